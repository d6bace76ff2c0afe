"""What all constraints have in common, and postures as every one of them looks at them:
with forward kinematics done once for all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from calib.robots import ChainState, SerialChain
from calib.se3 import FloatArray, IntArray


class Situation:
    """An arm at postures ``(S, n)`` [rad].

    ``q`` (S, n). ``depths``: whether somebody reads how deep meshes are in what they run into.
    """

    def __init__(
        self,
        chain: SerialChain,
        q: FloatArray,
        state: ChainState | None = None,
        *,
        depths: bool = False,
    ) -> None:
        self.chain = chain
        self.q = q
        self.depths = depths
        if state is not None:
            self.state = state

    @cached_property
    def state(self) -> ChainState:
        """Where joints and tip are."""
        return self.chain.forward(self.q)

    def take(self, rows: IntArray) -> Situation:
        """The same at some of the postures."""
        state = self.__dict__.get("state")
        some = None if state is None else _rows(state, rows)
        return Situation(self.chain, self.q[rows], some, depths=self.depths)


def _rows(state: ChainState, rows: IntArray) -> ChainState:
    return ChainState(
        rotations=state.rotations[rows],
        origins=state.origins[rows],
        axes=state.axes[rows],
        R_base_tip=np.asarray(state.R_base_tip[rows]),
        p_base_tip=np.asarray(state.p_base_tip[rows]),
    )


ROUNDING = 1e-9
"""A bound that is broken by no more [SI] is kept: computing a posture rounds that much."""


class Constraint(ABC):
    """A bound that postures keep or break, and by how much.

    ``name``: what is bounded, as tables head it. ``unit``: of the room as people read it.
    ``display``: factor from SI to that unit. ``measured``: whether the room is a measure, or only
    says yes or no. ``comfort``: room [SI] that counts as plenty. Divided by it, rooms of different
    kinds can be compared.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    display: ClassVar[float]
    comfort: ClassVar[float]
    measured: ClassVar[bool] = True

    @abstractmethod
    def room(self, arm: Situation) -> tuple[FloatArray, IntArray]:
        """How far each posture is inside the bound, and what comes nearest to breaking it.

        Returns ``room`` (S,): [SI]; negative where the bound is broken, infinite where nothing is
        near. ``which`` (S,): index of the joint, the pair of bodies, ... that :meth:`says` will be
        asked for.
        """

    @abstractmethod
    def says(self, arm: Situation, i: int, room: float, which: int) -> str:
        """In words, how posture i keeps or breaks the bound."""

    @abstractmethod
    def remedy(self, room: float) -> str:
        """What to change in ``cell.toml`` where the bound is broken by this much, or nothing."""
