"""KUKA's words for arm positions: ``S 2,T 35`` of a POS or E6POS, Status and Turn."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.programs.configuration import EXACT_DEG, ROUNDING_DEG, Configuration
from posedesign.programs.configurations.geometry import arm_positions

_NUMBER = r"(\d{1,3}|'(?:B ?[01]{1,8}|H ?[\dA-F]{1,2})')"

_ARM_BITS = 0b111
"""Bits of S that say where the arm is."""

_LARGEST_STATUS, _LARGEST_TURN = 0b11111, 0b111111


@dataclass(frozen=True)
class KukaConfiguration(Configuration):
    """Status and Turn of a KUKA controller for a six-axis arm.

    Notes
    -----
    Nothing here was measured on a controller. Bits of S as Beckhoff documents them for KUKA's kind
    of arm (TF5200, Status & Turn: "in front of the straight line through axes A2 and A3" adds 2);
    Siemens' manual of the same arms has bit 1 set for A3 >= 0 where axes 3 and 4 meet, which agrees
    (SINUMERIK ONE, NC programming, STAT). One web page has bit 1 the other way round. The common
    home posture (0, -90, 90, 0, 0, 0) has S 2 here. A5 beyond +-180 deg and bits 3 and 4 (4: taught
    with an absolutely accurate arm) are from memory. KUKA's own manuals were not seen.

    T tells a joint value from the same one a turn further only within +-360 deg. Controllers are
    reported to ignore bits of T of axes within 2 deg of zero.
    """

    maker: ClassVar[str] = "kuka"
    called: ClassVar[str] = "Status and Turn"
    hint: ClassVar[str] = (
        "write S from 0 to 31 and T from 0 to 63: S 2,T 35 or S 'B010',T 'B100011'"
    )
    form: ClassVar[re.Pattern[str]] = re.compile(
        rf"S\s*{_NUMBER}\s*,\s*T\s*{_NUMBER}", re.IGNORECASE
    )
    counts: ClassVar[tuple[str, ...]] = ("turn",)
    status: int
    """Bit 0: wrist centre behind axis 1, the overhead area. Bit 1: wrist centre in front of the
    line through axes 2 and 3, which is A3 above its in-line angle (0 for arms whose axes 3 and 4
    meet, a few degrees for others). Bit 2: A5 in [-180, 0) deg, or from 180 deg. Bits 3 and 4 say
    nothing of the arm, and are written as zero."""
    turn: int  # bit i - 1: axis i negative, for A1 to A6
    loose: int = field(default=0, compare=False, repr=False)
    """Bits of ``turn`` of axes so near to zero that the rounding of a pose may change their sign;
    zero when read."""

    @classmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        arm = arm_positions(robot, postures, cls.maker)
        angles = arm.pendant_deg
        flipped = np.floor((angles[:, 4] + EXACT_DEG) / 180.0) % 2 == 1
        status = 1 * arm.behind_axis_1 + 2 * ~arm.behind_line + 4 * flipped
        bit = 1 << np.arange(angles.shape[1])
        turn = (angles < -EXACT_DEG) @ bit
        loose = (np.abs(angles) < ROUNDING_DEG) @ bit
        return cls._of_columns(status, turn, loose)

    @property
    def words(self) -> str:
        """As a POS has it: ``S 2,T 35``."""
        return f"S {self.status},T {self.turn}"

    @classmethod
    def _of_groups(cls, *groups: str) -> Self | None:
        status, turn = map(_integer, groups)
        fits = status <= _LARGEST_STATUS and turn <= _LARGEST_TURN
        return cls(status, turn) if fits else None

    def allows(self, other: Configuration) -> bool:
        return (
            isinstance(other, KukaConfiguration)
            and self.status & _ARM_BITS == other.status & _ARM_BITS
            and not (self.turn ^ other.turn) & ~(self.loose | other.loose)
        )


def _integer(text: str) -> int:
    base = {"B": 2, "H": 16}.get(text[1:2].upper(), 10)
    return int(text if base == 10 else text[2:-1], base)
