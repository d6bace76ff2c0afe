"""KUKA KRL: the reader takes what pendants and people write, and names what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from calib.se3 import transform
from posedesign.programs import RecordedPosition, RecordedProgram, read
from posedesign.programs.kuka_krl import KukaKrl
from tests.unit.programs.dialects import changed, export, refused

# In the manner of a controller: headers, folds, data of inline forms, a home, a track at rest.
EXPORT = export("kuka.dat")

# In the manner of a generator, with subroutine, loop and inline forms of a pendant.
SOURCE = export("kuka.src")

SMALL = """\
DEFDAT CAL
;PLAN abcdef12 2
DECL E6AXIS XP1={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}
DECL E6POS XP2={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35}
ENDDAT
"""


def parse(text: str, name: str = "X.dat") -> RecordedProgram:
    return KukaKrl().parse(text.encode("latin-1"), Path(name)).whole()


def test_a_controller_export_is_read() -> None:
    program = parse(EXPORT.replace("\n", "\r\n"))
    assert (program.name, program.comment) == ("TOUCHUP", "nach Wartung")
    assert (program.fingerprint, program.mark.measured) == ("00c0ffee", 2)
    found = {p.number: p for p in program.positions}
    assert [(p.number, p.name) for p in program.positions] == [
        (8, "XHOME"),
        (1, ""),
        (2, ""),
        (9, "Xleft"),
        (7, ""),
        (10, "TABLE[2]"),
    ]
    assert [p.number for p in program.measured] == [1, 2]
    assert (found[1].tool_frame, found[1].user_frame) == (3, 4)
    assert (found[2].tool_frame, found[2].user_frame) == (None, None)
    np.testing.assert_array_equal(np.asarray(found[2].shown_deg), [1, -2.5, 3, 0.5, -5, 6])
    np.testing.assert_array_equal(np.asarray(found[9].shown_deg), [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(np.asarray(found[10].shown_deg), [9, 8, 7, 6, 5, 4])
    assert found[1].configuration is not None
    assert found[1].configuration.words == "S 2,T 35"
    assert found[7].configuration is None
    assert (found[1].external_shown, found[8].external_shown) == ((500.0,), (0.0,))
    rotated = transform([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0.001, 0.002, 0.003])
    np.testing.assert_allclose(np.asarray(found[7].T_user_tool), rotated, atol=1e-15)
    a, b, c = np.radians([10.5, -12.0, -178.565933])
    turn = about_z(a) @ about_y(b) @ about_x(c)
    expected = transform(turn, [0.525, -0.01, 0.89025])
    np.testing.assert_allclose(np.asarray(found[1].T_user_tool), expected, atol=1e-12)
    lines = EXPORT.splitlines()
    assert all(re.search(r"=\s*\{", lines[p.line - 1]) for p in program.positions)


def about_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def about_y(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_positions_in_motions_are_read(tmp_path: Path) -> None:
    path = tmp_path / "measure_all.src"
    path.write_text(SOURCE)
    program = read(path)
    assert (program.name, program.maker) == ("measure_all", "kuka")
    assert program.mark.words == "PLAN abcd1234 3"
    first, second, _, last = program.positions
    # behind the three of the plan: they are others, and count as no measurements
    assert [p.number for p in program.positions] == [4, 5, 6, 7]
    assert program.measured == ()
    assert [p.tool_frame for p in program.positions] == [5, 5, None, 7]  # once by value
    assert [p.user_frame for p in program.positions] == [6, 6, 6, 8]
    np.testing.assert_array_equal(np.asarray(first.shown_deg), [10, -90, 90, 0, 15, 0])
    assert second.configuration is not None
    assert second.configuration.words == "S 2,T 2"
    assert last.configuration is None


def test_a_source_that_assigns_its_positions() -> None:
    text = (
        "DEF CAL( )\nDECL E6AXIS P1, P2\nP1={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\n"
        "P2={A1 2,A2 2,A3 3,A4 4,A5 5,A6 6}\nPTP P2\nPTP P1\nEND\n"
    )
    assert [p.number for p in parse(text, "CAL.src").positions] == [1, 2]


@pytest.mark.parametrize(
    ("lines", "count"),
    [
        # as the $config.dat and $machine.dat of every controller have them
        ("DECL JERK_STRUC J={CP 50.0,ORI 50.0,AX {A1 1.0,A2 1.0}}", 2),
        ("DECL ACC_CAR $ACC_CAR_LIMIT={X 1.0,Y 2.0,Z 3.0}\n$LOAD_A1.CM={X 0.0,Y 0.0,Z 0.0}", 2),
        # and as KUKA.TouchSense writes beside the points of a search
        ("DECL TSG_CD_T V={MC TRUE,REF_W {X -10.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0},LEN 0.0}", 2),
        ("DECL FRAME R[2]\nR[1]={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}", 2),
        ("DECL E3POS P3={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0,S 2,T 35}", 3),
        ("DECL E3AXIS P3={A1 1.0,A2 2.0,A3 3.0,A4 0.0,A5 0.0,A6 0.0}", 3),
    ],
)
def test_what_beside_positions_is_a_position(lines: str, count: int) -> None:
    assert len(parse(changed(SMALL, "ENDDAT", f"{lines}\nENDDAT")).positions) == count


def test_a_frame_is_a_position_where_a_motion_goes_to_it() -> None:
    place = "={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}"
    text = f"DEF CAL( )\nDECL FRAME F,G[2]\nF{place}\nG[1]{place}\nLIN G[1]\nEND\n"
    assert len(parse(text, "CAL.src").positions) == 1


P1 = "XP1={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}"
SRC = "DEF CAL( )\nPTP {A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\nEND\n"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("ENDDAT\n", "", 5, "is cut off: there is no ENDDAT"),
        ("DEFDAT CAL\n", "", 2, "does not begin with DEFDAT or DEF"),
        (SMALL, "\n", 1, "there is no DEFDAT and no DEF"),
        (SMALL[SMALL.index("DECL") : SMALL.index("ENDDAT")], "", None, "holds no positions"),
        ("ENDDAT", "XP1.A1=3\nENDDAT", 5, "XP1 is changed in part"),
        ("ENDDAT", "DEFDAT A\nENDDAT", 5, "A begins inside CAL"),
        ("ENDDAT", f"ENDDAT\nDECL E6AXIS {P1}", 6, "behind the end"),
        (P1, "XP1", 3, "XP1 has no value"),
        ("A2 2.0,", "", 3, "XP1: A2 is missing"),
        ("Y 2.0,", "", 4, "XP2: Y is missing"),
        ("A2 2.0", "A1 2.0", 3, "XP1 has A1 twice"),
        ("A2 2.0", "A7 2.0", 3, "XP1: A7 is no joint"),
        ("A2 2.0", "Z 2.0", 3, "XP1 has Z beside A1"),
        ("A2 2.0", "A2 ****", 3, "cannot make sense"),
        ("A2 2.0", "A2 2.0.0", 3, "cannot make sense"),
        ("A2 2.0", "A2 nan", 3, "A2 is 'nan', not a number"),
        ("A2 2.0", "A2 #X", 3, "A2 is '#X', not a number"),
        ("A2 2.0", "A2 720.1", 3, r"A2 is 720.1 deg, beyond \+-720"),
        ("X 1.0", "X 1e6", 4, r"X is 1e6 mm, beyond \+-100000"),
        ("A2 2.0", "A2 2.0 deg", 3, "cannot make sense"),
        ("A2 2.0", "A2", 3, "cannot make sense"),
        ("6.0}\n", "6.0,}\n", 3, "cannot make sense"),
        ("6.0}\n", "6.0\n", 3, "cannot make sense of"),
        ("XP1={", "XP1={{", 3, "cannot make sense of"),
        ("XP1=", "XP 1=", 3, "cannot make sense"),
        ("ENDDAT", "DECL MY M={P {X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}}\nENDDAT", 5, "cannot make"),
        ("DECL E6AXIS", "DECL E6AXXIS", 3, "cannot make sense of 'DECL E6AXXIS"),
        ("XP2=", "xp1=", 4, "xp1 is there twice"),
        (",T 35", "", 4, "XP2 has S and no T"),
        ("S 2,", "", 4, "XP2 has T and no S"),
        ("S 2", "S 99", 4, "XP2: Status and Turn"),
        ("S 2", "S 'B002'", 4, "cannot make sense"),
        ("CAL\n", "CAL\n\0", 2, "holds the byte 0x00"),
        (P1, "\u00e4" + P1, 3, "cannot make sense of"),
        (SMALL, SRC.replace("END\n", ""), 3, "there is no END"),
        (SMALL, SRC.replace("PTP {", "PTP_REL {"), 2, "PTP_REL: only PTP, LIN and CIRC"),
        (SMALL, SRC.replace("PTP {", "CIRC {X 1},{").replace("6}", "6},CA 9"), 2, "CIRC: where an"),
        (SMALL, SRC.replace("6}", "6}:XOFF"), 2, "with an offset"),
        (SMALL, SRC.replace("END", "PTP XP3\nEND"), 3, "XP3 is stored elsewhere"),
        (SMALL, SRC.replace("END", "PTP P3[1]\nEND"), 3, "P3 is stored elsewhere"),
        (SMALL, SRC.replace("END", "PTP XP3:XOFF\nEND"), 3, "with an offset"),
        (SMALL, SRC.replace("END", "DEF B( )\nEND"), 3, "B begins inside CAL"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old, new, line, message):
    file = "X.src" if new.startswith("DEF CAL") else "X.dat"
    refused("kuka-krl", file, changed(SMALL, old, new), line, message)


@pytest.mark.parametrize("word", ["CIRC", "SCIRC"])
def test_a_circle_goes_through_one_position_to_the_next(word: str) -> None:
    places = [f"{{X {x},Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}}" for x in (1, 7)]
    text = SRC.replace("END", f"{word} {', '.join(places)} C_DIS\nEND")
    poses = [p.T_user_tool for p in parse(text, "CAL.src").positions[1:]]
    np.testing.assert_allclose(
        [T[:3, 3] for T in poses if T is not None], [[1e-3, 2e-3, 3e-3], [7e-3, 2e-3, 3e-3]]
    )


def test_the_end_of_a_circle_that_the_program_changes_is_unread(tmp_path: Path) -> None:
    (tmp_path / "CAL.dat").write_text(SMALL)
    program = "DEF CAL( )\nPTP XP1\nXP2.X=5\nCIRC XP1, XP2\nEND\n"
    (tmp_path / "CAL.src").write_text(program)
    (error,) = KukaKrl().read_data(SMALL.encode(), tmp_path / "CAL.dat").unread
    assert "XP2 is changed in line 3 of CAL.src" in error.message


A = "DECL E6POS A\nA={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 2,T 35}\n"


@pytest.mark.parametrize(
    "change", ["A.X=20", "A . X = 20", "A=B", "A=$POS_ACT", "a=A:C", "A=FLIP(A)"]
)
def test_a_variable_that_changes_is_not_known_any_more(change: str) -> None:
    text = f"DEF CAL( )\n{A}PTP A\n{change}\nPTP A\nEND\n"
    with pytest.raises(FileFormatError, match="A is changed by the program") as caught:
        parse(text, "CAL.src")
    assert caught.value.row == 6
    without = text.replace(change, "IF A==B THEN\nENDIF")
    assert len(parse(without, "CAL.src").positions) == 1
    # what it was at a motion before stays
    assert len(parse(text.replace("\nPTP A\nEND", "\nEND"), "CAL.src").positions) == 1


@pytest.mark.parametrize("change", ["P[2].X=1", "P[I].X=1", "P[I]=Q[1]", "P[2]=Q"])
def test_an_element_that_changes_is_not_known_any_more(change: str) -> None:
    text = f"DEF CAL( )\n{A}P[2]={{A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}}\n{change}\nPTP P[2]\nEND\n"
    with pytest.raises(FileFormatError, match="P is changed by the program"):
        parse(text, "CAL.src")
    assert len(parse(text.replace(change, "P[3].X=1"), "CAL.src").positions) == 2


TOOL = "$TOOL={X 10.0,Y 0.0,Z 100.0,A 0.0,B 90.0,C 0.0}\n"
BASE = "$BASE={FRAME: X 500.0,Y 0.0,Z 0.0,A 90.0,B 0.0,C 0.0}\n"


def in_frames(before: str, motion: str = "PTP A", behind: str = "") -> RecordedPosition:
    text = f"DEF CAL( )\n{A}{before}\n{motion}\n{behind}END\n"
    (position,) = parse(text, "CAL.src").positions
    return position


def test_frames_by_value_are_those_of_the_motion() -> None:
    # the one that is active where the position is assigned is not that of the motion
    position = in_frames("$TOOL=TOOL_DATA[3]\n" + TOOL + BASE, behind=TOOL.replace("10.0", "20.0"))
    tip_tool = transform([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [0.01, 0, 0.1])
    world_user = transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0, 0])
    np.testing.assert_allclose(np.asarray(position.T_tip_tool), tip_tool, atol=1e-15)
    np.testing.assert_allclose(np.asarray(position.T_world_user), world_user, atol=1e-15)
    assert (position.tool_frame, position.user_frame) == (None, None)


@pytest.mark.parametrize(
    ("before", "motion", "tool", "base"),
    [
        ("", "PTP A", None, None),
        ("$TOOL=TOOL_DATA[3]\nBAS(#BASE,4)", "PTP A", 3, 4),
        (TOOL + "BAS(#TOOL,3)\n$BASE=$NULLFRAME", "LIN A C_DIS", 3, "value"),
        ("$TOOL=TOOL_DATA[3]:OFF\n$BASE=BASE_DATA[I]", "PTP A", None, None),
        ("BAS(#TOOL,3)\n$TOOL.X=20", "PTP A", None, None),
        ("BAS(#TOOL,3)\nBAS(#TOOL,N)", "PTP A", None, None),
        ("BAS(#TOOL,3)\n$TOOL={X 1}", "PTP A", None, None),
        (TOOL + "FDAT_ACT={TOOL_NO 7,BASE_NO 8,IPO_FRAME #BASE}", "PTP A", 7, 8),
        (TOOL + BASE + "FDAT_ACT=FP1", "PTP A", None, None),
        ("BAS(#TOOL,3)\nIF B THEN\nBAS(#TOOL,4)\nENDIF", "PTP A", None, None),
        ("BAS(#TOOL,3)\nIF B THEN\nBAS(#BASE,4)\nENDIF", "PTP A", 3, None),
        ("BAS(#TOOL,3)\nBAS(#BASE,4)", "SPTP A WITH $TOOL=STOOL2(FP1)", None, 4),
        ("BAS(#TOOL,3)\nEND\nDEF SUB( )", "PTP A", None, None),
    ],
)
def test_frames_are_known_as_far_as_the_file_says(before, motion, tool, base):
    position = in_frames(before, motion)
    assert position.tool_frame == tool
    assert position.user_frame == (base if base != "value" else None)
    assert position.T_tip_tool is None
    assert (position.T_world_user is None) == (base != "value")


@pytest.mark.parametrize(
    "change", [TOOL, BASE, "BAS(#TOOL,5)\n", "BAS(#BASE,5)\n", "$TOOL.X=1\n", "FDAT_ACT=F\n"]
)
def test_a_position_in_two_frames_is_refused(change: str) -> None:
    with pytest.raises(FileFormatError, match="A is used in other frames than before") as caught:
        in_frames("BAS(#TOOL,3)\n$BASE=$NULLFRAME", behind=change + "PTP A\n")
    assert caught.value.row == 8
    # the same ones, said again
    again = in_frames(TOOL + BASE, behind=TOOL + BASE + "PTP A\n")
    assert again.T_tip_tool is not None
    # joints do not depend on frames
    text = f"DEF CAL( )\nP={{A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}}\nPTP P\n{change}PTP P\nEND\n"
    assert len(parse(text, "CAL.src").positions) == 1


def test_a_tool_that_stands_in_the_cell_is_refused() -> None:
    with pytest.raises(FileFormatError, match="IPO_MODE #TCP"):
        in_frames("$IPO_MODE=#TCP")
    assert in_frames("$IPO_MODE=#TCP\n$IPO_MODE=#BASE").number == 1
    data = "DECL FDAT FP2={TOOL_NO 3,BASE_NO 4,IPO_FRAME #TCP}\nENDDAT"
    with pytest.raises(FileFormatError, match="stands in the cell"):
        parse(SMALL.replace("ENDDAT", data))


def test_one_position_that_is_none_is_left_out_alone() -> None:
    bends = "DECL AXIS BENDS={A1 999,A2 0,A3 0,A4 0,A5 0,A6 0}\n"
    text = changed(SMALL, "ENDDAT", f"{bends}ENDDAT")
    program = KukaKrl().parse(text.encode(), Path("CAL.dat"))
    assert [p.number for p in program.positions] == [1, 2]
    assert [error.message.partition(": ")[2] for error in program.unread] == [
        "BENDS: A1 is 999 deg, beyond +-720 deg"
    ]
    with pytest.raises(FileFormatError, match="BENDS: A1 is 999"):
        program.whole()
    assert not [p for p in KukaKrl().check(text.encode(), Path("CAL.dat")) if p.level == "error"]


def test_what_the_program_beside_changes_is_unread(tmp_path: Path) -> None:
    path = tmp_path / "CAL.dat"
    path.write_text(SMALL)
    code = "DEF CAL( )\nXP1={A1 9,A2 9,A3 9,A4 9,A5 9,A6 9}\nPTP XP1\nPTP XP2\nEND\n"
    (tmp_path / "CAL.src").write_text(code)
    program = KukaKrl().read(path)
    assert [p.number for p in program.positions] == [2]
    assert "XP1 is changed in line 2 of CAL.src" in program.unread[0].message
    (tmp_path / "CAL.src").write_text(code.replace("PTP XP1\n", ""))  # it is not moved to
    assert len(KukaKrl().read(path).positions) == 2
