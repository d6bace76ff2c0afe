"""All pictures of a camera on sheets: their points, what is left over at them, why one is left out.

They are drawn where a calibration fails, too: then they show what was found in each picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import CalibError
from calib.se3 import BoolArray, FloatArray
from calib.vision.boards import Board, MarkerGrid
from posedesign.files import Claim, write_bytes_atomic
from posedesign.hand_eye.calibration import picture_rows
from posedesign.report import figures
from posedesign.report.drawing import BLACK, BLUE, GREY, SMALL, VERMILION
from posedesign.report.hand_eye import LONG_ARROW, short
from posedesign.report.pdf import Page, as_pdf, in_letters

if TYPE_CHECKING:
    from calib.vision.camera.rendering import GreyImage
    from posedesign.hand_eye import Calibrated, Sightings
    from posedesign.hand_eye.pictures import PictureSet

CAMERA_SHEETS = ("camera_pictures.pdf", "sheets of pictures of a board")
"""Name of the file, and what it says that it is."""

COLUMNS, ROWS = 4, 3
"""Pictures side by side, and one below the other, on a sheet."""

_SHEET = (842.0, 595.0)
"""A4 with its long side across, in points of 1/72 inch as all lengths on a sheet."""

_MARGIN, _HEAD, _GAP, _CAPTION = 25.0, 52.0, 11.0, 42.0
"""Beside and below all, above it, between pictures, and below each for its words."""

_VERDICT, _LETTERS, _LINES = 150, 56, 3
"""Letters of a line of the verdict above and of the words below a picture, and lines of these."""

_LONGEST_LEFT_OUT = 0.25
"""Length of the longest residual of a picture that is left out, in parts of its width: it would
leave the picture at the scale of the others."""

_SMALLEST, _LARGEST = 2.0, 5.0
"""Size of the label of a point: the smallest that is printed clearly, and the largest."""

_DIGIT = 0.556
"""Width of a digit over the size of its letters."""

_PALE = 125
"""Grey level of black: lines are seen on pale pictures."""

_CROSS = np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])
_FRAME = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
"""Lines of a cross about its middle, and corners of a frame in parts of its width and height."""


@dataclass(frozen=True, eq=False)
class PictureShown:
    """A picture of K points as a sheet shows it."""

    name: str
    thumbnail: GreyImage
    size_px: tuple[int, int]  # width and height of the picture
    pixels: FloatArray  # (K, 2): where the points were found; NaN where not
    residuals_px: FloatArray
    """(K, 2): from there to where the result shows them; NaN where there is no result."""
    left_out: bool
    words: str  # how well it fits, or why it was left out

    @property
    def seen(self) -> BoolArray:
        """Points ``(K,)`` that were found."""
        return np.asarray(np.isfinite(self.pixels).all(axis=1))

    @property
    def passed_over(self) -> BoolArray:
        """Those ``(K,)`` that took no part, in wrong places, where others did."""
        known = np.asarray(np.isfinite(self.residuals_px).all(axis=1))
        return self.seen & ~known if known.any() else np.zeros(len(known), dtype=bool)


def pictures_shown(
    pictures: Mapping[str, PictureSet],
    found: Mapping[str, Sightings],
    calibrated: Calibrated | None,
) -> list[PictureShown]:
    """Return all pictures with their points, and with residuals where there is a result.

    ``pictures``, ``found``: by the name of the camera.
    """
    cameras = [camera for camera, one in found.items() for _ in one.thumbnails]
    thumbnails = [small for one in found.values() for small in one.thumbnails]
    sizes = [pictures[camera].size_px for camera in cameras]
    if calibrated is None:
        pixels = np.concatenate([one.pixels for one in found.values()])
        reasons = [reason for one in found.values() for reason in one.reasons]
        names = [name for camera in found for name in pictures[camera].names]
        several = len(pictures) > 1
        return [
            PictureShown(
                f"{camera}/{name}" if several else name,
                small,
                size,
                own,
                np.full_like(own, np.nan),
                bool(reason),
                reason or f"{np.isfinite(own[:, 0]).sum()} of {len(own)} points found",
            )
            for camera, name, small, size, own, reason in zip(
                cameras, names, thumbnails, sizes, pixels, reasons, strict=True
            )
        ]
    result = calibrated.result
    return [
        PictureShown(name, small, size, own, left, not used, _words(row))
        for name, small, size, own, left, used, row in zip(
            result.names,
            thumbnails,
            sizes,
            calibrated.pixels,
            result.residuals_px,
            result.used.tolist(),
            picture_rows(calibrated),
            strict=True,
        )
    ]


def _words(row: Mapping[str, object]) -> str:
    """How well a picture fits, or why it was left out, of a row of camera_pictures.csv."""
    fits = f"{row['points']} points"
    if np.isfinite(float(str(row["rms_px"]))):
        rms, mm, deg = (short(float(str(row[key]))) for key in ("rms_px", "off_mm", "off_deg"))
        fits += f", rms {rms} px, board off {mm} mm {deg} deg"
    if row["status"] == "used":
        return fits
    why = row["reason"] or _WHY.get(str(row["status"]), row["status"])
    return f"{_LEFT_OUT}: {why}" + (f"; {fits}" if row["points"] else "")


_LEFT_OUT = "left out"
_WHY = {"no posture": "no posture, serves the lens only", "copy": "copy of another picture"}
"""Words for why a picture was left out, where its status is too short."""


def write_sheets(
    file: Claim,
    pictures: Mapping[str, PictureSet],
    found: Mapping[str, Sightings],
    board: Board,
    result: Calibrated | CalibError,
) -> None:
    """Write all pictures on sheets, as PDF.

    ``pictures``, ``found``: by the name of the camera. ``result``: or why there is none.
    """
    if isinstance(result, CalibError):
        shown, verdict = pictures_shown(pictures, found, None), f"not calibrated: {result.message}"
    else:
        shown = pictures_shown(pictures, found, result)
        state = "calibrated" if result.result.is_ok else "not to be trusted"
        used = sum(not one.left_out for one in shown)
        verdict = f"{state}: {used} of {len(shown)} pictures used"
    # a board is described once, not below each picture
    shown = [replace(one, words=one.words.replace(board.words, "board")) for one in shown]
    pages = sheets_of_pictures(shown, board, verdict)
    write_bytes_atomic(file, as_pdf(pages, "pictures of a board"))


def sheets_of_pictures(shown: Sequence[PictureShown], board: Board, verdict: str) -> Iterator[Page]:
    """Yield pages of pictures. ``verdict``: what the calibration came to, in words."""
    longer = _times([one for one in shown if not one.left_out], LONG_ARROW, typical=True)
    each = COLUMNS * ROWS
    pages = [shown[k : k + each] for k in range(0, len(shown), each)]
    for k, pictures in enumerate(pages):
        page = Page(*_SHEET)
        _write_head(page, board, verdict, longer, f"sheet {k + 1} of {len(pages)}")
        for place, one in enumerate(pictures):
            _draw(page, _Placed.at(place, one, longer), board)
        yield page


@dataclass(frozen=True, eq=False)
class _Placed:
    """A picture at its place on a sheet."""

    shown: PictureShown
    box: tuple[float, float, float, float]  # left, lower edge, width, height
    points: FloatArray  # (K, 2): where they were found
    arrows: FloatArray  # (K, 2): residuals as long as they are drawn
    longer: float  # factor of their length; 0 where there are none

    @classmethod
    def at(cls, place: int, shown: PictureShown, longer: float) -> _Placed:
        """Place a picture on a sheet; ``longer`` is the factor of those that were used."""
        width, height = _SHEET
        wide = (width - 2.0 * _MARGIN - (COLUMNS - 1) * _GAP) / COLUMNS
        high = (height - _HEAD - _MARGIN) / ROWS
        row, column = divmod(place, COLUMNS)
        left, below = _MARGIN + column * (wide + _GAP), height - _HEAD - (row + 1) * high + _CAPTION
        across, down = shown.size_px
        scale = min(wide / across, (high - _CAPTION) / down)  # points a pixel
        box = left, below, scale * across, scale * down
        if shown.left_out:
            own = _times([shown], _LONGEST_LEFT_OUT, typical=False)
            longer = min(own, longer) if own and longer else own
        to_page = scale * np.array([1.0, -1.0])
        points = [left, below + box[3]] + shown.pixels * to_page
        return cls(shown, box, points, longer * shown.residuals_px * to_page, longer)


def _write_head(page: Page, board: Board, verdict: str, longer: float, sheet: str) -> None:
    top = _SHEET[1] - 20.0
    for line in _lines(verdict, _VERDICT, 2):
        page.add_text(line, (_MARGIN, top), 9.0, bold=True)
        top -= 11.0
    labels = "the number of its marker" if isinstance(board, MarkerGrid) else "its number"
    said = f"{sheet}; circle: a point as it was found, with {labels}"
    if longer:
        said += (
            f"; arrow: from there to where the result shows it, {longer:g} times as long unless "
            "a caption says otherwise"
        )
    said += "; red: left out"
    page.add_text(said, (_MARGIN, top - 2.0), SMALL, GREY)


def _draw(page: Page, one: _Placed, board: Board) -> None:
    """Draw a picture with its points, their residuals, and its words below."""
    left, below, wide, high = one.box
    shown, colour = one.shown, VERMILION if one.shown.left_out else BLUE
    pale = (_PALE + shown.thumbnail * ((255 - _PALE) / 255.0)).astype(np.uint8)
    page.add_picture(pale, one.box)
    frame = VERMILION if shown.left_out else GREY
    page.add_lines(([left, below] + _FRAME * [wide, high])[None], frame, 0.8)
    page.add_circles(one.points[shown.seen], 1.1, colour, 0.4)
    wrong, known = shown.passed_over, shown.seen & ~shown.passed_over
    crosses = one.points[wrong, None, None] + 1.6 * _CROSS
    page.add_lines(crosses.reshape(-1, 2, 2), VERMILION, 0.5)
    if one.longer:
        page.add_lines(_arrows(one.points[known], one.arrows[known]), colour, 0.5)
    _write_labels(page, board, one.points)
    words = shown.words
    if wrong.any():
        words += f"; {wrong.sum()} of them in wrong places (crosses), not used"
    if shown.left_out and one.longer:
        longer = "in full size" if one.longer == 1.0 else f"{one.longer:g} times as long"
        # where a longer text is not cut off
        words = words.replace(_LEFT_OUT, f"{_LEFT_OUT}, arrows {longer}", 1)
    colour = VERMILION if shown.left_out else BLACK
    name = figures.shortened(in_letters(shown.name), _LETTERS - 16)
    page.add_text(name, (left, below - 8.5), 7.5, colour, bold=True)
    for k, line in enumerate(_lines(words, _LETTERS, _LINES)):
        page.add_text(line, (left, below - 16.5 - 7.5 * k), 7.0, colour)


def _arrows(start: FloatArray, along: FloatArray) -> FloatArray:
    """Arrows as lines ``(K, 5, 2)`` from points ``(K, 2)`` along vectors ``(K, 2)``."""
    tip, across = start + along, along[:, ::-1] * [-1.0, 1.0]
    barbs = [tip - 0.3 * along + side * 0.15 * across for side in (1.0, -1.0)]
    return np.stack([start, tip, barbs[0], tip, barbs[1]], axis=1)


def _write_labels(page: Page, board: Board, points: FloatArray) -> None:
    """Write numbers of points, or of markers, beside them where there is space for them."""
    at, numbers = points, np.arange(len(points))
    if isinstance(board, MarkerGrid):
        at, numbers = points.reshape(-1, 4, 2).mean(axis=1), np.array(board.ids)
    seen = np.isfinite(at).all(axis=1)
    at, numbers = at[seen], numbers[seen]
    apart = np.linalg.norm(at[:, None] - at, axis=-1)
    nearest = np.sort(apart, axis=1)[:, 1:2]
    usual = float(np.median(nearest)) if nearest.size else np.inf
    size = float(np.clip(0.4 * usual, _SMALLEST, _LARGEST))
    kept: list[int] = []
    for k in range(len(at)):  # the first of those that stand too near
        if not kept or apart[k, kept].min() > 2.0 * size:
            kept.append(k)
    for k in kept:
        text = str(numbers[k])
        x, y = at[k].tolist()
        if isinstance(board, MarkerGrid):  # in the middle of its marker
            x, y = x - _DIGIT * size * len(text) / 2.0, y - 0.35 * size
        else:
            x, y = x + 1.3, y + 0.9
        page.add_text(text, (x, y), size)


def _times(shown: Sequence[PictureShown], part: float, *, typical: bool) -> float:
    """Factor by which residuals are drawn longer, a round one; 0 where there are none.

    The longest one, or with ``typical`` all but one in a hundred, then takes at most this part of
    the width of its picture.
    """
    lengths = [np.linalg.norm(one.residuals_px, axis=1) / one.size_px[0] for one in shown]
    known = np.concatenate([np.zeros(0), *lengths])
    known = known[np.isfinite(known)]
    longest = float(np.quantile(known, 0.99 if typical else 1.0)) if known.size else 0.0
    if not longest:
        return 0.0
    power = 10.0 ** np.floor(np.log10(part / longest))
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= part / longest)
    return float(f"{step * power:.1g}")


def _lines(text: str, letters: int, most: int) -> list[str]:
    """A text in lines of so many letters; the end of a longer one is left away."""
    return wrap(text, letters, max_lines=most, placeholder=" …")
