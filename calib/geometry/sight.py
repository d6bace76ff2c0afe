"""Which of many bodies stand in which of many lines of sight."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calib.geometry.enclosure import enclose
from calib.geometry.engine import MeshSurface, Placed
from calib.geometry.rays import crosses, segment_segment
from calib.robots.shapes import Body, HalfSpace, Mesh
from calib.se3 import BoolArray, FloatArray, IntArray

_MARGIN_M = 1e-5
"""Bounds leave this much room for what lines are thick as meshes see them, and for rounding."""

_FLAT_M = 1e-9
"""Beams that reach no farther than this in a direction do not reach in it."""

_TINY = 1e-200
"""Takes the place of a slope of zero: quotients become huge and stay finite."""


class LinesOfSight:
    """Looks for bodies in lines of sight.

    Parameters
    ----------
    bodies : sequence of Body
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._bodies = bodies
        self._around = [
            None if isinstance(b.solid, HalfSpace) else enclose(b.solid) for b in bodies
        ]
        self._meshes = {
            b: MeshSurface(body.solid)
            for b, body in enumerate(bodies)
            if isinstance(body.solid, Mesh)
        }

    def blockers(
        self,
        placed: Placed,
        start: FloatArray,
        end: FloatArray,
        aside: FloatArray,
        ignore: Collection[str],
    ) -> IntArray:
        """Find the first body in each beam of lines.

        Parameters
        ----------
        placed : Placed
            The bodies for each of the S beams, or for all of them.
        start, end : array (S, 3)
            In the base frame [m].
        aside : array (K, 3)
            From the end of a beam's middle line to those of its others, in base axes [m].
        ignore : collection of str
            Names of bodies that are looked through.

        Returns
        -------
        array (S,) of int
            Row of the bodies, or -1.
        """
        found = np.full(len(start), -1, dtype=np.intp)
        # all lines of a beam lie this near to its middle one, and only in these directions from it
        spread = float(np.linalg.norm(aside, axis=1).max(initial=0.0))
        _, sizes, directions = np.linalg.svd(aside, full_matrices=False)
        directions = directions[sizes > _FLAT_M]
        for b, body in enumerate(self._bodies):
            if body.name in ignore:
                continue
            axes, origin = placed.rotations[:, b], placed.origins[:, b]
            near = found < 0
            near[near] = self._near(b, axes, origin, start, end, near) <= spread + _MARGIN_M
            rows = np.flatnonzero(near)
            at = rows if len(axes) > 1 else np.zeros_like(rows)
            R = axes[at]
            here, there = (((p[rows] - origin[at])[:, None] @ R)[:, 0] for p in (start, end))
            away = spread * np.linalg.norm(directions @ R, axis=1)
            left = self._may_meet(b, here, there, away)
            rows, R, here, there = rows[left], R[left], here[left], there[left]
            hit = self._crosses(b, here, there)
            found[rows[hit]] = b
            rows, R, here, there = rows[~hit], R[~hit], here[~hit], there[~hit]
            ends = (there[:, None] + aside @ R).reshape(-1, 3)
            hit = self._crosses(b, np.repeat(here, len(aside), axis=0), ends)
            found[rows[hit.reshape(len(rows), len(aside)).any(axis=1)]] = b
        return found

    def _may_meet(
        self, body: int, start: FloatArray, end: FloatArray, aside: FloatArray
    ) -> BoolArray:
        """Whether beams (M,) may meet what encloses a body, in its axes; no is certain.

        At a part t of its way, a beam reaches t ``aside`` (M, 3) from its middle line [m].
        """
        around = self._around[body]
        if around is None:
            return np.ones(len(start), dtype=bool)
        half = around.half + (around.radius_m + _MARGIN_M)
        at, way = start - around.centre, end - start
        # a face of the box bounds the part where the beam is not all beyond it
        first, last = np.zeros(len(at)), np.ones(len(at))
        for k in range(3):
            for sign in (1.0, -1.0):
                beyond = sign * at[:, k] - half[k]
                slope = sign * way[:, k] - aside[:, k]
                slope[np.abs(slope) < _TINY] = _TINY
                t = -beyond / slope
                falls = slope < 0.0
                np.maximum(first, t, out=first, where=falls)
                np.minimum(last, t, out=last, where=~falls)
        return np.asarray(first <= last)

    def _near(
        self,
        body: int,
        axes: FloatArray,
        origin: FloatArray,
        start: FloatArray,
        end: FloatArray,
        some: BoolArray,
    ) -> FloatArray:
        """Distance (M,) of some lines from what encloses a body, or less [m]."""
        at = some if len(axes) > 1 else np.zeros(1, dtype=np.intp)
        axes, origin, start, end = axes[at], origin[at], start[some], end[some]
        around = self._around[body]
        if around is None:
            heights = [((p - origin) * axes[:, :, 2]).sum(axis=1) for p in (start, end)]
            return np.asarray(np.minimum(*heights))
        tip, radius = around.capsule
        away = (start + end) / 2.0 - origin - axes @ around.centre
        along = np.broadcast_to(axes @ tip, away.shape)
        return segment_segment(away, along, (end - start) / 2.0) - radius

    def _crosses(self, body: int, start: FloatArray, end: FloatArray) -> BoolArray:
        if body in self._meshes:
            return self._meshes[body].crosses(start, end)
        return crosses(self._bodies[body].solid, start, end)
