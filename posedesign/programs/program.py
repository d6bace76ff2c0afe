"""A measuring program, whatever the controller: poses in order, and how each is measured."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal, Protocol, cast, get_args, runtime_checkable

import numpy as np

from calib.errors import InputError, near_names
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.files import program_numbers
from posedesign.programs.arm import Arm
from posedesign.programs.recorded import CORRECTED, PlanMark

FIXED_DATE = datetime(2000, 1, 1)
"""Date written where none is given: the same plan then gives the same file, byte for byte."""

Form = Literal["joint", "cartesian"]
"""Positions as joint values, which leave no branch to choose, or as poses of the tool."""

Keeping = Literal["position", "register"]
"""Where the touched-up position is kept: in the position of the program that it was planned at, or
in a register of its own."""

MOST_WARNINGS = 10
"""Of a kind in the head of a program; lists of a hundred are read by nobody at a pendant."""

_FINGERPRINT = re.compile(r"[0-9a-f]{4,16}")

_WHOLE = {
    "user_frame": program_numbers.FRAME,
    "tool_frame": program_numbers.FRAME,
    "speed_percent": program_numbers.SPEED_PERCENT,
    "first_register": program_numbers.REGISTER,
    "measure_output": program_numbers.OUTPUT,
    "measure_argument": program_numbers.ARGUMENT,
}


@dataclass(frozen=True, eq=False)
class ProgramPose:
    """One measuring pose, as the posture that takes it.

    Raises InputError: the posture is not one row of finite numbers.
    """

    name: str  # of the pose, e.g. the target it measures
    posture_rad: FloatArray  # (n,): joint values [rad], in the signs of the URDF
    comment: str = ""  # a remark for the operator, shown before the move
    via: bool = False  # the arm only passes through, and does not measure

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

    Raises InputError: a number out of its range, or a fingerprint that is not hexadecimal.
    """

    form: Form = "joint"  # how positions are written
    user_frame: int = 0
    tool_frame: int = 1
    """user_frame, tool_frame: numbers of the frames that are active at each pose."""
    speed_percent: int = 10  # joint speed, 1 to 100
    settle_s: float = 1.0  # time the arm stands still before it is measured [s]; 0 for none
    measure_call: str | None = "MEASURE"  # program called at each pose; None: nothing is called
    measure_argument: Literal["number"] | int | None = "number"
    """What it is called with: the pose's number, counted from 1 in the order of the visit; always
    the same whole number; or nothing."""
    measure_output: int | None = None
    """Number of a digital output that is pulsed at each pose, before the call."""
    measure_pulse_s: float = 0.5  # how long [s]
    keep: Keeping = "position"  # where the touched-up position is kept
    first_register: int = 1  # number of the register of the first pose
    guided: bool = True
    """The tool is brought to its target by hand during the call, where the call itself is written
    (UR, Doosan); otherwise the arm stands still, and only the question differs."""
    comment: str = ""  # title of the program
    fingerprint: str = ""
    """Short hexadecimal mark of the plan, 4 to 16 digits, which the program carries back with its
    measurements; empty for none."""
    pulses_per_deg: tuple[float, ...] = ()
    """Encoder pulses of each joint in one degree, signed: for controllers that store pulses."""
    pulses_per_mm: tuple[float, ...] = ()  # the same of each external axis that slides
    written: datetime = FIXED_DATE  # date in the program's header

    @property
    def question(self) -> str:
        """What the operator is asked at each pose."""
        return "Is the tool at its target?" if self.guided else "Is this pose measured?"

    def __post_init__(self) -> None:
        one_of("form", self.form, get_args(Form))
        one_of("keep", self.keep, get_args(Keeping))
        for name, (least, most) in _WHOLE.items():
            value = getattr(self, name)
            if value is not None and value != "number":
                in_range(name, _whole(name, value), least, most)
        for name in ("settle_s", "measure_pulse_s"):
            in_range(name, getattr(self, name), *program_numbers.SECONDS)
        if self.fingerprint and not _FINGERPRINT.fullmatch(self.fingerprint):
            raise InputError(
                f"fingerprint {self.fingerprint!r} is not hexadecimal",
                hint="give 4 to 16 digits 0-9 a-f, or nothing",
                name="fingerprint",
                value=self.fingerprint,
            )

    def argument(self, number: int) -> int | None:
        """What the measuring program is called with at the pose of this number."""
        return number if self.measure_argument == "number" else self.measure_argument


@runtime_checkable
class Planned(Protocol):
    """A plan that can be written as a program: ``posedesign.PosePlan`` or ``OptimalPlan``."""

    @property
    def stops(self) -> list[tuple[str, FloatArray, bool]]:
        """Name, posture ``(n,)`` [rad], and whether it is passed only, of every stop in order."""

    @property
    def fingerprint(self) -> str:
        """Short digest of the measured postures."""

    @property
    def not_checked(self) -> tuple[str, ...]:
        """What planning did not look at, in words."""

    @property
    def model(self) -> CalibrationModel:
        """What it was planned for."""


