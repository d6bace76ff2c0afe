"""How a dialect writes the numbers of a position, and numbers as they stand in a text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

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
from posedesign.programs.arm import Arm
from posedesign.programs.configurations import configuration_of
from posedesign.programs.program import PoseProgram, ProgramPose
from posedesign.programs.writing import plain_all, shown_deg

_MOST_DECIMALS = 12

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])", re.ASCII)


def _euler(first: FloatArray, near: FloatArray) -> FloatArray:
    """Of the two triples of angles [deg] that mean the same the one nearer to ``near``."""
    both = np.stack([first, [first[0] + 180.0, 180.0 - first[1], first[2] + 180.0]])
    both = 180.0 - (180.0 - both) % 360.0
    apart = np.abs(180.0 - (180.0 - (both - near)) % 360.0).max(axis=1)
    return np.asarray(both[int(np.argmin(apart))])


def _vector(first: FloatArray, near: FloatArray) -> FloatArray:
    """Of the two rotation vectors [rad] below a whole turn the one nearer to ``near``."""
    angle = float(np.linalg.norm(first))
    if angle == 0.0:
        return first
    other = first * (1.0 - 2.0 * np.pi / angle)
    return min(first, other, key=lambda v: float(np.linalg.norm(v - near)))


def _quaternion(first: FloatArray, near: FloatArray) -> FloatArray:
    return np.asarray(-first if first @ near < 0 else first)


@dataclass(frozen=True)
class Turn:
    """How a rotation is written: in so many numbers, angles in radians or, ``in_deg``, degrees."""

    count: int
    numbers: Callable[[FloatArray], FloatArray]  # (..., count) of rotation matrices (..., 3, 3)
    read: Callable[[FloatArray], FloatArray]  # and back, of one
    nearest: Callable[[FloatArray, FloatArray], FloatArray] = _euler
    """Of the numbers that mean the same those nearest to others."""
    in_deg: bool = True

    def write(self, R: FloatArray, near: FloatArray) -> FloatArray:
        """Numbers of a rotation ``(3, 3)`` that stay near to those that are there."""
        return self.nearest(self.numbers(R), near)


WPR = Turn(
    3, lambda R: np.rad2deg(wpr_from_rotation(R)), lambda v: rotation_from_wpr(np.deg2rad(v))
)
ABC = Turn(
    3,
    lambda R: np.rad2deg(wpr_from_rotation(R))[..., ::-1],
    lambda v: rotation_from_wpr(np.deg2rad(v[::-1])),
)
MOVING_XYZ = Turn(
    3,
    lambda R: np.rad2deg(moving_xyz_from_rotation(R)),
    lambda v: rotation_from_moving_xyz(np.deg2rad(v)),
)
QUATERNION = Turn(4, quaternion_from_rotation, rotation_from_quaternion, _quaternion, in_deg=False)
VECTOR = Turn(3, rotation_log, rotation_exp, _vector, in_deg=False)


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

    def pose_texts(self, T: FloatArray) -> list[list[str]]:
        """Coordinates and rotation of transforms ``(N, 4, 4)`` [m], as they are written."""
        turned = self.turn.numbers(T[:, :3, :3])
        if self.turn.in_deg:  # half a turn has one name
            turned = np.round(turned, self.turned)
            turned = np.where(turned <= -180.0, 180.0, turned)
        places = T[:, :3, 3] * self.place_unit
        return [
            plain_all(place, self.place) + plain_all(turn, self.turned)
            for place, turn in zip(places, turned, strict=True)
        ]


@dataclass(frozen=True)
class Texts:
    """The numbers of one position as they are written."""

    number: int
    pose: ProgramPose
    joints: list[str]
    external: list[str]
    placed: list[str]  # coordinates and rotation; empty in the joint form
    words: str  # of the arm position; empty without a pose, or where a maker has none


def texts_of(program: PoseProgram, arm: Arm, notation: Notation, external: int) -> list[Texts]:
    """Texts of all positions in the order of the visit, ``external`` with so many decimals.

    Raises InputError: a joint is beyond +-720 deg, or poses cannot be said of this arm.
    """
    rows = shown_deg(arm, program.poses)
    n = rows.shape[1] - arm.n_external
    joints = [plain_all(row, notation.joint) for row in rows[:, :n] * notation.joint_units]
    placed: list[list[str]] = [[]] * len(rows)
    words = [""] * len(rows)
    if program.options.form == "cartesian":
        postures = program.postures_rad
        placed = notation.pose_texts(arm.tool_poses(postures))
        if configuration_of(arm.controller.maker):
            words = [found.words for found in arm.configurations(postures)]
    beside = [plain_all(row, external) if arm.n_external else [] for row in rows[:, n:]]
    listed = zip(program.numbers, program.poses, joints, beside, placed, words, strict=True)
    return [Texts(*each) for each in listed]
