"""The calibration model: predictions, whitening, names, refusals."""

import numpy as np
import pytest

from calib import CalibrationModel
from calib.errors import InputError
from calib.model import KnownDistance, Setup
from calib.model.measurements import Distance, Point, Pose, TouchUp, ViewLine
from calib.model.parameters import TargetFrame, TargetPoints, ToolFrame, ToolPoint, ZeroOffsets
from calib.se3 import rotation_exp, transform

MEASUREMENTS = {"touch-up": TouchUp([1e-5, 2e-5, 8e-5]), "view line": ViewLine([1e-5, 2e-5])}


def test_prediction_is_the_tool_point_less_the_target(make_model, reference_robot):
    model = make_model(targets=2)
    q = np.random.default_rng(1).uniform(-1, 1, (3, 6))
    T = reference_robot.fk(q)
    places = model.parameters[-1].positions_m
    tip = T[:, :3, :3] @ [0.2, -0.05, 0.35] + T[:, :3, 3]
    at = model.predict(q, setup=Setup.of(3, target=[1, 0, 1]))
    np.testing.assert_allclose(at, tip - places[[1, 0, 1]], atol=1e-14)
    np.testing.assert_allclose(model.predict(q), tip - places[0], atol=1e-14)


@pytest.mark.parametrize("measurement", MEASUREMENTS)
def test_whitening_divides_by_the_noise_of_the_rows(make_model, touching, measurement):
    model = make_model(measurement=MEASUREMENTS[measurement])
    q = touching(4)
    linear = model.linearise(q)
    J, white, root = linear.jacobian, linear.white_jacobian, linear.noise_root
    assert white.shape == J.shape
    m = model.measurement.rows
    assert root.shape == (4, m, m)
    sigma = model.measurement.sigma
    R = np.broadcast_to(np.eye(2), (4, 2, 2)) if m == 2 else model.robot.fk(q)[:, :3, :3]
    for i in range(4):  # by the textbook: Σ = R diag(σ²) Rᵀ for rows in base axes
        covariance = R[i] @ np.diag(sigma**2) @ R[i].T
        np.testing.assert_allclose(root[i] @ root[i].T, covariance, atol=1e-24)
        information = J[i].T @ np.linalg.inv(covariance) @ J[i]
        np.testing.assert_allclose(white[i].T @ white[i], information, rtol=1e-6, atol=1e-3)


def test_kinds_are_whitened_by_their_own_noise(make_mixed):
    model, setup = make_mixed()
    q = np.random.default_rng(3).uniform(-1, 1, (6, 6))
    linear = model.linearise(q, setup=setup, observed=np.zeros((6, 6)))
    for i, kind in enumerate(setup.kind):
        rows = model.measurements[kind].rows
        sigma = model.measurements[kind].sigma
        np.testing.assert_allclose(linear.white_rows[i, :rows], linear.rows[i, :rows] / sigma)
        assert (linear.rows[i, rows:] == 0).all()
        assert (linear.white_jacobian[i, rows:] == 0).all()
        expected = np.zeros((6, 6))
        expected[:rows, :rows] = np.diag(sigma)
        np.testing.assert_allclose(linear.noise_root[i], expected, atol=1e-20)
    assert model.equations(setup) == 2 * (3 + 6 + 1)
    assert model.rows == 6


def test_a_mixture_predicts_what_each_kind_alone_does(make_mixed):
    model, setup = make_mixed()
    rng = np.random.default_rng(4)
    q, x = rng.uniform(-1, 1, (2, 6, 6)), model.nominal + rng.uniform(-0.01, 0.01, model.p)
    together = model.predict(q, x, setup)
    for k, kind in enumerate(model.measurements):
        own = np.flatnonzero(setup.kind == k)
        alone = model.with_measurements([kind])
        same = Setup.of(2, tool=setup.tool[own], target=setup.target[own])
        rows = alone.predict(q[:, own], x, same)
        np.testing.assert_allclose(together[:, own, : kind.rows], rows, atol=1e-14)


