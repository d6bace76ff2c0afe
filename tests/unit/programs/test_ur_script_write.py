"""URScript: the writer, and that what it writes is valid and read back equal."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import transform
from posedesign.programs import Arm, Load, PoseProgram, ProgramOptions, ProgramPose, postures_of
from posedesign.programs.ur_script import UrScript

ARM = Arm.of(Robot.preset("ur5e"))
T_USER = transform(np.diag([-1.0, 1.0, -1.0]), [0.5, -0.25, 0.1])
T_TOOL = transform(np.eye(3), [0.0, 0.05, 0.1])
DIALECT = UrScript()
PATH = Path("x.script")

POSES = (
    ProgramPose("T 1", np.radians([0, -75, 100, -115, -90, 0])),
    ProgramPose("over", np.radians([10, -75, 100, -115, -90, 0]), via=True),
    ProgramPose('a "name"', np.radians([-180, -75, 100, -115, -90, 363]), "mind the cable"),
)
OPTIONS = ProgramOptions(
    speed_percent=25,
    settle_s=0.3,
    measure_output=5,
    comment="cell 7",
    fingerprint="abcdef12",
)

EXPECTED = """\
def Calpose():
  # Title: cell 7
  # PLAN abcdef12 2 1 362f5872
  def MEASURE(number):
    textmsg("measuring ", number)
    freedrive_mode()
    while not request_boolean_from_primary_client("Is the tool at its target?"):
      sync()
    end
    end_freedrive_mode()
    sleep(0.300)
  end
  set_tcp(p[0.0000000, 0.0500000, 0.1000000, 0.0000000, 0.0000000, 0.0000000])
  textmsg("PROGRAM Calpose PLAN abcdef12 2")
  # POSE 1 T 1
  movej([0.0000000, -1.3089969, 1.7453293, -2.0071286, -1.5707963, 0.0000000], a=1.4, v=0.7854)
  sleep(0.300)
  set_standard_digital_out(5, True)
  sleep(0.500)
  set_standard_digital_out(5, False)
  MEASURE(1)
  textmsg("POSE 1 q=", get_actual_joint_positions())
  # POSE 3 over
  movej([0.1745329, -1.3089969, 1.7453293, -2.0071286, -1.5707963, 0.0000000], a=1.4, v=0.7854)
  # POSE 2
  textmsg("mind the cable")
  movej([-3.1415927, -1.3089969, 1.7453293, -2.0071286, -1.5707963, 6.3355452], a=1.4, v=0.7854)
  sleep(0.300)
  set_standard_digital_out(5, True)
  sleep(0.500)
  set_standard_digital_out(5, False)
  MEASURE(2)
  textmsg("POSE 2 q=", get_actual_joint_positions())
