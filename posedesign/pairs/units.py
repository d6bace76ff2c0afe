"""Whether lengths and angles of poses that came from a file can be in the unit that they say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.pairs.checks import Place, and_others

FEWEST_TO_JUDGE = 3
"""Rows from which the unit of a column can be doubted."""

FARTHEST_M = 100.0
"""Distance [m] that no flange has from its base, and no camera from its target."""

NEAREST_M = 0.01
"""Distance [m] that every camera has from its target, and every flange from its base."""


ENDLESS_M = 1e6
"""Distance [m] of nothing that has to do with a robot, whatever the unit: such a number is a mark
for a missing one, or damage, and would drown all others."""

ENDLESS_ANGLE = 1e6
"""The same of angles, in degrees or radians: of the decimals of such a number none is left that
says where it points."""


def refuse_endless_lengths(place: Place, p: FloatArray, column: str | None = None) -> None:
    """Refuse translations ``(N, 3)`` [m] beyond any robot, whether units are trusted or not."""
    _refuse_endless(place, p, ENDLESS_M, "a translation of {:.3g} m is beyond any robot", column)


def refuse_endless_angles(
    place: Place, angles: FloatArray, columns: Sequence[str], unit: str
) -> None:
    """Refuse angles ``(N, 3)`` that are no angles, whether units are trusted or not."""
    said, column = f"an angle of {{:.3g}} {unit} is none", f"{columns[0]} to {columns[-1]}"
    _refuse_endless(place, angles, ENDLESS_ANGLE, said, column)


def _refuse_endless(
    place: Place, numbers: FloatArray, bound: float, said: str, column: str | None
) -> None:
    largest = np.abs(numbers).max(axis=-1)  # no norm, which would overflow
    bad = largest > bound
    if bad.any():
        i = int(bad.argmax())
        raise place.error(
            i,
            said.format(largest[i]) + and_others(bad),
            hint="leave this pose out on both sides",
            column=column,
            value=float(largest[i]),
            bound=bound,
        )


def check_angles(path: Path, columns: tuple[str, ...], angles: FloatArray, unit: str) -> None:
    """Refuse angles ``(N, 3)`` in deg that look like rad, and the other way round."""
    largest = float(np.abs(angles).max())
    if unit == "deg":
        doubtful = len(angles) >= FEWEST_TO_JUDGE and 0.0 < largest <= 2.0 * math.pi
        other = "rad"
    else:
        doubtful, other = largest > 2.0 * math.pi * 1.001, "deg"
    if doubtful:
        names = ", ".join(column.replace(f"_{unit}", f"_{other}") for column in columns)
        long = {"deg": "degrees", "rad": "radians"}
        raise FileFormatError(
            f"the angles look like {long[other]} (the largest is {largest:.4g})",
            path=path,
            column=f"{columns[0]} to {columns[-1]}",
            hint=f"call the columns {names}, or pass --trust-units if they are {long[unit]}",
            value=largest,
            bound=2.0 * math.pi,
        )


def check_lengths(
    place: Place, p: FloatArray, unit: str, remedy: str, column: str | None = None
) -> None:
    """Refuse translations ``(N, 3)`` [m] read in mm that look like m, and the other way round.

    Parameters
    ----------
    place : Place
        Where they stand.
    p : array (N, 3)
        Translations as read [m].
    unit : {"mm", "m"}
        Unit that they were read in.
    remedy : str
        How to say the other unit.
    column : str, optional
        The columns of a table.
    """
    longest = float(np.linalg.norm(p, axis=-1).max())
    short = unit == "mm" and 0.0 < longest < NEAREST_M and len(p) >= FEWEST_TO_JUDGE
    if short or longest > FARTHEST_M:
        other = "m" if unit == "mm" else "mm"
        known = short or unit == "m"
        raise FileFormatError(
            f"no translation is longer than {1e3 * longest:.3g} mm"
            if short
            else f"a translation is {longest:.4g} m long",
            path=place.path,
            column=column,
            key=place.variable or None,
            hint=(f"if these are {other}, {remedy}; " if known else "")
            + "pass --trust-units if it is so",
            value=longest,
            bound=NEAREST_M if short else FARTHEST_M,
        )
