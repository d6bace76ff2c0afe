"""The relaxed problem itself, solved by cvxpy and Clarabel: a check of the dual route.

The cost is linear in the products of (u, 1) with itself. With the matrix of products replaced by
any positive semidefinite one that satisfies the equations of the rotations (Shor's relaxation), it
is a semidefinite program, whose value is the best bound that multipliers can give. Where its
solution has rank one, that is the global optimum. An interior-point solver knows its value to some
digits of the largest numbers in it only, which are the weights of the data, not the cost.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from calib import se3
from calib.errors import ConvergenceError
from calib.robot_world.certificate.dual import rotation_constraints
from calib.robot_world.certificate.polynomial import QuadraticForm
from calib.se3 import FloatArray

SOLVER_TOLERANCE = 1e-12
"""Asked of the solver, which stops at what it can reach."""


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Solution of the relaxed problem.

    Attributes
    ----------
    X, Z : ndarray (4, 4)
        Rounded to rotations, with the translations that fit best.
    cost : float
        Theirs.
    value : float
        Of the relaxed problem: a bound of the cost, as far as the solver's precision goes.
    relative_gap : float
        ``|cost - value| / cost``.
    second_eigenvalue : float
        Of the matrix of products, in units of the first: zero where the relaxation is tight.
    """

    X: FloatArray
    Z: FloatArray
    cost: float
    value: float
    relative_gap: float
    second_eigenvalue: float


def solve_relaxation(form: QuadraticForm) -> Relaxation:
    """Solve the relaxation of one problem.

    Parameters
    ----------
    form : QuadraticForm
        Of one problem, T = 1. The usual relaxation over the rotations themselves has the identity
        as the reference; the closer the reference to the solution, the more digits are left.

    Raises
    ------
    ConvergenceError
        The solver gave up.
    """
    cp: Any = import_module("cvxpy")  # takes a second to load
    whole = np.zeros((19, 19))
    whole[:18, :18] = form.quadratic[0]
    whole[18, :18] = whole[:18, 18] = form.linear[0]
    whole[18, 18] = form.constant[0]
    scale = float(np.abs(whole).max())
    Y = cp.Variable((19, 19), PSD=True)
    constraints = [Y[18, 18] == 1.0]
    equations = rotation_constraints()
    for at in (slice(0, 9), slice(9, 18)):
        constraints += [
            cp.sum(cp.multiply(bend, Y[at, at])) + 2.0 * (slope @ Y[at, 18]) == 0.0
            for bend, slope in zip(equations.bends, equations.slopes, strict=True)
        ]
    problem = cp.Problem(cp.Minimize(cp.sum(cp.multiply(whole / scale, Y))), constraints)
    with warnings.catch_warnings():
        # that it stopped short of its tolerances is what the result is looked at for
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        problem.solve(
            solver=cp.CLARABEL,
            tol_gap_abs=SOLVER_TOLERANCE,
            tol_gap_rel=SOLVER_TOLERANCE,
            tol_feas=SOLVER_TOLERANCE,
        )
    if Y.value is None:
        raise ConvergenceError(
            f"Clarabel ended with {problem.status}", hint="the dual certificate needs no solver"
        )
    products = np.asarray(Y.value)
    turns = se3.project_to_rotation(np.eye(3) + products[:18, 18].reshape(2, 1, 3, 3))
    X, Z = form.transforms(turns[0], turns[1])
    cost = float(form.cost(form.offset(X[:, :3, :3], Z[:, :3, :3]))[0])
    value = float(problem.value) * scale
    # over the rotations themselves, since about the solution u is zero and 1 is all there is
    lift = np.eye(19)
    lift[:18, 18] = np.tile(np.eye(3).ravel(), 2)
    eigenvalues = np.linalg.eigvalsh(lift @ products @ lift.T)
    second = float(eigenvalues[-2] / eigenvalues[-1])
    return Relaxation(X[0], Z[0], cost, value, abs(cost - value) / cost, second)
