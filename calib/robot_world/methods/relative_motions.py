"""What the methods for A X = X B share: motions between the poses, of all pairs of poses.

From ``A_i X = Z B_i`` and the same for j, Z cancels::

    P X = X Q   with   P = A_j⁻¹ A_i,   Q = B_j⁻¹ B_i

the motion of the flange and that of the camera between two poses. Publications leave open which
pairs of poses to take. Taken in sequence, the answer depends on the order of the samples; here all
pairs are taken, so it does not. It still would if each motion were taken in one direction: for
rotations i to j and j to i are the same equation, for translations they are not. Those equations
are therefore taken in both directions. (OpenCV takes all pairs i < j, in one direction.)

Sums over all pairs mostly need no loop over them: what is quadratic in the motions follows from
sums over the poses. Only the logarithms of Park and Martin, and unit axes, go through all pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from calib import se3
from calib.errors import InputError
from calib.robot_world.algebra import apply_matrix, least_squares, triangle
from calib.robot_world.estimate import Estimate
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_MOTIONS_AT_ONCE = 2**15
"""Motions in one step of a sum over all of them: their arrays stay in the cache."""

TOO_MANY = "number of pairs"
"""What the error names where there are more."""

MOST_PAIRS = 5000
"""Pairs whose motions are gone through one by one, some seconds long: 12 million of them."""


def relative(a_i: FloatArray, a_j: FloatArray) -> FloatArray:
    """Products ``a_j* a_i`` ``(4, ...)`` of quaternions ``(4, ...)``, the component first."""
    w_i, x_i, y_i, z_i = a_i
    w_j, x_j, y_j, z_j = a_j
    out = np.empty_like(a_i)
    out[0] = w_j * w_i + x_j * x_i + y_j * y_i + z_j * z_i
    out[1] = w_j * x_i - x_j * w_i - y_j * z_i + z_j * y_i
    out[2] = w_j * y_i - y_j * w_i - z_j * x_i + x_j * z_i
    out[3] = w_j * z_i - z_j * w_i - x_j * y_i + y_j * x_i
    return out


def all_motions(pairs: PairSets) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Quaternions p, q ``(4, T, n)`` of all N (N - 1) / 2 motions, some at a time.

    Their signs agree, ``p x = x q``, since those of the poses do (``pairs.quaternions``): by the
    closed form of all rotations, which knows the sign next to half a turn as well, where the
    usual choice, a scalar part >= 0 in p and in q, may make the two disagree under noise.
    """
    N = pairs.N
    if N > MOST_PAIRS:
        raise InputError(
            f"{N} pairs make {N * (N - 1) // 2} motions, which this method goes through one by one",
            hint=f"give {MOST_PAIRS} pairs at most, or take another method",
            name=TOO_MANY,
            value=N,
            bound=MOST_PAIRS,
        )
    a, b = (_components_first(q) for q in pairs.quaternions)
    count = N * (N - 1) // 2
    at_once = max(1, _MOTIONS_AT_ONCE // pairs.T)
    for first in range(0, count, at_once):
        # poses 1 apart in a ring of N, then 2 apart, up to half the way round
        apart, i = np.divmod(np.arange(first, min(first + at_once, count)), N)
        j = (i + apart + 1) % N
        yield relative(a[..., i], a[..., j]), relative(b[..., i], b[..., j])


def rotation_between_axes(
    pairs: PairSets, length: Callable[[FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    """R_X ``(T, 3, 3)`` that minimises ``Σ |α - R_X β|²``, α and β along the axes of p and q.

    Their length takes the sine and the cosine of half the angle of motions ``(T, n)``, and is
    divided by the sine, which may be 0.

    The minimum is the rotation nearest to ``Σ α βᵀ``. That sum squares the condition: where the
    common axis tilts by τ from pose to pose, rounding costs 1e-16 / τ², below 1e-9 from a tilt of
    0.02 deg on.
    """
    total = np.zeros((pairs.T, 3, 3))
    for p, q in all_motions(pairs):
        # p, q and -p, -q are the same motion: the one below half a turn, by both
        sign = np.where(p[0] + q[0] < 0.0, -1.0, 1.0)
        alpha, beta = (m[1:] * (sign * length(_sine(m), sign * m[0])) for m in (p, q))
        total += alpha.transpose(1, 0, 2) @ beta.transpose(1, 2, 0)
    return se3.project_to_rotation(total)


def _sine(motion: FloatArray) -> FloatArray:
    """Sine of half the angle ``(T, n)`` of the quaternions ``(4, T, n)`` of motions."""
    return np.asarray(np.sqrt(motion[1] ** 2 + motion[2] ** 2 + motion[3] ** 2))


def few_motions(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses i and j ``(m, T, n)`` whose motions stand for those of all pairs of poses.

    Of m numbers of each pose ``(T, N, m)``; n = k (k - 1) / 2, where k is the smaller of N and m.
    The sum of squares of anything bilinear in the numbers of two poses, zero for a pose and itself
    and of the same size both ways, is that over all pairs.

    With more poses than numbers, their QR factor takes their place: it has the same sums of
    products, so the same sums of squares of what is linear in one pose, twice over. Nothing is
    squared, and 1,000 poses cost little more than 10.
    """
    N, m = poses.shape[1:]
    if m < N:
        poses = triangle(poses)
    i, j = np.triu_indices(poses.shape[1], 1)
    by_number = _components_first(poses)
    return by_number[..., i], by_number[..., j]


def vector_rows(p: FloatArray, q: FloatArray) -> FloatArray:
    """Rows ``[P - Q, [P + Q]ₓ]`` ``(T, n, 3, 4)`` of the vectors P, Q of ``(4, T, n)``.

    Times x they are the vector part of ``p x - x q``, where p and q have equal scalar parts, as
    they have without noise.
    """
    P, Q = np.moveaxis(p[1:], 0, -1), np.moveaxis(q[1:], 0, -1)
    return np.concatenate([(P - Q)[..., None], se3.skew(P + Q)], axis=-1)


def translation(pairs: PairSets, R_X: FloatArray) -> FloatArray:
    """p_X ``(T, 3)`` by least squares of ``(R_P - 1) p_X = R_X p_Q - p_P`` over all motions.

    Notes
    -----
    With ``Z_j = R_A R_X R_Bᵀ`` of pose j, the equation times R_A of pose j is the difference of
    ``R_A p_X + p_A - Z_j p_B`` between poses i and j. Summed over all i and j, the least squares
    are those of the N equations ``(R_A - mean) p_X = (Z + Z_i) (p_B - mean) / 2 - (p_A - mean)``,
    Z being the mean of the Z_i.
    """
    A, B = pairs.A, pairs.B
    R_A, R_B = A[..., :3, :3], B[..., :3, :3]
    Z_i = R_A @ R_X[:, None] @ np.swapaxes(R_B, -1, -2)
    p_A, p_B = centred(A[..., :3, 3]), centred(B[..., :3, 3])
    right_side = 0.5 * apply_matrix(Z_i + Z_i.mean(axis=1, keepdims=True), p_B) - p_A
    return least_squares(
        centred(R_A).reshape(pairs.T, 3 * pairs.N, 3), right_side.reshape(pairs.T, 3 * pairs.N)
    )


def complete(pairs: PairSets, R_X: FloatArray, p_X: FloatArray | None = None) -> Estimate:
    """X and Z ``(T, 4, 4)``, Z being the mean of what the pairs say with this X.

    The translation of X is the one of :func:`translation` where none is given.
    """
    p_X = translation(pairs, R_X) if p_X is None else p_X
    mean = apply_matrix(pairs.kronecker_mean, R_X.reshape(-1, 9)).reshape(-1, 3, 3)
    R_Z = se3.project_to_rotation(mean)
    A, B = pairs.A.mean(axis=1), pairs.B.mean(axis=1)
    p_Z = apply_matrix(A[:, :3, :3], p_X) + A[:, :3, 3] - apply_matrix(R_Z, B[:, :3, 3])
    return Estimate(se3.transform(R_X, p_X), se3.transform(R_Z, p_Z))


def centred(values: FloatArray) -> FloatArray:
    """Values ``(T, N, ...)`` less their mean over the pairs."""
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _components_first(values: FloatArray) -> FloatArray:
    """Numbers ``(T, N, m)`` of the poses as ``(m, T, N)``, in that order in memory as well."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))
