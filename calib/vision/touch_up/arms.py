"""What moves and looks: a robot behind its adapter, and many simulated arms at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model import CalibrationModel, Setup
from calib.model.parameters import GravityLoad, Payload
from calib.model.parameters.gravity import NOTHING
from calib.robots import Robot
from calib.robots.one_posture import OnePosture
from calib.se3 import FloatArray, IntArray, inverse
from calib.vision.camera import CircleTarget, ImageObserver, Observer, Views
from calib.vision.camera.observers import Target
from calib.vision.camera.rendering import GreyImage

_LEAST_TORQUE_NM = 1e-6
"""Torque below which gravity pushes to neither side: on a joint with an upright axis it is
rounding, whose sign changes from posture to posture."""


@dataclass(frozen=True, eq=False)
class LostMotion:
    """What joints lose between motor and arm, and how well they stop.

    A joint follows its motor with a lag that lies within a band: after a change of direction the
    motor runs through the band before the joint moves. Friction in the joint winds the reducer up
    by ``friction / stiffness`` on either side. Backlash widens the band by half its width on either
    side where friction holds the joint, and where gravity is stronger it lays the joint against the
    side that gravity pushes to.
    """

    backlash_rad: FloatArray  # (n,): whole width of the play
    friction_nm: FloatArray  # (n,)
    stiffness_nm_per_rad: FloatArray  # (n,)
    scatter_rad: FloatArray
    """(n,): standard deviation of where a joint stops, each time it was moved."""

    @classmethod
    def of(
        cls,
        n: int,
        backlash_rad: ArrayLike = 0.0,
        friction_nm: ArrayLike = 0.0,
        stiffness_nm_per_rad: ArrayLike = np.inf,
        scatter_rad: ArrayLike = 0.0,
    ) -> LostMotion:
        """Of n joints, from one number for all or one for each."""
        given = (backlash_rad, friction_nm, stiffness_nm_per_rad, scatter_rad)
        try:
            spread = [np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in given]
        except ValueError as error:
            raise InputError(
                f"lost motion needs one number for all or one for each of {n} joints",
                name="lost motion",
            ) from error
        if any((np.isnan(v) | (v < 0.0)).any() for v in spread):
            raise InputError("lost motion is zero or more", name="lost motion")
        return cls(*spread)

    @property
    def has_backlash(self) -> bool:
        """Whether any joint has backlash."""
        return bool(self.backlash_rad.any())

    def band(self, torque_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and largest lag ``(..., n)`` [rad] of joints under gravity ``(..., n)`` [Nm]."""
        wind_up = self.friction_nm / self.stiffness_nm_per_rad
        leans = np.abs(torque_nm) > np.maximum(self.friction_nm, _LEAST_TORQUE_NM)
        middle = np.where(leans, np.sign(torque_nm) * self.backlash_rad / 2.0, 0.0)
        half = wind_up + np.where(leans, 0.0, self.backlash_rad / 2.0)
        return middle - half, middle + half


@dataclass(frozen=True, eq=False)
class TrueCell:
    """How the cell really is."""

    model: CalibrationModel  # the arm with all its errors
    values: FloatArray  # (p,): of its parameters [SI]
    T_tip_camera: FloatArray  # (4, 4)
    T_base_target: FloatArray  # (4, 4) or (S, 4, 4): one for all arms, or one for each
    lost_motion: LostMotion
    payload: Payload | None = None  # whose weight lays joints to a side
    vibration_m: float = 0.0
    """Standard deviation of where the lens is along each axis while a picture is taken."""

    @property
    def robot(self) -> Robot:
        """As its controller knows it."""
        return self.model.robot


