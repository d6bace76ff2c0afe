"""A cause that is not there is named in at most 1 of 200 sets, by all detectors together."""

import numpy as np
import pytest

from calib import se3
from calib.judgement import FALSE_ALARMS
from calib.robot_world import random_problems, solve
from calib.robot_world.noise import perturb
from tests.hostile_pairs import viewing_pairs

pytestmark = pytest.mark.slow

SIGMA = np.repeat([2e-3, 1e-3], 3)
COUNTS = (8, 10, 12, 15, 20, 30, 60)


def least_rate(hits: int, trials: int, z: float = 2.6) -> float:
    """Lower bound of a rate with 99.5 % confidence (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    rate, more = hits / trials, z**2 / trials
    half = z * np.sqrt(rate * (1.0 - rate) / trials + more / (4.0 * trials))
    return float((rate + more / 2.0 - half) / (1.0 + more))


def steady(seed):
    """Pairs without any cause: noise on B, on A, that grows with the distance, of heavy tails."""
    rng = np.random.default_rng(10_000 + seed)
    count, kind = int(rng.choice(COUNTS)), seed % 4
    problems = viewing_pairs(rng, count) if seed % 2 else random_problems(rng, 1, count, 40.0)
    A, B = problems.A[0], problems.B[0]
    error = rng.standard_normal((count, 6)) * SIGMA
    if kind == 1:
        return perturb(A, error), B
    if kind == 2:
        seen = se3.inverse(B)
        far = np.linalg.norm(seen[:, :3, 3], axis=1, keepdims=True)
        sight = seen[:, :3, 3] / far
        depth = (error[:, 3:] * sight).sum(axis=1, keepdims=True) * sight
        error[:, 3:] = far * (error[:, 3:] - depth) + 3.0 * far**2 * depth
        return A, se3.inverse(perturb(seen, error))
    if kind == 3:
        error *= np.sqrt(3.0 / rng.chisquare(4, count))[:, None]
    return A, perturb(B, error)


def test_steady_simulated_pairs():
    trials = 500
    named = sum(bool(solve(*steady(seed))._solution.causes) for seed in range(trials))
    assert least_rate(named, trials) < FALSE_ALARMS
