"""What can be identified, as blocks that are combined freely."""

from calib.model.parameters.base import ParameterBlock, Unit
from calib.model.parameters.bearings import BearingCompliance
from calib.model.parameters.compliance import JointCompliance
from calib.model.parameters.gravity import Payload, gravity_torque
from calib.model.parameters.joints import JointHarmonics, JointScale, ZeroOffsets
from calib.model.parameters.links import LinkGeometry
from calib.model.parameters.lost_motion import LostMotion
from calib.model.parameters.targets import LengthOffsets, TargetFrame, TargetPlane, TargetPoints
from calib.model.parameters.tool import ToolFrame, ToolPoint, ToolPoints
from calib.model.parameters.tool_body import ToolBody

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
