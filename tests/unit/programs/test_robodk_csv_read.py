"""Joint lists of RoboDK: the reader and the validator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs import (
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
    find_dialect,
    read,
    validate,
    write,
)
from posedesign.programs.registry import dialect_of
from posedesign.programs.robodk_csv import MOST_COLUMNS

ROBODK = find_dialect("robodk-csv")
NOWHERE = Path("/nowhere/X.csv")


def parse(text: str) -> RecordedProgram:
    return ROBODK.parse(text.encode(), NOWHERE)


def values(text: str) -> list[list[float]]:
    return [list(p.shown_deg) for p in parse(text).positions if p.shown_deg is not None]


@pytest.mark.parametrize(
    "text",
    [
        "1.0,-2.5\n3.0,4.0\n",
        "1, -2.5\r\n3,4.",
        "\n# joints\n1;-2.5;\n\n% of today\n// and others\n3;4;\n",
        "1\t-2.5\n3\t4\n",
        "1 -2.5\n +3   4\n",
        "\ufeff1,-2.50e0\n3,.4e1\n",
        "J1,J2\n1,-2.5\n3,4\n",
        '"J1","J2","TIME"\n1,-2.5,0.1\n3,4,0.2\n',
        "step;J2 [deg];J1 (deg);ERROR\n7;-2.5;1;0\n8;4;3;0\n",
        "joint_1, joint_2\n1,-2.5\n3,4\n",
        "# J\nJoint 1,Joint 2\n1,-2.5\n3,4\n",
    ],
)
def test_what_people_and_spreadsheets_save_is_read(text: str) -> None:
    assert values(text) == [[1.0, -2.5], [3.0, 4.0]]
    assert [p.number for p in parse(text).positions] == [1, 2]
    assert (parse(text).name, parse(text).maker) == ("X", None)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", None, "holds no rows of joint values"),
        ("# only\n\n", None, "holds no rows of joint values"),
        ("J1,J2\n", None, "holds no rows of joint values"),
        ("1,2\n3\n", 2, "row 2 has 1 values, others have 2"),
        ("1,2\n\n3,4,5\n", 3, "row 2 has 3 values, others have 2"),
        ("J1,J2\n1,2,3\n", 2, "row 1 has 3 values, others have 2"),
        ("1,2\n3,nan\n", 2, "row 2: J2 is 'nan', not a number"),
        ("1,2\n3,\n", 2, "row 2 has 1 values"),
        ("1,2\n,3\n", 2, "row 2: J1 is '', not a number"),
        ("1,2\n3,1e999\n", 2, "row 2: J2 is '1e999', not a number"),
        ("1,2\n3,1_0\n", 2, "row 2: J2 is '1_0', not a number"),
        ("1,2\n3,721\n", 2, r"row 2: J2 is 721 deg, beyond \+-720"),
        ("1,2\nJ1,J2\n", 2, "row 2: J1 is 'J1', not a number"),
        ("1,5;2,5\n", 1, "has both ',' and ';' between values"),
        ("X,Y,Z\n1,2,3\n", 1, "has no columns J1, J2 and so on"),
        ("J1,J3\n1,2\n", 1, "has no columns J1, J2 and so on"),
        ("J2,J3\n1,2\n", 1, "has no columns J1, J2 and so on"),
        ("J1,J1\n1,2\n", 1, "has the column J1 twice"),
        ("J1 [rad],J2 [rad]\n1,2\n", 1, r"J1 \[rad\] is not in degrees"),
        ("1,2\né\n", 2, "row 2 has 1 values"),
        ("1," * MOST_COLUMNS + "1\n", 1, f"has {MOST_COLUMNS + 1} values in a row"),
        (",\n", 1, "row 1: J1 is ''"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(text: str, line: int | None, message: str) -> None:
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(text)
    assert caught.value.row == line
    assert caught.value.hint


PROGRAM = PoseProgram(
    "CAL",
    tuple(
        ProgramPose(f"P{k}", np.radians([k, 20, -30.5, 0.1, 50, 60]), via=k == 1) for k in range(4)
    ),
    ProgramOptions(fingerprint="abcdef12"),
    Arm.usual("yaskawa"),
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rows: 4", "rows: 5", "has 4 rows, CAL.txt beside it names 5"),
        ("rows: 4\n", "", "has 4 rows, CAL.txt beside it names -1"),
        ("row 3: pose 2: P2\n", "", "row 3 is not named in CAL.txt"),
        ("row 3:", "row 2:", "row 2 or pose 2 is there twice"),
        ("pose 2:", "pose 3:", "row 4 or pose 3 is there twice"),
        ("pose 2:", "pose 0:", "row 3 or pose 0 is there twice"),
    ],
)
def test_a_file_beside_that_does_not_fit_is_refused(old, new, message, tmp_path):
    path, beside = write(PROGRAM, "robodk-csv", tmp_path)
    text = beside.read_text()
    assert text.count(old) == 1
    beside.write_text(text.replace(old, new))
    with pytest.raises(FileFormatError, match=message):
        read(path)


def test_the_file_beside_is_no_script(tmp_path: Path) -> None:
    # URScript's files end in .txt, too, and remarks may hold whatever a script does
    pose = ProgramPose("movej([0, 0, 0, 0, 0, 0])", np.zeros(6), "def f():")
    path, beside = write(PoseProgram("CAL", (pose,)), "robodk-csv", tmp_path)
    assert dialect_of(beside) is ROBODK
    assert validate(beside) == []
    with pytest.raises(FileFormatError, match=r"they are in CAL\.csv beside it"):
        read(beside)
    path.write_text(path.read_text() * 2)
    assert [p.rule for p in validate(beside)] == ["beside"]
    path.unlink()
    assert [p.rule for p in validate(beside)] == ["beside"]


def test_without_the_file_beside_rows_are_counted(tmp_path: Path) -> None:
    path, beside = write(PROGRAM, "robodk-csv", tmp_path)
    assert read(path).maker == "yaskawa"
    beside.write_text("notes of somebody\nrow 1: pose 7: x\n")
    assert [p.number for p in read(path).positions] == [1, 2, 3, 4]
    beside.unlink()
    assert [p.number for p in read(path).measured] == [1, 2, 3, 4]


def test_poses_passed_through_are_known_without_a_mark(tmp_path: Path) -> None:
    path, beside = write(PROGRAM, "robodk-csv", tmp_path)
    beside.write_text(beside.read_text().replace("PLAN abcdef12 3\n", ""))
    assert [p.name for p in read(path).measured] == ["P0", "P2", "P3"]


GOOD = "1.0,-2.5\r\n3,720.000\n"
BREAKS = [
    ("ascii", "3,", "\x00,", 2),
    ("rows", GOOD, "", 1),
    ("blank", "\r\n", "\n\n", 2),
    ("text", "1.0,", "J1,J2\n1.0,", 1),
    ("text", "3,", "# of today\n3,", 2),
    ("columns", "720.000", "720.000,1", 2),
    ("number", "-2.5", "nan", 1),
    ("number", "-2.5", "-0.000", 1),
    ("number", "-2.5", "2e1", 1),
    ("number", "-2.5", "", 1),
    ("range", "720.000", "720.001", 2),
]


@pytest.mark.parametrize(("rule", "old", "new", "line"), BREAKS)
def test_each_rule_alone(rule: str, old: str, new: str, line: int) -> None:
    assert GOOD.count(old) == 1
    problems = ROBODK.check(GOOD.replace(old, new).encode(), NOWHERE)
    assert [(p.rule, p.line) for p in problems] == [(rule, line)]


def test_the_good_list_breaks_no_rule() -> None:
    assert ROBODK.check(GOOD.encode(), NOWHERE) == []
