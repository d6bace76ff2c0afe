"""Arms beside positioners that carry the target, as URDFs."""

from calib import Robot
from calib.robots.urdf_anew import urdf_of

TWO_AXES = (
    ("tilt", "0 1 0", "-1.6", "1.9", "0.9 0.1 0.7", "0.02 -0.03 0.01"),
    ("turn", "0.01 0 1", "-3.3", "3.4", "0.05 -0.02 0.11", "0.01 0.02 -0.4"),
)
"""Of each joint from the floor: name, axis, lower and upper limit [rad], origin."""

ONE_AXIS = (("turn", "0 0 1", "-3.3", "3.4", "0.9 0.1 0.7", "0.02 -0.03 0.01"),)

PLATE = (
    '<collision><origin xyz="0 0 -0.02"/><geometry><cylinder radius="0.2" length="0.04"/>'
    "</geometry></collision>"
)


def beside_positioner(
    preset: str,
    joints: tuple[tuple[str, ...], ...] = TWO_AXES,
    *,
    place: float = 1.0,
    rail: bool = False,
    plate: str = PLATE,
) -> str:
    """URDF of a preset in a world with a positioner, whose plate is the link ``plate``.

    ``place`` multiplies how far the positioner stands off. ``rail``: the arm is on a rail.
    """
    text = urdf_of(Robot.preset(preset), "").decode()
    root = Robot.preset(preset).link_names[0]
    added, below = '<link name="world"/><link name="stand"/>', "stand"
    added += (
        '<joint name="standing" type="fixed"><parent link="world"/><child link="stand"/>'
        '<origin xyz="0.1 0.05 0" rpy="0 0 0.1"/></joint>'
    )
    for k, (name, axis, lower, upper, xyz, rpy) in enumerate(joints):
        x, y, z = (float(v) * (place if k == 0 else 1.0) for v in xyz.split())
        above = f"{name}_link"
        added += (
            f'<link name="{above}"/><joint name="{name}" type="revolute">'
            f'<parent link="{below}"/><child link="{above}"/>'
            f'<origin xyz="{x} {y} {z}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="1.5" effort="0"/></joint>'
        )
        below = above
    added += (
        f'<link name="plate">{plate}</link><joint name="face" type="fixed">'
        f'<parent link="{below}"/><child link="plate"/>'
        '<origin xyz="0 0.01 0.05" rpy="0 0 0.3"/></joint>'
    )
    foot = "world"
    if rail:
        foot = "carriage"
        added += (
            '<link name="carriage"/><joint name="rail" type="prismatic"><parent link="world"/>'
            '<child link="carriage"/><origin xyz="0 -0.2 0.1" rpy="0.01 0 0"/><axis xyz="0 1 0"/>'
            '<limit lower="-1" upper="1.2" velocity="1" effort="0"/></joint>'
        )
    added += (
        f'<joint name="foot" type="fixed"><parent link="{foot}"/><child link="{root}"/>'
        '<origin xyz="0 0 0.2" rpy="0 0.03 0.2"/></joint>'
    )
    return text.replace("</robot>", f"{added}</robot>")
