"""Lists for ROS: the readers take what people and ROS's tools write, and say what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from calib import Robot
from calib.errors import FileFormatError, InputError
from posedesign.files.yaml_tree import MOST_DEPTH, json_items
from posedesign.programs import (
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
    find_dialect,
)
from posedesign.programs.registry import dialect_of
from tests.unit.programs.dialects import changed, export, refused

LISTS = ("ros-trajectory", "moveit-joints", "robot-calibration")
PATH = Path("X.yaml")


def parse(text: str, dialect: str = "ros-trajectory") -> RecordedProgram:
    return find_dialect(dialect).parse(text.encode(), PATH)


ECHOED, GOAL = export("ros_echo.yaml"), export("ros_goal.yaml")


def test_what_ros_prints_is_read() -> None:
    program = parse(ECHOED)
    assert (program.name, program.comment, program.mark.fingerprint) == ("X", "", "")
    assert [(p.number, p.name, p.line) for p in program.positions] == [(1, "", 4), (2, "", 8)]
    np.testing.assert_allclose(program.postures(), [[0.1, -2], [1, 0.5]], atol=1e-15)
    assert [p.number for p in parse(GOAL).positions] == [1, 2]
    windows = find_dialect("ros-trajectory").parse(
        b"\xef\xbb\xbf" + ECHOED.replace("\n", "\r\n").encode(), PATH
    )
    assert [p.line for p in windows.positions] == [4, 8]


def test_joints_are_put_into_the_order_of_the_arm() -> None:
    robot = Robot.preset("panda")
    arm = find_dialect("ros-trajectory").seen(Arm.of(robot))
    names = list(robot.joint_names)[::-1]
    program = parse(f"joint_names: {names}\npoints: [{{positions: [7, 6, 5, 4, 3, 2, 1]}}]")
    np.testing.assert_allclose(program.postures(arm), [[1, 2, 3, 4, 5, 6, 7]])
    names[0] = "finger"
    program = parse(f"joint_names: {names}\npoints: [{{positions: [7, 6, 5, 4, 3, 2, 1]}}]")
    with pytest.raises(InputError, match="position 1 has the joints finger, "):
        program.postures(arm)


def test_capture_poses_may_be_messages_and_name_joints_in_any_order() -> None:
    program = parse(
        "- joint_states: {header: {}, name: [a, b], position: [1.0, 2.0], velocity: []}\n"
        "  features: [camera]\n"
        "- features: []\n"
        "  positions: [4.0, 3.0]\n"
        "  joints: [b, a]\n",
        "robot-calibration",
    )
    assert [p.joint_names for p in program.positions] == [("a", "b"), ("b", "a")]
    assert [p.line for p in program.positions] == [1, 3]


def test_poses_passed_through_are_known_without_a_mark() -> None:
    points = "# via 2: over\n- {positions: [1.0]}\n# pose 1: left\n- {positions: [2.0]}\n"
    program = parse("joint_names: [a]\npoints:\n" + points)
    assert [p.number for p in program.positions] == [2, 1]
    assert [p.name for p in program.measured] == ["left"]
    assert program.fingerprint == ""


def test_equal_captures_count_each_and_standing_counts_once() -> None:
    rows = parse("{joint_names: [a], joint_values: [[1.0], [1.0]]}", "moveit-joints").positions
    assert [p.number for p in rows] == [1, 2]
    stands = parse("{joint_names: [a], points: [{positions: [1.0]}, {positions: [1.0]}]}")
    assert [p.number for p in stands.positions] == [1]


@pytest.mark.parametrize(
    ("text", "dialect"),
    [
        (ECHOED, "ros-trajectory"),
        (GOAL, "ros-trajectory"),
        ("{joint_names: [a], joint_values: [[1.0]]}", "moveit-joints"),
        ("# points:\njoint_values:\n- [1.0]\njoint_names: [a]\n", "moveit-joints"),
        ("[{joints: [a], positions: [1.0]}]", "robot-calibration"),
        ("- positions:\n  - 1.0\n  joints:\n  - a\n", "robot-calibration"),
        ("- joint_states:\n    name: [a]\n    position: [1.0]\n", "robot-calibration"),
    ],
)
def test_files_of_one_ending_are_told_apart(text: str, dialect: str, tmp_path: Path) -> None:
    for suffix in (".yaml", ".YML"):
        path = tmp_path / ("X" + suffix)
        path.write_text(text)
        assert dialect_of(path).name == dialect


def test_other_yaml_is_none_of_them(tmp_path: Path) -> None:
    path = tmp_path / "X.yaml"
    path.write_text("parameters: {eye_on_hand: true}\ntransformation: {x: 1.0}\n")
    with pytest.raises(FileFormatError, match="is none of ros-trajectory"):
        dialect_of(path)


SMALL = """\
# program: CAL
# PLAN abcdef12 2
joint_names:
- a
- b
points:
# pose 1: left
- positions:
  - 0.5
  - 0.25
