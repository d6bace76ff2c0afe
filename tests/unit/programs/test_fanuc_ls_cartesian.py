"""FANUC .LS with poses of the tool: they come back to the joints that they were made from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import InputError, UnreachableError
from calib.robots import Robot
from calib.se3 import inverse, rotation_angle, rotation_from_wpr, transform
from posedesign.programs import (
    DIALECTS,
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    postures_of,
    read,
    validate,
    write,
)

R2000 = Robot.preset("r2000ic165f")
T_TIP_TOOL = transform(rotation_from_wpr(np.deg2rad([10, -20, 30])), [0.2, -0.05, 0.35])
T_WORLD_USER = transform(rotation_from_wpr(np.deg2rad([1, 2, 90])), [1.2, 0.3, -0.2])


def program_of(postures: np.ndarray, arm: Arm, name: str = "CART") -> PoseProgram:
    poses = tuple(ProgramPose(f"P{i}", q) for i, q in enumerate(postures))
    return PoseProgram(name, poses, ProgramOptions(form="cartesian"), arm)


def random_postures(robot: Robot, count: int, seed: int) -> np.ndarray:
    """Inside the limits, and far enough from singularities and the ends of turns to be told."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(robot.lower, robot.upper, (4 * count, robot.n))
    q = q[
        [not robot.coupled_limits or all(c.margin(p) > 0 for c in robot.coupled_limits) for p in q]
    ]
    clear = np.abs(np.sin(q[:, 4])) > 0.1
    ends = np.abs((np.rad2deg(q) + 180.0) % 360.0)
    clear &= (np.minimum(ends, 360 - ends)[:, [0, 3, 5]] > 0.01).all(axis=1)
    solutions = robot.inverse(robot.fk(q))
    near_singular = np.zeros(len(q), dtype=bool)
    np.logical_or.at(near_singular, solutions.pose, solutions.singular)
    return q[clear & ~near_singular][:count]


def test_the_check_value_of_the_controller() -> None:
    """Pendant (0, 0, 0, 0, -90, 0) is X 1592, Y 0, Z 1085 mm, W 180, P 0, R 0."""
    q = Arm.of(R2000).postures([0.0, 0, 0, 0, -90, 0])
    (text,) = DIALECTS["fanuc-ls"].files(program_of(q[None], Arm.of(R2000))).values()
    assert "CONFIG : 'N U T, 0, 0, 0'" in text
    assert "X =  1592.000  mm,\tY =     0.000  mm,\tZ =  1085.000  mm" in text
    assert "W =   180.000 deg,\tP =     0.000 deg,\tR =     0.000 deg" in text


@pytest.mark.parametrize("name", ["r2000ic165f", "lrmate200id", "m20ia"])
def test_poses_come_back_to_their_joints_in_every_branch_and_turn(
    name: str, tmp_path: Path
) -> None:
    """A pose is rounded to 0.0005 mm and deg: so far are joints off, times their leverage."""
    robot = Robot.preset(name)
    arm = Arm.of(robot, T_WORLD_USER, T_TIP_TOOL)
    q = random_postures(robot, 200, seed=3)
    (path,) = write(program_of(q, arm), "fanuc-ls", tmp_path)
    assert validate(path) == []
    # The J3 of the M-20iA has more than a turn, which CONFIG does not tell: the plan does, roughly.
    near = q + np.random.default_rng(1).uniform(-0.3, 0.3, q.shape) if name == "m20ia" else None
    back = postures_of(read(path).positions, arm, near)
    assert np.abs(np.rad2deg(back - q)).max() < 0.1
    moved = np.linalg.norm((arm.tool_poses(back) - arm.tool_poses(q))[:, :3, 3], axis=1)
    reach = robot.chain.reach_m + 1.5
    assert moved.max() < 1e-3 * (5e-4 * 2) + np.deg2rad(5e-4) * 2 * reach
    assert len(set(arm.configurations(q))) > 8


@pytest.mark.slow
def test_a_thousand_postures_come_back(tmp_path: Path) -> None:
    arm = Arm.of(R2000, T_WORLD_USER, T_TIP_TOOL)
    q = random_postures(R2000, 1000, seed=4)
    assert len(q) == 1000
    (path,) = write(program_of(q, arm), "fanuc-ls", tmp_path)
    assert validate(path) == []
    assert np.abs(np.rad2deg(read(path).postures(arm) - q)).max() < 0.1


