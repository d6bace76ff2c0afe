"""MELFA-BASIC programs: what is special to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs.mitsubishi_melfa import MitsubishiMelfa
from tests.unit.programs.dialects import export, three_poses

DIALECT = MitsubishiMelfa()
PATH = Path("CALIB.mb5")
PROGRAM, TEXT = three_poses("mitsubishi-melfa", "CALIB")

# as RT ToolBox saves it
EXPORT = export("melfa.mb5")


def test_a_position_of_the_operator_takes_no_number_of_the_plan() -> None:
    # J1 and J3 are planned; the operator's own, and J2 written otherwise, stand behind all
    text = TEXT.replace("\nJ2=(", "\nJV=(").replace("\nJ1=(", "\nJ01=(0,0,0,0,0,0)\nJ1=(")
    back = DIALECT.parse(text.encode(), PATH)
    numbers = [(p.number, p.name) for p in back.positions]
    assert numbers == [(1, "T -1"), (3, "T 0"), (4, "J01"), (5, "JV")]


def test_a_program_of_others() -> None:
    back = DIALECT.parse(EXPORT.encode(), PATH)
    assert [p.name for p in back.positions] == ["ppick", "J1"]
    T = back.positions[0].T_user_tool
    assert T is not None
    np.testing.assert_allclose(T[:3, 3], [-0.12053, -0.2839, 0.05122])
    turned = np.radians(156.09)
    np.testing.assert_allclose(T[:3, 2], [np.sin(turned), -np.cos(turned), 0], atol=1e-15)
    assert back.positions[1].shown_deg is not None
    assert back.positions[1].shown_deg.tolist() == [1.5, 0, 90, 0, 90, 0]
    levels = {p.level for p in DIALECT.check(EXPORT.encode(), PATH)}
    assert levels == {"note", "measuring"}  # a command of vision, and J1 is not moved to


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("J1=(+1.50", "J1=(+1_50", "cannot be read"),
        ("+1.50", "+721", "beyond"),
        ("J1=", "ppick=", "is there twice"),
        ("-283.90,", "-283-.90,", "no list of numbers"),
        ("+0.00,+0.00)\n", "+0.00,+3.00)\n", "additional axes"),
        (",+156.09)(4", ",+156.09,+5.00)(4", "additional axes"),
        (",+90.00,+0.00,+156.09)(4", ")(4", "has 3 values"),
    ],
)
def test_what_would_be_read_wrong_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        DIALECT.parse(EXPORT.replace(old, new).encode(), PATH)


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("syntax", "Cnt 0", "Cnt 0 0"),
        ("syntax", "5 Cnt", "5 Cntt"),
        ("step", "9 Dly", "8 Dly"),
        ("position", ",2.00000,", "-2.00000,"),
        ("range", "(-1.00000", "(-721.00000"),
        ("range", "JOvrd 10", "JOvrd 0"),
        ("target", "Mov J1", "Mov J9"),
        ("wait-to-measure", "9 Dly 1.000", "9 Cnt 0"),
        ("unused", "Mov J1", "Mov J2"),
    ],
)
def test_a_program_that_breaks_a_rule(rule: str, old: str, new: str) -> None:
    assert rule in {p.rule for p in DIALECT.check(TEXT.replace(old, new, 1).encode(), PATH)}
