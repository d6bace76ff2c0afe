"""Poses that are visited more than once: deviations count poses, and copies count once."""

import numpy as np
import pytest

from calib.robot_world import PairNoise, certify, difference, solve, solve_batch
from calib.robot_world.noise import perturb
from tests.hostile_pairs import viewing_pairs

OF_POSE = np.repeat([np.radians(0.15), 0.7e-3], 3)
OF_PAIR = np.repeat([np.radians(0.03), 0.1e-3], 3)


def visited(seed, *, poses=10, rounds=5, order="rounds", on="B"):
    """Pairs of poses that are visited in rounds, X and Z: an error is the same at each visit."""
    rng = np.random.default_rng(seed)
    problems = viewing_pairs(rng, poses)
    A, B = problems.A[0], problems.B[0]
    error = rng.standard_normal((poses, 6)) * OF_POSE
    A, B = (A, perturb(B, error)) if on == "B" else (perturb(A, error), B)
    A, B = np.tile(A, (rounds, 1, 1)), np.tile(B, (rounds, 1, 1))
    B = perturb(B, rng.standard_normal((len(B), 6)) * OF_PAIR)
    rows = {
        "rounds": np.arange(len(A)),
        "poses": np.argsort(np.arange(len(A)) % poses, kind="stable"),
        "mixed": rng.permutation(len(A)),
    }[order]
    return A[rows], B[rows], problems.X[0], problems.Z[0]


def off(X, Z, covariance, truth):
    error = np.concatenate([difference(X, truth[0]), difference(Z, truth[1])])
    return error / np.sqrt(np.diag(covariance))


def rms_of(trials, method="ml", **made):
    found = []
    for seed in range(trials):
        A, B, *truth = visited(seed, **made)
        result = solve(A, B, method)
        found.append(off(result.X, result.Z, result.covariance, truth))
    return np.sqrt(np.mean(np.square(found)))


@pytest.mark.parametrize("order", ["rounds", "mixed"])
def test_deviations_count_poses(order):
    """Counting rows, errors are 2.8 of the deviations."""
    assert 0.8 < rms_of(12, order=order) < 1.25


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah"])
@pytest.mark.parametrize("order", ["rounds", "poses", "mixed"])
def test_errors_over_deviations_are_one(order, method):
    """Student's t of some 18 degrees of freedom has a deviation of 1.06."""
    assert 0.9 < rms_of(100, method, order=order) < 1.15


@pytest.mark.parametrize("on", ["A", "B"])
def test_the_side_of_the_deviation_does_not_matter(on):
    assert 0.8 < rms_of(10, on=on, order="poses") < 1.3


def test_a_batch_counts_poses_as_a_single_set_does():
    A, B, *_ = visited(3, order="mixed")
    for method in ("ml", "ml-robust"):
        batch, single = solve_batch(A[None], B[None], method), solve(A, B, method)
        np.testing.assert_allclose(batch.X[0], single.X, atol=1e-9)
        np.testing.assert_allclose(batch.covariance[0], single.covariance, rtol=1e-4, atol=1e-14)


@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah"])
def test_exact_copies_count_once(method):
    A, B, *_ = visited(1, poses=12, rounds=1)
    once = solve(A, B, method)
    twice = solve(np.tile(A, (2, 1, 1)), np.tile(B, (2, 1, 1)), method)
    np.testing.assert_allclose(twice.X, once.X, atol=1e-9)
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-4, atol=1e-14)
    assert twice.used.tolist() == [True] * 12 + [False] * 12
    assert any("are copies of others" in text for text in twice.warnings)
    assert "left out" not in twice.message


def test_given_noise_that_explains_repeats_stands():
    """Visits with errors of their own share nothing."""
    rng = np.random.default_rng(0)
    problems = viewing_pairs(rng, 8)
    A, B = (np.tile(T[0], (4, 1, 1)) for T in (problems.A, problems.B))
    B = perturb(B, rng.standard_normal((len(B), 6)) * OF_PAIR)
    noise = PairNoise(float(OF_PAIR[0]), float(OF_PAIR[3]))
    result = solve(A, B, "ml", noise)
    plain = result._solution.likeliest
    assert plain.poses is None
    assert result.chi2_probability > 1e-3


def test_a_deviation_of_poses_leaves_the_proof_as_it_is():
    """It decides how certain X and Z are, so what is proven is what was found."""
    for seed in range(3):
        A, B, *_ = visited(seed)
        found = solve(A, B, "ml", "B")
        assert found._solution.likeliest.poses is not None
        proof = certify(A, B, found.X, found.Z, found.noise)
        assert proof.status == "optimal"
        assert proof.translation_moved_m.max() < 1e-7


@pytest.mark.slow
def test_errors_that_follow_each_other_beside_poses_are_counted_too():
    """A random walk of B along poses that are visited three times in a row."""
    found = []
    for seed in range(40):
        A, B, *truth = visited(seed, poses=20, rounds=3, order="poses")
        walk = np.cumsum(np.random.default_rng(seed).standard_normal((60, 6)) * OF_POSE / 3, axis=0)
        A = perturb(A, walk - walk.mean(axis=0))
        result = solve(A, B)
        found.append(off(result.X, result.Z, result.covariance, truth))
    assert np.sqrt(np.mean(np.square(found))) < 1.25
