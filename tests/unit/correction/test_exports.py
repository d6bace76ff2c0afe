"""The identified arm in other forms: each describes the same arm, read by nothing of ours."""

import re

import numpy as np
import pytest
import yaml

from calib import CalibrationModel, Robot
from calib.correction import corrected_robot
from calib.errors import InputError
from calib.model.measurements import TouchUp
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint, ZeroOffsets
from calib.robots import preset_names
from calib.se3 import rotation_from_wpr
from posedesign.files.csv_tables import read_rows
from posedesign.pose_programs.correction import mastering
from posedesign.pose_programs.exports import EXPORTS, find_exports, zeroing_words
from tests.arms import DESCRIPTIONS, robot_of

TABLES = ["dh", "dh-modified", "dh-hayati"]


def model_of(robot: Robot) -> CalibrationModel:
    blocks = [
        ZeroOffsets(robot, robot.joint_names),
        LinkGeometry(robot),
        ToolPoint([0.0, 0.0, 0.1]),
        TargetPoints([[1.0, 0.0, 0.5]]),
    ]
    return CalibrationModel(robot, blocks, TouchUp(1e-5))


def identified(name: str) -> Robot:
    model = model_of(Robot.preset(name))
    change = 2e-3 * np.random.default_rng(0).uniform(-1, 1, model.p)
    return corrected_robot(model, model.nominal + change).robot


def turned(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return T


def shifted(axis: str, distance: float) -> np.ndarray:
    T = np.eye(4)
    T["xyz".index(axis), 3] = distance
    return T


def placed(text: str, what: str) -> np.ndarray:
    """The transform that a line of a table has in words."""
    found = re.search(rf"# {what}.*x y z = (.*) mm. w p r = (.*) deg", text)
    assert found
    T = np.eye(4)
    T[:3, 3] = np.array(found[1].split(), dtype=float) / 1e3
    T[:3, :3] = rotation_from_wpr(np.deg2rad(np.array(found[2].split(), dtype=float)))
    return T


@pytest.mark.parametrize("form", TABLES)
@pytest.mark.parametrize("name", ["r2000ic165f", "irb120", "panda", "ur5e", "gp7"])
def test_a_table_as_it_stands_in_its_file_is_the_arm(name, form, tmp_path):
    robot = identified(name)
    path = tmp_path / EXPORTS[form].file
    path.write_text(EXPORTS[form].text(robot, ["said before"]))
    text = path.read_text()
    assert "# said before" in text
    rows = [
        {k: v if k == "joint" else float(v) for k, v in row.cells.items()}
        for row in read_rows(path)[1]
    ]
    assert [row["joint"] for row in rows] == list(robot.joint_names)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (20, robot.n))
    for posture, T_base_tip in zip(q, robot.fk(q), strict=True):
        T = placed(text, "base")
        for value, row in zip(posture, rows, strict=True):
            theta, alpha, beta = (
                np.deg2rad(row[f"{key}_deg"]) for key in ("theta", "alpha", "beta")
            )
            joint = turned("z", value + theta) @ shifted("z", row["d_mm"] / 1e3)
            link = shifted("x", row["a_mm"] / 1e3) @ turned("x", alpha) @ turned("y", beta)
            T = T @ (link @ joint if form == "dh-modified" else joint @ link)
        np.testing.assert_allclose(T @ placed(text, "tool"), T_base_tip, atol=1e-9)


LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def read_kinematics(robot: Robot) -> dict[str, list[float]]:
    content = yaml.safe_load(EXPORTS["ur-kinematics"].text(robot, ["said: before"]))["kinematics"]
    assert list(content) == [*LINKS, "hash"]
    assert re.fullmatch(r"posedesign_[0-9a-f]{16}", content["hash"])
    names = ["x", "y", "z", "roll", "pitch", "yaw"]
    assert all(list(content[link]) == names for link in LINKS)
    return {link: list(content[link].values()) for link in LINKS}


