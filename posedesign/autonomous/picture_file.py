"""Pictures from files that may come from anywhere: structure and size are checked, then decoded.

PNG, PGM, BMP, JPEG and TIFF, in the forms that cameras write. A few bytes can claim a picture that
fills the memory, or keep a decoder at work for hours, and a picture that is still being copied
looks like one that is damaged. So the file is first walked through from its header to its end
without decoding anything; only what is whole, of a known form and of a size that cameras have goes
to OpenCV. Which format it is its first bytes say, not its name.

Formats: PNG (ISO/IEC 15948), JPEG (ITU-T T.81 annex B), TIFF 6.0, BMP as Windows 3, PGM of Netpbm.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import FileFormatError
from posedesign.files import read_bytes_bounded

if TYPE_CHECKING:
    from calib.vision.camera.rendering import GreyImage

MOST_PIXELS = 50_000_000
"""Cameras that a flange carries have 1 to 20 million, the largest for inspection about 45."""

LARGEST_PICTURE_BYTES = 4 * MOST_PIXELS
"""The largest picture, without compression and with a byte for transparency."""

ENDINGS = (".png", ".pgm", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
"""Of files that hold such pictures; the one that loses details for its size last."""

_MOST_SCANS = 4
"""Of a baseline JPEG: one a component. Each costs as much as a whole picture to decode."""

_MOST_PARTS = 50_000
"""Chunks of a PNG or segments of a JPEG: a large picture has some thousand."""

_WHOLE_PICTURE = 0xFFFFFFFF
"""Rows of a strip in a TIFF that has only one."""


class _Unusable(ValueError):
    """Why a file is no such picture, in words that follow its name."""


def read_picture(path: Path | str) -> GreyImage:
    """Read a picture as grey levels.

    Colours become grey as OpenCV weighs them. Pixels stay where the sensor had them: a note in the
    file that it was held upright or on its side is not followed, since an arm holds its camera in
    every way.

    Pictures of 16 bits are refused and not scaled: files do not say which 10, 12 or 16 of the bits
    the camera filled, so that the same scene would come out in another brightness.

    Damage to the pixels themselves a PNG shows by its checksums. JPEG and TIFF have none: bytes of
    them that were changed, not cut off, may come out as other pixels.

    Parameters
    ----------
    path : Path or str
        A file of 8 bits a colour: PNG without animation, PGM (binary, of 255 levels), BMP without
        compression, baseline JPEG, or TIFF in strips, without compression or with one that loses
        nothing.

    Returns
    -------
    ndarray of uint8 (height, width)

    Raises
    ------
    FileFormatError
        There is no such file, it is too large, not a picture of these kinds, or not whole.
    """
    data = read_bytes_bounded(path, most_bytes=LARGEST_PICTURE_BYTES)
    try:
        width, height = _size(data)
        if not 0 < width * height <= MOST_PIXELS:
            raise _Unusable(f"claims {width} by {height} pixels")
        return _decoded(_png_pixels(data) if data.startswith(_PNG) else data, (height, width))
    except _Unusable as error:
        raise FileFormatError(
            str(error),
            path=path,
            hint=f"save it whole, as PNG of 8 bits, at most {MOST_PIXELS / 1e6:g} million pixels",
        ) from error


def _size(data: bytes) -> tuple[int, int]:
    """Width and height that a whole file claims."""
    walk = next((walk for start, walk in _FORMATS.items() if data.startswith(start)), None)
    if walk is None:
        raise _Unusable("is no PNG, PGM, BMP, JPEG or TIFF" if data else "is empty")
    try:
        return walk(data)
    except (struct.error, IndexError) as error:
        raise _Unusable("is cut off") from error


def _decoded(data: bytes, shape: tuple[int, int]) -> GreyImage:
    import cv2

    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as error:
        raise _Unusable("cannot be decoded") from error
    if picture is None or picture.shape != shape or picture.dtype != np.uint8:
        raise _Unusable("cannot be decoded")
    return np.asarray(picture, dtype=np.uint8)


def _eight_bits(bits: int) -> None:
    if bits != 8:
        raise _Unusable(f"has {bits} bits a colour, not 8")


_PNG = b"\x89PNG\r\n\x1a\n"


def _png(data: bytes) -> tuple[int, int]:
    """Walk through the chunks, each with its checksum, to the last."""
    size = None
    for kind, at, length in _png_chunks(data):
        if size is None:
            if kind != b"IHDR" or length != 13:
                raise _Unusable("is no PNG: it does not begin with its header")
            width, height, bits = struct.unpack_from(">IIB", data, at + 8)
            _eight_bits(bits)
            size = width, height
        elif kind == b"IHDR" or kind == b"acTL":
            raise _Unusable("holds several pictures")
    if size is None:
        raise _Unusable("is no PNG: it does not begin with its header")
    return size


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind of each chunk to the last, where it starts, and the length of what it holds."""
    at = len(_PNG)
    for _ in range(_MOST_PARTS):
        length, kind = struct.unpack_from(">I4s", data, at)
        (checksum,) = struct.unpack_from(">I", data, at + 8 + length)
        if checksum != zlib.crc32(memoryview(data)[at + 4 : at + 8 + length]):
            raise _Unusable("is damaged: a checksum is wrong")
        yield kind, at, length
        if kind == b"IEND":
            return
        at += 12 + length
    raise _Unusable(f"has more than {_MOST_PARTS} parts")


