"""VAL 3 projects: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.programs import Arm, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.staubli_val3 import StaubliVal3, rules
from posedesign.programs.staubli_val3.rules import MOST_PROBLEMS, check_staubli_val3

POSES = tuple(ProgramPose(f"T{i}", np.radians([i, 20, 90, 10, -50, 6])) for i in (1, -1))
ARM = Arm.of(Robot.preset("tx2_60"))


def project(form: str) -> dict[str, str]:
    options = ProgramOptions(form=form, fingerprint="abcdef12", keep="register")  # type: ignore[arg-type]
    files = StaubliVal3().render(PoseProgram("Calpose", POSES, options), ARM)
    return {Path(name).name: text for name, text in files.items()}


JOINT, POSED = project("joint"), project("cartesian")
DATA, POINTS, PROJECT, START = "Calpose.dtx", "Calpose.dtx ", "Calpose.pjx", "start.pgx"
SOURCES = {**JOINT, POINTS: POSED[DATA]}


def check(text: str, name: str) -> list[Problem]:
    return check_staubli_val3(text.encode("utf-8"), Path(name.strip()))


def test_good_files_have_no_problems(tmp_path: Path) -> None:
    for files in (JOINT, POSED):
        for name, text in files.items():
            assert check(text, name) == []
            (tmp_path / name).write_bytes(text.replace("\n", "\r\n").encode())
        for name in files:
            assert StaubliVal3().validate(tmp_path / name) == []


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (DATA, "<Datas>", "<!-- caf\u00e9 --><Datas>"),
        (DATA, 'j1="1.00000"', 'j1="1"'),
        (DATA, ' j1="1.00000"', ""),
        (DATA, 'j1="1.00000"', 'j1="-0.000"'),
        (POINTS, "lefty", "ssame"),
        (POINTS, 'fatherId="fUser[0]"', 'fatherId="world[0]"'),
        (START, "  delay(1.000)\n", "  if bGo\n    delay(1)\n  else\n    delay(2)\n  endIf\n"),
        (START, "  delay(1.000)\n", "  for nTraj=0 to 1\n  // endIf\n    delay(1)\n  endFor\n"),
        (START, "<Code>", "<Locals />\n<Code>\n\n"),
    ],
)
def test_what_controllers_write_too_is_accepted(name: str, old: str, new: str) -> None:
    text = SOURCES[name]
    assert old in text
    assert check(text.replace(old, new, 1), name) == []


ONE_RULE = [
    ("xml", DATA, "</Datas>", "", "mismatched tag"),
    ("xml", DATA, "<Datas>", "<Datas>&x;", "undefined entity"),
    ("xml", DATA, "<Database", "<!DOCTYPE a []><Database", "DTDForbidden"),
    ("xml", START, "]]>", "", "unclosed CDATA"),
    ("root", DATA, "/Data/2", "/Date/2", "is not Database of VAL 3"),
    ("root", PROJECT, "/Project/3", "/Project/x", "is not Project of VAL 3"),
    ("data-name", DATA, '"jPose"', '"jPosesOfTheWeek1"', "is no name"),
    ("data-name", DATA, '"jPose"', '"7Pose"', "is no name"),
    ("data-name", DATA, '"jPose"', '"jActual"', "there twice"),
    ("data-type", DATA, 'type="num"', 'type="number"', "'number'"),
    ("data-type", DATA, 'xsi:type="array" type="num"', 'type="num"', "'num'"),
    ("keys", DATA, 'key="1"', 'key="0"', "jPose[0] is none of 2"),
    ("keys", DATA, 'key="1"', 'key="2"', "jPose[2] is none of 2"),
    ("keys", DATA, 'size="2"', 'size="3"', "has 2 values, its size is 3"),
    ("attributes", POINTS, ' wrist="', ' wrst="', "lacks or should not have wrist wrst"),
    ("attributes", DATA, ' j1="1.00000"', ' j1="1.00000" j7="1"', "j7"),
    ("attributes", POINTS, ' shoulder="lefty"', "", "shoulder"),
    ("number", DATA, 'j1="1.00000"', 'j1="1e0"', "j1 is '1e0'"),
    ("number", DATA, 'j1="1.00000"', 'j1="nan"', "j1 is 'nan'"),
    ("range", DATA, 'j1="1.00000"', 'j1="721.0"', "j1 is 721.0"),
    ("range", DATA, 'x="0.0000"', 'x="10001"', "x is 10001"),
    ("range", DATA, 'rx="0.00000"', 'rx="-180.00000"', "rx is -180.00000"),
    ("config", POINTS, "lefty", "left", "shoulder 'left'"),
    ("config", POINTS, "epositive", "wpositive", "elbow 'wpositive'"),
    ("father", POINTS, 'fatherId="fUser[0]"', 'fatherId="fPart[0]"', "'fPart[0]', which is not"),
    ("father", DATA, 'fatherId="world[0]"', 'fatherId="world"', "'world', which is not"),
    ("project-files", PROJECT, '    <Program file="stop.pgx" />\n', "", "missing ['stop.pgx']"),
    ("project-files", PROJECT, "MEASURE.pgx", "start.pgx", "twice ['start.pgx']"),
    ("project-files", PROJECT, '    <Data file="Calpose.dtx" />\n', "", "0 data files"),
    ("project-files", PROJECT, "MEASURE.pgx", "MEASURE.txt", "'MEASURE.txt' is no program"),
    ("program-name", START, '<Program name="start"', '<Program name="begin"', "holds ['begin']"),
    ("code", START, "[begin", "[beginn", "does not begin with begin"),
    ("code", START, "\nend]", "\n]", "does not begin with begin and end with end"),
    ("code", START, "  delay(1.000)\n", "  if bGo\n", "endif is missing"),
    ("code", START, "  delay(1.000)\n", "  endWhile\n", "endwhile closes nothing"),
    ("identifier", START, "call MEASURE", "call " + "M" * 16, "is no name"),
    ("identifier", START, "movej(jPose", "movej(jPosesOfTheWeek1", "is no name"),
    ("instruction", START, "  delay(1.000)\n", "  delai(1)\n", "delai is no function"),
    ("instruction", START, "  delay(1.000)\n", "  stand still\n", "'stand still' is no instr"),
    ("instruction", START, "  delay(1.000)\n", "  nTraj=delai(1)\n", "delai is no function"),
    ("target", START, "movej(jPose[0]", "movej(jPose[2]", "jPose[2] is beyond its size 2"),
    ("target", START, "movej(jPose[0]", "movej(jPark[0]", "jPark is not in the data file"),
    ("target", START, "movej(jPose[0]", "movej(fUser[0]", "fUser is of type frame, not pointRx or"),
    ("target", START, "movej(jPose[0]", "movel(jPose[0]", "jPose is of type jointRx, not pointRx"),
    ("target", START, "tTool[0]", "mMeasure", "mMeasure is of type mdesc, not tool"),
    ("target", START, ",mMeasure", "", "movej takes 3 arguments"),
    ("target", START, "call MEASURE", "call PROBE", "there is no program PROBE"),
    ("wait-to-measure", START, "  waitEndMove()\n", "", "no waitEndMove()"),
]


@pytest.mark.parametrize(("rule", "name", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(
    rule: str, name: str, old: str, new: str, message: str, tmp_path: Path
) -> None:
    assert old in SOURCES[name]
    if rule == "target":
        for file, text in JOINT.items():
            (tmp_path / file).write_text(text)
    path = tmp_path / name.strip()
    problems = check_staubli_val3(SOURCES[name].replace(old, new, 1).encode(), path)
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
    text = JOINT[START].replace("call MEASURE(2)", "call " + "M" * 16 + "(2)")
    line = next(i for i, row in enumerate(text.splitlines(), 1) if "MMMM" in row)
    assert [(p.line, p.rule) for p in check(text, START)] == [(line, "identifier")]
    text = JOINT[DATA].replace('j1="1.00000"', 'j1="1e0"', 1)
    line = next(i for i, row in enumerate(text.splitlines(), 1) if "1e0" in row)
    assert [(p.line, p.rule) for p in check(text, DATA)] == [(line, "number")]


def test_a_file_of_rubbish_is_not_told_without_end() -> None:
    text = JOINT[DATA].replace("<Datas>", "<Datas>" + '<Data name="" />' * 5000)
    assert len(check(text, DATA)) == MOST_PROBLEMS


def test_an_empty_file_has_a_problem() -> None:
    for name in SOURCES:
        assert [p.rule for p in check("", name)] == ["xml"]
