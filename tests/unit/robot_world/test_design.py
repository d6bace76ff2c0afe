"""Information on X and Z of planned pairs: differences, elimination, and the other models."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot, se3
from calib.errors import InputError
from calib.model.measurements import CameraPose, Pose
from calib.model.parameters import TargetFrame, ToolFrame
from calib.robot_world import (
    PairCovariances,
    PairNoise,
    design,
    difference,
    random_problems,
    residuals,
    solve,
)
from calib.robot_world.noise import perturb

STEP = 1e-6


def problem(seed: int, pairs: int = 7):
    found = random_problems(np.random.default_rng(seed), 1, pairs)
    return found.A[0], found.B[0], found.X[0], found.Z[0]


def derivative(function, size: int):
    """Central differences of a function of ``(size,)``, as the last axis."""
    steps = STEP * np.eye(size)
    return np.stack([(function(s) - function(-s)) / (2 * STEP) for s in steps], axis=-1)


def some_covariance(rng: np.random.Generator):
    root = rng.normal(size=(6, 6)) * [1, 1, 1, 2, 2, 2]
    return 1e-6 * (root @ root.T + np.eye(6))


def noises():
    rng = np.random.default_rng(5)
    alike = [PairNoise(1e-3, 2e-3, on) for on in ("A", "B", "both")]
    one, other = some_covariance(rng), np.stack([some_covariance(rng) for _ in range(7)])
    return [
        *alike,
        PairCovariances(A=one),
        PairCovariances(B=other, axes="from"),
        PairCovariances(A=other, B=one),
    ]


def sides(noise, A, B):
    """Covariances ``(N, 6, 6)`` of the errors of A and B, in the axes that these map to."""
    roots = noise.roots(A, B)
    none = np.zeros((len(A), 6, 6))
    return [
        none if r is None else np.broadcast_to(r @ np.swapaxes(r, 1, 2), none.shape) for r in roots
    ]


@pytest.mark.parametrize("noise", noises())
def test_information_is_that_of_the_residuals_by_differences(noise):
    A, B, X, Z = problem(0)
    G = derivative(lambda s: residuals(A, B, perturb(X, s[:6]), perturb(Z, s[6:])), 12)
    of_A = derivative(lambda s: residuals(perturb(A, s), B, X, Z), 6)
    of_B = derivative(lambda s: residuals(A, perturb(B, s), X, Z), 6)
    C_A, C_B = sides(noise, A, B)
    C = of_A @ C_A @ np.swapaxes(of_A, 1, 2) + of_B @ C_B @ np.swapaxes(of_B, 1, 2)
    expected = np.einsum("nai,nab,nbj->ij", G, np.linalg.inv(C), G)
    found = design.information(design.blocks(A, X, Z, noise))
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.outer(size, size).max())
    np.testing.assert_allclose(
        found / np.outer(size, size), expected / np.outer(size, size), atol=1e-7
    )


def test_noise_on_one_side_is_that_side_against_what_the_others_predict():
    A, B, X, Z = problem(1)
    for on in ("A", "B"):
        noise = PairNoise(1e-3, 2e-3, on)

        def off(s, on=on):
            T_x, T_z = perturb(X, s[:6]), perturb(Z, s[6:])
            if on == "B":
                return difference(se3.inverse(T_z) @ A @ T_x, B)
            return difference(T_z @ B @ se3.inverse(T_x), A)

        J = (derivative(off, 12) / noise.sigma[:, None]).reshape(-1, 12)
        expected = np.linalg.inv(J.T @ J)
        found = design.covariance(design.blocks(A, X, Z, noise))
        scale = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6
        )


def test_noise_on_both_sides_is_what_unknown_true_poses_leave():
    """The Schur complement of the information on X, Z and all true A from all that is measured."""
    A, B, X, Z = problem(2, pairs=5)
    noise = PairNoise(1e-3, 2e-3, "both")

    def measured(s):
        true_A = perturb(A, s[12:].reshape(-1, 6))
        seen = se3.inverse(perturb(Z, s[6:12])) @ true_A @ perturb(X, s[:6])
        return np.concatenate([difference(true_A, A), difference(seen, B)])

    J = (derivative(measured, 12 + 6 * len(A)) / noise.sigma[:, None]).reshape(-1, 12 + 6 * len(A))
    whole = J.T @ J
    cross = whole[:12, 12:]
    expected = whole[:12, :12] - cross @ np.linalg.solve(whole[12:, 12:], cross.T)
    found = design.information(design.blocks(A, X, Z, noise))
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(size, size), expected / np.outer(size, size), atol=1e-7
    )


@pytest.mark.parametrize("on", ["A", "B", "both"])
def test_problems_are_designed_in_batches(on):
    many = random_problems(np.random.default_rng(3), 4, 6)
    noise = PairNoise(1e-3, 2e-3, on)
    together = design.blocks(many.A, many.X, many.Z, noise)
    assert together.shape == (4, 6, 6, 12)
    covariance = design.covariance(together)
    for t in range(4):
        alone = design.blocks(many.A[t], many.X[t], many.Z[t], noise)
        np.testing.assert_allclose(together[t], alone, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(covariance[t], design.covariance(alone), rtol=1e-9)
    one_X = design.blocks(many.A, many.X[0], many.Z[0], noise)
    np.testing.assert_array_equal(one_X[0], together[0])


def test_poses_about_one_axis_leave_X_and_Z_open():
    _, _, X, Z = problem(4)
    angles = np.linspace(-1, 1, 6)[:, None]
    A = se3.transform(
        se3.rotation_exp(angles * [0.0, 0.6, 0.8]), np.random.default_rng(0).normal(size=(6, 3))
    )
    blocks = design.blocks(A, X, Z, PairNoise(1e-3, 1e-3))
    assert np.isinf(design.covariance(blocks)).all()
    A[0] = A[0] @ se3.transform(se3.rotation_exp([0.3, 0, 0]), np.zeros(3))
    several = design.covariance(np.stack([blocks, design.blocks(A, X, Z, PairNoise(1e-3, 1e-3))]))
    assert np.isinf(several[0]).all()
    assert np.isfinite(several[1]).all()


def test_a_single_pair_leaves_everything_open():
    A, _, X, Z = problem(5, pairs=1)
    assert np.isinf(design.covariance(design.blocks(A, X, Z, PairNoise(1e-3, 1e-3)))).all()


def test_names_are_those_of_the_columns():
    assert design.NAMES[:6] == ("X.rx", "X.ry", "X.rz", "X.x", "X.y", "X.z")
    assert design.NAMES[6:] == tuple(name.replace("X", "Z") for name in design.NAMES[:6])


def test_what_is_no_transform_and_noise_that_is_zero_are_refused():
    A, _, X, Z = problem(6)
    with pytest.raises(InputError, match="Z"):
        design.blocks(A, X, 2 * Z, PairNoise(1e-3, 1e-3))
    with pytest.raises(InputError, match="rotation_rad"):
        design.blocks(A, X, Z, PairNoise(0.0, 1e-3))


@pytest.fixture(scope="module")
def arm():
    """Poses of an arm, with X and Z of a camera on it and a target beside it."""
    robot = Robot.preset("r2000ic165f")
    rng = np.random.default_rng(7)
    q = np.array([0.0, 0.2, -0.4, 0.0, -0.8, 0.0]) + rng.uniform(-0.5, 0.5, (9, 6))
    X = se3.transform(se3.rotation_exp([0.2, -0.1, 0.4]), [0.2, -0.05, 0.1])
    Z = se3.transform(se3.rotation_exp([3.0, 0.2, -0.3]), [1.9, 0.1, 0.5])
    return robot, q, X, Z


def in_pair_errors(model_covariance, X, Z):
    """Covariance of a model with tool and target frames in the order and axes of the pairs.

    Frames have their place first, and turn about their own axes.
    """
    turn = np.zeros((12, 12))
    for k, T in enumerate((X, Z)):
        turn[6 * k : 6 * k + 3, 6 * k + 3 : 6 * k + 6] = T[:3, :3]
        turn[6 * k + 3 : 6 * k + 6, 6 * k : 6 * k + 3] = np.eye(3)
    return turn @ model_covariance @ turn.T


def model_covariance(robot, q, X, Z, kind):
    model = CalibrationModel(robot, [ToolFrame(X), TargetFrame(Z)], kind)
    white = model.linearise(q).white_jacobian.reshape(-1, 12)
    return in_pair_errors(np.linalg.inv(white.T @ white), X, Z)


def agree(found, expected):
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9
    )


def test_a_tracked_pose_is_noise_on_B(arm):
    robot, q, X, Z = arm
    noise = PairNoise(3e-4, 1e-4, "B")
    found = design.covariance(design.blocks(robot.fk(q), X, Z, noise))
    agree(found, model_covariance(robot, q, X, Z, Pose([1e-4] * 3 + [3e-4] * 3)))


def test_a_camera_pose_is_noise_on_the_target_as_it_is_seen(arm):
    """By the equation read backwards, A⁻¹ Z = X B⁻¹: then B⁻¹ carries the noise."""
    robot, q, X, Z = arm
    noise = PairNoise(3e-4, 1e-4, "B")
    swapped = design.covariance(design.blocks(se3.inverse(robot.fk(q)), Z, X, noise))
    expected = model_covariance(robot, q, X, Z, CameraPose([1e-4] * 3 + [3e-4] * 3))
    order = np.r_[6:12, 0:6]
    agree(swapped[np.ix_(order, order)], expected)


def test_a_camera_pose_is_noise_on_B_with_a_lever(arm):
    """(w, v) of the target as seen is (-w, -v - p x w) of the camera, in its own axes."""
    robot, q, X, Z = arm
    A = robot.fk(q)
    seen = se3.inverse(design.planned_B(A, X, Z))
    sigma = np.array([3e-4, 2e-4, 5e-4, 1e-4, 2e-4, 6e-4])
    lever = np.tile(-np.eye(6), (len(A), 1, 1))
    lever[:, 3:, :3] = -se3.skew(seen[:, :3, 3])
    of_B = lever @ np.diag(sigma**2) @ np.swapaxes(lever, 1, 2)
    noise = PairCovariances(B=of_B, axes="from")
    found = design.covariance(design.blocks(A, X, Z, noise))
    agree(found, model_covariance(robot, q, X, Z, CameraPose(np.roll(sigma, 3))))


@pytest.mark.parametrize("noise", noises())
def test_the_likeliest_solution_of_perfect_pairs_is_as_certain_as_designed(noise):
    A, B, X, Z = problem(8)
    found = solve(A, B, "ml", noise=noise).covariance
    agree(found, design.covariance(design.blocks(A, X, Z, noise)))
