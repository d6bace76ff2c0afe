"""The arm that a slightly inexact description means."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.robots.chain import SerialChain
from calib.se3 import FloatArray

SLIGHT_TURN = 0.02
"""Element of a rotation or of an axis that a description is taken to mean as none, 1.1 deg:
rounding of angles to 1.571 and 3.142 is off by 4e-4, and the frames of a calibrated arm have its
zero offsets in them, of some tenths of a degree."""

SLIGHT_M = 5e-3
"""The same of an offset [m]: arms are built off by some tenths of a millimetre, rarely by a few."""


def idealised(chain: SerialChain) -> SerialChain:
    """The chain with right angles for almost right ones, and without its slight offsets.

    Axes that are almost parallel become parallel, those that almost meet meet: a chain with a
    closed form, whose answers are good starts for closing in on the poses with the chain itself.
    """
    placements = chain.placements.copy()
    for T in placements:
        T[:3, :3] = _squared(T[:3, :3])
    p = placements[:, :3, 3]
    placements[:, :3, 3] = np.where(np.abs(p) < SLIGHT_M, 0.0, p)
    axes = np.array([_straightened(axis) for axis in chain.axes])
    return replace(chain, placements=placements, axes=axes)


def _squared(R: FloatArray) -> FloatArray:
    right = np.round(R)
    near = np.abs(R - right).max() < SLIGHT_TURN
    return right if near and np.array_equal(right @ right.T, np.eye(3)) else R


def _straightened(axis: FloatArray) -> FloatArray:
    straight = np.round(axis)
    return straight if np.abs(axis - straight).max() < SLIGHT_TURN else axis
