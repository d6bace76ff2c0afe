"""Pictures from files that may come from anywhere: whole, of a known kind and size, then decoded.

PNG, PGM, BMP, JPEG and TIFF, in the forms that cameras write. Pillow reads them; its first bytes
say which format a file has, not its name. A few bytes can claim a picture that fills the memory,
or keep a decoder at work for hours, and a picture that is still being copied looks like one that
is damaged. So what Pillow has read of the header decides before any pixel is decoded.
"""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from calib.errors import FileFormatError, InputError
from posedesign.files.safe import read_bytes_bounded

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

    from calib.vision.camera.rendering import GreyImage

T = TypeVar("T")

MOST_PIXELS = 50_000_000
"""Cameras that a flange carries have 1 to 20 million, the largest for inspection about 45."""

LARGEST_PICTURE_BYTES = 4 * MOST_PIXELS
"""The largest picture, without compression and with a byte for transparency."""

ENDINGS = (".png", ".pgm", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg")
"""Of files that hold such pictures; the one that loses details for its size last."""

SMALL_PX = 480
"""Longer side of a picture made small: points a few pixels apart are told apart, and a hundred of
them take little memory."""

_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")

_EIGHT_BITS = ("L", "LA", "P", "RGB", "RGBA", "RGBX", "BGR", "BGRA", "BGRX")
"""How Pillow calls a byte for each colour of a pixel, in the order of the file."""

_SIXTEEN_BITS = ("I;16", "I;16B", "I;16N")
"""The same of two bytes for the grey level of a pixel."""

_DECODERS = ("raw", "zip", "jpeg", "libtiff")

_TIFF_LOSSLESS = ("raw", "packbits", "tiff_lzw", "tiff_deflate", "tiff_adobe_deflate")
_TIFF_TURNED, _TIFF_TILES, _TIFF_SIGNS = 274, 322, 339

_MOST_SCANS = 8
"""Of a baseline JPEG: one a component, and as many of a thumbnail. Each of a picture without
details costs little in the file and as much as a whole picture to decode."""


class _Unusable(ValueError):
    """Why a file is no such picture, in words that follow its name."""


@dataclass(frozen=True)
class PictureHead:
    """What a file says of its picture, before it is decoded."""

    size_px: tuple[int, int]  # width and height, as the sensor had them
    digest: str  # of all bytes of the file: those of the same picture are the same
    is_turned: bool  # whether a note in it asks for the picture to be shown turned or mirrored
    taken: str
    """When it was taken, by its EXIF: text that sorts by time; empty where it does not say."""


def read_picture(path: Path | str) -> GreyImage:
    """Read a picture as grey levels, of which each means the same brightness in all pictures.

    Colours become grey by their brightness (ITU-R BT.601). Pixels stay where the sensor had them: a
    note in the file that it was held upright or on its side is not followed, since an arm holds its
    camera in every way.

    Pictures of 16 bits are refused and not scaled: files do not say which 10, 12 or 16 of the bits
    the camera filled, so that the same scene would come out in another brightness. See
    :func:`read_grey`.

    Damage to the pixels themselves a PNG shows by its checksums. JPEG and TIFF have none: bytes of
    them that were changed, not cut off, may come out as other pixels.

    ``path``: a file of 8 bits a colour: PNG without animation, PGM (binary, of 255 levels), BMP
    without compression, baseline JPEG, or TIFF in strips, without compression or with one that
    loses nothing. Where it has a channel for transparency, it is opaque everywhere. Raises
    FileFormatError: there is no such file, it is too large, not a picture of these kinds, or not
    whole.
    """
    return _read(path, lambda data: _decoded(data, _EIGHT_BITS))


def read_grey(path: Path | str) -> GreyImage:
    """Read a picture whose edges count and not its brightness: as `read_picture`, or of 16 bits.

    Grey levels of 16 bits (PNG, PGM of 65535 levels, TIFF) are shifted to the right by as many bits
    as the brightest pixel has above 8. So a camera of 12 bits keeps its upper 8, whichever end of
    the 16 it fills; a dark picture comes out brighter, by a power of two.

    Raises FileFormatError: as of `read_picture`.
    """
    return _read(path, lambda data: _decoded(data, _EIGHT_BITS + _SIXTEEN_BITS))


def small_picture(picture: GreyImage) -> GreyImage:
    """Return a picture made smaller, pixels averaged, to be looked at among many."""
    import cv2

    height, width = picture.shape
    part = min(1.0, SMALL_PX / max(height, width))
    size = max(1, round(part * width)), max(1, round(part * height))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def decode_grey(data: bytes) -> GreyImage:
    """Return the picture of a file's bytes, as `read_grey` reads it.

    Raises InputError: as `read_picture` says, about the bytes.
    """
    try:
        return _strictly(lambda data: _decoded(data, _EIGHT_BITS + _SIXTEEN_BITS), data)
    except _Unusable as error:
        raise InputError(str(error), hint="record it as JPEG or PNG of 8 bits") from error


def read_head(path: Path | str) -> PictureHead:
    """Read what a file says of the picture that `read_grey` would read; FileFormatError likewise.

    The pixels are not decoded: damage to them shows when they are.
    """

    def head(data: bytes) -> PictureHead:
        picture = _opened(data, _EIGHT_BITS + _SIXTEEN_BITS)
        turned, taken = _exif_of(picture)
        return PictureHead(picture.size, hashlib.sha256(data).hexdigest(), turned, taken)

    return _read(path, head)


def _read(path: Path | str, read: Callable[[bytes], T]) -> T:
    """What is read of the bytes of a file; FileFormatError in one line for all that goes wrong."""
    data = read_bytes_bounded(path, most_bytes=LARGEST_PICTURE_BYTES)
    try:
        return _strictly(read, data)
    except _Unusable as error:
        raise FileFormatError(
            str(error),
            path=path,
            hint=f"save it whole, as PNG of 8 bits, at most {MOST_PIXELS / 1e6:g} million pixels",
        ) from error


def _strictly(read: Callable[[bytes], T], data: bytes) -> T:
    """What is read of bytes; _Unusable, in words on one line, for all that goes wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow reads on where it only warns
            return read(data)
    except Exception as error:  # its readers let anything through that their arithmetic raises
        why = str(error) if isinstance(error, _Unusable) else f"cannot be decoded: {error}"
        raise _Unusable(" ".join(why.split())) from error


def _decoded(data: bytes, orders: tuple[str, ...]) -> GreyImage:
    picture = _opened(data, orders)
    picture.draft("L", None)  # a JPEG holds the brightness itself
    picture.load()
    if picture.mode.startswith("I"):
        levels = np.asarray(picture)
        return np.asarray(levels >> max(int(levels.max()).bit_length() - 8, 0), dtype=np.uint8)
    if picture.mode in ("LA", "RGBA") and picture.getextrema()[-1] != (255, 255):
        raise _Unusable("is transparent in places, where its colours mean nothing")
    picture.info.pop("transparency", None)
    return np.asarray(picture.convert("L"), dtype=np.uint8)


def _opened(data: bytes, orders: tuple[str, ...]) -> ImageFile:
    """A picture whose pixels, in one of these orders, can be decoded."""
    if data.count(b"iCCP") > 1:  # each may unfold to a megabyte; a PNG has one
        raise _Unusable("holds several colour profiles")
    try:
        picture = Image.open(io.BytesIO(data), formats=_FORMATS)
        picture.verify()
        picture = Image.open(io.BytesIO(data), formats=_FORMATS)  # what was verified is closed
    except UnidentifiedImageError as error:
        known = "is no PNG, PGM, BMP, JPEG or TIFF, or damaged in its header"
        raise _Unusable(known if data else "is empty") from error
    _check_header(picture, data, orders)
    return picture


_EXIF_TURNED, _EXIF_CHANGED, _EXIF_MORE = 274, 306, 34665
_EXIF_TAKEN, _EXIF_FRACTION = 36867, 37521


def _exif_of(picture: ImageFile) -> tuple[bool, str]:
    """Whether a picture is to be shown turned, and when it was taken."""
    if "exif" not in picture.info and not isinstance(picture, TiffImageFile):
        return False, ""  # Pillow would decode a PNG to look behind its pixels
    try:
        exif = picture.getexif()
        more = exif.get_ifd(_EXIF_MORE)
        taken = more.get(_EXIF_TAKEN) or exif.get(_EXIF_CHANGED) or ""
        fraction = more.get(_EXIF_FRACTION, "")
        return exif.get(_EXIF_TURNED, 1) not in (0, 1), f"{taken}.{fraction}" if taken else ""
    except Exception:  # as of the decoders: a note that cannot be read is none
        return False, ""


def _check_header(picture: ImageFile, data: bytes, orders: tuple[str, ...]) -> None:
    """Refuse what cameras do not write, before any pixel is decoded."""
    width, height = picture.size
    if not 0 < width * height <= MOST_PIXELS:
        raise _Unusable(f"claims {width} by {height} pixels")
    covered = 0
    for decoder, extents, _, args in picture.tile:
        order = args[0] if isinstance(args, tuple) else args
        if decoder not in _DECODERS or order not in orders:
            raise _Unusable(f"has pixels of the kind {decoder} {order}, not 8 bits a colour")
        left, top, right, bottom = extents or (0, 0, 0, 0)
        covered += (right - left) * (bottom - top)
    if covered != width * height:
        raise _Unusable("is cut off: it does not hold each pixel once")
    if picture.format in ("JPEG", "MPO") and (
        "progressive" in picture.info or data.count(b"\xff\xda") > _MOST_SCANS
    ):
        raise _Unusable("is no baseline JPEG, or of too many scans")
    if picture.format in ("PNG", "TIFF") and getattr(picture, "is_animated", False):
        raise _Unusable("holds several pictures")
    if isinstance(picture, TiffImageFile) and (
        picture.info["compression"] not in _TIFF_LOSSLESS
        or picture.tag_v2.get(_TIFF_TURNED, 1) != 1
        or set(picture.tag_v2.get(_TIFF_SIGNS, (1,))) != {1}
        or _TIFF_TILES in picture.tag_v2
    ):
        raise _Unusable("is a TIFF of another kind than upright strips in grey or colours")
