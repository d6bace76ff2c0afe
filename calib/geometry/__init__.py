"""Solids, the distances between them, and what stands in the way.

Here are the solids alone: robots are made of them. What is reckoned with them is in
:mod:`calib.geometry.scene`, which needs the kinematics of robots, and meshes are read by
:mod:`calib.geometry.mesh_file`.
"""

from calib.geometry.shapes import (
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
    "Solid",
    "Sphere",
]
