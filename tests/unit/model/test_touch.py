"""The simulated touch-up: the tool point on the target, the orientation held."""

import numpy as np
import pytest

from calib import CalibrationModel
from calib.model import Setup, touch
from calib.model.measurements import TouchUp
from calib.model.parameters import JointCompliance, TargetPoints, ToolPoint, ZeroOffsets
from calib.model.simulation import TOUCH_TOLERANCE_M


@pytest.fixture(scope="module")
def model(make_model, reference_robot):
    return make_model(targets=2, extra=(JointCompliance(reference_robot, ["joint_2", "joint_3"]),))


def errors(model, count: int, seed: int = 0) -> np.ndarray:
    size = {"rad": 3e-3, "m": 3e-3, "rad/Nm": 3e-7}
    rng = np.random.default_rng(seed)
    scale = np.array([size[unit] for unit in model.units])
    return model.nominal + scale * rng.uniform(-1, 1, (count, model.p))


TARGET = Setup.of(5, target=[0, 1, 0, 0, 1])


def test_the_tool_point_meets_the_target_and_the_controller_holds_its_angles(model, touching):
    q, x = touching(5), errors(model, 4)
    found, missing = touch(model, q, x, TARGET)
    assert found.shape == (4, 5, 6)
    assert missing.shape == (4, 5)
    assert missing.max() < TOUCH_TOLERANCE_M
    for trial in range(4):  # the error of each posture, by the model and anew
        rows = model.predict(found[trial], x[trial], TARGET)
        np.testing.assert_allclose(rows, 0.0, atol=1e-12)
    nominal = model.robot.fk(found)[..., :3, :3]
    held = model.robot.fk(q)[:, :3, :3]
    np.testing.assert_allclose(nominal, np.broadcast_to(held, nominal.shape), atol=3e-12)


def test_where_the_arm_should_stop_beside_the_target(model, touching):
    q, x = touching(5), errors(model, 1)[0]
    beside = np.random.default_rng(1).uniform(-1e-3, 1e-3, (7, 5, 3))
    found, missing = touch(model, q, x, TARGET, beside)
    assert found.shape == (7, 5, 6)
    assert missing.max() < TOUCH_TOLERANCE_M
    np.testing.assert_allclose(model.predict(found, x, TARGET), beside, atol=1e-12)


def test_nothing_moves_where_there_is_no_error(model, touching):
    q = touching(5)
    found, missing = touch(model, q, model.nominal)
    np.testing.assert_allclose(found, q, atol=1e-9)
    assert missing.max() < TOUCH_TOLERANCE_M


def test_a_free_orientation_gives_the_smallest_motion(model, touching):
    q, x = touching(5), errors(model, 1)[0]
    held, _ = touch(model, q, x)
    free, missing = touch(model, q, x, hold_orientation=False)
    assert missing.max() < TOUCH_TOLERANCE_M
    motion = free - q
    assert (np.linalg.norm(motion, axis=1) < np.linalg.norm(held - q, axis=1)).all()
    # the motion of least norm has no part that leaves the tool point where it is
    view = model.view((free + q) / 2, x)
    moved = np.empty((6, 3, 5))
    for joint in range(6):
        view.turn_about(view.axis(joint), view.walk.origins[joint], moved[joint])
    J = moved.transpose(2, 1, 0)
    idle = motion - (np.linalg.pinv(J) @ (J @ motion[..., None]))[..., 0]
    assert (np.linalg.norm(idle, axis=1) < 0.02 * np.linalg.norm(motion, axis=1)).all()


def test_a_redundant_arm(seven_axis_robot):
    robot = seven_axis_robot
    q = np.array([0.1, 0.4, -0.2, -1.8, 0.3, 1.9, 0.5]) + np.linspace(-0.2, 0.2, 4)[:, None]
    tool = np.array([0.05, 0.02, 0.1])
    place = robot.fk(q)[0, :3, :3] @ tool + robot.fk(q)[0, :3, 3]
    model = CalibrationModel(
        robot,
        [ZeroOffsets(robot, ["j2", "j4"]), ToolPoint(tool), TargetPoints(place)],
        TouchUp(1e-5),
    )
    x = model.nominal + 2e-3
    found, missing = touch(model, q, x)
    assert missing.max() < TOUCH_TOLERANCE_M
    np.testing.assert_allclose(model.predict(found, x), 0.0, atol=1e-12)
    np.testing.assert_allclose(robot.fk(found)[:, :3, :3], robot.fk(q)[:, :3, :3], atol=3e-12)


def test_what_is_out_of_reach_says_how_far_it_stays_off(model, touching):
    x = model.nominal.copy()
    x[-6:-3] = [9.0, 0.0, 0.5]
    _, missing = touch(model, touching(3), x)
    assert (missing > 5.0).all()
    assert (missing < 9.0).all()
