"""Lists of joint values that macros of RoboDK move a robot along (CSV)."""

from posedesign.programs.robodk_csv.dialect import RobodkCsv

__all__ = ["RobodkCsv"]
