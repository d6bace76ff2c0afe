"""Lower bounds of the cost: the equations, the multipliers, the semidefinite problems."""

import warnings
from functools import cache

import cvxpy as cp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.robot_world import PairNoise, add_noise, random_problems
from calib.robot_world.certificate import cost_weights, minimise
from calib.robot_world.certificate.dual import (
    balanced_multipliers,
    best_multipliers,
    least_multipliers,
    lower_bound,
    minimise_first,
    relaxed_minimum,
    rotation_constraints,
)
from calib.robot_world.certificate.polynomial import quadratic_form


def rotations(rng, *shape):
    return Rotation.random(int(np.prod(shape)), rng=rng).as_matrix().reshape(*shape, 3, 3)


@cache
def hard_problems(seed, trials=20, pairs=3, noise_deg=2.0):
    """Few pairs in a cone: the cost has several minima. The best of many starts is global."""
    rng = np.random.default_rng(seed)
    noise = PairNoise(np.radians(noise_deg), 4e-3, "B")
    weights = cost_weights(noise)
    problems = random_problems(rng, trials, pairs, 40.0)
    A, B = add_noise(rng, problems.A, problems.B, noise)
    starts = [minimise(A, B, *rotations(rng, 2, trials), weights) for _ in range(12)]
    best = np.min([start.cost for start in starts], axis=0)
    return A, B, weights, starts[0], best


def test_equations_are_all_that_hold_on_rotations():
    rng = np.random.default_rng(1)
    equations = rotation_constraints()
    U = (rotations(rng, 400) - np.eye(3)).reshape(400, 9)
    values = 2.0 * U @ equations.slopes.T + np.einsum("ta,kab,tb->tk", U, equations.bends, U)
    assert np.abs(values).max() < 1e-13
    flat = np.einsum("ta,kab,tb->tk", U, equations.flat, U)
    assert np.abs(flat).max() < 1e-13
    # brute force: monomials of degree up to two that are dependent on random rotations
    first, second = np.triu_indices(9)
    monomials = np.hstack([np.ones((400, 1)), U, U[:, first] * U[:, second]])
    assert monomials.shape[1] - np.linalg.matrix_rank(monomials) == len(equations.bends) == 20
    assert len(equations.flat) == 20 - np.linalg.matrix_rank(equations.slopes) == 14


def test_any_multipliers_give_a_bound():
    rng = np.random.default_rng(2)
    A, B, weights, found, best = hard_problems(4)
    anywhere = quadratic_form(A, B, found.X, found.Z, weights)
    for form in (anywhere, quadratic_form(A, B, found.X[::-1], found.Z[::-1], weights)):
        least = least_multipliers(form)
        size = np.linalg.norm(form.quadratic, axis=(1, 2))[:, None]
        for scale in (0.0, 1e-6, 1e-4, 1e-2, 1.0):
            random = rng.normal(size=least.shape) * scale * size
            for multipliers in (random, least + random):
                bound = lower_bound(form, multipliers).value
                assert (bound <= best).all()
                for _ in range(5):
                    u = form.offset(*rotations(rng, 2, 200, len(best)))
                    assert (bound <= form.cost(u)).all()


def test_bound_is_tight_at_the_optimum_only():
    A, B, weights, found, best = hard_problems(4)
    wrong = found.cost > best * (1.0 + 1e-6)
    assert 3 < wrong.sum() < 17
    form = quadratic_form(A, B, found.X, found.Z, weights)
    for t in range(len(best)):
        one = quadratic_form(A[t : t + 1], B[t : t + 1], found.X[[t]], found.Z[[t]], weights)
        bound = lower_bound(one, balanced_multipliers(one)).value[0]
        assert bound <= best[t]
        if not wrong[t]:
            assert bound > best[t] * (1.0 - 1e-7)
    assert (lower_bound(form, least_multipliers(form)).value <= best).all()


