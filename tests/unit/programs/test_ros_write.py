"""Lists for ROS: the writers, and that ROS's own message types take what they write."""
# ruff: noqa: E501

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calib import Robot
from calib.errors import InputError
from calib.robots import preset_names
from posedesign.programs import (
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    find_dialect,
    read,
    validate,
    write,
)
from posedesign.programs.registry import dialect_of
from posedesign.programs.ros.writer import (
    MOST_SECONDS,
    UNKNOWN_SPEED,
    joint_speeds,
    point_times_ms,
)
from tests.marks import rest_in_full

LISTS = ("ros-trajectory", "moveit-joints", "robot-calibration")
CAPTURES = LISTS[1:]

TRAJECTORY = """\
# trajectory_msgs/msg/JointTrajectory, joint values in rad
# program: CAL
# title: cell 7
# PLAN abcdef12 2 1 470ef245
# tool frame 1, user frame 0, speed 50 percent, settling 0.5 s
header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: ""
joint_names:
- joint_1
- joint_2
points:
# pose 1: T 1
- {"positions": [0.500000000000, -1.000000000000], "velocities": [0.0, 0.0], "accelerations": [], "effort": [], "time_from_start": {"sec": 9, "nanosec": 425000000}}
# hold 1
- {"positions": [0.500000000000, -1.000000000000], "velocities": [0.0, 0.0], "accelerations": [], "effort": [], "time_from_start": {"sec": 9, "nanosec": 925000000}}
# via 3: over the fixture
- {"positions": [0.500000000000, 0.000000000000], "velocities": [0.0, 0.0], "accelerations": [], "effort": [], "time_from_start": {"sec": 12, "nanosec": 925000000}}
# remark: mind the cable
# pose 2
- {"positions": [0.500000000000, 0.100000000000], "velocities": [0.0, 0.0], "accelerations": [], "effort": [], "time_from_start": {"sec": 13, "nanosec": 415000000}}
# hold 2
- {"positions": [0.500000000000, 0.100000000000], "velocities": [0.0, 0.0], "accelerations": [], "effort": [], "time_from_start": {"sec": 13, "nanosec": 915000000}}
# end of CAL
"""

MOVEIT = """\
# joint states of moveit_calibration, joint values in rad
# program: CAL
# title: cell 7
# PLAN abcdef12 2 1 039c9f49
# tool frame 1, user frame 0, speed 50 percent, settling 0.5 s
joint_names:
- joint_1
- joint_2
joint_values:
# pose 1: T 1
- - 0.500000000000
  - -1.000000000000
# remark: mind the cable
# pose 2
- - 0.500000000000
  - 0.100000000000
# end of CAL
"""

CAPTURE = """\
# capture poses of robot_calibration, joint values in rad
# program: CAL
# title: cell 7
# PLAN abcdef12 2 1 af985700
# tool frame 1, user frame 0, speed 50 percent, settling 0.5 s
# pose 1: T 1
- joints:
  - joint_1
  - joint_2
  positions:
  - 0.500000000000
  - -1.000000000000
  features: []
# remark: mind the cable
# pose 2
- joints:
  - joint_1
  - joint_2
  positions:
  - 0.500000000000
  - 0.100000000000
  features: []
# end of CAL
"""
EXPECTED = dict(zip(LISTS, (TRAJECTORY, MOVEIT, CAPTURE), strict=True))

POSES = (
    ProgramPose("T 1", np.array([0.5, -1.0])),
    ProgramPose("over the fixture", np.array([0.5, -1e-14]), via=True),
    ProgramPose("", np.array([0.5, 0.1]), "mind the cable"),
)
OPTIONS = ProgramOptions(speed_percent=50, settle_s=0.5, comment="cell 7", fingerprint="abcdef12")


