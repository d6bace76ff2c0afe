"""How noise is made, as far as residuals tell: shares of A and B, and growth with the distance."""

import numpy as np
import pytest
from scipy.stats import chi2

from calib import se3
from calib.errors import InputError
from calib.robot_world import (
    PairCovariances,
    PairNoise,
    certify,
    difference,
    random_problems,
    shown_noise,
    solve,
    solve_batch,
)
from calib.robot_world.noise import perturb
from tests.hostile_pairs import viewing_pairs

SIGMA = np.repeat([2e-3, 1e-3], 3)


def noise_of(rng, count):
    return rng.standard_normal((count, 6)) * SIGMA


def seen_from_afar(rng, pairs, *, inverse):
    """A target at .3 to 3 m, its rotation and place less certain with the distance, its depth most.

    Returns A, B, X and Z.
    """
    problems = viewing_pairs(rng, pairs, distance_m=(0.5, 1.2))
    X, Z, B = problems.X[0], problems.Z[0], problems.B[0].copy()
    B[:, :3, 3] *= rng.uniform(0.4, 2.5, (pairs, 1))
    A = Z @ B @ se3.inverse(X)
    own = se3.inverse(B) if inverse else B
    far = np.linalg.norm(own[:, :3, 3], axis=1, keepdims=True)
    sight = own[:, :3, 3] / far
    error = noise_of(rng, pairs)
    depth = (error[:, 3:] * sight).sum(axis=1, keepdims=True) * sight
    error[:, 3:] = far * (error[:, 3:] - depth) + 3.0 * far**2 * depth
    error[:, :3] *= far
    own = perturb(own, error)
    return A, se3.inverse(own) if inverse else own, X, Z


def off(result, X, Z):
    return np.concatenate([difference(result.X, X), difference(result.Z, Z)])


@pytest.mark.parametrize("pairs", [12, 25, 60])
def test_nothing_is_invented(pairs):
    """Squares of the sizes are those of 3 N - 6 normal numbers each, set by set and in the mean."""
    rng = np.random.default_rng(pairs)
    freedom, trials = 3 * pairs - 6, 10
    squares = []
    for _ in range(trials):
        problems = random_problems(rng, 1, pairs, cone_deg=40.0)
        noise = shown_noise(problems.A[0], perturb(problems.B[0], noise_of(rng, pairs)))
        assert isinstance(noise, PairNoise)
        assert noise.on == "B"
        squares.append(np.square([noise.rotation_rad, noise.translation_m] / SIGMA[[0, 3]]))
    # one of twenty numbers outside by chance: one in 250; one of two means likewise
    least, most = chi2.ppf([1e-4, 1.0 - 1e-4], freedom) / freedom
    assert least < np.min(squares)
    assert np.max(squares) < most
    least, most = chi2.ppf([1e-3, 1.0 - 1e-3], trials * freedom) / (trials * freedom)
    mean = np.mean(squares, axis=0)
    assert least < mean.min()
    assert mean.max() < most


def noisy_robot(seed, pairs):
    """Pairs of a narrow cone with noise of A across a lever that shows it, and X and Z."""
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, 1, pairs, cone_deg=15.0)
    X = se3.transform(problems.X[0, :3, :3], np.array([0.4, -0.3, 0.5]))
    B = se3.inverse(problems.Z[0]) @ problems.A[0] @ X
    return perturb(problems.A[0], noise_of(rng, pairs)), B, X, problems.Z[0]


@pytest.mark.parametrize("method", ["ml", pytest.param("ml-robust", marks=pytest.mark.slow)])
def test_noise_that_shows_is_taken_and_said(method):
    off_by = {"B": [], None: []}
    for seed in range(6):
        A, B, X, Z = noisy_robot(seed, 40)
        shown, of_B = solve(A, B, method), solve(A, B, method, "B")
        assert shown.noise_estimated
        assert of_B.noise_estimated
        assert shown.chi2 is None
        assert "of the variance of rotations is of A" in shown.noise_made
        assert shown.noise_made in shown.message
        assert shown.noise.on in ("A", "both")
        assert of_B.noise.on == "B"
        assert not of_B.noise_made
        assert "which was taken: " in of_B.warnings[-1]
        assert not any("residuals show other noise" in text for text in shown.warnings)
        batch = solve_batch(A[None], B[None], method)
        np.testing.assert_allclose(batch.covariance[0], shown.covariance, rtol=1e-6, atol=1e-16)
        np.testing.assert_allclose(batch.Z[0], shown.Z, atol=1e-12)
        for asked, found in ((None, shown), ("B", of_B)):
            off_by[asked].append(off(found, X, Z))
    squares = {asked: np.mean(np.square(each), axis=0) for asked, each in off_by.items()}
    assert (squares[None] / squares["B"]).mean() < 0.85


