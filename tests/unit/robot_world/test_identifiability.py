"""Motion that does not identify X and Z is refused by name, never answered with a number."""

import numpy as np
import pytest

from calib import se3
from calib.errors import NotIdentifiableError
from calib.robot_world import METHODS, PairNoise, add_noise, random_problems, solve, solve_batch

POSITIONS = np.random.default_rng(0).uniform(-0.5, 0.5, (6, 3))
X = se3.transform(se3.rotation_exp([0.3, -1.2, 0.4]), [0.1, 0.2, 0.3])
Z = se3.transform(se3.rotation_exp([1.0, 0.5, -2.0]), [1.0, 0.2, -0.3])


def camera_of(A):
    return se3.inverse(Z) @ A @ X


def about(axis, angles, start=(0.2, 0.1, -0.4)):
    """Poses that differ by rotations about one axis of the flange."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    R = se3.rotation_exp(start) @ se3.rotation_exp(np.outer(angles, axis))
    return se3.transform(R, POSITIONS[: len(angles)])


ANGLES = [0.0, 0.4, -0.7, 1.9, 2.8, 0.1]
PURE_TRANSLATION = about([0, 0, 1], np.zeros(6))


@pytest.mark.parametrize("on", ["A", "B", "both"])
@pytest.mark.parametrize("sigma_deg", [0.001, 0.1, 1.0])
def test_noise_does_not_hide_a_common_axis(on, sigma_deg):
    rng = np.random.default_rng(1)
    A = about([0, 1, 0], ANGLES)
    noise = PairNoise(np.radians(sigma_deg), 1e-4, on)
    for _ in range(8):
        measured = add_noise(rng, A, camera_of(A), noise)
        with pytest.raises(NotIdentifiableError, match="common axis") as caught:
            solve(*measured)
        # what A and B agree on may vanish altogether
        assert caught.value.parameters[0].startswith("translation of X along the common axis")


@pytest.mark.parametrize("decimals", [7, 9])
def test_rounding_of_a_file_does_not_hide_a_common_axis(decimals):
    A = about([0.6, 0.0, 0.8], ANGLES)
    with pytest.raises(NotIdentifiableError, match="common axis"):
        solve(A.round(decimals), camera_of(A).round(decimals))


def test_small_rotations_about_two_axes_are_enough_where_the_noise_is_small():
    rng = np.random.default_rng(3)
    problems = random_problems(rng, 50, 8, cone_deg=2.0)
    measured = add_noise(rng, problems.A, problems.B, PairNoise(np.radians(0.01), 1e-5, "both"))
    assert solve_batch(*measured).ok.all()


def test_batch_masks_bad_trials_and_solves_the_others():
    problems = random_problems(np.random.default_rng(4), 5, 6)
    A, B = problems.A.copy(), problems.B.copy()
    A[1] = about([1, 0, 0], ANGLES)
    A[3] = PURE_TRANSLATION
    B[[1, 3]] = camera_of(A[[1, 3]])
    bad = np.array([False, True, False, True, False])
    for method in set(METHODS) - {"hirsh-literal"}:
        found = solve_batch(A, B, method)
        np.testing.assert_array_equal(found.rank_deficient, bad)
        np.testing.assert_array_equal(found.degenerate, bad)
        np.testing.assert_array_equal(found.ok, ~bad)
        assert np.isnan(found.X[bad]).all()
        assert np.isnan(found.Z[bad]).all()
        np.testing.assert_allclose(found.X[~bad], problems.X[~bad], atol=1e-9)


def test_batch_of_bad_trials_only():
    A = np.stack([PURE_TRANSLATION, PURE_TRANSLATION])
    found = solve_batch(A, camera_of(A), "hirsh")
    assert not found.ok.any()
    np.testing.assert_array_equal(found.iterations, 0)


def test_batch_keeps_the_numbers_of_trials_that_only_the_noise_makes_degenerate():
    rng = np.random.default_rng(5)
    A = np.repeat(about([0, 0, 1], ANGLES)[None], 10, axis=0)
    measured = add_noise(rng, A, camera_of(A), PairNoise(1e-2, 1e-4, "both"))
    found = solve_batch(*measured)
    assert found.degenerate.all()
    assert not found.rank_deficient.any()
    assert np.isfinite(found.X).all()
    assert not found.ok.any()
