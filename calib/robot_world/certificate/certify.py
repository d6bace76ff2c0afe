"""The certificate: whether a solution of A X = Z B is the global optimum."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.certificate.dual import (
    least_multipliers,
    lower_bound,
    relaxed_minimum,
)
from calib.robot_world.certificate.local import minimise
from calib.robot_world.certificate.multipliers import balanced_multipliers, best_multipliers
from calib.robot_world.certificate.polynomial import (
    QuadraticForm,
    Weights,
    cost_weights,
    quadratic_form,
)
from calib.robot_world.noise import PairNoise, check_noise_given
from calib.robot_world.pairs import checked_pairs
from calib.se3 import FloatArray

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


def certify(
    A: ArrayLike, B: ArrayLike, X: ArrayLike, Z: ArrayLike, noise: PairNoise
) -> Certificate:
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
            hint="give PairNoise, on A or on B",
            name="noise",
        )
    weights = cost_weights(noise)
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
    """A stationary point X, Z ``(4, 4)``, the form about it, and what is known of it."""

    X: FloatArray
    Z: FloatArray
    cost: float
    form: QuadraticForm
    bound: float
    smallest_eigenvalue: float
    convex: bool

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
    weights: Weights

    def descend(self, R_X: FloatArray, R_Z: FloatArray) -> _Optimum:
        """Stationary point that rotations ``(1, 3, 3)`` lead to, and the proof there."""
        A, B = self.A[None], self.B[None]
        minimum = minimise(A, B, R_X, R_Z, self.weights)
        form = quadratic_form(A, B, minimum.X, minimum.Z, self.weights)
        proof = lower_bound(form, least_multipliers(form))
        bound = float(proof.value[0])
        if not proof.convex[0] and np.isfinite(form.rounding[0]):
            proof = lower_bound(form, balanced_multipliers(form))
            bound = max(bound, float(proof.value[0]))
        return _Optimum(
            X=minimum.X[0],
            Z=minimum.Z[0],
            cost=float(minimum.cost[0]),
            form=form,
            bound=bound,
            smallest_eigenvalue=float(proof.smallest_eigenvalue[0]),
            convex=bool(proof.convex[0]),
        )

    def relax(self, found: _Optimum) -> tuple[_Optimum, float]:
        """What the solution of the relaxed problem leads to, and the bound that it is."""
        multipliers = best_multipliers(found.form)
        bound = float(lower_bound(found.form, multipliers).value[0])
        turns = se3.project_to_rotation(relaxed_minimum(found.form, multipliers))
        return self.descend(found.X[:3, :3] @ turns[:, 0], found.Z[:3, :3] @ turns[:, 1]), bound


def _certificate(
    found: _Optimum,
    better: Certificate | None,
    candidate: tuple[FloatArray, FloatArray],
    exchanged: bool,
) -> Certificate:
    unique = found.proven and found.convex
    status, message = _verdict(found, better, unique)
    optimum = [se3.inverse(T) if exchanged else T for T in (found.X, found.Z)]
    pairs = list(zip(candidate, optimum, strict=True))
    turns = np.array([a[:3, :3] @ b[:3, :3].T for a, b in pairs])
    return Certificate(
        X=optimum[0],
        Z=optimum[1],
        cost=found.cost,
        bound=found.bound,
        relative_gap=found.gap,
        smallest_eigenvalue=found.smallest_eigenvalue,
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
