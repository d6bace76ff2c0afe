"""Linear quaternion solution of A X = Z B (Zhuang, Roth and Sudhakar 1994), made safe.

The scalar part of ``a x = z b`` gives x_0 for each pair, the vector part divided by z_0 is then
linear in six unknowns::

    [a_0 1 + Ω(a) + a aᵀ/a_0 ,  -b_0 1 + Ω(b) - a bᵀ/a_0] (x/z_0, z/z_0) = b - (b_0/a_0) a

It is what Li et al. 2010 call the quaternion method and compare with. As usually written it breaks
where the signs of the quaternions do not agree over the set, which both forms here see to, and
where some A or Z is a rotation by half a turn (a_0 = 0, z_0 = 0).
"""

from __future__ import annotations

import itertools

import numpy as np

from calib import se3
from calib.robot_world.algebra import (
    conjugate,
    least_squares,
    left_matrix,
    right_matrix,
)
from calib.robot_world.closed_form import assemble
from calib.robot_world.estimate import Estimate
from calib.robot_world.pair_arrays import shared
from calib.robot_world.pairs import PairSets, own_order
from calib.se3 import FloatArray, IntArray

_SAFE_SCALAR = 0.2
"""Smallest |a_0| that needs no other reference: 157 deg from the mean orientation. A pair weighs
as a_0², so one below it counts for less than a twentieth."""

_MOST_REFERENCES = 200
"""Poses that are tried: each is held against all, so that of more the time would be quadratic."""

_SMALLEST_SCALAR = 1e-12
"""What the literal form takes for a_0 = 0: its equations are then wrong, but finite, and the misfit
of the result shows it."""


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the rotations first, then the translations.

    All frames are turned before the equations are written: the base and the flange so that a
    reference orientation far from half a turn from every A becomes the identity, the target and
    the camera so that X and Z, taken from the rotations in closed form, are near the identity
    (z_0 near 1). The equations are taken times a_0, without a division: a pair near a half turn
    that no reference avoids then loses weight, where the literal form would let it outweigh all
    others. Without noise none of this changes the answer.
    """
    a, b = pairs.quaternions
    sets = 1 if shared(pairs.A) else pairs.T
    reference = np.broadcast_to(_reference(pairs.A[:sets], a[:sets]), (pairs.T, 4))
    R_X, R_Z = pairs.rotations
    # A X = Z B becomes (PᵀA)(X Yᵀ) = (PᵀZ G)(GᵀB Yᵀ) with P the reference, Y = X and G = ZᵀP.
    x, z = pairs.quaternions_of_rotations
    to_base = left_matrix(conjugate(reference))
    to_target = to_base @ left_matrix(z) @ right_matrix(conjugate(x))
    x, z = _solve_quaternions(
        a @ np.swapaxes(to_base, -1, -2), b @ np.swapaxes(to_target, -1, -2), divide=False
    )
    R_base = se3.rotation_from_quaternion(reference)
    R_X = se3.rotation_from_quaternion(x) @ R_X
    R_Z = R_base @ se3.rotation_from_quaternion(z) @ np.swapaxes(R_base, -1, -2) @ R_Z
    return Estimate(*assemble(pairs, R_X, R_Z))


def estimate_literal(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, in the frames as given and with the division by a_0.

    Only the signs of the quaternions are made consistent. Fails where some A or Z is close to half
    a turn.
    """
    x, z = _solve_quaternions(*pairs.quaternions, divide=True)
    R_X, R_Z = se3.rotation_from_quaternion(x), se3.rotation_from_quaternion(z)
    return Estimate(*assemble(pairs, R_X, R_Z))


def _solve_quaternions(
    a: FloatArray, b: FloatArray, *, divide: bool
) -> tuple[FloatArray, FloatArray]:
    """Quaternions x and z ``(T, 4)``, of any norm, from ``a x = z b`` of all pairs ``(T, N, 4)``.

    The equations of the module times a_0, or as they stand where they are to be divided by it.
    """
    T, N = a.shape[:2]
    a_0, b_0, a_v, b_v = a[..., :1], b[..., :1], a[..., 1:], b[..., 1:]
    one = np.eye(3)
    rows_x = a_0[..., None] * (a_0[..., None] * one + se3.skew(a_v)) + _outer(a_v, a_v)
    rows_z = a_0[..., None] * (-b_0[..., None] * one + se3.skew(b_v)) - _outer(a_v, b_v)
    rows = np.concatenate([rows_x, rows_z], axis=-1)
    right_side = a_0 * b_v - b_0 * a_v
    if divide:
        divisor = np.where(np.abs(a_0) < _SMALLEST_SCALAR, _SMALLEST_SCALAR, a_0)
        rows, right_side = rows / divisor[..., None], right_side / divisor
    ratio = least_squares(rows.reshape(T, 3 * N, 6), right_side.reshape(T, 3 * N))
    x_v, z_v = ratio[:, None, :3], ratio[:, None, 3:]
    # The scalar part is a_0 x_0 = a·x + b_0 z_0 - b·z, here by least squares, with z_0 = 1.
    scalar = (a_v * x_v).sum(-1, keepdims=True) + b_0 - (b_v * z_v).sum(-1, keepdims=True)
    x_0 = (a_0 * scalar).sum(axis=1) / np.maximum((a_0**2).sum(axis=1), _SMALLEST_SCALAR)
    x = np.concatenate([x_0, ratio[:, :3]], axis=-1)
    z = np.concatenate([np.ones((T, 1)), ratio[:, 3:]], axis=-1)
    return x, z


def _outer(u: FloatArray, v: FloatArray) -> FloatArray:
    return u[..., :, None] * v[..., None, :]


def _reference(A: FloatArray, a: FloatArray) -> FloatArray:
    """Unit quaternions ``(T, 4)`` of orientations that are half a turn away from no pose.

    The mean orientation, as long as it is safe; otherwise, of the poses themselves and of mixtures
    of the principal axes of their quaternions, the one with the largest harmonic mean of a_0². It
    is led by the smallest a_0, as the smallest alone would be, but two poses that are each other's
    nearest do not tie, so the order of the pairs decides nothing.
    """
    axes = np.linalg.eigh(np.swapaxes(a, -1, -2) @ a)[1]  # columns, ascending: last is the mean
    mean = np.ascontiguousarray(axes[..., 3])
    safe = np.abs(a @ mean[..., None]).min(axis=(-2, -1)) > _SAFE_SCALAR
    if safe.all():
        return mean
    mixtures = np.array(list(itertools.product([1.0], [1.0, -1.0], [1.0, -1.0], [1.0, -1.0]))) / 2.0
    unsafe = np.flatnonzero(~safe)
    # set by set: what it takes stays in the cache
    for one, tried in zip(unsafe.tolist(), _spread(A[unsafe]), strict=True):
        poses = a[one, tried]
        candidates = np.concatenate([mean[one, None], poses, mixtures @ axes[one].T])
        squares = candidates @ a[one].T
        squares *= squares
        np.maximum(squares, _SMALLEST_SCALAR, out=squares)
        mean[one] = candidates[np.reciprocal(squares, out=squares).sum(axis=-1).argmin()]
    return mean


def _spread(A: FloatArray) -> IntArray:
    """Indices ``(T, few)`` of poses that are tried as a reference: all, or some of all kinds."""
    N = A.shape[1]
    if N <= _MOST_REFERENCES:
        return np.tile(np.arange(N), (len(A), 1))
    return own_order(A)[:, np.linspace(0, N - 1, _MOST_REFERENCES).astype(np.intp)]
