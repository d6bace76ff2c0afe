"""How noise is made, as far as residuals tell: shares of A and B, and growth with the distance."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import PairCovariances, PairNoise, random_problems, shown_noise, solve
from calib.robot_world.noise import difference, perturb
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
    rng = np.random.default_rng(pairs)
    for _ in range(15):
        problems = random_problems(rng, 1, pairs, cone_deg=40.0)
        noise = shown_noise(problems.A[0], perturb(problems.B[0], noise_of(rng, pairs)))
        assert isinstance(noise, PairNoise)
        assert noise.on == "B"
        assert 0.5 < noise.rotation_rad / SIGMA[0] < 1.6
        assert 0.5 < noise.translation_m / SIGMA[3] < 1.6


@pytest.mark.parametrize("inverse", [False, True])
def test_noise_that_grows_with_the_distance_is_found_and_used(inverse):
    rng = np.random.default_rng(1)
    plain, weighed, deviations = [], [], []
    for _ in range(15):
        A, B, X, Z = seen_from_afar(rng, 40, inverse=inverse)
        noise = shown_noise(A, B)
        assert isinstance(noise, PairCovariances)
        result = solve(A, B, "ml", noise)
        plain.append(off(solve(A, B), X, Z))
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
