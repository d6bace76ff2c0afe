"""A small description of two arms on a torso that turns, on a lift: a tree with two branches."""

from __future__ import annotations

import numpy as np

_JOINTS = [  # those of a LR Mate 200iD: ROS-Industrial fanuc, fanuc_lrmate200id_support
    ("0 0 0.330", "0 0 1", 170),
    ("0.050 0 0", "0 1 0", 100),
    ("0 0 0.330", "0 -1 0", 120),
    ("0 0 0.035", "-1 0 0", 190),
    ("0.335 0 0", "0 -1 0", 125),
    ("0.080 0 0", "-1 0 0", 360),
]


def _joint(name: str, kind: str, parent: str, child: str, more: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{more}</joint>"
    )


def _box(size: str, xyz: str) -> str:
    return f'<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'


def _moves(xyz: str, axis: str, lower: float, upper: float, more: str = "") -> str:
    return (
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{more}'
        f'<limit lower="{lower}" upper="{upper}" velocity="3" effort="1"/>'
    )


def two_arms() -> str:
    """Text of the URDF: ``foot``, ``column``, ``torso``, and a left and a right arm on it."""
    parts = [
        '<robot name="duo">',
        f'<link name="foot">{_box("0.6 0.6 0.1", "0 0 0")}</link>',
        f'<link name="column">{_box("0.2 0.2 0.4", "0 0 0.2")}</link>',
        f'<link name="torso">{_box("0.3 0.4 0.4", "0 0 -0.2")}</link>',
        _joint("lift", "prismatic", "foot", "column", _moves("0 0 0.1", "0 0 1", 0, 0.5)),
        _joint("waist", "revolute", "column", "torso", _moves("0 0 0.9", "0 0 1", -1.5, 1.5)),
    ]
    for side, y, roll in (("left", 0.3, -0.6), ("right", -0.3, 0.6)):
        before = f"{side}_base"
        mount = f'<origin xyz="0 {y} 0" rpy="{roll} 0 0"/>'
        parts += [
            f'<link name="{before}">{_box("0.1 0.1 0.1", "0 0 0.05")}</link>',
            _joint(f"{side}_mount", "fixed", "torso", before, mount),
        ]
        for k, (xyz, axis, most) in enumerate(_JOINTS, start=1):
            link, limit = f"{side}_link_{k}", float(np.deg2rad(most))
            parts += [
                f'<link name="{link}">{_box("0.08 0.08 0.08", "0 0 0")}</link>',
                _joint(
                    f"{side}_joint_{k}", "revolute", before, link, _moves(xyz, axis, -limit, limit)
                ),
            ]
            before = link
        tip = f"{side}_tool0"
        turned = f'<origin rpy="{np.pi} {-np.pi / 2} 0"/>'
        parts += [f'<link name="{tip}"/>', _joint(f"{side}_flange", "fixed", before, tip, turned)]
        for number, way, more in ((1, 1, ""), (2, -1, f'<mimic joint="{side}_finger_1"/>')):
            finger = f"{side}_finger_{number}"
            moves = _moves(f"{0.03 * way} 0 0", f"{way} 0 0", 0, 0.04, more)
            parts += [
                f'<link name="{finger}_link">{_box("0.02 0.02 0.05", "0 0 0.03")}</link>',
                _joint(finger, "prismatic", tip, f"{finger}_link", moves),
            ]
    return "\n".join([*parts, "</robot>"])