def _png_pixels(data: bytes) -> bytes:
    """The same PNG with header, colours and pixels alone.

    Notes and profiles may be compressed: seven megabytes of them kept a decoder at work for more
    than a minute. No pixel depends on them.
    """
    chunks = [(at, 12 + length) for kind, at, length in _png_chunks(data) if kind in _PNG_NEEDED]
    return _PNG + b"".join(data[at : at + whole] for at, whole in chunks)


_PNG_NEEDED = (b"IHDR", b"PLTE", b"IDAT", b"IEND")

_PGM_HEADER = re.compile(
    rb"P5" + 3 * rb"(?:[ \t\r\n]|#[^\r\n]{0,200}[\r\n]){1,20}([0-9]{1,9})" + rb"[ \t\r\n]"
)


def _pgm(data: bytes) -> tuple[int, int]:
    header = _PGM_HEADER.match(data[:4096])
    if header is None:
        raise _Unusable("is no binary PGM: its header cannot be read")
    width, height, levels = (int(number) for number in header.groups())
    if levels != 255:
        raise _Unusable(f"has levels up to {levels}, not 255")
    _whole(data, header.end() + width * height)
    return width, height


def _bmp(data: bytes) -> tuple[int, int]:
    start, header, width, height = struct.unpack_from("<10xIIii", data)
    if header not in (40, 108, 124):
        raise _Unusable("is a BMP of another kind than that of Windows")
    planes, bits, compression = struct.unpack_from("<HHI", data, 26)
    if planes != 1 or bits not in (8, 24, 32) or compression != 0:
        raise _Unusable("is a BMP with compression, or not of 8 bits a colour")
    (colours,) = struct.unpack_from("<I", data, 46)
    palette = 4 * (colours or 256) if bits == 8 else 0
    if colours > 256 or start < 14 + header + palette:
        raise _Unusable("is damaged: its colours reach into the pixels")
    _whole(data, start + (width * bits + 31) // 32 * 4 * abs(height))
    return width, abs(height)


def _whole(data: bytes, length: int) -> None:
    if len(data) < length:
        raise _Unusable("is cut off")


_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_BASELINE = (0xC0, 0xC1)
_JPEG_MARKER = re.compile(rb"\xff++[^\x00]", re.DOTALL)
_JPEG_AFTER_PIXELS = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]", re.DOTALL)
"""The marker behind coded pixels: in them 0xff 0x00 is a value, 0xff 0xd0 to 0xd7 a restart."""


def _jpeg(data: bytes) -> tuple[int, int]:
    """Walk through the segments and over the coded pixels to the mark of the end."""
    at, size, scans = 2, None, 0
    for _ in range(_MOST_PARTS):
        marker = _JPEG_AFTER_PIXELS.search(data, at) if scans else _JPEG_MARKER.match(data, at)
        if marker is None:
            raise _Unusable("is cut off, or no JPEG")
        kind, at = marker[0][-1], marker.end()
        if kind == 0xD9:
            if size is None or not 1 <= scans <= _MOST_SCANS:
                raise _Unusable(f"is a JPEG of {scans} scans")
            return size
        (length,) = struct.unpack_from(">H", data, at)
        if kind in _JPEG_FRAMES:
            bits, height, width, colours = struct.unpack_from(">BHHB", data, at + 2)
            if size is not None or kind not in _JPEG_BASELINE or colours not in (1, 3):
                raise _Unusable("is no baseline JPEG in grey or colours")
            _eight_bits(bits)
            size = width, height
        elif kind == 0xDA:
            scans += 1
        at += length
    raise _Unusable(f"has more than {_MOST_PARTS} parts")


