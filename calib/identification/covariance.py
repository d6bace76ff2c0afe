"""How certain an identification is: before measuring from the plan, and after it from the data."""

from __future__ import annotations

import numpy as np

from calib.identification.identifiability import is_identifiable
from calib.model import CalibrationModel
from calib.se3 import FloatArray, IntArray


def covariance_of(
    model: CalibrationModel,
    q: FloatArray,
    x: FloatArray | None = None,
    target: IntArray | None = None,
    *,
    weighted: bool = True,
) -> FloatArray:
    """Covariance ``(p, p)`` [SI] that the noise of the measurement gives, before measuring.

    Weighted: ``(JᵀJ)⁻¹`` of the whitened Jacobian, the Cramér-Rao bound. Unweighted: the scatter
    of the paper's estimate (Eq. 8), ``G⁺ Σ G⁺ᵀ``, under the same noise. Infinite throughout where
    the postures do not identify all parameters.
    """
    _, J, R = model.linearise(q, x, target)
    white = model.measurement.whiten(J, R)
    if not is_identifiable(white.reshape(-1, model.p)):
        return np.full((model.p, model.p), np.inf)
    if weighted:
        root = np.linalg.pinv(white.reshape(-1, model.p))
        return np.asarray(root @ root.T)
    gain = np.linalg.pinv(J.reshape(-1, model.p)).reshape(model.p, *J.shape[:2])
    rows = J.shape[1]
    # whiten(I) = Σ^(-1/2) of each posture
    unit = np.broadcast_to(np.eye(rows), (*J.shape[:2], rows))
    noise_root = np.linalg.inv(model.measurement.whiten(unit, R))
    spread = np.einsum("pim,imk->pik", gain, noise_root).reshape(model.p, -1)
    return np.asarray(spread @ spread.T)


def best_chi2(J: FloatArray, rows: FloatArray, R: FloatArray, model: CalibrationModel) -> float:
    """Sum of squares of the whitened residuals, where the weighted fit has them.

    After an unweighted fit the residuals are larger than that, by what it gives away, and would
    not have the distribution of chi²: what the parameters could still explain is taken out.

    Parameters
    ----------
    J : array (N, m, p)
    rows : array (N, m)
        Residuals of a fit, weighted or not [m].
    R : array (N, 3, 3)
        Rotations of the tip, see :meth:`CalibrationModel.linearise`.
    model : CalibrationModel
    """
    white = model.measurement.whiten(np.concatenate([J, rows[..., None]], axis=-1), R)
    white = white.reshape(-1, model.p + 1)
    Q = np.linalg.qr(white[:, :-1] / np.linalg.norm(white[:, :-1], axis=0))[0]
    left = white[:, -1] - Q @ (Q.T @ white[:, -1])
    return float(left @ left)


def leave_one_out(
    J: FloatArray, rows: FloatArray, R: FloatArray, model: CalibrationModel, weighted: bool
) -> FloatArray:
    """Rows ``(N, m)`` at each posture, predicted from the fit to all the others.

    In closed form from one fit: ``(I - H_ii)⁻¹ r_i`` with H the hat matrix. Exact where the model
    is linear, and calibrations are nearly so at their solution. A posture without which the
    parameters cannot be identified gives NaN.
    """
    if weighted:
        J, r = model.measurement.whiten(J, R), model.measurement.whiten(rows[..., None], R)
    else:
        r = rows[..., None]
    count, m, p = J.shape
    Q = np.linalg.qr(J.reshape(-1, p) / np.linalg.norm(J.reshape(-1, p), axis=0))[0]
    Q = Q.reshape(count, m, p)
    rest = np.eye(m) - Q @ np.swapaxes(Q, -1, -2)
    alone = np.linalg.svd(rest, compute_uv=False)[:, -1] < 1e-9
    rest[alone] = np.eye(m)
    out = np.linalg.solve(rest, r)
    if weighted:  # back to metres
        unit = np.broadcast_to(np.eye(m), (count, m, m))
        out = np.linalg.solve(model.measurement.whiten(unit, R), out)
    out = out[..., 0]
    out[alone] = np.nan
    return np.asarray(out)
