"""A measuring program, whatever the controller: poses in order, and how each is measured."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError

if TYPE_CHECKING:
    from posedesign.pose_plan import PosePlan

FloatArray = NDArray[np.float64]

FIXED_DATE = datetime(2000, 1, 1)
"""Date written where none is given: the same plan then gives the same file, byte for byte."""

_FINGERPRINT = re.compile(r"[0-9A-Fa-f]{4,16}")


@dataclass(frozen=True, eq=False)
class ProgramPose:
    """One measuring pose, as the posture that takes it.

    Parameters
    ----------
    name : str
        Name of the pose, e.g. the target it measures.
    posture_rad : array_like (n,)
        Joint values [rad], in the signs of the URDF.
    comment : str
        A remark for the operator, shown before the move.
    via : bool
        The arm only passes through, and does not measure.

    Raises
    ------
    InputError
        The posture is not one row of finite numbers.
    """

    name: str
    posture_rad: FloatArray
    comment: str = ""
    via: bool = False

    def __post_init__(self) -> None:
        posture = np.array(self.posture_rad, dtype=float)
        if posture.ndim != 1 or posture.size == 0:
            raise InputError(
                f"pose {self.name!r}: the posture has shape {posture.shape}, not (n,)",
                hint="give one value a joint",
                name=self.name,
            )
        bad = np.flatnonzero(~np.isfinite(posture))
        if bad.size:
            raise InputError(
                f"pose {self.name!r}: J{bad[0] + 1} is {posture[bad[0]]}, not a finite number",
                hint="leave out the poses that no posture takes",
                name=self.name,
                value=float(posture[bad[0]]),
            )
        posture.setflags(write=False)
        object.__setattr__(self, "posture_rad", posture)


@dataclass(frozen=True)
class ProgramOptions:
    """How the poses are visited and measured.

    Parameters
    ----------
    user_frame, tool_frame : int
        Numbers of the frames that are active at each pose.
    speed_percent : int
        Joint speed, 1 to 100 percent.
    settle_s : float
        Time the arm stands still before it is measured [s]; 0 for none.
    measure_call : str or None
        Program called at each pose with the pose's number, counted from 1. None calls nothing.
    comment : str
        Title of the program.
    fingerprint : str
        Short hexadecimal mark of the plan, 4 to 16 digits, which the program carries back with
        its measurements. Empty for none.
    written : datetime
        Date in the program's header.

    Raises
    ------
    InputError
        A number out of its range, or a fingerprint that is not hexadecimal.
    """

    user_frame: int = 0
    tool_frame: int = 1
    speed_percent: int = 10
    settle_s: float = 1.0
    measure_call: str | None = "MEASURE"
    comment: str = ""
    fingerprint: str = ""
    written: datetime = FIXED_DATE

    def __post_init__(self) -> None:
        for name in ("user_frame", "tool_frame", "speed_percent"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer):
                raise InputError(f"{name} is {value!r}, not a whole number", name=name, value=value)
        in_range("speed_percent", self.speed_percent, 1, 100)
        if not np.isfinite(self.settle_s) or self.settle_s < 0:
            raise InputError(
                f"settle_s is {self.settle_s}, not a time",
                hint="give seconds, or 0 for no wait",
                name="settle_s",
                value=self.settle_s,
            )
        if self.fingerprint and not _FINGERPRINT.fullmatch(self.fingerprint):
            raise InputError(
                f"fingerprint {self.fingerprint!r} is not hexadecimal",
                hint="give 4 to 16 digits 0-9 a-f, or nothing",
                name="fingerprint",
                value=self.fingerprint,
            )


@dataclass(frozen=True, eq=False)
class PoseProgram:
    """A program that visits measuring poses in order.

    Parameters
    ----------
    name : str
        Name of the program on the controller; each dialect has its rule for it.
    poses : sequence of ProgramPose
        The poses in the order in which they are visited.
    options : ProgramOptions
        How they are visited and measured.

    Raises
    ------
    InputError
        No poses, or poses of different joint counts.
    """

    name: str
    poses: tuple[ProgramPose, ...]
    options: ProgramOptions = field(default_factory=ProgramOptions)

    def __post_init__(self) -> None:
        poses = tuple(self.poses)
        if not poses:
            raise InputError(
                f"program {self.name!r} has no poses", hint="plan some first", name=self.name
            )
        n = poses[0].posture_rad.size
        for pose in poses:
            if pose.posture_rad.size != n:
                raise InputError(
                    f"pose {pose.name!r} has {pose.posture_rad.size} joint values, "
                    f"pose {poses[0].name!r} has {n}",
                    hint="one program moves one arm",
                    name=pose.name,
                    value=pose.posture_rad.size,
                    bound=n,
                )
        object.__setattr__(self, "poses", poses)

    @classmethod
    def of_plan(
        cls, plan: PosePlan, name: str, options: ProgramOptions | None = None
    ) -> PoseProgram:
        """The program of a plan: its route, with the plan's fingerprint."""
        poses = tuple(ProgramPose(name, posture, via=via) for name, posture, via in plan.stops)
        return cls(name, poses, options or ProgramOptions(fingerprint=plan.fingerprint))

    @property
    def numbers(self) -> tuple[int, ...]:
        """Number of each pose: those that are measured from 1 on, then those passed through."""
        measured = sum(not pose.via for pose in self.poses)
        counts = {False: 0, True: measured}
        numbers = []
        for pose in self.poses:
            counts[pose.via] += 1
            numbers.append(counts[pose.via])
        return tuple(numbers)

    @property
    def postures_rad(self) -> FloatArray:
        """Postures of all poses, shape (N, n) [rad], in the signs of the URDF."""
        return np.stack([pose.posture_rad for pose in self.poses])


def in_range(name: str, value: float, lower: float, upper: float) -> None:
    """Raise InputError where a number is outside its range, limits included."""
    if not lower <= value <= upper:
        raise InputError(
            f"{name} is {value}, outside {lower:g} to {upper:g}",
            hint=f"choose a value from {lower:g} to {upper:g}",
            name=name,
            value=value,
            bound=(lower, upper),
        )
