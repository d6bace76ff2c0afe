"""Where pose pairs come from, and which way round they are: files, names, inversion, convention.

Quaternions of one order read in the other, angles about moving axes read as about fixed ones: such
numbers are rotations all the same, and nothing in one pose shows the mistake. Over the pairs it
shows, because no X and Z fit. So the readings that a form is often confused with are tried too,
and one side the other way round. The rotations alone do not tell these two: four numbers in another
order are a reflection, and turn as the inverse does. The translations do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from calib import se3
from calib.errors import FileFormatError, InputError, near_names
from calib.robot_world import pairs_from_opencv, residuals, solve_batch
from calib.se3 import FloatArray, inverse
from posedesign.files.csv_tables import a_few
from posedesign.files.trees import read_tree
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.file import Pairs, joined, read_side, read_sides
from posedesign.hand_eye.pairs.forms import METRES, Poses
from posedesign.hand_eye.pairs.samples import Samples, samples_of
from posedesign.hand_eye.pairs.stacks import (
    StackFile,
    open_blocks,
    open_mat,
    open_npz,
    open_opencv,
    pick_one,
    pick_two,
)

FEWEST_PAIRS = 5
"""Pairs from which a fit says something: three fit many a wrong reading."""

DOUBTFUL_RAD = 0.01
"""Median residual [rad] from which another reading is looked for: cameras are better."""

CLEARLY_BETTER = 0.25
"""Part of the residuals that is left over where another reading is the right one."""

LARGEST_MISS_RAD = 0.15
"""Median difference between the turns of A and of B [rad] that no noise makes: real pairs of a
poor camera scatter by 0.05."""

_METHOD = "zhuang"
"""Rotations in closed form, then translations: as good as any to tell fair from bad."""

_REFERENCES = 5
"""Pairs, spread over the set, that the others are compared with: one alone may be the wrong one."""

Reading = Callable[[FloatArray], FloatArray]
"""Rotations ``(N, 3, 3)`` from the numbers of a form, angles in rad."""

Arrange = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def _rolled(shift: int) -> Reading:
    return lambda q: se3.rotation_from_quaternion(np.roll(q, shift, axis=-1))


def _transposed(R: FloatArray) -> FloatArray:
    return np.swapaxes(R, -1, -2)


_OTHER_READINGS: Mapping[str, tuple[tuple[str, Reading], ...]] = {
    "quaternion": (
        ("the four numbers called qw qx qy qz are x y z w", _rolled(1)),
        ("the four numbers called qx qy qz qw are w x y z", _rolled(-1)),
    ),
    "wpr": (
        (  # Rx(W) Ry(P) Rz(R), the inverse of what the angles mean the other way round
            "the three angles turn about moving axes x, y, z",
            lambda angles: _transposed(se3.rotation_from_wpr(-angles)),
        ),
        ("the three angles are a rotation vector: call them rx, ry, rz", se3.rotation_exp),
    ),
    "vector": (("the rotation vector is W, P, R: call it w, p, r", se3.rotation_from_wpr),),
    "matrix": (
        (
            "the rotation stands column by column: call r12 r21, and so on",
            lambda numbers: _transposed(numbers.reshape(-1, 3, 3)),
        ),
    ),
}
"""Mistakes that a form invites, and what the rotations would be without them."""


@dataclass(frozen=True)
class Misfit:
    """Sides that no X and Z fit as they were read."""

    text: str  # in a sentence
    explained: bool  # whether another reading fits, which the text names


def misfit_of(a: Poses, b: Poses, arrange: Arrange) -> Misfit | None:
    """What to say of two sides of N poses each that no X and Z fit; nothing where some do.

    ``arrange`` makes A and B of A X = Z B from transforms ``(..., N, 4, 4)`` as the files have
    them.
    """
    if len(a.T) < FEWEST_PAIRS:
        return None
    others = [(f"if in A {what}", T, b.T) for what, T in _read_otherwise(a)]
    others += [(f"if in B {what}", a.T, T) for what, T in _read_otherwise(b)]
    A, B = arrange(
        np.stack([a.T, *(T for _, T, _ in others)]), np.stack([b.T, *(T for _, _, T in others)])
    )
    # which side it is cannot be told: with the other one, X and Z change places
    said = [what for what, _, _ in others] + ["with one side the other way round: see `invert`"]
    A, B = np.concatenate([A, A[:1]]), np.concatenate([B, se3.inverse(B[:1])])
    turn, shift = _median_residuals(A, B)
    if not turn[0] > DOUBTFUL_RAD:
        return None
    # the translations, too: a quaternion in the wrong order fits the turns of the inverse
    fair = (turn < CLEARLY_BETTER * turn[0]) & (shift < CLEARLY_BETTER * shift[0])
    if fair.any():
        best = int(np.argmin(np.where(fair, shift, np.inf)))
        text = (
            f"no X and Z fit A and B as they were read: {math.degrees(turn[0]):.3g} deg are left "
            f"over (median), and {math.degrees(turn[best]):.2g} deg {said[best - 1]}"
        )
        return Misfit(text, explained=True)
    miss = turn_miss(A[0, :, :3, :3], B[0, :, :3, :3])
    if miss < LARGEST_MISS_RAD:
        return None
    text = (
        f"between its poses A turns otherwise than B, by {math.degrees(miss):.3g} deg (median), "
        "where A X = Z B makes their turns equal: are the orientations in the form that the names "
        "of the columns say, and the rows of A and B in step?"
    )
    return Misfit(text, explained=False)


def turn_miss(R_A: FloatArray, R_B: FloatArray) -> float:
    """Median difference [rad] between the turns of rotations ``(N, 3, 3)``, N pairs.

    The angle of ``A_iᵀ A_j`` is that of ``B_iᵀ B_j`` whatever X and Z are, and whichever side is
    inverted.
    """
    references = np.unique(np.linspace(0, len(R_A) - 1, _REFERENCES).astype(np.intp))
    return min(float(np.median(np.abs(_turns(R_A, k) - _turns(R_B, k)))) for k in references)


def _median_residuals(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median angle [rad] and distance [m] left over ``(K,)``; NaN where the poses say too little.

    Medians, as some pairs may be wrong without the reading being so.
    """
    found = solve_batch(A, B, _METHOD)
    turn, shift = np.full((2, len(A)), np.nan)
    solved = ~found.rank_deficient
    error = residuals(A[solved], B[solved], found.X[solved], found.Z[solved])
    turn[solved] = np.median(np.linalg.norm(error[..., :3], axis=-1), axis=-1)
    shift[solved] = np.median(np.linalg.norm(error[..., 3:], axis=-1), axis=-1)
    return turn, shift


