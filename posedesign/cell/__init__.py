"""The cell: a robot with its tool, its target and its measurement, ready to be planned for."""

from posedesign.cell.cell import Cell as Cell
from posedesign.cell.models import free_tool_axes as free_tool_axes
from posedesign.cell.models import usual_offsets as usual_offsets
from posedesign.cell.orientations import cone_rotations_at as cone_rotations_at
from posedesign.cell.orientations import poses_about_tool as poses_about_tool
from posedesign.cell.orientations import touching_poses as touching_poses
from posedesign.cell.orientations import wpr_rotations as wpr_rotations
from posedesign.cell.schema import CameraSection as CameraSection
from posedesign.cell.schema import CellConfig as CellConfig
from posedesign.cell.task_box import TaskBox as TaskBox
from posedesign.cell.template import cell_template as cell_template
