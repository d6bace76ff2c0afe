"""Both forms of Dornaika and Horaud 1998 against their definitions."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib import se3
from calib.robot_world import PairNoise, PairSets, add_noise, random_problems, solve_batch
from calib.robot_world.algebra import left_matrix, right_matrix
from calib.robot_world.methods import dornaika_horaud
from calib.robot_world.noise import difference, perturb


def noisy(seed, trials, pairs, cone_deg=None):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    return add_noise(rng, problems.A, problems.B, PairNoise(np.radians(0.5), 1e-3, "both"))


@pytest.mark.parametrize("cone_deg", [None, 30.0])
def test_closed_form_is_the_smallest_eigenvalue_of_both_quaternions(cone_deg):
    """``Σ |a x - z b|²`` over unit x and z, by the eigenvectors of CᵀC and CCᵀ."""
    A, B = noisy(1, 5, 7, cone_deg)
    found = solve_batch(A, B, "dornaika-horaud")
    a, b = PairSets(A, B).quaternions
    for trial in range(5):
        C = sum(left_matrix(p).T @ right_matrix(q) for p, q in zip(a[trial], b[trial], strict=True))
        x, z = np.linalg.eigh(C @ C.T)[1][:, 3], np.linalg.eigh(C.T @ C)[1][:, 3]
        np.testing.assert_allclose(
            found.X[trial, :3, :3], se3.rotation_from_quaternion(x), atol=1e-9
        )
        np.testing.assert_allclose(
            found.Z[trial, :3, :3], se3.rotation_from_quaternion(z), atol=1e-9
        )


def test_closed_form_is_where_hirsh_ends():
    A, B = noisy(2, 50, 6)
    closed, iterated = (solve_batch(A, B, name) for name in ("dornaika-horaud", "hirsh"))
    np.testing.assert_allclose(closed.X, iterated.X, atol=1e-9)
    np.testing.assert_allclose(closed.Z, iterated.Z, atol=1e-9)


def residuals(A, B, R_X, p_X, R_Z, p_Z):
    turn = A[:, :3, :3] @ R_X - R_Z @ B[:, :3, :3]
    shift = A[:, :3, :3] @ p_X + A[:, :3, 3] - B[:, :3, 3] @ R_Z.T - p_Z
    return np.concatenate([turn.ravel(), shift.ravel()])


@pytest.mark.parametrize("pairs", [3, 8])
def test_nonlinear_is_the_minimum_of_the_sum_of_both(pairs):
    A, B = noisy(3, 4, pairs)
    found = solve_batch(A, B, "dornaika-horaud-nonlinear")
    assert found.converged.all()
    for trial in range(4):
        X, Z = found.X[trial], found.Z[trial]
        start = np.random.default_rng(trial).normal(scale=0.02, size=12)

        def cost(error, a=A[trial], b=B[trial], X=X, Z=Z):
            X, Z = perturb(X, error[:6]), perturb(Z, error[6:])
            return residuals(a, b, X[:3, :3], X[:3, 3], Z[:3, :3], Z[:3, 3])

        end = least_squares(cost, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(end, 0.0, atol=1e-7)


def test_penalties_of_the_paper_lead_to_the_same_place():
    """All 24 numbers free, |RᵀR - 1|² weighted by 1e6, as printed."""
    A, B = noisy(4, 1, 8)
    found = solve_batch(A, B, "dornaika-horaud-nonlinear")
    start = np.concatenate(
        [part.ravel() for T in (found.X[0], found.Z[0]) for part in (T[:3, :3], T[:3, 3])]
    )

    def cost(u):
        R_X, R_Z = u[:9].reshape(3, 3), u[12:21].reshape(3, 3)
        penalties = [1e3 * (R.T @ R - np.eye(3)).ravel() for R in (R_X, R_Z)]
        return np.concatenate([residuals(A[0], B[0], R_X, u[9:12], R_Z, u[21:]), *penalties])

    moved = start + np.random.default_rng(5).normal(scale=1e-3, size=24)
    end = least_squares(cost, moved, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    np.testing.assert_allclose(end, start, atol=1e-6)


def test_nonlinear_depends_on_the_unit_of_length():
    A, B = noisy(6, 50, 8)
    metres = dornaika_horaud.estimate_nonlinear(PairSets(A, B))
    millimetres = [T.copy() for T in (A, B)]
    for T in millimetres:
        T[..., :3, 3] *= 1e3
    other = dornaika_horaud.estimate_nonlinear(PairSets(*millimetres))
    turn = difference(other.Z, metres.Z)[:, :3]
    assert np.median(np.linalg.norm(turn, axis=-1)) > 1e-4
