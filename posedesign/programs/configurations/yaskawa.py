"""Yaskawa's words for arm positions: ``///RCONF 1,0,0,0,0,0,0,0`` of a job."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, IntArray
from posedesign.programs.configuration import EXACT_DEG, Configuration, beside
from posedesign.programs.configurations.geometry import arm_positions

LENGTHS = (6, 8, 24)
"""Values of a job: as in the manual of NX100, as controllers of its time save them, and from DX100
on."""


@dataclass(frozen=True)
class YaskawaConfiguration(Configuration):
    """``RCONF`` of a Yaskawa controller for a six-axis arm.

    Notes
    -----
    Nothing here was measured on a controller. Order and values of RCONF as in the makers' manuals
    (DX100, HW0482494 p. 4-5; NX100 the same); RoboDK's post-processor writes front/rear first,
    against them. Flip by the angle of R, not by the sign of B as other makers have it: NX100
    operator's manual, RE-CSO-A031 p. 3-76, with the intervals above. Whether later controllers
    (DX200, YRC1000) do the same was not found. The half-open intervals of 180 deg are taken over
    from those of flip. The figures for upper and lower arm, front and rear were not seen: the
    meaning is that of the words, with the wrist centre (B axis) where the manual's list says TCP.

    Turns are told apart within +-360 deg. Values from the seventh on are not of six-axis arms.
    """

    maker: ClassVar[str] = "yaskawa"
    called: ClassVar[str] = "RCONF"
    hint: ClassVar[str] = (
        "write 6, 8 or 24 values, the first six 0 or 1, the others 0: 1,0,0,0,0,0,0,0"
    )
    form: ClassVar[re.Pattern[str]] = re.compile(r"(?:///RCONF\s+)?(\d(?:\s*,\s*\d)*)")
    exact: ClassVar[tuple[str, ...]] = ("lower", "rear")
    near: ClassVar[tuple[str, ...]] = ("no_flip", "r_beyond", "t_beyond", "s_beyond")
    no_flip: int
    """0, flip: R in (-90, 90] deg, or the same a turn further. 1, no flip: R elsewhere."""
    lower: int
    """0, upper arm: wrist centre in front of the line through axes 2 and 3 (L and U), the elbow up.
    1, lower arm: behind it."""
    rear: int  # 0, front: wrist centre in front of axis 1. 1, rear: behind it.
    r_beyond: int
    t_beyond: int
    s_beyond: int  # r_beyond, t_beyond, s_beyond: 0: R, T, S in (-180, 180] deg. 1: beyond.
    beside: tuple[int, ...] = field(default=(), compare=False, repr=False)
    length: int = field(default=LENGTHS[-1], compare=False)
    """Number of values to write, the rest are zero: one of :data:`LENGTHS`."""

    @classmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        arm = arm_positions(robot, postures, cls.maker)
        r, turning = arm.pendant_deg[:, [3]], arm.pendant_deg[:, [3, 5, 0]]
        other = np.hstack([beside(flip_numbers, r), beside(beyond_numbers, turning)])
        where = 1 * arm.behind_line, 1 * arm.behind_axis_1
        return cls._of_columns(*flip_numbers(r).T, *where, *beyond_numbers(turning).T, other)

    @property
    def words(self) -> str:
        """As a job has it behind ``///RCONF``: ``1,0,0,0,0,0,0,0``."""
        own = self.no_flip, self.lower, self.rear, self.r_beyond, self.t_beyond, self.s_beyond
        return ",".join(map(str, [*own, *[0] * (self.length - len(own))]))

    @classmethod
    def _of_groups(cls, *groups: str) -> Self | None:
        values = [int(v) for v in groups[0].split(",")]
        if len(values) not in LENGTHS or max(values[:6]) > 1 or any(values[6:]):
            return None
        no_flip, lower, rear, r, t, s = values[:6]
        return cls(no_flip, lower, rear, r, t, s, length=len(values))


def flip_numbers(r_deg: FloatArray) -> IntArray:
    """0 where the R axis [deg] stands for flip, 1 for no flip."""
    return np.asarray(np.ceil((r_deg - 90.0 - EXACT_DEG) / 180.0) % 2, dtype=np.intp)


def beyond_numbers(angles_deg: FloatArray) -> IntArray:
    """0 where joint values [deg] are in (-180, 180], 1 beyond."""
    high = angles_deg - 180.0 > EXACT_DEG
    return np.asarray(high | (angles_deg + 180.0 <= EXACT_DEG), dtype=np.intp)