class SimulatedArms:
    """Arms of one true cell side by side, each at a posture of its own.

    Parameters
    ----------
    observer : Observer
        Of its camera and target: through images, or without.
    q : array (n,), optional
        Where all arms stand at first [rad]; the middle of the limits by default.
    """

    def __init__(
        self,
        cell: TrueCell,
        observer: Observer,
        count: int,
        rng: np.random.Generator,
        q: FloatArray | None = None,
    ) -> None:
        robot = cell.robot
        start = (robot.lower + robot.upper) / 2.0 if q is None else np.asarray(q, dtype=float)
        self._cell = cell
        self._observer = observer
        self._rng = rng
        self._count = count
        self._motors = np.tile(start, (count, 1))
        self._lag = np.zeros((count, robot.n))
        self._stopped = np.zeros((count, robot.n))
        self._gravity = GravityLoad(robot, cell.payload)
        carried = cell.payload or NOTHING
        self._one = OnePosture(robot, carried.mass_kg, carried.com_m)
        self.pictures = 0
        self.seen: GreyImage | None = None

    @property
    def count(self) -> int:
        return self._count

    @property
    def image_px(self) -> tuple[int, int]:
        return self._observer.camera.width_px, self._observer.camera.height_px

    def move(self, which: IntArray, q: FloatArray) -> None:
        lost = self._cell.lost_motion
        torque = np.zeros_like(q)
        if lost.has_backlash and len(q) == 1:
            torque = self._one.gravity_torque(q[0])[None]
        elif lost.has_backlash:
            last = np.ascontiguousarray(q.T)
            torque = self._gravity.joint_torque(last, Setup.of(len(q))).T
        least, most = lost.band(torque)
        dragged = self._motors[which] + self._lag[which] - q
        self._lag[which] = np.clip(dragged, least, most)
        self._motors[which] = q
        self._stopped[which] = lost.scatter_rad * self._rng.standard_normal(q.shape)

    def joints(self, which: IntArray) -> FloatArray:
        return self._motors[which].copy()

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        self.pictures += len(which)
        T, observer = self.T_camera_target(which), self._observer
        if len(which) > 1 or not isinstance(observer, ImageObserver):
            return observer.views(T, self._rng, near_px)
        self.seen = observer.grab(T[0], self._rng)
        near = None if near_px is None else near_px[0]
        return Views.of([observer.target.measure(self.seen, near)])

    def picture(self, arm: int) -> GreyImage | None:
        if not isinstance(self._observer, ImageObserver):
            return None
        T = self.T_camera_target(np.array([arm]))[0]
        return self._observer.grab(T, self._rng)

    def stand(self, which: IntArray, q: FloatArray) -> None:
        """Stand where an earlier rehearsal has left the arms ``(K, n)`` [rad]."""
        self._motors[which] = q

    def reseed(self, rng: np.random.Generator) -> None:
        """Take all noise from another generator from now on."""
        self._rng = rng

    def T_camera_target(self, which: IntArray) -> FloatArray:
        """Where targets really are before the lens, the vibration of this moment in it."""
        cell = self._cell
        q = self._motors[which] + self._lag[which] + self._stopped[which]
        T_base_camera = cell.model.tip_poses(q, cell.values) @ cell.T_tip_camera
        own = cell.T_base_target if cell.T_base_target.ndim == 2 else cell.T_base_target[which]
        T = inverse(T_base_camera) @ own
        if cell.vibration_m > 0.0:
            T[:, :3, 3] += cell.vibration_m * self._rng.standard_normal((len(which), 3))
        return np.asarray(T)


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

    @property
    def image_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""

    def move(self, which: IntArray, q: FloatArray) -> None:
        """Move the joints of arms ``(K,)`` to ``(K, n)`` [rad]; they stand still afterwards."""

    def joints(self, which: IntArray) -> FloatArray:
        """Joint values ``(K, n)`` [rad] that their controllers show; NaN where that is nothing."""

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        """What each of their cameras sees of the target, near ``(K, 2)`` [px] if given."""

    def picture(self, arm: int) -> GreyImage | None:
        """A picture from where an arm stands; None where there are no pictures."""


class OneArm:
    """A robot behind its adapter, as a row of one.

    Parameters
    ----------
    target : Target
        What is looked at; by default a dark circle of any size.
    """

    count = 1

    def __init__(self, robot: RobotAdapter, target: Target | None = None) -> None:
        self._robot = robot
        self._target: Target = CircleTarget() if target is None else target
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
        self._last = None
        for posture in q:
            self._moved = True
            self._robot.move(posture.copy())

    def joints(self, which: IntArray) -> FloatArray:
        if not (self._moved or self._robot.shows_before_moving):
            return np.full((len(which), 1), np.nan)
        return np.array([self._shown() for _ in which])

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        seen = []
        for k in range(len(which)):
            image = self._grabbed()
            self._size, self._last = (image.shape[1], image.shape[0]), image
            near = None if near_px is None else near_px[k]
            ellipse, reason = self._target.measure(image, near)
            if not reason and self._is_old(image):
                ellipse = np.full(5, np.nan)
                reason = "no target: the camera repeats a picture from before the arm moved"
            seen.append((ellipse, reason))
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

    @property
    def seen(self) -> GreyImage | None:
        """The last picture that was looked at, if the arm has not moved since."""
        return self._last

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
