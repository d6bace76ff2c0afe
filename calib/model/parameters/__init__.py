"""What can be identified, as blocks that are combined freely."""

from calib.model.parameters.base import ParameterBlock, Part, Unit
from calib.model.parameters.frames import (
    Frames,
    LengthOffsets,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolBody,
    ToolFrame,
    ToolPoint,
    ToolPoints,
)
from calib.model.parameters.gravity import GravityLoad, Payload, gravity_torque
from calib.model.parameters.joints import (
    JointCompliance,
    JointHarmonics,
    JointScale,
    LostMotion,
    TimeOffsets,
    ZeroOffsets,
)
from calib.model.parameters.links import AXES, BearingCompliance, LinkGeometry
from calib.model.parameters.readings import BoardErrors, LensParameters, ReadingParameters

__all__ = [
    "AXES",
    "BearingCompliance",
    "BoardErrors",
    "Frames",
    "GravityLoad",
    "JointCompliance",
    "JointHarmonics",
    "JointScale",
    "LengthOffsets",
    "LensParameters",
    "LinkGeometry",
    "LostMotion",
    "ParameterBlock",
    "Part",
    "Payload",
    "ReadingParameters",
    "TargetFrame",
    "TargetPlane",
    "TargetPoints",
    "TimeOffsets",
    "ToolBody",
    "ToolFrame",
    "ToolPoint",
    "ToolPoints",
    "Unit",
    "ZeroOffsets",
    "gravity_torque",
]
