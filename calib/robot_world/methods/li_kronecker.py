"""Linear solution of A X = Z B by the Kronecker product (Li, Wang and Wu 2010).

With row-major vec (Eq. 17-19 hold for it, against the paper's Definition 1), one pair gives::

    [ R_A ⊗ 1   -1 ⊗ R_Bᵀ    0    0 ]  [vec R_X]   [ 0 ]
    [    0       1 ⊗ p_Bᵀ  -R_A   1 ]  [vec R_Z] = [p_A]        Eq. 19
                                       [  p_X  ]
                                       [  p_Z  ]

(Eq. 18, corrected: its first unknown is vec R_Z; Eq. 15, corrected: R_A R_X = R_Z R_B.) The nine
rotation rows are numbers without unit and the three translation rows are lengths, added unweighted,
so the answer changes with the unit of length. ``estimate`` divides the lengths by one taken from
the data; ``estimate_literal`` does as printed.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.robot_world.algebra import (
    LEAST_SQUARE,
    apply_matrix,
    kronecker,
    least_squares,
    triangle,
)
from calib.robot_world.closed_form import assemble
from calib.robot_world.estimate import Estimate
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray


def estimate(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once, the same in every unit of length.

    The translation rows are divided by the root mean square distance of the camera's positions
    from their centre, both seen from the target: the length that the rotation of Z turns. The
    translations are solved again after the rotations have been made orthonormal, which removes
    most of the loss that the printed form suffers there.
    """
    p_B = pairs.B[..., :3, 3]
    from_centre = p_B - p_B.mean(axis=1, keepdims=True)
    length = np.sqrt((from_centre**2).sum(axis=-1).mean(axis=-1))
    # A camera that stays in one place gives no length; then Eq. 19 does not fix the scale of R_Z
    # either, whatever the weight, and the misfit of the result says so.
    vec_X, vec_Z, _ = _solve_rows(pairs, np.where(length > 0.0, length, 1.0))
    R_X = se3.project_to_rotation(vec_X.reshape(-1, 3, 3))
    R_Z = se3.project_to_rotation(vec_Z.reshape(-1, 3, 3))
    return Estimate(*assemble(pairs, R_X, R_Z))


def estimate_literal(pairs: PairSets) -> Estimate:
    """X and Z of T problems at once as printed: lengths as given, translations as they come.

    The rotations are made orthonormal by singular value decomposition; the "Rodrigues' formula"
    of the paper cannot do that.
    """
    A, B = pairs.A, pairs.B
    vec_X, vec_Z, p_X = _solve_rows(pairs, np.ones(pairs.T))
    Z_linear = vec_Z.reshape(-1, 3, 3)
    # p_Z of Eq. 19 belongs to the matrix R_Z before it is made orthonormal.
    p_Z = (
        A[..., :3, 3].mean(axis=1)
        + apply_matrix(A[..., :3, :3].mean(axis=1), p_X)
        - apply_matrix(Z_linear, B[..., :3, 3].mean(axis=1))
    )
    R_X = se3.project_to_rotation(vec_X.reshape(-1, 3, 3))
    return Estimate(se3.transform(R_X, p_X), se3.transform(se3.project_to_rotation(Z_linear), p_Z))


def _solve_rows(pairs: PairSets, length: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least-squares vec R_X, vec R_Z ``(T, 9)`` and p_X ``(T, 3)`` of Eq. 19, lengths divided.

    p_Z and vec R_X enter with orthonormal columns and are eliminated exactly. With
    ``k_i = R_A ⊗ R_B`` and its mean K, the rotation rows become ``vec R_X = Kᵀ vec R_Z`` and
    ``(k_i - K)ᵀ vec R_Z = 0``: 12 unknowns in place of 24.
    """
    T, N, K = pairs.T, pairs.N, pairs.kronecker_mean
    numbers = [
        pairs.p_B.reshape(3, T, N),
        pairs.R_A.reshape(9, T, N),
        pairs.p_A.reshape(3, T, N),
    ]
    moved = np.concatenate(numbers).transpose(1, 0, 2)
    moved = moved - moved.mean(axis=-1, keepdims=True)
    products = (moved @ np.swapaxes(moved, -1, -2)).reshape(T, 225) @ _PRODUCTS
    gram = products.reshape(T, 13, 13) / (length**2)[:, None, None]
    # the k_i are orthogonal: the products of the rows (k_i - K)ᵀ add up to N (1 - K Kᵀ)
    gram[:, :9, :9] += N * (np.eye(9) - K @ np.swapaxes(K, -1, -2))
    values, vectors = np.linalg.eigh(gram[:, :12, :12])
    poor = ~(values[:, 0] > LEAST_SQUARE * values[:, -1])
    along = (gram[:, None, 12, :12] @ vectors)[:, 0] / np.where(poor[:, None], 1.0, values)
    solution = apply_matrix(vectors, along)
    if poor.any():  # without sums of products, whatever the condition
        sets, k = PairSets(pairs.A[poor], pairs.B[poor]), K[poor, None]
        turns = np.zeros((sets.T, 9, 13))
        deviation = kronecker(sets.A, sets.B) - k
        turns[..., :9] = triangle(np.swapaxes(deviation, -1, -2).reshape(-1, 9 * N, 9))
        shifts = np.tensordot(np.swapaxes(moved[poor], 1, 2), _ROWS, 1).reshape(-1, 3 * N, 13)
        rows = np.concatenate([turns, shifts / length[poor, None, None]], axis=1)
        solution[poor] = least_squares(rows[..., :12], rows[..., 12])
    vec_Z = solution[:, :9]
    return apply_matrix(np.swapaxes(K, -1, -2), vec_Z), vec_Z, solution[:, 9:]


def _rows() -> FloatArray:
    """Translation rows of Eq. 19 ``(15, 3, 13)``, the right side last, of each unit.

    Of p_B, of the columns of R_A, and of p_A.
    """
    rows = np.zeros((15, 3, 13))
    for axis in range(3):
        rows[:3, axis, 3 * axis : 3 * axis + 3] = np.eye(3)  # 1 ⊗ p_Bᵀ is block diagonal
        for column in range(3):
            rows[3 + 3 * column + axis, axis, 9 + column] = -1.0
        rows[12 + axis, axis, 12] = 1.0
    return rows


_ROWS = _rows()
_PRODUCTS = np.einsum("prc,qrd->pqcd", _ROWS, _ROWS).reshape(225, 169)
"""Sums of products of columns of these rows, by products of the numbers."""
