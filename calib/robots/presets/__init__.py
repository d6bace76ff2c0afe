"""Robots as plain numbers: one TOML file an arm, each with its source and how far to trust it.

Geometry in mm and degrees, joint by joint as in a URDF: where the joint sits in the link before
it, about which axis it turns, its limits and speed, and what is known of the mass it carries and
the stiffness of its reducer.
"""

from __future__ import annotations

import re
import tomllib
from copy import deepcopy
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pinocchio as pin

from calib.errors import RobotModelError, near_names
from calib.robots.bounds import CoupledLimit
from calib.robots.model_chain import RobotDescription
from calib.robots.shapes import Box, LinkShape, capsule_between
from calib.se3 import rotation_from_wpr

_NO_LIMIT = np.finfo(float).max


def preset_names() -> list[str]:
    """Names of the presets, sorted."""
    return list(_names())


@cache
def _names() -> tuple[str, ...]:
    files = resources.files(__name__).iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def find_preset(name: str) -> str:
    """Name of the preset that is meant: ``LR Mate 200iD``, say, or ``IRB 6700``.

    Capitals, spaces and signs do not count, and a file may list other names of its arm. Raises
    RobotModelError: there is none of that name.
    """
    known = preset_names()
    if name in known:
        return name
    for preset in known:
        names = (preset, *_content(preset).get("aliases", ()))
        if _plain(name) in [_plain(n) for n in names]:
            return preset
    raise RobotModelError(f"there is no preset {name!r}", hint=near_names(name, known), name=name)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def preset_info(name: str) -> dict[str, Any]:
    """Everything that stands in the file of a preset; for names see :func:`find_preset`.

    ``missing``: what its source does not say. ``controller``: its maker, a key of
    ``calib.robots.POSITIVE_AXES``. ``repeatability_mm`` and ``arm_mass_kg``, where they are known,
    and ``payload_kg``: as the maker's catalogue has them. ``tip``: link that carries the tool.
    ``base_posture_deg``: to start planning from, the tool in front of the arm and pointing down.
    ``shape_fit``: how the shapes were found, and how far off they may be.
    """
    return deepcopy(_content(find_preset(name)))


@cache
def _content(preset: str) -> dict[str, Any]:
    """What stands in a file: the files are parts of the package, so each is read once."""
    file = resources.files(__name__).joinpath(f"{preset}.toml")
    return tomllib.loads(file.read_text(encoding="utf-8"))


def describe_preset(name: str) -> RobotDescription:
    """Build the Pinocchio model of a preset; for names see :func:`find_preset`.

    Links have no mass where the file gives none, and are capsules and boxes.
    """
    name = find_preset(name)
    info = _content(name)
    known = [joint for joint in info["joint"] if "stiffness_nm_per_rad" in joint]
    return RobotDescription(
        model=_build_model(name, info),
        shapes=[_shape(entry) for entry in info["shape"]],
        stiffness={joint["name"]: float(joint["stiffness_nm_per_rad"]) for joint in known},
    )


def _build_model(name: str, info: dict[str, Any]) -> pin.Model:
    model = pin.Model()
    model.name = name
    links: dict[str, tuple[int, pin.SE3]] = {}  # link -> joint that moves it, its place there

    def add_link(link: str, joint: int, placement: pin.SE3) -> None:
        links[link] = joint, placement
        model.addFrame(pin.Frame(link, joint, 0, placement, pin.FrameType.BODY))

    add_link(info["base"], 0, pin.SE3.Identity())
    parent = info["base"]
    for joint in info["joint"]:
        mover, at = links[parent]
        index = model.addJoint(
            mover,
            pin.JointModelRevoluteUnaligned(np.array(joint["axis"], dtype=float)),
            at * _placement(joint),
            joint["name"],
            np.array([_NO_LIMIT]),
            np.array([np.deg2rad(joint["speed_deg_s"])]),
            np.array([np.deg2rad(joint["lower_deg"])]),
            np.array([np.deg2rad(joint["upper_deg"])]),
        )
        model.addJointFrame(index)  # without it a joint cannot be locked
        if "mass_kg" in joint:
            com = np.array(joint["com_mm"], dtype=float) / 1e3
            model.appendBodyToJoint(
                index, pin.Inertia(joint["mass_kg"], com, np.zeros((3, 3))), pin.SE3.Identity()
            )
        add_link(joint["link"], index, pin.SE3.Identity())
        parent = joint["link"]
    for frame in info["frame"]:
        mover, at = links[frame["parent"]]
        add_link(frame["name"], mover, at * _placement(frame))
    return model


def _placement(entry: dict[str, Any]) -> pin.SE3:
    rotation = rotation_from_wpr(np.deg2rad(entry.get("rpy_deg", [0.0, 0.0, 0.0])))
    return pin.SE3(rotation, np.array(entry.get("xyz_mm", [0.0, 0.0, 0.0]), dtype=float) / 1e3)


def _shape(entry: dict[str, Any]) -> LinkShape:
    """A capsule between two points, or a box about one; both in the frame of the link."""
    link = entry["link"]
    name = entry.get("name", link)
    if "radius_mm" in entry:
        start, end = np.array([entry["from_mm"], entry["to_mm"]], dtype=float) / 1e3
        return LinkShape(link, name, *capsule_between(start, end, entry["radius_mm"] / 1e3))
    x, y, z = np.array(entry["size_mm"], dtype=float) / 1e3
    return LinkShape(link, name, _placement(entry).homogeneous, Box((x, y, z)))


def coupled_limits_of(info: dict[str, Any]) -> tuple[CoupledLimit, ...]:
    """Limits that joints have together, of what stands in the file of a preset."""
    return tuple(
        CoupledLimit(
            entry["name"],
            np.array(entry["coefficients"], dtype=float),
            *np.deg2rad([entry["lower_deg"], entry["upper_deg"]]).tolist(),
        )
        for entry in info.get("coupled_limit", ())
    )
