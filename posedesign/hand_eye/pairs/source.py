"""Where pose pairs come from, and which way round they are: files, names, inversion, convention."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.robot_world import pairs_from_opencv
from calib.se3 import FloatArray, inverse
from posedesign.files.csv_tables import a_few
from posedesign.files.trees import read_tree
from posedesign.hand_eye.conventions import UNKNOWN, Convention, convention_of
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.file import Pairs, joined, read_side, read_sides
from posedesign.hand_eye.pairs.forms import METRES, Poses, WrittenPoses
from posedesign.hand_eye.pairs.pose_files import read_written, written_tree
from posedesign.hand_eye.pairs.readings import misfit_of, told
from posedesign.hand_eye.pairs.samples import Samples, samples_of
from posedesign.hand_eye.pairs.stacks import (
    OPENCV_NAMES,
    StackFile,
    open_blocks,
    open_mat,
    open_npz,
    open_opencv,
    pick_one,
    pick_two,
)

Invert = Literal["none", "a", "b", "both"]
Order = Literal["axzb", "opencv"]

FEWEST_DISTINCT = 3
"""Pairs below which repetitions are left in, so that the solver says what is wrong with them."""

_STACKS = (".mat", ".npz", ".npy", ".xml")
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
    convention: Order = "axzb"  # whose A and B the files have, once they are inverted
    trust_units: bool = False
    """Do not refuse angles and lengths that look like those of another unit."""
    camera: Camera = "on-flange"  # where it is: tells A and B of samples
    poses_are: str = ""
    """Convention of the poses, see :func:`~posedesign.hand_eye.conventions.convention_of`; those of
    A and of B apart with a slash between them."""

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
            ("convention", self.convention, get_args(Order)),
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

    @property
    def said(self) -> tuple[Convention | None, Convention | None]:
        """Conventions of A and B that are said."""
        if not self.poses_are.strip():
            return None, None
        parts = self.poses_are.split("/")
        if len(parts) > 2:
            raise InputError(
                f"`poses_are` {self.poses_are!r} has {len(parts)} parts",
                hint="say that of A, then that of B, with one slash between them",
                name="poses_are",
            )
        a, b = (convention_of(part) if part.strip() else None for part in (parts * 2)[:2])
        return a, b

    def _check_options(self) -> None:
        """Refuse options that would be of no effect, and the lack of those that are needed."""
        stacks = [path for path in self._paths if path.suffix.casefold() in _STACKS]
        if self.columns and len(stacks) == len(self._paths):
            raise InputError("`columns` is for tables, not for files of matrices", name="columns")
        for path in stacks:
            self._unit_of(path)
        _ = self.said  # a word that is not known is said before a file is opened
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

    def read(self, *, of_two_frames: bool = True) -> Pairs:
        """Read A and B as the solver takes them, each pair once.

        ``of_two_frames``: all pairs are of the same X and Z, so that they can be asked whether they
        fit together as they were read.

        Raises FileFormatError: naming file, line and column, or file, variable and pose.
        """
        a, b = self._sides()
        joined(a, b)  # as many of each
        if of_two_frames:
            a, b = told(a, b, self._arranged)
        pairs = joined(a, b)
        A, B = self._arranged(a.T, b.T)
        pairs = replace(pairs, A=A, B=B)
        misfit = misfit_of(a, b, self._arranged) if of_two_frames else None
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
        if (self.unit or self.variables) and not any(
            isinstance(f, StackFile | WrittenPoses) for f in files
        ):
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
            return read_sides(
                self.pairs, self.columns, trust_units=self.trust_units, said=self.said
            )
        if isinstance(file, WrittenPoses) or file.lines:
            raise FileFormatError(
                "holds the poses of one side",
                path=self.pairs,
                hint="give it with `a` or `b`, and the other side likewise",
            )
        unit, trust = self._unit_of(self.pairs), self.trust_units
        names = pick_two(file, self.variables)
        a, b = (file.poses(n, unit, trust_units=trust) for n in names)
        return self._by_names(a, b, names)

    def _by_names(self, a: Poses, b: Poses, names: tuple[str, str]) -> tuple[Poses, Poses]:
        """A and B of variables that were picked by their names in OpenCV, as A X = Z B has them.

        Where a person names them or says what is inverted, that counts.
        """
        known = names[0] in OPENCV_NAMES["a"] and names[1] in OPENCV_NAMES["b"]
        if not known or self.variables or self.invert != "none" or self.convention == "opencv":
            return a, b
        inverted_a = OPENCV_NAMES["a"][names[0]]
        inverted_b = OPENCV_NAMES["b"][names[1]] != (self.camera == "on-flange")
        note = f"{a.place.path}: A is of {names[0]} and B of {names[1]}, by their names in OpenCV"
        a = replace(a, notes=(*a.notes, note))
        return (a.inverted() if inverted_a else a), (b.inverted() if inverted_b else b)

    def _side(self, k: int, path: Path, file: StackFile | Samples | WrittenPoses | None) -> Poses:
        if isinstance(file, Samples):
            raise FileFormatError(
                "holds both sides", path=path, hint="give it alone, without `a` and `b`"
            )
        if isinstance(file, WrittenPoses):
            unit = Convention(UNKNOWN, "", self.unit or "")
            said = self.said[k] or unit
            return file.read(said, trust_units=self.trust_units)
        if file is None:
            return read_side(
                path, "ab"[k], self.columns, trust_units=self.trust_units, said=self.said[k]
            )
        name = pick_one(file, self.variables[k] if self.variables else "")
        return file.poses(name, self._unit_of(path), trust_units=self.trust_units)

    def _opened(self, path: Path) -> StackFile | Samples | WrittenPoses | None:
        """A file or a folder that was looked into; None for a table."""
        if path.is_dir():
            return read_written(path)
        ending = path.suffix.casefold()
        if ending == ".mat":
            return open_mat(path)
        if ending in (".npz", ".npy"):
            return open_npz(path)
        if ending in _TREES:
            tree = read_tree(path)
            samples = samples_of(tree, path, self.camera, trust_units=self.trust_units)
            if samples is not None:
                return samples
            try:
                file = open_opencv(path, tree)
                if file.stacks:
                    return file
            except FileFormatError:
                file = None
            written = written_tree(path, tree)
            return written or file or open_opencv(path, tree)
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
        numbers=tuple(np.flatnonzero(kept).tolist()),
        notes=(*pairs.notes, note),
    )