# hold 1
- positions:
  - 0.5
  - 0.25
# pose 2: right
- positions:
  - 1.5
  - 1.25
# end of CAL
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("# end of CAL\n", "", None, "is cut off: there is no comment '# end of CAL'"),
        ("joint_names:\n- a\n- b\n", "", 3, "joint_names is missing"),
        ("- a\n- b\n", "", 3, "joint_names is not a list"),
        ("- a\n- b\n", "  []\n", 4, "joint_names is empty"),
        ("- b", "- a", 5, "joint_names has 'a' twice"),
        ("- b", "- [b]", 5, "holds something that is not a name"),
        ("- b\n", "- b\n- c\n", 10, "point 1: positions has 2 values, there are 3 joints"),
        ("  - 1.5\n", "", 17, "point 3: positions has 1 values, there are 2 joints"),
        ("  - 1.5", "  - .nan", 17, "point 3: positions: a is '.nan', not a number"),
        ("  - 1.5", "  - -.inf", 17, "a is '-.inf', not a number"),
        ("  - 1.25", "  - nan", 18, "b is 'nan', not a number"),
        ("  - 1.25", "  - '1.25'", 18, "b is '1.25', a text in quotes"),
        ("  - 1.25", "  - 1_0", 18, "b is '1_0', not a number"),
        ("  - 1.25", "  - 1:30", 18, "b is '1:30', not a number"),
        ("  - 1.25", "  - 1.2.5", 18, "b is '1.2.5', not a number"),
        ("  - 1.25", "  - ١", 18, "b is '١', not a number"),
        ("  - 1.25", "  - [1.25]", 18, "b is not a number"),
        ("  - 1.25", "  - 90.0", 18, r"b is 90.0 rad, beyond \+-12.5664 rad"),
        ("  - 1.25", "  - 1e999", 18, "b is '1e999', not a number"),
        ("  - 1.25", "  - &x 1.25", 18, r"has an anchor \(&\)"),
        ("  - 1.25", "  - *x", 18, r"has an alias \(\*\)"),
        ("  - 1.25", "  - !!float 1.25", 18, "has a tag"),
        ("  - 1.25", "  - ! 1.25", 18, "has a tag"),
        ("  - 1.25", "  - @", 18, "is no YAML: while scanning|is no YAML: found character"),
        ("  - 1.25", "  - 1.25\n ---", 19, "is no YAML"),
        ("# end", "---\nnext: 1\n# end", 20, "holds several documents"),
        ("points:", "points: 1\nothers:", 6, "points is not a list"),
        ("points:", "points: []\nothers:", 6, "holds no points"),
        ("points:", "others:", 3, "points is missing"),
        ("points:", "header: {a: 1, a: 2}\npoints:", 6, "has the key 'a' twice"),
        ("points:", "points: []\npoints:", 7, "has the key 'points' twice"),
        ("points:", "? [a]\n: 1\npoints:", 6, "a key is not a word"),
        ("- positions:\n  - 1.5\n", "- positions: 1.5\n  x:\n", 16, "positions is not a list"),
        ("- positions:\n  - 1.5\n  - 1.25\n", "- 7\n", 16, "point 3 is not a map"),
        ("# pose 2: right\n", "", 15, "no comment says which pose this is"),
        ("# pose 2: right", "# pose 1: right", 16, "pose 1 is there twice"),
        ("# pose 2: right", "# pose 0: right", 15, "poses are counted from 1"),
        ("# pose 2: right", "# pose 3: right", 15, "pose 3 is called pose, but the first 2"),
        ("# pose 2: right", "# via 2: right", 15, "pose 2 is called via, but the first 2"),
        ("# pose 2: right", "# hold 2", 15, "is not the one before"),
        ("# pose 2: right", "# hold 1", 15, "its joint values change"),
        ("# pose 2: right", "# pose 4: x\n# pose 2: right", 15, "that pose 4 comes next, but"),
        ("# end", "# pose 7: lost\n# end", 19, "that pose 7 comes next, but it does not"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old, new, line, message):
    refused("ros-trajectory", "X.yaml", changed(SMALL, old, new), line, message)


