"""Where pose pairs come from, and which way round they are: files, names, inversion, convention."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from calib.errors import InputError, near_names
from calib.robot_world import pairs_from_opencv
from calib.se3 import FloatArray, inverse
from posedesign.pairs.checks import repeats
from posedesign.pairs.file import Pairs, joined, read_side, read_sides
from posedesign.pairs.forms import METRES, Poses
from posedesign.pairs.mat import open_mat, pick_one, pick_two
from posedesign.pairs.readings import misfit_of

Invert = Literal["none", "a", "b", "both"]
Convention = Literal["axzb", "opencv"]

FEWEST_DISTINCT = 3
"""Pairs below which repetitions are left in, so that the solver says what is wrong with them."""

_SHOWN = 5


@dataclass(frozen=True)
class PairSource:
    """Files of pose pairs, and how they are to be understood.

    Attributes
    ----------
    pairs : Path or None
        One file with both sides: a table, or a MATLAB file (``.mat``).
    a, b : Path or None
        Two files with one side each, in place of it.
    columns : sequence of str
        Names of the columns of tables without a header line.
    variables : sequence of str
        Names of A and B in MATLAB files.
    unit : {"mm", "m"} or None
        Unit of length of MATLAB files.
    invert : {"none", "a", "b", "both"}
        Sides that the files have the other way round.
    convention : {"axzb", "opencv"}
        Whose A and B the files have, once they are inverted.
    trust_units : bool
        Do not refuse angles and lengths that look like those of another unit.
    """

    pairs: Path | None = None
    a: Path | None = None
    b: Path | None = None
    columns: Sequence[str] = ()
    variables: Sequence[str] = ()
    unit: str | None = None
    invert: Invert = "none"
    convention: Convention = "axzb"
    trust_units: bool = False

    def __post_init__(self) -> None:
        given = (self.pairs is not None, self.a is not None, self.b is not None)
        if given not in ((True, False, False), (False, True, True)):
            raise InputError(
                "give one file of pairs, or one with --a and one with --b", name="pairs"
            )
        for name, value, known in (
            ("invert", self.invert, get_args(Invert)),
            ("convention", self.convention, get_args(Convention)),
            ("unit", self.unit or "mm", tuple(METRES)),
        ):
            if value not in known:
                raise InputError(
                    f"--{name} cannot be {value!r}",
                    hint=near_names(str(value), known),
                    name=name,
                    value=value,
                )
        self._check_options()

    def _check_options(self) -> None:
        """Refuse options that would be of no effect, and the lack of those that are needed."""
        mat = [path for path in self._paths if _is_mat(path)]
        if not mat and (self.unit or self.variables):
            raise InputError(
                "--unit and --variables are for MATLAB files (.mat)",
                hint="the unit of a table stands in the names of its columns",
                name="unit" if self.unit else "variables",
            )
        if self.columns and len(mat) == len(self._paths):
            raise InputError("--columns is for tables, not for MATLAB files", name="columns")
        if mat and self.unit is None:
            raise InputError(
                f"{mat[0]} does not say its unit of length",
                hint="say it with --unit mm or --unit m",
                name="unit",
            )
        if self.variables and len(self.variables) != 2:
            raise InputError(
                f"--variables has {len(self.variables)} names",
                hint="name A, then B, with a comma between them",
                name="variables",
            )

    @property
    def _paths(self) -> list[Path]:
        return [path for path in (self.pairs, self.a, self.b) if path is not None]

    def read(self) -> Pairs:
        """Read A and B as the solver takes them, each pair once.

        Raises
        ------
        FileFormatError
            Naming file, line and column, or file, variable and pose.
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
        if self.pairs is None:
            return self._side(0), self._side(1)
        if not _is_mat(self.pairs):
            return read_sides(self.pairs, self.columns, trust_units=self.trust_units)
        file = open_mat(self.pairs)
        unit, trust = self.unit or "", self.trust_units
        a, b = (file.poses(n, unit, trust_units=trust) for n in pick_two(file, self.variables))
        return a, b

    def _side(self, k: int) -> Poses:
        path = (self.a, self.b)[k]
        if path is None:
            raise InputError("both --a and --b are needed", name="ab"[k])
        if not _is_mat(path):
            return read_side(path, "ab"[k], self.columns, trust_units=self.trust_units)
        file = open_mat(path)
        name = pick_one(file, self.variables[k] if self.variables else "")
        return file.poses(name, self.unit or "", trust_units=self.trust_units)


def without_repeats(pairs: Pairs) -> Pairs:
    """The pairs without those that repeat another number by number, with a note of them."""
    kept, found = repeats(pairs.A, pairs.B)
    if not found or kept.sum() < FEWEST_DISTINCT:
        return pairs
    places = pairs.places or pairs.names
    shown = [f"{places[i]} as {places[first]}" for i, first in found[:_SHOWN]]
    more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    note = f"pairs that repeat another number by number are left out: {', '.join(shown)}{more}"
    return Pairs(
        tuple(name for name, ok in zip(pairs.names, kept, strict=True) if ok),
        pairs.A[kept],
        pairs.B[kept],
        tuple(place for place, ok in zip(places, kept, strict=True) if ok),
        (*pairs.notes, note),
        pairs.misread,
    )


def _is_mat(path: Path) -> bool:
    return path.suffix.casefold() == ".mat"
