"""FANUC .LS: the reader takes what controllers export, and says the line of what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError, UnreachableError
from posedesign.programs import DIALECTS, Arm, ProgramPose, RecordedProgram, postures_of, read
from posedesign.programs.fanuc_ls import FanucLs
from posedesign.programs.fanuc_ls.reader import parse_fanuc_ls, parse_registers
from tests.unit.programs.dialects import arm_of, changed, export, program_of, refused

# In the manner of a controller with a positioner as second group and a rail: program lines in
# another language, wrapped and nested lines, numbers without leading zero, comments of all kinds.
FANUC = Arm.usual("fanuc")

EXPORT = export("fanuc.LS")


def parse(text: str) -> RecordedProgram:
    return parse_fanuc_ls(text.encode("ascii"), Path("X.LS"))


def test_a_controller_export_is_read() -> None:
    program = parse(EXPORT.replace("\n", "\r\n"))
    assert (program.name, program.comment) == ("TOUCHUP", "after service")
    assert program.fingerprint == "00c0ffee"
    assert [p.number for p in program.positions] == [1, 2, 12]
    assert [p.name for p in program.positions] == ["left", "", ""]
    assert [(p.user_frame, p.tool_frame) for p in program.positions] == [
        (0, 1),
        (None, None),
        (9, 10),
    ]
    expected: list[list[float]] = [[10, 20, -0.25, 0.5, -90, 0], [1, 2, 3, 4, 5, 6], [0] * 6]
    np.testing.assert_allclose(program.postures(), FANUC.postures(expected), atol=1e-15)
    assert np.degrees(program.postures()[0, 2]) == pytest.approx(19.75)
    lines = EXPORT.splitlines()
    assert [lines[p.line - 1][:2] for p in program.positions] == ["P[", "P[", "P "]


def test_unquoted_names_and_missing_frames_are_taken() -> None:
    text = SMALL.replace('P[1:"A"]', "P[1:A]").replace("\tUF : 0, UT : 1,\t\n", "")
    (position,) = parse(text).positions
    assert (position.name, position.user_frame, position.tool_frame) == ("A", None, None)


SMALL = """\
/PROG  CAL
/ATTR
/MN
   1:J P[1] 10% FINE    ;
