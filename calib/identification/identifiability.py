"""What a set of measurements can tell about each parameter, before a number is returned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import NotIdentifiableError
from calib.identification.result import DISPLAY
from calib.parameters.base import Unit
from calib.se3 import BoolArray, FloatArray

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts.
Analytic Jacobians leave about 1e-15 where a direction is invisible, and the worst measuring sets
met in practice stay above 1e-6."""

LARGEST_SIGMA: dict[Unit, float] = {"rad": 0.2, "m": 0.2, "rad/Nm": 1e-3}
"""Standard deviations beyond which a number says nothing: a fifth of a radian or of a metre is
farther than the linear model, and any arm that is switched on, reaches."""

_SHARE = 0.02
"""Parameters whose weight in an invisible combination is below this are not named in it."""


def is_identifiable(jacobian: FloatArray) -> bool:
    """Whether the stacked Jacobian ``(M, p)`` can tell all its parameters apart."""
    length = np.linalg.norm(jacobian, axis=0)
    if not (length > RANK_TOLERANCE * length.max(initial=0.0)).all():
        return False
    return _rank_is_full(jacobian / length)


def check_identifiable(
    jacobian: FloatArray, names: Sequence[str], nuisance: BoolArray | None = None
) -> None:
    """Refuse parameters that the stacked Jacobian cannot tell apart, or cannot see.

    Columns are brought to unit length, so that units do not matter. Where the rank is deficient,
    parameters are taken in one by one, those of the set-up first, and each that lies in the span
    of those before it is named together with what it is mixed up with.

    Parameters
    ----------
    jacobian : array (M, p)
        Whitened or not; all rows of all measurements.
    names : sequence of str
    nuisance : array (p,) of bool, optional
        Parameters of the set-up: they have to be free, so they are blamed last.

    Raises
    ------
    NotIdentifiableError
        Naming the parameters to leave out and the invisible combinations.
    """
    if is_identifiable(jacobian):
        return
    length = np.linalg.norm(jacobian, axis=0)
    seen = length > RANK_TOLERANCE * length.max(initial=0.0)
    unit = jacobian[:, seen] / length[seen]
    index = [int(i) for i in np.flatnonzero(seen)]
    first = np.zeros(len(names), dtype=bool) if nuisance is None else nuisance
    order = sorted(range(len(index)), key=lambda k: (not first[index[k]], k))
    refused = [names[int(i)] for i in np.flatnonzero(~seen)]
    why = [f"nothing measured depends on {name}" for name in refused]
    kept: list[int] = []
    for k in order:
        if _rank_is_full(unit[:, [*kept, k]]):
            kept.append(k)
            continue
        refused.append(names[index[k]])
        why.append(_absorbed_by(unit, k, kept, [names[i] for i in index]))
    raise NotIdentifiableError(refused, why)


def check_believable(sigma: FloatArray, names: Sequence[str], units: Sequence[Unit]) -> None:
    """Refuse parameters that are identifiable by the letter, and in practice unknown.

    Parameters
    ----------
    sigma : array (p,)
        Standard deviations [SI].
    names, units : sequence of str

    Raises
    ------
    NotIdentifiableError
        Naming those whose standard deviation is beyond ``LARGEST_SIGMA``.
    """
    hopeless = [
        (name, f"{name} stays uncertain by {s * DISPLAY[unit][1]:.3g} {DISPLAY[unit][0]}")
        for name, unit, s in zip(names, units, sigma, strict=True)
        if not s <= LARGEST_SIGMA[unit]
    ]
    if hopeless:
        raise NotIdentifiableError(
            [name for name, _ in hopeless],
            [f"in the noise, {why}" for _, why in hopeless],
            hint="measure poses that turn the tool farther, or free fewer parameters",
        )


def _rank_is_full(columns: FloatArray) -> bool:
    if columns.shape[0] < columns.shape[1]:
        return False
    values = np.linalg.svd(columns, compute_uv=False)
    return bool(values.size == 0 or values[-1] > RANK_TOLERANCE * values[0])


def _absorbed_by(unit: FloatArray, k: int, kept: list[int], names: list[str]) -> str:
    if not kept:
        return f"{names[k]} stands alone and is not seen"
    weights = np.abs(np.linalg.lstsq(unit[:, kept], unit[:, k], rcond=None)[0])
    partners = [kept[i] for i in np.flatnonzero(weights > _SHARE * weights.max())]
    return f"{names[k]} is absorbed by " + ", ".join(names[i] for i in sorted(partners))
