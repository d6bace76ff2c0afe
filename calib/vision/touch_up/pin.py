"""Where a point of the tip and one of the base are, that touch each other in many postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.robots import Robot
from calib.se3 import FloatArray

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
    """The virtual pin tip and the target that it touches.

    Attributes
    ----------
    tool_m : array (3,)
        Pin tip in the tip frame [m].
    target_m : array (3,)
        In the base frame [m].
    missed_m : array (N, 3)
        Pin tip less target at each touch-up, in base axes.
    left_m : float
        Rms distance of the touch-ups from each other that zero offsets do not explain.
    sigma_tool_m : float
        Largest standard deviation of the pin tip along any direction, from what is missed.
    """

    tool_m: FloatArray
    target_m: FloatArray
    missed_m: FloatArray
    left_m: float
    sigma_tool_m: float

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
