"""Files of pose pairs A, B of A X = Z B: ``pairs.csv``, in any form that a pose can have.

A pair stands in one row, its poses in the columns of :mod:`posedesign.pairs.forms` with ``a_`` and
``b_`` before their names, in capitals or not; the two may have different forms. ``pose`` names the
pair and may be left out; other columns are passed over. Two files, one a side, hold the same with
or without the prefix. Files without a header line need the names of their columns beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.mat_file import LARGEST_MAT_BYTES, Variable, read_variables
from calib.se3 import FloatArray, check_transforms
from posedesign.files import StrPath, read_bytes_bounded
from posedesign.files.csv_tables import LONGEST_SHOWN, Row, read_rows, write_table
from posedesign.pairs.checks import Place, transforms_from_matrices
from posedesign.pairs.forms import (
    METRES,
    POSE_COLUMNS,
    PoseForm,
    Poses,
    check_lengths,
    read_poses_of,
    refuse_endless_lengths,
)

DEFAULT_FORM = PoseForm()
"""W, P, R in degrees and mm, as a FANUC pendant shows a pose."""

SKIPPED = "-"
"""Name of a column to be passed over."""

_MATRIX_ROWS = tuple(tuple(f"r{row}{column}" for column in range(1, 4)) for row in range(1, 4))
_SHORT = {
    f"matrix{count}_{unit}": tuple(
        name
        for row, axis in zip(_MATRIX_ROWS, "xyz", strict=True)
        for name in (*row, f"{axis}_{unit}")
    )
    + (("r41", "r42", "r43", "r44") if count == 16 else ())
    for count in (12, 16)
    for unit in METRES
}
"""Names that stand for all numbers of a matrix, row by row."""

_KNOWN = frozenset(
    {"pose", *(prefix + name for prefix in ("", "a_", "b_") for name in POSE_COLUMNS)}
)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Poses of the arm and of the camera, pair by pair: A X = Z B.

    Attributes
    ----------
    A, B : array (N, 4, 4)
        [m]; camera on the flange, ``T_base_flange`` and ``T_target_camera``.
    places : tuple of str
        Where each stands in its file, in words; empty where they come from none.
    notes : tuple of str
        What is odd about them.
    misread : str
        How else they seem to have been written than they were read; empty where they fit.
    """

    names: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    places: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    misread: str = ""


def pair_columns(letter: str, form: PoseForm = DEFAULT_FORM) -> list[str]:
    """``a_x_mm`` to ``a_r_deg``, or what another form has."""
    return [f"{letter}_{name}" for name in (*form.place_columns, *form.turn_columns)]


def write_pairs(
    path: StrPath, pairs: Pairs, a: PoseForm = DEFAULT_FORM, b: PoseForm = DEFAULT_FORM
) -> Path:
    """Write ``pairs.csv``; InputError for what is no rigid transform: W, P, R would not show it.

    Parameters
    ----------
    a, b : PoseForm
        Form of the poses of each side.
    """
    A, B = check_transforms(pairs.A, "A"), check_transforms(pairs.B, "B")
    numbers = np.concatenate([a.numbers(A), b.numbers(B)], axis=-1)
    columns = [*pair_columns("a", a), *pair_columns("b", b)]
    rows = [
        {"pose": name, **dict(zip(columns, row, strict=True))}
        for name, row in zip(pairs.names, numbers, strict=True)
    ]
    return write_table(path, ["pose", *columns], rows)


def read_pairs(path: Path, columns: Sequence[str] = (), *, trust_units: bool = False) -> Pairs:
    """Read a ``pairs.csv``.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns, for a file without a header line; see :func:`expanded`.
    trust_units : bool
        Do not refuse angles and lengths that look like those of another unit.

    Raises
    ------
    FileFormatError
        Naming line and column.
    """
    return joined(*read_sides(path, columns, trust_units=trust_units))


def read_sides(
    path: Path, columns: Sequence[str] = (), *, trust_units: bool = False
) -> tuple[Poses, Poses]:
    """Read both sides of a ``pairs.csv``; see :func:`read_pairs`."""
    named, rows = _rows(path, expanded(columns))
    a, b = (read_poses_of(path, named, rows, f"{s}_", trust_units=trust_units) for s in "ab")
    return a, b


def read_side(
    path: Path, letter: str, columns: Sequence[str] = (), *, trust_units: bool = False
) -> Poses:
    """Read a table with the poses of one side, with or without ``a_`` before the names.

    Parameters
    ----------
    letter : {"a", "b"}
    columns : sequence of str
        Names of the columns, for a file without a header line. If any begins with ``a_`` or
        ``b_``, those of the other side are not of this file.
    trust_units : bool
        As for :func:`read_pairs`.
    """
    named = expanded(columns)
    if any(name.startswith(("a_", "b_")) for name in named):
        named = [name for name in named if name.startswith(f"{letter}_")]
        if not named:
            raise _no_columns(letter)
    found, rows = _rows(path, named)
    prefix = f"{letter}_" if any(name.startswith(f"{letter}_") for name in found) else ""
    return read_poses_of(path, found, rows, prefix, trust_units=trust_units)


