"""Calibration boards printed to scale: a drawing in millimetres, as SVG or PDF."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from calib.errors import InputError, near_names
from calib.se3 import FloatArray
from calib.vision.boards import Board
from posedesign.files import write_bytes_atomic

PAGES_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Width and height of sheets that stand upright."""

AS_THE_BOARD = "board"
"""Name of a page as large as the board needs."""

EDGE_MM = 6.0
"""Of a sheet, what printers leave white."""

FOOT_MM = 22.0
"""Height of ruler and words below the pattern."""

RULER_MM = 100.0

_LINE_MM = 0.2
_TEXT_MM = 3.0
_MM_PER_INCH, _POINTS_PER_INCH = 25.4, 72.0


@dataclass(frozen=True, eq=False)
class Sheet:
    """A board on a sheet of paper; all in mm from its left upper corner."""

    width_mm: float
    height_mm: float  # width_mm, height_mm: of the sheet
    rectangles: FloatArray  # (M, 4): left, top, right and bottom of what is black
    discs: FloatArray  # (D, 3): centre and radius of what is black and round
    cut_out: FloatArray  # (C, 4): left, top, right and bottom of what is white in it
    lines: FloatArray  # (L, 4): of the ruler, from x, y to x, y
    texts: tuple[tuple[float, float, str], ...]  # where each line of text begins, and the text

    @classmethod
    def of(cls, board: Board, page: str = "a4") -> Sheet:
        """The board on a page, upright or across, with its ruler and its words.

        Raises InputError: an unknown page, or one that the board does not fit on.
        """
        if page.lower() not in (*PAGES_MM, AS_THE_BOARD):
            raise InputError(
                f"there is no page {page!r}",
                hint=near_names(page, (*PAGES_MM, AS_THE_BOARD)),
                name="page",
            )
        # white around the pattern is part of it: markers and circles are not found without
        white = max(EDGE_MM, 0.3e3 * board.cell_m)
        words = (
            board.words,
            f"{RULER_MM:g} mm? Print at 100 %, not fitted to the page; then measure the "
            "ruler and the pattern.",
        )
        pattern = 1e3 * np.array(board.size_m)
        widest_text = 0.52 * _TEXT_MM * max(map(len, words)) + 2 * EDGE_MM
        across = max(pattern[0] + 2 * white, RULER_MM + 2 * EDGE_MM, widest_text)
        down = pattern[1] + 2 * white + FOOT_MM
        width, height = _page(page.lower(), across, down, board)
        left, top = (width - pattern[0]) / 2, (height - FOOT_MM - pattern[1]) / 2
        corner = np.array([left, top]) - 1e3 * board.box[:2]
        rectangles, discs = board.printed
        start, base = (width - RULER_MM) / 2, height - EDGE_MM - 9.0
        return cls(
            width,
            height,
            1e3 * rectangles + np.tile(corner, 2),
            1e3 * discs + [*corner, 0.0],
            1e3 * board.cut_out + np.tile(corner, 2),
            np.array(list(_ruler(start, base))),
            (
                (start - 1.0, base - 4.5, "0"),
                (start + RULER_MM - 2.0, base - 4.5, f"{RULER_MM:g} mm"),
                (EDGE_MM, height - EDGE_MM - 4.0, words[0]),
                (EDGE_MM, height - EDGE_MM, words[1]),
            ),
        )


def _page(page: str, across: float, down: float, board: Board) -> tuple[float, float]:
    if page == AS_THE_BOARD:
        return float(np.ceil(across)), float(np.ceil(down))
    short, long = PAGES_MM[page]
    for width, height in ((short, long), (long, short)):
        if across <= width and down <= height:
            return width, height
    wide, tall = (1e3 * side for side in board.size_m)
    raise InputError(
        f"a pattern of {wide:.4g} x {tall:.4g} mm does not go on a page {page}: with white, ruler "
        f"and words it takes {across:.0f} x {down:.0f} mm",
        hint=f"take a larger page, or {AS_THE_BOARD!r} for one of its size; or smaller squares",
        name="page",
    )


