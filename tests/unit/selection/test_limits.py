"""Choices under costs, constraints and repeats, against all choices there are."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import LinearConstraint

from calib.errors import CalibError, InputError, NotIdentifiableError
from posedesign.selection import largest_deviation, mean_deviation, select
from tests.marks import rest_in_slow

KINDS = ("D", "A", "O5", "I", "G")


def criterion_of(kind: str, rng: np.random.Generator, p: int):
    if kind == "I":
        return mean_deviation(rng.standard_normal((3, 2, p)))
    if kind == "G":
        return largest_deviation(rng.standard_normal((3, 2, p)))
    return kind


def problem(seed: int):
    """A small pool with limits by chance, and what of it is a choice at all."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    N, p, m, repeats = int(rng.integers(5, 8)), int(rng.integers(2, 4)), 2, 1 + int(seed % 3 == 0)
    blocks = rng.standard_normal((N, m, p)) * np.exp(rng.normal(size=(N, 1, 1)))
    given = {"criterion": criterion_of(kind, rng, p), "repeats": repeats}
    if rng.random() < 0.7:
        given |= {"costs": rng.uniform(0.5, 3.0, N), "budget": float(rng.uniform(3.0, 9.0))}
    if rng.random() < 0.4 or "costs" not in given:
        given["n"] = int(rng.integers(2, N - 1))
    limits = []
    for _ in range(int(rng.integers(0, 3))):
        A = (rng.random(N) < 0.5).astype(float)
        limits.append(LinearConstraint(A, 1.0 if rng.random() < 0.4 else -np.inf, 2.0))
    given["constraints"] = limits
    if rng.random() < 0.2:
        given["keep"] = [int(rng.integers(N))]
    return blocks, given


def allowed(N: int, given: dict) -> list[np.ndarray]:
    """All times of all candidates that the limits let through, one by one."""
    found = []
    for times in product(range(given["repeats"] + 1), repeat=N):
        w = np.array(times)
        fits = "n" not in given or w.sum() == given["n"]
        fits &= "costs" not in given or given["costs"] @ w <= given["budget"]
        fits &= all(w[k] >= 1 for k in given.get("keep", ()))
        for limit in given["constraints"]:
            fits &= bool(np.all(limit.lb <= limit.A @ w) and np.all(limit.A @ w <= limit.ub))
        if fits:
            found.append(w)
    return found


def best_value(blocks: np.ndarray, given: dict, criterion) -> float | None:
    """The best of all allowed choices, as the criterion is shown; None where none sees all."""
    values = []
    for w in allowed(len(blocks), given):
        rows = np.repeat(blocks, w, axis=0).reshape(-1, blocks.shape[2])
        if len(rows) and np.linalg.matrix_rank(rows) == blocks.shape[2]:
            C = np.linalg.inv(rows.T @ rows)
            values.append(criterion.cost_by(C))
    return min(values, default=None)


def shown_cost(kind, given, p):
    """The cost of a covariance in plain terms, smaller is better, and of a shown value."""
    criterion = given["criterion"]
    if criterion == "D":
        return lambda C: np.linalg.det(C) ** (1 / p), lambda value: 1.0 / value
    if criterion == "A":
        return np.trace, lambda value: value
    if criterion == "O5":
        return lambda C: np.sqrt(np.linalg.eigvalsh(C)).sum(), lambda value: 1.0 / value
    L = criterion.on(SimpleCandidates(p)).L

    def error(C):
        return max(np.trace(each @ C @ each.T) for each in L)

    return error, lambda value: value**2


class SimpleCandidates(SimpleNamespace):
    """What an objective asks of a pool to give its functions: parameters as they are."""

    def __init__(self, p: int) -> None:
        super().__init__(p=p, m=2, scale=np.ones(p))


def is_told(blocks: np.ndarray, given: dict) -> bool:
    """Whether it is said that no allowed choice tells all parameters apart, or there is none."""
    try:
        return select(blocks, **given).status == "not identifiable"
    except CalibError:
        return True


@pytest.mark.parametrize("part", rest_in_slow(range(12), [7]))
def test_bound_and_choice_against_all_choices(part):
    """120 small pools: nothing allowed beats the bound, and the choice is the best of all."""
    seen = 0
    for seed in range(10 * part, 10 * part + 10):
        blocks, given = problem(seed)
        cost_of, back = shown_cost(KINDS[seed % len(KINDS)], given, blocks.shape[2])
        best = best_value(blocks, given, SimpleNamespace(cost_by=cost_of))
        if best is None:
            assert is_told(blocks, given), seed
            continue
        found = select(blocks, **given)
        w = np.bincount(found.indices, minlength=len(blocks))
        assert any(np.array_equal(w, each) for each in allowed(len(blocks), given)), seed
        assert back(found.bound) <= best * (1 + 1e-7), seed
        np.testing.assert_allclose(back(found.value), best, rtol=1e-6, err_msg=str(seed))
        assert found.efficiency > 1.0 - 1e-4, seed
        seen += 1
    assert seen > 6


POOL = np.random.default_rng(0).standard_normal((60, 2, 4))


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_limits_that_do_not_bind_change_nothing(criterion):
    """A choice of n by the exchange, and the same under limits that any choice keeps."""
    plain = select(POOL, 12, criterion)
    free = select(POOL, 12, criterion, costs=np.ones(60), budget=100.0, starts=1)
    assert abs(free.value / plain.value - 1.0) < 2e-3
    np.testing.assert_allclose(free.bound, plain.bound, rtol=2e-3)