_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_COMPRESSION, _TIFF_INK = 256, 257, 258, 259, 262
_TIFF_STRIPS, _TIFF_TURNED, _TIFF_COLOURS, _TIFF_ROWS, _TIFF_LENGTHS = 273, 274, 277, 278, 279
_TIFF_PLANES, _TIFF_TILES, _TIFF_SIGNS = 284, 322, 339
_TIFF_KNOWN = frozenset((*range(256, 260), 262, 273, 274, 277, 278, 279, 284, 322, 339))
_TIFF_MOST_TAGS, _TIFF_MOST_STRIPS = 500, 100_000

_TIFF_LOSSLESS = (1, 5, 8, 32773, 32946)
"""None, LZW, deflate, packed bits, and deflate by its old number."""


def _tiff(data: bytes) -> tuple[int, int]:
    """Read the directory of the picture, and whether its strips are all there."""
    order = "<" if data[:2] == b"II" else ">"
    tags = _tiff_tags(data, order)

    def one(tag: int, usual: int) -> int:
        return tags.get(tag, (usual,))[0]

    width, height, colours = one(_TIFF_WIDTH, 0), one(_TIFF_HEIGHT, 0), one(_TIFF_COLOURS, 1)
    for bits in tags.get(_TIFF_BITS, (1,)):
        _eight_bits(bits)
    grey_or_colours = (one(_TIFF_INK, 0), colours) in ((1, 1), (2, 3), (2, 4))
    rows = one(_TIFF_ROWS, _WHOLE_PICTURE)
    strips, lengths = tags.get(_TIFF_STRIPS, ()), tags.get(_TIFF_LENGTHS, ())
    if (
        not grey_or_colours
        or one(_TIFF_COMPRESSION, 1) not in _TIFF_LOSSLESS
        or one(_TIFF_PLANES, 1) != 1
        or one(_TIFF_TURNED, 1) != 1
        or one(_TIFF_SIGNS, 1) != 1
        or _TIFF_TILES in tags
        or not (0 < rows <= height or rows == _WHOLE_PICTURE)
        or not strips
        or len(strips) != len(lengths)
    ):
        raise _Unusable("is a TIFF of another kind than upright strips in grey or colours")
    _whole(data, max(at + length for at, length in zip(strips, lengths, strict=True)))
    return width, height


def _tiff_tags(data: bytes, order: str) -> dict[int, tuple[int, ...]]:
    """Whole numbers of the known tags in the one directory of a TIFF."""
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    if count > _TIFF_MOST_TAGS:
        raise _Unusable(f"is a TIFF of {count} tags")
    if struct.unpack_from(order + "I", data, at + 2 + 12 * count) != (0,):
        raise _Unusable("holds several pictures")
    tags: dict[int, tuple[int, ...]] = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, values = struct.unpack_from(order + "HHI", data, entry)
        if tag not in _TIFF_KNOWN:
            continue
        letter = {3: "H", 4: "I"}.get(kind)
        if letter is None or not 1 <= values <= _TIFF_MOST_STRIPS or tag in tags:
            raise _Unusable(f"is a TIFF whose tag {tag} cannot be read")
        form = f"{order}{values}{letter}"
        place = entry + 8
        if struct.calcsize(form) > 4:
            (place,) = struct.unpack_from(order + "I", data, place)
        tags[tag] = struct.unpack_from(form, data, place)
    return tags


_FORMATS: Mapping[bytes, Callable[[bytes], tuple[int, int]]] = {
    _PNG: _png,
    b"P5": _pgm,
    b"BM": _bmp,
    b"\xff\xd8": _jpeg,
    b"II*\0": _tiff,
    b"MM\0*": _tiff,
}
