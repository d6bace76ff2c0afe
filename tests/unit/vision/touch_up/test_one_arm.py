"""A robot behind its adapter: pictures are taken, measured, and old ones told."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.se3 import inverse
from calib.vision.camera import CircleTarget, Imaging, render
from calib.vision.touch_up import Drive, Loop, RobotAdapter, Station, touch_up
from calib.vision.touch_up.arms import OneArm
from calib.vision.touch_up.jacobian import measure_jacobian

ONE = np.zeros(1, dtype=np.intp)


class FakeRobot(RobotAdapter):
    """Renders what its camera sees, and counts what it is asked."""

    def __init__(self, bench) -> None:
        self.bench, self.q = bench, bench.q.copy()
        self.moves: list[np.ndarray] = []
        self.grabbed = 0
        self.frozen: np.ndarray | None = None
        self._rng = np.random.default_rng(0)

    def move(self, q):
        self.moves.append(q)
        self.q = q.copy()

    def joints(self):
        return self.q.copy()

    def grab(self):
        self.grabbed += 1
        if self.frozen is not None:
            return self.frozen
        T_camera = self.bench.robot.fk(self.q) @ self.bench.true.T_tip_camera
        T = inverse(T_camera) @ self.bench.true.T_base_target
        return render(self.bench.camera, [(self.bench.target, T)], Imaging(), self._rng)


@pytest.fixture
def robot(bench) -> FakeRobot:
    return FakeRobot(bench)


def test_target_is_measured_in_the_picture(bench, robot):
    arm = OneArm(robot)
    assert arm.image_px == (640, 480)
    assert arm.count == 1
    seen = arm.look(ONE)
    assert seen.reasons == ("",)
    assert np.abs(bench.relation.error(seen.ellipses)).max() < 0.2


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        (None, "gave nothing"),
        (np.zeros((4, 5, 3), dtype=np.uint8), r"gave an array \(4, 5, 3\) of uint8"),
        (np.zeros((4, 5)), r"gave an array \(4, 5\) of float64"),
        ("photo.png", "gave a str"),
    ],
)
def test_pictures_that_are_none(robot, monkeypatch, picture, said):
    monkeypatch.setattr(robot, "grab", lambda: picture)
    with pytest.raises(InputError, match=said):
        OneArm(robot).look(ONE)


def test_picture_is_the_last_one_until_the_arm_moves(robot):
    arm = OneArm(robot)
    arm.look(ONE)
    first = arm.picture(0)
    assert arm.picture(0) is first
    assert robot.grabbed == 1
    arm.move(ONE, robot.q[None] + 0.001)
    assert arm.picture(0) is not first
    assert robot.grabbed == 2


def test_whole_loop_through_pictures(bench, robot):
    drive = Drive(bench.robot, OneArm(robot), 0.003)
    jacobian = measure_jacobian(drive, bench.q, bench.relation, 0.01, both_ways=True).jacobian
    start = bench.q + np.deg2rad([0.5, -0.4, 0.3, 0.0, 0.2, 0.0])
    done = touch_up(drive, start[None], jacobian, Loop())
    assert done.touched.all()
    place = inverse(bench.robot.fk(done.q[0]) @ bench.true.T_tip_camera)
    place = (place @ bench.true.T_base_target)[:3, 3]
    assert np.abs(place - [0.0, 0.0, 0.35]).max() < 1e-3


def test_every_stop_is_come_to_from_below(bench, robot):
    drive = Drive(bench.robot, OneArm(robot), 0.003)
    drive.to_posture(ONE, bench.q[None])
    assert len(robot.moves) == 2
    assert robot.moves[1] - robot.moves[0] == pytest.approx(0.003)


def test_light_target_on_a_dark_plate_needs_to_be_said(bench, robot):
    light = CircleTarget(circle=0.85, face=0.08)
    assert OneArm(robot, light).look(ONE).reasons[0]


def test_picture_from_before_a_move_is_told(bench, robot):
    """Bit by bit the same at another posture: no picture with noise is."""
    arm = OneArm(robot)
    assert arm.look(ONE).seen[0]
    robot.frozen = arm.picture(0)
    assert arm.look(ONE).seen[0], "the arm stands where it stood: it may well be the same"
    arm.move(ONE, bench.q[None] + 0.01)
    for _ in range(2):
        assert "repeats a picture from before the arm moved" in arm.look(ONE).reasons[0]
    robot.frozen = None
    assert arm.look(ONE).seen[0]


def test_station_looks_where_it_is_asked(bench, robot):
    station = Station(Drive(bench.robot, OneArm(robot), 0.0))
    q = bench.q + np.deg2rad([0.3, 0, 0, 0, 0, 0])
    assert station.look("here", q).seen[0]
    assert np.array_equal(robot.q, q)
    closed = Station(
        Drive(bench.robot, OneArm(robot), 0.0, lambda start, end: ["no way"] * len(end))
    )
    assert closed.look("there", bench.q).reasons == ("no way",)
    assert np.array_equal(robot.q, q)
