"""Half turns that leave a choice to the rotations: the translations decide, or all are given."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import METHODS, PairNoise, add_noise, residuals, solve, solve_batch

X = se3.transform(se3.rotation_exp([0.3, -1.2, 0.4]), [0.1, 0.2, 0.3])
Z = se3.transform(se3.rotation_exp([1.0, 0.5, -2.0]), [1.0, 0.2, -0.3])
START = se3.rotation_exp([0.4, 0.2, -0.1])
POSITIONS = np.random.default_rng(0).uniform(-0.5, 0.5, (8, 3))
NOT_TURNED = np.eye(3)


def poses(rotation_vectors, turned=NOT_TURNED, *, moving=True):
    """Poses that turn about one place, the origin of the flange, unless they move as well."""
    R = START @ turned @ se3.rotation_exp(np.array(rotation_vectors, dtype=float)) @ turned.T
    return se3.transform(R, POSITIONS[: len(R)] if moving else POSITIONS[0])


def seen(A):
    return se3.inverse(Z) @ A @ X


HALF = np.pi
ACROSS = [[0, 0, 0], [0, 0, HALF], [0.7, 0, 0], [1.1, 0, 0]]
CASES = {
    "three axes": ([[0, 0, 0], [HALF, 0, 0], [0, HALF, 0], [0, 0, HALF]], 3),
    "across": (ACROSS, 1),
    "several across": (
        [[0, 0, 0], [0.9, 0, 0], [0, HALF, 0], [0, HALF * 0.6, HALF * 0.8], [-1.3, 0, 0]],
        1,
    ),
}
TURNED = [NOT_TURNED, se3.rotation_exp([0.5, -0.9, 1.4])]

every_case = pytest.mark.parametrize("case", CASES)
ALL_CASES = [*((case, TURNED[0]) for case in CASES), ("several across", TURNED[1])]
by_turns = pytest.mark.parametrize(
    ("method", "case", "turned"),
    [
        pytest.param(method, *ALL_CASES[k], id=f"{method}-{k}")
        for i, method in enumerate(METHODS)
        for k in (i % 2, 2 + i // 2 % 2)
    ],
)
"""Each method with two of the cases."""
ROTATIONS_FIRST = ("zhuang", "hirsh", "dornaika-horaud", "shah", "park-martin", "horaud-dornaika")


@by_turns
def test_translations_decide_where_the_flange_moves(method, case, turned):
    A = poses(CASES[case][0], turned)
    result = solve(A, seen(A), method)
    if result.status == "ok":
        assert "which the translations decide" in result.message
        assert not result.alternatives
        np.testing.assert_allclose(result.X, X, atol=1e-6)
        np.testing.assert_allclose(result.Z, Z, atol=1e-6)
    else:
        # four pairs say nothing of gross errors; an iteration as printed may end anywhere
        assert method in ("ml-robust", "hirsh-literal")
        assert result.status in ("misfit", "not converged")


@by_turns
def test_all_answers_are_given_where_nothing_decides(method, case, turned):
    vectors, others = CASES[case]
    A = poses(vectors, turned, moving=False)
    B = seen(A)
    result = solve(A, B, method)
    if method in ROTATIONS_FIRST or method.startswith("ml"):
        assert result.status == "ambiguous"
    if result.status != "ambiguous":
        assert result.status in ("misfit", "not converged")
        return
    assert "leave a choice" in result.message
    answers = [(result.X, result.Z), *result.alternatives]
    assert len(answers) == len(result.ambiguities) + 1 == others + 1
    for i, (x, z) in enumerate(answers):
        assert np.abs(residuals(A, B, x, z)).max() < 1e-6
        for other, _ in answers[:i]:
            # half turns of each other, every two of them
            angle = se3.rotation_angle(x[:3, :3] @ other[:3, :3].T)
            np.testing.assert_allclose(angle, np.pi, atol=1e-6)
    assert any(np.allclose(x[:3, :3], X[:3, :3], atol=1e-6) for x, _ in answers)


@every_case
def test_there_are_no_other_answers(case):
    """By brute force over the half turns about 20,000 axes."""
    A = poses(CASES[case][0], TURNED[1], moving=False)
    B = seen(A)
    result = solve(A, B, "shah")
    axes = np.random.default_rng(1).normal(size=(20_000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turned = (2.0 * axes[:, :, None] * axes[:, None, :] - np.eye(3)) @ result.X[:3, :3]
    implied = A[:, None, :3, :3] @ turned @ np.swapaxes(B[:, None, :3, :3], -1, -2)
    near = axes[np.abs(implied - implied[0]).max(axis=(0, 2, 3)) < 0.1]
    found = np.array([axis_of(x @ se3.inverse(result.X)) for x, _ in result.alternatives])
    agreement = np.abs(near @ found.T)
    assert (agreement.max(axis=1) > 0.98).all()
    assert (agreement.max(axis=0) > 0.995).all()


def axis_of(T):
    vector = se3.rotation_log(T[:3, :3])
    return vector / np.linalg.norm(vector)


def test_axis_is_named_in_the_frame_of_the_flange():
    A = poses(ACROSS, moving=False)
    result = solve(A, seen(A))
    assert result.ambiguities == ("X turned by half a turn about the axis (1, 0, 0) of the flange",)
    assert "ambiguous: X turned by half a turn about the axis (1, 0, 0)" in result.summary()
    assert ": ambiguous" in result.summary().splitlines()[0]


SIX = [*ACROSS, [-0.8, 0, 0], [2.0, 0, 0]]


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("on", ["A", "B", "both"])
def test_noise_hides_no_choice(on, moving):
    rng = np.random.default_rng(2)
    A = poses(SIX, moving=moving)
    for sigma in (1e-5, 1e-3, 5e-3):
        noise = PairNoise(sigma, 1e-4, on)
        result = solve(*add_noise(rng, A, seen(A), noise), "ml", noise)
        answers = [result.X, *(x for x, _ in result.alternatives)]
        angles = [se3.rotation_angle(x[:3, :3] @ X[:3, :3].T) for x in answers]
        assert min(angles) < 20.0 * sigma
        if moving:
            assert result.status == "ok"
            assert len(answers) == 1
        else:
            assert result.status == "ambiguous"
            assert max(angles) > np.pi - 20.0 * sigma


@pytest.mark.parametrize("method", ["ml", "shah", "ml-robust"])
def test_a_batch_is_not_ok_there(method):
    A = poses(ACROSS, moving=False)[None]
    assert not solve_batch(A, seen(A), method).ok.any()


@pytest.mark.parametrize("moving", [True, False])
def test_one_more_pose_that_turns_otherwise_decides(moving):
    A = poses([*ACROSS, [0.3, 0.5, -0.2]], moving=moving)
    result = solve(A, seen(A))
    assert result.status == "ok"
    assert not result.alternatives
    assert "choice" not in result.message
    np.testing.assert_allclose(result.X, X, atol=1e-9)


def test_half_turns_about_any_axes_leave_no_choice():
    """About axes that are at right angles neither to each other nor to one."""
    axes = np.random.default_rng(3).normal(size=(8, 3))
    A = poses(HALF * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    result = solve(A, seen(A))
    assert result.status == "ok"
    np.testing.assert_allclose(result.X, X, atol=1e-9)
