"""Relaxations: derivatives by central differences, optima by cvxpy, ledgers by inverses."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from posedesign import indices
from posedesign.selection import criterion_by_name, largest_deviation, mean_deviation, select
from posedesign.selection.candidates import Candidates

COUNT = 5


@pytest.fixture(scope="module")
def J():
    return np.random.default_rng(4).normal(size=(12, 2, 3)) * [1.0, 30.0, 0.1]


L = np.random.default_rng(5).normal(size=(4, 2, 3)) * [1.0, 0.03, 10.0]

SMOOTH = {
    "D": criterion_by_name("D", 3, COUNT),
    "D of two": criterion_by_name("D", 3, COUNT, [0, 2]),
    "A": criterion_by_name("A", 3, COUNT),
    "O5": criterion_by_name("O5", 3, COUNT),
    "I": mean_deviation(L),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_by_central_differences(J, name):
    pool = Candidates(J)
    objective = SMOOTH[name].on(pool)
    w, step = np.random.default_rng(1).uniform(0.2, 0.9, 12), 1e-5

    def slopes_at(weights):
        return -pool.scores(objective.smooth(pool, weights).Z)

    for k in range(12):
        shift = step * np.eye(12)[k]
        ahead, behind = (objective.smooth(pool, w + s).cost for s in (shift, -shift))
        numeric = (np.log(ahead) - np.log(behind)) / (2 * step)
        assert slopes_at(w)[k] == pytest.approx(numeric, rel=1e-6, abs=1e-9)
        second = (slopes_at(w + shift) - slopes_at(w - shift)) / (2 * step)
        np.testing.assert_allclose(
            objective.smooth(pool, w).curvature[k], second, rtol=1e-5, atol=1e-8
        )


def optimum(J: np.ndarray, name: str) -> float:
    """The value of the best weights, by cvxpy and Clarabel."""
    w = cp.Variable(len(J))
    each = np.swapaxes(J, 1, 2) @ J
    M = sum(w[i] * each[i] for i in range(len(J)))
    rules = [w >= 0, w <= 1, cp.sum(w) == COUNT]
    if name == "D":
        problem = cp.Problem(cp.Maximize(cp.log_det(M)), rules)
        return float(np.exp(problem.solve(solver=cp.CLARABEL) / 3))
    if name == "E":
        return float(cp.Problem(cp.Maximize(cp.lambda_min(M)), rules).solve(solver=cp.CLARABEL))
    if name == "A":
        return float(cp.Problem(cp.Minimize(cp.tr_inv(M)), rules).solve(solver=cp.CLARABEL))
    largest = cp.max(cp.hstack([cp.matrix_frac(each.T, M) for each in L]))
    return float(np.sqrt(cp.Problem(cp.Minimize(largest), rules).solve(solver=cp.CLARABEL)))


@pytest.mark.parametrize(
    ("name", "tolerance"), [("D", 1e-6), ("A", 1e-6), ("E", 1e-6), ("G", 5e-3)]
)
def test_bound_is_the_optimum_of_the_relaxation(name, tolerance):
    J = np.random.default_rng(6).normal(size=(12, 2, 3))
    pool = Candidates(J)
    criterion = largest_deviation(L) if name == "G" else criterion_by_name(name, 3, COUNT)
    found = criterion.on(pool).relax(COUNT, 1e-7)
    assert criterion.shown(found.bound) == pytest.approx(optimum(J, name), rel=tolerance)
    assert found.weights.sum() == pytest.approx(COUNT, rel=1e-6)
    assert found.bound <= found.cost * (1 + 1e-9)
    # the proof by itself, without the solver that it is from
    assert found.certificate.bound(pool, COUNT) == pytest.approx(found.bound, rel=1e-12)


@pytest.mark.parametrize("name", ["D", "A", "E", "O5", "C_G", "cond_2", "O2", "O4", "I", "G"])
def test_costs_of_changes_are_those_of_the_changed_choice(J, name):
    made = {"I": mean_deviation(L), "G": largest_deviation(L)}
    criterion = made[name] if name in made else criterion_by_name(name, 3, COUNT)
    objective = criterion.on(Candidates(J))
    chosen = np.array([0, 3, 4, 7, 9])
    ledger = objective.ledger(chosen, COUNT)
    ledger.drop(4)
    ledger.take(11)
    chosen = np.array([0, 3, 7, 9, 11])
    others = np.setdiff1d(np.arange(12), chosen)
    with_each = [objective.cost(np.append(chosen, k)) for k in others]
    np.testing.assert_allclose(objective.costs(ledger, others, 1.0), with_each, rtol=1e-4)
    without = [objective.cost(np.setdiff1d(chosen, [k])) for k in chosen]
    np.testing.assert_allclose(objective.costs(ledger, chosen, -1.0), without, rtol=1e-4)


def test_values_are_those_of_the_indices(J):
    of = {
        "D": indices.d_optimality,
        "A": indices.a_optimality,
        "E": indices.e_optimality,
        "C_G": indices.condition_inf,
        "cond_2": indices.condition_2,
        "O1": indices.o1,
        "O2": indices.o2,
        "O3": indices.o3,
        "O4": indices.o4,
        "O5": indices.o5,
    }
    for name, index in of.items():
        found = select(J, COUNT, name)
        assert found.value == pytest.approx(index(J[found.indices]), rel=1e-9), name
        assert criterion_by_name(name, 3, COUNT).smaller_is_better == (
            name in ("A", "C_G", "cond_2")
        )
        G = J[found.indices].reshape(-1, 3)
        np.testing.assert_allclose(found.covariance, np.linalg.inv(G.T @ G), rtol=1e-9)


def test_a_large_pool_is_solved_to_the_same_bound():
    """On working sets as on the whole pool at once."""
    J = np.random.default_rng(7).normal(size=(400, 2, 4))
    objective = criterion_by_name("D", 4, 10).on(Candidates(J))
    found = objective.relax(10, 1e-6)
    assert found.gap < 1e-6
    w = cp.Variable(400)
    M = cp.reshape((np.swapaxes(J, 1, 2) @ J).reshape(400, -1).T @ w, (4, 4), order="C")
    problem = cp.Problem(cp.Maximize(cp.log_det(M)), [w >= 0, w <= 1, cp.sum(w) == 10])
    expected = np.exp(problem.solve(solver=cp.CLARABEL) / 4)
    select_bound = select(J, 10, "D", tolerance=1e-6).bound
    assert select_bound == pytest.approx(expected, rel=1e-5)
