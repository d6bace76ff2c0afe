"""URScript: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.programs import Arm, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.ur_script import UrScript, rules
from posedesign.programs.ur_script.rules import MOST_PROBLEMS, check_ur_script

POSES = tuple(ProgramPose(f"T{i}", np.radians([i, -80, 90, -90, -90, 6])) for i in (1, -1))
ARM = Arm.of(Robot.preset("ur5e"))


def script(form: str) -> str:
    options = ProgramOptions(form=form, fingerprint="abcdef12", measure_output=3)  # type: ignore[arg-type]
    (text,) = UrScript().render(PoseProgram("Calpose", POSES, options), ARM).values()
    return text


GOOD, POSED = script("joint"), script("cartesian")


def check(text: str) -> list[Problem]:
    return check_ur_script(text.encode("latin-1"))


def test_good_files_have_no_problems(tmp_path: Path) -> None:
    assert check(GOOD) == []
    assert check(POSED) == []
    path = tmp_path / "Calpose.script"
    path.write_bytes(GOOD.replace("\n", "\r\n").encode())
    assert UrScript().validate(path) == []


@pytest.mark.parametrize(
    "line",
    [
        "movej(q1, a=1.4, v=0.3)",
        "movej([d2r(1), 0, 0, 0, 0, 0], 1.4, 0.3, 0, 0)",
        "movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.4, v=0.3, r=0)",
        "movel(p[0.1, .2, -.3, 0, 0, 3], a=1.2, v=0.25, r=0.0)",
        "global x = -0.5",
        "if (get_standard_digital_in(0) == True):\n  sync()\n  end",
        "while not is_steady():\n  sync()\n  end",
        'popup("[1e5 # (not code")  # 1e5 [',
        '$ 3 "Waypoint_1" "breakAfter"',
        "x = norm(a) - 0.5",
        "temp[0] = 3",
        "movej(q=[0, 0, 0, 0, 0, 0], a=1.4)",
        "set_payload(1.25, [0, 0, 0.05])",
        "def other(a, b):\n  return a + b\n  end\n  other(1, 2)",
    ],
)
def test_what_others_write_too_is_accepted(line: str) -> None:
    assert check(GOOD.replace("  # POSE 2 T-1", f"  {line}\n  # POSE 2 T-1")) == []


# What PolyScope puts before a program of somebody, and there is no call behind it.
POLYSCOPE = """\
def Touch_up():
  set_safety_mode_transition_hardness(1)
  modbus_add_signal("192.168.1.3", 255, 1, 0, "MODBUS_1", False)
  modbus_set_signal_update_frequency("MODBUS_1", 10)
  modbus_set_runstate_dependent_choice("MODBUS_1", 0)
  set_standard_analog_input_domain(0, 1)
  set_tool_analog_input_domain(0, 1)
  set_analog_outputdomain(0, 0)
  set_input_actions_to_default()
  set_tcp(p[-0.018457705833652818,-0.06671608895162245,0.19891377627880122,0.0,0.0,0.0])
  set_gravity([0.0, 0.0, 9.82])
  set_tool_communication(False, 115200, 0, 1, 1.5, 3.5)
  set_tool_output_mode(0)
  set_tool_digital_output_mode(0, 1)
  set_tool_voltage(0)
  step_count_1 = 0
  thread Step_Counter_Thread_1():
    while (True):
      step_count_1 = step_count_1 + 1
      sync()
    end
  end
  run Step_Counter_Thread_1()
  set_target_payload(1.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
  $ 1 "Robot Program"
  movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.396263401595, v=1.047)
