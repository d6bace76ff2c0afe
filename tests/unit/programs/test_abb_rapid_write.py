"""ABB RAPID: what is written, word by word, and read back again."""

from __future__ import annotations

import re
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
from posedesign.programs import (
    Arm,
    Load,
    PoseProgram,
    Problem,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
    read,
    validate,
    write,
)
from posedesign.programs.abb_rapid import AbbRapid
from posedesign.programs.abb_rapid.writer import render_module

IRB120 = Robot.preset("irb120")
AT_FULL_REACH = 5e-5
"""Determinant of the Jacobian below which the controller's rounding can put a pose out of reach."""

TOOL = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.01, -0.02, 0.15])
USER = transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.1, -0.05])
ARM = Arm.of(IRB120, USER, TOOL)

POSES = (
    ProgramPose("T1", np.radians([10.0, -5.0, 20.0, -0.000001, 45.0, 30.0])),
    ProgramPose("way", np.radians([20.0, 10.0, 30.0, 5.0, 25.123456, 0.0]), via=True),
    ProgramPose("Ö", np.radians([-10.0, 20.0, 10.0, -5.0, 35.0, 130.0]), comment="mind the jig"),
)
JOINT = PoseProgram(
    "CalPose",
    POSES,
    ProgramOptions(
        fingerprint="00c0ffee",
        comment="after service",
        measure_output=7,
        keep="register",
        first_register=2,
        speed_percent=20,
        settle_s=1.5,
        measure_argument=-4,
    ),
)

JOINT_MODULE = r"""MODULE CalPose
  ! after service
  ! PLAN 00c0ffee 2 1 f4a15b5e
  ! P1 T1
  LOCAL CONST jointtarget jp1:=[[10.00000,-5.00000,20.00000,0.00000,45.00000,30.00000],[#]];
  LOCAL CONST jointtarget jp2:=[[-10.00000,20.00000,10.00000,-5.00000,35.00000,130.00000],[#]];
  ! P3 way
  LOCAL CONST jointtarget jp3:=[[20.00000,10.00000,30.00000,5.00000,25.12346,0.00000],[#]];
  ! jMeasured{2} IS P1
  LOCAL PERS jointtarget jMeasured{3}:=[
    [[#],[#]],
    [[#],[#]],
    [[#],[#]]];
  LOCAL CONST speeddata vCalib:=[1000,100,1000,200];
  ! * start it with PP to Routine CalPose_run
  PROC CalPose_run()
    ! P1 T1
    MoveAbsJ jp1\NoEOffs,vCalib,fine,tool0;
    WaitTime\InPos,1.50;
    PulseDO\PLength:=0.500,do7;
    MEASURE -4;
    jMeasured{2}:=CJointT();
    ! P3 way
    MoveAbsJ jp3\NoEOffs,vCalib,fine,tool0;
    ! mind the jig
    MoveAbsJ jp2\NoEOffs,vCalib,fine,tool0;
    WaitTime\InPos,1.50;
    PulseDO\PLength:=0.500,do7;
    MEASURE -4;
    jMeasured{3}:=CJointT();
  ENDPROC
ENDMODULE
""".replace("#", "9E9,9E9,9E9,9E9,9E9,9E9")


def problems(text: str) -> list[Problem]:
    found = AbbRapid().check(text.encode(), Path("CAL.mod"))
    return [problem for problem in found if problem.level != "note"]


def test_a_joint_program_word_by_word(tmp_path: Path) -> None:
    (file,) = write(JOINT, "abb-rapid", tmp_path)
    assert file.name == "CalPose.mod"
    assert file.read_bytes() == JOINT_MODULE.replace("\n", "\r\n").encode("ascii")


