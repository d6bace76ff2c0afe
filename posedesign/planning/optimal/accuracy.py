"""What a number of poses promises, from their blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import NotIdentifiableError
from calib.identification import check_identifiable
from calib.model import CalibrationModel, Linearisation
from calib.se3 import FloatArray
from posedesign.planning.optimal.objective import Goal


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What a number of poses promises.

    Attributes
    ----------
    poses : int
    value : float
        Of the criterion, as it is shown.
    sigma : ndarray (p,)
        Standard deviations of the parameters [SI].
    tcp_m, tcp_worst_m : float
        Root mean square error of the tool point over the task box, in the mean and where it is
        largest [m].
    """

    poses: int
    value: float
    sigma: FloatArray
    tcp_m: float
    tcp_worst_m: float


def accuracy_of(
    model: CalibrationModel, goal: Goal, box: FloatArray, linear: Linearisation
) -> Accuracy:
    """What postures promise: parameters, criterion, tool point over the box ``(K, 3, p)``."""
    count = len(linear.white_jacobian)
    covariance = _covariance(linear.white_jacobian, model)
    if covariance is None:
        unknown = np.full(model.p, np.inf)
        return Accuracy(count, goal.criterion.shown(np.inf), unknown, np.inf, np.inf)
    squares = np.einsum("krp,pq,krq->k", box, covariance, box, optimize=True)
    return Accuracy(
        count,
        goal.value_of(linear),
        np.sqrt(np.diag(covariance)),
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares.max())),
    )


def _covariance(white: FloatArray, model: CalibrationModel) -> FloatArray | None:
    """Covariance ``(p, p)`` of blocks; None where they do not identify everything."""
    rows = white.reshape(-1, model.p)
    if len(rows) < model.p:
        return None
    try:
        check_identifiable(rows, model.names, model.nuisance)
    except NotIdentifiableError:
        return None
    length = np.linalg.norm(rows, axis=0)
    R = np.linalg.inv(np.linalg.qr(rows / length, mode="r")) / length[:, None]
    return np.asarray(R @ R.T)
