"""Accuracy over the volume that an arm works in."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import InputError, UnreachableError
from calib.identification.prediction import Expectation
from calib.identification.prior_arms import PriorArms
from posedesign.cell import TaskBox
from posedesign.cell.task_box import COLUMNS, BoxAccuracy, predict_box
from posedesign.planning import plan

BOX = TaskBox(np.array([1.4, -0.4, 0.5]), np.array([2.0, 0.4, 1.1]), (2, 3, 2))


@pytest.fixture(scope="module")
def planned(reference_cell):
    model = reference_cell.model()
    return PriorArms(model), model.linearise(plan(reference_cell).postures).white_jacobian


@pytest.fixture(scope="module")
def found(reference_cell, planned) -> BoxAccuracy:
    return predict_box(reference_cell, *planned, BOX)


def test_points_of_a_box():
    points = BOX.points_m
    assert points.shape == (12, 3)
    np.testing.assert_array_equal(points[0], BOX.lowest_m)
    np.testing.assert_array_equal(points[-1], BOX.highest_m)
    np.testing.assert_allclose(np.unique(points[:, 1]), [-0.4, 0.0, 0.4], atol=1e-15)
    one = TaskBox(BOX.lowest_m, BOX.highest_m, (1, 1, 1))
    np.testing.assert_allclose(one.points_m, [[1.7, 0.0, 0.8]])


def test_the_tool_stands_on_each_point_as_at_the_base_pose(reference_cell, found):
    assert found.reached.all()
    state = reference_cell.robot.state(found.postures)
    np.testing.assert_allclose(state.point(reference_cell.tool_m), BOX.points_m, atol=1e-8)
    R = reference_cell.robot.fk(reference_cell.base_posture)[:3, :3]
    np.testing.assert_allclose(state.R_base_tip, np.broadcast_to(R, (12, 3, 3)), atol=1e-8)
    for q in found.postures:
        reference_cell.robot.check_limits(q)


def test_figures_are_those_of_the_covariance(planned, found):
    """The base placed anew over all points: by drawn arms, each moved onto the one as described."""
    model = planned[0].model
    C = np.linalg.inv(np.einsum("nmp,nmq->pq", planned[1], planned[1]))
    left = Expectation(model, model.nominal, C, found.postures)
    J = left.jacobian.reshape(len(found.postures), 3, model.p)
    expected = J @ C @ np.swapaxes(J, 1, 2)
    np.testing.assert_allclose(found.covariance, expected)
    draws = 4000
    x = model.nominal + np.random.default_rng(0).multivariate_normal(np.zeros(model.p), C, draws)
    true = model.view(found.postures).tool_points
    squares = []
    for points in model.view(found.postures, x).tool_points:
        moved = points - points.mean(axis=0)
        turn, _ = Rotation.align_vectors(true - true.mean(axis=0), moved)
        squares.append(np.sum((turn.apply(moved) - true + true.mean(axis=0)) ** 2, axis=1))
    drawn = np.sqrt(np.mean(squares, axis=0))
    # of squares of a few normal variates: five standard errors of their mean
    np.testing.assert_allclose(found.rms_m, drawn, rtol=5 / np.sqrt(2 * draws))
    rows = found.rows()
    assert list(rows[0]) == [*COLUMNS, "reason"]
    for row, point, spread in zip(rows, BOX.points_m, expected, strict=True):
        assert [row["x_mm"], row["y_mm"], row["z_mm"]] == pytest.approx((1e3 * point).tolist())
        sigma = 1e3 * np.sqrt(np.diag(spread))
        assert [row[f"sigma_{a}_mm"] for a in "xyz"] == pytest.approx(sigma.tolist())
        assert row["rms_mm"] == pytest.approx(np.linalg.norm(sigma))
        largest = 1e3 * np.sqrt(np.linalg.eigvalsh(spread)[-1])
        assert row["worst_sigma_mm"] == pytest.approx(largest)
        assert sigma.max() <= row["worst_sigma_mm"] <= row["rms_mm"]
        assert row["reason"] == ""
    assert found.summary().startswith("12 of 12 points reached: rms ")
    assert "the base is placed anew" in found.reference


def test_nearer_to_the_target_it_is_reached_better(reference_cell, planned):
    at = reference_cell.target_m
    near = predict_box(reference_cell, *planned, TaskBox(at, at, (1, 1, 1)))
    away = predict_box(reference_cell, *planned, BOX)
    assert near.to_target_m[0] < 0.5 * np.median(away.to_target_m)
    assert near.to_target_m[0] < away.to_target_m.min()
    assert near.to_target_m[0] < 2e-5  # better than a single touch-up


def test_what_cannot_be_reached_has_a_reason(reference_cell, planned):
    box = TaskBox(np.array([1.5, 0.0, 0.8]), np.array([5.5, 0.0, 0.8]), (3, 1, 1))
    found = predict_box(reference_cell, *planned, box)
    np.testing.assert_array_equal(found.reached, [True, False, False])
    row = found.rows()[2]
    assert str(row["reason"]).startswith("out of reach by ")
    assert row["rms_mm"] is None
    assert row["x_mm"] == pytest.approx(5500.0)
    assert np.isnan(found.rms_m[1:]).all()
    assert np.isnan(found.worst_m[1:]).all()
    assert found.summary().startswith("1 of 3 points reached")


def test_nothing_reachable_is_refused(reference_cell, planned):
    far = np.array([9.0, 0.0, 0.0])
    with pytest.raises(UnreachableError, match="no point of the task box can be reached: out of"):
        predict_box(reference_cell, *planned, TaskBox(far, far, (1, 1, 1)))


def test_obstacles_count(make_cell, planned):
    block = {"name": "block", "size_mm": [300.0, 300.0, 300.0], "at_mm": [1400.0, -400.0, 1100.0]}
    cell = make_cell(obstacle=[block], constraints={"collisions": True})
    found = predict_box(cell, *planned, BOX)
    assert 0 < found.reached.sum() < 12
    assert any("block" in reason for reason in found.reasons)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2,3", "not six numbers"),
        ("a,b,c,d,e,f", "not six numbers"),
        ("1,2,3,4,5,nan", "not six numbers"),
        ("1,2,3,4,5,inf", "not six numbers"),
        ("", "not six numbers"),
        ("1,2,3,4,5,6,7", "not six numbers"),
        ("1,2,9,4,5,6", "upside down along z: 9 is above 6"),
        ("0,0,0,1e12,1,1", "two corners"),
    ],
)
def test_text_that_is_no_box_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        TaskBox.of_text(text)


@pytest.mark.parametrize("steps", [(0, 3, 3), (1000, 1000, 1000), (3, -1, 3)])
def test_steps_out_of_bounds_are_refused(steps):
    with pytest.raises(InputError, match="points"):
        TaskBox(BOX.lowest_m, BOX.highest_m, steps)