def test_a_cartesian_program_word_by_word() -> None:
    # at zero the flange of the IRB 120 is at x = 302 + 72, z = 290 + 270 + 70 mm, and looks along x
    pose = ProgramPose("T1", np.zeros(6))
    options = ProgramOptions(form="cartesian", measure_argument=None, settle_s=0)
    arm = Arm.of(IRB120, transform(np.eye(3), [0.3, 0, 0]), transform(np.eye(3), [0, 0, 0.1]))
    half = "0.707106781,0.000000000,0.707106781,0.000000000"
    one = "1.000000000,0.000000000,0.000000000,0.000000000"
    assert render_module(PoseProgram("CAL", (pose,), options), arm) == (
        "MODULE CAL\n"
        "  ! the load of tCalib is not known: set its mass and centre\n"
        f"  TASK PERS tooldata tCalib:=[TRUE,[[0.0000,0.0000,100.0000],[{one}]],"
        "[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        f'  TASK PERS wobjdata wCalib:=[FALSE,TRUE,"",[[300.0000,0.0000,0.0000],[{one}]],'
        "[[0,0,0],[1,0,0,0]]];\n"
        "  ! P1 T1\n"
        f"  LOCAL CONST robtarget p1:=[[174.0000,0.0000,630.0000],[{half}],[0,0,0,0],"
        "[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        "  LOCAL CONST speeddata vCalib:=[500,50,500,100];\n"
        "  ! * start it with PP to Routine CAL_run\n"
        "  PROC CAL_run()\n    ConfJ\\On;\n    ! P1 T1\n"
        "    MoveJ p1,vCalib,fine,tCalib\\WObj:=wCalib;\n    WaitTime\\InPos,0;\n    MEASURE;\n"
        "  ENDPROC\nENDMODULE\n"
    )


def test_frames_of_faceplate_and_world_have_their_own_names() -> None:
    text = render_module(
        PoseProgram("CAL", POSES, ProgramOptions(form="cartesian")), Arm.of(IRB120)
    )
    assert "tooldata" not in text
    assert "wobjdata" not in text
    assert text.count("fine,tool0\\WObj:=wobj0;") == 3


LOADED = Arm.of(IRB120, USER, TOOL, Load(2.3456, np.array([0.01, -0.0021, 0.05])))


def test_the_tool_of_a_joint_program_is_no_made_up_one() -> None:
    text = render_module(PoseProgram("CAL", POSES), ARM)
    assert "tooldata" not in text  # MoveAbsJ knows no tool frame, and the load is not known
    assert "wobjdata" not in text  # nor a work object
    assert text.count("fine,tool0;") == 3


@pytest.mark.parametrize("form", ["joint", "cartesian"])
def test_the_tool_has_the_load_of_the_arm(form: Any) -> None:
    program = PoseProgram("CAL", POSES, ProgramOptions(form=form))
    text = render_module(program, LOADED)
    tool = re.search(r"PERS tooldata tCalib:=(.*);", text)
    assert tool
    assert tool[1].startswith("[TRUE,[[10.0000,-20.0000,150.0000],[0.707106781,")
    assert tool[1].endswith(",[2.346,[10.00,-2.10,50.00],[1,0,0,0],0,0,0]]")
    assert "not known" not in text
    assert text.count("fine,tCalib") == 3
    assert problems(text) == []
    # at the faceplate, too: tool0 carries nothing
    assert "fine,tCalib" in render_module(program, replace(LOADED, T_tip_tool=np.eye(4)))
    nothing = render_module(program, replace(LOADED, load=Load(0.0, np.zeros(3))))
    assert ("tool0" in nothing) == (form == "joint")
    assert ("[0.001,[0,0,0.001]," in nothing) == (form == "cartesian")
    assert problems(nothing) == []


def random_program(seed: int, **options: Any) -> PoseProgram:
    """A plan over the whole range of the joints, some of its stops passed."""
    rng = np.random.default_rng(seed)
    postures = rng.uniform(IRB120.lower, IRB120.upper, (int(rng.integers(1, 12)), 6)) * 0.99
    via = rng.random(len(postures)) < 0.2
    stops = enumerate(zip(postures, via, strict=True))
    poses = tuple(ProgramPose(f"T{i}", q, via=bool(v)) for i, (q, v) in stops)
    return PoseProgram("CALIB01", poses, ProgramOptions(fingerprint="abcdef12", **options))


def by_number(program: PoseProgram) -> np.ndarray:
    """Postures in the order of their numbers, as they are declared."""
    return program.postures_rad[np.argsort(program.numbers)]