/POS
P[1:"A"]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=     1.000 deg,\tJ2=     2.000 deg,\tJ3=     3.000 deg,
\tJ4=     4.000 deg,\tJ5=     5.000 deg,\tJ6=     6.000 deg
};
/END
"""
SECOND = SMALL[SMALL.index("P[1:") : SMALL.index("/END")].replace("P[1:", "P[2:")
CARTESIAN = """\
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   900.000  mm,\tY =     0.000  mm,\tZ =   500.000  mm,
\tW =   180.000 deg,\tP =     0.000 deg,\tR =   180.000 deg
};
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("/PROG  CAL\n", "", 1, "no name behind /PROG"),
        ("/PROG  CAL", "/PROG", 1, "no name behind /PROG"),
        ("/PROG", "ALARM HISTORY\n/PROG", 1, "does not start with /PROG"),
        ("/END\n", "", 12, "is cut off: there is no /END"),
        ("};\n/END\n", "", 11, "is cut off"),
        ("};\n", "", 10, r"P\[1\] .* is not complete"),
        ("};\n", "};\n" + SECOND.replace("};\n", ""), 16, r"P\[2\] .* is not complete"),
        ("};\n", SECOND, 10, r"P\[1\] .* is not complete"),
        ("};\n", "};\n" + SECOND.replace("P[2:", "P[1:"), 12, r"P\[1\] is there twice"),
        ("};\n", "};\nJ1=1 deg\n", 12, "'J1=1 deg' cannot stand"),
        ("   GP1:\n", "", 7, r"P\[1\] .* cannot stand"),
        ("   GP1:", "   GP2:", 6, r"P\[1\] has no motion group GP1"),
        ("   GP1:", "   GP1:\nGP1:", 8, r"P\[1\] has GP1 twice"),
        ("\tJ2=     2.000 deg,", "", 7, r"P\[1\]: J2 is missing"),
        (",\tJ6=     6.000 deg", "", 7, r"P\[1\]: J6 is missing"),
        ("J2=", "J1=", 9, r"P\[1\] has J1 twice"),
        ("6.000 deg", "6.000 deg, J7= 7 deg", 10, "J7 is no joint of a six-joint arm"),
        ("J4=     4.000", "J4=  ********", 10, r"P\[1\]: J4 has no value"),
        ("J4=     4.000", "J4=     4e2", 10, r"P\[1\] .* cannot stand behind .*J4="),
        ("J4=     4.000", "J4=     NaN", 10, r"P\[1\] .* cannot stand behind .*J4="),
        ("J4=     4.000", "J4=     inf", 10, r"P\[1\] .* cannot stand behind .*J4="),
        ("J4=     4.000", "J4=     4..0", 10, r"P\[1\] .* cannot stand behind .*J4="),
        ("J4=     4.000", "J4=     -", 10, r"P\[1\] .* cannot stand behind .*J4="),
        ("J4=     4.000", "J4=   720.001", 10, r"J4 is 720.001 deg, beyond \+-720"),
        ("4.000 deg", "4.000  mm", 10, "J4 is in mm, not in deg"),
        ("4.000 deg", "4.000", 10, "J4 is in no unit"),
        ("4.000 deg", "4.000 rad", 10, r"P\[1\] 'rad.* cannot stand"),
        ("CAL\n", "CAL\n\0", 2, "holds the byte 0x00"),
        ("};\n", "};\n\x7f\n", 12, "holds the byte 0x7f"),
        (SMALL[SMALL.index("P[1:") : SMALL.index("/END")], "", None, "holds no positions"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old, new, line, message):
    refused("fanuc-ls", "X.LS", changed(SMALL, old, new), line, message)


def test_a_cartesian_position_stands_beside_joint_positions() -> None:
    program = parse(SMALL.replace("};\n", '};\nP[2:"B"]{\n   GP1:\n' + CARTESIAN))
    joints, pose = program.positions
    assert joints.T_user_tool is None
    assert pose.shown_deg is None
    expected = [[-1, 0, 0, 0.9], [0, 1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1]]
    np.testing.assert_allclose(pose.T_user_tool, expected, atol=1e-15)
    assert pose.configuration is not None
    assert pose.configuration.words == "N U T, 0, 0, 0"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("W =   180.000 deg,", "", 7, r"P\[1\]: W is missing"),
        ("W =   180.000", "J1=   180.000", 10, r"P\[1\] has J1 beside X, Y, Z, W, P, R"),
        ("N U T", "N U X", 7, r"P\[1\]: .*N U X"),
        ("N U T, 0, 0, 0", "* * *, *, *, *", 7, "has no configuration"),
        ("900.000  mm", "900.000 deg", 9, "X is in deg, not in mm"),
        ("900.000", "900000.0", 9, "X is 900000.0 mm, beyond"),
        ("X =", "RX=", 9, "is seen from a remote TCP: RX"),
    ],
)
def test_what_is_wrong_with_a_pose_is_named_with_its_line(old, new, line, message):
    text = SMALL[: SMALL.index("\tUF")] + CARTESIAN + "/END\n"
    assert parse(text).positions[0].configuration
    assert parse(text.replace("N U T, 0, 0, 0", "")).positions[0].configuration is None
    refused("fanuc-ls", "X.LS", changed(text, old, new), line, message)


RAIL = ("6.000 deg\n", "6.000 deg,\n\tE1=   100.000  mm\n")


def test_an_extended_axis_is_there_in_all_positions() -> None:
    with pytest.raises(FileFormatError, match=r"P\[2\]: E1 is not there as in P\[1\]"):
        parse(SMALL.replace(*RAIL).replace("/END", SECOND + "/END"))
    with pytest.raises(FileFormatError, match=r"P\[1\] has a value for some extended axes only"):
        parse(SMALL.replace(RAIL[0], "6.000 deg,\n\tE1=  ********  mm,\tE2=     1.000  mm\n"))
    both = SMALL.replace("/END", SECOND + "/END").replace(*RAIL)
    zeros = both[::-1].replace("100.000"[::-1], "-.000"[::-1], 1)[::-1].replace("100.000", "0.000")
    assert len(parse(zeros).positions) == 2


