"""What may be wrong with pairs that do not fit together, in words.

Where the residuals are a good part of the motion, another direction of B or another order of the
pairs is tried in closed form, which takes next to no time: the right one fits far better. Where
none does, a few pairs may contradict all others.

What changes along a sequence of pairs: a target or a camera that was moved, clocks that differ.

X and Z are the same for all pairs, and A and B of a pair are of one moment. Where that is not so,
residuals follow the sequence. Both are tested by scores at the solution, without another fit: a
step of X or Z from some pair on (Andrews, Econometrica 61, 1993), and a delay of B against A, which
leaves residuals along the motion of A. Errors that are alike from pair to pair make such scores by
themselves; what they make is taken out by the correlation that is left once the step is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib import se3
from calib.chance import chi2_tail, f_bound, f_tail
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.algebra import kronecker_mean, unit_diagonal
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.estimate import Estimate, Fit, residuals
from calib.robot_world.identifiability import Motion, examine
from calib.robot_world.methods import robust
from calib.robot_world.methods.maximum_likelihood import estimated_model
from calib.robot_world.noise import Noise, difference, perturb
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


def copies(pairs: PairSets, used: BoolArray) -> tuple[str, ...]:
    """Pairs of one set that are others once more, to the last digit, as a sentence."""
    both = np.concatenate([pairs.A[0], pairs.B[0]], axis=1).reshape(pairs.N, -1)
    _, first, inverse = np.unique(both, axis=0, return_index=True, return_inverse=True)
    again = (first[inverse.reshape(-1)] != np.arange(pairs.N)) & used
    if not again.any():
        return ()
    return (
        f"{named(again)} {'is a copy' if again.sum() == 1 else 'are copies'} of others, which tell "
        "nothing new: standard deviations count them as measured again, and are too small",
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


FEWEST_PAIRS = 12
"""Pairs from which on steps and delays are looked for: with fewer, noise makes some of them."""

FEWEST_FOR_A_DRIFT = 8
"""Pairs from which on, short of those, a steady drift is: three numbers that X and Z do not take
up, of nine to eighteen that are left of the translations."""

_FEWEST_ASIDE = 4
"""Pairs before and after a step: of three, one that is wrong is no step."""

_MOST_SPLITS = 100
"""Places along the sequence at which a step is looked for: where it lies between two of them, all
but half a hundredth of the pairs are on the right side, and long sequences cost no more."""

CHANCE = 1e-4
"""Probability that a steady set is said not to be."""

_LEAST_EXPLAINED = 0.25
"""Part of the squares that a change has to explain before it is named: errors that are alike from
pair to pair look like small ones, and the standard deviations by runs of pairs cover those."""

_MOST_ALIKE = 0.95
"""Correlation from pair to pair that is believed at most."""

_STEP = 1e-4
"""Part of the motion between neighbours by which A is moved to see what a delay does."""

_LEAST_PART = 1e-9

_ROUNDING = 1e-3
"""Residuals over their noise that are rounding: data without noise hold nothing else."""


@dataclass(frozen=True, eq=False)
class _Sequence:
    """White rows ``(n, 6)`` of the pairs used, derivatives ``(n, 6, 12)``, covariance (12, 12)."""

    white: FloatArray
    jacobian: FloatArray
    covariance: FloatArray

    def chance(self, score: float, left: FloatArray, freedom: int, tried: int) -> float:
        """Probability of a score as large, given the rows ``(n, 6)`` that are left without it.

        1 where it leaves most of the squares.
        """
        if float((left**2).sum()) > (1.0 - _LEAST_EXPLAINED) * float((self.white**2).sum()):
            return 1.0
        variance = float((left**2).sum()) / max(left.size - 12 - freedom, 1)
        if variance <= 0.0:
            return 1.0
        neighbours = float((left[1:] * left[:-1]).sum()) / float((left**2).sum())
        alike = float(np.clip(neighbours, 0.0, _MOST_ALIKE))
        size = score / variance * (1.0 - alike) / (1.0 + alike)
        return float(min(float(chi2_tail(size, freedom)) * tried, 1.0))

    def chance_of_few(self, left: FloatArray) -> float:
        """Probability of what three numbers explain of the translations, given the rows left.

        By Fisher's F, of translations alone: a drift of them makes their noise look larger than it
        is, and not that of the rotations. X and Z take up twelve of them at most.
        """
        left, whole = left[:, 3:], self.white[:, 3:]
        square = float((left**2).sum())
        freedom = left.size - 12 - 3
        if square <= 0.0:
            return 1.0
        neighbours = float((left[1:] * left[:-1]).sum()) / square
        alike = float(np.clip(neighbours, 0.0, _MOST_ALIKE))
        ratio = (float((whole**2).sum()) - square) / 3.0 / (square / freedom)
        return f_tail(ratio * (1.0 - alike) / (1.0 + alike), 3, freedom)

    def without(self, rows: FloatArray) -> FloatArray:
        """Rows ``(n, 6, k)`` less what X and Z can explain of them."""
        J = self.jacobian
        return np.asarray(rows - J @ (self.covariance @ np.einsum("iap,iak->pk", J, rows)))


def drifting(
    pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise | None, trial: int = 0
) -> tuple[str, ...]:
    """What changes along the sequence of one set, in sentences; nothing where it is steady.

    Pairs are in the order in which they were measured. Without a noise that they were weighed by it
    is that of B which was found with X and Z; of a method that does not weigh them nothing is said.
    """
    count = int(used.sum())
    if found.fit is None or count < FEWEST_FOR_A_DRIFT:
        return ()
    fit = found.fit
    pairs = PairSets(pairs.A[trial : trial + 1], pairs.B[trial : trial + 1])
    if noise is not None:
        model = noise.model(pairs)
    elif found.sigma is not None:
        model = estimated_model(pairs, found.sigma[:, trial : trial + 1])
    else:
        return ()
    one = _Sequence(*fit.rows(trial, used), fit.covariance[trial])
    if not np.square(one.white).mean() > _ROUNDING**2:
        return ()
    if count < FEWEST_PAIRS:
        changes = _drifts(one)
    else:
        own = fit.of(np.array([trial]))
        changes = [*_steps(one, np.flatnonzero(used)), *_delay(one, pairs, model, own, used)]
    return tuple(text for chance, text in sorted(changes)[:1] if chance < CHANCE)


def _drifts(one: _Sequence) -> list[tuple[float, str]]:
    """A steady shift of X and of Z: probability by chance, and what it is in words."""
    found = []
    count = len(one.white)
    along = np.linspace(-0.5, 0.5, count)[:, None, None]
    for name, part, whose in (
        ("X", slice(3, 6), "camera and the target on the flange"),
        ("Z", slice(9, 12), "target and the camera"),
    ):
        rows = one.without(along * one.jacobian[:, :, part]).reshape(-1, 3)
        way = np.linalg.lstsq(rows, one.white.reshape(-1), rcond=_LEAST_PART)[0]
        explained = (rows @ way).reshape(count, 6)
        chance = min(2.0 * one.chance_of_few(one.white - explained), 1.0)
        found.append(
            (
                chance,
                f"{name} seems to have drifted by {1e3 * np.linalg.norm(way):.2g} mm from the "
                f"first pair to the last: are the {whose} fastened?",
            )
        )
    return found


def _steps(one: _Sequence, rows: IntArray) -> list[tuple[float, str]]:
    """The likeliest step of X and of Z: probability by chance, and what it is in words."""
    found = []
    J, count = one.jacobian, len(one.white)
    information = np.cumsum(np.swapaxes(J, 1, 2) @ J, axis=0)
    scores = np.cumsum((np.swapaxes(J, 1, 2) @ one.white[..., None])[..., 0], axis=0)
    # of the pairs before the split: at the least sum of squares those after it are its opposite
    splits = count - 2 * _FEWEST_ASIDE + 1
    at = np.linspace(0, splits - 1, min(splits, _MOST_SPLITS)).round().astype(np.intp)
    at += _FEWEST_ASIDE - 1
    for name, part in (("X", slice(0, 6)), ("Z", slice(6, 12))):
        S = scores[at, part]
        cross = information[at][:, part]
        inner = information[at][:, part, part]
        V = inner - cross @ one.covariance @ np.swapaxes(cross, 1, 2)
        scaled, size = unit_diagonal(V)
        inverse = np.linalg.pinv(scaled, rcond=_LEAST_PART, hermitian=True)
        step = (inverse @ (S / size)[..., None])[..., 0] / size
        score = (step * S).sum(axis=1)
        best = int(np.argmax(score))
        before = np.arange(count) <= at[best]
        moved = np.where(before[:, None, None], J[:, :, part], 0.0)
        left = one.white - (one.without(moved) @ step[best])
        chance = one.chance(float(score[best]), left, 6, 2 * len(at))
        turn, shift = step[best][:3], step[best][3:]
        found.append(
            (
                chance,
                f"{name} seems to have moved at pair {rows[at[best]] + 2} (counted from 1), by "
                f"{np.degrees(np.linalg.norm(turn)):.2g} deg and "
                f"{1e3 * np.linalg.norm(shift):.2g} mm: was the "
                f"{'camera or the target on the flange' if name == 'X' else 'target or the camera'}"
                " touched? Solve the pairs before and after it apart",
            )
        )
    return found


def _delay(
    one: _Sequence, pairs: PairSets, model: ErrorModel, fit: Fit, used: BoolArray
) -> list[tuple[float, str]]:
    """A delay between A and B: probability by chance, and what it is in words."""
    A = pairs.A[0]
    ahead, behind = np.roll(A, -1, axis=0), np.roll(A, 1, axis=0)
    ahead[-1], behind[0] = A[-1], A[0]
    span = np.full((len(A), 1), 2.0)
    span[[0, -1]] = 1.0
    motion = difference(ahead, behind) / span
    later = PairSets(perturb(A, _STEP * motion)[None], pairs.B)
    rows = [linear_rows(own, model, fit.X, fit.Z)[0][:, 0, used].T for own in (later, pairs)]
    along = ((rows[0] - rows[1]) / _STEP)[..., None]
    along = one.without(along)
    square = float((along**2).sum())
    if square <= 0.0 or not np.isfinite(square):
        return []
    delay = float((along[..., 0] * one.white).sum()) / square
    left = one.white - delay * along[..., 0]
    chance = one.chance(delay**2 * square, left, 1, 1)
    way = "later" if delay > 0 else "earlier"
    return [
        (
            chance,
            f"A seems to be taken {abs(delay):.2g} of a step between neighbours {way} than B: "
            "let the arm stand still for each pair, or bring the two clocks together",
        )
    ]
