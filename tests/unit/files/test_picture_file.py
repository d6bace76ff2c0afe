"""Pictures from hostile files: exact pixels or one line that says why not; no bomb goes off."""

import struct
import zlib
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import ImageFile

from calib.errors import FileFormatError
from posedesign.files import pictures
from posedesign.files.pictures import ENDINGS, MOST_PIXELS, read_grey, read_head, read_picture

Picture = NDArray[np.uint8]
FORMATS = (".png", ".pgm", ".bmp", ".tif", ".jpg")
HUGE = 60_000


def scene(height: int = 24, width: int = 37, colours: int = 0) -> Picture:
    """A smooth scene, so that JPEG keeps it."""
    y, x = np.mgrid[:height, :width]
    levels = [20 + 5 * x + 2 * y, 200 - 3 * x, 40 + 6 * y]
    return np.dstack(levels[:colours]).astype(np.uint8) if colours else levels[0].astype(np.uint8)


@cache
def encoded(ending: str, colours: int = 0, *options: int) -> bytes:
    done, data = cv2.imencode(ending, scene(colours=colours), list(options))
    assert done
    return bytes(data)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def tiff(order: str, picture: Picture, changes: dict[int, tuple[int, int]] | None = None) -> bytes:
    """A TIFF in one strip, its directory before its pixels; ``changes`` to (kind, value) by tag."""
    height, width = picture.shape
    tags = {256: (3, width), 257: (3, height), 258: (3, 8), 259: (3, 1), 262: (3, 1)}
    tags |= {277: (3, 1), 278: (3, height), 279: (4, picture.size)} | (changes or {})
    tags = {273: (4, 8 + 2 + 12 * (len(tags) + (273 not in tags)) + 4)} | tags
    lines = b"".join(
        struct.pack(order + "HHI", tag, kind, 1)
        + (struct.pack(order + "HH", value, 0) if kind == 3 else struct.pack(order + "I", value))
        for tag, (kind, value) in sorted(tags.items())
    )
    start = b"II" if order == "<" else b"MM"
    head = start + struct.pack(order + "HI", 42, 8) + struct.pack(order + "H", len(tags))
    return head + lines + bytes(4) + picture.tobytes()


def read(data: bytes, folder: Path) -> Picture:
    path = folder / "picture"
    path.write_bytes(data)
    return read_picture(path)


