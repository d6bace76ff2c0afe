"""Exchange against all choices out of small pools, and bounds that none of them beats."""

from __future__ import annotations

import numpy as np
import pytest

from posedesign.selection import criterion_by_name, largest_deviation, select
from tests.marks import rest_in_full
from tests.unit.selection.brute_force import best_value, random_pool

POOL, CHOSEN = 16, 7
"""11,440 choices: more than are tried all at once, few enough to be tried here."""

KINDS = ("D", "A", "E", "O5", "G", "C_G", "cond_2", "O2", "O4")
FOUND = 0.95
"""Part of the problems in which the best of all choices is found."""

PROBLEMS = dict.fromkeys(KINDS, 60) | {"D": 200, "A": 200, "C_G": 200}


def shares(kind: str, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Of each problem: value found over the best (at least 1), best over the bound (at least 1)."""
    lost, slack = [], []
    for seed in seeds:
        J, L = random_pool(np.random.default_rng(seed), POOL)
        best = best_value(J, CHOSEN, kind, L)
        criterion = (
            largest_deviation(L) if kind == "G" else criterion_by_name(kind, J.shape[2], CHOSEN)
        )
        found = select(J, CHOSEN, criterion)
        sign = 1 if criterion.smaller_is_better else -1
        lost.append((found.value / best) ** sign)
        slack.append((best / found.bound) ** sign)
    return np.array(lost), np.array(slack)


@pytest.mark.parametrize("kind", KINDS)
def test_best_of_all_choices(kind):
    lost, slack = shares(kind, range(5))
    assert (lost >= 1.0 - 1e-9).all()  # nothing is better than the best: both count alike
    assert np.median(lost) == pytest.approx(1.0, abs=1e-6)
    assert lost.max() < 1.1
    assert (slack >= 1.0 - 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", rest_in_full(KINDS, ("D", "A")))
def test_nearly_always_the_best_of_all_choices(kind):
    lost, slack = shares(kind, range(1000, 1000 + PROBLEMS[kind]))
    assert (lost < 1.0 + 1e-6).mean() >= FOUND
    assert (slack >= 1.0 - 1e-12).all()


@pytest.mark.parametrize("method", ["detmax", "greedy", "rounding"])
def test_other_methods_find_no_better_one(method):
    for seed in range(5):
        J, _ = random_pool(np.random.default_rng(seed), 16)
        best = best_value(J, 7, "D")
        found = select(J, 7, "D", method)
        assert len(found.indices) == 7
        assert found.value <= best * (1 + 1e-9)
        assert found.value > 0.5 * best
        assert found.bound >= best * (1 - 1e-12)
