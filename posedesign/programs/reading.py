"""What the readers of all dialects share: files are hostile until read."""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.files import read_bytes_bounded
from posedesign.programs.configurations import Configuration

MOST_BYTES = 20_000_000
"""Largest program file read: the largest that a controller holds is far smaller, and 10,000 poses
take a tenth of it."""

MOST_JOINT_DEG = 720.0  # no arm turns so far: a value beyond is a damaged file, or in another unit
MOST_POSITION_MM = 100_000.0  # no arm on any track reaches so far
EXTERNAL_AT_REST = 0.01
"""Largest difference of an external axis at rest [mm or deg]: what is shown of it flickers."""

C = TypeVar("C", bound=Configuration)

MOST_EXTERNAL = 1e6
_ENDS = re.compile(r"(?<!\r)\r++(?=\n|\Z)")
_NUMBER = re.compile(r"[-+]?(?:\d{1,9}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][-+]?\d{1,3})?", re.ASCII)
"""``float()`` would take more: 1_0, nan, infinity, digits of other scripts."""


def refuse(
    message: str, path: Path | str, row: int | None = None, hint: str = "save the program again"
) -> NoReturn:
    """Raise FileFormatError for a line of a file."""
    raise FileFormatError(message, path=path, row=row, hint=hint)


class NoPositionsError(FileFormatError):
    """A program that is a right one, and has its positions in another file or nowhere."""


def no_positions(
    path: Path | str, hint: str, reason: str = "holds no positions", row: int | None = None
) -> NoReturn:
    """Raise NoPositionsError for a whole file."""
    raise NoPositionsError(reason, path=path, row=row, hint=hint)


def read_program_bytes(path: Path | str) -> bytes:
    """Content of a program file of at most 20 MB.

    Editors put a byte-order mark in front, DOS its mark of the end (0x1a) behind: both are no part
    of the program. One that is packed by gzip is unpacked.

    Raises FileFormatError: the file is missing, cannot be opened, or is larger.
    """
    data = unpacked(read_bytes_bounded(path, most_bytes=MOST_BYTES))
    if data is None:
        refuse("is packed, and damaged or larger than 20 MB", path, hint="copy it again")
    data = data.removeprefix(b"\xef\xbb\xbf")
    text = data.rstrip()
    return text.rstrip(b"\x1a") if text.endswith(b"\x1a") else data


_GZIP = 31  # what zlib calls a gzip file


def unpacked(data: bytes) -> bytes | None:
    """Content of a file that may be packed by gzip; None: it is damaged, or larger than 20 MB."""
    if not data.startswith(b"\x1f\x8b"):
        return data
    file = zlib.decompressobj(_GZIP)
    try:
        found = file.decompress(data, MOST_BYTES + 1)
    except zlib.error:
        return None
    whole = file.eof and not file.unused_data.strip(b"\0")
    return found if whole and len(found) <= MOST_BYTES else None


def text_of(data: bytes, path: Path | str, hint: str = "", *, strict: bool = False) -> str:
    """Text of a file, after checking that it is one.

    Comments of people may have letters of any language: bytes that are not ASCII are one character
    each, whatever the controller's code page. Where it is ``strict``, lines end in LF or CR LF, of
    which LF stays, and another CR is refused.

    Raises FileFormatError: naming the first byte that is not, and its line.
    """
    if strict:
        data = data.replace(b"\r\n", b"\n")
    data = data.removeprefix(b"\xef\xbb\xbf")
    bad = re.search(rb"[^\t\n -~\x80-\xff]" if strict else rb"[^\t\r\n -~\x80-\xff]", data)
    if bad:
        refuse(
            f"holds the byte 0x{bad[0][0]:02x}, which is not text",
            path,
            data.count(b"\n", 0, bad.start()) + 1,
            hint,
        )
    return data.decode("latin-1")


MOST_LINES = 1_000_000  # of a file that is read line by line: 10,000 poses take a hundredth of them


def text_lines(data: bytes, path: Path | str, hint: str = "") -> list[str]:
    """Lines of a file, without their ends; see `text_of`."""
    if data.count(b"\n") > MOST_LINES:
        refuse(f"has more than {MOST_LINES} lines", path, hint="is it the right file?")
    # one list of lines, not two: a file may be nothing but line ends
    return _ENDS.sub("", text_of(data, path, hint)).split("\n")


def number(text: str, what: str, path: Path | str, row: int, most: float, unit: str = "") -> float:
    """A finite decimal number of a file, within ``+-most``.

    Raises FileFormatError: saying what is not such a number.
    """
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(value):
        refuse(f"{what} is {text[:30]!r}, not a number", path, row)
    if abs(value) > most:
        reason = f"{what} is {text[:30]} {unit}".rstrip() + f", beyond +-{most:g} {unit}".rstrip()
        refuse(reason, path, row, "is it in another unit?")
    return value


def joint_deg(text: str, what: str, path: Path | str, row: int) -> float:
    """A joint value of a file [deg]."""
    return number(text, what, path, row, MOST_JOINT_DEG, "deg")


def millimetres(text: str, what: str, path: Path | str, row: int) -> float:
    """A coordinate of a file [mm]."""
    return number(text, what, path, row, MOST_POSITION_MM, "mm")


def pose_values(
    texts: Sequence[str], names: Sequence[str], label: str, path: Path | str, row: int
) -> list[float]:
    """Coordinates [mm] and angles [deg] of a pose, by the names of the six."""
    return [
        (millimetres if k < 3 else joint_deg)(text, f"{label}: {name}", path, row)
        for k, (text, name) in enumerate(zip(texts, names, strict=True))
    ]


def poses_of(values: ArrayLike) -> FloatArray:
    """Transforms ``(N, 4, 4)`` [m] of x, y, z [mm] and angles about the fixed X, Y, Z [deg]."""
    rows = np.reshape(np.asarray(values, dtype=float), (-1, 6))
    return transform(rotation_from_wpr(np.deg2rad(rows[:, 3:])), rows[:, :3] / 1e3)


def configuration_in(kind: type[C], words: str, label: str, path: Path | str, row: int) -> C:
    """The arm position that the words of a maker mean; FileFormatError where they are not his."""
    try:
        return kind.parse(words)
    except InputError as error:
        refuse(f"{label}: {error.message}", path, row, error.hint)


def carried_off(
    values: Iterable[tuple[str, str, str, int]], path: Path | str
) -> dict[str, dict[int, FileFormatError]]:
    """Positions that external axes have left their places in: they may carry the arm's base.

    By label, and by index of the axis, from 0 on. ``values``: label of the position, name of the
    axis, its value [mm or deg] as text, and the line: of every position in order, axes that are not
    there left out. ``path``: for the messages. Left is a place by more than 0.01; raises
    FileFormatError for no number.
    """
    found: dict[str, dict[int, FileFormatError]] = {}
    counts: Counter[str] = Counter()
    first: dict[str, tuple[str, float]] = {}
    for label, axis, text, row in values:
        k, counts[label] = counts[label], counts[label] + 1
        value = number(text, f"{label}: {axis}", path, row, MOST_EXTERNAL)
        there, rest = first.setdefault(axis, (label, value))
        if abs(value - rest) > EXTERNAL_AT_REST:
            reason = f"{label}: {axis} differs from that of {there}"
            hint = "measure with the external axes at rest, or describe the slide in the URDF"
            error = FileFormatError(reason, path=path, row=row, hint=hint)
            found.setdefault(label, {})[k] = error
    return found
