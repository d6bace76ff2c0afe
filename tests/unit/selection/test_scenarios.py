"""Choices over several scenarios, against brute force over all of them."""

from itertools import combinations

import numpy as np
import pytest

from calib.errors import InputError
from posedesign.selection import criterion_by_name, select
from posedesign.selection.criterion import over_scenarios

SCENARIOS, POOL, CHOSEN, P = 3, 10, 4, 3


def scenarios(seed: int) -> np.ndarray:
    """Blocks ``(S, N, m, p)`` of scenarios that favour different candidates."""
    return np.random.default_rng(seed).normal(size=(SCENARIOS, POOL, 2, P))


def stacked(blocks: np.ndarray) -> np.ndarray:
    return np.moveaxis(blocks, 0, 1).reshape(POOL, -1, P)


def cost(blocks: np.ndarray, rows, kind: str) -> float:
    """Geometric mean (D) or sum (A) of the variances in one scenario."""
    G = blocks[list(rows)].reshape(-1, P)
    M = G.T @ G
    return np.linalg.det(M) ** (-1 / P) if kind == "D" else np.trace(np.linalg.inv(M))


@pytest.mark.parametrize("kind", ["D", "A"])
@pytest.mark.parametrize("worst", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_best_of_all_choices(kind, worst, seed):
    blocks = scenarios(seed)
    over = np.max if worst else np.mean
    best = min(
        over([cost(each, rows, kind) for each in blocks])
        for rows in combinations(range(POOL), CHOSEN)
    )
    criterion = over_scenarios(criterion_by_name(kind, P, CHOSEN), SCENARIOS, worst=worst)
    found = select(stacked(blocks), CHOSEN, criterion, starts=12)
    own = over([cost(each, found.indices, kind) for each in blocks])
    assert own == pytest.approx(best, rel=1e-9)
    assert criterion.cost_of(found.value) == pytest.approx(own, rel=1e-9)
    assert criterion.cost_of(found.bound) <= best * (1 + 1e-9)
    assert 0.0 < found.efficiency <= 1.0


def test_one_scenario_is_the_criterion_itself():
    blocks = scenarios(9)[:1]
    own = select(blocks[0], CHOSEN, "D")
    found = select(stacked(blocks), CHOSEN, over_scenarios(criterion_by_name("D", P, CHOSEN), 1))
    np.testing.assert_array_equal(found.indices, own.indices)
    assert found.value == pytest.approx(own.value, rel=1e-12)


def test_the_worst_case_is_better_than_that_of_the_first_scenario_alone():
    gained = []
    for seed in range(10):
        blocks = scenarios(seed)
        criterion = over_scenarios(criterion_by_name("A", P, CHOSEN), SCENARIOS, worst=True)
        robust = select(stacked(blocks), CHOSEN, criterion).indices
        plain = select(blocks[0], CHOSEN, "A").indices
        worst = [max(cost(each, rows, "A") for each in blocks) for rows in (robust, plain)]
        gained.append(worst[1] / worst[0])
    assert min(gained) >= 1.0 - 1e-9
    assert max(gained) > 1.1


def test_blocks_that_are_not_of_so_many_scenarios():
    criterion = over_scenarios(criterion_by_name("D", P, CHOSEN), 4)
    with pytest.raises(InputError, match="4 scenarios"):
        select(stacked(scenarios(0)), CHOSEN, criterion)
    with pytest.raises(InputError, match="0 scenarios"):
        over_scenarios(criterion_by_name("D", P, CHOSEN), 0)
