"""Doosan DRL programs: what is special to them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.programs.doosan_drl import DoosanDrl
from tests.unit.programs.dialects import three_poses
from tests.unit.programs.test_all_dialects import mutants

DIALECT = DoosanDrl()
PATH = Path("Calib.drl")
PROGRAM, TEXT = three_poses("doosan-drl")

# as the pendant generates it, and as people write it
EXPORT = """\
from DRCF import *
set_singular_handling(DR_AVOID)
home = posj([0, 0, 90, 0, 90, 0])
loop = 0
while loop < 1:
    # MoveJNode
    movej(posj(0.00, 0.01, 132.64, 0.00, 15.00, -0.01), radius=0.00, ra=DR_MV_RA_DUPLICATE)
    wait(0.1)
    if get_digital_input(11) == ON:
        set_digital_output(1,ON)
    else:
        tp_log('{} of # "it"'.format(loop))
    movel(posx(1,2,3,4,5,6), v=[250.0, 80.6], a=100)
    movej(home, vel=10,
          acc=10)
    loop += 1
"""


def test_a_program_and_the_way_back() -> None:
    lines = TEXT.split("\n")
    at = lines.index("# POSE 1 T -1")
    assert lines[at + 1].endswith("3.000000, -4.000000, 5.500000, 6.000000), vel=17.19, acc=17.19)")
    assert lines[at + 2 : at + 5] == ["mwait()", "wait(1.000)", "set_digital_output(5, ON)"]
    assert lines[at + 5 : at + 8] == ["wait(0.500)", "set_digital_output(5, OFF)", "MEASURE(1)"]
    assert DIALECT.check(TEXT.encode(), PATH) == []
    back = DIALECT.parse(TEXT.encode(), PATH)
    assert [(p.number, p.name) for p in back.positions] == [(1, "T -1"), (2, "T 1"), (3, "T 0")]
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    order = np.argsort(PROGRAM.numbers)
    np.testing.assert_allclose(back.postures(PROGRAM.arm), PROGRAM.postures_rad[order], atol=1e-7)
    compile(TEXT, "Calib.drl", "exec")  # it is Python


def test_a_program_without_a_call_defines_none() -> None:
    bare = replace(PROGRAM, options=replace(PROGRAM.options, measure_call=None))
    assert "def " not in next(iter(DIALECT.files(bare).values()))


def test_a_program_of_others() -> None:
    compile(EXPORT, "Calib.drl", "exec")
    back = DIALECT.parse(EXPORT.encode(), PATH)
    found = [p.shown_deg.tolist() for p in back.positions if p.shown_deg is not None]
    assert found == [[0, 0.01, 132.64, 0, 15, -0.01], [0, 0, 90, 0, 90, 0]]
    assert [p.line for p in back.positions] == [7, 14]
    problems = DIALECT.check(EXPORT.encode(), PATH)
    assert {p.level for p in problems} == {"note"}  # functions that are not known here


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("132.64", "132_64", "cannot be read"),
        ("132.64", "721", "beyond"),
        ("-0.01)", "-0.01 * 2)", "no list of numbers"),
        (", -0.01)", ")", "has 5 values"),
        ("[0, 0, 90, 0, 90, 0]", "*given", "no list of numbers"),
    ],
)
def test_what_would_be_read_wrong_is_refused(old: str, new: str, message: str) -> None:
    assert old in EXPORT
    with pytest.raises(FileFormatError, match=message):
        DIALECT.parse(EXPORT.replace(old, new).encode(), PATH)


Q = "posj(0, 0, 90, 0, 90, 0)"
COMPUTED = [
    f"movej({Q} + posj(1, 1, 1, 1, 1, 1))",
    f"movej(-{Q})",
    "movej(posj(-[0, 0, 90, 0, 90, 0]))",
    "q = posj(-[0, 0, 90, 0, 90, 0])\nmovej(q)",
    "movej(home[0])",
    "movej(vel=10)",
    "movej(*home)",
    f"if True: movej({Q})",
    *(f"movej({Q}, {mod})" for mod in ("mod=DR_MV_MOD_REL", "mod=1", "mod=m", "1, 1, 1, 1, 1")),
    *(
        f"home = {Q}\n{change}\nmovej(home)"
        for change in (
            "home[0] = 45",
            "home += [3]",
            "home, b = b, home",
            "home = b = c",
            "home: list = [1, 2, 3, 4, 5, 6]",
            "home.reverse()",
            "home = other",
            "from mine import home",
            "for home in all:",
            "def go(home):",
        )
    ),
    f'text = """\nmovej({Q})',
]


