"""Which of several arm positions a stored Cartesian pose means, in the words of a controller.

A pose of the tool is taken by up to eight arm positions, and by more where joints have several
turns. Each maker has its own words for the one that is meant; they are derived from the joint
values and the geometry of the arm, and serve to choose among the answers of the inverse kinematics.

The commonest joint values of all, 0 and 180 deg, are where one maker or another goes from one
number to the next. A pose in a program is rounded, and the joint that was at 0 comes out of the
inverse kinematics at -0.001 deg; what is meant is the same arm position. So the number on the other
side of a boundary nearby is kept, and either is taken. Answers of the inverse kinematics in the
same arm position differ by whole turns: they cannot be mistaken for each other but within the same
distance of a boundary of turns.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import ClassVar, Self

import numpy as np

from calib.errors import InputError
from calib.robots import ChainState, Controller, Robot
from calib.se3 import BoolArray, FloatArray, IntArray

ROUNDING_DEG = 0.02
"""Joint value that the rounding of a pose may turn into another [deg]: programs have angles to
0.005 deg (old Yaskawa jobs) and lengths to 0.005 mm at worst, and a joint turns by some times the
angle where the wrist is not straight."""

EXACT_DEG = 1e-6
"""Distance from a boundary [deg] that counts as on it: what radians and back leave is 1e-13."""


def beside(rule: Callable[[FloatArray], IntArray], angles_deg: FloatArray) -> IntArray:
    """Numbers that a ``rule`` has on the other side of a boundary, where there is one nearby.

    ``rule``: from angles [deg] to numbers, element by element. The result has the shape of
    ``angles_deg``; it has the numbers of the angles themselves where no boundary is near.
    """
    here, below = rule(angles_deg), rule(angles_deg - ROUNDING_DEG)
    return np.where(below != here, below, rule(angles_deg + ROUNDING_DEG))


class Configuration(ABC):
    """Arm position and turns of joints: one subclass, a frozen dataclass in one file, a maker.

    ``maker``: a key of ``calib.robots.POSITIVE_AXES``. ``form``: of the words; its groups are what
    `_of_groups` takes. ``called``, ``hint``: what the words are called, and how to write them.
    ``counts``: fields that only count turns, quadrants or signs of joints, in the order of the
    words. ``exact``: fields that have to be the same; None leaves one open. ``near``: those that
    agree on either side of a boundary nearby, by default ``counts``.
    """

    maker: ClassVar[str]
    form: ClassVar[re.Pattern[str]]
    called: ClassVar[str]
    hint: ClassVar[str]
    counts: ClassVar[tuple[str, ...]] = ()
    exact: ClassVar[tuple[str, ...]] = ()
    near: ClassVar[tuple[str, ...] | None] = None
    _exactly: ClassVar[Callable[[Configuration], tuple[object, ...]]]
    _nearly: ClassVar[Callable[[Configuration], tuple[int, ...]]]

    def __init_subclass__(cls) -> None:
        near = cls.counts if cls.near is None else cls.near
        cls._exactly = attrgetter("maker", *cls.exact)
        cls._nearly = attrgetter(*near) if near else lambda configuration: ()

    @property
    def beside(self) -> tuple[int, ...]:
        """The numbers of ``near`` on the other side of a boundary; empty when read."""
        return ()

    @classmethod
    @abstractmethod
    def of(cls, robot: Robot, postures: FloatArray) -> list[Self]:
        """Of each posture ``(N, n)`` [rad]; InputError for an arm that the words are not for."""

    @property
    @abstractmethod
    def words(self) -> str:
        """As the maker's programs write it."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """The arm position that words mean; InputError where they are not the maker's."""
        found = cls.form.fullmatch(text.strip())
        meant = cls._of_groups(*found.groups()) if found else None
        if meant is None:
            maker = cls.maker.upper() if len(cls.maker) < 6 else cls.maker.title()
            raise InputError(
                f"{cls.called} {text!r} is not one of a six-axis {maker} arm",
                hint=cls.hint,
                name=cls.called,
                value=text,
            )
        return meant

    @classmethod
    @abstractmethod
    def _of_groups(cls, *groups: str) -> Self | None:
        """The arm position of the parts of the words; None where one is out of its range."""

    @classmethod
    def _of_columns(cls, *columns: IntArray | BoolArray) -> list[Self]:
        """One of each row ``(N, ...)`` of the values of the fields."""
        values = (map(tuple, c.tolist()) if c.ndim > 1 else c.tolist() for c in columns)
        return [cls(*row) for row in zip(*values, strict=True)]

    @property
    def counted(self) -> tuple[int, ...]:
        """The numbers of the fields ``counts``."""
        values = [getattr(self, name) for name in self.counts]
        return tuple(np.hstack(values).tolist()) if values else ()

    def allows(self, other: Configuration) -> bool:
        """Whether an arm position with ``other`` is one that is meant by this."""
        if type(self) is not type(other):
            return False
        said, found = type(self)._exactly(self), type(self)._exactly(other)
        open_ = None in said and all(w in (None, f) for w, f in zip(said, found, strict=True))
        if said != found and not open_:
            return False
        a, b = type(self)._nearly(self), type(self)._nearly(other)
        sides = zip(a, self.beside or a, b, other.beside or b, strict=True)
        return a == b or all({w, x} & {y, z} for w, x, y, z in sides)


_ONE_POINT_M = 2e-3
"""Distance of axes 4 and 6 from the wrist centre up to which they meet: frames of calibrated arms
are off by some tenths of a millimetre, wrists that are offset by design by 20 mm and more."""

_PARALLEL = 1e-3
"""Sine of the angle between axes 4 and 5 below which they have no one nearest point."""


@dataclass(frozen=True, eq=False)
class ArmPositions:
    """Arm positions at N postures."""

    pendant_deg: FloatArray
    """(N, 6): joint values with the maker's signs, as the pendant shows them [deg]."""
    front_m: FloatArray
    """(N,): how far the wrist centre is in front of axis 1 [m], seen by the arm: along the
    horizontal direction that is x of the controller's world when joint 1 is at zero, and turns with
    it. Negative behind axis 1."""
    line_m: FloatArray
    """(N,): how far the wrist centre is in front of the line from axis 2 to axis 3 [m], seen by the
    arm: positive where a forearm that points to the front is with the upper arm straight up. Zero
    where the arm is stretched or folded."""

    @property
    def behind_axis_1(self) -> BoolArray:
        """Whether the wrist centre is behind axis 1, ``(N,)``."""
        return self.front_m < 0

    @property
    def behind_line(self) -> BoolArray:
        """Whether the wrist centre is behind the line from axis 2 to axis 3, ``(N,)``.

        With the wrist in front of axis 1 the elbow is then below the line from axis 2 to the wrist.
        """
        return self.line_m < 0


