"""Transforms from MATLAB files: arrays 4x4xN of numbers and nothing else.

A ``.mat`` file can hold objects, functions, cells in cells, and a few compressed bytes that unfold
to gigabytes. So it is unfolded here, up to a size, and of what it then lists only the named arrays
of floating-point numbers are read.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import FileFormatError, near_names
from calib.se3 import FloatArray
from posedesign.csv_tables import LONGEST_SHOWN
from posedesign.files import read_bytes_bounded
from posedesign.pairs_checks import Place, check_lengths, transforms_from_matrices
from posedesign.pairs_forms import METRES, Poses

LARGEST_MAT_BYTES = 50_000_000
"""As stored, and again as unfolded: 390,000 transforms."""

_MAGIC = b"MATLAB 5.0 MAT-file"
_HDF5 = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")
_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_ORDER = {b"IM": "<", b"MI": ">"}
_NUMBERS = ("double", "single")

_DAMAGE = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    Warning,
)
"""What scipy raises on files whose inner lengths, types or names are wrong."""


@dataclass(frozen=True)
class MatFile:
    """A MATLAB file that was looked into, but not read.

    Attributes
    ----------
    path : Path
    data : bytes
        The file, unfolded.
    shapes : mapping of str to str
        Every variable, and what it is in words.
    stacks : tuple of str
        Those that are 4x4xN numbers.
    """

    path: Path
    data: bytes
    shapes: Mapping[str, str]
    stacks: tuple[str, ...]

    def poses(self, name: str, unit: str, *, trust_units: bool) -> Poses:
        """Transforms of a variable.

        Raises
        ------
        FileFormatError
            It is not there, no 4x4xN numbers, or some are no rigid transforms.
        """
        T = self._array(name)
        place = Place(self.path, variable=name)
        T[:, :3, 3] *= METRES[unit]
        T, note = transforms_from_matrices(T, place)
        if not trust_units:
            other = "m" if unit == "mm" else "mm"
            check_lengths(place, T[:, :3, 3], unit, f"say --unit {other}")
        notes = (f"{self.path}, {name}: {note}",) if note else ()
        return Poses(T, place, (), notes, "matrix", T[:, :3, :3].reshape(-1, 9))

    def _array(self, name: str) -> FloatArray:
        if name not in self.shapes:
            raise FileFormatError(
                f"there is no variable {name[:LONGEST_SHOWN]!r}",
                path=self.path,
                hint=near_names(name, self.stacks or self.shapes),
                value=name,
            )
        if name not in self.stacks:
            raise FileFormatError(
                f"is {self.shapes[name]}, not 4x4xN double",
                path=self.path,
                key=name,
                hint="stack the transforms along the third dimension: cat(3, T{:})",
                value=self.shapes[name],
            )
        from scipy.io import loadmat  # here: what reads no such file shall not wait for it

        stream: Any = io.BytesIO(self.data)  # which its stubs do not know it takes
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = loadmat(stream, variable_names=[name])[name]
        except (*_DAMAGE, zlib.error) as error:
            raise _damaged(self.path) from error
        if np.iscomplexobj(found) or found.shape[:2] != (4, 4) or found.ndim != 3:
            raise FileFormatError(
                "is no array of real numbers", path=self.path, key=name, hint="take real(..) of it"
            )
        return np.ascontiguousarray(np.moveaxis(found, -1, 0), dtype=float)


def open_mat(path: Path) -> MatFile:
    """Look into a MATLAB file.

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
    unfolded = _unfolded(path, data)
    from scipy.io import whosmat

    stream: Any = io.BytesIO(unfolded)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            listed = whosmat(stream)
    except (*_DAMAGE, zlib.error) as error:
        raise _damaged(path) from error
    shapes = {name: "x".join(str(n) for n in shape) + f" {kind}" for name, shape, kind in listed}
    stacks = tuple(
        name
        for name, shape, kind in listed
        if kind in _NUMBERS and len(shape) == 3 and shape[:2] == (4, 4) and shape[2] > 0
    )
    return MatFile(path, unfolded, shapes, stacks)


def pick_two(file: MatFile, variables: Sequence[str]) -> tuple[str, str]:
    """The variables that are A and B: those that were named, or ``A`` and ``B``.

    Raises
    ------
    FileFormatError
        Which is which cannot be known.
    """
    if variables:
        return variables[0], variables[1]
    if "A" in file.stacks and "B" in file.stacks:
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
    if len(file.stacks) == 1:
        return file.stacks[0]
    raise FileFormatError(
        f"does not say which of its variables to take ({_listed(file)})",
        path=file.path,
        hint="name that of A, then that of B, with --variables NAME,NAME",
    )


def _listed(file: MatFile) -> str:
    if not file.shapes:
        return "it is empty"
    shown = [f"{name[:LONGEST_SHOWN]}: {what}" for name, what in list(file.shapes.items())[:8]]
    more = len(file.shapes) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _unfolded(path: Path, data: bytes) -> bytes:
    """The file with its compressed variables decompressed, up to a size."""
    order = _ORDER.get(data[_HEADER - 2 : _HEADER])
    if order is None:
        raise _damaged(path)
    parts, room, at = [data[:_HEADER]], LARGEST_MAT_BYTES, _HEADER
    while at < len(data):
        if len(data) < at + 8:
            raise _damaged(path)
        kind, size = struct.unpack(order + "II", data[at : at + 8])
        stored = data[at + 8 : at + 8 + size]
        if kind not in (_MATRIX, _COMPRESSED) or len(stored) < size:
            raise _damaged(path)
        part = data[at : at + 8 + size]
        if kind == _COMPRESSED:
            inflate = zlib.decompressobj()
            try:
                part = inflate.decompress(stored, room + 1)
            except zlib.error as error:
                raise _damaged(path) from error
        room -= len(part)
        if room < 0:
            raise FileFormatError(
                f"unfolds to more than {LARGEST_MAT_BYTES / 1e6:g} MB",
                path=path,
                hint="save the two variables alone",
            )
        parts.append(part)
        at += 8 + size
    return b"".join(parts)


def _damaged(path: Path) -> FileFormatError:
    return FileFormatError(
        "is damaged or cut off", path=path, hint="save it again with save('file.mat', .., '-v7')"
    )
