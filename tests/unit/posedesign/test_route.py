"""The round through the poses: short, along clear ways only, with detours where they must be."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.cell import Cell
from posedesign.constraints import MotionChecker
from posedesign.constraints.space import WayVerdicts
from posedesign.motion import Router
from posedesign.motion.route import Passing, Route, RouteOptions

FREE = MotionChecker((), np.inf)


class Walls(MotionChecker):
    """Ways between given numbers of joint 1 [deg] are blocked, where joint 2 stands at 15 deg."""

    def __init__(self, *blocked: tuple[float, float]) -> None:
        super().__init__((), np.inf)
        object.__setattr__(self, "blocked", {frozenset(pair) for pair in blocked})
        object.__setattr__(self, "asked", [])

    def check(self, start: np.ndarray, end: np.ndarray, *, far: bool = False) -> WayVerdicts:
        ends = np.rad2deg(np.stack([start[:, 0], end[:, 0]], axis=1)).round(6)
        self.asked.append(len(ends))  # type: ignore[attr-defined]
        low = np.isclose(np.rad2deg([start[:, 1], end[:, 1]]), 15.0).all(axis=0)
        hit = np.array([frozenset(pair) in self.blocked for pair in ends.tolist()])  # type: ignore[attr-defined]
        clear = ~(hit & low)
        return WayVerdicts(
            clear,
            np.zeros(len(ends)),
            np.full(len(ends), np.nan),
            tuple("" if c else "a wall" for c in clear),
        )


def at(*degrees: float) -> np.ndarray:
    """Postures of the reference arm with joint 1 at some angles."""
    q = np.tile(np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0]), (len(degrees), 1))
    q[:, 0] = np.deg2rad(degrees)
    return q


def route(
    reference_cell: Cell, ways: MotionChecker, *degrees: float, options: RouteOptions | None = None
) -> Route:
    cell = reference_cell
    return Router(cell.robot, ways, cell.passing, cell.base_posture, options).route(at(*degrees))


def test_poses_are_visited_along_the_shortest_way(reference_cell):
    options = RouteOptions(return_to_base=False)
    found = route(reference_cell, FREE, 30.0, 10.0, 20.0, options=options)
    assert found.order.tolist() == [1, 2, 0]
    assert [stop.pose for stop in found.stops] == [1, 2, 0]
    assert found.detours == 0
    assert found.lost == {}


def test_the_round_ends_at_the_base_posture(reference_cell):
    """Past 70 deg on the way there or on the way back: the same time, so as it is on one side."""
    found = route(reference_cell, FREE, 140.0, 70.0, -30.0)
    assert sorted(found.order) == [0, 1, 2]
    assert found.stops[-1].pose is None
    assert found.stops[-1].passing is Passing.RETURN
    np.testing.assert_array_equal(found.stops[-1].posture, reference_cell.base_posture)
    assert len(found.stops) == 4
    assert found.detours == 0
    # there and back at 130 deg/s, with a ramp for each of the four moves
    assert found.moving_s == pytest.approx(2.0 * (140.0 + 30.0) / 130.0 + 4 * 0.3, abs=0.02)


@pytest.mark.parametrize(
    ("degrees", "blocked", "detours"),
    [((10.0, 20.0, 30.0), [(0.0, 30.0)], False), ((20.0, 30.0), [(0.0, 30.0), (0.0, 20.0)], True)],
)
def test_the_way_back_is_clear(reference_cell, degrees, blocked, detours):
    """Where nothing leads back from the last pose: by another pose last, else by a detour."""
    walls = Walls(*blocked)
    found = route(reference_cell, walls, *degrees)
    path = np.array([reference_cell.base_posture, *(stop.posture for stop in found.stops)])
    assert walls.check(path[:-1], path[1:]).clear.all()
    assert found.lost == {}
    assert found.stops[-1].passing is Passing.RETURN
    assert (found.detours > 0) == detours


def test_time_of_a_route(reference_cell):
    """Half the speed, 20 s at each pose; without any speeds it is not known."""
    robot, dwell = reference_cell.robot, RouteOptions(dwell_s=20.0, speed_share=0.5)
    found = route(reference_cell, FREE, 130.0, options=dwell)
    assert found.moving_s == pytest.approx(2 * (2.0 + 0.3))
    assert found.standing_s == 20.0
    assert found.cycle_time_s == pytest.approx(24.6)
    assert found.timing == ("predicted cycle time 25 s: 5 s moving, 20 s standing at 1 pose(s)")
    unknown = replace(robot, speed=np.full(6, np.nan))
    cell = reference_cell
    silent = Router(unknown, FREE, cell.passing, cell.base_posture).route(at(10.0, 20.0))
    assert np.isnan(silent.cycle_time_s)
    assert "not known" in silent.timing


def test_the_router_of_a_cell_does_what_its_plan_says(make_cell):
    plan = {"return_to_base": False, "approach": "same-side", "approach_deg": 3.0, "dwell_s": 5.0}
    cell = make_cell(plan=plan, program={"speed_percent": 50})
    assert Router.of_cell(cell).options == RouteOptions(False, np.deg2rad(3.0), 5.0, 0.5)
    assert Router.of_cell(make_cell()).options == RouteOptions(True, 0.0, 20.0, 0.1)


def test_a_blocked_way_changes_the_order(reference_cell):
    found = route(reference_cell, Walls((10.0, 20.0)), 10.0, 20.0, 30.0)
    steps = [frozenset(pair) for pair in pairwise([0, *np.array([10, 20, 30])[found.order]])]
    assert frozenset((10, 20)) not in steps
    assert sorted(found.order) == [0, 1, 2]
    assert found.detours == 0


def test_a_detour_where_no_order_is_clear(reference_cell):
    walls = Walls((0.0, 20.0), (10.0, 20.0))
    found = route(reference_cell, walls, 10.0, 20.0, options=RouteOptions(return_to_base=False))
    assert found.detours == 1
    assert sorted(found.order) == [0, 1]
    path = [reference_cell.base_posture, *(stop.posture for stop in found.stops)]
    assert walls.check(np.array(path[:-1]), np.array(path[1:])).clear.all()
    drawn_back = next(stop.posture for stop in found.stops if stop.pose is None)
    robot = reference_cell.robot
    poses = robot.fk(np.vstack([drawn_back, at(10.0, 20.0)]))
    # the tool is drawn back along its own z, by the shortest retreat
    apart = np.linalg.norm(poses[1:, :3, 3] - poses[0, :3, 3], axis=1)
    assert apart.min() == pytest.approx(0.1, abs=1e-9)


class Prison(MotionChecker):
    """No way leads to joint 1 at 20 deg, from wherever."""

    def check(self, start: np.ndarray, end: np.ndarray, *, far: bool = False) -> WayVerdicts:
        inside = np.isclose(np.rad2deg([start[:, 0], end[:, 0]]), 20.0).any(axis=0)
        return WayVerdicts(
            ~inside,
            np.zeros(len(start)),
            np.zeros(len(start)),
            tuple("a wall" if i else "" for i in inside),
        )


def test_a_pose_that_no_way_leads_to_is_lost(reference_cell):
    found = route(reference_cell, Prison((), np.inf), 10.0, 20.0, 30.0)
    assert found.lost == {1: "no clear way to it: a wall"}
    assert sorted(found.order) == [0, 2]


class Maze(MotionChecker):
    """Only given pairs of numbers of joint 1 [deg] are joined by a clear way."""

    def __init__(self, *clear: tuple[float, float]) -> None:
        super().__init__((), np.inf)
        object.__setattr__(self, "joined", {frozenset(pair) for pair in clear})

    def check(self, start: np.ndarray, end: np.ndarray, *, far: bool = False) -> WayVerdicts:
        ends = np.rad2deg(np.stack([start[:, 0], end[:, 0]], axis=1)).round(6).tolist()
        clear = np.array([frozenset(pair) in self.joined or pair[0] == pair[1] for pair in ends])  # type: ignore[attr-defined]
        none = np.zeros(len(ends))
        return WayVerdicts(clear, none, none, tuple("" if c else "a wall" for c in clear))


@pytest.mark.parametrize("seed", range(10))
def test_a_path_through_a_maze_is_found(reference_cell, seed):
    """One clear path through seven poses and as many ways that lead nowhere: none is given up."""
    rng = np.random.default_rng(seed)
    degrees = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    path = [0.0, *rng.permutation(degrees)]
    more = [tuple(rng.choice(degrees, 2, replace=False)) for _ in range(6)]
    maze = Maze(*pairwise(path), *more)
    found = route(reference_cell, maze, *degrees)
    assert found.lost == {}
    assert sorted(found.order) == list(range(6))
    stops = np.array([reference_cell.base_posture, *(stop.posture for stop in found.stops)])
    assert maze.check(stops[:-1], stops[1:]).clear.all()


def test_only_ways_of_the_order_are_checked(reference_cell):
    walls = Walls()
    route(reference_cell, walls, *range(5, 65, 5))
    assert walls.asked == [13]  # type: ignore[attr-defined]


def test_travel_of_a_joint_is_bounded():
    ways = MotionChecker((), np.deg2rad(45.0))
    verdicts = ways.check(at(0.0, 0.0), at(45.0, 46.0))
    assert verdicts.clear.tolist() == [True, False]
    assert verdicts.reasons == ("", "J1 travels 46 deg, 45 deg allowed")
    np.testing.assert_allclose(np.rad2deg(verdicts.travel), [45.0, 46.0])


def test_fast_joints_count_less(make_cell):
    """Time counts, not angle: joint 6 of this arm is twice as fast as joint 1."""
    robot = Robot.preset("r2000ic165f")
    q = np.tile(make_cell().base_posture, (2, 1))
    q[0, 0] += np.deg2rad(30.0)  # 0.23 s at 130 deg/s
    q[1, 5] += np.deg2rad(40.0)  # 0.15 s at 260 deg/s
    found = Router(robot, FREE, make_cell().passing, make_cell().base_posture).route(q)
    assert found.order[0] == 1
