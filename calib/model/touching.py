"""Moving a model of an arm until its tool point meets the target, as touch-up does."""

from __future__ import annotations

import numpy as np

from calib.model.calibration_model import CalibrationModel
from calib.model.context import Setup
from calib.se3 import FloatArray, rotation_log

TOUCH_TOLERANCE_M = 1e-12
"""How near the simulated loop brings the tool point: the noise is added on purpose, and nothing
else may be left in the data."""

_ITERATIONS = 25
_DAMPING = 1e-12
"""Added to J Jᵀ [m², 1]: keeps postures next to a singularity solvable, below all that matters."""

_LARGEST_STEP_RAD = 0.2


def touch(
    model: CalibrationModel,
    q: FloatArray,
    x: FloatArray,
    setup: Setup | None = None,
    displacement: FloatArray | float = 0.0,
    *,
    hold_orientation: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Move the arm from postures until its tool point meets the target, as touch-up does.

    Newton's method on the joints. The correction is a shift of the arm tip (Eq. 3 and Fig. 4 of
    [Watanabe2006]_): the controller holds the W, P, R that it believes in, of the nominal robot.

    Parameters
    ----------
    model : CalibrationModel
    q : array (..., N, n)
        Postures to start from [rad].
    x : array (..., p)
        True parameters; a leading dimension holds trials.
    setup : Setup, optional
        Tool and target of each posture. Those whose kind is read off an instrument stay.
    displacement : array (..., N, 3)
        Where the tool point stops, seen from the target, in base axes [m].
    hold_orientation : bool
        Hold W, P, R; otherwise take the smallest joint motion.

    Returns
    -------
    q : array (..., N, n)
        Joint values as the controller shows them [rad].
    error : array (..., N)
        Distance still missing [m]; above ``TOUCH_TOLERANCE_M`` where there is no such posture.
    """
    chain = model.robot.chain
    batch = np.broadcast_shapes(q.shape[:-2], x.shape[:-1], np.shape(displacement)[:-2])
    q = np.broadcast_to(q, (*batch, *q.shape[-2:]))
    R_held = chain.forward(q).R_base_tip if hold_orientation else None
    for _ in range(_ITERATIONS):
        J, right = _shift(model, q, x, setup, displacement, R_held)
        if np.abs(right).max(initial=0.0) < TOUCH_TOLERANCE_M:
            break
        Jt = np.swapaxes(J, -1, -2)
        JJt = J @ Jt + _DAMPING * np.eye(J.shape[-2])
        step = (Jt @ np.linalg.solve(JJt, right[..., None]))[..., 0]
        largest = np.abs(step).max(axis=-1, keepdims=True)
        q = q + step * np.minimum(1.0, _LARGEST_STEP_RAD / np.maximum(largest, 1e-300))
    else:
        right = _shift(model, q, x, setup, displacement, R_held)[1]
    return np.asarray(q), np.asarray(np.linalg.norm(right[..., :3], axis=-1))


def _shift(
    model: CalibrationModel,
    q: FloatArray,
    x: FloatArray,
    setup: Setup | None,
    displacement: FloatArray | float,
    R_held: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Equations ``J dq = right`` of one step: the missing way [m], then the turn to undo [rad]."""
    view = model.view(q, x, setup)
    wanted = np.broadcast_to(displacement, (*q.shape[:-1], 3)).reshape(-1, 3).T
    moved = np.empty((model.robot.n, 3, view.q.shape[1]))
    for joint in range(model.robot.n):
        view.turn_about(view.axis(joint), view.walk.origins[joint], moved[joint])
    J = view.posture_first(model.gap(moved, view))
    missing = view.posture_first(model.gap(wanted - view.error, view))
    if R_held is None:
        return J, missing
    nominal = model.robot.chain.forward(q)
    turn = rotation_log(R_held @ np.swapaxes(nominal.R_base_tip, -1, -2))
    J = np.concatenate([J, np.swapaxes(nominal.axes, -1, -2)], axis=-2)
    return J, np.concatenate([missing, turn], axis=-1)
