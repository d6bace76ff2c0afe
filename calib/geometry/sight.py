"""Which of many bodies stand in which of many lines of sight."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calib.geometry.enclosure import enclose
from calib.geometry.engine import MeshSurface, Placed
from calib.geometry.rays import crosses
from calib.geometry.segments import segment_segment
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
            From the end of a beam to those of its lines, in base axes [m].
        ignore : collection of str
            Names of bodies that are looked through.

        Returns
        -------
        array (S,) of int
            Row of the bodies, or -1.
        """
        found = np.full(len(start), -1, dtype=np.intp)
        # all lines of a beam lie this near to its middle one
        spread = float(np.linalg.norm(aside, axis=1).max())
        for b, body in enumerate(self._bodies):
            if body.name in ignore:
                continue
            axes, origin = placed.rotations[:, b], placed.origins[:, b]
            near = found < 0
            near[near] = self._near(b, axes, origin, start, end, near) <= spread
            rows = np.flatnonzero(near)
            at = rows if len(axes) > 1 else np.zeros_like(rows)
            lines = np.broadcast_to(start[rows, None], (len(rows), *aside.shape))
            hit = self._crosses(
                b,
                _seen_from(axes[at], origin[at], lines),
                _seen_from(axes[at], origin[at], end[rows, None] + aside),
            ).reshape(len(rows), len(aside))
            found[rows[hit.any(axis=1)]] = b
        return found

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


def _seen_from(R_base_body: FloatArray, p_base_body: FloatArray, points: FloatArray) -> FloatArray:
    """Points (M, K, 3) of the base frame in axes of bodies (M, 3, 3) at (M, 3), (M K, 3)."""
    return np.asarray(((points - p_base_body[:, None]) @ R_base_body).reshape(-1, 3))
