"""Solve A X = Z B by any of the methods: one problem, or many at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.errors import InputError
from calib.robot_world.identifiability import Motion, examine, not_identifiable
from calib.robot_world.methods import find_method
from calib.robot_world.noise import PairNoise, propagate
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate, RobotWorldBatch, RobotWorldResult, residuals
from calib.se3 import FloatArray

FEWEST_PAIRS = 3
"""Two rotations between poses are the fewest that can have two different axes."""

_PAIRS_AT_ONCE = 20_000
"""Pairs that one call of a method sees: bounds its memory to some 100 MB."""


def solve(
    A: ArrayLike, B: ArrayLike, method: str = "hirsh", noise: PairNoise | None = None
) -> RobotWorldResult:
    """Solve ``A_i X = Z B_i`` for X and Z.

    Eye in hand, ``A = T_base_flange``, ``B = T_target_camera``, ``X = T_flange_camera`` and
    ``Z = T_base_target``. Eye to hand, ``B = T_camera_target``, ``X = T_flange_target`` and
    ``Z = T_base_camera``.

    Parameters
    ----------
    A, B : array_like (N, 4, 4)
        Measured transforms [m], N >= 3, pair by pair.
    method : str
        One of :data:`~calib.robot_world.METHODS`.
    noise : PairNoise, optional
        Noise of the transforms; with it the result has a covariance, to first order.

    Returns
    -------
    RobotWorldResult
        X, Z, residuals and covariance. Look at its ``status``: an iteration may not have
        converged, and a method may have failed on data that another one solves.

    Raises
    ------
    InputError
        Unknown method, shapes that differ, fewer than three pairs, or matrices that are not rigid
        transforms.
    NotIdentifiableError
        The rotations between the poses are all about one axis, or there are none, or they are
        half turns that leave a choice, or the noise hides what there is besides.
    """
    chosen = find_method(method)
    A, B = _checked(A, B, dimensions=3)
    pairs = PairSets(A[None], B[None])
    motion = examine(pairs)
    if motion.degenerate[0]:
        raise not_identifiable(motion, A, B)
    found = chosen.estimate(pairs)
    X, Z = found.X[0], found.Z[0]
    error = residuals(A, B, X, Z)
    status, message = _verdict(found, motion, error)
    covariance = None
    if noise is not None and status == "ok":
        covariance = propagate(chosen.estimate, A, B, noise)
        ratio = noise.excess(error, X)
        if ratio > 1.0:
            covariance = covariance * ratio**2
            message += (
                f"; the residuals are {ratio:.1f} times the noise given: standard deviations are "
                "scaled up to them, which does not cover a bias of A or B"
            )
    iterations = None if found.iterations is None else int(found.iterations[0])
    return RobotWorldResult(X, Z, method, status, message, iterations, error, covariance)


def solve_batch(A: ArrayLike, B: ArrayLike, method: str = "hirsh") -> RobotWorldBatch:
    """Solve T problems ``A_i X = Z B_i`` at once, as Monte Carlo studies need it.

    Parameters
    ----------
    A, B : array_like (T, N, 4, 4)
        Measured transforms of T problems with N >= 3 pairs each.
    method : str
        One of :data:`~calib.robot_world.METHODS`.

    Returns
    -------
    RobotWorldBatch
        X and Z ``(T, 4, 4)``. A single bad trial does not stop the others, so degenerate motion
        is a mask here, not an error: X and Z are NaN where nothing identifies them, and ``ok``
        is False wherever :func:`solve` would raise or give a status other than ``"ok"``.

    Raises
    ------
    InputError
        As :func:`solve`.
    """
    chosen = find_method(method)
    A, B = _checked(A, B, dimensions=4)
    motion = examine(PairSets(A, B))
    T = len(A)
    X, Z = np.full((T, 4, 4), np.nan), np.full((T, 4, 4), np.nan)
    iterations = np.zeros(T, dtype=np.intp) if chosen.iterative else None
    converged, misfit = np.ones(T, dtype=bool), np.zeros(T, dtype=bool)
    usable = np.flatnonzero(~motion.rank_deficient)
    at_once = max(1, _PAIRS_AT_ONCE // A.shape[1])
    for first in range(0, len(usable), at_once):
        rows = usable[first : first + at_once]
        found = chosen.estimate(PairSets(A[rows], B[rows]))
        X[rows], Z[rows] = found.X, found.Z
        if iterations is not None and found.iterations is not None:
            iterations[rows] = found.iterations
        if found.converged is not None:
            converged[rows] = found.converged
        error = residuals(A[rows], B[rows], found.X, found.Z)
        misfit[rows] = motion.is_misfit(error, rows)
    return RobotWorldBatch(
        X, Z, method, iterations, converged, motion.rank_deficient, motion.degenerate, misfit
    )


def _checked(A: ArrayLike, B: ArrayLike, *, dimensions: int) -> tuple[FloatArray, FloatArray]:
    """Both sides as arrays of rigid transforms, of the same shape, with enough pairs."""
    A, B = se3.check_transforms(A, "A"), se3.check_transforms(B, "B")
    shape = "(N, 4, 4)" if dimensions == 3 else "(T, N, 4, 4)"
    for name, array in (("A", A), ("B", B)):
        if array.ndim != dimensions:
            raise InputError(
                f"{name} has shape {array.shape}, not {shape}",
                hint="solve takes one problem, solve_batch takes T of them",
                name=name,
                value=array.shape,
            )
    if A.shape != B.shape:
        raise InputError(
            f"A has shape {A.shape} and B has {B.shape}",
            hint="give one B for each A",
            name="B",
            value=B.shape,
            bound=A.shape,
        )
    if dimensions == 4 and not len(A):
        raise InputError("A and B have no trial", hint="give at least one", name="A", value=0)
    if A.shape[-3] < FEWEST_PAIRS:
        raise InputError(
            f"{A.shape[-3]} pose pairs cannot identify X and Z",
            hint=f"measure at least {FEWEST_PAIRS}, with rotations about different axes",
            name="A",
            value=A.shape[-3],
            bound=FEWEST_PAIRS,
        )
    return _orthonormal(A), _orthonormal(B)


def _orthonormal(T: FloatArray) -> FloatArray:
    """Transforms with their rotations orthonormal to rounding, from as good as a file holds.

    A step of Newton's iteration for the nearest rotation squares the deviation: two are enough,
    and far cheaper than the singular values of every pair.
    """
    R = T[..., :3, :3]
    for _ in range(2):
        R = 1.5 * R - 0.5 * R @ np.swapaxes(R, -1, -2) @ R
    return se3.transform(R, T[..., :3, 3])


def _verdict(found: Estimate, motion: Motion, error: FloatArray) -> tuple[str, str]:
    """Status and message of one solution with the residuals ``(N, 6)``."""
    if found.converged is not None and not found.converged[0]:
        return "not converged", (
            f"still moving after {found.iterations[0] if found.iterations is not None else 0} "
            "cycles: X and Z are the last iterate"
        )
    if motion.is_misfit(error[None], np.array([0]))[0]:
        return "misfit", (
            f"the residuals are several times the {np.degrees(motion.residual_rad[0]):.2g} deg and "
            f"{1e3 * motion.residual_m[0]:.2g} mm that rotations first, then translations leave: "
            "this method has failed on these data, take another"
        )
    return "ok", f"solved from {len(error)} pairs"
