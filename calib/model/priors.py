"""What is known besides the measurements: priors of parameters, and distances between targets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import InputError
from calib.model.parameters import Frames
from calib.se3 import FloatArray

if TYPE_CHECKING:
    from calib.model.calibration_model import CalibrationModel


@dataclass(frozen=True)
class KnownDistance:
    """A distance between two targets that is known from elsewhere.

    Attributes
    ----------
    first, second : str
        Labels of the targets.
    length_m : float
    sigma_m : float
        Standard deviation of the length.
    """

    first: str
    second: str
    length_m: float
    sigma_m: float = 1e-5

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise InputError(
                f"the target {self.first!r} has no distance from itself", name=self.first
            )
        for number, what in ((self.length_m, "length"), (self.sigma_m, "standard deviation")):
            if not (np.isfinite(number) and number > 0):
                raise InputError(
                    f"a distance of targets with a {what} of {number:g} m cannot be known",
                    hint="give metres above zero",
                    name=what,
                    value=number,
                    bound=0.0,
                )


def known_rows(model: CalibrationModel, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is known besides the measurements, whitened: priors, then distances.

    Parameters
    ----------
    x : array (T, p)

    Returns
    -------
    rows : array (T, K)
    jacobian : array (T, K, p)
    """
    held = np.flatnonzero(np.isfinite(model.prior))
    total = len(held) + len(model.distances)
    rows, J = np.zeros((len(x), total)), np.zeros((len(x), total, model.p))
    rows[:, : len(held)] = (x[:, held] - model.nominal[held]) / model.prior[held]
    J[:, np.arange(len(held)), held] = 1.0 / model.prior[held]
    for k, known in enumerate(model.distances, start=len(held)):
        ends, columns = [], []
        for label in (known.first, known.second):
            place, own = _target_place(model, label, x)
            ends.append(place)
            columns.append(own)
        apart = ends[1] - ends[0]
        length = np.linalg.norm(apart, axis=-1, keepdims=True)
        way = apart / np.maximum(length, np.finfo(float).tiny)
        rows[:, k] = (length[:, 0] - known.length_m) / known.sigma_m
        for sign, own in zip((-1.0, 1.0), columns, strict=True):
            if own is not None:
                J[:, k, own] += sign * way / known.sigma_m
    return rows, J


def _target_place(
    model: CalibrationModel, label: str, x: FloatArray
) -> tuple[FloatArray, slice | None]:
    """Place ``(T, 3)`` [m] of a target point, and the columns of its x, y and z if free."""
    for block, part in zip(model.parameters, model.slices, strict=True):
        if label in block.targets and isinstance(block, Frames):
            k = block.labels.index(label)
            if block.size == 0:
                return np.broadcast_to(block.positions_m[k], (len(x), 3)), None
            each = block.size // len(block.labels)
            if each == 3 and set(block.units) == {"m"}:
                own = slice(part.start + 3 * k, part.start + 3 * k + 3)
                return x[:, own], own
    raise InputError(f"the distance to target {label!r} cannot be known: it is no point")
