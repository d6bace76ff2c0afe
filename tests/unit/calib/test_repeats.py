"""Which measurements are left out together."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.model.measurements import Measurements, Setup
from calib.model.measurements.repeats import SAME_POSTURE_RAD, repeated_together, same_posture


def test_of_one_name_or_at_one_posture() -> None:
    q = np.array([[0.0, 1.0], [1.0, 1.0], [0.001, 1.001], [0.002, 1.0], [0.0, 1.0], [2.0, 2.0]])
    data = Measurements(q, Setup.of(6), names=("A", "B", "C", "D", "E", "B"))
    # A, C and E are at one posture; D is too far in one joint; B has one name
    np.testing.assert_array_equal(data.groups == data.groups[:, None], expected())
    np.testing.assert_array_equal(data[np.array([5, 1, 3])].groups, [0, 0, 1])


def expected() -> np.ndarray:
    index = np.array([0, 1, 0, 2, 0, 1])
    return index == index[:, None]


def test_a_slow_path_is_not_one_posture() -> None:
    q = np.linspace(0.0, 1.0, 5000)[:, None] * np.ones(6)
    index = same_posture(q)
    assert np.abs(q - q[np.unique(index, return_index=True)[1]][0]).max() == 1.0
    assert len(np.unique(index)) > 250
    for each in np.unique(index):
        assert np.ptp(q[index == each], axis=0).max() <= 2 * SAME_POSTURE_RAD


def test_many_at_one_posture() -> None:
    """Pairs are not counted one by one: there are fifty million of them."""
    q = np.zeros((10_000, 6))
    assert not repeated_together(np.arange(10_000), q).any()


@given(st.integers(0, 10_000), st.integers(1, 30))
def test_the_order_of_measurements_does_not_matter(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(0, 4 * SAME_POSTURE_RAD, (count, 2))
    pose = rng.integers(0, count, count)
    order = rng.permutation(count)
    groups = repeated_together(pose, q)
    again = repeated_together(pose[order], q[order])
    np.testing.assert_array_equal(again == again[:, None], groups[order] == groups[order][:, None])
