"""What a line of sight meets, what a point lies in, and distances of segments, over arrays.

Distances between straight segments and rounded boxes are signed: below zero is how far the two
would have to be moved apart.
"""

from __future__ import annotations

from typing import assert_never

import numpy as np

from calib.robots.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere
from calib.se3 import BoolArray, FloatArray

_LEAST_SQUARE = 1e-300
"""Keeps a division by the squared length of a point finite; the result is then clipped."""


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...k,...k->...", a, b))


def _share(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotient clipped to -1 to 1, the two ends of a segment."""
    return np.clip(numerator / np.maximum(denominator, _LEAST_SQUARE), -1.0, 1.0)


def segment_segment(apart: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance ``(...)`` [m] between the segments ``-a..a`` and ``apart - b..apart + b``.

    The square of the distance is convex in the places s, t on the two segments. The best s for
    the unclipped t is clipped, then the best t for that s, then the best s for that t: this ends
    at the minimum [Ericson2005]_, also for points and for parallel segments. Arrays ``(..., 3)``
    [m]: from middle to middle, and from the middle of each to its end.

    References
    ----------
    .. [Ericson2005] C. Ericson, Real-Time Collision Detection, Morgan Kaufmann 2005, section
       5.1.9.
    """
    aa, bb, ab = _dot(a, a), _dot(b, b), _dot(a, b)
    ca, cb = _dot(apart, a), _dot(apart, b)
    s = _share(ca * bb - ab * cb, aa * bb - ab * ab)
    t = _share(ab * s - cb, bb)
    s = _share(ca + ab * t, aa)
    gap = apart + t[..., None] * b - s[..., None] * a
    return np.sqrt(_dot(gap, gap))


def point_segment(apart: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of the origin from the segment ``apart - b..apart + b``, arrays (..., 3) [m]."""
    gap = apart + _share(-_dot(apart, b), _dot(b, b))[..., None] * b
    return np.sqrt(_dot(gap, gap))


def box_box_bound(
    R_a_b: FloatArray, p_a_b: FloatArray, half_a: FloatArray, half_b: FloatArray
) -> FloatArray:
    """Lower bound ``(M,)`` [m] of the signed distance of boxes, better than that of capsules.

    Box b is at ``R_a_b (M, 3, 3)`` and ``p_a_b (M, 3)``, from centre to centre in axes of box a;
    halves of the edges are ``(M, 3)`` [m]. Each is enclosed by one along the axes of the other,
    and the distance of those two boxes
    is exact: the gaps along the axes add up as a vector, or the widest of them separates.
    """
    turned = np.abs(R_a_b)
    p_b_a = (np.swapaxes(R_a_b, -1, -2) @ p_a_b[..., None])[..., 0]
    gaps_a = np.abs(p_a_b) - half_a - (turned @ half_b[..., None])[..., 0]
    gaps_b = np.abs(p_b_a) - half_b - (np.swapaxes(turned, -1, -2) @ half_a[..., None])[..., 0]
    return np.maximum(_apart(gaps_a), _apart(gaps_b))


def _apart(gaps: FloatArray) -> FloatArray:
    """Signed distance of two boxes with the same axes and these gaps along them (..., 3)."""
    outside = np.maximum(gaps, 0.0)
    widest = gaps.max(axis=-1)
    return np.where(widest > 0.0, np.sqrt(_dot(outside, outside)), widest)


_TINY = 1e-200
"""Takes the place of a zero in a direction: quotients become huge and stay finite."""

_WINDING_ENTRIES = 500_000
"""Points times triangles that are held at once; bounds the memory."""


def crosses(solid: Solid, start: FloatArray, end: FloatArray) -> BoolArray:
    """Whether segments (M, 3) to (M, 3) [m], in the axes of a solid, run through it, (M,).

    Not for meshes (see :class:`calib.geometry.engine.MeshSurface`).
    """
    middle, half = (start + end) / 2.0, (end - start) / 2.0
    match solid:
        case Sphere(radius_m=radius):
            return np.asarray(point_segment(middle, half) < radius)
        case Capsule(radius_m=radius, length_m=length):
            axis = np.array([0.0, 0.0, length / 2.0])
            axis = np.broadcast_to(axis, half.shape)
            return np.asarray(segment_segment(middle, axis, half) < radius)
        case Cylinder(radius_m=radius, length_m=length):
            return _crosses_cylinder(start, end, radius, length / 2.0)
        case Box(size_m=size):
            first, last = _slabs(start, end, np.array(size) / 2.0)
            return np.asarray(first < last)
        case HalfSpace():
            return np.asarray(np.minimum(start[:, 2], end[:, 2]) < 0.0)
        case Mesh():
            raise TypeError("a mesh has no formula")
    assert_never(solid)


def _slabs(start: FloatArray, end: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Part (M,), (M,) of each segment that lies between all planes at +-half (K,)."""
    way = end - start
    way = np.where(np.abs(way) < _TINY, _TINY, way)
    one, other = (-half - start) / way, (half - start) / way
    first = np.minimum(one, other).max(axis=-1)
    last = np.maximum(one, other).min(axis=-1)
    return np.maximum(first, 0.0), np.minimum(last, 1.0)


def _crosses_cylinder(
    start: FloatArray, end: FloatArray, radius_m: float, half_length_m: float
) -> BoolArray:
    first, last = _slabs(start[:, 2:], end[:, 2:], np.array([half_length_m]))
    at, way = start[:, :2], (end - start)[:, :2]
    nearest = -(at * way).sum(axis=-1) / np.maximum((way * way).sum(axis=-1), _TINY)
    point = at + np.clip(nearest, first, np.maximum(first, last))[:, None] * way
    return np.asarray((first < last) & (np.hypot(point[:, 0], point[:, 1]) < radius_m))


def contains(solid: Solid, points: FloatArray) -> BoolArray:
    """Whether points (M, 3) [m], in the axes of a solid, lie inside it, (M,).

    A mesh is taken to be closed, whichever way round its triangles are.
    """
    match solid:
        case Sphere(radius_m=radius):
            return np.asarray(np.linalg.norm(points, axis=-1) < radius)
        case Capsule(radius_m=radius, length_m=length):
            off = np.abs(points[:, 2]) - length / 2.0
            flat = np.hypot(points[:, 0], points[:, 1])
            return np.asarray(np.hypot(flat, np.maximum(off, 0.0)) < radius)
        case Cylinder(radius_m=radius, length_m=length):
            flat = np.hypot(points[:, 0], points[:, 1])
            return np.asarray((flat < radius) & (np.abs(points[:, 2]) < length / 2.0))
        case Box(size_m=size):
            return np.asarray((np.abs(points) < np.array(size) / 2.0).all(axis=-1))
        case HalfSpace():
            return np.asarray(points[:, 2] < 0.0)
        case Mesh(vertices=vertices):
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            inside = ((points > low) & (points < high)).all(axis=-1)
            inside[inside] = np.abs(_winding(solid, points[inside])) > 0.5
            return np.asarray(inside)
    assert_never(solid)


def _winding(mesh: Mesh, points: FloatArray) -> FloatArray:
    """How often a surface goes round points (M, 3): solid angles over 4 pi [VanOosterom1983]_.

    .. [VanOosterom1983] A. Van Oosterom and J. Strackee, The solid angle of a plane triangle,
       IEEE Transactions on Biomedical Engineering 30 (1983) 125-126.
    """
    found = np.empty(len(points))
    chunk = max(1, _WINDING_ENTRIES // len(mesh.triangles))
    for first in range(0, len(points), chunk):
        rows = slice(first, first + chunk)
        corners = mesh.vertices[mesh.triangles] - points[rows, None, None]  # (M, F, 3, 3)
        a, b, c = corners[:, :, 0], corners[:, :, 1], corners[:, :, 2]
        la, lb, lc = np.moveaxis(np.linalg.norm(corners, axis=-1), -1, 0)
        volume = np.einsum("mfk,mfk->mf", a, np.cross(b, c))
        ab, bc, ca = ((u * v).sum(axis=-1) for u, v in ((a, b), (b, c), (c, a)))
        angle = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        found[rows] = angle.sum(axis=1) / (4.0 * np.pi)
    return found
