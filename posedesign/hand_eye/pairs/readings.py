"""Readings of poses under which A X = Z B fits, where it does not as they were read.

Angles of one order read in another, quaternions with the real part at the other end: such numbers
are rotations all the same, and nothing in one pose shows the mistake. Over the pairs it shows,
because no X and Z fit. So all conventions that the numbers can have are tried, on one side and on
both, and the other way round, and in other units of length.

The angle between two rotations of A is that between the two of B, whatever X and Z are and
whichever side is inverted: that leaves a few of the combinations of both sides. Those are solved,
and all with one side read otherwise; places tell conventions apart that differ by the names of the
axes only. A reading is named where little is left under it, and a quarter of what is left as the
poses were read, or less; all that leave about as little are named with it, as the pairs do not tell
them apart, but none that reads more otherwise than is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calib import se3
from calib.errors import InputError
from calib.robot_world import residuals, solve_batch
from calib.se3 import FloatArray, IntArray
from posedesign.hand_eye.conventions import (
    AS_THEY_STAND,
    LENGTHS,
    READERS,
    labels_fit,
    named,
    same_count,
)
from posedesign.hand_eye.pairs.forms import Poses

FEWEST_PAIRS = 5
"""Pairs from which a fit says something: three fit many a wrong reading."""

FEWEST_FOR_BOTH = 8
"""Pairs from which both sides are tried at once: there are hundreds of combinations."""

MOST_PAIRS = 40
"""Pairs that are tried, spread over the set: more take longer and say no more."""

DOUBTFUL = 0.01, 0.05
"""Median residual [rad], and of places in parts of the motion, from which other readings are
tried: cameras are better."""

CLEARLY_BETTER = 0.25
"""Part of the residuals that is left over where another reading is the right one."""

TOLD_APART = 1.5
"""Ratio of the residuals from which on one of two readings is told to be the right one: of eight
pairs with normal errors, it has odds of thousands."""

LARGEST_MISS_RAD = 0.15
"""Median difference between the turns of A and of B [rad] that no noise makes: real pairs of a
poor camera scatter by 0.05."""

_METHOD = "zhuang"
"""Rotations in closed form, then translations: as good as any to tell fair from bad."""

_REFERENCES = 5
"""Pairs, spread over the set, that the others are compared with: one alone may be the wrong one."""

_MOST_SOLVED = 300
"""Combinations of readings of both sides that are solved: a dozen of each side turn alike."""

FAIR = 0.15
"""Turns [rad] and places in parts of the motion, together, that a reading may leave over."""

_NEAR_MISS = 2.0, 0.02
"""Miss over the least one, or in rad, up to which combinations are solved: noise may order them
otherwise than translations do."""

Arrange = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_ODD_QUATERNION = "the four numbers called qx qy qz qw are w x y z"


@dataclass(frozen=True)
class Reading:
    """A way to read both sides, and what A X = Z B leaves over under it."""

    a: str  # how the orientation of A is read; empty for as it was read
    b: str
    is_inverse: bool  # one side the other way round
    length: float  # factor of the lengths of A
    turn_rad: float
    shift_m: float  # turn_rad, shift_m: medians of what is left over
    score: float  # turn [rad] and shift in parts of the motion, together

    @property
    def changes(self) -> int:
        """Number of things that are read otherwise."""
        return bool(self.a) + bool(self.b) + self.is_inverse + (self.length != 1.0)

    @property
    def left(self) -> str:
        """Return the residuals in words."""
        return f"{math.degrees(self.turn_rad):.2g} deg and {1e3 * self.shift_m:.2g} mm"


@dataclass(frozen=True)
class Misfit:
    """Sides that no X and Z fit as they were read."""

    text: str  # in a sentence
    explained: bool  # whether another reading fits, which the text names
    readings: tuple[Reading, ...] = ()  # those that fit, the best first


@dataclass(frozen=True)
class Sides:
    """Names of both sides for a message."""

    subject: str = "A and B"
    a: str = "A"
    b: str = "B"
    inverse: str = (
        "with A or, X and Z in each other's place, B inverted: with one side the other way round: "
        "see `invert`"
    )


PAIRS = Sides()
"""Sides of a file of pairs."""


def misfit_of(a: Poses, b: Poses, arrange: Arrange, sides: Sides = PAIRS) -> Misfit | None:
    """Return what to say of two sides of N poses each that no X and Z fit; None where some do.

    ``arrange`` makes A and B of A X = Z B from transforms ``(..., N, 4, 4)`` as the files have
    them.
    """
    if len(a.T) < FEWEST_PAIRS:
        return None
    some = np.unique(np.linspace(0, len(a.T) - 1, MOST_PAIRS).astype(np.intp))
    read_a, read_b = _readings_of(a, some), _readings_of(b, some)
    asread = _scored([_AS_READ], read_a, read_b, arrange)[0]
    doubtful_turn, doubtful_shift = DOUBTFUL
    if not (asread.turn_rad > doubtful_turn or asread.score - asread.turn_rad > doubtful_shift):
        return None
    both = _promising(read_a, read_b)
    for tried in (
        [*_one_side(read_a, read_b), *((x, y, False, 1.0) for x, y in both)],
        [(x, y, True, 1.0) for x, y in both],
    ):
        fitting = _fitting(asread, _scored(tried, read_a, read_b, arrange)) if tried else []
        if fitting:
            return Misfit(_words_of(asread, fitting, a, b, sides), True, tuple(fitting))
    A, B = arrange(a.T, b.T)
    miss = turn_miss(A[:, :3, :3], B[:, :3, :3])
    if miss < LARGEST_MISS_RAD:
        return None
    text = (
        f"between its poses {sides.a} turns otherwise than {sides.b}, by {math.degrees(miss):.3g} "
        "deg (median), where A X = Z B makes their turns equal: are the orientations in the form "
        "that the names of the columns say, and the rows of A and B in step? No other convention "
        "of either side fits"
    )
    return Misfit(text, explained=False)


_Combination = tuple[str, str, bool, float]
"""Readings of A and B, whether one side is inverted, and the factor of lengths of A."""

_AS_READ: _Combination = ("", "", False, 1.0)


def _one_side(a: _Side, b: _Side) -> list[_Combination]:
    """Return what reads one side otherwise, with one thing more at most."""
    factors = {one / other for one in LENGTHS.values() for other in LENGTHS.values()}
    others = [factor for factor in sorted(factors) if not math.isclose(factor, 1.0)]
    sides = [*((x, "") for x in a.rotations), *(("", y) for y in b.rotations if y)]
    return [
        (x, y, inverse, factor)
        for x, y in sides
        for inverse, factor in ((False, 1.0), (True, 1.0), *((False, f) for f in others))
    ]


def told(a: Poses, b: Poses, arrange: Arrange, sides: Sides = PAIRS) -> tuple[Poses, Poses]:
    """Return the sides with the conventions that nobody said, as the pairs tell them.

    Raises InputError: no convention fits, or several, or there are too few pairs to tell.
    """
    if a.is_said and b.is_said:
        return a, b
    unsaid = " and ".join(n for n, side in ((sides.a, a), (sides.b, b)) if not side.is_said)
    hint = "say it with `poses_are`, say kuka-abc or quaternion-xyzw"
    if len(a.T) < FEWEST_FOR_BOTH:
        raise InputError(
            f"nobody says what the numbers of the orientation of {unsaid} are, and {len(a.T)} "
            "poses are too few to tell",
            hint=hint,
            name="poses_are",
        )
    some = np.unique(np.linspace(0, len(a.T) - 1, MOST_PAIRS).astype(np.intp))
    read_a, read_b = _readings_of(a, some), _readings_of(b, some)
    tried = [
        (x, y, False, 1.0)
        for x, y in product(read_a.rotations, read_b.rotations)
        if not ((x and a.is_said) or (y and b.is_said))
    ]
    found = sorted(_scored(tried, read_a, read_b, arrange), key=lambda one: one.score)
    best = [one for one in found if one.score <= TOLD_APART * found[0].score]
    if found[0].score > LARGEST_MISS_RAD:
        misfit = misfit_of(a, b, arrange, sides)
        raise InputError(
            f"nobody says what the numbers of the orientation of {unsaid} are, and no convention "
            "fits alone" + (f": {misfit.text}" if misfit and misfit.explained else ""),
            hint=hint,
            name="poses_are",
        )
    ways = [" and ".join(_unsaid(one, a, b)) for one in best]
    if len(ways) > 1:
        raise InputError(
            f"nobody says what the numbers of the orientation of {unsaid} are, and these poses fit "
            f"by {', by '.join(ways[:5])}",
            hint=f"say which with `poses_are`: {best[0].a or a.turn}, say",
            name="poses_are",
        )
    return _read_by(best[0].a, a, ways[0], found), _read_by(best[0].b, b, ways[0], found)


def _unsaid(one: Reading, a: Poses, b: Poses) -> list[str]:
    """Return the conventions of the sides that nobody said, under a reading, in words."""
    pairs = ((one.a, a), (one.b, b))
    return [named(turn or poses.turn) for turn, poses in pairs if not poses.is_said]


def _read_by(turn: str, poses: Poses, way: str, found: Sequence[Reading]) -> Poses:
    """Return a side as another reading has it, with a note where nobody said it."""
    if poses.is_said:
        return poses
    turn = turn or poses.turn
    other = f", by the next best {found[1].left}" if len(found) > 1 else ""
    note = (
        f"{poses.place.path} does not say what its orientations are: {way}, by which A X = Z B "
        f"leaves {found[0].left} over{other}"
    )
    return replace(poses, T=poses.turned(turn), turn=turn, is_said=True, notes=(*poses.notes, note))


def _fitting(asread: Reading, found: list[Reading]) -> list[Reading]:
    """Return the readings that fit, the best first, those with the fewest changes only."""
    most = min(CLEARLY_BETTER * asread.score, FAIR)
    fair = [one for one in found if one.changes and one.score < most]
    if not fair:
        return []
    best = min(one.score for one in fair)
    fair = [one for one in fair if one.score <= TOLD_APART * best]
    least = min(one.changes for one in fair)
    return sorted((one for one in fair if one.changes == least), key=lambda one: one.score)


def turn_miss(R_A: FloatArray, R_B: FloatArray) -> float:
    """Return the median difference [rad] between the turns of rotations ``(N, 3, 3)``, N pairs.

    The angle of ``A_iᵀ A_j`` is that of ``B_iᵀ B_j`` whatever X and Z are, and whichever side is
    inverted.
    """
    return float(_misses(_turns(R_A), _turns(R_B)))


def _turns(R: FloatArray) -> FloatArray:
    """Return the angles ``(references, N)`` [rad] from some of the rotations to all."""
    some = np.unique(np.linspace(0, len(R) - 1, _REFERENCES).astype(np.intp))
    return np.stack([se3.rotation_angle(R[k].T @ R) for k in some])


def _misses(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the least over the references of the medians of differences of ``(..., refs, N)``."""
    return np.asarray(np.median(np.abs(one - other), axis=-1).min(axis=-1))


