"""What may be given as noise, and in which axes it is meant."""

import pickle

import numpy as np
import pytest

from calib import se3
from calib.errors import InputError
from calib.robot_world import (
    PairCovariances,
    PairNoise,
    PairSets,
    add_noise,
    difference,
    random_problems,
    solve,
    solve_batch,
)

SPREAD = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) ** 2 * 1e-8


def refused(*args, **kwargs):
    with pytest.raises(InputError) as caught:
        PairCovariances(*args, **kwargs)
    return caught.value


def test_something_must_be_given():
    assert "no covariance is given" in refused().message


@pytest.mark.parametrize("value", [np.eye(3), np.zeros((2, 3, 6, 6)), np.zeros((0, 6, 6)), 1.0])
def test_shape(value):
    error = refused(B=value)
    assert "not (6, 6) or (N, 6, 6)" in error.message
    assert error.name == "B"


def test_symmetry_and_finite_numbers():
    lopsided = SPREAD.copy()
    lopsided[0, 1] = 1e-9
    assert "not finite and symmetric" in refused(A=lopsided).message
    broken = SPREAD.copy()
    broken[2, 2] = np.nan
    assert "not finite and symmetric" in refused(A=broken).message


def test_no_direction_is_exact():
    flat = SPREAD.copy()
    flat[5, 5] = 0.0
    error = refused(B=flat)
    assert "not positive definite" in error.message
    assert "rotation (rad) comes first" in error.hint
    negative = SPREAD.copy()
    negative[0, 1] = negative[1, 0] = 1e-7
    assert "not positive definite" in refused(B=negative).message


def test_units_far_apart_are_no_reason_to_refuse():
    PairCovariances(B=np.diag([1e-12, 1e-12, 1e-12, 1e4, 1e4, 1e4]))


def test_axes_are_checked():
    error = refused(B=SPREAD, axes="From")
    assert "no axes 'From'" in error.message
    assert "from" in error.hint


def test_side_with_noise():
    assert PairCovariances(A=SPREAD).on == "A"
    assert PairCovariances(B=SPREAD).on == "B"
    assert PairCovariances(A=SPREAD, B=SPREAD).on == "both"


@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah"])
@pytest.mark.parametrize(("count", "pairs"), [(5, 10), (4, 5), (2, 10)])
def test_as_many_covariances_as_pairs(count, pairs, method):
    """Also where the number of pairs is a multiple: five are not those of ten."""
    problems = random_problems(np.random.default_rng(0), 3, pairs)
    noise = PairCovariances(B=np.tile(SPREAD, (count, 1, 1)))
    with pytest.raises(InputError, match=f"{count} covariances of B for {pairs} pairs"):
        solve(problems.A[0], problems.B[0], method, noise)
    with pytest.raises(InputError, match=f"{count} covariances of B for {pairs} pairs"):
        add_noise(np.random.default_rng(0), problems.A, problems.B, noise)


def test_covariances_of_one_batch_are_those_of_each_set():
    rng = np.random.default_rng(1)
    problems = random_problems(rng, 4, 6)
    noise = PairCovariances(B=SPREAD * rng.uniform(0.2, 5.0, 6)[:, None, None])
    A, B = add_noise(rng, problems.A, problems.B, noise)
    batch = solve_batch(A, B, "ml", noise)
    for trial in range(4):
        alone = solve(A[trial], B[trial], "ml", noise)
        np.testing.assert_allclose(alone.X, batch.X[trial], atol=1e-10)
        np.testing.assert_allclose(alone.covariance, batch.covariance[trial], rtol=1e-6)


@pytest.mark.parametrize("axes", ["to", "from"])
@pytest.mark.parametrize("side", ["A", "B"])
def test_simulated_noise_has_the_covariance_in_the_axes_it_was_given_in(side, axes):
    trials = 20_000
    problems = random_problems(np.random.default_rng(2), 1, 3)
    noise = PairCovariances(**{side: SPREAD}, axes=axes)
    shape = (trials, 3, 4, 4)
    A, B = add_noise(
        np.random.default_rng(3),
        np.broadcast_to(problems.A, shape),
        np.broadcast_to(problems.B, shape),
        noise,
    )
    true = getattr(problems, side)[0]
    error = difference(A if side == "A" else B, true)
    if axes == "from":
        R_t = np.swapaxes(true[:, :3, :3], -1, -2)
        error = np.concatenate(
            [(R_t @ error[..., part, None])[..., 0] for part in (slice(0, 3), slice(3, 6))], axis=-1
        )
    root = np.sqrt(np.diag(SPREAD))
    white = error / root
    observed = np.einsum("tni,tnj->nij", white, white) / trials
    # five standard deviations of an entry, at most sqrt(2 / trials)
    np.testing.assert_allclose(
        observed, np.tile(np.eye(6), (3, 1, 1)), atol=5 * np.sqrt(2 / trials)
    )
    other = B if side == "A" else A
    np.testing.assert_array_equal(other[0, :, :3], getattr(problems, "BA"[side == "B"])[0, :, :3])


def test_pairs_weigh_by_their_own_covariance():
    """A pair a thousand times less certain has no say."""
    rng = np.random.default_rng(4)
    problems = random_problems(rng, 1, 8)
    A, B = add_noise(rng, problems.A[0], problems.B[0], PairNoise(1e-3, 1e-3))
    each = np.tile(np.eye(6) * 1e-6, (8, 1, 1))
    B[3, :3, 3] += [0.02, 0.0, -0.01]
    each[3] *= 1e12
    weighed = solve(A, B, "ml", PairCovariances(B=each))
    keep = np.arange(8) != 3
    without = solve(A[keep], B[keep], "ml", PairCovariances(B=each[keep]))
    np.testing.assert_allclose(weighed.X, without.X, atol=1e-8)
    np.testing.assert_allclose(weighed.Z, without.Z, atol=1e-8)


