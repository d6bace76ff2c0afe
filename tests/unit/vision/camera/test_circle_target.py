"""The target: its pattern, its corners, and what is refused."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.vision.camera import CircleTarget


def test_areas_by_monte_carlo():
    """Dark: circle less cross, pi r² - (2 L w - w²); light: the rest of the plate."""
    target = CircleTarget(0.02, (0.05, 0.04), 0.012, 0.002, circle=0.1, face=0.9)
    count = 400_000
    xy = np.random.default_rng(0).uniform(-0.03, 0.03, (count, 2))
    seen = target.pattern(xy)
    cross = 2 * 0.012 * 0.002 - 0.002**2
    dark = np.pi * 0.01**2 - cross
    for area, share in [
        (dark, (seen == 0.1).mean()),
        (0.05 * 0.04 - dark, (seen == 0.9).mean()),
        (0.06**2 - 0.05 * 0.04, np.isnan(seen).mean()),
    ]:
        p = area / 0.06**2
        assert share == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / count))


def test_corners_are_where_the_pattern_changes():
    """About a corner three quarters are of one kind and one of the other."""
    target = CircleTarget()
    assert target.corners().shape == (16, 3)
    quarters = 1e-6 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    for corner in target.corners():
        seen = np.nan_to_num(target.pattern(corner[:2] + quarters), nan=-1.0)
        values, counts = np.unique(seen, return_counts=True)
        assert len(values) == 2
        assert sorted(counts) == [1, 3]


def test_corners_follow_each_other_about_z():
    for corners in (CircleTarget().plate_corners(), CircleTarget().cross_corners()):
        x, y, _ = corners.T
        area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
        assert area > 0.0
    assert CircleTarget(cross_length_m=0.0).cross_corners().shape == (0, 3)


def test_rim_is_on_the_circle():
    rim = CircleTarget(0.03).rim(7)
    np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 0.015)
    assert (rim[:, 2] == 0.0).all()


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"diameter_m": 0.0}, "diameter_m"),
        ({"diameter_m": 0.05}, "diameter_m"),
        ({"cross_length_m": 0.02}, "cross_length_m"),
        ({"cross_width_m": 0.013}, "cross_width_m"),
        ({"face": 1.1}, "face"),
        ({"face": 0.08}, "circle"),
    ],
)
def test_impossible_targets_are_refused(arguments, name):
    with pytest.raises(InputError) as caught:
        CircleTarget(**arguments)
    assert caught.value.name == name
