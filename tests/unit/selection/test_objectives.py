"""Costs, their derivatives and what is kept up to date, against definitions and differences."""

import numpy as np
import pytest

from posedesign.selection import (
    CRITERIA,
    Candidates,
    criterion_by_name,
    indices,
    largest_deviation,
    mean_deviation,
    select,
    wanted_deviations,
)
from posedesign.selection.information import InformationState
from posedesign.selection.variances import SpectrumObjective

NAMES = tuple(CRITERIA)
OF_INDICES = {
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


def pool(seed: int = 0, N: int = 15, m: int = 2, p: int = 4, known: bool = False) -> Candidates:
    """Columns of unlike size and correlated, poses of unlike strength."""
    rng = np.random.default_rng(seed)
    mixed = rng.normal(size=(p, p)) * np.exp(rng.normal(size=p))
    blocks = rng.normal(size=(N, m, p)) * np.exp(0.5 * rng.normal(size=(N, 1, 1)))
    return Candidates(blocks @ mixed, rng.normal(size=(2, p)) if known else None)


def functions(p: int, seed: int = 9) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(5, 2, p))


def objectives(candidates: Candidates) -> dict[str, object]:
    p = candidates.p
    made = {name: criterion_by_name(name, p, 6) for name in NAMES}
    made |= {f"{k}_s": criterion_by_name(k, p, 6, [0, 2]) for k in "DAE"}
    made |= {"G": largest_deviation(functions(p)), "I": mean_deviation(functions(p))}
    made["sigma"] = wanted_deviations(np.r_[np.inf, np.arange(1.0, p)], p)
    return {name: criterion.on(candidates) for name, criterion in made.items()}


@pytest.mark.parametrize("name", NAMES)
def test_values_are_those_of_the_indices(name):
    rng = np.random.default_rng(1)
    J = rng.normal(size=(15, 2, 4)) * [1.0, 1e-3, 50.0, 0.2]
    found = select(J, 6, name)
    assert found.value == pytest.approx(OF_INDICES[name](J[found.indices]), rel=1e-9)
    C = np.linalg.inv(np.einsum("nmi,nmj->ij", J[found.indices], J[found.indices]))
    np.testing.assert_allclose(found.covariance, C, rtol=1e-7)
    assert found.criterion.shown(found.criterion.cost_of(found.value)) == pytest.approx(found.value)


def test_deviations_are_roots_of_mean_squares():
    rng = np.random.default_rng(2)
    J, L = rng.normal(size=(12, 2, 4)), functions(4)
    found = select(J, 5, largest_deviation(L))
    C = found.covariance
    squares = np.einsum("krp,pq,krq->k", L, C, L)
    assert found.value == pytest.approx(np.sqrt(squares.max()))
    assert select(J, 5, mean_deviation(L)).value <= np.sqrt(squares.mean()) * (1 + 1e-9)
    wanted = np.array([1.0, np.inf, 0.3, 2.0])
    found = select(J, 5, wanted_deviations(wanted, 4))
    assert found.value == pytest.approx((found.sigma / wanted).max())


@pytest.mark.parametrize("name", ["D_s", "A_s", "E_s"])
def test_nuisances_are_marginalised_by_the_schur_complement(name):
    candidates = pool(3)
    rows = np.arange(6)
    G = candidates.root(rows) * candidates.scale
    M, own, rest = G.T @ G, [0, 2], [1, 3]
    schur = M[np.ix_(own, own)] - M[np.ix_(own, rest)] @ np.linalg.solve(
        M[np.ix_(rest, rest)], M[np.ix_(rest, own)]
    )
    expected = {
        "D_s": np.linalg.det(schur) ** -0.5,
        "A_s": np.trace(np.linalg.inv(schur)),
        "E_s": 1.0 / np.linalg.eigvalsh(schur)[0],
    }
    assert objectives(candidates)[name].cost(rows) == pytest.approx(expected[name], rel=1e-9)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("name", [*NAMES, "D_s", "A_s", "E_s", "G", "I", "sigma"])
def test_costs_of_changes_are_those_of_the_changed_choices(name, known):
    """One by one from the regressor, without any update; and all at once for small pools."""
    candidates = pool(4, known=known)
    objective = objectives(candidates)[name]
    rows = np.array([0, 3, 4, 7, 9, 11])
    state = objective.state(rows, len(rows))
    taken = objective.costs_with_each(state)
    outside = np.setdiff1d(np.arange(candidates.N), rows)
    expected = [objective.cost(np.sort(np.append(rows, k))) for k in outside]
    np.testing.assert_allclose(taken[outside], expected, rtol=1e-4)
    assert np.isinf(taken[rows]).all()
    without = [objective.cost(np.setdiff1d(rows, k)) for k in rows]
    np.testing.assert_allclose(objective.costs(state, rows, -1.0), without, rtol=1e-4)
    many = np.array([np.append(rows, k) for k in outside])
    np.testing.assert_allclose(objective.of_choices(many), expected, rtol=1e-8)