@pytest.mark.parametrize("noise", [PairNoise(1e-3, 2e-3, "both"), PairCovariances(B=SPREAD)])
@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah", "hirsh"])
def test_result_goes_through_pickle_with_all_that_is_worked_out_later(method, noise):
    rng = np.random.default_rng(5)
    problems = random_problems(rng, 1, 7)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    result = solve(A, B, method, noise)
    copy = pickle.loads(pickle.dumps(result))  # noqa: S301
    np.testing.assert_array_equal(copy.X, result.X)
    np.testing.assert_allclose(copy.covariance, result.covariance)
    np.testing.assert_allclose(copy.left_out_residuals, result.left_out_residuals)
    assert copy.summary() == result.summary()
    again = pickle.loads(pickle.dumps(copy))  # noqa: S301
    assert again.rank == 12


def test_result_cannot_be_changed():
    problems = random_problems(np.random.default_rng(6), 1, 5)
    result = solve(problems.A[0], problems.B[0])
    with pytest.raises(AttributeError):
        result.status = "fine"


def test_summary_says_what_is_known():
    rng = np.random.default_rng(7)
    problems = random_problems(rng, 1, 12)
    noise = PairNoise(2e-3, 1e-3)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    B[4] = B[9]
    text = solve(A, B, "ml-robust", noise).summary()
    assert "A X = Z B by ml-robust: ok, " in text
    assert "left out as contradicting the others: 5 (counted from 1)" in text
    assert "residuals of 11 pairs, rms: " in text
    assert "each pair left out, rms: " in text
    assert "of 54 degrees of freedom: probability" in text
    assert "known least: rotation of " in text
    assert "known least: translation of " in text
    assert "warning: " not in text
    plain = solve(A, B, "ml", noise).summary()
    assert "warning: " in plain


def test_weak_direction_is_that_of_the_largest_deviation():
    """Rotations about z, and a little about x: where X is along z is known least."""
    rng = np.random.default_rng(8)
    angles = np.zeros((15, 3))
    angles[:, 2] = rng.uniform(-2.0, 2.0, 15)
    A = se3.transform(
        se3.rotation_exp(angles) @ se3.rotation_exp(rng.normal(size=(15, 3)) * [0.1, 0.0, 0.0]),
        rng.uniform(-0.5, 0.5, (15, 3)),
    )
    problems = random_problems(rng, 1, 3)
    B = se3.inverse(problems.Z[0]) @ A @ problems.X[0]
    noise = PairNoise(1e-3, 1e-4)
    result = solve(*add_noise(rng, A, B, noise), noise=noise)
    turn, shift = result.weak_directions
    assert "translation of " in shift
    assert ", 1)" in shift or ", 0.99" in shift
    assert "rotation of " in turn
    block = result.covariance[3:6, 3:6]
    largest = 1e3 * np.sqrt(max(np.linalg.eigvalsh(block)[-1],
                                np.linalg.eigvalsh(result.covariance[9:, 9:])[-1]))  # fmt: skip
    assert f"{largest:.3g} mm" in shift


def test_noise_is_estimated_and_said_to_be_where_none_is_given():
    rng = np.random.default_rng(9)
    true = PairNoise(2e-3, 1e-3)
    problems = random_problems(rng, 1, 40)
    A, B = add_noise(rng, problems.A[0], problems.B[0], true)
    for method in ("ml", "ml-robust", "shah"):
        result = solve(A, B, method)
        assert result.noise_estimated
        assert result.chi2 is None
        assert result.chi2_probability is None
        # four standard deviations of a standard deviation from 3 · 40 - 12 numbers; other methods
        # leave more translation than there was
        assert result.noise.rotation_rad == pytest.approx(true.rotation_rad, rel=0.28)
        if method != "shah":
            assert result.noise.translation_m == pytest.approx(true.translation_m, rel=0.28)
        assert result.covariance.shape == (12, 12)
    given = solve(A, B, "ml", true)
    assert not given.noise_estimated
    assert given.noise is true
    assert given.freedom == 6 * 40 - 12


def test_pair_sets_of_a_seen_target():
    """Errors of T_camera_target as it is seen, and B its inverse: to first order the same."""
    rng = np.random.default_rng(10)
    trials = 20_000
    problems = random_problems(rng, 1, 2)
    T_camera_target = se3.inverse(problems.B[0])
    noise = PairCovariances.of_seen_target(problems.B[0], SPREAD * 1e-2)
    error = rng.normal(size=(trials, 2, 6)) * np.sqrt(np.diag(SPREAD * 1e-2))
    seen = se3.transform(
        se3.rotation_exp(error[..., :3]) @ T_camera_target[:, :3, :3],
        T_camera_target[:, :3, 3] + error[..., 3:],
    )
    of_B = difference(se3.inverse(seen), problems.B[0])
    observed = np.einsum("tni,tnj->nij", of_B, of_B) / trials
    expected = noise.model(PairSets(problems.A, problems.B)).B
    size = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    scale = size[:, :, None] * size[:, None, :]
    np.testing.assert_allclose(observed / scale, expected / scale, atol=5 * np.sqrt(2 / trials))
