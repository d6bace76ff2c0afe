"""What a set of measurements can tell about each parameter, before a number is returned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import NotIdentifiableError
from calib.identification.result import DISPLAY
from calib.model.parameters import Unit
from calib.se3 import BoolArray, FloatArray

RANK_TOLERANCE = 1e-9
"""Smallest singular value, relative to the largest, of columns of unit length that still counts.
Analytic Jacobians leave about 1e-15 where a direction is invisible, and the worst measuring sets
met in practice stay above 1e-6."""

LARGEST_SIGMA: dict[Unit, float] = {"rad": 0.2, "m": 0.2, "rad/Nm": 1e-3, "rad/rad": 0.2}
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


@dataclass(frozen=True)
class Sorting:
    """Parameters sorted into those that a Jacobian can tell apart and the rest.

    Attributes
    ----------
    kept : tuple of int
        Columns, in order.
    left_out : tuple of int
    why : tuple of str
        Of each column left out, in words.
    """

    kept: tuple[int, ...]
    left_out: tuple[int, ...]
    why: tuple[str, ...]


def sort_out(
    jacobian: FloatArray,
    names: Sequence[str],
    *,
    first: BoolArray | None = None,
    least: FloatArray | None = None,
) -> Sorting:
    """Sort out the columns that lie in the span of those before them.

    Columns are brought to unit length, so that units do not matter, and taken in one by one.
    Gram-Schmidt, each column twice: what rounding leaves of the first pass goes in the second.

    Parameters
    ----------
    jacobian : array (M, p)
        All rows of all measurements; whitened where ``least`` is given.
    names : sequence of str
    first : array (p,) of bool, optional
        Columns that are taken in before the others, whatever their place.
    least : array (p,), optional
        Length that a column must have left, besides being independent: the inverse of the largest
        standard deviation that is worth having.
    """
    length = np.linalg.norm(jacobian, axis=0)
    seen = length > RANK_TOLERANCE * length.max(initial=0.0)
    before = np.zeros(len(names), dtype=bool) if first is None else first
    needed = np.zeros(len(names)) if least is None else least
    order = sorted(range(len(names)), key=lambda k: (not before[k], k))
    kept: list[int] = []
    left_out: list[int] = [int(k) for k in np.flatnonzero(~seen)]
    why = [f"nothing measured depends on {names[k]}" for k in left_out]
    basis = np.zeros((jacobian.shape[0], 0))
    for k in (k for k in order if seen[k]):
        unit = jacobian[:, k] / length[k]
        rest = unit - basis @ (basis.T @ unit)
        rest -= basis @ (basis.T @ rest)
        left = float(np.linalg.norm(rest))
        if len(kept) < len(jacobian) and left > RANK_TOLERANCE and left * length[k] > needed[k]:
            kept.append(k)
            basis = np.column_stack([basis, rest / left])
        else:
            left_out.append(k)
            why.append(_absorbed_by(jacobian / np.where(seen, length, 1.0), k, kept, names))
    return Sorting(tuple(sorted(kept)), tuple(left_out), tuple(why))


def check_identifiable(
    jacobian: FloatArray, names: Sequence[str], nuisance: BoolArray | None = None
) -> None:
    """Refuse parameters that the stacked Jacobian cannot tell apart, or cannot see.

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
    found = sort_out(jacobian, names, first=nuisance)
    if found.left_out:
        raise NotIdentifiableError([names[k] for k in found.left_out], found.why)


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


_IN_WORDS = {"tool": "the tool point", "target": "the targets"}
_MOST_NAMED = 6


def _absorbed_by(unit: FloatArray, k: int, kept: list[int], names: Sequence[str]) -> str:
    if not kept:
        return f"{names[k]} stands alone and is not seen"
    weights = np.abs(np.linalg.lstsq(unit[:, kept], unit[:, k], rcond=None)[0])
    partners = sorted(kept[i] for i in np.flatnonzero(weights > _SHARE * weights.max()))
    listed = [names[i] for i in partners]
    shown = ", ".join(listed[:_MOST_NAMED])
    if len(listed) > _MOST_NAMED:
        shown += f" and {len(listed) - _MOST_NAMED} more"
    kinds = {name.partition(".")[0] for name in listed}
    if len(kinds) == 1 and kinds <= set(_IN_WORDS):
        shown = f"{_IN_WORDS[kinds.pop()]} ({shown})"
    return f"{names[k]} is absorbed by {shown}"
