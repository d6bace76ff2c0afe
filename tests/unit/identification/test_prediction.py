"""Accuracy predicted before measuring, against what many identifications scatter by."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import CalibrationModel
from calib.errors import InputError
from calib.identification import covariance_of, identify_batch, predict_accuracy, tool_motion
from calib.identification.prediction import placed_anew
from calib.model import Setup, simulate
from calib.model.measurements import TouchUp, ViewLine
from calib.model.parameters import JointCompliance, Payload, TargetPoints, ToolPoint, ZeroOffsets

TRIALS = 500


@pytest.fixture(scope="module")
def elsewhere(reference_robot) -> np.ndarray:
    rng = np.random.default_rng(9)
    return rng.uniform(reference_robot.lower / 2, reference_robot.upper / 2, (12, 6))


@pytest.mark.parametrize(("against", "with_compliance"), [("base", False), ("target", True)])
def test_monte_carlo_scatters_as_predicted(
    reference_robot, make_model, touching, elsewhere, with_compliance, against
):
    extra = (JointCompliance(reference_robot, ["joint_2", "joint_3"]),) if with_compliance else ()
    model = make_model(extra=extra)
    q = touching(30)
    x = model.nominal + np.where(np.array(model.units) == "rad/Nm", 3e-7, 1e-3)
    data = simulate(model, x, q, np.random.default_rng(1), trials=TRIALS)
    found = identify_batch(model, data)
    touched = simulate(model, x, q).postures
    covariance = covariance_of(model, touched, x)
    predicted = predict_accuracy(model, covariance, elsewhere, x=x, against=against)
    seen, true = model.view(elsewhere, found), model.view(elsewhere, x)
    off = seen.tool_points - true.tool_points
    if against == "target":
        off = seen.posture_first(seen.error) - true.posture_first(true.error)
    # whitened by the prediction the scatter is of unit covariance, each element within 5 sigma
    white = np.linalg.solve(np.linalg.cholesky(predicted), np.moveaxis(off, 0, -1))
    scatter = white @ np.swapaxes(white, -1, -2) / TRIALS
    five = 5.0 * np.sqrt((1.0 + np.eye(3)) / TRIALS)
    assert (np.abs(scatter - np.eye(3)) < five).all()


def test_targets_are_of_no_account(make_model, touching, elsewhere):
    model = make_model()
    C = covariance_of(model, touching(30))
    larger = C.copy()
    larger[7:, 7:] *= 100.0
    found = predict_accuracy(model, C, elsewhere)
    np.testing.assert_array_equal(found, predict_accuracy(model, larger, elsewhere))
    assert (np.linalg.eigvalsh(found) > 0).all()
    larger = C.copy()
    larger[4:7, 4:7] *= 4.0  # the tool is
    wider = predict_accuracy(model, larger, elsewhere)
    assert (np.trace(wider - found, axis1=1, axis2=2) > 0).all()


def test_what_arm_and_target_do_together_does_not_count(make_model, touching):
    """Where it was touched up, the tool point stands to the target as well as it was touched."""
    model, q = make_model(), touching(30)
    C = covariance_of(model, q)
    near, far = (
        np.sqrt(np.trace(predict_accuracy(model, C, q, against=against), axis1=1, axis2=2))
        for against in ("target", "base")
    )
    assert near.max() < 0.2 * far.min()


def test_an_unknown_reference_is_refused(make_model, elsewhere):
    with pytest.raises(InputError, match="unknown 'world'"):
        predict_accuracy(make_model(), np.eye(10), elsewhere, against="world")


def test_the_zero_of_joint_1_is_no_error_once_the_base_is_placed_anew(
    reference_robot, target_m, elsewhere
):
    """It turns all points alike; the zero of joint 2 does not."""
    blocks = [
        ZeroOffsets(reference_robot, ["joint_1", "joint_2"]),
        ToolPoint([0.2, -0.05, 0.35], ""),
        TargetPoints([target_m], free=False),
    ]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5))
    points = model.view(elsewhere).tool_points
    moved = tool_motion(model, elsewhere)
    left = placed_anew(moved, points)
    assert np.abs(moved[..., 0]).max() > 0.1
    np.testing.assert_allclose(left[..., 0], 0.0, atol=1e-12)
    # as the best fit of two sets of points has it
    turned = points + 1e-6 * moved[..., 1]
    best, _ = Rotation.align_vectors(points - points.mean(axis=0), turned - turned.mean(axis=0))
    off = best.apply(turned - turned.mean(axis=0)) - points + points.mean(axis=0)
    assert np.abs(left[..., 1]).max() > 0.1
    np.testing.assert_allclose(left[..., 1], off / 1e-6, atol=1e-4)


def test_the_zero_of_joint_1_counts_where_it_is_identified(
    reference_robot, target_m, touching, elsewhere
):
    """As far as a point is from the axis of joint 1, so far its sigma is carried."""
    blocks = [
        ZeroOffsets(reference_robot, ["joint_1"]),
        ToolPoint([0.2, -0.05, 0.35], ""),
        TargetPoints([target_m], free=False),
    ]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5))
    found = predict_accuracy(model, [[1e-8]], elsewhere)
    p = model.view(elsewhere).tool_points
    expected = np.hypot(p[:, 0], p[:, 1]) * 1e-4
    np.testing.assert_allclose(np.sqrt(np.trace(found, axis1=1, axis2=2)), expected, rtol=1e-9)
    np.testing.assert_allclose(found[:, 2], 0.0, atol=1e-20)


def test_the_payload_counts(reference_robot, target_m, elsewhere):
    loads = [Payload(0.0, [0, 0, 0]), Payload(165.0, [0, 0, 0.2])]
    blocks = [
        JointCompliance(reference_robot, ["joint_2"], loads),
        ToolPoint([0.2, -0.05, 0.35], ""),
        TargetPoints([target_m], free=False),
    ]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5))
    light, heavy = (
        predict_accuracy(model, [[1e-14]], elsewhere, Setup.of(12, payload=k)) for k in (0, 1)
    )
    assert np.abs(heavy - light).max() > 0.1 * light.max()


@pytest.mark.parametrize(
    ("covariance", "words"),
    [(np.eye(3), "shape"), (np.full((10, 10), np.inf), "not finite"), (np.nan, "shape")],
)
def test_what_is_no_covariance_of_the_model_is_refused(make_model, elsewhere, covariance, words):
    with pytest.raises(InputError, match=words):
        predict_accuracy(make_model(), covariance, elsewhere)


IDENTIFICATIONS = 600


@pytest.mark.parametrize(("kind", "weighted"), [("touch-up", True), ("view line", False)])
def test_covariance_is_the_scatter_of_the_estimates(make_model, touching, kind, weighted):
    model = make_model()
    if kind == "view line":
        model = make_model(measurement=ViewLine([1e-5, 4e-5]), free="xy")
    q = touching(20, tilt=0.8)
    x = model.nominal.copy()
    x[:4] = np.deg2rad([0.2, -0.3, 0.1, 0.2])
    clean = simulate(model, x, q)
    data = simulate(model, x, q, np.random.default_rng(0), trials=IDENTIFICATIONS)
    estimates = identify_batch(model, data, weighted=weighted)
    predicted = covariance_of(model, clean.postures, x, weighted=weighted)
    # in axes in which the prediction is the unit matrix, every direction is tested alike
    root = np.linalg.cholesky(predicted)
    white = np.linalg.solve(root, (estimates - x).T).T
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=5 / np.sqrt(IDENTIFICATIONS))
    scatter = np.cov(white.T)
    np.testing.assert_allclose(np.diag(scatter), 1.0, atol=5 * np.sqrt(2 / IDENTIFICATIONS))
    off = scatter - np.diag(np.diag(scatter))
    np.testing.assert_allclose(off, 0.0, atol=5 / np.sqrt(IDENTIFICATIONS))


def test_weighting_by_the_noise_is_never_worse(make_model, touching):
    model, q = make_model(), touching(20)
    gain = covariance_of(model, q, weighted=False) - covariance_of(model, q)
    sigma = np.sqrt(np.diag(covariance_of(model, q)))
    assert np.linalg.eigvalsh(gain / np.outer(sigma, sigma)).min() > -1e-6


def test_covariance_scales_with_the_noise_and_the_number_of_rounds(make_model, touching):
    q = touching(12)
    once = covariance_of(make_model(measurement=TouchUp(1e-5)), q)
    louder = covariance_of(make_model(measurement=TouchUp(3e-5)), q)
    twice = covariance_of(make_model(measurement=TouchUp(1e-5)), np.concatenate([q, q]))
    np.testing.assert_allclose(louder, 9 * once, rtol=1e-6)
    np.testing.assert_allclose(twice, once / 2, rtol=1e-6)
    # equal noise in all rows: weighting changes nothing
    plain = covariance_of(make_model(measurement=TouchUp(1e-5)), q, weighted=False)
    np.testing.assert_allclose(plain, once, rtol=1e-6)
