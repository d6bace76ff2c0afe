"""Simulated measurements: what an arm with errors, and noise, would bring back."""

from __future__ import annotations

import numpy as np

from calib.errors import ConvergenceError
from calib.model.calibration_model import CalibrationModel
from calib.model.context import MeasurementContext, Setup
from calib.model.measurements import Measurements
from calib.model.measurements.base import Contact
from calib.model.touching import TOUCH_TOLERANCE_M, touch
from calib.se3 import FloatArray


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
    hold = truth.robot.n >= 6  # fewer joints cannot hold an orientation while they touch
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
    out = np.zeros((3 if lift else truth.rows, view.q.shape[1]))
    for kind, columns, part in truth.by_kind(view):
        if isinstance(kind, Contact) != lift:
            continue
        rows = kind.colour(rng.standard_normal((part.q.shape[1], kind.rows)).T, part)
        if isinstance(kind, Contact):
            out[:, columns] = kind.lift(rows, part)
        else:
            out[: kind.rows, columns] = rows
    return out
