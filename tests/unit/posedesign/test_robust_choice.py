"""Robots that are not as described: their blocks, and what a choice is worth on them."""

from __future__ import annotations

import numpy as np
import pytest

from calib.identification import identify_batch
from calib.model.measurements.simulate import simulate
from calib.model.measurements.touch import touch
from posedesign.candidates import cone_pool
from posedesign.candidates.of_cell import functions_over_box
from posedesign.planning.optimal import Wish, plan_optimal
from posedesign.planning.optimal.objective import goal_of
from posedesign.planning.optimal.robust import TRIALS, blocks_of_robots, draw_parameters, robustness

TILT = np.deg2rad(40.0)


@pytest.fixture(scope="module")
def reference(make_cell):
    cell = make_cell()
    model = cell.model()
    pool = cone_pool(cell, TILT, 40, np.random.default_rng(3))
    box, _ = functions_over_box(cell, model)
    return cell, model, pool, goal_of(Wish(), model, box)


def test_parameters_are_drawn_as_the_cell_says(reference):
    cell, model, _, _ = reference
    drawn = draw_parameters(cell, model, 4001, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn[0], model.nominal)
    spread = (drawn[1:] - model.nominal).std(axis=0)
    expected = [np.deg2rad(1.0) if unit == "rad" else 5e-3 for unit in model.units]
    # standard error of a standard deviation: 1 / sqrt(2 n); five of them
    np.testing.assert_allclose(spread, expected, rtol=5 / np.sqrt(8000))


def test_blocks_are_those_at_the_postures_that_touch(reference):
    cell, model, pool, goal = reference
    drawn = draw_parameters(cell, model, 3, np.random.default_rng(1))
    blocks = blocks_of_robots(model, goal, pool, drawn)
    assert blocks.shape == (3, len(pool), 3, model.p)
    np.testing.assert_allclose(blocks[0], pool.white(model), rtol=1e-9, atol=1e-6)
    q, miss = touch(model, pool.postures, drawn[2])
    assert miss.max() < 1e-9
    step = 1e-6
    for k in range(model.p):  # central differences of what such a robot would show
        shift = step * np.eye(model.p)[k]
        ahead = model.linearise(q, drawn[2] + shift).white_rows
        behind = model.linearise(q, drawn[2] - shift).white_rows
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(blocks[2][..., k], slope, rtol=1e-4, atol=1.0)


def test_what_is_said_of_other_robots_is_what_identification_finds_there(reference):
    """The predicted error over the box, against Monte Carlo on one such robot."""
    cell, model, pool, goal = reference
    chosen = pool.take(np.arange(0, len(pool), 3))
    x = draw_parameters(cell, model, 2, np.random.default_rng(5))[1]
    predicted = goal.criterion.shown(
        goal.cost_of_blocks(blocks_of_robots(model, goal, chosen, x[None])[0])
    )
    trials, rng = 600, np.random.default_rng(6)

    data = simulate(model, x, chosen.postures, rng, trials=trials)
    found = identify_batch(model, data)
    box, _ = functions_over_box(cell, model)
    error = np.einsum("krp,tp->tkr", box, found - x)
    rms = np.sqrt((error**2).sum(axis=(1, 2)).mean() / len(box))
    # a few parameters carry most of the error: some 600 independent squares, five standard errors
    assert 1e3 * rms == pytest.approx(predicted, rel=5 / np.sqrt(2 * trials))  # in mm


def test_robustness_is_of_the_trials(reference):
    cell, model, pool, goal = reference
    chosen = pool.take(np.arange(0, len(pool), 3))
    found = robustness(cell, model, goal, chosen)
    assert found.trials == TRIALS
    assert found.nominal == pytest.approx(goal.value_of(chosen.linearise(model)), rel=1e-6)
    assert found.nominal < found.worst
    assert found.median < found.worst
    assert found.worst < 3 * found.nominal  # a degree and 5 mm do not make it useless


def test_a_robust_plan_says_for_how_many_robots(make_cell):
    cell = make_cell(pool={"candidates": 60})
    for robust in ("average", "worst"):
        plan = plan_optimal(cell, Wish(count=8, robust=robust))
        assert plan.reached
        assert f"{robust} of 6 robots" in plan.message
        assert plan.selection.value >= plan.accuracy.value * 0.9
        assert plan.selection.efficiency > 0.9
