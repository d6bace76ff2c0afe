"""Detectors of what changes along the sequence of pairs: a step, a drift, clocks that differ.

X and Z are the same for all pairs, and A and B of a pair are of one moment. Where that is not so,
residuals follow the sequence. Each detector adds columns to the derivatives by X and Z and asks how
much of the squares they explain: a step of X or Z from some pair on (Andrews, Econometrica 61,
1993), a steady drift of either, and a delay of B against A, which leaves residuals along the motion
of A.

The null hypothesis is that the errors of pairs are symmetric about zero and independent, whatever
their sizes are, or that neighbours are alike by one correlation. A cause is named where Fisher's F
and the signs agree: F is large at the level of :mod:`calib.judgement`, and the columns explain more
than with the signs of the errors drawn at random (the wild bootstrap: Liu, Ann. Statist. 16, 1988).
Errors that are alike from pair to pair make such columns by themselves. The correlation that is
left without the columns takes out what they make.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from calib.chance import f_bound, f_tail
from calib.judgement import Finding, level_of_each
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.algebra import inverse_information, unit_diagonal
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.estimate import Fit
from calib.robot_world.noise import difference, perturb
from calib.robot_world.pairs import PairSets
from calib.robot_world.poses import Poses
from calib.se3 import BoolArray, FloatArray, IntArray

DETECTORS = 8
"""Detectors of one command: steps and drifts of X and of Z, the delay, the scale of B, and that of
its depth, from either side."""

LEVEL = level_of_each(DETECTORS)
"""Significance level of each of them."""

UNKNOWN = 0.05
"""Standard deviation of the scale, in parts of it, from which on the pairs do not tell it: the
errors of an arm that looks at one place are alike from pose to pose, and make any such scale."""

FEWEST_PAIRS = 8
"""Pairs from which on drifts are looked for: a drift has three numbers that X and Z do not take up,
of nine to eighteen that are left of the translations."""

FEWEST_FOR_STEPS = 12
"""Pairs from which on steps and delays are looked for."""

_FEWEST_ASIDE = 4
"""Pairs before and after a step: of three, one that is wrong is no step."""

_MOST_SPLITS = 16
"""Steps along the sequence that are tried: a step between two of them has all but a thirtieth of
the pairs on the right side. The place of one that is found is then looked for among as many
between its neighbours."""

_OF_FEW = 0.1
"""Factor of the level of drifts of so few pairs that their signs tell little."""

_DRAWN, _EQUAL = 1999, 1e-9
"""Draws of signs, more than the inverse of the level, and the relative difference of two sums that
is rounding."""

_SCREENED = 100.0
"""Factor of the level at which drifts of many sets are looked at more closely."""

_MOST_ALIKE = 0.95
"""Correlation from pair to pair that is believed at most."""

_DELAY_STEP = 1e-4
"""Part of the motion between neighbours by which A is moved to see what a delay does."""

_LEAST_PART, _TINY = 1e-9, 1e-300

_UNSEEN = 1e-10
"""Part of the columns that X and Z do not take up, below which nothing is left of them."""

_ROUNDING = 1e-3
"""Residuals over their noise that are rounding: data without noise hold nothing else."""

_APART = 10.0
"""Difference of Schwarz's criterion from which on one change is told apart from another: e⁵ in
likelihood."""

_FOUND_IN = 0.9
"""Part of the sets in which a change of the size that is said is found."""

_WHOSE = {
    "X": "camera or the target on the flange",
    "Z": "target or the camera",
}


@dataclass(frozen=True, eq=False)
class Sequence:
    """Pairs of one set that are used, in the order in which they were measured."""

    white: FloatArray  # (n, 6): rows of the pairs in units of their noise
    jacobian: FloatArray  # (n, 6, 12): derivatives by the errors of X and Z
    covariance: FloatArray  # (12, 12): of X and Z
    rows: IntArray  # (n,): where the pairs stand among all
    delayed: Callable[[], FloatArray | None]
    """Makes the derivatives ``(n, 6)`` by a delay of one step between neighbours."""
    poses: Poses | None

    @classmethod
    def of(
        cls,
        fit: Fit,
        trial: int,
        used: BoolArray,
        pairs: PairSets,
        model: ErrorModel,
        poses: Poses | None = None,
    ) -> Sequence:
        """Return the rows of one trial of a fit.

        Parameters
        ----------
        pairs, model : PairSets, ErrorModel
            Pairs of this trial alone, and their errors.
        """
        white, J = fit.rows(trial, used)
        covariance = fit.covariance[trial]
        if poses is not None:
            poses = Poses(poses.member[:, used], poses.share)
            own = _by_pairs(poses.decorrelated, J).reshape(-1, 12)
            covariance = inverse_information((own.T @ own)[None])[0]
        X, Z = fit.X[trial][None], fit.Z[trial][None]
        delayed = partial(_delayed, pairs, model, X, Z, used)
        return cls(white, J, covariance, np.flatnonzero(used), delayed, poses)

    @property
    def is_rounding(self) -> bool:
        """Return True if the residuals are rounding of data without noise."""
        return not bool(np.square(self.white).mean() > _ROUNDING**2)

    @cached_property
    def own(self) -> tuple[FloatArray, FloatArray]:
        """Rows ``(n, 6)`` and derivatives ``(n, 6, 12)`` that are independent."""
        return self._independent(self.white[..., None])[..., 0], self._independent(self.jacobian)

    def _independent(self, rows: FloatArray) -> FloatArray:
        return rows if self.poses is None else _by_pairs(self.poses.decorrelated, rows)

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """Everything that may have changed along the sequence."""
        return tuple(self._changes())

    def _changes(self) -> Iterator[Change]:
        count = len(self.white)
        if count < FEWEST_PAIRS or self.is_rounding:
            return
        ramp = np.linspace(-0.5, 0.5, count)[:, None, None]
        for name, first in (("X", 0), ("Z", 6)):
            own = self.jacobian[:, :, first : first + 6]
            yield Change(self, name, "drift", ramp * own[:, :, 3:])
            if count >= FEWEST_FOR_STEPS:
                yield self.step(name, _FEWEST_ASIDE, count - _FEWEST_ASIDE)
        along = self.delayed() if count >= FEWEST_FOR_STEPS else None
        if along is not None:
            yield Change(self, "A", "delay", along[..., None])

    def step(self, name: str, first: int, last: int) -> Change:
        """Return the likeliest step of X or Z whose first pair is between two pairs."""
        own = self.jacobian[:, :, :6] if name == "X" else self.jacobian[:, :, 6:]
        at = np.unique(np.linspace(first, last, _MOST_SPLITS).round().astype(np.intp))
        after = np.arange(len(own)) >= at[:, None]
        return Change(self, name, "step", np.where(after[..., None, None], own, 0.0), at)

    def told(self, *others: Change) -> tuple[Change, ...]:
        """Return the likeliest change that is told apart from chance, among others, too.

        With it those that the pairs do not tell apart from it, and those that explain more beside
        it.
        """
        every = [*self.changes, *others]
        every = sorted((one for one in every if one.is_told), key=lambda one: one.criterion)
        if not every:
            return ()
        best = every[0]
        alike = [one for one in every if one.criterion < best.criterion + _APART]
        more = [one for one in every if one.kind != best.kind and one.explains_more_than(best)]
        return tuple(one for one in every if one in alike or one in more)


class Change:
    """One way in which pairs may have changed along their sequence.

    Parameters
    ----------
    columns : ndarray (n, 6, k) or (splits, n, 6, k)
        What the change does to the rows of the pairs.
    at : ndarray (splits,), optional
        First pair after each step.
    """

    def __init__(
        self,
        one: Sequence,
        name: str,
        kind: str,
        columns: FloatArray,
        at: IntArray | None = None,
    ) -> None:
        self._one, self._name, self.kind = one, name, kind
        columns = columns.reshape(-1, *columns.shape[-3:])
        self._raw = one._independent(columns)
        white, J = one.own
        rows, J = self._raw.reshape(len(columns), -1, columns.shape[-1]), J.reshape(-1, 12)
        # less what X and Z can explain of them
        self._taken = one.covariance @ (J.T @ rows)
        rows = rows - J @ self._taken
        information = np.swapaxes(rows, 1, 2) @ rows
        self._information = np.einsum("skk->sk", information)
        size = np.sqrt(np.maximum(self._information, _TINY))
        unit = size[:, :, None] * size[:, None, :]
        if columns.shape[-1] == 1:
            self._inverse = 1.0 / unit
        else:
            scaled = np.linalg.pinv(information / unit, rcond=_LEAST_PART, hermitian=True)
            self._inverse = scaled / unit
        total = white.reshape(-1) @ rows
        estimates = (self._inverse @ total[..., None])[..., 0]
        explained = (estimates * total).sum(axis=1)
        self._best = best = int(np.argmax(explained))
        self._explained, self.estimate = float(explained[best]), estimates[best]
        self._left = white - (rows[best] @ self.estimate).reshape(white.shape)
        self._apart, self._at, self._tried = rows, at, len(columns)
        self.columns = columns[best]
        self._rows = slice(3, 6) if kind in ("drift", "scale", "depth") else slice(None)

    @cached_property
    def _alike(self) -> float:
        """Factor of the squares that neighbours which are alike leave to independent ones."""
        left = self._left
        alike = float((left[1:] * left[:-1]).sum()) / max(float((left**2).sum()), _TINY)
        alike = float(np.clip(alike, 0.0, _MOST_ALIKE))
        return (1.0 - alike) / (1.0 + alike)

    @cached_property
    def _rest(self) -> tuple[float, float]:
        """Mean square of what the change leaves, and its degrees of freedom.

        Of a drift and of the scale those of the translations alone: these make their noise look
        larger than it is, and not that of the rotations.
        """
        J = self._one.own[1][:, self._rows]
        J = J.reshape(-1, 12)
        taken = float(((J @ self._one.covariance) * J).sum())
        left = self._left[:, self._rows]
        freedom = max(left.size - taken - self.estimate.size, 1.0)
        return float((left**2).sum()) / freedom, freedom

    @cached_property
    def probability(self) -> float:
        """Probability that errors without any change explain as much."""
        square, rest = self._rest
        k = self.estimate.size
        ratio = self._explained / k / max(square, _TINY)
        return float(min(f_tail(ratio * self._alike, k, rest) * self._tried, 1.0))

    @cached_property
    def beats_signs(self) -> bool:
        """Return True if the change explains more than with any signs that were drawn."""
        white = self._one.own[0]
        if len(white) < FEWEST_FOR_STEPS:
            return self.probability < _OF_FEW * LEVEL
        parts = self._apart.reshape(self._tried, *white.shape, -1)
        scores = (white[:, None] @ parts)[..., 0, :]  # (s, n, k)
        signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(_DRAWN, len(white)))
        drawn = signs @ scores  # (s, draws, k)
        explained = np.einsum("sdk,skl,sdl->sd", drawn, self._inverse, drawn)
        # of few pairs some draw has the signs that there are
        return bool(self._explained >= explained.max() * (1.0 - _EQUAL))

    @property
    def criterion(self) -> float:
        """Schwarz's criterion of the rows, but for what all changes have in common."""
        square = max(float((self._left**2).sum()), _TINY)
        return float(self._left.size * np.log(square)) + self._cost

    @property
    def _cost(self) -> float:
        """Penalty of Schwarz's criterion for the numbers of the change and the steps tried."""
        count = float(np.log(self._left.size))
        return float(self.estimate.size * count + 2.0 * np.log(self._tried))

    @property
    def gain(self) -> float:
        """Fall of Schwarz's criterion by the change, of as many rows as are independent."""
        squares = [max(float((rows**2).sum()), _TINY) for rows in (self._left, self._one.own[0])]
        fall = float(np.log(squares[1] / squares[0]))
        return float(self._alike * self._left.size * fall - self._cost)

    def explains_more_than(self, other: Change) -> bool:
        """Return True if the change is told beside another one."""
        both = np.concatenate([other.columns, self.columns], axis=-1)
        joint = Change(self._one, self._name, self.kind, both)
        more, extra = self.estimate.size, joint._explained - other._explained
        square, rest = joint._rest
        ratio = max(extra, 0.0) / more / max(square, _TINY)
        return bool(f_tail(ratio * joint._alike, more, rest) * self._tried < LEVEL)

    @cached_property
    def is_told(self) -> bool:
        """Return True if the change is told apart from chance.

        A scale that the pairs leave open by a twentieth is none: errors of the arm make any.
        """
        if self.is_of_scale and not self.sigma < UNKNOWN:
            return False
        return self.probability < LEVEL and self.beats_signs

    @property
    def is_seen(self) -> bool:
        """Return True if X and Z do not take up all of the change."""
        own = np.einsum("siak,siak->", self._raw, self._raw)
        return float(self._information.max()) > _UNSEEN * float(own)

    @property
    def sigma(self) -> float:
        """Standard deviation of the estimate of a change that is one number."""
        return float(np.sqrt(self._rest[0] * self._inverse[self._best][0, 0] / self._alike))

    def effect(self, size: float) -> float:
        """Return how far a change of one number moves X and Z, in their standard deviations."""
        sigma = np.sqrt(np.diag(self._one.covariance) * min(self._rest[0], 1.0))
        return float(np.abs(self._taken[self._best] * size / sigma[:, None]).max())

    @cached_property
    def finding(self) -> Finding:
        """The change in words, and by how much it moves X and Z, in deviations without it."""
        # the change makes the noise look larger than it is, and so the deviations by it
        sigma = np.sqrt(np.diag(self._one.covariance) * min(self._rest[0], 1.0))
        moved = self._taken[self._best] @ self.estimate
        effect = float(np.abs(moved / sigma).max())
        if self.kind == "scale":
            return Finding("the translations of B have another scale than those of A", effect)
        if self.kind == "depth":
            return Finding(
                f"{self._name} has the target {-100.0 * float(self.estimate[0]):.2g} ± "
                f"{100.0 * self.sigma:.2g} % too far along the line of sight: check the focal "
                "length and the size of the target",
                effect,
            )
        if self.kind == "delay":
            delay = float(self.estimate[0])
            way = "later" if delay > 0 else "earlier"
            return Finding(
                f"A seems to be taken {abs(delay):.2g} of a step between neighbours {way} than B: "
                "let the arm stand still for each pair, or bring the two clocks together",
                effect,
            )
        first = 0 if self._name == "X" else 6
        if self.kind == "drift":
            own = sigma[first + 3 : first + 6]
            effect = max(effect, 0.5 * float(np.abs(self.estimate / own).max()))
            return Finding(
                f"{self._name} seems to have drifted by {1e3 * np.linalg.norm(self.estimate):.2g} "
                f"mm from the first pair to the last: is the {_WHOSE[self._name]} fastened?",
                effect,
            )
        effect = max(effect, float(np.abs(self.estimate / sigma[first : first + 6]).max()))
        turn, shift = self.estimate[:3], self.estimate[3:]
        at = int(self._one.rows[self._place()]) + 1
        return Finding(
            f"{self._name} seems to have moved at pair {at} (counted from 1), by "
            f"{np.degrees(np.linalg.norm(turn)):.2g} deg and {1e3 * np.linalg.norm(shift):.2g} mm: "
            f"was the {_WHOSE[self._name]} touched? Solve the pairs before and after it apart",
            effect,
        )

    @property
    def smallest(self) -> float:
        """Size of the change that is found in nine of ten sets, in the direction that tells least.

        In metres of the translation, or in steps between neighbours; of a step in the middle of the
        sequence.
        """
        from scipy.special import chndtrinc

        square, rest = self._rest
        k = self.estimate.size
        level = LEVEL if len(self._left) >= FEWEST_FOR_STEPS else _OF_FEW * LEVEL
        bound = k * f_bound(level / self._tried, k, rest) / self._alike
        length = np.sqrt(float(chndtrinc(bound, k, 1.0 - _FOUND_IN)))
        inverse = self._inverse[len(self._inverse) // 2]
        inverse = inverse[-3:, -3:] if k > 1 else inverse
        return float(length * np.sqrt(square * np.linalg.eigvalsh(inverse)[-1]))

    def _place(self) -> int:
        """Return the first pair after the step, among all steps between the neighbours tried."""
        if self._at is None:
            return 0
        first, last = (
            self._at[max(self._best - 1, 0)],
            self._at[min(self._best + 1, self._tried - 1)],
        )
        if last - first <= 2:  # these are all that there are
            return int(self._at[self._best])
        return self._one.step(self._name, int(first), int(last))._place()

    @property
    def label(self) -> str:
        """Kind and transform in a word or two."""
        return f"{self.kind} of {self._name}" if self.kind != "delay" else "delay"

    @property
    def is_of_scale(self) -> bool:
        """Return True if lengths that the camera sees may be wrong."""
        return self.kind in ("scale", "depth")


def _by_pairs(change: Callable[[FloatArray], FloatArray], rows: FloatArray) -> FloatArray:
    """Apply a function of rows ``(..., 6, n)`` to rows ``(..., n, 6, k)``."""
    last = np.moveaxis(rows, -3, -1).swapaxes(-3, -2)  # (..., k, 6, n)
    return np.asarray(np.moveaxis(change(last).swapaxes(-3, -2), -1, -3))


def may_drift(fit: Fit, used: BoolArray) -> BoolArray:
    """Return the trials ``(T,)`` whose drifts are worth a closer look, without a loop over them."""
    white, J = fit.white.transpose(1, 2, 0), fit.jacobian.transpose(2, 3, 1, 0)[:, :, 3:]
    count = used.sum(axis=1)
    ramp = np.linspace(-0.5, 0.5, white.shape[1])[:, None, None]
    square = (white[:, :, 3:] ** 2).sum(axis=(1, 2))
    freedom = np.maximum(3.0 * count - 12.0 - 3.0, 1.0)
    bound = f_bound(min(_SCREENED * LEVEL, 1.0), 3.0, freedom)
    may = np.zeros(len(white), dtype=bool)
    for part in (slice(3, 6), slice(9, 12)):
        columns = ramp * J[..., part]
        taken = np.einsum("tiap,tiak->tpk", J, columns, optimize=True)
        own = np.einsum("tiak,tial->tkl", columns, columns, optimize=True)
        own = own - np.swapaxes(taken, 1, 2) @ fit.covariance @ taken
        scores = np.einsum("tiak,tia->tk", columns, white[:, :, 3:], optimize=True)[..., None]
        unit, size = unit_diagonal(own)
        scores = scores / size[..., None]
        explained = (scores * (np.linalg.pinv(unit, hermitian=True) @ scores)).sum(axis=(1, 2))
        may |= ~(explained * freedom < 3.0 * bound * np.maximum(square - explained, 0.0))
    return np.asarray(may & (count >= FEWEST_PAIRS))


def _delayed(
    pairs: PairSets, model: ErrorModel, X: FloatArray, Z: FloatArray, used: BoolArray
) -> FloatArray | None:
    """Derivatives ``(n, 6)`` of the rows by a delay of A in steps between neighbours."""
    A = pairs.A[0]
    ahead, behind = np.roll(A, -1, axis=0), np.roll(A, 1, axis=0)
    ahead[-1], behind[0] = A[-1], A[0]
    span = np.full((len(A), 1), 2.0)
    span[[0, -1]] = 1.0
    motion = difference(ahead, behind) / span
    later = PairSets(perturb(A, _DELAY_STEP * motion)[None], pairs.B)
    rows = [linear_rows(own, model, X, Z)[0][:, 0, used].T for own in (later, pairs)]
    along = (rows[0] - rows[1]) / _DELAY_STEP
    return along if np.isfinite(along).all() and along.any() else None
