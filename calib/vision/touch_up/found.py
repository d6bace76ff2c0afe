"""What the first step of section 2.5 of Watanabe et al. 2006 comes to."""

from __future__ import annotations

from dataclasses import dataclass

from calib.se3 import FloatArray, transform
from calib.vision.touch_up.facing import Facing
from calib.vision.touch_up.jacobian import ImageJacobian


@dataclass(frozen=True, eq=False)
class SetUp:
    """Where camera and target are, roughly, as the nominal arm sees them.

    Attributes
    ----------
    jacobian : ImageJacobian
    tool_m : array (3,)
        Virtual pin tip in the tip frame [m].
    target_m : array (3,)
        In the base frame [m].
    facing : Facing
        How the target's face is turned.
    postures : array (N, n)
        Touched up on the way [rad].
    rms_m : float
        Distance by which the touch-ups miss each other, three axes together.
    sigma_tool_m : float
        Largest standard deviation of the virtual pin tip, from what the touch-ups miss.
    notes : tuple of str
        Turns that could not be made, and why.
    """

    jacobian: ImageJacobian
    tool_m: FloatArray
    target_m: FloatArray
    facing: Facing
    postures: FloatArray
    rms_m: float
    sigma_tool_m: float
    notes: tuple[str, ...]

    @property
    def T_tip_camera(self) -> FloatArray:
        """The camera in the tip frame: the lens, z along the view, x right and y down."""
        R = self.jacobian.R_tip_camera
        return transform(R, self.tool_m - self.jacobian.distance_m * R[:, 2])


@dataclass(frozen=True)
class NoSetUp:
    """Why camera and target were not found.

    Attributes
    ----------
    reason : str
    hint : str
        What to do about it.
    """

    reason: str
    hint: str


class Refused(Exception):
    """Ends the first step from within: its outcome is no error, and callers never see this.

    Parameters
    ----------
    reason, hint : str
        Of the :class:`NoSetUp` that comes of it.
    """

    def __init__(self, reason: str, hint: str) -> None:
        super().__init__(reason)
        self.outcome = NoSetUp(reason, hint)
