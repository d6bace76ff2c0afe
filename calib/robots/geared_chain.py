"""Chains in which joints follow others: parallelograms, lifts of two stages driven by one joint.

A joint that follows (URDF's mimic) has no value of its own: it moves by a factor times its leader,
plus an offset. What people see are the joints that lead; the chain behind them has all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from calib.robots.chain import Displacement, ExternalAxes, Joint, SerialChain, Walk
from calib.se3 import BoolArray, FloatArray, IntArray, inverse, rotation_exp, transform


@dataclass(frozen=True, eq=False)
class GearedChain(SerialChain):
    """n joints that lead, among others that follow them.

    ``placements`` and ``axes`` are of the joints that lead, those that follow at rest. States hold
    the frames of the links that leading joints move; how they move all that is behind them, with
    all that follows, is in their twists.
    """

    whole: SerialChain = field(kw_only=True)
    """All joints, those that follow included, as if each had a value of its own."""
    gears: FloatArray = field(kw_only=True)
    """(m, n): motion of each joint of the whole by each that leads."""
    rest: FloatArray = field(kw_only=True)
    """(m,): values of those that follow while their leaders are at zero [rad, m]."""
    own: IntArray = field(kw_only=True)
    """(n,): row of each joint that leads in the whole."""

    @classmethod
    def of(
        cls,
        whole: SerialChain,
        gears: FloatArray,
        rest: FloatArray,
        own: IntArray,
        slides: BoolArray,
    ) -> GearedChain:
        """Return the chain of a whole, of which ``slides`` ``(m,)`` tells what slides."""
        at_rest = whole.forward(rest)
        T = np.tile(np.eye(4), (len(own), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = at_rest.rotations[own], at_rest.origins[own]
        before = np.concatenate([np.eye(4)[None], T[:-1]])
        strokes = dict(zip(whole.external.arm_slides, whole.strokes_m, strict=True))
        sliding = [k for k, row in enumerate(own) if slides[row]]
        moved = np.abs(gears).sum(axis=0)  # a stage on a stage goes twice as far
        return cls(
            placements=np.linalg.inv(before) @ T,
            axes=whole.axes[own],
            T_link_tip=np.linalg.inv(T[-1]) @ at_rest.T_base_tip,
            external=ExternalAxes(arm_slides=tuple(sliding)),
            strokes_m=tuple(float(strokes[int(own[k])] * moved[k]) for k in sliding),
            whole=whole,
            gears=gears,
            rest=rest,
            own=own,
        )

    @property
    def all_placements(self) -> FloatArray:
        """Frames ``(m, 4, 4)`` of all joints at zero, in the link before each [m]."""
        return self.whole.placements

    @cached_property
    def reach_m(self) -> float:
        """Length of the stretched arm, an upper bound: see :class:`SerialChain`."""
        return self.whole.reach_m

    @cached_property
    def outlying(self) -> FloatArray:
        """Zero: frames of arms with joints that follow stay where the description has them."""
        return np.zeros(self.n)

    def walk(
        self, q: FloatArray, displaced: Mapping[int, Displacement] = MappingProxyType({})
    ) -> Walk:
        """See :meth:`SerialChain.walk`."""
        whole, gears, rest, own = self.whole, self.gears, self.rest, self.own
        rows = {int(own[j]): by for j, by in displaced.items()}
        walk = whole.walk(np.ascontiguousarray(gears @ q + rest[:, None]), rows)
        axes, at = whole.all_axes(walk), walk.origins
        single = np.empty((len(axes), 6, q.shape[1]))
        slides = whole.external.slides_of(whole.n)[:, None, None]
        x, y, z = at.transpose(1, 0, 2)
        a, b, c = axes.transpose(1, 0, 2)
        moment = np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)
        single[:, :3] = np.where(slides, axes, moment)
        single[:, 3:] = np.where(slides, 0.0, axes)
        return Walk(
            walk.columns[own],
            walk.origins[own],
            walk.tip,
            walk.p_base_tip,
            {j: walk.placed[int(own[j])] for j in displaced},
            np.einsum("mn,mks->nks", gears, single),
        )

    @cached_property
    def _joints(self) -> list[Joint]:
        joints = self.whole._joints
        return [joints[row] for row in self.own]

    def moved(self, placements: FloatArray, offsets: FloatArray) -> GearedChain:
        """Return the chain with its leading joints placed elsewhere, ``(n, 4, 4)``.

        ``offsets`` (n,): of the values of leading joints [rad, m], which those that follow take up
        as well; of the leading joints themselves they are in the placements already.
        """
        whole, gears, rest, own = self.whole, self.gears, self.rest, self.own
        placed = whole.placements.copy()
        placed[own] @= inverse(self.placements) @ placements
        slides = whole.external.slides_of(whole.n)
        by = gears @ offsets
        for row in np.setdiff1d(np.flatnonzero(by), own):
            along = whole.axes[row] * by[row]
            turn = np.eye(3) if slides[row] else rotation_exp(along)
            placed[row] @= transform(turn, along if slides[row] else np.zeros(3))
        return self.of(replace(whole, placements=placed), gears, rest, own, slides)
