"""Grey pictures of image messages of ROS: raw in the encodings of cameras, or as JPEG and PNG.

Sources: ``sensor_msgs/image_encodings.hpp`` of ROS 2; ``compressed_image_transport``, whose format
reads, say, ``rgb8; jpeg compressed bgr8``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.vision.camera.rendering import GreyImage
from posedesign.files.pictures import MOST_PIXELS, decode_grey


class _Encoding(NamedTuple):
    """How the pixels of an encoding are stored."""

    channels: int
    bits: int
    to_grey: int | None = None  # OpenCV's conversion; None where the first channel is the grey
    first: int = 0  # channel that is the grey


_ENCODINGS: Mapping[str, _Encoding] = {
    "mono8": _Encoding(1, 8),
    "8uc1": _Encoding(1, 8),
    "mono16": _Encoding(1, 16),
    "16uc1": _Encoding(1, 16),
    "rgb8": _Encoding(3, 8, cv2.COLOR_RGB2GRAY),
    "bgr8": _Encoding(3, 8, cv2.COLOR_BGR2GRAY),
    "8uc3": _Encoding(3, 8, cv2.COLOR_BGR2GRAY),
    "rgba8": _Encoding(4, 8, cv2.COLOR_RGBA2GRAY),
    "bgra8": _Encoding(4, 8, cv2.COLOR_BGRA2GRAY),
    "rgb16": _Encoding(3, 16, cv2.COLOR_RGB2GRAY),
    "bgr16": _Encoding(3, 16, cv2.COLOR_BGR2GRAY),
    # the brightness of each pixel, and one of two colours beside it
    "yuv422": _Encoding(2, 8, first=1),
    "uyvy": _Encoding(2, 8, first=1),
    "yuv422_yuy2": _Encoding(2, 8),
    "yuyv": _Encoding(2, 8),
    **{
        f"bayer_{pattern}{bits}": _Encoding(1, bits, code)
        for bits in (8, 16)
        for pattern, code in (
            ("rggb", cv2.COLOR_BayerRGGB2GRAY),
            ("bggr", cv2.COLOR_BayerBGGR2GRAY),
            ("gbrg", cv2.COLOR_BayerGBRG2GRAY),
            ("grbg", cv2.COLOR_BayerGRBG2GRAY),
        )
    },
}


class PictureDecoder:
    """Grey pictures of 8 bits of the messages of one topic, all of one size.

    Grey levels of 16 bits are shifted to the right by as many bits as the brightest pixel of the
    first picture has above 8; brighter pixels of later pictures become white.
    """

    def __init__(self) -> None:
        self.size_px: tuple[int, int] | None = None  # width and height
        self._shift: int | None = None

    def decode(self, content: Any) -> GreyImage:
        """Return the picture ``(height, width)`` of a message.

        Raises InputError: its encoding is not known, it has not the bytes that it claims, or
        another size than those before.
        """
        grey = self._raw(content) if hasattr(content, "encoding") else _compressed(content)
        size = grey.shape[1], grey.shape[0]
        if self.size_px is None:
            self.size_px = size
        if size != self.size_px:
            raise InputError(
                f"has {size[0]} by {size[1]} pixels, after pictures of {self.size_px[0]} by "
                f"{self.size_px[1]}",
                hint="cut the bag where the camera was set otherwise",
            )
        return grey

    def _raw(self, content: Any) -> GreyImage:
        width, height, step = int(content.width), int(content.height), int(content.step)
        name = str(content.encoding)
        known = _ENCODINGS.get(name.casefold())
        if known is None:
            raise InputError(
                f"has the encoding {name[:40]!r}",
                hint=f"known are {', '.join(_ENCODINGS)}; JPEG and PNG as CompressedImage",
            )
        row = width * known.channels * known.bits // 8
        data = np.asarray(content.data, dtype=np.uint8)
        if not 0 < width * height <= MOST_PIXELS or not row <= step <= len(data) // height:
            raise InputError(
                f"claims {width} by {height} pixels of {name[:40]}, {step} bytes a row, and has "
                f"{len(data)} bytes",
                hint="record it again",
            )
        rows = data[: step * height].reshape(height, step)[:, :row]
        order = ">" if content.is_bigendian and known.bits == 16 else "<"
        pixels = np.ascontiguousarray(rows).view(f"{order}u{known.bits // 8}")
        pixels = pixels.reshape(height, width, known.channels)
        pixels = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("="))
        if known.to_grey is None:
            grey = pixels[..., known.first]
        else:
            grey = cv2.cvtColor(pixels[..., 0] if known.channels == 1 else pixels, known.to_grey)
        return self._of_8_bits(np.ascontiguousarray(grey))

    def _of_8_bits(self, grey: NDArray[Any]) -> GreyImage:
        if grey.dtype == np.uint8:
            return grey
        if self._shift is None:
            self._shift = max(int(grey.max()).bit_length() - 8, 0)
        return np.asarray(np.minimum(grey >> self._shift, 255), dtype=np.uint8)


def _compressed(content: Any) -> GreyImage:
    said = str(content.format)
    if "compresseddepth" in said.casefold():
        raise InputError(
            f"is a picture of depths ({said[:40]!r})", hint="name the topic of the grey pictures"
        )
    return decode_grey(np.asarray(content.data, dtype=np.uint8).tobytes())
