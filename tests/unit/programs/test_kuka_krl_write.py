"""KUKA KRL: what is written, word by word, and read back again."""

from __future__ import annotations

import importlib
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import transform
from posedesign.cell import Cell
from posedesign.pose_programs import import_touch_ups
from posedesign.programs import (
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
    read,
    validate,
    write,
)
from posedesign.programs.kuka_krl import KukaKrl
from posedesign.programs.kuka_krl.writer import render_kuka_krl

AT_FULL_REACH = 5e-5
"""Determinant of the Jacobian below which the controller's rounding can put a pose out of reach."""

KR6 = Robot.preset("kr6r900sixx")
TOOL = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.01, -0.02, 0.15])
USER = transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.1, -0.05])
ARM = Arm.of(KR6, USER, TOOL)

POSES = (
    ProgramPose("T1", np.radians([10.0, -90.0, 90.0, -0.000001, 15.5, -30.0])),
    ProgramPose("way", np.radians([20.0, -80.0, 70.0, 5.0, 25.123456, 0.0]), via=True),
    ProgramPose("Ö", np.radians([-10.0, -70.0, 60.0, -5.0, 35.0, 130.0]), comment="mind the jig"),
)
JOINT = PoseProgram(
    "CalPose",
    POSES,
    ProgramOptions(
        fingerprint="00c0ffee",
        comment="after service",
        measure_output=7,
        keep="register",
        first_register=11,
        user_frame=3,
        tool_frame=2,
        speed_percent=20,
        settle_s=1.5,
    ),
)

JOINT_DAT = """\
&ACCESS RVP
&REL 1
&COMMENT after service
DEFDAT CalPose
;PLAN 00c0ffee 2 2 2c916bae
;TOOL 2 BASE 3
EXT BAS(BAS_COMMAND :IN,REAL :IN)
DECL PDAT PPDAT1={VEL 20.0,ACC 100.0,APO_DIST 100.0,GEAR_JERK 50.0,EXAX_IGN 0}
;P1 T1
DECL E6AXIS XP1={A1 10.00000,A2 -90.00000,A3 90.00000,A4 0.00000,A5 15.50000,A6 -30.00000}
DECL FDAT FP1={TOOL_NO 2,BASE_NO 3,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL E6AXIS XP2={A1 -10.00000,A2 -70.00000,A3 60.00000,A4 -5.00000,A5 35.00000,A6 130.00000}
DECL FDAT FP2={TOOL_NO 2,BASE_NO 3,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
;P3 way
DECL E6AXIS XP3={A1 20.00000,A2 -80.00000,A3 70.00000,A4 5.00000,A5 25.12346,A6 0.00000}
DECL FDAT FP3={TOOL_NO 2,BASE_NO 3,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
;XM[11] IS P1
DECL E6AXIS XM[12]
ENDDAT
"""
JOINT_SRC = """\
&ACCESS RVP
&REL 1
&COMMENT after service
DEF CalPose( )
;PLAN 00c0ffee 2 2 2c916bae
BAS(#INITMOV,0)
BAS(#VEL_PTP,20)
BAS(#TOOL,2)
BAS(#BASE,3)
;P1 T1
;FOLD PTP P1 Vel=20 % PDAT1 Tool[2] Base[3];%{PE}%R 8.3.42,%MKUKATPBASIS,%CMOVE,%VPTP,%P \
1:PTP, 2:P1, 3:, 5:20, 7:PDAT1
$BWDSTART=FALSE
PDAT_ACT=PPDAT1
FDAT_ACT=FP1
BAS(#PTP_PARAMS,20)
PTP XP1
;ENDFOLD
WAIT SEC 1.50
PULSE($OUT[7],TRUE,0.50)
MEASURE(1)
XM[11]=$AXIS_ACT
;P3 way
;FOLD PTP P3 Vel=20 % PDAT1 Tool[2] Base[3];%{PE}%R 8.3.42,%MKUKATPBASIS,%CMOVE,%VPTP,%P \
1:PTP, 2:P3, 3:, 5:20, 7:PDAT1
$BWDSTART=FALSE
PDAT_ACT=PPDAT1
FDAT_ACT=FP3
BAS(#PTP_PARAMS,20)
PTP XP3
;ENDFOLD
;mind the jig
;FOLD PTP P2 Vel=20 % PDAT1 Tool[2] Base[3];%{PE}%R 8.3.42,%MKUKATPBASIS,%CMOVE,%VPTP,%P \
1:PTP, 2:P2, 3:, 5:20, 7:PDAT1
$BWDSTART=FALSE
PDAT_ACT=PPDAT1
FDAT_ACT=FP2
BAS(#PTP_PARAMS,20)
PTP XP2
;ENDFOLD
WAIT SEC 1.50
PULSE($OUT[7],TRUE,0.50)
MEASURE(2)
XM[12]=$AXIS_ACT
END
"""


