"""What may be wrong with pairs that do not fit together, in words.

Another direction of A or B, or another order of the pairs, is tried by the rotations alone, in
closed form: it takes next to no time, and the right one fits by far better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from calib import se3
from calib.robot_world.identifiability import Motion, rotation_rms
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray, IntArray

POOR = 0.1
"""Residual rotation, in parts of what the poses turn, from which on the pairs are questioned: a
camera that is off by a tenth of its own motion is none that anyone would calibrate."""

_FAR_BETTER = 0.3
"""Residual rotation, in parts of that of the pairs as given, of what is said to be meant."""

_ALIEN = 0.4
"""Residual rotation, in parts of what the poses turn, that pairs have which do not belong together
(about 1) and others have not."""

_STANDS_OUT = 8.0
"""Residual, in medians of all, of a pair that is named."""

_Change = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_INVERTED: tuple[tuple[str, _Change], ...] = (
    # A inverted in its place fits as well, with X and Z exchanged
    ("one side inverted: A or B is given from the wrong side", lambda A, B: (A, se3.inverse(B))),
)

_REORDERED: tuple[tuple[str, _Change], ...] = (
    ("B in reversed order", lambda A, B: (A, B[::-1])),
    ("B one row later: is a row of B missing, or one of A too many?", lambda A, B: (A[1:], B[:-1])),
    (
        "B one row earlier: is a row of A missing, or one of B too many?",
        lambda A, B: (A[:-1], B[1:]),
    ),
)

_FEWEST = 4


def suspicions(A: FloatArray, B: FloatArray, motion: Motion) -> tuple[str, ...]:
    """What seems to be wrong with pairs ``(N, 4, 4)``, in sentences; nothing where they fit."""
    residual_rad = float(motion.residual_rad[0])
    turned_rad = float(motion.turned_rad[0])
    if residual_rad <= POOR * turned_rad:
        return ()
    found = list(_better(A, B, residual_rad))
    if found:
        return tuple(found)
    if residual_rad > _ALIEN * turned_rad:
        return (
            f"A and B do not belong together: what is left ({np.degrees(residual_rad):.2g} deg) is "
            f"of the size of the motion itself ({np.degrees(turned_rad):.2g} deg); are the pairs "
            "in the same order, and do all of them look at the same target?",
        )
    return ()


def outstanding(residual: FloatArray, used: BoolArray) -> tuple[str, ...]:
    """Pairs whose residuals ``(N, 6)`` are far above the median, named in one sentence."""
    far = np.zeros(len(residual), dtype=bool)
    for part in (residual[:, :3], residual[:, 3:]):
        size = np.linalg.norm(part, axis=-1)
        median = np.median(size[used])
        far |= (size > _STANDS_OUT * median) & (median > 0.0)
    far &= used
    if not far.any():
        return ()
    rows: IntArray = np.flatnonzero(far)
    named = ", ".join(str(i + 1) for i in rows[:10]) + (", ..." if len(rows) > 10 else "")
    return (
        f"{'pair' if len(rows) == 1 else 'pairs'} {named} (counted from 1) "
        f"{'is' if len(rows) == 1 else 'are'} more than {_STANDS_OUT:.0f} times as far off as the "
        "median: the method ml-robust leaves such pairs out",
    )


def _better(A: FloatArray, B: FloatArray, residual_rad: float) -> Iterator[str]:
    """Changes of the pairs that fit far better."""
    for text, change in (*_INVERTED, *_REORDERED):
        other = change(A, B)
        if len(other[0]) < _FEWEST:
            continue
        left_rad = float(rotation_rms(PairSets(other[0][None], other[1][None]))[0])
        if left_rad < _FAR_BETTER * residual_rad:
            yield (
                f"the rotations fit far better ({np.degrees(left_rad):.2g} in place of "
                f"{np.degrees(residual_rad):.2g} deg) with {text}"
            )
            return