@dataclass(frozen=True, eq=False)
class _Side:
    """Rotations of one side by each reading, the one that was read first, under an empty name."""

    places: FloatArray  # (N, 3) as they stand [m]
    rotations: Mapping[str, FloatArray]
    is_inverse: bool

    def transforms(self, name: str, factor: float, *, inverse: bool) -> FloatArray:
        T = se3.transform(self.rotations[name], factor * self.places)
        return se3.inverse(T) if self.is_inverse != inverse else T


def _readings_of(poses: Poses, some: IntArray) -> _Side:
    stands = (se3.inverse(poses.T) if poses.is_inverse else poses.T)[some]
    rotations = {"": stands[:, :3, :3]}
    if poses.turn:
        numbers = poses.numbers[some]
        for name in same_count(numbers.shape[1]):
            if name != poses.turn:
                rotations[name] = READERS[name](numbers)
        if poses.turn == "quaternion-wxyz":
            rotations[_ODD_QUATERNION] = se3.rotation_from_quaternion(np.roll(numbers, -1, axis=1))
    return _Side(stands[:, :3, 3], rotations, poses.is_inverse)


def _promising(a: _Side, b: _Side) -> list[tuple[str, str]]:
    """Return the readings of both sides, each other than it was read, that turn most alike."""
    names_a, names_b = list(a.rotations)[1:], list(b.rotations)[1:]
    if not names_a or not names_b or len(a.places) < FEWEST_FOR_BOTH:
        return []
    turns_a, turns_b = (
        np.stack([_turns(side.rotations[name]) for name in names])
        for side, names in ((a, names_a), (b, names_b))
    )
    miss = _misses(turns_a[:, None], turns_b[None])
    ratio, floor = _NEAR_MISS
    near = miss <= max(ratio * float(miss.min()), floor)
    order = [k for k in np.argsort(miss, axis=None).tolist() if near.flat[k]]
    chosen = [np.unravel_index(k, miss.shape) for k in order[:_MOST_SOLVED]]
    return [(names_a[x], names_b[y]) for x, y in chosen]


