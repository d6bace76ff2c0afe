"""The cell: a robot with its tool, its target and its measurement, ready to be planned for."""

from posedesign.cell.cell import Cell
from posedesign.cell.measuring import free_tool_axes, usual_offsets
from posedesign.cell.orientations import (
    cone_rotations_at,
    touching_poses,
    wpr_rotations,
)
from posedesign.cell.schema import CameraSection, CellConfig
from posedesign.cell.task_box import TaskBox
from posedesign.cell.template import cell_template

__all__ = [
    "CameraSection",
    "Cell",
    "CellConfig",
    "TaskBox",
    "cell_template",
    "cone_rotations_at",
    "free_tool_axes",
    "touching_poses",
    "usual_offsets",
    "wpr_rotations",
]
