"""The scale of B's translations: found, said, corrected, with its standard deviation."""

import re

import numpy as np
import pytest

from calib import se3
from calib.errors import NotIdentifiableError
from calib.robot_world import METHODS, PairNoise, add_noise, difference, random_problems, solve
from tests.hostile_pairs import viewing_pairs

NOISE = PairNoise(np.radians(0.1), 1e-3)
FACTORS = (0.5, 0.8, 0.97, 1.03, 1.25, 2.0, 3.0)
OFTEN = 0.5, 0.97, 1.25, 3.0
EXACT = [name for name in METHODS if "literal" not in name and name != "andreff"]


def looking(seed, pairs=20, factor=1.0, noise=NOISE):
    """Pairs of a camera that looks at a target whose size is said to be so many times its own."""
    rng = np.random.default_rng(seed)
    problems = viewing_pairs(rng, pairs)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    B = B.copy()
    B[:, :3, 3] *= factor
    return A, B, problems


@pytest.mark.parametrize("method", ["ml", "ml-robust", "shah", "li-kronecker", "tsai-lenz"])
@pytest.mark.parametrize(
    ("factor", "seeds"),
    [
        *((factor, range(1)) for factor in OFTEN),
        *(pytest.param(f, range(f in OFTEN, 3), marks=pytest.mark.slow) for f in FACTORS),
    ],
)
def test_a_wrong_scale_is_never_ok(method, factor, seeds):
    for seed in seeds:
        A, B, problems = looking(seed, factor=factor)
        result = solve(A, B, method)
        assert result.status == "doubtful"
        if not any("belong together" in text or "standard dev" in text for text in result.warnings):
            pytest.fail(f"the scale is not named: {result.warnings}")
        if result.scale is not None:
            assert abs(result.scale.value * factor - 1.0) < 5.0 * result.scale.sigma * factor
        assert np.linalg.norm(result.X[:3, 3] - problems.X[0, :3, 3]) > 5e-3


@pytest.mark.parametrize(
    ("method", "noise"), [*((method, None) for method in EXACT), ("ml", NOISE), ("shah", NOISE)]
)
def test_the_scale_is_corrected_on_request(method, noise):
    A, B, problems = looking(5, factor=2.0)
    result = solve(A, B, method, noise, estimate_scale=True)
    assert result.status == "ok", result.message
    assert result.scale_estimated
    assert "multiplied by 0." in result.message
    assert abs(result.scale.value - 0.5) < 4.0 * result.scale.sigma < 0.02
    assert result.scale.covariance.shape == (13, 13)
    np.testing.assert_allclose(result.scale.covariance[:12, :12], result.covariance)
    error = np.concatenate(
        [difference(result.X, problems.X[0]), difference(result.Z, problems.Z[0])]
    )
    assert (np.abs(error) < 5.0 * np.sqrt(np.diag(result.covariance))).all()
    assert result.translation_rms_m < 3e-3


@pytest.mark.slow
def test_a_scale_of_one_is_rarely_doubted():
    """In one of 10,000 sets by chance; here in none of 40."""
    results = [solve(*looking(100 + seed)[:2]) for seed in range(40)]
    assert [result.message for result in results if result.status != "ok"] == []
    assert [
        result.warnings for result in results if "translations of B" in str(result.warnings)
    ] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("on", "sets"),
    [("both", 60), *(pytest.param(on, 1000, marks=pytest.mark.full) for on in ("A", "B", "both"))],
)
def test_a_scale_of_one_is_rarely_doubted_of_many(on, sets):
    """Noise on A as well, which the solver does not know of: at most 3 of 1,000 are named."""
    named = 0
    noise = PairNoise(NOISE.rotation_rad, NOISE.translation_m, on)
    for seed in range(sets):
        named += "translations of B" in str(solve(*looking(seed, noise=noise)[:2]).warnings)
    assert named <= 3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ml", "shah"])
