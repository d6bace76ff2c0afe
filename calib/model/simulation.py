"""Simulated measurements: what an arm with errors, and noise, would bring back."""

from __future__ import annotations

import numpy as np

from calib.errors import ConvergenceError
from calib.model.calibration_model import CalibrationModel
from calib.model.context import MeasurementContext, Setup
from calib.model.measurements import Measurements
from calib.model.measurements.kinds import Contact
from calib.robots.inverse.solutions import damped_step
from calib.se3 import FloatArray, rotation_log


def simulate(
    truth: CalibrationModel,
    x: FloatArray,
    q: FloatArray,
    rng: np.random.Generator | None = None,
    *,
    trials: int | None = None,
    setup: Setup | None = None,
) -> Measurements:
    """Measure planned postures with a robot that has errors.

    Kinds that touch move the arm until tool and target meet, and keep its posture; the others
    are read off at the posture as planned.

    Parameters
    ----------
    truth : CalibrationModel
        The robot as it really is: any parameters, and the kinds of measurement with their noise.
    x : array (p,)
        True parameters.
    q : array (N, n)
        Planned postures [rad].
    rng : numpy.random.Generator, optional
        Source of the noise; none: measurements without noise.
    trials : int, optional
        Number of Monte Carlo trials; the postures then get a leading dimension.
    setup : Setup, optional
        Kind, tool, target and payload of each; the first of all by default.

    Raises
    ------
    ConvergenceError
        The arm cannot bring its tool point to the target from one of the postures.
    """
    how = Setup.of(len(q)) if setup is None else setup
    reads = np.array([kind.reads for kind in truth.measurements])[how.kind]
    batch = () if trials is None else (trials,)
    postures: FloatArray = np.broadcast_to(q, (*batch, *q.shape))
    if not reads.all():
        postures = _touched(truth, x, q, rng, batch, how)
    observed = _read(truth, x, postures, rng, how) if reads.any() else None
    return Measurements(postures, how, truth.targets, truth.tools, observed)


def _touched(
    truth: CalibrationModel,
    x: FloatArray,
    q: FloatArray,
    rng: np.random.Generator | None,
    batch: tuple[int, ...],
    setup: Setup,
) -> FloatArray:
    hold = (
        len(truth.robot.arm_joints) >= 6
    )  # fewer joints cannot hold an orientation while they touch
    start, _ = touch(truth, q, x, setup, hold_orientation=hold)
    start = np.broadcast_to(start, (*batch, *start.shape))
    displacement: FloatArray | float = 0.0
    if rng is not None:
        view = truth.view(start, x, setup)
        displacement = view.posture_first(_noise(truth, view, rng, lift=True))
    postures, missing = touch(truth, start, x, setup, displacement, hold_orientation=hold)
    if missing.max(initial=0.0) > 1e3 * TOUCH_TOLERANCE_M:
        pose = int(np.argmax(missing.reshape(-1, missing.shape[-1]).max(axis=0)))
        raise ConvergenceError(
            f"pose {pose + 1}: the simulated arm stays {missing.max() * 1e3:.3g} mm off its target",
            hint="the pose is next to a singularity or out of reach; plan with a larger margin",
            name=f"pose {pose + 1}",
        )
    return postures


def _read(
    truth: CalibrationModel,
    x: FloatArray,
    q: FloatArray,
    rng: np.random.Generator | None,
    setup: Setup,
) -> FloatArray:
    view = truth.view(q, x, setup)
    readings = np.zeros((truth.rows, view.q.shape[1]))
    noise = None if rng is None else _noise(truth, view, rng, lift=False)
    for kind, columns, part in truth.by_kind(view):
        if kind.reads:
            read = kind.predict(part)
            if noise is not None:
                read = kind.disturb(read, noise[: kind.rows, columns])
            readings[: kind.rows, columns] = read
    return view.posture_first(readings)


def _noise(
    truth: CalibrationModel, view: MeasurementContext, rng: np.random.Generator, *, lift: bool
) -> FloatArray:
    """Noise of the kinds that touch as displacements ``(3, S)``, or of the others as rows (m, S).

    Drawn posture by posture, so that the draws of the first trials do not depend on how many
    follow.
    """
    white = np.zeros((truth.rows, view.q.shape[1]))
    own = [each for each in truth.by_kind(view) if isinstance(each[0], Contact) == lift]
    for kind, columns, part in own:
        white[: kind.rows, columns] = rng.standard_normal((part.q.shape[1], kind.rows)).T
    noise = truth.colour_last(white, view)
    out = np.zeros((3 if lift else truth.rows, view.q.shape[1]))
    for kind, columns, part in own:
        rows = noise[: kind.rows, columns]
        if isinstance(kind, Contact):
            out[:, columns] = kind.lift(rows, part)
        else:
            out[: kind.rows, columns] = rows
    return out


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

    Slides that carry the arm stay where they are.

    Newton's method on the joints. The correction is a shift of the arm tip (Eq. 3 and Fig. 4 of
    [Watanabe2006]_): the controller holds the W, P, R that it believes in, of the nominal robot.

    Parameters
    ----------
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
        q = q + damped_step(J, right, _DAMPING, _LARGEST_STEP_RAD)
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
    moved = np.zeros((model.robot.n, 3, view.q.shape[1]))
    for joint in range(model.robot.n_external, model.robot.n):  # external axes stay
        view.move_joint(joint, moved[joint])
    J = view.posture_first(model.gap(moved, view))
    missing = view.posture_first(model.gap(wanted - view.error, view))
    if R_held is None:
        return J, missing
    nominal = model.robot.chain.forward(q)
    turn = rotation_log(R_held @ np.swapaxes(nominal.R_base_tip, -1, -2))
    turning = nominal.jacobian(nominal.p_base_tip)[..., 3:, :]
    turning[..., : model.robot.n_external] = 0.0
    J = np.concatenate([J, turning], axis=-2)
    return J, np.concatenate([missing, turn], axis=-1)
