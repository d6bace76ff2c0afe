"""The certificate: whether a solution of A X = Z B is the global optimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.certificate.dual import LowerBound, least_multipliers, lower_bound
from calib.robot_world.certificate.local import LocalMinimum, minimise
from calib.robot_world.certificate.multipliers import balanced_multipliers, best_multipliers
from calib.robot_world.certificate.polynomial import (
    QuadraticForm,
    Weights,
    cost_weights,
    quadratic_form,
)
from calib.robot_world.noise import PairNoise
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

GAP_TOLERANCE = 1e-6
"""Relative gap up to which the optimum counts as proven: less than the data could ever show, far
more than rounding makes."""

COST_FLOOR = 1.0
"""Cost [chi²] that the relative gap refers to at least. A rise by 1 is one standard deviation, so
where the data are far better than their noise says, a gap is measured by that."""

FEWEST_PAIRS = 3
"""Two rotations between poses are the fewest that can have two different axes."""


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
        it is False, the optimum may still be the global one. Motion that leaves a translation
        free (all rotations about one axis) is never certified.

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
    weights = cost_weights(noise)
    A, B = _pairs(A, B)
    X, Z = (_rigid(T, name, dimensions=2) for T, name in ((X, "X"), (Z, "Z")))
    exchanged = noise.on == "A"
    if exchanged:
        A, B = B, A
    start = [se3.inverse(T) if exchanged else T for T in (X, Z)]
    found = minimise(A[None], B[None], start[0][None, :3, :3], start[1][None, :3, :3], weights)
    form = quadratic_form(A[None], B[None], found.X, found.Z, weights)
    proof = _prove(form)
    other = None
    if _gap(found, proof) >= GAP_TOLERANCE and np.isfinite(form.rounding[0]):
        other, elsewhere = _from_closed_form(A, B, weights)
        proof = _with_bound(proof, elsewhere)
        if _gap(found, proof) >= GAP_TOLERANCE and not _is_better(other, found):
            proof = _with_bound(proof, lower_bound(form, best_multipliers(form)))
    best_X, best_Z = (se3.inverse(T[0]) if exchanged else T[0] for T in (found.X, found.Z))
    return _certificate(form, found, other, proof, (X, Z), (best_X, best_Z))


def _prove(form: QuadraticForm) -> LowerBound:
    """Bound of the cost by multipliers that balance the form: first the cheap ones."""
    proof = lower_bound(form, least_multipliers(form))
    if proof.unique[0] or not np.isfinite(form.rounding[0]):
        return proof
    return _with_bound(lower_bound(form, balanced_multipliers(form)), proof)


def _from_closed_form(
    A: FloatArray, B: FloatArray, weights: Weights
) -> tuple[LocalMinimum, LowerBound]:
    """Optimum that the closed form of the rotations leads to, and the bound proven there."""
    R_X, R_Z = PairSets(A[None], B[None]).rotations
    found = minimise(A[None], B[None], R_X, R_Z, weights)
    return found, _prove(quadratic_form(A[None], B[None], found.X, found.Z, weights))


def _with_bound(proof: LowerBound, other: LowerBound) -> LowerBound:
    """A proof with the better of two bounds of the same cost."""
    return LowerBound(np.maximum(proof.value, other.value), proof.smallest_eigenvalue, proof.unique)


def _gap(found: LocalMinimum, proof: LowerBound) -> float:
    cost = float(found.cost[0])
    return (cost - float(proof.value[0])) / max(cost, COST_FLOOR)


def _is_better(other: LocalMinimum, found: LocalMinimum) -> bool:
    cost = float(found.cost[0])
    return float(other.cost[0]) < cost - GAP_TOLERANCE * max(cost, COST_FLOOR)


def _certificate(
    form: QuadraticForm,
    found: LocalMinimum,
    other: LocalMinimum | None,
    proof: LowerBound,
    candidate: tuple[FloatArray, FloatArray],
    optimum: tuple[FloatArray, FloatArray],
) -> Certificate:
    cost, bound, gap = float(found.cost[0]), float(proof.value[0]), _gap(found, proof)
    certified = gap < GAP_TOLERANCE
    unique = certified and bool(proof.unique[0])
    if certified:
        status = "optimal"
        message = f"proven: no X and Z have a cost below {cost:.6g} by more than {gap:.1g} of it"
        if not unique:
            message += ", but others may have the same"
    elif other is not None and _is_better(other, found):
        status = "not optimal"
        message = (
            f"the candidate leads to a cost of {cost:.4g}, but one of "
            f"{float(other.cost[0]):.4g} is known: start from another method"
        )
    elif not np.isfinite(form.rounding[0]):
        status = "not proven"
        message = "not proven: all rotations are about one axis, which leaves a translation free"
    else:
        status = "not proven"
        message = f"not proven: the cost is {cost:.4g}, the best bound {bound:.4g} (gap {gap:.2g})"
    pairs = list(zip(candidate, optimum, strict=True))
    turns = [a[:3, :3] @ b[:3, :3].T for a, b in pairs]
    return Certificate(
        X=optimum[0],
        Z=optimum[1],
        cost=cost,
        bound=bound,
        relative_gap=gap,
        smallest_eigenvalue=float(proof.smallest_eigenvalue[0]),
        certified=certified,
        unique=unique,
        status=status,
        message=message,
        rotation_moved_rad=se3.rotation_angle(np.array(turns)),
        translation_moved_m=np.array([np.linalg.norm(a[:3, 3] - b[:3, 3]) for a, b in pairs]),
    )


def _pairs(A: ArrayLike, B: ArrayLike) -> tuple[FloatArray, FloatArray]:
    A, B = _rigid(A, "A", dimensions=3), _rigid(B, "B", dimensions=3)
    if A.shape != B.shape:
        raise InputError(
            f"A has shape {A.shape} and B has {B.shape}",
            hint="give one B for each A",
            name="B",
            value=B.shape,
            bound=A.shape,
        )
    if len(A) < FEWEST_PAIRS:
        raise InputError(
            f"{len(A)} pose pairs cannot identify X and Z",
            hint=f"measure at least {FEWEST_PAIRS}, with rotations about different axes",
            name="A",
            value=len(A),
            bound=FEWEST_PAIRS,
        )
    return A, B


def _rigid(T: ArrayLike, name: str, *, dimensions: int) -> FloatArray:
    """A rigid transform, or N of them, with rotations orthonormal to rounding."""
    array = se3.check_transforms(T, name)
    if array.ndim != dimensions:
        shape = "(4, 4)" if dimensions == 2 else "(N, 4, 4)"
        raise InputError(
            f"{name} has shape {array.shape}, not {shape}",
            hint="the certificate is of one problem at a time",
            name=name,
            value=array.shape,
        )
    return se3.transform(se3.project_to_rotation(array[..., :3, :3]), array[..., :3, 3])
