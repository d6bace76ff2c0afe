"""What can be identified, as blocks that are combined freely."""

from calib.parameters.base import ParameterBlock, Unit
from calib.parameters.compliance import JointCompliance, Payload, gravity_torque
from calib.parameters.frames import (
    LengthOffsets,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
)
from calib.parameters.joints import JointHarmonics, JointScale, ZeroOffsets
from calib.parameters.links import LinkGeometry

__all__ = [
    "JointCompliance",
    "JointHarmonics",
    "JointScale",
    "LengthOffsets",
    "LinkGeometry",
    "ParameterBlock",
    "Payload",
    "TargetFrame",
    "TargetPlane",
    "TargetPoints",
    "ToolFrame",
    "ToolPoint",
    "ToolPoints",
    "Unit",
    "ZeroOffsets",
    "gravity_torque",
]
