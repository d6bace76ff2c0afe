"""FANUC .LS: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

import numpy as np
import pytest

from posedesign.programs import DIALECTS, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.fanuc_ls.rules import check_fanuc_ls
from tests.unit.programs.dialects import breaks, changed, export

(GOOD,) = (
    DIALECTS["fanuc-ls"]
    .files(
        PoseProgram(
            "CALPOSE",
            (
                ProgramPose("T1", np.radians([1, 2, 3, 4, 5, 6])),
                ProgramPose("T2", np.radians([-1, -2, -3, -4, -5, -6])),
            ),
            ProgramOptions(fingerprint="abcdef12"),
        )
    )
    .values()
)
LINES = GOOD.splitlines()
P2 = GOOD[GOOD.index("P[2:") : GOOD.index("/END")]

CARTESIAN = """\
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   900.000  mm,\tY =     0.000  mm,\tZ =   500.000  mm,
\tW =   180.000 deg,\tP =     0.000 deg,\tR =   180.000 deg,
\tE1=   -10.000  mm
   GP2:
\tUF : 3, UT : 4,\t
\tJ1=     -.001 deg,\tJ2=    45.000 deg
};
"""


def check(text: str, *levels: str) -> list[Problem]:
    """Problems of these levels; of all but notes, where none are named."""
    problems = check_fanuc_ls(text.replace("\n", "\r\n").encode("latin-1"))
    return [p for p in problems if p.level in (levels or ("error", "measuring"))]


def line_of(text: str) -> int:
    (row,) = [i for i, line in enumerate(LINES, start=1) if text in line]
    return row


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("/PROG  CALPOSE", "/PROG  CALPOSE\t  Macro"),
        ("/MN\n", "/APPL\n/APPL\n\nAUTO_SINGULARITY_HEADER;\n/MN\n"),
        ("J P[1] 10% FINE    ;", "J P[1:T1 CNT -1] 10% FINE;"),
        ("WAIT   1.00(sec) ;\n   6:", "WAIT R[1:CALL X(-1)]                  ;\n   6:"),
        ("!PLAN abcdef12 2", "!CALL X(-1) at 1e5"),
        ("!PLAN abcdef12 2", "//CALL X(-1)"),
        ("!PLAN abcdef12 2", "WAIT (R[1]<(-2.5))"),
        ("!PLAN abcdef12 2", "R[1]=R[2]-1"),
        ("!PLAN abcdef12 2", "MESSAGE[a]"),
        ("!PLAN abcdef12 2", "IF PL[R[1]]=[1,R[2],*],JMP LBL[R[1]]"),
        ("!PLAN abcdef12 2", "OVERRIDE=R[1:slow]%"),
        (
            "WAIT   1.00(sec) ;\n   6:  CALL MEASURE(1) ;",
            "PALLETIZING-B_1 ;\n   6:L PAL_1[BTM] 100mm/sec CNT10    ;",
        ),
        ("MEASURE(1)", "MEASURE((-1))"),
        ("MEASURE(1)", "MEASURE('it, -1, was 1e5')"),
        ("J P[1] 10% FINE    ;", "C P[1]    \n    :  P[1] 10mm/sec FINE    ;"),
        (P2[P2.index("\tUF") :], CARTESIAN),
    ],
)
def test_what_controllers_write_too_is_accepted(old: str, new: str) -> None:
    assert check(changed(GOOD, old, new)) == []


TWICE = "LBL[7] ;\n   6:  LBL[7]"
ERRORS = [
    ("text", "!PLAN", "!PL\0N", "0x00"),
    ("sections", "/END\n", "", "/PROG /ATTR /MN /POS"),
    ("instruction", "!PLAN abcdef12 2", "WAIT NEXT 5", "NEXT"),
    ("instruction", "!PLAN abcdef12 2", "IF (R[1]=1)JMP LBL[1]", "JMP"),
    ("instruction", "!PLAN abcdef12 2", "UALM[1] ;", "';'"),
    ("sections", "/END\n", "/END\n/END\n", "/END /END"),
    ("sections", "/END\n", "/END\nmore\n", "in no section"),
    ("sections", "/PROG", "first\n/PROG", "in no section"),
    ("sections", "/POS\n", "/APPL\n/POS\n", "/APPL stands between"),
    ("sections", "/MN\n", "/MN x\n", "'x' stands behind /MN"),
    ("program-name", "/PROG  CALPOSE", "/PROG  " + 37 * "C", "36 characters"),
    ("program-name", "/PROG  CALPOSE", "/PROG  7CAL", "a letter"),
    ("attribute", "PROTECT", "PROTCT", "PROTECT is"),
    ("attribute", "READ_WRITE", "READ_WRIT", "cannot stand"),
    ("attribute", "DEFAULT_GROUP", "DEFAULT_GRUP", "DEFAULT_GROUP is"),
    ("attribute", "VERSION\t\t= 0;", "VERSION\t\t= 0", "not complete"),
    ("attribute", "FILE_NAME\t= ;", "FILE_NAME\t= ,", "cannot stand"),
    ("line-format", "   5:  WAIT", "   X:  WAIT", "its number"),
    ("instruction", "!PLAN abcdef12 2", "WAIT", "'WAIT' is not complete"),
    ("instruction", "WAIT   1.00(sec) ;\n   6", "WAIT SAC 1.00(sec) ;\n   6", "SAC"),
    ("instruction", "WAIT   1.00(sec) ;\n   6", "WAIT   1_0(sec) ;\n   6", "_0"),
    ("instruction", "!PLAN abcdef12 2", "WAIT 0.5 sec", "'sec' cannot stand behind"),
    ("instruction", "CALL MEASURE(2)", "CALL", "'CALL' is not complete"),
    ("instruction", "!PLAN abcdef12 2", "UFRAM_NUM=0", "UFRAME_NUM is"),
    ("instruction", "!PLAN abcdef12 2", "DO[1]=AN", "German"),
    ("instruction", "!PLAN abcdef12 2", "R[1]=1.5E-6", "cannot stand"),
    ("instruction", "P[1] 10% FINE", "P[1] FINE", "FINE"),
    ("instruction", "P[1] 10% FINE", "P[1] 10% FINE FINE", "FINE is"),
    ("negative-argument", "MEASURE(1)", "MEASURE(-1)", "(-1)"),
    ("negative-argument", "MEASURE(1)", "MEASURE(1,-1)", "(-1)"),
    ("negative-argument", "!PLAN abcdef12 2", "IF (R[1]<-2.5),ABORT", "(-1)"),
    ("negative-argument", "!PLAN abcdef12 2", "FOR R[1]=1 TO -2", "(-1)"),
    ("block", "!PLAN abcdef12 2", "IF (R[1]=1) THEN", "never closed"),
    ("block", "!PLAN abcdef12 2", "ENDFOR", "closes nothing"),
    ("instruction", "!PLAN abcdef12 2", "STRANGE]", "a bracket is not closed"),
    ("position-format", "\tUF : 0, UT : 1,\t\n", "", "P[1] has no UF and UT"),
    ("speed", "P[1] 10% FINE", "P[1] 0% FINE", "from 1% to 100%"),
    ("speed", "P[1] 10% FINE", "P[1] 150% FINE", "from 1% to 100%"),
    ("speed", "P[1] 10% FINE", "P[1] 10mm/sec FINE", "no speed of this kind"),
    ("position-format", "};\nP[2", "P[2", "is not complete"),
    ("position-format", "};\n/END", "/END", "is not complete"),
    ("position-format", "J1=     1.000 deg,\t", "", "J2 J3 J4 J5 J6, not J1 to J6"),
    ("position-format", "J3=     1.000 deg,\n", "J3=     1.000 deg\n", "cannot stand"),
    ("position-format", "J6=     6.000 deg", "J6=     6.000 deg,", "cannot stand"),
    ("position-format", "J6=     6.000 deg", "J6=     6.000 deg; rubbish", "cannot stand"),
    ("position-format", "1.000 deg,\tJ2=    -2", "1e0 deg,\tJ2=    -2", "cannot stand"),
    ("position-format", "1.000 deg,\tJ2=     2", "NaN deg,\tJ2=     2", "cannot stand"),
    ("configuration", "UT : 1,\t", "UT : 1,\tCONFIG : 'N U T, 0, 0, 0',", "P[1] has a CONFIG"),
    ("range", "J1=     1.000", "J1=   721.000", "J1 is 721.000"),
    ("position-defined", "!PLAN abcdef12 2", "PR[1]=P[3]", "P[3] is not there"),
    ("position-unique", "/END", P2 + "/END", "P[2] is there twice"),
    ("frame", "UFRAME_NUM=0", "UFRAME_NUM=1", "P[1] has UF 0, UFRAME_NUM is 1"),
    ("frame", "UTOOL_NUM=1", "UTOOL_NUM=2", "P[1] has UT 1, UTOOL_NUM is 2"),
    ("frame", "  CALL MEASURE(1)", "  UTOOL_NUM=2", "P[2] has UT 1, UTOOL_NUM is 2"),
]
MEASURING = [
    ("crlf", "OWNER", "\rOWNER", ""),
    ("line-count", "LINE_COUNT\t= 9;", "LINE_COUNT\t= 8;", "/MN has 9 lines"),
    ("line-count", "LINE_COUNT\t= 9;\n", "", "no LINE_COUNT"),
    ("program-name", "/PROG  CALPOSE", "/PROG  calpose", "a letter"),
    ("line-number", "   5:  WAIT", "   4:  WAIT", "line number 4 where 5 is due"),
    ("instruction", "CALL MEASURE(2)", "CALLMEASURE(2)", "CALL is"),
    ("instruction", "CALL MEASURE(2)", "MEASURE(2)", "CALL is"),
    ("label", "!PLAN abcdef12 2", "JMP LBL[7]", "LBL[7] is not there"),
    ("label", "WAIT   1.00(sec) ;\n   6:  CALL MEASURE(1)", TWICE, "LBL[7] is there twice"),
    ("unit", "J1=     1.000 deg", "J1=     1.000  mm", "J1 is in mm, not in deg"),
    ("line-format", "   5:  WAIT", "5:  WAIT", "right-aligned"),
    ("line-format", "   5:  WAIT", "   5: WAIT", "two spaces"),
    ("line-format", ":J P[1]", ": J P[1]", "right behind the colon"),
    ("position-format", "   GP1:", "   GP2:", "P[1] has no GP1"),
    ("position-used", "/END", P2.replace("P[2", "P[3") + "/END", "P[3] is never used"),
    ("position-value", "J1=     1.000", "J1=  ********", "J1 has no value"),
    ("elsewhere", "P[1] 10% FINE", "P[1] 10% FINE INC", "moves to another place"),
    ("elsewhere", "P[1] 10% FINE", "P[1] 10% FINE Offset,PR[1]", "moves to another place"),
    ("frames-set", "UTOOL_NUM=1", "UTOOL_NUM=R[1]", "UTOOL_NUM is not set"),
    ("fine-before-call", "P[1] 10% FINE", "P[1] 10% CNT0", "standstill (FINE) before the CALL"),
    ("fine-before-call", "!PLAN abcdef12 2", "CALL INIT", "standstill"),
]


@pytest.mark.parametrize(("rule", "old", "new", "message"), ERRORS)
def test_what_a_controller_refuses(rule: str, old: str, new: str, message: str) -> None:
    breaks(check(changed(GOOD, old, new), "error"), rule, message)


@pytest.mark.parametrize(("rule", "old", "new", "message"), MEASURING[1:])
def test_what_would_not_measure_as_planned(rule: str, old: str, new: str, message: str) -> None:
    text = changed(GOOD, old, new)
    assert check(text, "error") == []
    breaks(check(text, "measuring"), rule, message)


@pytest.mark.parametrize(
    ("rule", "old", "new", "message"),
    [
        ("configuration", "\t\tCONFIG : 'N U T, 0, 0, 0',", "", "P[2] has no CONFIG"),
        ("configuration", "'N U T", "'Q U T", "no CONFIG 'Q U T"),
        ("configuration", "'N U T", "'N T", "no CONFIG 'N T"),
        ("range", "180.000 deg,\tP", "270.000 deg,\tP", "W is 270.000"),
        ("unit", "900.000  mm", "900.000 deg", "X is in deg, not in mm"),
        ("frame", "UF : 0, UT : 1,\t\tCON", "UF : 0, UT : 0,\t\tCON", "P[2] has UT 0"),
    ],
)
def test_a_pose_that_breaks_one_rule(rule: str, old: str, new: str, message: str) -> None:
    text = GOOD.replace(P2[P2.index("\tUF") :], CARTESIAN)
    assert text.count(old) == 1
    (problem,) = [p for p in check(text.replace(old, new)) if p.rule == rule]
    assert message in problem.message


EXPORT = export("fanuc_german.LS")
"""In the manner of exports of a German controller of a car maker."""


def test_the_export_of_a_german_controller_is_valid() -> None:
    assert check(EXPORT, "error") == []
    assert {p.rule for p in check(EXPORT, "note")} == {"text", "instruction"}
    assert "an application's own" in " ".join(p.message for p in check(EXPORT, "note"))


@pytest.mark.parametrize(
    "code",
    [
        "IF (!F[1:ON :Part in Grip]),JMP LBL[1] ;\n  11:  LBL[1:go on]",
        "IF (R[100:*Sts ID]<>10 AND R[100:*Sts ID]<>(-11)),R[1]=(R[1]+1)",
        "WAIT DI[193:OFF:Retract]=ON AND DI[194:ON :Extend]=OFF TIMEOUT,LBL[1] ;\n  11:  LBL[1]",
        "SELECT R[20:Num]=1,CALL SUB_1 ;\n  11:         =2,CALL SUB_2 ;\n  12:         ELSE,ABORT",
        "PR[GP1:1,7:Trolley]=PR[GP1:1,7:Trolley]+R[15:Trolley INC]",
        "GO[10:CurTCPX]=(PR[84,1:CurrentToolData]*10)",
        "R[37]=$MNUTOOLNUM[1]",
        "DO[43:Fin Prise]=PULSE,0.5sec",
        "FOR R[1]=1 TO R[2:count] ;\n  11:  ENDFOR",
        "CALL FAULT_MESSAGE('Machine failed to start.','Check it')",
        "MESSAGE[Fin du programme.]",
        "PROGRAM VERIFY(8)",
        "Arc Start[1]",
        "VISION RUN_FIND 'FIND1'",
        "PR[R[3]]=VR[1].OFFSET ;\n  11:  R[57]=VR[1].MES[1]",
        "R[1]=STRLEN SR[2:text] ;\n  11:  SR[1]=SUBSTR SR[2],R[1],4",
        "R[6]=(ABS[R[5:value]]+ATAN2[R[1],R[2]])",
        "IF PL[1]<>[1,1,2],JMP LBL[1] ;\n  11:  LBL[1]",
        "LINEAR_MAX_SPEED=5 ;\n  11:  RESUME_PROG[1]=BACK ;\n  12:  ERROR_PROG=ALL",
        "WHEN DI[1]=ON+,CALL STOP_IT",
        "CALL set_it('MENU',1) ;\n  11:  RUN -LOGGER-",
        "if (R[1]>10 and AI[3]>5) then ;\n  11:  Jmp Lbl[1] ;\n  12:  endif ;\n  13:  LBL[1]",
        "AT POUNCE ;\n  11:  ENTER I-ZONE(5) ;\n  12:  GO TO HOME POS",
        "GRIPPER(2) ;\n  11:  END CONDITION ON ;\n  12:  FORCE CTRL[2:JIG]",
        "CALL ENDE ;\n  11:  ZANGE AUS",
        "R[1:way [mm]]=5 ;\n  11:  MESSAGE[no part in DI[1]]",
        "J PR[1] R[108:Transit]% CNT100 ;\n  11:L PR[1] max_speed CNT0",
        "L PR[1] 9mm/sec FINE TB R[5]sec,CALL ALL ;\n  11:L PR[1] 9mm/sec FINE DB    0.0mm,CALL A",
        "L PR[1] 100cm/min FINE OFFSET, PR[1]",
        "L PR[1] 100mm/sec FINE\n    :  SPOT[BU=*,S=1,ANTIC(B=300,G=150)] UPDET_OFS=3.0mm",
        "L PR[1] 100mm/sec CNT100 SS[R[1]] ;\n  11:L PR[1] 100mm/sec CR10mm SE",
        "L PR[1] 100mm/sec FINE HighSpeedSkip,LBL[1],PR[1]=LPOS Search[X],PR[2] Corner 20,30",
        "L PR[1] 100mm/sec CR R[1] DB  -5.0mm,DO[1]=ON CTV-50",
        "C PR[1] Tool_Offset,PR[28]\n    :  PR[2] R[23]mm/sec CNT100 Tool_Offset,PR[29]",
        "UFRAME_NUM[GP1,2]=0 ;\n  11:  PR[GP1,3:11,1]=PR[GP1,3:11,1]-R[134]",
        "PAYLOAD[GP1,2:3] ;\n  11:  PR[GP1,2:5]=JPOS",
        "WAIT NEXT PATH ;\n  11:  IF SDI[1]=ON,SDO[1]=ON ;\n  12:  R[1]=GIN[2]",
        "LINE[1] ON ;\n  11:  SPO[1]=ON ;\n  12:  AA[1] ;\n  13:  EV=50",
        "IF (DI[1]),UALM[1] ;\n  11:  IF (DI[1]),OVERRIDE=50%",
        "IF (DI[1]),UTOOL_NUM=1 ;\n  11:  IF (DI[1]),L PR[1] 100mm/sec FINE",
        "IF (PR[GP1:11,1]<(-150))PR[GP1:11,1]=(-150) ;\n  11:  IF ((R[14]<=R[3]),R[15]=(1))",
        "IF (F[3]),CALL ...(...) ;\n  11:  R[...]=... ;\n  12:L P[...] 100mm/sec FINE",
        "CALL VW_USER(Basic1,EZSP,Nr1 Service,ProgNr=31, , ,S-Punkt=31, ,EIN/AUS=1)",
        "MAINT_PROG[1]=X ;\n  11:  RESUME_PROG[1:back]=X ;\n  12:  RUN SR[1]",
    ],
)
def test_what_exported_programs_hold_is_no_error(code: str) -> None:
    number = code.count(" ;\n") + 10
    text = GOOD.replace("\n/POS", f"\n  10:  {code} ;\n/POS")
    text = text.replace("LINE_COUNT\t= 9", f"LINE_COUNT\t= {number}")
    assert check(text, "error") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("/PROG  CALPOSE", "/PROG  Cal_pose\t\tProcess"),
        ("/PROG  CALPOSE", "/PROG  CALPOSE\t  Job"),
        ("FILE_NAME\t= ;", "FILE_NAME\t= CALPOSE\t  Process;"),
        ("VERSION\t\t= 0;", "VERSION\t\t= 0;\nSTORAGE\t\t= SHADOW ONDEMAND;"),
        ("OWNER\t\t= MNEDITOR;", "OWNER\t\t= 3rd shift;"),
        ("UFRAME_NUM=0 ;", "UFRAME_NUM=0 ;\n   3:  UFRAME_NUM[GP2]=7 ;"),
        ("   5:  WAIT", "   5:  !by hand ;\n   5:  WAIT"),
        (P2[P2.index("\tUF") :], CARTESIAN.replace("N U T, 0, 0, 0", "U T, 0, 0")),
        (P2[P2.index("\tJ4") :], "\tJ4=    -4.000 deg\n};\n"),
        (GOOD[GOOD.index("/ATTR") : GOOD.index("/MN")], ""),
        ('";', '"'),
    ],
)
def test_heads_and_positions_of_others_are_no_error(old: str, new: str) -> None:
    assert check(changed(GOOD, old, new), "error") == []


def test_lines_without_numbers_are_instructions_of_their_own() -> None:
    text = GOOD
    for number in range(1, 10):
        text = text.replace(f"\n{number:4d}:", "\n    :")
    assert check(text, "error") == []
    wrong = text.replace("UTOOL_NUM=1", "UTOOL_NUM=2")
    assert {p.rule for p in check(wrong, "error")} == {"frame"}


def test_behind_a_label_or_a_call_frames_are_not_known() -> None:
    text = GOOD.replace("UTOOL_NUM=1", "UTOOL_NUM=2").replace("!PLAN abcdef12 2", "LBL[1]")
    assert {p.rule for p in check(text, "error")} == {"frame"}
    text = GOOD.replace("UTOOL_NUM=1 ;", "UTOOL_NUM=2 ;\n   4:  LBL[1] ;")
    assert check(text, "error") == []


def test_a_gap_in_the_numbers_is_told_once() -> None:
    text = GOOD
    for number in range(9, 4, -1):
        text = text.replace(f"{number:4d}:", f"{number + 2:4d}:")
    assert [(p.line, p.rule) for p in check(text)] == [(line_of("   5:"), "line-number")]


def test_a_position_chosen_by_a_register_may_be_any() -> None:
    assert check(GOOD.replace("J P[2]", "J P[R[1:next]]")) == []
