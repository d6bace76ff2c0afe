"""Residuals of a pair with X and Z from all others, against solving without it."""

import tracemalloc

import numpy as np
import pytest

from calib.errors import InputError
from calib.robot_world import METHODS, PairNoise, add_noise, random_problems, residuals, solve

SMALL = {"rotation_rad": 1e-5, "translation_m": 1e-5}
USUAL = {"rotation_rad": np.radians(0.3), "translation_m": 1e-3}


def without(T, i):
    return np.delete(T, i, axis=0)


def measured(seed, pairs, noise):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, 1, pairs)
    return add_noise(rng, problems.A[0], problems.B[0], noise)


def refitted(A, B, method, noise):
    out = []
    for i in range(len(A)):
        left = solve(without(A, i), without(B, i), method, noise)
        out.append(residuals(A[i, None], B[i, None], left.X, left.Z)[0])
    return np.array(out)


def relative(found, expected):
    """Largest difference of rotations and of translations, over the root mean square of each."""
    parts = (slice(0, 3), slice(3, 6))
    return max(
        np.abs(found[:, p] - expected[:, p]).max() / np.sqrt((expected[:, p] ** 2).mean())
        for p in parts
    )


@pytest.mark.parametrize("on", ["B", "A", "both"])
@pytest.mark.parametrize("pairs", [5, 20])
def test_one_step_is_the_whole_way_where_the_noise_is_small(on, pairs):
    """The next step is smaller by the residual rotations in radians: 1e-5 to 1e-4 here."""
    noise = PairNoise(**SMALL, on=on)
    A, B = measured(pairs, pairs, noise)
    found = solve(A, B, "ml", noise).left_out_residuals
    assert relative(found, refitted(A, B, "ml", noise)) < 2e-4


@pytest.mark.parametrize("on", ["B", "A", "both"])
@pytest.mark.parametrize("pairs", [6, 20])
def test_one_step_is_nearly_the_whole_way_at_usual_noise(on, pairs):
    noise = PairNoise(**USUAL, on=on)
    A, B = measured(10 + pairs, pairs, noise)
    result = solve(A, B, "ml", noise)
    expected = refitted(A, B, "ml", noise)
    assert relative(result.left_out_residuals, expected) < 0.03
    # it is not the residual of the pair itself
    assert relative(result.residuals, expected) > 0.05


@pytest.mark.parametrize(
    "method", [name for name in METHODS if not METHODS[name].likelihood and "literal" not in name]
)
def test_other_methods_are_solved_again(method):
    noise = PairNoise(**USUAL)
    A, B = measured(30, 7, noise)
    found = solve(A, B, method).left_out_residuals
    np.testing.assert_allclose(found, refitted(A, B, method, None), rtol=1e-8, atol=1e-12)


def test_a_pair_that_was_left_out_already_has_its_own_residual():
    noise = PairNoise(**USUAL)
    A, B = measured(31, 12, noise)
    B[3] = B[7]
    result = solve(A, B, "ml-robust", noise)
    np.testing.assert_array_equal(np.flatnonzero(~result.used), [3])
    np.testing.assert_allclose(result.left_out_residuals[3], result.residuals[3])
    good = result.used
    kept = solve(A[good], B[good], "ml", noise)
    np.testing.assert_allclose(
        result.left_out_residuals[good], kept.left_out_residuals, rtol=1e-5, atol=1e-9
    )


@pytest.mark.parametrize("method", ["ml", "shah"])
def test_three_pairs_leave_too_few(method):
    A, B = measured(32, 3, PairNoise(**SMALL))
    assert np.isnan(solve(A, B, method).left_out_residuals).all()


@pytest.mark.parametrize("method", ["ml", "shah"])
def test_a_pair_without_which_nothing_is_identified_has_none(method):
    """Four poses about one axis and one that turns otherwise."""
    rng = np.random.default_rng(33)
    problems = random_problems(rng, 1, 5)
    A = problems.A[0].copy()
    angles = np.array([0.0, 0.5, 1.2, 2.0])
    A[:4, :3, :3] = np.eye(3)
    A[:4, 0, 0] = A[:4, 1, 1] = np.cos(angles)
    A[:4, 1, 0], A[:4, 0, 1] = np.sin(angles), -np.sin(angles)
    B = np.linalg.inv(problems.Z[0]) @ A @ problems.X[0]
    found = solve(A, B, method, PairNoise(**SMALL) if method == "ml" else None).left_out_residuals
    assert np.isnan(found[4]).all()
    assert np.abs(found[:4]).max() < 1e-8


def test_root_mean_squares_are_of_the_used_pairs():
    A, B = measured(34, 8, PairNoise(**USUAL))
    result = solve(A, B)
    rows = result.left_out_residuals
    assert result.left_out_rotation_rms_rad == pytest.approx(
        np.sqrt((rows[:, :3] ** 2).sum(axis=1).mean())
    )
    assert result.left_out_translation_rms_m == pytest.approx(
        np.sqrt((rows[:, 3:] ** 2).sum(axis=1).mean())
    )
    assert result.left_out_rotation_rms_rad > result.rotation_rms_rad


@pytest.mark.slow
def test_size_is_that_of_new_poses():
    """What leaving out predicts is what fresh pairs show: a sum over 300 sets, within 5 %."""
    rng = np.random.default_rng(35)
    noise = PairNoise(**USUAL)
    predicted, shown = [], []
    for _ in range(300):
        problems = random_problems(rng, 1, 30)
        A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
        result = solve(A[:9], B[:9], "ml", noise)
        predicted.append((result.left_out_residuals[:, :3] ** 2).sum(axis=1).mean())
        fresh = residuals(A[9:], B[9:], result.X, result.Z)
        shown.append((fresh[:, :3] ** 2).sum(axis=1).mean())
    # eight pairs in place of nine: the prediction is on the safe side by a few per cent
    assert 0.95 < np.sqrt(np.mean(predicted) / np.mean(shown)) < 1.08


def test_of_thousands_of_pairs_some_stand_for_all():
    """Standard deviations and left-out residuals of a method without a likelihood."""
    noise = PairNoise(**USUAL)
    A, B = measured(3, 3000, noise)
    linear, likeliest = solve(A, B, "shah", noise), solve(A, B, "ml", noise)
    # rotations first is next to the likeliest for translations of this size
    ratio = linear.sigma_X / likeliest.sigma_X
    assert (ratio > 0.9).all()
    assert (ratio < 1.6).all()
    left = linear.left_out_residuals
    assert np.isfinite(left).all()
    assert relative(left, linear.residuals) < 0.1


@pytest.mark.parametrize("method", ["zhuang", "shah", "ml-robust"])
def test_memory_grows_with_the_pairs_not_with_their_square(method):
    peaks = []
    for pairs in (1000, 4000):
        A, B = measured(5, pairs, PairNoise(**USUAL))
        tracemalloc.start()
        solve(A, B, method)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 6.0 * peaks[0]
    assert peaks[1] < 150e6


@pytest.mark.parametrize("method", ["park-martin", "horaud-dornaika-literal"])
def test_methods_that_go_through_all_motions_take_so_many_pairs(method):
    A, B = measured(5, 6000, PairNoise(**USUAL))
    with pytest.raises(InputError, match=r"6000 pairs make 17997000 motions") as error:
        solve(A, B, method)
    assert "5000 pairs at most" in error.value.hint
