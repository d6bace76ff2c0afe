"""URScript: the readers of scripts and logs, and the line of what they refuse."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs import RecordedProgram
from posedesign.programs.ur_script import UrScript
from tests.unit.programs.dialects import changed, export, refused

DIALECT = UrScript()
PATH = Path("x.script")

# In the manner of what PolyScope generates: waypoints as pairs, labels, threads, nested blocks.
POLYSCOPE = export("ur.script")


def parse(text: str, path: Path = PATH) -> RecordedProgram:
    return DIALECT.parse(text.encode("latin-1"), path).whole()


def joints(program: RecordedProgram) -> dict[int, list[float]]:
    return {
        p.number: np.radians(p.shown_deg).tolist()
        for p in program.positions
        if p.shown_deg is not None
    }


def test_what_polyscope_generates_is_read() -> None:
    program = parse(POLYSCOPE.replace("\n", "\r\n"))
    assert (program.name, program.comment, program.fingerprint) == ("Touch_up", "", "")
    assert [p.number for p in program.positions] == [1, 2, 3, 4, 5, 6]
    assert [p.name for p in program.positions] == ["Waypoint_1", "Waypoint_2", "q1", "q1", "", ""]
    found = joints(program)
    assert found.keys() == {1, 3, 4, 5}
    np.testing.assert_allclose(
        found[1], [1.5, -1.6684614620604457, 1.9, -0.27, 1.32, 0.0036344528198242188]
    )
    np.testing.assert_allclose(found[3], [np.pi / 2, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(found[4], np.ones(6))
    np.testing.assert_allclose(found[5], np.full(6, 2.0))
    first, second, *_, last = (p.T_user_tool for p in program.positions)
    assert first is not None
    assert second is not None
    assert last is not None
    np.testing.assert_allclose(first[:3, 3], [0.433025361705, -0.467959205379, 0.522310714714])
    np.testing.assert_allclose(second[:3, 3], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(second[:2, :2], [[np.cos(3), -np.sin(3)], [np.sin(3), np.cos(3)]])
    np.testing.assert_allclose(last[:3, 3], [0.4, 0.5, 0.6])
    lines = POLYSCOPE.splitlines()
    assert "Waypoint_1_p=" in lines[program.positions[0].line - 1]
    assert "movel([2" in lines[program.positions[4].line - 1]


def test_lists_without_moves_are_positions() -> None:
    text = "q1=[1,2,3,0,0,0]\nP1_q=[1,1,1,1,1,1]\nP1_p=p[1,0,0,0,0,0]\nx=[1,2]\nn=3\n"
    program = parse(text)
    assert joints(program) == {1: pytest.approx([1, 2, 3, 0, 0, 0]), 2: pytest.approx([1] * 6)}
    assert program.name == "x"
    assert program.positions[1].T_user_tool is not None


SMALL = """\
def cal():
  # Title: cell 7
  # PLAN abcdef12 2
  # POSE 1 left
  movej([0.1, -1.5, 1.5, -1.5, -1.5, 0.5], a=1.4, v=0.3)
  textmsg("POSE 1 q=", get_actual_joint_positions())
  # POSE 2
  movej([0.2, -1.5, 1.5, -1.5, -1.5, 0.5], a=1.4, v=0.3)
  textmsg("POSE 2 q=", get_actual_joint_positions())
