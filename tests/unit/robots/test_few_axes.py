"""Arms of fewer than six axes, and arms whose own joints slide: kinematics and poses."""

import numpy as np
import pinocchio as pin
import pytest

from calib import CalibrationModel, Robot, identify
from calib.geometry.enclosure import motion_radii
from calib.model.measurements import TouchUp
from calib.model.parameters import LinkGeometry, TargetPoints, ToolPoint, ZeroOffsets
from calib.model.simulation import simulate
from calib.robots.one_posture import OnePosture
from calib.robots.shapes import Body, Sphere
from calib.se3 import rotation_exp, transform
from tests.few_axes import ARMS, few_axes
from tests.unit.robots.test_chain import assert_same_kinematics

TOOL_M = np.array([0.03, -0.01, 0.05])


@pytest.fixture(scope="module", params=ARMS)
def robot(request, tmp_path_factory) -> Robot:
    return few_axes(request.param, tmp_path_factory.mktemp("few"))


def drawn(robot: Robot, count: int, inner: float = 0.0) -> np.ndarray:
    share = np.random.default_rng(3).uniform(inner, 1.0 - inner, (count, robot.n))
    return robot.lower + share * robot.joint_range


def test_kinematics_are_pinocchio_s(robot):
    q = drawn(robot, 30)
    assert_same_kinematics(robot, robot.model, q)
    np.testing.assert_array_equal(robot.fk(q[:1])[0], robot.fk(q)[0])
    np.testing.assert_allclose(OnePosture(robot).tip(q[0]), robot.fk(q[0]), atol=1e-12)


def test_slides_of_the_arm_are_told_with_their_units_and_labels(robot):
    assert robot.n_external == 0
    assert robot.joint_labels == tuple(f"J{k + 1}" for k in range(robot.n))
    slides = [kind == "P" for kind, *_ in ARMS[robot.name][0]]
    assert robot.sliding.tolist() == slides
    assert [unit == "mm" for unit in robot.joint_units] == slides
    assert list(robot.turning_joints) == [
        name for name, s in zip(robot.joint_names, slides, strict=True) if not s
    ]


def test_no_point_is_farther_than_the_reach(robot):
    q = drawn(robot, 4000)
    state = robot.state(q)
    far = np.linalg.norm(state.p_base_tip - state.origins[:, 1], axis=1)
    if not robot.sliding[:2].any():
        assert far.max() <= robot.chain.reach_m + 1e-12
    assert robot.chain.reach_m > 0.0


def test_joint_motion_is_bounded_by_the_radii(robot):
    """How far a body moves against another one is no more than what motions are proven by."""
    bodies = [
        Body(f"b{k}", k, transform(np.eye(3), [0.02 * k, -0.03, 0.05]), Sphere(0.02))
        for k in range(robot.n + 1)
    ]
    pairs = np.array([[a, b] for a in range(robot.n + 1) for b in range(a + 1, robot.n + 1)])
    radii = motion_radii(robot.chain, bodies, pairs)
    q, step = drawn(robot, 200), 1e-6
    at = [_centres(robot, bodies, q)]
    for j in range(robot.n):
        moved = q.copy()
        moved[:, j] += step
        at.append(_centres(robot, bodies, moved))
    apart = [np.linalg.norm(p[:, pairs[:, 0]] - p[:, pairs[:, 1]], axis=-1) for p in at]
    for j in range(robot.n):
        fastest = np.abs(apart[j + 1] - apart[0]).max(axis=0) / step
        assert (fastest <= radii[:, j] * (1 + 1e-6) + 1e-6).all()


def _centres(robot: Robot, bodies: list[Body], q: np.ndarray) -> np.ndarray:
    state, out = robot.state(q), []
    for body in bodies:
        p = body.T_link_body[:3, 3]
        if body.link:
            p = state.rotations[:, body.link - 1] @ p + state.origins[:, body.link - 1]
        out.append(np.broadcast_to(p, (len(q), 3)))
    return np.stack(out, axis=1)


