"""Points on a rigid body of the tool."""

from __future__ import annotations

import numpy as np
import pytest

from calib import CalibrationModel, Robot, identify
from calib.errors import InputError
from calib.model.measurements import Measurement, Measurements, Point, Pose, Setup, TouchUp
from calib.model.measurements.simulate import simulate
from calib.model.parameters import TargetFrame, ToolBody, ToolFrame, ToolPoints, ZeroOffsets
from calib.se3 import rotation_exp, transform

ROBOT = Robot.preset("ur5e")
PLACES = np.array([[0.1, 0.0, 0.0], [0.0, 0.12, 0.02], [-0.05, -0.06, 0.03]])
LABELS = ("P", "Q", "R")
T_BODY = transform(rotation_exp(np.array([0.4, -1.0, 0.7])), [0.02, 0.05, 0.1])
T_TARGET = transform(rotation_exp(np.array([0.1, 0.2, 2.0])), [0.8, -0.3, 0.2])
X = np.array([0.01, -0.02, 0.03, 0.3, -0.2, 0.1])


def test_distances_stay_and_the_pose_is_that_of_a_frame() -> None:
    q = np.random.default_rng(0).uniform(-2, 2, (3, ROBOT.n))
    setup = Setup.of(3, tool=[0, 1, 2])
    body = CalibrationModel(
        ROBOT, [ToolBody(PLACES, LABELS, T_BODY), TargetFrame(T_TARGET, free=())], Point(1e-4)
    )
    frame = CalibrationModel(ROBOT, [ToolFrame(T_BODY), TargetFrame(T_TARGET, free=())], Pose(1e-4))
    x = body.nominal + X
    assert frame.nominal == pytest.approx(body.nominal)
    view = frame.view(q, x)
    turned = np.moveaxis(view.tool, -1, 0).swapaxes(1, 2)  # R_base_body of each posture
    expected = view.tool_points + np.einsum("nij,nj->ni", turned, PLACES)
    np.testing.assert_allclose(body.view(q, x, setup).tool_points, expected, atol=1e-12)


@pytest.mark.parametrize("kind", [Point(1e-4), Pose(1e-4), TouchUp([1e-4, 2e-4, 3e-4])])
@pytest.mark.parametrize("trials", [0, 2])
def test_jacobian_is_the_derivative_of_the_rows(kind: Measurement, trials: int) -> None:
    rng = np.random.default_rng(1)
    other = ToolPoints([[0.3, 0.1, 0.2]], ["other"])
    blocks = [ToolBody(PLACES, LABELS, T_BODY), other, TargetFrame(T_TARGET)]
    model = CalibrationModel(ROBOT, blocks, kind)
    setup = Setup.of(6, tool=[0, 1, 2, 3, 1, 0])
    batch = (trials,) if trials else ()
    q = rng.uniform(-2, 2, (*batch, 6, ROBOT.n))
    x = model.nominal + rng.uniform(-0.3, 0.3, (*batch, model.p))
    read = model.predict(q, x, setup) + rng.uniform(-0.1, 0.1, (*batch, 6, model.rows))
    read = read if kind.reads else np.zeros_like(read)
    found = model.linearise(q, x, setup, read)
    for k, step in enumerate(1e-6 * np.eye(model.p)):
        ahead, behind = (model.linearise(q, x + s, setup, read) for s in (step, -step))
        numeric = (ahead.rows - behind.rows) / 2e-6
        np.testing.assert_allclose(found.jacobian[..., k], numeric, atol=1e-8)
        white = (ahead.white_rows - behind.white_rows) / 2e-6
        np.testing.assert_allclose(found.white_jacobian[..., k], white, atol=1e-4)


@pytest.mark.parametrize("kind", [Point(1e-5), Pose(1e-5)])
def test_it_is_found_from_readings(kind: Measurement) -> None:
    """Also where a pose is read: the start is then that of the nominal body."""
    rng = np.random.default_rng(2)
    count = 20
    q = np.repeat(rng.uniform(-2, 2, (count, ROBOT.n)), 3, axis=0)
    setup = Setup.of(3 * count, tool=np.tile([0, 1, 2], count))
    blocks = [
        ZeroOffsets(ROBOT, ROBOT.joint_names[1:5]),
        ToolBody(PLACES, LABELS, T_BODY),
        TargetFrame(T_TARGET),
    ]
    truth = CalibrationModel(ROBOT, blocks, kind)
    x = truth.nominal + rng.normal(0.0, 0.01, truth.p)
    read = simulate(truth, x, q, None, setup=setup)
    data = Measurements(q, setup, truth.targets, truth.tools, read.observed)
    result = identify(truth, data)
    np.testing.assert_allclose(result.values, x, atol=1e-9)
    assert result.names[4:10] == tuple(f"tool.body.{a}" for a in ("x", "y", "z", "rx", "ry", "rz"))


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match="each point of the body needs three finite numbers"):
        ToolBody(PLACES[:, :2], LABELS)
    with pytest.raises(InputError, match="two tools have the same name"):
        ToolBody(PLACES, ("P", "Q", "P"))
    with pytest.raises(InputError, match="a prior of -1 cannot be used"):
        ToolBody(PLACES, LABELS, prior_m=-1.0)
