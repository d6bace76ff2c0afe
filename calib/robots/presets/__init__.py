"""Robots as plain numbers: one TOML file an arm, each with its source and how far to trust it.

Geometry in mm and degrees, joint by joint as in a URDF: where the joint sits in the link before
it, about which axis it turns, its limits and speed, and what is known of the mass it carries and
the stiffness of its reducer.
"""

from __future__ import annotations

import re
import tomllib
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pinocchio as pin

from calib.errors import RobotModelError, near_names
from calib.robots.bounds import CoupledLimit
from calib.robots.shapes import Box, LinkShape, capsule_between
from calib.se3 import rotation_from_wpr

_NO_LIMIT = np.finfo(float).max


@dataclass(frozen=True, eq=False)
class Preset:
    """A robot as loaded from its file."""

    name: str
    title: str
    source: str
    confidence: str
    missing: tuple[str, ...]  # what the source does not say
    controller: str  # maker of the controller, a key of ``calib.robots.POSITIVE_AXES``
    payload_kg: float
    repeatability_mm: float | None
    arm_mass_kg: float | None
    """repeatability_mm, arm_mass_kg: as the maker's catalogue has them; None where not known."""
    tip: str  # link that carries the tool
    base_posture_deg: tuple[float, ...]
    """A posture to start planning from, the tool in front of the arm and pointing down."""
    model: pin.Model  # links have no mass where the file gives none
    stiffness: dict[str, float]  # torsional stiffness by joint name [Nm/rad]
    shapes: tuple[LinkShape, ...]  # the links as capsules and boxes
    shape_fit: str  # how the shapes were found, and how far off they may be
    coupled_limits: tuple[CoupledLimit, ...]


def preset_names() -> list[str]:
    """Names that :func:`load_preset` knows, sorted."""
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
    """Everything that stands in the file of a preset; for names see :func:`find_preset`."""
    return deepcopy(_content(find_preset(name)))


@cache
def _content(preset: str) -> dict[str, Any]:
    """What stands in a file: the files are parts of the package, so each is read once."""
    file = resources.files(__name__).joinpath(f"{preset}.toml")
    return tomllib.loads(file.read_text(encoding="utf-8"))


def load_preset(name: str) -> Preset:
    """Load a preset and build its Pinocchio model; for names see :func:`find_preset`."""
    name = find_preset(name)
    info = _content(name)
    stiffness = {
        j["name"]: float(j["stiffness_nm_per_rad"])
        for j in info["joint"]
        if "stiffness_nm_per_rad" in j
    }
    return Preset(
        name=name,
        title=info["title"],
        source=info["source"],
        confidence=info["confidence"],
        missing=tuple(info["missing"]),
        controller=info["controller"],
        payload_kg=float(info["payload_kg"]),
        repeatability_mm=info.get("repeatability_mm"),
        arm_mass_kg=info.get("arm_mass_kg"),
        tip=info["tip"],
        base_posture_deg=tuple(info["base_posture_deg"]),
        model=_build_model(name, info),
        stiffness=stiffness,
        shapes=tuple(_shape(entry) for entry in info["shape"]),
        shape_fit=info["shape_fit"],
        coupled_limits=tuple(_coupled_limit(entry) for entry in info.get("coupled_limit", ())),
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


def _coupled_limit(entry: dict[str, Any]) -> CoupledLimit:
    lower, upper = np.deg2rad([entry["lower_deg"], entry["upper_deg"]])
    coefficients = np.array(entry["coefficients"], dtype=float)
    return CoupledLimit(entry["name"], coefficients, float(lower), float(upper))
