"""Solids, the distances between them, and what stands in the way.

The solids are those that robots are made of. What is computed with them is in
:mod:`calib.geometry.scene`; meshes are read by
:mod:`calib.robots.description.mesh_file`.
"""

from calib.geometry.scene import Scene
from calib.robots.shapes import (
    Body,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    LinkShape,
    Mesh,
    Solid,
    Sphere,
)

__all__ = [
    "Body",
    "Box",
    "Capsule",
    "Cylinder",
    "HalfSpace",
    "LinkShape",
    "Mesh",
    "Scene",
    "Solid",
    "Sphere",
]
