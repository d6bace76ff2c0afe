"""The certificate: whether a solution of A X = Z B is the global optimum.

A local minimum of the cost over both rotations is found by Newton's method on the manifold. Every
iteration works on 18 numbers whatever the number of pairs. Steps are rotation vectors from
the left, ``R ← exp([w]) R``. Far from the minimum the Hessian may be indefinite: the absolute
values of its eigenvalues, plus a damping, then make every step one that descends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.algebra import apply_matrix
from calib.robot_world.certificate import dual, polynomial
from calib.robot_world.noise import Noise, PairNoise, check_noise_given
from calib.robot_world.pairs import checked_pairs
from calib.se3 import BoolArray, FloatArray, IntArray

GAP_TOLERANCE = 1e-6
"""Relative gap up to which the optimum counts as proven: less than the data could ever show, far
more than rounding makes."""

COST_FLOOR = 1.0
"""Cost [chi²] that the relative gap refers to at least. A rise by 1 is one standard deviation, so
where the data are far better than their noise says, a gap is measured by that."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """What is known of the optimum that a candidate leads to.

    Attributes
    ----------
    X, Z : ndarray (4, 4)
        The stationary point [m] of the cost that a descent from the candidate ends in. The
        certificate is about this, not about the candidate.
    cost : float
        Its chi²: twice the negative logarithm of the likelihood, but for a constant.
    bound : float
        No X and Z whatsoever have a lower cost. It is computed so that rounding cannot break it.
    relative_gap : float
        ``(cost - bound) / max(cost, 1)``.
    smallest_eigenvalue : float
        Of the matrix S that the proof needs to be positive definite [chi²], as it was found at X
        and Z.
    certified : bool
        The relative gap is below :data:`GAP_TOLERANCE`.
    unique : bool
        Certified, and S is positive definite beyond rounding: there is no other optimum. How well
        the data identify it is another question, which the covariance answers.
    status : str
        ``"optimal"`` where certified; ``"not optimal"`` where a solution of lower cost is known;
        ``"not proven"`` where neither is so.
    message : str
        The status in a sentence.
    rotation_moved_rad, translation_moved_m : ndarray (2,)
        From the candidate's X, and Z, to the ones above: angle [rad] and distance [m].
    better : Certificate or None
        Where the status is ``"not optimal"``, that of the solution of lower cost.
    """

    X: FloatArray
    Z: FloatArray
    cost: float
    bound: float
    relative_gap: float
    smallest_eigenvalue: float
    certified: bool
    unique: bool
    status: str
    message: str
    rotation_moved_rad: FloatArray
    translation_moved_m: FloatArray
    better: Certificate | None = None


def certify(A: ArrayLike, B: ArrayLike, X: ArrayLike, Z: ArrayLike, noise: Noise) -> Certificate:
    """Descend from a candidate to an optimum of the likelihood, and try to prove it global.

    Parameters
    ----------
    A, B : array_like (N, 4, 4)
        Measured transforms [m], N >= 3, pair by pair.
    X, Z : array_like (4, 4)
        The candidate: the solution of any method.
    noise : PairNoise
        On A or on B, not on both; both of its standard deviations above zero.

    Returns
    -------
    Certificate
        ``certified`` is sound: it follows from a bound that holds whatever has been found. Where
        the status is ``"not proven"``, the optimum may still be the global one. An optimum that is
        not the only one, as after rotations about one axis, is proven at best where the data are
        free of noise, and ``unique`` is False then. Whether noisy data identify X and Z well
        enough is no question of optimality: :func:`calib.robot_world.solve` asks it.

    Raises
    ------
    InputError
        Noise on both sides, or none; fewer than three pairs, shapes that differ, or matrices that
        are not rigid transforms.

    Notes
    -----
    Noise on A alone is the same problem with the roles of A and B exchanged,
    ``B X⁻¹ = Z⁻¹ A``. Noise on both is not: an error in the rotation of A moves the origin of X,
    so that the cost is no polynomial of the second degree in the rotations.
    """
    check_noise_given(noise)
    if not isinstance(noise, PairNoise):
        raise InputError(
            "there is a certificate only for noise that is the same in all directions",
            hint='give PairNoise, on A or on B, or solve with noise="B"',
            name="noise",
        )
    weights = polynomial.cost_weights(noise)
    A, B = checked_pairs(A, B, dimensions=3)
    X, Z = _candidate(X, "X"), _candidate(Z, "Z")
    exchanged = noise.on == "A"
    problem = _Problem(*((B, A) if exchanged else (A, B)), weights)
    start = [se3.inverse(T) if exchanged else T for T in (X, Z)]
    found = problem.descend(start[0][None, :3, :3], start[1][None, :3, :3])
    better = None
    if not found.proven and found.determined:
        other, bound = problem.relax(found)
        found = replace(found, bound=max(found.bound, bound, other.bound))
        if other.cost < found.cost - GAP_TOLERANCE * max(found.cost, COST_FLOOR):
            other = replace(other, bound=max(bound, other.bound))
            better = _certificate(other, None, (X, Z), exchanged)
    return _certificate(found, better, (X, Z), exchanged)


@dataclass(frozen=True, eq=False)
class _Optimum:
    """A stationary point, T = 1, the form about it, and what is known of it."""

    at: LocalMinimum
    form: polynomial.QuadraticForm
    bound: float
    proof: dual.LowerBound

    @property
    def cost(self) -> float:
        return float(self.at.cost[0])

    @property
    def gap(self) -> float:
        return (self.cost - self.bound) / max(self.cost, COST_FLOOR)

    @property
    def proven(self) -> bool:
        return self.gap < GAP_TOLERANCE

    @property
    def determined(self) -> bool:
        """Whether the motion fixes the translations."""
        return bool(np.isfinite(self.form.rounding[0]))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Pairs ``(N, 4, 4)`` with noise on B alone."""

    A: FloatArray
    B: FloatArray
    weights: polynomial.Weights

    def descend(self, R_X: FloatArray, R_Z: FloatArray) -> _Optimum:
        """Stationary point that rotations ``(1, 3, 3)`` lead to, and the proof there."""
        A, B = self.A[None], self.B[None]
        minimum = minimise(A, B, R_X, R_Z, self.weights)
        form = polynomial.quadratic_form(A, B, minimum.X, minimum.Z, self.weights)
        proof = dual.lower_bound(form, dual.least_multipliers(form))
        bound = float(proof.value[0])
        if not proof.convex[0] and np.isfinite(form.rounding[0]):
            proof = dual.lower_bound(form, dual.balanced_multipliers(form))
            bound = max(bound, float(proof.value[0]))
        return _Optimum(minimum, form, bound, proof)

    def relax(self, found: _Optimum) -> tuple[_Optimum, float]:
        """What the solution of the relaxed problem leads to, and the bound that it is."""
        multipliers = dual.best_multipliers(found.form)
        bound = float(dual.lower_bound(found.form, multipliers).value[0])
        turns = se3.project_to_rotation(dual.relaxed_minimum(found.form, multipliers))
        R_X, R_Z = found.at.X[:, :3, :3], found.at.Z[:, :3, :3]
        return self.descend(R_X @ turns[:, 0], R_Z @ turns[:, 1]), bound


