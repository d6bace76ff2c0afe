"""The solids of a cell, as its file describes them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.geometry import Body, Box, Cylinder, HalfSpace, Solid, Sphere
from calib.robots import Robot
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.config import SolidSection


def tool_bodies(sections: Sequence[SolidSection], robot: Robot, folder: Path) -> list[Body]:
    """What the flange carries; places in the file are in the tip frame."""
    T_link_tip = robot.chain.T_link_tip
    return [Body(s.name, robot.n, T_link_tip @ _placement(s), _solid(s, folder)) for s in sections]


def obstacles(sections: Sequence[SolidSection], folder: Path) -> list[Body]:
    """What stands around; places in the file are in the base frame."""
    return [Body(s.name, 0, _placement(s), _solid(s, folder)) for s in sections]


def _placement(section: SolidSection) -> FloatArray:
    rotation = rotation_from_wpr(np.deg2rad(section.wpr_deg))
    return transform(rotation, np.array(section.at_mm) / 1e3)


def _solid(section: SolidSection, folder: Path) -> Solid:
    if section.mesh is not None:
        from calib.geometry.mesh_file import read_mesh

        scale = section.scale / 1e3  # a mesh of a cell is in mm, as everything in its file
        return read_mesh(folder / section.mesh, (scale, scale, scale))
    if section.size_mm is not None:
        x, y, z = np.array(section.size_mm) / 1e3
        return Box((float(x), float(y), float(z)))
    if section.radius_mm is not None:
        radius_m = section.radius_mm / 1e3
        if section.height_mm is None:
            return Sphere(radius_m)
        return Cylinder(radius_m, section.height_mm / 1e3)
    return HalfSpace()
