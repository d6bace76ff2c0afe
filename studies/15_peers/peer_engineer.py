"""A X = Z B as an engineer would refine it with scipy: a least-squares problem on rotation vectors.

Started at OpenCV's Shah; the residuals are those of the likelihood, R_B = exp([w]) R and
p_B = p + v with w and v divided by their noise; the Jacobian is by two-point differences.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from calib.se3 import FloatArray


def refined(
    A: FloatArray,
    B: FloatArray,
    start: tuple[FloatArray, FloatArray],
    rotation_rad: float,
    translation_m: float,
) -> tuple[FloatArray, FloatArray, OptimizeResult]:
    """X and Z ``(4, 4)`` of pairs ``(N, 4, 4)`` with noise on B, and what scipy says."""
    R_A, p_A, R_B, p_B = A[:, :3, :3], A[:, :3, 3], B[:, :3, :3], B[:, :3, 3]

    def rows(v: FloatArray) -> FloatArray:
        R_X, R_Z = Rotation.from_rotvec(v[:6].reshape(2, 3)).as_matrix()
        R = R_Z.T @ R_A @ R_X
        p = (R_A @ v[6:9] + p_A - v[9:]) @ R_Z
        turn = Rotation.from_matrix(R_B @ R.transpose(0, 2, 1)).as_rotvec()
        return np.concatenate([turn / rotation_rad, (p_B - p) / translation_m]).ravel()

    turns = Rotation.from_matrix([T[:3, :3] for T in start]).as_rotvec()
    first = np.concatenate([turns.ravel(), *(T[:3, 3] for T in start)])
    found = least_squares(rows, first, method="lm", x_scale="jac")
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3], Z[:3, :3] = Rotation.from_rotvec(found.x[:6].reshape(2, 3)).as_matrix()
    X[:3, 3], Z[:3, 3] = found.x[6:9], found.x[9:]
    return X, Z, found
