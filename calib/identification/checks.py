"""What is checked before anything is fitted: that data and model belong together."""

from __future__ import annotations

import numpy as np

from calib.errors import InputError
from calib.identification.covariance import information_root, triangle
from calib.identification.identifiability import check_believable, check_identifiable
from calib.model import CalibrationModel, touch
from calib.model.measurements import Measurements
from calib.se3 import FloatArray


def check_enough(model: CalibrationModel, measurements: Measurements) -> None:
    """Check that measurements and model speak of the same things, with enough equations.

    Raises
    ------
    InputError
    """
    for found, known, what in (
        (measurements.targets, model.targets, "target"),
        (measurements.tools, model.tools, "tool"),
    ):
        if found != known:
            raise InputError(
                f"the measurements name the {what}s {', '.join(found)}, "
                f"the model {', '.join(known)}",
                name=what,
            )
    model.check_setup(measurements.setup, measurements.count)
    kinds = [model.measurements[k] for k in sorted(set(measurements.setup.kind.tolist()))]
    read = [kind.name for kind in kinds if kind.reads]
    if read and measurements.observed is None:
        raise InputError(f"there are no readings of the kind {read[0]}", name="observed")
    if measurements.observed is not None and measurements.observed.shape[-1] != model.rows:
        raise InputError(
            f"readings have {measurements.observed.shape[-1]} columns, the model {model.rows} rows",
            name="observed",
        )
    met = np.array([not kind.reads for kind in model.measurements])[measurements.setup.kind]
    if measurements.observed is not None and measurements.observed[..., met, :].any():
        raise InputError(
            "a touch-up has a reading: what the arm is moved for is met, not read",
            hint="leave the readings of touch-ups, view lines and planes zero",
            name="observed",
        )
    equations = model.equations(measurements.setup)
    known_besides = int(np.isfinite(model.prior).sum()) + len(model.distances)
    if equations + known_besides < model.p:
        rows = equations / max(measurements.count, 1)
        need = int(-(-(model.p - known_besides) // max(rows, 1.0)))
        raise InputError(
            f"{measurements.count} measurements give {equations} equations for {model.p} "
            "parameters",
            hint=f"measure at least {need} poses, better twice as many",
            name="measurements",
            value=equations,
            bound=model.p,
        )


def check_identifiable_at(
    model: CalibrationModel, measurements: Measurements, x: FloatArray
) -> None:
    """Check what measurements can tell, at parameters ``(p,)``.

    Raises
    ------
    NotIdentifiableError
        Parameters that they cannot tell apart, or whose standard deviation says nothing.
    """
    white = triangle(clean_root(model, measurements, x))
    check_identifiable(white, model.names, model.nuisance)
    if any(kind.estimated for kind in model.measurements):
        return  # nobody knows the noise yet: the result is judged by what it turns out to be
    # what the noise alone leaves unknown would wander off before it could be refused
    sigma = np.linalg.norm(np.linalg.inv(white), axis=1)
    check_believable(sigma, model.names, model.units)


def clean_root(model: CalibrationModel, measurements: Measurements, x: FloatArray) -> FloatArray:
    """Rows ``(M, p)`` over their noise of all that is known, with the residuals taken out.

    A residual lends a hidden parameter a false hold: turning the whole arm about its base turns
    every residual with it, so that the Jacobian is not quite singular, though nothing has been
    seen. Postures of a touch-up are therefore first moved, by as little as the residuals, onto
    the target; readings do not enter the Jacobian to begin with.
    """
    setup, q = measurements.setup, measurements.postures
    if not all(kind.reads for kind in model.measurements):
        q, _ = touch(model, q, x, setup, hold_orientation=False)
    return information_root(model.linearise(q, x, setup), x)
