"""A target or a camera that was moved half-way, and clocks that differ: named, never silent."""

import numpy as np
import pytest

from calib import se3
from calib.robot_world import random_problems, solve, solve_batch
from calib.robot_world.noise import perturb
from tests.hostile_pairs import viewing_pairs

SIGMA = np.repeat([2e-3, 1e-3], 3)
BUMP = np.concatenate([np.radians(0.3) * np.array([0.6, 0.0, 0.8]), [3e-3, -4e-3, 0.0]])


def along_a_path(seed, pairs, *, delay=0.0):
    """A smooth path of A, a few degrees a step, B taken ``delay`` steps before it; X, Z."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(0.5, 2.0, (6, 3, 1)), rng.uniform(0.0, 2.0 * np.pi, (6, 3, 1))

    def poses(at):
        y = np.sin(0.3 * rate * at + phase).sum(axis=1) / np.sqrt(3.0)
        return se3.transform(se3.rotation_exp(0.5 * y[:3].T), 0.3 * y[3:].T)

    problems = random_problems(rng, 1, 3)
    X, Z = problems.X[0], problems.Z[0]
    at = np.arange(pairs)
    return poses(at), se3.inverse(Z) @ poses(at - delay) @ X, X, Z, rng


def noisy(rng, B):
    return perturb(B, rng.standard_normal((len(B), 6)) * SIGMA)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("what", ["X", "Z"])
def test_what_was_moved_half_way_is_named(what, seed):
    A, B, X, Z, rng = along_a_path(seed, 40)
    X_after, Z_after = (perturb(X, BUMP), Z) if what == "X" else (X, perturb(Z, BUMP))
    B[22:] = (se3.inverse(Z_after) @ A @ X_after)[22:]
    result = solve(A, noisy(rng, B))
    assert result.status == "doubtful"
    (said,) = [text for text in result.warnings if "seems to have moved at pair" in text]
    assert said.startswith(what)
    assert abs(int(said.split("pair ")[1].split(" ")[0]) - 23) <= 2


@pytest.mark.parametrize("moved", [False, True])
def test_noise_of_A_and_a_step_are_told_apart(moved):
    """Each is named where it is there, and what explains more keeps the other from being named."""
    for seed in range(4):
        A, B, X, Z, rng = along_a_path(seed, 60)
        if moved:
            B[30:] = (se3.inverse(perturb(Z, 2.0 * BUMP)) @ A @ X)[30:]
        A = perturb(A, rng.standard_normal((60, 6)) * np.repeat([4e-3, 2e-4], 3))
        B = perturb(B, rng.standard_normal((60, 6)) * np.repeat([5e-4, 5e-4], 3))
        result = solve(A, B)
        assert any("seems to have moved at pair" in text for text in result.warnings) == moved
        assert ("is of A" in result.noise_made) != moved


@pytest.mark.parametrize("delay", [0.2, 0.5, -0.5])
def test_a_delay_is_named_with_its_size(delay):
    A, B, _, _, rng = along_a_path(3, 40, delay=delay)
    result = solve(A, noisy(rng, B))
    assert result.status == "doubtful"
    way = "later" if delay > 0 else "earlier"
    assert f"{abs(delay):.1g}" in result.warnings[0]
    assert way in result.warnings[0]


def test_a_drift_of_few_pairs_is_named():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        problem = viewing_pairs(rng, 8)
        B = noisy(rng, problem.B[0])
        B[:, :3, 3] += np.linspace(0.0, 1.0, 8)[:, None] * [0.03, -0.02, 0.03]
        result = solve(problem.A[0], B)
        assert result.status == "doubtful"
        assert any("seems to have drifted by" in text for text in result.warnings)


@pytest.mark.parametrize("pairs", [8, 11])
def test_few_steady_pairs_are_not_said_to_drift(pairs):
    rng = np.random.default_rng(pairs)
    for _ in range(6):
        problem = viewing_pairs(rng, pairs)
        assert not solve(problem.A[0], noisy(rng, problem.B[0])).drift


def test_steady_pairs_are_not_doubted():
    rng = np.random.default_rng(0)
    sets = [along_a_path(seed, 30)[:2] for seed in range(20)]
    sets += [(p.A[0], p.B[0]) for p in (viewing_pairs(rng, 30) for _ in range(20))]
    A, B = np.array([A for A, _ in sets]), np.array([noisy(rng, B) for _, B in sets])
    assert solve_batch(A, B).doubtful.mean() <= 0.01


def test_one_set_and_many_are_doubted_alike():
    A, B, _, _, rng = along_a_path(3, 40, delay=0.5)
    B = noisy(rng, B)
    for method in ("ml", "ml-robust"):
        batch = solve_batch(A[None], B[None], method)
        assert batch.doubtful[0] == (solve(A, B, method).status == "doubtful")