def _certificate(
    found: _Optimum,
    better: Certificate | None,
    candidate: tuple[FloatArray, FloatArray],
    exchanged: bool,
) -> Certificate:
    unique = found.proven and bool(found.proof.convex[0])
    status, message = _verdict(found, better, unique)
    optimum = [se3.inverse(T) if exchanged else T for T in (found.at.X[0], found.at.Z[0])]
    pairs = list(zip(candidate, optimum, strict=True))
    turns = np.array([a[:3, :3] @ b[:3, :3].T for a, b in pairs])
    return Certificate(
        X=optimum[0],
        Z=optimum[1],
        cost=found.cost,
        bound=found.bound,
        relative_gap=found.gap,
        smallest_eigenvalue=float(found.proof.smallest_eigenvalue[0]),
        certified=found.proven,
        unique=unique,
        status=status,
        message=message,
        rotation_moved_rad=se3.rotation_angle(turns),
        translation_moved_m=np.array([np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in pairs]),
        better=better,
    )


def _verdict(found: _Optimum, better: Certificate | None, unique: bool) -> tuple[str, str]:
    """Status and message."""
    cost = f"{found.cost:.5g}"
    if found.proven:
        others = "" if unique else ", though others may have the same"
        return "optimal", (
            f"proven: no X and Z have a chi² below {cost} by more than "
            f"{found.cost - found.bound:.0e}{others}"
        )
    if better is not None:
        proof = "which is proven optimal" if better.certified else "itself not proven optimal"
        return "not optimal", (
            f"the candidate leads to a chi² of {cost}, another start to one of {better.cost:.5g}, "
            f"{proof}"
        )
    if not found.determined:
        return "not proven", (
            "not proven: the rotations of the poses are about one axis, which leaves a "
            "translation free"
        )
    return "not proven", (
        f"not proven: chi² is {cost} and the best lower bound {found.bound:.5g}, a gap of "
        f"{found.gap:.2g}"
    )


