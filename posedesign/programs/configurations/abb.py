"""ABB's words for arm positions: the confdata ``[cf1,cf4,cf6,cfx]`` of a robtarget."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from posedesign.programs.configuration import EXACT_DEG, Configuration, beside
from posedesign.programs.configurations.geometry import arm_positions


@dataclass(frozen=True)
class AbbConfiguration(Configuration):
    """``confdata`` of an ABB controller for a six-axis arm.

    Notes
    -----
    The quadrants are documented (RAPID, Basic characteristics). They and the three bits were
    measured by others on ABB's simulator (RobotStudio, IRB 6700-140/2.85, 28 postures:
    LeroyDu56/robconv, tests/fixtures/probes/results); the tests repeat them. Bit 1 is that of the
    line, not of the direction of the forearm: it changed between axis 3 at -81.5 and -82.2 deg, and
    the arm is stretched at -81.83 deg. Axis 5 at zero was not measured.

    Arms of another kind (seven axes, parallel rods, IRB 6400C) use the same four numbers otherwise.
    """

    maker: ClassVar[str] = "abb"
    called: ClassVar[str] = "confdata"
    hint: ClassVar[str] = "write the quadrants of axes 1, 4, 6 and cfx from 0 to 7: [0,-1,0,1]"
    form: ClassVar[re.Pattern[str]] = re.compile(
        r"\[" + r",".join([r"\s*([+-]?\d{1,3})\s*"] * 3) + r",\s*([0-7])\s*\]"
    )
    counts: ClassVar[tuple[str, ...]] = ("cf1", "cf4", "cf6")
    exact: ClassVar[tuple[str, ...]] = ("cfx",)
    cf1: int
    cf4: int
    cf6: int
    """cf1, cf4, cf6: quadrants of axes 1, 4, 6: the angle divided by 90 deg, rounded down. At 0:
    0."""
    cfx: int
    """Bit 0: axis 5 negative. Bit 1: wrist centre behind the line through axes 2 and 3, "behind the
    lower arm". Bit 2: wrist centre behind axis 1."""
    beside: tuple[int, ...] = field(default=(), compare=False, repr=False)

    @classmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        arm = arm_positions(robot, postures, cls.maker)
        angles = arm.pendant_deg[:, [0, 3, 5]]
        negative = arm.pendant_deg[:, 4] < -EXACT_DEG
        cfx = 1 * negative + 2 * arm.behind_line + 4 * arm.behind_axis_1
        return cls._of_columns(*quadrants(angles).T, cfx, beside(quadrants, angles))

    @property
    def words(self) -> str:
        """As a robtarget has it: ``[0,-1,0,1]``."""
        return f"[{self.cf1},{self.cf4},{self.cf6},{self.cfx}]"

    @classmethod
    def _of_groups(cls, *groups: str) -> Self:
        cf1, cf4, cf6, cfx = map(int, groups)
        return cls(cf1, cf4, cf6, cfx)


def quadrants(angles_deg: FloatArray) -> IntArray:
    """ABB's quadrant of each joint value [deg]."""
    return np.asarray(np.floor((angles_deg + EXACT_DEG) / 90.0), dtype=np.intp)
