"""From a plan to the controller's program, back to touch-ups, and what corrects the robot then."""

from posedesign.pose_programs.correcting import CorrectedProgram as CorrectedProgram
from posedesign.pose_programs.correcting import correct_program as correct_program
from posedesign.pose_programs.from_plan import WrittenProgram as WrittenProgram
from posedesign.pose_programs.from_plan import chosen_dialect as chosen_dialect
from posedesign.pose_programs.from_plan import program_options as program_options
from posedesign.pose_programs.from_plan import write_program as write_program
from posedesign.pose_programs.touch_ups import import_touch_ups as import_touch_ups