end
"""


def test_what_polyscope_puts_before_a_program_is_accepted() -> None:
    assert check(POLYSCOPE) == []


MOVE = "movej([0.0174533,"
ONE_RULE = [
    ("ascii", GOOD, "# PLAN", "# PL\u00e4N", "0xe4"),
    ("ascii", GOOD, "# PLAN", "# PL\0N", "0x00"),
    ("log", "POSE 1 q=[0, 0, 0, 0, 0, 0]\n", "POSE", "x\nPOSE", "the log of a run"),
    ("program", GOOD, "end\nCalpose()\n", "end\ncalpose = 1\n", "where the call Calpose() is due"),
    ("program", GOOD, "def Calpose():", "def Calpose(x):", "where def NAME(): is due"),
    ("program", GOOD, "def Calpose():", "x = 1\ndef Calpose():", "where def NAME(): is due"),
    ("blocks", GOOD, "\nend\n", "\n", "'def Calpose():' has no end"),
    ("blocks", GOOD, "\nend\n", "\nend\nend\n", "end of nothing"),
    ("brackets", GOOD, "set_tcp(p[", "set_tcp((p[", "( is not closed"),
    ("brackets", GOOD, "freedrive_mode()", "freedrive_mode())", ") closes nothing"),
    ("brackets", GOOD, "freedrive_mode()", "freedrive_mode(])", "] closes nothing"),
    ("brackets", GOOD, 'q=", get', "q=, get", "a quote is not closed"),
    ("known-function", GOOD, "  def MEASURE(number):", "  def probe(number):", "MEASURE is not"),
    ("known-function", GOOD, "sleep(", "wait(", "wait is not defined above"),
    ("arguments", GOOD, "sleep(1.000)", "sleep()", "sleep has 0 arguments, not 1 to 1"),
    ("arguments", GOOD, "v=0.3142)", "v=0.3142, speed=3)", "movej has no speed"),
    ("arguments", GOOD, "v=0.3142)", "a=1.3)", "one is empty or twice"),
    ("arguments", GOOD, "v=0.3142)", "v=0.3142,)", "one is empty or twice"),
    ("arguments", GOOD, "digital_out(3, True)", "digital_out(3)", "has 1 arguments, not 2"),
    ("arguments", GOOD, "freedrive_mode()", "freedrive_mode(on=1)", "freedrive_mode has no on"),
    ("arguments", POSED, "qnear=", "near=", "get_inverse_kin has no near"),
    ("joints", GOOD, MOVE, "movej([6.4,", "is not six joint values"),
    ("joints", GOOD, MOVE, "movej([", "is not six joint values"),
    ("joints", POSED, "qnear=[0.0174533,", "qnear=[57.3,", "is not six joint values"),
    ("pose", GOOD, "set_tcp(p[0.0000000", "set_tcp(p[350", "in metres"),
    ("pose", GOOD, "  set_tcp", "  part = p[350, 0, 0, 0, 0, 0]\n  set_tcp", "in metres"),
    ("pose", POSED, "set_tcp", "movel(p[800, 0, 0, 0, 0, 0])\n  set_tcp", "in metres"),
    ("pose", POSED, "set_tcp", "movel(p[0, 0, 0, 180, 0, 0])\n  set_tcp", "in metres"),
    ("pose", POSED, "set_tcp", "movel(p[0, 0, 0, 0, 0])\n  set_tcp", "in metres"),
    ("arm-position", GOOD, MOVE, "movej(p[0, 0, 0, 0, 0, 0])\n  " + MOVE, "movej to a pose"),
    ("arm-position", POSED, ", qnear=[0.0174533, ", ") + ([0.0174533, ", "without qnear"),
    ("speed", GOOD, "v=0.3142", "v=30", "v is 30"),
    ("speed", GOOD, "v=0.3142", "v=0.0", "v is 0.0"),
    ("speed", GOOD, "a=1.4", "a=80.2", "a is 80.2"),
    ("number", GOOD, MOVE, "movej([1.74533e-2,", "'1.74533e-2' is not a plain number"),
    ("number", GOOD, MOVE, "movej([nan,", "'nan' is not a plain number"),
    ("number", GOOD, MOVE, "movej([-0.0000000,", "'-0.0000000' is not a plain number"),
    ("stop-to-measure", GOOD, "v=0.3142)", "v=0.3142, r=0.05)", "has a blend radius"),
    ("stop-to-measure", GOOD, "a=1.4, v=0.3142)", "1.4, 0.3, 0, 0.05)", "has a blend radius"),
    ("report", GOOD, "POSE 2 q=", "POSE 1 q=", "POSE 1 is reported twice"),
    ("report", GOOD, '1 q=", get_actual_joint_positions()', '1 q=", q1', "without the actual"),
    ("output", GOOD, "digital_out(3, True)", "digital_out(8, True)", "output 8, not 0 to 7"),
    ("tcp", POSED, "set_tcp", "set_payload", "no set_tcp above"),
]


@pytest.mark.parametrize(("rule", "source", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(
    rule: str, source: str, old: str, new: str, message: str
) -> None:
    assert old in source
    text = source.replace(old, new, 1)
    if rule in ("pose", "arm-position") and "set_tcp" in new:
        # the TCP is set before the added move
        text = text.replace("  def MEASURE", "  set_tcp(p[0, 0, 0, 0, 0, 0])\n  def MEASURE", 1)
    problems = check(text)
    assert {problem.rule for problem in problems} == {rule}
    assert message in " ".join(problem.message for problem in problems)


def test_every_rule_has_such_a_file() -> None:
    documented = {
        line[2 : line.index("``", 2)]
        for line in (rules.__doc__ or "").splitlines()
        if line.startswith("``")
    }
    assert documented == {rule for rule, *_ in ONE_RULE}


def test_problems_name_their_lines() -> None:
    text = GOOD.replace("v=0.3142", "v=30").replace("# PLAN", "# PL\u00e4N")
    moves = [i for i, line in enumerate(GOOD.splitlines(), 1) if "movej" in line]
    assert sorted((p.line, p.rule) for p in check(text)) == [
        (2, "ascii"),
        *((line, "speed") for line in moves),
    ]


def test_a_file_of_rubbish_is_not_told_without_end() -> None:
    assert len(check("def x():\n" + "rubbish(\n" * 5000)) == MOST_PROBLEMS


def test_an_empty_file_has_a_problem() -> None:
    assert {p.rule for p in check_ur_script(b"")} == {"program"}
