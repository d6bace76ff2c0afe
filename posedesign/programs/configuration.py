"""Which of several arm positions a stored Cartesian pose means, in the words of a controller.

A pose of the tool is taken by up to eight arm positions, and by more where joints have several
turns. Each maker has its own words for the one that is meant; they are derived from the joint
values and the geometry of the arm, and serve to choose among the answers of the inverse kinematics.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from typing import ClassVar, Self

import numpy as np

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import FloatArray


class Configuration(ABC):
    """Arm position and turns of joints: one subclass, a frozen dataclass in one file, a maker.

    ``maker``: a key of ``calib.robots.POSITIVE_AXES``. ``form``: of the words; its groups are what
    `_of_groups` takes. ``called``, ``hint``: what the words are called, and how to write them.
    ``counts``: fields that only count turns, quadrants or signs of joints, in the order of the
    words.
    """

    maker: ClassVar[str]
    form: ClassVar[re.Pattern[str]]
    called: ClassVar[str]
    hint: ClassVar[str]
    counts: ClassVar[tuple[str, ...]] = ()

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

    @property
    def counted(self) -> tuple[int, ...]:
        """The numbers of the fields ``counts``."""
        values = [getattr(self, name) for name in self.counts]
        return tuple(np.hstack(values).tolist()) if values else ()

    @abstractmethod
    def allows(self, other: Configuration) -> bool:
        """Whether an arm position with ``other`` is one that is meant by this.

        Some makers' words leave open what they do not say, and numbers agree on either side of a
        boundary nearby (:mod:`~posedesign.programs.configurations.boundaries`).
        """
