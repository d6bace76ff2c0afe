"""Touch-ups whose noise is along the axes of a camera that is turned on the tool."""

from __future__ import annotations

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.errors import InputError
from calib.model.measurements import TouchUp
from calib.model.measurements.simulate import simulate
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.se3 import rotation_from_wpr

SIGMA = np.array([1e-5, 2e-5, 9e-5])
R_TIP_CAMERA = rotation_from_wpr(np.deg2rad([20.0, -35.0, 80.0]))
TRIALS = 4000


def model(measurement: TouchUp) -> CalibrationModel:
    robot = Robot.preset("r2000ic165f")
    q = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
    target = robot.state(q).point(np.array([0.2, -0.05, 0.35]))
    tool = ToolPoint([0.2, -0.05, 0.35])
    return CalibrationModel(
        robot, [ZeroOffsets(robot, ["joint_2"]), tool, TargetPoints([target])], measurement
    )


def test_simulated_noise_has_the_axes_of_the_camera() -> None:
    truth = model(TouchUp(SIGMA, R_TIP_CAMERA))
    q = np.deg2rad([[0.0, 15.0, -25.0, 0.0, -50.0, 0.0]])
    done = simulate(truth, truth.nominal, q, np.random.default_rng(1), trials=TRIALS).postures[:, 0]
    robot = truth.robot
    state = robot.state(done)
    off = state.point(np.array([0.2, -0.05, 0.35])) - robot.state(q[0]).point(
        np.array([0.2, -0.05, 0.35])
    )
    in_camera = off @ state.R_base_tip[0] @ R_TIP_CAMERA
    # the standard deviation of a standard deviation is 1 / sqrt(2 trials); four of them
    np.testing.assert_allclose(in_camera.std(axis=0), SIGMA, rtol=4 / np.sqrt(2 * TRIALS))
    assert np.abs(np.corrcoef(in_camera.T) - np.eye(3)).max() < 4 / np.sqrt(TRIALS)


def test_whitening_is_that_of_the_covariance() -> None:
    """White Jacobians give JᵀC⁻¹J with the covariance turned into base axes, where it touches."""
    given = model(TouchUp(SIGMA, R_TIP_CAMERA))
    q = np.deg2rad([[10.0, 15.0, -25.0, 20.0, -50.0, 30.0], [-5.0, 20.0, -30.0, -20.0, -40.0, 0.0]])
    q = simulate(given, given.nominal, q).postures
    linear = given.linearise(q)
    R = given.robot.fk(q)[:, :3, :3] @ R_TIP_CAMERA
    C = R @ np.diag(SIGMA**2) @ np.swapaxes(R, 1, 2)
    J, white = linear.jacobian, linear.white_jacobian
    expected = np.einsum("kip,kij,kjr->kpr", J, np.linalg.inv(C), J)
    got = np.einsum("kip,kir->kpr", white, white)
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def test_axes_that_are_no_rotation() -> None:
    with pytest.raises(InputError, match="axes"):
        TouchUp(SIGMA, np.diag([1.0, 1.0, -1.0]))
