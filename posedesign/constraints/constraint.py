"""What all constraints have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from calib.se3 import FloatArray, IntArray
from posedesign.constraints.situation import Situation

ROUNDING = 1e-9
"""A bound that is broken by no more [SI] is kept: computing a posture rounds that much."""


class Constraint(ABC):
    """A bound that postures keep or break, and by how much.

    Attributes
    ----------
    name : str
        What is bounded, as tables head it.
    unit : str
        Of the room as people read it.
    display : float
        Factor from SI to that unit.
    measured : bool
        Whether the room is a measure, or only says yes or no.
    comfort : float
        Room [SI] that counts as plenty. Divided by it, rooms of different kinds can be compared.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    display: ClassVar[float]
    comfort: ClassVar[float]
    measured: ClassVar[bool] = True

    @abstractmethod
    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """How far each posture is inside the bound, and what comes nearest to breaking it.

        Returns
        -------
        room : array (S,)
            [SI]; negative where the bound is broken, infinite where nothing is near.
        which : array (S,)
            Index of the joint, the pair of bodies, ... that :meth:`says` will be asked for.
        """

    @abstractmethod
    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        """In words, how posture i keeps or breaks the bound."""

    @abstractmethod
    def remedy(self, room: float) -> str:
        """What to change in ``cell.toml`` where the bound is broken by this much, or nothing."""
