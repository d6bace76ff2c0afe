"""A camera that is connected to this computer: a device, a stream or a recording, by OpenCV.

A driver hands out the pictures that it kept while nobody asked: they show the arm where it was. So
the kept ones are taken out first, which is told by how fast they come, and only a picture that was
waited for counts.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from calib.errors import InputError
from calib.vision.camera.rendering import GreyImage

USUAL_RATE_HZ = 25.0
"""Of a camera that does not tell its own."""

_WAITED = 0.5
"""Part of the time between two pictures that one takes to come which was not kept by the driver."""

_LONGEST_S = 10.0
"""Longest emptying of what a driver keeps: streams keep seconds."""

_MOST_KEPT = 1000
"""Pictures without a wait after which a source is a recording: it has all of them at once."""

_WARMING_UP = 10
"""Pictures after opening in which exposure settles."""

_MOST_SAME = 50
"""Pictures, the same to the last bit, from which on a camera is frozen: noise changes each, and a
stream that leaves out what has not changed sends a whole picture every second or two."""

_BLACK, _SEEN = 16, 1e-3
"""Grey level, and the least share of pixels that reach it in a picture that is not black."""


class VideoCamera:
    """Grey pictures, each taken after it was asked for.

    ``source``: number of a device, address of a stream, or a file. ``size_px``: width and height
    that pictures must have; a device is set to it. By default as they come. ``open_``: opens a
    number or a text: OpenCV's, or what stands in for it. ``clock``: seconds that go on. Raises
    InputError: it cannot be opened.
    """

    def __init__(
        self,
        source: str,
        size_px: tuple[int, int] | None = None,
        *,
        open_: Callable[[Any], Any] = cv2.VideoCapture,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._device = source.isdecimal()
        self.name = re.sub(r"//[^/@]*@", "//", source)  # a password is nobody's business
        self._size, self._clock = size_px, clock
        self._capture = open_(int(source) if self._device else source)
        if not self._capture.isOpened():
            raise self._refused(
                "cannot be opened",
                "is it connected, and used by nothing else? Give the number of a device, 0 for the "
                "first, the address of a stream, or a file",
            )
        if self._device and size_px is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._period_s = 1.0 / (rate if 0.1 <= rate <= 1000.0 else USUAL_RATE_HZ)
        self._is_live = self._device or "://" in source
        for _ in range(_WARMING_UP * self._device):
            self._advance()

    def grab(self) -> GreyImage:
        """Picture ``(height, width)`` of 8 bits, exposed after this call.

        Of a recording, the next one.

        Raises InputError: there is none, it has another size than those before, it is black, or the
        camera repeats one.
        """
        if not self._is_live:
            return self._read()
        self._empty()
        self._advance()  # this one may have been exposed before the call
        first = self._read()
        for _ in range(_MOST_SAME):
            picture = self._read()
            if not np.array_equal(picture, first):
                return picture
        raise self._refused(
            f"is frozen: {_MOST_SAME} pictures are the same to the last bit",
            "connect it again, or restart its stream",
        )

    def close(self) -> None:
        """Give the camera back."""
        self._capture.release()

    def _empty(self) -> None:
        """Take out what the driver has kept, up to the first picture that had to be waited for."""
        begun = self._clock()
        for _ in range(_MOST_KEPT):
            before = self._clock()
            self._advance()
            now = self._clock()
            if now - before >= _WAITED * self._period_s:
                return
            if now - begun > _LONGEST_S:
                break
        raise self._refused(
            "gives old pictures without an end",
            "lower its rate or its size: this computer does not follow",
        )

    def _advance(self) -> None:
        if not self._capture.grab():
            raise self._refused("gives no picture", "is it still connected?" * self._is_live)

    def _read(self) -> GreyImage:
        self._advance()
        done, picture = self._capture.retrieve()
        if not done or picture is None:
            raise self._refused("gave a picture that cannot be read", "")
        if picture.dtype != np.uint8:
            raise self._refused(
                f"gives pictures of {picture.dtype}", "set it to 8 bits, grey or colour"
            )
        if picture.ndim == 3:
            picture = (
                cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
                if picture.shape[2] == 3
                else picture[..., 0]
            )
        size = picture.shape[1], picture.shape[0]
        if self._size is not None and size != tuple(self._size):
            raise self._refused(
                f"gives pictures of {size[0]} x {size[1]}, not {self._size[0]} x {self._size[1]}",
                "set the camera, or correct camera.image_px",
            )
        self._size = size
        if np.mean(picture >= _BLACK) < _SEEN:
            raise self._refused("gives black pictures", "take off the cap, and make light")
        return np.ascontiguousarray(picture)

    def _refused(self, what: str, hint: str) -> InputError:
        return InputError(f"camera {self.name} {what}", hint=hint, name="camera")
