"""Where camera and target are, from nothing: the first step of section 2.5 of Watanabe et al. 2006.

From one posture with the target in view the arm is inched around it. Small moves tell how the
camera is turned, how far the target is and how large (:mod:`calib.vision.touch_up.jacobian`). Then
the tip is turned, a little at first, and the target touched up again: postures at which the same
point of the tip frame is on the same point of the base tell where both are, and each tells better
where to turn about for the next, wider turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray, rotation_exp, rotation_log, transform
from calib.vision.camera.observers import Target
from calib.vision.touch_up.servo import Loop, Station
from calib.vision.touch_up.sighting import (
    CIRCLE,
    FIXED,
    NoSetUp,
    Refused,
    SetUp,
    Sighting,
    find_normal,
    posture_at,
    sight,
)

_PRIOR_M = 0.5
"""How far from the tip a camera is mounted at most: holds the first solutions, of small turns."""

_EXPECTED_M = 3e-4
"""What touch-ups of an arm that is not calibrated miss each other by besides, about."""

_OFFSET_RAD = np.deg2rad(0.1)
"""Zero offsets of an arm that is not calibrated, about."""

_STEPS = 2
"""Solutions: the Jacobian of the second is that of the pin tip of the first."""


@dataclass(frozen=True, eq=False)
class Pin:
    """The virtual pin tip and the target that it touches."""

    tool_m: FloatArray  # (3,): pin tip in the tip frame [m]
    target_m: FloatArray  # (3,): in the base frame [m]
    missed_m: FloatArray  # (N, 3): pin tip less target at each touch-up, in base axes
    left_m: float  # rms distance of the touch-ups from each other that zero offsets do not explain
    sigma_tool_m: float
    """Largest standard deviation of the pin tip along any direction, from what is missed."""

    @property
    def rms_m(self) -> float:
        """Distance by which the touch-ups miss each other, three axes together."""
        return float(np.sqrt((self.missed_m**2).sum(axis=1).mean()))


def solve_pin(robot: Robot, q: FloatArray, guess_m: FloatArray) -> Pin:
    """Pin tip and target from postures ``(N, n)`` [rad], all of which touch the target.

    ``R_i p + t_i = m`` by least squares, where the arm is off by zero offsets about
    :data:`_OFFSET_RAD`: they move the tip alike at like postures, which plain least squares takes
    for a longer pin. They are unknowns with that standard deviation; the pin tip is held, weakly,
    to a guess ``(3,)`` [m]. The target is where the pin tip was by the nominal arm, the mean of all
    touch-ups.
    """
    state = robot.state(q)
    count, n = q.shape
    R, t = state.R_base_tip, state.p_base_tip
    tool = np.asarray(guess_m, dtype=float)
    for _ in range(_STEPS):
        turned = state.jacobian(t + R @ tool)[:, :3]
        A = np.zeros((3 * count + 3 + n, 6 + n))
        A[: 3 * count, :3] = R.reshape(-1, 3) / _EXPECTED_M
        A[: 3 * count, 3:6] = np.tile(-np.eye(3), (count, 1)) / _EXPECTED_M
        A[: 3 * count, 6:] = turned.reshape(-1, n) / _EXPECTED_M
        A[3 * count : 3 * count + 3, :3] = np.eye(3) / _PRIOR_M
        A[3 * count + 3 :, 6:] = np.eye(n) / _OFFSET_RAD
        right = np.zeros(len(A))
        right[: 3 * count] = -t.ravel() / _EXPECTED_M
        right[3 * count : 3 * count + 3] = guess_m / _PRIOR_M
        x = np.linalg.lstsq(A, right, rcond=None)[0]
        tool = np.asarray(x[:3])
    points = t + R @ tool
    target = points.mean(axis=0)
    missed = points - target
    covariance = np.linalg.inv(A.T @ A)
    left = (A @ x - right)[: 3 * count]
    square = float((left**2).sum())
    scale = max(float(np.sqrt(square / max(3 * count - 6, 1))), 1.0)
    sigma = scale * float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
    return Pin(tool, target, missed, _EXPECTED_M * float(np.sqrt(square / count)), sigma)


_TURNS = (
    (0.13, ((1, 0, 0), (0, 1, 0))),
    (0.33, ((-1, 0, 0), (0, -1, 0), (0, 0, 1))),
    (1.0, ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))),
    (1.0, ((0, 0, 2), (0, 0, -2), (1, 1, 0), (-1, 1, 0))),
)
"""Turns about the axes of the camera: parts of the widest, which grow as more is known."""

_HALVINGS = 3
"""How often a turn that fails is tried with half its angle."""

_FEWEST = 6
"""Touch-ups below which six numbers are not told from the errors of the arm."""

LARGEST_RMS_M = 5e-3
"""Rms distance by which touch-ups may miss each other. Zero offsets of half a degree stay below;
joint signs that are not the robot's do not."""