@pytest.mark.parametrize("lines", COMPUTED)
def test_a_move_to_what_is_computed_is_refused(lines: str) -> None:
    with pytest.raises(FileFormatError, match=r"no list of numbers|cannot be read|is relative"):
        DIALECT.parse((EXPORT + lines).encode(), PATH)
    assert DIALECT.check((EXPORT + lines).encode(), PATH) != DIALECT.check(
        EXPORT.encode(), PATH
    ) or ("movej(home)" in lines)


def test_positions_by_name_are_read_and_those_of_long_texts_are_not() -> None:
    more = f'''"""
# POSE 1 no pose
movej({Q})
"""
note = """
movej({Q})"""
movej(pos=posj(1, 2, 3, 4, 5, 6), mod=DR_MV_MOD_ABS)
movej([1, 2, 3, 4, 5, 7], 10, 10, mod=0)
movej(posj(home))
'''
    back = DIALECT.parse((EXPORT + more).encode(), PATH)
    found = [p.shown_deg.tolist() for p in back.positions if p.shown_deg is not None]
    assert found[2:] == [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 7], [0, 0, 90, 0, 90, 0]]
    assert [p.line for p in back.positions][2:] == [23, 24, 25]
    assert not [p for p in DIALECT.check((EXPORT + more).encode(), PATH) if p.level == "error"]


def test_a_pose_of_a_plan_is_there_once() -> None:
    with pytest.raises(FileFormatError, match="pose 1 is there twice"):
        DIALECT.parse(TEXT.replace("POSE 2", "POSE 1").encode(), PATH)


def test_what_an_operator_adds_comes_behind_the_plan() -> None:
    added = TEXT.replace("MEASURE(1)", "MEASURE(1)\nmovej(posj(0, 0, 90, 0, 90, 0))")
    back = DIALECT.parse(added.encode(), PATH)
    assert [(p.number, p.name) for p in back.positions][2:] == [(3, "T 0"), (4, "")]
    assert len(back.measured) == 2


@pytest.mark.parametrize(
    ("rule", "old", "new"),
    [
        ("syntax", "mwait()", "mwait("),
        ("indent", "    tp_log", "  tp_log"),
        ("indent", "mwait()", "  mwait()"),
        ("name", "MEASURE(1)", "MEASURES(1)"),
        ("name", "vel=", "vel=="),
        ("arguments", "vel=", "speed="),
        ("arguments", "wait(1.000)", "wait()"),
        ("arguments", "movej(posj(", "movej(("),
        ("arguments", "5, ON", "5% ON"),
        ("position", "posj(-1.000000, ", "posj("),
        ("position", "-1.000000,", "--1.000000,"),
        ("range", "(-1.00", "(-721.00"),
        ("range", "output(5", "output(17"),
        ("standstill", "acc=17.19", "acc=17.19, r=5"),
        ("wait-to-measure", "wait(1.000)", "mwait()"),
    ],
)
def test_a_program_that_breaks_a_rule(rule: str, old: str, new: str) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1).replace("mwait()\n", "", rule == "standstill")
    assert rule in {p.rule for p in DIALECT.check(text.encode(), PATH)}


def test_what_it_does_not_have_is_refused() -> None:
    for options in (
        replace(PROGRAM.options, keep="register"),
        replace(PROGRAM.options, measure_output=17),
    ):
        with pytest.raises(InputError):
            DIALECT.files(replace(PROGRAM, options=options))
    with pytest.raises(InputError, match="'movej' is not a DRL name"):
        DIALECT.files(replace(PROGRAM, name="movej"))


def test_a_broken_token_is_refused() -> None:
    for changed, text in mutants(TEXT, 1000, re.compile(r'#.*|"[^"]*"')):
        assert DIALECT.check(text.encode(), PATH), changed
