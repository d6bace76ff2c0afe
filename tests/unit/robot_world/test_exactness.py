"""Without noise every method returns the true X and Z, whatever the orientations."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import METHODS, random_problems, solve, solve_batch

EXACT = 1e-9
"""What the methods promise on data without noise [rad, m]."""

SOUND = [name for name in METHODS if name != "hirsh-literal"]
GUARDED = [name for name in SOUND if name != "zhuang-literal"]
"""Methods that half turns of A or Z do not trouble; those of X trouble tsai-lenz."""
TURNS = {
    "identity": [1.0, 0.0, 0.0, 0.0],
    "x": [0.0, 1.0, 0.0, 0.0],
    "y": [0.0, 0.0, 1.0, 0.0],
    "z": [0.0, 0.0, 0.0, 1.0],
    "oblique": [0.0, 0.6, 0.48, 0.64],
}
HALF_TURNS = [name for name in TURNS if name != "identity"]


def rotation_error(estimate, truth):
    return se3.rotation_angle(estimate[..., :3, :3] @ np.swapaxes(truth[..., :3, :3], -1, -2))


def translation_error(estimate, truth):
    return np.linalg.norm(estimate[..., :3, 3] - truth[..., :3, 3], axis=-1)


def turn(name):
    return se3.rotation_from_quaternion(TURNS[name])


def pairs_of(A, X, Z):
    return se3.inverse(Z)[..., None, :, :] @ A @ X[..., None, :, :]


def assert_exact(found, X, Z):
    for estimate, truth in ((found.X, X), (found.Z, Z)):
        assert rotation_error(estimate, truth).max() < EXACT
        assert translation_error(estimate, truth).max() < EXACT


@pytest.mark.parametrize(
    ("pairs", "cone_deg"), [(3, None), (4, 40.0), (10, 2.0), (12, 40.0), (50, None)]
)
@pytest.mark.parametrize("method", SOUND)
def test_exact_without_noise(method, pairs, cone_deg):
    problems = random_problems(np.random.default_rng(pairs), 6, pairs, cone_deg)
    found = solve_batch(problems.A, problems.B, method)
    assert found.ok.all()
    assert_exact(found, problems.X, problems.Z)


ONE_FROM_ALL = [np.eye(3), se3.rotation_exp([0.7, 0.0, 0.0]), se3.rotation_exp([0.0, 0.5, 0.0])]
"""Rotations of which the half turn about z is half a turn away: the sign of its quaternion cannot
be told from products in pairs, which all vanish."""
FIRST_ROTATIONS = {
    **{f"some A half a turn about {name}": [np.eye(3), turn(name)] for name in HALF_TURNS},
    "one pose half a turn from all others": [*ONE_FROM_ALL, turn("z")],
}


@pytest.mark.parametrize(
    ("first", "pairs"),
    [
        *((first, 3 + 5 * (k % 2)) for k, first in enumerate(FIRST_ROTATIONS)),
        (list(FIRST_ROTATIONS)[-1], 4),
        (list(FIRST_ROTATIONS)[-1], 8),
    ],
)
@pytest.mark.parametrize("method", GUARDED)
def test_exact_where_some_a_is_half_a_turn(method, first, pairs):
    rotations = FIRST_ROTATIONS[first][:pairs]
    problems = random_problems(np.random.default_rng(3), 20, pairs)
    A = problems.A.copy()
    A[:, : len(rotations), :3, :3] = rotations
    found = solve_batch(A, pairs_of(A, problems.X, problems.Z), method)
    assert found.ok.all()
    assert_exact(found, problems.X, problems.Z)


@pytest.mark.parametrize("half_turn", HALF_TURNS)
@pytest.mark.parametrize("method", GUARDED)
def test_exact_where_z_is_half_a_turn(method, half_turn):
    problems = random_problems(np.random.default_rng(2), 20, 6)
    Z = se3.transform(turn(half_turn), problems.Z[:, :3, 3])
    found = solve_batch(problems.A, pairs_of(problems.A, problems.X, Z), method)
    assert found.ok.all()
    assert_exact(found, problems.X, Z)


@pytest.mark.parametrize("method", [name for name in GUARDED if name != "tsai-lenz"])
def test_exact_where_everything_is_half_a_turn(method):
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(8, 3))
    half = se3.rotation_exp(np.pi * axes / np.linalg.norm(axes, axis=-1, keepdims=True))
    A = se3.transform(half, rng.uniform(-0.5, 0.5, (8, 3)))
    X = se3.transform(turn("oblique"), [0.1, 0.2, 0.3])
    Z = se3.transform(turn("y"), [1.0, 0.2, -0.3])
    found = solve(A, pairs_of(A, X, Z), method)
    assert found.status == "ok"
    assert_exact(found, X, Z)


def test_unguarded_quaternion_method_fails_at_half_turns_and_says_so():
    problems = random_problems(np.random.default_rng(6), 20, 6)
    Z = se3.transform(turn("x"), problems.Z[:, :3, 3])
    B = pairs_of(problems.A, problems.X, Z)
    literal = solve_batch(problems.A, B, "zhuang-literal")
    assert rotation_error(literal.Z, Z).min() > 0.1
    assert literal.misfit.all()
    assert not literal.ok.any()
    assert solve(problems.A[0], B[0], "zhuang-literal").status == "misfit"


@pytest.mark.parametrize("method", SOUND)
def test_single_problem_is_a_batch_of_one(method):
    problems = random_problems(np.random.default_rng(7), 3, 6)
    batch = solve_batch(problems.A, problems.B, method)
    for trial in range(3):
        single = solve(problems.A[trial], problems.B[trial], method)
        np.testing.assert_allclose(single.X, batch.X[trial], atol=1e-12)
        np.testing.assert_allclose(single.Z, batch.Z[trial], atol=1e-12)


def test_printed_iteration_ends_where_it_may_not_and_says_so():
    problems = random_problems(np.random.default_rng(8), 200, 5)
    found = solve_batch(problems.A, problems.B, "hirsh-literal")
    right = rotation_error(found.Z, problems.Z) < 1e-6
    assert 0.1 < right.mean() < 0.9
    assert not found.ok[~right].any()
