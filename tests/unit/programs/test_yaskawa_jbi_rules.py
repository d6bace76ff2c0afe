"""Yaskawa jobs: each rule of the strict validator, by a file that breaks it and no other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from posedesign.programs import Arm, PoseProgram, Problem, ProgramOptions, ProgramPose
from posedesign.programs.yaskawa_jbi import YaskawaJbi, rules
from posedesign.programs.yaskawa_jbi.rules import MOST_PROBLEMS, check_yaskawa_jbi

OPTIONS = ProgramOptions(
    fingerprint="abcdef12",
    comment="cell 7",
    measure_output=3,
    pulses_per_deg=(1000.0, 2000.0, 1500.0, 1000.0, 900.0, 500.0),
)
POSES = tuple(ProgramPose(f"T{i}", np.radians([i, 2, 3, 4, 5, 6])) for i in (1, -1))
(GOOD,) = YaskawaJbi().render(PoseProgram("CALPOSE", POSES, OPTIONS), Arm.usual("yaskawa")).values()
RECTAN = """\
///POSTYPE BASE
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00000=800.000,-10.500,614.000,180.0000,-0.0500,0.0000
C00001=800.000,0.000,614.000,180.0000,0.0000,0.0000
//INST
///DATE 2000/01/01 00:00
///COMM cell 7
///ATTR SC,RW,RJ
////FRAME BASE
"""
POSES_JOB = GOOD[: GOOD.index("///POSTYPE")] + RECTAN + GOOD[GOOD.index("///GROUP1") :]


def check(text: str) -> list[Problem]:
    return check_yaskawa_jbi(text.replace("\n", "\r\n").encode("latin-1"))


def test_good_files_have_no_problems(tmp_path: Path) -> None:
    assert check(GOOD) == []
    assert check(POSES_JOB) == []
    path = tmp_path / "CALPOSE.JBI"
    path.write_bytes(GOOD.replace("\n", "\r\n").encode())
    assert YaskawaJbi().validate(path) == []


@pytest.mark.parametrize(
    ("source", "old", "new"),
    [
        (GOOD, "///TOOL 1", "///TOOL 1,2"),
        (GOOD, "SC,RW", "SC,RO"),
        (GOOD, "RB1\n", "RB1,BS1\n///GROUP2 ST1\n"),
        (GOOD, "CALPOSE", "TOUCH_UP-OF-CELL-7-AFTER-SERVICE"),
        (POSES_JOB, "180.0000", "-180.0000"),
        (POSES_JOB, "180.0000", "-180.00"),
        (GOOD, "///TOOL 1", "///TOOL 63"),
        (GOOD, "VJ=10.00 PL=0", "VJ=I000 PL=0 NWAIT ACC=20 UNTIL IN#(1)=ON"),
        (GOOD, "TIMER T=1.00", "*LABEL\nTIMER T=1.00"),
        (GOOD, "TIMER T=1.00", "MEASURE_7 MJ#(0)\nTIMER T=1.00"),
        (GOOD, "TIMER T=1.00", "SET D000 EXPRESS D001 + 2\nDOUT OT#(3) ON\nRET"),
        (GOOD, "TIMER T=1.00", "\tTIMER T=B000"),
        (GOOD, "SET I000 1", "SET I000 B003"),
        (GOOD, "CALL JOB:MEASURE", "CALL JOB:measure-1 IF IN#(1)=ON"),
        (GOOD, "CALL JOB:MEASURE", "CALL JOB:MEASURE ARGF1"),
        (POSES_JOB, "////FRAME", "///FRAME"),
        (POSES_JOB, "0,0,0,0,0,0,0\n", "0,0,0,0,0" + ",0" * 18 + "\n"),
        (
            POSES_JOB.replace("////FRAME BASE", "////FRAME USER 12"),
            "///POSTYPE BASE",
            "///USER 12\n///POSTYPE USER",
        ),
    ],
)
def test_what_controllers_write_too_is_accepted(source: str, old: str, new: str) -> None:
    assert old in source
    assert check(source.replace(old, new, 1)) == []


ONE_RULE = [
    ("ascii", GOOD, "'PLAN", "'PL\u00e4N", "0xe4"),
    ("ascii", GOOD, "'PLAN", "'PL\0N", "0x00"),
    ("crlf", GOOD, "'PLAN", "'PL\rN", "CR inside"),
    ("sections", GOOD, "END\n", "", "where END is due"),
    ("sections", GOOD, "NOP\n", "", "where NOP is due"),
    ("sections", GOOD, "END\n", "END\nNOP\n", "where END is due"),
    ("sections", GOOD, "/JOB\n", "/JOB\n//NAM X\n", "belongs nowhere"),
    ("sections", GOOD, "///TOOL", "///TOL 3\n///TOOL", "belongs nowhere"),
    ("job-name", GOOD, "CALPOSE", "C" * 33, "32 characters"),
    ("job-name", GOOD, "CALPOSE", "CAL POSE", "letters, digits"),
    ("job-name", GOOD, "//NAME CALPOSE\n", "", "one //NAME"),
    ("header", GOOD, "///DATE 2000/01/01 00:00\n", "", "///DATE is missing"),
    ("header", GOOD, "2000/01/01", "01.01.2000", "///DATE is missing or malformed"),
    ("header", GOOD, "SC,RW", "RW", "///ATTR"),
    ("header", GOOD, "///GROUP1 RB1\n", "", "///GROUP1"),
    ("header", GOOD, "cell 7", "c" * 33, "longer than 32"),
    ("npos", GOOD, "NPOS 2,", "NPOS 3,", "there are 2,0,0,0,0,0"),
    ("npos", GOOD, "NPOS 2,0,0,0,0,0", "NPOS 2", "there are 2,0,0,0,0,0"),
    ("npos", GOOD, "///NPOS 2,0,0,0,0,0\n", "", "///NPOS is ''"),
    ("position-format", GOOD, "///TOOL 1\n", "", "has no ///TOOL"),
    ("position-format", GOOD, "POSTYPE PULSE", "POSTYPE BASE", "is in BASE and PULSE"),
    ("position-format", GOOD, "C00001=-1000,", "C00001=", "has 5 values"),
    ("number", GOOD, "C00001=-1000,", "C00001=-1000.5,", "'-1000.5' is not a whole number"),
    ("number", GOOD, "C00001=-1000,", "C00001=-0,", "'-0' is not a whole number"),
    ("number", GOOD, "C00001=-1000,", "C00001=1e3,", "not a whole number"),
    ("number", GOOD, "C00001=-1000,", "C00001=9999999999,", "not a whole number"),
    ("number", POSES_JOB, "=800.000", "=800.0000", "at most 3 decimals"),
    ("number", POSES_JOB, "=800.000", "=8e2", "at most 3 decimals"),
    ("number", POSES_JOB, "=800.000", "=-0.000", "is minus zero"),
    ("number", POSES_JOB, "180.0000", "-180.0001", "not in [-180, 180]"),
    ("rconf", POSES_JOB, "///RCONF 1,0,0,0,0,0,0,0\n", "", "///RCONF is ''"),
    ("rconf", POSES_JOB, "RCONF 1,", "RCONF 2,", "///RCONF is '2,"),
    ("rconf", POSES_JOB, "RCONF 1,", "RCONF 1,0,", "///RCONF is '1,0,"),
    ("relative-job", POSES_JOB, ",RJ\n", "\n", "is not relative"),
    ("relative-job", POSES_JOB, "////FRAME BASE\n", "", "no ////FRAME"),
    ("relative-job", POSES_JOB, "FRAME BASE", "FRAME USER 2", "has ////FRAME USER 2"),
    ("position-defined", GOOD, "MOVJ C00000", "MOVJ C00000 +MOVJ C00002", "C00002 is not there"),
    ("position-used", GOOD, "MOVJ C00001", "MOVJ P001", "C00001 is never moved to"),
    ("stop-before-call", GOOD, " PL=0\nTIMER", "\nTIMER", "no move with PL=0"),
    ("stop-before-call", GOOD, " PL=0\nTIMER", " PL=1\nTIMER", "no move with PL=0"),
    ("stop-before-call", GOOD, "NOP\n", "NOP\nCALL JOB:INIT\n", "no move with PL=0"),
    ("argument", GOOD, "VJ=10.00", "VJ=100.01", "VJ= is '100.01'"),
    ("argument", GOOD, "VJ=10.00", "VJ=10.0", "with two decimals"),
    ("argument", GOOD, "VJ=10.00", "VJ=10", "with two decimals"),
    ("argument", GOOD, "VJ=10.00", "VJ=0.00", "VJ= is '0.00'"),
    ("argument", GOOD, "TIMER T=1.00", "TIMER T=655.36", "T= is '655.36'"),
    ("argument", GOOD, "TIMER T=1.00", "TIMER T=0.00", "T= is '0.00'"),
    ("argument", GOOD, "T=0.50", "T=0.505", "T= is '0.505'"),
    ("argument", GOOD, "SET I000 1", "SET I000 32768", "an I variable is '32768'"),
    ("argument", GOOD, "JOB:MEASURE", "JOB:" + "M" * 33, "calls no job"),
    ("argument", GOOD, "JOB:MEASURE", "MEASURE", "calls no job"),
    ("instruction", GOOD, "SET I000 1", "SETT I000 1", "'SETT' is no instruction"),
    ("instruction", GOOD, "TIMER T=1.00", "TIMER 1.00", "is not a whole TIMER"),
    ("instruction", GOOD, "SET I000 1", "SET I000", "is not a whole SET"),
    ("instruction", GOOD, "PULSE OT#(3)", "PULSE (3)", "is not a whole PULSE"),
    ("instruction", GOOD, "VJ=10.00", "VJJ=10.00", "'VJJ=10.00' does not belong to MOVJ"),
    ("instruction", GOOD, "VJ=10.00", "10.00", "'10.00' does not belong to MOVJ"),
    ("instruction", GOOD, "NOP\n", "NOP\nMOVJJ C00000 VJ=10.00\n", "'MOVJJ' is no"),
    ("position-format", GOOD, "///TOOL 1", "///TOOL 64", "///TOOL is 64, not 0 to 63"),
    ("comment", GOOD, "'POSE 1 T1", "'" + "x" * 33, "longer than 32"),
    ("length", GOOD, "NOP\n", "NOP\n" + "'\n" * 10000, "at most 9999"),
    (
        "position-unique",
        GOOD.replace("NPOS 2", "NPOS 3"),
        "//INST",
        "C00001=0,0,0,0,0,0\n//INST",
        "C00001 is there twice",
    ),
]


@pytest.mark.parametrize(("rule", "source", "old", "new", "message"), ONE_RULE)
def test_a_file_that_breaks_one_rule(
    rule: str, source: str, old: str, new: str, message: str
) -> None:
    assert old in source
    problems = check(source.replace(old, new, 1))
    assert {problem.rule for problem in problems} == {rule}
    assert message in " ".join(problem.message for problem in problems)


def test_every_rule_has_such_a_file() -> None:
    documented = {
        line[2 : line.index("``", 2)]
        for line in (rules.__doc__ or "").splitlines()
        if line.startswith("``")
    }
    assert documented == {rule for rule, *_ in ONE_RULE}


def test_sections_in_another_order() -> None:
    pos, inst = GOOD.index("//POS"), GOOD.index("//INST")
    problems = check(GOOD[:pos] + GOOD[inst:] + GOOD[pos:inst])
    assert {p.rule for p in problems} == {"sections"}


def test_line_ends() -> None:
    count = len(GOOD.splitlines())
    assert check_yaskawa_jbi(GOOD.encode()) == [
        Problem(1, "crlf", f"{count} lines are not ended by CR LF, this the first")
    ]


def test_problems_name_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "X.JBI"
    path.write_bytes(
        GOOD.replace("SET I000 2", "SET I000 99999")
        .replace("/JOB\n", "/JOB\nx\n")
        .replace("\n", "\r\n")
        .encode()
    )
    found = YaskawaJbi().validate(path)
    line = 1 + next(i for i, text in enumerate(GOOD.splitlines(), 1) if text == "SET I000 2")
    assert [(p.line, p.rule) for p in found] == [(2, "sections"), (line, "argument")]


def test_a_file_of_rubbish_is_not_told_without_end() -> None:
    assert len(check("/JOB\n//POS\n" + "rubbish\n" * 5000)) == MOST_PROBLEMS


def test_an_empty_file_has_problems() -> None:
    assert {p.rule for p in check_yaskawa_jbi(b"")} == {"sections", "job-name", "header", "npos"}
