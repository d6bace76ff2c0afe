"""How well planned poses would determine X and Z, before anything is measured.

The whitened Jacobians of the pairs are blocks ``(N, m, p)`` as of any other model, so that the
same indices and the same selection of poses serve them::

    A = robot.fk(postures)
    blocks = design.blocks(A, X, Z, PairNoise(1e-4, 5e-5))
    posedesign.selection.select_fewest(blocks, wanted)

The information of a pair is that of its residual, with the noise of both sides carried into it.
To first order no unbiased estimate of X and Z scatters less than its inverse (Cramér-Rao). That
holds with noise on both sides, too: of the twelve numbers of a pair the likeliest true A and B take
up six, whatever X and Z are, and the residual is what is left.
"""

from __future__ import annotations

import numpy as np

from calib import se3
from calib.batch_last import columns_of, turn
from calib.errors import InputError
from calib.robot_world.algebra import triangle
from calib.robot_world.errors_of_pairs import derivatives
from calib.robot_world.noise import Noise, check_noise_given
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

NAMES = tuple(
    f"{letter}.{part}{axis}" for letter in "XZ" for part in ("r", "") for axis in ("x", "y", "z")
)
"""Of the twelve columns: X.rx, X.ry, X.rz [rad], X.x, X.y, X.z [m], then those of Z."""

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts, as
for other models: analytic Jacobians leave 1e-15 where nothing is seen."""


def planned_B(A: FloatArray, X: FloatArray, Z: FloatArray) -> FloatArray:
    """What the camera would see without noise: ``B = Z⁻¹ A X``, ``(..., N, 4, 4)``."""
    A, X, Z = _checked(A, X, Z)
    return np.asarray(se3.inverse(Z)[..., None, :, :] @ A @ X[..., None, :, :])


def _checked(
    A: FloatArray, X: FloatArray, Z: FloatArray, *, alike: bool = False
) -> tuple[FloatArray, ...]:
    """Poses, and X and Z of the same problems or of all, as rigid transforms."""
    A, X, Z = (se3.check_transforms(T, name) for T, name in ((A, "A"), (X, "X"), (Z, "Z")))
    try:
        together = np.broadcast_shapes(A.shape[:-3], X.shape[:-2], Z.shape[:-2])
        fit = A.ndim > 2 and A.size > 0 and (not alike or together == A.shape[:-3])
    except ValueError:
        fit = False
    if not fit:
        raise InputError(
            f"shapes {A.shape} of A, {X.shape} of X and {Z.shape} of Z do not go together",
            hint="give A (..., N, 4, 4), X and Z (4, 4) or (..., 4, 4)",
            name="A",
        )
    return A, X, Z


def blocks(A: FloatArray, X: FloatArray, Z: FloatArray, noise: Noise) -> FloatArray:
    """Whitened Jacobians ``(..., N, 6, 12)`` of planned pairs.

    Parameters
    ----------
    A : ndarray (..., N, 4, 4)
        Planned poses, such as ``T_base_flange`` [m].
    X, Z : ndarray (4, 4) or (..., 4, 4)
        Nominal transforms [m]: what is known of them before measuring is enough.
    noise : PairNoise or PairCovariances
        Of the sides that carry it.

    Returns
    -------
    ndarray (..., N, 6, 12)
        Six rows of unit variance for each pair. Columns: X rotation, X translation, Z rotation, Z
        translation [per rad, per m], the errors of
        :class:`~calib.robot_world.results.RobotWorldResult`; named in :data:`NAMES`.

    Raises
    ------
    InputError
        Something that is no rigid transform, or a noise that is zero: nothing would limit how well
        X and Z are known.
    """
    A, X, Z = _checked(A, X, Z, alike=True)
    check_noise_given(noise)
    shape = A.shape
    A = A.reshape(-1, *shape[-3:])
    X, Z = (np.broadcast_to(T, (*shape[:-3], 4, 4)).reshape(-1, 4, 4) for T in (X, Z))
    pairs = PairSets(A, planned_B(A, X, Z))
    R_Z = pairs.spread(columns_of(Z[:, :3, :3]))
    m, q = turn(pairs.R_A, pairs.spread(X[:, :3, 3].T)), turn(R_Z, pairs.p_B)
    white = noise.model(pairs).at(m, R_Z).whiten(derivatives(pairs.R_A, q))
    return np.ascontiguousarray(white.transpose(2, 1, 0)).reshape(*shape[:-2], 6, 12)


def information(blocks: FloatArray) -> FloatArray:
    """Information matrices ``(..., 12, 12)`` of X and Z from blocks ``(..., N, 6, 12)``."""
    rows = _stacked(blocks)
    return np.asarray(np.swapaxes(rows, -1, -2) @ rows)


def covariance(blocks: FloatArray) -> FloatArray:
    """Covariance ``(..., 12, 12)`` [rad, m] of X and Z, by the inverse of the information.

    Infinite throughout where the poses do not determine X and Z.
    """
    rows = _stacked(blocks)
    out = np.full((*rows.shape[:-2], 12, 12), np.inf)
    if rows.shape[-2] < rows.shape[-1]:
        return out
    R = triangle(rows)
    length = np.linalg.norm(R, axis=-2, keepdims=True)
    values = np.linalg.svd(R / np.where(length > 0.0, length, 1.0), compute_uv=False)
    good = values[..., -1] > RANK_TOLERANCE * values[..., 0]
    root = np.linalg.inv(R[good])
    out[good] = root @ np.swapaxes(root, -1, -2)
    return out


def _stacked(blocks: FloatArray) -> FloatArray:
    """All rows of all pairs ``(..., 6N, 12)``."""
    blocks = se3.numbers(blocks, "blocks")
    if blocks.ndim < 3 or blocks.shape[-2:] != (6, 12) or not np.isfinite(blocks).all():
        raise InputError(
            f"blocks of shape {blocks.shape} are not finite numbers (..., N, 6, 12)", name="blocks"
        )
    *batch, N, m, p = blocks.shape
    return blocks.reshape(*batch, N * m, p)
