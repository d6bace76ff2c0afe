"""How accurately a calibrated arm will stand, predicted before anything is measured.

A plan tells the covariance of what it identifies (:func:`calib.identification.covariance_of`).
What an arm will do with it somewhere else follows from how its tool point moves with each
parameter there: ``J C Jᵀ``. It is the accuracy that the noise of the measurement leaves; what the
model does not describe comes on top.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model import CalibrationModel, Setup
from calib.se3 import BoolArray, FloatArray

TURNED_BASE = (
    "accuracy in the base frame as the targets were found in it: the zero of joint 1, which they "
    "take up, and where the base stands in the world are no part of it"
)
KNOWN_BASE = "accuracy in the frame that the known targets are given in"

Against = Literal["base", "target"]


def predict_accuracy(
    model: CalibrationModel,
    covariance: ArrayLike,
    q: ArrayLike,
    setup: Setup | None = None,
    *,
    x: ArrayLike | None = None,
    against: Against = "base",
) -> FloatArray:
    """Covariance of the position of the tool point in base axes, ``(N, 3, 3)`` [m²].

    Against the base: of the parameters of arm and tool; where the targets are is of no account.
    What the targets take up is not free, and counts as known. Where they are identified with the
    arm nothing tells where the base is in the world, nor the zero of joint 1: the base is then the
    arm's own, turned about joint 1 as the targets were found, see :func:`reference_frame`.

    Against a target: of where the tool point goes as seen from the target as identified. What
    moves both alike does not count; points given by their distance from the target are reached as
    accurately as this.

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
    against : {"base", "target"}
        The target is that of ``setup``.

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
    J = tool_motion(model, q, setup, x=x, against=against)
    return np.asarray(J @ C @ np.swapaxes(J, -1, -2))


def tool_motion(
    model: CalibrationModel,
    q: ArrayLike,
    setup: Setup | None = None,
    *,
    x: ArrayLike | None = None,
    against: Against = "base",
) -> FloatArray:
    """How the tool point moves with the parameters, ``(N, 3, p)`` in base axes [m per unit].

    Zero for parameters that are of no account, see :func:`predict_accuracy`, which takes the same
    arguments. These are the functions of the parameters whose deviations poses are chosen by.
    """
    motion = model.linearise(np.asarray(q, dtype=float), x, setup).motion[:, :3]
    J = np.ascontiguousarray(motion.transpose(2, 1, 0))
    J[:, :, ~_counts(model, against)] = 0.0
    return J


def reference_frame(model: CalibrationModel) -> str:
    """What an accuracy against the base is one against, in words."""
    free = any(block.targets and block.size for block in model.parameters)
    return TURNED_BASE if free else KNOWN_BASE


def _counts(model: CalibrationModel, against: Against) -> BoolArray:
    """Which parameters ``(p,)`` move the tool; not those of targets, nor of instruments."""
    if against not in get_args(Against):
        raise InputError(f"unknown {against!r}", hint='one of "base", "target"', name="against")
    counts = [
        not b.nuisance or bool(b.tools) or (against == "target" and bool(b.targets))
        for b in model.parameters
        for _ in b.names
    ]
    return np.array(counts, dtype=bool)
