"""How accurately a calibrated arm will stand, predicted before anything is measured.

A plan tells the covariance of what it identifies (:func:`calib.identification.covariance_of`).
What an arm will do with it somewhere else follows from how its tool point moves with each
parameter there: ``J C Jᵀ``. It is the accuracy that the noise of the measurement leaves; what the
model does not describe comes on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.arm_view import Setup
from calib.errors import InputError
from calib.model import CalibrationModel
from calib.se3 import BoolArray, FloatArray

AGAINST_TARGETS = (
    "accuracy against the targets, as one frame: where the base stands to them, and what turns "
    "the whole arm (the zero of joint 1), is not part of it"
)
AGAINST_BASE = "accuracy in the frame that the known targets are given in"


def predict_accuracy(
    model: CalibrationModel,
    covariance: ArrayLike,
    q: ArrayLike,
    setup: Setup | None = None,
    *,
    x: ArrayLike | None = None,
) -> FloatArray:
    """Covariance of the position of the tool point in base axes, ``(N, 3, 3)`` [m²].

    Of the parameters of arm and tool; where the targets are is of no account to where the arm
    goes. What targets take up is not free, and counts as known: where they are identified with
    the arm, no measurement tells where the base is to the world, nor the zero of joint 1. The
    base is then that of the arm itself, and the accuracy one against the frame in which all
    targets are found, see :func:`reference_frame`.

    Parameters
    ----------
    model : CalibrationModel
    covariance : array_like (p, p)
        Of all its parameters [SI].
    q : array_like (N, n)
        Postures [rad].
    setup : Setup, optional
        Tool and payload at each; the first of each by default.
    x : array_like (p,), optional
        Parameters to predict at; the nominal ones by default.

    Raises
    ------
    InputError
        A covariance of another shape, or one that is not finite: of parameters that the
        measurements do not identify.
    """
    C = np.asarray(covariance, dtype=float)
    if C.shape != (model.p, model.p):
        raise InputError(
            f"the model has {model.p} parameters, the covariance has shape {C.shape}",
            name="covariance",
        )
    if not np.isfinite(C).all():
        raise InputError(
            "the covariance is not finite: the measurements do not identify all parameters",
            hint="measure other or more poses, or leave parameters out",
            name="covariance",
        )
    kept = moves_the_tool(model)
    motion = model.linearise(np.asarray(q, dtype=float), x, setup).motion[kept, :3]
    J = np.ascontiguousarray(motion.transpose(2, 1, 0))  # (N, 3, parameters)
    return np.asarray(J @ C[np.ix_(kept, kept)] @ np.swapaxes(J, -1, -2))


def moves_the_tool(model: CalibrationModel) -> BoolArray:
    """Which parameters ``(p,)`` are those of arm and tool, not of targets and instruments."""
    blocks = [not b.nuisance or bool(b.tools) for b in model.parameters for _ in b.names]
    return np.array(blocks, dtype=bool)


def reference_frame(model: CalibrationModel) -> str:
    """What a predicted accuracy is one against, in words: the targets as found, or the base."""
    free = any(block.targets and block.size for block in model.parameters)
    return AGAINST_TARGETS if free else AGAINST_BASE
