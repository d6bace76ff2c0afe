"""Arms of fewer axes than six, and arms with slides of their own, as small descriptions."""

from __future__ import annotations

from math import pi, radians
from pathlib import Path

from calib import Robot

FLANGE = '<link name="tool0"/><joint name="mount" type="fixed"><parent link="{last}"/>'
FLANGE += '<child link="tool0"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
DOWN, AHEAD = f"{pi} 0 0", f"0 {pi / 2} 0"

Axis = tuple[str, str, str, float, float]
"""Kind (R in deg or P in m), origin [m], axis, lower and upper limit."""

ARMS: dict[str, tuple[list[Axis], str, str]] = {
    # two arms of 300 mm and a stroke of 200 mm, as small SCARAs have; the quill before the roll
    "scara": (
        [
            ("R", "0 0 0.25", "0 0 1", -140, 140),
            ("R", "0.3 0 0", "0 0 1", -145, 145),
            ("P", "0.3 0 0", "0 0 -1", 0.0, 0.2),
            ("R", "0 0 -0.05", "0 0 1", -360, 360),
        ],
        "0 0 -0.02",
        DOWN,
    ),
    # the roll before the quill
    "quill last": (
        [
            ("R", "0 0 0.25", "0 0 1", -140, 140),
            ("R", "0.3 0 0", "0 0 1", -145, 145),
            ("R", "0.3 0 0", "0 0 1", -360, 360),
            ("P", "0 0 -0.05", "0 0 -1", 0.0, 0.2),
        ],
        "0 0 -0.02",
        DOWN,
    ),
    "cartesian": (
        [
            ("P", "0 0 1.2", "1 0 0", 0.0, 2.0),
            ("P", "0 0 0", "0 1 0", -0.6, 0.6),
            ("P", "0 0 0", "0 0 1", -0.8, 0.0),
        ],
        "0 0 -0.1",
        DOWN,
    ),
    "cartesian with a roll": (
        [
            ("P", "0 0 1.2", "1 0 0", 0.0, 2.0),
            ("P", "0 0 0", "0 1 0", -0.6, 0.6),
            ("P", "0 0 0", "0 0 1", -0.8, 0.0),
            ("R", "0 0 -0.1", "0 0 1", -180, 180),
        ],
        "0 0 -0.1",
        DOWN,
    ),
    "cylindrical": (
        [
            ("R", "0 0 0.2", "0 0 1", -170, 170),
            ("P", "0 0 0.1", "0 0 1", 0.0, 0.5),
            ("P", "0.2 0 0", "1 0 0", 0.0, 0.4),
        ],
        "0 0 0",
        DOWN,
    ),
    # the arm of Stanford: six axes, the third slides
    "stanford": (
        [
            ("R", "0 0 0.4", "0 0 1", -170, 170),
            ("R", "0 0.15 0", "0 1 0", -120, 120),
            ("P", "0 0 0.2", "0 0 1", 0.0, 0.5),
            ("R", "0 0 0.1", "0 0 1", -170, 170),
            ("R", "0 0 0", "0 1 0", -110, 110),
            ("R", "0 0 0.08", "0 0 1", -170, 170),
        ],
        "0 0 0.02",
        "0 0 0",
    ),
    "five axes": (
        [
            ("R", "0 0 0.3", "0 0 1", -150, 150),
            ("R", "0.1 0 0", "0 1 0", -60, 120),
            ("R", "0 0 0.25", "0 1 0", -110, 120),
            ("R", "0.16 0 0", "0 1 0", -90, 90),
            ("R", "0.072 0 0", "1 0 0", -200, 200),
        ],
        "0.02 0 0",
        AHEAD,
    ),
    "four axes": (
        [
            ("R", "0 0 0.08", "0 0 1", -150, 150),
            ("R", "0.012 0 0", "0 1 0", -90, 90),
            ("R", "0.024 0 0.128", "0 1 0", -90, 80),
            ("R", "0.124 0 0", "0 1 0", -100, 115),
        ],
        "0.126 0 0",
        AHEAD,
    ),
}


def urdf_of_axes(name: str) -> str:
    """The description of one of these arms, without shapes."""
    axes, xyz, rpy = ARMS[name]
    parts = [f'<robot name="{name}"><link name="l0"/>']
    for k, (kind, at, axis, least, most) in enumerate(axes, start=1):
        turns = kind == "R"
        low, high = (radians(least), radians(most)) if turns else (least, most)
        parts.append(
            f'<link name="l{k}"/><joint name="j{k}" type="{"revolute" if turns else "prismatic"}">'
            f'<parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="{at}"/>'
            f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="1" effort="1"/>'
            "</joint>"
        )
    parts.append(FLANGE.format(last=f"l{len(axes)}", xyz=xyz, rpy=rpy))
    return "\n".join([*parts, "</robot>"])


def few_axes(name: str, folder: Path) -> Robot:
    """One of these arms, read from a file in a folder."""
    path = folder / "arm.urdf"
    path.write_text(urdf_of_axes(name))
    return Robot.from_urdf(path)
