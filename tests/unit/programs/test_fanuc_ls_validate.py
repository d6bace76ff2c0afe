"""FANUC .LS: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs import (
    DIALECTS,
    PoseProgram,
    Problem,
    ProgramOptions,
    ProgramPose,
    validate,
)
from posedesign.programs.fanuc_ls import rules
from posedesign.programs.fanuc_ls.rules import MOST_PROBLEMS, check_fanuc_ls
from posedesign.programs.reading import MOST_BYTES

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


def check(text: str) -> list[Problem]:
    return check_fanuc_ls(text.replace("\n", "\r\n").encode("latin-1"))


def line_of(text: str) -> int:
    (row,) = [i for i, line in enumerate(LINES, start=1) if text in line]
    return row


def test_a_good_file_has_no_problems(tmp_path: Path) -> None:
    assert check(GOOD) == []
    path = tmp_path / "CALPOSE.LS"
    path.write_bytes(GOOD.replace("\n", "\r\n").encode())
    assert validate(path) == []


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
        ("MEASURE(1)", "MEASURE((-1))"),
        ("MEASURE(1)", "MEASURE('it, -1, was 1e5')"),
        ("J P[1] 10% FINE    ;", "C P[1]    \n    :  P[1] 10mm/sec FINE    ;"),
        (P2[P2.index("\tUF") :], CARTESIAN),
    ],
)
def test_what_controllers_write_too_is_accepted(old: str, new: str) -> None:
    assert GOOD.count(old) == 1
    assert check(GOOD.replace(old, new)) == []


ONE_RULE = [
    ("ascii", "!PLAN", "!PL\u00e4N", "0xe4"),
    ("ascii", "!PLAN", "!PL\0N", "0x00"),
    ("crlf", "OWNER", "OWN\rER", "CR inside"),
    ("sections", "/END\n", "", "/PROG /ATTR /MN /POS"),
    ("sections", "/END\n", "/END\n/END\n", "/END /END"),
    ("sections", "/END\n", "/END\nmore\n", "in no section"),
    ("sections", "/PROG", "first\n/PROG", "in no section"),
    ("sections", "/POS\n", "/APPL\n/POS\n", "/APPL stands between"),
    ("program-name", "/PROG  CALPOSE", "/PROG  " + 37 * "C", "36 characters"),
    ("program-name", "/PROG  CALPOSE", "/PROG  calpose", "a letter"),
    ("program-name", "/PROG  CALPOSE", "/PROG  7CAL", "a letter"),
    ("program-name", "/PROG  CALPOSE", "/PROG CALPOSE", "two spaces"),
    ("line-format", "   5:  WAIT", "5:  WAIT", "right-aligned"),
    ("line-format", "   5:  WAIT", "     WAIT", "its number"),
    ("line-format", "   5:  WAIT", "   5: WAIT", "two spaces"),
    ("line-format", "1.00(sec) ;\n   6", "1.00(sec)\n   6", "ends in ' ;'"),
    ("line-number", "   5:  WAIT", "   4:  WAIT", "line number 4 where 5 is due"),
    ("line-count", "LINE_COUNT\t= 9;", "LINE_COUNT\t= 8;", "LINE_COUNT is 8, /MN has 9"),
    ("line-count", "LINE_COUNT\t= 9;\n", "", "no LINE_COUNT"),
    ("position-format", "};\nP[2", "P[2", r"P[1] is not closed"),
    ("position-format", "};\n/END", "/END", r"P[2] is not closed"),
    ("position-format", "};\nP[2", "};\n\nrubbish\nP[2", "'rubbish' is outside"),
    ("position-format", "J1=     1.000 deg,\t", "", "J2 J3 J4 J5 J6, not J1 to J6"),
    ("position-format", "J3=     1.000 deg,\n", "J3=     1.000 deg\n", "no comma before"),
    ("position-format", "J6=     6.000 deg", "J6=     6.000 deg,", "comma behind its last"),
    ("position-format", "J6=     6.000 deg", "J6=     6.000 deg, J7=     6.000 deg", "J7"),
    ("position-format", "J6=     6.000 deg", "J6=     6.000 deg; rubbish", "cannot be under"),
    ("position-format", "   GP1:\n", "", "no group GP1"),
    ("configuration", "UT : 1,\t", "UT : 1,\tCONFIG : 'N U T, 0, 0, 0',", "P[1] has a CONFIG"),
    ("unit", "J1=     1.000 deg", "J1=     1.000  mm", "J1 is in mm, not in deg"),
    ("range", "J1=     1.000", "J1=   721.000", "J1 is 721.000"),
    ("motion", "P[1] 10% FINE", "P[1] 0% FINE", "from 1% to 100%"),
    ("motion", "P[1] 10% FINE", "P[1] 150% FINE", "from 1% to 100%"),
    ("motion", "P[1] 10% FINE", "P[1] FINE", "a position, a speed"),
    ("motion", "P[1] 10% FINE", "P[1] 10mm/sec FINE", "a position, a speed"),
    ("motion", "P[1] 10% FINE", "P[1] 10% FINE INC", "INC moves to another place"),
    ("motion", "P[1] 10% FINE", "P[1] 10% FINE Offset,PR[1]", "moves to another place"),
    ("motion", "P[1] 10% FINE", "P[1] 10% FINE FAST", "'FAST' is not known"),
    ("instruction", "!PLAN abcdef12 2", "FOO BAR", "no instruction 'FOO BAR'"),
    ("instruction", "!PLAN abcdef12 2", "WAIT", "no instruction 'WAIT'"),
    ("instruction", "!PLAN abcdef12 2", "WAIT 0.5 sec", "no instruction"),
    ("instruction", "CALL MEASURE(2)", "CALL", "no instruction 'CALL'"),
    ("position-defined", "!PLAN abcdef12 2", "PR[1]=P[3]", "P[3] is not defined"),
    ("position-unique", "/END", P2 + "/END", "P[2] is defined twice"),
    ("position-used", "/END", P2.replace("P[2", "P[3") + "/END", "P[3] is never used"),
    ("frame", "UFRAME_NUM=0", "UFRAME_NUM=1", "P[1] has UF 0, UFRAME_NUM is 1"),
    ("frame", "UTOOL_NUM=1", "UTOOL_NUM=2", "P[2] has UT 1, UTOOL_NUM is 2"),
    ("frame", "UTOOL_NUM=1", "UTOOL_NUM=R[1]", "UTOOL_NUM is not set"),
    ("frame", "  CALL MEASURE(1)", "  UTOOL_NUM=2", "P[2] has UT 1, UTOOL_NUM is 2"),
    ("fine-before-call", "P[1] 10% FINE", "P[1] 10% CNT0", "standstill (FINE) before the CALL"),
    ("fine-before-call", "!PLAN abcdef12 2", "CALL INIT", "standstill"),
    ("number", "1.000 deg,\tJ2=    -2", "1e0 deg,\tJ2=    -2", "J1 is '-1e0'"),
    ("number", "1.000 deg,\tJ2=     2", "NaN deg,\tJ2=     2", "J1 is 'NaN'"),
    ("number", "J1=     1.000", "J1=    -0.000", "J1 is '-0.000'"),
    ("number", "J1=     1.000", "J1=  ********", "J1 is '********'"),
    ("number", "!PLAN abcdef12 2", "R[1]=1.5E-6", "exponents"),
    ("number", "!PLAN abcdef12 2", "R[1]=nan", "NaN"),
    ("negative-argument", "MEASURE(1)", "MEASURE(-1)", "(-1)"),
    ("negative-argument", "MEASURE(1)", "MEASURE(1,-1)", "(-1)"),
    ("negative-argument", "!PLAN abcdef12 2", "IF (R[1]<-2.5),JMP LBL[1]", "(-1)"),
    ("negative-argument", "!PLAN abcdef12 2", "FOR R[1]=1 TO -2", "(-1)"),
]


@pytest.mark.parametrize(("rule", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(rule: str, old: str, new: str, message: str) -> None:
    text = GOOD.replace(old, new, 1)
    assert text != GOOD
    problems = check(text)
    assert {problem.rule for problem in problems} == {rule}
    assert message in " ".join(problem.message for problem in problems)


@pytest.mark.parametrize(
    ("rule", "old", "new", "message"),
    [
        ("configuration", "\t\tCONFIG : 'N U T, 0, 0, 0',", "", "P[2] has no CONFIG"),
        ("configuration", "'N U T", "'Q U T", "no CONFIG 'Q U T"),
        ("range", "180.000 deg,\tP", "270.000 deg,\tP", "W is 270.000"),
        ("range", "180.000 deg,\tP", "-180.000 deg,\tP", "W is -180.000"),
        ("unit", "900.000  mm", "900.000 deg", "X is in deg, not in mm"),
        ("frame", "UF : 0, UT : 1,\t\tCON", "UF : 0, UT : 0,\t\tCON", "count from 1"),
    ],
)
def test_a_pose_that_breaks_one_rule(rule: str, old: str, new: str, message: str) -> None:
    text = GOOD.replace(P2[P2.index("\tUF") :], CARTESIAN)
    assert text.count(old) == 1
    problems = check(text.replace(old, new))
    assert [problem.rule for problem in problems] == [rule]
    assert message in problems[0].message


def test_frames_left_open_and_sub_lines_are_what_controllers_write() -> None:
    text = GOOD.replace("UF : 0, UT : 1,", "UF : F, UT : F,").replace('P[2:"T2"]{', "P[2] {")
    text = text.replace(
        "!PLAN abcdef12 2 ;", "TC_ONLINE ON ;\n      1:  A[1]=ON ;\n       ------ ;"
    )
    assert check(text) == []


def test_every_rule_has_such_a_file() -> None:
    documented = {
        line[2 : line.index("``", 2)]
        for line in (rules.__doc__ or "").splitlines()
        if line.startswith("``")
    }
    assert documented == {rule for rule, *_ in ONE_RULE}


def test_sections_in_another_order() -> None:
    mn, pos, end = GOOD.index("/MN"), GOOD.index("/POS"), GOOD.index("/END")
    problems = check(GOOD[:mn] + GOOD[pos:end] + GOOD[mn:pos] + GOOD[end:])
    assert [p.rule for p in problems] == ["sections"]
    assert "/PROG /ATTR /POS /MN /END" in problems[0].message


def test_line_ends() -> None:
    assert check_fanuc_ls(GOOD.encode()) == [
        Problem(1, "crlf", f"{len(LINES)} lines are not ended by CR LF, this the first")
    ]
    cut = GOOD.replace("\n", "\r\n").removesuffix("\r\n").encode()
    assert [(p.line, p.rule) for p in check_fanuc_ls(cut)] == [(len(LINES), "crlf")]


def test_problems_name_their_lines_in_order() -> None:
    text = GOOD.replace("UTOOL_NUM=1", "UTOOL_NUM=2").replace("MEASURE(2)", "MEASURE(-2)")
    assert [(p.line, p.rule) for p in check(text)] == [
        (line_of("J P[1]"), "frame"),
        (line_of("J P[2]"), "frame"),
        (line_of("CALL MEASURE(2)"), "negative-argument"),
    ]
    first = check(text)[0]
    assert str(first) == f"line {first.line}: P[1] has UT 1, UTOOL_NUM is 2 [frame]"


def test_a_gap_in_the_numbers_is_told_once() -> None:
    text = GOOD
    for number in range(9, 4, -1):
        text = text.replace(f"{number:4d}:", f"{number + 2:4d}:")
    assert [(p.line, p.rule) for p in check(text)] == [(line_of("   5:"), "line-number")]


def test_a_position_chosen_by_a_register_may_be_any() -> None:
    text = GOOD.replace("J P[2]", "J P[R[1:next]]")
    assert check(text) == []


def test_a_file_of_rubbish_is_not_told_line_by_line() -> None:
    problems = check("/PROG  A\n/MN\n" + "rubbish\n" * 5000)
    assert len(problems) < 2 * MOST_PROBLEMS
    assert {p.rule for p in problems} == {"sections", "line-format"}


def test_an_empty_file_has_problems() -> None:
    assert {p.rule for p in check_fanuc_ls(b"")} == {"sections", "line-count"}


def test_a_huge_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "X.LS"
    with path.open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    with pytest.raises(FileFormatError, match="is larger than 20 MB"):
        validate(path)
