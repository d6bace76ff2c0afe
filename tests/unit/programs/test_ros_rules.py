"""Lists for ROS: each rule of the validators has a file that breaks it, and it alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from posedesign.programs import find_dialect

TRAJECTORY = """\
header:
  stamp: {sec: 0, nanosec: 0}
  frame_id: ""
joint_names: [a, b]
points:
- positions: [0.5, -1.0]
  velocities: [0.1, 0.0]
  accelerations: []
  effort: []
  time_from_start: {sec: 1, nanosec: 0}
- positions: [0, 12.5]
  velocities: [0.0, 0.0]
  accelerations: []
  effort: []
  time_from_start: {sec: 1, nanosec: 5}
"""
MOVEIT = "joint_names: [a, b]\njoint_values:\n- [0.5, -1.0]\n- [0.0, 12.5]\n"
CAPTURE = """\
- joints: [a, b]
  positions: [0.5, -1.0]
  features: []
- joints: [b, a]
  positions: [0.0, 12.5]
  features: [camera]
"""
GOOD = {"ros-trajectory": TRAJECTORY, "moveit-joints": MOVEIT, "robot-calibration": CAPTURE}

BREAKS: list[tuple[str, str, str, str, int]] = [
    # rule, dialect, what is replaced, by what, line
    ("utf-8", "ros-trajectory", "[a, b]", "[a, \udce9]", 4),
    ("yaml", "ros-trajectory", "[a, b]", "[a, b", 5),
    ("yaml", "moveit-joints", "12.5]\n", "12.5]\n---\n{}\n", 6),
    ("plain-yaml", "ros-trajectory", "[a, b]", "&n [a, b]", 4),
    ("plain-yaml", "ros-trajectory", "[0, 12.5]", "[0, !!float 12.5]", 11),
    ("plain-yaml", "robot-calibration", "[0.0, 12.5]", "*p", 5),
    ("plain-yaml", "robot-calibration", "[camera]", "[" * 20 + "]" * 20, 6),
    ("plain-yaml", "moveit-joints", "joint_names: [a, b]\n", "joint_names: [a, b]\n" * 2, 2),
    ("keys", "ros-trajectory", "nanosec: 5", "nsecs: 5", 15),
    ("keys", "ros-trajectory", "- positions: [0.5, -1.0]\n  ", "- ", 6),
    ("keys", "ros-trajectory", "nanosec: 5", "nanosec: 5, nsec: 5", 15),
    ("keys", "ros-trajectory", "{sec: 1, nanosec: 5}", "1.0", 15),
    ("keys", "ros-trajectory", "[0, 12.5]", "0", 11),
    ("keys", "moveit-joints", "joint_values", "values: []\njoint_values", 2),
    ("keys", "robot-calibration", "  features: []\n", "", 1),
    ("joint-names", "ros-trajectory", "[a, b]", "[a, a]", 4),
    ("joint-names", "ros-trajectory", "[a, b]", "[a, yes]", 4),
    ("joint-names", "moveit-joints", "[a, b]", "[a, 1]", 1),
    ("joint-names", "moveit-joints", "[a, b]", '[a, ""]', 1),
    ("joint-names", "moveit-joints", "[a, b]", "[a, [b]]", 1),
    ("length", "ros-trajectory", "[0, 12.5]", "[0, 12.5, 1.0]", 11),
    ("length", "ros-trajectory", "[0.1, 0.0]", "[0.1]", 7),
    ("length", "moveit-joints", "[0.0, 12.5]", "[0.0]", 4),
    ("length", "robot-calibration", "[0.0, 12.5]", "[0.0]", 5),
    ("number", "ros-trajectory", "12.5", ".nan", 11),
    ("number", "ros-trajectory", "12.5", "'12.5'", 11),
    ("number", "ros-trajectory", "12.5", "1e1", 11),
    ("number", "moveit-joints", "12.5", "012", 4),
    ("number", "moveit-joints", "12.5", "1_2", 4),
    ("number", "moveit-joints", "12.5", "1:2", 4),
    ("number", "robot-calibration", "12.5", "{}", 5),
    ("range", "ros-trajectory", "12.5", "12.57", 11),
    ("range", "moveit-joints", "12.5", "-90.0", 4),
    ("entries", "moveit-joints", "\n- [0.5, -1.0]\n- [0.0, 12.5]", " []", 2),
    ("stamp", "ros-trajectory", "{sec: 0,", "{sec: 4,", 2),
    ("frame-id", "ros-trajectory", '""', "[]", 3),
    ("time", "ros-trajectory", "nanosec: 5", "nanosec: 1000000000", 15),
    ("time", "ros-trajectory", "nanosec: 5", "nanosec: 5.0", 15),
    ("time", "ros-trajectory", "sec: 1, nanosec: 5", "sec: 2147483648, nanosec: 5", 15),
    ("increasing", "ros-trajectory", "nanosec: 5", "nanosec: 0", 15),
    ("increasing", "ros-trajectory", ", nanosec: 5", "", 15),
    ("keys", "ros-trajectory", "\n  time_from_start: {sec: 1, nanosec: 5}", "", 11),
    ("increasing", "ros-trajectory", "sec: 1, nanosec: 0", "sec: 0, nanosec: 0", 10),
    ("standstill", "ros-trajectory", "  velocities: [0.0, 0.0]", "  velocities: [0.0, -0.1]", 12),
    ("same-joints", "robot-calibration", "[b, a]", "[b, c]", 4),
    ("features", "robot-calibration", "[camera]", "[[]]", 6),
]  # fmt: skip


@pytest.mark.parametrize("dialect", GOOD)
def test_good_files_break_no_rule(dialect: str) -> None:
    assert find_dialect(dialect).check(GOOD[dialect].encode(), Path("X.yaml")) == []


@pytest.mark.parametrize(
    "text",
    [
        # as people publish them
        "header:\n  stamp: now\n  frame_id: ''\njoint_names: ['a']\npoints:\n"
        "- positions: [1.]\n  time_from_start: {secs: 5, nsecs: 0}\n",
        "{joint_names: [a],\n  points: [{positions: [.56], time_from_start: {secs: 6}}]}\n",
        "trajectory:\n  header: auto\n  joint_names:\n  - a\n  points:\n  - positions: [0]\n"
        "    velocities: [0]\n    time_from_start: {sec: 1}\npath_tolerance:\n- {name: ''}\n"
        "goal_time_tolerance: {sec: 0, nanosec: 0}\n",
        "{goal: {trajectory: {joint_names: [a], points:\n"
        "  [{positions: [+1], time_from_start: {sec: 2}}]}}}\n",
        # as rostopic echo prints it
        "header: \n  seq: 0\n  stamp: \n    secs: 0\n    nsecs:         0\n  frame_id: ''\n"
        "joint_names: \n  - a\npoints: \n  - \n    positions: [-1.2e-05]\n    velocities: []\n"
        "    time_from_start: \n      secs: 1\n      nsecs:         0\n---\n",
    ],
)
def test_what_people_publish_and_echo_prints_breaks_no_rule(text: str) -> None:
    ros = find_dialect("ros-trajectory")
    assert ros.check(text.encode(), Path("X.yaml")) == []
    assert len(ros.parse(text.encode(), Path("X.yaml")).positions) == 1


@pytest.mark.parametrize(("rule", "dialect", "old", "new", "line"), BREAKS)
def test_each_rule_alone(rule: str, dialect: str, old: str, new: str, line: int) -> None:
    assert GOOD[dialect].count(old) == 1
    data = GOOD[dialect].replace(old, new).encode("utf-8", "surrogateescape")
    problems = find_dialect(dialect).check(data, Path("X.yaml"))
    assert {problem.rule for problem in problems} == {rule}
    assert problems[0].line == line
    assert len(problems) == 1


def test_the_dialog_of_moveit_opens_only_yaml() -> None:
    (problem,) = find_dialect("moveit-joints").check(MOVEIT.encode(), Path("X.yml"))
    assert problem.rule == "ending"


@pytest.mark.parametrize("dialect", GOOD)
@pytest.mark.parametrize("data", [b"", b"\0", b"\xff\xfe", b"1", b"[]", b"{}", b"- - - 1", b"? ?"])
def test_what_is_no_list_never_fails_and_has_problems(dialect: str, data: bytes) -> None:
    assert find_dialect(dialect).check(data, Path("X.yaml"))
