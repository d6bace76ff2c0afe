"""What readers of several dialects do alike: own positions, axes that carry the arm, letters."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.errors import FileFormatError
from posedesign.programs import DIALECTS, RecordedProgram
from tests.unit.programs import test_abb_rapid_read as abb
from tests.unit.programs import test_fanuc_ls_read as fanuc
from tests.unit.programs import test_kuka_krl_read as kuka
from tests.unit.programs.dialects import changed

FANUC = fanuc.SMALL.replace("/END", fanuc.SECOND + "/END").replace(*fanuc.RAIL)
JOINTS = "[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def parse(name: str, text: str, encoding: str = "latin-1") -> RecordedProgram:
    dialect = DIALECTS[name]
    return dialect.parse(text.encode(encoding), Path(f"X{dialect.suffixes[0]}"))


# A program in whose second position an axis stands at 100.0, where that is told, and another one.
AXES = [
    ("fanuc-ls", FANUC, "100.000  mm\n};\n/END", r"P\[2\]: E1 differs from that of P\[1\]", 18),
    (
        "kuka-krl",
        kuka.SMALL.replace("6.0}", "6.0,E1 100.0}").replace("T 35}", "T 35,E1 100.0}"),
        "T 35,E1 100.0",
        "XP2: E1 differs from that of XP1",
        4,
    ),
    (
        "abb-rapid",
        abb.SMALL.replace("6],[9E9", "6],[100.0").replace("3],[9E9", "3],[100.0"),
        "3],[100.0",
        "p2: eax_a differs from that of jp1",
        4,
    ),
]


@pytest.mark.parametrize(("name", "text", "axis", "message", "line"), AXES)
def test_an_external_axis_may_not_carry_the_arm(name, text, axis, message, line):
    # what is shown of an axis at rest flickers
    near, far = (
        changed(text, axis, axis.replace("100.0", value)) for value in ("100.009", "100.1")
    )
    assert len(parse(name, near).positions) == 2
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(name, far).postures()
    assert caught.value.row == line


# An operator's own position, and what stands behind it.
OWN = [
    ("kuka-krl", kuka.SMALL, ";", "DECL E6AXIS XLEFT={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}", "ENDDAT"),
    ("abb-rapid", abb.SMALL, "  ! ", f"CONST jointtarget XLEFT:={JOINTS};", "ENDMODULE"),
]


@pytest.mark.parametrize(("name", "text", "remark", "own", "end"), OWN)
def test_a_position_of_the_operator_is_none_of_the_plan(name, text, remark, own, end):
    notes = "\n".join(f"{remark}{note}" for note in ("P1 T1", "P2 T2", "P3 T3", "P4 via"))
    text = changed(text, f"{remark}PLAN abcdef12 2", f"{remark}PLAN abcdef12 3\n{notes}")
    program = parse(name, changed(text, end, f"{own}\n{end}"))  # and position 3 was deleted
    assert [(p.number, p.name) for p in program.positions] == [(1, "T1"), (2, "T2"), (5, "XLEFT")]
    assert [p.number for p in program.measured] == [1, 2]
    home = own.replace("XLEFT", "HOME").replace("6}", "6,E1 9}").replace("6],[9E9", "6],[9")
    moved = changed(text, end, f"{home}\n{end}")  # it may be anywhere
    assert len(parse(name, moved).positions) == 3


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize(("name", "text", "remark"), [own[:3] for own in OWN])
def test_remarks_in_other_letters_are_passed_over(name, text, remark, encoding):
    told = changed(text, f"{remark}PLAN", f'{remark}für "Übung\n{remark}PLAN')
    assert [p.number for p in parse(name, told, encoding).positions] == [1, 2]
