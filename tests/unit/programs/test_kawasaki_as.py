"""Kawasaki AS programs: what is special to them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs.kawasaki_as import KawasakiAs
from tests.unit.programs.dialects import three_poses
from tests.unit.programs.test_all_dialects import mutants

DIALECT = KawasakiAs()
PATH = Path("CALIB.as")
PROGRAM, TEXT = three_poses("kawasaki-as", keep="register", first_register=3)

# as a controller saves it
EXPORT = """\
.*=== AS GROUP ===         : ASE_010100X3Q
.NETCONF     192.168.0.2,"timesys-",255.255.255.0
.PROGRAM a.home() #9744
  HOME
.END
.PROGRAM main (.n) ; steps
  SPEED 40MM/S ALWAYS
10 JMOVE #start_pos
  BREAK
  IF .n == 1 THEN
    .spd = 2 ; local
    LMOVE SHIFT(p BY 0, 0, 100)
  ELSE
    IF SIG(1001) GOTO 20
    JOINT SPEED9 ACCU1 TIMER0 TOOL1 WORK0 CLAMP1 (OFF,0,0,O) OX= WX= #[1.5,0,90,0,-90,0] ;
  END
  TWAIT(1)
  PRINT "END ; of it"
  SIGNAL 5,-6
.END
.TRANS
p 506.2 -83.4 192.6 -35.9 112.2 -179.9
.END
.JOINTS
#start_pos -91.265190 26.640381 -121.421951 0.640723 -31.712723 2.059593
.END
.REALS
speed = 20
.END
"""


def test_a_program_and_the_way_back() -> None:
    lines = [line.strip() for line in TEXT.split("\n")]
    assert lines[4:9] == ["; POSE 1 T -1", "JMOVE #Calib.p[1]", "BREAK", "TWAIT 1.000", lines[8]]
    assert lines[8:12] == ["PULSE 5,0.500", "TWAIT 0.500", "CALL MEASURE(1)", "HERE #Calib.m[3]"]
    assert DIALECT.check(TEXT.encode(), PATH) == []
    saved = TEXT.replace("Calib", "calib").replace("\n", "\r\n")
    back = DIALECT.parse(saved.encode(), PATH)
    assert back.empty_registers
    numbered = sorted((p.number, p.name) for p in back.positions)
    assert numbered == [(1, "T -1"), (2, "T 1"), (3, "T 0")]
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    np.testing.assert_allclose(back.postures(PROGRAM.arm), PROGRAM.postures_rad, atol=1e-7)


def test_touched_up_positions_take_the_place_of_planned_ones() -> None:
    kept = "#calib.m[4] 1.1 2.1 3.1 -4.1 5.1 6.1\n#calib.m[3] 9 8 7 6 5 4\n"
    text = TEXT.replace(".JOINTS\n", ".JOINTS\n#park 0 0 0 0 0 0\n" + kept)
    back = DIALECT.parse(text.encode(), PATH)
    assert not back.empty_registers
    found = {p.name: p.shown_deg.tolist() for p in back.measured if p.shown_deg is not None}
    assert found == {"T -1": [9, 8, 7, 6, 5, 4], "T 1": [1.1, 2.1, 3.1, -4.1, 5.1, 6.1]}


def test_a_file_of_others() -> None:
    back = DIALECT.parse(EXPORT.encode(), PATH)
    assert [(p.name, p.line) for p in back.positions] == [("", 15), ("#start_pos", 25)]
    assert back.positions[0].shown_deg is not None
    assert back.positions[0].shown_deg.tolist() == [1.5, 0, 90, 0, -90, 0]
    found = DIALECT.check(EXPORT.encode(), PATH)
    assert {p.level for p in found} == {"note", "measuring"}
    assert {p.line for p in found if p.level == "measuring"} == {15}  # no BREAK before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("-91.265190", "-91_265190", "cannot be read"),
        ("-91.265190", "-721", "beyond"),
        (".JOINTS\n", ".JOINTS\n#START_POS 1 2 3 4 5 6\n", "is there twice"),
        (" 2.059593", " 2.059593 5\n#other 1 2 3 4 5 6 9", "differs"),
        (" 2.059593", "", "has 5 values"),
    ],
)
def test_what_would_be_read_wrong_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        DIALECT.parse(EXPORT.replace(old, new).encode(), PATH)


def test_two_programs_of_a_plan_are_refused() -> None:
    with pytest.raises(FileFormatError, match="two programs"):
        DIALECT.parse((TEXT + TEXT.replace("Calib", "other")).encode(), PATH)


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("syntax", "BREAK", "BREAKE"),
        ("syntax", "TWAIT 1.000", "TWAIT 1.000 1"),
        ("syntax", "CALL ", ""),
        ("block", ".END\n.J", ".J"),
        ("block", "  BREAK", "  END"),
        ("position", "6.000000\n", "6.000000 0.5\n"),
        ("range", "] -1.000000", "] -721.000000"),
        ("range", "SPEED 10", "SPEED 0"),
        ("range", "PULSE 5", "PULSE 5.5"),
        ("target", "JMOVE #Calib.p[1]", "JMOVE #Calib.p[9]"),
        ("target", "JMOVE #Calib.p[1]", "JMOVE Calib.p[1]"),
        ("standstill", "BREAK", "TWAIT 1"),
        ("wait-to-measure", "TWAIT 1.000", "SPEED 10 ALWAYS"),
        ("speed", " ALWAYS", ""),
        ("unused", "JMOVE #Calib.p[1]", "JMOVE #Calib.p[2]"),
    ],
)
def test_a_program_that_breaks_a_rule(rule: str, old: str, new: str) -> None:
    assert old in TEXT
    assert rule in {p.rule for p in DIALECT.check(TEXT.replace(old, new, 1).encode(), PATH)}


def test_a_broken_token_is_refused() -> None:
    free = re.compile(r";.*|MEASURE|(?<=PROGRAM )\w+|(?<=HERE ).*")
    for changed, text in mutants(TEXT, 1000, free):
        assert DIALECT.check(text.encode(), PATH), changed


def test_names_leave_room_for_their_ending() -> None:
    names = replace(PROGRAM, name="a" * 13)
    assert f"#{'a' * 13}.p[1]" in next(iter(DIALECT.files(names).values()))
    assert not DIALECT.names.is_legal("a" * 14)
