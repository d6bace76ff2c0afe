"""An arm of six axes as EAIK solves it (Ostermeier et al.): every branch in some microseconds.

EAIK 1.2.2 takes axes that run against each other for others, and answers wrongly without saying so:
such axes are turned here. Lines that pass by each other at some micrometres it takes for lines that
meet, and hardly finds a posture then: by trial it is told for which arms that is so.
"""

from __future__ import annotations

import eaik.pybindings.EAIK as eaik
import numpy as np

from calib.robots.chain import SerialChain
from calib.se3 import FloatArray, IntArray

PARALLEL = 1e-9
"""Sine [rad] below which axes of a description are parallel, or perpendicular."""

ZEROS = np.zeros(6), np.array([0.61, -0.83, 1.07, -0.47, 0.92, -0.71])
"""Postures (6,) at which EAIK gets the axes: with all joints at zero, axes that are no neighbours
may be almost parallel, by a joint's zero offset. At no round angles they are not."""


class EaikArm:
    """Six axes of a chain, the other joints held at fixed angles."""

    def __init__(
        self, chain: SerialChain, zero: FloatArray, held: tuple[int, float] | None = None
    ) -> None:
        """Take the chain at a posture ``zero`` (6,) [rad] of its axes.

        ``held``: index and angle [rad] of the joint of a seven-axis arm that does not move.
        """
        self._n, self._held = chain.n, held
        free = np.arange(chain.n)
        at = zero
        if held is not None:
            free = np.delete(free, held[0])
            at = np.insert(zero, held[0], held[1])
        self._free = free
        state = chain.forward(at)
        axes, points = state.axes[free], np.vstack([state.origins[free], state.p_base_tip])
        signs = np.ones(len(free))
        for j in range(1, len(free)):
            parallel = np.linalg.norm(np.cross(axes[j - 1], axes[j])) < PARALLEL
            if parallel and axes[j - 1] @ axes[j] < 0:
                axes[j], signs[j] = -axes[j], -1.0
        steps = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
        self._solver = eaik.Robot(axes.T, steps.T, state.R_base_tip, [], True)
        self._signs, self._zero = signs, zero
        self._turned = bool((signs < 0).any() or zero.any())
        self.known: bool = self._solver.has_known_decomposition()
        """True if EAIK has a closed form for the arm."""

    def branches(self, T_base_tip: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return what EAIK answers to poses ``(N, 4, 4)``, least-squares answers included.

        Postures ``(S, n)`` [rad] and their poses ``(S,)`` in ascending order.
        """
        # its batches start a thread, which takes as long as six poses
        found = [self._solver.calculate_IK(T).Q for T in T_base_tip]
        counts = [len(f) for f in found]
        q = np.concatenate([np.empty((0, len(self._free))), *(f for f in found if len(f))])
        if self._turned:
            q *= self._signs
            q += self._zero
        if self._held is not None:
            q = np.insert(q, self._held[0], self._held[1], axis=1)
        return q, np.repeat(np.arange(len(found)), counts)
