"""Criteria by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, check_type, near_names
from calib.se3 import FloatArray
from posedesign.selection.criteria.base import Criterion
from posedesign.selection.criteria.conditioning import Conditioning, Kind
from posedesign.selection.criteria.deviation import Deviation
from posedesign.selection.criteria.spectrum import Spectrum
from posedesign.selection.criteria.volume import RootVolume, Volume

CRITERIA = {
    "D": "determinant of the information: the volume of the confidence ellipsoid",
    "A": "sum of the variances of the parameters",
    "E": "longest axis of the confidence ellipsoid",
    "C_G": "condition number of Watanabe et al. 2006",
    "cond_2": "ratio of extreme singular values, columns of unit length",
    "O1": "geometric mean of the singular values over the root of the number of poses",
    "O2": "smallest over largest singular value",
    "O3": "smallest singular value",
    "O4": "square of the smallest over the largest singular value",
    "O5": "inverse of the sum of the inverse singular values",
}
"""Name and meaning of the criteria that need nothing but the blocks. Others are made from linear
functions of the parameters: :func:`mean_deviation` and :func:`largest_deviation`."""


def criterion_by_name(
    name: str, parameters: int, count: int, interest: Sequence[int] | None = None
) -> Criterion:
    """The criterion of a name, in any case.

    ``name``: one of :data:`CRITERIA`. ``count``: poses to be chosen. ``interest``: columns of the
    parameters of interest; the others are nuisances, and marginalised. Of D, A and E.
    """
    check_type(name, str, "criterion")
    known = {key.lower(): key for key in CRITERIA}
    key = known.get(name.lower())
    if key is None:
        raise InputError(
            f"there is no criterion {name[:40]!r}",
            hint=near_names(name, list(CRITERIA)),
            name="criterion",
        )
    K = _columns(parameters, interest)
    if interest is not None and key not in ("D", "A", "E"):
        raise InputError(
            f"{key} is of all parameters", hint="leave interest out, or take D, A, E", name=key
        )
    if key == "D":
        return Volume(K if interest is not None else None)
    if key == "A":
        return Deviation(K.T[None], "A", "sum of the variances", squared=True)
    if key == "E":
        title = "smallest eigenvalue of the information"
        return Spectrum(np.inf, "E", title, _inverse, _inverse, K)
    if key == "O1":
        return RootVolume(count)
    if key == "O3":
        title = "smallest singular value"
        return Spectrum(np.inf, "O3", title, lambda c: c**-0.5, lambda v: v**-2.0)
    if key == "O5":
        title, p = "inverse of the sum of the inverse singular values", parameters
        return Spectrum(0.5, "O5", title, lambda c: c**-0.5 / p, lambda v: (p * v) ** -2.0)
    return Conditioning(cast(Kind, key))


def mean_deviation(functions: ArrayLike, name: str = "I", title: str = "") -> Deviation:
    """I-optimality: root mean square error, in the mean over functions ``(K, r, p)``."""
    L = np.asarray(functions, dtype=float)
    stacked = L.reshape(1, -1, L.shape[-1]) / np.sqrt(len(L))
    return Deviation(stacked, name, title or "root mean square error, in the mean")


def largest_deviation(functions: ArrayLike, name: str = "G", title: str = "") -> Deviation:
    """G-optimality: root mean square error of that of functions ``(K, r, p)`` which has most."""
    return Deviation(
        np.asarray(functions, dtype=float), name, title or "largest root mean square error"
    )


def wanted_deviations(wanted: ArrayLike, parameters: int) -> Deviation:
    """Largest standard deviation over that wanted ``(p,)``; infinite where any will do."""
    given = np.asarray(wanted, dtype=float)
    if given.ndim > 1 or (given.ndim == 1 and len(given) != parameters):
        raise InputError(
            f"wanted deviations of shape {given.shape} for {parameters} parameters",
            hint="give one number, or one for each column",
            name="wanted",
        )
    limits = np.array(np.broadcast_to(given, parameters))
    if not (limits > 0.0).all():
        raise InputError(
            "a wanted standard deviation is not above zero",
            hint="leave parameters that may have any infinite",
            name="wanted",
            bound=0.0,
        )
    limited = np.isfinite(limits)
    if not limited.any():
        raise InputError("no standard deviation is wanted", hint="give one", name="wanted")
    rows = np.eye(parameters)[limited] / limits[limited, None]
    return Deviation(rows[:, None, :], "sigma", "largest standard deviation over that wanted")


def _columns(parameters: int, interest: Sequence[int] | None) -> FloatArray:
    if interest is None:
        return np.eye(parameters)
    columns = sorted(set(interest))
    if not columns or columns[0] < 0 or columns[-1] >= parameters:
        raise InputError(
            f"parameters of interest must be columns 0 to {parameters - 1}",
            hint="name one at least, and count from 0",
            name="interest",
        )
    return np.asarray(np.eye(parameters)[:, columns])


def _inverse(value: float) -> float:
    return 1.0 / value
