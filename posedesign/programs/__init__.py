"""Robot programs: written for a controller, read back, and strictly validated."""

from posedesign.programs.arm import Arm, Load
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.recorded import (
    Level,
    PlanMark,
    Problem,
    RecordedPosition,
    RecordedProgram,
    postures_of,
)
from posedesign.programs.registry import DIALECTS, find_dialect, read, validate, write

__all__ = [
    "DIALECTS",
    "Arm",
    "Dialect",
    "Level",
    "Load",
    "PlanMark",
    "PoseProgram",
    "Problem",
    "ProgramOptions",
    "ProgramPose",
    "RecordedPosition",
    "RecordedProgram",
    "find_dialect",
    "postures_of",
    "read",
    "validate",
    "write",
]
