"""Rotations and rigid transforms: the conventions of the whole project, and their conversions.

Conventions
-----------
* ``T_a_b`` maps coordinates in frame b to coordinates in frame a: ``x_a = T_a_b @ x_b``. Adjacent
  letters cancel: ``T_base_tool = T_base_flange @ T_flange_tool``. ``R_a_b`` is its rotation and
  ``p_a_b`` its translation, the origin of b seen from a.
* Lengths are in metres and angles in radians. Millimetres and degrees appear only at the edges
  (files, command line, reports), in names that end in ``_mm`` and ``_deg``.
* ``W, P, R`` are FANUC's angles: rotations about the fixed X, Y and Z axes in that order,
  ``R = Rz(R) Ry(P) Rx(W)``. At P = +-90 deg W and R are degenerate: R is then set to zero and the
  matrix is still right. Compare rotations, never angles.
* KUKA's ``A, B, C`` are ``R, P, W``: the same rotation, the other order. Yaskawa's Rx, Ry, Rz are
  ``W, P, R``. Stäubli's ``rx, ry, rz`` are about the moving X, Y and Z axes: ``Rx(rx) Ry(ry)
  Rz(rz)``. Universal Robots takes rotation vectors, ABB quaternions.
* Quaternions are ``(w, x, y, z)``, of unit norm; q and -q are the same rotation.
* All functions take leading batch dimensions: ``(..., 3, 3)``, ``(..., 4, 4)``, ``(..., 3)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import SupportsInt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import batch_last
from calib.batch_last import FloatArray as FloatArray
from calib.errors import InputError

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

RIGID_TOLERANCE = 2e-6
"""Largest |RᵀR - I| of an accepted rotation: rounding to six decimals in a file passes (1.7e-6),
a scaled or sheared matrix does not."""

_EXACT = 1e-14
"""Largest |RᵀR - I| that rounding alone makes."""

_SMALL_ANGLE = 1e-2
"""[rad] below which series are used: what they leave out is below 1e-13, and the closed forms lose
as much to the difference of nearly equal numbers."""

_GIMBAL_COSINE = 1e-9
"""|cos P| below which W and R cannot be told apart in double precision."""


_IDENTITY = np.eye(3)


def skew(vector: ArrayLike) -> FloatArray:
    """Cross-product matrix: ``skew(a) @ b == np.cross(a, b)``; ``(..., 3)`` to ``(..., 3, 3)``."""
    v = np.asarray(vector, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def transform(rotation: ArrayLike, translation: ArrayLike) -> FloatArray:
    """Rigid transforms ``(..., 4, 4)`` of rotations ``(..., 3, 3)``, translations ``(..., 3)``."""
    R = np.asarray(rotation, dtype=float)
    p = np.asarray(translation, dtype=float)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse(T: FloatArray) -> FloatArray:
    """Inverse of rigid transforms ``(..., 4, 4)``."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_t, -(R_t @ T[..., :3, 3:])[..., 0])


def apply(T: FloatArray, points: FloatArray) -> FloatArray:
    """Points ``(..., 3)`` mapped by transforms ``(..., 4, 4)``, batch dimensions broadcast."""
    return (T[..., :3, :3] @ points[..., None])[..., 0] + T[..., :3, 3]


