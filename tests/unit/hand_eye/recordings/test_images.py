"""Image messages of ROS: each encoding gives the same grey picture, and what lies is named."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from posedesign.hand_eye.recordings.images import PictureDecoder
from tests import recordings as r

pytest.importorskip("rosbags", reason="messages are made by rosbags, the extra bags")

rng = np.random.default_rng(2)
COLOURS = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)  # red, green, blue
GREY = cv2.cvtColor(COLOURS, cv2.COLOR_RGB2GRAY)
OPAQUE = np.full((6, 8, 1), 255, np.uint8)
SIDE = rng.integers(0, 256, (6, 8), dtype=np.uint8)
FORMS = {
    "mono8": GREY,
    "8UC1": GREY,
    "mono16": GREY.astype("<u2") << 4,
    "16UC1": GREY.astype("<u2") << 8,
    "rgb8": COLOURS,
    "bgr8": COLOURS[..., ::-1],
    "8UC3": COLOURS[..., ::-1],
    "rgba8": np.dstack([COLOURS, OPAQUE]),
    "bgra8": np.dstack([COLOURS[..., ::-1], OPAQUE]),
    "rgb16": COLOURS.astype("<u2") << 8,
    "yuv422": np.dstack([SIDE, GREY]),
    "uyvy": np.dstack([SIDE, GREY]),
    "yuv422_yuy2": np.dstack([GREY, SIDE]),
}


@pytest.mark.parametrize("encoding", FORMS)
def test_encodings(encoding):
    grey = PictureDecoder().decode(r.image(0.0, FORMS[encoding], encoding))
    assert grey.dtype == np.uint8
    assert np.abs(grey.astype(int) - GREY).max() <= (1 if encoding == "rgb16" else 0)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_mosaics_become_the_brightness_of_their_colours(pattern, bits):
    colour = {"r": 200, "g": 120, "b": 40}
    tile = np.array([[colour[pattern[0]], colour[pattern[1]]]] * 2, dtype=np.uint16)
    tile[1] = [colour[pattern[2]], colour[pattern[3]]]
    mosaic = np.tile(tile, (6, 8)) << (bits - 8)
    shown = mosaic.astype(np.uint8 if bits == 8 else "<u2")
    grey = PictureDecoder().decode(r.image(0.0, shown, f"bayer_{pattern}{bits}"))
    want = 0.299 * 200 + 0.587 * 120 + 0.114 * 40
    assert np.abs(grey[2:-2, 2:-2] - want).max() <= 1.5


def test_rows_may_be_longer_than_their_pixels_and_bytes_in_the_other_order():
    padded = np.hstack([GREY, np.full((6, 5), 77, np.uint8)])
    message = r.image(0.0, padded, width=8)
    np.testing.assert_array_equal(PictureDecoder().decode(message), GREY)
    swapped = r.image(0.0, (GREY.astype("<u2") << 4).astype(">u2"), "mono16", is_bigendian=1)
    np.testing.assert_array_equal(PictureDecoder().decode(swapped), GREY)


def test_all_pictures_of_16_bits_are_made_darker_alike():
    decoder = PictureDecoder()
    bright = np.full((4, 4), 4095, np.uint16)
    assert (decoder.decode(r.image(0.0, bright, "mono16")) == 255).all()
    assert (decoder.decode(r.image(0.1, bright // 4, "mono16")) == 63).all()
    assert (decoder.decode(r.image(0.2, bright * 2, "mono16")) == 255).all()


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_compressed_pictures(ending):
    smooth = cv2.GaussianBlur(cv2.resize(GREY, (80, 60)), (0, 0), 5)
    grey = PictureDecoder().decode(r.compressed(0.0, smooth, ending))
    assert np.abs(grey.astype(int) - smooth).max() <= (4 if ending == ".jpg" else 0)


def refusal(message, decoder: PictureDecoder | None = None) -> str:
    with pytest.raises(InputError) as caught:
        (decoder or PictureDecoder()).decode(message)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value.message


@pytest.mark.parametrize(
    "lie",
    [
        {"width": 9},
        {"height": 7},
        {"step": 7},
        {"step": 2**32 - 1},
        {"height": 0},
        {"width": 0, "step": 0},
        {"width": 2**32 - 1, "height": 2**32 - 1, "step": 2**32 - 1},
        {"encoding": "rgb8"},
    ],
)
def test_sizes_that_are_not_those_of_the_bytes_are_refused(lie):
    assert "claims" in refusal(r.image(0.0, GREY, **lie))


def test_unknown_kinds_and_other_sizes_are_named():
    assert "has the encoding '32FC1'" in refusal(r.image(0.0, GREY, "32FC1"))
    depth = r.compressed(0.0, GREY, ".png")
    depth.format = "16UC1; compressedDepth"
    assert "picture of depths" in refusal(depth)
    broken = r.compressed(0.0, GREY)
    broken.data = broken.data[:40]
    assert refusal(broken)
    decoder = PictureDecoder()
    decoder.decode(r.image(0.0, GREY))
    assert "has 6 by 8 pixels, after pictures of 8 by 6" in refusal(r.image(0.1, GREY.T), decoder)