def test_the_small_list_is_good() -> None:
    program = parse(SMALL)
    assert [(p.number, p.name) for p in program.positions] == [(1, "left"), (2, "right")]


@pytest.mark.parametrize(
    ("text", "dialect", "line", "message"),
    [
        ("[1]", "moveit-joints", 1, "the file is not a map"),
        ("{joint_names: [a]}", "moveit-joints", 1, "joint_values is missing"),
        ("{joint_names: [a], joint_values: []}", "moveit-joints", 1, "holds no joint values"),
        ("joint_names: [a]\njoint_values:\n- [1.0, 2.0]", "moveit-joints", 3, "row 1 has 2 values"),
        ("joint_names: [a]\njoint_values:\n- 1.0", "moveit-joints", 3, "row 1 is not a list"),
        ("[]", "robot-calibration", 1, "holds no poses"),
        ("- 1", "robot-calibration", 1, "entry 1 is not a map"),
        ("- {}", "robot-calibration", 1, "entry 1: joints is missing"),
        ("- {joints: [a]}", "robot-calibration", 1, "entry 1: positions is missing"),
        ("- {positions: [1.0]}", "robot-calibration", 1, "entry 1: joints is missing"),
        (
            "- {joints: [a], positions: [1.0]}\n- {joints: [b], positions: [1.0]}",
            "robot-calibration",
            2,
            "entry 2 has other joints than entry 1",
        ),
        ("", "ros-trajectory", None, "is empty"),
        ("# only\n---\n", "ros-trajectory", None, "is empty"),
        ("\0", "ros-trajectory", None, "is no YAML"),
    ],
)
def test_what_is_wrong_with_lists_is_named(text, dialect, line, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(text, dialect)
    assert caught.value.row == line


def test_bytes_that_are_no_text_are_named_with_their_line() -> None:
    with pytest.raises(FileFormatError, match="line 2: holds the byte 0xe9") as caught:
        find_dialect("ros-trajectory").parse(b"# a\n# \xe9\n", PATH)
    assert caught.value.hint == "save it in UTF-8"


HOSTILE = [
    "[" * 300_000,
    "{" * 300_000,
    "- " * 300_000,
    "? " * 300_000,
    "a: " * 100_000,
    "[a," * 100_000,
    "[\n" * 100_000,
    "'" + "x" * 1_000_000,
    "#" * 1_000_000,
    "# pose 1: " + "(" * 1_000_000,
    "\n".join(f"{' ' * k}a:" for k in range(500)),
    "&a [" * 100_000,
    "x: &a [1]\ny: [" + "*a," * 10_000 + "]",
    "[" + "1" * 1_000_000 + "]",
    "{" + "a," * 15_000 + "}",
]


@pytest.mark.parametrize("k", range(len(HOSTILE)))
def test_hostile_files_are_refused_at_once(k: int) -> None:
    dialect, text = (LISTS[k % 3], HOSTILE[k])  # they have one parser
    # The parser's time grows with the square of the depth: minutes for the first of these.
    with pytest.raises(FileFormatError):
        parse(text, dialect)
    assert find_dialect(dialect).check(text.encode(), PATH)
    find_dialect(dialect).recognises(text.encode())


def test_nesting_is_bounded() -> None:
    deep = "[" * (MOST_DEPTH + 1) + "]" * (MOST_DEPTH + 1)
    with pytest.raises(FileFormatError, match=f"nested more than {MOST_DEPTH} deep"):
        parse(deep)


# points that stand on one line as JSON are read as a parser of YAML reads them, only sooner


def written() -> str:
    q = np.random.default_rng(1).uniform(-3, 3, (5, 6))
    poses = tuple(ProgramPose(f"P{i}", row) for i, row in enumerate(q))
    options = ProgramOptions(fingerprint="abcdef12", settle_s=0.0)
    return next(
        iter(find_dialect("ros-trajectory").files(PoseProgram("CAL", poses, options)).values())
    )


def test_every_point_is_read_the_quick_way_and_alike() -> None:
    text = written()
    short, items = json_items(text)
    assert len(items) == 5
    assert "positions" not in short
    assert short.count("\n") == text.count("\n")
    slow = parse(yaml.safe_dump(yaml.safe_load(text)))
    quick = parse(text)
    for a, b in zip(slow.positions, quick.positions, strict=True):
        np.testing.assert_array_equal(a.shown_deg, b.shown_deg)
    rows = text.splitlines()
    assert all('"positions"' in rows[p.line - 1] for p in quick.positions)


def test_a_text_that_looks_like_a_point_is_none() -> None:
    point = '- {"positions": [0.5]}'
    text = f"note: |\n  x\n\n  {point}\njoint_names: [a]\npoints:\n{point}\n"
    assert parse(text).positions[0].shown_deg == pytest.approx(np.degrees([0.5]))
    quoted = f"'a\n{point}\nb'\n"  # one text, of three lines
    assert json_items(quoted)[1]
    with pytest.raises(FileFormatError, match="the trajectory is not a map"):
        parse(quoted)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ('- {"positions": [0.5], "positions": [0.5]}', "has the key 'positions' twice"),
        ('- {"positions": [NaN]}', "positions: a is 'NaN', not a number"),
        ('- {"positions": [1e400]}', "positions: a is '1e400', not a number"),
        ('- {"positions": [' + "9" * 400 + "]}", "positions: a is '999.*', not a number"),
        ('- {"positions": [' + "9" * 5000 + "]}", "positions: a is '999.*', not a number"),
        ('- {"positions": [99999]}', "beyond"),
        ('- {"positions": [true]}', "positions: a is 'true', not a number"),
        ('- {"positions": ["0.5"]}', "a text in quotes, not a number"),
        ('- {"positions": [13.0]}', "beyond"),
        ('- {"positions": [[0.5]]}', "a is not a number"),
        ('- {"positions": [0.5, 0.5]}', "has 2 values, there are 1 joints"),
        ('- {"positions": []}', "has 0 values"),
        ('- {"positions": {"a": 0.5}}', "positions is not a list"),
        ('- {"velocities": [0.5]}', "positions is missing"),
        ('- {"positions": [0.5]', "is no YAML"),
        ('- {"positions": ' + "[" * 5000 + "]" * 5000 + "}", "nested more than|not a number"),
    ],
)
def test_what_is_wrong_with_json_is_said_with_its_line(point: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(f'joint_names: [a]\npoints:\n- {{"positions": [0.25]}}\n{point}\n')
    assert caught.value.row in (4, 5)
