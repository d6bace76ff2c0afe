"""What a robot has to do for a calibration: move, say where its joints are, take a picture."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from calib.se3 import FloatArray

if TYPE_CHECKING:
    from calib.vision.camera.rendering import GreyImage


class RobotAdapter(ABC):
    """One robot with a camera on its flange, driven through its controller.

    Joint values are those of the robot description, signs and zeros of the URDF, in radians.
    Nothing else is asked of a robot: the controller's Cartesian moves are not needed, and what the
    arm really does is never known. Every move is checked, before it is commanded and by the joints
    that are shown after it: see :class:`~calib.vision.touch_up.drive.Drive`. An adapter that cannot
    do what it is asked to raises a :class:`~calib.errors.CalibError` that says why; the calibration
    then stops, and goes on from the same place when it is started again.

    Attributes
    ----------
    shows_before_moving : bool
        Whether :meth:`joints` knows where the arm stands before its first move, so that the motion
        from there can be checked.
    """

    shows_before_moving: bool = True

    @abstractmethod
    def move(self, q: FloatArray) -> None:
        """Move the joints to ``(n,)`` [rad], and return when the arm stands still."""

    @abstractmethod
    def joints(self) -> FloatArray:
        """Joint values ``(n,)`` [rad] that the controller shows."""

    @abstractmethod
    def grab(self) -> GreyImage:
        """Picture ``(height, width)`` of 8 bits, taken now, by the camera on the flange."""

    def identity(self) -> str:
        """Name of this one robot, its serial number say; empty where it is not known.

        A calibration that was stopped is gone on with by the same robot only.
        """
        return ""
