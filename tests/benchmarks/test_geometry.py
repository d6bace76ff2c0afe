"""How fast a cell of solids is checked. Run with ``make bench``.

An arm of seven joints with twelve capsules and boxes, a tool of three boxes, the floor and three
boxes around: what a large cell has.
"""

import numpy as np
import pytest

from calib.geometry import Body, Box, Capsule, HalfSpace, Scene
from calib.robots import SerialChain
from calib.se3 import FloatArray, rotation_exp, transform


def place(x: float, y: float, z: float) -> FloatArray:
    return transform(np.eye(3), [x, y, z])


@pytest.fixture(scope="module")
def cell() -> Scene:
    """Joints about z and y in turn, 0.35 m apart along z."""
    placements = np.repeat(place(0.0, 0.0, 0.35)[None], 7, axis=0)
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[np.arange(7) % 2]
    chain = SerialChain(placements, axes, place(0.0, 0.0, 0.1))
    arm = [Body("base", 0, place(0.0, 0.0, 0.1), Box((0.4, 0.4, 0.2)))]
    arm += [Body(f"link{j}", j, place(0.0, 0.0, 0.15), Capsule(0.08, 0.2)) for j in range(1, 8)]
    arm += [Body(f"motor{j}", j, place(0.0, 0.1, 0.0), Box((0.1, 0.2, 0.1))) for j in (1, 3, 5, 6)]
    tool = [Body("tool", 7, place(0.0, 0.0, 0.2 + 0.1 * k), Box((0.1, 0.1, 0.1))) for k in range(3)]
    turned = transform(rotation_exp([0.0, 0.0, 0.4]), [1.2, 0.0, 0.4])
    obstacles = [
        Body("floor", 0, np.eye(4), HalfSpace()),
        Body("table", 0, turned, Box((0.8, 1.6, 0.8))),
        Body("fence", 0, place(0.0, 2.0, 1.0), Box((4.0, 0.05, 2.0))),
        Body("cabinet", 0, place(-1.2, -1.2, 0.8), Box((0.8, 0.6, 1.6))),
    ]
    return Scene(chain, arm, tool=tool, obstacles=obstacles)


def postures(count: int) -> FloatArray:
    return np.random.default_rng(1).uniform(-1.5, 1.5, (count, 7))


@pytest.mark.parametrize("count", [1_000, 10_000])
def test_clearance(benchmark, cell, count):
    """To be under 10 s for 10,000 postures, and linear in their number."""
    q = postures(count)
    found = benchmark.pedantic(cell.clearance, args=(q,), rounds=5, warmup_rounds=1)
    assert 0.1 < (found.distance_m > 0).mean() < 0.9


@pytest.mark.parametrize("one_posture", [True, False])
def test_sight_of_100_000_lines(benchmark, cell, one_posture):
    """To be under 0.7 s, in one posture for all and in another for each."""
    q = postures(1 if one_posture else 100_000)
    start, end = np.random.default_rng(2).uniform(-1.5, 1.5, (2, 100_000, 3))
    found = benchmark.pedantic(cell.sight, args=(q, start, end), rounds=3, warmup_rounds=1)
    assert 0.1 < found.clear.mean() < 0.9


def test_a_thousand_ways(benchmark, cell):
    q = postures(20_000)
    free = q[cell.clearance(q).distance_m > 0.02]
    start, end = free[:1000], free[1000:2000]
    found = benchmark.pedantic(cell.ways, args=(start, end, 0.01), rounds=3)
    assert 0.01 < found.clear.mean() < 0.99


def test_extent(benchmark, cell):
    """Of 10,000 postures."""
    assert np.isfinite(benchmark(cell.extent, postures(10_000)).lowest).all()
