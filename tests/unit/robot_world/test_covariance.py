"""The covariance of X and Z against scatter, and against what is known of it."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.robot_world import (
    METHODS,
    PairNoise,
    PairSets,
    accuracy,
    add_noise,
    difference,
    random_problems,
    solve,
    solve_batch,
    solve_batch_by_each,
)
from calib.robot_world.accuracy import propagate
from tests.hostile_pairs import viewing_pairs
from tests.marks import rest_in_full

METHODS_WITH_COVARIANCE = [name for name in METHODS if name != "hirsh-literal"]
SMALL = {"rotation_rad": 2e-4, "translation_m": 1e-4}
"""Noise small enough for the first order: squares of it are below a hundredth of it."""


def scatter(method, problems, noise, trials, rng):
    shape = (trials, *problems.A.shape[1:])
    measured = add_noise(
        rng, np.broadcast_to(problems.A, shape), np.broadcast_to(problems.B, shape), noise
    )
    found = solve_batch(*measured, method)
    # of steady sets one in some thousands is taken to have moved (drift.CHANCE, three tests a set)
    assert np.count_nonzero(~found.ok) <= 5
    errors = np.concatenate(
        [difference(found.X, problems.X), difference(found.Z, problems.Z)], axis=-1
    )
    return errors.T @ errors / trials


def assert_agrees(predicted, observed, trials):
    """Eigenvalues of the observed covariance in units of the predicted one, all near 1.

    Those of a sample covariance of p normal numbers lie within (1 ± (√p + t)/√T)², but for a
    chance of 2 exp(-t²/2): below 1e-3 with t = 4.
    """
    whitener = np.linalg.inv(np.linalg.cholesky(predicted))
    ratio = np.linalg.eigvalsh(whitener @ observed @ whitener.T)
    spread = (np.sqrt(12) + 4.0) / np.sqrt(trials)
    assert ratio[0] > (1.0 - spread) ** 2
    assert ratio[-1] < (1.0 + spread) ** 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "on"),
    [
        (name, on)
        for name in METHODS_WITH_COVARIANCE
        for on in ("A", "B", "both")[2 * (name == "ml-robust") :]
    ],
)
def test_covariance_is_the_scatter(method, on):
    rng = np.random.default_rng(1)
    problems = random_problems(rng, 1, 6)
    noise = PairNoise(**SMALL, on=on)
    result = solve(problems.A[0], problems.B[0], method, noise)
    trials = 300
    observed = scatter(method, problems, noise, trials, rng)
    assert_agrees(result.covariance, observed, trials)
    np.testing.assert_allclose(result.sigma_X**2, np.diag(result.covariance)[:6])
    np.testing.assert_allclose(result.sigma_Z**2, np.diag(result.covariance)[6:])


@pytest.mark.slow
@pytest.mark.parametrize("cone_deg", rest_in_full([None, 40.0], (40.0,)))
@pytest.mark.parametrize("method", [m for m in METHODS_WITH_COVARIANCE if m != "ml-robust"])
def test_covariance_is_the_scatter_closely(method, cone_deg):
    rng = np.random.default_rng(2)
    problems = random_problems(rng, 1, 15, cone_deg)
    noise = PairNoise(**SMALL, on="both")
    result = solve(problems.A[0], problems.B[0], method, noise)
    trials = 1000
    assert_agrees(result.covariance, scatter(method, problems, noise, trials, rng), trials)


def test_covariance_from_noisy_data_is_near_that_of_the_truth():
    rng = np.random.default_rng(3)
    problems = random_problems(rng, 1, 10)
    noise = PairNoise(**SMALL, on="both")
    truth = solve(problems.A[0], problems.B[0], noise=noise)
    measured = solve(*add_noise(rng, problems.A[0], problems.B[0], noise), noise=noise)
    np.testing.assert_allclose(measured.sigma_X, truth.sigma_X, rtol=0.05)
    np.testing.assert_allclose(measured.sigma_Z, truth.sigma_Z, rtol=0.05)


def test_covariance_grows_with_the_square_of_the_noise_and_adds_over_the_sides():
    """Of noise so small that the square of a bias, its fourth power, is below rounding."""
    problems = random_problems(np.random.default_rng(4), 1, 5)
    pair = problems.A[0], problems.B[0]
    single = {on: solve(*pair, "shah", PairNoise(1e-7, 1e-7, on)).covariance for on in ("A", "B")}
    both = solve(*pair, "shah", PairNoise(2e-7, 2e-7, "both")).covariance
    np.testing.assert_allclose(both, 4.0 * (single["A"] + single["B"]), rtol=1e-9, atol=1e-26)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["andreff", "li-kronecker-literal", "shah", "daniilidis", "ml"])
def test_standard_deviations_cover_the_errors_where_a_target_stays_in_view(method):
    """A method's own bias is part of them: without it those of the first two cover a half.

    Of 60 sets the 95 % intervals of one number cover 95 % but for 11 % at four deviations.
    """
    rng = np.random.default_rng(11)
    noise = PairNoise(np.radians(0.5), 3e-3)
    covered = []
    for _ in range(60):
        problems = viewing_pairs(rng, 20)
        A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
        estimate = METHODS[method].run(PairSets(A[None], B[None]), noise)
        error = np.concatenate(
            [difference(estimate.X, problems.X), difference(estimate.Z, problems.Z)], axis=-1
        )
        if estimate.fit is not None:
            covariance = estimate.fit.covariance[0]
        else:
            covariance = propagate(METHODS[method].estimate, A, B, noise)
        covered.append(np.abs(error[0]) < 1.96 * np.sqrt(np.diag(covariance)))
    assert np.mean(covered, axis=0).min() > 0.84
    assert np.mean(covered) > 0.92


@pytest.mark.parametrize("method", ["ml", "shah"])
def test_pairs_without_noise_have_next_to_no_covariance(method):
    """Without noise given the residuals show it: rounding here."""
    problems = random_problems(np.random.default_rng(5), 1, 5)
    result = solve(problems.A[0], problems.B[0], method)
    assert result.noise_estimated
    assert 0.0 <= result.sigma_X.max() < 1e-8


@pytest.mark.parametrize(
    ("sigma", "name"), [((0.0, 1e-3), "rotation_rad"), ((1e-3, 0.0), "translation_m")]
)
@pytest.mark.parametrize("method", ["ml", "ml-robust"])
def test_noise_of_zero_has_no_likelihood(method, sigma, name):
    problems = random_problems(np.random.default_rng(5), 1, 5)
    with pytest.raises(InputError, match=f"{name} of the noise is 0"):
        solve(problems.A[0], problems.B[0], method, noise=PairNoise(*sigma))


def test_noise_of_zero_is_carried_through_other_methods():
    problems = random_problems(np.random.default_rng(5), 1, 5)
    A, B = problems.A[0], problems.B[0]
    shifts = solve(A, B, "shah", noise=PairNoise(0.0, 1e-3))
    assert shifts.chi2 is None
    np.testing.assert_allclose(shifts.sigma_X[:3], 0.0, atol=1e-12)
    both = solve(A, B, "shah", noise=PairNoise(1e-3, 1e-3)).covariance
    turns = solve(A, B, "shah", noise=PairNoise(1e-3, 0.0)).covariance
    np.testing.assert_allclose(shifts.covariance + turns, both, rtol=1e-5, atol=1e-14)


def test_covariance_without_noise_given_is_that_of_the_noise_shown():
    """By the method's own first order, with the noise that its residuals show, on B."""
    rng = np.random.default_rng(8)
    problems = random_problems(rng, 1, 12)
    A, B = add_noise(rng, problems.A[0], problems.B[0], PairNoise(1e-3, 1e-3))
    for method in ("ml", "shah"):
        plain = solve(A, B, method)
        given = solve(A, B, method, plain.noise)
        np.testing.assert_allclose(plain.covariance, given.covariance, rtol=1e-5, atol=1e-14)


