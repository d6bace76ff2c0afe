"""The cost as a polynomial of the rotations, and its local minimum."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib import se3
from calib.robot_world import PairNoise, add_noise, random_problems
from calib.robot_world.certificate import Weights, cost_weights, minimise
from calib.robot_world.certificate.certify import derivatives
from calib.robot_world.certificate.polynomial import quadratic_form

NOISE = PairNoise(np.radians(0.5), 1e-3, "B")
WEIGHTS = cost_weights(NOISE)


def noisy(seed, trials, pairs, noise=NOISE, cone_deg=None):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    return problems, *add_noise(rng, problems.A, problems.B, noise)


def rotations(seed, count):
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


def brute_force(A, B, X, Z, weights=WEIGHTS):
    """The cost pair by pair, from the matrices A X and Z B."""
    difference = A @ X[:, None] - Z[:, None] @ B
    turns = (difference[..., :3, :3] ** 2).sum(axis=(1, 2, 3))
    return weights.rotation * turns + weights.translation * (difference[..., :3, 3] ** 2).sum(
        axis=(1, 2)
    )


@pytest.mark.parametrize("pairs", [3, 12])
def test_cost_is_that_of_all_pairs_with_the_best_translations(pairs):
    problems, A, B = noisy(1, 20, pairs)
    R_X, R_Z = rotations(2, 20), rotations(3, 20)
    form = quadratic_form(A, B, problems.X, problems.Z, WEIGHTS)
    turns = [np.swapaxes(T[:, :3, :3], 1, 2) @ R for T, R in ((problems.X, R_X), (problems.Z, R_Z))]
    X, Z = form.transforms(*turns)
    np.testing.assert_allclose(X[:, :3, :3], R_X, atol=1e-14)
    cost = form.cost(form.offset(R_X, R_Z))
    np.testing.assert_allclose(cost, brute_force(A, B, X, Z), rtol=1e-11)
    for axis in range(3):
        for T in (X, Z):
            for step in (-1e-4, 1e-4):
                T[:, axis, 3] += step
                assert (brute_force(A, B, X, Z) > cost).all()
                T[:, axis, 3] -= step


@pytest.mark.parametrize("side", ["A", "B"])
def test_cost_at_the_optimum_is_chi_square(side):
    trials, pairs = 1500, 6
    noise = PairNoise(np.radians(0.1), 4e-4, side)
    problems, A, B = noisy(4, trials, pairs, noise)
    X, Z = problems.X, problems.Z
    if side == "A":
        A, B, X, Z = B, A, se3.inverse(X), se3.inverse(Z)
    cost = minimise(A, B, X[:, :3, :3], Z[:, :3, :3], cost_weights(noise)).cost
    freedom = 6 * pairs - 12
    assert abs(cost.mean() - freedom) < 4.0 * np.sqrt(2.0 * freedom / trials)
    assert abs(cost.var() / (2.0 * freedom) - 1.0) < 0.25


def exact(a):
    return np.asarray(a, dtype=np.longdouble)


def least_over_translations(A, B, X, Z, u):
    """The cost at offsets u (K, 18) about X, Z in extended precision, by the adjugate."""
    A, B, X, Z = (exact(a) for a in (A, B, X, Z))
    U, V = exact(u[:, :9].reshape(-1, 1, 3, 3)), exact(u[:, 9:].reshape(-1, 1, 3, 3))
    R_A, R_B = A[:, :3, :3], B[:, :3, :3]
    eye = np.eye(3, dtype=np.longdouble)
    X_turned, Z_turned = X[:3, :3] @ (eye + U), Z[:3, :3] @ (eye + V)
    difference = R_A @ X_turned - Z_turned @ R_B
    turns = (difference**2).sum(axis=(1, 2, 3))
    e = (R_A @ X[:3, 3] + A[:, :3, 3] - Z[:3, 3]) - (Z_turned @ B[:, :3, 3:])[..., 0]
    centred, R = e - e.mean(axis=1, keepdims=True), R_A - R_A.mean(axis=0)
    normal = np.einsum("nab,nac->bc", R, R)
    right = np.einsum("nab,kna->kb", R, centred)
    a, b, c = normal
    adjugate = np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)]).T
    solved = right @ (adjugate / (a @ np.cross(b, c)))
    shifts = (centred**2).sum(axis=(1, 2)) - (right * solved).sum(axis=1)
    return WEIGHTS.rotation * turns + WEIGHTS.translation * shifts


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="needs extended precision")
@pytest.mark.parametrize("pairs", [3, 5, 40])
def test_rounding_stays_within_its_allowance(pairs):
    problems, A, B = noisy(5, 6, pairs, PairNoise(2e-4, 1e-5, "B"), 40.0)
    form = quadratic_form(A, B, problems.X, problems.Z, WEIGHTS)
    eye = np.eye(18)
    first, second = np.triu_indices(18)
    for t in range(6):
        points = np.concatenate([np.zeros((1, 18)), eye, -eye, eye[first] + eye[second]])
        f = least_over_translations(A[t], B[t], problems.X[t], problems.Z[t], points)
        zero, plus, minus, both = f[0], f[1:19], f[19:37], f[37:]
        quadratic = np.empty((18, 18), dtype=np.longdouble)
        quadratic[first, second] = (both - plus[first] - plus[second] + zero) / 2
        quadratic[second, first] = quadratic[first, second]
        linear = (plus - minus) / 4
        assert abs(form.constant[t] - zero) < form.constant_rounding[t]
        assert np.linalg.norm(np.float64(form.linear[t] - linear)) < form.rounding[t]
        assert np.linalg.norm(np.float64(form.quadratic[t] - quadratic), 2) < form.rounding[t]
        assert form.constant_rounding[t] < 1e-6 * form.constant[t]


def test_derivatives_on_the_rotations_match_central_differences():
    problems, A, B = noisy(6, 3, 5)
    form = quadratic_form(A, B, problems.X, problems.Z, WEIGHTS)
    turns = np.stack([rotations(7, 3), rotations(8, 3)], axis=1)

    def cost(w):
        moved = se3.rotation_exp(w.reshape(2, 3)) @ turns
        return form.cost((moved - np.eye(3)).reshape(3, 18))

    slope, curvature = derivatives(form.quadratic, form.linear, turns)
    h, eye = 1e-4, np.eye(6)
    for i in range(6):
        expected = (cost(h * eye[i]) - cost(-h * eye[i])) / (2 * h)
        np.testing.assert_allclose(slope[:, i], expected, rtol=1e-5, atol=1e-3)
        for j in range(6):
            corners = [
                s * r * cost(h * (s * eye[i] + r * eye[j])) for s in (1, -1) for r in (1, -1)
            ]
            expected = sum(corners) / (4 * h * h)
            scale = np.abs(curvature).max(axis=(1, 2))
            assert np.abs(curvature[:, i, j] - expected).max() < 1e-5 * scale.max()


@pytest.mark.parametrize("weights", [WEIGHTS, Weights(1.0, 1.0)])
def test_minimum_is_that_of_a_general_solver(weights):
    problems, A, B = noisy(9, 4, 6, PairNoise(np.radians(2.0), 5e-3, "B"))
    found = minimise(A, B, problems.X[:, :3, :3], problems.Z[:, :3, :3], weights)
    assert found.converged.all()
    roots = np.sqrt([weights.rotation, weights.translation])
    for t in range(4):

        def transforms(p, t=t):
            return [
                se3.transform(se3.rotation_exp(w) @ T[t, :3, :3], T[t, :3, 3] + v)
                for T, w, v in ((problems.X, p[0:3], p[3:6]), (problems.Z, p[6:9], p[9:12]))
            ]

        def residual(p, t=t):
            X, Z = transforms(p)
            difference = A[t] @ X - Z @ B[t]
            turn, shift = difference[:, :3, :3], difference[:, :3, 3]
            return np.concatenate([roots[0] * turn.ravel(), roots[1] * shift.ravel()])

        best = least_squares(residual, np.zeros(12), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        X, Z = transforms(best.x)
        np.testing.assert_allclose(found.cost[t], 2.0 * best.cost, rtol=1e-9)
        np.testing.assert_allclose(found.X[t], X, atol=1e-6)
        np.testing.assert_allclose(found.Z[t], Z, atol=1e-6)


def test_descent_from_anywhere_ends_where_the_slope_is_rounding():
    _, A, B = noisy(10, 100, 4, cone_deg=40.0)
    R_X, R_Z = rotations(11, 100), rotations(12, 100)
    found = minimise(A, B, R_X, R_Z, WEIGHTS)
    assert found.converged.all()
    assert np.median(found.iterations) < 20
    form = quadratic_form(A, B, found.X, found.Z, WEIGHTS)
    at = np.tile(np.eye(3), (100, 2, 1, 1))
    slope, curvature = derivatives(form.quadratic, form.linear, at)
    step = np.linalg.solve(curvature, slope[..., None])[..., 0]
    assert np.linalg.norm(step, axis=-1).max() < 1e-11
    assert np.linalg.eigvalsh(curvature)[:, 0].min() > 0.0
    start = quadratic_form(A, B, found.X, found.Z, WEIGHTS)
    assert (found.cost <= start.cost(start.offset(R_X, R_Z))).all()


def test_a_batch_is_its_problems_one_by_one():
    _, A, B = noisy(13, 5, 4)
    R_X, R_Z = rotations(14, 5), rotations(15, 5)
    together = minimise(A, B, R_X, R_Z, WEIGHTS)
    for t in range(5):
        alone = minimise(A[t : t + 1], B[t : t + 1], R_X[t : t + 1], R_Z[t : t + 1], WEIGHTS)
        np.testing.assert_allclose(alone.X[0], together.X[t], atol=1e-12)
        assert alone.iterations[0] == together.iterations[t]