def small(*poses: ProgramPose, **options: object) -> PoseProgram:
    return PoseProgram("CAL", poses or POSES, replace(OPTIONS, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize("dialect", LISTS)
def test_a_whole_list(dialect: str, tmp_path: Path) -> None:
    (path,) = write(small(), dialect, tmp_path)
    assert path == tmp_path / "CAL.yaml"
    assert path.read_text() == EXPECTED[dialect]
    assert validate(path, dialect) == []
    assert dialect_of(path).name == dialect

    back = read(path)
    assert (back.name, back.comment, back.maker) == ("CAL", "cell 7", None)
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    assert [(p.number, p.name) for p in back.measured] == [(1, "T 1"), (2, "")]
    stops = [pose for pose in POSES if not (pose.via and dialect in CAPTURES)]
    np.testing.assert_allclose(back.postures(), [p.posture_rad for p in stops], atol=1e-12, rtol=0)
    assert back.positions[0].joint_names == ("joint_1", "joint_2")
    lines = path.read_text().splitlines()
    assert all(lines[p.line - 1].startswith("- ") for p in back.positions)


def test_without_a_time_to_settle_the_arm_does_not_stand() -> None:
    text = find_dialect("ros-trajectory").files(small(settle_s=0))["CAL.yaml"]
    assert "hold" not in text
    assert text.count('"positions":') == 3


def test_times_follow_the_slowest_joint_and_a_cubic_is_never_too_fast() -> None:
    robot = Robot.preset("r2000ic165f")
    arm = Arm.of(robot)
    rng = np.random.default_rng(3)
    path = rng.uniform(robot.lower, robot.upper, (200, robot.n))
    path[50:] = path[49] + rng.normal(0, 0.02, (150, robot.n))  # short moves too
    moving, standing = point_times_ms(path, arm, 20, 0.7)
    assert standing == 700
    times, moves = np.array(moving) * 1e-3, np.abs(np.diff(path, axis=0))
    peak = 1.5 * moves / times[1:, None]  # of q0 + d (3 s^2 - 2 s^3) at s = 1/2
    assert (peak <= 0.2 * robot.speed * (1 + 1e-9)).all()
    assert (times[1:] >= (moves / (0.2 * robot.speed)).max(axis=1)).all()
    # not much slower than the arm can: the run-up, the cubic, and a millisecond
    slowest = (moves / (0.2 * robot.speed)).max(axis=1)
    assert (times[1:] <= np.maximum(1.5 * slowest, np.maximum(2 * slowest, 0.1) + 0.301)).all()
    farthest = np.maximum(robot.upper - path[0], path[0] - robot.lower)
    assert times[0] >= (farthest / (0.2 * robot.speed)).max()


def test_joints_without_a_speed_are_as_fast_as_the_others() -> None:
    robot = Robot.preset("r2000ic165f")
    robot = replace(robot, speed=np.array([np.nan, 2.0, 2.0, 4.0, 4.0, 9.0]))
    np.testing.assert_allclose(joint_speeds(Arm.of(robot), 50), [2, 1, 1, 2, 2, 4.5])
    none = replace(robot, speed=np.full(6, np.nan))
    np.testing.assert_allclose(joint_speeds(Arm.of(none), 10), np.full(6, 0.1 * UNKNOWN_SPEED))


def test_poses_at_one_place_have_different_times(tmp_path: Path) -> None:
    twice = small(POSES[0], replace(POSES[0], name="again"), settle_s=0)
    (path,) = write(twice, "ros-trajectory", tmp_path)
    assert validate(path) == []
    assert [(p.number, p.name) for p in read(path).positions] == [(1, "T 1"), (2, "again")]


def test_joint_names_that_yaml_would_misread_stand_in_quotes(tmp_path: Path) -> None:
    names = ("1", "yes", 'a "b": c', "é", "~", "arm/joint-6")
    robot = replace(Robot.preset("r2000ic165f"), joint_names=names)
    program = PoseProgram("CAL", (ProgramPose("P", np.zeros(6)),), OPTIONS, Arm.of(robot))
    for dialect in LISTS:
        (path,) = write(program, dialect, tmp_path)
        assert read(path).positions[0].joint_names == names
        assert validate(path) == []
        assert "- arm/joint-6" in path.read_text()


@pytest.mark.parametrize("dialect", LISTS)
@pytest.mark.parametrize(
    ("program", "message"),
    [
        (lambda: small(comment="two\nlines"), "comment 'two.nlines' cannot stand in a comment"),
        (lambda: small(comment=" cell"), "cannot stand in a comment"),
        (lambda: small(ProgramPose("a\x85b", np.zeros(2))), "name of a pose"),
        (lambda: small(ProgramPose("P", np.zeros(2), "a\tb")), "comment of pose 'P'"),
        (lambda: small(ProgramPose("P", np.array([0, 13.0]))), r"pose 'P': J2 is beyond \+-720"),
        (lambda: small(measure_output=3), "switches no output"),
        (lambda: small(keep="register"), "has no registers"),
        (lambda: small(form="cartesian"), "has no cartesian form"),
        (lambda: replace(small(), name="7up"), "'7up' is not a name for a list"),
        (lambda: replace(small(), name="a b"), "for instance a_b"),
        (lambda: replace(small(), name="x" * 65), "is not a name for a list"),
    ],
)
def test_what_cannot_be_said_is_refused(
    dialect: str, program: Callable[[], PoseProgram], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        write(program(), dialect, tmp_path)
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


def test_times_that_the_message_cannot_say_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"longer than {MOST_SECONDS} s"):
        write(small(settle_s=2e9), "ros-trajectory", tmp_path)


@pytest.mark.parametrize("dialect", CAPTURES)
def test_a_list_of_nothing_but_poses_passed_through_is_refused(
    dialect: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="has no poses to capture"):
        write(small(POSES[1]), dialect, tmp_path)


@pytest.mark.parametrize("dialect", LISTS)
def test_parts_of_a_plan_go_on_counting(dialect: str, tmp_path: Path) -> None:
    _, second = small(*[ProgramPose(f"P{k}", np.full(2, k)) for k in range(5)]).split(3)
    (path,) = write(second, dialect, tmp_path)
    back = read(path)
    assert [(p.number, p.name) for p in back.positions] == [(4, "P3"), (5, "P4")]
    assert back.mark.measured == 5
    assert len(back.measured) == 2


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_written_and_read_back(name: str, tmp_path: Path) -> None:
    robot = Robot.preset(name)
    rng = np.random.default_rng(robot.n)
    postures = rng.uniform(robot.lower, robot.upper, (9, robot.n))
    poses = tuple(ProgramPose(f"P{k}", q, via=k % 4 == 2) for k, q in enumerate(postures))
    program = PoseProgram("CAL", poses, OPTIONS, Arm.of(robot))
    for dialect in LISTS:
        (path,) = write(program, dialect, tmp_path)
        assert validate(path) == []
        back = read(path)
        kept = [k for k, pose in enumerate(poses) if not (pose.via and dialect in CAPTURES)]
        assert [(p.number, p.name) for p in back.positions] == [
            (program.numbers[k], poses[k].name) for k in kept
        ]
        assert back.positions[0].joint_names == tuple(robot.joint_names)
        arm = find_dialect(dialect).seen(Arm.of(robot))
        np.testing.assert_allclose(back.postures(arm), postures[kept], atol=1e-12, rtol=0)


def check_round_trip(dialect: str, postures: np.ndarray, via: list[bool], folder: Path) -> None:
    poses = [ProgramPose(f"P {k}", q) for k, q in enumerate(postures)]
    poses = [replace(p, via=v) for p, v in zip(poses, via, strict=False)]
    if all(pose.via for pose in poses):
        poses[0] = replace(poses[0], via=False)
    robot = Robot.preset("panda")
    program = PoseProgram("CAL", tuple(poses), OPTIONS, Arm.of(robot))
    (path,) = write(program, dialect, folder)
    assert validate(path) == []
    back = read(path)
    kept = [k for k, p in enumerate(poses) if not (p.via and dialect in CAPTURES)]
    assert [p.number for p in back.positions] == [program.numbers[k] for k in kept]
    found = back.postures(find_dialect(dialect).seen(Arm.of(robot)))
    np.testing.assert_allclose(found, program.postures_rad[kept], atol=6e-13, rtol=0)


postures_7 = arrays(float, st.tuples(st.integers(1, 8), st.just(7)), elements=st.floats(-12, 12))
stops = st.lists(st.booleans(), min_size=8, max_size=8)


@pytest.mark.parametrize("dialect", LISTS)
def test_random_plans_come_back(dialect: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("lists")
    given(postures_7, stops)(
        settings(max_examples=25)(lambda q, via: check_round_trip(dialect, q, via, folder))
    )()


@pytest.mark.slow
@pytest.mark.parametrize("dialect", rest_in_full(LISTS, ("ros-trajectory",)))
def test_many_random_plans_come_back(
    dialect: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("lists")
    given(postures_7, stops)(
        settings(max_examples=1000)(lambda q, via: check_round_trip(dialect, q, via, folder))
    )()


# rosbags builds the messages from the definitions of ROS 2 Humble and knows nothing of our code.


def test_ros_takes_the_trajectory() -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags has ROS's message types")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    raw = yaml.safe_load(TRAJECTORY)
    numbers = np.float64
    points = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{k: np.array(v, dtype=numbers) for k, v in point.items() if k != "time_from_start"},
            time_from_start=kinds["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in raw["points"]
    ]
    stamp = kinds["builtin_interfaces/msg/Time"](**raw["header"].pop("stamp"))
    header = kinds["std_msgs/msg/Header"](stamp=stamp, **raw.pop("header"))
    name = "trajectory_msgs/msg/JointTrajectory"
    message = kinds[name](header=header, **{**raw, "points": points})
    back = store.deserialize_cdr(store.serialize_cdr(message, name), name)
    assert back.joint_names == ["joint_1", "joint_2"]
    assert back.header.frame_id == ""
    np.testing.assert_array_equal([p.positions[1] for p in back.points], [-1, -1, 0, 0.1, 0.1])
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in back.points]
    np.testing.assert_allclose(np.diff(times), [0.5, 3.0, 0.49, 0.5])
    assert all((p.velocities == 0).all() and p.velocities.size == 2 for p in back.points)


def test_ros_takes_the_capture_poses() -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags has ROS's message types")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    name = "sensor_msgs/msg/JointState"
    for raw, position in zip(yaml.safe_load(CAPTURE), ([0.5, -1.0], [0.5, 0.1]), strict=True):
        message = kinds[name](
            header=kinds["std_msgs/msg/Header"](
                stamp=kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
            ),
            name=raw["joints"],
            position=np.array(raw["positions"], dtype=np.float64),
            velocity=np.array([], dtype=np.float64),
            effort=np.array([], dtype=np.float64),
        )
        back = store.deserialize_cdr(store.serialize_cdr(message, name), name)
        assert back.name == ["joint_1", "joint_2"]
        np.testing.assert_array_equal(back.position, position)
        assert raw["features"] == []


@pytest.mark.parametrize("dialect", LISTS)
def test_a_reader_of_yaml_1_2_finds_the_same_content(dialect: str) -> None:
    # yaml-cpp, which ROS's tools use, reads YAML 1.2; PyYAML reads 1.1
    ruamel = pytest.importorskip("ruamel.yaml", reason="ruamel.yaml comes with rosbags")
    names = ("1", "yes", 'a "b": c', "é", "010", "1:30")
    robot = replace(Robot.preset("r2000ic165f"), joint_names=names)
    postures = np.random.default_rng(5).uniform(robot.lower, robot.upper, (4, 6))
    poses = tuple(ProgramPose(f"{k}: # {{x}}", q) for k, q in enumerate(postures))
    program = PoseProgram("CAL", poses, OPTIONS, Arm.of(robot))
    text = find_dialect(dialect).files(program)["CAL.yaml"]
    content = ruamel.YAML(typ="safe", pure=True).load(text)
    assert content == yaml.safe_load(text)
    if dialect == "ros-trajectory":
        rows = [point["positions"] for point in content["points"][::2]]
    elif dialect == "moveit-joints":
        rows = content["joint_values"]
    else:
        rows = [entry["positions"] for entry in content]
    np.testing.assert_allclose(rows, postures, atol=1e-12, rtol=0)
    found = content[0]["joints"] if dialect == "robot-calibration" else content["joint_names"]
    assert tuple(found) == names
