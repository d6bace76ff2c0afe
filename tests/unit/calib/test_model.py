"""The calibration model: every Jacobian against central differences, shapes, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.errors import InputError
from calib.measurement import TouchUp, ViewLine
from calib.parameters import JointCompliance, Payload, TargetPoints, ToolPoint, ZeroOffsets

MEASUREMENTS = {"touch-up": TouchUp([1e-5, 2e-5, 8e-5]), "view line": ViewLine([1e-5, 2e-5])}
STEP = {"rad": 1e-5, "m": 1e-5, "rad/Nm": 1e-8}
"""Of the central differences: each moves the arm by some 10 µm."""

ROUNDING_M = 2e-15
"""Of a difference of two positions some metres off."""


def blocks(robot: Robot, kind: str) -> list:
    load = Payload(100.0, np.array([0.1, 0.0, 0.2]))
    tool, targets = (
        ToolPoint([0.2, -0.05, 0.35], ""),
        TargetPoints([[1.9, 0.1, 0.5], [1.5, 0.6, 1]], "ab"),
    )
    return {
        "zero offsets": [ZeroOffsets(robot, robot.joint_names), tool, targets],
        "compliance": [JointCompliance(robot, robot.joint_names[1:], load), tool, targets],
        "tool": [ToolPoint([0.2, -0.05, 0.35], "zxy"), targets],
        "targets": [tool, targets],
        "all": [
            TargetPoints([[1.9, 0.1, 0.5], [1.5, 0.6, 1]], "ab"),
            JointCompliance(robot, robot.joint_names[::2], load),
            ToolPoint([0.2, -0.05, 0.35], "yz"),
            ZeroOffsets(robot, robot.joint_names[::-1]),
        ],
    }[kind]


@pytest.mark.parametrize("measurement", MEASUREMENTS)
@pytest.mark.parametrize("kind", ["zero offsets", "compliance", "tool", "targets", "all"])
@pytest.mark.parametrize("batch", ["one set", "trials of x", "trials of q", "both"])
def test_jacobian_is_the_derivative_of_the_prediction(reference_robot, measurement, kind, batch):
    rng = np.random.default_rng(0)
    model = CalibrationModel(
        reference_robot, blocks(reference_robot, kind), MEASUREMENTS[measurement]
    )
    steps = np.array([STEP[unit] for unit in model.units])
    trials = 3
    q_shape = (trials, 5, 6) if batch in ("trials of q", "both") else (5, 6)
    x_shape = (trials, model.p) if batch in ("trials of x", "both") else (model.p,)
    q = rng.uniform(-1, 1, q_shape)
    x = model.nominal + 1e3 * steps * rng.uniform(-1, 1, x_shape)  # up to 10 mrad, 10 mm
    target = np.array([0, 1, 1, 0, 1])
    J = model.jacobian(q, x, target)
    out = (5,) if batch == "one set" else (trials, 5)
    assert J.shape == (*out, model.measurement.rows, model.p)
    for k in range(model.p):
        shift = steps[k] * np.eye(model.p)[k]
        ahead, behind = model.predict(q, x + shift, target), model.predict(q, x - shift, target)
        numeric = (ahead - behind) / (2 * steps[k])
        size = max(np.abs(numeric).max(), 1.0)
        np.testing.assert_allclose(J[..., k], numeric, atol=1e-9 * size + ROUNDING_M / steps[k])


def test_prediction_is_the_tool_point_less_the_target(make_model, reference_robot):
    model = make_model(targets=2)
    q = np.random.default_rng(1).uniform(-1, 1, (3, 6))
    T = reference_robot.fk(q)
    places = model.parameters[-1].positions_m
    tip = T[:, :3, :3] @ [0.2, -0.05, 0.35] + T[:, :3, 3]
    at = model.predict(q, target=np.array([1, 0, 1]))
    np.testing.assert_allclose(at, tip - places[[1, 0, 1]], atol=1e-14)
    np.testing.assert_allclose(model.predict(q), tip - places[0], atol=1e-14)


def test_trials_are_independent(make_model):
    model = make_model()
    rng = np.random.default_rng(2)
    q, x = rng.uniform(-1, 1, (3, 4, 6)), model.nominal + rng.uniform(-0.01, 0.01, (3, model.p))
    together, J, R = model.linearise(q, x)
    for t in range(3):
        rows, J_t, R_t = model.linearise(q[t], x[t])
        np.testing.assert_allclose(rows, together[t], atol=1e-14)
        np.testing.assert_allclose(J_t, J[t], atol=1e-14)
        np.testing.assert_allclose(R_t, R[t], atol=1e-14)


@pytest.mark.parametrize("measurement", MEASUREMENTS)
def test_whitening_divides_by_the_noise_of_the_rows(make_model, measurement):
    model = make_model(measurement=MEASUREMENTS[measurement])
    q = np.random.default_rng(3).uniform(-1, 1, (4, 6))
    rows, J, R = model.linearise(q)
    white = model.whiten(q, J)
    assert white.shape == J.shape
    with pytest.raises(InputError, match="blocks to whiten have shape"):
        model.whiten(q, rows)
    m = model.measurement.rows
    sigma = model.measurement.sigma_m
    for i in range(4):  # by the textbook: Σ = R diag(σ²) Rᵀ for rows in base axes
        turn = R[i] if m == 3 else np.eye(2)
        root = turn @ np.diag(sigma**2) @ turn.T
        np.testing.assert_allclose(
            white[i].T @ white[i], J[i].T @ np.linalg.inv(root) @ J[i], rtol=1e-9, atol=1e-3
        )


def test_names_and_labels(make_model):
    model = make_model((5, 2), targets=2)
    assert model.names[:5] == (
        *("zero_offset.joint_5", "zero_offset.joint_2", "tool.x", "tool.y", "tool.z"),
    )
    assert model.labels == ("T1", "T2")
    assert model.p == len(model.names) == 11


def tool_and_targets() -> list:
    return [ToolPoint([0, 0, 0]), TargetPoints([1, 0, 0])]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: [TargetPoints([1, 0, 0])], r"exactly one ToolPoint \(add it .* free=''"),
        (
            lambda r: [ToolPoint([0, 0, 0])],
            r"exactly one TargetPoints \(add it to the parameters\)",
        ),
        (lambda r: [*tool_and_targets(), ToolPoint([0, 0, 1])], "exactly one ToolPoint"),
        (
            lambda r: [
                ZeroOffsets(r, ["joint_2"]),
                ZeroOffsets(r, ["joint_2"]),
                *tool_and_targets(),
            ],
            "the parameter zero_offset.joint_2 is there twice",
        ),
    ],
)
def test_sets_of_blocks_that_make_no_model(reference_robot, change, message):
    with pytest.raises(InputError, match=message):
        CalibrationModel(reference_robot, change(reference_robot), TouchUp(1e-5))


@pytest.mark.parametrize(
    ("q", "x", "target", "message"),
    [
        (np.zeros((2, 6)), np.zeros(9), None, "the model has 10 parameters, 9 were given"),
        (np.zeros((2, 6)), 1.0, None, "the model has 10 parameters, 1 were given"),
        (np.zeros((2, 5)), None, None, "has 6 joints, the posture has 5 values"),
        (np.zeros(6), None, None, r"a list of postures, \(N, n\)"),
        (np.full((2, 6), np.nan), None, None, "joint_1 is not a finite number"),
        (np.zeros((2, 6)), None, [0, 1], "2 postures need 2 targets, each an index from 0 to 0"),
        (np.zeros((2, 6)), None, [0, -1], "2 postures need 2 targets"),
        (np.zeros((2, 6)), None, [0], "2 postures need 2 targets"),
    ],
)
def test_arguments_are_checked(make_model, q, x, target, message):
    model = make_model()
    for use in (model.predict, model.jacobian):
        with pytest.raises(InputError, match=message):
            use(q, x, None if target is None else np.array(target))
