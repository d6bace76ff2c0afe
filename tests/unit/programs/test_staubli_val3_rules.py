"""VAL 3 projects: each rule of the validator, by a file that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.programs import Arm, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.rules import MOST_PROBLEMS
from posedesign.programs.staubli_val3 import StaubliVal3
from posedesign.programs.staubli_val3.rules import check_staubli_val3
from tests.unit.programs.dialects import breaks, changed

POSES = tuple(ProgramPose(f"T{i}", np.radians([i, 20, 90, 10, -50, 6])) for i in (1, -1))
ARM = Arm.of(Robot.preset("tx2_60"))


def project(form: str) -> dict[str, str]:
    options = ProgramOptions(  # type: ignore[arg-type]
        form=form, fingerprint="abcdef12", keep="register", measure_output=3, comment="cell 7"
    )
    files = StaubliVal3().render(PoseProgram("Calpose", POSES, options), ARM)
    return {Path(name).name: text for name, text in files.items()}


JOINT, POSED = project("joint"), project("cartesian")
DATA, POINTS, PROJECT, START, CALLED = (
    "Calpose.dtx",
    "Calpose.dtx ",
    "Calpose.pjx",
    "start.pgx",
    "MEASURE.pgx",
)
SOURCES = {**JOINT, POINTS: POSED[DATA]}


def check(text: str, path: Path) -> list[Problem]:
    """Problems, notes left out."""
    found = check_staubli_val3(text.encode("utf-8"), path)
    return [problem for problem in found if problem.level != "note"]


def written(folder: Path, files: dict[str, str]) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def program(code: str, inside: str = "") -> str:
    head, _, _ = JOINT[CALLED].partition("    <Parameters")
    return f"{head}{inside}<Code><![CDATA[begin\n{code}\nend]]></Code></Program></Programs>"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (DATA, "<Datas>", "<!-- caf\u00e9 --><Datas>"),
        (DATA, 'j1="1.00000"', 'j1="1"'),
        (DATA, ' j1="1.00000"', ""),
        (DATA, 'j1="1.00000"', 'j1="-5.5e-15"'),
        (DATA, 'rx="0.00000"', 'rx="-180"'),
        (POINTS, "lefty", "ssame"),
        (POINTS, 'fatherId="fUser[0]"', 'fatherId="world[0]"'),
        (POINTS, 'fatherId="fUser[0]"', 'fatherId="cell:fUser[0]"'),
        (START, "  delay(1.000)\n", "  if bGo\n    delay(1)\n  else\n    delay(2)\n  endIf\n"),
        (START, "  delay(1.000)\n", "  for nTraj=0 to 1\n  // endIf\n    delay(1)\n  endFor\n"),
        (START, "<Code>", "<Locals />\n<Code>\n\n"),
        # a project with enumerations and libraries: ros-industrial/staubli_val3_driver, s7.9
        (DATA, 'type="num" size="1">\n    </Data>', 'type="num" size="1" />'),
        (DATA, 'type="num" size="1">', 'type="JointTraj" size="1">'),
        (DATA, "<Datas>", '<Datas><Data name="nDo" type="num" size="9" xsi:type="array" />'),
        (
            DATA,
            "<Datas>",
            '<Datas><Data name="msg" type="RosMsg" size="1" xsi:type="array"><Value key="0">'
            '<Field name="nData" xsi:type="array" type="num" size="12" /></Value></Data>',
        ),
        # points without words for the arm: nachosandovall/staubli-pick-and-place
        (POINTS, ' shoulder="lefty" elbow="epositive" wrist="wnegative"', ""),
        # a table: txellgalletto/TFG-Robot-Program, s8
        (
            DATA,
            "<Datas>",
            '<Datas><Data name="nInertia" xsi:type="array" type="num" size="3 3">'
            '<Value key="0,0" value="0.3" /><Value key="2,2" value="0.2" /></Data>',
        ),
    ],
)
def test_what_controllers_write_too_is_accepted(name: str, old: str, new: str) -> None:
    text = SOURCES[name]
    assert check(changed(text, old, new), Path(name.strip())) == []


@pytest.mark.parametrize(
    "code",
    [
        "call lib:init()\nlib:nMode=lib:MODE_A",  # CarlosHagio/CS8C
        "switch nId\ncase lib:A,lib:B\nn=2\nbreak\ndefault\nbreak\nendSwitch",
        'taskCreate sPre+toString("",n),10,exe(n,movel(p,t,m),p)',  # alejho/VAL3-Signals
        'taskCreateSync "servo",0.004,bOver,servo()\nwait(taskStatus("a b")==-1 or !bGo)',
        'msg.body.nData[n+1]=nType["JOINT"]\nif(a<b and !c)\nelseIf (-a==2)\nendIf',
        "movej(appro(p,{0,0,-100*n,0,0,0}),flange,mNomSpeed)",  # evamatvi, s6.8
        's.body.nData[44]=power(2,3)\nuserPageSet("main")',
        "$setVel(mVel)\nwhile true\ndo\nuntil false\nendWhile",  # ICube-Robotics, s8
        'put("say \\"no\\" // no remark") // a remark\nlogMsg("late", 2)',
    ],
)
def test_statements_of_others(code: str) -> None:
    assert check(program(code), Path(CALLED)) == []


def test_a_program_of_the_older_xml(tmp_path: Path) -> None:
    code = "begin\nput(&quot;&lt;-&quot;)\nmovej(pA,flange,mNom)\nend"
    text = f"""<programList xmlns="ProgramNameSpace"><program name="a"><source>
        <code>{code}</code></source></program></programList>"""
    assert check(text, tmp_path / "a.pgx") == []
    assert {p.rule for p in check(text.replace("mNom)", "mNom"), tmp_path / "a.pgx")} == {"syntax"}
    assert check('<dataList xmlns="DataNameSpace" />', tmp_path / "a.dtx") == []


ONE_RULE = [
    ("xml", DATA, "</Datas>", "", "mismatched tag"),
    ("xml", DATA, "<Database", "<!DOCTYPE a []><Database", "has a DTD or entities"),
    ("xml", START, "]]>", "", "unclosed CDATA"),
    ("xml", DATA, "<Value ", "<Vlue ", "Vlue' is in Data"),
    ("xml", DATA, "<Datas>", "<Datas>>", "'>' stands in Datas"),
    ("xml", PROJECT, "  <Programs>", "  <Programs /><Programs>", "Project has 2 Programs"),
    ("xml", DATA, 'encoding="utf-8"', 'encoding="utf8"', "begins with"),
    ("root", DATA, "/Data/2", "/Date/2", "is not Database of VAL 3"),
    ("root", START, "XMLSchema-instance", "XMLSchema", "xsi is none"),
    ("data-name", DATA, '"jPose"', '"jActual"', "there twice"),
    ("number", DATA, 'key="0" value="1"', 'key="0" value="1_0"', "nFirst[0] is '1_0', not a"),
    (
        "attributes",
        DATA,
        'type="num" size="1">\n      <Value key="0" value="1"',
        'type="bool" size="1">\n      <Value key="0" value="1"',
        "nFirst[0] is '1'",
    ),
    ("data-type", DATA, 'type="num"', 'type="numm"', "'numm'"),
    ("keys", DATA, 'key="1"', 'key="0"', "jPose[0] is none of 2"),
    ("keys", DATA, 'key="1"', 'key="2"', "jPose[2] is none of 2"),
    ("keys", DATA, 'size="2"', 'size="3"', "has 2 positions, its size is 3"),
    ("attributes", DATA, '"jPose"', '"7Pose"', "name is '7Pose'"),
    ("attributes", DATA, 'xsi:type="array" type="num"', 'type="num"', "is missing"),
    ("attributes", POINTS, ' wrist="', ' wrst="', "wrst is 'wnegative'"),
    ("attributes", DATA, ' j1="1.00000"', ' j1="1.00000" j7="1"', "j7"),
    ("attributes", POINTS, "lefty", "left", "shoulder is 'left'"),
    ("attributes", POINTS, "epositive", "wpositive", "elbow is 'wpositive'"),
    ("number", DATA, 'j1="1.00000"', 'j1="1_0"', "j1 is '1_0'"),
    ("number", DATA, 'j1="1.00000"', 'j1="nan"', "j1 is 'nan'"),
    ("number", DATA, 'j1="1.00000"', f'j1="{"1" * 400}"', "not a plain number"),
    ("range", DATA, 'j1="1.00000"', 'j1="721.0"', "j1 is '721.0'"),
    ("range", DATA, 'x="0.0000"', 'x="100001"', "x is '100001'"),
    ("range", DATA, 'accel="100"', 'accel="-100"', "accel is"),
    ("range", DATA, 'rx="0.00000"', 'rx="361"', "rx is '361'"),
    ("father", POINTS, 'fatherId="fUser[0]"', 'fatherId="fPart[0]"', "'fPart[0]' is not there"),
    ("father", DATA, 'fatherId="world[0]"', 'fatherId="world"', "'world' is not there"),
    ("project-files", PROJECT, "MEASURE.pgx", "start.pgx", "'start.pgx' is there twice"),
    ("project-files", PROJECT, "Calpose.dtx", "Capose.dtx", "'Capose.dtx' is not there"),
    ("program-name", START, '<Program name="start"', '<Program name="begin"', "holds ['begin']"),
    ("syntax", START, "  delay(1.000)\n", "  stand still\n", "'still' cannot stand behind"),
    ("syntax", START, "delay(1.000)", "delay(1_0)", "'_0)' cannot stand behind"),
    ("syntax", START, "tTool[0],", "tTool[0]", "cannot stand behind"),
    ("code", START, "\nend]", "\n]", "does not begin with begin and end with end"),
    ("code", START, "  delay(1.000)\n", "  if bGo\n", "'if bGo' is never closed"),
    ("code", START, "  delay(1.000)\n", "  endWhile\n", "'endWhile' closes nothing"),
    ("function", START, "  delay(1.000)\n", "  delai(1)\n", "delai is no function"),
    ("function", START, "delay(1.000)", "delay()", "delay takes 1 arguments, not 0"),
    ("function", START, ",mMeasure", "", "movej takes 3 arguments, not 2"),
    ("function", START, "call MEASURE", "MEASURE", "MEASURE is a program"),
    ("name", START, "bGo", "bGoo", "bGoo is neither"),
    ("name", START, "delay(1.000)", "delay(end)", "end is a word of VAL 3"),
    ("target", START, "[0],tTool", "[2],tTool", "jPose[2] is beyond its size 2"),
    ("target", START, "movej(jPose[0]", "movel(jPose[0]", "jPose[0] is of type jointRx, not"),
    ("target", START, "tTool[0]", "mMeasure", "mMeasure is of type mdesc, not tool"),
    ("target", START, "call MEASURE", "call PROBE", "PROBE is no program of the project"),
    ("target", START, "MEASURE(1)", "MEASURE()", "MEASURE takes 1 arguments, not 0"),
    ("wait-to-measure", START, "  waitEndMove()\n", "", "no waitEndMove()"),
    ("unused", START, "[1],tTool", "[0],tTool", "1 of 2 positions in jPose are never moved to"),
]


@pytest.mark.parametrize(("rule", "name", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(rule, name, old, new, message, tmp_path):
    files = {**JOINT, START: JOINT[START].replace("resetMotion()", "bGo=false")}
    text = POSED[DATA] if name == POINTS else files[name]
    path = written(tmp_path, files) / name.strip()
    problems = check(changed(text, old, new), path)
    breaks(problems, rule, message, *(["unused"] if rule == "target" else []))
    told = {p.level for p in problems if p.rule == rule}
    measuring = rule in ("wait-to-measure", "unused") or "positions" in message
    assert told == {"measuring" if measuring else "error"}


def test_problems_name_their_lines() -> None:
    text = JOINT[START].replace("call MEASURE(2)", "call MEASURE(2")
    line = next(i for i, row in enumerate(text.splitlines(), 1) if "URE(2" in row)
    assert [(p.line, p.rule) for p in check(text, Path(START))] == [(line, "syntax")]
    text = JOINT[DATA].replace('j1="1.00000"', 'j1="1_0"', 1)
    line = next(i for i, row in enumerate(text.splitlines(), 1) if "1_0" in row)
    assert [(p.line, p.rule) for p in check(text, Path(DATA))] == [(line, "number")]


def test_what_cannot_be_known_is_noted() -> None:
    text = program("vendorThing(1)")
    assert [p.level for p in check_staubli_val3(text.encode(), Path(CALLED))] == ["note"]
    text = JOINT[DATA].replace('"nTraj"', '"nNameOfTheNextMove"')
    assert [p.level for p in check_staubli_val3(text.encode(), Path(DATA))] == ["note"]


def test_a_file_of_rubbish_is_not_told_without_end() -> None:
    text = JOINT[DATA].replace("<Datas>", "<Datas>" + '<Data name="" />' * 5000)
    assert len(check(text, Path(DATA))) == MOST_PROBLEMS
    for rubbish in ("\n" * 3_000_000, "," * 3_000_000, "(" * 50_000, "x(" * 9000, "1" * 9000):
        assert check(program(rubbish), Path(CALLED)) or not rubbish.strip()
