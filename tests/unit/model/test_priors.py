"""What is known besides the measurements: priors, and distances between targets."""

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import InputError
from calib.identification import covariance_of
from calib.model import KnownDistance, Setup, simulate
from calib.model.measurements import Measurements, Point, TouchUp
from calib.model.parameters import TargetFrame, TargetPoints, ToolFrame, ToolPoint, ZeroOffsets

SIGMA = np.array([1e-5, 2e-5, 5e-5])
NAMES = ("A", "B", "C")


def linear_model(robot, prior_tool_m, prior_target_m) -> CalibrationModel:
    """Tool point and target enter linearly where the axes of the instrument are those of base."""
    blocks = [
        ToolPoint([0.2, -0.05, 0.35], prior_m=prior_tool_m),
        TargetPoints([1.5, 0.2, 0.4], prior_m=prior_target_m),
    ]
    return CalibrationModel(robot, blocks, Point(SIGMA))


@pytest.mark.parametrize(("tool", "target"), [(1e-5, 2e-5), (3e-4, None), (None, 1e-5)])
def test_a_prior_gives_the_closed_form_of_maximum_a_posteriori(reference_robot, tool, target):
    model = linear_model(reference_robot, tool, target)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (5, 6))
    x = model.nominal + rng.normal(0, np.minimum(model.prior, 1e-3))
    data = simulate(model, x, q, rng)
    result = identify(model, data)
    # by the textbook: rows R t - m, of noise SIGMA
    T = reference_robot.fk(q)
    A = np.concatenate([T[:, :3, :3], np.broadcast_to(-np.eye(3), (5, 3, 3))], axis=2)
    b = data.observed - T[:, :3, 3]
    W = np.diag(1 / SIGMA**2)
    P = np.diag([0.0 if s is None else 1 / s**2 for s in (tool, target) for _ in range(3)])
    N = np.einsum("nij,jk,nkl->il", np.swapaxes(A, 1, 2), W, A) + P
    right = np.einsum("nij,jk,nk->i", np.swapaxes(A, 1, 2), W, b) + P @ model.nominal
    expected = np.linalg.solve(N, right)
    np.testing.assert_allclose(result.values, expected, atol=1e-12)
    scale = np.sqrt(np.diag(np.linalg.inv(N)))
    unscaled = covariance_of(model, q, result.values)
    np.testing.assert_allclose(
        unscaled / np.outer(scale, scale), np.linalg.inv(N) / np.outer(scale, scale), atol=1e-9
    )
    # residuals are held against the equations that parameters do not use up
    rows = data.observed - model.predict(q, result.values)
    assert result.chi2 == pytest.approx(np.sum((rows / SIGMA) ** 2), rel=1e-9)
    hat = np.einsum("nij,jk,nlk,lm->nim", A, np.linalg.inv(N), A, W)
    used = np.trace(hat, axis1=1, axis2=2).sum()
    assert result.degrees_of_freedom == round(15 - used)


def test_a_wide_prior_changes_nothing_and_a_narrow_one_holds(make_model, touching):
    model = make_model()
    x = model.nominal + 1e-3
    data = simulate(model, x, touching(20), np.random.default_rng(1))
    free = identify(model, data)
    wide = identify(model.with_prior(np.full(10, 1e3)), data)
    np.testing.assert_array_less(np.abs(wide.values - free.values), 1e-4 * free.sigma)
    prior = np.full(10, np.inf)
    prior[2] = 1e-9
    held = identify(model.with_prior(prior), data)
    assert held.values[2] == pytest.approx(model.nominal[2], abs=1e-9)
    assert held.sigma[2] == pytest.approx(1e-9, rel=0.2) or not held.explains_data


def test_what_only_the_prior_knows_is_said(make_model, touching, reference_robot):
    """The first joint hides behind the target: its prior makes it free, and holds it."""
    base = make_model((1, 2, 3, 4, 5))
    prior = np.full(base.p, np.inf)
    prior[0] = 1e-3
    model = base.with_prior(prior)
    x = model.nominal + 2e-4
    data = simulate(model, x, touching(20), np.random.default_rng(2))
    result = identify(model, data)
    assert result.held_by_prior == ["zero_offset.joint_1"]
    assert result.values[0] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(result.sigma[0], 1e-3, rtol=1e-3)
    np.testing.assert_array_equal(result.prior, prior)
    # what is measured to better than the prior is not held by it
    prior[1:5] = 0.1
    assert identify(base.with_prior(prior), data).held_by_prior == ["zero_offset.joint_1"]


def test_priors_make_up_for_missing_measurements(make_model, touching):
    model = make_model().with_prior(np.full(10, 1e-3))
    data = simulate(model, model.nominal + 1e-4, touching(1), np.random.default_rng(3))
    result = identify(model, data)
    # three equations, of which the parameters use up next to all
    assert result.degrees_of_freedom == 0
    assert (result.sigma <= 1e-3 * (1 + 1e-9)).all()