def test_covariance_with_the_scale_is_the_scatter(method):
    rng = np.random.default_rng(3)
    problems = viewing_pairs(rng, 15)
    trials, small = 100, PairNoise(5e-4, 5e-4)
    errors = []
    for _ in range(trials):
        A, B = add_noise(rng, problems.A[0], problems.B[0], small)
        result = solve(A, B, method, small, estimate_scale=True)
        errors.append(
            np.concatenate(
                [
                    difference(result.X, problems.X[0]),
                    difference(result.Z, problems.Z[0]),
                    [result.scale.value - 1.0],
                ]
            )
            if method == "ml"
            else np.concatenate(
                [difference(result.X, problems.X[0]), difference(result.Z, problems.Z[0])]
            )
        )
    observed = np.array(errors).T @ np.array(errors) / trials
    predicted = solve(
        problems.A[0], problems.B[0], method, small, estimate_scale=True
    ).scale.covariance[: len(observed), : len(observed)]
    whitener = np.linalg.inv(np.linalg.cholesky(predicted))
    ratio = np.linalg.eigvalsh(whitener @ observed @ whitener.T)
    spread = (np.sqrt(13) + 4.0) / np.sqrt(trials)
    assert ratio[0] > (1.0 - spread) ** 2
    assert ratio[-1] < (1.0 + spread) ** 2


def test_the_scale_adds_to_the_covariance():
    A, B, _ = looking(1)
    with_it, without = solve(A, B, estimate_scale=True), solve(A, B)
    assert with_it.sigma_X[3:].max() > 1.5 * without.sigma_X[3:].max()


def test_a_wrong_unit_of_the_robot_is_the_same_seen_from_the_other_side():
    A, B, problems = looking(2)
    A = A.copy()
    A[:, :3, 3] *= 2.0
    result = solve(A, B, estimate_scale=True)
    assert abs(result.scale.value - 2.0) < 4.0 * result.scale.sigma
    np.testing.assert_allclose(result.X[:3, 3], 2.0 * problems.X[0, :3, 3], atol=0.02)
    assert "or the unit of A" in str(solve(A, B).warnings)


@pytest.mark.parametrize("factor", [1e-3, 0.1, 10.0, 1e3])
def test_units_of_length_are_told(factor):
    A, B, _ = looking(3, factor=factor)
    assert solve(A, B).status != "ok"
    assert abs(solve(A, B, estimate_scale=True).scale.value * factor - 1.0) < 0.02


def test_motion_that_does_not_tell_the_scale_is_said():
    """A flange that turns in one place: X, Z and B may all be as long as they like."""
    problems = random_problems(np.random.default_rng(4), 1, 12, 30.0)
    A = problems.A[0].copy()
    A[:, :3, 3] = [0.4, 0.1, 0.3]
    X, Z = problems.X[0], problems.Z[0]
    A, B = add_noise(np.random.default_rng(5), A, se3.inverse(Z) @ A @ X, NOISE)
    result = solve(A, B)
    assert not result.scale.is_told
    assert "the pairs tell the scale of B's translations not at all" in str(result.warnings)
    with pytest.raises(NotIdentifiableError, match="the scale of B"):
        solve(A, B, estimate_scale=True)


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_it_does_not_depend_on_the_unit_of_length(unit):
    A, B, _ = looking(7, factor=1.1)
    expected = solve(A, B).scale
    A, B = A.copy(), B.copy()
    A[:, :3, 3] *= unit
    B[:, :3, 3] *= unit
    found = solve(A, B).scale
    assert found.value == pytest.approx(expected.value, rel=1e-4)
    assert found.sigma == pytest.approx(expected.sigma, rel=1e-3)


def test_summary_says_the_scale():
    A, B, _ = looking(8, factor=0.9)
    result = solve(A, B)
    assert re.search(r"scale of B's translations 1\.1?[01]", result.summary())
    assert "doubtful" in result.summary()
