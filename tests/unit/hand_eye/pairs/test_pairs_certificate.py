"""How far an answer is from the optimum that is proven, against the rise of chi² itself."""

from dataclasses import replace

import numpy as np
import pytest

from calib.robot_world import PairNoise, add_noise, certify, random_problems, residuals, solve
from calib.robot_world.noise import perturb
from calib.se3 import FloatArray
from posedesign.hand_eye.pairs.certificate import AT_THE_OPTIMUM, Proof, prove

NOISE = PairNoise(1e-3, 5e-4, on="B")


def measured() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(2)
    problem = random_problems(rng, 1, 15)
    return add_noise(rng, problem.A[0], problem.B[0], NOISE)


def chi2(A: FloatArray, B: FloatArray, X: FloatArray, Z: FloatArray) -> float:
    return float(((residuals(A, B, X, Z) / NOISE.sigma) ** 2).sum())


@pytest.mark.parametrize("times", [0.01, 0.04, 0.06, 0.5, 2.0])
@pytest.mark.parametrize("sides", ["X", "Z", "XZ"])
def test_sigmas_are_the_root_of_the_rise_of_chi2(times, sides):
    A, B = measured()
    result = solve(A, B, "ml", NOISE)
    assert result.covariance is not None
    rng = np.random.default_rng(3)
    step = rng.standard_normal(12) * np.sqrt(np.diag(result.covariance))
    if sides != "XZ":
        step[slice(6, 12) if sides == "X" else slice(0, 6)] = 0.0
    step *= times / np.sqrt(step @ np.linalg.inv(result.covariance) @ step)
    moved = replace(result, X=perturb(result.X, step[:6]), Z=perturb(result.Z, step[6:]))
    proof = Proof.of(moved, certify(A, B, moved.X, moved.Z, NOISE))
    rise = chi2(A, B, moved.X, moved.Z) - chi2(A, B, result.X, result.Z)
    assert proof.sigma == pytest.approx(np.sqrt(rise), rel=5e-3)
    assert proof.status == ("proven" if times < AT_THE_OPTIMUM else "away")
    assert ("the optimum proven is" in proof.message) == (proof.status == "away")
    # of one side alone it is less: the other may make up for it
    assert max(proof.sigma_X, proof.sigma_Z) <= proof.sigma * (1.0 + 1e-6)
    assert (proof.sigma_X < 1e-3) == (sides == "Z")
    assert (proof.sigma_Z < 1e-3) == (sides == "X")


def test_the_likeliest_is_at_the_optimum_and_others_are_not():
    A, B = measured()
    likeliest = prove(A, B, solve(A, B, "ml", NOISE))
    other = prove(A, B, solve(A, B, "tsai-lenz", NOISE))
    assert likeliest is not None
    assert other is not None
    assert likeliest.sigma < 1e-3
    assert likeliest.message.startswith("proven: ")
    assert other.status == "away"
    np.testing.assert_allclose(other.certificate.X, likeliest.certificate.X, atol=1e-9)
