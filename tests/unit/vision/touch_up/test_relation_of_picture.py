"""The designated relation: its numbers are linear in the place of the target."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.se3 import transform
from calib.vision.camera import Camera, circle_image
from calib.vision.touch_up import Relation

FACING = np.diag([1.0, -1.0, -1.0])


def test_error_is_linear_in_the_place_of_the_target():
    """Also 100 mm off: Eq. 1, but for what a finite circle off the axis is longer by."""
    camera = Camera.paper()
    relation = Relation((320.0, 240.0), 1600.0 * 0.002 / 0.35)
    rng = np.random.default_rng(1)
    for _ in range(20):
        p0 = np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.25, 0.45)])
        way = np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(-0.1, 0.1)])
        e = [
            relation.error(circle_image(camera, 0.002, transform(FACING, p0 + k * way)))
            for k in (0.0, 0.5, 1.0)
        ]
        assert np.abs(e[0] + e[2] - 2.0 * e[1]).max() < 0.02


def test_numbers_are_those_of_equation_2():
    """``(V - V0) s0/s``, ``(H - H0) s0/s``, ``s0 (s0/s - 1)``, a bias taken off first."""
    relation = Relation((100.0, 80.0), 30.0)
    ellipse = np.array([110.0, 60.0, 20.0, 0.0, 15.0])
    assert relation.error(ellipse) == pytest.approx([-15.0, 7.5, -7.5])
    assert relation.error(ellipse, np.array([-20.0, 10.0, 10.0])) == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("center", "size"), [((0.0, 0.0), 0.0), ((0.0, 0.0), -3.0), ((float("nan"), 0.0), 10.0)]
)
def test_relation_without_size_or_place_is_refused(center, size):
    with pytest.raises(InputError, match="cannot be designated"):
        Relation(center, size)
