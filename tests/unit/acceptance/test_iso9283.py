"""Characteristics of ISO 9283 against figures worked out by hand, and intervals by simulation."""

import math

import numpy as np
import pytest

from calib.errors import InputError
from posedesign.acceptance.iso9283 import CHANCE, distance_characteristics, pose_characteristics
from tests.marks import by_stage


def test_pose_figures_are_those_of_a_sheet_of_paper():
    """Barycentre off by (3, 4, 12): AP = 13. l = 1, 1, 2, 2: mean 1.5, S = sqrt(4 / 4 / 3)."""
    about = [(1, 0, 0), (-1, 0, 0), (0, 2, 0), (0, -2, 0)]
    found = pose_characteristics(np.add(about, [3.0, 4.0, 12.0]))
    assert found.accuracy.value == pytest.approx(13.0)
    assert found.deviation == pytest.approx([3.0, 4.0, 12.0])
    assert found.repeatability.value == pytest.approx(1.5 + 3.0 * math.sqrt(1.0 / 3.0))
    assert found.cycles == 4
    assert found.angles is None


def test_angles_have_three_standard_deviations_about_their_mean():
    """Angles 1, 2, 3: mean 2, S = 1, RP = 3; 0, 0, 3: mean 1, S = sqrt(3)."""
    turns = np.column_stack([[1.0, 2.0, 3.0], [0.0, 0.0, 3.0], [5.0, 5.0, 5.0]])
    found = pose_characteristics(np.zeros((3, 3)), turns)
    assert found.angles == pytest.approx([2.0, 1.0, 5.0])
    values = [each.value for each in found.angle_repeatability]
    assert values == pytest.approx([3.0, 3.0 * math.sqrt(3.0), 0.0])


def test_distance_figures_are_those_of_a_sheet_of_paper():
    """D = 10.1, 10.2, 10.3 where 10 was commanded: AD = 0.2, RD = 0.3."""
    found = distance_characteristics(np.array([10.1, 10.2, 10.3]), 10.0)
    assert found.accuracy.value == pytest.approx(0.2)
    assert found.repeatability.value == pytest.approx(0.3)
    # Student's t of 2 degrees of freedom is 4.3027 at 97.5 %: 4.3027 * 0.1 / sqrt(3)
    assert found.accuracy.high - 0.2 == pytest.approx(0.24842, rel=1e-4)
    # chi-square of 2 degrees of freedom at 97.5 % is 7.3778: 0.3 sqrt(2 / 7.3778)
    assert found.repeatability.low == pytest.approx(0.15620, rel=1e-4)


def test_figures_agree_with_sums_written_out():
    """Thirty cycles by loops over plain numbers, as a spreadsheet has them."""
    rng = np.random.default_rng(4)
    rows = (rng.normal(size=(30, 3)) * [0.02, 0.05, 0.03] + [0.1, -0.2, 0.05]).tolist()
    mean = [sum(row[k] for row in rows) / 30 for k in range(3)]
    far = [math.dist(row, mean) for row in rows]
    average = sum(far) / 30
    spread = math.sqrt(sum((value - average) ** 2 for value in far) / 29)
    found = pose_characteristics(np.array(rows))
    assert found.accuracy.value == pytest.approx(math.hypot(*mean))
    assert found.repeatability.value == pytest.approx(average + 3.0 * spread)


def test_one_cycle_has_no_repeatability_and_no_interval():
    found = pose_characteristics(np.array([[3.0, 0.0, 4.0]]))
    assert found.accuracy.value == 5.0
    assert math.isnan(found.accuracy.low)
    assert math.isnan(found.repeatability.value)
    assert math.isnan(distance_characteristics(np.array([2.0]), 1.0).repeatability.value)


def test_rows_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"deviations of shape \(3, 2\)"):
        pose_characteristics(np.zeros((3, 2)))
    with pytest.raises(InputError, match="one row of three numbers a cycle"):
        pose_characteristics(np.full((3, 3), np.nan))


@pytest.mark.parametrize("scatter", [(1.0, 1.0, 1.0), (1.0, 0.3, 0.1)], ids=["round", "long"])
@pytest.mark.parametrize("off", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("trials", by_stage(30, 200, 1500))
def test_intervals_hold_what_many_cycles_would_find(scatter, off, trials):
    """AP at least as often as they say, RP, AD and RD as often, within 3.5 standard deviations."""
    rng, sigma = np.random.default_rng(11), np.array(scatter)
    true = off * np.ones(3)
    many = rng.standard_normal((200_000, 3)) * sigma
    far = np.linalg.norm(many, axis=1)
    rp = far.mean() + 3.0 * far.std()
    held = np.zeros(4)
    for _ in range(trials):
        rows = true + rng.standard_normal((30, 3)) * sigma
        pose = pose_characteristics(rows)
        distance = distance_characteristics(rows[:, 0], 0.0)
        for k, (figure, what) in enumerate(
            (
                (pose.accuracy, np.linalg.norm(true)),
                (pose.repeatability, rp),
                (distance.accuracy, off),
                (distance.repeatability, 3.0 * sigma[0]),
            )
        ):
            held[k] += figure.low <= what <= figure.high
    slack = 3.5 * math.sqrt(CHANCE * (1.0 - CHANCE) / trials)
    assert (held / trials > CHANCE - slack - 0.01).all(), held / trials
    assert (held[1:] / trials < CHANCE + slack + 0.015).all(), held / trials
