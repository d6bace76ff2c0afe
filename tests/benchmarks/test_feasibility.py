"""How fast verdicts are. Run with ``make bench``."""

import time

import numpy as np
import pytest

from posedesign.candidates import candidates_of
from posedesign.cell import Cell
from posedesign.constraints import Checker, Collision
from posedesign.motion import Router
from posedesign.planning import plan
from posedesign.planning.loop import grid_poses


def postures(cell: Cell, count: int) -> np.ndarray:
    """Postures about the base pose, as a planner looks at them."""
    rng = np.random.default_rng(1)
    q = cell.base_posture + rng.uniform(-0.6, 0.6, (count, cell.robot.n))
    return np.asarray(np.clip(q, cell.robot.lower + 0.02, cell.robot.upper - 0.02))


def test_limits_and_visibility(benchmark, demo_cell):
    """100,000 postures, every constraint but collisions, 25 lines of sight to each."""
    constraints = [c for c in demo_cell.checker.constraints if not isinstance(c, Collision)]
    checker = Checker(demo_cell.robot)
    checker.constraints = tuple(constraints)
    q = postures(demo_cell, 100_000)
    verdicts = benchmark.pedantic(checker.check, args=(q,), rounds=5)
    assert verdicts.margin.shape == (100_000, len(constraints))


@pytest.mark.parametrize("count", [1_000, 10_000])
def test_collisions(benchmark, demo_cell, count):
    """Smallest distances of postures of the demo cell. 10,000 to be under 10 s."""
    q = postures(demo_cell, count)
    found = benchmark.pedantic(demo_cell.scene.clearance, args=(q,), rounds=3)
    assert found.distance_m.shape == (count,)


def test_one_round_with_all_constraints(benchmark, demo_cell):
    """27 poses of the demo cell: inverse kinematics, limits, visibility, collisions."""
    assert len(benchmark(grid_poses, demo_cell, np.full(3, 40.0)).kept) > 20


def test_the_whole_plan_with_all_constraints(benchmark, demo_cell):
    """The plan of the demo cell with collisions, visibility, repair and the route."""
    assert benchmark.pedantic(plan, args=(demo_cell,), rounds=5, warmup_rounds=1).reached


def test_the_route_of_many(capsys, demo_cell):
    """Order and motions of 500 poses under 20 s, less than 16 times those of a quarter."""
    pool = candidates_of(demo_cell).postures
    seconds = []
    for count in (125, 500):
        q = pool[np.linspace(0, len(pool) - 1, count).astype(np.intp)]
        start = time.process_time()
        route = Router.of_cell(demo_cell).route(q)
        seconds.append(time.process_time() - start)
        assert len(route.order) > 0.9 * count
    with capsys.disabled():
        print(f"\n500 poses ordered: {seconds[1]:.1f} s, {seconds[1] / seconds[0]:.1f} times 125")
    assert seconds[1] < 20.0
    assert seconds[1] < 16.0 * seconds[0]


def test_motions_between_all_of_thirty(benchmark, demo_cell):
    """435 motions of the demo cell, blocked ones among them."""
    q = postures(demo_cell, 400)
    q = q[demo_cell.checker.check(q, every=False).feasible][:30]
    first, last = np.triu_indices(len(q), 1)
    found = benchmark.pedantic(demo_cell.ways.check, args=(q[first], q[last]), rounds=3)
    assert found.clear.any()
