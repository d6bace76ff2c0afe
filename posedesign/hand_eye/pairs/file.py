"""Files of pose pairs A, B of A X = Z B: ``pairs.csv``, in any form that a pose can have.

A pair stands in one row, its poses in the columns of :mod:`.forms` with ``a_`` and ``b_`` before
their names, in capitals or not; the two may have different forms. ``pose`` names the pair and may
be left out; other columns are passed over. Two files, one a side, hold the same with or without the
prefix. Files without a header line need the names of their columns beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray, check_transforms
from posedesign.files import StrPath
from posedesign.files.csv_tables import Row, Table, is_number, read_table, write_table
from posedesign.files.measurements import check_label
from posedesign.hand_eye.conventions import Convention
from posedesign.hand_eye.pairs.forms import METRES, POSE_COLUMNS, PoseForm, Poses, read_poses_of

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
    """Poses of the arm and of the camera, pair by pair: A X = Z B."""

    names: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    """A, B (N, 4, 4) [m]; camera on the flange, ``T_base_flange`` and ``T_target_camera``."""
    places: tuple[str, ...] = ()
    """Where each stands in its file, in words; empty where they come from none."""
    notes: tuple[str, ...] = ()  # what is odd about them
    misread: str = ""
    """How else they seem to have been written than they were read; empty where they fit."""
    numbers: tuple[int, ...] = ()
    """Number of each among those of the file, from 0, where some are left out; else empty."""


def pair_columns(letter: str, form: PoseForm = DEFAULT_FORM) -> list[str]:
    """``a_x_mm`` to ``a_r_deg``, or what another form has."""
    return [f"{letter}_{name}" for name in (*form.place_columns, *form.turn_columns)]


def write_pairs(
    path: StrPath, pairs: Pairs, a: PoseForm = DEFAULT_FORM, b: PoseForm = DEFAULT_FORM
) -> Path:
    """Write ``pairs.csv``; InputError for what is no rigid transform: W, P, R would not show it.

    a and b are the forms of the poses of each side.
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

    ``columns``: names of the columns, for a file without a header line; see :func:`expanded`.
    ``trust_units``: do not refuse angles and lengths that look like those of another unit.
    """
    return joined(*read_sides(path, columns, trust_units=trust_units))


def read_sides(
    path: Path,
    columns: Sequence[str] = (),
    *,
    trust_units: bool = False,
    said: tuple[Convention | None, Convention | None] = (None, None),
) -> tuple[Poses, Poses]:
    """Read both sides of a ``pairs.csv``; see :func:`read_pairs`.

    ``said``: the convention of each side, where it is not that of the names of the columns.
    """
    table = read_numbers(path, expanded(columns))
    a, b = (
        read_poses_of(
            path, table.columns, table.rows, f"{side}_", trust_units=trust_units, said=own
        )
        for side, own in zip("ab", said, strict=True)
    )
    return replace(a, notes=table.notes + a.notes), b


def read_side(
    path: Path,
    letter: str,
    columns: Sequence[str] = (),
    *,
    trust_units: bool = False,
    said: Convention | None = None,
) -> Poses:
    """Read a table with the poses of one side, with or without ``a_`` before the names.

    Otherwise as :func:`read_pairs`. If any of the names given begins with ``a_`` or ``b_``, those
    of the other side are not of this file.
    """
    named = expanded(columns)
    if any(name.startswith(("a_", "b_")) for name in named):
        named = [name for name in named if name.startswith(f"{letter}_")]
        if not named:
            raise InputError(
                f"`columns` names none of {letter.upper()}",
                hint="names without a_ and b_ count for both files",
                name="columns",
            )
    table = read_numbers(path, named, bare=said is not None)
    prefixed = any(name.startswith(f"{letter}_") for name in table.columns)
    prefix = f"{letter}_" if prefixed else ""
    poses = read_poses_of(
        path, table.columns, table.rows, prefix, trust_units=trust_units, said=said
    )
    return replace(poses, notes=table.notes + poses.notes)


def joined(a: Poses, b: Poses) -> Pairs:
    """Pairs from the poses of both sides."""
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
    return Pairs(names, a.T, b.T, places, tuple(dict.fromkeys((*a.notes, *b.notes))))


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


_BARE: Mapping[int, tuple[str, ...]] = {
    6: ("x", "y", "z", "n1", "n2", "n3"),
    7: ("x", "y", "z", "n1", "n2", "n3", "n4"),
    **{n: tuple(c.removesuffix("_mm") for c in _SHORT[f"matrix{n}_mm"]) for n in (12, 16)},
}
"""Columns of lists without a header line, by their number: position, then orientation."""


def read_numbers(path: Path, columns: Sequence[str] = (), *, bare: bool = False) -> Table:
    """Read a table with a header line, or without one where names are given.

    ``bare``: it may have none where the number of its columns tells what they are: six or seven for
    a position and an orientation, 12 or 16 for a matrix row by row.
    """
    table = _table_of(path, columns)
    if bare and not columns and all(map(is_number, table.columns)):
        if len(table.columns) not in _BARE:
            raise FileFormatError(
                f"has {len(table.columns)} numbers a line and no names of columns",
                path=path,
                row=1,
                hint="name them, say `columns` x_mm,y_mm,z_mm,a,b,c; - for one to be passed over",
            )
        columns = _BARE[len(table.columns)]
        table = _table_of(path, columns)
    found, rows = table.columns, table.rows
    first = {cell.lower() for cell in rows[0].cells.values()}
    if columns and all(name in first for name in columns):
        raise FileFormatError(
            "the file has a header line of its own",
            path=path,
            row=rows[0].line,
            hint="leave `columns` out",
        )
    if not columns and all(is_number(name) for name in found):
        raise FileFormatError(
            "the first line has numbers in place of the names of columns",
            path=path,
            row=1,
            hint="name them, say `columns` qw,qx,qy,qz,x_m,y_m,z_m; or say what they are with "
            "`poses_are`",
        )
    found, rows = _in_small_letters(path, found, rows)
    for column in LABELS:
        for row in rows if column in found else ():
            check_label(path, row.line, row.cells[column], column)
    return replace(table, columns=found, rows=rows)


LABELS = ("pose", "picture", "on_flange", "around", "arm")
"""Columns with names, which are shown on terminals and written into figures."""


def _table_of(path: Path, columns: Sequence[str]) -> Table:
    """Read a table as people have it; say of a program that it is one."""
    try:
        return read_table(path, columns, loose=True)
    except FileFormatError as error:
        from posedesign.programs.registry import said_of_program  # all languages: slow to load

        raise said_of_program(error) from None


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
