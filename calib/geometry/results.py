"""What the checks of a cell find."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

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
