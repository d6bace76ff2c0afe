"""Shares of targets, sides and zones, repeats, and times that differ: kept by the chosen poses."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from calib.errors import CalibError, InputError
from calib.identification.prediction import Expectation
from posedesign.candidates import away_from_singularities, candidates_of, workplace_of
from posedesign.candidates.postures import in_front
from posedesign.cell import Cell
from posedesign.planning.optimal import OptimalPlan, Request, plan_optimal
from posedesign.planning.optimal import plan as optimal
from posedesign.selection import limited, mean_deviation, select
from tests.measured_cells import ARMS, cell_text

ARM = "kr6r900sixx"


@pytest.fixture(scope="module", autouse=True)
def _few_draws() -> Iterator[None]:
    """What more draws would still gain, a few thousandths, decides nothing here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limited, "PATIENCE", 1)
        patch.setattr(limited, "SMALL", 0)  # nor whether small pools are proven
        yield


def cell_with(more: str, kind: str = "two targets") -> Cell:
    pool = "" if "[pool]" in more else "[pool]\ncandidates = 50\n"
    return Cell.from_text(cell_text(kind, f'preset = "{ARM}"', ARMS[ARM]) + pool + more)


def targets_of(chosen: OptimalPlan) -> list[str]:
    return [label["target"] for label in chosen.labels]


def test_a_target_has_its_share_and_the_rest_is_as_good_as_can_be():
    free = plan_optimal(cell_with(""), Request(count=10, beside=0))
    few = targets_of(free).count("high")
    less = f'target = "high"\nmost = {few - 2}\n'
    more = f'target = "low"\nleast = {12 - few}\n'
    for limit, beside in ((less, 1), (more, 0)):
        cell = cell_with(f"[[pool.limit]]\n{limit}")
        limited = plan_optimal(cell, Request(count=10, beside=beside))
        assert targets_of(limited).count("high") == few - 2
        assert limited.selection.value >= free.selection.bound
        assert limited.selection.efficiency > 0.8


def test_sides_and_zones_are_kept():
    text = (
        '[pool]\ncandidates = 50\nconfigurations = "all"\n'
        '[[pool.limit]]\nside = "behind"\nmost = 2\n'
        "[[pool.limit]]\nlowest_mm = [-2000.0, -2000.0, {z}]\n"
        "highest_mm = [2000.0, 2000.0, 3000.0]\nleast = 9\n"
    )
    z = 1e3 * cell_with("").target_m[2]
    cell = cell_with(text.format(z=round(float(z) + 50.0, 1)))
    chosen = plan_optimal(cell, Request(count=14, beside=0))
    front = in_front(chosen.postures[:, 0], float(cell.base_posture[0]))
    assert (~front).sum() <= 2
    height = cell.robot.state(chosen.postures).point(cell.tool_m)[:, 2]
    assert (height > z / 1e3 + 0.05).sum() >= 9


def test_a_pose_is_measured_again_where_that_tells_more():
    cell = cell_with("[pool]\nrepeats = 4\ncandidates = 50\n", "touch-up")
    chosen = plan_optimal(cell, Request(count=12, beside=0, criterion="D"))
    once = plan_optimal(cell_with("", "touch-up"), Request(count=12, beside=0, criterion="D"))
    assert len(np.unique(chosen.postures, axis=0)) < 12
    assert chosen.selection.value > once.selection.value  # D: the larger the better
    assert len(chosen.postures) == 12


def test_a_given_time_is_spent_on_what_takes_less_where_that_tells_as_much(monkeypatch):
    """A tracker reads in 3 s what a touch-up takes 20 s for."""
    monkeypatch.setattr(optimal, "TRIED_COUNTS", 3)
    more = "[plan]\ndwell_s = 20.0\n[pool]\ncandidates = 24\n"
    text = cell_text("mixed", f'preset = "{ARM}"', ARMS[ARM])
    text = text.replace('kind = "point"\n', 'kind = "point"\ndwell_s = 3.0\n', 1) + more
    cell = Cell.from_text(text)
    chosen = plan_optimal(cell, Request(count=18, beside=0, time_s=200.0))
    assert chosen.cycle_time_s < 200.0
    of = targets_of(chosen)
    standing = sum(20.0 if target == "T1" else 3.0 for target in of)
    assert chosen.route.standing_s == pytest.approx(standing)
    slow = Cell.from_text(text.replace("dwell_s = 3.0", "dwell_s = 20.0"))
    even = plan_optimal(slow, Request(count=18, beside=0, time_s=200.0))
    assert of.count("tracker") > targets_of(even).count("tracker")
    assert chosen.accuracy.tcp_m < even.accuracy.tcp_m
    with pytest.raises(InputError, match="equations for"):
        plan_optimal(cell, Request(count=18, beside=0, time_s=20.0))


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ('target = "midle"\nleast = 2\n', "of the target 'midle', which no pose is of"),
        ('side = "behind"\nleast = 2\n', "limit 1 asks for 2 poses, and none of"),
        ('target = "high"\n', "a limit has least, most, or both"),
        ('target = "high"\nleast = 5\nmost = 3\n', "least 5 is above most 3"),
        ("lowest_mm = [0.0, 0.0, 0.0]\nleast = 1\n", "give both lowest_mm and highest_mm"),
        ('target = "high"\nleast = 20\n', "no choice keeps all limits at once"),
    ],
)
def test_limits_that_cannot_be_kept_are_refused(limit, message):
    with pytest.raises(CalibError) as refused:
        plan_optimal(cell_with(f"[[pool.limit]]\n{limit}"), Request(count=16, beside=0))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_fewest_poses_are_not_looked_for_within_limits():
    cell = cell_with('[[pool.limit]]\ntarget = "high"\nmost = 8\n')
    with pytest.raises(InputError, match="without limits and repeats"):
        plan_optimal(cell, Request(count=None, accuracy_m=1e-4))


def test_what_the_tracker_buys_against_the_pin_is_said():
    """Each target by itself, for as many poses: as a cell that has only that one."""
    cell = cell_with("", "mixed")
    at = workplace_of(cell)  # the arm will work there, whatever it is measured at
    both = plan_optimal(cell, Request(count=16))
    assert list(both.alone) == ["T1", "tracker"]
    for name, part in zip(both.alone, cell.parts, strict=True):
        pool = part.config.pool.model_copy(update={"candidates": 25})
        own = replace(part, config=part.config.model_copy(update={"pool": pool}))
        model, candidates = own.model(), candidates_of(away_from_singularities(own))
        work = Expectation(model, model.nominal, np.eye(model.p), at.postures, at.setup)
        moved = work.jacobian.reshape(len(at.postures), 3, model.p)
        one = select(candidates.white(model), 16, mean_deviation(moved), bound=False)
        assert both.alone[name] == pytest.approx(one.value, rel=0.02)
    assert both.of_pool.tcp_m < min(both.alone.values()) * 1.05
