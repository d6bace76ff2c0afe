"""Properties of choices and of their proofs, on any pool."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import NotIdentifiableError
from posedesign.selection import criterion_by_name, largest_deviation, mean_deviation, select
from posedesign.selection.candidates import Candidates
from posedesign.selection.relaxation import ConditionCertificate, MeanCertificate

seeds = st.integers(0, 2**31)
INVARIANT = ("D", "C_G", "cond_2")


def pool(rng: np.random.Generator, size: int = 9) -> np.ndarray:
    """Blocks with parameters of unlike units, and now and then poses that tell little."""
    p, m = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    strength = 10.0 ** rng.uniform(-2, 1, (size, 1, 1))
    return rng.normal(size=(size, m, p)) * strength * 10.0 ** rng.uniform(-4, 4, p)


def least_cost(objective, size: int, count: int, keep=()) -> float:
    return min(
        objective.cost(np.array(rows))
        for rows in combinations(range(size), count)
        if set(keep) <= set(rows)
    )


@given(seeds, st.sampled_from(["D", "A", "E", "O5", "C_G", "cond_2", "O2", "O4", "G"]))
def test_no_choice_beats_the_bound(seed, kind):
    rng = np.random.default_rng(seed)
    J = pool(rng)
    p, count = J.shape[2], int(rng.integers(4, 8))
    criterion = (
        largest_deviation(rng.normal(size=(3, 2, p)) / np.abs(J).max(axis=(0, 1)))
        if kind == "G"
        else criterion_by_name(kind, p, count)
    )
    keep = rng.choice(9, int(rng.integers(0, 3)), replace=False).tolist()
    known = rng.normal(size=(2, p)) * np.abs(J).max(axis=(0, 1)) if rng.random() < 0.5 else None
    try:
        found = select(J, count, criterion, keep=keep, known=known, starts=2)
    except NotIdentifiableError:
        return
    best = least_cost(criterion.on(Candidates(J, known)), 9, count, keep)
    assert criterion.cost_of(found.bound) <= best * (1 + 1e-9)
    assert set(keep) <= set(found.indices.tolist())
    assert 0.0 <= found.efficiency <= 1.0 or not np.isfinite(found.efficiency)


@given(seeds, st.sampled_from([0.0, 0.5, 1.0, np.inf]))
def test_any_matrix_proves_something_true(seed, order):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(8, 2, 3))
    root = rng.normal(size=(3, int(rng.integers(1, 4))))
    K = rng.normal(size=(3, int(rng.integers(1, 4))))
    bound = MeanCertificate(root @ root.T, K, order).bound(Candidates(J), 4)
    scaled = Candidates(J)
    for rows in combinations(range(8), 4):
        variances = np.linalg.eigvalsh(K.T @ np.linalg.inv(scaled.information(np.array(rows))) @ K)
        if order == 0.0:
            cost = np.exp(np.mean(np.log(variances)))
        elif np.isinf(order):
            cost = variances.max()
        else:
            cost = np.mean(variances**order) ** (1 / order)
        assert bound <= cost * (1 + 1e-9)


@given(seeds)
def test_any_two_matrices_prove_something_true_of_the_condition(seed):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(8, 2, 3))
    Y, Z = (root @ root.T for root in rng.normal(size=(2, 3, 2)))
    lowest, highest = np.sort(rng.uniform(0.5, 2.0, (2, 3)), axis=0)
    candidates = Candidates(J)
    bound = ConditionCertificate(Y, Z, lowest, highest).bound(candidates, 4)
    E = rng.uniform(lowest, highest, (20, 3))
    for rows in combinations(range(8), 4):
        M = candidates.information(np.array(rows))
        values = np.linalg.eigvalsh(M / np.sqrt(E[:, :, None] * E[:, None, :]))
        assert bound <= (values[:, -1] / values[:, 0]).min() * (1 + 1e-9)


@settings(max_examples=8)
@given(seeds, st.sampled_from(INVARIANT))
def test_units_of_the_parameters_do_not_matter(seed, kind):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(12, 2, 3))
    scale = 10.0 ** rng.integers(-3, 4, 3)
    first, second = select(J, 5, kind, starts=3), select(J * scale, 5, kind, starts=3)
    factor = np.prod(scale.astype(float)) ** (2 / 3) if kind == "D" else 1.0
    assert second.value == pytest.approx(first.value * factor, rel=1e-6)
    assert second.efficiency == pytest.approx(first.efficiency, abs=2e-3)


@settings(max_examples=8)
@given(seeds)
def test_order_of_the_candidates_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    J, order = rng.normal(size=(15, 2, 3)), rng.permutation(15)
    first, second = select(J, 6, "D", starts=8), select(J[order], 6, "D", starts=8)
    assert second.value == pytest.approx(first.value, rel=1e-3)
    assert second.bound == pytest.approx(first.bound, rel=2e-3)


@given(seeds)
def test_nuisances_are_marginalised_as_a_schur_complement(seed):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(10, 2, 4))
    found = select(J, 5, "D", interest=[0, 1], starts=3)
    G = J[found.indices].reshape(-1, 4)
    M = G.T @ G
    own = M[:2, :2] - M[:2, 2:] @ np.linalg.solve(M[2:, 2:], M[2:, :2])
    assert found.value == pytest.approx(np.sqrt(np.linalg.det(own)), rel=1e-8)
    A = select(J, 5, "A", interest=[0, 1], starts=3)
    G = J[A.indices].reshape(-1, 4)
    assert A.value == pytest.approx(np.trace(np.linalg.inv(G.T @ G)[:2, :2]), rel=1e-8)


@given(seeds)
def test_more_poses_never_know_less(seed):
    rng = np.random.default_rng(seed)
    J, L = rng.normal(size=(10, 2, 3)), rng.normal(size=(4, 2, 3))
    values = [select(J, n, mean_deviation(L), starts=6).value for n in (3, 5, 7)]
    assert values[0] >= values[1] * (1 - 1e-9) >= values[2] * (1 - 1e-9)
