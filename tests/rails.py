"""Arms on rails, gantries and lifts, as URDFs."""

from collections.abc import Sequence

from calib import Robot
from calib.robots.urdf_anew import urdf_of

RAIL = ("rail", "0 1 0", "-1.5", "2.5")
"""Name, direction, lower and upper limit [m]."""

GANTRY = (
    ("along", "1 0 0.02", "0", "4"),
    ("across", "0 1 0", "-1", "1"),
    ("lift", "0 0 1", "0", "0.8"),
)


def on_slides(arm: str | Robot, slides: Sequence[tuple[str, str, str, str]] = (RAIL,)) -> str:
    """URDF of an arm, or a preset, whose base link stands on slides, the first on the floor."""
    robot = Robot.preset(arm) if isinstance(arm, str) else arm
    text, root = urdf_of(robot, "").decode(), robot.link_names[0]
    added = ""
    for k, (name, axis, lower, upper) in enumerate(slides):
        below = f"{slides[k - 1][0]}_carriage" if k else "floor"
        above = f"{name}_carriage"
        added += (
            f'<link name="{below}"/><joint name="{name}" type="prismatic"><parent link="{below}"/>'
            f'<child link="{above}"/><origin xyz="0 0 0.4" rpy="0.02 -0.03 0.01"/>'
            f'<axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="1.2" effort="0"/>'
            "</joint>"
        )
    added += (
        f'<link name="{above}"/><joint name="stand" type="fixed"><parent link="{above}"/>'
        f'<child link="{root}"/><origin xyz="0.1 0 0.2" rpy="0 0 1.2"/></joint>'
    )
    return text.replace("</robot>", f"{added}</robot>")