def test_a_joint_program_word_by_word(tmp_path: Path) -> None:
    files = write(JOINT, "kuka-krl", tmp_path)
    assert [file.name for file in files] == ["CalPose.dat", "CalPose.src"]
    assert files[0].read_bytes() == JOINT_DAT.replace("\n", "\r\n").encode("ascii")
    assert files[1].read_bytes() == JOINT_SRC.replace("\n", "\r\n").encode("ascii")


def test_a_cartesian_program_word_by_word() -> None:
    # stretched forearm level: at (0, -90, 90, 0, 0, 0) the flange of the KR 6 R900 is at x = 25 +
    # 420 + 80, z = 400 + 455 + 35 mm, and looks along x
    pose = ProgramPose("T1", np.radians([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]))
    options = ProgramOptions(form="cartesian", measure_argument=None, settle_s=0)
    arm = Arm.of(KR6, transform(np.eye(3), [0.5, 0, 0]), transform(np.eye(3), [0, 0, 0.1]))
    dat, src = render_kuka_krl(PoseProgram("CAL", (pose,), options), arm)
    assert dat == (
        "&ACCESS RVP\n&REL 1\nDEFDAT CAL\n;TOOL 1 BASE 0\nEXT BAS(BAS_COMMAND :IN,REAL :IN)\n"
        ";P1 T1\nDECL E6POS XP1={X 125.0000,Y 0.0000,Z 890.0000,A 0.00000,B 90.00000,C 0.00000,"
        "S 2,T 2}\nENDDAT\n"
    )
    assert src == (
        "&ACCESS RVP\n&REL 1\nDEF CAL( )\nBAS(#INITMOV,0)\nBAS(#VEL_PTP,10)\nBAS(#TOOL,1)\n"
        "BAS(#BASE,0)\n$TOOL={X 0.0000,Y 0.0000,Z 100.0000,A 0.00000,B 0.00000,C 0.00000}\n"
        "$BASE={X 500.0000,Y 0.0000,Z 0.0000,A 0.00000,B 0.00000,C 0.00000}\n"
        ";P1 T1\nPTP XP1\nWAIT SEC 0\nMEASURE( )\nEND\n"
    )


def random_program(seed: int, **options: Any) -> PoseProgram:
    """A plan over the whole range of the joints, some of its stops passed."""
    rng = np.random.default_rng(seed)
    postures = rng.uniform(KR6.lower, KR6.upper, (int(rng.integers(1, 12)), KR6.n)) * 0.99
    via = rng.random(len(postures)) < 0.2
    poses = [
        ProgramPose(f"T{i}", q, via=v) for i, (q, v) in enumerate(zip(postures, via, strict=True))
    ]
    return PoseProgram("CALIB01", tuple(poses), ProgramOptions(fingerprint="abcdef12", **options))


def by_number(program: PoseProgram) -> np.ndarray:
    """Postures in the order of their numbers, as they stand in the ``.dat``."""
    return program.postures_rad[np.argsort(program.numbers)]