def test_covariance_does_not_depend_on_the_size_of_the_chunks(monkeypatch):
    problems = random_problems(np.random.default_rng(6), 1, 5)
    noise = PairNoise(1e-3, 1e-3)
    whole = solve(problems.A[0], problems.B[0], noise=noise).covariance
    monkeypatch.setattr("calib.robot_world.accuracy._PAIRS_AT_ONCE", 40)
    chunks = solve(problems.A[0], problems.B[0], noise=noise).covariance
    np.testing.assert_allclose(chunks, whole, rtol=1e-12)


def test_batch_does_not_depend_on_the_size_of_the_chunks_nor_on_other_methods(monkeypatch):
    problems = random_problems(np.random.default_rng(7), 7, 5)
    whole = solve_batch(problems.A, problems.B, "hirsh")
    monkeypatch.setattr("calib.robot_world.solver._PAIRS_AT_ONCE", 11)
    by_each = solve_batch_by_each(problems.A, problems.B, ("li-kronecker", "hirsh"))
    np.testing.assert_allclose(by_each["hirsh"].X, whole.X, atol=1e-14)
    np.testing.assert_array_equal(by_each["hirsh"].iterations, whole.iterations)
    other = solve_batch(problems.A, problems.B, "li-kronecker")
    np.testing.assert_array_equal(by_each["li-kronecker"].Z, other.Z)


@pytest.mark.parametrize(
    ("method", "off"), [("shah", 1e-3), ("hirsh", 1e-3), ("li-kronecker", 1e-3), ("zhuang", 0.08)]
)
def test_of_more_than_a_hundred_pairs_as_by_each_error(monkeypatch, method, off):
    """What the pairs tell is taken as it is, the rest is drawn: by its share, to some per cent."""
    rng = np.random.default_rng(3)
    problem = random_problems(rng, 1, 110)
    noise = PairNoise(5e-3, 2e-3)
    A, B = (T[0] for T in add_noise(rng, problem.A, problem.B, noise))
    few = propagate(METHODS[method].estimate, A, B, noise)
    monkeypatch.setattr(accuracy, "_EACH_ERROR", len(A))
    each = propagate(METHODS[method].estimate, A, B, noise)
    ratio = np.sqrt(np.diag(few) / np.diag(each))
    np.testing.assert_allclose(ratio, 1.0, atol=off)
