"""A commented ``cell.toml`` to start from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.errors import RobotModelError, near_names
from calib.robots import Robot, preset_info, preset_names
from posedesign.base_posture import suggest_base_posture, suggest_tool

REFERENCE = "r2000ic165f"
"""Preset of the reference cell: the arm and tool of Watanabe et al. 2006 in public numbers."""

_TEMPLATE = """\
# A calibration cell for posedesign. Lengths in mm, angles in degrees, joints in URDF signs.
# Plan with:  posedesign plan cell.toml --out DIR

[robot]
{robot}
{notices}# base = "base_link"              # positions are given in this link; default: the root
tip = {tip}

[tool]
# The point that is brought to the target: a pin, a ball, or the camera's virtual pin tip.
# {tool_note}
point_mm = {point_mm}             # in the axes of the tip
mass_kg = {mass_kg}               # what the flange carries, for deflection in the simulation
com_mm = {com_mm}
camera_stand_off_mm = {stand_off} # the lens is this far behind the tool point, along the tip's z

[base_pose]
# The posture with the tool point on the target that all poses are varied around.
{pendant}posture_deg = {posture_deg}

[target]
name = "T1"
# In the base frame; default: where the base pose puts the tool point, which is
# position_mm = {target_mm}

[variations]
# W, P and R are varied by -D, 0, +D: 27 poses. D starts here and is raised step by step.
start_deg = [5.0, 5.0, 5.0]
step_deg = [5.0, 5.0, 5.0]
largest_deg = [60.0, 60.0, 60.0]
raise = "together"                # or "best": only the angle that lowers the condition most

[plan]
condition_threshold = {threshold} # C_G = cond(G'G); the loop stops below it
limit_margin_deg = 0.0            # kept from every joint limit
repair = true                     # replace poses that cannot be reached
repair_margin_deg = 2.0           # kept by the replacements
repair_tilt_deg = 60.0            # largest tilt of a replacement against the base pose
repair_base_joint_deg = 90.0      # how far joint 1 may turn in a replacement

[parameters]
# Identified besides the target. The first and the last joint are absorbed by target and tool.
zero_offsets = {offsets}
tool_axes = "xyz"                 # "xy" for a view line
method = "gauss-newton"           # or "newton-raphson": as in the paper, by finite differences

[measurement]
kind = "touch-up"                 # or "view-line": only across the line of sight
three_sigma_mm = {three_sigma}    # of one touch-up, along x, y, z of the tip
weighted = true                   # by this noise
camera_three_sigma_deg = 0.06     # of the camera's pose, for AX = ZB
camera_three_sigma_mm = 0.3

[truth]
# The robot that is simulated; planning and identification never look here.
seed = 1
zero_offsets_deg = {truth}
tool_error_mm = [2.0, -1.0, 3.0]
target_error_mm = [5.0, -4.0, 2.0]
deflection = {deflection}         # reducers give way under gravity
# stiffness_nm_per_rad = [4e6, ...]  # of each joint; default: the preset's

[program]
name = "CALIB01"
user_frame = 0
tool_frame = 1
speed_percent = 10
settle_s = 1.0
measure_call = "MEASURE"          # called at each pose with its number
"""


def cell_template(robot: str | None = None) -> str:
    """Text of a ``cell.toml``, commented, for a preset or a URDF file.

    Parameters
    ----------
    robot : str, optional
        Name of a preset or path of a URDF; the reference cell by default.

    Raises
    ------
    RobotModelError
        Neither a preset nor a file that can be read.
    UnreachableError
        No base posture was found for the arm of a URDF.
    """
    name = robot or REFERENCE
    if name in preset_names():
        return _for_preset(name)
    path = Path(name)
    if not path.exists() and path.suffix.lower() not in (".urdf", ".xml"):
        raise RobotModelError(
            f"{name!r} is neither a preset nor a URDF file",
            hint=near_names(name, preset_names()),
            name=name,
        )
    return _for_urdf(path)


def _for_preset(name: str) -> str:
    info = preset_info(name)
    robot = Robot.preset(name)
    posture = info["base_posture_deg"]
    pendant = ""
    if info["dialect"] == "fanuc-ls":
        pendant = f"# A FANUC pendant shows J3 = {posture[2] - posture[1]:g} here: J3 less J2.\n"
    return _fill(
        robot,
        source=f'preset = "{name}"',
        tool_note="As good as you know it; it is identified too.",
        tool=([200.0, -50.0, 350.0], 106.0, [50.0, 0.0, 200.0], 350.0),
        pendant=pendant,
        posture=posture,
        three_sigma=[0.02, 0.02, 0.12],
        deflection=True,
    )


def _for_urdf(path: Path) -> str:
    robot = Robot.from_urdf(path)
    tool = suggest_tool(robot)
    posture = np.rad2deg(suggest_base_posture(robot, tool))
    return _fill(
        robot,
        source=f"urdf = {_quoted(str(path.resolve()))}\n{_controller_line(robot)}",
        tool_note="A SUGGESTION only: put in your own, as good as you know it; it is identified.",
        tool=((1e3 * tool).tolist(), 0.0, [0.0, 0.0, 0.0], 100.0),
        pendant="# Suggested: tool pointing down, room to turn it. Take your own taught posture.\n",
        posture=(np.round(posture, 6) + 0.0).tolist(),
        three_sigma=[0.1, 0.1, 0.1],
        deflection=False,
    )


def _controller_line(robot: Robot) -> str:
    """The controller, of a URDF that says by its name that it is ROS-Industrial's of a FANUC."""
    if robot.name.lower().startswith("fanuc"):
        return 'controller = "fanuc"              # with joints in ROS-Industrial signs'
    return '# controller = "fanuc"            # only for a FANUC in ROS-Industrial signs'


def _quoted(text: str) -> str:
    """A TOML string: names in a URDF and paths may hold quotation marks and backslashes."""
    return json.dumps(text, ensure_ascii=False)


def _fill(
    robot: Robot,
    *,
    source: str,
    tool_note: str,
    tool: tuple[Sequence[float], float, Sequence[float], float],
    pendant: str,
    posture: Sequence[float],
    three_sigma: Sequence[float],
    deflection: bool,
) -> str:
    from posedesign.cell import usual_offsets

    point = robot.state(np.deg2rad(posture)).point(np.array(tool[0]) / 1e3)
    offsets = ", ".join(_quoted(joint) for joint in robot.joint_names[1:-1])
    return _TEMPLATE.format(
        robot=source,
        tool_note=tool_note,
        target_mm=[round(float(v), 3) + 0.0 for v in 1e3 * point],
        notices="".join(f"# {' '.join(said.split())}\n" for said in robot.notices),
        tip=_quoted(robot.tip_frame),
        point_mm=list(tool[0]),
        mass_kg=tool[1],
        com_mm=list(tool[2]),
        stand_off=tool[3],
        pendant=pendant,
        posture_deg=list(posture),
        threshold="1.0e5",
        offsets=f"[{offsets}]",
        three_sigma=list(three_sigma),
        truth=np.round(np.rad2deg(usual_offsets(robot.n)), 6).tolist(),
        deflection=str(deflection).lower(),
    )
