"""Robots that say something else than where they are: stopped before the next move is commanded."""

from collections.abc import Callable

import numpy as np
import pytest

from calib.errors import InputError
from calib.se3 import FloatArray, rotation_exp
from calib.vision.touch_up import Drive, RobotAdapter
from calib.vision.touch_up.arms import OneArm
from tests.visual_cells import preset, usual_posture

ONE = np.zeros(1, dtype=np.intp)
TURN = 2.0 * np.pi
Lie = Callable[[FloatArray, FloatArray], FloatArray]
"""What is shown by an arm that stands at ``(n,)`` and stood at ``(n,)`` before [rad]."""


class Lying(RobotAdapter):
    """An arm that moves as it is told, and from some move on shows something else."""

    def __init__(self, q: FloatArray, lie: Lie, moves: int = 0) -> None:
        self.q, self.before, self.lie, self.moves = q.copy(), q.copy(), lie, moves
        self.commanded: list[FloatArray] = []

    def move(self, q: FloatArray) -> None:
        self.commanded.append(q.copy())
        self.before, self.q = self.q, q.copy()
        q += 1.0  # an adapter may do with its array what it likes

    def joints(self) -> FloatArray:
        lies = len(self.commanded) >= self.moves
        return self.lie(self.q.copy(), self.before) if lies else self.q.copy()

    def grab(self) -> np.ndarray:
        return np.zeros((8, 8), dtype=np.uint8)


def added(joint: int, what: float) -> Lie:
    return lambda q, before: q + what * np.eye(len(q))[joint]


def flipped(joint: int) -> Lie:
    return lambda q, before: q * np.where(np.arange(len(q)) == joint, -1.0, 1.0)


def stuck(joint: int) -> Lie:
    return lambda q, before: np.where(np.arange(len(q)) == joint, before, q)


LIES = {
    "turn on": (added(1, TURN), "shoulder_lift_joint is shown at", "one turn of 360 deg on"),
    "two turns back": (added(5, -2 * TURN), "wrist_3_joint is shown", "2 turns of 360 deg back"),
    "sign": (flipped(1), "shoulder_lift_joint", "its sign is the opposite"),
    "degrees": (lambda q, before: np.rad2deg(q), "", "in degrees, radians are asked for"),
    "stale": (lambda q, before: before, "", "the arm did not move, or the joint values are from"),
    "stuck": (stuck(2), "elbow_joint", "it did not move, the others did"),
    "lag": (lambda q, before: before + 0.8 * (q - before), "", "it has not arrived"),
    "off": (added(3, np.deg2rad(0.2)), "wrist_1_joint", "0.20 deg off"),
}


def postures(count: int) -> FloatArray:
    start = usual_posture("ur10e")
    return start + np.deg2rad(5.0) * np.arange(1, count + 1)[:, None] * [1, -1, 1, 1, -1, 1]


@pytest.mark.parametrize("name", LIES)
def test_a_lie_ends_it_before_the_next_move(name):
    lie, joint, said = LIES[name]
    robot = Lying(usual_posture("ur10e"), lie, moves=3)
    drive = Drive(preset("ur10e"), OneArm(robot), np.deg2rad(0.2))
    first, second = postures(2)
    assert drive.to_posture(ONE, first[None]) == [""]
    with pytest.raises(InputError, match=said) as caught:
        drive.to_posture(ONE, second[None])
    assert len(robot.commanded) == 3
    assert joint in caught.value.message
    assert "after the move to" in caught.value.message
    assert "nothing more was commanded" in caught.value.hint


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("turn on", "one turn of 360 deg on"),
        ("two turns back", "2 turns of 360 deg back"),
        ("sign", "its sign is the opposite"),
        ("degrees", "in degrees"),
    ],
)
def test_a_lie_at_first_ends_it_before_any_move(name, said):
    robot = Lying(usual_posture("ur10e"), LIES[name][0])
    drive = Drive(preset("ur10e"), OneArm(robot), np.deg2rad(0.2))
    with pytest.raises(InputError, match=said) as caught:
        drive.to_posture(ONE, usual_posture("ur10e")[None])
    assert not robot.commanded
    assert "before the first move" in caught.value.message


