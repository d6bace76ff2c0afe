"""Staubli's words for arm positions: the config of a VAL 3 point."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar, Self

from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.programs.configuration import EXACT_DEG, Configuration
from posedesign.programs.configurations.geometry import arm_positions

SHOULDER = {"righty": True, "lefty": False, "sfree": None}
ELBOW = {"enegative": True, "epositive": False, "efree": None}
WRIST = {"wnegative": True, "wpositive": False, "wfree": None}
"""What each word says of ``behind_axis_1``, ``elbow_negative``, ``wrist_negative``."""

_TABLES = SHOULDER, ELBOW, WRIST


@dataclass(frozen=True)
class StaubliConfiguration(Configuration):
    """``config`` of a Staubli controller for a six-axis arm (RX, TX, TX2).

    Notes
    -----
    Nothing here was measured on a controller. The words are those of VAL 3 (Beckhoff documents them
    as such, TF5130, eConfigShoulder and others). What they mean is from public post-processors:
    RoboDK writes righty for its "rear", enegative for "lower arm" and wnegative for "flip", and
    templates of others have lefty, epositive, wpositive for an arm that reaches to the front. The
    manual's figures were not seen: which shoulder is righty is the least certain.

    The words do not tell turns of joints 1, 4 and 6 apart; the controller takes the nearest. A
    point may leave a word ``free``; ``same`` (as the arm stood before) says nothing of a posture
    alone and is refused.
    """

    maker: ClassVar[str] = "staubli"
    called: ClassVar[str] = "config"
    hint: ClassVar[str] = "write one of each: " + "; ".join(map("/".join, _TABLES))
    form: ClassVar[re.Pattern[str]] = re.compile(
        r'(?:shoulder=")?(\w+)(?:"\s+elbow="|[\s,]+)(\w+)(?:"\s+wrist="|[\s,]+)(\w+)"?'
    )
    exact: ClassVar[tuple[str, ...]] = ("righty", "elbow_negative", "wrist_negative")
    righty: bool | None  # wrist centre behind axis 1; lefty: in front of it. None: free.
    elbow_negative: bool | None
    """Wrist centre behind the line through axes 2 and 3, which is joint 3 negative where axes 3 and
    4 meet. None: free."""
    wrist_negative: bool | None  # joint 5 negative; at zero it is positive. None: free.

    @classmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        arm = arm_positions(robot, postures, cls.maker)
        negative = arm.pendant_deg[:, 4] < -EXACT_DEG
        return cls._of_columns(arm.behind_axis_1, arm.behind_line, negative)

    @property
    def words(self) -> str:
        """As a point of a data file has it: ``shoulder="lefty" elbow="..." wrist="..."``."""
        shoulder, elbow, wrist = (
            next(word for word, value in table.items() if value is getattr(self, name))
            for table, name in zip(_TABLES, self.exact, strict=True)
        )
        return f'shoulder="{shoulder}" elbow="{elbow}" wrist="{wrist}"'

    @classmethod
    def _of_groups(cls, *groups: str) -> Self | None:
        if not all(word in table for word, table in zip(groups, _TABLES, strict=True)):
            return None
        return cls(*(table[word] for word, table in zip(groups, _TABLES, strict=True)))
