"""The ideal arm nearest to a described one, and the postures of the one from those of the other.

Frames of descriptions are rounded, those of a calibrated arm are slightly off. Closed forms need
axes that are parallel or meet exactly. The ideal arm has them so, and its answers are starts from
which the described arm is closed in on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calib.robots.chain import SLIGHT_M, SerialChain
from calib.se3 import FloatArray, rotation_exp

_SLIGHT = ((1e-9, 1e-9), (1e-4, 1e-4), (2e-3, 1e-3), (0.02, SLIGHT_M))
"""Angles [rad] and lengths [m] that are taken for none: rounding of numbers; rounding of a
description to 4 digits; a calibrated arm; and one whose frames have its zero offsets in them, or
angles of 1.57 and 3.14."""


def ideals(chain: SerialChain) -> Iterator[SerialChain]:
    """Yield arms near to a chain, the nearest first: see :func:`idealised`."""
    for turn_rad, length_m in _SLIGHT:
        yield idealised(chain, turn_rad, length_m)


def idealised(chain: SerialChain, turn_rad: float, length_m: float) -> SerialChain:
    """Return the chain without its slight offsets: almost parallel axes are parallel in it.

    Neighbours that almost meet meet, those almost at right angles are at right angles, and common
    normals that almost share a foot share it. Each joint takes all that is behind it along, so that
    what one pair of axes is off by is no longer in the next. Only the lines of the axes count: the
    frames of a description may be anywhere along them.
    """
    state = chain.forward(np.zeros(chain.n))
    axes, points, tip = state.axes, state.origins, state.T_base_tip
    for j in range(1, chain.n):  # the point nearest to the neighbour's: frames may be far away
        points[j] -= axes[j] * (axes[j] @ (points[j] - points[j - 1]))

    def move(j: int, R: FloatArray, shift: FloatArray) -> None:
        """Move the arm from joint j on: a turn about the point of its axis, then a shift."""
        at = points[j].copy()
        axes[j:] = axes[j:] @ R.T
        points[j:] = (points[j:] - at) @ R.T + at + shift
        tip[:3, :3] = R @ tip[:3, :3]
        tip[:3, 3] = R @ (tip[:3, 3] - at) + at + shift

    foot: FloatArray | None = None  # on the axis before, of the last common normal
    for j in range(1, chain.n):
        before = axes[j - 1]
        wanted = _squared(before, axes[j], turn_rad)
        move(j, _turn_to(axes[j], wanted), np.zeros(3))
        axes[j] = wanted
        away = points[j] - points[j - 1]
        normal = np.cross(before, wanted)
        if not normal.any():  # parallel: where along them the neighbours are is left as it is
            points[j] -= wanted * (wanted @ away)
            if foot is not None:
                foot = foot + points[j] - points[j - 1]
            continue
        # feet of the common normal: points[j - 1] + s before, points[j] + t wanted
        s, gap, t = np.linalg.solve(np.column_stack([before, normal, -wanted]), away)
        here = points[j - 1] + s * before
        shift = np.zeros(3)
        if abs(gap) * np.linalg.norm(normal) < length_m:
            shift -= gap * normal
        slid = 0.0 if foot is None else before @ (here - foot)
        if abs(slid) < length_m:
            shift -= slid * before
        there = points[j] + t * wanted
        move(j, np.eye(3), shift)
        foot = points[j] = there + shift
    first = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
    placements = np.tile(np.eye(4), (chain.n, 1, 1))
    placements[:, :3, 3] = first
    tip[:3, 3] -= points[-1]
    return replace(chain, placements=placements, axes=axes, T_link_tip=tip)


def _squared(before: FloatArray, axis: FloatArray, turn_rad: float) -> FloatArray:
    """Return a unit vector parallel to, or at right angles with, another, if it almost is."""
    cosine = before @ axis
    if np.linalg.norm(np.cross(before, axis)) < turn_rad:
        return before * np.sign(cosine)
    if abs(cosine) < turn_rad:
        axis = axis - cosine * before
        return np.asarray(axis / np.linalg.norm(axis))
    return axis


def _turn_to(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the least rotation (3, 3) that brings a unit vector to one nearby."""
    normal = np.cross(a, b)
    return rotation_exp(normal * (np.arcsin(s) / s if (s := np.linalg.norm(normal)) > 0 else 1.0))
