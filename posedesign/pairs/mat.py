"""Pose pairs in MATLAB files of version 5 to 7: arrays 4x4xN of transforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.mat_file import LARGEST_MAT_BYTES, Variable, read_variables
from calib.se3 import FloatArray
from posedesign.files import read_bytes_bounded
from posedesign.files.csv_tables import LONGEST_SHOWN
from posedesign.pairs.checks import Place, transforms_from_matrices
from posedesign.pairs.forms import METRES, Poses, check_lengths, refuse_endless_lengths

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
    """A MATLAB file that was looked into.

    Attributes
    ----------
    path : Path
    variables : mapping of str to Variable
    """

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
