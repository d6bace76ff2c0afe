"""Link geometry: what a displaced frame does, against a chain whose placements were changed."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.batch_last import columns_of, matrices_of
from calib.errors import InputError
from calib.model.measurements import Point
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint
from calib.robots import SerialChain
from calib.robots.chain import Displacement
from calib.se3 import rotation_exp, transform

AXES = ("x", "y", "z", "rx", "ry", "rz")


@pytest.fixture(params=["reference", "oblique"])
def robot(request, reference_robot, random_urdf) -> Robot:
    if request.param == "reference":
        return reference_robot
    return Robot.from_urdf(random_urdf(np.random.default_rng(3), 5))


def changed(chain: SerialChain, joint: int, T: np.ndarray) -> SerialChain:
    placements = chain.placements.copy()
    placements[joint] = placements[joint] @ T
    return SerialChain(placements, chain.axes, chain.T_link_tip)


def some_pose(rng: np.random.Generator, size: float) -> np.ndarray:
    return transform(rotation_exp(rng.uniform(-size, size, 3)), rng.uniform(-size, size, 3))


def test_a_displaced_frame_is_a_changed_placement(robot):
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (robot.n, 8))
    for joint in range(robot.n):
        T = some_pose(rng, 1.0)
        walk = robot.chain.walk(q, {joint: Displacement(T[:3, 3, None], T[:3, :3, None])})
        plain = changed(robot.chain, joint, T).walk(q)
        np.testing.assert_allclose(walk.tip, plain.tip, atol=1e-14)
        np.testing.assert_allclose(walk.p_base_tip, plain.p_base_tip, atol=1e-14)
        np.testing.assert_allclose(walk.origins, plain.origins, atol=1e-14)
        assert list(walk.placed) == [joint]


def test_each_posture_may_be_displaced_by_another_amount(robot):
    rng = np.random.default_rng(1)
    q = rng.uniform(-1, 1, (robot.n, 4))
    T = np.stack([some_pose(rng, 0.5) for _ in range(4)])
    moved = Displacement(T[:, :3, 3].T, np.moveaxis(T[:, :3, :3], 0, -1))
    walk = robot.chain.walk(q, {1: moved})
    for s in range(4):
        state = changed(robot.chain, 1, T[s]).forward(q[:, s])
        np.testing.assert_allclose(walk.p_base_tip[:, s], state.p_base_tip, atol=1e-14)
        np.testing.assert_allclose(matrices_of(walk.tip)[s], state.R_base_tip, atol=1e-14)


def test_the_placed_frame_has_the_axes_of_the_description(robot):
    """At zero, and before the joint turns it."""
    T = some_pose(np.random.default_rng(2), 0.5)
    q = np.random.default_rng(2).uniform(-1, 1, (robot.n, 3))
    for joint in (0, 2):
        walk = robot.chain.walk(q, {joint: Displacement(T[:3, 3, None], T[:3, :3, None])})
        stopped = changed(robot.chain, joint, T)
        held = np.where(np.arange(robot.n)[:, None] < joint, q, 0.0)
        state = stopped.forward(held.T)
        expected = columns_of(state.rotations[:, joint])
        np.testing.assert_allclose(
            np.broadcast_to(walk.placed[joint], expected.shape), expected, atol=1e-14
        )


def test_all_numbers_of_all_links_at_once(robot):
    """x, y, z in the axes as described, then the rotation vector; every joint, several trials."""
    rng = np.random.default_rng(4)
    block = LinkGeometry(robot)
    assert block.names[:7] == (
        *(f"link.{robot.joint_names[0]}.{axis}" for axis in AXES),
        f"link.{robot.joint_names[1]}.x",
    )
    assert block.units == ("m", "m", "m", "rad", "rad", "rad") * robot.n
    model = CalibrationModel(
        robot, [block, ToolPoint([0, 0, 0], ""), TargetPoints([0, 0, 0], free=False)], Point(1e-5)
    )
    x = rng.uniform(-0.3, 0.3, (3, model.p))
    q = rng.uniform(-1, 1, (3, 4, robot.n))
    T = model.view(q, x).T_base_tip
    assert T.shape == (3, 4, 4, 4)
    for t in range(3):
        chain = robot.chain
        for joint, six in enumerate(x[t].reshape(-1, 6)):
            chain = changed(chain, joint, transform(rotation_exp(six[3:]), six[:3]))
        np.testing.assert_allclose(T[t], chain.forward(q[t]).T_base_tip, atol=1e-13)


def test_only_what_is_asked_for_is_freed(reference_robot):
    block = LinkGeometry(
        reference_robot, ["link.joint_3.rz", "link.joint_2.x", "link.joint_3.y"], prior_m=1e-3
    )
    assert block.names == ("link.joint_2.x", "link.joint_3.y", "link.joint_3.rz")
    assert block.units == ("m", "m", "rad")
    np.testing.assert_array_equal(block.prior, [1e-3, 1e-3, np.inf])
    model = CalibrationModel(
        reference_robot,
        [block, ToolPoint([0, 0, 0], ""), TargetPoints([0, 0, 0], free=False)],
        Point(1e-5),
    )
    q = np.random.default_rng(5).uniform(-1, 1, (3, 6))
    chain = changed(reference_robot.chain, 1, transform(np.eye(3), [0.01, 0, 0]))
    chain = changed(chain, 2, transform(rotation_exp([0, 0, 0.03]), [0, 0.02, 0]))
    np.testing.assert_allclose(
        model.predict(q, [0.01, 0.02, 0.03]), chain.forward(q).p_base_tip, atol=1e-14
    )


@pytest.mark.parametrize(
    ("freed", "message"),
    [
        (["link.joint_9.x"], r"no joint 'joint_9' \(did you mean joint_"),
        (["link.joint_2.w"], r"'link.joint_2.w' is no parameter of a link \(link.JOINT. and one"),
        (["joint_2.x"], r"'joint_2.x' is no parameter of a link"),
    ],
)
def test_what_is_no_parameter_of_a_link(reference_robot, freed, message):
    with pytest.raises(InputError, match=message):
        LinkGeometry(reference_robot, freed)


@pytest.mark.parametrize("sigma", [0.0, -1e-3, np.nan])
def test_a_prior_must_be_above_zero(reference_robot, sigma):
    with pytest.raises(InputError, match=r"a prior of .* cannot be used: it must be above zero"):
        LinkGeometry(reference_robot, prior_rad=sigma)
