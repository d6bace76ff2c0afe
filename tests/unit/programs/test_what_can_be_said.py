"""How options are said by each dialect, and what none of them can say is refused before it is."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import InputError, OutputError
from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramOptions, ProgramPose, postures_of
from tests.unit.programs.dialects import (
    CASES,
    HOW,
    POSED,
    dialect_of,
    each_case,
    each_dialect,
    middle,
    program_of,
    robot_of,
    texts_of,
)

ASKED = [name for name, how in HOW.items() if how.asks]
each_asked = pytest.mark.parametrize("name", ASKED)


def refuse(program: PoseProgram, name: str, message: str, folder: Path) -> InputError:
    """The error, which has a hint; and nothing is written."""
    with pytest.raises(InputError, match=message) as caught:
        DIALECTS[name].write(program, folder)
    assert caught.value.hint
    assert not list(folder.iterdir())
    return caught.value


# Options, and what stands in the program then; "-" before a text that does not.
SAID = [
    ("fanuc-ls", {"settle_s": 0, "measure_call": None}, "-WAIT", "-CALL"),
    ("fanuc-ls", {"settle_s": 0.001}, "  WAIT    .01(sec) ;"),
    ("fanuc-ls", {"settle_s": 1.0}, "  WAIT   1.00(sec) ;"),
    ("fanuc-ls", {"settle_s": 327.67}, "  WAIT 327.67(sec) ;"),
    ("fanuc-ls", {"measure_argument": None}, "  CALL MEASURE ;"),
    ("fanuc-ls", {"measure_argument": -4}, "  CALL MEASURE((-4)) ;"),
    ("fanuc-ls", {"keep": "register", "first_register": 41}, "  PR[41]=JPOS ;"),
    ("fanuc-ls", {"measure_output": 3}, "  DO[3]=PULSE,0.5sec ;"),
    ("fanuc-ls", {}, "CREATE\t\t= DATE 00-01-01  TIME 00:00:00;", "-PR["),
    ("kuka-krl", {"settle_s": 0, "measure_call": None}, "WAIT SEC 0\n", "-MEASURE", "-PULSE"),
    ("kuka-krl", {"settle_s": 0.001}, "WAIT SEC 0.01\n"),
    ("kuka-krl", {"measure_argument": None}, "MEASURE( )\n"),
    ("kuka-krl", {"measure_argument": -4}, "MEASURE(-4)\n"),
    (
        "abb-rapid",
        {"settle_s": 0, "measure_call": None},
        r"WaitTime\InPos,0;",
        "-MEASURE",
        "-Pulse",
    ),
    ("abb-rapid", {"settle_s": 0.001}, r"WaitTime\InPos,0.01;"),
    ("abb-rapid", {"measure_argument": None}, "    MEASURE;"),
    ("abb-rapid", {"measure_argument": -4}, "    MEASURE -4;"),
    (
        "ur-script",
        {"settle_s": 0, "measure_call": None},
        "-sleep(0.3",
        "-sleep(0.0",
        "-MEASURE",
        "(36, 1)\n  sleep(0.5)\n  write_output_integer_register(36, 0)",
    ),
    ("ur-script", {"settle_s": 1e-9}, "  sleep(0.001)"),
    ("ur-script", {"guided": False}, "Is this pose measured?", "-freedrive_mode"),
    ("ur-script", {"measure_call": "probe", "measure_argument": None}, "def probe():", "  probe()"),
    ("ur-script", {"measure_call": "probe", "measure_argument": -7}, "  probe(-7)"),
    ("yaskawa-jbi", {"settle_s": 0, "measure_call": None}, "-TIMER", "-CALL", "-SET I000"),
    ("yaskawa-jbi", {"settle_s": 0.001}, "TIMER T=0.01\n"),
    ("yaskawa-jbi", {"measure_argument": None}, "CALL JOB:MEASURE\n", "-SET I000"),
    ("yaskawa-jbi", {"measure_argument": -7}, "SET I000 -7\nCALL JOB:MEASURE\n"),
    ("yaskawa-jbi", {"keep": "register", "first_register": 12}, "MEASURE\nGETS PX012 $PX000\nEND"),
    ("staubli-val3", {"settle_s": 0, "measure_call": None}, "-delay(", "-call ", "-bGo"),
    ("staubli-val3", {"settle_s": 1e-9}, "delay(0.001)"),
    ("staubli-val3", {"measure_call": "probe", "measure_argument": None}, "call probe()", "-x_nN"),
    ("staubli-val3", {"measure_argument": -7}, "call MEASURE(-7)"),
    ("mitsubishi-melfa", {"settle_s": 0, "measure_call": None}, " Dly 0.100\n", "-CallP"),
    ("mitsubishi-melfa", {"measure_argument": None}, ' CallP "MEASURE"\n'),
    ("mitsubishi-melfa", {"measure_argument": -4}, ' CallP "MEASURE",-4\n'),
    ("kawasaki-as", {"settle_s": 0, "measure_call": None}, "TWAIT 0.100\n", "-CALL"),
    ("kawasaki-as", {"measure_argument": None}, "CALL MEASURE()\n"),
    ("kawasaki-as", {"measure_argument": -4}, "CALL MEASURE(-4)\n"),
    ("ros-trajectory", {"settle_s": 0}, "-hold"),
]


@pytest.mark.parametrize(("name", "options", "texts"), [(n, o, t) for n, o, *t in SAID])
def test_options_are_said(name: str, options: dict[str, Any], texts: list[str]) -> None:
    text = texts_of(program_of(name, **options), name)
    for wanted in texts:
        assert (wanted.removeprefix("-") in text) != wanted.startswith("-"), wanted


# What one dialect refuses; "remark" and "program" are that of a pose and the name.
REFUSED = [
    ("fanuc-ls", {"user_frame": 10}, "user_frame is 10, outside 0 to 9"),
    ("fanuc-ls", {"tool_frame": 11}, "tool_frame is 11, outside 0 to 10"),
    ("fanuc-ls", {"comment": 'a "b"'}, "cannot stand in a comment"),
    ("fanuc-ls", {"comment": "a; b"}, "cannot stand in a comment"),
    ("fanuc-ls", {"remark": "a;b"}, "cannot stand in a comment"),
    ("fanuc-ls", {"measure_call": "measure"}, "is not a FANUC program name"),
    ("fanuc-ls", {"keep": "register", "first_register": 101}, r"would need PR\[101\]"),
    ("fanuc-ls", {"measure_output": 1, "measure_pulse_s": 0.05}, "measure_pulse_s is 0.05"),
    ("fanuc-ls", {"measure_output": 1, "measure_pulse_s": 25.6}, "measure_pulse_s is 25.6"),
    ("kuka-krl", {"comment": "endfold"}, "would hide the lines"),
    ("kuka-krl", {"measure_call": "ptp"}, "is not a KUKA program name"),
    ("kuka-krl", {"measure_call": "Xp3"}, "is the name of a position"),
    ("kuka-krl", {"measure_call": "fp12"}, "is the name of a position"),
    ("kuka-krl", {"tool_frame": 17}, "tool_frame is 17"),
    ("kuka-krl", {"measure_output": 1, "measure_pulse_s": 3.1}, "measure_pulse_s"),
    *[("kuka-krl", {"program": p}, p) for p in ("end", "E6Pos", "xm", "XP1")],
    ("abb-rapid", {"measure_call": "endproc"}, "is not a RAPID name"),
    ("abb-rapid", {"measure_call": "main"}, "is not a RAPID name"),
    ("abb-rapid", {"measure_call": "jP3"}, "is the name of a position"),
    ("abb-rapid", {"measure_call": "CALPOSE_run"}, "would call itself"),
    ("abb-rapid", {"measure_output": 1, "measure_pulse_s": 0.0}, "measure_pulse_s"),
    *[("abb-rapid", {"program": p}, p) for p in ("module", "Base", "jMeasured", "p1")],
    ("ur-script", {"measure_output": 8}, "measure_output is 8"),
    ("ur-script", {"comment": 'say "go"'}, "cannot stand in a comment"),
    ("ur-script", {"comment": "back\\slash"}, "cannot stand in a comment"),
    ("ur-script", {"measure_call": "while"}, "is not a URScript name"),
    ("ur-script", {"measure_call": "sleep"}, "is not a URScript name"),
    *[("ur-script", {"remark": r}, "comment of pose") for r in ('"', "POSE 7", "PROGRAM x")],
    ("ur-script", {"remark": "PLAN 12345"}, "would be read as what the program says"),
    *[("ur-script", {"program": p}, "is not a URScript name") for p in ("cal-1", "end", "movej")],
    ("yaskawa-jbi", {"tool_frame": 64}, "tool_frame is 64"),
    ("yaskawa-jbi", {"measure_output": 1, "measure_pulse_s": 0.0}, "measure_pulse_s is 0"),
    ("yaskawa-jbi", {"measure_call": "measure"}, "is not a Yaskawa job name"),
    ("yaskawa-jbi", {"keep": "register", "first_register": 128}, "variable P128"),
    *[("yaskawa-jbi", {"remark": r}, "comment of pose") for r in ("POSE 7", "PULSES S 1")],
    ("yaskawa-jbi", {"remark": "PLAN 12345"}, "would be read as what the program says"),
    ("yaskawa-jbi", {"form": "cartesian", "user_frame": 0}, "need its number"),
    *[("yaskawa-jbi", {"program": p}, "is not a Yaskawa job name") for p in ("cal", "CAL-1")],
    ("staubli-val3", {"measure_output": 16}, "measure_output is 16"),
    ("staubli-val3", {"comment": "a ]]> b"}, "would end the code"),
    ("staubli-val3", {"measure_call": "start"}, "is not a VAL 3 name"),
    ("staubli-val3", {"measure_call": "jPose"}, "is the name of data"),
    *[("staubli-val3", {"program": p}, "is not a VAL 3 name") for p in ("../cal", "a/b", "end")],
    *[
        (name, {option: value}, said)
        for name in ("ros-trajectory", "moveit-joints", "robot-calibration", "robodk-csv")
        for option, value, said in [
            ("measure_output", 3, "switches no output"),
            ("keep", "register", "keep no registers"),
            ("pose", "a\nb", "name of a pose"),
            ("pose", "a\x85b", "name of a pose"),
        ]
    ],
    *[
        (name, {"via": True}, "no poses to capture")
        for name in ("moveit-joints", "robot-calibration")
    ],
    ("mitsubishi-melfa", {"keep": "register"}, "keep no registers"),
    *[
        (name, {"remark": remark}, "would be read as what the program says")
        for name in ("mitsubishi-melfa", "kawasaki-as", "doosan-drl", "denso-pac")
        for remark in ("POSE 2 Other", " PLAN 12345")
    ],
    *[
        (name, {"comment": "PLAN 1a2b3c4d 27"}, "would be read as the mark of another plan")
        for name in ("abb-rapid", "mitsubishi-melfa", "kawasaki-as", "doosan-drl", "denso-pac")
    ],
]


@pytest.mark.parametrize(("name", "changes", "message"), REFUSED)
def test_what_a_controller_would_refuse(name, changes, message, tmp_path):
    options = dict(changes)
    pose = ProgramPose(
        options.pop("pose", "T9"),
        middle(name),
        options.pop("remark", ""),
        options.pop("via", False),
    )
    refuse(
        program_of(name, [pose], options.pop("program", "CALPOSE"), **options),
        name,
        message,
        tmp_path,
    )


def test_a_trajectory_takes_no_longer_than_a_duration_can_say(tmp_path):
    name = "ros-trajectory"
    poses = [ProgramPose(f"P{k}", middle(name)) for k in range(2148)]
    program = program_of(name, poses, "CALPOSE", settle_s=1e6)
    refuse(program, name, "longer than 2147483647 s", tmp_path)


@each_dialect
def test_names_of_programs(name: str, tmp_path: Path) -> None:
    how, rule = HOW[name], DIALECTS[name].names
    program = program_of(name)
    for bad in (
        "",
        "7UP",
        "MY CAL",
        "Ä",
        "A\n",
        "CAL-1",
        "../CAL",
        "X" * (how.name + 1),
        *rule.reserved,
    ):
        error = refuse(replace(program, name=bad), name, f"is not {rule.what}", tmp_path)
        proposed = re.search(r"for instance (\w+):", error.hint)
        assert proposed
        rule.check(proposed[1])
    longest = "X" * how.name
    assert longest in texts_of(replace(program, name=longest), name) + str(
        DIALECTS[name].files(replace(program, name=longest)).keys()
    )


@given(st.text())
def test_every_proposed_name_is_legal(name: str) -> None:
    for dialect in DIALECTS.values():
        dialect.names.check(dialect.names.legal(name))


PROPOSED = {
    "CALIBRATION": "CALIBRAT",
    "cal pose": "CAL_POSE",
    "7up": "P7UP",
    "_x": "X",
    "": "CALPOSE",
    "é": "CALPOSE",
    "ABCDEFG-H": "ABCDEFG",
    "A\n": "A",
}


def test_proposed_names_are_near_the_one_given() -> None:
    for name, proposal in PROPOSED.items():
        assert DIALECTS["fanuc-ls"].names.legal(name) == proposal
    assert DIALECTS["moveit-joints"].names.legal("a b") == "a_b"


@each_asked
def test_names_of_the_program_that_measures(name: str, tmp_path: Path) -> None:
    how, rule = HOW[name], DIALECTS[name].names
    for bad in ("", "7UP", "MY MEASURE", "X" * (how.name + 1)):
        refuse(program_of(name, measure_call=bad), name, f"is not {rule.what}", tmp_path)
    longest = "M" * how.name
    assert longest in texts_of(program_of(name, measure_call=longest), name)
    if name == "staubli-val3":  # its programs are files of the project, which has another name
        return
    refuse(program_of(name, measure_call="CALPOSE"), name, "CALPOSE would call itself", tmp_path)
    if rule.small:
        refuse(program_of(name, measure_call="CalPose"), name, "would call itself", tmp_path)


@each_dialect
def test_texts_that_cannot_stand_in_a_comment(name: str, tmp_path: Path) -> None:
    how = HOW[name]
    bad = ["two\nlines", "a\rb", "a\tb"]
    for most, said in ((how.text, "comment"), (how.remark, "comment of pose 'T1'")):
        for text in [*bad, *(["é", "x" * (most + 1)] if most else [])]:
            options = {"comment": text} if said == "comment" else {}
            poses = [ProgramPose("T1", middle(name), "" if options else text)]
            refuse(program_of(name, poses, **options), name, re.escape(said), tmp_path)
    longest = program_of(
        name, [ProgramPose("T1", middle(name), "y" * how.remark)], comment="x" * how.text
    )
    assert "x" * how.text in texts_of(longest, name)
    assert "y" * how.remark in texts_of(longest, name)


@each_case
def test_a_joint_beyond_all_arms_names_its_pose(name: str, form: str, tmp_path: Path) -> None:
    most = HOW[name].most_deg
    for value in (most + 0.1, -most - 1.0, 1e308):
        q = middle(name)
        q[3] = np.radians(value)
        poses = [ProgramPose("T1", middle(name)), ProgramPose("far", q)]
        refuse(program_of(name, poses, form=form), name, "pose 'far': J4 is", tmp_path)


@each_dialect
def test_poses_of_another_arm(name: str, tmp_path: Path) -> None:
    maker = DIALECTS[name].maker
    n = robot_of(name).n
    other = program_of(name, [ProgramPose("T1", np.zeros(n + 1))])
    refuse(other, name, f"the poses have {n + 1} joint values, the arm {n}", tmp_path)
    if maker is not None:
        refuse(
            *(replace(other, arm=None), name),
            *(f"has {n + 1} joint values, an arm of {maker} has", tmp_path),
        )
        strange = replace(
            program_of(name),
            arm=replace(other.arm, robot=None, controller=Arm.usual(None, n).controller),
        )
        refuse(strange, name, "the arm has an unknown controller", tmp_path)
        if maker == "franka":
            return
        panda = replace(program_of(name), arm=Arm.of(robot_of("moveit-joints")))
        refuse(panda, name, "joint values, the arm 7|controller of franka", tmp_path)


@pytest.mark.parametrize("name", POSED)
def test_poses_of_the_tool_need_the_robot(name: str, tmp_path: Path) -> None:
    program = replace(program_of(name, form="cartesian"), arm=Arm.usual(DIALECTS[name].maker))
    refuse(program, name, "need the robot", tmp_path)
    ((file, text), *_) = DIALECTS[name].files(program_of(name, form="cartesian")).items()
    (position,) = dialect_of(name).parse(text.encode(), Path(file)).positions
    with pytest.raises(InputError, match="need the robot"):
        postures_of((replace(position, shown_deg=None),), program.arm)


@pytest.mark.parametrize("name", [name for name in DIALECTS if (name, "cartesian") not in CASES])
def test_lists_of_joints_have_no_poses(name: str, tmp_path: Path) -> None:
    refuse(program_of(name, form="cartesian"), name, "has no cartesian form", tmp_path)


@pytest.mark.parametrize("name", [name for name, how in HOW.items() if how.wait_s])
def test_a_time_to_settle_is_no_longer_than_the_controller_takes(name: str, tmp_path: Path) -> None:
    most = HOW[name].wait_s
    in_ms = {"denso-pac": "Delay", "comau-pdl": "DELAY"}.get(name)
    said = f"{in_ms} {1e3 * most:.0f}" if in_ms else f"{most:.2f}"
    assert said in texts_of(program_of(name, settle_s=most), name)
    refuse(program_of(name, settle_s=most + 0.01), name, "settle_s is", tmp_path)


def test_a_refused_program_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "CAL.LS"
    path.write_text("old")
    with pytest.raises(InputError):
        dialect_of("fanuc-ls").write(program_of("fanuc-ls", call="too long a name"), tmp_path)
    assert path.read_text() == "old"
    with pytest.raises(OutputError, match="the output folder cannot be made"):
        dialect_of("fanuc-ls").write(program_of("fanuc-ls"), path / "none")


@pytest.mark.parametrize(
    ("pulses", "message"),
    [
        ((), "has 0 values"),
        ((1.0,) * 5, "has 5 values"),
        ((*(1.0,) * 5, 0.0), "of T is 0"),
        ((*(1.0,) * 5, 2e6), "of T is 2"),
        ((float("nan"), *(1.0,) * 5), "of S is nan"),
    ],
)
def test_pulses_that_are_missing_are_asked_for(pulses, message, tmp_path):
    yaskawa = DIALECTS["yaskawa-jbi"]
    error = refuse(
        program_of("yaskawa-jbi", pulses_per_deg=pulses), "yaskawa-jbi", message, tmp_path
    )
    assert "S L U R B T in pulses/deg" in error.hint
    assert "ALL.PRM" in error.hint
    if pulses:
        with pytest.raises(InputError, match=message):
            yaskawa.reading(pulses)
    # what is known of the arm is taken where the program has none
    program = program_of("yaskawa-jbi")
    none = replace(program, options=replace(program.options, pulses_per_deg=()))
    assert dialect_of("yaskawa-jbi").files(none) == yaskawa.files(program)
    assert ProgramOptions().pulses_per_deg == ()