def _read_otherwise(poses: Poses) -> list[tuple[str, FloatArray]]:
    others = _OTHER_READINGS.get(poses.turn.partition("-")[0], ())
    p = poses.T[:, :3, 3]
    return [(what, se3.transform(read(poses.numbers), p)) for what, read in others]


def _turns(R: FloatArray, k: int) -> FloatArray:
    return se3.rotation_angle(R[k].T @ R)


Invert = Literal["none", "a", "b", "both"]
Convention = Literal["axzb", "opencv"]

FEWEST_DISTINCT = 3
"""Pairs below which repetitions are left in, so that the solver says what is wrong with them."""

_STACKS = (".mat", ".npz", ".xml")
"""Endings of files that hold matrices under names."""

_TREES = (".xml", ".yaml", ".yml", ".json", ".samples")
"""Endings of files that hold such matrices, or samples."""


@dataclass(frozen=True)
class PairSource:
    """Files of pose pairs, and how they are to be understood."""

    pairs: Path | None = None
    """One file with both sides: a table, a file of matrices (:mod:`.stacks`), or samples of MoveIt
    or easy_handeye (:mod:`.samples`)."""
    a: Path | None = None
    b: Path | None = None  # a, b: two files with one side each, in place of it
    columns: Sequence[str] = ()  # names of the columns of tables without a header line
    variables: Sequence[str] = ()  # names of A and B in files of matrices
    unit: str | None = None  # {"mm", "m"}: unit of length of files of matrices
    invert: Invert = "none"  # sides that the files have the other way round
    convention: Convention = "axzb"  # whose A and B the files have, once they are inverted
    trust_units: bool = False
    """Do not refuse angles and lengths that look like those of another unit."""
    camera: Camera = "on-flange"  # where it is: tells A and B of samples

    def __post_init__(self) -> None:
        if self.camera == "fixed" and self.convention == "opencv":
            # its function has no fixed camera: its world would be the flange
            raise InputError(
                "`convention` opencv is for a camera on the flange",
                hint="for a fixed one give gripper2base as A and target2cam as B, without it",
                name="convention",
            )
        given = (self.pairs is not None, self.a is not None, self.b is not None)
        if given not in ((True, False, False), (False, True, True)):
            raise InputError(
                "give one file of pairs, or one with `a` and one with `b`", name="pairs"
            )
        for name, value, known in (
            ("invert", self.invert, get_args(Invert)),
            ("convention", self.convention, get_args(Convention)),
            ("unit", self.unit or "mm", tuple(METRES)),
        ):
            if value not in known:
                raise InputError(
                    f"`{name}` cannot be {value!r}",
                    hint=near_names(str(value), known),
                    name=name,
                    value=value,
                )
        self._check_options()

    def _check_options(self) -> None:
        """Refuse options that would be of no effect, and the lack of those that are needed."""
        stacks = [path for path in self._paths if path.suffix.casefold() in _STACKS]
        if self.columns and len(stacks) == len(self._paths):
            raise InputError("`columns` is for tables, not for files of matrices", name="columns")
        for path in stacks:
            self._unit_of(path)
        if self.variables and len(self.variables) != 2:
            raise InputError(
                f"`variables` has {len(self.variables)} names",
                hint="name A, then B, with a comma between them",
                name="variables",
            )

    def _unit_of(self, path: Path) -> str:
        if self.unit is None:
            raise InputError(
                f"{path} does not say its unit of length",
                hint="say it with `unit` mm or `unit` m",
                name="unit",
            )
        return self.unit

    @property
    def _paths(self) -> list[Path]:
        return [path for path in (self.pairs, self.a, self.b) if path is not None]

    def read(self) -> Pairs:
        """Read A and B as the solver takes them, each pair once.

        Raises FileFormatError: naming file, line and column, or file, variable and pose.
        """
        a, b = self._sides()
        pairs = joined(a, b)
        A, B = self._arranged(a.T, b.T)
        pairs = replace(pairs, A=A, B=B)
        misfit = misfit_of(a, b, self._arranged)
        if misfit is not None and misfit.explained:
            pairs = replace(pairs, misread=misfit.text)
        elif misfit is not None:
            pairs = replace(pairs, notes=(*pairs.notes, misfit.text))
        return without_repeats(pairs)

    def _arranged(self, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A and B as the solver takes them from transforms ``(..., 4, 4)`` as the files have."""
        if self.invert in ("a", "both"):
            A = inverse(A)
        if self.invert in ("b", "both"):
            B = inverse(B)
        if self.convention == "opencv":
            return pairs_from_opencv(world2cam=A, base2gripper=B)
        return A, B

    def _sides(self) -> tuple[Poses, Poses]:
        files = [self._opened(path) for path in self._paths]
        if (self.unit or self.variables) and not any(isinstance(f, StackFile) for f in files):
            raise InputError(
                "`unit` and `variables` are for files of matrices: MATLAB's, NumPy's, OpenCV's",
                hint="the unit of a table stands in the names of its columns, samples are in m",
                name="unit" if self.unit else "variables",
            )
        if self.pairs is None:
            a, b = (self._side(k, *of) for k, of in enumerate(zip(self._paths, files, strict=True)))
            return a, b
        file = files[0]
        if isinstance(file, Samples):
            if self.convention == "opencv" or self.columns:
                raise InputError(
                    f"{self.pairs} says itself what A and B are",
                    hint="leave `convention` and `columns` out",
                    name="convention",
                )
            return file.a, file.b
        if file is None:
            return read_sides(self.pairs, self.columns, trust_units=self.trust_units)
        if file.lines:
            raise FileFormatError(
                "holds the poses of one side",
                path=self.pairs,
                hint="give it with `a` or `b`, and the other side likewise",
            )
        unit, trust = self._unit_of(self.pairs), self.trust_units
        a, b = (file.poses(n, unit, trust_units=trust) for n in pick_two(file, self.variables))
        return a, b

    def _side(self, k: int, path: Path, file: StackFile | Samples | None) -> Poses:
        if isinstance(file, Samples):
            raise FileFormatError(
                "holds both sides", path=path, hint="give it alone, without `a` and `b`"
            )
        if file is None:
            return read_side(path, "ab"[k], self.columns, trust_units=self.trust_units)
        name = pick_one(file, self.variables[k] if self.variables else "")
        return file.poses(name, self._unit_of(path), trust_units=self.trust_units)

    def _opened(self, path: Path) -> StackFile | Samples | None:
        """A file that was looked into; None for a table."""
        ending = path.suffix.casefold()
        if ending == ".mat":
            return open_mat(path)
        if ending == ".npz":
            return open_npz(path)
        if ending in _TREES:
            tree = read_tree(path)
            samples = samples_of(tree, path, self.camera, trust_units=self.trust_units)
            return samples or open_opencv(path, tree)
        return open_blocks(path)


def without_repeats(pairs: Pairs) -> Pairs:
    """The pairs without those that repeat another number by number, with a note of them.

    A measurement that was made twice differs in its last digits; a row that was pasted twice does
    not, and would count double.
    """
    both = np.concatenate([pairs.A, pairs.B], axis=1).reshape(len(pairs.A), -1)
    _, first, same = np.unique(both, axis=0, return_index=True, return_inverse=True)
    first = first[same.reshape(-1)]
    kept = first == np.arange(len(first))
    if kept.all() or kept.sum() < FEWEST_DISTINCT:
        return pairs
    places, again = pairs.places or pairs.names, np.flatnonzero(~kept)
    shown = a_few([f"{places[i]} as {places[first[i]]}" for i in again])
    note = f"pairs that repeat another number by number are left out: {shown}"
    return replace(
        pairs,
        names=tuple(compress(pairs.names, kept)),
        A=pairs.A[kept],
        B=pairs.B[kept],
        places=tuple(compress(places, kept)),
        notes=(*pairs.notes, note),
    )
