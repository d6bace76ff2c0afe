"""Yaskawa jobs: the writer, and that what it writes is valid and read back equal."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import transform
from posedesign.programs import Arm, PoseProgram, ProgramOptions, ProgramPose, postures_of
from posedesign.programs.yaskawa_jbi import YaskawaJbi

PULSES = (1638.4, -1706.6667, 1425.27, 1365.333, -910.2222, 568.889)
T_USER = transform(np.diag([-1.0, 1.0, -1.0]), [0.5, -0.25, 0.1])
ARM = Arm.of(Robot.preset("gp7"))
DIALECT = YaskawaJbi()

POSES = (
    ProgramPose("T 1", np.radians([0, 15, -25, 0, -50, 0])),
    ProgramPose("over", np.radians([10, 0, 0, 0, 0, 0]), via=True),
    ProgramPose("a name that is far too long", np.radians([-180, 0, 0, 0.5, -0.5, 360]), "cable!"),
)
OPTIONS = ProgramOptions(
    tool_frame=3,
    speed_percent=25,
    settle_s=0.3,
    measure_output=5,
    comment="cell 7",
    fingerprint="abcdef12",
    pulses_per_deg=PULSES,
    written=datetime(2026, 3, 4, 5, 6, 7),
)

EXPECTED = """\
/JOB
//NAME CALPOSE
//POS
///NPOS 3,0,0,0,0,0
///TOOL 3
///POSTYPE PULSE
///PULSE
C00000=0,-25600,-35632,0,45511,0
C00001=16384,0,0,0,0,0
C00002=-294912,0,0,683,455,204800
//INST
///DATE 2026/03/04 05:06
///COMM cell 7
///ATTR SC,RW
///GROUP1 RB1
NOP
'PLAN abcdef12 2 1 5326e08d
'PULSES S 1638.4
'PULSES L -1706.6667
'PULSES U 1425.27
'PULSES R 1365.333
'PULSES B -910.2222
'PULSES T 568.889
'POSE 1 T 1
MOVJ C00000 VJ=25.00 PL=0
TIMER T=0.30
PULSE OT#(5) T=0.50
SET I000 1
CALL JOB:MEASURE
'POSE 3 over
MOVJ C00001 VJ=25.00 PL=0
'POSE 2
'cable!
MOVJ C00002 VJ=25.00 PL=0
TIMER T=0.30
PULSE OT#(5) T=0.50
SET I000 2
CALL JOB:MEASURE
END
"""


def text_of(program: PoseProgram, arm: Arm = ARM) -> str:
    (text,) = DIALECT.render(program, arm).values()
    return text


def one_pose(**options: object) -> PoseProgram:
    chosen = {"pulses_per_deg": PULSES, **options}
    return PoseProgram("CALPOSE", POSES[:1], ProgramOptions(**chosen))  # type: ignore[arg-type]


def steps(program: PoseProgram) -> list[str]:
    return text_of(program).split("'PULSES T 568.889\n")[1].splitlines()


def test_a_whole_job(tmp_path: Path) -> None:
    (path,) = DIALECT.write(PoseProgram("CALPOSE", POSES, OPTIONS), tmp_path)
    assert path == tmp_path / "CALPOSE.JBI"
    assert path.read_bytes() == EXPECTED.replace("\n", "\r\n").encode("ascii")
    assert DIALECT.validate(path) == []
    back = DIALECT.read(path)
    assert (back.name, back.comment, back.maker) == ("CALPOSE", "cell 7", "yaskawa")
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    assert [(p.number, p.name) for p in back.positions] == [(1, "T 1"), (3, "over"), (2, "")]
    assert [p.number for p in back.measured] == [1, 2]
    assert [(p.tool_frame, p.user_frame) for p in back.positions] == [(3, None)] * 3
    assert EXPECTED.splitlines()[back.positions[2].line - 1].startswith("C00002=")
    assert back.positions[0].shown_deg is not None
    np.testing.assert_allclose(
        back.positions[0].shown_deg, np.array([0, -25600, -35632, 0, 45511, 0]) / PULSES
    )


def test_poses_of_the_tool(tmp_path: Path) -> None:
    options = replace(OPTIONS, form="cartesian", user_frame=4, pulses_per_deg=())
    arm = replace(ARM, T_world_user=T_USER)
    (path,) = DIALECT.write(PoseProgram("CALPOSE", POSES[:2], options, arm), tmp_path)
    text = path.read_text()
    head, instructions = text.split("//INST\n")
    assert head.splitlines()[:8] == [
        "/JOB",
        "//NAME CALPOSE",
        "//POS",
        "///NPOS 2,0,0,0,0,0",
        "///USER 4",
        "///TOOL 3",
        "///POSTYPE USER",
        "///RECTAN",
    ]
    assert instructions.splitlines()[2:5] == [
        "///ATTR SC,RW,RJ",
        "////FRAME USER 4",
        "///GROUP1 RB1",
    ]
    assert "PULSES" not in text
    assert DIALECT.validate(path) == []
    back = DIALECT.read(path)
    assert [(p.user_frame, p.tool_frame) for p in back.positions] == [(4, 3)] * 2
    expected = arm.tool_poses([pose.posture_rad for pose in POSES[:2]])
    for position, pose in zip(back.positions, expected, strict=True):
        np.testing.assert_allclose(position.T_user_tool, pose, atol=2e-6)


def test_angles_are_those_of_another_library(tmp_path: Path) -> None:
    robomath = pytest.importorskip("robodk.robomath", reason="compares with RoboDK's conventions")
    rng = np.random.default_rng(1)
    poses = tuple(ProgramPose(f"P{i}", rng.uniform(-1, 1, 6)) for i in range(20))
    program = PoseProgram("CALPOSE", poses, ProgramOptions(form="cartesian"))
    rows = re.findall(r"C\d{5}=(.*)", text_of(program))
    for row, pose in zip(rows, ARM.tool_poses(program.postures_rad), strict=True):
        theirs = np.array(robomath.Motoman_2_Pose([float(v) for v in row.split(",")]).Rows())
        np.testing.assert_allclose(theirs[:3, :3], pose[:3, :3], atol=2e-6)
        np.testing.assert_allclose(theirs[:3, 3], pose[:3, 3] * 1e3, atol=6e-4)


def test_a_new_arm_position_is_said_once() -> None:
    q = np.array([[0.1, 0.2, 0.1, 0, -1, 0], [0.2, 0.2, 0.1, 0, -1, 0], [0.1, 0.2, 0.1, 3, 1, 0]])
    poses = tuple(ProgramPose("", row) for row in q)
    text = text_of(PoseProgram("CALPOSE", poses, ProgramOptions(form="cartesian")))
    kinds = re.findall(r"^(///RCONF|C\d{5}=)", text, re.MULTILINE)
    assert kinds == ["///RCONF", "C00000=", "C00001=", "///RCONF", "C00002="]


def test_no_settling_no_call_and_no_argument() -> None:
    move = "MOVJ C00000 VJ=10.00 PL=0"
    assert steps(one_pose(settle_s=0, measure_call=None)) == ["'POSE 1 T 1", move, "END"]
    assert steps(one_pose(settle_s=0, measure_argument=None)) == [
        "'POSE 1 T 1",
        move,
        "CALL JOB:MEASURE",
        "END",
    ]
    assert "SET I000 -7" in steps(one_pose(measure_argument=-7))
    assert "TIMER T=0.01" in steps(one_pose(settle_s=0.001))


def test_the_touched_up_position_in_a_variable() -> None:
    lines = steps(one_pose(keep="register", first_register=12))
    assert lines[-3:] == ["CALL JOB:MEASURE", "GETS PX012 $PX000", "END"]
    with pytest.raises(InputError, match="variable P128"):
        text_of(one_pose(keep="register", first_register=128))


def test_pulses_of_the_dialect_are_taken_where_the_program_has_none() -> None:
    program = one_pose(pulses_per_deg=())
    (text,) = YaskawaJbi(PULSES).render(program, ARM).values()
    assert text == text_of(one_pose())


@pytest.mark.parametrize(
    ("pulses", "message"),
    [
        ((), "has 0 values"),
        (PULSES[:5], "has 5 values"),
        ((*PULSES[:5], 0.0), "of T is 0"),
        ((*PULSES[:5], 2e6), "of T is 2"),
        ((float("nan"), *PULSES[1:]), "of S is nan"),
    ],
)
def test_pulses_that_are_missing_are_asked_for(pulses: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        text_of(one_pose(pulses_per_deg=pulses))
    assert "S L U R B T in pulses/deg" in caught.value.hint
    assert "ALL.PRM" in caught.value.hint
    if pulses:
        with pytest.raises(InputError, match=message):
            YaskawaJbi(pulses)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tool_frame": 64}, "tool_frame is 64"),
        ({"user_frame": -1}, "user_frame is -1"),
        ({"settle_s": 655.36}, "settle_s is 655.36"),
        ({"measure_output": 1, "measure_pulse_s": 0.0}, "measure_pulse_s is 0"),
        ({"comment": "x" * 33}, "cannot stand in a comment"),
        ({"comment": "Stra\u00dfe"}, "cannot stand in a comment"),
        ({"comment": "two\nlines"}, "cannot stand in a comment"),
        ({"measure_call": "MEASURE_1"}, "is not a Yaskawa job name"),
        ({"measure_call": "measure"}, "is not a Yaskawa job name"),
        ({"measure_call": "CALPOSE"}, "would call itself"),
    ],
)
def test_what_the_controller_would_refuse(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        text_of(one_pose(**options))
    assert caught.value.hint


@pytest.mark.parametrize(
    "comment", ["x" * 33, "\u00e9", "a\nb", "POSE 7", "PULSES S 1", "PLAN 12345"]
)
def test_remarks_that_cannot_stand_in_a_job(comment: str) -> None:
    pose = replace(POSES[0], comment=comment)
    with pytest.raises(InputError, match="comment of pose 'T 1'"):
        text_of(PoseProgram("CALPOSE", (pose,), OPTIONS))


@pytest.mark.parametrize("name", ["cal", "7CAL", "CAL POSE", "CALPOSES1", "", "CAL-1"])
def test_names_of_jobs(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="is not a Yaskawa job name"):
        DIALECT.write(PoseProgram(name, POSES, OPTIONS), tmp_path)


def test_a_joint_beyond_two_turns_and_a_user_frame_without_number() -> None:
    far = (ProgramPose("far", np.radians([0, 0, 0, 0, 0, 721])),)
    for form in ("joint", "cartesian"):
        with pytest.raises(InputError, match="pose 'far': J6 is beyond"):
            text_of(PoseProgram("CALPOSE", far, replace(OPTIONS, form=form)))
    with pytest.raises(InputError, match="need its number"):
        text_of(one_pose(form="cartesian"), replace(ARM, T_world_user=T_USER))


def test_no_minus_zero() -> None:
    tiny = (ProgramPose("", -np.full(6, 1e-9)),)
    for form in ("joint", "cartesian"):
        text = text_of(PoseProgram("CALPOSE", tiny, replace(OPTIONS, form=form)))
        assert not re.search(r"[=,]-0(\.0*)?(?![\d.])", text)


def test_a_long_program_is_split(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    poses = tuple(
        ProgramPose(f"T{i}", q, via=i % 3 == 1) for i, q in enumerate(rng.uniform(-1, 1, (900, 6)))
    )
    paths = DIALECT.write(PoseProgram("CALPOSE", poses, OPTIONS), tmp_path)
    assert [p.name for p in paths] == [f"CALOSE_{k}.JBI" for k in (1, 2, 3, 4)]
    measured = []
    for path in paths:
        assert DIALECT.validate(path) == []
        assert len(path.read_text().split("NOP\n")[1].splitlines()) + 1 <= 2000
        back = DIALECT.read(path)
        assert back.mark.measured == 600
        measured += [p.number for p in back.measured]
    assert measured == list(range(1, 601))


def random_program(seed: int, form: str, count: int) -> tuple[PoseProgram, Arm]:
    rng = np.random.default_rng(seed)
    robot = ARM.robot
    assert robot is not None
    postures = rng.uniform(robot.lower, robot.upper, (count, 6))
    poses = tuple(ProgramPose(f"T{i}", q, via=i % 3 == 1) for i, q in enumerate(postures))
    options = replace(OPTIONS, form=form, user_frame=2)
    T_tip_tool = transform(np.eye(3), rng.uniform(-0.2, 0.2, 3))
    arm = replace(ARM, T_world_user=T_USER, T_tip_tool=T_tip_tool)
    return PoseProgram("CALPOSE", poses, options), arm


def test_pulses_are_rounded_by_half_of_one() -> None:
    program, arm = random_program(1, "joint", 50)
    back = DIALECT.parse(text_of(program, arm).encode(), Path("X.JBI"))
    error = np.degrees(back.postures(arm) - program.postures_rad)
    assert (np.abs(error) <= 0.5 / np.abs(PULSES) + 1e-6).all()


def test_poses_lead_back_to_the_postures() -> None:
    program, arm = random_program(5, "cartesian", 30)
    back = DIALECT.parse(text_of(program, arm).encode(), Path("X.JBI"))
    found = postures_of(back.positions, arm, near=program.postures_rad)
    # rounding of 0.0005 mm and 0.00005 deg, made larger where the arm is nearly stretched
    np.testing.assert_allclose(found, program.postures_rad, atol=2e-4)
