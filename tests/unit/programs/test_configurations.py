"""Among all ways to take a pose, the words of a maker mean the one they were made of."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.errors import InputError
from calib.robots import ChainState, Robot
from calib.se3 import BoolArray, FloatArray
from posedesign.programs.configurations import (
    CONFIGURATIONS,
    ROUNDING_DEG,
    FanucConfiguration,
    arm_positions,
    configuration_of,
    words,
    wrist_centre,
)

PRESETS = {
    "fanuc": ("r2000ic165f", "lrmate200id", "m20ia"),
    "kuka": ("kr6r900sixx",),
    "abb": ("irb120", "irb6700_200_260"),
    "yaskawa": ("mh5", "gp7", "hp3"),
    "staubli": ("tx2_60", "tx2_90"),
}
TURNS_TOLD = {
    "fanuc": (0, 3, 5),
    "kuka": (0, 1, 2, 3, 4, 5),
    "abb": (0, 3, 5),
    "yaskawa": (0, 3, 5),
    "staubli": (),
}
"""Joints whose full turns the words tell apart."""

TURNS_OPEN = {"m20ia": {2}, "tx2_60": {3, 5}, "tx2_90": {3, 5}}
"""Joints that have several turns inside the limits which the words do not tell apart: axis 3 of the
M-20iA goes 458 deg, and CONFIG has no turn for it."""

POSTURES = 1000
"""For each maker."""

BOUNDARY = 1e-4
"""[rad, and part of the arm's reach] from where an arm position becomes another one."""

SAME = 1e-6
"""[rad] between a posture and the answer that is the same one."""

each_preset = pytest.mark.parametrize(
    ("maker", "name"), [(maker, name) for maker, names in PRESETS.items() for name in names]
)


@cache
def preset(name: str) -> Robot:
    return Robot.preset(name)


def random_postures(robot: Robot, count: int) -> FloatArray:
    """Inside all limits, and not where words change: see :func:`at_a_boundary`."""
    rng = np.random.default_rng(2026)
    q = rng.uniform(robot.lower, robot.upper, (4 * count, robot.n))
    for limit in robot.coupled_limits:
        q = q[limit.margin(q) >= 0]
    q = q[~at_a_boundary(robot, q)][:count]
    assert len(q) == count
    return q


def at_a_boundary(robot: Robot, q: FloatArray) -> BoolArray:
    """A wrist that is straight, a wrist centre over axis 1 or an arm stretched, all within 1e-4;
    axis 1, 4 or 6 at a quarter of a turn, within what the rounding of a pose is taken to be."""
    arm = arm_positions(robot, q, robot.controller.maker)
    reach = robot.chain.reach_m
    quarter = np.remainder(arm.pendant_deg[:, [0, 3, 5]] + 45.0, 90.0) - 45.0
    return (
        (np.abs(np.sin(q[:, 4])) < BOUNDARY)
        | (np.abs(arm.front_m) < BOUNDARY * reach)
        | (np.abs(arm.line_m) < BOUNDARY * reach)
        | (np.abs(quarter) < ROUNDING_DEG).any(axis=1)
    )


def test_every_maker_that_writes_poses_has_words() -> None:
    assert set(CONFIGURATIONS) == set(PRESETS)
    assert all(configuration_of(maker).maker == maker for maker in PRESETS)
    assert configuration_of("ur") is None


@each_preset
def test_the_words_of_a_posture_mean_this_posture_alone(maker: str, name: str) -> None:
    """But for full turns of joints that the words say nothing of."""
    robot, kind = preset(name), CONFIGURATIONS[maker]
    q = random_postures(robot, -(-POSTURES // len(PRESETS[maker])))
    wanted = kind.of(robot, q)
    answers = robot.inverse(robot.fk(q), near=q[0], every_turn=True)
    postures, pose = answers.postures[answers.inside], answers.pose[answers.inside]
    found = kind.of(robot, postures)
    meant = np.array([wanted[p].allows(other) for p, other in zip(pose, found, strict=True)])
    apart = postures - q[pose]
    turns = np.rint(apart / (2.0 * np.pi))
    position = np.abs(apart - 2.0 * np.pi * turns).max(axis=1) < SAME
    itself = np.abs(apart).max(axis=1) < SAME
    assert (np.bincount(pose[itself], minlength=len(q)) == 1).all()
    told = list(TURNS_TOLD[maker])
    np.testing.assert_array_equal(meant, position & (turns[:, told] == 0).all(axis=1))
    several = set(np.flatnonzero((turns[meant] != 0).any(axis=0)).tolist())
    assert several == TURNS_OPEN.get(name, set())
    assert (~itself).sum() > 2 * len(q)  # there was something to choose from


@pytest.mark.parametrize("maker", PRESETS)
def test_random_postures_take_every_branch_and_turn(maker: str) -> None:
    """Without this the test above could leave some out."""
    seen = set()
    for name in PRESETS[maker]:
        robot = preset(name)
        arm = arm_positions(robot, random_postures(robot, 500), maker)
        turns = np.rint(arm.pendant_deg[:, 5] / 360.0).astype(int)
        flags = arm.behind_axis_1, arm.behind_line, arm.pendant_deg[:, 4] < 0, turns
        seen |= set(zip(*(f.tolist() for f in flags), strict=True))
    branches = {flags[:3] for flags in seen}
    assert len(branches) == 8
    assert {flags[3] for flags in seen} == {-1, 0, 1}


@each_preset
def test_the_other_wrist_changes_the_wrist_alone(maker: str, name: str) -> None:
    robot = preset(name)
    q = random_postures(robot, 100)
    other = q * [1, 1, 1, 1, -1, 1] + np.pi * np.array([0, 0, 0, 1, 0, 1])
    np.testing.assert_allclose(robot.fk(other), robot.fk(q), atol=1e-9)
    arm, turned = (arm_positions(robot, p, maker) for p in (q, other))
    np.testing.assert_allclose(turned.front_m, arm.front_m, atol=1e-9)
    np.testing.assert_allclose(turned.line_m, arm.line_m, atol=1e-9)
    kind = CONFIGURATIONS[maker]
    for a, b in zip(kind.of(robot, q), kind.of(robot, other), strict=True):
        assert not a.allows(b)
        assert not b.allows(a)


@each_preset
def test_front_and_behind_are_where_the_wrist_is_seen_from_axis_1(maker: str, name: str) -> None:
    """From the pose of the tip alone, which the wrist centre is fixed to; joint 5 of all presets is
    described with its origin there."""
    robot = preset(name)
    q = random_postures(robot, 100)
    straight = robot.fk(np.zeros(6))
    wrist_at_zero = robot.state(np.zeros(6)).origins[4]
    p_tip_wrist = straight[:3, :3].T @ (wrist_at_zero - straight[:3, 3])
    T = robot.fk(q)
    wrist = T[:, :3, :3] @ p_tip_wrist + T[:, :3, 3]
    q1 = -q[:, 0] if maker == "kuka" else q[:, 0]
    expected = wrist[:, 0] * np.cos(q1) + wrist[:, 1] * np.sin(q1)
    np.testing.assert_allclose(arm_positions(robot, q, maker).front_m, expected, atol=1e-9)


@pytest.mark.parametrize("maker", PRESETS)
def test_words_survive_a_pose_that_is_rounded(maker: str) -> None:
    """Axes 1, 4 and 6 at the very joint values where numbers change, moved by a hundredth of a
    degree: the answers that the words mean have the posture among them."""
    robot, kind = preset(PRESETS[maker][0]), CONFIGURATIONS[maker]
    rng = np.random.default_rng(1)
    at = rng.choice([-180.0, -90.0, 0.0, 90.0, 180.0], (200, 3))
    pendant = np.array([0.0, 10.0, 20.0, 0.0, -50.0, 0.0]) * np.ones((200, 1))
    pendant[:, [0, 3, 5]] = at
    q = robot.controller.posture(pendant)
    pendant[:, [0, 3, 5]] += rng.uniform(-0.01, 0.01, at.shape)
    rounded = robot.controller.posture(pendant)
    for exact, other in zip(kind.of(robot, q), kind.of(robot, rounded), strict=True):
        assert kind.parse(exact.words).allows(other)
    differ = [a != b for a, b in zip(kind.of(robot, q), kind.of(robot, rounded), strict=True)]
    assert any(differ) or maker == "staubli"


@pytest.mark.parametrize("maker", PRESETS)
def test_words_are_read_as_they_are_written(maker: str) -> None:
    kind = CONFIGURATIONS[maker]
    robot = preset(PRESETS[maker][0])
    q = random_postures(robot, 200)
    for written, found in zip(words(robot, q), kind.of(robot, q), strict=True):
        assert written == found.words
        assert kind.parse(written) == found
        assert kind.parse(f"  {written} ").words == written
        assert hash(kind.parse(written)) == hash(found)


def test_words_of_makers_are_not_mixed() -> None:
    found = {
        maker: kind.of(preset(PRESETS[maker][0]), np.full((1, 6), 0.1))[0]
        for maker, kind in CONFIGURATIONS.items()
    }
    for maker, one in found.items():
        assert [one.allows(other) for other in found.values()] == [maker == m for m in found]


def test_a_wrist_of_axes_that_do_not_meet_has_no_words() -> None:
    robot = preset("ur5e").controlled_by("ur")
    with pytest.raises(InputError, match=r"no wrist centre: .* miss one point by 99.\d mm"):
        arm_positions(robot, np.zeros((1, 6)), "ur")
    assert words(robot, np.zeros((2, 6))) == ["", ""]


def wrist(slant: float) -> ChainState:
    """An arm whose axes 4, 5 and 6 meet at (1, 2, 3), axis 5 slanted against axis 4 [rad]."""
    axes = np.tile([0.0, 0.0, 1.0], (1, 6, 1))
    axes[0, 4] = [np.sin(slant), 0.0, np.cos(slant)]
    axes[0, 5] = [0.6, 0.8, 0.0]
    origins = np.array([1.0, 2.0, 3.0]) + axes * np.arange(-3.0, 3.0)[:, None]
    return ChainState(np.zeros((1, 6, 3, 3)), origins, axes, np.eye(3)[None], np.zeros((1, 3)))


@pytest.mark.parametrize("slant_deg", [30.0, 60.0, 90.0, 120.0])
def test_the_wrist_centre_is_where_slanted_axes_meet(slant_deg: float) -> None:
    centre = wrist_centre(wrist(np.radians(slant_deg)))
    np.testing.assert_allclose(centre, [[1.0, 2.0, 3.0]], atol=1e-12)


def test_a_wrist_of_parallel_axes_has_no_centre() -> None:
    with pytest.raises(InputError, match="axes 4 and 5 are parallel"):
        wrist_centre(wrist(1e-5))


@pytest.mark.parametrize("kind", CONFIGURATIONS.values())
def test_words_are_for_the_controller_of_their_maker(kind: type) -> None:
    with pytest.raises(InputError, match=f"ur10e has a controller of ur, .* words of {kind.maker}"):
        kind.of(preset("ur10e"), np.zeros((1, 6)))
    with pytest.raises(InputError, match="panda has a controller of franka"):
        kind.of(preset("panda"), np.zeros((1, 7)))


def test_a_robot_without_a_controller_has_no_words() -> None:
    robot = replace(preset("irb120"), controller=None)
    with pytest.raises(InputError, match="has no controller") as caught:
        CONFIGURATIONS["abb"].of(robot, np.zeros((1, 6)))
    assert "controlled_by('abb')" in caught.value.hint
    assert words(robot, np.zeros((1, 6))) == [""]


def test_postures_of_another_arm_are_refused() -> None:
    with pytest.raises(InputError, match="6 joints, the posture has 7"):
        FanucConfiguration.of(preset("m20ia"), np.zeros((1, 7)))
    assert FanucConfiguration.of(preset("m20ia"), np.zeros((0, 6))) == []
