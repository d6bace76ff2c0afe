"""Poses that are kept out of the fit, to test what comes out of it.

They are chosen like the others, from what is left of the pool, by how much they would tell of the
tool point over the task box on top of a little of what the plan tells: what goes wrong there shows
in them.
"""

from __future__ import annotations

import numpy as np

from calib.errors import InputError
from calib.model import CalibrationModel
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import Pool
from posedesign.selection import mean_deviation, select

PART_OF_PLAN = 0.01
"""Part of the plan's information that is taken for known. Without any, fewer validation poses than
parameters could not be judged; with all, nothing that they tell would count."""


def choose_validation(
    model: CalibrationModel, left: Pool, plan: FloatArray, box: FloatArray, count: int
) -> IntArray:
    """Choose poses for validation out of what a plan left.

    Parameters
    ----------
    model : CalibrationModel
    left : Pool
        Candidates that are not in the plan.
    plan : ndarray (N, m, p)
        Whitened Jacobians of the plan.
    box : ndarray (K, 3, p)
        How the tool point moves with the parameters over the task box.
    count : int

    Returns
    -------
    ndarray of int (count,)
        Rows of what is left.

    Raises
    ------
    InputError
        Too few poses are left.
    """
    if count > len(left):
        raise InputError(
            f"{count} poses for validation, and {len(left)} are left in the pool",
            hint="ask for fewer, or raise pool.candidates",
            name="validation",
        )
    known = np.sqrt(PART_OF_PLAN) * plan.reshape(-1, model.p)
    white = left.white(model)
    found = select(white, count, mean_deviation(box), known=known, starts=1, bound=False)
    return found.indices