@pytest.fixture
def make_mixed(reference_robot):
    def make() -> tuple[CalibrationModel, Setup]:
        T = transform(rotation_exp([0.3, -0.2, 0.5]), [1.5, 0.4, 0.2])
        model = CalibrationModel(
            reference_robot,
            [
                ZeroOffsets(reference_robot, reference_robot.joint_names),
                ToolFrame(transform(rotation_exp([0.1, 0.2, 0.3]), [0.1, 0.2, 0.3])),
                TargetFrame(T),
            ],
            [Point([1e-5, 2e-5, 3e-5]), Pose([1e-5] * 3 + [2e-5] * 3), Distance(4e-5)],
        )
        return model, Setup.of(6, kind=[0, 1, 2, 2, 1, 0])

    return make


def test_names_and_labels(make_model):
    model = make_model((5, 2), targets=2)
    assert model.names[:5] == (
        *("zero_offset.joint_5", "zero_offset.joint_2", "tool.x", "tool.y", "tool.z"),
    )
    assert model.targets == ("T1", "T2")
    assert model.p == len(model.names) == 11


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ("target", r"a calibration model needs a tool \(add ToolPoint .* free=''"),
        ("tool", r"a calibration model needs a target \(add TargetPoints to the parameters\)"),
        ("tool target tool", r"two tools have the same name \(rename one\)"),
        ("tool target frame", r"two targets have the same name \(rename one\)"),
        ("zero zero tool target", "the parameter zero_offset.joint_2 is there twice"),
    ],
)
def test_sets_of_blocks_that_make_no_model(reference_robot, blocks, message):
    known = {
        "tool": ToolPoint([0, 0, 0]),
        "target": TargetPoints([1, 0, 0]),
        "frame": TargetFrame(np.eye(4), "T1"),
        "zero": ZeroOffsets(reference_robot, ["joint_2"]),
    }
    with pytest.raises(InputError, match=message):
        CalibrationModel(reference_robot, [known[name] for name in blocks.split()], TouchUp(1e-5))


@pytest.mark.parametrize(
    ("q", "x", "setup", "message"),
    [
        (np.zeros((2, 6)), np.zeros(9), None, "the model has 10 parameters, 9 were given"),
        (np.zeros((2, 6)), 1.0, None, "the model has 10 parameters, 1 were given"),
        (np.zeros((2, 5)), None, None, "has 6 joints, the posture has 5 values"),
        (np.zeros(6), None, None, r"a list of postures, \(N, n\)"),
        (np.full((2, 6), np.nan), None, None, "joint_1 is not a finite number"),
        (np.zeros((2, 6)), None, Setup.of(1), "2 postures need 2 targets, 1 were given"),
        (
            np.zeros((2, 6)),
            None,
            Setup.of(2, target=[0, 1]),
            "target 2 of a measurement is not in the model, which has 1",
        ),
        (np.zeros((2, 6)), None, Setup.of(2, tool=[2, 0]), "tool 3 of a measurement is not"),
        (np.zeros((2, 6)), None, Setup.of(2, kind=1), "kind of measurement 2 of a measurement is"),
    ],
)
def test_arguments_are_checked(make_model, q, x, setup, message):
    model = make_model()
    for use in (model.predict, model.jacobian):
        with pytest.raises(InputError, match=message):
            use(q, x, setup)


@pytest.mark.parametrize(
    ("indices", "name"),
    [
        ({"target": [0, -1]}, "target"),
        ({"target": [0]}, "target"),
        ({"tool": [0, 0, 0]}, "tool"),
        ({"payload": -1}, "payload"),
        ({"kind": [[0, 0]]}, "kind"),
    ],
)
def test_a_set_up_needs_an_index_for_each_measurement(indices, name):
    with pytest.raises(InputError, match=f"2 measurements need 2 indices of the {name}, from 0 up"):
        Setup.of(2, **indices)


def test_a_distance_to_what_is_no_target(reference_robot):
    with pytest.raises(InputError, match=r"no target 'T3' .* \(did you mean T1\?\)"):
        CalibrationModel(
            reference_robot,
            [ToolPoint([0, 0, 0]), TargetPoints([1, 0, 0])],
            TouchUp(1e-5),
            distances=[KnownDistance("T1", "T3", 0.5)],
        )


@pytest.mark.parametrize("prior", [np.ones(9), np.zeros(10), np.full(10, np.nan), np.array(1.0)])
def test_priors_that_cannot_be(make_model, prior):
    with pytest.raises(InputError, match="a prior needs 10 standard deviations above zero"):
        make_model().with_prior(prior)
