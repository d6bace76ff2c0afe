"""Relaxations against cvxpy, and the proofs that they give."""

from itertools import combinations

import cvxpy as cp
import numpy as np
import pytest

from posedesign.selection import Candidates, criterion_by_name, largest_deviation
from posedesign.selection.certificate import ConditionCertificate, MeanCertificate

N, COUNT, P = 18, 5, 4
SHARP = 1e-7


def pool(seed: int, known: bool = False) -> Candidates:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(N, 2, P)) * np.exp(0.7 * rng.normal(size=(N, 1, 1)))
    return Candidates(J, rng.normal(size=(2, P)) if known else None)


def program(candidates: Candidates) -> tuple[cp.Expression, list[cp.Constraint]]:
    """Information in the units of the blocks, and the rules for the weights."""
    w = cp.Variable(candidates.N, nonneg=True)
    each = np.swapaxes(candidates.J, 1, 2) @ candidates.J
    unit = np.outer(candidates.scale, candidates.scale)
    flat = (each * unit).reshape(candidates.N, -1)
    M = cp.reshape(flat.T @ w, (P, P), order="C") + candidates.known * unit
    return (M + M.T) / 2, [w <= 1, cp.sum(w) == COUNT]


def best_by_cvxpy(candidates: Candidates, kind: str, L: np.ndarray | None = None) -> float:
    """The cost."""
    M, rules = program(candidates)
    if kind == "D":
        problem = cp.Problem(cp.Maximize(cp.log_det(M)), rules)
    elif kind == "A":
        problem = cp.Problem(cp.Minimize(cp.tr_inv(M)), rules)
    elif kind == "E":
        problem = cp.Problem(cp.Maximize(cp.lambda_min(M)), rules)
    else:
        worst = cp.max(cp.hstack([cp.matrix_frac(row, M) for row in L]))
        problem = cp.Problem(cp.Minimize(worst), rules)
    sharp = 1e-8 if kind == "E" else 1e-9
    problem.solve(solver=cp.CLARABEL, tol_gap_abs=sharp, tol_gap_rel=sharp, tol_feas=sharp)
    found = float(problem.value)
    return {"D": np.exp(-found / P), "E": 1.0 / found}.get(kind, found)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("kind", ["D", "A", "E"])
@pytest.mark.parametrize("seed", range(3))
def test_as_cvxpy(kind, seed, known):
    candidates = pool(seed, known)
    found = criterion_by_name(kind, P, COUNT).on(candidates).relax(COUNT, SHARP)
    expected = best_by_cvxpy(candidates, kind)
    assert found.cost == pytest.approx(expected, rel=1e-6)
    assert found.bound == pytest.approx(expected, rel=1e-6)
    assert found.bound <= found.cost
    assert found.weights.sum() == pytest.approx(COUNT, abs=1e-9)
    assert found.weights.min() >= 0.0
    assert found.weights.max() <= 1.0


@pytest.mark.parametrize("seed", range(6))
def test_largest_deviation_as_cvxpy(seed):
    candidates = pool(seed)
    L = np.random.default_rng(9).normal(size=(6, 1, P))
    found = largest_deviation(L).on(candidates).relax(COUNT, SHARP)
    expected = best_by_cvxpy(candidates, "G", L[:, 0])
    assert found.bound == pytest.approx(expected, rel=1e-6)
    assert found.cost == pytest.approx(expected, rel=1e-6)
    assert found.bound <= found.cost


@pytest.mark.parametrize("seed", range(3))
def test_conditions_as_a_search_by_cvxpy(seed):
    """The smallest ratio for which matrices between ``F`` and ``ratio F`` exist, by bisection."""
    candidates = pool(seed)
    found = criterion_by_name("cond_2", P, COUNT).on(candidates).relax(COUNT, 1e-4)
    M, rules = program(candidates)
    F, ratio, slack = cp.Variable(P), cp.Parameter(nonneg=True), cp.Variable()
    rules = [*rules, M >> cp.diag(F), cp.diag(F) + slack * np.eye(P) >> ratio * M, F >= 0]
    problem = cp.Problem(cp.Minimize(slack), rules)
    low, high = 1.0, 1e4
    while high > low * (1 + 1e-4):
        middle = np.sqrt(low * high)
        ratio.value = 1.0 / middle
        problem.solve(solver=cp.CLARABEL)
        low, high = (low, middle) if problem.value <= 1e-7 else (middle, high)
    assert found.bound == pytest.approx(np.sqrt(high), rel=1e-3)
    assert found.cost == pytest.approx(np.sqrt(high), rel=1e-3)


@pytest.mark.parametrize("kind", ["D", "A", "E", "O5", "G", "C_G", "cond_2", "O2", "O4"])
def test_cost_is_that_of_the_weights(kind):
    candidates = pool(5)
    L = np.random.default_rng(9).normal(size=(6, 2, P))
    criterion = largest_deviation(L) if kind == "G" else criterion_by_name(kind, P, COUNT)
    found = criterion.on(candidates).relax(COUNT, 1e-3)
    M = candidates.weighted(found.weights) * np.outer(candidates.scale, candidates.scale)
    values = np.linalg.eigvalsh(M)
    C = np.linalg.inv(M)
    expected = {
        "D": np.linalg.det(M) ** (-1 / P),
        "A": np.trace(C),
        "E": 1.0 / values[0],
        "O5": np.mean(values**-0.5) ** 2,
        "G": np.einsum("krp,pq,krq->k", L, C, L).max(),
        "O2": np.sqrt(values[-1] / values[0]),
        "O4": np.sqrt(values[-1]) / values[0],
    }
    if kind in expected:  # the others leave the scales of the columns free
        assert found.cost == pytest.approx(expected[kind], rel=1e-8)
    assert found.bound <= found.cost * (1 + 1e-12)