def three_targets(robot, target_m, distances=(), sigma=1e-5) -> CalibrationModel:
    places = target_m + np.array([[0, 0, 0], [0, 0.3, 0.4], [0.2, -0.3, 0.3]])
    blocks = [
        ZeroOffsets(robot, ["joint_3"]),
        ToolPoint([0.2, -0.05, 0.35]),
        TargetPoints(places, NAMES),
    ]
    return CalibrationModel(robot, blocks, TouchUp(sigma), distances)


def test_known_distances_are_differentiated(reference_robot, target_m):
    known = [KnownDistance("A", "B", 0.5, 1e-5), KnownDistance("C", "A", 0.46, 2e-5)]
    model = three_targets(reference_robot, target_m, known).with_prior(
        np.where(np.arange(13) % 3 == 0, 1e-3, np.inf)
    )
    rng = np.random.default_rng(4)
    x = model.nominal + rng.uniform(-0.01, 0.01, (2, model.p))
    rows, J = model.known(x)
    assert rows.shape == (2, 5 + 2)
    for k in range(model.p):
        h = 1e-6 * np.eye(model.p)[k]
        numeric = (model.known(x + h)[0] - model.known(x - h)[0]) / 2e-6
        np.testing.assert_allclose(J[..., k], numeric, rtol=1e-6, atol=1e-3)
    places = x[:, 4:].reshape(2, 3, 3)
    length = np.linalg.norm(places[:, 1] - places[:, 0], axis=1)
    np.testing.assert_allclose(rows[:, 5], (length - 0.5) / 1e-5, rtol=1e-9)


def test_a_known_distance_is_weighed_by_its_own_noise(reference_robot, target_m, touching):
    shifts = np.array([[0, 0, 0], [0, 0.3, 0.4], [0.2, -0.3, 0.3]])
    q = np.concatenate([touching(5, shift=s) for s in shifts])
    setup = Setup.of(15, target=np.repeat([0, 1, 2], 5))
    plain = three_targets(reference_robot, target_m)
    data = simulate(plain, plain.nominal, q, np.random.default_rng(5), setup=setup)
    free = identify(plain, data)
    C = free.covariance
    place = free.values[4:].reshape(3, 3)
    apart = place[1] - place[0]
    g = np.zeros(plain.p)
    g[4:7], g[7:10] = -apart, apart
    g /= np.linalg.norm(apart)
    for sigma in (1e-7, 1e-5, 1e-3):
        length = np.linalg.norm(apart) + 5e-6
        model = three_targets(reference_robot, target_m, [KnownDistance("A", "B", length, sigma)])
        result = identify(model, data)
        # Kalman's update by one more row; the problem is all but linear there
        gain = C @ g / (g @ C @ g + sigma**2)
        moved = free.values + gain * 5e-6
        np.testing.assert_array_less(np.abs(result.values - moved), 1e-3 * free.sigma)
        expected = C - np.outer(gain, g @ C)
        np.testing.assert_allclose(result.sigma, np.sqrt(np.diag(expected)), rtol=1e-4)


def test_surveyed_targets_may_be_named_in_a_distance(reference_robot, target_m):
    blocks = [
        ToolPoint([0.2, -0.05, 0.35]),
        TargetPoints([[1, 2, 3.0]], ["held"], free=False),
        TargetPoints([target_m], ["free"]),
    ]
    known = [KnownDistance("held", "free", 1.0)]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5), known)
    x = model.nominal
    rows, J = model.known(x[None])
    length = np.linalg.norm(target_m - [1, 2, 3])
    assert rows[0, 0] == pytest.approx((length - 1.0) / 1e-5)
    np.testing.assert_allclose(J[0, 0, 3:] * 1e-5, (target_m - [1, 2, 3]) / length)
    np.testing.assert_array_equal(J[0, 0, :3], 0.0)


def test_a_distance_to_a_frame_that_turns_is_refused(reference_robot, target_m, touching):
    blocks = [
        ToolFrame(np.eye(4), free=()),
        TargetPoints([target_m], ["P"]),
        TargetFrame(np.eye(4), "tracker"),
    ]
    known = [KnownDistance("P", "tracker", 1.0)]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5), known)
    with pytest.raises(InputError, match="distance to target 'tracker' cannot be known"):
        identify(model, Measurements(touching(8), Setup.of(8), ("P", "tracker")))


def test_unweighted_rows_cannot_be_weighed_against_a_prior(make_model, touching):
    model = make_model().with_prior(np.full(10, 1e-3))
    data = simulate(model, model.nominal, touching(10))
    with pytest.raises(InputError, match="need rows that are weighted by their noise"):
        identify(model, data, weighted=False)
    with pytest.raises(InputError, match="need rows that are weighted by their noise"):
        covariance_of(model, touching(10), weighted=False)
