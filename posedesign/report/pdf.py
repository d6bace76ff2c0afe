"""Sheets of pictures as PDF: pictures with lines, circles and words on top.

Pictures are stored as JPEG. matplotlib stores them without loss, and takes as long to load what it
writes PDF with as a sheet takes to be drawn here a hundred times: it draws what has axes.

Letters are those of Helvetica, which every reader has; others stand by their number in Unicode.
Source: ISO 32000-1:2008 (PDF 1.7), 7.5 files, 8.5 paths, 8.9 pictures, 9.6.2.2 fonts.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera.rendering import GreyImage

_FONTS = ("Helvetica", "Helvetica-Bold")
_ENCODING = "cp1252"
"""That PDF calls WinAnsiEncoding."""

_ROUND = 0.5523
"""Of a quarter of a circle, distance of the control points from its ends over the radius."""

_QUALITY = 80
"""Of JPEG: edges of squares stay clear."""


class Page:
    """A page of PDF; lengths in points (1/72 inch) from its left lower corner."""

    def __init__(self, width: float, height: float) -> None:
        self.size = width, height
        self.pictures: list[GreyImage] = []
        self.marks: list[bytes] = []
        """What is drawn, in the language of PDF, one after the other."""

    def add_picture(self, picture: GreyImage, box: tuple[float, float, float, float]) -> None:
        """Draw a picture into a box: left and lower edge, width and height."""
        left, below, width, height = box
        place = f"q {width:.2f} 0 0 {height:.2f} {left:.2f} {below:.2f} cm"
        self._add(f"{place} /P{len(self.pictures)} Do Q")
        self.pictures.append(picture)

    def add_lines(self, lines: FloatArray, colour: str, width: float) -> None:
        """Draw lines ``(K, P, 2)``, each through P points."""
        self._add(f"{_colour(colour)} RG {width:g} w")
        for line in lines.tolist():
            start, *rest = (f"{x:.2f} {y:.2f}" for x, y in line)
            self._add(f"{start} m {' '.join(f'{point} l' for point in rest)} S")

    def add_circles(self, centres: FloatArray, radius: float, colour: str, width: float) -> None:
        """Draw circles about points ``(K, 2)``."""
        self._add(f"{_colour(colour)} RG {width:g} w")
        turned = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]], dtype=float)
        arcs = [
            [turned[k] + _ROUND * turned[k + 1], turned[k + 1] + _ROUND * turned[k], turned[k + 1]]
            for k in range(4)
        ]
        shape = radius * np.concatenate([turned[:1], *arcs])  # shape (13, 2)
        for centre in centres:
            x = [f"{a:.2f} {b:.2f}" for a, b in (centre + shape).tolist()]
            curves = (" ".join(x[k : k + 3]) + " c" for k in range(1, len(x), 3))
            self._add(f"{x[0]} m {' '.join(curves)} s")

    def add_text(
        self,
        text: str,
        at: tuple[float, float],
        size: float,
        colour: str = "#000000",
        *,
        bold: bool = False,
    ) -> None:
        """Write a line of words from a point on."""
        letters = in_letters(text).encode(_ENCODING)
        for special in (b"\\", b"(", b")"):
            letters = letters.replace(special, b"\\" + special)
        begin = f"BT {_colour(colour)} rg /F{int(bold)} {size:g} Tf {at[0]:.2f} {at[1]:.2f} Td ("
        self.marks.append(begin.encode() + letters + b") Tj ET")

    def _add(self, mark: str) -> None:
        self.marks.append(mark.encode())


def in_letters(text: str) -> str:
    """A text in letters that there are on a page, others by their number in Unicode."""
    shown = "".join(letter if letter.isprintable() else " " for letter in text)
    return shown.encode(_ENCODING, "backslashreplace").decode(_ENCODING)


def as_pdf(pages: Iterable[Page], title: str) -> bytes:
    """Pages as a file; the same bytes each time. ``title``: of letters of ASCII."""
    import cv2

    catalogue, tree, about = 1, 2, 3
    fonts = [4 + k for k in range(len(_FONTS))]
    named = " ".join(f"/F{k} {number} 0 R" for k, number in enumerate(fonts))
    objects: list[bytes] = [b""] * (3 + len(fonts))
    objects[catalogue - 1] = f"<< /Type /Catalog /Pages {tree} 0 R >>".encode()
    objects[about - 1] = f"<< /Title ({title}) >>".encode()
    for number, font in zip(fonts, _FONTS, strict=True):
        objects[number - 1] = (
            f"<< /Type /Font /Subtype /Type1 /BaseFont /{font} /Encoding /WinAnsiEncoding >>"
        ).encode()
    kids = []
    for page in pages:
        drawn = []
        for k, picture in enumerate(page.pictures):
            _, packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            height, width = picture.shape
            said = f"/Type /XObject /Subtype /Image /Width {width} /Height {height} "
            said += "/ColorSpace /DeviceGray /BitsPerComponent 8 /Filter /DCTDecode"
            objects.append(_stream(said, packed.tobytes()))
            drawn.append(f"/P{k} {len(objects)} 0 R")
        objects.append(_stream("/Filter /FlateDecode", zlib.compress(b"\n".join(page.marks))))
        width, height = page.size
        objects.append(
            f"<< /Type /Page /Parent {tree} 0 R /MediaBox [0 0 {width:g} {height:g}] "
            f"/Contents {len(objects)} 0 R "
            f"/Resources << /Font << {named} >> /XObject << {' '.join(drawn)} >> >> >>".encode()
        )
        kids.append(f"{len(objects)} 0 R")
    objects[tree - 1] = f"<< /Type /Pages /Count {len(kids)} /Kids [{' '.join(kids)}] >>".encode()
    data = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
    table = [b"0000000000 65535 f \n"]
    for number, content in enumerate(objects, 1):
        table.append(b"%010d 00000 n \n" % len(data))
        data += b"%d 0 obj\n%s\nendobj\n" % (number, content)
    start = len(data)
    data += b"xref\n0 %d\n%s" % (len(table), b"".join(table))
    data += b"trailer\n<< /Size %d /Root %d 0 R /Info %d 0 R >>\n" % (len(table), catalogue, about)
    return bytes(data + b"startxref\n%d\n%%%%EOF\n" % start)


def _stream(said: str, content: bytes) -> bytes:
    head = f"<< {said} /Length {len(content)} >>\nstream\n"
    return head.encode() + content + b"\nendstream"


def _colour(code: str) -> str:
    """Red, green and blue of a colour as ``#RRGGBB``, from 0 to 1."""
    return " ".join(f"{value / 255.0:.3f}" for value in bytes.fromhex(code[1:]))
