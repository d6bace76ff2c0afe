"""Straight joint-space ways, checked as a whole by halving them.

Samples alone prove nothing about what lies between them. Here every piece of a way carries a
bound: no pair can come nearer than its distance at the middle of the piece, less what the joints
between the two bodies can move them until an end of it. A piece is done when that is more than
the distance to keep, for every pair; else it is halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.geometry.engine import Bounds, Engine
from calib.robots import SerialChain
from calib.se3 import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Clearance:
    """How near bodies come to each other at S postures.

    Attributes
    ----------
    distance_m : array (S,)
        Smallest distance of all pairs, or the cap where that is farther; below zero where bodies
        touch, by how far one would have to be moved to come free; of meshes by a micrometre, unless
        depths were asked for. Infinite without pairs.
    pair : array (S,) of int
        Which pair, a row of :attr:`~calib.geometry.scene.Scene.pairs`; beyond the cap one that
        may be the nearest. -1 without pairs.
    """

    distance_m: FloatArray
    pair: IntArray


@dataclass(frozen=True, eq=False)
class Ways:
    """Straight joint-space ways that were checked as a whole.

    Attributes
    ----------
    clear : array (W,) of bool
        No pair comes nearer than asked, anywhere on the way.
    distance_m : array (W,)
        Smallest distance at the postures that had to be looked at, as in :class:`Clearance`. A
        blocked way is not looked at any further than to find that it is blocked.
    pair : array (W,) of int
        The pair of that distance, as in :class:`Clearance`.
    part : array (W,)
        Where on the way that is: 0 at its start, 1 at its end.
    """

    clear: BoolArray
    distance_m: FloatArray
    pair: IntArray
    part: FloatArray


@dataclass(frozen=True, eq=False)
class Sight:
    """Which lines of sight are free.

    Attributes
    ----------
    clear : array (S,) of bool
    blocker : array (S,) of int
        The first body, a row of :attr:`~calib.geometry.scene.Scene.bodies`, that stands in the
        way; -1: none.
    """

    clear: BoolArray
    blocker: IntArray


class Extent(NamedTuple):
    """Box around what moves, along the axes of the base.

    Attributes
    ----------
    lowest, highest : array (S, 3)
        [m]; plus and minus infinity where nothing moves.
    """

    lowest: FloatArray
    highest: FloatArray


WAY_TOLERANCE_M = 1e-3
"""Pieces in which a pair cannot move by more are not halved: their middle decides. A way may so
come nearer than asked by this much, which is below what cells are measured to, but by no more than
what is asked for: it does not come to a contact."""

TOUCH_M = 1e-4
"""Bodies nearer than this count as touching: descriptions are no better. Ways that are to keep it
are free of contact all along; less cannot be asked of them in a bounded number of pieces."""


@dataclass(eq=False)
class _Found:
    """The smallest distance of each way so far."""

    distance_m: FloatArray
    pair: IntArray
    part: FloatArray

    def take(self, ways: IntArray, parts: FloatArray, distance: FloatArray, pair: IntArray) -> None:
        order = np.argsort(-distance, kind="stable")  # of several rows of a way, the last one wins
        order = order[distance[order] < self.distance_m[ways[order]]]
        ways = ways[order]
        self.distance_m[ways] = distance[order]
        self.pair[ways] = pair[order]
        self.part[ways] = parts[order]


def check_ways(
    chain: SerialChain,
    engine: Engine,
    radii: FloatArray,
    start: FloatArray,
    end: FloatArray,
    *,
    keep_m: float,
    cap_m: float,
    chunk: int,
) -> Ways:
    """Check ways from ``start`` to ``end``, (W, n) each [rad].

    Parameters
    ----------
    chain : SerialChain
    engine : Engine
    radii : array (P, n)
        How fast a joint changes the distance of a pair [m/rad], see
        :func:`calib.geometry.pairs.motion_radii`.
    start, end : array (W, n)
    keep_m : float
        Distance to keep.
    cap_m : float
        Distances beyond this are not told apart; more than ``keep_m``.
    chunk : int
        Postures that are looked at at once.
    """
    W = len(start)
    speed = np.abs(end - start) @ radii.T  # (W, P): metres a whole way
    tolerance_m = min(WAY_TOLERANCE_M, max(keep_m, TOUCH_M))
    found = _Found(np.full(W, np.inf), np.full(W, -1, dtype=np.intp), np.zeros(W))
    everything = np.arange(W)
    ways, middles = np.repeat(everything, 2), np.tile([0.0, 1.0], W)
    half = 0.0  # the ends are looked at first: they are pieces without a length
    while len(ways):
        undone = np.zeros(len(ways), dtype=bool)
        for first in range(0, len(ways), chunk):
            rows = slice(first, first + chunk)
            way, middle = ways[rows], middles[rows]
            q = start[way] + middle[:, None] * (end - start)[way]
            known = engine.bounds(engine.place(chain.forward(q)))
            engine.settle(known, 0.0, cap_m)
            found.take(way, middle, *nearest(known.distance_m, cap_m))
            here = found.distance_m[way] >= keep_m
            motion = speed[way[here]] * half
            # a pair that can no longer move noticeably is decided by its distance at the middle
            beyond = np.where(motion > tolerance_m, motion, -np.inf)
            here[here] = _undecided(engine, known.rows(here), beyond, keep_m)
            undone[rows] = here
        open_ = undone & (found.distance_m[ways] >= keep_m)
        if half == 0.0:
            half = 0.5
            ways = everything[found.distance_m >= keep_m]
            middles = np.full(len(ways), 0.5)
        else:
            half /= 2.0
            ways = np.repeat(ways[open_], 2)
            middles = (middles[open_, None] + [-half, half]).ravel()
    return Ways(found.distance_m >= keep_m, found.distance_m, found.pair, found.part)


def _undecided(engine: Engine, known: Bounds, beyond: FloatArray, keep_m: float) -> BoolArray:
    """Which pieces (S,) have a pair that may come too near before an end of the piece.

    Parameters
    ----------
    engine : Engine
    known : Bounds
        At the middles of the pieces, where all keep the distance.
    beyond : array (S, P)
        What the distance of a pair can change until an end of the piece [m]; minus infinity where
        that is not looked at.
    keep_m : float
    """
    engine.settle(known, beyond, keep_m)
    return np.asarray((known.distance_m - beyond <= keep_m).any(axis=1))


def nearest(distance_m: FloatArray, cap_m: float) -> tuple[FloatArray, IntArray]:
    """Smallest of settled distances (S, P), or the cap, and its pair, (S,) and (S,)."""
    if not distance_m.shape[1]:
        return np.full(len(distance_m), np.inf), np.full(len(distance_m), -1, dtype=np.intp)
    pair = distance_m.argmin(axis=1)
    return np.minimum(distance_m[np.arange(len(pair)), pair], cap_m), pair