def _scored(tried: list[_Combination], a: _Side, b: _Side, arrange: Arrange) -> list[Reading]:
    """Return what A X = Z B leaves over under each reading; medians, as some pairs may be wrong."""
    A = np.stack([a.transforms(x, factor, inverse=inverse) for x, _, inverse, factor in tried])
    B = np.stack([b.transforms(y, 1.0, inverse=False) for _, y, _, _ in tried])
    A, B = arrange(A, B)
    found = solve_batch(A, B, _METHOD)
    turn, shift = np.full((2, len(A)), np.inf)
    solved = ~found.rank_deficient
    error = residuals(A[solved], B[solved], found.X[solved], found.Z[solved])
    turn[solved] = np.median(np.linalg.norm(error[..., :3], axis=-1), axis=-1)
    shift[solved] = np.median(np.linalg.norm(error[..., 3:], axis=-1), axis=-1)
    moved = np.maximum(*(np.linalg.norm(T[..., :3, 3].std(axis=1), axis=-1) for T in (A, B)))
    score = turn + shift / np.maximum(moved, np.finfo(float).tiny)
    return [
        Reading(*one, float(t), float(s), float(c))
        for one, t, s, c in zip(tried, turn, shift, score, strict=True)
    ]


def _words_of(asread: Reading, fitting: list[Reading], a: Poses, b: Poses, sides: Sides) -> str:
    ways = [_way(one, a, b, sides) for one in fitting]
    text = (
        f"no X and Z fit {sides.subject} as they were read: {asread.left} are left over (median), "
        f"and {fitting[0].left} {ways[0]}"
    )
    if len(ways) > 1:
        text += f"; they fit as well {' or '.join(ways[1:5])}: these poses do not tell which"
    return text


