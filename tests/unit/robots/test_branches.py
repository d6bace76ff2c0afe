"""An arm that is a branch of a bigger tree: other joints held, other bodies standing still."""

import numpy as np
import pinocchio as pin
import pytest

from calib import Robot
from calib.errors import RobotModelError
from calib.geometry import Scene
from calib.robots.arm_shapes import makers_like
from calib.se3 import inverse
from tests.two_arms import two_arms

HELD_RAD = {"waist": 0.5, "right_joint_2": -0.7}
HELD_M = {"lift": 0.25, "left_finger_1": 0.01}
LED = {"left_finger_2": 0.01}


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp("tree") / "duo.urdf"
    path.write_text(two_arms())
    return path


def frames_of_the_tree(urdf, robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Every link in the base frame of the arm, of the whole tree as Pinocchio reads it."""
    model = pin.buildModelFromUrdf(str(urdf))
    data, whole = model.createData(), pin.neutral(model)
    values = {**HELD_RAD, **HELD_M, **LED, **dict(zip(robot.joint_names, q, strict=True))}
    for name, value in values.items():
        whole[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, whole)
    base = data.oMf[model.getFrameId(robot.base_frame)].inverse()
    return {
        frame.name: (base * data.oMf[i]).homogeneous
        for i, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY
    }


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("base", ["{}_base", "torso", "foot"])
def test_arm_gravity_and_bodies_are_those_of_the_whole_tree(urdf, side, base):
    held = HELD_RAD if side == "left" else {**HELD_RAD, "right_joint_2": 0.0}
    held = {name: value for name, value in held.items() if value}
    base = base.format(side)
    robot = Robot.from_urdf(urdf, tip=f"{side}_tool0", base=base, held_rad=held, held_m=HELD_M)
    assert robot.joint_names == tuple(f"{side}_joint_{k}" for k in range(1, 7))
    q = np.random.default_rng(0).uniform(-1, 1, 6)
    if side == "right":
        q[1] = HELD_RAD["right_joint_2"]  # of this arm it is free
    there = frames_of_the_tree(urdf, robot, q)
    np.testing.assert_allclose(robot.fk(q), there[robot.tip_frame], atol=1e-12)
    down = there["foot"][:3, :3] @ [0, 0, -9.80665]  # the root is level
    np.testing.assert_allclose(robot.gravity, down, atol=1e-12)
    state = robot.state(q)
    assert len(robot.bodies) == 3 + 2 * 7 + 4
    for body in robot.bodies:
        link = there[body.name]
        placed = body.T_link_body
        if body.link:
            frame = np.eye(4)
            frame[:3, :3] = state.rotations[body.link - 1]
            frame[:3, 3] = state.origins[body.link - 1]
            placed = frame @ placed
        shape = inverse(link) @ placed
        np.testing.assert_allclose(shape[:3, :3], np.eye(3), atol=1e-12)
        fixed = {"column": 0.2, "torso": -0.2, f"{side}_base": 0.05}.get(body.name)
        if fixed is not None:
            np.testing.assert_allclose(shape[:3, 3], [0, 0, fixed], atol=1e-12)


def test_a_notice_says_what_is_held_and_at_what(urdf):
    robot = Robot.from_urdf(
        urdf, tip="left_tool0", base="left_base", held_rad=HELD_RAD, held_m=HELD_M
    )
    said = next(n for n in robot.notices if n.startswith("held"))
    assert said == (
        "held: lift at 250 mm, waist at 28.6479 deg, left_finger_1 at 10 mm, "
        "left_finger_2 at 10 mm, right_joint_2 at -40.107 deg"
    )
    zero = next(n for n in robot.notices if n.startswith("locked"))
    assert "right_joint_1, right_joint_3" in zero
    assert "waist" not in zero


def test_a_controller_is_found_from_the_arm_s_own_base(urdf):
    robot = Robot.from_urdf(urdf, tip="right_tool0", base="right_base")
    assert "fanuc" in makers_like(robot)
    assert robot.controlled_by("fanuc").controller.maker == "fanuc"


def test_a_joint_between_base_and_tip_can_be_held(urdf):
    both = Robot.from_urdf(urdf, tip="left_tool0", base="column", held_rad={"waist": 0.0})
    assert both.n == 6
    whole = Robot.from_urdf(urdf, tip="left_tool0")
    assert (whole.joint_names[:2], whole.n_external) == (("lift", "waist"), 1)
    with_waist = Robot.from_urdf(urdf, tip="left_tool0", lock=["lift"])
    assert with_waist.joint_names[0] == "waist"
    assert with_waist.n == 7


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"held_rad": {"lift": 0.1}}, r"joint lift slides \(give its value in mm\)"),
        ({"held_m": {"waist": 0.1}}, r"joint waist turns \(give its value in deg\)"),
        ({"held_m": {"lift": 0.6}}, "lift is to be held at 600 mm, and its limits are 0 and 500"),
        ({"held_rad": {"waist": 2.0}}, "waist is to be held at 114.592 deg, and its limits are"),
        ({"held_rad": {"waist": np.nan}}, "waist is to be held at nan deg"),
        ({"held_rad": {"left_mount": 0.1}}, "left_mount is fixed, and has no value to be held at"),
        ({"held_rad": {"wrist": 0.0}}, "there is no joint 'wrist' to lock"),
    ],
)
def test_what_cannot_be_held_so_is_refused(urdf, given, message):
    with pytest.raises(RobotModelError, match=message):
        Robot.from_urdf(urdf, tip="left_tool0", base="left_base", **given)


@pytest.mark.parametrize(
    ("multiplier", "moved"), [("2", 0.02), ("-1", 0.01), ("nan", 0.0), ("2 3", 0.0)]
)
def test_a_joint_that_follows_is_where_its_leader_brings_it(tmp_path, multiplier, moved):
    """Its own limits are the maker's affair; a factor that is no number leaves it at zero."""
    path = tmp_path / "duo.urdf"
    mimic = '<mimic joint="left_finger_1"'
    path.write_text(two_arms().replace(mimic, f'{mimic} multiplier="{multiplier}"'))

    def finger(**held):
        robot = Robot.from_urdf(path, tip="left_tool0", base="torso", **held)
        return next(b for b in robot.bodies if b.name == "left_finger_2_link").T_link_body[:3, 3]

    off = finger(held_m={"left_finger_1": 0.01}) - finger()
    assert np.linalg.norm(off) == pytest.approx(moved, abs=1e-12)


def test_the_first_link_is_kept_clear_of_other_branches(urdf):
    """It is a neighbour of the torso that it turns on, but not of the other arm and the lift."""
    robot = Robot.from_urdf(urdf, tip="left_tool0", base="left_base")
    other = {body.name for body in robot.bodies if body.of_other_branch}
    still = {body.name for body in robot.bodies if body.link == 0}
    assert still - other == {"left_base", "right_base", "torso"}
    scene = Scene(robot.chain, robot.bodies)
    pairs = {frozenset(scene.names(k)) for k in range(len(scene.pairs))}
    assert frozenset(("left_link_1", "right_link_6")) in pairs
    assert frozenset(("left_link_1", "column")) in pairs
    assert frozenset(("left_link_1", "torso")) not in pairs
    assert frozenset(("left_link_2", "torso")) in pairs
    assert not any(body.of_other_branch for body in Robot.preset("ur5e").bodies)