def check_round_trip(seed: int, form: str, folder: Path) -> None:
    program = replace(random_program(seed, form=form, keep="register"), arm=ARM)
    dat, src = write(program, "kuka-krl", folder)
    assert validate(dat) == []
    assert validate(src) == []
    found = read(dat)
    assert [p.number for p in found.positions] == sorted(program.numbers)
    assert len(found.measured) == found.mark.measured == program.measured_count
    names = [
        pose.name
        for _, pose in sorted(zip(program.numbers, program.poses, strict=True), key=lambda e: e[0])
    ]
    assert [p.name for p in found.positions] == names
    expected = by_number(program)
    if form == "joint":
        shown = np.stack([p.shown_deg for p in found.positions if p.shown_deg is not None])
        np.testing.assert_allclose(shown, ARM.shown(expected), rtol=0, atol=5.001e-6)
        np.testing.assert_allclose(found.postures(ARM), expected, rtol=0, atol=1e-7)
        return
    poses = np.stack([p.T_user_tool for p in found.positions if p.T_user_tool is not None])
    wanted = ARM.tool_poses(expected)
    np.testing.assert_allclose(poses[:, :3, 3], wanted[:, :3, 3], rtol=0, atol=5.001e-8)
    # three angles of 0.000005 deg
    np.testing.assert_allclose(poses[:, :3, :3], wanted[:, :3, :3], rtol=0, atol=2.7e-7)
    words = [p.configuration for p in found.positions]
    assert words == ARM.configurations(expected)
    size = np.abs(np.linalg.det(KR6.jacobian(expected)))
    assume(size.min() > AT_FULL_REACH)
    regular = size > 1e-3
    postures = found.postures(ARM)
    np.testing.assert_allclose(postures[regular], expected[regular], rtol=0, atol=2e-4)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["joint", "cartesian"]))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, seed: int, form: str) -> None:
    check_round_trip(seed, form, tmp_path_factory.mktemp("krl"))


@pytest.mark.slow
@settings(max_examples=1000, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["joint", "cartesian"]))
def test_round_trip_long(tmp_path_factory: pytest.TempPathFactory, seed: int, form: str) -> None:
    check_round_trip(seed, form, tmp_path_factory.mktemp("krl"))


def test_angles_are_those_of_another_library() -> None:
    robomath = pytest.importorskip("robodk.robomath", reason="compares with RoboDK's conventions")
    program = random_program(3, form="cartesian")
    dat, _ = render_kuka_krl(program, ARM)
    for line, posture in zip(re.findall(r"XP\d+=\{(.*),S", dat), by_number(program), strict=True):
        values = [float(field.split()[1]) for field in line.split(",")]
        T = np.array(robomath.KUKA_2_Pose(values).Rows())
        T[:3, 3] /= 1e3
        np.testing.assert_allclose(T, ARM.tool_poses(posture), rtol=0, atol=3e-7)


@pytest.mark.parametrize("b", [90.0, -90.0])
def test_at_the_gimbal_the_matrix_is_kept(b: float) -> None:
    # A5 turns the tool up and down: B = +-90 deg at the end of a level arm
    program = PoseProgram(
        "CAL",
        (ProgramPose("T", np.radians([30.0, -90.0, 90.0, 0.0, 90.0 - b, 20.0])),),
        ProgramOptions(form="cartesian"),
    )
    arm = Arm.of(KR6)
    dat, _ = render_kuka_krl(program, arm)
    (position,) = KukaKrl().parse(dat.encode(), Path("CAL.dat")).positions
    assert position.T_user_tool is not None
    np.testing.assert_allclose(
        position.T_user_tool, arm.tool_poses(program.postures_rad)[0], rtol=0, atol=3e-7
    )


def test_numbers_are_plain() -> None:
    tiny = np.array([1e-9, -1e-9, 0.0, -0.0, 1e-7, -1e-7])
    for form in ("joint", "cartesian"):
        options = ProgramOptions(form=form)
        program = PoseProgram("CAL", (ProgramPose("T", tiny),), options)
        for text in render_kuka_krl(program, Arm.of(KR6)):
            assert not re.search(r"-0\.?0*(?![\d.])|\de|nan|inf", text.replace("service", ""))


