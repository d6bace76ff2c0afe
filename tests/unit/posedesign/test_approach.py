"""All joints arrive at all poses from one side, whatever the poses; where not, it is said why."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from posedesign.constraints import MotionChecker
from posedesign.constraints.space import WayVerdicts
from posedesign.motion import Router
from posedesign.motion.route import Passing, Route, RouteOptions
from posedesign.planning import plan

FREE = MotionChecker((), np.inf)
ANGLE = np.deg2rad(1.0)
SAME_SIDE = RouteOptions(approach_rad=ANGLE)


def last_movements(base: np.ndarray, found: Route) -> np.ndarray:
    """By how much every joint moves on to each pose since it last stood or turned round [rad].

    Followed back from the pose, stop by stop, as long as the joint moves the same way.
    """
    path = np.array([base, *(stop.posture for stop in found.stops)])
    moves = np.diff(path, axis=0)
    arrived = []
    for row in (i for i, stop in enumerate(found.stops) if stop.pose is not None):
        total = moves[row].copy()
        for joint in range(path.shape[1]):
            for before in range(row - 1, -1, -1):
                if found.stops[before].pose is not None:
                    break  # it stands there
                if moves[before, joint] * moves[row, joint] <= 0.0:
                    break
                total[joint] += moves[before, joint]
        arrived.append(total)
    return np.array(arrived)


def check_one_side(base: np.ndarray, found: Route, angle: float) -> None:
    arrived = last_movements(base, found)
    assert np.abs(arrived).min() >= angle - 1e-12
    assert (np.sign(arrived) == np.sign(arrived[0])).all()


@given(
    share=arrays(float, st.tuples(st.integers(1, 6), st.just(6)), elements=st.floats(0.05, 0.95))
)
@settings(max_examples=25, deadline=None)
def test_joints_arrive_from_one_side(reference_cell, share):
    cell = reference_cell
    robot = cell.robot
    q = robot.lower + share * robot.joint_range
    q = q[cell.passing.check(q).feasible]
    found = Router(robot, FREE, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    kept = [i for i in range(len(q)) if i not in found.lost]
    assert sorted(found.order) == kept
    if kept:
        check_one_side(cell.base_posture, found, ANGLE)
    for stop in found.stops:
        assert cell.passing.check(stop.posture[None]).feasible.all()


@pytest.mark.parametrize("angle_deg", [0.5, 3.0])
def test_poses_of_a_plan_are_approached(make_demo_cell, angle_deg):
    """Among floor, fixture and gun: passed postures and ways keep what the poses keep."""
    cell = make_demo_cell(plan={"approach": "same-side", "approach_deg": angle_deg})
    found = plan(cell)
    assert len(found.postures) >= 26
    check_one_side(cell.base_posture, found.route, np.deg2rad(angle_deg))
    stops = np.array([cell.base_posture, *(stop.posture for stop in found.route.stops)])
    assert cell.passing.check(stops).feasible.all()
    assert cell.ways.check(stops[:-1], stops[1:]).clear.all()
    for before, stop in zip(found.route.stops, found.route.stops[1:], strict=False):
        assert stop.pose is None or before.passing is Passing.APPROACH


def test_without_it_joints_arrive_from_both_sides(make_demo_cell):
    """The check can fail."""
    cell = make_demo_cell()
    arrived = last_movements(cell.base_posture, plan(cell).route)
    assert (arrived > 0.0).any(axis=0).all()
    assert (arrived < 0.0).any(axis=0).all()


def test_a_joint_at_its_lower_limit_turns_all_of_them(reference_cell):
    """One pose has no room below J5, so J5 arrives from above everywhere; the others from below."""
    cell = reference_cell
    q = np.tile(cell.base_posture, (3, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0, 30.0])
    q[1, 4] = cell.robot.lower[4] + cell.margin + 0.5 * ANGLE
    found = Router(cell.robot, FREE, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert found.lost == {}
    signs = np.sign(last_movements(cell.base_posture, found))
    np.testing.assert_array_equal(signs, np.tile([1.0, 1, 1, 1, -1, 1], (3, 1)))


def test_what_cannot_be_approached_like_most_is_lost(reference_cell):
    """Two poses at the lower limit of J5, one at the upper: the one is given up, and why."""
    cell = reference_cell
    q = np.tile(cell.base_posture, (3, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0, 30.0])
    q[[0, 2], 4] = cell.robot.lower[4] + cell.margin + 0.5 * ANGLE
    q[1, 4] = cell.robot.upper[4] - cell.margin - 0.5 * ANGLE
    found = Router(cell.robot, FREE, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert list(found.lost) == [1]
    assert found.lost[1].startswith("cannot be approached from one side: J5 ")
    assert sorted(found.order) == [0, 2]
    check_one_side(cell.base_posture, found, ANGLE)


class ShutFromBelow(MotionChecker):
    """No short way leads to joint 1 at 20 deg from below, or from either side."""

    def __init__(self, *bounds: Any, both: bool = False) -> None:
        super().__init__(*bounds)
        object.__setattr__(self, "both", both)

    def check(self, start: np.ndarray, end: np.ndarray, *, far: bool = False) -> WayVerdicts:
        there = np.isclose(np.rad2deg(end[:, 0]), 20.0)
        step = end[:, 0] - start[:, 0]
        step = np.abs(step) if self.both else step  # type: ignore[attr-defined]
        hit = there & (step > 0.0) & (step < 2.0 * ANGLE)
        none = np.zeros(len(hit))
        return WayVerdicts(~hit, none, none, tuple("a wall" if h else "" for h in hit))


def test_a_blocked_way_from_the_passed_posture_turns_the_joint(reference_cell):
    cell = reference_cell
    q = np.tile(cell.base_posture, (2, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0])
    ways = ShutFromBelow((), np.inf)
    found = Router(cell.robot, ways, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert found.lost == {}
    signs = np.sign(last_movements(cell.base_posture, found))
    np.testing.assert_array_equal(signs, np.tile([-1.0, 1, 1, 1, 1, 1], (2, 1)))


def test_a_wall_on_both_sides_loses_the_pose(reference_cell):
    cell = reference_cell
    q = np.tile(cell.base_posture, (2, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0])
    ways = ShutFromBelow((), np.inf, both=True)
    found = Router(cell.robot, ways, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert found.lost == {1: "cannot be approached from one side: a wall"}
    assert found.order.tolist() == [0]