def test_repeats_are_at_least_as_good():
    """A pose that may be measured again: never worse, and better where few poses tell most."""
    blocks = POOL * np.where(np.arange(60) % 10 == 0, 5.0, 1.0)[:, None, None]
    once, often = select(blocks, 12), select(blocks, 12, repeats=12, starts=1)
    assert often.value > 1.2 * once.value
    assert often.count == 12
    assert len(set(often.indices.tolist())) < 12
    assert often.value <= often.bound


def detmax(blocks: np.ndarray, n: int, rng: np.random.Generator) -> float:
    """D by Mitchell 1974: the best taken in, repeats and all, the worst put back, over again."""
    each = blocks.transpose(0, 2, 1) @ blocks
    rows, best = rng.choice(len(blocks), n, replace=False), -np.inf
    while True:
        M = each[rows].sum(axis=0)
        rows = np.append(rows, np.argmax(np.linalg.slogdet(M + each)[1]))
        M = each[rows].sum(axis=0)
        left = np.linalg.slogdet(M - each[rows])[1]
        rows = np.delete(rows, np.argmax(left))
        if left.max() <= best + 1e-12:
            return float(np.exp(best / blocks.shape[2]))
        best = left.max()


@pytest.mark.parametrize(
    ("N", "m", "p", "n", "seed"),
    [
        (100, 1, 6, 14, 3),
        *(pytest.param(500, 1, 10, 30, k, marks=pytest.mark.slow) for k in (3, 6)),
    ],
)
def test_repeats_are_as_good_as_the_best_of_many_starts_of_detmax(N, m, p, n, seed):
    blocks = np.random.default_rng(seed).standard_normal((N, m, p))
    rng = np.random.default_rng(0)
    theirs = max(detmax(blocks, n, rng) for _ in range(20))
    assert select(blocks, n, repeats=n).value >= (1.0 - 1e-9) * theirs


def test_the_bound_is_sharp_where_fractions_begin_with_a_part_of_the_pool():
    """Prices of the limits are zero for the very candidate that has to come in."""
    blocks = np.random.default_rng(3).standard_normal((500, 1, 10))
    found = select(blocks, 30, repeats=30, starts=1)
    assert found.relaxation.bound > (1.0 - 2e-3) * found.relaxation.cost


def test_a_budget_in_place_of_a_number():
    """As many as the budget pays for, and no pose more fits into what is left of it."""
    costs = np.random.default_rng(1).uniform(1.0, 3.0, 60)
    found = select(POOL, costs=costs, budget=20.0, starts=1)
    spent = costs[found.indices].sum()
    left = np.delete(costs, found.indices).min()
    assert 20.0 - left < spent <= 20.0


def test_at_least_and_at_most_of_groups():
    """At least 3 poses of each target, at most 4 over the back, with poses that are kept."""
    target, back = np.arange(60) % 3, np.arange(60) < 30
    rows = [(target == k).astype(float) for k in range(3)]
    groups = LinearConstraint(rows, [3.0, 3.0, 3.0], np.inf)
    behind = LinearConstraint(back.astype(float), -np.inf, 4.0)
    found = select(POOL, 14, constraints=[groups, behind], keep=[0, 31], starts=1)
    assert np.bincount(target[found.indices], minlength=3).min() >= 3
    assert back[found.indices].sum() <= 4
    assert {0, 31} <= set(found.indices.tolist())
    free = select(POOL, 14, keep=[0, 31])
    assert found.value <= free.value * (1.0 + 1e-9)
    assert found.efficiency > 0.95


def test_a_large_pool():
    """Far more candidates than quadratic programmes take at once: the proof is over all."""
    rng = np.random.default_rng(2)
    blocks, costs = rng.standard_normal((900, 2, 4)), rng.uniform(1.0, 2.0, 900)
    found = select(blocks, costs=costs, budget=25.0, starts=1)
    assert costs[found.indices].sum() <= 25.0
    assert found.efficiency > 0.95


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"n": None}, "nothing limits the number"),
        ({"costs": np.ones(60)}, "costs without a budget"),
        ({"budget": 5.0, "n": 5}, "a budget without costs"),
        ({"costs": np.ones(59), "budget": 5.0}, "costs of 60 candidates"),
        ({"costs": -np.ones(60), "budget": 5.0}, "from zero on"),
        ({"costs": np.ones(60), "budget": -1.0}, "a budget of -1"),
        ({"n": 5, "repeats": 0}, "measured up to 0 times"),
        ({"n": 5, "repeats": 1.5}, "repeats are a whole number"),
        ({"n": 5, "constraints": [3]}, "constraint 1 is a int"),
        ({"n": 5, "constraints": [LinearConstraint(np.ones(3), 0, 1)]}, "rows of 3 numbers"),
        ({"n": 5, "constraints": [LinearConstraint(np.ones(60), 6, 9)]}, "no choice keeps all"),
        ({"n": 5, "constraints": [LinearConstraint(np.ones(60), 3.2, 3.6)]}, "no choice keeps"),
        ({"constraints": [LinearConstraint(np.ones(60), 3.2, 3.6)]}, "no whole number of times"),
        ({"n": 5, "criterion": "C_G", "repeats": 2}, "C_G does not go with"),
        ({"n": 5, "criterion": "E", "repeats": 2}, "E does not go with"),
        ({"n": 121, "repeats": 2}, "121 poses of 120 candidates"),
    ],
)
def test_limits_that_cannot_be(given, said):
    with pytest.raises(InputError, match=said):
        select(POOL, **given)


def test_limits_that_hide_a_parameter():
    """All that sees a parameter is forbidden."""
    blocks = POOL.copy()
    blocks[10:, :, 3] = 0.0
    none = LinearConstraint((np.arange(60) < 10).astype(float), 0.0, 0.0)
    with pytest.raises(NotIdentifiableError, match="within the limits"):
        select(blocks, 12, constraints=[none])
