"""URScript: each rule of the validator, by a script that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.programs import Arm, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.ur_script import UrScript
from tests.unit.programs.dialects import breaks, changed

POSES = tuple(ProgramPose(f"T{i}", np.radians([i, -80, 90, -90, -90, 6])) for i in (1, -1))
ARM = Arm.of(Robot.preset("ur5e"))


def script(form: str) -> str:
    options = ProgramOptions(form=form, fingerprint="abcdef12", measure_output=3)  # type: ignore[arg-type]
    (text,) = UrScript().render(PoseProgram("Calpose", POSES, options), ARM).values()
    return text


GOOD, POSED = script("joint"), script("cartesian")


def check(text: str) -> list[Problem]:
    return UrScript().check(text.encode("utf-8"), Path("x.script"))


def faults(text: str) -> list[Problem]:
    return [problem for problem in check(text) if problem.level == "error"]


# Retyped in small from public scripts: of Universal Robots' URScript_Examples (Modbus, Ethernet/IP,
# impedance and admittance control, timing), of its client library (external control, a program of
# PolyScope X), of RoboDK's post-processor, and of grippers' URCaps.
OTHERS = [
    'modbus_add_signal("192.168.1.9", 255, 0, 0, "IN", True, 24)\nsleep(1)\nglobal all = '
    'modbus_get_signal_status("IN", False)\nglobal first = all[0]',
    "def connect(name, most):\n  local i = 0\n  while i < most * 10:\n"
    "    if(modbus_get_error(name) == 0):\n      return True\n    end\n    i = i + 1\n  end\n"
    "  return -1\nend  ",
    "def start(size = 8):\n  global out = eip_writer_factory(size, 8)\n"
    '  if(not out.add(size, "x")):\n    popup("no<br>" + to_str(size))\n    halt\n  end\n'
    "  out.write(struct(Inside = True, Bit = [True][0]))\n"
    '  while (not out.read(["A", "B"])[size]):\n    later()\n  end\nend\n'
    "def later():\n  sync()\nend",
    "def circle(time):\n  pose = p[\n    0.1 * cos(2 * time),  # x\n    -sin(time),\n"
    "    0, 0, 0, 0\n  ]\n  return struct(p = pose, v = [1, 2] * -1.3)\nend\n"
    'global used = get_rtde_value("actual_execution_time")\nstart = pose_inv(circle(0).p)',
    'local said = str_cat(\n  str_cat("a", 1), str_cat(\n    "(", ")]"))',
    "def adm(scale = 0.5, frame = p[0, 0, 0, 0, 0, 0], free = [1, 1, 1]):\n"
    "  local M = inv(scale) * ((frame - free) - (scale * free)) # mass\n"
    "  M[2, 1] = M[1, 2] - 1e-3\n  speedl(M, a = 5, t = get_steptime(), aRot = 45)\nend\n"
    "adm(free = [0, 0, 1])",
    '$ 3 "var_4\u22544"\nglobal var_4=4\nthread T_1():\n  while (True):\n    # \'a remark\n'
    "    global var_4=(var_4+1)%15\n    enter_critical\n    sync()\n    exit_critical\n  end\nend\n"
    "id = run T_1()\nkill id\njoin id",
    "def seconds(t):\n  return (t.sec - 3) * 1e6 + t.nanosec / 1e3\nend",
    "if True == get_digital_in(8):\n  z = (get_analog_in(2)-0.026)/2.976*1.57+-0.08\n"
    "elif not is_steady():\n  p = 3\nelse:\n  pass\nend",
    'set_tcp(p[0, 0, 0.1, 0, 0, 0], "Tool_flange")\nglobal Home = struct(p=p[-1e-9, 0, 1, 0, 0, 0]'
    ", q=[0, -1.57, 0, -1.57, 0, 0])\nmovej(Home.q, a=1.4, v=0, t=3)",
    "movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.396263401595, v=1.047)",
    "movej([d2r(1), 0, 0, 0, 0, 0], 1.4, 0.3, 0, 0)\nmovel(p[.1, 2, -.3, 0, 0, 3], v=.25, r=0.)",
    "def shake(w, pass = 2):\n  w = -0.2 turn(w)  w = pass*3\n  turn(w) turn(-w)\nend\n"
    "def turn(w):\n  sleep(w)\nend",
    '$ 12 "If digital_in[0]=\u201cf(1) g(2)\u201d, "on""\nsleep(1)',
    "def turn(p):\n  p[2] = p[2] + 0.1\n  return p\nend",
    'popup("[1e5 # (not code", "Robot\'s", error=True)  # 1e5 [ \u00e9',
    "sec setOut():\n  set_tool_voltage(24)\nend",
    "rq_activate_and_wait()\nif not(rq_is_there(1, 2)):\n  RG2(100,40,0.0,True)\nend",
]


@pytest.mark.parametrize("text", OTHERS)
def test_what_others_write_has_no_error(text: str) -> None:
    assert faults(text + "\n") == []
    inside = GOOD.replace("  # POSE 2 T-1", text + "\n  # POSE 2 T-1")
    assert faults(inside) == []


def test_what_a_script_does_not_give_is_told_as_a_note() -> None:
    problems = check("rg_grip(Plane_1)\nrg_grip(Plane_1)\n")
    assert {(p.line, p.rule, p.level) for p in problems} == {
        (1, "function", "note"),
        (1, "variable", "note"),
        (1, "read", "note"),  # it moves to no position
    }


MOVE = "movej([0.0174533,"
ONE_RULE = [
    ("text", GOOD, "# PLAN", "# PL\0N", "error", "0x00"),
    ("log", "POSE 1 q=[0, 0, 0, 0, 0, 0]\n", "POSE", "x\nPOSE", "note", "the log of a run"),
    ("program", "# nothing\n", "nothing", "no", "error", "there is nothing in it"),
    ("block", GOOD, "\nend\n", "\n", "error", "'def Calpose():' is never closed"),
    ("block", GOOD, "\nend\n", "\nend\nend\n", "error", "'end' closes nothing"),
    ("syntax", GOOD, "set_tcp(p[", "set_tcp((p[", "error", "cannot stand behind"),
    ("syntax", GOOD, "  freedrive_mode()", "  freedrive_mode(])", "error", "cannot stand behind"),
    ("syntax", GOOD, 'q=", get', "q=, get", "error", "cannot stand behind"),
    ("syntax", GOOD, "sleep(1.000)", "sleep(1_0)", "error", "'_0)' cannot stand behind"),
    ("syntax", GOOD, MOVE, "movej([0.01.5,", "error", "'.5,"),
    ("syntax", GOOD, MOVE, "movej([end,", "error", "'end,"),
    ("syntax", GOOD, "v=0.3142)", "v=0.3142,)", "error", "cannot stand behind"),
    ("syntax", GOOD, "True)\n  sleep", "sleep True", "error", "True"),
    ("syntax", GOOD, "not request", "not not request", "error", "'not request"),
    ("function", GOOD, "sleep(", "slep(", "error", "slep is nearly sleep"),
    ("function", GOOD, "  sync()", "  snc()", "error", "snc is nearly sync"),
    ("function", GOOD, "  def MEASURE(number):", "  def probe(number):", "measuring", "MEASURE is"),
    ("variable", GOOD, "(3, True)", "(3, Tre)", "error", "Tre is nearly True"),
    ("variable", GOOD, '", number)', '", numbr)', "error", "numbr is nearly number"),
    ("variable", GOOD, MOVE, "movej([nan,", "error", "nan is no variable"),
    ("variable", GOOD, MOVE, "movej([sleep,", "error", "sleep is no variable"),
    ("variable", GOOD, MOVE, "movej([base_turn,", "measuring", "base_turn is given nowhere"),
    ("arguments", GOOD, "sleep(1.000)", "sleep()", "error", "sleep has 0 arguments, not 1"),
    ("arguments", GOOD, "MEASURE(1)", "MEASURE()", "error", "MEASURE has 0 arguments, not 1"),
    ("arguments", GOOD, "v=0.3142)", "v=0.3142, speed=3)", "error", "movej has no speed"),
    ("arguments", GOOD, "v=0.3142)", "a=1.3)", "error", "given twice"),
    ("arguments", GOOD, "v=0.3142)", "v=0, 3)", "error", "without a name behind one with"),
    ("arguments", GOOD, "a=1.4,", 'a="1",', "error", 'a is "1", no number'),
    ("arguments", GOOD, "a=1.4,", "a=1.4, q=0.3,", "error", "given twice"),
    ("arguments", GOOD, "sync()", 'sync()\n  while not ("x"):\n  end', "error", "no condition"),
    ("arguments", GOOD, "sync()", 'sync()\n  if "x":\n  end', "error", "is no condition"),
    ("arguments", GOOD, "sleep(1.000)", 'sleep(-("x"))', "error", "is no number"),
    ("range", GOOD, "sleep(1.000)", "sleep(-1)", "error", "t is -1, not 0 to inf"),
    ("range", GOOD, "v=0.3142)", "v=0.3142, t=-3)", "error", "t is -3"),
    (
        *("range", GOOD, "sleep(1.000)"),
        *("write_output_integer_register(-36, 0)", "error", "address is -36, not 0 to 47"),
    ),
    (
        *("arguments", GOOD, "sleep(1.000)", "write_output_integer_register(36% 0)", "error"),
        "write_output_integer_register has 1 arguments, not 2",
    ),
    ("arguments", GOOD, "sleep(1.000)", "sleep(True)", "error", "t is True, no number"),
    ("arguments", GOOD, "  set_tcp", "  set_payload(2, [0, 1])\n  set_tcp", "error", "not three"),
    ("arguments", POSED, "qnear=", "near=", "error", "get_inverse_kin has no near"),
    ("joints", GOOD, MOVE, "movej([6.4,", "error", "not six joint values"),
    ("joints", GOOD, MOVE, "movej([", "error", "not six joint values"),
    ("joints", GOOD, MOVE, "movej([False,", "error", "not six joint values"),
    ("joints", POSED, "qnear=[0.0174533,", "qnear=[57.3,", "error", "not six joint values"),
    ("joints", POSED, "qnear=[", "qnear=p[", "error", "no joints"),
    ("pose", GOOD, "set_tcp(p[0.0000000", "set_tcp(p[350", "error", "in metres"),
    ("pose", GOOD, "set_tcp(p[0.0000000", "set_tcp(p[True", "error", "in metres"),
    ("pose", GOOD, "set_tcp(p[", "set_tcp([", "error", "no pose p[...]"),
    ("pose", POSED, "inverse_kin(p[", "inverse_kin([", "error", "no pose p[...]"),
    ("pose", GOOD, "  set_tcp", "  movel(p[0, 0, 0, 180, 0, 0])\n  set_tcp", "error", "in metres"),
    ("pose", GOOD, "  set_tcp", "  a = p[0, 0, 0, 0, 0]\n  set_tcp", "error", "in metres"),
    ("arm-position", GOOD, MOVE, "movej(p[0, 0, 0, 0, 0, 0])\n  " + MOVE, "measuring", "to a pose"),
    ("arm-position", POSED, ", qnear=[0.01", ") + ([0.01", "measuring", "without qnear"),
    ("speed", GOOD, "v=0.3142", "v=0.0", "error", "v is 0"),
    ("speed", GOOD, "v=0.3142", "v=30", "measuring", "v is 30"),
    ("speed", GOOD, "a=1.4", "a=80.2", "measuring", "a is 80.2"),
    (
        "output",
        GOOD,
        "digital_out(3, True)",
        "digital_out(8, True)",
        "error",
        "output 8, not 0 to 7",
    ),
    ("tcp", POSED, "set_tcp", "pose_inv", "measuring", "no set_tcp above"),
    ("stop-to-measure", GOOD, "v=0.3142)", "v=0.3142, r=0.05)", "measuring", "a blend radius"),
    ("stop-to-measure", GOOD, "a=1.4, v=0.3142)", "1.4, 0.3, 0, 0.05)", "measuring", "a blend"),
    ("freedrive", GOOD, "    end_freedrive_mode()\n", "", "measuring", "is never ended"),
    ("report", GOOD, "POSE 2 q=", "POSE 1 q=", "measuring", "POSE 1 is reported twice"),
    ("report", GOOD, "  movej(", "  # movej(", "measuring", "no move since the report before"),
    ("report", GOOD, "get_actual_joint_positions()", '""', "measuring", "without the actual"),
]


@pytest.mark.parametrize(("rule", "source", "old", "new", "level", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(rule, source, old, new, level, message):
    # the TCP is set before an added move
    new = new if "  set_tcp" not in old else f"  set_tcp(p[0, 0, 0, 0, 0, 0])\n{new}"
    problems = check(changed(source, old, new))
    if "p[0, 0, 0, 0, 0, 0])\n  movej" in new:
        problems = [problem for problem in problems if problem.rule != "tcp"]
    # a statement that is none is missing elsewhere, too
    breaks(problems, rule, message, *({p.rule for p in problems} if rule == "syntax" else ()))
    assert {p.level for p in problems if p.rule == rule} == {level}


def test_problems_name_their_lines() -> None:
    moves = [i for i, line in enumerate(GOOD.splitlines(), 1) if "movej" in line]
    problems = check(GOOD.replace("v=0.3142", "v=0").replace("  # PLAN", "\n\n  # PLAN"))
    assert [p.line for p in problems] == [line + 2 for line in moves]


@pytest.mark.parametrize("name", ["time", "Force", "sync", "pause", "while"])
def test_words_and_functions_of_urscript_are_no_names_of_programs(name: str) -> None:
    assert not UrScript().names.is_legal(name)
    assert UrScript().names.is_legal(f"{name}_1")
