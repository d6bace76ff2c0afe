"""Bad tables: one line with file, line and column; exit code 2; no file left behind."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calib.errors import FileFormatError
from calib.robots import Robot
from posedesign.cell.schema_sections import InstrumentSection
from posedesign.files import csv_tables
from posedesign.identification.instruments.joint_logs import read_joint_rows
from tests.cli.conftest import offsets_only

Refuse = Callable[..., Any]


NUMBER_CASES = {
    "nan": "nan",
    "text": "abc",
    "empty": "",
    "infinite": "inf",
    "beyond all bounds": "1e308",
    "too large for a float": "1e999",
    "formula": "=1+1",
    "hexadecimal": "0x10",
    "underscore": "1_0",
    "Arabic digits": "١٢",
    "unit behind the number": "12 deg",
    "two numbers": "1 2",
}


@pytest.mark.parametrize(
    ("file", "column", "command", "value"),
    [
        *(("poses.csv", "j6_deg", "score", value) for value in NUMBER_CASES.values()),
        ("touchups.csv", "j3_deg", "identify", "abc"),
        ("pairs.csv", "b_z_mm", "robot-world", "abc"),
    ],
    ids=[*NUMBER_CASES, "text in touchups", "text in pairs"],
)
def test_cell_that_is_no_number(refuse, change_csv, work, value, file, column, command):
    path = change_csv(file, 5, column, value)
    words = [command, *([] if command == "robot-world" else [work / "cell.toml"]), path]
    line = refuse(*words, *([] if command == "score" else ["--out", work / "out"]))
    shown = repr(value) if value else "an empty cell"
    line.says(f"{path}, line 6, column {column}: {shown}", "finite number", "correct")


def identify(refuse: Refuse, work: Path, data: bytes | str) -> Any:
    """What identify says of other touch-ups."""
    path = work / "touchups.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert str(path) in line
    return line


def test_wrong_column_names(refuse, work):
    good = (work / "touchups.csv").read_text()
    line = identify(refuse, work, good.replace("j2_deg", "joint2"))
    line.says("line 1: there is no column j2_deg", "did you mean")
    line = identify(refuse, work, good.replace("j2_deg", "J2_deg"))
    line.says("there is no column j2_deg", "J2_deg")
    line = identify(refuse, work, good.replace("target,", "tagret,"))
    line.says("there is no column target", "did you mean tagret?")


def test_wrong_unit_columns(refuse, work):
    good = (work / "touchups.csv").read_text()
    for bad in (good.replace("_deg", "_rad"), good.replace("j1_deg", "j1_rad")):
        line = identify(refuse, work, bad)
        line.says("line 1, column j1_rad", "another unit than deg", "j1_deg")
    pairs = (work / "pairs.csv").read_text()
    (work / "pairs.csv").write_text(pairs.replace("b_y_mm", "b_y_m"))
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    line.says("pairs.csv, line 1, column b_y_m", "another unit than mm", "b_y_mm")


def test_radians_in_a_degree_column(refuse, work):
    lines = (work / "touchups.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    turned = [
        ",".join([row[0], *(str(math.radians(float(v))) for v in row[1:7]), row[7]]) for row in rows
    ]
    line = identify(refuse, work, "\n".join([lines[0], *turned]) + "\n")
    line.says("column j1_deg to j6_deg", "look like radians", "57.29578", "--trust-units")


def test_fewer_equations_than_parameters(refuse, work):
    lines = (work / "touchups.csv").read_text().splitlines()
    path, cell = work / "few.csv", offsets_only(work / "cell.toml")
    for count in (1, 2, 3):
        path.write_text("\n".join(lines[: count + 1]) + "\n")
        line = refuse("identify", cell, path, "--out", work / "out")
        said = f"{count} measurements give {3 * count} equations for 10 parameters"
        line.says(said, "measure at least 4")


def test_the_same_posture_again_and_again(refuse, work):
    lines = (work / "touchups.csv").read_text().splitlines()
    path = work / "same.csv"
    target, *joints, pose = lines[1].split(",")
    rows = []
    for k in range(27):  # what the sixth joint does is the tool point's business
        turned = [*joints[:5], str(float(joints[5]) + 0.01 * k)]
        rows.append(",".join([target, *turned, f"{pose}{k}"]))
    path.write_text("\n".join([lines[0], *rows]) + "\n")
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    line.says("cannot identify", "absorbed by")


def test_touch_ups_of_another_robot(refuse, change_csv, work):
    lines = (work / "touchups.csv").read_text().splitlines()
    seven = [lines[0] + ",j7_deg", *(line + ",1.0" for line in lines[1:])]
    line = identify(refuse, work, "\n".join(seven) + "\n")
    line.says("column j7_deg", "6 joints only", "another robot")


TABLE_TEXTS = {
    "nothing in it": (b"", ("no rows of data",)),
    "a header only": (b"target,j1_deg\n", ("no rows of data",)),
    "blank lines": (b"\n\r\n\n", ("no rows of data",)),
    "comments only": (b"# a\n# b\n", ("no rows of data",)),
    "binary": (bytes(range(256)), ("not UTF-8", "CSV (UTF-8)")),
    "Latin 1": ("target,j1_deg\nZäpfchen,1\n".encode("latin-1"), ("not UTF-8",)),
    "UTF-16": ("target,j1_deg\nT1,1\n".encode("utf-16"), ("not UTF-8",)),
    "tabs": (b"target\tj1_deg\nT1\t1\n", ("line 1", "tabs", "commas")),
    "semicolons": (b"target;j1_deg\nT1;1,5\n", ("line 1", "semicolons", "commas")),
    "comments, then semicolons": (b"# a\ntarget;j1_deg\nT1;1,5\n", ("line 2", "semicolons")),
    "a row too short": (b"target,j1_deg\nT1,1\nT1\n", ("line 3", "1 cells, the header has 2")),
    "a row too long": (b"target,j1_deg\nT1,1\nT1,1,5\n", ("line 3", "3 cells", "has 2", "point")),
    "a column twice": (b"j1_deg,target,j1_deg\n1,T1,1\n", ("column j1_deg", "twice", "rename")),
    "half a quotation": (b'target,j1_deg\n"T1,1\nT1,1\n', ("no valid CSV", "quotation")),
    "a zero byte": (b"target,j1_deg\nT1,\x001\n", ("touchups.csv",)),
    "old Macintosh": (b"target,j1_deg\rT1,1\r", ("no valid CSV", "line end")),
    "a cell of megabytes": (b"target,j1_deg\n" + b"1" * 3_000_000 + b",1\n", ("line 2", "limit")),
    "a page of HTML": (b"<html>\n<body>\n</body>\n</html>\n", ("there is no column target",)),
}


@pytest.mark.parametrize(("data", "words"), TABLE_TEXTS.values(), ids=TABLE_TEXTS)
def test_text_of_a_table(refuse, work, data, words):
    identify(refuse, work, data).says(*words)


def test_long_nonsense_is_not_echoed_in_full(refuse, change_csv, work):
    path = change_csv("touchups.csv", 1, "j2_deg", "x" * 50_000)
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert len(line) < 300 + len(str(path))


def test_nothing_steers_the_terminal(refuse, work):
    line = identify(refuse, work, "\x1b[31mtarget,\x1b[31mtarget\n1,2\n")
    assert "\x1b" not in line
    assert "\\x1b[31mtarget" in line


def test_table_that_is_too_large(refuse, work, monkeypatch):
    monkeypatch.setattr(csv_tables, "LARGEST_CSV_BYTES", 1000)
    line = refuse("identify", work / "cell.toml", work / "touchups.csv", "--out", work / "out")
    line.says("touchups.csv", "is larger than 0.001 MB")


def test_tables_that_are_not_there(refuse, work):
    for words in (
        ("identify", work / "cell.toml", work / "no.csv"),
        ("simulate", work / "cell.toml", work / "no.csv"),
        ("score", work / "cell.toml", work / "no.csv"),
        ("program", work / "no.csv"),
        ("robot-world", work / "no.csv"),
    ):
        out = [] if words[0] == "score" else ["--out", work / "out"]
        refuse(*words, *out).says("no.csv: cannot be read: No such file", "check the path")


def test_touch_up_without_a_target(refuse, change_csv, work):
    path = change_csv("touchups.csv", 4, "target", "")
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    line.says(f"{path}, line 5, column target", "has no name")


def test_poses_that_were_all_dropped(refuse, work):
    text = (work / "poses.csv").read_text()
    text = text.replace(",grid,", ",dropped,").replace(",via,", ",dropped,")
    (work / "poses.csv").write_text(text)
    line = refuse("score", work / "cell.toml", work / "poses.csv")
    line.says("poses.csv: has no pose that was not dropped")


def test_arguments_swapped(refuse, work):
    line = refuse("score", work / "poses.csv", work / "cell.toml")
    line.says("poses.csv", "no valid TOML")


def test_a_mistyped_column_that_is_not_needed_is_named(cli, work):
    """Without the word, a pose that is to be passed through would be measured."""
    poses, touch_ups = work / "poses.csv", work / "touchups.csv"
    poses.write_text(poses.read_text().replace("status", "stauts", 1))
    said = cli("check", work / "cell.toml", poses)
    assert f"warning: {poses}: the column stauts is not read: is it meant to be status?" in said.err
    touch_ups.write_text(touch_ups.read_text().replace(",pose", ",Pose", 1))
    said = cli("identify", offsets_only(work / "cell.toml"), touch_ups, "--out", work)
    assert f"{touch_ups}: the column Pose is not read: is it meant to be pose?" in said.err
    touch_ups.write_text(touch_ups.read_text().replace(",Pose", ",shift", 1))
    assert "not read" not in cli("identify", work / "cell.toml", touch_ups, "--out", work).err


def test_files_of_another_kind_say_what_they_are(refuse, work):
    """JSON, a cell and a program where a table is read, by every command that reads one."""
    cell, poses = work / "cell.toml", work / "poses.csv"
    content = work / "identification.json"
    content.write_text('{\n  "models": [1, 2,\n 3, 4]\n}\n')
    program = work / "CALIB01.script"
    program.write_text("def CALIB01():\n  movej([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], a=1, v=1)\nend\n")
    page = work / "report.html"
    page.write_text("<html>\n<body>a, b</body>\n</html>\n")
    rule = ("--identification", content)
    for command in (
        ("identify", cell),
        ("recheck", cell),
        ("prove", cell),
        ("robot-world",),
        ("network",),
        ("score", cell),
        ("program",),
    ):
        more = rule if command[0] == "recheck" else ()
        if command[0] == "prove":
            more = ("--rule", poses)
        if command[0] == "program":
            more = ("--cell", cell)
        for path, said in (
            (content, "is JSON"),
            (cell, "is TOML"),
            (page, "is XML or HTML"),
            (program, "is a Universal Robots URScript program"),
        ):
            if (command[0], path) in {("robot-world", content), ("prove", path)}:
                continue
            if path == program and command[0] in ("score", "program"):
                continue
            refuse(*command, path, *more).says(f"{path}: {said}", "a table (CSV) is read here")


def test_joints_in_a_file_of_another_kind(tmp_path):
    other = tmp_path / "identification.json"
    other.write_text("{}")
    with pytest.raises(FileFormatError, match=r"no table of joints .* no program of") as no:
        read_joint_rows(other, Robot.preset("ur5e"), InstrumentSection())
    assert "j1_deg j2_deg" in no.value.hint


def test_names_that_would_steer_a_terminal_are_refused_in_poses(refuse, change_csv, work):
    for column in ("name", "reason"):
        path = change_csv("poses.csv", 3, column, "P1\x1b[31mred")
        line = refuse("check", work / "cell.toml", path)
        line.says(f"column {column}: 'P1\\x1b[31mred' has a character that cannot be shown")
        path = change_csv("poses.csv", 3, column, "P1")
