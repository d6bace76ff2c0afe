"""Lists for ROS and RoboDK: their own libraries take what is written, and times are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib import Robot
from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramPose, read, validate, write
from posedesign.programs.ros import UNKNOWN_SPEED, joint_speeds, point_times_ms
from tests.unit.programs.dialects import options_of, program_of, texts_of
from tests.unit.programs.test_written_and_read import POSES, WRITTEN

LISTS = ("ros-trajectory", "moveit-joints", "robot-calibration")
LRMATE = Arm.of(Robot.preset("lrmate200id"))


def program_for(arm: Arm, *poses: ProgramPose) -> PoseProgram:
    return PoseProgram("CAL", poses, options_of("ros-trajectory"), arm)


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
    pose = program_of("ros-trajectory").poses[0]
    twice = program_of("ros-trajectory", [pose, replace(pose, name="again")], settle_s=0)
    (path,) = write(twice, "ros-trajectory", tmp_path)
    assert validate(path) == []
    assert [(p.number, p.name) for p in read(path).positions] == [(1, "T1"), (2, "again")]


def test_joint_names_that_yaml_would_misread_stand_in_quotes(tmp_path: Path) -> None:
    names = ("1", "yes", 'a "b": c', "é", "~", "arm/joint-6")
    arm = Arm.of(replace(Robot.preset("r2000ic165f"), joint_names=names))
    for dialect in LISTS:
        (path,) = write(program_for(arm, ProgramPose("P", np.zeros(6))), dialect, tmp_path)
        assert read(path).positions[0].joint_names == names
        assert validate(path) == []
        assert "- arm/joint-6" in path.read_text()


# rosbags builds the messages from the definitions of ROS 2 Humble and knows nothing of our code.


def test_ros_takes_the_trajectory() -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags has ROS's message types")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    raw = yaml.safe_load((WRITTEN / "ros-trajectory-joint/CALPOSE.yaml").read_text())
    points = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{k: np.array(v, dtype=float) for k, v in point.items() if k != "time_from_start"},
            time_from_start=kinds["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in raw["points"]
    ]
    stamp = kinds["builtin_interfaces/msg/Time"](**raw["header"].pop("stamp"))
    header = kinds["std_msgs/msg/Header"](stamp=stamp, **raw.pop("header"))
    name = "trajectory_msgs/msg/JointTrajectory"
    message = kinds[name](header=header, **{**raw, "points": points})
    back = store.deserialize_cdr(store.serialize_cdr(message, name), name)
    assert back.joint_names == [f"panda_joint{k}" for k in range(1, 8)]
    assert back.header.frame_id == ""
    stands = [POSES[k].posture_rad[1] for k in (0, 0, 1, 2, 2)]
    np.testing.assert_allclose([p.positions[1] for p in back.points], stands, atol=1e-12)
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in back.points]
    np.testing.assert_allclose(np.diff(times)[[0, 3]], 0.3)
    assert (np.diff(times) > 0).all()
    assert all((p.velocities == 0).all() and p.velocities.size == 7 for p in back.points)


def test_ros_takes_the_capture_poses() -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags has ROS's message types")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    name = "sensor_msgs/msg/JointState"
    entries = yaml.safe_load((WRITTEN / "robot-calibration-joint/CALPOSE.yaml").read_text())
    for raw, pose in zip(entries, (POSES[0], POSES[2]), strict=True):
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
        assert back.name == [f"panda_joint{k}" for k in range(1, 8)]
        np.testing.assert_allclose(back.position, np.resize(pose.posture_rad, 7), atol=1e-12)
        assert raw["features"] == []


@pytest.mark.parametrize("dialect", LISTS)
def test_a_reader_of_yaml_1_2_finds_the_same_content(dialect: str) -> None:
    # yaml-cpp, which ROS's tools use, reads YAML 1.2; PyYAML reads 1.1
    ruamel = pytest.importorskip("ruamel.yaml", reason="ruamel.yaml comes with rosbags")
    names = ("1", "yes", 'a "b": c', "é", "010", "1:30")
    robot = replace(Robot.preset("r2000ic165f"), joint_names=names)
    postures = np.random.default_rng(5).uniform(robot.lower, robot.upper, (4, 6))
    poses = tuple(ProgramPose(f"{k}: # {{x}}", q) for k, q in enumerate(postures))
    program = program_for(Arm.of(robot), *poses)
    text = texts_of(program, dialect)
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


def test_robodk_loads_the_rows_as_the_pendant_shows_them(tmp_path: Path) -> None:
    files = pytest.importorskip("robodk.robofileio", reason="robodk is RoboDK's own library")
    program = program_for(LRMATE, *POSES)
    paths = write(program, "robodk-csv", tmp_path)
    assert DIALECTS["robodk-csv"].seen(LRMATE).maker == read(paths[0]).maker == "fanuc"
    rows = files.LoadList(str(paths[0]))
    assert rows[0] == [0.0, 15.0, -40.0, -0.000001, -50.0, 30.0]  # J3 against the horizontal
    np.testing.assert_allclose(rows, LRMATE.shown(program.postures_rad), atol=5.01e-7)
    matrix = files.LoadMat(str(paths[0]))
    assert matrix.size() == (3, 6)
    # what RoboDK saves comes back
    matrix.tr().SaveMat(str(tmp_path / "SAVED.csv"))
    saved = read(tmp_path / "SAVED.csv")
    assert [p.number for p in saved.positions] == [1, 2, 3]
    np.testing.assert_array_equal([p.shown_deg for p in saved.positions], rows)
    assert "controller: fanuc\n" in texts_of(program, "robodk-csv")