def test_another_motion_group_may_not_move_either() -> None:
    group = "6.000 deg\n   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=   100.000  mm\n"
    both = SMALL.replace("/END", SECOND + "/END").replace("6.000 deg\n", group)
    assert len(parse(both).positions) == 2
    moved = parse(both[::-1].replace("100.000"[::-1], "200.000"[::-1], 1)[::-1])
    assert moved.positions[1].shown_deg is not None
    assert moved.positions[1].external_shown == ()
    with pytest.raises(FileFormatError, match=r"P\[2\]: GP2 J1 differs from that of P\[1\]"):
        moved.postures()


def test_letters_of_any_language_are_taken_and_other_bytes_named() -> None:
    text = SMALL.replace("   1:J", "   1:  !Prise pi\xe8ce ;\n   2:J")
    assert parse_fanuc_ls(text.encode("latin-1"), "X.LS").positions
    with pytest.raises(FileFormatError, match="line 2: holds the byte 0x01") as caught:
        parse_fanuc_ls(SMALL.replace("/ATTR", "/ATTR \x01").encode("latin-1"), "X.LS")
    assert caught.value.row == 2


def test_a_remark_of_a_person_is_no_mark_of_a_plan() -> None:
    for remark in ("SEE PLAN face 2", "FLOORPLAN 4711 2", "PLAN BEAD 1", "PLAN beef"):
        text = SMALL.replace("   1:J", f"   1:  !{remark} ;\n   2:J")
        assert parse(text).fingerprint == ""
    text = SMALL.replace("   1:J", "   1:  !PLAN 1a2b3c4d 27 ;\n   2:J")
    assert (parse(text).mark.fingerprint, parse(text).mark.measured) == ("1a2b3c4d", 27)


BACKUP = export("fanuc_registers.VA")


def test_a_backup_is_read_by_register(tmp_path: Path) -> None:
    path = tmp_path / "POSREG.VA"
    path.write_bytes(BACKUP.replace("\n", "\r\n").encode())
    program = read(path)
    assert [(p.number, p.name, p.line) for p in program.positions] == [
        (1, "HOME", 2),
        (3, "pin", 8),
    ]
    joints, pose = program.positions
    np.testing.assert_allclose(joints.shown_deg, [60, -50, 10, -10, -95, -0.5])
    assert pose.T_user_tool is not None
    np.testing.assert_allclose(pose.T_user_tool[:3, 3], [-0.820507, 2.309503, 0.945836])
    assert pose.configuration is not None
    assert pose.configuration.words == "N U T, 0, 0, 1"
    assert not program.fingerprint


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("[*POSREG*]$POSREG", "[*NUMREG*]$NUMREG", 1, r"there is no \$POSREG"),
        ("J3 =    10.000", "J3 =   *******", 3, r"PR\[1\]: J3 has no value"),
        ("J3 =    10.000 deg", "", 2, r"PR\[1\]: J3 is missing"),
        ("J3 =    10.000", "J3 =    1e.000", 3, "cannot stand behind"),
        ("J3 =", "J2 =", 3, r"PR\[1\] has J2 twice"),
        ("W:    90.594", "", 8, r"PR\[3\]: W is missing"),
        ("Config: N U T", "Config: N Q T", 8, r"PR\[3\]"),
        ("EXT1:     0.000 mm\n    [1,8]", "EXT1:     1.000 mm\n    [1,8]", 12, "E1 differs"),
        ("    [1,1] =   'HOME'   Group: 1\n", "", 2, "cannot make sense of"),
        ("J3 =", "?3 =", 3, "cannot make sense of"),
        ("    [1,8] = '' Uni", "    [1,123456] = '' Uni", 13, "there is no register"),
        ("    [1,8] = '' Uni", "    [1,1] = '' Uni", 13, r"PR\[1\] is there twice"),
    ],
)
def test_what_is_wrong_in_a_backup_is_named_with_its_line(
    old: str, new: str, line: int, message: str
) -> None:
    refused("fanuc-ls", "POSREG.VA", changed(BACKUP, old, new), line, message)