def arm_positions(robot: Robot, postures: FloatArray, maker: str) -> ArmPositions:
    """Arm positions at postures ``(N, 6)`` [rad, signs of the description].

    Raises InputError: the robot does not have this maker's controller, its last three axes do not
    meet, or the postures are not of this robot.
    """
    controller = _controller_of(robot, maker)
    postures = np.atleast_2d(robot.check_posture(postures))
    state = robot.state(postures)
    wrist = wrist_centre(state)
    # positive joint 2 tips the upper arm to the front with every maker: its axis points to the left
    left = state.axes[:, 1] * np.sign(controller.pendant_from_joints[1, 1])
    up = state.axes[:, 0] * np.sign(state.axes[:, 0] @ controller.T_base_world[:3, 2])[:, None]
    front = np.cross(left, up)
    upper_arm = state.origins[:, 2] - state.origins[:, 1]
    upper_arm -= left * _dot(upper_arm, left)[:, None]
    ahead = np.cross(left, upper_arm) / np.linalg.norm(upper_arm, axis=-1)[:, None]
    return ArmPositions(
        pendant_deg=controller.pendant(postures),
        front_m=_dot(wrist - state.origins[:, 0], front),
        line_m=_dot(wrist - state.origins[:, 2], ahead),
    )


def wrist_centre(state: ChainState) -> FloatArray:
    """Where axes 4, 5 and 6 meet, ``(N, 3)`` [m] in the base frame.

    The point of axis 5 nearest to axis 4, which is defined in every posture; axis 6 may lie on
    axis 4.

    Raises InputError: the three axes do not meet.
    """
    a4, a5, a6 = (state.axes[:, j] for j in (3, 4, 5))
    p4, p5, p6 = (state.origins[:, j] for j in (3, 4, 5))
    cosine = _dot(a4, a5)
    sine_squared = 1.0 - cosine**2
    if (sine_squared < _PARALLEL**2).any():
        raise _no_wrist_centre("axes 4 and 5 are parallel")
    apart = p4 - p5
    along = (_dot(apart, a5) - _dot(apart, a4) * cosine) / sine_squared
    centre = p5 + along[:, None] * a5
    miss = max(
        float(np.linalg.norm(np.cross(centre - p, a), axis=-1).max(initial=0.0))
        for p, a in ((p4, a4), (p6, a6))
    )
    if miss > _ONE_POINT_M:
        raise _no_wrist_centre(f"its axes 4, 5 and 6 miss one point by {1e3 * miss:.1f} mm")
    return np.asarray(centre)


