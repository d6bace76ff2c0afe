"""What holds of every pool: bounds that nothing beats, and what units and order may not change."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import NotIdentifiableError
from posedesign.selection import (
    CRITERIA,
    Candidates,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    select,
    select_fewest,
    wanted_deviations,
)
from posedesign.selection.search import ENUMERATED
from tests.marks import rest_in_slow

KINDS = (*CRITERIA, "G")


@st.composite
def pools(draw):
    """Small pools of all kinds: scaled, correlated, sparse, with known rows and kept poses."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    N, m, p = draw(st.integers(5, 9)), draw(st.integers(1, 3)), draw(st.integers(1, 4))
    J = rng.normal(size=(N, m, p)) * np.exp(draw(st.floats(0, 2)) * rng.normal(size=(N, 1, 1)))
    if draw(st.booleans()):  # columns that are nearly alike
        J += draw(st.sampled_from([1.0, 30.0, 1000.0])) * J[:, :, :1]
    if draw(st.booleans()):  # poses that see some of the parameters only
        J *= rng.random((N, 1, p)) < 0.7
    if draw(st.booleans()):  # candidates that are there twice
        J[-1] = J[0]
    if draw(st.booleans()):  # nearly twice
        J[-2] = J[1] * (1.0 + 1e-9)
    J *= np.exp(draw(st.sampled_from([0.0, 3.0, 12.0])) * rng.normal(size=p))
    known = None
    if draw(st.booleans()):
        known = rng.normal(size=(draw(st.integers(1, p)), p)) * np.abs(J).max(axis=(0, 1))
    keep = sorted(rng.choice(N, draw(st.integers(0, 2)), replace=False).tolist())
    n = draw(st.integers(max(len(keep), 1), N - 2))
    return J, n, known, keep, rng


def criterion_of(kind: str, p: int, n: int):
    if kind == "G":
        return largest_deviation(np.random.default_rng(0).normal(size=(3, 2, p)))
    return criterion_by_name(kind, p, n)


@pytest.mark.parametrize("kind", rest_in_slow(KINDS, ("D", "C_G", "sigma")))
@settings(max_examples=25)
@given(pools())
def test_no_choice_is_better_than_the_bound(kind, pool):
    J, n, known, keep, _ = pool
    # candidates that are there twice are offered once
    first = np.unique(J, axis=0, return_index=True)[1]
    n = min(n, len(np.union1d(first, keep)))
    criterion = criterion_of(kind, J.shape[2], n)
    candidates = Candidates(J, known)
    try:
        candidates.check_identifiable()
    except NotIdentifiableError:
        with pytest.raises(NotIdentifiableError):
            select(J, n, criterion, known=known, keep=keep)
        return
    objective = criterion.on(candidates)
    free = np.setdiff1d(first, keep)
    costs = [
        objective.cost(np.sort(np.array([*keep, *rest], dtype=int)))
        for rest in combinations(free, n - len(keep))
    ]
    # what the whole of a pool this size has, in few digits, is not told to the last of them
    few_digits = 1e-6
    for method in ("exchange", "rounding"):
        found = select(J, n, criterion, method, known=known, keep=keep)
        assert set(keep) <= set(found.indices)
        assert len(set(found.indices)) == n
        cost = objective.cost(found.indices)
        assert criterion.cost_of(found.value) == pytest.approx(cost, rel=1e-6)
        bound = criterion.cost_of(found.bound)
        assert 0.0 <= found.efficiency <= 1.0 or not np.isfinite(found.efficiency)
        if found.status != "no bound":
            assert bound <= min(costs) * (1 + few_digits) or np.isinf(min(costs))
        if method == "exchange" and np.isfinite(min(costs)):
            assert len(costs) <= ENUMERATED
            assert cost <= min(costs) * (1 + few_digits)


@pytest.mark.parametrize("kind", rest_in_slow(["D", "C_G", "cond_2", "sigma"], ("C_G", "sigma")))
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1))
def test_units_of_columns_do_not_matter(kind, seed):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(20, 2, 4))
    scale = np.exp(3.0 * rng.normal(size=4))
    wanted = np.exp(rng.normal(size=4))
    plain = select(J, 6, wanted_deviations(wanted, 4) if kind == "sigma" else kind)
    units = select(J * scale, 6, wanted_deviations(wanted / scale, 4) if kind == "sigma" else kind)
    factor = np.exp(2 * np.mean(np.log(scale))) if kind == "D" else 1.0
    assert units.value == pytest.approx(plain.value * factor, rel=1e-6)
    assert units.bound == pytest.approx(plain.bound * factor, rel=5e-3)
    np.testing.assert_allclose(units.efficiency, plain.efficiency, atol=5e-3)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_candidates_does_not_matter(kind, seed):
    """Of small pools, where the best of all is found."""
    rng = np.random.default_rng(seed)
    J, order = rng.normal(size=(12, 2, 3)), rng.permutation(12)
    criterion = criterion_of(kind, 3, 5)
    plain, moved = select(J, 5, criterion), select(J[order], 5, criterion)
    assert moved.value == pytest.approx(plain.value, rel=1e-9)
    np.testing.assert_allclose(moved.bound, plain.bound, rtol=2e-3)
    np.testing.assert_array_equal(np.sort(order[moved.indices]), plain.indices)


@pytest.mark.parametrize(
    "kind", rest_in_slow(["D", "A", "E", "G", "O1", "O5", "C_G"], ("D", "C_G"))
)
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.2, 0.95))
def test_what_is_called_too_few_is_too_few(kind, seed, share):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(9, 2, 3)) * np.exp(0.5 * rng.normal(size=(9, 1, 1)))
    value = {}
    for n in range(2, 10):
        criterion = criterion_of(kind, 3, n)
        costs = [criterion.on(Candidates(J)).cost(np.array(s)) for s in combinations(range(9), n)]
        value[n] = criterion.shown(min(costs))
    better = min if criterion.smaller_is_better else max
    ends = better(value.values()), value[2]
    goal = float(ends[0] ** share * ends[1] ** (1 - share))
    goal *= 1 + 1e-8 if criterion.smaller_is_better else 1 - 1e-8
    enough = [n for n in value if better(value[n], goal) == value[n]]
    found = select_fewest(J, criterion if kind == "G" else kind, goal)
    assert found.at_least <= min(enough)
    if found.reached:
        assert found.selection.count >= min(enough)
        assert better(found.selection.value, goal * (1 + 1e-8)) == pytest.approx(
            found.selection.value
        ) or found.selection.value == pytest.approx(goal)
    if kind not in ("O1", "C_G"):  # which need not fall with the number of poses
        assert found.reached
        assert found.selection.count == min(enough)


seeds = st.integers(0, 2**31)


@settings(max_examples=10)
@given(seeds)
def test_more_poses_never_know_less(seed):
    rng = np.random.default_rng(seed)
    J, L = rng.normal(size=(10, 2, 3)), rng.normal(size=(4, 2, 3))
    values = [select(J, n, mean_deviation(L), starts=6).value for n in (3, 5, 7)]
    assert values[0] >= values[1] * (1 - 1e-9) >= values[2] * (1 - 1e-9)