end
Calpose()
"""


def text_of(program: PoseProgram, arm: Arm = ARM) -> str:
    (text,) = DIALECT.render(program, arm).values()
    return text


def one_pose(**options: object) -> PoseProgram:
    return PoseProgram("Calpose", POSES[:1], ProgramOptions(**options))  # type: ignore[arg-type]


def lines_of(program: PoseProgram) -> list[str]:
    return [line.strip() for line in text_of(program).splitlines()]


def test_a_whole_script(tmp_path: Path) -> None:
    arm = replace(ARM, T_tip_tool=T_TOOL)
    (path,) = DIALECT.write(PoseProgram("Calpose", POSES, OPTIONS, arm), tmp_path)
    assert path == tmp_path / "Calpose.script"
    assert path.read_text() == EXPECTED
    assert DIALECT.validate(path) == []
    back = DIALECT.read(path)
    assert (back.name, back.comment, back.maker) == ("Calpose", "cell 7", "ur")
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    assert [(p.number, p.name) for p in back.positions] == [(1, "T 1"), (3, "over"), (2, "")]
    assert [p.number for p in back.measured] == [1, 2]
    assert "movej([-3.14" in EXPECTED.splitlines()[back.positions[2].line - 1]
    np.testing.assert_allclose(back.postures(arm)[1], POSES[1].posture_rad, atol=6e-8)


def test_poses_of_the_tool_say_which_arm_position_is_meant() -> None:
    arm = replace(ARM, T_tip_tool=T_TOOL)
    program = PoseProgram("Calpose", POSES, replace(OPTIONS, form="cartesian"))
    moves = [line.strip() for line in text_of(program, arm).splitlines() if "movej" in line]
    assert [move[: move.index("[")] for move in moves] == ["movej(get_inverse_kin(p"] * 3
    joints = re.findall(r"movej\((\[.*?\])", EXPECTED)
    assert [re.findall(r"qnear=(\[.*?\])", move)[0] for move in moves] == joints
    # in the base frame, which is turned by half a turn against base_link
    expected = np.diag([-1.0, -1.0, 1.0]) @ arm.robot.fk(POSES[0].posture_rad)[:3, :3]  # type: ignore[union-attr]
    back = DIALECT.parse(text_of(program, arm).encode(), PATH)
    assert back.positions[0].T_user_tool is not None
    np.testing.assert_allclose(back.positions[0].T_user_tool[:3, :3], expected, atol=1e-6)


def test_a_user_frame_is_written_by_value() -> None:
    arm = replace(ARM, T_world_user=T_USER)
    program = PoseProgram("Calpose", POSES, replace(OPTIONS, form="cartesian"))
    text = text_of(program, arm)
    assert (
        "user_frame = p[0.5000000, -0.2500000, 0.1000000, 0.0000000, 3.1415927, 0.0000000]" in text
    )
    assert text.count("pose_trans(user_frame, p[") == 3
    assert DIALECT.check(text.encode(), PATH) == []
    back = DIALECT.parse(text.encode(), PATH)
    expected = arm.tool_poses(program.postures_rad)
    for position, pose in zip(back.positions, expected, strict=True):
        np.testing.assert_allclose(position.T_user_tool, pose, atol=2e-7)
    assert "user_frame" not in text_of(PoseProgram("Calpose", POSES, OPTIONS), arm)


def test_poses_are_those_of_another_library() -> None:
    robomath = pytest.importorskip("robodk.robomath", reason="compares with RoboDK's conventions")
    rng = np.random.default_rng(1)
    poses = tuple(ProgramPose(f"P{i}", rng.uniform(-2, 2, 6)) for i in range(20))
    program = PoseProgram("Calpose", poses, ProgramOptions(form="cartesian"))
    rows = re.findall(r"get_inverse_kin\(p\[(.*?)\]", text_of(program))
    for row, pose in zip(rows, ARM.tool_poses(program.postures_rad), strict=True):
        values = [float(v) for v in row.split(",")]
        theirs = np.array(robomath.UR_2_Pose([1e3 * v for v in values[:3]] + values[3:]).Rows())
        np.testing.assert_allclose(theirs[:3, :3], pose[:3, :3], atol=3e-7)
        np.testing.assert_allclose(theirs[:3, 3], pose[:3, 3] * 1e3, atol=1e-4)


def test_no_settling_no_call_and_no_argument() -> None:
    lines = lines_of(one_pose(settle_s=0, measure_call=None))
    assert not [line for line in lines if line.startswith(("sleep", "def MEASURE", "MEASURE"))]
    assert lines[-4].startswith("movej(")
    assert lines[-3:] == ['textmsg("POSE 1 q=", get_actual_joint_positions())', "end", "Calpose()"]
    lines = lines_of(one_pose(measure_call="probe", measure_argument=None))
    assert "def probe():" in lines
    assert "probe()" in lines
    assert "probe(-7)" in lines_of(one_pose(measure_call="probe", measure_argument=-7))
    assert "sleep(0.001)" in lines_of(one_pose(settle_s=1e-9))


def test_the_speed_is_a_share_of_that_of_the_slowest_joint() -> None:
    robot = ARM.robot
    assert robot is not None
    slow = replace(robot, speed=np.array([1.0, 2.0, np.nan, 4.0, 5.0, 6.0]))
    assert "v=0.1000)" in text_of(one_pose(), replace(ARM, robot=slow))
    assert "v=0.3142)" in text_of(one_pose(), Arm.usual("ur"))
    assert "v=0.0001)" in text_of(
        one_pose(speed_percent=1), replace(ARM, robot=replace(slow, speed=np.full(6, 1e-9)))
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"measure_output": 8}, "measure_output is 8"),
        ({"settle_s": 1e5}, "settle_s is 1"),
        ({"comment": 'say "go"'}, "cannot stand in a comment"),
        ({"comment": "back\\slash"}, "cannot stand in a comment"),
        ({"comment": "two\nlines"}, "cannot stand in a comment"),
        ({"comment": "Stra\u00dfe"}, "cannot stand in a comment"),
        ({"comment": "x" * 81}, "cannot stand in a comment"),
        ({"measure_call": "my measure"}, "is not a URScript name"),
        ({"measure_call": "7up"}, "is not a URScript name"),
        ({"measure_call": "while"}, "is not a URScript name"),
        ({"measure_call": "sleep"}, "is not a URScript name"),
        ({"measure_call": "Calpose"}, "would call itself"),
        ({"measure_call": "CALPOSE"}, "would call itself"),
    ],
)
def test_what_urscript_would_refuse(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        text_of(one_pose(**options))
    assert caught.value.hint


@pytest.mark.parametrize("comment", ['"', "\u00e9", "a\nb", "POSE 7", "PROGRAM x", "PLAN 12345"])
def test_remarks_that_cannot_stand_in_a_script(comment: str) -> None:
    pose = replace(POSES[0], comment=comment)
    with pytest.raises(InputError, match="comment of pose 'T 1'"):
        text_of(PoseProgram("Calpose", (pose,), OPTIONS))


@pytest.mark.parametrize("name", ["cal pose", "7CAL", "", "cal-1", "end", "movej", "x" * 33])
def test_names_of_programs(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="is not a URScript name"):
        DIALECT.write(PoseProgram(name, POSES, OPTIONS), tmp_path)


@pytest.mark.parametrize("angle", [363.1, -364, 721])
def test_a_joint_beyond_its_limits(angle: float) -> None:
    far = (ProgramPose("far", np.radians([0, 0, 0, 0, 0, angle])),)
    for form in ("joint", "cartesian"):
        with pytest.raises(InputError, match="pose 'far': J6 is"):
            text_of(PoseProgram("Calpose", far, replace(OPTIONS, form=form)))


def test_no_minus_zero_and_no_exponent() -> None:
    tiny = (ProgramPose("", -np.full(6, 1e-9)),)
    for form in ("joint", "cartesian"):
        text = text_of(PoseProgram("Calpose", tiny, replace(OPTIONS, form=form)))
        assert not re.search(r"-0(\.0*)?(?![\d.])|\de-", text)


def test_the_payload_is_that_of_the_load() -> None:
    assert "set_payload" not in text_of(one_pose())
    text = text_of(one_pose(), replace(ARM, load=Load(2.5, np.array([0.0, -0.01, 0.06]))))
    lines = [line.strip() for line in text.splitlines()]
    k = lines.index("set_payload(2.5000, [0.000000, -0.010000, 0.060000])")
    assert lines[k - 1].startswith("set_tcp(")
    assert DIALECT.check(text.encode(), PATH) == []


@pytest.mark.parametrize(
    "load", [Load(-1.0, np.zeros(3)), Load(np.nan, np.zeros(3)), Load(1.0, np.array([0, 0, 60.0]))]
)
def test_loads_that_no_arm_carries(load: Load) -> None:
    with pytest.raises(InputError, match="of the load is"):
        text_of(one_pose(), replace(ARM, load=load))


def test_poses_are_read_in_the_frames_of_the_script() -> None:
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_TOOL)
    program = PoseProgram("Calpose", POSES[:2], replace(OPTIONS, form="cartesian"))
    # without numbers: joints beside a pose then only say which arm position is near
    text = re.sub(r"  # POSE.*\n", "", text_of(program, arm))
    back = DIALECT.parse(text.encode(), PATH)
    for position in back.positions:
        assert position.shown_deg is None
        np.testing.assert_allclose(position.T_world_user, T_USER, atol=2e-7)
        np.testing.assert_allclose(position.T_tip_tool, T_TOOL, atol=2e-7)
    # whatever the cell's own tool and user frame: the arm is where the script moves it
    elsewhere = replace(ARM, T_tip_tool=transform(np.eye(3), [0.0, 0.0, 0.3]))
    found = postures_of(back.positions, elsewhere, program.postures_rad)
    np.testing.assert_allclose(found, program.postures_rad, atol=2e-6)


seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=40, deadline=None)
@given(seed=seeds, form=st.sampled_from(["joint", "cartesian"]), count=st.integers(1, 12))
def test_what_is_written_is_valid_and_read_back(seed: int, form: str, count: int) -> None:
    rng = np.random.default_rng(seed)
    robot = ARM.robot
    assert robot is not None
    postures = rng.uniform(robot.lower, robot.upper, (count, 6))
    poses = tuple(
        ProgramPose(f"T{i}", q, via=bool(rng.random() < 0.3)) for i, q in enumerate(postures)
    )
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_TOOL) if rng.random() < 0.5 else ARM
    program = PoseProgram("Calpose", poses, replace(OPTIONS, form=form))
    data = text_of(program, arm).encode("ascii")
    assert DIALECT.check(data, PATH) == []
    back = DIALECT.parse(data, PATH)
    assert tuple(p.number for p in back.positions) == program.numbers
    np.testing.assert_allclose(back.postures(arm), program.postures_rad, atol=0.6e-7)
    if form == "cartesian":
        for position, pose in zip(back.positions, arm.tool_poses(postures), strict=True):
            np.testing.assert_allclose(position.T_user_tool, pose, atol=3e-7)
