"""Poses that are kept out of the fit, to test what comes out of it.

They are chosen like the others, from what is left of the pool, by how much they would tell of the
tool point over the task box on top of a little of what the plan tells: what goes wrong there shows
in them.
"""

from __future__ import annotations

import numpy as np

from calib.errors import InputError
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.pools import Pool
from posedesign.selection import Selection, mean_deviation, select

PART_OF_PLAN = 0.01
"""Part of the plan's information that is taken for known. Without any, fewer validation poses than
parameters could not be judged; with all, nothing that they tell would count."""


def choose_validation(
    model: CalibrationModel, pool: Pool, selection: Selection, box: FloatArray, count: int
) -> Pool:
    """Choose poses for validation out of what a selection left.

    Parameters
    ----------
    model : CalibrationModel
    pool : Pool
    selection : Selection
        The poses of the plan.
    box : ndarray (K, 3, p)
        How the tool point moves with the parameters over the task box.
    count : int

    Raises
    ------
    InputError
        Too few poses are left.
    """
    left = np.setdiff1d(np.arange(len(pool)), selection.indices)
    if count > len(left):
        raise InputError(
            f"{count} poses for validation, and {len(left)} are left in the pool",
            hint="ask for fewer, or raise pool.candidates",
            name="validation",
        )
    white = pool.white(model)
    known = np.sqrt(PART_OF_PLAN) * white[selection.indices].reshape(-1, model.p)
    found = select(white[left], count, mean_deviation(box), known=known, starts=1, bound=False)
    return pool.take(left[found.indices])
