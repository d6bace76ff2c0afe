"""A transform in the forms that other programs take: matrix, quaternion, ROS, URDF."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, quaternion_from_rotation, wpr_from_rotation

DIGITS = 9
"""Decimals of metres and of quaternions: far below what anything measures."""


def forms_of(T: FloatArray, parent: str, child: str) -> dict[str, str]:
    """The transform ``T_parent_child`` (4, 4) [m] as text, by the name of the form.

    ROS names frames from the parent: its static transform ``parent -> child`` is the place of the
    child in the parent, which is this one (REP 103, 105; tf2's ``static_transform_publisher``).
    """
    w, x, y, z = (_plain(value) for value in quaternion_from_rotation(T[:3, :3]))
    place = [_plain(value) for value in T[:3, 3]]
    roll, pitch, yaw = (_plain(value) for value in wpr_from_rotation(T[:3, :3]))
    rows = (", ".join(_plain(value) for value in row) for row in T)
    turned = f"--qx {x} --qy {y} --qz {z} --qw {w}"
    moved = " ".join(f"--{axis} {value}" for axis, value in zip("xyz", place, strict=True))
    return {
        "matrix [m]": "[" + ", ".join(f"[{row}]" for row in rows) + "]",
        "x y z [m], quaternion x y z w": ", ".join([*place, x, y, z, w]),
        "ROS 2": f"ros2 run tf2_ros static_transform_publisher {moved} {turned} "
        f"--frame-id {parent} --child-frame-id {child}",
        "URDF": f'<origin xyz="{" ".join(place)}" rpy="{roll} {pitch} {yaw}"/>',
    }


def _plain(value: float) -> str:
    """A number in decimals, without an exponent and without minus zero."""
    return np.format_float_positional(round(float(value), DIGITS) + 0.0, trim="-")
