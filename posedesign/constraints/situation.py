"""Postures as every constraint looks at them: with forward kinematics done once for all."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from calib.robots import ChainState, SerialChain
from calib.se3 import FloatArray, IntArray


class Situation:
    """An arm at postures ``(S, n)`` [rad].

    Attributes
    ----------
    chain : SerialChain
    q : array (S, n)
    depths : bool
        Whether somebody reads how deep meshes are in what they run into.
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