end
cal()
"""
POSED = SMALL.replace("movej([0.1,", "movej(get_inverse_kin(p[0.4, 0.1, 0.5, 0, 0, 0], qnear=[0.1,")
POSED = POSED.replace("0.5], a", "0.5]), a", 1)


def test_added_moves_stand_behind_all() -> None:
    added = SMALL.replace(
        "  # POSE 2", "  movej([1,1,1,1,1,1])\n  movej(pose_add(a, b))\n  # POSE 2"
    )
    program = parse(added)
    assert [p.number for p in program.positions] == [1, 3, 2]
    assert (program.comment, program.mark.measured) == ("cell 7", 2)
    assert [p.number for p in program.measured] == [1, 2]


def test_joints_beside_a_pose_are_taken_below_its_number_only() -> None:
    first = parse(POSED).positions[0]
    assert first.shown_deg is not None
    np.testing.assert_allclose(np.radians(first.shown_deg), [0.1, -1.5, 1.5, -1.5, -1.5, 0.5])
    assert first.T_user_tool is not None
    without = parse(re.sub(r"  # POSE.*\n", "", POSED)).positions[0]
    assert without.shown_deg is None
    assert without.T_user_tool is not None


@pytest.mark.parametrize(
    ("source", "old", "new", "line", "message"),
    [
        (SMALL, "end\n", "", 11, "is cut off"),
        (SMALL, "cal():", "c\0l():", 1, "holds the byte 0x00"),
        (SMALL, "[0.1, ", "[", 5, "position 1 has 5 values"),
        (SMALL, "0.1,", "nan,", 5, "value 1 is 'nan', not a number"),
        (SMALL, "0.1,", "0..1,", 5, r"cannot stand behind .*movej\(\[0"),
        (SMALL, "0.1,", "12.6,", 5, "value 1 is 12.6, beyond"),
        (SMALL, "0.1,", "d2r(721),", 5, r"value 1 is d2r\(721\), beyond"),
        (SMALL, "0.1,", "10.0*x,", 5, "not a number"),
        (SMALL, "v=0.3)", "v=0.3", 5, "'textmsg.* cannot stand behind"),
        (SMALL, "movej([0.1", "stopj([0.1", 4, "POSE 1 is not followed by a move"),
        (SMALL, "movej([0.1, -1.5, 1.5, -1.5, -1.5, 0.5]", "movej(q7", 4, "POSE 1 is not followed"),
        (SMALL, "# POSE 2", "# POSE 1", 7, "POSE 1 stands before two moves"),
        (SMALL, "# POSE 2", "# POSE 0", 7, "counted from 1"),
        (POSED, "p[0.4,", "p[400,", 5, "value 1 is 400, beyond"),
        ("q=[1,1,1,1,1,1]\nq[0]=0.5\nmovej(q)\n", "0.5", "0.6", 3, "target 'q' cannot be known"),
        ("q=[1,1,1,1,1,1]\np1=p[1,0,0,0,0,0]\np1 [2]= 3\nmovel(p1)\n", "1", "2", 4, "'p1' cannot"),
        ("q=[1,1,1,1,1,1]\nglobal q[0] = 0.5\n", "1", "2", 2, "an element of q is changed"),
        (
            SMALL,
            "  movej([0.1",
            "  q=[1,1,1,1,1,1]\n  q[5]=2\n  movej(q)\n  movej([0.1",
            4,
            "POSE 1 is not",
        ),
        ("movej(get_inverse_kin(p[1,0,0,0,0,0])+[1])\n", "1", "2", 1, "cannot be known"),
        ("movel(pose_trans(a, p[1,0,0,0,0,0]))\n", "a", "b", 1, "cannot be known"),
        ("movej(get_inverse_kin(a, qnear=[1,1,1,1,1,1]))\n", "a,", "b,", 1, "cannot be known"),
        ("q=[1,1,1,1,1,1]\nmovej(f(q))\n", "f", "g", 2, r"target 'g\(q\)' cannot be known"),
        (
            "p1=p[1,0,0,0,0,0]\nset_tcp(p[0,0,1,0,0,0])\nmovel(p1)\nset_tcp(p[0,0,2,0,0,0])\n"
            "movel(p1)\n",
            "1",
            "1",
            5,
            "moves to p1 with another TCP than before",
        ),
        ("set_tcp(p[800,0,x,0,0,0])\nmovel(p[1,0,0,0,0,0])\n", "x", "y", 2, "the TCP: value 1"),
        ("x = p[\n  1,\n", "1", "2", 1, "is not complete"),
        ("def x():\nend\n", "x", "y", None, "holds no positions"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(source, old, new, line, message):
    refused("ur-script", "x.script", changed(source, old, new), line, message)


def test_frames_that_are_given_by_value() -> None:
    program = parse(
        "a=p[1,0,0,0,0,0]\nset_tcp(p[0,0,0.1,0,0,0])\nb=p[0,0,0,0,0,d2r(90)]\n"
        "movel(pose_trans(pose_trans(a, b), p[0.5,0,0,0,0,0]))\n"
        "set_tcp(other())\n"
        "movel(pose=pose_trans(a, p_from_to=pose_trans(b, p[0.6,0,0,0,0,0])), a=1)\n"
        "movej(get_inverse_kin(pose_trans(a, pose_trans(b, p[0.7,0,0,0,0,0])), "
        "tcp=p[0,0,3,0,0,0]))\n"
        "movel(pose_trans(p[1,0.8,0,0,0,0], p[0,0,0,0,0,0]))\nmovel(p[1,0.9,0,0,0,0])\n"
    )
    # a turn about z in a frame that is 1 m along x: user x is the base's y
    for position, x in zip(program.positions, (0.5, 0.6, 0.7, 0.8, 0.9), strict=True):
        assert position.T_world_user is not None
        assert position.T_user_tool is not None
        both = position.T_world_user @ position.T_user_tool
        np.testing.assert_allclose(both[:3, 3], [1.0, x, 0.0], atol=1e-12)
    first, second, third = (p.T_tip_tool for p in program.positions[:3])
    assert first is not None
    assert third is not None
    np.testing.assert_allclose(first[:3, 3], [0, 0, 0.1])
    assert second is None
    np.testing.assert_allclose(third[:3, 3], [0, 0, 3.0])


def test_the_tcp_of_polyscope_and_of_branches() -> None:
    first = parse(POLYSCOPE).positions[0]
    assert first.T_tip_tool is not None
    np.testing.assert_allclose(first.T_tip_tool[:3, 3], [0, 0, 0.1])
    np.testing.assert_array_equal(first.T_world_user, np.eye(4))
    branch = POLYSCOPE.replace("set_payload(0.5, [0, 0, 0.05])", "set_tcp(p[0,0,9,0,0,0])")
    assert parse(branch).positions[0].T_tip_tool is None
    same = POLYSCOPE.replace(
        "set_payload(0.5, [0, 0, 0.05])", "set_tcp(p[0.0,0.0,0.1,0.0,0.0,0.0])"
    )
    assert parse(same).positions[0].T_tip_tool is not None


def test_targets_given_by_name() -> None:
    program = parse("movej(q=[1, 2, 3, 0, 0, 0], a=1.4)\nmovel(a=1, pose = p[1,0,0,0,0,0])\n")
    assert joints(program) == {1: pytest.approx([1, 2, 3, 0, 0, 0])}
    assert program.positions[1].T_user_tool is not None


LOG = export("ur.log")


def test_a_log_is_read_from_its_last_run() -> None:
    program = parse(LOG, Path("history.log"))
    assert (program.name, program.fingerprint, program.mark.measured) == ("Calpose", "abcdef12", 2)
    assert joints(program) == {
        1: pytest.approx([0.1, -1.5, 1.5, -1.5, -1.5, -5.2e-5]),
        2: pytest.approx([0.2, -1.5, 1.5, -1.5, -1.5, 0.5]),
    }
    assert [p.line for p in program.positions] == [6, 7]
    bare = parse("POSE 3 q=[1,1,1,1,1,1]\nPOSE 3 q = [1, 1, 1, 1, 1, 1]\n", Path("history.log"))
    assert (bare.name, bare.mark.measured, list(joints(bare))) == ("history", None, [3])


def test_the_mark_of_a_log_may_be_followed_by_anything() -> None:
    for behind in (" (from RTMachine)", '"', " 9"):
        program = parse(LOG.replace("PLAN abcdef12 2", "PLAN abcdef12 2" + behind))
        assert (program.fingerprint, program.mark.measured) == ("abcdef12", 2)
    assert parse(LOG.replace("PLAN abcdef12 2", "PLAN abcdef12 2x")).fingerprint == ""


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("POSE 2", "POSE 1", 7, "POSE 1 is reported twice in one run"),
        ("POSE 2", "POSE 0", 7, "counted from 1"),
        ("0.5]", "0.5", 7, "POSE 2 has no whole list"),
        ("[0.2, ", "[", 7, "POSE 2 has 5 values"),
        ("[0.2, ", "[x, ", 7, "POSE 2: value 1 is 'x', not a number"),
        ("[0.2, ", "[20, ", 7, "POSE 2: value 1 is 20, beyond"),
        ("q=[0.2, -1.5, 1.5, -1.5, -1.5, 0.5]", "q=", 7, "POSE 2 has no whole list"),
    ],
)
def test_what_is_wrong_in_a_log(old: str, new: str, line: int, message: str) -> None:
    refused("ur-script", "history.log", changed(LOG, old, new), line, message)


def test_a_run_without_reports() -> None:
    with pytest.raises(FileFormatError, match="last run in it reports no POSE"):
        parse(LOG + "PROGRAM Calpose PLAN abcdef12 2\n")


def test_a_file_of_faults_is_no_script() -> None:
    with pytest.raises(FileFormatError, match="hardly a line"):
        parse(SMALL + "rubbish!\n" * 1000)


def test_speeds_and_forces_of_a_program_are_no_positions() -> None:
    """A program that moves by ``speedj`` in a loop, as for admittance, has lists of six as well."""
    text = (
        "def admittance():\n  vel_target = [0, 0, 0, 0, 0, 0]\n  global stiffness=[1,1,1,0,0,0]\n"
        "  while True:\n    speedj(vel_target, 5, 0.002)\n  end\nend\n"
    )
    with pytest.raises(FileFormatError, match="holds no positions"):
        parse(text)
    stored = text.replace("  while", "  P1_q=[1,2,3,0,0,0]\n  while")
    assert joints(parse(stored)) == {1: pytest.approx([1, 2, 3, 0, 0, 0])}


def test_brackets_go_on_over_lines() -> None:
    """As in the examples of Universal Robots, with remarks between."""
    program = parse(
        "circle = p[  # a pose\n  0.5, 0,\n  0, 0, 0, 0\n]\n"
        "movel(circle\n, a=1.2\n)\n# POSE 1 far\nmovej(\n  [1, 2, -3, 0, 0, 0])\n"
    )
    assert [(p.number, p.name, p.line) for p in program.positions] == [
        (2, "circle", 1),
        (1, "far", 9),
    ]
    assert joints(program) == {1: pytest.approx([1, 2, -3, 0, 0, 0])}


def test_lines_that_hold_no_position_are_passed_over() -> None:
    text = SMALL.replace("  # PLAN", "  turn_on(the_light)\n  if the_light:\n  end\n  # PLAN")
    assert parse(text).positions[1].line == 11


A, B = "[0, -1.57, -1.0, -1.57, 0, 0]", "[1, -1.57, -1.0, -1.57, 0, 0]"
GIVES = f"  home = {A}\n"
MOVES = "  movej(home)\n"


@pytest.mark.parametrize(
    "text",
    [
        f"def f():\n{GIVES}end\nhome = {B}\nf()\n{MOVES}",
        f"def f():\n  home[0] = 3\nend\nhome = {B}\nf()\n{MOVES}",
        f"def f():\n  g()\nend\ndef g():\n{GIVES}end\nhome = {B}\nn = 1 + f()\n{MOVES}",
        f"home = {B}\ndef f(home):\n{MOVES}end\nf({A})\n",
        f"home = {B}\ndef f():\n{MOVES}end\nhome = {A}\nf()\n",
        f"thread f():\n{GIVES}end\nhome = {B}\nrun f()\nhome = {B}\n{MOVES}",
        f"home = {B}\nif go:\n{GIVES}end\n{MOVES}",
        f"home = {B}\nif go:\n{GIVES}else:\n{MOVES}end\n",
        f"home = {B}\nwhile go:\n{MOVES}{GIVES}end\n",
    ],
)
def test_a_list_that_may_have_been_given_other_values_is_not_known(text: str) -> None:
    with pytest.raises(FileFormatError, match="'home' cannot be known"):
        parse(text)


@pytest.mark.parametrize(
    "text",
    [
        f"def init():\n  global home = {B}\nend\ndef p():\n  init()\n{MOVES}end\np()\n",
        f"def f():\n{GIVES}end\nhome = {B}\n{MOVES}",
        f"home = {A}\nif go:\n  home = {B}\n{MOVES}end\n",
        f"home = {A}\nf()\nhome = {B}\n{MOVES}home = {A}\n",
    ],
)
def test_a_list_that_is_given_before_the_move_is_known(text: str) -> None:
    (position,) = parse(text).positions
    assert position.shown_deg[0] == pytest.approx(np.degrees(1))
