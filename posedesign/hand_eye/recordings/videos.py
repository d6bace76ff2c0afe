"""Pictures of a video file, decoded in a process of its own with limits."""

from __future__ import annotations

import json
from collections.abc import Collection, Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.limited import stream_limited
from calib.vision.camera.rendering import GreyImage
from posedesign.files.pictures import MOST_PIXELS
from posedesign.files.safe import read_bytes_bounded
from posedesign.hand_eye.recordings.video_process import FRAME

VIDEO_ENDINGS = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm")

_MEMORY_BYTES = 4_000_000_000
"""Of the process that decodes: some dozens of pictures, and the decoder itself."""

_SECONDS, _PATIENCE_S = 7200.0, 60.0

_HEAD_BYTES = 16


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a video."""

    number: int  # in the video, from 0
    time_s: float
    picture: GreyImage
    part: float  # of the recording that is read with it, from 0 to 1, as far as the file says


def is_video(path: Path) -> bool:
    """Return True if a path has the ending of a video."""
    return path.suffix.casefold() in VIDEO_ENDINGS


def frames_of(path: Path, wanted: Collection[int] | None = None) -> Generator[Frame, None, None]:
    """Yield the pictures of a video in their order: all of them, or those of some numbers.

    Times [s] are those of the file, from its start. Raises FileFormatError: it is no video, or
    damaged, or has no picture.
    """
    _check_kind(path)
    job = {
        "file": str(path.resolve()),
        "wanted": None if wanted is None else sorted(wanted),
        "most_pixels": MOST_PIXELS,
    }
    count = 0
    try:
        for part in stream_limited(
            "posedesign.hand_eye.recordings.video_process",
            json.dumps(job).encode(),
            memory_bytes=_MEMORY_BYTES,
            seconds=_SECONDS,
            patience_s=_PATIENCE_S,
            threads=True,  # pictures whose colours are converted without one stay black
        ):
            if part[:1] == b"e":
                raise _fault(path, part[1:].decode("utf-8", "replace"))
            number, time_s, whole, height, width = FRAME.unpack_from(part, 1)
            pixels = np.frombuffer(part, dtype=np.uint8, offset=1 + FRAME.size)
            count += 1
            yield Frame(number, time_s, pixels.reshape(height, width), whole)
    except OSError as error:  # TimeoutError among them
        raise _fault(path, str(error)) from error
    if not count:
        raise _fault(path, "no picture in it can be decoded")


def _check_kind(path: Path) -> None:
    """Refuse what is not a video by its first bytes: decoders read playlists, and follow them."""
    if not path.is_file():
        read_bytes_bounded(path, most_bytes=0)  # says why
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    known = (
        head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free")  # MP4, QuickTime
        or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")
        or head[:4] == b"\x1aE\xdf\xa3"  # Matroska, WebM
    )
    if not known:
        raise _fault(path, "it is no MP4, QuickTime, AVI, Matroska or WebM")


def _fault(path: Path, why: str) -> FileFormatError:
    return FileFormatError(
        f"cannot be read as a video: {' '.join(why.split())[:200]}",
        path=path,
        hint="was it copied whole? save it as MP4 (H.264) or AVI (MJPG)",
    )