def test_kinematics_of_a_ur_as_described_are_those_of_ur_description():
    """``config/ur5e/default_kinematics.yaml``."""
    half = np.pi / 2
    expected = {
        "shoulder": [0, 0, 0.1625, 0, 0, 0],
        "upper_arm": [0, 0, 0, half, 0, 0],
        "forearm": [-0.425, 0, 0, 0, 0, 0],
        "wrist_1": [-0.3922, 0, 0.1333, 0, 0, 0],
        "wrist_2": [0, -0.0997, 0, half, 0, 0],
        "wrist_3": [0, 0.0996, 0, half, np.pi, np.pi],
    }
    for link, values in read_kinematics(Robot.preset("ur5e")).items():
        np.testing.assert_allclose(values[:3], expected[link][:3], atol=1e-9)
        R, wanted = (rotation_from_wpr(np.array(v[3:])) for v in (values, expected[link]))
        np.testing.assert_allclose(R, wanted, atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e", "ur10e"])
def test_kinematics_of_a_ur_are_the_identified_arm(name):
    """As ``ur_macro.xacro`` puts it together: half a turn below the shoulder, joints about z."""
    robot = identified(name)
    origins = read_kinematics(robot)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (20, 6))
    for posture, T_base_tip in zip(q, robot.fk(q), strict=True):
        T = turned("z", np.pi)
        for link, value in zip(LINKS, posture, strict=True):
            x, y, z, roll, pitch, yaw = origins[link]
            turn = turned("z", yaw) @ turned("y", pitch) @ turned("x", roll)
            place = shifted("x", x) @ shifted("y", y) @ shifted("z", z)
            T = T @ place @ turn @ turned("z", value)
        np.testing.assert_allclose(T, T_base_tip, atol=1e-9)


@pytest.mark.parametrize("name", ["r2000ic165f", "panda", "irb120"])
def test_kinematics_of_other_arms_are_refused(name):
    with pytest.raises(InputError, match="is no arm of Universal Robots"):
        EXPORTS["ur-kinematics"].text(Robot.preset(name), [])


def test_forms_are_found_by_name_and_once():
    assert [form.file for form in find_exports(["dh", "dh-hayati", "dh"])] == [
        "corrected_dh.csv",
        "corrected_dh_hayati.csv",
    ]
    with pytest.raises(InputError, match="unknown form 'dh-hyati'") as caught:
        find_exports(["dh-hyati"])
    assert "dh-hayati" in caught.value.hint


@pytest.mark.parametrize("name", [*preset_names(), *DESCRIPTIONS])
def test_zeros_that_are_set_as_it_is_said_make_the_pendant_show_where_the_arm_is(name):
    """A controller that shows motor counts off a zero of its own; the words are followed."""
    robot = robot_of(name) if name in DESCRIPTIONS else Robot.preset(name)
    controller, words = robot.controller, zeroing_words(robot)
    if controller.maker == "ur":
        assert "take no zeros by the user" in words
        return
    model, rng = model_of(robot), np.random.default_rng(0)
    x = model.nominal.copy()
    offsets = rng.uniform(-0.01, 0.01, robot.n)
    for joint, offset in zip(robot.joint_names, offsets, strict=True):
        x[model.names.index(f"zero_offset.{joint}")] = offset
    rows = mastering(model, x).rows()
    asked = np.array([row["shown_at_zero_deg"] for row in rows])
    # a KUKA takes its mastering position for the values of $MAMES, the others for zero
    mames = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
    reference = mames if controller.maker == "kuka" else np.zeros(robot.n)
    assert ("plus its shown_at_zero_deg" in words) == (controller.maker == "kuka")
    assert "shown_at_zero_deg" in words
    jogged = reference + asked  # what the pendant shows when the zeros are set
    true = rng.uniform(-1, 1, (20, robot.n))  # where the joints really are [rad]
    before = controller.pendant(true - offsets)
    after = before - jogged + reference
    np.testing.assert_allclose(after, controller.pendant(true), atol=1e-9)
