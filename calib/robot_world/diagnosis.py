"""What may be wrong with pairs that do not fit together, in words.

Where the residuals are a good part of the motion, another direction of B or another order of the
pairs is tried in closed form, which takes next to no time: the right one fits far better. Where
none does, a few pairs may contradict all others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from calib import se3
from calib.chance import f_bound
from calib.robot_world.algebra import kronecker_mean
from calib.robot_world.estimate import residuals
from calib.robot_world.identifiability import Motion, examine
from calib.robot_world.methods import robust
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray, IntArray

POOR = 0.1
"""Residual, in parts of the motion, from which on the pairs are questioned: a camera that is off by
a tenth of its own motion is none that anyone would calibrate."""

_POOR_OF_FEW = 0.02
"""The same for few pairs, of which those of another order or direction may all but fit."""

_FAR_BETTER = 0.3
"""Residual, in parts of that of the pairs as given, of what is said to be meant."""

_SURELY_BETTER = 0.05
"""The same where the poses turn so little that it may be noise alone."""

_NO_TURN_RAD = float(np.radians(3.0))
"""Rotation between the poses that noise may make up."""

ALIEN = 0.4
"""Residual, in parts of the motion, that pairs have which do not belong together (about 1) and
others have not."""

_AGREEING, _FEWEST_AGREEING = 0.6, 5
"""Part of the pairs that must agree before the others are said to be wrong, and their number: four
agree by chance now and then."""

_STANDS_OUT = 4.0
"""Residual, in medians of all, of a pair that is named: normal errors reach 3 in good sets. In few
pairs one that is wrong lifts the residuals of all, and does not stand out by more."""

_FEW = 6
"""Pairs up to which residuals are too small by chance, now and then, to show the noise."""

_CHANCE = 1e-3
"""Probability of a tilt as large, in residuals, by noise alone, below which it is believed. It is a
bound: the smaller tilt of A and B is taken, of the best axis."""

_Change = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_CHANGES: tuple[tuple[str, _Change], ...] = (
    # A inverted in its place fits as well, with X and Z exchanged
    ("one side inverted: A or B is given from the wrong side", lambda A, B: (A, se3.inverse(B))),
    ("B in reversed order", lambda A, B: (A, B[::-1])),
    ("B one row later: is a row of B missing, or one of A too many?", lambda A, B: (A[1:], B[:-1])),
    (
        "B one row earlier: is a row of A missing, or one of B too many?",
        lambda A, B: (A[:-1], B[1:]),
    ),
)

_FEWEST = 4


def suspicions(pairs: PairSets, used: BoolArray, motion: Motion) -> tuple[str, ...]:
    """What seems to be wrong with the pairs of one set, in sentences; nothing where they fit.

    Of all pairs; the motion is of those used ``(N,)``, which a solution is made from.
    """
    left = float(motion.misfit[0])
    few = pairs.N <= _FEW and not motion.degenerate[0]
    if left <= (_POOR_OF_FEW if few else POOR) and used.all():
        return ()
    whole = motion if used.all() else examine(pairs)
    meant = _meant(pairs, whole)
    if meant or left <= POOR:
        return meant
    degenerate = bool(motion.degenerate[0])
    if degenerate and motion.turned_rad[0] < _NO_TURN_RAD:
        return ()
    named = _contradicting(motion) if used.all() else ()
    if named:
        return named
    if left > ALIEN:
        return (
            f"A and B do not belong together: what is left ({_sizes(motion)}) is of the size of "
            f"the motion itself ({_motion_sizes(motion)}); are the pairs in the same order, and do "
            "all of them look at the same target?",
        )
    if degenerate or pairs.N > _FEW:
        return ()
    return (
        f"what is left ({_sizes(motion)}) is a good part of the motion itself "
        f"({_motion_sizes(motion)}): few pairs in a wrong order fit as well now "
        "and then",
    )


def few_for_the_noise(motion: Motion) -> tuple[str, ...]:
    """Say where a set has so few pairs that noise may pass for a second axis of rotation."""
    N = motion.pairs.N
    if N > _FEW or motion.degenerate[0]:
        return ()
    # residuals of N rotations that six numbers have been fitted to, about three axes
    sigma_rad = float(motion.residual_rad[0]) * np.sqrt(N / (3.0 * N - 6.0))
    enough_rad = _believed(N) * sigma_rad
    if motion.tilt_rad[0] > enough_rad:
        return ()
    tilt_rad = min(_tilt_rad(motion.pairs.A), _tilt_rad(motion.pairs.B))
    if tilt_rad > enough_rad:
        return ()
    return (
        f"{N} pairs hardly show how large the noise is, so that noise may pass for rotation about "
        f"a second axis: what the poses turn about it ({np.degrees(tilt_rad):.2g} deg) should be "
        f"{_believed(N):.0f} times what the residuals show ({np.degrees(sigma_rad):.2g} deg); "
        "measure more",
    )


def standing_out(sizes: Sequence[FloatArray], used: BoolArray) -> BoolArray:
    """Pairs ``(N,)``, of those used, that are far off by any of some measures ``(N,)``."""
    far = np.zeros(len(used), dtype=bool)
    for size in sizes:
        median = np.median(size[used])
        far |= (size > _STANDS_OUT * median) & (median > 0.0)
    return far & used


def outstanding(sizes: Sequence[FloatArray], used: BoolArray) -> tuple[str, ...]:
    """Pairs that are far off, named in one sentence; see :func:`standing_out`."""
    far = standing_out(sizes, used)
    if not far.any():
        return ()
    return (
        f"{named(far)} {'is' if far.sum() == 1 else 'are'} more than {_STANDS_OUT:.0f} times as "
        "far off as the median: the method ml-robust leaves such pairs out",
    )


def copies(again: BoolArray) -> tuple[str, ...]:
    """Pairs ``(N,)`` of one set that are others once more, to the last digit, as a sentence."""
    if not again.any():
        return ()
    return (
        f"{named(again)} {'is a copy' if again.sum() == 1 else 'are copies'} of others, which tell "
        "nothing new: such pairs count once",
    )


def _meant(pairs: PairSets, whole: Motion) -> tuple[str, ...]:
    """A change of all pairs that makes them fit far better, as a sentence."""
    doubtful = whole.turned_rad[0] < _NO_TURN_RAD
    enough = (_SURELY_BETTER if doubtful else _FAR_BETTER) * float(whole.misfit[0])
    for text, change in _CHANGES:
        A, B = change(pairs.A[0], pairs.B[0])
        if len(A) < _FEWEST:
            continue
        other = examine(PairSets(A[None], B[None]))
        if float(other.misfit[0]) < enough:
            return (
                f"the pairs fit far better ({_sizes(other)} in place of {_sizes(whole)}) with "
                f"{text}",
            )
    return ()


def _contradicting(motion: Motion) -> tuple[str, ...]:
    """The pairs of one set that contradict all others, which agree, as a sentence."""
    pairs = motion.pairs
    if pairs.N <= _FEWEST_AGREEING:
        return ()
    found = robust.estimate(pairs)
    if found.weights is None:
        return ()
    agree = found.weights[0] > 0
    count = int(agree.sum())
    if agree.all() or count < max(_FEWEST_AGREEING, _AGREEING * pairs.N):
        return ()
    others = examine(PairSets(pairs.A[:, agree], pairs.B[:, agree]))
    if others.degenerate[0] or float(others.misfit[0]) > _FAR_BETTER * float(motion.misfit[0]):
        return ()
    rows = np.flatnonzero(~agree)
    remedy = "the method ml-robust leaves such pairs out"
    if len(rows) == 2:
        error = residuals(pairs.A[:, rows], pairs.B[:, rows[::-1]], found.X, found.Z)[0]
        turned_rad = np.linalg.norm(error[:, :3], axis=-1).max()
        if turned_rad < _FAR_BETTER * float(motion.residual_rad[0]):
            remedy = f"exchanged with each other they fit; otherwise {remedy}"
    return (
        f"{named(~agree)} {'contradicts' if len(rows) == 1 else 'contradict'} the other {count}, "
        f"which agree to {_sizes(others)}: {remedy}",
    )


def named(chosen: BoolArray) -> str:
    """Pairs as people count them, ten at most."""
    rows: IntArray = np.flatnonzero(chosen)
    text = ", ".join(str(i + 1) for i in rows[:10]) + (", ..." if len(rows) > 10 else "")
    return f"{'pair' if len(rows) == 1 else 'pairs'} {text} (counted from 1)"


def _sizes(motion: Motion) -> str:
    """Residuals of one set in words; that of translation only where it means something."""
    turn = f"{np.degrees(motion.residual_rad[0]):.2g} deg"
    return turn if motion.degenerate[0] else f"{turn}, {1e3 * motion.residual_m[0]:.2g} mm"


def _motion_sizes(motion: Motion) -> str:
    """The motion of one set in words, as its residuals."""
    turn = f"{np.degrees(motion.turned_rad[0]):.2g} deg"
    return turn if motion.degenerate[0] else f"{turn}, {1e3 * float(motion.moved_m[0]):.2g} mm"


@lru_cache(maxsize=_FEW)
def _believed(N: int) -> float:
    """Tilt, in residual rotations per axis, that noise on N pairs hardly ever makes up."""
    return float(np.sqrt(f_bound(_CHANCE, 2 * (N - 2), 3 * N - 6)))


def _tilt_rad(T: FloatArray) -> float:
    """Root mean square angle [rad] by which the common axis of one set tilts, in full."""
    second = float(np.linalg.svd(kronecker_mean(T, T)[0], compute_uv=False)[1])
    return float(np.sqrt(max(2.0 * (1.0 - second), 0.0)))
