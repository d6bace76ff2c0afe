"""What can be identified, as blocks that are combined freely."""

from calib.parameters.base import ParameterBlock, Unit
from calib.parameters.bearings import BearingCompliance
from calib.parameters.compliance import JointCompliance
from calib.parameters.gravity import Payload, gravity_torque
from calib.parameters.joints import JointHarmonics, JointScale, ZeroOffsets
from calib.parameters.links import LinkGeometry
from calib.parameters.lost_motion import LostMotion
from calib.parameters.targets import LengthOffsets, TargetFrame, TargetPlane, TargetPoints
from calib.parameters.tool import ToolFrame, ToolPoint, ToolPoints
from calib.parameters.tool_body import ToolBody

__all__ = [
    "BearingCompliance",
    "JointCompliance",
    "JointHarmonics",
    "JointScale",
    "LengthOffsets",
    "LinkGeometry",
    "LostMotion",
    "ParameterBlock",
    "Payload",
    "TargetFrame",
    "TargetPlane",
    "TargetPoints",
    "ToolBody",
    "ToolFrame",
    "ToolPoint",
    "ToolPoints",
    "Unit",
    "ZeroOffsets",
    "gravity_torque",
]
