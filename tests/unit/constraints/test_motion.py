"""Orders against all orders; tours are short, along clear motions, with one-sided arrivals."""

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calib.robots import Robot
from calib.robots.move_times import ACCELERATION_S, move_times, moving_time_s
from posedesign.cell import Cell
from posedesign.constraints import MotionChecker
from posedesign.motion import Router
from posedesign.motion.order import OrderSearch, legs_of, shortest_order
from posedesign.motion.route import Passing, Route, RouteOptions
from posedesign.planning import plan
from tests.blocked import Blocked


def length(cost: np.ndarray, order: list[int], closed: bool) -> float:
    return float(sum(cost[a, b] for a, b in pairwise([*order, order[0]] if closed else order)))


def costs(count: int, seed: int, *, uneven: float = 0.0) -> np.ndarray:
    """Largest differences of random points in six dimensions; not the same there and back."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(count, 6))
    cost = np.abs(points[:, None] - points[None]).max(axis=-1)
    cost = cost + uneven * rng.uniform(size=cost.shape)
    np.fill_diagonal(cost, 0.0)
    return cost


def best_of_all(cost: np.ndarray, closed: bool) -> float:
    """Held and Karp: the best way to every place through every set of places."""
    n = len(cost) - 1
    best = np.full((1 << n, n), np.inf)
    best[1 << np.arange(n), np.arange(n)] = cost[0, 1:]
    for places in range(1, 1 << n):
        for last in range(n):
            if places >> last & 1 and places != 1 << last:
                before = best[places ^ (1 << last)]
                best[places, last] = (before + cost[1:, 1 + last]).min()
    return float((best[-1] + (cost[1:, 0] if closed else 0.0)).min())


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_order_against_all_orders(seed, closed):
    """Four to eight places: none of all orders is shorter."""
    count = 4 + seed % 5
    cost = costs(count, seed)
    order = shortest_order(cost, closed=closed)
    assert order[0] == 0
    assert sorted(order) == list(range(count))
    best = min(length(cost, [0, *rest], closed) for rest in permutations(range(1, count)))
    assert length(cost, order, closed) == pytest.approx(best, rel=1e-8)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_costs_that_differ_there_and_back(seed, closed):
    """As with approaches: near the best of all orders, though the search averages the two."""
    cost = costs(8, seed, uneven=0.03)
    found = length(cost, shortest_order(cost, closed=closed), closed)
    best = min(length(cost, [0, *rest], closed) for rest in permutations(range(1, 8)))
    assert found <= 1.01 * best


def test_rounding_to_whole_numbers_loses_nothing_that_counts():
    """A heap of near places and one that is a thousand times as far: not lost in the rounding."""
    points = np.random.default_rng(5).uniform(size=(12, 6))
    points[7] += 1000.0
    cost = np.abs(points[:, None] - points[None]).max(axis=-1)
    found = length(cost, shortest_order(cost, closed=True), True)
    there_and_back = 2.0 * np.sort(cost[7])[1]
    best = best_of_all(cost, closed=True)
    assert found - there_and_back <= (best - there_and_back) * 1.01
    assert found <= (1.0 + 1e-4) * best


def test_a_thorough_search_finds_what_the_quick_one_does_not():
    """Of three sets of 60 places most are shorter, none is longer."""
    gains = []
    for seed in range(3):
        cost = costs(60, seed)
        quick, thorough = (
            length(cost, shortest_order(cost, closed=True, thorough=t), True) for t in (False, True)
        )
        gains.append(1.0 - thorough / quick)
    assert min(gains) >= 0.0
    assert np.median(gains) > 0.002


@pytest.mark.parametrize(("seed", "best"), [(0, 20.13765), (1, 20.50782), (2, 19.96675)])
def test_long_orders_are_near_the_best_known(seed, best):
    """Rounds of 60 places: within .5 % of those of fast-tsp 0.2.2 in a second each."""
    found = length(costs(60, seed), shortest_order(costs(60, seed), closed=True), True)
    assert best * (1.0 - 1e-5) <= found <= 1.005 * best


@pytest.mark.parametrize(("count", "best"), [(217, 64.066764), (501, 126.649813)])
def test_orders_of_hundreds_with_blocked_ways_are_near_the_best_known(count, best):
    """Half of the ways blocked: within 1 % of rounds by Lin, Kernighan and Helsgaun (elkai 2.0.1).

    None of the blocked ways is taken.
    """
    cost = costs(count, 0)
    shut = np.triu(np.random.default_rng(100).uniform(size=cost.shape) < 0.5, 1)
    cost[shut | shut.T] = np.inf
    found = length(cost, shortest_order(cost, closed=True), True)
    assert best * (1.0 - 1e-7) <= found <= 1.01 * best


@pytest.mark.parametrize("count", [12, 27, 90])
def test_the_order_does_not_depend_on_rounding(count):
    """As arithmetic of another machine differs: by some of the last digits of each cost."""
    cost = costs(count, 1)
    rounded = np.random.default_rng(2).uniform(-4e-16, 4e-16, cost.shape)
    assert shortest_order(cost, closed=True) == shortest_order(cost * (1.0 + rounded), closed=True)


@pytest.mark.parametrize("closed", [True, False])
def test_an_order_is_repaired_where_ways_turn_out_to_be_blocked(closed):
    """One way after the other is taken away: the order avoids all, and is as short as anew."""
    cost = costs(40, 4)
    found = OrderSearch(cost, closed=closed)
    for _ in range(12):
        order = found.order
        legs = legs_of(order, closed=closed)
        shut = max(legs, key=lambda leg: cost[leg])
        cost[shut] = cost[shut[::-1]] = np.inf
        found.change([shut, shut[::-1]], np.array([np.inf, np.inf]))
    found.search()
    again = found.order
    assert sorted(again) == list(range(40))
    anew = length(cost, shortest_order(cost, closed=closed), closed)
    assert length(cost, again, closed) <= 1.02 * anew


@pytest.mark.parametrize("uneven", [0.0, 0.2])
def test_no_stretch_turned_round_or_moved_would_be_shorter(uneven):
    cost = costs(25, 3, uneven=uneven)
    order = shortest_order(cost, thorough=False)
    found = length(cost, order, False)
    for i in range(1, 25):
        for j in range(i + 1, 25):
            other = [*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]
            assert length(cost, other, False) >= found - 1e-9
    for size in (1, 2, 3):
        for i in range(1, 26 - size):
            stretch, rest = order[i : i + size], [*order[:i], *order[i + size :]]
            for k in range(1, len(rest) + 1):
                for part in (stretch, stretch[::-1]):
                    other = [*rest[:k], *part, *rest[k:]]
                    assert length(cost, other, False) >= found - 1e-9


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_places(count, closed):
    assert shortest_order(np.zeros((count, count)), closed=closed) == list(range(count))


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_ways_that_do_not_exist_are_avoided(seed, closed):
    """One round, and as many ways again: every order but one of few leads through a wall."""
    rng = np.random.default_rng(seed)
    count = 9
    cost = np.full((count, count), np.inf)
    circle = [0, *(1 + rng.permutation(count - 1))]
    more = [rng.choice(count, 2, replace=False) for _ in range(count)]
    for a, b in [*pairwise([*circle, 0]), *more]:
        cost[a, b] = cost[b, a] = rng.uniform(1.0, 2.0)
    order = shortest_order(cost, closed=closed)
    assert np.isfinite(length(cost, order, closed))
    assert length(cost, order, closed) <= (1.0 + 1e-4) * best_of_all(cost, closed)


@pytest.mark.parametrize(
    ("degrees", "order"),
    [((20, 100, 190, 280), [0, 1, 2, 3, 4]), ((80, 170, 260, 340), [0, 4, 3, 2, 1])],
)
def test_a_round_begins_with_the_nearer_end(degrees, order):
    angle = np.deg2rad([0, *degrees])
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    cost = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert shortest_order(cost, closed=True) == order


@pytest.mark.parametrize("moves_deg", [[0.0, 0.0], [3.0, 1.0], [5.0, 60.0], [-90.0, 20.0]])
def test_times_against_joints_that_are_run(moves_deg):
    """Speed up with v/t, hold v, slow down: the time in which the steps add up to the way."""
    speeds, ramp = np.deg2rad([20.0, 50.0]), 0.3
    moves = np.deg2rad(moves_deg)
    slowest = 0.0
    for way, speed in zip(np.abs(moves), speeds, strict=True):
        step, gone, going, clock = 1e-4, 0.0, 0.0, 0.0
        braking = 0.0  # way that is needed to stop
        while gone + braking < way:
            going = min(speed, going + speed / ramp * step)
            gone, clock = gone + going * step, clock + step
            braking = going**2 / (2.0 * speed / ramp)
        slowest = max(slowest, clock + going / (speed / ramp))
    assert move_times(moves, speeds, ramp) == pytest.approx(slowest, abs=1e-3)


def test_times_without_ramps_and_of_many_moves():
    speeds = np.array([1.0, 2.0])
    moves = np.array([[[1.0, 1.0], [0.5, -3.0]]])
    np.testing.assert_allclose(move_times(moves, speeds, 0.0), [[1.0, 1.5]])


def test_time_of_a_tour():
    """There at 2 rad/s in 1 + 0.3 s, on in 0.5 + 0.3 s, back in 1.5 + 0.3 s."""
    path = np.array([[0.0], [2.0], [3.0], [0.0]])
    assert moving_time_s(path, [2.0], 0.3) == pytest.approx(1.3 + 0.8 + 1.8)


def test_a_detour_takes_longer():
    """Stopping on the way costs a ramp, whatever the way."""
    speeds = 0.1 * Robot.preset("r2000ic165f").speed
    path = np.deg2rad([[0.0] * 6, [40.0, 10, 20, -30, 5, 60]])
    halfway = np.insert(path, 1, path.mean(axis=0), axis=0)
    times = [moving_time_s(q, speeds, ACCELERATION_S) for q in (path, halfway)]
    assert times[1] - times[0] == pytest.approx(ACCELERATION_S)


FREE = MotionChecker((), np.inf)


def ends_deg(start: np.ndarray, end: np.ndarray) -> list[frozenset[float]]:
    """Numbers of joint 1 between which motions lead."""
    ends = np.rad2deg(np.stack([start[:, 0], end[:, 0]], axis=1)).round(6)
    return [frozenset(pair) for pair in ends.tolist()]


def walls(*blocked: tuple[float, float]) -> Blocked:
    """Between given numbers of joint 1 [deg], where joint 2 stands at 15 deg."""
    shut = {frozenset(pair) for pair in blocked}

    def hit(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        low = np.isclose(np.rad2deg([start[:, 1], end[:, 1]]), 15.0).all(axis=0)
        return low & [pair in shut for pair in ends_deg(start, end)]

    return Blocked(hit)


def prison(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """No motion leads to joint 1 at 20 deg, from wherever."""
    return np.isclose(np.rad2deg([start[:, 0], end[:, 0]]), 20.0).any(axis=0)


def maze(*clear: tuple[float, float]) -> Blocked:
    """Only given pairs of numbers of joint 1 [deg] are joined by a clear motion."""
    joined = {frozenset(pair) for pair in clear}
    return Blocked(
        lambda start, end: np.array([p not in joined and len(p) > 1 for p in ends_deg(start, end)])
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
    shut = walls(*blocked)
    found = route(reference_cell, shut, *degrees)
    path = np.array([reference_cell.base_posture, *(stop.posture for stop in found.stops)])
    assert shut.check(path[:-1], path[1:]).clear.all()
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
    found = route(reference_cell, walls((10.0, 20.0)), 10.0, 20.0, 30.0)
    steps = [frozenset(pair) for pair in pairwise([0, *np.array([10, 20, 30])[found.order]])]
    assert frozenset((10, 20)) not in steps
    assert sorted(found.order) == [0, 1, 2]
    assert found.detours == 0


def test_a_detour_where_no_order_is_clear(reference_cell):
    shut = walls((0.0, 20.0), (10.0, 20.0))
    found = route(reference_cell, shut, 10.0, 20.0, options=RouteOptions(return_to_base=False))
    assert found.detours == 1
    assert sorted(found.order) == [0, 1]
    path = [reference_cell.base_posture, *(stop.posture for stop in found.stops)]
    assert shut.check(np.array(path[:-1]), np.array(path[1:])).clear.all()
    drawn_back = next(stop.posture for stop in found.stops if stop.pose is None)
    robot = reference_cell.robot
    poses = robot.fk(np.vstack([drawn_back, at(10.0, 20.0)]))
    # the tool is drawn back along its own z, by the shortest retreat
    apart = np.linalg.norm(poses[1:, :3, 3] - poses[0, :3, 3], axis=1)
    assert apart.min() == pytest.approx(0.1, abs=1e-9)


def test_a_pose_that_no_way_leads_to_is_lost(reference_cell):
    found = route(reference_cell, Blocked(prison), 10.0, 20.0, 30.0)
    assert found.lost == {1: "no clear way to it: a wall"}
    assert sorted(found.order) == [0, 2]


@pytest.mark.parametrize("seed", range(5))
def test_a_path_through_a_maze_is_found(reference_cell, seed):
    """One clear path through seven poses and as many ways that lead nowhere: none is given up."""
    rng = np.random.default_rng(seed)
    degrees = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    path = [0.0, *rng.permutation(degrees)]
    more = [tuple(rng.choice(degrees, 2, replace=False)) for _ in range(6)]
    own = maze(*pairwise(path), *more)
    found = route(reference_cell, own, *degrees)
    assert found.lost == {}
    assert sorted(found.order) == list(range(6))
    stops = np.array([reference_cell.base_posture, *(stop.posture for stop in found.stops)])
    assert own.check(stops[:-1], stops[1:]).clear.all()


def test_only_ways_of_the_order_are_checked(reference_cell):
    shut = walls()
    route(reference_cell, shut, *range(5, 65, 5))
    assert shut.asked == [13]


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


@pytest.mark.parametrize("angle_deg", [pytest.param(0.5, marks=pytest.mark.slow), 3.0])
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


def shut_from_below(*, both: bool = False) -> Blocked:
    """No short motion leads to joint 1 at 20 deg from below, or from either side."""

    def hit(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        step = end[:, 0] - start[:, 0]
        step = np.abs(step) if both else step
        there = np.isclose(np.rad2deg(end[:, 0]), 20.0)
        return there & (step > 0.0) & (step < 2.0 * ANGLE)

    return Blocked(hit)


def test_a_blocked_way_from_the_passed_posture_turns_the_joint(reference_cell):
    cell = reference_cell
    q = np.tile(cell.base_posture, (2, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0])
    ways = shut_from_below()
    found = Router(cell.robot, ways, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert found.lost == {}
    signs = np.sign(last_movements(cell.base_posture, found))
    np.testing.assert_array_equal(signs, np.tile([-1.0, 1, 1, 1, 1, 1], (2, 1)))


def test_a_wall_on_both_sides_loses_the_pose(reference_cell):
    cell = reference_cell
    q = np.tile(cell.base_posture, (2, 1))
    q[:, 0] = np.deg2rad([10.0, 20.0])
    ways = shut_from_below(both=True)
    found = Router(cell.robot, ways, cell.passing, cell.base_posture, SAME_SIDE).route(q)
    assert found.lost == {1: "cannot be approached from one side: a wall"}
    assert found.order.tolist() == [0]