def test_without_a_robot_nothing_is_said_of_poses(tmp_path: Path) -> None:
    q = np.deg2rad([[0.0, 10, -20, 0, -60, 0]])
    with pytest.raises(InputError, match="poses of the tool need the robot"):
        write(program_of(q, Arm.usual("fanuc")), "fanuc-ls", tmp_path)
    (path,) = write(program_of(q, Arm.of(R2000)), "fanuc-ls", tmp_path)
    with pytest.raises(InputError, match="poses of the tool need the robot"):
        read(path).postures()


def test_a_pose_in_an_arm_position_that_cannot_take_it_is_named(tmp_path: Path) -> None:
    arm = Arm.of(R2000)
    q = np.deg2rad([[0.0, 10, -20, 0, -60, 0], [5.0, 10, -20, 0, -60, 0]])
    (path,) = write(program_of(q, arm), "fanuc-ls", tmp_path)
    text = path.read_text()
    path.write_text(text[::-1].replace("'N U T"[::-1], "'N U B"[::-1], 1)[::-1])
    with pytest.raises(UnreachableError, match=r"position 2 \(P1\): .* N U B, 0, 0, 0"):
        read(path).postures(arm)
    far = text.replace("X =  ", "X =  9", 1)
    path.write_text(far)
    with pytest.raises(UnreachableError, match=r"position 1 \(P0\): no posture"):
        read(path).postures(arm)


def test_without_a_configuration_the_plan_settles_which_posture_is_meant(tmp_path: Path) -> None:
    arm = Arm.of(R2000)
    q = random_postures(R2000, 20, seed=8)
    (path,) = write(program_of(q, arm), "fanuc-ls", tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line.split("\t\tCONFIG")[0] for line in lines))
    positions = read(path).positions
    assert all(p.configuration is None for p in positions)
    with pytest.raises(InputError, match=r"position 1 \(P0\): \d+ postures take it"):
        read(path).postures(arm)
    near = q + np.deg2rad(0.5)
    np.testing.assert_allclose(postures_of(positions, arm, near), q, atol=2e-3)


LIMITS = st.lists(st.floats(0.02, 0.98), min_size=6, max_size=6)


@pytest.mark.slow
@settings(max_examples=1000)
@given(plans=st.lists(LIMITS, min_size=1, max_size=4), form=st.sampled_from(["joint", "cartesian"]))
def test_a_thousand_random_plans_come_back(plans: list[list[float]], form: str) -> None:
    """Joints to the third decimal; poses to it as well, where an arm position can take them."""
    arm = Arm.of(R2000, T_WORLD_USER, T_TIP_TOOL)
    q = R2000.lower + np.array(plans) * R2000.joint_range
    poses = tuple(ProgramPose(f"P{i}", posture) for i, posture in enumerate(q))
    options = ProgramOptions(form=form, fingerprint="abcdef12", user_frame=2)  # type: ignore[arg-type]
    dialect = DIALECTS["fanuc-ls"]
    ((name, text),) = dialect.files(PoseProgram("RANDOM", poses, options, arm)).items()
    data = text.replace("\n", "\r\n").encode()
    assert dialect.check(data, Path(name)) == []
    positions = dialect.parse(data, Path(name)).positions
    if form == "joint":
        shown = np.stack([p.shown_deg for p in positions if p.shown_deg is not None])
        np.testing.assert_allclose(shown, np.round(arm.shown(q), 3), atol=1e-9)
        return
    poses_back = np.stack([p.T_user_tool for p in positions if p.T_user_tool is not None])
    off = inverse(arm.tool_poses(q)) @ poses_back
    assert np.abs(off[:, :3, 3]).max() <= 0.9e-6
    assert np.rad2deg(rotation_angle(off[:, :3, :3])).max() <= 1.6e-3
    inside = np.array([all(c.margin(p) > 0.01 for c in R2000.coupled_limits) for p in q])
    solutions = R2000.inverse(R2000.fk(q))
    singular = np.zeros(len(q), dtype=bool)
    np.logical_or.at(singular, solutions.pose, solutions.singular)
    kept = np.flatnonzero(inside & ~singular)
    if len(kept):
        back = postures_of(tuple(positions[i] for i in kept), arm, q[kept])
        assert np.abs(np.rad2deg(back - q[kept])).max() < 0.1
