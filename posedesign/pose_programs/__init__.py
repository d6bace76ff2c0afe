"""From a plan to the controller's program, back to touch-ups, and what corrects the robot then."""

from posedesign.pose_programs.correcting import CorrectedProgram, correct_program
from posedesign.pose_programs.from_plan import (
    WrittenProgram,
    chosen_dialect,
    program_options,
    write_program,
)
from posedesign.pose_programs.touch_ups import import_touch_ups

__all__ = [
    "CorrectedProgram",
    "WrittenProgram",
    "chosen_dialect",
    "correct_program",
    "import_touch_ups",
    "program_options",
    "write_program",
]
