"""Which of many bodies stand in which of many lines of sight."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calib.geometry.enclosure import enclose
from calib.geometry.engine import MeshSurface, Placed
from calib.geometry.rays import crosses
from calib.geometry.segments import point_segment
from calib.geometry.shapes import Body, HalfSpace, Mesh
from calib.se3 import BoolArray, FloatArray, IntArray


class LinesOfSight:
    """Looks for bodies in lines of sight.

    Parameters
    ----------
    bodies : sequence of Body
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._bodies = bodies
        around = [None if isinstance(b.solid, HalfSpace) else enclose(b.solid) for b in bodies]
        self._balls = [
            None if e is None else (e.centre, float(np.linalg.norm(e.half)) + e.radius_m)
            for e in around
        ]
        self._meshes = {
            b: MeshSurface(body.solid)
            for b, body in enumerate(bodies)
            if isinstance(body.solid, Mesh)
        }

    def blockers(
        self, placed: Placed, start: FloatArray, end: FloatArray, ignore: Collection[str]
    ) -> IntArray:
        """Find the first body in each line.

        Parameters
        ----------
        placed : Placed
            The bodies for each of the S lines, or for all of them.
        start, end : array (S, 3) or (S, K, 3)
            In the base frame [m]; a body in any of K lines counts.
        ignore : collection of str
            Names of bodies that are looked through.

        Returns
        -------
        array (S,) of int
            Row of the bodies, or -1.
        """
        start, end = (a.reshape(len(a), -1, 3) for a in (start, end))
        found = np.full(len(start), -1, dtype=np.intp)
        # all lines of a beam lie this near to the segment between its middle ends
        from_, to = start.mean(axis=1), end.mean(axis=1)
        aside = (np.linalg.norm(a - b[:, None], axis=2) for a, b in ((start, from_), (end, to)))
        spread = np.maximum(*(a.max(axis=1, initial=0.0) for a in aside))
        middle, half = (from_ + to) / 2.0, (to - from_) / 2.0
        for b, body in enumerate(self._bodies):
            if body.name in ignore:
                continue
            axes, origin = placed.rotations[:, b], placed.origins[:, b]
            near = found < 0
            ball = self._balls[b]
            if ball is not None:  # most lines pass far from most bodies
                centre, radius = ball
                near &= point_segment(middle - origin - axes @ centre, half) <= radius + spread
            rows = np.flatnonzero(near)
            at = rows if len(axes) > 1 else np.zeros_like(rows)
            hit = self._crosses(
                b,
                _seen_from(axes[at], origin[at], start[rows]),
                _seen_from(axes[at], origin[at], end[rows]),
            ).reshape(len(rows), start.shape[1])
            found[rows[hit.any(axis=1)]] = b
        return found

    def _crosses(self, body: int, start: FloatArray, end: FloatArray) -> BoolArray:
        if body in self._meshes:
            return self._meshes[body].crosses(start, end)
        return crosses(self._bodies[body].solid, start, end)


def _seen_from(R_base_body: FloatArray, p_base_body: FloatArray, points: FloatArray) -> FloatArray:
    """Points (M, K, 3) of the base frame in axes of bodies (M, 3, 3) at (M, 3), (M K, 3)."""
    return np.asarray(((points - p_base_body[:, None]) @ R_base_body).reshape(-1, 3))
