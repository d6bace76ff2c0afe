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
from operator import attrgetter
from typing import ClassVar, Self

import numpy as np

from calib.errors import InputError
from calib.robots import Robot
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
