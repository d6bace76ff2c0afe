"""Errors that are kept up to date as poses are taken in and put back."""

import numpy as np
import pytest

from posedesign.selection.candidates import Candidates
from posedesign.selection.information import ErrorState, InformationState
from posedesign.selection.variances import DeviationObjective


@pytest.mark.parametrize("known", [0.0, 1.0], ids=["nothing known", "priors"])
def test_costs_are_those_that_are_computed_anew(known):
    """Of candidates taken in and put back, after a pose left that others hardly replace."""
    rng = np.random.default_rng(3)
    blocks = rng.normal(size=(40, 2, 6))
    blocks[7] *= 1e2  # what it tells, no other tells as well
    candidates = Candidates(blocks, known * np.eye(6))
    L = rng.normal(size=(1, 9, 6))
    objective = DeviationObjective(candidates, L)
    state = objective.state(np.arange(8), 8)
    assert isinstance(state, ErrorState)
    for drop, take in ((7, 20), (2, 7), (20, 31), (0, 12), (7, 39)):
        state.drop(drop)
        part = np.setdiff1d(np.arange(40), state.rows)
        plain = InformationState(candidates, state.rows, 8)
        found = objective.costs(state, part, 1.0)
        np.testing.assert_allclose(found, objective.costs(plain, part, 1.0), rtol=1e-6)
        before = state.snapshot
        state.take(take)
        state.snapshot = before
        np.testing.assert_array_equal(objective.costs(state, part, 1.0), found)
        state.take(take)
        plain = InformationState(candidates, state.rows, 8)
        for rows, sign in ((part[part != take], 1.0), (state.rows, -1.0)):
            np.testing.assert_allclose(
                objective.costs(state, rows, sign), objective.costs(plain, rows, sign), rtol=1e-6
            )
