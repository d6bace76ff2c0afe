"""Straight joint-space ways, checked as a whole by halving them.

Samples alone prove nothing about what lies between them. Here every piece of a way carries a
bound: no pair can come nearer than its distance at the middle of the piece, less what the joints
between the two bodies can move them until an end of it. A piece is done when that is more than
the distance to keep, for every pair; else it is halved.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.geometry.enclosure import enclose
from calib.geometry.engine import Bounds, Engine, MeshSurface, Placed
from calib.geometry.rays import crosses, segment_segment
from calib.robots import SerialChain
from calib.robots.shapes import Body, HalfSpace, Mesh
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Clearance:
    """How near bodies come to each other at S postures."""

    distance_m: FloatArray
    """(S,): smallest distance of all pairs, or the cap where that is farther; below zero where
    bodies touch, by how far one would have to be moved to come free; of meshes by a micrometre,
    unless depths were asked for. Infinite without pairs."""
    pair: IntArray
    """(S,): which pair, a row of :attr:`~calib.geometry.scene.Scene.pairs`; beyond the cap one that
    may be the nearest. -1 without pairs."""


@dataclass(frozen=True, eq=False)
class Ways:
    """Straight joint-space ways that were checked as a whole."""

    clear: BoolArray  # (W,): no pair comes nearer than asked, anywhere on the way
    distance_m: FloatArray
    """(W,): smallest distance at the postures that had to be looked at, as in :class:`Clearance`. A
    blocked way is not looked at any further than to find that it is blocked."""
    pair: IntArray  # (W,): the pair of that distance, as in :class:`Clearance`
    part: FloatArray  # (W,): where on the way that is: 0 at its start, 1 at its end


@dataclass(frozen=True, eq=False)
class Sight:
    """Which lines of sight are free ``(S,)``, and the first body of the scene in the way, or -1."""

    clear: BoolArray
    blocker: IntArray


class Extent(NamedTuple):
    """Box around what moves, along the axes of the base."""

    lowest: FloatArray  # (S, 3) [m]; plus and minus infinity where nothing moves
    highest: FloatArray  # (S, 3) [m]; plus and minus infinity where nothing moves


WAY_TOLERANCE_M = 1e-3
"""Pieces in which a pair cannot move by more are not halved: their middle decides. A way may so
come nearer than asked by this much, which is below what cells are measured to, but by no more than
what is asked for: it does not come to a contact."""

TOUCH_M = 1e-4
"""Bodies nearer than this count as touching: descriptions are no better. Ways that are to keep it
are free of contact all along; less cannot be asked of them in a bounded number of pieces."""


@dataclass(eq=False)
class _Found:
    """The smallest distance of each way so far, less what its pair is to keep."""

    spare_m: FloatArray
    pair: IntArray
    part: FloatArray

    def take(self, ways: IntArray, parts: FloatArray, spare: FloatArray, pair: IntArray) -> None:
        order = np.argsort(-spare, kind="stable")  # of several rows of a way, the last one wins
        order = order[spare[order] < self.spare_m[ways[order]]]
        ways = ways[order]
        self.spare_m[ways] = spare[order]
        self.pair[ways] = pair[order]
        self.part[ways] = parts[order]


def check_ways(
    chain: SerialChain,
    engine: Engine,
    radii: FloatArray,
    start: FloatArray,
    end: FloatArray,
    *,
    keep_m: FloatArray,
    cap_m: float,
    chunk: int,
) -> Ways:
    """Check ways from ``start`` to ``end``, (W, n) each [rad], ``chunk`` postures at once.

    ``radii (P, n)``: how fast a joint changes the distance of a pair [m/rad], see
    :func:`calib.geometry.enclosure.motion_radii`. ``keep_m (P,)``: distance that each pair has to
    keep. ``cap_m``: what is kept by more than this is not told apart; above zero.
    """
    W = len(start)
    speed = np.abs(end - start) @ radii.T  # (W, P): metres a whole way
    tolerance_m = np.clip(keep_m, TOUCH_M, WAY_TOLERANCE_M)
    found = _Found(np.full(W, np.inf), np.full(W, -1, dtype=np.intp), np.zeros(W))
    # many ways start or end at the same place
    places, place = np.unique(np.concatenate([start, end]), axis=0, return_inverse=True)
    spare, pair = np.empty(len(places)), np.empty(len(places), dtype=np.intp)
    for first in range(0, len(places), chunk):
        rows = slice(first, first + chunk)
        known = engine.bounds(engine.place(chain.forward(places[rows])), None, cap_m + keep_m)
        engine.settle(known, keep_m, cap_m)
        spare[rows], pair[rows] = nearest(known.distance_m - keep_m, cap_m)
    found.take(np.tile(np.arange(W), 2), np.repeat([0.0, 1.0], W), spare[place], pair[place])
    ways = np.flatnonzero(found.spare_m >= 0.0)
    half, middles = 0.5, np.full(len(ways), 0.5)
    # pairs that keep the distance all along a piece keep it on both its halves
    done = np.zeros((len(ways), len(radii)), dtype=bool)
    while len(ways) and len(radii):
        for first in range(0, len(ways), chunk):
            rows = slice(first, first + chunk)
            way, middle = ways[rows], middles[rows]
            q = start[way] + middle[:, None] * (end - start)[way]
            # the farther ways are halved, the fewer pairs are left
            some = np.flatnonzero(~done[rows].all(axis=0))
            part, keep, before = engine.only(some), keep_m[some], done[rows][:, some]
            motion = speed[way[:, None], some] * half
            placed = part.place(chain.forward(q), before)
            known = part.bounds(placed, before, np.maximum(cap_m, motion) + keep)
            part.settle(known, keep, np.minimum(found.spare_m[way], cap_m))
            spare, pair = nearest(known.distance_m - keep, cap_m)
            found.take(way, middle, spare, some[pair])
            here = (found.spare_m[way] >= 0.0)[:, None]
            # a pair that can no longer move noticeably is decided by its distance at the middle,
            # and a way that is blocked is not looked at any further
            beyond = np.where(here & (motion > tolerance_m[some]), motion + keep, -np.inf)
            done[rows, some] = here & ~_undecided(part, known, beyond)
        open_ = ~done.all(axis=1) & (found.spare_m[ways] >= 0.0)
        half /= 2.0
        ways = np.repeat(ways[open_], 2)
        middles = (middles[open_, None] + [-half, half]).ravel()
        done = np.repeat(done[open_], 2, axis=0)
    distance_m = found.spare_m + (keep_m[found.pair] if len(keep_m) else 0.0)
    return Ways(found.spare_m >= 0.0, distance_m, found.pair, found.part)


def _undecided(engine: Engine, known: Bounds, beyond: FloatArray) -> BoolArray:
    """Which pairs of pieces (S, P) may come too near before an end, of bounds at their middles.

    ``beyond (S, P)``: what a pair has to keep, and what its distance can change until an end of the
    piece [m]; minus infinity where that is not looked at.
    """
    engine.settle(known, beyond, 0.0, one_will_do=True)
    return np.asarray(known.distance_m <= beyond)


def nearest(distance_m: FloatArray, cap_m: float) -> tuple[FloatArray, IntArray]:
    """Smallest of settled distances (S, P), or the cap, and its pair, (S,) and (S,)."""
    if not distance_m.shape[1]:
        return np.full(len(distance_m), np.inf), np.full(len(distance_m), -1, dtype=np.intp)
    pair = distance_m.argmin(axis=1)
    return np.minimum(distance_m[np.arange(len(pair)), pair], cap_m), pair


_MARGIN_M = 1e-5
"""Bounds leave this much room for what lines are thick as meshes see them, and for rounding."""

_FLAT_M = 1e-9
"""Beams that reach no farther than this in a direction do not reach in it."""

_TINY = 1e-200
"""Takes the place of a slope of zero: quotients become huge and stay finite."""


class LinesOfSight:
    """Looks for bodies in lines of sight."""

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
        """Find the first body, its row or -1, in each beam of lines ``(S,)``.

        From ``start (S, 3)`` to ``end (S, 3)`` in the base frame [m], and ``aside (K, 3)`` from the
        end of a beam's middle line to those of its others. ``ignore``: looked through, by name.
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
