"""The likeliest X and Z: the least of the likelihood, whatever the frames, units and order."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2, kstest

from calib import se3
from calib.batch_last import columns_of, matrices_of, rotation_exp, rotation_log
from calib.robot_world import (
    PairCovariances,
    PairNoise,
    PairSets,
    add_noise,
    difference,
    random_problems,
    solve,
    solve_batch,
)
from calib.robot_world.methods import maximum_likelihood
from calib.robot_world.noise import perturb
from calib.se3 import FloatArray

NOISE = {"rotation_rad": np.radians(0.5), "translation_m": 1e-3}


def noise_of(on):
    return PairNoise(**NOISE, on=on)


def camera_noise(rng, pairs=None):
    """Covariance of B in the axes of the camera: five times worse along its axis, correlated."""
    sigma = np.array([4.0, 4.0, 1.0, 1.0, 1.0, 5.0]) * np.repeat([1e-3, 5e-4], 3)
    if pairs is not None:
        sigma = sigma * rng.uniform(0.5, 2.0, (pairs, 1))
    correlation = np.eye(6)
    correlation[0, 4] = correlation[4, 0] = 0.6
    correlation[1, 3] = correlation[3, 1] = -0.6
    return PairCovariances(B=sigma[..., :, None] * correlation * sigma[..., None, :], axes="from")


def white(errors, noise, side):
    """Errors ``(N, 6)`` of one side as independent numbers of unit variance."""
    if isinstance(noise, PairNoise):
        return errors / noise.sigma
    root = np.linalg.inv(np.linalg.cholesky(getattr(noise, side)))
    return (root @ errors[..., None])[..., 0]


def likelihood_rows(A, B, noise, X, Z):
    """White errors of all measurements by errors of X and Z, and of every A where both sides err.

    The problem as it is written down; with errors on one side, the other one is true.
    """

    def rows(p):
        x, z = perturb(X, p[:6]), perturb(Z, p[6:12])
        if noise.on == "A":
            return white(difference(A, z @ B @ se3.inverse(x)), noise, "A").ravel()
        if noise.on == "B":
            return white(difference(B, se3.inverse(z) @ A @ x), noise, "B").ravel()
        a = perturb(A, p[12:].reshape(len(A), 6))
        of_B = difference(B, se3.inverse(z) @ a @ x)
        return np.concatenate(
            [white(difference(A, a), noise, "A"), white(of_B, noise, "B")]
        ).ravel()

    return rows


UNLIKE = np.diag([9.0, 1.0, 4.0, 25.0, 1.0, 1.0]) * np.repeat([4e-6, 1e-7], 3)
UNLIKE[0, 4] = UNLIKE[4, 0] = 0.5 * np.sqrt(UNLIKE[0, 0] * UNLIKE[4, 4])


@pytest.mark.parametrize("pairs", [3, 6])
@pytest.mark.parametrize(
    "noise",
    [
        PairNoise(**NOISE, on="B"),
        PairNoise(**NOISE, on="A"),
        PairNoise(**NOISE, on="both"),
        PairCovariances(B=UNLIKE),
        PairCovariances(A=UNLIKE),
        PairCovariances(A=UNLIKE, B=UNLIKE),
    ],
    ids=["B", "A", "both", "unlike B", "unlike A", "unlike both"],
)
def test_it_is_the_minimum_that_a_general_solver_finds(noise, pairs):
    """scipy's, with every true pose of A as an unknown of its own where both sides err."""
    rng = np.random.default_rng(pairs)
    problems = random_problems(rng, 1, pairs)
    A, B = add_noise(rng, problems.A[0], problems.B[0], noise)
    result = solve(A, B, "ml", noise)
    X, Z = problems.X[0], problems.Z[0]
    count = 12 + (6 * pairs if noise.on == "both" else 0)
    found = least_squares(
        likelihood_rows(A, B, noise, X, Z),
        np.zeros(count),
        jac="3-point",
        x_scale=np.resize(np.repeat([NOISE["rotation_rad"], NOISE["translation_m"]], 3), count),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    X, Z = perturb(X, found.x[:6]), perturb(Z, found.x[6:12])
    sigma = np.concatenate([result.sigma_X, result.sigma_Z])
    apart = np.concatenate([difference(result.X, X), difference(result.Z, Z)]) / sigma
    # its own differences leave a few parts in 1e6 of a standard deviation
    assert np.abs(apart).max() < 1e-4
    assert result.chi2 == pytest.approx(2.0 * found.cost, rel=1e-6)


def scattered(noise, pairs, trials, seed, *, given=True, cone_deg=None):
    """NEES ``(trials,)`` over random problems."""
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    measured = add_noise(rng, problems.A, problems.B, noise)
    found = solve_batch(*measured, "ml", noise if given else None)
    assert found.converged.all()
    error = np.concatenate(
        [difference(found.X, problems.X), difference(found.Z, problems.Z)], axis=-1
    )
    return np.einsum("ti,tij,tj->t", error, np.linalg.inv(found.covariance), error)


RNG = np.random.default_rng(9)
NOISES = {
    "B": noise_of("B"),
    "A": noise_of("A"),
    "both": noise_of("both"),
    "camera axes": camera_noise(RNG),
    "camera axes, pair by pair": camera_noise(RNG, 12),
    "both, covariances": PairCovariances(
        A=np.diag(np.repeat([1e-3, 2e-4], 3) ** 2), B=np.diag([3, 3, 1, 2, 2, 9.0]) * 1e-6
    ),
}


@pytest.fixture(scope="module", params=NOISES)
def nees(request) -> FloatArray:
    return scattered(NOISES[request.param], 12, 250, 1)


@pytest.mark.slow
def test_errors_are_chi_square_by_the_covariance(nees):
    tail = 1e-3
    low, high = chi2.ppf([tail / 2, 1.0 - tail / 2], 12 * len(nees)) / len(nees)
    assert low < nees.mean() < high
    assert kstest(nees, chi2(12).cdf).pvalue > tail


def test_the_chi_square_test_sees_a_wrong_covariance():
    nees = scattered(NOISES["B"], 12, 100, 1)
    for ratio in (0.5, 2.0):
        assert kstest(nees * ratio, chi2(12).cdf).pvalue < 1e-6


@pytest.mark.slow
def test_errors_with_estimated_noise_are_as_wide_as_few_degrees_of_freedom_make_them():
    """Rotations and translations share 6 N - 12 = 108: an F test of 12 and that many, nearly."""
    nees = scattered(noise_of("B"), 20, 200, 2, given=False)
    expected, deviation = 12.0 * 108 / 106, np.sqrt(2 * 12.0 / len(nees))
    # of each part half the residuals, so twice the excess at most
    assert expected - 4 * deviation < nees.mean() < 12.0 * 54 / 52 + 4 * deviation


def chi_squares(noise, pairs, trials, seed, scale=1.0):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs)
    A, B = add_noise(rng, problems.A, problems.B, noise)
    claimed = PairNoise(noise.rotation_rad * scale, noise.translation_m * scale, noise.on)
    return [solve(a, b, "ml", claimed) for a, b in zip(A, B, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize("on", ["B", "A", "both"])
def test_probabilities_of_chi_square_are_uniform(on):
    found = chi_squares(noise_of(on), 6, 60, 3)
    assert {result.freedom for result in found} == {24}
    assert kstest([result.chi2_probability for result in found], "uniform").pvalue > 1e-3


def test_noise_that_is_too_small_is_scaled_up_to_the_residuals():
    right = chi_squares(noise_of("B"), 20, 5, 4)
    small = chi_squares(noise_of("B"), 20, 5, 4, scale=0.2)
    for good, bad in zip(right, small, strict=True):
        assert "times the noise given" not in good.message
        assert "times the noise given" in bad.message
        assert bad.chi2 == pytest.approx(25.0 * good.chi2, rel=1e-6)
        excess = np.sqrt(bad.chi2 / bad.freedom)
        np.testing.assert_allclose(bad.sigma_X, 0.2 * excess * good.sigma_X, rtol=1e-6)
        np.testing.assert_allclose(bad.X, good.X, atol=1e-9)


def test_estimated_noise_is_unbiased():
    """Its square: of 3 N - 6 degrees of freedom each, T times."""
    rng = np.random.default_rng(5)
    T, N = 300, 20
    problems = random_problems(rng, T, N)
    sets = PairSets(*add_noise(rng, problems.A, problems.B, noise_of("B")))
    sigma = maximum_likelihood.estimate(sets).sigma
    true = np.array([[NOISE["rotation_rad"]], [NOISE["translation_m"]]])
    square = (sigma / true) ** 2
    # some of the twelve are decided by both: none of the rows has fewer than 3 N - 12
    deviation = np.sqrt(2.0 / (3 * N - 12)) / np.sqrt(T)
    np.testing.assert_allclose(square.mean(axis=1), 1.0, atol=4.0 * deviation)


def test_estimated_noise_does_not_depend_on_the_others_in_the_batch():
    rng = np.random.default_rng(6)
    problems = random_problems(rng, 5, 8)
    A, B = add_noise(rng, problems.A, problems.B, noise_of("B"))
    together = maximum_likelihood.estimate(PairSets(A, B))
    for trial in range(5):
        alone = maximum_likelihood.estimate(PairSets(A[trial, None], B[trial, None]))
        np.testing.assert_allclose(alone.sigma[:, 0], together.sigma[:, trial], rtol=1e-7)
        np.testing.assert_allclose(alone.X[0], together.X[trial], atol=1e-9)


def test_unit_of_length_of_noise_and_pairs_changes_nothing():
    rng = np.random.default_rng(7)
    problems = random_problems(rng, 20, 6)
    for on in ("B", "A", "both"):
        A, B = add_noise(rng, problems.A, problems.B, noise_of(on))
        metres = solve_batch(A, B, "ml", noise_of(on))
        other = PairNoise(NOISE["rotation_rad"], NOISE["translation_m"] * 1e3, on)
        A_mm, B_mm = A.copy(), B.copy()
        A_mm[..., :3, 3] *= 1e3
        B_mm[..., :3, 3] *= 1e3
        found = solve_batch(A_mm, B_mm, "ml", other)
        for T, reference in ((found.X, metres.X), (found.Z, metres.Z)):
            T[..., :3, 3] /= 1e3
            np.testing.assert_allclose(T, reference, atol=1e-9)


def adjoint(T):
    """Errors (w, v) of B @ C in the axes of its own frame, by those of B in its own, C given.

    In own axes an error turns about the origin: B_est = B [exp w, v].
    """
    R_t, p = T[:3, :3].T, T[:3, 3]
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R_t
    out[3:, :3] = -R_t @ se3.skew(p)
    return out


@pytest.mark.parametrize("per_pair", [False, True])
def test_another_frame_of_the_camera_changes_nothing_with_the_noise_carried_along(per_pair):
    """B_other = B C: the errors of B move its origin, so their covariance changes by an adjoint.

    The likelihood is that of B's measured rotation and position: to first order in the noise the
    same in both frames, so the noise is small here.
    """
    rng = np.random.default_rng(8)
    noise = camera_noise(rng, 10 if per_pair else None)
    noise = PairCovariances(B=np.asarray(noise.B) * 1e-8, axes="from")
    problems = random_problems(rng, 1, 10)
    A, B = add_noise(rng, problems.A, problems.B, noise)
    C = se3.transform(se3.rotation_exp([0.4, -1.0, 0.7]), [0.1, -0.2, 0.4])
    to_other = adjoint(C)
    carried = PairCovariances(B=to_other @ np.asarray(noise.B) @ to_other.T, axes="from")
    plain = solve_batch(A, B, "ml", noise)
    other = solve_batch(A, B @ C, "ml", carried)
    np.testing.assert_allclose(other.X @ se3.inverse(C), plain.X, atol=1e-9)
    np.testing.assert_allclose(other.Z, plain.Z, atol=1e-9)
    # the same with the noise left behind is seen
    wrong = solve_batch(A, B @ C, "ml", noise)
    assert np.abs(wrong.Z - plain.Z).max() > 1e-8


def test_isotropic_covariances_are_the_isotropic_noise():
    rng = np.random.default_rng(10)
    problems = random_problems(rng, 8, 7)
    C = np.diag(np.repeat([NOISE["rotation_rad"], NOISE["translation_m"]], 3) ** 2)
    given = {
        "B": PairCovariances(B=C),
        "A": PairCovariances(A=C),
        "both": PairCovariances(A=C, B=np.tile(C, (7, 1, 1))),
    }
    for on, general in given.items():
        A, B = add_noise(rng, problems.A, problems.B, noise_of(on))
        plain, other = solve_batch(A, B, "ml", noise_of(on)), solve_batch(A, B, "ml", general)
        np.testing.assert_allclose(other.X, plain.X, atol=1e-10)
        np.testing.assert_allclose(other.Z, plain.Z, atol=1e-10)
        size = np.sqrt(np.diagonal(plain.covariance, axis1=1, axis2=2))
        scale = size[:, :, None] * size[:, None, :]
        # the second order in the noise differs
        np.testing.assert_allclose(other.covariance / scale, plain.covariance / scale, atol=1e-4)


def test_a_side_that_is_all_but_exact_is_like_an_exact_one():
    rng = np.random.default_rng(11)
    problems = random_problems(rng, 5, 8)
    A, B = add_noise(rng, problems.A, problems.B, noise_of("B"))
    C = np.diag(noise_of("B").sigma ** 2)
    one = solve_batch(A, B, "ml", noise_of("B"))
    nearly = solve_batch(A, B, "ml", PairCovariances(A=C * 1e-10, B=C))
    np.testing.assert_allclose(nearly.X, one.X, atol=1e-8)


def test_exact_without_noise_in_the_pairs():
    problems = random_problems(np.random.default_rng(12), 20, 5)
    for noise in (None, noise_of("both"), camera_noise(RNG)):
        found = solve_batch(problems.A, problems.B, "ml", noise)
        assert found.ok.all()
        np.testing.assert_allclose(found.X, problems.X, atol=1e-9)


def test_rotations_with_the_posture_last_are_those_of_se3():
    rng = np.random.default_rng(14)
    axes = rng.normal(size=(60, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.concatenate(
        [[0.0, 1e-300, 1e-12, 1e-5, np.pi - 1e-9, np.pi - 1e-4, 2.69, 2.7], rng.uniform(0, 3.1, 52)]
    )
    vectors = axes * angles[:, None]
    R = se3.rotation_exp(vectors)
    np.testing.assert_allclose(matrices_of(rotation_exp(vectors.T)), R, atol=1e-15)
    np.testing.assert_allclose(rotation_log(columns_of(R)).T, vectors, atol=1e-12)
    half = rotation_log(columns_of(se3.rotation_exp(np.pi * axes))).T
    np.testing.assert_allclose(np.linalg.norm(half, axis=1), np.pi, atol=1e-12)
