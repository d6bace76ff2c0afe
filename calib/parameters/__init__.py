"""What can be identified, as blocks that are combined freely."""

from calib.parameters.base import ArmErrors, ArmView, ParameterBlock, Payload
from calib.parameters.joints import JointCompliance, ZeroOffsets, gravity_torque
from calib.parameters.setup import TargetPoints, ToolPoint

__all__ = [
    "ArmErrors",
    "ArmView",
    "JointCompliance",
    "ParameterBlock",
    "Payload",
    "TargetPoints",
    "ToolPoint",
    "ZeroOffsets",
    "gravity_torque",
]
