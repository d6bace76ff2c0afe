"""Numbers that count turns of joints, and joints that stand where one number becomes the next.

The commonest joint values of all, 0 and 180 deg, are where one maker or another goes from one
number to the next. A pose in a program is rounded, and the joint that was at 0 comes out of the
inverse kinematics at -0.001 deg; what is meant is the same arm position. So the number on the other
side of a boundary nearby is kept, and :func:`agree` takes either. Answers of the inverse
kinematics in the same arm position differ by whole turns: they cannot be mistaken for each other
but within the same distance of a boundary of turns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calib.se3 import FloatArray, IntArray

ROUNDING_DEG = 0.02
"""Joint value that the rounding of a pose may turn into another [deg]: programs have angles to
0.005 deg (old Yaskawa jobs) and lengths to 0.005 mm at worst, and a joint turns by some times the
angle where the wrist is not straight."""


EXACT_DEG = 1e-6
"""Distance from a boundary [deg] that counts as on it: what radians and back leave is 1e-13."""


def beside(rule: Callable[[FloatArray], IntArray], angles_deg: FloatArray) -> IntArray:
    """The numbers of angles on the other side of a boundary, where there is one nearby.

    Parameters
    ----------
    rule : function
        Numbers of angles [deg], element by element.
    angles_deg : array

    Returns
    -------
    array of int
        Of the shape of ``angles_deg``; the numbers of the angles themselves elsewhere.
    """
    here, below = rule(angles_deg), rule(angles_deg - ROUNDING_DEG)
    return np.where(below != here, below, rule(angles_deg + ROUNDING_DEG))


def agree(
    a: Sequence[int], a_beside: Sequence[int], b: Sequence[int], b_beside: Sequence[int]
) -> bool:
    """Whether two lists of numbers can be the same; empty where there is nothing beside them."""
    sides = zip(a, a_beside or a, b, b_beside or b, strict=True)
    return all({w, x} & {y, z} for w, x, y, z in sides)
