"""The target of visual touch-up: a circle with a cross in it, on a plate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray
from calib.vision.camera.conic import circle_image
from calib.vision.camera.ellipse import measure_ellipse
from calib.vision.camera.lens import Camera

if TYPE_CHECKING:
    from calib.vision.camera.rendering import GreyImage

SMALLEST_PX = 10.0
"""Short axis of the smallest target that is measured."""


@dataclass(frozen=True)
class CircleTarget:
    """A circle with a cross in its middle, on a rectangular plate.

    The target frame has its origin in the middle of circle and plate, x and y along the sides of
    the plate and along the bars of the cross, and z out of the face.

    Attributes
    ----------
    diameter_m : float
        Of the circle.
    plate_m : tuple of two floats
        Size of the plate along x and y.
    cross_length_m, cross_width_m : float
        Length and width of the two bars of the cross. It ends inside the circle, so the contour of
        the circle is whole; a length of 0 leaves the cross out.
    circle, face : float
        Reflectance (0 black, 1 white) of the circle, and of plate and cross. A light circle with a
        dark cross on a dark plate has ``circle > face``.

    Raises
    ------
    InputError
        A size that is not positive, a cross longer than the circle or one not longer than wide, a
        circle larger than the plate, or two reflectances that are the same or outside 0 to 1.
    """

    diameter_m: float = 0.020
    plate_m: tuple[float, float] = (0.040, 0.040)
    cross_length_m: float = 0.012
    cross_width_m: float = 0.002
    circle: float = 0.08
    face: float = 0.85

    is_known: ClassVar[bool] = False
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0.0 < self.diameter_m < min(self.plate_m):
            self._refuse("diameter_m", "give a positive one that the plate has room for")
        if not 0.0 <= self.cross_length_m < self.diameter_m:
            self._refuse("cross_length_m", "the cross must end inside the circle")
        if self.cross_length_m > 0.0 and not 0.0 < self.cross_width_m < self.cross_length_m:
            self._refuse("cross_width_m", "the bars of a cross are longer than they are wide")
        for name in ("circle", "face"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                self._refuse(name, "reflectances lie between 0 and 1")
        if self.circle == self.face:
            self._refuse("circle", "circle and face must differ in reflectance")

    @property
    def is_dark(self) -> bool:
        """Whether the circle is darker than the plate about it."""
        return self.circle < self.face

    def measure(
        self, image: GreyImage, near_px: FloatArray | None = None
    ) -> tuple[FloatArray, str]:
        """See :meth:`~calib.vision.camera.observers.Target.measure`."""
        found = measure_ellipse(image, dark=self.is_dark, smallest_px=SMALLEST_PX, near_px=near_px)
        if found.is_ok:
            return found.ellipse, ""
        return np.full(5, np.nan), f"{found.status}: {found.message}"

    def image(
        self, camera: Camera, T_camera_target: FloatArray, diameter_m: float | None = None
    ) -> FloatArray:
        """See :meth:`~calib.vision.camera.observers.Target.image`."""
        return circle_image(
            camera, self.diameter_m if diameter_m is None else diameter_m, T_camera_target
        )

    def pose(self, camera: Camera, image: GreyImage, about: FloatArray) -> FloatArray | None:
        """See :meth:`~calib.vision.camera.observers.Target.pose`: by all edges."""
        from calib.vision.camera.target_pose import pose_from_image

        found = [pose_from_image(camera, self, image, T) for T in about]
        good = [pose for pose in found if pose.is_ok]
        return min(good, key=lambda pose: pose.rms_px).T_camera_target if good else None

    def on_plate(self, xy: FloatArray) -> BoolArray:
        """Whether points ``(..., 2)`` [m] of the target's plane lie on the plate ``(...)``."""
        width, height = self.plate_m
        return np.asarray((np.abs(xy[..., 0]) <= width / 2) & (np.abs(xy[..., 1]) <= height / 2))

    def pattern(self, xy: FloatArray) -> FloatArray:
        """Reflectance ``(...)`` at points ``(..., 2)`` [m] of the target's plane; NaN off it."""
        x, y = np.abs(xy[..., 0]), np.abs(xy[..., 1])
        inside = x * x + y * y <= (self.diameter_m / 2) ** 2
        if self.cross_length_m > 0.0:
            half_length, half_width = self.cross_length_m / 2, self.cross_width_m / 2
            longer, shorter = np.maximum(x, y), np.minimum(x, y)
            inside &= (longer > half_length) | (shorter > half_width)
        reflectance = np.where(inside, self.circle, self.face)
        reflectance[~self.on_plate(xy)] = np.nan
        return reflectance

    def plate_corners(self) -> FloatArray:
        """Corners of the plate ``(4, 3)`` [m] in the target frame, in order about z."""
        half = np.array(self.plate_m) / 2
        signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return np.column_stack([signs * half, np.zeros(4)])

    def cross_corners(self) -> FloatArray:
        """Corners of the cross ``(12, 3)`` [m] in the target frame, in order about z.

        ``(0, 3)`` where there is no cross.
        """
        if self.cross_length_m == 0.0:
            return np.empty((0, 3))
        long, short = self.cross_length_m / 2, self.cross_width_m / 2
        arm = np.array([[long, -short], [long, short], [short, short]])
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # row vectors, by 90 degrees about z
        quarters = [arm @ np.linalg.matrix_power(turn, k) for k in range(4)]
        return np.column_stack([np.vstack(quarters), np.zeros(12)])

    def corners(self) -> FloatArray:
        """Corners of cross and plate ``(K, 3)`` [m] in the target frame."""
        return np.vstack([self.cross_corners(), self.plate_corners()])

    def rim(self, count: int) -> FloatArray:
        """Points of the circle ``(count, 3)`` [m] in the target frame, evenly spaced about z."""
        angle = np.arange(count) * (2.0 * np.pi / count)
        circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
        return np.asarray(self.diameter_m / 2 * circle)

    def _refuse(self, name: str, hint: str) -> None:
        raise InputError(
            f"{name} of the target is {getattr(self, name)}",
            hint=hint,
            name=name,
            value=getattr(self, name),
        )