def _no_wrist_centre(why: str) -> InputError:
    return InputError(
        f"the arm has no wrist centre: {why}",
        hint="its poses cannot be told apart by words: write the program with joint values",
        name="robot",
    )


def _controller_of(robot: Robot, maker: str) -> Controller:
    controller = robot.controller
    if controller is None or controller.maker != maker:
        found = f"a controller of {controller.maker}" if controller else "no controller"
        raise InputError(
            f"{robot.name} has {found}, these are words of {maker}",
            hint=f"use robot.controlled_by({maker!r}) if that is what it has",
            name=maker,
        )
    return controller


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))


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

    maker = "abb"
    called = "confdata"
    hint = "write the quadrants of axes 1, 4, 6 and cfx from 0 to 7: [0,-1,0,1]"
    form = re.compile(r"\[" + r",".join([r"\s*([+-]?\d{1,3})\s*"] * 3) + r",\s*([0-7])\s*\]")
    counts = ("cf1", "cf4", "cf6")
    exact = ("cfx",)
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

    maker = "fanuc"
    called = "CONFIG"
    hint = "write F or N, U or D, T or B and the turns of J1, J4, J6: N U T, 0, 0, 0"
    form = re.compile(r"'?\s*([FN])\s*([UD])\s*([TB])" + r"\s*,\s*(-?\d)" * 3 + r"\s*'?")
    counts = ("turns",)
    exact = ("flip", "down", "back")
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


_NUMBER = r"(\d{1,3}|'(?:B ?[01]{1,8}|H ?[\dA-F]{1,2})')"

_ARM_BITS = 0b111  # bits of S that say where the arm is
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

    maker = "kuka"
    called = "Status and Turn"
    hint = "write S from 0 to 31 and T from 0 to 63: S 2,T 35 or S 'B010',T 'B100011'"
    form = re.compile(rf"S\s*{_NUMBER}\s*,\s*T\s*{_NUMBER}", re.IGNORECASE)
    counts = ("turn",)
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

    maker = "staubli"
    called = "config"
    hint = "write one of each: " + "; ".join(map("/".join, _TABLES))
    form = re.compile(
        r'(?:shoulder=")?(\w+)(?:"\s+elbow="|[\s,]+)(\w+)(?:"\s+wrist="|[\s,]+)(\w+)"?'
    )
    exact = ("righty", "elbow_negative", "wrist_negative")
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

    maker = "yaskawa"
    called = "RCONF"
    hint = "write 6, 8 or 24 values, the first six 0 or 1, the others 0: 1,0,0,0,0,0,0,0"
    form = re.compile(r"(?:///RCONF\s+)?(\d(?:\s*,\s*\d)*)")
    exact = ("lower", "rear")
    near = ("no_flip", "r_beyond", "t_beyond", "s_beyond")
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


CONFIGURATIONS: dict[str, type[Configuration]] = {
    kind.maker: kind
    for kind in (
        FanucConfiguration,
        KukaConfiguration,
        AbbConfiguration,
        YaskawaConfiguration,
        StaubliConfiguration,
    )
}
"""By maker. A new maker is a new file and one entry here."""


def configuration_of(maker: str) -> type[Configuration] | None:
    """The words of a maker for arm positions; None where it has none."""
    return CONFIGURATIONS.get(maker)


def words(robot: Robot, postures: FloatArray) -> list[str]:
    """The configuration of each posture ``(N, n)`` [rad]; empty where there are no words for it."""
    kind = configuration_of(robot.controller.maker) if robot.controller else None
    if kind is None:
        return [""] * len(postures)
    try:
        return [found.words for found in kind.of(robot, postures)]
    except InputError:  # an arm with another wrist than the words are for
        return [""] * len(postures)
