"""Robot programs: written for a controller, read back, and strictly validated."""

from posedesign.programs.controller_view import pendant_from_urdf, urdf_from_pendant
from posedesign.programs.dialect import Dialect
from posedesign.programs.program import PoseProgram, ProgramOptions, ProgramPose
from posedesign.programs.recorded import Problem, RecordedPosition, RecordedProgram
from posedesign.programs.registry import DIALECTS, find_dialect, read, validate, write

__all__ = [
    "DIALECTS",
    "Dialect",
    "PoseProgram",
    "Problem",
    "ProgramOptions",
    "ProgramPose",
    "RecordedPosition",
    "RecordedProgram",
    "find_dialect",
    "pendant_from_urdf",
    "read",
    "urdf_from_pendant",
    "validate",
    "write",
]
