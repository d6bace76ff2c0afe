"""Only what identifies X and Z, and predicts the pairs left out, is ok; by every method."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import METHODS, PairNoise, add_noise, solve, solve_batch
from tests.hostile_pairs import viewing_pairs


def looking(seed, pairs, noise, **view):
    rng = np.random.default_rng(seed)
    problems = viewing_pairs(rng, pairs, **view)
    return add_noise(rng, problems.A[0], problems.B[0], noise)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "hirsh-literal"])
def test_absurd_standard_deviations_are_not_ok(method):
    """Poses that turn by some degrees, seen by a camera that is off by a degree."""
    A, B = looking(1, 30, PairNoise(np.radians(1.0), 3e-3), tilt_deg=4.0, roll_deg=2.0)
    result = solve(A, B, method)
    assert result.status != "ok"
    if result.status == "doubtful" and not result.warnings:
        assert "do not identify X and Z by this method" in result.message
        assert "known least are rotation of" in result.message


@pytest.mark.parametrize("method", ["ml", "ml-robust"])
def test_nor_in_a_batch(method):
    A, B = looking(1, 30, PairNoise(np.radians(1.0), 3e-3), tilt_deg=4.0, roll_deg=2.0)
    assert not solve_batch(A[None], B[None], method).ok.any()


@pytest.mark.parametrize("method", ["shah", "park-martin"])
def test_pairs_that_single_ones_decide_are_not_ok(method):
    """Nine poses turned about nearly one axis, and one that turns otherwise."""
    rng = np.random.default_rng(2)
    vectors = np.linspace(-1.0, 1.0, 10)[:, None] * [0.0, 0.0, 1.0]
    vectors += rng.normal(scale=2e-3, size=vectors.shape)
    vectors[4] = [0.8, -0.3, 0.1]
    A = se3.transform(se3.rotation_exp(vectors), rng.uniform(-0.4, 0.4, (10, 3)))
    X, Z = viewing_pairs(rng, 1).X[0], viewing_pairs(rng, 1).Z[0]
    A, B = add_noise(rng, A, se3.inverse(Z) @ A @ X, PairNoise(1e-3, 1e-3))
    result = solve(A, B, method)
    assert result.status == "doubtful"
    assert "pairs that are left out are off by" in result.message


def test_good_pairs_are_ok():
    for seed in range(40):
        result = solve(*looking(seed, 12, PairNoise(np.radians(0.1), 1e-3)))
        assert (result.status, result.warnings) == ("ok", ()), result.message