@pytest.mark.parametrize(
    ("shown_deg", "said"),
    [
        ([200.0, -75.0, 100.0, -115.0, -90.0, 0.0], "turn it by 200 deg, 180 deg allowed"),
        ([0.0, -75.0, 185.0, -115.0, -90.0, 0.0], "inside them one turn of 360 deg back"),
        ([0.0, -75.0, 100.0, -115.0, 500.0, 0.0], "inside them one turn of 360 deg back"),
        ([0.0, -75.0, 1e300, -115.0, -90.0, 0.0], "outside its limits"),
    ],
)
def test_where_no_move_begins_from(shown_deg, said):
    shown = np.deg2rad(shown_deg)
    robot = Lying(shown, lambda q, before: q)
    drive = Drive(preset("ur10e"), OneArm(robot), np.deg2rad(0.2))
    with pytest.raises(InputError, match=said):
        drive.to_posture(ONE, usual_posture("ur10e")[None])
    assert not robot.commanded


def test_more_than_half_a_turn_from_where_it_was_left():
    """A planned motion may turn a joint by more: the arm goes on with it where it was stopped."""
    left, asked = usual_posture("ur10e").copy(), usual_posture("ur10e").copy()
    left[5], asked[5] = np.deg2rad([-120.0, 110.0])
    goes_on = {-120.0: True, 40.0: True, 230.0: True, 240.0: False, -330.0: False}
    for shown_deg, turned in goes_on.items():
        shown = left.copy()
        shown[5] = np.deg2rad(shown_deg)
        robot = Lying(shown, lambda q, before: q)
        drive = Drive(preset("ur10e"), OneArm(robot))
        drive.was_left_at(ONE, left[None])
        if turned:
            assert drive.to_posture(ONE, asked[None]) == [""]
            continue
        with pytest.raises(InputError, match=r"180 deg allowed|turn of 360 deg on"):
            drive.to_posture(ONE, asked[None])


def test_a_sign_is_told_by_where_the_arm_was_left():
    left = usual_posture("ur10e") + 0.1
    robot = Lying(left, flipped(1))
    drive = Drive(preset("ur10e"), OneArm(robot))
    drive.was_left_at(ONE, left[None])
    with pytest.raises(InputError, match="its sign is the opposite"):
        drive.to_posture(ONE, usual_posture("ur10e")[None])
    assert not robot.commanded


def test_an_arm_that_is_jogged_between_two_moves():
    robot = Lying(usual_posture("ur10e"), lambda q, before: q)
    drive = Drive(preset("ur10e"), OneArm(robot))
    first, second = postures(2)
    drive.to_posture(ONE, first[None])
    robot.q[0] += 0.1
    with pytest.raises(InputError, match="where it was left at"):
        drive.to_posture(ONE, second[None])
    assert len(robot.commanded) == 2


def test_a_pendants_joint_3_is_named():
    arm = preset("r2000ic165f")
    q = usual_posture("r2000ic165f")
    robot = Lying(q, lambda q, before: np.deg2rad(arm.controller.pendant(q)))
    with pytest.raises(InputError, match="are those of the pendant"):
        Drive(arm, OneArm(robot)).to_posture(ONE, q[None])
    assert not robot.commanded


def test_rounding_and_width_of_fine_positions_are_allowed():
    robot = Lying(usual_posture("ur10e"), lambda q, before: q + np.deg2rad(0.05))
    drive = Drive(preset("ur10e"), OneArm(robot))
    for q in postures(5):
        assert drive.to_posture(ONE, q[None]) == [""]
    strict = Drive(preset("ur10e"), OneArm(robot), shown_within_rad=np.deg2rad(0.01))
    with pytest.raises(InputError, match=r"0\.05 deg off"):
        strict.to_posture(ONE, postures(1))