def check_round_trip(seed: int, form: str, folder: Path) -> None:
    program = replace(random_program(seed, form=form, keep="register"), arm=ARM)
    (file,) = write(program, "abb-rapid", folder)
    assert validate(file) == []
    found = read(file)
    assert [p.number for p in found.positions] == sorted(program.numbers)
    assert len(found.measured) == found.mark.measured == program.measured_count
    order = np.argsort(program.numbers)
    assert [p.name for p in found.positions] == [program.poses[i].name for i in order]
    expected = by_number(program)
    if form == "joint":
        shown = np.stack([p.shown_deg for p in found.positions if p.shown_deg is not None])
        np.testing.assert_allclose(shown, ARM.shown(expected), rtol=0, atol=5.001e-6)
        np.testing.assert_allclose(found.postures(ARM), expected, rtol=0, atol=1e-7)
        return
    poses = np.stack([p.T_user_tool for p in found.positions if p.T_user_tool is not None])
    wanted = ARM.tool_poses(expected)
    np.testing.assert_allclose(poses[:, :3, 3], wanted[:, :3, 3], rtol=0, atol=5.001e-8)
    # four numbers of a quaternion, each within 5e-10
    np.testing.assert_allclose(poses[:, :3, :3], wanted[:, :3, :3], rtol=0, atol=4e-9)
    assert [p.configuration for p in found.positions] == ARM.configurations(expected)
    for position in found.positions:
        np.testing.assert_allclose(np.asarray(position.T_world_user), USER, atol=1e-8)
        np.testing.assert_allclose(np.asarray(position.T_tip_tool), TOOL, atol=1e-8)
    size = np.abs(np.linalg.det(IRB120.jacobian(expected)))
    assume(size.min() > AT_FULL_REACH)
    regular = size > 1e-3
    postures = found.postures(ARM)
    np.testing.assert_allclose(postures[regular], expected[regular], rtol=0, atol=2e-4)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["joint", "cartesian"]))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, seed: int, form: str) -> None:
    check_round_trip(seed, form, tmp_path_factory.mktemp("rapid"))


@pytest.mark.slow
@settings(max_examples=1000, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["joint", "cartesian"]))
def test_round_trip_long(tmp_path_factory: pytest.TempPathFactory, seed: int, form: str) -> None:
    check_round_trip(seed, form, tmp_path_factory.mktemp("rapid"))


def test_quaternions_are_those_of_another_library() -> None:
    robomath = pytest.importorskip("robodk.robomath", reason="compares with RoboDK's conventions")
    program = random_program(3, form="cartesian")
    text = render_module(program, ARM)
    found = re.findall(r"robtarget p\d+:=\[\[(.*?)\],\[(.*?)\]", text)
    for (place, turn), posture in zip(found, by_number(program), strict=True):
        pose = robomath.quaternion_2_pose([float(q) for q in turn.split(",")])
        T = np.array(pose.Rows())
        T[:3, 3] = [float(x) / 1e3 for x in place.split(",")]
        np.testing.assert_allclose(T, ARM.tool_poses(posture), rtol=0, atol=6e-8)


def test_numbers_are_plain() -> None:
    tiny = np.array([1e-9, -1e-9, 0.0, -0.0, 1e-7, -1e-7])
    for form in ("joint", "cartesian"):
        program = PoseProgram("CAL", (ProgramPose("T", tiny),), ProgramOptions(form=form))
        text = render_module(program, ARM).replace("9E9", "")
        assert not re.search(r"-0\.?0*(?![\d.])|\d[eE]|nan\b|\binf\b", text)


def test_quaternions_have_norm_one() -> None:
    text = render_module(random_program(9, form="cartesian"), ARM)
    found = re.findall(r"\],\[(-?[\d.]+,-?[\d.]+,-?[\d.]+,-?[\d.]+)\],\[-?\d", text)
    assert found
    for turn in found:
        assert min(len(q.split(".")[1]) for q in turn.split(",")) >= 7
        assert np.linalg.norm([float(q) for q in turn.split(",")]) == pytest.approx(1, abs=2e-9)


