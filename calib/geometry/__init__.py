"""Solids, the distances between them, and what stands in the way."""

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
