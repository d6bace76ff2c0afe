"""How long choosing takes: figures for the record, and ratios that must hold."""

from __future__ import annotations

import time

import numpy as np
import pytest

from posedesign.selection import criterion_by_name, select
from posedesign.selection.candidates import Candidates
from posedesign.selection.exchange import exchange

LINEAR = 4.0
"""Times that ten times the candidates may take more than ten times as long."""


def blocks(count: int, m: int, p: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.normal(size=(count, m, p)) * np.exp(0.5 * rng.normal(size=(count, 1, p)))


def test_relaxation_of_500_candidates_and_30_parameters(benchmark):
    """Figaroh's SOCP takes 18.4 s for it."""
    pool = Candidates(blocks(500, 3, 30))
    objective = criterion_by_name("D", 30, 50).on(pool)
    found = benchmark.pedantic(lambda: objective.relax(50, 1e-3), rounds=5)
    assert found.gap < 1e-3


def test_exchange_of_50_out_of_10_000_with_30_parameters(benchmark):
    pool = Candidates(blocks(10_000, 3, 30))
    objective = criterion_by_name("D", 30, 50).on(pool)
    nothing = np.zeros(0, dtype=np.intp)
    start = np.arange(50)
    rows = benchmark.pedantic(lambda: exchange(objective, start, nothing), rounds=3)
    assert objective.cost(rows) < 0.8 * objective.cost(start)


@pytest.mark.parametrize("m", [1, 3])
def test_30_out_of_a_million(benchmark, m):
    J = blocks(1_000_000, m, 10)
    found = benchmark.pedantic(lambda: select(J, 30, "D"), rounds=1)
    assert found.efficiency > 0.98


@pytest.mark.parametrize("criterion", ["C_G", "cond_2", "E"])
def test_27_out_of_6000_by(benchmark, criterion):
    J = blocks(6000, 3, 10)
    found = benchmark.pedantic(lambda: select(J, 27, criterion), rounds=1)
    assert np.isfinite(found.value)


def test_time_is_linear_in_candidates():
    taken = []
    for count in (20_000, 200_000):
        J = blocks(count, 3, 10)
        start = time.perf_counter()
        select(J, 30, "D")
        taken.append(time.perf_counter() - start)
    assert taken[1] < 10 * LINEAR * taken[0]