def test_names_that_no_comment_holds_are_left_out() -> None:
    poses = [ProgramPose(name, np.zeros(6)) for name in ("Ö", "a\nb", "", "x" * 81, 'a "b"; !')]
    text = render_module(PoseProgram("CAL", tuple(poses)), Arm.usual("abb"))
    assert problems(text) == []
    found = AbbRapid().parse(text.encode(), Path("CAL.mod"))
    assert [p.name for p in found.positions] == ["", "", "", "", 'a "b"; !']


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"comment": "für"}, "comment"),
        ({"comment": "a\nENDMODULE"}, "comment"),
        ({"comment": "x" * 81}, "comment"),
        ({"measure_call": "my prog"}, "is not a RAPID name"),
        ({"measure_call": "M" * 33}, "is not a RAPID name"),
        ({"measure_call": "endproc"}, "is not a RAPID name"),
        ({"measure_call": "main"}, "is not a RAPID name"),
        ({"measure_call": "jP3"}, "is the name of a position"),
        ({"measure_call": "cal"}, "would call itself"),
        ({"measure_call": "CAL_run"}, "would call itself"),
        ({"settle_s": 1e6}, "settle_s"),
        ({"measure_output": 1, "measure_pulse_s": 0.0}, "measure_pulse_s"),
    ],
)
def test_options_that_no_controller_takes(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    program = PoseProgram("CAL", POSES[:1], ProgramOptions(**changes))
    with pytest.raises(InputError, match=message) as caught:
        write(program, "abb-rapid", tmp_path)
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["1CAL", "MY CAL", "C" * 33, "", "module", "Base", "jMeasured", "p1", "Ä"]
)
def test_names_that_no_controller_takes(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write(PoseProgram(name, POSES[:1]), "abb-rapid", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_bad_comment_names_its_pose(tmp_path: Path) -> None:
    poses = (ProgramPose("T9", np.zeros(6), comment='say "é"'),)
    with pytest.raises(InputError, match="comment of pose 'T9'"):
        write(PoseProgram("CAL", poses), "abb-rapid", tmp_path)


def test_a_joint_beyond_all_arms_names_its_pose(tmp_path: Path) -> None:
    poses = (POSES[0], ProgramPose("T9", np.array([0, 0, 0, 13.0, 0, 0])))
    for form in ("joint", "cartesian"):
        program = PoseProgram("CAL", poses, ProgramOptions(form=form), ARM)
        with pytest.raises(InputError, match="pose 'T9': J4 is beyond"):
            write(program, "abb-rapid", tmp_path)


def test_cartesian_needs_the_robot(tmp_path: Path) -> None:
    program = PoseProgram("CAL", POSES, ProgramOptions(form="cartesian"))
    with pytest.raises(InputError, match="need the robot"):
        write(program, "abb-rapid", tmp_path)


def test_nothing_is_called_or_waited_for_where_nothing_is_asked() -> None:
    options = ProgramOptions(measure_call=None, settle_s=0.001)
    text = render_module(PoseProgram("CAL", POSES, options), Arm.usual("abb"))
    assert "MEASURE" not in text
    assert "PulseDO" not in text
    assert text.count("WaitTime\\InPos,0.01;") == 2  # a wait asked for does not round to none


def touched_up(text: str) -> RecordedProgram:
    return AbbRapid().parse(text.encode("ascii"), Path("CalPose.mod"))


def test_touched_up_positions_stand_in_the_place_of_the_planned_ones() -> None:
    planned = touched_up(JOINT_MODULE)
    assert [p.number for p in planned.positions] == [1, 2, 3]
    assert planned.empty_registers
    empty = "    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]]];"
    value = "    [[-10.5,20.5,10.5,-5.5,35.5,130.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]];"
    assert JOINT_MODULE.count(empty) == 1
    program = touched_up(JOINT_MODULE.replace(empty, value))
    assert not program.empty_registers
    # pose 1 is not measured yet: its planned position is no measurement
    assert [(p.number, p.name) for p in program.positions] == [(2, ""), (3, "way")]
    assert [p.number for p in program.measured] == [2]
    np.testing.assert_array_equal(
        np.asarray(program.positions[0].shown_deg), [-10.5, 20.5, 10.5, -5.5, 35.5, 130.5]
    )
    half = value.replace("-10.5", "9E9")
    with pytest.raises(Exception, match="axis 1 has no value"):
        touched_up(JOINT_MODULE.replace(empty, half))


def test_the_routine_of_the_longest_name_is_no_longer(tmp_path: Path) -> None:
    (file,) = write(PoseProgram("C" * 32, POSES[:1]), "abb-rapid", tmp_path)
    assert f"PROC {'C' * 28}_run()" in file.read_text()
    assert problems(file.read_text()) == []


def test_programs_of_older_versions_are_read() -> None:
    old = JOINT_MODULE.replace("PROC CalPose_run()", "PROC main()\n    VelSet 20,5000;")
    old = old.replace("  LOCAL CONST speeddata vCalib:=[1000,100,1000,200];\n", "")
    old = old.replace("vCalib", "vmax").replace("  ENDPROC", "    VelSet 100,5000;\n  ENDPROC")
    assert problems(old) == []
    shown = [p.shown_deg for p in touched_up(old).positions]
    np.testing.assert_array_equal(shown, [p.shown_deg for p in touched_up(JOINT_MODULE).positions])