def _way(one: Reading, a: Poses, b: Poses, sides: Sides) -> str:
    said = [
        f"if in {side} {_change(turn, poses)}"
        for turn, poses, side in ((one.a, a, sides.a), (one.b, b, sides.b))
        if turn
    ]
    if one.length != 1.0:
        said.append(
            f"if lengths of {sides.a} are {_units(one.length)}, or those of {sides.b} "
            f"{_units(1.0 / one.length)}"
        )
    if one.is_inverse:
        said.append(sides.inverse)
    return ", and ".join(said)


def _change(turn: str, poses: Poses) -> str:
    """Return how an orientation is meant, in words, and what to say or to call the columns."""
    before = poses.turn
    if turn == _ODD_QUATERNION:
        return f"{turn}: rename them"
    if before.startswith("quaternion"):
        order, read = (" ".join(name.partition("-")[2]) for name in (turn, before))
        return (
            f"the four numbers called {' '.join('q' + c for c in read.split())} are {order}: "
            f"`poses_are` {turn}"
        )
    if before.startswith("matrix"):
        return (
            f"the rotation stands column by column, or is that of the inverse: `poses_are` {turn}"
        )
    stand = "" if labels_fit(turn, poses.labels) else f",{AS_THEY_STAND}"
    return f"the three numbers are {named(turn)}: `poses_are` {turn}{stand}"


def _units(factor: float) -> str:
    """Return the units that were taken for each other, by a factor of lengths."""
    pairs = [
        f"{meant}, not {taken}"
        for meant, taken in product(LENGTHS, LENGTHS)
        if math.isclose(LENGTHS[meant] / LENGTHS[taken], factor)
    ]
    return " or ".join(pairs)
