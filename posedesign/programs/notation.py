"""How a dialect writes the numbers of a position, and numbers as they stand in a text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import (
    FloatArray,
    moving_xyz_from_rotation,
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_moving_xyz,
    rotation_from_quaternion,
    rotation_from_wpr,
    rotation_log,
    wpr_from_rotation,
)

_MOST_DECIMALS = 12

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])", re.ASCII)


def _euler(
    R: FloatArray, angles: Callable[[ArrayLike], FloatArray], near: FloatArray
) -> FloatArray:
    """Angles [deg] of a rotation, of the two triples the one nearer to ``near``."""
    first = np.rad2deg(angles(R))
    both = np.stack([first, [first[0] + 180.0, 180.0 - first[1], first[2] + 180.0]])
    both = 180.0 - (180.0 - both) % 360.0
    apart = np.abs(180.0 - (180.0 - (both - near)) % 360.0).max(axis=1)
    return np.asarray(both[int(np.argmin(apart))])


def _vector(R: FloatArray, near: FloatArray) -> FloatArray:
    """Rotation vector [rad], of the two below a whole turn the one nearer to ``near``."""
    first = rotation_log(R)
    angle = float(np.linalg.norm(first))
    if angle == 0.0:
        return first
    other = first * (1.0 - 2.0 * np.pi / angle)
    return min(first, other, key=lambda v: float(np.linalg.norm(v - near)))


def _quaternion(R: FloatArray, near: FloatArray) -> FloatArray:
    found = quaternion_from_rotation(R)
    return np.asarray(-found if found @ near < 0 else found)


@dataclass(frozen=True)
class Turn:
    """How a rotation is written: how many numbers, and to a rotation matrix ``(3, 3)`` and back.

    ``write`` is given the numbers that are there, too, and stays near to them.
    """

    count: int
    read: Callable[[FloatArray], FloatArray]
    write: Callable[[FloatArray, FloatArray], FloatArray]
    in_deg: bool = True


WPR = Turn(
    3,
    lambda v: rotation_from_wpr(np.deg2rad(v)),
    lambda R, near: _euler(R, wpr_from_rotation, near),
)
ABC = Turn(
    3,
    lambda v: rotation_from_wpr(np.deg2rad(v[::-1])),
    lambda R, near: _euler(R, wpr_from_rotation, near[::-1])[::-1],
)
MOVING_XYZ = Turn(
    3,
    lambda v: rotation_from_moving_xyz(np.deg2rad(v)),
    lambda R, near: _euler(R, moving_xyz_from_rotation, near),
)
QUATERNION = Turn(4, rotation_from_quaternion, _quaternion, in_deg=False)
VECTOR = Turn(3, rotation_exp, _vector, in_deg=False)


@dataclass(frozen=True)
class Literal:
    """A number as it stands in a text; ``before`` and ``after``: what it has to be put between."""

    start: int
    end: int
    text: str
    scale: float = 1.0  # its value over that of the number, where a function stands around it
    before: str = ""
    after: str = ""

    @property
    def value(self) -> float:
        """In the unit of the dialect."""
        return float(self.text) * self.scale

    def decimals(self, least: int) -> int:
        """To write it with: as many as it has, and at least so many."""
        if self.scale != 1.0:
            least += 2
        own = len(self.text.partition(".")[2]) if "e" not in self.text.lower() else 0
        return min(max(least, own), max(least, _MOST_DECIMALS))


def literals_of(text: str) -> Iterator[Literal]:
    """All numbers of a text."""
    for found in _NUMBER.finditer(text):
        in_degrees = text.endswith("d2r(", 0, found.start())
        yield Literal(*found.span(), found[0], np.pi / 180 if in_degrees else 1.0)


@dataclass(frozen=True, eq=False)
class Notation:
    """How a dialect writes the numbers of a position."""

    joint: int = 6
    place: int = 4
    turned: int = 5
    """joint, place, turned: decimals that are written at least, of joint values, coordinates and
    rotations."""
    joint_units: float | FloatArray = 1.0
    """(n,): number in the file over the joint value in degrees; with 0 decimals numbers are
    whole."""
    place_unit: float = 1e3  # number in the file over the coordinate in metres
    turn: Turn = WPR  # the rotation
    literals: Callable[[str], Iterator[Literal]] = literals_of
    """All numbers of a text that can be a position's, in their order."""
    counts_at: int = 0
    """Where the numbers that count turns begin, from the first one of a pose on; 0: nowhere."""
    repeated: bool = False
    """Whether a position can stand there again before the next one: the arm stands at it."""
