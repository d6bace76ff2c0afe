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


ALONE = [Pose(1e-5)]
FOR_EACH = [Pose(1e-5), Distance(1e-5)]
EIGHT = np.zeros((8, 6))


@pytest.mark.parametrize(
    ("kinds", "data", "message"),
    [
        (ALONE, data_of(2, EIGHT[:2]), "2 measurements give 12 equations for 16 parameters"),
        (
            FOR_EACH,
            data_of(8, EIGHT, Setup.of(8, kind=[0, *[1] * 7])),
            "8 measurements give 13 equations for 16",
        ),
        (ALONE, data_of(0, EIGHT[:0]), "0 measurements give 0 equations for 16"),
        (ALONE, data_of(8), "there are no readings of the kind pose"),
        (
            [TouchUp(1e-5), Distance(1e-5)],
            data_of(20, None, Setup.of(20, kind=np.arange(20) % 2)),
            "there are no readings of the kind distance",
        ),
        (ALONE, data_of(8, EIGHT[:, :3]), "readings have 3 columns, the model 6 rows"),
        (ALONE, data_of(8, np.zeros((8, 7))), "readings have 7 columns, the model 6 rows"),
        (ALONE, data_of(8, EIGHT, targets=("T1",)), "name the targets T1, the model tracker"),
        (ALONE, data_of(8, EIGHT, tools=("gripper",)), "name the tools gripper, the model tool"),
        (ALONE, data_of(8, EIGHT, Setup.of(8, kind=[0, 1] * 4)), "kind of measurement 2 of a"),
    ],
)
def test_data_that_do_not_belong_to_the_model(pose_model, kinds, data, message):
    """Refused by identify, by identify_batch and by the check alone."""
    model = pose_model.with_measurements(kinds)
    for refuse, given in (
        (identify, data),
        (identify_batch, data.repeated(2)),
        (check_enough, data),
    ):
        with pytest.raises(InputError, match=message) as caught:
            refuse(model, given)
        assert "\n" not in str(caught.value)
    if message.startswith("2 measurements"):  # six equations a pose
        assert "at least 3 poses" in caught.value.hint
        assert (caught.value.value, caught.value.bound) == (12, 16)


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
