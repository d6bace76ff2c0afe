"""The identified arm in the forms that other programs, and pendants, take.

=============================  ====================================================================
``corrected_dh.csv``           table of Denavit and Hartenberg, of Craig (``_modified``), or with
                               Hayati's rows where axes are parallel (``_hayati``): see
                               :mod:`calib.robots.dh`
``corrected_kinematics.yaml``  what ``ur_description`` takes as ``kinematics_params``, and
                               ``ur_calibration`` makes of the factory's calibration
=============================  ====================================================================

Left out, as nothing public says them rightly: parameters of KUKA's and ABB's absolute accuracy,
which are options of the controller, and motor offsets in counts or radians of a motor, whose signs
and ratios belong to the model of the arm. RoboDK has tables of Craig's form; how they are entered
is not public.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import InputError, near_names
from calib.robots import Robot
from calib.robots.dh import PARALLEL_RAD, Form, dh_table
from calib.robots.urdf_anew import rpy_of
from calib.se3 import FloatArray, inverse
from posedesign.files.csv_tables import table_text

_PRODUCTS: dict[Form, str] = {
    "standard": "Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    "modified": "Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)",
}

_UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")

_ZEROED = "jog every joint to its shown_at_zero_deg, all of them at once"

IN_THE_WORDS_OF = {
    "fanuc": f"{_ZEROED}; then MENU, SYSTEM, Master/Cal: ZERO POSITION MASTER, and CALIBRATE. Note "
    "the master counts before",
    "kuka": "jog every axis to its mastering position (of $MAMES) plus its shown_at_zero_deg, all "
    "of them at once; then Start-up, Master, Dial",
    "abb": f"{_ZEROED}; then Calibration, Fine Calibration, all axes, and Update Revolution "
    "Counters. Note the motor calibration offsets before",
    "yaskawa": f"{_ZEROED}; then ROBOT, HOME POSITION: register all axes. Note the ABSO DATA "
    "before",
    "ur": "these arms take no zeros by the user: use the corrected poses",
}
"""How to enter zero offsets, in the words of makers' pendants (from general knowledge): what is
shown there becomes the zero. It needs neither signs nor ratios of motors."""


def zeroing_words(robot: Robot) -> str:
    """How the zeros of an arm are entered, in the words of its maker's pendant."""
    maker = "" if robot.controller is None else robot.controller.maker
    usual = f"{_ZEROED}; then make this the zero of all joints, as the maker has it"
    words = IN_THE_WORDS_OF.get(maker, usual)
    external = ", ".join(sorted(robot.joint_labels[: robot.n_external]))
    keep = f". {external} at 0 meanwhile, or left out: only the zeros of the arm are corrected"
    return words + keep * bool(external)


@dataclass(frozen=True)
class Export:
    """A file of an identified arm; ``text`` makes its content, of what there is to be said."""

    file: str
    purpose: str
    text: Callable[[Robot, Sequence[str]], str]


def dh_text(robot: Robot, said: Sequence[str], form: Form, parallel_rad: float) -> str:
    """A table in CSV, one row a joint, with the base and the tool in the lines before."""
    table = dh_table(robot, form, parallel_rad)
    columns = ["joint", "theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg"]
    values = np.column_stack(
        [
            np.rad2deg(table.theta),
            1e3 * table.d,
            1e3 * table.a,
            np.rad2deg(table.alpha),
            np.rad2deg(table.beta),
        ]
    )
    rows = [
        {"joint": name, **dict(zip(columns[1:], row, strict=True))}
        for name, row in zip(robot.joint_names, values.tolist(), strict=True)
    ]
    comments = [
        *said,
        f"each row is {_PRODUCTS[form]}, theta is the description's joint value plus theta_deg",
        f"base, before the first row: {_placed(table.T_base_0)}",
        f"tool, behind the last row, to {robot.tip_frame}: {_placed(table.T_n_tip)}",
    ]
    return table_text(columns, rows, comments)


def _placed(T: FloatArray) -> str:
    """A transform in words: ``x y z = 0.0 0.0 450.0 mm, w p r = 0.0 0.0 90.0 deg``."""
    given = 1e3 * T[:3, 3], np.rad2deg(rpy_of(T[:3, :3]))
    place, turn = (" ".join(map(repr, numbers.tolist())) for numbers in given)
    return f"x y z = {place} mm, w p r = {turn} deg (Rz(r) Ry(p) Rx(w))"


def ur_kinematics_text(robot: Robot, said: Sequence[str]) -> str:
    """The joint origins of an arm of Universal Robots, as ``ur_description`` takes them.

    Of a file ``config/*/default_kinematics.yaml`` (Universal_Robots_ROS2_Description); the first is
    in the axes of ``base_link_inertia``, which are those of the controller's base. The hash is none
    of an arm: the driver says that it is not the one that it is connected to.

    Raises InputError: the arm is no such arm.
    """
    controller = robot.controller
    about_z = np.abs(robot.chain.axes - [0.0, 0.0, 1.0]).max(initial=0.0) < 1e-12
    if controller is None or controller.maker != "ur" or not about_z or robot.n_external:
        raise InputError(
            f"{robot.name} is no arm of Universal Robots with joint frames that turn about z",
            hint="export a table of Denavit and Hartenberg",
            name="export",
        )
    placements = robot.chain.placements.copy()
    placements[0] = inverse(controller.T_base_world) @ placements[0]
    lines = [*(f"# {text}" for text in said), "kinematics:"]
    for link, T in zip(_UR_LINKS, placements, strict=True):
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        values = [*T[:3, 3].tolist(), *rpy_of(T[:3, :3]).tolist()]
        lines.append(f"  {link}:")
        lines += [f"    {name}: {value + 0.0!r}" for name, value in zip(names, values, strict=True)]
    digest = hashlib.sha256(placements.tobytes()).hexdigest()[:16]
    return "\n".join([*lines, f"  hash: posedesign_{digest}", ""])


def _dh(form: Form, parallel_rad: float) -> Callable[[Robot, Sequence[str]], str]:
    return lambda robot, said: dh_text(robot, said, form, parallel_rad)


EXPORTS = {
    "dh": Export("corrected_dh.csv", "DH table", _dh("standard", 0.0)),
    "dh-modified": Export("corrected_dh_modified.csv", "modified DH table", _dh("modified", 0.0)),
    "dh-hayati": Export(
        "corrected_dh_hayati.csv", "DH table with Hayati's rows", _dh("standard", PARALLEL_RAD)
    ),
    "ur-kinematics": Export("corrected_kinematics.yaml", "UR kinematics", ur_kinematics_text),
}
"""By the name that is asked for."""


def find_exports(names: Sequence[str]) -> list[Export]:
    """The forms of these names; InputError with the near ones where there is none."""
    for name in names:
        if name not in EXPORTS:
            raise InputError(
                f"unknown form {name[:40]!r} to export",
                hint=near_names(name, EXPORTS),
                name="export",
            )
    return [EXPORTS[name] for name in dict.fromkeys(names)]
