"""FANUC's words for arm positions: ``CONFIG : 'N U T, 0, 0, 0'``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from posedesign.programs.configuration import EXACT_DEG, Configuration, beside
from posedesign.programs.configurations.geometry import arm_positions

_TOLERANCE_DEG = 5e-4
"""Distance from 180 deg that the controller takes for 180: measured, between 0.0004 and 0.0007."""


@dataclass(frozen=True)
class FanucConfiguration(Configuration):
    """``CONFIG`` of a FANUC controller for a six-axis arm.

    Notes
    -----
    F/N, U/D, T/B and the turns were measured by others on FANUC's simulator (ROBOGUIDE, M-20iD/25,
    16 postures: LeroyDu56/CrossArm, tests/fixtures/probes); the tests repeat them. Two things were
    not: J5 = 0 and -180 deg. Web pages that state the opposite rule for F/N, or other axes for the
    turns, are wrong. How far turns go is not known; one digit is read.

    There is no turn for J3, which goes beyond 360 deg on some arms (M-20iA: 458 deg): the words
    mean both turns of it then.
    """

    maker: ClassVar[str] = "fanuc"
    called: ClassVar[str] = "CONFIG"
    hint: ClassVar[str] = "write F or N, U or D, T or B and the turns of J1, J4, J6: N U T, 0, 0, 0"
    form: ClassVar[re.Pattern[str]] = re.compile(
        r"'?\s*([FN])\s*([UD])\s*([TB])" + r"\s*,\s*(-?\d)" * 3 + r"\s*'?"
    )
    counts: ClassVar[tuple[str, ...]] = ("turns",)
    exact: ClassVar[tuple[str, ...]] = ("flip", "down", "back")
    flip: bool  # F: J5 > 0. N: J5 < 0, which is the usual posture with the tool down, and J5 = 0.
    down: bool
    """D: the wrist centre is behind the line from axis 2 to axis 3. U: in front of it, the elbow
    up."""
    back: bool  # B: the wrist centre is behind axis 1. T: in front of it.
    turns: tuple[int, int, int]
    """Of J1, J4, J6. Turn 0 is (-180, 180) deg, open at both ends: +180 is turn 1, and -180 is
    taken for turn -1. Turn t is the same 360 t deg further."""
    beside: tuple[int, ...] = field(default=(), compare=False, repr=False)

    @classmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        arm = arm_positions(robot, postures, cls.maker)
        angles = arm.pendant_deg[:, [0, 3, 5]]
        return cls._of_columns(
            arm.pendant_deg[:, 4] > EXACT_DEG,
            arm.behind_line,
            arm.behind_axis_1,
            turn_numbers(angles),
            beside(turn_numbers, angles),
        )

    @property
    def words(self) -> str:
        """As a program has it between quotes: ``N U T, 0, 0, 0``."""
        letters = "NF"[self.flip], "UD"[self.down], "TB"[self.back]
        return ", ".join([" ".join(letters), *map(str, self.turns)])

    @classmethod
    def _of_groups(cls, *groups: str) -> Self:
        flip, down, back, *turns = groups
        j1, j4, j6 = map(int, turns)
        return cls(flip == "F", down == "D", back == "B", (j1, j4, j6))


def turn_numbers(angles_deg: FloatArray) -> IntArray:
    """FANUC's turn number of each joint value [deg]."""
    turns = np.floor((np.abs(angles_deg) + 180.0 + _TOLERANCE_DEG) / 360.0)
    return np.asarray(np.sign(angles_deg) * turns, dtype=np.intp)
