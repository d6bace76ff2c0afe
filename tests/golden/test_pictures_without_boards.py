"""In hundreds of pictures without the board there is none: noise, print, dots, mosaics, tiles."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from calib.vision.boards import board_picture, detect_board
from tests.board_pictures import BOARDS

MORE = 6
"""Times more pictures for a round target, which has less in it than any other board."""
SIZE = HEIGHT, WIDTH = 480, 640

Grey = np.ndarray
Clutter = Callable[[np.random.Generator], Grey]


def noise(rng: np.random.Generator) -> Grey:
    grey = rng.integers(0, 256, SIZE, dtype=np.uint8)
    return cv2.GaussianBlur(grey, (0, 0), rng.uniform(0.3, 8.0))


def stripes(rng: np.random.Generator) -> Grey:
    y, x = np.indices(SIZE)
    angle, period = rng.uniform(0, np.pi), rng.uniform(6, 40)
    return 127 + 100 * np.sign(np.sin((x * np.cos(angle) + y * np.sin(angle)) * 2 * np.pi / period))


def bricks(rng: np.random.Generator) -> Grey:
    y, x = np.indices(SIZE)
    side = rng.integers(12, 50)
    row = y // side
    along = x + (row % 2) * side
    grey = 120.0 + (row * 37 + along // (2 * side) * 91) % 60
    grey[(y % side < 3) | (along % (2 * side) < 3)] = 220
    return grey + rng.normal(0, 4, SIZE)


def print_(rng: np.random.Generator) -> Grey:
    grey = np.full(SIZE, 230, np.uint8)
    for _ in range(80):
        text = "".join(map(chr, rng.integers(33, 127, 12)))
        place = int(rng.integers(0, WIDTH)), int(rng.integers(10, HEIGHT))
        font, size = int(rng.integers(0, 8)), rng.uniform(0.3, 1.6)
        cv2.putText(grey, text, place, font, size, int(rng.integers(0, 200)), 1)
    return grey


def dots(rng: np.random.Generator) -> Grey:
    grey = np.full(SIZE, int(rng.integers(60, 240)), np.uint8)
    for x, y, radius, value in rng.integers([0, 0, 3, 0], [WIDTH, HEIGHT, 25, 256], (150, 4)):
        cv2.circle(grey, (int(x), int(y)), int(radius), int(value), -1)
    return grey


def codes(rng: np.random.Generator) -> Grey:
    """Black squares with random cells: markers of no dictionary, or of one by chance."""
    grey = np.full(SIZE, 150, np.uint8)
    for _ in range(60):
        side = int(rng.integers(20, 70)) // 6 * 6
        code = np.zeros((side, side), np.uint8)
        cell = side // 6
        bits = 255 * rng.integers(0, 2, (4, 4), dtype=np.uint8)
        code[cell:-cell, cell:-cell] = np.kron(bits, np.ones((cell, cell), np.uint8))
        x, y = int(rng.integers(5, WIDTH - side - 5)), int(rng.integers(5, HEIGHT - side - 5))
        grey[y - 5 : y + side + 5, x - 5 : x + side + 5] = 230
        grey[y : y + side, x : x + side] = code
    return grey


def mosaic(rng: np.random.Generator) -> Grey:
    side = int(rng.integers(8, 50))
    cells = 20 + 200 * rng.integers(0, 2, (HEIGHT // side + 1, WIDTH // side + 1), dtype=np.uint8)
    return np.kron(cells, np.ones((side, side), np.uint8))[:HEIGHT, :WIDTH]


def squares_without_end(rng: np.random.Generator) -> Grey:
    y, x = np.indices(SIZE)
    side = int(rng.integers(14, 60))
    return 25 + 200 * ((x // side + y // side) % 2)


def windows_without_end(rng: np.random.Generator) -> Grey:
    y, x = np.indices(SIZE)
    side = int(rng.integers(14, 60))
    return np.where((x % side < 0.7 * side) & (y % side < 0.7 * side), 40, 210)


def circles_without_end(rng: np.random.Generator) -> Grey:
    y, x = np.indices(SIZE)
    side = int(rng.integers(14, 60))
    return np.where(np.hypot(x % side - side / 2, y % side - side / 2) < 0.25 * side, 30, 220)


CLUTTER: tuple[Clutter, ...] = (
    noise, stripes, bricks, print_, dots, codes, mosaic,
    squares_without_end, windows_without_end, circles_without_end,
)  # fmt: skip


def of_another_board(rng: np.random.Generator, name: str) -> Grey:
    """One of the other boards, seen at a slant."""
    board = BOARDS[name]
    ideal = board_picture(board, 2000.0, board.cell_m)
    high, wide = ideal.shape
    corners = np.array([[0, 0], [wide, 0], [wide, high], [0, high]], np.float32)
    middle, half = np.array([WIDTH, HEIGHT]) / 2, np.array([wide, high]) * 0.42
    half *= min(WIDTH / wide, HEIGHT / high)
    seen = middle + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    seen += rng.uniform(-0.1, 0.1, (4, 2)) * half
    plane = cv2.getPerspectiveTransform(corners, seen.astype(np.float32))
    return cv2.warpPerspective(ideal, plane, (WIDTH, HEIGHT), borderValue=(90,))


def found_where_none_is(name: str, count: int) -> list[tuple[int, str, int]]:
    rng = np.random.default_rng(2024)
    others = [other for other in BOARDS if other != name]
    found = []
    for k in range(count):
        drawn, kind = divmod(k, len(CLUTTER) + 1)
        if kind < len(CLUTTER):
            what, grey = CLUTTER[kind].__name__, CLUTTER[kind](rng)
        else:
            what = others[drawn % len(others)]
            grey = of_another_board(rng, what)
        picture = cv2.GaussianBlur(np.clip(grey, 0, 255).astype(np.uint8), (0, 0), 0.8)
        sighting = detect_board(picture, BOARDS[name])
        if sighting.status == "ok" or sighting.seen.any():
            found.append((k, what, int(sighting.seen.sum())))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, pytest.param(8, marks=pytest.mark.full)])
@pytest.mark.parametrize("name", BOARDS)
def test_no_board_where_there_is_none(name: str, times: int) -> None:
    count = times * (len(CLUTTER) + 1)
    assert not found_where_none_is(name, MORE * count if name == "round-target" else count)


def test_no_round_target_where_there_is_none() -> None:
    assert not found_where_none_is("round-target", len(CLUTTER) + 1)


@pytest.mark.parametrize("name", BOARDS)
def test_the_same_pictures_show_their_own_board(name: str) -> None:
    """The test above cannot pass by finding nothing at all."""
    picture = of_another_board(np.random.default_rng(3), name)
    assert detect_board(picture, BOARDS[name]).status == "ok"