def test_noise_that_is_estimated_explains_the_residuals():
    """Residuals in units of it have a mean square of one for each degree of freedom."""
    A, B, _, _ = noisy_robot(1, 40)
    result = solve(A, B)
    again = solve(A, B, "ml", result.noise)
    assert again.chi2 == pytest.approx(again.freedom, rel=1e-3)
    assert not again.noise_estimated


def test_what_is_no_noise_is_not_taken():
    """B of another size, which makes residuals grow with the distance; a single wrong pair."""
    rng = np.random.default_rng(4)
    A, B, _, _ = seen_from_afar(rng, 40, inverse=False)
    assert solve(A, B).noise_made
    B[:, :3, 3] *= 0.9
    assert not solve(A, B).noise_made
    problems = random_problems(rng, 1, 30, cone_deg=40.0)
    B = perturb(problems.B[0], noise_of(rng, 30))
    B[3, :3, 3] += [0.2, 0.0, 0.0]
    result = solve(problems.A[0], B)
    assert not result.noise_made
    assert any(text.startswith("pair 4 (counted from 1)") for text in result.warnings)


def test_others_than_the_likeliest_take_it_where_it_is_asked_for():
    A, B, _, _ = noisy_robot(2, 40)
    plain, asked = solve(A, B, "shah"), solve(A, B, "shah", "shown")
    np.testing.assert_array_equal(plain.X, asked.X)
    assert plain.noise.on == "B"
    assert asked.noise.on in ("A", "both")
    assert asked.noise_estimated


def test_a_noise_of_no_kind_is_refused():
    A, B, _, _ = noisy_robot(2, 20)
    for call in (solve, lambda *sides: solve_batch(sides[0][None], sides[1][None], *sides[2:])):
        with pytest.raises(InputError, match="the noise is 'b', which is none") as refused:
            call(A, B, "ml", "b")
        assert '"shown"' in refused.value.hint
    result = solve(A, B)
    with pytest.raises(InputError):
        certify(A, B, result.X, result.Z, "B")


@pytest.mark.parametrize("inverse", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_noise_that_grows_with_the_distance_is_found_and_used(inverse):
    rng = np.random.default_rng(1)
    plain, weighed, deviations = [], [], []
    for _ in range(10):
        A, B, X, Z = seen_from_afar(rng, 40, inverse=inverse)
        noise = shown_noise(A, B)
        assert isinstance(noise, PairCovariances)
        result = solve(A, B, "ml", noise)
        plain.append(off(solve(A, B, "ml", "B"), X, Z))
        weighed.append(off(result, X, Z))
        deviations.append(weighed[-1] / np.sqrt(np.diag(result.covariance)))
    better = np.sqrt(np.mean(np.square(weighed), axis=0) / np.mean(np.square(plain), axis=0))
    assert better.mean() < 0.85
    assert 0.90 < (np.abs(deviations) < 1.96).mean() < 0.99


def test_the_share_of_A_is_told_where_the_lever_shows_it():
    rng = np.random.default_rng(2)
    shares = []
    for _ in range(10):
        problems = random_problems(rng, 1, 60, cone_deg=60.0)
        X = se3.transform(problems.X[0, :3, :3], np.array([0.4, -0.3, 0.5]))
        B = se3.inverse(problems.Z[0]) @ problems.A[0] @ X
        noise = shown_noise(perturb(problems.A[0], noise_of(rng, 60)), B)
        on_A = noise.A if isinstance(noise, PairCovariances) else None
        on_B = noise.B if isinstance(noise, PairCovariances) else None
        of_A = 0.0 if on_A is None else on_A[0, 0, 0]
        of_B = 0.0 if on_B is None else on_B[0, 0, 0]
        shares.append(of_A / (of_A + of_B) if of_A + of_B else 0.0)
    assert np.median(shares) > 0.8
