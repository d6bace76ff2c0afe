"""Visual touch-up: the loop of Fig. 4 of Watanabe et al. 2006, over many arms at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray
from calib.vision.camera import Camera, Views
from calib.vision.camera.observers import Target
from calib.vision.touch_up.drive import Drive, shifted
from calib.vision.touch_up.jacobian import (
    ImageJacobian,
    MeasuredJacobian,
    Relation,
    measure_jacobian,
)

Status = Literal["touched", "lost", "no posture", "too far", "not converged"]

_CLEAR_PX = 3.0
"""Error from which on it is told whether the picture follows a move: far above its noise."""

_FOLLOWED = 0.3
"""Least part of the error that a move takes away: a Jacobian that is wrong by half takes half."""


@dataclass(frozen=True)
class Loop:
    """When the loop ends."""

    center_px: float = 0.1
    size_px: float = 0.05
    """center_px, size_px: errors across the picture, and of the size, at or below which the target
    is touched."""
    iterations: int = 10  # moves after which it has not converged
    farthest_m: float = 0.1
    """Distance of the tip from where the loop began beyond which it has run away."""
    looks: int = 1  # pictures whose mean is taken at each stop
    view_line: bool = False
    """Only V and H: the target is brought onto the view line, at any distance (Fig. 1a)."""

    @property
    def within(self) -> str:
        """The thresholds by the names that a cell file has for them."""
        names = ("center_px",) if self.view_line else ("center_px", "size_px")
        return ", ".join(f"{name} = {getattr(self, name):g}" for name in names)

    def __post_init__(self) -> None:
        for name in ("center_px", "size_px", "iterations", "farthest_m", "looks"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(
                    f"{name} of the touch-up is {value}",
                    hint="give a number above zero",
                    name=name,
                    value=value,
                )


@dataclass(frozen=True, eq=False)
class TouchUps:
    """What became of S touch-ups."""

    q: FloatArray  # (S, n): joint values that the controllers showed at the end [rad]
    error_px: FloatArray
    """(S, 3): of the relation, as last measured; NaN where nothing was seen at the end."""
    ellipses: FloatArray  # (S, 5): as last measured [px]
    moves: IntArray  # (S,)
    status: tuple[Status, ...]
    """``touched``, or why not: ``lost``, ``no posture``, ``too far``, ``not converged``."""
    reasons: tuple[str, ...]  # the same in a sentence; empty where it is touched

    @property
    def touched(self) -> BoolArray:
        """Where the target was touched ``(S,)``."""
        return np.array([status == "touched" for status in self.status], dtype=bool)


Bias = Callable[[FloatArray], FloatArray]
"""Of postures ``(K, n)`` [rad], what V, H and s are off at a tilt of the target ``(K, 3)`` [px]."""


def touch_up(
    drive: Drive, q: FloatArray, jacobian: ImageJacobian, loop: Loop, bias: Bias | None = None
) -> TouchUps:
    """Move arms from postures ``(S, n)`` [rad] until each sees its target as designated.

    Look, and where the error is above its threshold shift the tip by what the Jacobian says
    (Eq. 3), the orientation as the controller believes it held. Nothing but pictures and joint
    values of the controller is used. Failures are outcomes: nothing is raised for what a cell may
    do. The paper does without a bias; see :class:`~calib.vision.touch_up.sighting.TiltBias`.
    """
    return _Run(drive, q, jacobian, loop, bias).run()


class _Run:
    """State of a loop: where each arm is, what it saw last, and what became of it."""

    def __init__(
        self, drive: Drive, q: FloatArray, jacobian: ImageJacobian, loop: Loop, bias: Bias | None
    ) -> None:
        count = len(q)
        self.drive, self.jacobian, self.loop, self.bias = drive, jacobian, loop, bias
        self.q = np.array(q, dtype=float)
        self.start = drive.tips(self.q)[:, :3, 3]
        self.error = np.full((count, 3), np.nan)
        self.ellipses = np.full((count, 5), np.nan)
        self.moves = np.zeros(count, dtype=np.intp)
        self.status: list[Status] = ["not converged"] * count
        self.reasons = [""] * count
        self.active = np.arange(count)

    def run(self) -> TouchUps:
        self._ended("no posture", self.active, self.drive.to_posture(self.active, self.q))
        for moves in range(self.loop.iterations + 1):
            self._look(self.active)
            if moves == 0:
                # the picture may be one from before the arm came here, of a touch-up elsewhere
                self._look(self.active[self._is_touched()])
            self._finish()
            if not self.active.size or moves == self.loop.iterations:
                break
            self._shift()
        for k in self.active.tolist():
            dv, dh, ds = np.abs(self.error[k])
            self.reasons[k] = (
                f"after {self.moves[k]} moves the target is still {np.hypot(dv, dh):.2f} px off"
                + f" and {ds:.2f} px too large or small" * (not self.loop.view_line)
                + f"; arm and pictures have to repeat within {self.loop.within}"
            )
        return TouchUps(
            self.drive.arms.joints(np.arange(len(self.q))),
            self.error,
            self.ellipses,
            self.moves,
            tuple(self.status),
            tuple(self.reasons),
        )

    def _ended(self, status: Status, which: IntArray, reasons: list[str]) -> None:
        """Take those of some arms that have a reason out of the loop."""
        if not any(reasons):
            return
        for k, reason in zip(which.tolist(), reasons, strict=True):
            if reason:
                self.status[k], self.reasons[k] = status, reason
        gone = which[[bool(reason) for reason in reasons]]
        self.active = np.setdiff1d(self.active, gone)

    def _look(self, which: IntArray) -> None:
        arms, before = self.drive.arms, self.error[which]
        if not which.size:
            return
        near = np.broadcast_to(self.jacobian.relation.center_px, (len(which), 2))
        views = [arms.look(which, near) for _ in range(self.loop.looks)]
        each = zip(*(view.reasons for view in views), strict=True)
        reasons = [next((reason for reason in said if reason), "") for said in each]
        ellipses = np.asarray(sum(view.ellipses for view in views)) / len(views)
        bias = 0.0 if self.bias is None else self.bias(arms.joints(which))
        error = self.jacobian.relation.error(ellipses, bias)
        self.ellipses[which], self.error[which] = ellipses, error
        axes = 2 if self.loop.view_line else 3
        change = np.linalg.norm((error - before)[:, :axes], axis=1)
        asked = np.linalg.norm(before[:, :axes], axis=1)
        stuck = (asked > _CLEAR_PX) & (change < _FOLLOWED * asked)
        for k in np.flatnonzero(stuck).tolist():
            reasons[k] = reasons[k] or (
                f"the picture followed a move by {change[k]:.1f} of {asked[k]:.1f} px: it is an "
                "old one, or the joints have much lost motion"
            )
        self._ended("lost", which, reasons)

    def _is_touched(self) -> BoolArray:
        """Which of the arms in the loop see the target as designated."""
        error = np.abs(self.error[self.active])
        done = (error[:, :2] <= self.loop.center_px).all(axis=1)
        if not self.loop.view_line:
            done &= error[:, 2] <= self.loop.size_px
        return np.asarray(done)

    def _finish(self) -> None:
        done = self._is_touched()
        for k in self.active[done].tolist():
            self.status[k] = "touched"
        self.active = self.active[~done]

    def _shift(self) -> None:
        which = self.active
        here = self.drive.arms.joints(which)
        shift = self.jacobian.shift(self.error[which], view_line=self.loop.view_line)
        wanted = shifted(self.drive.tips(here), shift)
        away = np.linalg.norm(wanted[:, :3, 3] - self.start[which], axis=1)
        far = [
            f"the loop would move the tip by {1e3 * far:.0f} mm" * (far > self.loop.farthest_m)
            for far in away.tolist()
        ]
        self._ended("too far", which, far)
        near = away <= self.loop.farthest_m
        planned = self.q[self.active]
        reasons = self.drive.to_pose(self.active, here[near], wanted[near], planned)
        self._ended("no posture", self.active, reasons)
        self.moves[self.active] += 1


_ONLY = np.zeros(1, dtype=np.intp)


class Station:
    """Measurements of one arm, each under a name of its own.

    A process that asks for the same names in the same order can be run again from what was kept
    under them; a subclass that keeps the answers makes a process that survives being stopped.
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
        self, name: str, camera: Camera, target: Target, about: FloatArray
    ) -> FloatArray | None:
        """Pose of the target ``(4, 4)`` [m] before the camera, where the arm stands.

        See :meth:`Target.pose`; None where there are no pictures, too.
        """
        image = self.drive.arms.picture(0)
        return None if image is None else target.pose(camera, image, about)

    def pass_through(self, name: str, q: FloatArray) -> None:
        """Move to a posture ``(n,)`` [rad] at which nothing is measured."""
        reason = self.drive.to_posture(_ONLY, q[None])[0]
        if reason:
            self.drive.tell(f"{name} was not passed through: {reason}")

    def rest(self) -> None:
        """Nothing more is asked for."""
