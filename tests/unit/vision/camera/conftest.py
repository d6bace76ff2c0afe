"""Poses, camera and target that the tests of the camera share."""

from collections.abc import Callable

import numpy as np
import pytest

from calib import se3
from calib.vision.camera import Camera, CircleTarget

Looking = Callable[..., np.ndarray]


@pytest.fixture(scope="session")
def camera() -> Camera:
    """The camera of the paper."""
    return Camera.paper()


@pytest.fixture(scope="session")
def target() -> CircleTarget:
    """A circle of 20 mm on a plate of 40 mm."""
    return CircleTarget()


@pytest.fixture(scope="session")
def looking() -> Looking:
    """T_camera_target of a target that faces the camera, tilted about the camera's x axis."""

    def pose(
        tilt_deg: float = 0.0,
        x_m: float = 0.0,
        y_m: float = 0.0,
        z_m: float = 0.35,
        spin_deg: float = 0.0,
    ) -> np.ndarray:
        tilted = se3.rotation_from_wpr(np.deg2rad([180.0 + tilt_deg, 0.0, 0.0]))
        spun = se3.rotation_from_wpr(np.deg2rad([0.0, 0.0, spin_deg]))
        return se3.transform(tilted @ spun, [x_m, y_m, z_m])

    return pose
