"""One arm that measures by name: what a process asks of it, and what can be kept and replayed."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera import Camera, CircleTarget, Views, pose_from_image
from calib.vision.touch_up.drive import Drive
from calib.vision.touch_up.jacobian import (
    ImageJacobian,
    MeasuredJacobian,
    Relation,
    measure_jacobian,
)
from calib.vision.touch_up.servo import Bias, Loop, TouchUps, touch_up

_ONLY = np.zeros(1, dtype=np.intp)


class Station:
    """Measurements of one arm, each under a name of its own.

    A process that asks for the same names in the same order can be run again from what was kept
    under them; a subclass that keeps the answers makes a process that survives being stopped.

    Parameters
    ----------
    drive : Drive
        Of one arm.
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive

    @property
    def image_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self.drive.arms.image_px

    def look(self, name: str, q: FloatArray) -> Views:
        """What is seen at a posture ``(n,)`` [rad]."""
        reason = self.drive.to_posture(_ONLY, q[None])[0]
        if reason:
            return Views(np.full((1, 5), np.nan), (reason,))
        return self.drive.arms.look(_ONLY)

    def jacobian(
        self, name: str, q: FloatArray, relation: Relation, step_m: float, *, both_ways: bool
    ) -> MeasuredJacobian:
        """See :func:`~calib.vision.touch_up.jacobian.measure_jacobian`."""
        return measure_jacobian(self.drive, q, relation, step_m, both_ways=both_ways)

    def touch_up(
        self,
        name: str,
        q: FloatArray,
        jacobian: ImageJacobian,
        loop: Loop,
        bias: Bias | None = None,
    ) -> TouchUps:
        """Touch up from a posture ``(n,)`` [rad]."""
        return touch_up(self.drive, q[None], jacobian, loop, bias)

    def target_pose(
        self, name: str, camera: Camera, target: CircleTarget, about: FloatArray
    ) -> FloatArray | None:
        """Pose of the target ``(4, 4)`` [m] before the camera, where the arm stands.

        By all edges of its pattern. The best of the poses ``(K, 4, 4)`` that it may be about; None
        where there are no pictures, or none of them fits.
        """
        image = self.drive.arms.picture(0)
        if image is None:
            return None
        found = [pose_from_image(camera, target, image, T) for T in about]
        good = [pose for pose in found if pose.is_ok]
        return min(good, key=lambda pose: pose.rms_px).T_camera_target if good else None

    def pass_through(self, name: str, q: FloatArray) -> None:
        """Move to a posture ``(n,)`` [rad] at which nothing is measured."""
        reason = self.drive.to_posture(_ONLY, q[None])[0]
        if reason:
            self.drive.tell(f"{name} was not passed through: {reason}")

    def rest(self) -> None:
        """Nothing more is asked for."""
