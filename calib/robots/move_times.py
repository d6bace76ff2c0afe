"""Times that joint moves take: all joints together, from rest to rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import FloatArray

ACCELERATION_S = 0.3
"""Time in which a joint reaches its speed, or comes to rest from it [s]. Descriptions of robots
give none; arms of 5 to 200 kg payload take 0.1 to 0.5 s. It is taken to be the same at any
programmed speed, as with controllers that filter their commands over a fixed time; who ramps at the
full acceleration is faster than predicted."""


def move_times(moves: ArrayLike, speeds: ArrayLike, acceleration_s: float) -> FloatArray:
    """Times ``(...)`` [s] of moves by ``(..., n)`` [rad], from rest to rest, all joints together.

    Each joint runs up in ``acceleration_s`` to its speed and down again, or turns halfway where it
    does not get there: d/v + t for d > v t, else 2 sqrt(d t/v). The slowest joint sets the time.

    ``moves`` (..., n): joint differences [rad]. ``speeds`` (n,): [rad/s]. ``acceleration_s``: 0:
    the speed is there at once.
    """
    ran = (np.abs(np.asarray(moves, dtype=float)) / np.asarray(speeds)).max(axis=-1)
    short = 2.0 * np.sqrt(ran * acceleration_s)
    return np.asarray(np.where(ran > acceleration_s, ran + acceleration_s, short))


def moving_time_s(path: FloatArray, speeds: ArrayLike, acceleration_s: float) -> float:
    """Time [s] of the moves along postures ``(S, n)`` [rad], stopping at each."""
    return float(move_times(np.diff(path, axis=0), speeds, acceleration_s).sum())
