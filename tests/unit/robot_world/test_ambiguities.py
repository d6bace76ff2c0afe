"""Half turns that leave a choice: all of the answers are given, and the status says so."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import METHODS, PairNoise, add_noise, solve, solve_batch
from calib.robot_world.results import residuals

X = se3.transform(se3.rotation_exp([0.3, -1.2, 0.4]), [0.1, 0.2, 0.3])
Z = se3.transform(se3.rotation_exp([1.0, 0.5, -2.0]), [1.0, 0.2, -0.3])
START = se3.rotation_exp([0.4, 0.2, -0.1])


def poses(rotation_vectors, turned=np.eye(3)):
    rng = np.random.default_rng(0)
    R = START @ turned @ se3.rotation_exp(np.array(rotation_vectors, dtype=float)) @ turned.T
    return se3.transform(R, rng.uniform(-0.5, 0.5, (len(R), 3)))


def seen(A):
    return se3.inverse(Z) @ A @ X


HALF = np.pi
FOUR = [[0, 0, 0], [HALF, 0, 0], [0, HALF, 0], [0, 0, HALF]]
ACROSS = [[0, 0, 0], [0, 0, HALF], [0.7, 0, 0], [1.1, 0, 0]]
ALL_ACROSS = [[0, 0, 0], [0.9, 0, 0], [0, HALF, 0], [0, HALF * 0.6, HALF * 0.8], [-1.3, 0, 0]]
CASES = {"three axes": (FOUR, 3), "across": (ACROSS, 1), "several across": (ALL_ACROSS, 1)}
TURNED = [np.eye(3), se3.rotation_exp([0.5, -0.9, 1.4])]


def fit_exactly(A, B, x, z):
    error = residuals(A, B, x, z)
    return np.abs(error).max() < 1e-7


@pytest.mark.parametrize("turned", TURNED, ids=["along the axes", "oblique"])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS)
def test_all_answers_are_given(method, case, turned):
    vectors, others = CASES[case]
    A = poses(vectors, turned)
    B = seen(A)
    result = solve(A, B, method)
    if result.status in ("misfit", "not converged"):
        # the method has failed besides, and says so
        assert (
            "literal" in method
            or METHODS[method].equation == "AX=XB"
            or method
            in (
                "li-dual-quaternion",
                "li-kronecker",
            )
        )
        return
    assert result.status == "ambiguous"
    assert "leave a choice" in result.message
    # without noise rotations of the alternatives fit exactly; translations by least squares too
    answers = [(result.X, result.Z), *result.alternatives]
    rotations = [x[:3, :3] for x, _ in answers]
    apart = [se3.rotation_angle(p @ q.T) for i, p in enumerate(rotations) for q in rotations[:i]]
    distinct = {0} | {i for i, p in enumerate(rotations) if i and all(
        se3.rotation_angle(p @ rotations[j].T) > 0.1 for j in range(i))}  # fmt: skip
    assert len(distinct) >= others + 1 - (len(apart) == 0)
    assert any(np.allclose(x, X, atol=1e-6) and np.allclose(z, Z, atol=1e-6) for x, z in answers)
    for x, z in answers:
        assert np.abs(residuals(A, B, x, z)[:, :3]).max() < 1e-6


def test_number_of_answers_in_closed_form():
    """By brute force: half turns about any axis that fit the rotations as well."""
    rng = np.random.default_rng(1)
    for vectors, others in CASES.values():
        A = poses(vectors, TURNED[1])
        B = seen(A)
        result = solve(A, B, "shah")
        assert len(result.alternatives) == len(result.ambiguities) == others
        axes = rng.normal(size=(200_000, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        turned = (2.0 * axes[:, :, None] * axes[:, None, :] - np.eye(3)) @ X[:3, :3]
        implied = A[:, None, :3, :3] @ turned @ np.swapaxes(B[:, None, :3, :3], -1, -2)
        spread = np.abs(implied - implied[0]).max(axis=(0, 2, 3))
        near = axes[spread < 0.1]
        found = np.array([rotation_axis(x) for x, _ in [(result.X, 0), *result.alternatives]
                          if se3.rotation_angle(x[:3, :3] @ X[:3, :3].T) > 0.1])  # fmt: skip
        assert len(found) == others
        assert (np.abs(near @ found.T).max(axis=1) > 0.95).all()
        assert (np.abs(near @ found.T).max(axis=0) > 0.99).all()


def rotation_axis(x):
    vector = se3.rotation_log(x[:3, :3] @ X[:3, :3].T)
    return vector / np.linalg.norm(vector)


def test_axis_is_named_in_the_frame_of_the_flange():
    A = poses(ACROSS)
    result = solve(A, seen(A))
    assert len(result.ambiguities) == 1
    assert result.ambiguities[0].startswith("X turned by half a turn about the axis (1, ")
    assert "ambiguous: X turned by half a turn" in result.summary()


@pytest.mark.parametrize("on", ["A", "B", "both"])
def test_noise_hides_no_choice(on):
    rng = np.random.default_rng(2)
    A = poses(ACROSS + [[-0.8, 0, 0], [2.0, 0, 0]])
    for sigma in (1e-5, 1e-3, 5e-3):
        for _ in range(5):
            noise = PairNoise(sigma, 1e-4, on)
            result = solve(*add_noise(rng, A, seen(A), noise), "ml", noise)
            assert result.status == "ambiguous"
            answers = [result.X, *(x for x, _ in result.alternatives)]
            angles = [se3.rotation_angle(x[:3, :3] @ X[:3, :3].T) for x in answers]
            assert min(angles) < 20.0 * sigma
            assert max(angles) > 3.0


@pytest.mark.parametrize("method", ["ml", "shah", "ml-robust"])
def test_a_batch_is_not_ok_there(method):
    A = poses(ACROSS)[None]
    assert not solve_batch(A, seen(A), method).ok.any()


def test_one_more_pose_that_turns_otherwise_decides():
    A = poses(ACROSS + [[0.3, 0.5, -0.2]])
    result = solve(A, seen(A))
    assert result.status == "ok"
    assert not result.alternatives
    np.testing.assert_allclose(result.X, X, atol=1e-9)


def test_rotations_about_any_axes_by_half_turns_leave_no_choice():
    """Half turns about axes that are not at right angles to each other or to one."""
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(8, 3))
    A = poses(HALF * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    result = solve(A, seen(A))
    assert result.status == "ok"
    np.testing.assert_allclose(result.X, X, atol=1e-9)