@pytest.mark.parametrize(
    "kind",
    [
        "D",
        "E",
        "C_G",
        "O2",
        *(pytest.param(k, marks=pytest.mark.slow) for k in ("A", "O5", "cond_2")),
    ],
)
def test_a_parameter_that_few_of_a_large_pool_see(kind):
    """3 of 3,000: a working set drawn at random would not have any of them."""
    rng = np.random.default_rng(0)
    J = rng.normal(size=(3000, 2, P))
    J[:, :, 0] = 0.0
    seeing = [1234, 2000, 2999]
    J[seeing, :, 0] = rng.normal(size=(3, 2))
    candidates = Candidates(J)
    found = criterion_by_name(kind, P, 10).on(candidates).relax(10, 1e-3)
    assert found.gap < 2e-3
    if kind not in ("C_G", "cond_2"):  # which can do with little, as the column is scaled up
        assert found.weights[seeing].sum() > 1.0


@pytest.mark.parametrize("order", [0.0, 0.5, 1.0, 3.0, np.inf])
def test_any_matrix_is_a_proof(order):
    """Random ones prove little, but never too much; the best of many choices is not below."""
    rng = np.random.default_rng(1)
    candidates = pool(7, known=True)
    K = rng.normal(size=(P, 2))
    chosen = [rng.choice(N, COUNT, replace=False) for _ in range(300)]
    C = np.array([np.linalg.inv(candidates.information(rows)) for rows in chosen])
    values = np.linalg.eigvalsh(K.T @ C @ K)
    mean = {0.0: np.exp(np.log(values).mean(axis=1)), np.inf: values.max(axis=1)}.get(order)
    costs = np.mean(values**order, axis=1) ** (1 / order) if mean is None else mean
    best = C[np.argmin(costs)]
    proven = []
    for _ in range(200):
        root = rng.normal(size=(P, int(rng.integers(1, P + 1)))) * np.exp(3 * rng.normal())
        for Z in (root @ root.T, best @ K @ K.T @ best + 1e-3 * root @ root.T, root @ root.T - 1.0):
            proven.append(MeanCertificate(Z, K, order).bound(candidates, COUNT))
    assert 0.0 < max(proven) <= costs.min()
    total = MeanCertificate(best, K, 1.0, total=True).bound(candidates, COUNT)
    assert total == pytest.approx(2 * MeanCertificate(best, K, 1.0).bound(candidates, COUNT))


def test_any_two_matrices_are_a_proof_of_a_condition():
    rng = np.random.default_rng(2)
    candidates = pool(8)
    low, high = np.full(P, 0.5), np.array([0.5, 1.0, 2.0, 0.7])
    chosen = [rng.choice(N, COUNT, replace=False) for _ in range(300)]
    M = np.array([candidates.information(rows) for rows in chosen])
    for lowest, highest in [(low, high), (np.zeros(P), np.full(P, np.inf))]:
        E = rng.uniform(low, high, size=(300, P))
        values = np.linalg.eigvalsh(M / np.sqrt(E[:, :, None] * E[:, None, :]))
        ratios = values[:, -1] / values[:, 0]
        proven = []
        for _ in range(200):
            roots = rng.normal(size=(2, P, int(rng.integers(1, P + 1)))) * np.exp(rng.normal())
            Y, Z = roots @ np.swapaxes(roots, 1, 2)
            proven.append(ConditionCertificate(Y, Z, lowest, highest).bound(candidates, COUNT))
        assert max(proven) <= ratios.min()
    zero = np.zeros((P, P))
    assert ConditionCertificate(zero, zero, low, high).bound(candidates, COUNT) == 1.0
    assert ConditionCertificate(np.eye(P), zero, low, high).bound(candidates, COUNT) == 1.0


def test_the_smallest_ratio_over_choices_is_found():
    """Of two sums over the same choice, against all choices."""
    candidates = pool(9).take(np.arange(10))
    rng = np.random.default_rng(3)
    for _ in range(20):
        roots = rng.normal(size=(2, P, 2))
        Y, Z = roots @ np.swapaxes(roots, 1, 2)
        y, z = candidates.scores(Y), candidates.scores(Z)
        subsets = np.array(list(combinations(range(10), 4)))
        least = (z[subsets].sum(axis=1) / y[subsets].sum(axis=1)).min()
        same = np.ones(P)  # of scales that are known the other factor is their ratio of traces
        found = ConditionCertificate(Y, Z, same, same).bound(candidates, 4)
        expected = least * np.trace(Y) / np.trace(Z)
        assert found == pytest.approx(max(1.0, expected), rel=1e-8)
        assert found <= max(1.0, expected)