def joined(a: Poses, b: Poses) -> Pairs:
    """Pairs from the poses of both sides.

    Raises
    ------
    FileFormatError
        One side has more poses than the other, or others by name.
    """
    if len(a.T) != len(b.T):
        raise FileFormatError(
            f"has {len(b.T)} poses, {a.place.variable or a.place.path} has {len(a.T)}",
            path=b.place.path,
            key=b.place.variable or None,
            hint="give one B for each A, in the same order",
            value=len(b.T),
            bound=len(a.T),
        )
    for i, (one, other) in enumerate(zip(a.names, b.names, strict=False)):
        if one != other:
            raise b.place.error(
                i,
                f"this is {other!r}, and {a.place.path}, {a.place.name(i)}, is {one!r}",
                hint="put both files into the same order",
                column="pose",
            )
    given = a.names or b.names or ("",) * len(a.T)
    names = tuple(name or f"P{i + 1:02d}" for i, name in enumerate(given))
    places = tuple(a.place.name(i) for i in range(len(names)))
    return Pairs(names, a.T, b.T, places, (*a.notes, *b.notes))


def expanded(columns: Sequence[str]) -> list[str]:
    """Names of columns with the short ones written out.

    ``matrix16_mm`` stands for the 16 numbers of a transform row by row, ``matrix12_mm`` for those
    without its last row, ``_m`` likewise, all with or without ``a_`` or ``b_`` before them. A
    column with the name ``-`` is passed over. Capitals count as small letters.
    """
    names: list[str] = []
    for position, given in enumerate(columns):
        name = given.lower()
        prefix = name[:2] if name[:2] in ("a_", "b_") else ""
        stem = name.removeprefix(prefix)
        if stem == SKIPPED:
            names.append(f"{prefix}column {position + 1}, passed over")
        else:
            names += [prefix + n for n in _SHORT.get(stem, (stem,))]
    return names


def _rows(path: Path, columns: Sequence[str]) -> tuple[list[str], list[Row]]:
    """Names and rows of a table with a header line, or without one where names are given."""
    found, rows = read_rows(path, columns)
    first = {cell.lower() for cell in rows[0].cells.values()}
    if columns and all(name in first for name in columns):
        raise FileFormatError(
            "the file has a header line of its own",
            path=path,
            row=rows[0].line,
            hint="leave --columns out",
        )
    if not columns and all(_is_number(name) for name in found):
        raise FileFormatError(
            "the first line has numbers in place of the names of columns",
            path=path,
            row=1,
            hint="name them, say --columns qw,qx,qy,qz,x_m,y_m,z_m",
        )
    return _in_small_letters(path, found, rows)


def _in_small_letters(
    path: Path, found: Sequence[str], rows: list[Row]
) -> tuple[list[str], list[Row]]:
    """The same with small letters in the names of the columns that this file knows."""
    named = {name: name.lower() for name in found if name.lower() in _KNOWN}
    if all(name == small for name, small in named.items()):
        return list(found), rows
    columns = [named.get(name, name) for name in found]
    if len(set(columns)) != len(columns):
        double = next(name for name in found if columns.count(named.get(name, name)) > 1)
        raise FileFormatError(
            "appears twice, capitals apart", path=path, row=1, column=double, hint="rename one"
        )
    return columns, [
        Row(row.line, {named.get(name, name): cell for name, cell in row.cells.items()})
        for row in rows
    ]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _no_columns(letter: str) -> InputError:
    return InputError(
        f"--columns names none of {letter.upper()}",
        hint="names without a_ and b_ count for both files",
        name="columns",
    )