def _candidate(T: ArrayLike, name: str) -> FloatArray:
    """A single rigid transform, orthonormal to rounding."""
    array = se3.rigid(T, name)
    if array.ndim != 2:
        raise InputError(
            f"{name} has shape {array.shape}, not (4, 4)",
            hint="the certificate is of one problem at a time",
            name=name,
            value=array.shape,
        )
    return array


ARRIVED_RAD = 1e-9
"""Length of an undamped step after which there is no other: Newton squares it."""

ITERATION_LIMIT = 100
"""Quadratic convergence takes some 5 steps, and far starts some 20."""

_LARGEST_STEP_RAD = 1.0
"""Beyond that a model of second order says nothing of a rotation."""

_LEAST_CURVATURE = 1e-12
"""Part of the largest eigenvalue of the Hessian below which a direction counts as flat: nothing
moves along it."""

_GOOD_MODEL = 0.5
"""Decrease of the cost, in units of the one foreseen, from which a step needs no damping."""

_FIRST_DAMPING = 1e-2
"""In units of the largest eigenvalue of the Hessian; where a step fails, ten times as much."""

_MATRICES = np.array([se3.skew(axis) for axis in np.eye(3)])


@dataclass(frozen=True, eq=False)
class LocalMinimum:
    """Stationary points that T descents ended in."""

    X: FloatArray
    Z: FloatArray  # X, Z (T, 4, 4)
    cost: FloatArray  # (T,): chi², where the weights are those of the noise
    iterations: IntArray  # (T,): steps of Newton's method
    converged: BoolArray  # (T,): the last step was one that needs no other


def minimise(
    A: FloatArray, B: FloatArray, R_X: FloatArray, R_Z: FloatArray, weights: polynomial.Weights
) -> LocalMinimum:
    """Descend from given rotations to a stationary point of the cost, as a rule a local minimum.

    Parameters
    ----------
    A, B : ndarray (T, N, 4, 4)
        Measured transforms, rotations orthonormal to rounding; noise on B.
    R_X, R_Z : ndarray (T, 3, 3)
        Where to start, anywhere.
    weights : Weights
        Of the two kinds of residual: those of the noise, or 1 and 1 as in Dornaika and Horaud
        1998.

    Returns
    -------
    LocalMinimum
        For T problems. The first descent ends to the precision that the numbers far from the
        reference have; the second one starts there with the reference at the end of the first.
    """
    none = np.zeros(3)
    form = polynomial.quadratic_form(
        A, B, se3.transform(R_X, none), se3.transform(R_Z, none), weights
    )
    X, Z, first, _ = descend(form)
    form = polynomial.quadratic_form(A, B, X, Z, weights)
    X, Z, second, converged = descend(form)
    cost = form.cost(form.offset(X[:, :3, :3], Z[:, :3, :3]))
    return LocalMinimum(X, Z, cost, first + second, converged)