def refusal(data: bytes, folder: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        read(data, folder)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value.message


@pytest.mark.parametrize("ending", FORMATS)
def test_grey_levels_are_those_that_were_saved(ending, tmp_path):
    found = read(encoded(ending), tmp_path)
    assert found.dtype == np.uint8
    assert found.shape == (24, 37)
    off = np.abs(found.astype(int) - scene())
    assert off.max() <= (2 if ending == ".jpg" else 0)
    assert ending in ENDINGS


@pytest.mark.parametrize("ending", [".png", ".bmp", ".tif"])
def test_colours_become_grey_by_their_brightness(ending, tmp_path):
    blue, green, red = np.moveaxis(scene(colours=3).astype(float), -1, 0)
    wanted = 0.114 * blue + 0.587 * green + 0.299 * red  # ITU-R BT.601
    found = read(encoded(ending, 3), tmp_path)
    assert np.abs(found - wanted).max() < 1.01  # the PNG decoder cuts fractions off


@pytest.mark.parametrize("order", "<>")
def test_tiffs_of_others(order, tmp_path):
    assert np.array_equal(read(tiff(order, scene()), tmp_path), scene())


def test_the_content_tells_the_format_and_not_the_name(tmp_path):
    path = tmp_path / "0001.jpg"
    path.write_bytes(encoded(".png"))
    assert np.array_equal(read_picture(path), scene())


def test_a_note_on_how_the_camera_was_held_is_not_followed(tmp_path):
    entry = struct.pack("<HHIHH", 0x0112, 3, 1, 6, 0)  # turned by a quarter
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4)
    data = encoded(".jpg")
    noted = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    turned = cv2.imdecode(np.frombuffer(noted, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert turned is not None
    assert turned.shape == (37, 24)  # OpenCV alone would turn it
    assert np.array_equal(read(noted, tmp_path), read(data, tmp_path))


@pytest.mark.parametrize("ending", [".png", ".pgm", ".tif"])
def test_sixteen_bits_are_refused(ending, tmp_path):
    done, data = cv2.imencode(ending, scene().astype(np.uint16) * 16)
    assert done
    assert "not 8" in (message := refusal(bytes(data), tmp_path)) or "not 255" in message


@pytest.mark.parametrize("ending", FORMATS)
def test_a_picture_that_is_cut_off_anywhere_is_refused(ending, tmp_path):
    """Only the mark of the end, or what fills the last row up, may be missing: no pixel is."""
    data = encoded(ending)
    for length in range(0, len(data) - 12, 1 + len(data) // 150):
        refusal(data[:length], tmp_path)
    whole = read(data, tmp_path)
    for length in range(len(data) - 12, len(data)):
        try:
            found = read(data[:length], tmp_path)
        except FileFormatError:
            continue
        assert np.array_equal(found, whole)


def test_pixels_of_a_tiff_that_are_missing(tmp_path):
    data = tiff("<", scene())
    assert "truncated" in refusal(data[:-1], tmp_path)


def twice(data: bytes, tag: int, other: int) -> bytes:
    """A TIFF with one tag called like another."""
    return data.replace(struct.pack("<HH", tag, 4), struct.pack("<HH", other, 4))


@cache
def bombs() -> dict[str, bytes]:
    """Small files that claim much: 60,000 x 60,000 pixels or as many as the format has."""
    header = struct.pack(">II", HUGE, HUGE) + encoded(".png")[24:29]
    jpeg = encoded(".jpg")
    frame = jpeg.index(b"\xff\xc0") + 5
    bmp = encoded(".bmp")
    scan = jpeg.index(b"\xff\xda")
    animated = chunk(b"acTL", struct.pack(">II", 100_000, 0))
    return {
        "png": encoded(".png")[:8] + chunk(b"IHDR", header) + encoded(".png")[33:],
        "png, animated": encoded(".png")[:33] + animated + encoded(".png")[33:],
        "pgm": b"P5 60000 60000 255\n" + bytes(1000),
        "bmp": bmp[:18] + struct.pack("<ii", HUGE, HUGE) + bmp[26:],
        "bmp, mirrored": bmp[:18] + struct.pack("<ii", -HUGE, -HUGE) + bmp[26:],
        "bmp, runs": bmp[:30] + struct.pack("<I", 1) + bmp[34:],
        "jpeg": jpeg[:frame] + struct.pack(">HH", HUGE, HUGE) + jpeg[frame + 4 :],
        "jpeg, progressive": encoded(".jpg", 0, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        "jpeg, scans": jpeg[:-2] + jpeg[scan:-2] * 1000 + jpeg[-2:],
        "tiff": tiff("<", scene(), {256: (4, HUGE), 257: (4, HUGE)}),
        "tiff, of bytes": tiff("<", scene(), {256: (1, HUGE), 257: (16, HUGE)}),
        "tiff, two": encoded(".tif")[:-4] + struct.pack("<I", 8),
        "tiff, tiles": tiff("<", scene(), {322: (4, HUGE)}),
        "tiff, jpeg in it": tiff("<", scene(), {259: (3, 7)}),
        "tiff, with signs": tiff("<", scene(), {339: (3, 2)}),
        "tiff, upside down": tiff("<", scene(), {274: (3, 3)}),
    }


@cache
def oddities() -> dict[str, bytes]:
    """Files that break their format's rules, and claim no more than they hold."""
    bmp = encoded(".bmp")
    jpeg = encoded(".jpg")
    return {
        "jpeg, fill": jpeg[:-2] + b"\xff" * 3_000_000,
        "png, two headers": encoded(".png")[:33] + encoded(".png")[8:],
        "png, many parts": encoded(".png")[:33]
        + chunk(b"tEXt", b"") * 60_000
        + encoded(".png")[33:],
        "bmp, colours": bmp[:46] + struct.pack("<I", 257) + bmp[50:],
        "bmp, pixels in the colours": bmp[:10] + struct.pack("<I", 60) + bmp[14:],
        "tiff, a tag twice": twice(tiff("<", scene(), {258: (3, 8), 300: (4, HUGE)}), 300, 256),
        "tiff, rows": tiff("<", scene(), {278: (4, 2**20)}),
    }


@pytest.mark.parametrize("kind", oddities())
def test_oddities_give_a_picture_of_their_size_or_one_line(kind, tmp_path):
    try:
        found = read(oddities()[kind], tmp_path)
    except FileFormatError:
        refusal(oddities()[kind], tmp_path)
    else:
        assert found.shape == (24, 37)


@pytest.mark.parametrize("kind", bombs())
def test_bombs_are_refused_before_they_are_decoded(kind, tmp_path, monkeypatch):
    def decode(*_: object) -> None:
        pytest.fail("was decoded")

    monkeypatch.setattr(ImageFile.ImageFile, "load", decode)
    message = refusal(bombs()[kind], tmp_path)
    assert kind != "jpeg, progressive" or "no baseline JPEG" in message


@pytest.mark.parametrize("kind", bombs())
def test_bombs_are_refused_by_their_heads(kind, tmp_path):
    path = tmp_path / "picture"
    path.write_bytes(bombs()[kind])
    for reader in (read_head, read_grey):
        with pytest.raises(FileFormatError):
            reader(path)


@settings(max_examples=75)
@given(st.data())
def test_notes_of_a_camera_that_are_damaged_change_no_picture(tmp_path_factory, data):
    entry = struct.pack("<HHII", 0x8769, 4, 1, 26) + struct.pack("<HHII", 36867, 2, 20, 60)
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 2) + entry + b"2024:05:01 10:00:00\0" * 3
    broken = bytearray(exif)
    for _ in range(data.draw(st.integers(1, 6))):
        broken[data.draw(st.integers(6, len(exif) - 1))] = data.draw(st.integers(0, 255))
    jpeg = encoded(".jpg")
    path = tmp_path_factory.getbasetemp() / "noted"
    length = struct.pack(">H", len(broken) + 2)
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + length + broken + jpeg[2:])
    try:
        assert read_head(path).size_px == (37, 24)
    except FileFormatError:
        return
    assert np.array_equal(read_grey(path), read_picture(path))


@pytest.mark.parametrize("kind", [b"zTXt", b"iTXt", b"tRNS", b"gAMA", b"iCCP"])
def test_notes_of_a_png_change_no_pixel(kind, tmp_path):
    note = chunk(kind, b"k\0\0" + zlib.compress(bytes(1000)))
    plain = encoded(".png")
    assert np.array_equal(read(plain[:33] + note + plain[33:], tmp_path), scene())


@pytest.mark.parametrize("kind", [b"zTXt", b"iCCP"])
def test_notes_of_a_png_do_not_unfold_without_end(kind, tmp_path):
    """Seven megabytes of them could keep a decoder at work for more than a minute."""
    note = chunk(kind, b"k\0\0" + zlib.compress(bytes(1_000_000)))
    plain = encoded(".png")
    refusal(plain[:33] + 70 * note + plain[33:], tmp_path)


def test_colours_of_a_png_by_number(tmp_path):
    colours = bytes(value for k in range(256) for value in (k, k, k))
    rows = b"".join(b"\0" + row.tobytes() for row in scene())
    header = struct.pack(">IIBBBBB", 37, 24, 8, 3, 0, 0, 0)
    parts = {b"IHDR": header, b"PLTE": colours, b"IDAT": zlib.compress(rows), b"IEND": b""}
    data = encoded(".png")[:8] + b"".join(chunk(kind, part) for kind, part in parts.items())
    assert np.array_equal(read(data, tmp_path), scene())


def test_as_many_pixels_as_cameras_have_and_no_more(tmp_path):
    side = int(MOST_PIXELS**0.5)
    full = struct.pack(">II", side, side)
    more = struct.pack(">II", side, side + 2)
    start, rest = encoded(".png")[:8], encoded(".png")[33:]
    tail = encoded(".png")[24:29]
    assert "claims" not in refusal(start + chunk(b"IHDR", full + tail) + rest, tmp_path)
    assert "claims" in refusal(start + chunk(b"IHDR", more + tail) + rest, tmp_path)


def test_wrong_files(tmp_path, monkeypatch):
    assert "is empty" in refusal(b"", tmp_path)
    assert "is no PNG" in refusal(b"GIF89a" + bytes(50), tmp_path)
    broken = bytearray(encoded(".png"))
    broken[60] ^= 1
    assert "checksum" in refusal(bytes(broken), tmp_path)
    for path in (tmp_path / "none.png", tmp_path):
        with pytest.raises(FileFormatError):
            read_picture(path)
    monkeypatch.setattr(pictures, "LARGEST_PICTURE_BYTES", 100)
    assert "is larger" in refusal(encoded(".bmp"), tmp_path)


@settings(max_examples=75)
@given(st.data())
def test_damaged_pictures_give_pixels_or_one_line(tmp_path_factory, data):
    whole = data.draw(
        st.sampled_from([*(encoded(e) for e in FORMATS), encoded(".jpg", 3), tiff(">", scene())])
    )
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        # the headers are at the beginning, and that of a TIFF of OpenCV at the end
        near = st.integers(0, min(120, len(whole) - 1))
        at = data.draw(near | near.map(lambda k: len(whole) - 1 - k))
        broken[at] = data.draw(st.sampled_from([0, 1, 8, 127, 128, 255]) | st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(bytes(broken))
    try:
        found = read_picture(path)
    except FileFormatError:
        return
    assert found.dtype == np.uint8
    assert found.ndim == 2


@settings(max_examples=150)
@given(
    st.sampled_from([b"\x89PNG\r\n\x1a\n", b"P5", b"BM", b"\xff\xd8", b"II*\0", b"MM\0*"]),
    st.binary(),
)
def test_rubbish_behind_a_signature(tmp_path_factory, start, rest):
    path = tmp_path_factory.getbasetemp() / "rubbish"
    path.write_bytes(start + rest)
    with pytest.raises(FileFormatError):
        read_picture(path)
