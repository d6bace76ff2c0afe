"""The assignment of replacements to poses, against scipy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from posedesign.planning.assignment import least_assignment


@given(st.integers(0, 12), st.integers(0, 12), st.integers(0, 2**32 - 1), st.booleans())
def test_no_other_assignment_costs_less(rows, columns, seed, rounded):
    cost = np.random.default_rng(seed).uniform(size=(rows, columns))
    if rounded:  # many that cost as much
        cost = np.round(3.0 * cost)
    found = least_assignment(cost)
    best = linear_sum_assignment(cost)
    assert len(found[0]) == min(rows, columns)
    assert len(set(found[0].tolist())) == len(set(found[1].tolist())) == min(rows, columns)
    np.testing.assert_allclose(cost[found].sum(), cost[best].sum(), atol=1e-12)
    if not rounded:
        np.testing.assert_array_equal(found, best)
