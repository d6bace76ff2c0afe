"""ABB RAPID: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from calib.se3 import transform
from posedesign.programs import (
    Arm,
    Load,
    PoseProgram,
    Problem,
    ProgramOptions,
    ProgramPose,
    validate,
)
from posedesign.programs.abb_rapid import AbbRapid, rules
from posedesign.programs.abb_rapid.rules import MOST_PROBLEMS
from posedesign.programs.abb_rapid.writer import render_abb_rapid

POSES = tuple(ProgramPose(f"T{i}", np.radians([i, 10, 20, 4, 30, 6]), via=i == 1) for i in range(3))
ARM = Arm.of(
    Robot.preset("irb120"),
    transform(np.eye(3), [0.3, 0, 0]),
    transform(np.eye(3), [0, 0, 0.1]),
    Load(1.0, np.array([0, 0, 0.05])),
)
JOINT, POSE = (
    render_abb_rapid(
        PoseProgram(
            "CAL",
            POSES,
            ProgramOptions(form=form, fingerprint="abcdef12", measure_output=3, keep="register"),
        ),
        ARM,
    )
    for form in ("joint", "cartesian")
)
JP1 = re.search(r"LOCAL CONST jointtarget jp1:=(.*);", JOINT)
assert JP1


def check(text: str, name: str = "CAL.mod") -> list[Problem]:
    return AbbRapid().check(text.replace("\n", "\r\n").encode("latin-1"), Path(name))


@pytest.mark.parametrize("text", [JOINT, POSE])
def test_a_good_module_has_no_problems(tmp_path: Path, text: str) -> None:
    assert check(text) == []
    path = tmp_path / "CAL.modx"
    path.write_text(text)
    assert validate(path) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("MODULE CAL", "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\nMODULE CAL"),
        ("MODULE CAL", "MODULE CAL(SYSMODULE, NOSTEPIN)"),
        ("  PROC main()", "  VAR num n:=1E-05;\n  CONST num m;\n  PROC main()"),
        ("  PROC main()", "  FUNC num f(num a)\n  RETURN a;\n  ENDFUNC\n  PROC main()"),
        ("  PROC main()", '  VAR string s:="nan; ! (";\n  PROC main()\n    VAR num k;'),
        ("MEASURE 1;", "IF a=1 THEN\n MEASURE 1;\n ELSE\n MEASURE 2;\n ENDIF"),
        ("MEASURE 1;", "IF a=1 MEASURE 1;"),
        ("MEASURE 1;", "FOR i FROM 1 TO 3 DO\n MEASURE -1;\n ENDFOR"),
        ("MEASURE 1;", "TEST a\n CASE 1:\n MEASURE 1;\n DEFAULT:\n MEASURE 2;\n ENDTEST"),
        ("MEASURE 1;", "MEASURE\n 1\n ;"),
        ("  PROC main()", "PROC go()\nMoveAbsJ jp1,v5,z1,tool0;\nENDPROC\nPROC f()\nMEASURE 1;\n"
         "ENDPROC\n  PROC main()"),
        ("MoveAbsJ jp1", "MoveAbsJ \\Conc, jp1"),
        ("MEASURE 1;", 'TPWrite "a;b" \\Num:=3;'),
        ("MEASURE 1;", "a{1}.x:=-(3-0);"),
        ("MEASURE 1;", "again:\n MEASURE 1;"),
        ("WaitTime\\InPos,1.00;", "WaitRob \\InPos;"),
        ("WaitTime\\InPos,1.00;", "WaitTime \\InPos, 0.5+a;\nWaitTime 2;"),
        ("jp1\\NoEOffs,vmax,fine,tCalib",
         "jp1 \\ID:=3\\NoEOffs, v100\\T:=5, fine \\Inpos:=inpos50, tCalib\\TLoad:=load0"),
        ("  PROC main()", "  VAR speeddata vMine:=[1,1,1,1];\n  VAR zonedata zMine;\n"
         "PROC go(VAR jointtarget target,\\num n)\nMoveAbsJ target,vMine,zMine,tool0;\n"
         "ENDPROC\n  PROC main()"),
        ("  PROC main()", "  VAR jointtarget j{3};\nPROC go(num n)\n"
         "MoveAbsJ j{n},[1,1,1,1],fine,tool0;\nENDPROC\n  PROC main()"),
        ("  PROC main()", "PROC go()\n"
         "MoveJSync [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z5,tool0,\"x\";\n"
         "MoveL Offs(CRobT(),0,0,5),v5,z5,tool0;\n"
         "ENDPROC\n  PROC main()"),
        ("MoveAbsJ jp1\\NoEOffs", "MoveAbsJ jp1"),
        ("9E9,9E9,9E9,9E9,9E9,9E9", "1.5,9E+09,9E9,9E9,9E9,9E9"),
        ("jp1\\NoEOffs", "[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,vmax,fine,tool0;\n"
         "MoveAbsJ jp1\\NoEOffs"),
        ("! P1 T0", "! (nan; -0 \""),
    ],
)  # fmt: skip
def test_what_controllers_and_people_write_too_is_accepted(old: str, new: str) -> None:
    text = JOINT if old in JOINT else POSE
    assert old in text
    assert check(text.replace(old, new, 1)) == []


LONG = "x" * 33
ONE_RULE = [
    ("encoding", JOINT, "! P1 T0", "! P1 T\u00e4", "0xe4"),
    ("encoding", JOINT, "! P1 T0", "! P1 T\0", "0x00"),
    ("module", JOINT, "MODULE CAL", "VAR num a;\nMODULE CAL", "MODULE is not the first"),
    ("module", JOINT, "ENDMODULE", "ENDMODULE\nmore;", "ENDMODULE is not the last"),
    ("module", JOINT, "MODULE CAL", "MODULE A\nENDMODULE\nMODULE CAL", "one module"),
    ("identifier", JOINT, "MODULE CAL", f"MODULE {LONG}", "32 in all"),
    ("identifier", JOINT, "MODULE CAL", "MODULE 1CAL", "'1CAL' is no name"),
    ("identifier", JOINT, "MODULE CAL", "MODULE ERROR", "'ERROR' is no name"),
    ("identifier", JOINT, "PROC main()", f"VAR num {LONG};\nPROC main()", "32 in all"),
    ("string", JOINT, "MEASURE 1", f'TPWrite "{"x" * 81}"', "81 characters"),
    ("string", JOINT, "MEASURE 1;", 'TPWrite "x;\n;', "not closed"),
    ("semicolon", JOINT, "    VelSet 100,5000;", "    VelSet 100,5000", "semicolon"),
    ("semicolon", JOINT, "MEASURE 1;\n", "MEASURE 1\n", "semicolon"),
    ("semicolon", JOINT, "PROC main", "VAR num a:=1\nVAR num b;\nPROC main", "is not ended"),
    ("statement", JOINT, "MEASURE 1", "1 MEASURE", "'1 MEASURE' is no statement"),
    ("semicolon", JOINT, "MEASURE 1", "MEASURE one two", "is not ended"),
    ("statement", JOINT, "PROC main", "CONST num;\nPROC main", "is no declaration"),
    ("brackets", JOINT, "CJointT()", "CJointT(", "( is not closed"),
    ("brackets", JOINT, "CJointT()", "CJointT())", ") closes nothing"),
    ("brackets", JOINT, "MEASURE 1", "MEASURE [1)", ") closes nothing"),
    ("block", JOINT, "ENDPROC\n", "", "PROC has no ENDPROC"),
    ("block", JOINT, "ENDPROC\n", "ENDIF\nENDPROC\n", "ENDIF closes nothing"),
    ("block", JOINT, "MEASURE 1;", "WHILE TRUE DO\nMEASURE 1;", "closes nothing"),
    ("declarations-first", JOINT, "VelSet 100", "VAR num a;\nVelSet 100", "behind an instruction"),
    ("declarations-first", JOINT, "ENDMODULE", "VAR num a;\nENDMODULE", "behind a routine"),
    ("position-format", JOINT, JP1[1], "[[1,2,3,4,5],[9E9,9E9,9E9,9E9,9E9,9E9]]", "jp1 has not"),
    ("position-format", JOINT, JP1[1], "[1,2,3,4,5,6]", "jp1 has not"),
    ("position-format", JOINT, "{2}:=[", "{3}:=[", "jMeasured{3} has 2 elements"),
    ("position-defined", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp9\\NoEOffs,vmax,fine,tool0;\n"
     "MoveAbsJ jp1", "jp9 is not declared"),
    ("unique", JOINT, "PROC main", f"CONST jointtarget JP1:={JP1[1]};\nPROC main", "JP1 is decl"),
    ("position-used", JOINT, "PROC main", f"CONST jointtarget jp9:={JP1[1]};\nPROC main", "jp9"),
    ("number", JOINT, "4.00000", "nan", "NaN"),
    ("number", JOINT, "4.00000", "-0.000", "a zero with a sign"),
    ("number", JOINT, "4.00000", "4.0.0", "'4.0.0' is not a plain number"),
    ("quaternion", POSE, None, None, "norm"),
    ("confdata", POSE, "[0,0,0,0],[9E9", "[0,0,0,8],[9E9", "[0,0,0,8] is no confdata"),
    ("confdata", POSE, "[0,0,0,0],[9E9", "[0.5,0,0,0],[9E9", "is no confdata"),
    ("frame-format", POSE, "TASK PERS tooldata", "TASK VAR tooldata", "is PERS, not VAR"),
    ("frame-format", POSE, "[1.000,", "[0,", "mass above 0"),
    ("frame-format", POSE, "[TRUE,", "[", "not [robhold, frame, load]"),
    ("frame-format", POSE, '[FALSE,TRUE,"",', "[FALSE,TRUE,", "not [robhold, ufprog"),
    ("frame-format", POSE, "[[0,0,0],[1,0,0,0]]];", "[[0,0,0],[1,0,1,0]]];", "norm is 1.41"),
    ("frame-format", POSE, "[[0,0,0],[1,0,0,0]]];", "[[0,0],[1,0,0,0]]];", "a frame is not"),
    ("frame", JOINT, "fine,tCalib", "fine,tOther", "tOther is no tooldata"),
    ("frame", POSE, "WObj:=wCalib", "WObj:=wOther", "wOther is no wobjdata"),
    ("frame", JOINT, "vmax,fine,tCalib", "fine,tCalib", "a motion has a position"),
    ("motion", JOINT, "MoveAbsJ jp1\\NoEOffs", "MoveJ jp1", "jp1 is a jointtarget, not a robt"),
    ("motion", POSE, "MoveJ p1", "MoveAbsJ p1", "p1 is a robtarget, not a jointtarget"),
    ("motion", JOINT, "MoveAbsJ jp1", "MoveAbsJ jMeasured,v5,z5,tool0;\n"
     "MoveAbsJ jp1", "jMeasured is an array"),
    ("motion", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp1{1}", "jp1 is no array"),
    ("motion", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp1-jp3", "is no jointtarget"),
    ("motion", JOINT, "\\NoEOffs", "\\NoEOfs", "NOEOFS is no switch of a jointtarget"),
    ("motion", JOINT, "vmax,", "vmx,", "vmx is no speeddata that is known"),
    ("motion", JOINT, "vmax,", "v55,", "v55 is no speeddata that is known"),
    ("motion", JOINT, "vmax,", "fine,", "fine is no speeddata that is known"),
    ("motion", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp1\\NoEOffs,vmax,z3,tool0;\nMoveAbsJ jp1", "z3"),
    ("motion", JOINT, "VelSet 100", "MovAbsJ jp1,vmax,fine,tool0;\nVelSet 100", "MOVABSJ is no"),
    ("motion", JOINT, "VelSet 100", "MoveAbs jp1;\nVelSet 100", "MOVEABS is no motion"),
    ("wait", JOINT, "VelSet 100", "WaitTime InPos,1;\nVelSet 100", "not a time alone"),
    ("wait", JOINT, "VelSet 100", "WaitTime\\InPoss,1;\nVelSet 100", "not a time alone"),
    ("wait", JOINT, "VelSet 100", "WaitTime;\nVelSet 100", "not a time alone"),
    ("speed", JOINT, "VelSet 10,", "VelSet 101,", "not from 1 to 100"),
    ("speed", JOINT, "VelSet 10,", "VelSet 0,", "not from 1 to 100"),
    ("standstill", JOINT, "WaitTime\\InPos,1.00;", "", "may still move"),
    ("standstill", JOINT, "WaitTime\\InPos,1.00;", "WaitTime 1.00;", "may still move"),
    ("standstill", JOINT, "vmax,fine", "vmax,z10", "no stop point"),
    ("array-bounds", JOINT, "jMeasured{2}:=CJ", "jMeasured{3}:=CJ", "jMeasured{3} of 2"),
]  # fmt: skip


@pytest.mark.parametrize(("rule", "text", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(
    rule: str, text: str, old: str | None, new: str | None, message: str
) -> None:
    if old is None or new is None:
        changed = re.sub(r"(p1:=\[\[[^\]]*\],\[)[\d.]+", r"\g<1>0.9", text)
    else:
        assert old in text
        changed = text.replace(old, new, 1)
    problems = check(changed)
    # a motion that lacks an argument has no zone either
    found = {p.rule for p in problems} - ({"standstill"} if rule == "frame" else set())
    assert found == {rule}, problems
    assert any(message in p.message for p in problems)


def test_the_encoding_of_a_modx_is_utf8() -> None:
    text = JOINT.replace("! P1 T0", "! P1 T\u00e4")
    assert AbbRapid().check(text.encode("utf-8"), Path("CAL.modx")) == []
    (problem,) = AbbRapid().check(text.encode("latin-1"), Path("CAL.modx"))
    assert (problem.rule, problem.line) == (
        "encoding",
        text[: text.index("\u00e4")].count("\n") + 1,
    )


def test_every_rule_of_the_table_is_broken_by_a_file() -> None:
    told = set(re.findall(r"^``([a-z-]+)``", rules.__doc__ or "", re.M))
    assert told == {rule for rule, *_ in ONE_RULE}


def test_problems_are_told_up_to_a_number() -> None:
    bad = "MODULE CAL\n" + "\xe4 nan (;\n" * 5000
    assert len(check(bad)) == MOST_PROBLEMS
