"""Robot programs: written for a controller, read back, and strictly validated."""

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from posedesign.programs.arm import Arm as Arm
    from posedesign.programs.arm import Load as Load
    from posedesign.programs.dialect import Dialect as Dialect
    from posedesign.programs.program import PoseProgram as PoseProgram
    from posedesign.programs.program import ProgramOptions as ProgramOptions
    from posedesign.programs.program import ProgramPose as ProgramPose
    from posedesign.programs.recorded import Level as Level
    from posedesign.programs.recorded import PlanMark as PlanMark
    from posedesign.programs.recorded import Problem as Problem
    from posedesign.programs.recorded import RecordedPosition as RecordedPosition
    from posedesign.programs.recorded import RecordedProgram as RecordedProgram
    from posedesign.programs.recorded import postures_of as postures_of
    from posedesign.programs.registry import DIALECTS as DIALECTS
    from posedesign.programs.registry import find_dialect as find_dialect
    from posedesign.programs.registry import read as read
    from posedesign.programs.registry import validate as validate
    from posedesign.programs.registry import write as write
else:
    __getattr__ = load_when_asked(__name__)
