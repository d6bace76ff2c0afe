"""``trajectory_msgs/msg/JointTrajectory`` in YAML: the writer.

Sources: the message definitions of ROS 2 (common_interfaces, builtin_interfaces), and what the
joint trajectory controller of ros2_control asks of points.
"""

from __future__ import annotations

from posedesign.programs.arm import Arm
from posedesign.programs.lists import check_options
from posedesign.programs.program import PoseProgram
from posedesign.programs.ros.trajectory_times import point_times_ms
from posedesign.programs.ros.yaml_writing import (
    DECIMALS,
    ending,
    heading,
    joint_values,
    label,
    name_lines,
)

_STAMP = ["header:", "  stamp:", "    sec: 0", "    nanosec: 0", '  frame_id: ""']
"""Zero: the motion begins when the message arrives."""


def render_trajectory(program: PoseProgram, arm: Arm) -> str:
    r"""Text of the trajectory, its lines ended by ``\n``.

    One point a line, in the form of YAML that is JSON, too. The arm comes to rest at every point:
    velocities are zero. A pose that is measured has two points, one where the arm arrives and one,
    after the time to settle, with the same positions. Nothing is called: who runs the trajectory
    measures while the arm stands. Joint values are rounded by 5e-13 rad, times up to whole
    milliseconds.

    Parameters
    ----------
    program : PoseProgram
        What to write.
    arm : Arm
        Whose joints, in the signs of its description.

    Raises
    ------
    InputError
        A text that cannot stand in a comment, a joint beyond +-720 deg, an output to be pulsed,
        registers to be kept, or a time that the message cannot say.
    """
    check_options(program)
    options = program.options
    postures = joint_values(arm, program)
    moving, standing = point_times_ms(postures, arm, options.speed_percent, options.settle_s)
    lines = heading(program, "trajectory_msgs/msg/JointTrajectory")
    lines += [*_STAMP, "joint_names:", *name_lines(arm, ""), "points:"]
    rest = f'"velocities": [{", ".join(["0.0"] * arm.n)}], "accelerations": [], "effort": []'
    now = 0
    for number, pose, posture, move in zip(
        program.numbers, program.poses, postures, moving, strict=True
    ):
        values = ", ".join(f"{value:.{DECIMALS}f}" for value in posture.tolist())
        point = f'- {{"positions": [{values}], {rest}, '
        now += move
        lines += [*label(number, pose), point + _time(now)]
        if standing and not pose.via:
            now += standing
            lines += [f"# hold {number}", point + _time(now)]
    return "\n".join([*lines, ending(program)]) + "\n"


def _time(milliseconds: int) -> str:
    seconds, rest = divmod(milliseconds, 1000)
    return f'"time_from_start": {{"sec": {seconds}, "nanosec": {rest * 1_000_000}}}}}'
