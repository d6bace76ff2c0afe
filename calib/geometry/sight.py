"""Which of many bodies stand in which of many lines of sight."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calib.geometry.enclosure import enclose
from calib.geometry.engine import MeshSight, Placed
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
            b: MeshSight(body.solid)
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
        start, end : array (S, 3)
            In the base frame [m].
        ignore : collection of str
            Names of bodies that are looked through.

        Returns
        -------
        array (S,) of int
            Row of the bodies, or -1.
        """
        found = np.full(len(start), -1, dtype=np.intp)
        middle, half = (start + end) / 2.0, (end - start) / 2.0
        for b, body in enumerate(self._bodies):
            if body.name in ignore:
                continue
            axes, origin = placed.rotations[:, b], placed.origins[:, b]
            near = found < 0
            ball = self._balls[b]
            if ball is not None:  # most lines pass far from most bodies
                centre, radius = ball
                near &= point_segment(middle - origin - axes @ centre, half) <= radius
            rows = np.flatnonzero(near)
            at = rows if len(axes) > 1 else np.zeros_like(rows)
            hit = self._crosses(
                b,
                _seen_from(axes[at], origin[at], start[rows]),
                _seen_from(axes[at], origin[at], end[rows]),
            )
            found[rows[hit]] = b
        return found

    def _crosses(self, body: int, start: FloatArray, end: FloatArray) -> BoolArray:
        if body in self._meshes:
            return self._meshes[body].crosses(start, end)
        return crosses(self._bodies[body].solid, start, end)


def _seen_from(R_base_body: FloatArray, p_base_body: FloatArray, points: FloatArray) -> FloatArray:
    """Points (M, 3) of the base frame in the axes of bodies (M, 3, 3) at (M, 3)."""
    return np.asarray(np.einsum("mij,mi->mj", R_base_body, points - p_base_body))
