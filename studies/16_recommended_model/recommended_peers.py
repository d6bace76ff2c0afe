"""Two ways of others on the same measurements, in a few lines each.

Both free six errors of every joint. One drops the columns that others span, found by QR without
pivoting, and fits the rest by weighted least squares with nothing known beforehand, as figaroh
does. The other keeps all of them and pulls them to the description by a small weight, metres and
radians alike, over measurements that are weighed alike, as MUKCa does (Franzese et al. 2025; its
weight of 1e-4 a site on the mean square of each site).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.model.parameters import LinkGeometry, ParameterBlock
from calib.model.parameters.part import Part
from calib.se3 import FloatArray

REDUCED, PULLED = "QR, least squares", "pulled to nominal"
EVALUATIONS = 60

Rows = Callable[[FloatArray], FloatArray]


def all_links(baseline: CalibrationModel) -> CalibrationModel:
    """The baseline, which places tool and targets, with six errors of every joint besides."""
    blocks: list[ParameterBlock] = [LinkGeometry(baseline.robot), *baseline.parameters]
    return baseline.with_parameters(blocks)


def reduced_by_qr(
    whole: CalibrationModel, data: Measurements, planned: FloatArray, tolerance: float
) -> CalibrationModel:
    """The model without link errors whose columns are spanned by those of set-up and others.

    At the postures as planned ``(N, n)``: where tool and target meet by the description, what
    touch-ups cannot see is not seen; those that were measured would show it by their residuals.
    """
    J = whole.linearise(planned, whole.nominal, data.setup, data.observed).white_jacobian
    columns = J.reshape(-1, whole.p)
    length = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(length > 0, length, 1.0)
    order = np.concatenate([np.flatnonzero(whole.nuisance), np.flatnonzero(~whole.nuisance)])
    R = np.linalg.qr(columns[:, order], mode="r")
    kept = {whole.names[k] for k in order[np.abs(np.diag(R)) > tolerance]}
    links = whole.parameters[0]
    part = Part(links, [name for name in links.names if name in kept])
    return whole.with_parameters([part, *whole.parameters[1:]])


def by_least_squares(model: CalibrationModel, data: Measurements, start: FloatArray) -> FloatArray:
    """Parameters ``(p,)`` that leave least, in units of the noise and of priors."""

    def rows(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.white_rows.ravel(), (x - model.nominal) / model.prior])

    def jacobian(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.white_jacobian.reshape(-1, model.p), np.diag(1 / model.prior)])

    return _solved(rows, jacobian, start)


def by_pull(
    model: CalibrationModel, data: Measurements, start: FloatArray, pull: float
) -> FloatArray:
    """Parameters ``(p,)`` that leave least [m, rad], errors of links being pulled to zero."""
    root = np.where(model.nuisance, 0.0, np.sqrt(pull * data.count))

    def rows(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.rows.ravel(), root * (x - model.nominal)])

    def jacobian(x: FloatArray) -> FloatArray:
        found = model.linearise(data.postures, x, data.setup, data.observed)
        return np.concatenate([found.jacobian.reshape(-1, model.p), np.diag(root)])

    return _solved(rows, jacobian, start)


def _solved(rows: Rows, jacobian: Rows, start: FloatArray) -> FloatArray:
    found = least_squares(rows, start, jacobian, method="lm", x_scale="jac", max_nfev=EVALUATIONS)
    return np.asarray(found.x)