def test_empty_registers_are_no_positions() -> None:
    text = BACKUP.splitlines()[0] + "\n    [1,1] = '' Uninitialized\n"
    with pytest.raises(FileFormatError, match="all registers are empty"):
        parse_registers(text.encode(), "POSREG.VA")


POSTURES = np.deg2rad([[0.0, 10, -20, 0, -60, 0], [5.0, 10, -20, 0, -60, 0]])
ARM = arm_of("fanuc-ls")
MEANT = [ProgramPose(f"P{i}", q) for i, q in enumerate(POSTURES)]
(POSED,) = DIALECTS["fanuc-ls"].files(program_of("fanuc-ls", MEANT, form="cartesian")).values()


def test_a_pose_in_an_arm_position_that_cannot_take_it_is_named() -> None:
    head, tail = POSED.split('P[2:"P1"]')
    with pytest.raises(UnreachableError, match=r"position 2 \(P1\): .* N U B, 0, 0, 0"):
        parse(f'{head}P[2:"P1"]{tail.replace("N U T", "N U B")}').postures(ARM)
    with pytest.raises(UnreachableError, match=r"position 1 \(P0\): no posture"):
        parse(re.sub(r"Z = +", "Z = 99", POSED, count=1)).postures(ARM)


def test_without_a_configuration_the_plan_settles_which_posture_is_meant() -> None:
    positions = parse("\n".join(row.split("\t\tCONFIG")[0] for row in POSED.split("\n"))).positions
    assert all(p.configuration is None for p in positions)
    with pytest.raises(InputError, match=r"position 1 \(P0\): \d+ postures take it"):
        postures_of(positions, ARM)
    found = postures_of(positions, ARM, POSTURES + np.deg2rad(0.5))
    np.testing.assert_allclose(found, POSTURES, atol=2e-3)


UNTAUGHT = """P[2]{
   GP1:
\tUF : F, UT : F,\tCONFIG : '   , , , , ',
\tX = ********  mm,\tY = ********  mm,\tZ = ********  mm,
\tW = ********  deg,\tP = ********  deg,\tR = ********  deg,
\tE1=     0.000
};
"""


def test_an_untaught_position_spoils_no_other() -> None:
    text = SMALL.replace("/END", UNTAUGHT + "/END")
    program = FanucLs().parse(text.encode(), Path("CAL.LS"))
    assert [p.number for p in program.positions] == [1]
    assert "P[2]: X has no value" in program.unread[0].message
    assert [p for p in FanucLs().check(text.encode(), Path("CAL.LS")) if p.level == "error"] == []


@pytest.mark.parametrize("change", ["P[2]=LPOS", "P[2]=PR[3]"])
def test_a_position_that_the_program_changes_is_unread(change: str) -> None:
    move = "   1:J P[1] 10% FINE    ;\n"
    moves = f"{move}   2:  {change} ;\n   3:J P[2] 10% FINE    ;\n"
    text = SMALL.replace(move, moves).replace("/END", SECOND + "/END")
    program = FanucLs().parse(text.encode(), Path("CAL.LS"))
    assert 2 not in [p.number for p in program.positions]
    assert "P[2] is changed by the program" in " ".join(e.message for e in program.unread)
    assert len(parse(text.replace("3:J P[2]", "3:J P[1]")).positions) == 2


def test_words_of_german_controllers() -> None:
    move = "   1:J P[1] 10% FINE    ;"
    text = SMALL.replace(move, "   1:L P[1] 10mm/sec FINE WKZ_Offset,PR[3]    ;")
    assert [p for p in FanucLs().check(text.encode(), Path("CAL.LS")) if p.level == "error"] == []
