"""``posedesign board`` as a person types it."""

import re
import zlib

import cv2
import numpy as np
import pytest

from calib.vision.boards import detect_board
from posedesign.cell import Cell

BOARD = """
[board]
kind = "charuco"
columns = 7
rows = 5
square_mm = 25.0
marker_mm = 18.0
dictionary = "5x5_100"
"""


@pytest.fixture
def cell(cli, tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(cli("new").out + BOARD)
    return path


def test_svg_is_to_scale(done, cell, tmp_path):
    out = tmp_path / "board.svg"
    said = done("board", cell, "--out", out)
    assert "ChArUco board of 7 x 5 squares of 25 mm" in said.out
    text = out.read_text()
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in text
    black = re.search(r'<path d="(M[^"]*Z)"/>', text)[1]
    boxes = np.array(re.findall(r"M([\d.]+) ([\d.]+)H([\d.]+)V([\d.]+)", black), dtype=float)
    assert np.ptp(boxes[:, [0, 2]]) == pytest.approx(175.0)
    assert np.ptp(boxes[:, [1, 3]]) == pytest.approx(125.0)
    done("board", cell, "--out", out)  # its own file


def drawn_in(data: bytes) -> bytes:
    """What a page of PDF draws."""
    stream = data.index(b"stream", data.index(b"/Filter /FlateDecode")) + 7
    return zlib.decompressobj().decompress(data[stream:])


def test_pdf_is_to_scale(done, cell, tmp_path, rendered):
    out = tmp_path / "board.pdf"
    done("board", cell, "--out", out, "--page", "a3")
    data = out.read_bytes()
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+)", data)
    assert np.array(box.groups(), dtype=float) == pytest.approx(np.array([297, 420]) / 25.4 * 72)
    drawn = drawn_in(data)
    corners = np.array(re.findall(rb"([\d.]+) ([\d.]+) [ml]\n", drawn), dtype=float) / 72 * 25.4
    inside = corners[(corners > 1).all(axis=1) & (corners[:, 1] > 30)]  # not sheet and ruler
    inside = inside[(inside < [296, 419]).all(axis=1)]
    assert np.ptp(inside, axis=0) == pytest.approx([175.0, 125.0], abs=1e-3)


@pytest.fixture
def round_cell(cli, tmp_path):
    path = tmp_path / "round.toml"
    path.write_text(cli("new").out + '\n[board]\nkind = "round-target"\ndiameter_mm = 150.0\n')
    return path


def test_a_round_target_is_drawn_white_in_black(cli, done, round_cell, tmp_path, rendered):
    out = tmp_path / "round.svg"
    said = cli("board", round_cell, "--out", out)
    assert "round target of 150 mm with a cross and three squares" in said.out
    text = out.read_text()
    assert 'cx="105" cy="137.5" r="75"' in text
    white = re.search(r'<path d="(M[^"]*Z)" fill="#fff"/>', text[text.index("<circle") :])[1]
    boxes = np.array(re.findall(r"M([\d.]+) ([\d.]+)H([\d.]+)V([\d.]+)", white), dtype=float)
    assert len(boxes) == 5
    assert np.ptp(boxes[:, [0, 2]]) == pytest.approx(0.72 * 150.0)
    picture = np.full((4 * 297, 4 * 210), 230, np.uint8)
    cv2.circle(picture, (4 * 105, 4 * 137 + 2), 4 * 75, 20, -1)
    for x0, y0, x1, y1 in np.rint(4 * boxes).astype(int):
        picture[y0:y1, x0:x1] = 230
    sighting = detect_board(cv2.GaussianBlur(picture, (0, 0), 1.0), Cell.load(round_cell).board)
    wanted = 4 * (1e3 * Cell.load(round_cell).board.points[:, :2] + [105.0, 137.5])
    np.testing.assert_allclose(sighting.pixels, wanted, atol=0.02)
    pdf = tmp_path / "round.pdf"
    done("board", round_cell, "--out", pdf)
    drawn = drawn_in(pdf.read_bytes())
    after = drawn[drawn.rindex(b" c\n") :]  # the circle is of curves, what is white comes later
    corners = np.array(re.findall(rb"([\d.]+) ([\d.]+) [ml]\n", after), dtype=float) / 72 * 25.4
    assert b" g" not in after[: after.index(b" m\n")]  # filled by what the page began with, white
    assert re.search(rb"([\d.]+) g\n", drawn)[1] == b"1"
    np.testing.assert_allclose(corners[0], [boxes[0, 0], 297.0 - boxes[0, 1]], atol=1e-3)


def test_what_cannot_be_printed_is_refused(cli, refuse, cell, tmp_path):
    refuse("board", cell, "--out", tmp_path / "b.png").says(".svg or .pdf")
    refuse("board", cell, "--out", tmp_path / "b.svg", "--page", "a44").says("a4")
    cell.write_text(cell.read_text().replace("square_mm = 25.0", "square_mm = 60.0"))
    refuse("board", cell, "--out", tmp_path / "b.svg").says("does not go on a page a4")
    cell.write_text(cell.read_text().replace("marker_mm = 18.0", "marker_mm = 90.0"))
    refuse("board", cell, "--out", tmp_path / "b.svg").says("key board", "do not go into squares")
    cell.write_text(cli("new").out)
    refuse("board", cell, "--out", tmp_path / "b.svg").says("no calibration board", "[board]")


def test_inner_corners_and_a_large_dot_are_keys_of_a_board(cli, cell, done, refuse, tmp_path):
    text = cell.read_text()
    counts = "columns = 7\nrows = 5\n"
    assert counts in text
    cell.write_text(text.replace(counts, "inner_corners = [6, 4]\n"))
    said = done("board", cell, "--out", tmp_path / "a.svg")
    assert "ChArUco board of 7 x 5 squares of 25 mm" in said.out
    cell.write_text(text.replace(counts, counts + "inner_corners = [7, 5]\n"))
    refuse("board", cell, "--out", tmp_path / "b.svg").says("7 x 5 inner corners are 8 x 6 squares")
    board = 'kind = "circles"\ncolumns = 10\nrows = 10\nspacing_mm = 16.0\nlarge_dot_mm = 12.0\n'
    cell.write_text(cli("new").out + "\n[board]\n" + board)
    said = done("board", cell, "--out", tmp_path / "c.svg")
    assert "the left upper one of 12 mm" in said.out
