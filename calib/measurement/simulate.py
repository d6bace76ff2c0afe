"""Simulated touch-ups: the postures at which an arm with errors, and noise, meets its target."""

from __future__ import annotations

import numpy as np

from calib.errors import ConvergenceError
from calib.measurement.data import TouchUps
from calib.measurement.touch import TOUCH_TOLERANCE_M, touch
from calib.model import CalibrationModel
from calib.se3 import FloatArray, IntArray


def simulate_touch_ups(
    truth: CalibrationModel,
    x: FloatArray,
    q: FloatArray,
    rng: np.random.Generator | None = None,
    *,
    trials: int | None = None,
    target: IntArray | None = None,
) -> TouchUps:
    """Touch up planned postures with a robot that has errors.

    Parameters
    ----------
    truth : CalibrationModel
        The robot as it really is: any parameters, and the measurement with its noise.
    x : array (p,)
        True parameters.
    q : array (N, n)
        Planned postures [rad].
    rng : numpy.random.Generator, optional
        Source of the noise; none: measurements without noise.
    trials : int, optional
        Number of Monte Carlo trials; the postures then get a leading dimension.
    target : array (N,), optional
        Index of the target that each posture touches.

    Raises
    ------
    ConvergenceError
        The arm cannot bring its tool point to the target from one of the postures.
    """
    hold = truth.robot.n >= 6  # fewer joints cannot hold an orientation while they touch
    start, _ = touch(truth, q, x, target, hold_orientation=hold)
    displacement: FloatArray | float = 0.0
    if rng is not None:
        R = truth.view(start, x, target)[0].state.R_base_tip
        batch = () if trials is None else (trials,)
        displacement = truth.measurement.sample(np.broadcast_to(R, (*batch, *R.shape)), rng)
    elif trials is not None:
        start = np.broadcast_to(start, (trials, *start.shape))
    postures, missing = touch(truth, start, x, target, displacement, hold_orientation=hold)
    if missing.max(initial=0.0) > 1e3 * TOUCH_TOLERANCE_M:
        pose = int(np.argmax(missing.reshape(-1, missing.shape[-1]).max(axis=0)))
        raise ConvergenceError(
            f"pose {pose + 1}: the simulated arm stays {missing.max() * 1e3:.3g} mm off its target",
            hint="the pose is next to a singularity or out of reach; plan with a larger margin",
            name=f"pose {pose + 1}",
        )
    touched = np.zeros(len(q), dtype=np.intp) if target is None else target
    return TouchUps(postures, touched, truth.labels)
