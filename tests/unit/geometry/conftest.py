"""A plain arm whose distances can be reckoned by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from calib.geometry import Body, Solid
from calib.robots import SerialChain
from calib.se3 import transform


@pytest.fixture
def straight_arm() -> SerialChain:
    """Four joints about z, one metre apart along x; at zero the links lie on the x axis."""
    placements = np.repeat(np.eye(4)[None], 4, axis=0)
    placements[1:, 0, 3] = 1.0
    axes = np.tile([0.0, 0.0, 1.0], (4, 1))
    return SerialChain(placements, axes, transform(np.eye(3), [1.0, 0.0, 0.0]))


@pytest.fixture
def body() -> Callable[..., Body]:
    """A body at a place of its link, not turned."""

    def make(name: str, link: int, solid: Solid, at: tuple[float, float, float]) -> Body:
        return Body(name, link, transform(np.eye(3), at), solid)

    return make
