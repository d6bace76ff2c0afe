"""Arrays of numbers out of MATLAB files of version 5 to 7, and of nothing else in them.

The level 5 format of "MAT-File Format" (The MathWorks), as far as arrays of real numbers go:
``scipy.io.loadmat`` reads all of it, but crashes the interpreter on some damaged files. A few
compressed bytes can unfold to gigabytes, so unfolding has a limit.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.files import read_bytes_bounded

LARGEST_MAT_BYTES = 50_000_000
"""As stored, and again as unfolded: 390,000 transforms."""

NUMBERS = ("double", "single")
"""Kinds of arrays that transforms can be."""

WHOLE_NUMBERS = tuple(f"{sign}int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "u"))
"""Kinds that they cannot be, however their numbers are stacked."""

_MAGIC = b"MATLAB 5.0 MAT-file"
_HDF5 = (b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")
_HEADER = 128
_TAG = 8
_ORDERS = {b"IM": "<", b"MI": ">"}
_MATRIX, _COMPRESSED, _NAME, _DIMENSIONS, _FLAGS = 14, 15, 1, 5, 6
_COMPLEX = 0x0800
_LARGEST_RANK = 32

_CLASSES: Mapping[int, str] = MappingProxyType(
    {
        1: "cell",
        2: "struct",
        3: "object",
        4: "char",
        5: "sparse",
        6: "double",
        7: "single",
        8: "int8",
        9: "uint8",
        10: "int16",
        11: "uint16",
        12: "int32",
        13: "uint32",
        14: "int64",
        15: "uint64",
        16: "function",
        17: "object",
    }
)
"""Names of the array classes, by their number."""

_STORED: Mapping[int, str] = MappingProxyType(
    {
        1: "i1",
        2: "u1",
        3: "i2",
        4: "u2",
        5: "i4",
        6: "u4",
        7: "f4",
        9: "f8",
        12: "i8",
        13: "u8",
    }
)
"""How numbers are stored: MATLAB packs doubles that are small integers as such."""


@dataclass(frozen=True)
class Variable:
    """An array in a MATLAB file, not read yet.

    Attributes
    ----------
    kind : str
        Its class: double, cell, ...
    shape : tuple of int
    is_complex : bool
    order : {"<", ">"}
        Order of bytes.
    body : bytes
        What follows its name.
    """

    kind: str
    shape: tuple[int, ...]
    is_complex: bool
    order: str
    body: bytes

    @property
    def described(self) -> str:
        """In words, say ``4x4x88 double``."""
        sizes = "x".join(str(n) for n in self.shape)
        return f"{sizes} {'complex ' if self.is_complex else ''}{self.kind}".strip()


class Damaged(Exception):
    """Lengths, types or names inside that cannot be."""


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
        return _listed(path, data)
    except Damaged as error:
        raise damaged(path) from error


def real_array(path: Path, variable: Variable) -> FloatArray:
    """The numbers of a variable of a kind of :data:`NUMBERS`, in its shape.

    Raises
    ------
    FileFormatError
        The file is damaged.
    """
    try:
        kind, stored, _ = _element(variable.body, 0, variable.order)
        if kind not in _STORED:
            raise Damaged
        dtype = np.dtype(variable.order + _STORED[kind])
        if len(stored) != dtype.itemsize * math.prod(variable.shape):
            raise Damaged
    except Damaged as error:
        raise damaged(path) from error
    numbers = np.frombuffer(stored, dtype).astype(float)
    return numbers.reshape(variable.shape, order="F")


def damaged(path: Path) -> FileFormatError:
    """The error of a file whose inner lengths, types or names cannot be."""
    return FileFormatError(
        "is damaged or cut off", path=path, hint="save it again with save('file.mat', .., '-v7')"
    )


def _listed(path: Path, data: bytes) -> dict[str, Variable]:
    order = _ORDERS.get(data[_HEADER - 2 : _HEADER])
    if order is None:
        raise Damaged
    found: dict[str, Variable] = {}
    room, at = LARGEST_MAT_BYTES, _HEADER
    while at < len(data):
        # no padding here: compressed variables have any length
        kind, size = _tag(data, at, order)
        stored = data[at + _TAG : at + _TAG + size]
        if kind not in (_MATRIX, _COMPRESSED) or len(stored) < size:
            raise Damaged
        at += _TAG + size
        if kind == _COMPRESSED:
            stored = _unfolded(path, stored, room, order)
        room -= len(stored)
        name, variable = _variable(stored, order)
        if name in found:
            raise Damaged
        if name:  # MATLAB keeps what its objects refer to in one without a name
            found[name] = variable
    return found


def _unfolded(path: Path, stored: bytes, room: int, order: str) -> bytes:
    """What a compressed variable holds, without its tag."""
    try:
        part = zlib.decompressobj().decompress(stored, max(room, 0) + 1)
    except zlib.error as error:
        raise Damaged from error
    if len(part) > room:
        raise FileFormatError(
            f"unfolds to more than {LARGEST_MAT_BYTES / 1e6:g} MB",
            path=path,
            hint="save the two variables alone",
        )
    kind, size = _tag(part, 0, order)
    if kind != _MATRIX or len(part) < _TAG + size:
        raise Damaged
    return part[_TAG : _TAG + size]


def _variable(body: bytes, order: str) -> tuple[str, Variable]:
    """Name and array of what stands in the element of a matrix."""
    kind, flags, at = _element(body, 0, order)
    if kind != _FLAGS or len(flags) != 8:
        raise Damaged
    (flag,) = struct.unpack(order + "I", flags[:4])
    kind, first, at = _element(body, at, order)
    shape: tuple[int, ...] = ()
    if kind == _DIMENSIONS:
        if len(first) % 4 or len(first) > 4 * _LARGEST_RANK:
            raise Damaged
        shape = struct.unpack(f"{order}{len(first) // 4}i", first)
        if any(size < 0 for size in shape):
            raise Damaged
        kind, first, at = _element(body, at, order)
    if kind != _NAME:  # objects of classes have no dimensions before their name
        raise Damaged
    try:
        name = first.decode("ascii")
    except UnicodeDecodeError as error:
        raise Damaged from error
    described = _CLASSES.get(flag & 0xFF, "unknown")
    return name, Variable(described, shape, bool(flag & _COMPLEX), order, body[at:])


def _element(data: bytes, at: int, order: str) -> tuple[int, bytes, int]:
    """Type and bytes of an element, and where the next one begins: on a multiple of eight."""
    kind, size = _tag(data, at, order)
    if kind >> 16:  # four bytes or fewer stand in the tag itself
        size, kind = kind >> 16, kind & 0xFFFF
        if size > 4:
            raise Damaged
        return kind, data[at + 4 : at + 4 + size], at + _TAG
    stored = data[at + _TAG : at + _TAG + size]
    if len(stored) < size:
        raise Damaged
    return kind, stored, at + _TAG + size + -size % 8


def _tag(data: bytes, at: int, order: str) -> tuple[int, int]:
    if len(data) < at + _TAG:
        raise Damaged
    kind, size = struct.unpack(order + "II", data[at : at + _TAG])
    return kind, size
