"""What the loop of visual touch-up drives: arms with a camera, one real one or many simulated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray
from calib.vision.camera import EllipseMeasurement, Views, measure_ellipse
from calib.vision.camera.observers import SMALLEST_PX
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


_MOVED_RAD = 1e-4
"""Turn of a joint that a picture shows: a tenth of a millimetre at a metre."""


class Arms(Protocol):
    """Arms that stand side by side and know nothing of each other.

    A loop over arrays drives them all at once: a rehearsal of a thousand touch-ups takes little
    more than that of one. A real robot is a row of one, :class:`OneArm`.
    """

    @property
    def count(self) -> int:
        """Number of arms S."""
        ...

    @property
    def image_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        ...

    def move(self, which: IntArray, q: FloatArray) -> None:
        """Move the joints of arms ``(K,)`` to ``(K, n)`` [rad]; they stand still afterwards."""
        ...

    def joints(self, which: IntArray) -> FloatArray:
        """Joint values ``(K, n)`` [rad] that their controllers show; NaN where that is nothing."""
        ...

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        """What each of their cameras sees of the target, near ``(K, 2)`` [px] if given."""
        ...

    def picture(self, arm: int) -> GreyImage | None:
        """A picture from where an arm stands; None where there are no pictures."""
        ...


class OneArm:
    """A robot behind its adapter, as a row of one.

    Parameters
    ----------
    robot : RobotAdapter
    dark : bool
        Whether the target's circle is darker than the plate about it.
    """

    count = 1

    def __init__(self, robot: RobotAdapter, *, dark: bool = True) -> None:
        self._robot = robot
        self._dark = dark
        self._size: tuple[int, int] | None = None
        self._moved = False
        self._last: GreyImage | None = None
        self._before: tuple[FloatArray, GreyImage] | None = None

    @property
    def image_px(self) -> tuple[int, int]:
        """See :meth:`Arms.image_px`; takes a picture where none was taken yet."""
        if self._size is None:
            height, width = self._grabbed().shape
            self._size = (width, height)
        return self._size

    def move(self, which: IntArray, q: FloatArray) -> None:
        """See :meth:`Arms.move`."""
        self._last = None
        for posture in q:
            self._moved = True
            self._robot.move(posture.copy())

    def joints(self, which: IntArray) -> FloatArray:
        """See :meth:`Arms.joints`."""
        if not (self._moved or self._robot.shows_before_moving):
            return np.full((len(which), 1), np.nan)
        return np.array([self._shown() for _ in which])

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        """See :meth:`Arms.look`."""
        seen = []
        for k in range(len(which)):
            image = self._grabbed()
            self._size, self._last = (image.shape[1], image.shape[0]), image
            near = None if near_px is None else near_px[k]
            found = measure_ellipse(image, dark=self._dark, smallest_px=SMALLEST_PX, near_px=near)
            if found.is_ok and self._is_old(image):
                found = EllipseMeasurement.failed(
                    "no target", "the camera repeats a picture from before the arm moved"
                )
            seen.append(found)
        return Views.of(seen)

    def _is_old(self, image: GreyImage) -> bool:
        """Whether a picture is that of another posture, to the last bit: noise never is."""
        joints = self._shown()
        old = (
            self._before is not None
            and np.abs(joints - self._before[0]).max() > _MOVED_RAD
            and np.array_equal(image, self._before[1])
        )
        if not old:
            self._before = joints, image
        return old

    def picture(self, arm: int) -> GreyImage | None:
        """See :meth:`Arms.picture`: the last that was looked at, if the arm has not moved since."""
        return self._grabbed() if self._last is None else self._last

    def _grabbed(self) -> GreyImage:
        """A picture that is one: adapters are written by others."""
        image = self._robot.grab()
        if not (isinstance(image, np.ndarray) and image.ndim == 2 and image.dtype == np.uint8):
            raise InputError(
                f"grab() of the robot's adapter gave {_described(image)}",
                hint="give a grey picture: an array (height, width) of uint8",
                name="grab",
            )
        return image

    def _shown(self) -> FloatArray:
        """Joint values that are finite numbers."""
        given = self._robot.joints()
        try:
            joints = np.array(given, dtype=float)
        except (TypeError, ValueError, OverflowError):
            joints = np.empty(0)
        if joints.ndim != 1 or not joints.size or not np.isfinite(joints).all():
            raise InputError(
                f"joints() of the robot's adapter gave {_described(given)}",
                hint="give an array (n,) of finite joint values [rad]",
                name="joints",
            )
        return joints


def _described(given: object) -> str:
    """An answer in short: what kind of thing it is."""
    if isinstance(given, np.ndarray):
        return f"an array {given.shape} of {given.dtype}"
    return "nothing" if given is None else f"a {type(given).__name__}"
