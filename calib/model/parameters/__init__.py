"""What can be identified, as blocks that are combined freely."""

from calib.model.parameters.base import ParameterBlock, Unit
from calib.model.parameters.bearings import BearingCompliance
from calib.model.parameters.compliance import JointCompliance
from calib.model.parameters.frames import Frames
from calib.model.parameters.gravity import (
    GravityLoad,
    Payload,
    gravity_torque,
)
from calib.model.parameters.joints import (
    JointHarmonics,
    JointScale,
    ZeroOffsets,
)
from calib.model.parameters.links import AXES, LinkGeometry
from calib.model.parameters.lost_motion import LostMotion
from calib.model.parameters.part import Part
from calib.model.parameters.targets import (
    LengthOffsets,
    TargetFrame,
    TargetPlane,
    TargetPoints,
)
from calib.model.parameters.tool import (
    ToolFrame,
    ToolPoint,
    ToolPoints,
)
from calib.model.parameters.tool_body import ToolBody

__all__ = [
    "AXES",
    "BearingCompliance",
    "Frames",
    "GravityLoad",
    "JointCompliance",
    "JointHarmonics",
    "JointScale",
    "LengthOffsets",
    "LinkGeometry",
    "LostMotion",
    "ParameterBlock",
    "Part",
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