WHOLE_NUMBERS = tuple(f"{sign}int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "u"))
"""Kinds that they cannot be, however their numbers are stacked."""

_MAGIC = b"MATLAB 5.0 MAT-file"
_HDF5 = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")


def variables_of(path: Path) -> dict[str, Variable]:
    """The variables of a MATLAB file by name.

    Raises
    ------
    FileFormatError
        It is missing, too large, of version 7.3, no MATLAB file, or damaged.
    """
    data = read_bytes_bounded(path, most_bytes=LARGEST_MAT_BYTES)
    if data.startswith(_HDF5) or data[512:].startswith(_HDF5[1]):
        raise FileFormatError(
            "is a MATLAB file of version 7.3 (HDF5)",
            path=path,
            hint="save it again with save('file.mat', 'A', 'B', '-v7')",
        )
    if not data.startswith(_MAGIC):
        raise FileFormatError(
            "is no MATLAB file of version 5 to 7", path=path, hint="is it the right file?"
        )
    try:
        return read_variables(data)
    except OverflowError as error:
        raise FileFormatError(
            f"unfolds to more than {LARGEST_MAT_BYTES / 1e6:g} MB",
            path=path,
            hint="save the two variables alone",
        ) from error
    except OSError as error:
        raise FileFormatError(
            "is damaged or cut off",
            path=path,
            hint="save it again with save('file.mat', .., '-v7')",
        ) from error


@dataclass(frozen=True)
class MatFile:
    """A MATLAB file that was looked into."""

    path: Path
    variables: Mapping[str, Variable]

    @property
    def stacks(self) -> tuple[str, ...]:
        """Names of the variables that are 4x4xN numbers."""
        return tuple(name for name, variable in self.variables.items() if _is_stack(variable))

    def poses(self, name: str, unit: str, *, trust_units: bool) -> Poses:
        """Transforms of a variable.

        Raises
        ------
        FileFormatError
            It is not there, no 4x4xN real numbers, or some are no rigid transforms.
        """
        T = self._array(name)
        place = Place(self.path, variable=name)
        T[:, :3, 3] *= METRES[unit]
        T, note = transforms_from_matrices(T, place)
        refuse_endless_lengths(place, T[:, :3, 3])
        if not trust_units:
            other = "m" if unit == "mm" else "mm"
            check_lengths(place, T[:, :3, 3], unit, f"say --unit {other}")
        notes = (f"{self.path}, {name}: {note}",) if note else ()
        return Poses(T, place, (), notes, "matrix", T[:, :3, :3].reshape(-1, 9))

    def _array(self, name: str) -> FloatArray:
        """Matrices ``(N, 4, 4)`` in the unit of the file."""
        if name not in self.variables:
            raise FileFormatError(
                f"there is no variable {name[:LONGEST_SHOWN]!r}",
                path=self.path,
                hint=near_names(name, self.stacks or self.variables),
                value=name,
            )
        variable = self.variables[name]
        if variable.array is None or not _is_stack(variable):
            raise _no_stack(self.path, name, variable)
        return np.moveaxis(variable.array, -1, 0).copy()


def open_mat(path: Path) -> MatFile:
    """Look into a MATLAB file.

    Raises
    ------
    FileFormatError
        It is missing, too large, of version 7.3, no MATLAB file, or damaged.
    """
    return MatFile(path, variables_of(path))


def pick_two(file: MatFile, variables: Sequence[str]) -> tuple[str, str]:
    """The variables that are A and B: those that were named, or ``A`` and ``B``.

    Raises
    ------
    FileFormatError
        Which is which cannot be known.
    """
    if variables:
        return variables[0], variables[1]
    if "A" in file.variables and "B" in file.variables:
        return "A", "B"
    two = ",".join(file.stacks[:2]) if len(file.stacks) == 2 else "NAME_OF_A,NAME_OF_B"
    raise FileFormatError(
        f"does not say which of its variables are A and B ({_listed(file)})",
        path=file.path,
        hint=f"name A, then B, with --variables {two}",
    )


def pick_one(file: MatFile, variable: str) -> str:
    """The variable of a file with one side: the one that was named, or the only 4x4xN one.

    Raises
    ------
    FileFormatError
        There are several.
    """
    if variable:
        return variable
    known = file.stacks or tuple(file.variables)
    if len(known) == 1:
        return known[0]
    raise FileFormatError(
        f"does not say which of its variables to take ({_listed(file)})",
        path=file.path,
        hint="name that of A, then that of B, with --variables NAME,NAME",
    )


def _listed(file: MatFile) -> str:
    if not file.variables:
        return "it is empty"
    known = list(file.variables.items())
    shown = [f"{name[:LONGEST_SHOWN]}: {variable.described}" for name, variable in known[:8]]
    return ", ".join(shown) + (f" and {len(known) - 8} more" if len(known) > 8 else "")


def _no_stack(path: Path, name: str, variable: Variable) -> FileFormatError:
    """What keeps a variable from being transforms, and what to do."""
    said = f"is {variable.described}, not 4x4xN double"
    hint = "stack the transforms along the third dimension: cat(3, T{:})"
    if variable.is_stacked and variable.kind in WHOLE_NUMBERS:
        said = f"is {variable.described}: whole numbers, which rotations are not made of"
        hint = "save what it was made from, in double; double() does not bring its decimals back"
    elif variable.is_stacked and variable.is_complex:
        said = f"is {variable.described}, and transforms are real"
        hint = "if its imaginary part is mere rounding, save real() of it"
    return FileFormatError(said, path=path, key=name, hint=hint, value=variable.described)


def _is_stack(variable: Variable) -> bool:
    return variable.may_be_transforms and not variable.is_complex
