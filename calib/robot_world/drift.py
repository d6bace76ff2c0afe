"""What changes along a sequence of pairs: a target or a camera that was moved, clocks that differ.

X and Z are the same for all pairs, and A and B of a pair are of one moment. Where that is not so,
residuals follow the sequence. Both are tested by scores at the solution, without another fit: a
step of X or Z from some pair on (Andrews, Econometrica 61, 1993), and a delay of B against A, which
leaves residuals along the motion of A. Errors that are alike from pair to pair make such scores by
themselves; what they make is taken out by the correlation that is left once the step is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from calib.robot_world.adjustment import linear_rows
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.fit import Fit
from calib.robot_world.methods.maximum_likelihood import estimated_model
from calib.robot_world.noise import Noise, difference, perturb
from calib.robot_world.pairs import PairSets
from calib.robot_world.results import Estimate
from calib.se3 import BoolArray, FloatArray, IntArray

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
        return float(min(chi2.sf(size, freedom) * tried, 1.0))

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
        return float(f_distribution.sf(ratio * (1.0 - alike) / (1.0 + alike), 3, freedom))

    def without(self, rows: FloatArray) -> FloatArray:
        """Rows ``(n, 6, k)`` less what X and Z can explain of them."""
        J = self.jacobian
        return np.asarray(rows - J @ (self.covariance @ np.einsum("iap,iak->pk", J, rows)))


def drifting(
    pairs: PairSets, found: Estimate, used: BoolArray, noise: Noise | None, trial: int = 0
) -> tuple[str, ...]:
    """What changes along the sequence of one set, in sentences; nothing where it is steady.

    Parameters
    ----------
    pairs : PairSets
        All pairs, in the order in which they were measured.
    found : Estimate
        The likeliest X and Z; of a method that does not weigh the pairs nothing is said.
    used : ndarray of bool (N,)
        Pairs that they are from.
    noise : PairNoise or PairCovariances, optional
        That they were weighed by; else it is that of B which they have been found with.
    trial : int
        Which of many sets.
    """
    count = int(used.sum())
    if found.fit is None or count < FEWEST_FOR_A_DRIFT:
        return ()
    fit = found.fit.of(np.array([trial]))
    pairs = PairSets(pairs.A[trial : trial + 1], pairs.B[trial : trial + 1])
    if noise is not None:
        model = noise.model(pairs)
    elif found.sigma is not None:
        model = estimated_model(pairs, found.sigma[:, trial : trial + 1])
    else:
        return ()
    one = _Sequence(
        fit.white[:, 0, used].T, fit.jacobian[:, :, 0, used].transpose(2, 1, 0), fit.covariance[0]
    )
    if not np.square(one.white).mean() > _ROUNDING**2:
        return ()
    if count < FEWEST_PAIRS:
        changes = _drifts(one)
    else:
        changes = [*_steps(one, np.flatnonzero(used)), *_delay(one, pairs, model, fit, used)]
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
        size = np.sqrt(np.maximum(np.diagonal(V, axis1=1, axis2=2), np.finfo(float).tiny))
        inverse = np.linalg.pinv(
            V / (size[:, :, None] * size[:, None]), rcond=_LEAST_PART, hermitian=True
        )
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