LARGEST_LEFT_M = 1e-3
"""What is left of that when zero offsets are taken out: links of another robot, a target that has
moved. Arms with usual errors leave a third of it."""

LARGEST_SIGMA_M = 2e-3
"""Standard deviation of the virtual pin tip above which planning with it makes no sense."""

LARGEST_DRIFT_M = 1e-3
"""How far the first touch-up may be from itself when it is made again at the end: an arm comes back
to a tenth of that, calibrated or not, with the lost motion taken up."""

LARGEST_TURN = np.deg2rad(1.0)
"""How far the axes of the camera may be from themselves when they are told again at the end."""

_COUNT = sum(len(directions) for _, directions in _TURNS)


def find_set_up(
    station: Station,
    q: FloatArray,
    loop: Loop,
    *,
    widest: float = np.deg2rad(15.0),
    size_px: float | None = None,
    target: Target = CIRCLE,
    progress: Callable[[str, float], None] = lambda what, part: None,
) -> SetUp | NoSetUp:
    """Find camera and target from a taught posture ``(n,)`` [rad] with the target in view.

    Parameters
    ----------
    q : array (n,)
    widest : float
        Largest turn about the target [rad]; about the line of sight it is twice that.
    size_px : float, optional
        Size of the target in the designated relation; by default as it is seen at the posture.
    target : Target
        What is looked at; by default a circle of any size.
    progress : callable
        Called with what is being done and the part of the step that is done.
    """
    try:
        progress("finding how the picture moves", 0.0)
        sighting = sight(station, q, loop, size_px, target)
        return _Inching(station, loop, widest, sighting, target).run(progress)
    except Refused as refused:
        return refused.outcome


