"""Decoding of videos, for a process of its own: see :func:`calib.limited.stream_limited`.

Decoders of videos are native code that reads whatever a file holds.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator
from typing import Any

FRAME = struct.Struct("<Qddii")
"""Before the pixels of a picture: its number, time [s], part of the video, height and width."""


def stream(data: bytes) -> Iterator[bytes]:
    """Yield the pictures of a video in grey; or why it cannot be read.

    ``data``: JSON of ``file``, ``wanted`` (numbers of pictures, or null for all) and
    ``most_pixels``. The first byte of each part: ``f`` a picture, ``e`` an error in words.
    """
    try:
        yield from _frames(json.loads(data))
    except MemoryError:
        yield b"ea picture of it claims more memory than there is for it"
    except Exception as error:  # OpenCV's, and what its arithmetic raises
        yield b"e" + (str(error) or type(error).__name__).encode("utf-8", "replace")


def _frames(job: dict[str, Any]) -> Iterator[bytes]:
    # one thread a video is enough, and nothing but this file is read
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "threads;1|protocol_whitelist;file"
    import cv2

    cv2.setNumThreads(1)
    capture = cv2.VideoCapture(job["file"], cv2.CAP_FFMPEG)
    # a note in the file that it was held upright is not followed, as in pictures
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    if not capture.isOpened():
        raise ValueError("no decoder for it, or damaged at its begin or end")
    width, height = (
        capture.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    if not 0 < width * height <= job["most_pixels"]:
        raise ValueError(f"claims {width:g} by {height:g} pixels")
    rate = capture.get(cv2.CAP_PROP_FPS)
    count = max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 1.0)
    wanted = None if job["wanted"] is None else set(job["wanted"])
    number, last = -1, -1.0
    while capture.grab():
        number += 1
        time_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        if not time_s > last:  # one that the file does not say
            time_s = last + 1.0 / (rate if 0.1 <= rate <= 1000.0 else 25.0) if number else 0.0
        last = time_s
        if wanted is not None and number not in wanted:
            continue
        done, picture = capture.retrieve()
        if not done or picture is None:
            continue
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
        yield (
            b"f"
            + FRAME.pack(number, time_s, min((number + 1) / count, 1.0), *grey.shape)
            + grey.tobytes()
        )
