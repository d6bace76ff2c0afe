"""Universal Robots URScript programs."""

from posedesign.programs.ur_script.spec import UrScript

__all__ = ["UrScript"]