class _Inching:
    """State of the first step: the touch-ups so far and what follows from them."""

    def __init__(
        self, station: Station, loop: Loop, widest: float, sighting: Sighting, target: Target
    ) -> None:
        self.station, self.loop, self.widest, self.target = station, loop, widest, target
        self.robot = station.drive.robot
        self.jacobian, self.noise_m = sighting.jacobian, sighting.noise_m
        self.step_m = sighting.step_m
        self.postures = [sighting.q]
        self.ellipses = [sighting.ellipse]
        self.notes: list[str] = []

    def run(self, progress: Callable[[str, float], None]) -> SetUp:
        for k, (turn, name) in enumerate(self._turns()):
            progress(f"touch-up {name}", 0.2 + 0.8 * k / _COUNT)
            self._inch(turn, name)
        found = self._solved()
        self._check_drift()
        self._check_turn()
        return found

    def _turns(self) -> Iterator[tuple[FloatArray, str]]:
        """Turns about camera axes as rotation vectors ``(3,)`` [rad], and their names."""
        number = 2
        for part, directions in _TURNS:
            for direction in directions:
                yield self.widest * part * np.array(direction, dtype=float), f"S{number:02d}"
                number += 1

    def _inch(self, turn: FloatArray, name: str) -> None:
        """Turn about the target where it is known to be, and touch up; half of it if that fails."""
        tool = self._pin().tool_m
        about = self.jacobian.R_tip_camera @ turn
        reason = ""
        for halving in range(_HALVINGS):
            R = rotation_exp(about / 2**halving)
            T = self.robot.fk(self.postures[0]) @ transform(R, tool - R @ tool)
            q, reason = posture_at(self.robot, self.postures[0], T)
            if reason:
                continue
            done = self.station.touch_up(f"{name}{'abc'[halving]}", q, self.jacobian, self.loop)
            if done.touched[0]:
                self.postures.append(done.q[0])
                self.ellipses.append(done.ellipses[0])
                return
            reason = done.reasons[0]
        self.notes.append(f"{name}: {reason}")

    def _pin(self) -> Pin:
        guess = self.jacobian.distance_m * self.jacobian.R_tip_camera[:, 2]
        return solve_pin(self.robot, np.array(self.postures), guess)

    def _solved(self) -> SetUp:
        pin = self._pin()
        count = len(self.postures)
        if count < _FEWEST:
            raise Refused(
                f"only {count} touch-ups around the target succeeded: {'; '.join(self.notes)}",
                "choose a posture with more room around the target",
            )
        if pin.rms_m > LARGEST_RMS_M:
            raise Refused(
                f"touch-ups of one target miss each other by {1e3 * pin.rms_m:.0f} mm",
                "check the robot description and its joint signs, and that camera and target are "
                "fixed",
            )
        if pin.left_m > LARGEST_LEFT_M + self.noise_m:
            raise Refused(
                f"touch-ups of one target miss each other by {1e3 * pin.left_m:.1f} mm that no "
                "zero offsets explain",
                "check that the description is of this robot, and that camera and target are fixed",
            )
        if not pin.sigma_tool_m <= LARGEST_SIGMA_M:
            raise Refused(
                "the arm could not turn enough: the virtual pin tip is known to "
                f"{1e3 * pin.sigma_tool_m:.0f} mm only",
                "choose a posture with more room around the target",
            )
        R = self.robot.fk(np.array(self.postures))[:, :3, :3]
        facing = find_normal(self.jacobian, R, np.array(self.ellipses), self.target)
        if facing.flaw:
            raise Refused(facing.flaw, "take a flat, round target, and check the joint signs")
        touched, notes = np.array(self.postures), tuple(self.notes)
        place = pin.tool_m, pin.target_m
        return SetUp(self.jacobian, *place, facing, touched, pin.rms_m, pin.sigma_tool_m, notes)

    def _check_drift(self) -> None:
        """Touch up once more from the first posture: it has to be where it was."""
        done = self.station.touch_up("again", self.postures[0], self.jacobian, self.loop)
        if not done.touched[0]:
            raise Refused(f"the first touch-up could not be made again: {done.reasons[0]}", FIXED)
        first, last = self.robot.fk(np.array([self.postures[0], done.q[0]]))[:, :3, 3]
        drift = float(np.linalg.norm(last - first))
        if drift > LARGEST_DRIFT_M + 2.0 * self.noise_m:
            raise Refused(
                f"the first touch-up made again is {1e3 * drift:.1f} mm from where it was", FIXED
            )

    def _check_turn(self) -> None:
        """Move along the axes of the tip once more: the picture has to move as it did at first.

        A camera that was turned in between still leads the loop to the target.
        """
        made = self.station.jacobian(
            "moves again", self.postures[0], self.jacobian.relation, self.step_m, both_ways=False
        )
        if made.jacobian is None:
            raise Refused(f"the picture could not be followed again: {made.reason}", FIXED)
        turned = rotation_log(self.jacobian.R_tip_camera.T @ made.jacobian.R_tip_camera)
        angle = float(np.linalg.norm(turned))
        if angle > LARGEST_TURN:
            raise Refused(
                f"the camera is turned by {np.rad2deg(angle):.1f} deg against where it was", FIXED
            )