def rotation_from_wpr(wpr: ArrayLike) -> FloatArray:
    """Rotations ``(..., 3, 3)`` from FANUC W, P, R ``(..., 3)`` [rad]: ``Rz(R) Ry(P) Rx(W)``."""
    angles = np.asarray(wpr, dtype=float)
    (cw, cp, cr), (sw, sp, sr) = (
        np.moveaxis(np.cos(angles), -1, 0),
        np.moveaxis(np.sin(angles), -1, 0),
    )
    R = np.empty((*angles.shape, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (
        cr * cp,
        cr * sp * sw - sr * cw,
        cr * sp * cw + sr * sw,
    )
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (
        sr * cp,
        sr * sp * sw + cr * cw,
        sr * sp * cw - cr * sw,
    )
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sp, cp * sw, cp * cw
    return R


def wpr_from_rotation(rotation: ArrayLike) -> FloatArray:
    """FANUC W, P, R ``(..., 3)`` [rad] of rotations ``(..., 3, 3)``, each in (-pi, pi].

    P lies in [-pi/2, pi/2]. Where it is +-pi/2, R is set to zero.
    """
    R = np.asarray(rotation, dtype=float)
    cos_p = np.hypot(R[..., 2, 1], R[..., 2, 2])
    regular = cos_p > _GIMBAL_COSINE
    w = np.where(
        regular,
        np.arctan2(R[..., 2, 1], R[..., 2, 2]),
        np.arctan2(-R[..., 1, 2], R[..., 1, 1]),
    )
    p = np.arctan2(-R[..., 2, 0], cos_p)
    # R from the matrix with W taken out: it makes up for what rounding does to W near P = +-90 deg
    sw, cw = np.sin(w), np.cos(w)
    sin_r = sw * R[..., 0, 2] - cw * R[..., 0, 1]
    cos_r = cw * R[..., 1, 1] - sw * R[..., 1, 2]
    r = np.where(regular, np.arctan2(sin_r, cos_r), 0.0)
    wpr = np.stack([w, p, r], axis=-1)
    return np.where(wpr <= -np.pi, np.pi, wpr) + 0.0  # + 0.0 turns -0.0 into 0.0


def rotation_from_moving_xyz(angles: ArrayLike) -> FloatArray:
    """Rotations ``(..., 3, 3)`` from Stäubli's rx, ry, rz ``(..., 3)`` [rad]: ``Rx Ry Rz``."""
    # the transpose of Rz(-rz) Ry(-ry) Rx(-rx)
    return np.swapaxes(rotation_from_wpr(-np.asarray(angles, dtype=float)), -1, -2)


def moving_xyz_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Stäubli's rx, ry, rz ``(..., 3)`` [rad] of rotations ``(..., 3, 3)``, each in (-pi, pi].

    ry lies in [-pi/2, pi/2]. Where it is +-pi/2, rz is set to zero.
    """
    R = np.asarray(rotation, dtype=float)
    angles = -wpr_from_rotation(np.swapaxes(R, -1, -2))
    return np.where(angles <= -np.pi, np.pi, angles) + 0.0


def quaternion_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Unit quaternions (w, x, y, z) ``(..., 4)`` of rotations ``(..., 3, 3)``, with w >= 0."""
    R = np.asarray(rotation, dtype=float)
    return batch_last.quaternions_of(_columns(R)).T.reshape(*R.shape[:-2], 4)


def rotation_from_quaternion(quaternion: ArrayLike) -> FloatArray:
    """Rotations ``(..., 3, 3)`` of quaternions (w, x, y, z) ``(..., 4)`` of any norm but zero."""
    q = np.asarray(quaternion, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, v = q[..., :1, None], q[..., 1:]
    # R = I + 2 w K + 2 K²
    K = skew(v)
    return np.asarray(_IDENTITY + 2.0 * (w * K + K @ K))


def rotation_exp(rotation_vector: ArrayLike) -> FloatArray:
    """Rotations ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` [rad]: axis times angle."""
    v = np.asarray(rotation_vector, dtype=float)
    columns = batch_last.rotation_exp(v.reshape(-1, 3).T)
    return batch_last.matrices_of(columns).reshape(*v.shape, 3)


def rotation_log(rotation: ArrayLike) -> FloatArray:
    """Rotation vectors ``(..., 3)`` [rad] of rotations ``(..., 3, 3)``, angle in [0, pi]."""
    R = np.asarray(rotation, dtype=float)
    return batch_last.rotation_log(_columns(R)).T.reshape(R.shape[:-1])


def _columns(R: FloatArray) -> FloatArray:
    """Columns ``(3, 3, S)`` of rotations ``(..., 3, 3)``."""
    return batch_last.columns_of(R.reshape(-1, 3, 3))


def right_jacobian(rotation_vector: ArrayLike) -> FloatArray:
    """``(..., 3, 3)`` that turns a change of rotation vectors ``(..., 3)`` into a turn.

    ``exp(v + dv) = exp(v) exp(J_r(v) dv)`` to first order: the turn is in the axes that v turns
    to. Eq. 143 of Solà et al., "A micro Lie theory for state estimation in robotics" (2018).
    """
    v = np.asarray(rotation_vector, dtype=float)
    square = (v * v).sum(axis=-1)[..., None, None]
    first, second = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    large = square >= _SMALL_ANGLE**2
    if large.any():
        a = np.sqrt(np.where(large, square, 1.0))
        first = np.where(large, (1.0 - np.cos(a)) / a**2, first)
        second = np.where(large, (a - np.sin(a)) / a**3, second)
    K = skew(v)
    return np.asarray(_IDENTITY - first * K + second * (K @ K))


def inverse_left_jacobian(rotation_vector: ArrayLike) -> FloatArray:
    """``(..., 3, 3)`` that turns a turn of rotations into a change of their vectors ``(..., 3)``.

    ``log(exp(w) exp(v)) = v + J_l⁻¹(v) w`` to first order, for angles below 2 pi: Eq. 146 of
    Solà et al. (2018).
    """
    v = np.asarray(rotation_vector, dtype=float)
    square = (v * v).sum(axis=-1)[..., None, None]
    factor = 1.0 / 12.0 + square / 720.0
    large = square >= _SMALL_ANGLE**2
    if large.any():
        a = np.sqrt(np.where(large, square, 1.0))
        # (1 + cos a) / sin a is 1 / tan(a / 2), which is finite at pi
        factor = np.where(large, 1.0 / a**2 - 0.5 / (a * np.tan(a / 2)), factor)
    K = skew(v)
    return np.asarray(_IDENTITY - 0.5 * K + factor * (K @ K))


def rotation_angle(rotation: ArrayLike) -> FloatArray:
    """Angle in [0, pi] [rad] of rotations ``(..., 3, 3)``, accurate near zero and near pi."""
    return np.asarray(np.linalg.norm(rotation_log(rotation), axis=-1))


def frame_about(axis: FloatArray) -> FloatArray:
    """Rotations ``(..., 3, 3)`` whose third columns are unit vectors ``(..., 3)``."""
    x = _IDENTITY[np.abs(axis).argmin(axis=-1)]
    x = x - axis * (axis * x).sum(axis=-1, keepdims=True)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def project_to_rotation(matrix: ArrayLike) -> FloatArray:
    """Nearest rotations (Frobenius norm, determinant +1) to matrices ``(..., 3, 3)``, by SVD.

    What is often called "Rodrigues' formula" in this place cannot make a matrix orthogonal.
    """
    U, _, Vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    sign = np.ones(U.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(U @ Vt))
    return np.asarray((U * sign[..., None, :]) @ Vt)


def rigid(T: ArrayLike, name: str) -> FloatArray:
    """Return checked transforms ``(..., 4, 4)`` with rotations orthonormal to rounding.

    A file holds them less well. A step of Newton's iteration for the nearest rotation squares the
    deviation: two are enough, and far cheaper than the singular values of every one.
    """
    array, deviation = _checked(T, name)
    if deviation.max(initial=0.0) < _EXACT:
        return array
    R = array[..., :3, :3]
    for _ in range(2):
        R = 1.5 * R - 0.5 * R @ np.swapaxes(R, -1, -2) @ R
    return transform(R, array[..., :3, 3])


def columns_if_exactly_rigid(T: FloatArray) -> FloatArray | None:
    """Columns ``(4, 4, S)`` of transforms ``(..., 4, 4)`` that are all rigid, to rounding.

    Their elements column by column, with the transform as the last index; None where any is not.
    """
    if T.ndim < 2 or T.shape[-2:] != (4, 4) or not np.isfinite(T).all():
        return None
    columns, gram, determinant = _columns_gram_and_determinant(T)
    exact = (
        max(gram.max(initial=0.0), -gram.min(initial=0.0)) < _EXACT
        and determinant.min(initial=1.0) > 0.0
        and not columns[:3, 3].any()
        and (columns[3, 3] == 1.0).all()
    )
    return columns if exact else None


def numbers(value: ArrayLike, name: str) -> FloatArray:
    """Return real numbers as a float array: the one given, where it is one.

    Raises
    ------
    InputError
        Text, complex numbers, rows of unequal length, or what is no numbers at all.
    """
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufO":
            return np.asarray(array, dtype=float)
        what = "complex numbers" if array.dtype.kind == "c" else f"of type {array.dtype}"
    except (ValueError, TypeError, OverflowError):
        what = f"a {type(value).__name__}" + (
            " whose parts make no array" if isinstance(value, tuple | list) else ""
        )
    raise InputError(f"{name} is {what}, not an array of real numbers", name=name)


def check_transforms(T: ArrayLike, name: str) -> FloatArray:
    """Return T as a float array ``(..., 4, 4)`` after checking that it is a rigid transform.

    Raises
    ------
    InputError
        Wrong shape, numbers that are not finite, a last row other than (0, 0, 0, 1), a rotation
        part that is not orthonormal, or a left-handed one.
    """
    return _checked(T, name)[0]


def _checked(T: ArrayLike, name: str) -> tuple[FloatArray, FloatArray]:
    """Transforms as a float array, and the largest ``|RᵀR - I|`` of each; see check_transforms."""
    array = numbers(T, name)
    if array.ndim < 2 or array.shape[-2:] != (4, 4):
        raise InputError(f"{name} has shape {array.shape}, not (..., 4, 4)", name=name)
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        raise InputError(f"{name}{_place(where)} is not a finite number", name=name)
    deviation, determinant = _deviation_and_determinant(array)
    if (
        (array[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
        and deviation.max(initial=0.0) <= RIGID_TOLERANCE
        and determinant.min(initial=1.0) > 0.0
    ):
        return array, deviation
    if np.abs(array[..., 3, :] - [0, 0, 0, 1]).max(initial=0.0) > RIGID_TOLERANCE:
        raise InputError(
            f"{name}: the last row of a transform must be 0 0 0 1",
            name=name,
            hint="are the matrices transposed?",
        )
    if deviation.max(initial=0.0) > RIGID_TOLERANCE:
        worst = np.unravel_index(int(np.argmax(deviation)), deviation.shape)
        raise InputError(
            f"{name}{_place(worst)}: the rotation part is not orthonormal "
            f"(off by {deviation.max():.2g})",
            name=name,
            hint="write rotations with at least six decimals",
            value=float(deviation.max()),
            bound=RIGID_TOLERANCE,
        )
    left = determinant < 0.0
    if left.any():
        raise InputError(
            f"{name}{_place(np.argwhere(left)[0])}: the rotation part is left-handed "
            "(determinant -1)",
            name=name,
            hint="an axis is mirrored where the matrix was made",
        )
    return array, deviation


def _deviation_and_determinant(T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Largest |RᵀR - I| and determinant ``(...)`` of the rotations of ``(..., 4, 4)``."""
    _, gram, determinant = _columns_gram_and_determinant(T)
    deviation = np.abs(gram, out=gram).max(axis=(0, 1))
    return deviation.reshape(T.shape[:-2]), determinant.reshape(T.shape[:-2])


def _columns_gram_and_determinant(T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Columns ``(4, 4, S)`` of transforms ``(..., 4, 4)``, RᵀR - I ``(3, 3, S)``, and det R.

    Component by component over all of them: far faster than a product for each.
    """
    columns = np.ascontiguousarray(T.reshape(-1, 4, 4).transpose(2, 1, 0))
    R = columns[:3, :3]
    gram = np.einsum("kis,lis->kls", R, R)
    for k in range(3):
        gram[k, k] -= 1.0
    x, y, z = R
    determinant = (
        x[0] * (y[1] * z[2] - y[2] * z[1])
        + x[1] * (y[2] * z[0] - y[0] * z[2])
        + x[2] * (y[0] * z[1] - y[1] * z[0])
    )
    return columns, gram, determinant


def _place(index: Iterable[SupportsInt]) -> str:
    """Index of one of many for a message; nothing where there is only one."""
    numbers = [int(i) for i in index]
    return str(numbers) if numbers else ""
