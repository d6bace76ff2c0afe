"""Shah's closed form against its definition, against OpenCV, and in ill-conditioned motion."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import (
    METHODS,
    PairNoise,
    PairSets,
    add_noise,
    pairs_from_opencv,
    random_problems,
    solve_batch,
)
from calib.robot_world.results import Estimate


def noisy(seed, trials, pairs, cone_deg=None):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    return add_noise(rng, problems.A, problems.B, PairNoise(np.radians(0.5), 1e-3, "both"))


def plain_shah(A, B):
    """Sum of Kronecker products, singular vectors, determinants, then 3N linear equations."""
    total = sum(np.kron(a[:3, :3], b[:3, :3]) for a, b in zip(A, B, strict=True))
    U, _, Vt = np.linalg.svd(total)
    R_X, R_Z = (nearest(v.reshape(3, 3)) for v in (Vt[0], U[:, 0]))
    rows = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A])
    right_side = np.concatenate([R_Z @ b[:3, 3] - a[:3, 3] for a, b in zip(A, B, strict=True)])
    p = np.linalg.lstsq(rows, right_side)[0]
    return R_X, R_Z, p[:3], p[3:]


def nearest(V):
    U, _, Wt = np.linalg.svd(V / np.cbrt(np.linalg.det(V)))
    return U @ Wt


@pytest.mark.parametrize("cone_deg", [None, 30.0])
@pytest.mark.parametrize("pairs", [3, 8, 25])
def test_shah_is_its_definition(pairs, cone_deg):
    A, B = noisy(pairs, 4, pairs, cone_deg)
    found = solve_batch(A, B, "shah")
    for trial in range(4):
        R_X, R_Z, p_X, p_Z = plain_shah(A[trial], B[trial])
        np.testing.assert_allclose(found.X[trial, :3, :3], R_X, atol=1e-9)
        np.testing.assert_allclose(found.Z[trial, :3, :3], R_Z, atol=1e-9)
        np.testing.assert_allclose(found.X[trial, :3, 3], p_X, atol=1e-9)
        np.testing.assert_allclose(found.Z[trial, :3, 3], p_Z, atol=1e-9)


def one(A, B, method):
    found = solve_batch(A[None], B[None], method)
    return Estimate(found.X[0], found.Z[0])


@pytest.mark.parametrize(("method", "name"), [("shah", "SHAH"), ("li-kronecker-literal", "LI")])
def test_opencv_solves_the_same_equation_read_from_the_other_side(method, name):
    """Its residual is that of the inverse equation, so the inverses are what to give us."""
    cv2 = pytest.importorskip("cv2", reason="comparison with OpenCV")
    world2cam, base2gripper = noisy(1, 5, 9)
    for ours, theirs in zip(world2cam, base2gripper, strict=True):
        R_X, p_X, R_Z, p_Z = cv2.calibrateRobotWorldHandEye(
            list(ours[:, :3, :3]),
            list(ours[:, :3, 3]),
            list(theirs[:, :3, :3]),
            list(theirs[:, :3, 3]),
            method=getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"),
        )
        found = one(ours, theirs, method)
        np.testing.assert_allclose(found.X[:3, :3], R_X, atol=1e-9)
        np.testing.assert_allclose(found.Z[:3, :3], R_Z, atol=1e-9)
        np.testing.assert_allclose(found.X[:3, 3], p_X[:, 0], atol=1e-9)
        np.testing.assert_allclose(found.Z[:3, 3], p_Z[:, 0], atol=1e-9)
        # From our side the rotations of Shah are the same, the translations are not.
        mine = one(*pairs_from_opencv(ours, theirs), method)
        if method == "shah":
            np.testing.assert_allclose(np.linalg.inv(mine.Z)[:3, :3], R_X, atol=1e-9)
        assert np.abs(np.linalg.inv(mine.Z)[:3, 3] - p_X[:, 0]).max() > 1e-6


def test_poses_that_hardly_tilt_cost_no_digits():
    """Three poses whose common axis tilts by 1e-4: singular vectors of the mean lose 1e-16/1e-8."""
    rng = np.random.default_rng(3)
    problems = random_problems(rng, 50, 3)
    start = problems.A[:, :1, :3, :3]
    turns = se3.rotation_exp([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1e-4, 0.0, 2.0]])
    A = se3.transform(start @ turns, problems.A[..., :3, 3])
    B = se3.inverse(problems.Z)[:, None] @ A @ problems.X[:, None]
    found = METHODS["shah"].estimate(PairSets(A, B))
    np.testing.assert_allclose(found.X[:, :3, :3], problems.X[:, :3, :3], atol=1e-10)
    mean = np.array(
        [
            sum(np.kron(a[:3, :3], b[:3, :3]) for a, b in zip(*T, strict=True))
            for T in zip(A, B, strict=True)
        ]
    )
    by_mean = np.array([nearest(v.reshape(3, 3)) for v in np.linalg.svd(mean)[2][:, 0]])
    assert np.abs(by_mean - problems.X[:, :3, :3]).max() > 1e-9
