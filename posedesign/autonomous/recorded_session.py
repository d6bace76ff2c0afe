"""A station whose measurements are kept in a journal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, get_args
from zlib import crc32

import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera import Camera, CircleTarget, Views
from calib.vision.touch_up import Drive, ImageJacobian, Loop, Relation, Station, TouchUps
from calib.vision.touch_up.jacobian import MeasuredJacobian
from calib.vision.touch_up.servo import Bias, Status
from posedesign.autonomous.journal import Journal

_STATUS: tuple[Status, ...] = get_args(Status)

T = TypeVar("T")

_ONLY = np.zeros(1, dtype=np.intp)


class KeptStation(Station):
    """A station whose measurements are kept in a journal and never made twice.

    Parameters
    ----------
    drive : Drive
    journal : Journal
    seed : int
        Simulated arms draw the noise of each measurement from this and its name, so that a
        calibration comes out the same whether it was stopped or not.
    """

    def __init__(self, drive: Drive, journal: Journal, seed: int = 0) -> None:
        super().__init__(drive)
        self._journal = journal
        self._seed = seed
        self._image_px: tuple[int, int] | None = None
        self._passing: list[tuple[str, FloatArray]] = []
        self._has_moved = False
        self._left: FloatArray | None = None

    @property
    def image_px(self) -> tuple[int, int]:
        """See :attr:`Station.image_px`."""
        return super().image_px if self._image_px is None else self._image_px

    def look(self, name: str, q: FloatArray) -> Views:
        """See :meth:`Station.look`."""

        def measure() -> dict[str, Any]:
            seen = super(KeptStation, self).look(name, q)
            # of an arm that was not moved there is no picture
            size = None if any(seen.reasons) else super(KeptStation, self).image_px
            return {"ellipses": seen.ellipses, "reasons": list(seen.reasons), "image_px": size}

        def read(answer: dict[str, Any]) -> Views:
            if answer["image_px"] is not None:
                width, height = (int(v) for v in answer["image_px"])
                self._image_px = (width, height)
            return Views(_array(answer["ellipses"], (1, 5)), _texts(answer["reasons"]))

        return self._recall(name, q, measure, read)

    def jacobian(
        self, name: str, q: FloatArray, relation: Relation, step_m: float, *, both_ways: bool
    ) -> MeasuredJacobian:
        """See :meth:`Station.jacobian`."""

        def measure() -> dict[str, Any]:
            found = super(KeptStation, self).jacobian(
                name, q, relation, step_m, both_ways=both_ways
            )
            matrix = None if found.jacobian is None else found.jacobian.matrix
            return {"matrix": matrix, "reason": found.reason, "status": found.status}

        def read(answer: dict[str, Any]) -> MeasuredJacobian:
            jacobian = None
            if answer["matrix"] is not None:
                jacobian = ImageJacobian(_numbers(answer["matrix"], (3, 3)), relation)
            return MeasuredJacobian(jacobian, str(answer["reason"]), str(answer["status"]))

        asked = np.array([*q, *relation.center_px, relation.size_px, step_m])
        return self._recall(name, asked, measure, read)

    def touch_up(
        self,
        name: str,
        q: FloatArray,
        jacobian: ImageJacobian,
        loop: Loop,
        bias: Bias | None = None,
    ) -> TouchUps:
        """See :meth:`Station.touch_up`."""

        def measure() -> dict[str, Any]:
            done = super(KeptStation, self).touch_up(name, q, jacobian, loop, bias)
            return {
                "q": done.q,
                "error_px": done.error_px,
                "ellipses": done.ellipses,
                "moves": done.moves,
                "status": list(done.status),
                "reasons": list(done.reasons),
            }

        def read(answer: dict[str, Any]) -> TouchUps:
            (status,) = answer["status"]
            joints = _array(answer["q"], (1, len(q)))
            if status == "touched":
                self._check_joints(joints[0])
            return TouchUps(
                joints,
                _array(answer["error_px"], (1, 3)),
                _array(answer["ellipses"], (1, 5)),
                np.array(answer["moves"], dtype=np.intp),
                (_STATUS[_STATUS.index(status)],),
                _texts(answer["reasons"]),
            )

        return self._recall(name, q, measure, read)

    def target_pose(
        self, name: str, camera: Camera, target: CircleTarget, about: FloatArray
    ) -> FloatArray | None:
        """See :meth:`Station.target_pose`; where the arm stands after what was measured last."""

        def measure() -> dict[str, Any]:
            if not self._has_moved:
                return {"T": None}  # stopped between the touch-up and this: the arm may be anywhere
            return {"T": super(KeptStation, self).target_pose(name, camera, target, about)}

        def read(answer: dict[str, Any]) -> FloatArray | None:
            return None if answer["T"] is None else _numbers(answer["T"], (4, 4))

        return self._journal.recall(name, np.zeros(0), measure, read)

    def pass_through(self, name: str, q: FloatArray) -> None:
        """See :meth:`Station.pass_through`: kept until something is measured after it.

        What lies before a measurement that was made already is not gone through again.
        """
        self._passing.append((name, q))

    def rest(self) -> None:
        """See :meth:`Station.rest`."""
        if self._has_moved:
            self._pass()

    def _pass(self) -> None:
        for name, q in self._passing:
            super().pass_through(name, q)
        self._passing.clear()

    def _recall(
        self,
        name: str,
        asked: FloatArray,
        measure: Callable[[], dict[str, Any]],
        read: Callable[[dict[str, Any]], T],
    ) -> T:
        """A measurement that the arm moves for, if it was not made before."""

        def move_and_measure() -> dict[str, Any]:
            self._prepare(name)
            return measure()

        answer = self._journal.recall(name, asked, move_and_measure, read)
        self._left = answer.q[0] if isinstance(answer, TouchUps) else asked[: self.drive.robot.n]
        self._passing.clear()
        return answer

    def _check_joints(self, q: FloatArray) -> None:
        """Raise a ValueError for joint values ``(n,)`` [rad] that this arm cannot have shown."""
        robot, within = self.drive.robot, self.drive.shown_within_rad
        if not ((q >= robot.lower - within) & (q <= robot.upper + within)).all():
            raise ValueError("outside the joint limits")

    def _prepare(self, name: str) -> None:
        if not self._has_moved and self._left is not None and np.isfinite(self._left).all():
            self.drive.was_left_at(_ONLY, self._left[None])
            stand = getattr(self.drive.arms, "stand", None)
            if stand is not None:
                stand(_ONLY, self._left[None])
        self._has_moved = True
        self._pass()
        reseed = getattr(self.drive.arms, "reseed", None)
        if reseed is not None:
            reseed(np.random.default_rng([self._seed, crc32(name.encode())]))


def _array(value: object, shape: tuple[int, ...]) -> FloatArray:
    """Numbers as an array; what JSON has as null was no number."""
    return np.array(value, dtype=float).reshape(shape)


def _numbers(value: object, shape: tuple[int, ...]) -> FloatArray:
    """The same where all have to be finite."""
    found = _array(value, shape)
    if not np.isfinite(found).all():
        raise ValueError("not a finite number")
    return found


def _texts(value: object) -> tuple[str, ...]:
    return tuple(str(text) for text in np.atleast_1d(np.array(value, dtype=object)))