@dataclass(frozen=True, eq=False)
class PoseProgram:
    """A program that visits measuring poses in order.

    Raises InputError: no poses, or poses of different joint counts.
    """

    name: str  # on the controller; each dialect has its rule for it
    poses: tuple[ProgramPose, ...]  # in the order in which they are visited
    options: ProgramOptions = field(default_factory=ProgramOptions)
    arm: Arm | None = None  # None: each dialect takes its maker's usual one
    first: int = 1  # number of the first measured pose: parts of a plan go on counting
    in_all: int | None = None  # measured poses of the whole plan, where this is a part of it
    not_checked: tuple[str, ...] = ()
    forced: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    made_from: tuple[str, ...] = ()
    short_m: float = 0.0
    corrected_by: str = ""
    """not_checked, forced, simulated, made_from, short_m, corrected_by: what its head says. What
    nobody looked at before it was written; poses that are written although they break a constraint,
    each with the reason; the files that it was made from, in words, those of a simulated robot
    apart; how far before the target the poses stop [m]; the checksum of the identification that the
    poses are corrected by, empty for poses as planned."""

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
        cls, plan: Planned, name: str, options: ProgramOptions | None = None
    ) -> PoseProgram:
        """The program of a plan: its route, with the plan's fingerprint, for its robot."""
        poses = tuple(ProgramPose(name, posture, via=via) for name, posture, via in plan.stops)
        chosen = replace(options or ProgramOptions(), fingerprint=plan.fingerprint)
        arm = Arm.of(plan.model.robot)
        return cls(name, poses, chosen, arm, not_checked=plan.not_checked)

    @property
    def measured_count(self) -> int:
        """Measured poses of the whole plan."""
        own = sum(not pose.via for pose in self.poses)
        return self.first - 1 + own if self.in_all is None else self.in_all

    @property
    def numbers(self) -> tuple[int, ...]:
        """Number of each pose: measured ones in their order, those passed through behind all."""
        counts = {False: self.first - 1, True: self.measured_count}
        numbers = []
        for pose in self.poses:
            counts[pose.via] += 1
            numbers.append(counts[pose.via])
        return tuple(numbers)

    @property
    def registers(self) -> range:
        """Registers that its touched-up positions are kept in; none where they stay in place."""
        first = self.options.first_register + self.first - 1
        own = sum(not pose.via for pose in self.poses)
        return range(first, first + own * (self.options.keep == "register"))

    @property
    def mark(self) -> str:
        """What a comment of the program says of its plan; empty without a fingerprint."""
        fingerprint = self.options.fingerprint
        return PlanMark(fingerprint, self.measured_count).words if fingerprint else ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the head of the program says to whoever runs it, at most so much of each kind."""
        short = (f"{self.short_m * 1e3:g} mm, jog in and touch up",) if self.short_m else ()
        corrected = ("not the poses of the plan",) if self.corrected_by else ()
        return tuple(
            f"{word}: {text}"
            for word, texts in (
                ("SIMULATED, NOT FOR A ROBOT", self.simulated),
                (CORRECTED.format(self.corrected_by), corrected),
                ("STOPS SHORT OF THE TARGET", short),
                ("WRITTEN IN SPITE OF", self.forced),
                ("NOT CHECKED", self.not_checked),
                ("FROM", self.made_from),
            )
            for text in first_of(texts, MOST_WARNINGS)
        )

    def split(self, most: int) -> Iterator[PoseProgram]:
        """Parts of at most so many poses, each ending at one that is measured, where it can.

        Where two or more are passed behind it, at the first of them: the tool has backed off there.
        """
        rest, first = list(self.poses), self.first
        while rest:
            cut = len(rest)
            if cut > most:
                via = [pose.via for pose in rest]
                ends = [k + 1 + all(via[k + 1 : k + 3]) for k in range(most) if not via[k]]
                cut = max((end for end in ends if end <= most), default=most)
            part, rest = tuple(rest[:cut]), rest[cut:]
            yield replace(self, poses=part, first=first, in_all=self.measured_count)
            first += sum(not pose.via for pose in part)

    @property
    def postures_rad(self) -> FloatArray:
        """Postures of all poses, shape (N, n) [rad], in the signs of the URDF."""
        return np.stack([pose.posture_rad for pose in self.poses])


def first_of(texts: Sequence[str], most: int) -> list[str]:
    """At most so many texts, the last of them saying how many there are besides."""
    if len(texts) <= most:
        return list(texts)
    return [*texts[: most - 1], f"and {len(texts) - most + 1} more"]


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


def form_of(word: str) -> Form:
    """The form of this name; InputError with those that there are where it is none."""
    one_of("form", word, get_args(Form))
    return cast(Form, word)


def one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    """Raise InputError where a word is none of those that are known."""
    if value not in known:
        raise InputError(
            f"{name} is {value!r}", hint=near_names(str(value), known), name=name, value=value
        )


def _whole(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(f"{name} is {value!r}, not a whole number", name=name, value=value)
    return int(value)