@pytest.mark.parametrize(
    "shown", [np.zeros(5), np.zeros(7), np.zeros((2, 6)), [], [np.nan] * 6, None, "home"]
)
def test_joint_values_that_are_none(shown):
    robot = Lying(usual_posture("ur10e"), lambda q, before: shown, moves=1)
    with pytest.raises(InputError, match=r"joints\(\) of the robot's adapter gave"):
        Drive(preset("ur10e"), OneArm(robot)).to_posture(ONE, postures(1))
    assert len(robot.commanded) == 1


def test_limits_are_kept_without_anybody_asking():
    robot = Lying(usual_posture("ur10e"), lambda q, before: q)
    drive = Drive(preset("ur10e"), OneArm(robot))
    q = usual_posture("ur10e")[None].copy()
    q[0, 2] = np.deg2rad(181.0)
    assert drive.to_posture(ONE, q) == ["elbow_joint 181.0 deg is above 180.0 deg"]
    q[0, 2] = np.nan
    assert drive.to_posture(ONE, q)[0]
    assert not robot.commanded


def test_a_motion_is_asked_for_from_where_the_arm_stands():
    asked: list[tuple[FloatArray, FloatArray]] = []

    def refuses(start: FloatArray, end: FloatArray) -> list[str]:
        asked.append((start[0], end[0]))
        return [""]

    away = usual_posture("ur10e") + 0.2
    robot = Lying(away, lambda q, before: q)
    drive = Drive(preset("ur10e"), OneArm(robot), 0.003, refuses)
    q = usual_posture("ur10e")
    drive.to_posture(ONE, q[None])
    assert np.allclose([start for start, _ in asked], [q - 0.003, away])
    assert np.allclose([end for _, end in asked], [q, q - 0.003])


def test_another_way_is_taken_where_the_straight_one_is_refused():
    robot = Lying(usual_posture("ur10e"), lambda q, before: q)
    q, between = postures(2)

    def refuses(start: FloatArray, end: FloatArray) -> list[str]:
        return ["the fence" * bool((abs(start - end) > 0.05).any())]

    def drive(around: object) -> Drive:
        return Drive(preset("ur10e"), OneArm(robot), 0.003, refuses, around)

    assert drive(lambda start, end: None).to_posture(ONE, q[None]) == ["the fence"]
    assert drive(None).to_posture(ONE, q[None]) == ["the fence"]
    assert not robot.commanded
    assert drive(lambda start, end: [between]).to_posture(ONE, q[None]) == [""]
    assert np.allclose(robot.commanded, [between, q - 0.003, q])


def test_where_the_arm_stands_at_first_may_not_be_known():
    said: list[str] = []
    starts: list[FloatArray] = []

    def refuses(start: FloatArray, end: FloatArray) -> list[str]:
        starts.append(start)
        return [""]

    robot = Lying(usual_posture("ur10e"), lambda q, before: q)
    robot.shows_before_moving = False
    drive = Drive(preset("ur10e"), OneArm(robot), 0.0, refuses, tell=said.append)
    for q in postures(2):
        drive.to_posture(ONE, q[None])
    assert len(said) == 1
    assert "is not checked" in said[0]
    assert np.isnan(starts[1]).all()
    assert np.array_equal(starts[3], postures(2)[:1])


def test_a_correction_that_turns_a_joint_far_is_not_made(bench):
    """Next to a singularity a shift of millimetres turns the wrist by half a turn."""
    q = bench.q.copy()
    q[4] = np.deg2rad(0.3)
    robot = Lying(q, lambda q, before: q)
    drive = Drive(bench.robot, OneArm(robot), 0.0)
    T = bench.robot.fk(q)[None]
    T[0, :3, :3] = T[0, :3, :3] @ rotation_exp(np.deg2rad([1.0, 0.0, 0.0]))
    (reason,) = drive.to_pose(ONE, q[None], T)
    assert "off the planned posture, 45 deg allowed" in reason
    assert not robot.commanded
