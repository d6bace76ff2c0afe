"""Data and models that do not belong together are refused in one line."""

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import CalibError, InputError
from calib.identification import check_enough, identify_batch
from calib.model import Setup
from calib.model.measurements import Distance, Measurements, Point, Pose, TouchUp, touch_ups
from calib.model.parameters import JointCompliance, Payload, TargetFrame, ToolFrame, ZeroOffsets

JOINTS = ["joint_2", "joint_3", "joint_4", "joint_5"]


@pytest.fixture
def pose_model(reference_robot) -> CalibrationModel:
    blocks = [ZeroOffsets(reference_robot, JOINTS), ToolFrame(np.eye(4)), TargetFrame(np.eye(4))]
    return CalibrationModel(reference_robot, blocks, Pose(1e-5))


def data_of(count: int, observed=None, setup=None, **labels) -> Measurements:
    q = np.random.default_rng(0).uniform(-1, 1, (count, 6))
    how = Setup.of(count) if setup is None else setup
    return Measurements(q, how, **{"targets": ("tracker",), **labels}, observed=observed)


def assert_refused(model, data, message) -> InputError:
    """By identify, by identify_batch and by the check alone."""
    with pytest.raises(InputError, match=message) as caught:
        identify(model, data)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=message):
        identify_batch(model, data.repeated(2))
    with pytest.raises(InputError, match=message):
        check_enough(model, data)
    return caught.value


def test_fewer_equations_than_parameters(pose_model):
    """Six equations a pose, and the hint says how many poses that takes."""
    error = assert_refused(
        pose_model,
        data_of(2, np.zeros((2, 6))),
        "2 measurements give 12 equations for 16 parameters",
    )
    assert "at least 3 poses" in error.hint
    assert (error.value, error.bound) == (12, 16)


def test_a_mixture_counts_the_equations_of_each_kind(pose_model):
    model = pose_model.with_measurements([Pose(1e-5), Distance(1e-5)])
    setup = Setup.of(8, kind=[0, 1, 1, 1, 1, 1, 1, 1])
    assert_refused(
        model, data_of(8, np.zeros((8, 6)), setup), "8 measurements give 13 equations for 16"
    )


def test_no_measurements_at_all(pose_model):
    assert_refused(
        pose_model, data_of(0, np.zeros((0, 6))), "0 measurements give 0 equations for 16"
    )


def test_readings_that_are_not_there(pose_model):
    assert_refused(pose_model, data_of(8), "there are no readings of the kind pose")
    model = pose_model.with_measurements([TouchUp(1e-5), Distance(1e-5)])
    setup = Setup.of(20, kind=np.arange(20) % 2)
    assert_refused(model, data_of(20, None, setup), "there are no readings of the kind distance")


@pytest.mark.parametrize("columns", [3, 7])
def test_readings_of_another_shape(pose_model, columns):
    assert_refused(
        pose_model,
        data_of(8, np.zeros((8, columns))),
        f"readings have {columns} columns, the model 6 rows",
    )


def test_labels_that_the_model_does_not_have(pose_model):
    read = np.zeros((8, 6))
    assert_refused(
        pose_model,
        data_of(8, read, targets=("T1",)),
        "the measurements name the targets T1, the model tracker",
    )
    assert_refused(
        pose_model,
        data_of(8, read, tools=("gripper",)),
        "the measurements name the tools gripper, the model tool",
    )


def test_a_kind_that_the_model_does_not_have(pose_model):
    setup = Setup.of(8, kind=[0, 1] * 4)
    assert_refused(pose_model, data_of(8, np.zeros((8, 6)), setup), "kind of measurement 2 of a")


def test_a_payload_that_the_model_does_not_have(pose_model, reference_robot):
    load = Payload(100.0, np.zeros(3))
    blocks = [JointCompliance(reference_robot, ["joint_2"], load), *pose_model.parameters]
    model = pose_model.with_parameters(blocks)
    setup = Setup.of(8, payload=[0, 1] * 4)
    with pytest.raises(InputError, match="a measurement has payload 2, 1 are known"):
        identify(model, data_of(8, np.zeros((8, 6)), setup))


def test_an_arm_of_another_number_of_joints(pose_model):
    data = Measurements(
        np.zeros((8, 7)), Setup.of(8), targets=("tracker",), observed=np.zeros((8, 6))
    )
    with pytest.raises(InputError, match="has 6 joints, the posture has 7 values"):
        identify(pose_model, data)


def test_many_sets_are_not_one(pose_model):
    data = data_of(8, np.zeros((8, 6))).repeated(3)
    with pytest.raises(InputError, match=r"shape \(3, 8, 6\): more than one set .*identify_batch"):
        identify(pose_model, data)


def test_one_set_is_not_many(pose_model):
    with pytest.raises(InputError, match=r"shape \(8, 6\): one set .*identify takes one"):
        identify_batch(pose_model, data_of(8, np.zeros((8, 6))))


def test_readings_of_a_wrong_unit_are_refused(reference_robot):
    """Millimetres for metres."""
    blocks = [ZeroOffsets(reference_robot, JOINTS), ToolFrame(np.eye(4), free=["x", "y", "z"])]
    model = CalibrationModel(reference_robot, [*blocks, TargetFrame(np.eye(4))], Point(1e-5))
    q = np.random.default_rng(1).uniform(-1, 1, (12, 6))
    read = 1e3 * model.predict(q, model.nominal + 0.01)
    data = Measurements(q, Setup.of(12), targets=("tracker",), observed=read)
    with pytest.raises(CalibError) as caught:
        identify(model, data)
    assert "\n" not in str(caught.value)


def test_touch_ups_of_one_posture_repeated(make_model, touching):
    q = np.repeat(touching(1), 12, axis=0)
    with pytest.raises(CalibError) as caught:
        identify(make_model(), touch_ups(q))
    assert "\n" not in str(caught.value)
