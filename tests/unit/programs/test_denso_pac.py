"""Denso PacScript programs: what is special to them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.programs.denso_pac import DensoPac
from tests.unit.programs.dialects import three_poses
from tests.unit.programs.test_all_dialects import mutants

DIALECT = DensoPac()
PATH = Path("Calib.pcs")
PROGRAM, TEXT = three_poses("denso-pac")

# as people write it
EXPORT = """\
'!TITLE "of ours"
#include "dio.h"
Sub Main
  Dim aaa As Joint, n As Integer
  TAKEARM KEEP=1
  Speed 100
  aaa = J( 10, 20, 30, 40, 50, 60, 0, 0 ) ' start
  Move P, @P aaa, S = 30
  For n = 0 To 3
    If n > 1 Then
      Move L, P( 740, 0, 480, 180, 0, 180, -1 ), Next
    Else
      Move P, @0 J[n], @E J(-1, 2.5, 90, 0, 45, 0), Speed = 50
    End If
  Next
  Depart L, 70
  Wait IO[128] = 1
  GiveArm
End Sub
"""


def test_a_program_and_the_way_back() -> None:
    lines = [line.strip() for line in TEXT.split("\n")]
    at = lines.index("' POSE 1 T -1")
    assert lines[at + 1].startswith("Move P, @E J(-1.000000, 2.000000, ")
    assert lines[at + 2 : at + 5] == ["Delay 1000", "Set IO[5]", "Delay 500"]
    assert lines[at + 5 : at + 7] == ["Reset IO[5]", "Call MEASURE(1)"]
    assert DIALECT.check(TEXT.encode(), PATH) == []
    back = DIALECT.parse(TEXT.replace("\n", "\r\n").encode(), PATH)
    assert [(p.number, p.name) for p in back.positions] == [(1, "T -1"), (2, "T 1"), (3, "T 0")]
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    order = np.argsort(PROGRAM.numbers)
    np.testing.assert_allclose(back.postures(PROGRAM.arm), PROGRAM.postures_rad[order], atol=1e-7)


def test_a_call_without_an_argument() -> None:
    bare = replace(PROGRAM, options=replace(PROGRAM.options, measure_argument=None))
    text = next(iter(DIALECT.files(bare).values()))
    assert "  Call MEASURE\n" in text
    assert DIALECT.check(text.encode(), PATH) == []


def test_a_program_of_others() -> None:
    back = DIALECT.parse(EXPORT.encode(), PATH)
    found = [p.shown_deg.tolist() for p in back.positions if p.shown_deg is not None]
    assert found == [[10, 20, 30, 40, 50, 60], [-1, 2.5, 90, 0, 45, 0]]
    problems = DIALECT.check(EXPORT.encode(), PATH)
    assert {p.level for p in problems} == {"note", "measuring"}
    # moves that pass into the next one
    assert [p.line for p in problems if p.level == "measuring"] == [11, 13]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2.5", "2_5", "cannot be read"),
        ("2.5", "721", "beyond"),
        ("2.5", "2.5 * n", "no list of numbers"),
        (", 45, 0)", ")", "has 4 values"),
        (", 60, 0, 0 )", ", 60, 5, 0 )\n  Move P, aaa\n  aaa = J(1, 2, 3, 4, 5, 6, 0)", "differs"),
    ],
)
def test_what_would_be_read_wrong_is_refused(old: str, new: str, message: str) -> None:
    assert old in EXPORT
    text = EXPORT.replace(old, new)
    with pytest.raises(FileFormatError, match=message):
        DIALECT.parse(text.encode(), PATH)


LOST = [
    "Move P, @E aaa + J(1, 1, 1, 1, 1, 1)",
    "Move P, @E -J(1, 1, 1, 1, 1, 1)",
    "Move P, @E J(1, 1, 1, 1, 1, 1), aaa * 2",
    "If n > 1 Then Move P, J(1, 1, 1, 1, 1, 1)",
    "If n > 1 Then Move P, aaa",
    *(
        f"{change}\n  Move P, @E aaa"
        for change in (
            "LetJ 1, aaa = 90",
            "AAA = aaa + J(1, 1, 1, 1, 1, 1)",
            "aaa = other",
            "Call Turn(aaa)",
            "If n > 1 Then aaa = other",
        )
    ),
    "Dim b As Joint = J(1, 1, 1, 1, 1, 1) + aaa\n  Move P, b",
    "#define b J(1, 1, 1, 1, 1, 1)\n  Move P, b",
    "b[1] = J(1, 1, 1, 1, 1, 1)\n  b[n] = J(2, 1, 1, 1, 1, 1)\n  Move P, b[1]",
    "b[n] = J(1, 1, 1, 1, 1, 1)\n  Move P, b[n]",
]


@pytest.mark.parametrize("lines", LOST)
def test_a_move_to_what_is_computed_is_refused(lines: str) -> None:
    with pytest.raises(FileFormatError, match=r"no list of numbers|cannot be read"):
        DIALECT.parse(EXPORT.replace("GiveArm", lines).encode(), PATH)


def test_a_declared_value_is_read() -> None:
    lines = "Depart P, J(1, 2)\n  #define c J(1, 2)\n  Move L, P[1]\n  Move L, P(1, 2)\n  "
    lines += "Dim n As Integer = 2, b As Joint = J(1, 2, 3, 4, 5, 6)\n  b[1] = J(1, 2, 3, 4, 5, 7)"
    text = EXPORT.replace("GiveArm", f"{lines}\n  Move P, @E B\n  Move P, b[1]\n  Move P, J[2]")
    found = [p.shown_deg for p in DIALECT.parse(text.encode(), PATH).positions]
    np.testing.assert_array_equal(found[2:], [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 7]])


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("syntax", "Delay", "Dely"),
        ("syntax", "Move P, ", "P, "),
        ("syntax", "Call ", ""),
        ("block", "End Sub", ""),
        ("main", "Sub Main", "Sub Other"),
        ("arm", "  TakeArm Keep = 0\n", ""),
        ("position", "J(-1.000000, ", "J("),
        ("position", "-1.000000", "-1.000000 * 2"),
        ("position", "J(-1", "(-1"),
        ("range", "(-1.000000", "(-721.000000"),
        ("range", "Speed 10", "Speed 0"),
        ("standstill", "@E", "@P"),
        ("standstill", "6.000000)", "6.000000), Next"),
        ("wait-to-measure", "Delay 1000", "Speed 10"),
    ],
)
def test_a_program_that_breaks_a_rule(rule: str, old: str, new: str) -> None:
    assert old in TEXT
    assert rule in {p.rule for p in DIALECT.check(TEXT.replace(old, new, 1).encode(), PATH)}


def test_what_it_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match="keep no registers"):
        DIALECT.files(replace(PROGRAM, options=replace(PROGRAM.options, keep="register")))


def test_a_broken_token_is_refused() -> None:
    for changed, text in mutants(TEXT, 1000, re.compile("'.*|MEASURE")):
        assert DIALECT.check(text.encode(), PATH), changed
