"""Whether A and B turn as much as each other, as pairs of A X = Z B must.

The angle of ``A_iᵀ A_j`` is that of ``B_iᵀ B_j`` whatever X and Z are, and whichever side is
inverted. Where it is not, the orientations were read in another convention than they were written
in, or the rows of the two sides are out of step; which of these is often found by trying.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from calib import se3
from calib.se3 import FloatArray, IntArray
from posedesign.pairs_forms import Poses

LARGEST_MISS_RAD = 0.15
"""Median difference between the turns of A and of B [rad] that no noise makes: real pairs of a
poor camera scatter by 0.05."""

CLEARLY_BETTER = 0.25
"""Part of the difference that is left over where another convention is the right one."""

_REFERENCES = 5
"""Pairs, spread over the set, that the others are compared with: one alone may be the wrong one."""

Reading = Callable[[FloatArray], FloatArray]


def _scalar_last(R: FloatArray) -> FloatArray:
    return _rolled(R, 1)


def _scalar_first(R: FloatArray) -> FloatArray:
    return _rolled(R, -1)


def _rolled(R: FloatArray, by: int) -> FloatArray:
    return se3.rotation_from_quaternion(np.roll(se3.quaternion_from_rotation(R), by, axis=-1))


def _moving_axes(R: FloatArray) -> FloatArray:
    """What W, P, R mean about moving axes: Rx(W) Ry(P) Rz(R)."""
    return np.swapaxes(se3.rotation_from_wpr(-se3.wpr_from_rotation(R)), -1, -2)


def _angles_are_vector(R: FloatArray) -> FloatArray:
    return se3.rotation_exp(se3.wpr_from_rotation(R))


def _vector_is_angles(R: FloatArray) -> FloatArray:
    return se3.rotation_from_wpr(se3.rotation_log(R))


_OTHER_READINGS: Mapping[str, tuple[tuple[str, Reading], ...]] = {
    "quaternion": (
        ("if the four columns named qw qx qy qz are x y z w", _scalar_last),
        ("if the four columns named qx qy qz qw are w x y z", _scalar_first),
    ),
    "wpr": (
        ("if the three angles turn about moving axes x, y, z", _moving_axes),
        ("if the three angles are a rotation vector: columns rx, ry, rz", _angles_are_vector),
    ),
    "vector": (("if the rotation vector is W, P, R: columns w, p, r", _vector_is_angles),),
}
"""Mistakes of convention that a form invites, and what the rotations would be without them."""


def turn_notes(a: Poses, b: Poses) -> list[str]:
    """What to say of two sides of N poses each whose turns differ; nothing where they agree."""
    R_A, R_B = a.T[:, :3, :3], b.T[:, :3, :3]
    miss = turn_miss(R_A, R_B)
    if miss < LARGEST_MISS_RAD:
        return []
    said = (
        f"between its poses A turns otherwise than B, by {math.degrees(miss):.3g} deg (median), "
        "where A X = Z B makes their turns equal"
    )
    tried = [(turn_miss(read(R_A), R_B), f"A would agree {what}") for what, read in _others(a)] + [
        (turn_miss(R_A, read(R_B)), f"B would agree {what}") for what, read in _others(b)
    ]
    best, found = min(tried, default=(math.inf, ""))
    if best > CLEARLY_BETTER * miss:
        found = "are the conventions of the orientations right, and the rows in step?"
    return [f"{said}; {found}"]


def turn_miss(R_A: FloatArray, R_B: FloatArray) -> float:
    """Median difference [rad] between the turns of rotations ``(N, 3, 3)``, N pairs."""
    return min(
        float(np.median(np.abs(_turns(R_A, k) - _turns(R_B, k)))) for k in _references(len(R_A))
    )


def _others(poses: Poses) -> tuple[tuple[str, Reading], ...]:
    return _OTHER_READINGS.get(poses.turn.partition("-")[0], ())


def _references(count: int) -> IntArray:
    return np.unique(np.linspace(0, count - 1, _REFERENCES).astype(np.intp))


def _turns(R: FloatArray, k: int) -> FloatArray:
    return se3.rotation_angle(R[k].T @ R)
