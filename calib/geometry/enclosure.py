"""What encloses a solid: few numbers from which distances are bounded without an engine."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import assert_never
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from calib.errors import InputError
from calib.robots.shapes import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere
from calib.se3 import FloatArray, check_transforms

_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A box with rounded edges about a solid, in the axes of the solid.

    A ball, a capsule and a box are their own enclosure.

    Attributes
    ----------
    centre : array (3,)
        [m]
    half : array (3,)
        Half of the edges of the box, before it is rounded [m].
    radius_m : float
        How far the rounding reaches beyond the box.
    """

    centre: FloatArray
    half: FloatArray
    radius_m: float

    @property
    def corners(self) -> FloatArray:
        """Corners ``(8, 3)`` of the box before it is rounded [m]; some fall together."""
        return np.asarray(self.centre + _SIGNS * self.half)

    @property
    def capsule(self) -> tuple[FloatArray, float]:
        """The capsule along the longest edge: from the centre to one end ``(3,)``; radius [m]."""
        longest = int(np.argmax(self.half))
        end = np.zeros(3)
        end[longest] = self.half[longest]
        return end, float(np.linalg.norm(np.delete(self.half, longest))) + self.radius_m


def enclose(solid: Solid) -> Enclosure:
    """Enclosure of a bounded solid.

    Raises
    ------
    InputError
        A half-space, which nothing encloses.
    """
    centre = np.zeros(3)
    match solid:
        case Sphere(radius_m=radius):
            return Enclosure(centre, np.zeros(3), radius)
        case Capsule(radius_m=radius, length_m=length):
            return Enclosure(centre, np.array([0.0, 0.0, length / 2.0]), radius)
        case Cylinder(radius_m=radius, length_m=length):
            return Enclosure(centre, np.array([radius, radius, length / 2.0]), 0.0)
        case Box(size_m=size):
            return Enclosure(centre, np.array(size) / 2.0, 0.0)
        case Mesh():
            low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
            return Enclosure((low + high) / 2.0, (high - low) / 2.0, 0.0)
        case HalfSpace():
            raise InputError("a half-space is not bounded", hint="use it as an obstacle only")
    assert_never(solid)


def outer_points(solid: Solid) -> tuple[FloatArray, float]:
    """Points ``(K, 3)`` [m] and a radius [m]: their convex hull, grown by it, holds the solid."""
    if isinstance(solid, Mesh):
        return hull_vertices(solid), 0.0
    around = enclose(solid)
    return around.corners, around.radius_m


_HULLS: WeakKeyDictionary[Mesh, FloatArray] = WeakKeyDictionary()


def hull_vertices(mesh: Mesh) -> FloatArray:
    """The vertices ``(K, 3)`` [m] of a mesh that lie on its convex hull."""
    found = _HULLS.get(mesh)
    if found is None:
        found = mesh.vertices[np.unique(mesh.triangles)]
        with suppress(QhullError):  # all in a plane
            found = found[ConvexHull(found).vertices]
        _HULLS[mesh] = found
    return found


def reach(solid: Solid, hull: FloatArray | None, direction: FloatArray) -> FloatArray:
    """How far a solid reaches in unit directions (its support function), exactly.

    Parameters
    ----------
    solid : Solid
        Not a half-space.
    hull : array (K, 3), optional
        :func:`hull_vertices` of a mesh.
    direction : array (..., 3)
        In the axes of the solid.

    Returns
    -------
    array (...)
        Largest product of a point of the solid and the direction [m].
    """
    if isinstance(solid, Cylinder):
        along = direction[..., 2]
        across = np.hypot(direction[..., 0], direction[..., 1])
        return np.asarray(np.abs(along) * (solid.length_m / 2.0) + across * solid.radius_m)
    if isinstance(solid, Mesh):
        points = hull_vertices(solid) if hull is None else hull
        return np.asarray((direction @ points.T).max(axis=-1))
    around = enclose(solid)
    return np.asarray(direction @ around.centre + np.abs(direction) @ around.half + around.radius_m)


def check_body(body: Body) -> None:
    """Raise :class:`InputError` for a placement that is not rigid or a size that is not one."""
    check_transforms(body.T_link_body, f"T_link_body of {body.name}")
    solid = body.solid
    if isinstance(solid, Mesh):
        _check_mesh(body.name, solid)
        return
    for name, value in vars(solid).items():
        sizes = np.atleast_1d(np.asarray(value, dtype=float))
        # a capsule without a length is a ball
        smallest = 0.0 if isinstance(solid, Capsule) and name == "length_m" else 1e-9
        if not (np.isfinite(sizes).all() and (sizes >= smallest).all()):
            raise InputError(
                f"{body.name}: {name} of the {type(solid).__name__.lower()} is {value}",
                hint="sizes are finite and above zero, in metres",
                name=name,
                value=value,
            )


def _check_mesh(name: str, mesh: Mesh) -> None:
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if vertices.ndim != 2 or vertices.shape[-1] != 3 or triangles.shape[1:] != (3,):
        what = f"vertices of shape {vertices.shape} and triangles of shape {triangles.shape}"
        raise InputError(f"{name}: the mesh has {what}", hint="give (V, 3) and (F, 3)", name=name)
    if not len(triangles):
        raise InputError(f"{name}: the mesh has no triangles", name=name)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        worst = int(triangles.min() if triangles.min() < 0 else triangles.max())
        raise InputError(
            f"{name}: a triangle of the mesh names vertex {worst} of {len(vertices)}",
            hint="vertices are counted from zero",
            name=name,
            value=worst,
        )
    if not np.isfinite(vertices).all():
        raise InputError(f"{name}: a vertex of the mesh is not finite", name=name)