def test_best_multipliers_find_the_optimum_from_a_wrong_minimum():
    A, B, weights, found, best = hard_problems(4)
    tried = 0
    for t in np.flatnonzero(found.cost > 1.5 * best)[:3]:
        pairs = A[t : t + 1], B[t : t + 1]
        form = quadratic_form(*pairs, found.X[[t]], found.Z[[t]], weights)
        multipliers = best_multipliers(form)
        bound = lower_bound(form, multipliers).value[0]
        assert bound <= best[t]
        assert bound > best[t] - 1e-3 * found.cost[t]
        U, _, Vt = np.linalg.svd(relaxed_minimum(form, multipliers)[0])
        turns = U @ Vt
        start = found.X[[t], :3, :3] @ turns[0], found.Z[[t], :3, :3] @ turns[1]
        np.testing.assert_allclose(minimise(*pairs, *start, weights).cost, best[t], rtol=1e-8)
        tried += 1
    assert tried == 3


def test_barrier_finds_the_least_largest_eigenvalue():
    # of [[a, y], [y, b]] it is max(a, b), at y = 0; of diag(c + y) with Σ y = 0 the mean of c
    constant = -np.array([[1.0, 0.7], [0.7, -2.0]])
    moves = np.array([np.eye(2), [[0.0, -1.0], [-1.0, 0.0]]])
    x = minimise_first(constant, moves, np.array([5.0, 0.0]), 1e-9)
    np.testing.assert_allclose(x, [1.0, -0.7], atol=1e-4)
    c = np.array([3.0, -1.0, 4.0])
    moves = np.array([np.eye(3), -np.diag([1.0, -1.0, 0.0]), -np.diag([0.0, 1.0, -1.0])])
    x = minimise_first(-np.diag(c), moves, np.array([9.0, 0.0, 0.0]), 1e-9)
    assert x[0] == pytest.approx(2.0, abs=1e-8)
    outside = np.array([3.9, 0.0, 0.0])
    np.testing.assert_array_equal(minimise_first(-np.diag(c), moves, outside, 1e-9), outside)


def shor(form):
    """Value of Shor's relaxation by Clarabel, and the second eigenvalue of its solution.

    The matrix of products of (u, 1) is replaced by any positive semidefinite one that satisfies the
    equations of the rotations: the value is the best bound that multipliers can give.
    """
    whole = np.block(
        [
            [form.quadratic[0], form.linear[0][:, None]],
            [form.linear[0][None], form.constant[:1, None]],
        ]
    )
    scale = np.abs(whole).max()
    Y = cp.Variable((19, 19), PSD=True)
    equations = rotation_constraints()
    held = [
        cp.sum(cp.multiply(bend, Y[at, at])) + 2.0 * (slope @ Y[at, 18]) == 0.0
        for at in (slice(0, 9), slice(9, 18))
        for bend, slope in zip(equations.bends, equations.slopes, strict=True)
    ]
    problem = cp.Problem(
        cp.Minimize(cp.sum(cp.multiply(whole / scale, Y))), [Y[18, 18] == 1, *held]
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        problem.solve(solver=cp.CLARABEL)
    # over the rotations themselves, since about the solution u is zero and 1 is all there is
    lift = np.eye(19)
    lift[:18, 18] = np.tile(np.eye(3).ravel(), 2)
    eigenvalues = np.linalg.eigvalsh(lift @ Y.value @ lift.T)
    return problem.value * scale, eigenvalues[-2] / eigenvalues[-1]


def test_relaxation_by_clarabel_agrees_with_the_dual():
    A, B, weights, found, best = hard_problems(6, trials=3, noise_deg=5.0)
    for t in range(3):
        form = quadratic_form(A[[t]], B[[t]], found.X[[t]], found.Z[[t]], weights)
        value, second = shor(form)
        bound = lower_bound(form, best_multipliers(form)).value[0]
        # both to within what an interior point keeps of the largest numbers
        tolerance = 1e-3 * found.cost[t]
        assert value == pytest.approx(bound, abs=tolerance)
        assert value == pytest.approx(best[t], abs=tolerance)
        assert second < 1e-3