def test_poses_next_to_those_asked_for_keep_the_point(robot):
    q = drawn(robot, 60, inner=0.2)
    rng, state = np.random.default_rng(4), robot.state(q)
    place = state.point(TOOL_M)
    R = state.R_base_tip @ rotation_exp(rng.uniform(-0.4, 0.4, (60, 3)))
    asked = transform(R, place - R @ TOOL_M)
    poses = robot.nearest_poses(asked, TOOL_M, q)
    if robot.n >= 6:
        np.testing.assert_array_equal(poses, asked)
        return
    np.testing.assert_allclose(poses[:, :3, :3] @ TOOL_M + poses[:, :3, 3], place, atol=1e-9)
    # no posture next to the one found has the point there and is turned less against what was asked
    found, took = robot.inverse(poses, near=q[0]).nearest()
    assert took.mean() > 0.9
    own = robot.nearest_poses(robot.fk(q), TOOL_M, q)
    np.testing.assert_allclose(own, robot.fk(q), atol=1e-6)  # what it takes already stays
    turned = np.linalg.norm(pin_log(R @ np.swapaxes(poses[:, :3, :3], -1, -2)), axis=1)
    first = np.linalg.norm(pin_log(R @ np.swapaxes(state.R_base_tip, -1, -2)), axis=1)
    assert (turned <= first + 1e-3).all()
    assert len(found) == 60


def pin_log(R: np.ndarray) -> np.ndarray:
    return np.array([pin.log3(r) for r in R])


def test_parameters_move_as_differences_say(robot):
    """Zero offsets and frames of arms whose joints slide, by central differences."""
    offsets, links = ZeroOffsets(robot, robot.joint_names), LinkGeometry(robot)
    target = robot.state(drawn(robot, 1)[0]).point(TOOL_M)
    model = CalibrationModel(
        robot, [offsets, links, ToolPoint(TOOL_M), TargetPoints([target])], TouchUp([1e-4] * 3)
    )
    rng = np.random.default_rng(6)
    q, x = drawn(robot, 5), model.nominal + rng.normal(0.0, 1e-2, model.p)
    J, step = model.jacobian(q, x), 1e-6
    for k in range(model.p):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += step
        behind[k] -= step
        differences = (model.predict(q, ahead) - model.predict(q, behind)) / (2.0 * step)
        np.testing.assert_allclose(J[..., k], differences, atol=1e-7)


@pytest.mark.parametrize("robot", ["scara", "stanford", "five axes"], indirect=True)
def test_identified_offsets_have_the_truth_in_their_intervals(robot):
    """Monte Carlo: squared errors over their covariance are those of chi-squared."""
    told = {"scara": ["j2"], "stanford": ["j2", "j3", "j4", "j5"], "five axes": ["j2", "j3", "j4"]}
    joints = told[robot.name]
    axes = "xy" if robot.name == "scara" else "xyz"
    base = robot.lower + 0.6 * robot.joint_range
    place = robot.state(base).point(TOOL_M)
    rng = np.random.default_rng(8)
    R = robot.fk(base)[:3, :3] @ rotation_exp(rng.uniform(-0.7, 0.7, (40, 3)))
    asked = transform(R, place - R @ TOOL_M)
    poses = robot.nearest_poses(asked, TOOL_M, base)
    solved = robot.inverse(poses, near=base)
    q = solved.postures[solved.inside]
    assert len(q) > 20
    model = CalibrationModel(
        robot,
        [ZeroOffsets(robot, joints), ToolPoint(TOOL_M, axes), TargetPoints([place])],
        TouchUp([2e-5] * 3),
    )
    x = model.nominal.copy()
    x[: len(joints)] = 1e-3 * np.array([1.0, -0.7, 0.5, 0.9])[: len(joints)]
    distances = []
    for _ in range(40):
        data = simulate(model, x, q, rng=rng)
        found = identify(model, data)
        off = found.values - x
        distances.append(off @ np.linalg.solve(found.covariance, off))
    # mean p, variance 2 p: of forty trials within four standard errors
    assert np.mean(distances) == pytest.approx(model.p, abs=4.0 * np.sqrt(2.0 * model.p / 40))
