"""Which pictures of a recording are still, and how sharp they are: from the pictures alone.

Pictures are compared as thumbnails, in blocks. The shift of a block is that of least squares,
``min_v ||∇I v + ΔI||² + μ ||v||²`` [Lucas1981]_, damped so that noise of a grey level moves no
block by more than some hundredths of a pixel, and blocks without a pattern not at all. A block that
differs by more than a small shift explains has moved, too.

.. [Lucas1981] B. Lucas and T. Kanade, An iterative image registration technique with an application
   to stereo vision, IJCAI.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.se3 import BoolArray, FloatArray, IntArray
from calib.vision.camera.rendering import GreyImage

Thumbnail = NDArray[np.float32]

WIDEST_PX = 320
"""Of a thumbnail: a pixel of it is 2 to 6 of the picture, whose noise it averages."""

_BLOCK_PX = 16

_SHIFT_PX = 0.15
"""Of a block in a thumbnail, beyond which it has moved."""

_DAMPING = 1000.0
"""Sum of squares of gradients in a block: a noise of one grey level shifts it by less than
``1 / (2 √1000)``, 0.016 pixels of a thumbnail."""

_LEAST_CHANGE, _CHANGE_PER_GRADIENT = 4.0, 0.5
"""Grey levels by which a block changes, root mean square, when it has moved: so many at least, and
so many of its gradients."""

MOST_MOVED = 0.03
"""Share of blocks that may move in a still picture: something small does somewhere."""


def moved_share(first: Thumbnail, second: Thumbnail) -> float:
    """Return the share of the blocks of a thumbnail that moved to another one."""
    gx = cv2.Sobel(first, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    gy = cv2.Sobel(first, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    change = _blocks(second - first)
    change = change - change.mean(axis=-1, keepdims=True)  # brighter light moves nothing
    bx, by = _blocks(gx), _blocks(gy)
    xx, xy, yy = ((a * b).sum(axis=-1) for a, b in ((bx, bx), (bx, by), (by, by)))
    x, y = ((a * change).sum(axis=-1) for a in (bx, by))
    xx, yy = xx + _DAMPING, yy + _DAMPING
    det = xx * yy - xy * xy
    shift = np.hypot(yy * x - xy * y, xx * y - xy * x) / det
    rms = np.sqrt((change**2).mean(axis=-1))
    steep = np.sqrt((bx**2 + by**2).mean(axis=-1))
    moved = (shift > _SHIFT_PX) | (rms > _LEAST_CHANGE + _CHANGE_PER_GRADIENT * steep)
    return float(moved.mean())


def _blocks(picture: NDArray[Any]) -> NDArray[Any]:
    """Pixels of each block, ``(rows, columns, pixels)``; those of a margin are left out."""
    rows, columns = (max(size // _BLOCK_PX, 1) for size in picture.shape)
    height, width = (min(_BLOCK_PX, size) for size in picture.shape)
    cut = picture[: rows * height, : columns * width]
    parts = cut.reshape(rows, height, columns, width).swapaxes(1, 2)
    return parts.reshape(rows, columns, height * width)


def thumbnail(picture: GreyImage) -> Thumbnail:
    """Return a picture made small and smooth, of 32-bit numbers."""
    factor = min(1.0, WIDEST_PX / max(picture.shape))
    size = tuple(max(round(factor * n), 1) for n in picture.shape[::-1])
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small.astype(np.float32), (3, 3), 0), dtype=np.float32)


@dataclass(eq=False)
class StillnessOfPictures:
    """What the pictures of a recording tell, one after the other."""

    _share: list[float] = field(default_factory=list)
    _run: list[int] = field(default_factory=list)
    _sharp: list[float] = field(default_factory=list)
    _last: Thumbnail | None = None
    _first: Thumbnail | None = None  # of the present run
    _firsts: dict[int, GreyImage] = field(default_factory=dict)
    """Of the runs of several pictures, by number: the first thumbnail."""

    def add(self, picture: GreyImage) -> None:
        """Take in the next picture."""
        small = thumbnail(picture)
        self._share.append(0.0 if self._last is None else moved_share(self._last, small))
        run = self._run[-1] if self._run else -1
        if self._first is None or moved_share(self._first, small) > MOST_MOVED:
            self._first, run = small, run + 1
        elif run not in self._firsts:
            self._firsts[run] = np.asarray(self._first, dtype=np.uint8)
        self._run.append(run)
        _, deviation = cv2.meanStdDev(cv2.Laplacian(picture, cv2.CV_16S))
        self._sharp.append(float(deviation[0, 0]) ** 2)
        self._last = small

    def are_same(self, one: int, other: int) -> bool:
        """Return True if two runs of several pictures show the same."""
        first, second = (np.asarray(self._firsts[run], dtype=np.float32) for run in (one, other))
        return moved_share(first, second) <= MOST_MOVED

    @property
    def moved(self) -> FloatArray:
        """Share ``(K,)`` of the blocks that moved since the picture before."""
        return np.array(self._share)

    @property
    def runs(self) -> IntArray:
        """Number ``(K,)`` of the run of each picture: those of a run show the same."""
        return np.array(self._run, dtype=np.intp)

    @property
    def sharpness(self) -> FloatArray:
        """Variance ``(K,)`` of the second derivative of each picture: more where it is sharper."""
        return np.array(self._sharp)


def still_runs(seconds: FloatArray, runs: IntArray, shortest_s: float) -> BoolArray:
    """Return the pictures ``(K,)`` of runs that last at least so long."""
    count = int(runs[-1]) + 1 if len(runs) else 0
    begin, end = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(begin, runs, seconds)
    np.maximum.at(end, runs, seconds)
    return np.asarray((end - begin >= shortest_s)[runs])
