"""What an arm of fewer than six axes tells of itself, found before a cell is written.

Where the tool point stays on one target such an arm has one or two ways to turn left, or none. What
it cannot show then is the same as where target and tool point are.
"""

from __future__ import annotations

import numpy as np

from calib.identification.identifiability import sort_out
from calib.se3 import FloatArray
from posedesign.cell.cell import Cell
from posedesign.cell.observations import touched_by_tool
from posedesign.cell.orientations import cone_rotations, poses_about_tool

_POSES = 60
"""Poses that are tried."""

_TILT_RAD = np.deg2rad(60.0)
"""Tilt of the tool up to which they are tried."""


def told_of(cell: Cell) -> tuple[tuple[str, ...], str]:
    """Return the zero offsets of a cell that poses can tell, and the axes of its tool point.

    The target is what is placed first: where tool point or joints say the same, they are left out.
    """
    model = cell.model()
    rows = cell.linearise(model, _postures(cell)).white_jacobian.reshape(-1, model.p)
    rows = np.vstack([rows, model.known_rows])
    place = {"target": 0, "tool": 1}
    order = sorted(range(model.p), key=lambda k: place.get(model.names[k].split(".")[0], 2))
    kept = sort_out(rows[:, order], [model.names[k] for k in order]).kept
    names = {model.names[order[k]] for k in kept}
    offsets = tuple(joint for joint in cell.offset_joints if f"zero_offset.{joint}" in names)
    return offsets, "".join(axis for axis in "xyz" if f"tool.{axis}" in names)


def _postures(cell: Cell) -> FloatArray:
    """Return postures ``(N, n)`` [rad, m] inside the limits, on a target that is touched."""
    robot, rng = cell.robot, np.random.default_rng(0)
    if not touched_by_tool(cell.config):
        return np.asarray(rng.uniform(robot.lower, robot.upper, (_POSES, robot.n)))
    base = robot.fk(cell.base_posture)[:3, :3]
    R = cone_rotations(base, _TILT_RAD, _POSES, rng)
    poses = poses_about_tool(robot, R, cell.tool_m, cell.target_m, cell.base_posture, cell.margin)
    found = robot.inverse(poses, near=cell.base_posture, margin=cell.margin)
    return np.vstack([cell.base_posture, found.postures[found.inside]])