def test_lines_are_short(tmp_path: Path) -> None:
    far = np.radians([-170.0, -100.123456, -100.123456, -180.123456, -100.123456, -300.123456])
    poses = tuple(ProgramPose("N" * 80, far, comment="C" * 80) for _ in range(3))
    for form in ("joint", "cartesian"):
        options = ProgramOptions(
            form=form,
            first_register=32000,
            keep="register",
            comment="T" * 80,
            measure_call="M" * 24,
            fingerprint="0123456789abcdef",
        )
        program = PoseProgram("N" * 24, poses, options, ARM, first=99_997)
        for file in write(program, "kuka-krl", tmp_path):
            lines = [line for line in file.read_text().splitlines() if line[:5] != ";FOLD"]
            assert max(map(len, lines)) < 120
            assert validate(file) == []


def test_names_that_no_comment_holds_are_left_out() -> None:
    poses = [ProgramPose(name, np.zeros(6)) for name in ("Ö", "a\nb", "", "x" * 81, "FOLD; a")]
    dat, src = render_kuka_krl(PoseProgram("CAL", tuple(poses)), Arm.usual("kuka"))
    assert [line for line in dat.splitlines() if line.startswith(";P")] == [";P5 FOLD; a"]
    assert KukaKrl().check(src.encode(), Path("/nowhere/CAL.src")) != []
    found = KukaKrl().parse(dat.encode(), Path("CAL.dat"))
    assert [p.name for p in found.positions] == ["", "", "", "", "FOLD; a"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"comment": "für"}, "comment"),
        ({"comment": "a\nEND"}, "comment"),
        ({"comment": "x" * 81}, "comment"),
        ({"comment": "endfold"}, "comment"),
        ({"measure_call": "my prog"}, "is not a KUKA program name"),
        ({"measure_call": "M" * 25}, "is not a KUKA program name"),
        ({"measure_call": "ptp"}, "is not a KUKA program name"),
        ({"measure_call": "Xp3"}, "is the name of a position"),
        ({"measure_call": "fp12"}, "is the name of a position"),
        ({"measure_call": "cal"}, "would call itself"),
        ({"tool_frame": 17}, "tool_frame is 17"),
        ({"user_frame": -1}, "user_frame is -1"),
        ({"settle_s": 1e6}, "settle_s"),
        ({"measure_output": 1, "measure_pulse_s": 3.1}, "measure_pulse_s"),
    ],
)
def test_options_that_no_controller_takes(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    program = PoseProgram("CAL", POSES[:1], ProgramOptions(**changes))
    with pytest.raises(InputError, match=message) as caught:
        write(program, "kuka-krl", tmp_path)
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["1CAL", "MY CAL", "C" * 25, "", "end", "E6Pos", "xm", "XP1", "Ä"])
def test_names_that_no_controller_takes(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write(PoseProgram(name, POSES[:1]), "kuka-krl", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_bad_comment_names_its_pose(tmp_path: Path) -> None:
    poses = (ProgramPose("T9", np.zeros(6), comment='say "é"'),)
    with pytest.raises(InputError, match="comment of pose 'T9'"):
        write(PoseProgram("CAL", poses), "kuka-krl", tmp_path)


def test_a_joint_beyond_all_arms_names_its_pose(tmp_path: Path) -> None:
    poses = (POSES[0], ProgramPose("T9", np.array([0, 0, 0, 13.0, 0, 0])))
    for form in ("joint", "cartesian"):
        program = PoseProgram("CAL", poses, ProgramOptions(form=form), ARM)
        with pytest.raises(InputError, match="pose 'T9': J4 is beyond"):
            write(program, "kuka-krl", tmp_path)


def test_cartesian_needs_the_robot(tmp_path: Path) -> None:
    program = PoseProgram("CAL", POSES, ProgramOptions(form="cartesian"))
    with pytest.raises(InputError, match="need the robot"):
        write(program, "kuka-krl", tmp_path)


def test_nothing_is_called_or_waited_for_where_nothing_is_asked() -> None:
    options = ProgramOptions(measure_call=None, settle_s=0.001)
    _, src = render_kuka_krl(PoseProgram("CAL", POSES, options), Arm.usual("kuka"))
    assert "MEASURE" not in src
    assert "PULSE" not in src
    assert src.count("WAIT SEC 0.01\n") == 2  # a wait that is asked for does not round to none


def parse_with(folder: str) -> Any:
    """Function that tells the syntax errors of a text by a parser generated from a grammar."""
    sys.path.insert(0, folder)
    antlr4 = pytest.importorskip("antlr4", reason="runs the parser of the grammar")
    listener: Any = importlib.import_module("antlr4.error.ErrorListener").ErrorListener
    lexer_of = importlib.import_module("krlLexer").krlLexer
    parser_of = importlib.import_module("krlParser").krlParser

    def errors(text: str) -> list[str]:
        found: list[str] = []

        class Listener(listener):  # type: ignore[misc]
            def syntaxError(self, *what: Any) -> None:
                found.append(str(what[2:5]))

        lexer = lexer_of(antlr4.InputStream(text))
        parser = parser_of(antlr4.CommonTokenStream(lexer))
        for machine in (lexer, parser):
            machine.removeErrorListeners()
            machine.addErrorListener(Listener())
        parser.module()
        return found

    return errors


@pytest.mark.skipif(
    "POSEDESIGN_KRL_PARSER" not in os.environ,
    reason="POSEDESIGN_KRL_PARSER names no folder with a parser generated from the KRL grammar",
)
def test_a_parser_of_the_public_grammar_takes_what_is_written() -> None:
    errors = parse_with(os.environ["POSEDESIGN_KRL_PARSER"])
    for seed in range(4):
        for form in ("joint", "cartesian"):
            for keep in ("joint", "register"):
                keeping = {"keep": "register", "measure_output": 4} if keep == "register" else {}
                program = random_program(seed, form=form, **keeping)
                for text in render_kuka_krl(program, ARM):
                    assert errors(text.replace("\n", "\r\n")) == []
    assert errors(JOINT_DAT.replace(",A3", " A3"))
    assert errors(JOINT_SRC.replace("WAIT SEC", "WAIT SEK"))


def touched_up(dat: str) -> RecordedProgram:
    return KukaKrl().parse(dat.encode("ascii"), Path("CalPose.dat"))


def test_planned_positions_are_no_touch_ups(reference_cell: Cell, tmp_path: Path) -> None:
    path = tmp_path / "CalPose.dat"
    path.write_text(JOINT_DAT)
    for keep in (False, True):
        with pytest.raises(InputError, match="no register holds a touched-up position"):
            import_touch_ups(reference_cell, [path], keep_untouched=keep)


def test_a_position_that_the_pendant_touched_up_is_read_with_its_frames() -> None:
    pose = "E6POS XP1={X 525.0,Y -10.0,Z 890.25,A 10.5,B -12.0,C 178.5,S 2,T 35}"
    planned = re.search(r"E6AXIS XP1=.*", JOINT_DAT)
    assert planned is not None
    first, second, _ = touched_up(JOINT_DAT.replace(planned[0], pose)).positions
    assert (first.shown_deg, first.tool_frame, first.user_frame) == (None, 2, 3)
    assert second.shown_deg is not None


def test_touched_up_positions_stand_in_the_place_of_the_planned_ones() -> None:
    planned = touched_up(JOINT_DAT)
    assert [p.number for p in planned.positions] == [1, 2, 3]
    assert planned.empty_registers
    measured = (
        "XM[12]={A1 -10.5,A2 -70.5,A3 60.5,A4 -5.5,A5 35.5,A6 130.5,E1 0.0,E2 0.0,E3 0.0,"
        "E4 0.0,E5 0.0,E6 0.0}\nENDDAT"
    )
    program = touched_up(JOINT_DAT.replace("ENDDAT", measured))
    assert not program.empty_registers
    # pose 1 is not measured yet: its planned position is no measurement
    assert [(p.number, p.name) for p in program.positions] == [(2, ""), (3, "way")]
    assert [p.number for p in program.measured] == [2]
    np.testing.assert_allclose(
        np.asarray(program.positions[0].shown_deg), [-10.5, -70.5, 60.5, -5.5, 35.5, 130.5]
    )
