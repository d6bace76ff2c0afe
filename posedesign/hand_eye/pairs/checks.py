"""Rigid transforms out of numbers that came from a file, and what looks wrong about them.

A file holds rotations as exactly as it has decimals. Up to what four decimals leave they are
taken, as the nearest rotation and with a note; what is farther off is no rotation, and is refused
with the place where it stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib import se3
from calib.errors import FileFormatError
from calib.se3 import BoolArray, FloatArray

LARGEST_DEVIATION = 5e-4
"""Largest |RᵀR - I| of a rotation in a file: rounding to four decimals passes (1.7e-4), to three
(1.7e-3, a tenth of a degree) does not, as it would be the largest error of the whole calibration
without anybody seeing it."""

LARGEST_NORM_DEVIATION = 2.1e-3
"""Largest | |q|² - 1 | of a quaternion in a file: rounding to three decimals, as ``tf_echo``
prints them, passes (2e-3). Unlike with a matrix, nothing but rounding comes so close to 1."""


@dataclass(frozen=True)
class Place:
    """Where the poses of one side stand, for messages.

    ``lines``: lines of a table. ``variable``: name of a variable, in a file that is no table.
    ``marks``: what stands around the number of a pose, behind the name. ``first``: number of the
    first pose.
    """

    path: Path
    lines: tuple[int, ...] = ()
    variable: str = ""
    marks: tuple[str, str] = ("(:,:,", ")")
    first: int = 1

    def name(self, i: int) -> str:
        """``line 7``, or ``T_cam(:,:,6)`` as MATLAB counts, ``T_cam[5]`` as Python does."""
        if not self.variable:
            return f"line {self.lines[i]}"
        return f"{self.variable}{self.marks[0]}{i + self.first}{self.marks[1]}"

    def error(
        self, i: int, message: str, *, column: str | None = None, **details: Any
    ) -> FileFormatError:
        """The error of one pose, with hint, value and bound as any."""
        if self.variable:
            return FileFormatError(message, path=self.path, key=self.name(i), **details)
        row = self.lines[i]
        return FileFormatError(message, path=self.path, row=row, column=column, **details)


def transforms_from_matrices(
    T: FloatArray, place: Place, column: str | None = None
) -> tuple[FloatArray, str]:
    """Rigid transforms ``(N, 4, 4)`` from matrices of a file, and a note where they are rounded."""
    bad = np.asarray(~np.isfinite(T).all(axis=(-2, -1)))
    if bad.any():
        raise place.error(
            int(bad.argmax()),
            "has a number that is not finite" + and_others(bad),
            hint="leave this pose out on both sides",
            column=column,
        )
    _check_last_rows(T, place, column)
    R, note = _rotations_from_matrices(T[:, :3, :3], place, column)
    return se3.transform(R, T[:, :3, 3]), note


def rotations_from_quaternions(q: FloatArray, place: Place, column: str) -> tuple[FloatArray, str]:
    """Rotations ``(N, 3, 3)`` from quaternions (w, x, y, z), and a note where they are rounded."""
    with np.errstate(over="ignore"):
        square = (q**2).sum(axis=-1)
    off = np.abs(square - 1.0)
    bad = ~(off <= LARGEST_NORM_DEVIATION)  # also where the square is too large for a float
    if bad.any():
        i = int(bad.argmax())
        raise place.error(
            i,
            f"the quaternion has the norm {math.sqrt(square[i]):.6g}, not 1" + and_others(bad),
            hint="are these four columns one quaternion, and all of it?",
            column=column,
            value=float(math.sqrt(square[i])),
            bound=1.0,
        )
    return se3.rotation_from_quaternion(q), _rounding_note(off, place)


def _rotations_from_matrices(
    M: FloatArray, place: Place, column: str | None
) -> tuple[FloatArray, str]:
    with np.errstate(over="ignore", invalid="ignore"):
        gram = np.swapaxes(M, -1, -2) @ M
        off = np.abs(gram - np.eye(3)).max(axis=(-2, -1))
    bad = ~(off <= LARGEST_DEVIATION)
    if bad.any():
        i = int(bad.argmax())
        hint, wrong = _scale_hint(gram[i]), f"the rotation is not orthonormal (off by {off[i]:.2g})"
        if hint:
            wrong = f"the rotation is scaled by {math.sqrt(np.trace(gram[i]) / 3.0):.4g}"
        raise place.error(
            i,
            wrong + and_others(bad),
            hint=hint or "write rotations with six decimals or more",
            column=column,
            value=float(off[i]),
            bound=LARGEST_DEVIATION,
        )
    left = np.linalg.det(M) < 0.0
    if left.any():
        raise place.error(
            int(left.argmax()),
            "the rotation is left-handed (determinant -1)" + and_others(left),
            hint="an axis is mirrored where the matrix was made",
            column=column,
        )
    return se3.project_to_rotation(M), _rounding_note(off, place)


def _check_last_rows(T: FloatArray, place: Place, column: str | None) -> None:
    off = np.abs(T[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=-1)
    bad = off > se3.RIGID_TOLERANCE
    if not bad.any():
        return
    i = int(bad.argmax())
    shown = " ".join(f"{number:.4g}" for number in T[i, 3])
    transposed = not T[i, :3, 3].any() and T[i, 3, 3] == 1.0
    raise place.error(
        i,
        f"the last row of the matrix is {shown}, not 0 0 0 1" + and_others(bad),
        hint="it is transposed: give it row by row"
        if transposed
        else "is this a 4x4 matrix [R t; 0 0 0 1]?",
        column=column,
    )


def _scale_hint(gram: FloatArray) -> str:
    square = float((np.diag(gram) / 3.0).sum())  # the sum itself may be too large for a float
    if not (np.isfinite(square) and square > 0.0):
        return ""
    pure = np.abs(gram / square - np.eye(3)).max() <= LARGEST_DEVIATION
    return "divide it by this factor, and look where it comes from" if pure else ""


def and_others(bad: BoolArray) -> str:
    """What to add to the error of one of several bad poses ``(N,)``."""
    count = int(bad.sum()) - 1
    return f", and so on in {count} more" if count else ""


def _rounding_note(off: FloatArray, place: Place) -> str:
    worst = int(off.argmax())
    if off[worst] <= se3.RIGID_TOLERANCE:
        return ""
    return (
        f"rotations are rounded, off by up to {off[worst]:.1g} ({place.name(worst)}): the nearest "
        f"ones are taken, good to about {math.degrees(off[worst]):.1g} deg"
    )
