"""Bad input: one line that says what, where and what to do; exit code 2; no file left behind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from posedesign import config, tables

Cli = Callable[..., Any]
Refuse = Callable[..., str]
ChangeCell = Callable[[Mapping[str, str]], Path]
ChangeCsv = Callable[[str, int, str, str], Path]
MakeUrdf = Callable[..., Path]


def assert_says(line: str, *words: str) -> None:
    missing = [word for word in words if word not in line]
    assert not missing, f"{missing} not in: {line}"


# ------------------------------------------------------------------------------------- the cell

RADIANS = "[0.0, 0.2618, -0.4363, 0.0, -0.8727, 0.1]"

CELL_CASES = {
    "preset that does not exist": ("robot.preset", '"r2000ic165"', ("did you mean r2000ic165f",)),
    "preset nowhere near": ("robot.preset", '"kuka"', ("known: r2000ia165f_fig7, r2000ic165f",)),
    "tip that does not exist": ("robot.tip", '"tol0"', ("'tol0'", "did you mean tool0?")),
    "base that does not exist": ("robot.base", '"base_lnk"', ("'base_lnk'", "base_link")),
    "base that is the tip": ("robot.base", '"tool0"', ("no moving joint", "another tip")),
    "preset and urdf": ("robot.urdf", '"a.urdf"', ("either preset or urdf",)),
    "preset that is a number": ("robot.preset", "5", ("string", "5")),
    "control characters": ("robot.preset", r'"a\u0000b"', ("not allowed here",)),
    "unknown key": ("plan.condition_treshold", "1e5", ("did you mean condition_threshold?",)),
    "unknown key with an alias near": ("variations.rase", '"best"', ("did you mean raise?",)),
    "tool point of two values": ("tool.point_mm", "[1.0, 2.0]", ("is missing",)),
    "tool point of four values": ("tool.point_mm", "[1, 2, 3, 4]", ("too many values",)),
    "tool point as text": ("tool.point_mm", '"200, 0, 0"', ("should be a list in [ ]",)),
    "tool point not finite": ("tool.point_mm", "[nan, 0.0, 0.0]", ("finite number", "nan")),
    "tool point in another solar system": ("tool.point_mm", "[1e9, 0.0, 0.0]", ("1000000",)),
    "mass below zero": ("tool.mass_kg", "-1.0", ("greater than or equal to 0", "-1")),
    "posture of five joints": (
        "base_pose.posture_deg",
        "[0, 15, -25, 0, -50]",
        ("has 6 joints, the posture has 5 values", "joint_1, joint_2"),
    ),
    "posture of seven joints": (
        "base_pose.posture_deg",
        "[0, 15, -25, 0, -50, 0, 0]",
        ("has 6 joints, the posture has 7 values",),
    ),
    "posture with text": ("base_pose.posture_deg", '[0, "x", 0, 0, 0, 0]', ("number", "'x'")),
    "posture not finite": ("base_pose.posture_deg", "[0, inf, 0, 0, 0, 0]", ("finite",)),
    "posture in radians": ("base_pose.posture_deg", RADIANS, ("looks like radians", "degrees")),
    "posture outside the limits": (
        "base_pose.posture_deg",
        "[0, 80, -25, 0, -50, 0]",
        ("outside the limits", "joint_2 80.0 deg is above 76.0 deg", "inside the limits"),
    ),
    "variation of zero": ("variations.start_deg", "[0, 5, 5]", ("greater than 0",)),
    "step below zero": ("variations.step_deg", "[5, -5, 5]", ("greater than 0", "-5")),
    "start above the largest": (
        "variations.start_deg",
        "[5, 70, 5]",
        ("start_deg 70 is above largest_deg 60",),
    ),
    "raise in a way unknown": ("variations.raise", '"twice"', ("'together' or 'best'",)),
    "threshold below zero": ("plan.condition_threshold", "-1.0", ("greater than 0", "-1")),
    "threshold as text": ("plan.condition_threshold", '"low"', ("valid number", "'low'")),
    "margin below zero": ("plan.limit_margin_deg", "-5.0", ("greater than or equal to 0",)),
    "repair neither true nor false": ("plan.repair", "3", ("boolean", "3")),
    "offset of an unknown joint": (
        "parameters.zero_offsets",
        '["joint_2", "joint_33"]',
        ("no joint 'joint_33'", "joint_3"),
    ),
    "offset twice": ("parameters.zero_offsets", '["joint_2", "joint_2"]', ("listed twice",)),
    "offsets as text": ("parameters.zero_offsets", '"joint_2"', ("should be a list",)),
    "tool axes in another order": ("parameters.tool_axes", '"zx"', ("another order", "'zx'")),
    "unknown kind": ("measurement.kind", '"touchup"', ("'touch-up' or 'view-line'",)),
    "noise of zero": ("measurement.three_sigma_mm", "[0.02, 0.0, 0.1]", ("greater than 0",)),
    "noise below zero": ("measurement.three_sigma_mm", "[0.02, -1, 0.1]", ("greater than 0", "-1")),
    "one noise for three axes": ("measurement.three_sigma_mm", "0.02", ("should be a list",)),
    "camera noise of zero": ("measurement.camera_three_sigma_mm", "0.0", ("greater than 0",)),
    "camera angle noise of zero": ("measurement.camera_three_sigma_deg", "0", ("greater than 0",)),
    "seed with a fraction": ("truth.seed", "1.5", ("valid integer", "1.5")),
    "offsets of two joints": (
        "truth.zero_offsets_deg",
        "[0.1, 0.2]",
        ("2 values for 6 joints", "one value for each joint"),
    ),
    "speed above full speed": ("program.speed_percent", "200", ("less than or equal to 100",)),
    "empty target name": ("target.name", '""', ("at least 1 character",)),
    "line end in a target name": ("target.name", r'"a\nb"', ("not allowed here",)),
}


@pytest.mark.parametrize(("key", "value", "words"), CELL_CASES.values(), ids=CELL_CASES)
def test_key_of_the_cell(
    refuse: Refuse,
    change_cell: ChangeCell,
    work: Path,
    key: str,
    value: str,
    words: tuple[str, ...],
) -> None:
    line = refuse("plan", change_cell({key: value}), "--out", work / "out")
    section = key.split(".")[0]
    assert_says(line, str(work / "cell.toml"), section, *words, "(")


@pytest.mark.parametrize(
    "command",
    [
        ("score", "{cell}", "{work}/poses.csv"),
        ("simulate", "{cell}", "{work}/poses.csv", "--out", "{work}/out"),
        ("identify", "{cell}", "{work}/touchups.csv", "--out", "{work}/out"),
        ("program", "{work}/poses.csv", "--cell", "{cell}", "--out", "{work}/out"),
        ("study", "accuracy", "{cell}", "--draws", "10", "--out", "{work}/out"),
    ],
    ids=lambda words: words[0],
)
def test_every_command_refuses_a_bad_cell(
    refuse: Refuse, change_cell: ChangeCell, work: Path, command: tuple[str, ...]
) -> None:
    cell = change_cell({"plan.condition_treshold": "1.0"})
    line = refuse(*(word.format(cell=cell, work=work) for word in command))
    assert_says(line, str(cell), "plan.condition_treshold", "condition_threshold?")


CELL_TEXTS = {
    "nothing in it": (b"", ("robot", "is missing")),
    "a section that does not exist": (b"[tooll]\nmass_kg = 1\n", ("tooll", "did you mean tool?")),
    "a value for a section": (b"robot = 5\n", ("robot", "table")),
    "no TOML": (b"robot preset\n", ("no valid TOML", "line 1", "mend")),
    "a table twice": (b"[robot]\n[robot]\n", ("no valid TOML", "line 2")),
    "half a string": (b'[robot]\npreset = "r2\n', ("no valid TOML", "line 2")),
    "binary": (bytes(range(256)), ("not UTF-8", "save it as UTF-8")),
    "UTF-16": ("[robot]\n".encode("utf-16"), ("not UTF-8",)),
    "nested deep": (b"a = " + b"[" * 100_000, ("no valid TOML",)),
    "a number of ten thousand digits": (b"a = " + b"9" * 10_000, ("no valid TOML",)),
    "a CSV": (b"name,j1_deg\nP1,0.5\n", ("no valid TOML", "line 1")),
}


@pytest.mark.parametrize(("data", "words"), CELL_TEXTS.values(), ids=CELL_TEXTS)
def test_text_of_the_cell(refuse: Refuse, work: Path, data: bytes, words: tuple[str, ...]) -> None:
    path = work / "cell.toml"
    path.write_bytes(data)
    assert_says(refuse("plan", path, "--out", work / "out"), str(path), *words)


def test_cell_that_is_not_there(refuse: Refuse, work: Path) -> None:
    line = refuse("plan", work / "nosuch.toml", "--out", work / "out")
    assert_says(line, "nosuch.toml: cannot be read: No such file", "posedesign new > cell.toml")
    assert_says(refuse("plan", work, "--out", work / "out"), "Is a directory")


def test_cell_that_is_too_large(
    refuse: Refuse, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "LARGEST_CELL_BYTES", 100)
    assert_says(refuse("plan", work / "cell.toml", "--out", work / "out"), "cell.toml", "is larger")
    assert_says(refuse("plan", "/dev/zero", "--out", work / "out"), "/dev/zero", "is larger")


def test_base_pose_out_of_reach(refuse: Refuse, change_cell: ChangeCell, work: Path) -> None:
    cell = change_cell({"target.position_mm": "[9000.0, 0.0, 500.0]"})
    line = refuse("plan", cell, "--out", work / "out")
    assert_says(line, "the base pose cannot be taken", "out of reach by", "mm", "move the target")


def test_base_pose_inside_the_margin(refuse: Refuse, change_cell: ChangeCell, work: Path) -> None:
    line = refuse("plan", change_cell({"plan.limit_margin_deg": "70.0"}), "--out", work / "out")
    assert_says(line, "the base pose cannot be taken", " deg is ", "lower plan.limit_margin_deg")


@pytest.mark.parametrize("joint", ["joint_1", "joint_6"])
@pytest.mark.parametrize("command", ["plan", "identify"])
def test_joint_that_cannot_be_identified_is_named(
    refuse: Refuse, change_cell: ChangeCell, work: Path, joint: str, command: str
) -> None:
    joints = sorted({"joint_2", "joint_3", "joint_4", "joint_5", joint})
    cell = change_cell({"parameters.zero_offsets": str(joints).replace("'", '"')})
    words = [command, cell, *([work / "touchups.csv"] if command == "identify" else [])]
    line = refuse(*words, "--out", work / "out")
    assert_says(line, f"cannot identify zero_offset.{joint}:", "absorbed by", "leave it out")


def test_score_names_the_joint_that_cannot_be_identified(
    cli: Cli, change_cell: ChangeCell, work: Path
) -> None:
    cell = change_cell({"parameters.zero_offsets": '["joint_1", "joint_2"]'})
    said = cli("score", cell, work / "poses.csv")
    assert said.code == 1
    assert "cannot identify zero_offset.joint_1" in said.out


# ------------------------------------------------------------------------------------- the URDF


def test_new_names_near_presets(refuse: Refuse) -> None:
    line = refuse("new", "--robot", "r2000ic165")
    assert_says(line, "'r2000ic165' is neither a preset nor a URDF", "did you mean r2000ic165f")


URDF_CASES: dict[str, tuple[Mapping[str, Mapping[str, Any]], tuple[str, ...]]] = {
    "limits reversed": (
        {"a3": {"lower": 1.5, "upper": -1.5}},
        ("joint 'a3'", "limits reversed: lower 1.5 is above upper -1.5", "swap"),
    ),
    "limit as text": ({"a2": {"lower": "low"}}, ("joint 'a2'", "lower='low'", "correct")),
    "limit not a number": ({"a2": {"upper": "nan"}}, ("joint 'a2'", "upper='nan'")),
    "link that is missing": ({"a6": {"child": "hand"}}, ("joint 'a6'", "'hand'")),
    "prismatic": ({"a3": {"kind": "prismatic"}}, ("joint a3 is not revolute",)),
    "axis of zero": ({"a4": {"axis": "0 0 0"}}, ("joint 'a4'", "axis of length zero")),
    "origin of two numbers": ({"a4": {"xyz": "0 0"}}, ("joint 'a4'", "not three finite numbers")),
    "joint twice": ({"a2": {"name": "a1"}}, ("'a1'", "defined twice", "rename")),
}


@pytest.mark.parametrize(("joints", "words"), URDF_CASES.values(), ids=URDF_CASES)
def test_malformed_arm(
    refuse: Refuse,
    make_urdf: MakeUrdf,
    joints: Mapping[str, Mapping[str, Any]],
    words: tuple[str, ...],
) -> None:
    urdf = make_urdf(joints)
    line = refuse("new", "--robot", urdf)
    assert_says(line, *words, "(")
    if "prismatic" not in str(joints):
        assert str(urdf) in line


URDF_TEXTS = {
    "nothing in it": (b"", ("not well-formed XML",)),
    "cut off": (b'<robot name="a"><link name="l0"/>', ("not well-formed XML", "line 1")),
    "not a robot": (b"<sdf/>", ("<sdf>, not <robot>", "convert")),
    "no links": (b'<robot name="a"/>', ("no links",)),
    "binary": (bytes(range(256)), ("not well-formed XML",)),
    "entities": (
        b'<!DOCTYPE r [<!ENTITY a "aa">]><robot name="&a;"/>',
        ("entities are not accepted", "DOCTYPE"),
    ),
    "xacro": (
        b'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
        ("xacro", "xacro file.xacro > file.urdf"),
    ),
}


@pytest.mark.parametrize(("data", "words"), URDF_TEXTS.values(), ids=URDF_TEXTS)
def test_text_of_the_urdf(
    refuse: Refuse, tmp_path: Path, data: bytes, words: tuple[str, ...]
) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(data)
    assert_says(refuse("new", "--robot", path), str(path), *words)


def test_urdf_that_is_not_there(
    refuse: Refuse, cli: Cli, make_urdf: MakeUrdf, tmp_path: Path
) -> None:
    line = refuse("new", "--robot", tmp_path / "no.urdf")
    assert_says(line, "no.urdf: cannot be read: No such file", "posedesign robots")
    urdf = make_urdf()
    (tmp_path / "cell.toml").write_text(cli("new", "--robot", urdf).out)
    urdf.unlink()
    line = refuse("plan", tmp_path / "cell.toml", "--out", tmp_path / "out")
    assert_says(line, str(tmp_path / "cell.toml"), "robot", f"{urdf}: cannot be read")


def test_urdf_changed_under_the_cell(
    refuse: Refuse, cli: Cli, make_urdf: MakeUrdf, tmp_path: Path
) -> None:
    (tmp_path / "cell.toml").write_text(cli("new", "--robot", make_urdf()).out)
    make_urdf({"a3": {"lower": 1.0, "upper": -1.0}})
    line = refuse("plan", tmp_path / "cell.toml", "--out", tmp_path / "out")
    assert_says(line, "small.urdf", "joint 'a3'", "limits reversed")


# ------------------------------------------------------------------------------------ the tables

NUMBER_CASES = {
    "nan": "nan",
    "text": "abc",
    "empty": "",
    "infinite": "inf",
    "too large for a float": "1e999",
    "formula": "=1+1",
    "hexadecimal": "0x10",
    "underscore": "1_0",
    "Arabic digits": "١٢",
    "unit behind the number": "12 deg",
    "two numbers": "1 2",
}


@pytest.mark.parametrize("value", NUMBER_CASES.values(), ids=NUMBER_CASES)
@pytest.mark.parametrize(
    ("file", "column", "command"),
    [
        ("touchups.csv", "j3_deg", "identify"),
        ("poses.csv", "j6_deg", "score"),
        ("pairs.csv", "b_z_mm", "robot-world"),
    ],
    ids=["touchups", "poses", "pairs"],
)
def test_cell_that_is_no_number(
    refuse: Refuse,
    change_csv: ChangeCsv,
    work: Path,
    value: str,
    file: str,
    column: str,
    command: str,
) -> None:
    path = change_csv(file, 5, column, value)
    words = [command, *([] if command == "robot-world" else [work / "cell.toml"]), path]
    line = refuse(*words, *([] if command == "score" else ["--out", work / "out"]))
    shown = repr(value) if value else "an empty cell"
    assert_says(line, f"{path}, line 6, column {column}: {shown}", "finite number", "correct")


@pytest.mark.parametrize("command", ["simulate", "program", "score"])
def test_nan_in_poses(refuse: Refuse, change_csv: ChangeCsv, work: Path, command: str) -> None:
    poses = change_csv("poses.csv", 1, "j1_deg", "nan")
    words = [command, *([] if command == "program" else [work / "cell.toml"]), poses]
    line = refuse(*words, *([] if command == "score" else ["--out", work / "out"]))
    assert_says(line, f"{poses}, line 2, column j1_deg")


def identify(refuse: Refuse, work: Path, data: bytes | str) -> str:
    """What identify says of other touch-ups."""
    path = work / "touchups.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert str(path) in line
    return line


def test_wrong_column_names(refuse: Refuse, work: Path) -> None:
    good = (work / "touchups.csv").read_text()
    line = identify(refuse, work, good.replace("j2_deg", "joint2"))
    assert_says(line, "line 1: there is no column j2_deg", "did you mean")
    line = identify(refuse, work, good.replace("j2_deg", "J2_deg"))
    assert_says(line, "there is no column j2_deg", "J2_deg")
    line = identify(refuse, work, good.replace("target,", "tagret,"))
    assert_says(line, "there is no column target", "did you mean tagret?")


def test_wrong_unit_columns(refuse: Refuse, work: Path) -> None:
    good = (work / "touchups.csv").read_text()
    for bad in (good.replace("_deg", "_rad"), good.replace("j1_deg", "j1_rad")):
        line = identify(refuse, work, bad)
        assert_says(line, "line 1, column j1_rad", "another unit than deg", "j1_deg")
    pairs = (work / "pairs.csv").read_text()
    (work / "pairs.csv").write_text(pairs.replace("b_y_mm", "b_y_m"))
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    assert_says(line, "pairs.csv, line 1, column b_y_m", "another unit than mm", "b_y_mm")


def test_radians_in_a_degree_column(refuse: Refuse, work: Path) -> None:
    lines = (work / "touchups.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    turned = [
        ",".join([row[0], *(str(math.radians(float(v))) for v in row[1:7]), row[7]]) for row in rows
    ]
    line = identify(refuse, work, "\n".join([lines[0], *turned]) + "\n")
    assert_says(line, "column j1_deg to j6_deg", "look like radians", "57.29578", "--trust-units")


def test_fewer_equations_than_parameters(refuse: Refuse, work: Path) -> None:
    lines = (work / "touchups.csv").read_text().splitlines()
    path = work / "few.csv"
    for count in (1, 2, 3):
        path.write_text("\n".join(lines[: count + 1]) + "\n")
        line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
        said = f"{count} touch-ups give {3 * count} equations for 10 parameters"
        assert_says(line, said, "measure at least 4")


def test_the_same_posture_again_and_again(refuse: Refuse, work: Path) -> None:
    lines = (work / "touchups.csv").read_text().splitlines()
    path = work / "same.csv"
    path.write_text("\n".join([lines[0], *[lines[1]] * 27]) + "\n")
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert_says(line, "cannot identify", "absorbed by")


def test_touch_ups_of_another_robot(refuse: Refuse, change_csv: ChangeCsv, work: Path) -> None:
    lines = (work / "touchups.csv").read_text().splitlines()
    seven = [lines[0] + ",j7_deg", *(line + ",1.0" for line in lines[1:])]
    line = identify(refuse, work, "\n".join(seven) + "\n")
    assert_says(line, "column j7_deg", "6 joints only", "another robot")


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
def test_text_of_a_table(refuse: Refuse, work: Path, data: bytes, words: tuple[str, ...]) -> None:
    assert_says(identify(refuse, work, data), *words)


def test_long_nonsense_is_not_echoed_in_full(
    refuse: Refuse, change_csv: ChangeCsv, work: Path
) -> None:
    path = change_csv("touchups.csv", 1, "j2_deg", "x" * 50_000)
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert len(line) < 300 + len(str(path))


def test_nothing_steers_the_terminal(refuse: Refuse, work: Path) -> None:
    line = identify(refuse, work, "\x1b[31mtarget,\x1b[31mtarget\n1,2\n")
    assert "\x1b" not in line
    assert "\\x1b[31mtarget" in line


def test_table_that_is_too_large(
    refuse: Refuse, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "LARGEST_CSV_BYTES", 1000)
    line = refuse("identify", work / "cell.toml", work / "touchups.csv", "--out", work / "out")
    assert_says(line, "touchups.csv", "is larger than 0.001 MB")


def test_tables_that_are_not_there(refuse: Refuse, work: Path) -> None:
    for words in (
        ("identify", work / "cell.toml", work / "no.csv"),
        ("simulate", work / "cell.toml", work / "no.csv"),
        ("score", work / "cell.toml", work / "no.csv"),
        ("program", work / "no.csv"),
        ("robot-world", work / "no.csv"),
    ):
        out = [] if words[0] == "score" else ["--out", work / "out"]
        assert_says(refuse(*words, *out), "no.csv: cannot be read: No such file", "check the path")


def test_touch_up_without_a_target(refuse: Refuse, change_csv: ChangeCsv, work: Path) -> None:
    path = change_csv("touchups.csv", 4, "target", "")
    line = refuse("identify", work / "cell.toml", path, "--out", work / "out")
    assert_says(line, f"{path}, line 5, column target", "has no name")


def test_poses_that_were_all_dropped(refuse: Refuse, work: Path) -> None:
    text = (work / "poses.csv").read_text().replace(",grid,", ",dropped,")
    (work / "poses.csv").write_text(text)
    line = refuse("score", work / "cell.toml", work / "poses.csv")
    assert_says(line, "poses.csv: has no pose that was not dropped")


def test_arguments_swapped(refuse: Refuse, work: Path) -> None:
    line = refuse("score", work / "poses.csv", work / "cell.toml")
    assert_says(line, "poses.csv", "no valid TOML")


# ---------------------------------------------------------------------------------- AX=ZB, program


def test_too_few_pairs(refuse: Refuse, work: Path) -> None:
    lines = (work / "pairs.csv").read_text().splitlines()
    (work / "pairs.csv").write_text("\n".join(lines[:3]) + "\n")
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    assert_says(line, "2 pose pairs", "at least 3")


def test_pairs_all_alike(refuse: Refuse, work: Path) -> None:
    lines = (work / "pairs.csv").read_text().splitlines()
    (work / "pairs.csv").write_text("\n".join([lines[0], *[lines[1]] * 9]) + "\n")
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out")
    assert_says(line, "cannot identify", "all poses are the same")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "zhang"), ("no method 'zhang'", "did you mean zhuang")),
        (("--noise-deg", "1"), ("--noise-deg and --noise-mm", "or neither")),
        (("--noise-deg", "-1", "--noise-mm", "1"), ("noise", "-", "standard deviation")),
        (("--noise-deg", "nan", "--noise-mm", "1"), ("noise", "nan")),
        (("--noise-deg", "text", "--noise-mm", "1"), ("--noise-deg", "number", "--help")),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_options_of_robot_world(
    refuse: Refuse, work: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    line = refuse("robot-world", work / "pairs.csv", "--out", work / "out", *options)
    assert_says(line, *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--format", "fanuc"), ("'fanuc'", "did you mean fanuc-ls?")),
        (("--format", "kuka"), ("'kuka'", "known: fanuc-ls")),
        (("--name", "../x"), ("'../x' is not a FANUC program name", "letter first")),
        (("--name", "A B"), ("'A B' is not a FANUC program name",)),
        (("--name", "TOOLONGNAME"), ("at most 8 characters",)),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_options_of_program(
    cli: Cli, work: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    said = cli("program", work / "poses.csv", "--out", work / "out", *options)
    assert said.code == 2
    assert said.err.count("\n") == 1
    assert_says(said.err, "error: ", *words)
    assert not [path for path in (work / "out").glob("*") if path.is_file()]


def test_program_of_seven_joints(refuse: Refuse, work: Path) -> None:
    text = "name," + ",".join(f"j{i}_deg" for i in range(1, 8)) + "\nP1,10,20,30,40,50,60,70\n"
    (work / "poses.csv").write_text(text)
    line = refuse("program", work / "poses.csv", "--out", work / "out")
    assert_says(line, "six joints", "have 7")


# ---------------------------------------------------------------------------------- where results go

WRITERS = {
    "plan": ("plan", "cell.toml"),
    "simulate": ("simulate", "cell.toml", "poses.csv"),
    "identify": ("identify", "cell.toml", "touchups.csv"),
    "robot-world": ("robot-world", "pairs.csv"),
    "program": ("program", "poses.csv"),
    "study": ("study", "accuracy", "cell.toml", "--draws", "10"),
    "demo": ("demo", "--draws", "10"),
}


def typed(work: Path, words: tuple[str, ...]) -> list[str]:
    return [str(work / word) if "." in word else word for word in words]


@pytest.mark.parametrize("words", WRITERS.values(), ids=WRITERS)
def test_file_in_place_of_the_output_folder(
    refuse: Refuse, work: Path, words: tuple[str, ...]
) -> None:
    (work / "taken").write_text("mine")
    for out in (work / "taken", work / "taken" / "below"):
        line = refuse(*typed(work, words), "--out", out)
        assert_says(line, f"{out}: the output folder cannot be made", "--out")


FIRST_FILES = {
    "plan": "poses.csv",
    "simulate": "touchups.csv",
    "identify": "identification.json",
    "robot-world": "robot_world.csv",
    "program": "CALIB01.LS",
    "demo": "cell.toml",
}


@pytest.mark.parametrize("command", FIRST_FILES)
def test_folder_in_place_of_an_output_file(refuse: Refuse, work: Path, command: str) -> None:
    blocked = work / "out" / FIRST_FILES[command]
    blocked.mkdir(parents=True)
    line = refuse(*typed(work, WRITERS[command]), "--out", work / "out")
    assert_says(line, f"{blocked} is not an ordinary file")


# ------------------------------------------------------------------------------------ the command


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("plna", "cell.toml"), "No such command 'plna'. Did you mean 'plan'?"),
        (("plan",), "Missing argument 'cell'. (see posedesign plan --help)"),
        (("plan", "a.toml", "b.toml"), "unexpected extra argument(s) (b.toml)"),
        (("plan", "a.toml", "--outt", "x"), "No such option: --outt"),
        (("plan", "--help-me"), "No such option: --help-me"),
        (("study",), "Missing command. (see posedesign study --help)"),
        (("study", "acuracy"), "No such command 'acuracy'. Did you mean 'accuracy'?"),
        (("study", "accuracy", "--draws", "9"), "'--draws': Input should be greater than or equal"),
        (("study", "accuracy", "--draws", "many"), "'--draws': Input should be a valid integer"),
        (("demo", "--draws", "-5"), "'--draws': Input should be greater than or equal to 10"),
        (("demo", "--draws"), "Option '--draws' requires an argument"),
        (("simulate", "a", "b", "--seed", "-1"), "'--seed': Input should be greater than or equal"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_mistyped_commands(
    refuse: Refuse,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_says(refuse(*words), said, "--help)")
