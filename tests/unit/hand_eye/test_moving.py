"""Pictures of an arm that moved: the time between joints and pictures, and records of joints."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from calib.hand_eye import calibrate, motion_at
from calib.model import CalibrationModel, Setup
from calib.model.measurements import BoardShape, BoardView
from calib.model.parameters import TargetFrame, TimeOffsets, ToolFrame, ZeroOffsets
from calib.robots import Robot
from calib.robots.flange_poses import flange_robot, posture_of_pose
from calib.se3 import quaternion_from_rotation, rotation_exp, transform
from posedesign.hand_eye.pictures import read_picture_set
from studies.board_scenes import FLANGE, LENS, SIGMA_PX, STOPS_OFF, X, draw_scene, inner_corners
from tests.unit.hand_eye.test_picture_sets import picture

NAMES = ("a.png", "b.png", "c.png")


def moving(scene, rng, late, speed=0.3):
    """Joints as read, and how they moved, of pictures that were taken a time later."""
    q = posture_of_pose(scene.flange)
    velocity = speed * rng.standard_normal(q.shape) * np.repeat([0.3, 1.0], 3)
    return q - late * velocity, np.stack([velocity, np.zeros_like(q)], axis=1)


@pytest.mark.parametrize("robot", [FLANGE, Robot.preset("ur10e")], ids=["flange", "joints"])
@pytest.mark.parametrize("carried", ["camera", "board"])
def test_derivatives_by_the_time_are_central_differences(robot, carried):
    """Of two trials at once, besides zero offsets, at an offset of 20 ms."""
    rng = np.random.default_rng(5)
    q = posture_of_pose(draw_scene(rng, 4).flange)
    around = robot.fk(q[0]) @ X @ transform(np.eye(3), np.array([-0.1, -0.1, 0.6]))
    blocks = [ToolFrame(X), TargetFrame(around), TimeOffsets({"camera": ("tool", 0)})]
    if robot is not FLANGE:
        blocks.append(ZeroOffsets(robot, robot.joint_names[1:3]))
    kind = BoardView(SIGMA_PX, BoardShape(inner_corners()), LENS, carried)
    model = CalibrationModel(robot, blocks, kind)
    views = replace(Setup.of(4), motion=rng.standard_normal((4, 2, 6)))
    k = model.names.index("time.offset")
    x = np.tile(model.nominal, (2, 1))
    x[:, k] = 0.02, -0.01
    e = 1e-6 * (np.arange(model.p) == k)
    wanted = (model.predict(q, x + e, views) - model.predict(q, x - e, views)) / 2e-6
    found = model.jacobian(q, x, views)[..., k]
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


def test_each_of_two_cameras_has_its_own_time():
    rng = np.random.default_rng(6)
    scene = draw_scene(rng, 15)
    postures, motion = moving(scene, rng, 0.03)
    left = scene.shown(scene.seen(rng, arm=STOPS_OFF), postures=postures, motion=motion)
    other, still = draw_scene(rng, 15), draw_scene(rng, 15)
    postures, motion = moving(other, rng, -0.01)
    sets = [
        replace(left, camera="left"),
        other.shown(other.seen(rng, arm=STOPS_OFF), postures=postures, motion=motion, camera="mid"),
        still.shown(still.seen(rng, arm=STOPS_OFF), camera="right"),
    ]
    sets = [replace(s, names=tuple(f"{s.camera} {i}" for i in range(15))) for s in sets]
    result = calibrate(sets)
    assert set(result.time_offsets_s) == {"left", "mid"}
    for camera, late in (("left", 0.03), ("mid", -0.01)):
        value, sigma = result.time_offsets_s[camera]
        assert abs(value - late) < 5 * sigma
        assert sigma < 1e-3
    assert result.warnings == ()


def test_an_arm_that_stands_still_costs_nothing():
    rng = np.random.default_rng(7)
    scene = draw_scene(rng, 12)
    pixels = scene.seen(rng, arm=STOPS_OFF)
    plain = calibrate(scene.shown(pixels))
    slow = 1e-3 * rng.standard_normal((12, 2, 6))  # what the noise of encoders looks like
    result = calibrate(scene.shown(pixels, motion=slow))
    assert result.time_offsets_s == {}
    # the noise is found to a hundredth, and rounding decides where in it
    np.testing.assert_allclose(result.estimate.sigma, plain.estimate.sigma, rtol=1e-3)


def test_without_the_time_of_an_arm_that_moved_the_answer_is_not_trusted():
    rng = np.random.default_rng(8)
    scene = draw_scene(rng, 15)
    postures, motion = moving(scene, rng, 0.05)
    pixels = scene.seen(rng, arm=STOPS_OFF)
    with_time = calibrate(scene.shown(pixels, postures=postures, motion=motion))
    assert with_time.is_ok
    without = calibrate(scene.shown(pixels, postures=postures))
    assert "are joints and pictures of the same moment" in " ".join(without.warnings)


def test_motion_of_a_record_is_that_of_its_polynomial():
    times = np.sort(np.random.default_rng(9).uniform(0.0, 1.0, 60))
    curves = [np.polynomial.Polynomial([0.1, 0.5, -0.7, 0.3]), np.polynomial.Polynomial([1.0])]
    at = np.array([0.31, 0.5])
    q, motion = motion_at(times, np.stack([c(times) for c in curves], axis=1), at)
    for j, curve in enumerate(curves):
        np.testing.assert_allclose(q[:, j], curve(at), atol=1e-12)
        np.testing.assert_allclose(motion[:, 0, j], curve.deriv()(at), atol=1e-9)
        np.testing.assert_allclose(motion[:, 1, j], curve.deriv(2)(at), atol=1e-6)
    with pytest.raises(InputError, match="no 4 rows about time 3 s"):
        motion_at(times, np.zeros((60, 2)), [3.0])
    with pytest.raises(InputError, match="do not all rise"):
        motion_at(times[::-1], np.zeros((60, 2)), at)


def test_motion_that_does_not_belong_to_the_pictures_is_refused():
    scene = draw_scene(np.random.default_rng(1), 5)
    pixels = scene.seen(np.random.default_rng(1))
    for bad in (np.zeros((5, 6)), np.zeros((4, 2, 6)), np.full((5, 2, 6), np.nan)):
        with pytest.raises(InputError, match="do not belong to 5 pictures"):
            scene.shown(pixels, motion=bad)


def record(folder, rows):
    """A table of times, pictures and joints [deg]; None for joints that are not given."""
    lines = ["time_s,picture," + ",".join(f"j{j}_deg" for j in range(1, 7))]
    for time, name, joints in rows:
        cells = [""] * 6 if joints is None else [f"{value:.6f}" for value in joints]
        lines.append(",".join([f"{time:.4f}", name, *cells]))
    (folder / "joints.csv").write_text("\n".join(lines) + "\n")
    return folder / "joints.csv"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pictures").mkdir()
    for k, name in enumerate(NAMES):
        picture(tmp_path / "pictures" / name, k)
    return tmp_path


def joints_at(time):
    return np.array([10.0, -20.0, 30.0, 0.0, 40.0, 5.0]) + time * np.array([20, -10, 5, 0, 3, 1.0])


ROBOT = Robot.preset("lrmate200id")
TAKEN = dict(zip(NAMES, (0.333, 0.7171, 1.5), strict=True))


@pytest.mark.parametrize("with_joints", [False, True])
def test_a_record_gives_joints_and_motion_of_pictures_between_its_rows(folder, with_joints):
    rows = [(t, "", joints_at(t)) for t in np.arange(0.0, 2.0, 0.02) + 0.003]
    rows += [(t, name, joints_at(t) if with_joints else None) for name, t in TAKEN.items()]
    found = read_picture_set(folder / "pictures", record(folder, rows), ROBOT)
    assert found.notes == ()
    wanted = np.deg2rad([joints_at(t) for t in TAKEN.values()])
    np.testing.assert_allclose(found.postures, wanted, atol=1e-7)
    speed = np.deg2rad([20, -10, 5, 0, 3, 1.0])
    np.testing.assert_allclose(found.motion[:, 0], np.tile(speed, (3, 1)), atol=1e-5)


def pose_at(time):
    """A camera that looks down, whose rotation goes through half a turn."""
    turn = rotation_exp([np.pi - 0.05 + 0.1 * time, 0.2 * time, 0.1])
    return transform(turn, np.array([0.5, 0.1, 0.4]) + time * np.array([0.05, -0.02, 0.01]))


@pytest.mark.parametrize("with_poses", [False, True])
def test_a_record_of_poses_of_the_flange_does_as_well(folder, with_poses):
    """Against central differences of the pose itself, on both sides of half a turn."""
    columns = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    lines = [",".join(["time_s", "picture", *columns])]
    for time, name in [
        *[(t, "") for t in np.arange(0.0, 2.0, 0.02) + 0.003],
        *[(t, name) for name, t in TAKEN.items()],
    ]:
        T = pose_at(time)
        values = [*1e3 * T[:3, 3], *quaternion_from_rotation(T[:3, :3])]
        cells = [""] * 7 if name and not with_poses else [f"{value:.9f}" for value in values]
        lines.append(",".join([f"{time:.4f}", name, *cells]))
    (folder / "flange.csv").write_text("\n".join(lines) + "\n")
    found = read_picture_set(folder / "pictures", folder / "flange.csv")
    assert found.postures is None
    T = np.array([pose_at(time) for time in TAKEN.values()])
    np.testing.assert_allclose(found.T_base_flange, T, atol=1e-7)
    robot, step = flange_robot(), 1e-3
    for i, time in enumerate(TAKEN.values()):
        q, (velocity, acceleration) = posture_of_pose(T[i]), found.motion[i]
        for sign in (-1.0, 1.0):
            moved = q + sign * step * velocity + step**2 / 2.0 * acceleration
            np.testing.assert_allclose(robot.fk(moved), pose_at(time + sign * step), atol=1e-7)


def test_times_of_single_stops_say_nothing_of_motion(folder):
    rows = [(10.0 * k, name, joints_at(k)) for k, name in enumerate(NAMES)]
    found = read_picture_set(folder / "pictures", record(folder, rows), ROBOT)
    assert found.motion is None
    np.testing.assert_allclose(found.postures, np.deg2rad([joints_at(k) for k in range(3)]))


@pytest.mark.parametrize("late", [0.0, 5.0])
def test_a_picture_outside_the_record_is_named(folder, late):
    step = 0.02 if late else 0.2  # outside, or too coarse
    rows = [(t, "", joints_at(t)) for t in np.arange(0.0, 2.0, step)]
    rows += [(t, name, None) for name, t in TAKEN.items()]
    rows[-1] = (1.5 + late, NAMES[-1], None)
    with pytest.raises(FileFormatError, match=r"no 4 rows of joints within 0\.25 s") as refused:
        read_picture_set(folder / "pictures", record(folder, rows), ROBOT)
    assert refused.value.row is not None
    assert refused.value.hint