def _ruler(left: float, base: float) -> Iterator[list[float]]:
    yield [left, base, left + RULER_MM, base]
    for mark in range(int(RULER_MM) + 1):
        length = 4.0 if mark % 10 == 0 else 2.5 if mark % 5 == 0 else 1.5
        yield [left + mark, base, left + mark, base - length]


def write_board(board: Board, path: os.PathLike[str], *, page: str = "a4") -> None:
    """Write a board to scale, as a vector drawing.

    ``path``: ends in ``.svg`` or ``.pdf``. ``page``: one of :data:`PAGES_MM`, or ``"board"`` for a
    page of its size. Raises InputError: another ending, an unknown page, or one that the board does
    not fit on. OutputError: the file cannot be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in (".svg", ".pdf"):
        raise InputError(
            f"{path}: a board is written as .svg or .pdf, not {ending or 'without an ending'}",
            hint="give the file one of these endings",
            name="out",
        )
    sheet = Sheet.of(board, page)
    write_bytes_atomic(path, as_svg(sheet).encode() if ending == ".svg" else as_pdf(sheet))


def as_svg(sheet: Sheet) -> str:
    """The sheet as SVG, in millimetres."""
    width, height = _number(sheet.width_mm), _number(sheet.height_mm)
    # one path: rectangles that touch leave no hair line between them
    black, white = (
        "".join(
            f"M{_number(x0)} {_number(y0)}H{_number(x1)}V{_number(y1)}H{_number(x0)}Z"
            for x0, y0, x1, y1 in rectangles
        )
        for rectangles in (sheet.rectangles, sheet.cut_out)
    )
    ruler = "".join(
        f"M{_number(x0)} {_number(y0)}L{_number(x1)} {_number(y1)}"
        for x0, y0, x1, y1 in sheet.lines
    )
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}">',
            f'<rect width="{width}" height="{height}" fill="#fff"/>',
            *([f'<path d="{black}"/>'] if black else []),
            *(
                f'<circle cx="{_number(x)}" cy="{_number(y)}" r="{_number(r)}"/>'
                for x, y, r in sheet.discs
            ),
            *([f'<path d="{white}" fill="#fff"/>'] if white else []),
            f'<path d="{ruler}" fill="none" stroke="#000" stroke-width="{_LINE_MM:g}"/>',
            *(
                f'<text x="{_number(x)}" y="{_number(y)}" font-family="sans-serif" '
                f'font-size="{_TEXT_MM:g}">{escape(text)}</text>'
                for x, y, text in sheet.texts
            ),
            "</svg>\n",
        ]
    )


def as_pdf(sheet: Sheet) -> bytes:
    """The sheet as a page of PDF; the same bytes each time."""
    import matplotlib
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, PathPatch
    from matplotlib.path import Path as Outline

    points = _POINTS_PER_INCH / _MM_PER_INCH
    figure = Figure(figsize=(sheet.width_mm / _MM_PER_INCH, sheet.height_mm / _MM_PER_INCH))
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0), frame_on=False)
    panel.set(xlim=(0.0, sheet.width_mm), ylim=(sheet.height_mm, 0.0), xticks=[], yticks=[])
    for x, y, radius in sheet.discs:
        panel.add_patch(Circle((x, y), radius, facecolor="black", linewidth=0.0))
    for color, rectangles in (("black", sheet.rectangles), ("white", sheet.cut_out)):
        if len(rectangles):
            corners = rectangles[:, [0, 1, 2, 1, 2, 3, 0, 3, 0, 1]].reshape(-1, 2)
            codes = [Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY] * len(rectangles)
            panel.add_patch(PathPatch(Outline(corners, codes), facecolor=color, linewidth=0.0))
    ends = sheet.lines.reshape(-1, 2, 2)
    panel.add_collection(LineCollection(list(ends), colors="black", linewidths=_LINE_MM * points))
    for x, y, text in sheet.texts:
        panel.text(x, y, text, fontsize=_TEXT_MM * points, va="baseline", parse_math=False)
    data = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42, "path.simplify": False}):
        figure.savefig(data, format="pdf", metadata={"CreationDate": None, "Title": "board"})
    return data.getvalue()


def _number(value: float) -> str:
    """A length to a tenth of a micrometre."""
    return f"{value:.4f}".rstrip("0").rstrip(".")
