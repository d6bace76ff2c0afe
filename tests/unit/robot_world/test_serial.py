"""Standard deviations where errors follow each other along the sequence of poses."""

import numpy as np
import pytest

from calib.robot_world import PairSets, difference, random_problems, solve, solve_batch
from calib.robot_world.accuracy import FEWEST_PAIRS, widening
from calib.robot_world.methods import maximum_likelihood
from calib.robot_world.noise import perturb

SIGMA = np.repeat([2e-3, 1e-3], 3)


def sequences(seed, trials, pairs, alike):
    """Problems with errors of B of which each is ``alike`` times the one before, and new ones."""
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg=40.0)
    error = rng.standard_normal((trials, pairs, 6))
    for i in range(1, pairs):
        error[:, i] = alike * error[:, i - 1] + np.sqrt(1.0 - alike**2) * error[:, i]
    return problems, perturb(problems.B, SIGMA * error)


def in_deviations(problems, found):
    """Errors of X and Z ``(T, 12)`` over their standard deviations."""
    error = [difference(found.X, problems.X), difference(found.Z, problems.Z)]
    return np.concatenate(error, axis=-1) / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))


def covered(problems, found):
    return (np.abs(in_deviations(problems, found)) < 1.96).mean()


def by_noise_alone(problems, B):
    return maximum_likelihood.estimate(PairSets(problems.A, B)).fit


@pytest.mark.parametrize("pairs", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_independent_errors_change_nothing(pairs):
    problems, B = sequences(pairs, 100, pairs, 0.0)
    factor = widening(by_noise_alone(problems, B), np.ones((100, pairs), dtype=bool))
    assert (factor > 1.0).any(axis=1).mean() < 0.04
    assert np.sqrt((factor**2).mean()) < 1.03
    assert 0.93 < covered(problems, solve_batch(problems.A, B)) < 0.975


@pytest.mark.slow
@pytest.mark.parametrize(("alike", "pairs", "least"), [(0.8, 20, 0.91), (0.8, 60, 0.92)])
def test_errors_that_follow_each_other_are_covered(alike, pairs, least):
    problems, B = sequences(1, 150, pairs, alike)
    assert covered(problems, by_noise_alone(problems, B)) < 0.88
    assert least < covered(problems, solve_batch(problems.A, B)) < 0.98


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ml", "ml-robust"])
def test_wrong_pairs_among_errors_that_follow_each_other_are_covered(method):
    """One in twenty is 5 to 50 mm and .5 to 5 deg off.

    Of 300 sets each of 20, 40 and 60 pairs .93 to .96 of all numbers were inside their intervals.
    """
    problems, B = sequences(5, 100, 20, 0.8)
    rng = np.random.default_rng(6)
    error = rng.standard_normal((100, 2, 3))
    error *= rng.uniform([[0.0087], [0.005]], [[0.087], [0.05]], (100, 2, 1)) / np.linalg.norm(
        error, axis=-1, keepdims=True
    )
    trials = np.arange(100)
    wrong = rng.integers(0, 20, 100)
    B[trials, wrong] = perturb(B[trials, wrong], error.reshape(100, 6))
    assert 0.90 < covered(problems, solve_batch(problems.A, B, method)) < 0.98


@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah"])
def test_all_methods_are_widened_and_covariances_stay_covariances(method):
    problems, B = sequences(2, 1, 40, 0.9)
    A, B = problems.A[0], B[0]
    along = solve(A, B, method)
    mixed = np.random.default_rng(0).permutation(len(A))
    other = solve(A[mixed], B[mixed], method)
    assert np.linalg.eigvalsh(along.covariance).min() > 0.0
    # the same pairs, and the same answer: in another order they say nothing of the sequence
    np.testing.assert_allclose(along.X, other.X, atol=1e-6)
    assert np.sqrt(np.trace(along.covariance) / np.trace(other.covariance)) > 1.3


def test_one_set_and_many_say_the_same():
    problems, B = sequences(3, 2, 40, 0.8)
    batch = solve_batch(problems.A, B)
    for k in range(2):
        one = solve(problems.A[k], B[k])
        np.testing.assert_allclose(batch.covariance[k], one.covariance, rtol=1e-5, atol=1e-16)


def test_few_pairs_have_no_runs():
    problems, B = sequences(4, 20, FEWEST_PAIRS - 1, 0.9)
    fit = by_noise_alone(problems, B)
    assert (widening(fit, np.ones((20, FEWEST_PAIRS - 1), dtype=bool)) == 1.0).all()
