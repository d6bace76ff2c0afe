"""Criteria by name."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, check_type, near_names
from calib.se3 import FloatArray
from posedesign.selection.candidates import Candidates
from posedesign.selection.conditioning import Kind, conditioning
from posedesign.selection.criterion import Criterion
from posedesign.selection.variances import DeviationObjective, SpectrumObjective, VolumeObjective

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

_AXES: dict[str, tuple[float, str, float, bool]] = {
    "E": (np.inf, "smallest eigenvalue of the information", -1.0, False),
    "O3": (np.inf, "smallest singular value", -0.5, False),
    "O5": (0.5, "inverse of the sum of the inverse singular values", -0.5, True),
}
"""Of criteria along the axes of the ellipsoid: order of the mean, title, power of the mean variance
that is shown, and whether that is divided by the number of parameters."""


def criterion_by_name(
    name: str, parameters: int, count: int, interest: Sequence[int] | None = None
) -> Criterion:
    """The criterion of a name of :data:`CRITERIA`, in any case.

    ``count``: poses to be chosen. ``interest``: columns of the parameters of interest; the others
    are nuisances, and marginalised. Of D, A and E.
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
    if key == "A":
        return _deviation(K.T[None], "A", "sum of the variances", squared=True)
    if key == "D":
        return Criterion(
            "D", "det(information)^(1/p)", False, partial(_volume, K), _inverse, _inverse
        )
    if key == "O1":
        return Criterion(
            "O1",
            "geometric mean of the singular values over sqrt(poses)",
            False,
            partial(_volume, K),
            lambda cost: float(np.sqrt(_inverse(cost) / count)),
            lambda value: _inverse(value**2 * count),
            falls_with_poses=False,
        )
    if key in _AXES:
        order, title, power, by_number = _AXES[key]
        p = parameters if by_number else 1
        return Criterion(
            key,
            title,
            False,
            lambda candidates: SpectrumObjective(candidates, K / candidates.scale[:, None], order),
            lambda cost: cost**power / p if cost > 0.0 else np.inf,
            lambda value: (p * value) ** (1.0 / power) if value > 0.0 else np.inf,
        )
    return conditioning(cast(Kind, key))


def _volume(K: FloatArray, candidates: Candidates) -> VolumeObjective:
    return VolumeObjective(candidates, K / candidates.scale[:, None])


def _inverse(value: float) -> float:
    return 1.0 / value if value > 0.0 else np.inf


def mean_deviation(functions: ArrayLike, name: str = "I", title: str = "") -> Criterion:
    """I-optimality: root mean square error, in the mean over functions ``(K, r, p)``."""
    L = np.asarray(functions, dtype=float)
    stacked = L.reshape(1, -1, L.shape[-1]) / np.sqrt(len(L))
    return _deviation(stacked, name, title or "root mean square error, in the mean")


def largest_deviation(functions: ArrayLike, name: str = "G", title: str = "") -> Criterion:
    """G-optimality: root mean square error of that of functions ``(K, r, p)`` which has most."""
    L = np.asarray(functions, dtype=float)
    return _deviation(L, name, title or "largest root mean square error")


def _deviation(L: FloatArray, name: str, title: str, *, squared: bool = False) -> Criterion:
    """Largest error of functions ``(K, r, p)``; ``squared``: shown as its square, as A is known."""
    if L.ndim != 3 or 0 in L.shape:
        raise InputError(
            f"functions of the parameters have shape (K, r, p), not {L.shape}", name=name
        )
    if not np.isfinite(L).all() or not L.any(axis=(1, 2)).all():
        raise InputError("a function of the parameters is zero or not finite", name=name)

    def on(candidates: Candidates) -> DeviationObjective:
        if L.shape[2] != candidates.p:
            raise InputError(
                f"functions of {L.shape[2]} parameters, blocks of {candidates.p}", name=name
            )
        return DeviationObjective(candidates, L / candidates.scale)

    return Criterion(
        name,
        title,
        True,
        on,
        lambda cost: cost if squared else float(np.sqrt(cost)),
        lambda value: value if squared else value**2,
    )


def wanted_deviations(wanted: ArrayLike, parameters: int) -> Criterion:
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
    return _deviation(rows[:, None, :], "sigma", "largest standard deviation over that wanted")


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