@pytest.mark.parametrize("name", [*NAMES, "G", "sigma"])
def test_the_best_to_take_in_is_the_best_of_all(name):
    """Also where most candidates are left out by what they cost at least, which is never more."""
    for seed in range(4):
        candidates = pool(seed, N=300, m=1 + seed % 3, p=5)
        objective = objectives(candidates)[name].stages[-1]
        state = objective.state(np.arange(0, 40, 5), 8)
        costs = objective.costs_with_each(state)
        best = objective.best_with_each(state)
        assert costs[best] == pytest.approx(costs.min(), rel=1e-12)
        assert objective.best_with_each(state, costs.min() * (1 - 1e-9)) is None
        if objective.has_floor:
            for near in (None, best):
                floor = objective.at_least(state, slice(None), near)
                assert (floor <= costs * (1 + 1e-9)).all()
            # for the candidate itself the floor is the cost
            sharp = objective.at_least(state, slice(None), best)[best]
            assert sharp == pytest.approx(costs[best], rel=1e-6)


def test_information_states_keep_to_inverses():
    candidates = pool(5, N=30, m=3, p=6)
    state = InformationState(candidates, np.arange(10), 10)
    before = state.snapshot
    for out, into in [(0, 12), (5, 20), (12, 0), (7, 29)]:
        state.drop(out)
        state.take(into)
    fresh = InformationState(candidates, state.rows, 10)
    np.testing.assert_allclose(state.C, fresh.C, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(state.C @ state.M, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(state.S, fresh.S, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(
        state.S[:, :, 4], candidates.J[4] @ np.linalg.inv(fresh.M) @ candidates.J[4].T, rtol=1e-9
    )
    state.snapshot = before
    np.testing.assert_array_equal(state.rows, np.arange(10))
    np.testing.assert_allclose(
        state.S, InformationState(candidates, np.arange(10), 10).S, rtol=1e-12
    )


SMOOTH = ("D", "D_s", "A", "A_s", "I", "O5", "order 4", "Lagrangian of G")
SHARES = np.array([0.1, 0.4, 0.2, 0.25, 0.05])


def smooth_at(candidates: Candidates, name: str, weights: np.ndarray):
    """Logarithm of what is minimised, and its derivatives."""
    if name == "order 4":
        objective = SpectrumObjective(candidates, np.diag(1 / candidates.scale), 4.0)
    elif name == "Lagrangian of G":
        objective = objectives(candidates)["G"]
        smooth = objective.lagrangian(candidates, weights, SHARES)
        squares = objective.errors(candidates, weights).squares
        assert smooth.cost == pytest.approx(squares.max())
        return SHARES @ np.log(squares), smooth
    else:
        objective = objectives(candidates)[name]
    smooth = objective.smooth(candidates, weights)
    return np.log(smooth.cost), smooth


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_against_central_differences(name, known):
    candidates = pool(6, N=7, known=known)
    w = np.random.default_rng(0).uniform(0.3, 0.9, size=7)
    step = 1e-4
    unit = step * np.eye(7)

    def log_cost(weights: np.ndarray) -> float:
        return smooth_at(candidates, name, weights)[0]

    def gradient(weights: np.ndarray) -> np.ndarray:
        return -candidates.scores(smooth_at(candidates, name, weights)[1].Z)

    slopes = [(log_cost(w + e) - log_cost(w - e)) / (2 * step) for e in unit]
    np.testing.assert_allclose(gradient(w), slopes, rtol=1e-5)
    curvature = np.array([(gradient(w + e) - gradient(w - e)) / (2 * step) for e in unit])
    found = smooth_at(candidates, name, w)[1].curvature
    np.testing.assert_allclose(found, curvature, rtol=1e-5, atol=1e-6 * np.abs(curvature).max())


def test_units_of_any_size():
    rng = np.random.default_rng(7)
    J, scale = rng.normal(size=(15, 2, 3)), np.array([1e-100, 1.0, 1e100])
    for name in ("D", "C_G", "cond_2"):
        plain, scaled = select(J, 5, name), select(J * scale, 5, name)
        np.testing.assert_array_equal(scaled.indices, plain.indices)
        assert scaled.value == pytest.approx(plain.value, rel=1e-9)
        assert scaled.bound == pytest.approx(plain.bound, rel=1e-6)
    np.testing.assert_allclose(scaled.sigma * scale, plain.sigma, rtol=1e-9)


def test_blocks_of_many_rows_do_not_overflow():
    rng = np.random.default_rng(8)
    candidates = Candidates(rng.normal(size=(3, 120, 120)))
    objective = criterion_by_name("D", 120, 2).on(candidates)
    state = InformationState(candidates, np.array([], dtype=int), 2)
    assert np.isfinite(objective.costs_with_each(state)).all()
    assert (objective.costs_with_each(state) > 0.0).all()