def descend(form: polynomial.QuadraticForm) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """X, Z ``(T, 4, 4)``, number of steps and convergence ``(T,)`` from the form's reference."""
    T = len(form.constant)
    turns = np.tile(np.eye(3), (T, 2, 1, 1))  # of X and Z from the reference
    damping = np.zeros(T)
    steps = np.zeros(T, dtype=np.intp)
    converged = np.zeros(T, dtype=bool)
    for _ in range(ITERATION_LIMIT):
        at = np.flatnonzero(~converged)
        if not len(at):
            break
        G, g = form.quadratic[at], form.linear[at]
        slope, curvature = derivatives(G, g, turns[at])
        step, foreseen = _step(slope, curvature, damping[at])
        new = se3.rotation_exp(step.reshape(-1, 2, 3)) @ turns[at]
        old_u = _offset(turns[at])
        change = _offset(new) - old_u
        # the difference itself, since costs far from the minimum would hide it in their rounding
        decrease = -(change * (apply_matrix(G, 2.0 * old_u + change) + 2.0 * g)).sum(axis=-1)
        length = np.linalg.norm(step, axis=-1)
        small = length < ARRIVED_RAD
        accepted = small | (decrease > 0.0)
        turns[at[accepted]] = new[accepted]
        steps[at] += 1
        converged[at] = small & (damping[at] == 0.0)
        good = small | (decrease > _GOOD_MODEL * foreseen)
        more = np.maximum(10.0 * damping[at], _FIRST_DAMPING)
        damping[at] = np.where(good, 0.0, np.where(accepted, damping[at], more))
    X, Z = form.transforms(turns[:, 0], turns[:, 1])
    return X, Z, steps, converged


def derivatives(
    quadratic: FloatArray, linear: FloatArray, turns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient ``(T, 6)`` and Hessian ``(T, 6, 6)`` of the cost by (w_X, w_Z).

    Of a form ``(T, 18, 18), (T, 18)``, at rotations ``(T, 2, 3, 3)`` of X and Z from the reference,
    which are moved by ``exp([w])`` from the left.
    """
    T = len(turns)
    D = np.zeros((T, 18, 6))
    moved = _MATRICES @ turns[:, :, None]  # (T, 2, 3, 3, 3): [axis] R
    moved = np.moveaxis(moved.reshape(T, 2, 3, 9), 2, 3)
    D[:, :9, :3], D[:, 9:, 3:] = moved[:, 0], moved[:, 1]
    by_u = 2.0 * (linear + apply_matrix(quadratic, _offset(turns)))
    slope = apply_matrix(np.swapaxes(D, 1, 2), by_u)
    curvature = 2.0 * np.swapaxes(D, 1, 2) @ quadratic @ D
    # exp([w]) = I + [w] + [w]²/2, and the trace of Γᵀ [w]² is wᵀ Γ w - tr Γ |w|²
    force = by_u.reshape(T, 2, 3, 3) @ np.swapaxes(turns, -1, -2)
    trace = np.trace(force, axis1=-2, axis2=-1)[..., None, None]
    bend = 0.5 * (force + np.swapaxes(force, -1, -2)) - trace * np.eye(3)
    curvature[:, :3, :3] += bend[:, 0]
    curvature[:, 3:, 3:] += bend[:, 1]
    return slope, 0.5 * (curvature + np.swapaxes(curvature, 1, 2))


def _step(
    slope: FloatArray, curvature: FloatArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Damped steps ``(T, 6)`` [rad] and the decrease of the cost they promise ``(T,)``."""
    values, axes = np.linalg.eigh(curvature)
    size = np.abs(values)
    largest = size.max(axis=-1, keepdims=True)
    along = apply_matrix(np.swapaxes(axes, 1, 2), slope)
    bound = size + damping[:, None] * largest
    live = bound > _LEAST_CURVATURE * largest
    along_step = np.where(live, -along / np.where(live, bound, 1.0), 0.0)
    length = np.linalg.norm(along_step, axis=-1, keepdims=True)
    shrink = np.minimum(1.0, _LARGEST_STEP_RAD / np.maximum(length, _LARGEST_STEP_RAD))
    along_step = along_step * shrink
    foreseen = -(along_step * along + 0.5 * values * along_step**2).sum(axis=-1)
    return apply_matrix(axes, along_step), foreseen


def _offset(turns: FloatArray) -> FloatArray:
    return polynomial.join(turns[:, 0] - np.eye(3), turns[:, 1] - np.eye(3))
