"""Universal Robots URScript programs."""

from posedesign.programs.ur_script.dialect import UrScript

__all__ = ["UrScript"]
