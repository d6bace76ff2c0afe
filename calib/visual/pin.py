"""Where a point of the tip frame and one of the base are, that touch each other in many postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray

_PRIOR_M = 0.5
"""How far from the tip a camera is mounted at most: holds the first solutions, of small turns."""

_EXPECTED_M = 3e-4
"""What touch-ups of an arm that is not calibrated miss each other by, about."""


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
    sigma_tool_m : float
        Largest standard deviation of the pin tip along any direction, from what is missed.
    """

    tool_m: FloatArray
    target_m: FloatArray
    missed_m: FloatArray
    sigma_tool_m: float

    @property
    def rms_m(self) -> float:
        """Distance by which the touch-ups miss each other, three axes together."""
        return float(np.sqrt((self.missed_m**2).sum(axis=1).mean()))


def solve_pin(T_base_tip: FloatArray, guess_m: FloatArray) -> Pin:
    """Pin tip and target from poses ``(N, 4, 4)`` of the tip, all of which touch the target.

    ``R_i p + t_i = m`` by least squares. The pin tip is held, weakly, to a guess ``(3,)`` [m], so
    that there is an answer from the first touch-up on.
    """
    count = len(T_base_tip)
    A = np.zeros((3 * count + 3, 6))
    A[: 3 * count, :3] = T_base_tip[:, :3, :3].reshape(-1, 3)
    A[: 3 * count, 3:] = np.tile(-np.eye(3), (count, 1))
    weight = _EXPECTED_M / _PRIOR_M
    A[3 * count :, :3] = weight * np.eye(3)
    right = np.concatenate([-T_base_tip[:, :3, 3].ravel(), weight * guess_m])
    x = np.linalg.lstsq(A, right, rcond=None)[0]
    missed = (A @ x - right)[: 3 * count].reshape(count, 3)
    spread = T_base_tip[:, :3, :3] - T_base_tip[:, :3, :3].mean(axis=0)
    information = np.einsum("kij,kil->jl", spread, spread) + weight**2 * np.eye(3)
    noise = max(float(np.sqrt((missed**2).sum() / max(3 * count - 6, 1))), _EXPECTED_M)
    sigma = float(noise / np.sqrt(np.linalg.eigvalsh(information)[0]))
    return Pin(x[:3], x[3:], missed, sigma)
