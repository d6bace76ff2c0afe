"""What a straight line of sight meets, and what a point lies in, over arrays."""

from __future__ import annotations

from typing import assert_never

import numpy as np

from calib.geometry.segments import point_segment, segment_segment
from calib.robots.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere
from calib.se3 import BoolArray, FloatArray

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
