"""ABB RAPID: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from calib.se3 import transform
from posedesign.programs import Arm, Load, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.abb_rapid import AbbRapid, render_abb_rapid
from tests.unit.programs.dialects import breaks, changed

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
    )["CAL.mod"].replace("  ENDPROC", "    VelSet 100,5000;\n  ENDPROC")
    for form in ("joint", "cartesian")
)
JP1 = re.search(r"LOCAL CONST jointtarget jp1:=(.*);", JOINT)
assert JP1


def check(text: str, name: str = "CAL.mod") -> list[Problem]:
    found = AbbRapid().check(text.replace("\n", "\r\n").encode("latin-1"), Path(name))
    return [problem for problem in found if problem.level != "note"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("MODULE CAL", "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\nMODULE CAL"),
        ("MODULE CAL", "MODULE CAL(SYSMODULE, NOSTEPIN)"),
        ("  PROC CAL_run()", "  VAR num n:=1E-05;\n  CONST num m;\n  PROC CAL_run()"),
        ("  PROC CAL_run()", "  FUNC num f(num a)\n  RETURN a;\n  ENDFUNC\n  PROC CAL_run()"),
        ("  PROC CAL_run()", '  VAR string s:="nan; ! (";\n  PROC CAL_run()\n    VAR num k;'),
        ("MEASURE 1;", "IF a=1 THEN\n MEASURE 1;\n ELSE\n MEASURE 2;\n ENDIF"),
        ("MEASURE 1;", "IF a=1 MEASURE 1;"),
        ("MEASURE 1;", "FOR i FROM 1 TO 3 DO\n MEASURE -1;\n ENDFOR"),
        ("MEASURE 1;", "TEST a\n CASE 1:\n MEASURE 1;\n DEFAULT:\n MEASURE 2;\n ENDTEST"),
        ("MEASURE 1;", "MEASURE\n 1\n ;"),
        ("  PROC CAL_run()", "PROC go()\nMoveAbsJ jp1,v5,z1,tool0;\nENDPROC\nPROC f()\nMEASURE 1;\n"
         "ENDPROC\n  PROC CAL_run()"),
        ("MoveAbsJ jp1", "MoveAbsJ \\Conc, jp1"),
        ("jp1\\NoEOffs,vCalib", "jp1,\\NoEOffs,vCalib"),
        ("MEASURE 1;", 'TPWrite "a;b" \\Num:=3;'),
        ("MEASURE 1;", "a{1}.x:=-(3-0);"),
        ("MEASURE 1;", "again:\n MEASURE 1;"),
        ("WaitTime\\InPos,1.00;", "WaitRob \\InPos;"),
        ("WaitTime\\InPos,1.00;", "WaitTime \\InPos, 0.5+a;\nWaitTime 2;"),
        ("jp1\\NoEOffs,vCalib,fine,tCalib",
         "jp1 \\ID:=3\\NoEOffs, v100\\T:=5, fine \\Inpos:=inpos50, tCalib\\TLoad:=load0"),
        ("  PROC CAL_run()", "  VAR speeddata vMine:=[1,1,1,1];\n  VAR zonedata zMine;\n"
         "PROC go(VAR jointtarget target,\\num n)\nMoveAbsJ target,vMine,zMine,tool0;\n"
         "ENDPROC\n  PROC CAL_run()"),
        ("  PROC CAL_run()", "  VAR jointtarget j{3};\nPROC go(num n)\n"
         "MoveAbsJ j{n},[1,1,1,1],fine,tool0;\nENDPROC\n  PROC CAL_run()"),
        ("  PROC CAL_run()", "PROC go()\n"
         "MoveJSync [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v5,z5,tool0,\"x\";\n"
         "MoveL Offs(CRobT(),0,0,5),v5,z5,tool0;\n"
         "ENDPROC\n  PROC CAL_run()"),
        ("MoveAbsJ jp1\\NoEOffs", "MoveAbsJ jp1"),
        ("9E9,9E9,9E9,9E9,9E9,9E9", "1.5,9E+09,9E9,9E9,9E9,9E9"),
        ("jp1\\NoEOffs", "[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,vmax,fine,tool0;\n"
         "MoveAbsJ jp1\\NoEOffs"),
        ("! P1 T0", "! (nan; -0 \""),
        # RAPID kernel (3HAC16585-1), alias data types: a type is equal to another one
        ("  PROC CAL_run()", "  ALIAS num level;\n  CONST level low:=2.5;\n  PROC CAL_run()"),
        # a routine of another module, as public socket servers (MODULE MattServer) call it
        ("MEASURE 1;", "MoveToHomePos;"),
    ],
)  # fmt: skip
def test_what_controllers_and_people_write_too_is_accepted(old: str, new: str) -> None:
    text = JOINT if old in JOINT else POSE
    assert check(changed(text, old, new)) == []


@pytest.mark.parametrize(
    "code",
    [
        r"MoveL p10,v250,z120,tool1\WObj:=wobj1;",
        r"MoveJ p10,v100,z50,Tool\WObj:=wobj;",
        "SearchX 3;",
        "PulseDi di1;",
        "offset:=Distance+load1;",
        "IF Clear(3) RETURN;",
        "Move_it do_1,Feeder:=n\\High;",
        "VAR clock clock;",
        r"MoveL p10,v100\Other:=3,z10,tool1;",
        "Z\u00e4hler:=Z\u00e4hler+0xFF+0b01+0o17;",
        "zur\u00fcck: Stop;\nGOTO zur\u00fcck;",
        f'TPWrite "{60 * chr(34)}{50 * "x"}";',
        'TPWrite "' + 30 * r"\0A" + '";',
    ],
)
def test_without_a_plan_any_name_may_be_one_of_another_module(code: str) -> None:
    # as in public modules beside a CalibData.mod or user.sys, which have the tools and the speeds
    assert check(f"MODULE m\nPROC main()\n{code}\nENDPROC\nENDMODULE\n", "m.sys") == []


@pytest.mark.parametrize(
    "data",
    [
        "RECORD a\nnum x;\nENDRECORD\nRECORD b\na y;\nENDRECORD\n",
        f"CONST jointtarget j:={JP1[1].replace('6.00000', '9E9')};\n",
        "PERS tooldata t:=[TRUE,[[6E7,0,0],[1,0,0,0]],[-1,[0,0,0],[1,0,0,0],0,0,0]];\n",
        "VAR num n;\nPROC main()\nENDPROC\nENDMODULE\nMODULE n\nLOCAL VAR num n;\n",
    ],
)
def test_what_programs_of_other_controllers_have(data: str) -> None:
    found = check(f"MODULE m\n{data}ENDMODULE\n", "m.prg")
    assert [problem for problem in found if problem.level == "error"] == []


LONG = "x" * 33
ONE_RULE = [
    ("encoding", JOINT, "! P1 T0", "! P1 T\0", "0x00"),
    ("placeholder", JOINT, "MEASURE 1;", "! <DDN>\n<SMT>\nMEASURE 1;", "stops at <SMT>"),
    ("placeholder", JOINT, "MEASURE 1;", "IF <EXP> THEN\nMEASURE 1;\nENDIF", "stops at <EXP>"),
    ("module", JOINT, "MODULE CAL", "VAR num a;\nMODULE CAL", "MODULE is not the first"),
    ("module", JOINT, "ENDMODULE", "ENDMODULE\nmore;", "ENDMODULE is not the last"),
    ("module", JOINT, "MODULE CAL", "MODULE A\nENDMODULE\nMODULE CAL", "one module"),
    ("name", JOINT, "MODULE CAL", f"MODULE {LONG}", "at most 32"),
    ("name", JOINT, "PROC CAL_run", f"VAR num {LONG};\nPROC CAL_run", "at most 32"),
    ("name", JOINT, "PROC CAL_run", "VAR num pos;\nPROC CAL_run", "none of a type"),
    ("syntax", JOINT, "MODULE CAL", "MODULE 1CAL", "cannot stand"),
    ("string", JOINT, "MEASURE 1", f'TPWrite "{"x" * 81}"', "81 characters"),
    ("syntax", JOINT, "MEASURE 1;", 'TPWrite "x;\n;', "cannot stand behind"),
    ("syntax", JOINT, "MEASURE 1;\n", "MEASURE 1\n", "cannot stand behind"),
    ("syntax", JOINT, "MEASURE 1;\n", "MEASURE 1;;\n", "';' cannot stand"),
    ("syntax", JOINT, "PROC CAL_run", "VAR num a:=1\nVAR num b;\nPROC CAL_run", "not complete"),
    ("syntax", JOINT, "MEASURE 1", "1 MEASURE", "cannot stand"),
    ("syntax", JOINT, "MEASURE 1", "MEASURE one two", "cannot stand"),
    ("syntax", JOINT, "PROC CAL_run", "CONST num;\nPROC CAL_run", "cannot stand"),
    ("syntax", JOINT, "CJointT()", "CJointT(", "cannot stand"),
    ("syntax", JOINT, "MEASURE 1", "MEASURE [1)", "cannot stand"),
    ("syntax", JOINT, "4.00000", "4.0.0", "cannot stand behind"),
    ("syntax", JOINT, "4.00000", "--4", "cannot stand behind"),
    ("block", JOINT, "ENDPROC\n", "", "does not close what"),
    ("block", JOINT, "ENDPROC\n", "ENDIF\nENDPROC\n", "does not close what"),
    ("block", JOINT, "MEASURE 1;", "WHILE TRUE DO\nMEASURE 1;", "does not close what"),
    ("place", JOINT, "VelSet 100", "VAR num a;\nVelSet 100", "behind an instruction"),
    ("place", JOINT, "ENDMODULE", "VAR num a;\nENDMODULE", "behind a routine"),
    ("place", JOINT, "ENDMODULE", "MoveAbsJ jp1,v5,fine,tool0;\nENDMODULE", "outside of all"),
    ("place", JOINT, "PROC CAL_run()", "PROC CAL_run()\nLOCAL VAR num a;", "data of the module"),
    ("position", JOINT, JP1[1], "[[1,2,3,4,5],[9E9,9E9,9E9,9E9,9E9,9E9]]", "jp1 has not"),
    ("position", JOINT, JP1[1], "[1,2,3,4,5,6]", "jp1 has not"),
    ("position", JOINT, JP1[1], "5", "jp1: '5' is no jointtarget"),
    ("position", JOINT, "{2}:=[", "{3}:=[", "jMeasured{3} has 2 elements"),
    ("name", JOINT, "PROC CAL_run", f"CONST jointtarget JP1:={JP1[1]};\nPROC CAL_run", "too"),
    ("position-used", JOINT, "PROC CAL_run", f"CONST jointtarget jp9:={JP1[1]};\nPROC CAL_run",
     "jp9"),
    ("position", JOINT, "4.00000", "nan", "jp1 has not plain numbers"),
    ("position", JOINT, "4.00000", "4e3", "beyond +-720"),
    ("position", JOINT, "4.00000,", "4.00000,7,", "jp1 has not the lists"),
    ("position", JOINT, "9E9,9E9,9E9]]", "9E9,9E9,TRUE]]", "jp1 has not plain numbers"),
    ("position", POSE, None, None, "norm"),
    ("position", POSE, "[0,0,0,0],[9E9", "[0,0,0,8],[9E9", "is not one of a six-axis"),
    ("position", POSE, "[0,0,0,0],[9E9", "[0.5,0,0,0],[9E9", "is not one of a six-axis"),
    ("argument", POSE, "TASK PERS tooldata", "TASK VAR tooldata", "tooldata of a motion is PERS"),
    ("argument", POSE, "[1.000,", "[0,", "mass above 0"),
    ("frame", POSE, "[TRUE,", "[", "has not the parts of tooldata"),
    ("frame", POSE, '[FALSE,TRUE,"",', "[FALSE,TRUE,", "has not the parts of wobjdata"),
    ("frame", POSE, "[[0,0,0],[1,0,0,0]]];", "[[0,0,0],[1,0,1,0]]];", "norm is 1.41"),
    ("frame", POSE, "[[0,0,0],[1,0,0,0]]];", "[[0,0],[1,0,0,0]]];", "of a frame"),
    ("frame", POSE, "[[0,0,0],[1,0,0,0]]];", "[[0,0,fine],[1,0,0,0]]];", "plain numbers"),
    ("name", JOINT, "fine,tCalib", "fine,tOther", "TOTHER is no tooldata"),
    ("name", POSE, "WObj:=wCalib", "WObj:=wOther", "WOTHER is no wobjdata"),
    ("name", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp9\\NoEOffs,vmax,fine,tool0;\nMoveAbsJ jp1",
     "JP9 is no jointtarget"),
    ("name", JOINT, "jMeasured{2}:=CJ", "kMeasured{2}:=CJ", "JMEASURED?"),
    ("name", JOINT, "vCalib,", "vmx,", "VMX is no speeddata"),
    ("name", JOINT, "vCalib,", "v55,", "V55 is no speeddata"),
    ("name", JOINT, "VelSet 100", "MovAbsJ jp1,vmax,fine,tool0;\nVelSet 100", "MOVEABSJ?"),
    ("name", JOINT, "VelSet 100", "MoveAbs jp1;\nVelSet 100", "MOVEABSJ?"),
    ("name", POSE, "ConfJ\\On", "ConfJOn", "CONFJ\\ON?"),
    ("argument", JOINT, "jMeasured{2}:=CJ", "jMeasured{TRUE}:=CJ", "TRUE is no index"),
    ("name", JOINT, "CJointT()", "CJontT()", "CJOINTT?"),
    ("name", JOINT, "CJointT()", "(CJointT)", "CJOINTT is no value"),
    ("name", POSE, "tooldata tCalib", "tooldat tCalib", "TOOLDATA?"),
    ("name", JOINT, "MEASURE 1;", "jp1 MEASURE;", "JP1 is no instruction"),
    ("argument", JOINT, "vCalib,fine,tCalib", "fine,tCalib", "MOVEABSJ has 3 arguments"),
    ("argument", JOINT, "MoveAbsJ jp1\\NoEOffs", "MoveJ jp1", "JP1 is a jointtarget, not a robt"),
    ("argument", POSE, "MoveJ p1", "MoveAbsJ p1", "P1 is a robtarget, not a jointtarget"),
    ("argument", JOINT, "MoveAbsJ jp1", "MoveAbsJ jMeasured,v5,z5,tool0;\n"
     "MoveAbsJ jp1", "JMEASURED is a list"),
    ("argument", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp1{1}", "JP1 is no list"),
    ("argument", JOINT, "MoveAbsJ jp1", "MoveAbsJ jp1-jp3", "is no jointtarget"),
    ("argument", JOINT, "\\NoEOffs", "\\NoEOfs", "NOEOFS is no switch"),
    ("argument", JOINT, "vCalib,", "fine,", "FINE is a zonedata, not a speeddata"),
    ("argument", JOINT, "[500,50,", "[500,TRUE,", "four numbers of a speeddata"),
    ("argument", JOINT, "VelSet 100", "WaitTime InPos,1;\nVelSet 100", "2 arguments"),
    ("argument", JOINT, "VelSet 100", "WaitTime\\InPoss,1;\nVelSet 100", "is no switch"),
    ("argument", JOINT, "VelSet 100", "WaitTime;\nVelSet 100", "0 arguments"),
    ("argument", JOINT, "VelSet 100", "WaitTime -1;\nVelSet 100", "-1 is not from 0"),
    ("argument", JOINT, "VelSet 100", "VelSet 0", "is not from"),
    ("argument", JOINT, "jMeasured{2}:=CJ", "jMeasured{3}:=CJ", "JMEASURED{3} of 2"),
    ("standstill", JOINT, "WaitTime\\InPos,1.00;", "", "may still move"),
    ("standstill", JOINT, "WaitTime\\InPos,1.00;", "WaitTime 1.00;", "may still move"),
    ("standstill", JOINT, "vCalib,fine", "vCalib,z10", "no stop point"),
]  # fmt: skip


@pytest.mark.parametrize(("rule", "text", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(rule, text, old, new, message):
    if old is None or new is None:
        broken = re.sub(r"(p1:=\[\[[^\]]*\],\[)[\d.]+", r"\g<1>0.9", text)
    else:
        broken = changed(text, old, new)
    # what does not parse is not declared, is not used, and stops nothing
    follow = ("module", "name", "place", "block", "position-used", "standstill")
    breaks(check(broken), rule, message, *follow)


def test_the_encoding_of_a_modx_is_utf8() -> None:
    text = JOINT.replace("! P1 T0", "! P1 T\u00e4")
    assert check(text.encode("utf-8").decode("latin-1"), "CAL.modx") == []
    (problem,) = check(text, "CAL.modx")
    assert (problem.rule, problem.line) == (
        "encoding",
        text[: text.index("\u00e4")].count("\n") + 1,
    )


def test_what_stands_before_a_module_is_told_with_its_line() -> None:
    first, *_ = check("! x\n\nPROC f()\nENDPROC\n")
    assert (first.line, first.rule) == (3, "module")
    assert [(p.line, p.rule) for p in check("")] == [(1, "module")]


@pytest.mark.parametrize(("name", "meant"), [("vwxya", True), ("abce", False)])
def test_short_names_are_near_to_no_other(name: str, meant: bool) -> None:
    declared = "  VAR num vwxyz;\n  VAR num abcd;\n  PROC CAL_run()"
    text = changed(JOINT, "  PROC CAL_run()", declared)
    found = check(changed(text, "MEASURE 1;", f"MEASURE {name};"))
    assert [p.rule for p in found] == ["name"] * meant
