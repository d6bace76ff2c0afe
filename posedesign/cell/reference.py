"""The arm that plans are for: what may be off on it, how much, and how well it is measured.

It is the arm that identification fits: everything that may be off, held by priors. Before measuring
nobody knows the sizes of its errors; they are taken to be those of arms that were measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.identification.prior_arms import PriorArms, UsualSize
from calib.model import CalibrationModel
from posedesign.cell.cell import Cell
from posedesign.cell.models import everything, measuring_model
from posedesign.cell.observations import Observation

USUAL_SIZES = {
    "offsets": UsualSize(0.25, 3.0),
    "lengths": UsualSize(0.5, 1.6),
    "angles": UsualSize(0.3, 1.8),
    "compliance": UsualSize(0.5, 2.0),
    "bearing": UsualSize(0.1, 2.0),
    "lost motion": UsualSize(0.35, 1.8),
    "harmonic": UsualSize(0.35, 1.8),
}
"""Sizes of errors over the priors of a cell, which are wide enough for every arm.

Four arms that others measured (two IRB 120, an R-2000iC, a Panda; identified with tuned priors)
have zero offsets of .06 to 1.3 times the usual prior, lengths of links of .17 to .42, angles of .17
to .71, and compliance of .35 to 2. What they have of bearings, lost motion and harmonics (.05 to 2)
holds what no parameter describes, too: those are what makers of precision reducers state for
transmission error and lost motion, at most an arc minute (.3 mrad)."""

DEVIATION_RAD = 5e-6
"""Deviation of each joint at each pose, one standard deviation: what is left by the repeatability
that makers state, .01 mm for an arm of .6 m and .05 mm for one of 2.6 m (three standard deviations
at the tip)."""


def reference_of(cell: Cell, observations: Sequence[Observation] | None = None) -> PriorArms:
    """The arms that poses of a cell are planned for.

    Everything that may be off, or what ``parameters.planned`` says. Where a camera is calibrated
    nothing of the arm is: camera and target.

    ``observations``: what is measured; all that the cell has by default.
    """
    if cell.is_hand_eye:
        return PriorArms(cell.model())
    seen = cell.observations if observations is None else observations
    if cell.config.parameters.planned is not None:
        return PriorArms(measuring_model(cell, seen))
    model = measuring_model(cell, seen, everything(cell))
    arms = PriorArms.of(model, USUAL_SIZES, DEVIATION_RAD)
    return replace(arms, model=_as_stiff_as_described(arms.model))


def _as_stiff_as_described(model: CalibrationModel) -> CalibrationModel:
    """The model with joints that give way as little as the robot's description says."""
    prior = model.prior.copy()
    for joint, stiffness in zip(model.robot.joint_names, model.robot.stiffness, strict=True):
        name = f"compliance.{joint}"
        if name in model.names and np.isfinite(stiffness):
            k = model.names.index(name)
            prior[k] = min(prior[k], 1.0 / stiffness)
    return model.with_prior(prior)
