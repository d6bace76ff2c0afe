"""KUKA KRL: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from posedesign.programs import PoseProgram, Problem, ProgramOptions, ProgramPose, validate
from posedesign.programs.kuka_krl import KukaKrl
from posedesign.programs.reading import MOST_BYTES
from tests.unit.programs.dialects import breaks

POSES = tuple(
    ProgramPose(f"T{i}", np.radians([i + 1, -90, 90, 4, 5, 6]), via=i == 1) for i in range(3)
)
OPTIONS = ProgramOptions(fingerprint="abcdef12", measure_output=3, keep="register")
DAT, SRC = KukaKrl().files(PoseProgram("CAL", POSES, OPTIONS)).values()
P1 = "XP1={A1 1.00000,A2 -90.00000,A3 90.00000,A4 4.00000,A5 5.00000,A6 6.00000}"
POSE = "E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35}"


def check(folder: Path, dat: str | None, src: str | None, which: str) -> list[Problem]:
    for text, name in ((dat, "CAL.dat"), (src, "CAL.src")):
        if text is not None:
            (folder / name).write_bytes(text.replace("\n", "\r\n").encode("latin-1"))
    return validate(folder / f"CAL{which}")


PLACE = "{X 1,Y 2,Z 3,A 4,B 5,C 6}"


@pytest.mark.parametrize(
    ("which", "old", "new"),
    [
        (".src", "PTP XP1", ";FOLD PTP P1 " + "x" * 120 + "\nPTP XP1\n;ENDFOLD"),
        (".src", "BAS(#TOOL,1)", "$TOOL=TOOL_DATA[1]"),
        (".src", "BAS(#TOOL,1)", "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C 0}"),
        (".src", "BAS(#INITMOV,0)", "  bas ( #initmov , 0 )"),
        (".src", "BAS(#INITMOV,0)", "DECL INT I\nINT K\nBAS(#INITMOV,0)"),
        (".src", "END\n", "FOR I=1 TO 3\nIF A==1 THEN\nHALT\nENDIF\nENDFOR\nEND\n"),
        (".src", "END\n", "REPEAT\nX[1].Y=3\nUNTIL TRUE\nLABEL:\nGOTO LABEL\nEND\n"),
        (".src", "END\n", "END\nDEF SUB(N :IN)\nDECL REAL R\nR=N\nEND\n"),
        (".src", "END\n", "PTP XP1\nEND\nDEF SUB( )\nMEASURE(1)\nEND\n"),
        (".src", "PTP XP1", "PTP XHOME"),
        (".src", "PTP XP1", "SPTP XP1 WITH $VEL_AXIS[1]=SVEL_JOINT(100.0),$TOOL=STOOL2(FP1),"
         "$BASE=SBASE(FP1.BASE_NO),$LOAD=SLOAD(FP1.TOOL_NO),$ACC_AXIS[1]=SACC_JOINT(PPDAT1)"),
        (".src", "PTP XP1", "PTP {A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}\nPTP XP1"),
        (".src", "BAS(#INITMOV,0)", 'BAS(#INITMOV,0)\nMSG[]="a; b ("'),
        (".src", "PTP XP1", "PTP $AXIS_ACT\nPTP XP1"),
        (".src", "PTP XP3", f"LIN {PLACE} C_DIS C_ORI\nPTP XP3"),
        (".src", "PTP XP3", f"CIRC {PLACE}, {PLACE}, CA 90.5 C_VEL\nPTP XP3"),
        (".src", "PTP XP3", f"LIN_REL {PLACE} #TOOL C_DIS\nPTP XP3"),
        (".src", "PTP XP3", f"LIN_REL {PLACE} C_VEL #BASE\nPTP XP3"),
        (".src", "BAS(#TOOL,1)", "$TOOL=TOOL_DATA[NO]\nBAS(#TOOL,NO)"),
        (".src", "BAS(#VEL_PTP,10)", "BAS(#VEL_PTP,N)\nBAS(#VEL_CP,0.2)\nBAS (#ACC_PTP, 100 )"),
        (".dat", "EXT BAS", f'DECL MODULEPARAM_T LAST_TP_PARAMS={{P[] "{"x" * 300}"}}\nEXT BAS'),
        (".dat", "EXT BAS", f'DECL TQM_SUGG_T L={{P[] "{"x" * 300}"}}\nEXT BAS'),
        (".src", "BAS(#INITMOV,0)", "INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\n"
         "BAS(#INITMOV,0)"),
        (".dat", "EXT BAS", "DECL BASIS_SUGG_T L={POINT1[] \"P1\"}\nEXT BAS"),
        (".dat", "EXT BAS", "DECL FDAT FP9={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}\nEXT BAS"),
        (".dat", 'POINT2[] " "', 'POINT2 [ ] " "'),
        (".dat", "EXT BAS", "INT N=3\nSTRUC MY REAL A,B\nEXT BAS"),
        (".dat", "EXT BAS", "CHANNEL :SER_1 :SER_1 $PSER_1\nEXT BAS"),
        (".dat", "EXT BAS", "DECL FDAT FP9={TOOL_NO 1,BASE_NO 0,IPO_FRAME #NONE}\nEXT BAS"),
        (".dat", "EXT BAS", 'DECL CHAR N[2,24]\nN[1,]="gripper"\nEXT BAS'),
        (".dat", "A2 -90.00000", "A2 -9.0E+01"),
        (".dat", "A2 -90.00000", "A2 -9.0e-005"),
        (".dat", "A6 6.00000}", "A6 6.0,E1 0.0,E2 0.0}"),
        (".dat", "E6AXIS " + P1, POSE),
        (".dat", "E6AXIS " + P1, POSE.replace("S 2,T 35", "S 'B010',T 'B100011'")),
        (".dat", "E6AXIS " + P1, POSE.replace("S 2,T 35", "S 'B 010',T 'H23'")),
        (".dat", "DEFDAT CAL", "DEFDAT CAL PUBLIC"),
        (".src", "END\n", "LOOP\nWHILE TRUE\nIF B THEN\nEXIT\nENDIF\nENDWHILE\nENDLOOP\nEND\n"),
        (".src", "END\n", "LOOP\nWAIT FOR $IN[1]\nENDLOOP\nEND\n"),
        (".src", "END\n", "END\nDEF SUB( )\nDECL REAL XM[9]\nXM[3]=2\nEND\n"),
        (".dat", "ENDDAT", "XM[2]={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nENDDAT"),
    ],
)  # fmt: skip
def test_what_controllers_and_people_write_too_is_accepted(tmp_path, which, old, new):
    text = DAT if which == ".dat" else SRC
    assert text.count(old) >= 1
    text = text.replace(old, new, 1)
    pair = (text, SRC) if which == ".dat" else (DAT, text)
    problems = check(tmp_path, *pair, which)
    # the home and other names may be those of another file
    assert [p for p in problems if p.rule not in ("position-used", "position-defined")] == []
    assert all(p.level == "measuring" for p in problems)


@pytest.mark.parametrize(
    ("declaration", "code"),
    [
        ("DECL POSE P", "P=FUN(P)"),
        ("DECL SDAT S", "BASE(3)"),
        ("DECL INT I", "BAG(I)\nHALTE()"),
        ("DECL E6POS POS", "POS=$POS_ACT"),
        ("DECL INT I", "IF ($EXT OR $AUT)THEN\n$LOADS=1\nENDIF"),
        ("DECL CHAR T[9]", "T[]=NAME(1)\nD={S 1,NO 2}"),
    ],
)
def test_without_a_plan_any_name_may_be_one_of_another_file(tmp_path, declaration, code):
    src = f"DEF CAL( )\n{declaration}\n{code}\nEND\n"
    assert check(tmp_path, None, src, ".src") == []


ONE_RULE = [
    ("ascii", ".dat", ";P1 T0", ";P1 T\u00e4", "0xe4"),
    ("ascii", ".src", ";P1 T0", ";P1 T\0", "0x00"),
    ("line-length", ".dat", ";P1 T0", ";" + "x" * 255, "256 characters"),
    ("line-length", ".src", "MEASURE(1)", "MEASURE(1)" + " " * 110, "120 characters"),
    ("block", ".dat", "ENDDAT\n", "", "'DEFDAT CAL' is never closed"),
    ("block", ".src", "END\n", "", "'DEF CAL( )' is never closed"),
    ("block", ".src", "END\n", "END\nEND\n", "'END' closes nothing"),
    ("module", ".src", "END\n", "END\nHALT\n", "in no routine"),
    ("module", ".src", "DEF CAL", "HALT\nDEF CAL", "in no routine"),
    ("module", ".src", "DEF CAL( )", "DEF CAL", "no brackets behind the name"),
    ("module", ".src", "END\n", "DEF B( )\nEND\nEND\n", "before the end of the one before"),
    ("module-name", ".src", "END\n", f"END\nDEF {'B' * 25}( )\nEND\n", "24"),
    ("syntax", ".src", "MEASURE(1)", "MEASURE(1", "is not complete"),
    ("syntax", ".src", "MEASURE(1)", "MEASURE(1))", "cannot stand"),
    ("syntax", ".src", "MEASURE(1)", "MEASURE([1)]", "cannot stand"),
    ("syntax", ".src", "MEASURE(1)", 'MEASURE("1)', "cannot stand"),
    ("block", ".src", "END\n", "LOOP\nEND\n", "does not close what line"),
    ("block", ".src", "END\n", "ENDIF\nEND\n", "'ENDIF' does not close"),
    ("block", ".src", "END\n", "IF A==1 THEN\nLOOP\nENDIF\nENDLOOP\nEND\n", "does not close"),
    ("syntax", ".src", "MEASURE(1)", "WAITSEC 1", "behind 'WAITSEC '"),
    ("syntax", ".src", "MEASURE(1)", "MEASURE 1", "behind 'MEASURE '"),
    ("data", ".dat", "EXT BAS", "HALT\nEXT BAS", "'HALT' in a data list"),
    ("syntax", ".dat", "EXT BAS", "1 = 2\nEXT BAS", "cannot stand behind"),
    ("declarations-first", ".src", "PTP XP1", "DECL INT I\nPTP XP1", "behind an instruction"),
    ("position-format", ".dat", "A2 -90.00000,", "", "XP1 has A1 A3 A4 A5 A6: the others stay"),
    ("position-format", ".dat", "A2 -90.00000", "A1 -90.00000", "XP1 has A1 twice"),
    ("position-format", ".dat", "A2 -90.00000", "X -90.00000", "XP1 has A1 X A3"),
    ("syntax", ".dat", "A2 -90.00000", "A2", "cannot stand behind"),
    ("syntax", ".dat", "6.00000}", "6.00000,}", "cannot stand behind"),
    ("position-format", ".dat", "DECL E6AXIS XP1", "DECL E6POS XP1", "E6POS of A1"),
    ("position-format", ".src", "END\n", "PTP {A1 1}\nEND\n", "the position has A1"),
    ("position-defined", ".src", "END\n", "PTP XP4\nEND\n", "XP4 is not defined"),
    ("unique", ".dat", "ENDDAT", f"DECL E6AXIS {P1}\nENDDAT", "XP1 is defined twice"),
    ("position-used", ".dat", "ENDDAT", f"DECL E6AXIS {P1}\nENDDAT".replace("P1", "P4"), "XP4"),
    ("number", ".dat", "A2 -90.00000", "A2 TRUE", "A2 'TRUE' is not a plain number"),
    ("number", ".dat", "E6AXIS " + P1, POSE.replace("S 2", "S 2.5"), "S '2.5' is no whole"),
    ("syntax", ".dat", "A2 -90.00000", "A2 ******", "cannot stand behind"),
    ("syntax", ".dat", "A2 -90.00000", "A2 1,5", "cannot stand behind"),
    ("syntax", ".dat", "A2 -90.00000", "A2 1.2.3", "cannot stand behind"),
    ("syntax", ".src", "WAIT SEC 1.00", "WAIT SAC 1.00", "cannot stand behind 'WAIT '"),
    ("syntax", ".src", "WAIT SEC 1.00", "WAIT SEC 1_0", "cannot stand behind 'WAIT SEC '"),
    ("syntax", ".src", "WAIT SEC 1.00", "WAIT SEC1.00", "cannot stand behind 'WAIT '"),
    ("syntax", ".src", "TRUE,0.50)", "TRUE,-)", "cannot stand behind"),
    ("syntax", ".src", "=$AXIS_ACT\n", "=$AXIS_ACTWAIT SEC 0.50\n", "cannot stand behind"),
    ("syntax", ".dat", "ENDDAT\n", "ENDDAT ENDDAT\n", "cannot stand behind"),
    ("call", ".src", "BAS(#INITMOV,0)", "BAS(#INITMOV,0)\nBAS(#INITMOV,,0)", "BAS takes"),
    ("call", ".src", "BAS(#VEL_PTP,10)", "BAS(#VELPTP,10)", "BAS takes"),
    ("call", ".src", "BAS(#VEL_PTP,10)", "BAS(#VEL_PTP,TRUE)", "TRUE is no number"),
    ("call", ".src", "OUT[3]", "OUT[]", "PULSE takes"),
    ("syntax", ".src", "WAIT SEC 1.00", "WAIT SEC TRUE", "is not complete"),
    ("syntax", ".src", "OUT[3]", "OUT[TRUE]", "cannot stand behind"),
    ("constant", ".src", "XM[2]=", "XM[]=", "a whole array is given one value"),
    ("constant", ".dat", "XM[2]", "XM[]", "the size of the array is missing"),
    ("word", ".src", "PULSE(", "PULS(", "PULSE?"),
    ("word", ".src", "$OUT", "$OT", "$OT is no word that is known here: $OUT?"),
    ("word", ".src", "BAS(#VEL_PTP,10)", "BSA(#VEL_PTP,10)", "BAS?"),
    ("word", ".dat", "DECL E6AXIS XP1", "DECLE6AXIS XP1", "no blank behind DECL"),
    ("word", ".dat", "REAL", "RAEL", "REAL?"),
    ("word", ".dat", "EXT BAS", "EXT AS", "what takes a BAS_COMMAND is BAS"),
    ("form", ".dat", "TOOL_NO 1", "TOL_NO 1", "FP1: TOL_NO is no name of FDAT"),
    ("word", ".src", "BAS(#INITMOV,0)", "DECL INT REAL\nBAS(#INITMOV,0)", "REAL is a type"),
    ("form", ".dat", "TQ_STATE FALSE", "TQ_STATE 1", "not TRUE or FALSE"),
    ("form", ".dat", "IPO_FRAME #BASE", "IPO_FRAME #BASIS", "not #BASE or #TCP"),
    ("form", ".dat", "TOOL_NO 1", "TOOL_NO TRUE", "TOOL_NO is TRUE, not a number"),
    ("form", ".dat", "TOOL_NO 1", "TOOL_NO " + "9" * 41, "not a number"),
    ("form", ".dat", "IPO_FRAME #BASE", "IPO_FRAME BASE", "not #BASE or #TCP"),
    ("form", ".dat", "APO_DIST", "APODIST", "PPDAT1: APODIST is no name of PDAT"),
    ("data", ".dat", "EXT BAS", "MEASURE(1)\nEXT BAS", "in a data list"),
    ("number", ".dat", "E6AXIS " + P1, POSE.replace("A 4.0", "A 180.1"), "beyond +-180"),
    ("number", ".dat", "E6AXIS " + P1, POSE.replace("S 2", "S 32"), "S '32' is not from 0 to 31"),
    ("number", ".dat", "E6AXIS " + P1, POSE.replace("T 35", "T 64"), "T '64' is not from 0 to 63"),
    ("number", ".src", "WAIT SEC 1.00", "WAIT SEC nan", "NaN"),
    ("position-defined", ".src", "MEASURE(1)", "MEASURE(N)", "N is not defined"),
    ("first-move", ".src", "PTP XP1", f"LIN {PLACE}\nPTP XP1", "LIN is the first motion"),
    ("first-move", ".dat", "E6AXIS " + P1, POSE.replace(",S 2,T 35", ""), "no S and T"),
    ("number", ".dat", "A2 -90.00000", "A2 -720.1", "beyond +-720"),
    ("syntax", ".src", "PTP XP3", "PTP XP3 XP1", "cannot stand behind"),
    ("syntax", ".src", "PTP XP3", "PTP XP3 C_FOO", "cannot stand behind"),
    ("syntax", ".src", "PTP XP3", "PTP XP3,XP1", "cannot stand behind"),
    ("syntax", ".src", "PTP XP3", "PTP XP3 10", "cannot stand behind"),
    ("syntax", ".src", "PTP XP3", "PTP\nPTP XP3", "is not complete"),
    ("syntax", ".src", "PTP XP3", f"CIRC {PLACE}\nPTP XP3", "is not complete"),
    ("motion", ".src", "PTP XP3", "LIN XP3", "goes to a pose"),
    ("motion", ".src", "PTP XP3", "LIN {A1 1,A2 1,A3 1,A4 1,A5 1,A6 1}\nPTP XP3", "to a pose"),
    ("speed", ".src", "#VEL_PTP,10", "#VEL_PTP,500", "value is 500, not 1 to 100"),
    ("speed", ".src", "#VEL_PTP,10", "#VEL_PTP,0", "value is 0, not 1 to 100"),
    ("speed", ".src", "BAS(#VEL_PTP,10)", "$VEL_AXIS[7]=10", "index is 7, not 1 to 6"),
    ("speed", ".src", "BAS(#VEL_PTP,10)", "$VEL_AXIS[1]=0", "value is 0, not 1 to 100"),
    ("speed", ".src", "BAS(#VEL_PTP,10)", "$ACC_AXIS[0]=50", "index is 0, not 1 to 6"),
    ("speed", ".src", "BAS(#VEL_PTP,10)", "$VEL.CP=0", "value is 0, not above 0"),
    ("speed", ".src", "BAS(#VEL_PTP,10)", "BAS(#VEL_CP,0)", "value is 0, not above 0"),
    ("loop", ".src", "END\n", "LOOP\n$OV_PRO=50\nENDLOOP\nEND\n", "without a motion or a wait"),
    ("loop", ".src", "END\n", "WHILE TRUE\nENDWHILE\nEND\n", "without a motion or a wait"),
    ("loop", ".src", "END\n", "REPEAT\nUNTIL FALSE\nEND\n", "without a motion or a wait"),
    ("form", ".src", "BAS(#VEL_PTP,10)", "PDAT_ACT=FDAT_ACT", "FDAT_ACT is none of PDAT_ACT"),
    ("form", ".dat", "VEL 10.0", "VEL 0", "VEL is 0, not 1 to 100"),
    ("frame-value", ".src", "#TOOL,1", "#TOOL,17", "TOOL 17: controllers have 0 to 16"),
    ("frame-value", ".src", "#BASE,0", "#BASE,-1", "numbered from 0"),
    ("frame-value", ".src", "BAS(#TOOL,1)", "$TOOL=TOOL_DATA[99]", "TOOL 99"),
    ("frame-value", ".src", "BAS(#TOOL,1)", "$TOOL=TOOL_DATA[2.0]", "TOOL 2.0: frames are"),
    ("frame-value", ".src", "BAS(#TOOL,1)", "$TOOL={X 0,Y 0,Z 0}", "$TOOL has not X Y Z A B C"),
    ("frame-value", ".src", "BAS(#TOOL,1)", "$TOOL={X 0,Y 0,Z 0,A 0,B 0,C TRUE}", "no number"),
    ("initialised", ".src", "BAS(#INITMOV,0)\n", "", "no BAS(#INITMOV,0)"),
    ("standstill", ".src", "WAIT SEC 1.00\n", "", "the arm may still move"),
    ("standstill", ".src", "PTP XP1", "PTP XP1 C_PTP", "approximated"),
    ("array-bounds", ".src", "XM[2]=", "XM[3]=", "XM[3] of 2"),
    ("array-bounds", ".dat", "ENDDAT", "XM[3]={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nENDDAT", "of 2"),
]


@pytest.mark.parametrize(("rule", "which", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(tmp_path, rule, which, old, new, message):
    text = DAT if which == ".dat" else SRC
    assert old in text
    at = text.rindex(old) if old in ("END\n", "ENDDAT") else text.index(old)
    text = text[:at] + new + text[at + len(old) :]
    pair = (text, SRC) if which == ".dat" else (DAT, text)
    problems = check(tmp_path, *pair, which)
    if rule == "first-move" and which == ".dat":
        problems = validate(tmp_path / "CAL.src")
    # a line that is no statement may leave out what others ask for
    breaks(problems, rule, message, *({p.rule for p in problems} if rule == "syntax" else ()))


@pytest.mark.parametrize(
    ("dat", "src", "which", "message"),
    [
        (DAT, None, ".dat", "CAL.src is not beside it"),
        (None, SRC, ".src", "CAL.dat is not beside it"),
        (DAT.replace("DEFDAT CAL", "DEFDAT COL"), SRC, ".src", "is the module 'COL'"),
        (SRC, SRC, ".src", "not the other file"),
    ],
)
def test_the_other_file_is_asked_for(tmp_path, dat, src, which, message):
    (problem,) = check(tmp_path, dat, src, which)
    assert problem.rule == "companion"
    assert message in problem.message


@pytest.mark.parametrize("name", ["TOOL", "BASE"])
def test_frames_are_set_before_the_first_motion(tmp_path: Path, name: str) -> None:
    without = re.sub(rf"BAS\(#{name},.*\n|FDAT_ACT=.*\n", "", SRC)
    (problem,) = check(tmp_path, DAT, without, ".src")
    assert (problem.rule, problem.level) == ("frame", "measuring")
    assert f"${name} is not set" in problem.message


def test_nothing_is_said_of_positions_that_stand_in_the_file_beside(tmp_path: Path) -> None:
    src, dat = tmp_path / "a.src", tmp_path / "a.dat"
    src.write_text("DEF a( )\nBAS(#INITMOV,0)\nBAS(#TOOL,1)\nBAS(#BASE,0)\nPTP XP1\nEND\n")
    assert [p.rule for p in validate(src, levels=("measuring",))] == ["companion"]
    dat.write_text("DEFDAT a\nDECL E6AXIS XP1={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nENDDAT\n")
    assert [
        *validate(src, levels=("error", "note")),
        *validate(dat, levels=("error", "note")),
    ] == []


def test_a_companion_that_cannot_be_read_is_a_problem(tmp_path: Path) -> None:
    with (tmp_path / "CAL.dat").open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    (problem,) = check(tmp_path, None, SRC, ".src")
    assert problem.rule == "companion"
    assert "larger than 20 MB" in problem.message


def test_a_source_without_variables_needs_no_other_file(tmp_path: Path) -> None:
    inline = re.sub(r"XM.*\n", "", re.sub(r"XP\d", "{A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}", SRC))
    assert check(tmp_path, None, re.sub(r"[FP]DAT_ACT.*\n", "", inline), ".src") == []


@pytest.mark.parametrize(("which", "text"), [(".dat", SRC), (".src", DAT)])
def test_the_ending_is_that_of_the_module(tmp_path: Path, which: str, text: str) -> None:
    (tmp_path / f"CAL{which}").write_text(text)
    problems = validate(tmp_path / f"CAL{which}")
    assert {p.rule for p in problems} >= {"module"}


def test_the_name_is_that_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "OTHER.dat").write_text(DAT)
    (tmp_path / "OTHER.src").write_text(SRC)
    assert {p.rule for p in validate(tmp_path / "OTHER.src")} == {"module-name"}
