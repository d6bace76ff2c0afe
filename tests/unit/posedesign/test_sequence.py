"""Orders against all orders and against dynamic programming; times against joints that are run."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.motion import order as sequence
from posedesign.motion.order import move_times, moving_time_s, shortest_order


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
@pytest.mark.parametrize("seed", range(15))
def test_order_against_all_orders(seed, closed):
    """Four to eight places: none of all orders is shorter by more than costs are rounded."""
    count = 4 + seed % 5
    cost = costs(count, seed)
    order = shortest_order(cost, closed=closed)
    assert order[0] == 0
    assert sorted(order) == list(range(count))
    best = min(length(cost, [0, *rest], closed) for rest in permutations(range(1, count)))
    assert length(cost, order, closed) <= (1.0 + sequence.WORTH) * best


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(15))
def test_costs_that_differ_there_and_back(seed, closed):
    """As with approaches: near the best of all orders, though the library averages the two."""
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


def test_the_library_finds_what_the_quick_search_does_not():
    """Of five sets of 60 places most are shorter, none is longer."""
    gains = []
    for seed in range(5):
        cost = costs(60, seed)
        quick, thorough = (
            length(cost, shortest_order(cost, closed=True, thorough=t), True) for t in (False, True)
        )
        gains.append(1.0 - thorough / quick)
    assert min(gains) >= 0.0
    assert np.median(gains) > 0.005


def test_the_same_places_have_the_same_order():
    cost = costs(27, 1)
    assert len({tuple(shortest_order(cost, closed=True)) for _ in range(5)}) == 1


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
@pytest.mark.parametrize("seed", range(10))
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
        step, gone, going, clock = 1e-5, 0.0, 0.0, 0.0
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
    times = [moving_time_s(q, speeds, sequence.ACCELERATION_S) for q in (path, halfway)]
    assert times[1] - times[0] == pytest.approx(sequence.ACCELERATION_S)
