"""Boards, against OpenCV's own, and found in pictures that OpenCV warps."""

import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from calib.lens import Lens
from calib.se3 import transform
from calib.vision.boards import board_picture, detect_board, make_board
from calib.vision.boards.circles import dark_ellipses
from calib.vision.boards.picture import BoardPlate
from tests.board_pictures import BOARDS, Camera


def picture_of(board, **changes):
    """A picture of the board by OpenCV's warping, and where its points are in it."""
    picture, seen = _taken(board, **changes)
    return picture.copy(), seen


@cache
def made(kind, columns, rows):
    """A board of which only the size matters."""
    size = {"square_m": 0.025} if kind == "chessboard" else {"spacing_m": 0.03}
    return make_board(kind, columns=columns, rows=rows, **size)


@cache
def _taken(board, *, tilt_deg=30.0, blur_px=1.0, noise=3.0, margin=0.3, px=640):
    size, focal, scale = (px, px * 3 // 4), px / 0.96, 6000.0
    about = np.ceil(margin * board.cell_m * scale) / scale  # whole pixels
    ideal = cv2.copyMakeBorder(board_picture(board, scale, about), 9, 9, 9, 9, 0, value=255)
    left, top = board.box[:2] - about
    to_ideal = np.array(
        [[scale, 0, -left * scale + 8.5], [0, scale, -top * scale + 8.5], [0, 0, 1]]
    )
    tilt = np.deg2rad(tilt_deg) * np.array([0.8, 0.6, 0.0])
    turn = cv2.Rodrigues(tilt)[0]
    middle = np.append(board.outline[:, :2].mean(axis=0), 0.0)
    shift = (
        np.array([0.0, 0.0, 1000.0 * max(board.size_m[0] / 600, board.size_m[1] / 450)])
        - turn @ middle
    )
    camera = np.array([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1]])
    plane = camera @ np.column_stack([turn[:, :2], shift])
    fine = np.array([[3.0, 0, 1], [0, 3, 1], [0, 0, 1]])  # three times as fine, then averaged
    warped = cv2.warpPerspective(
        cv2.GaussianBlur(ideal, (0, 0), 0.6),
        fine @ plane @ np.linalg.inv(to_ideal),
        (3 * size[0], 3 * size[1]),
        flags=cv2.INTER_LINEAR,
        borderValue=90,
    )
    grey = cv2.resize(warped, size, interpolation=cv2.INTER_AREA).astype(float)
    grey = cv2.GaussianBlur(30 + 0.7 * grey, (0, 0), blur_px)
    grey += np.random.default_rng(4).normal(0, noise, grey.shape)
    seen = board.points[:, :2] @ plane[:, :2].T + plane[:, 2]
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), seen[:, :2] / seen[:, 2:] + 0.5


@pytest.mark.parametrize("legacy", [False, True])
def test_charuco_is_that_of_opencv(legacy):
    board = make_board(
        "charuco", columns=8, rows=6, square_m=0.03, marker_m=0.021, dictionary="5X5_100",
        legacy=legacy,
    )  # fmt: skip
    theirs = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.021, board.markers)
    theirs.setLegacyPattern(legacy)
    np.testing.assert_allclose(theirs.getChessboardCorners(), board.points, atol=1e-7)
    np.testing.assert_allclose(
        np.array(theirs.getObjPoints())[..., :2], board.marker_corners, atol=1e-7
    )
    np.testing.assert_array_equal(board_picture(board, 1e4 / 3), theirs.generateImage((800, 600)))


def test_grid_is_that_of_opencv():
    board = make_board(
        "aruco-grid", columns=5, rows=4, spacing_m=0.03, marker_m=0.024, dictionary="4x4_50"
    )
    theirs = cv2.aruco.GridBoard((5, 4), 0.024, 0.006, board.markers)
    np.testing.assert_allclose(
        np.array(theirs.getObjPoints()).reshape(-1, 3), board.points, atol=1e-7
    )
    picture = board_picture(board, 5e3)
    np.testing.assert_array_equal(picture, theirs.generateImage(picture.shape[::-1]))


TAG_0 = 0xD5D628584
"""First tag of 36h11, its 36 bits row by row from the left upper one, white bits set.

Source: Olson, AprilTag: a robust and flexible visual fiducial system, ICRA 2011, ``Tag36h11`` of
the AprilTags C++ library, which Kalibr's ``kalibr_create_target_pdf`` prints.
"""


@pytest.mark.parametrize("kind", ["apriltag-grid", "kalibr-aprilgrid"])
def test_tags_are_upright_as_april_robotics_and_kalibr_print_them(kind):
    board = BOARDS[kind]
    cells = board.border_bits * 2 + 6
    side = board.marker_m / cells
    where = side * (np.arange(6) + board.border_bits + 0.5)
    xy = board.marker_corners[0, 0] + np.stack(np.meshgrid(where, where), axis=-1).reshape(-1, 2)
    bits = "".join("01"[not black] for black in board.is_black(xy))
    assert int(bits, 2) == TAG_0


def test_printed_tags_are_upright_for_another_decoder():
    """That of AprilRobotics, by the package pupil-apriltags: from the left lower corner on."""
    decoders = pytest.importorskip("pupil_apriltags", reason="pupil-apriltags is not installed")
    board = make_board("apriltag-grid", columns=3, rows=2, spacing_m=0.03, marker_m=0.024)
    picture = board_picture(board, 4e3, 0.02)
    tags = decoders.Detector(families="tag36h11").detect(picture)
    assert [tag.tag_id for tag in tags] == list(range(6))
    for tag, corners in zip(tags, board.marker_corners, strict=True):
        np.testing.assert_allclose(tag.corners, 4e3 * (corners[[3, 2, 1, 0]] + 0.02), atol=1.5)


@pytest.mark.parametrize("turn", [0, 2])
def test_apriltags_are_read_upright_and_as_opencv_draws_them(turn):
    board = BOARDS["apriltag-grid"]
    picture = np.full((5 * 150, 6 * 150), 255, np.uint8)
    for number, corner in enumerate(5e3 * board.marker_corners[:, 0]):
        tag = np.rot90(board.markers.generateImageMarker(number, 120), turn)
        x, y = np.rint(corner).astype(int) + 75
        picture[y : y + 120, x : x + 120] = tag
    sighting = detect_board(cv2.GaussianBlur(picture, (0, 0), 1.0), board)
    assert (sighting.status, sighting.message) == ("ok", "")
    np.testing.assert_allclose(sighting.pixels, 75 + 5e3 * board.points[:, :2], atol=0.03)


@pytest.mark.parametrize(
    ("kind", "tilt_deg"), [(kind, (0.0, 35.0)[k % 2]) for k, kind in enumerate(BOARDS)]
)
def test_points_are_found_where_they_are(kind, tilt_deg):
    """The bound is thrice the error of noise, and a tenth of what half a pixel would be."""
    board = BOARDS[kind]
    picture, truth = picture_of(board, tilt_deg=tilt_deg)
    sighting = detect_board(picture, board)
    assert (sighting.status, sighting.message) == ("ok", "")
    assert sighting.seen.mean() > 0.95
    error = (sighting.pixels - truth)[sighting.seen]
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.abs(error.mean(axis=0)).max() < 0.02
    # a blur of 1 px, that of the pixels besides
    assert sighting.sharpness_px == pytest.approx(2.563 * np.sqrt(1 + 1 / 12), rel=0.2)


@pytest.mark.parametrize("kind", BOARDS)
def test_boards_are_found_at_60_deg_out_of_focus_and_among_dots(kind):
    board = BOARDS[kind]
    picture, truth = picture_of(board, tilt_deg=60.0, blur_px=2.0, px=960)
    corners = truth.min(axis=0), truth.max(axis=0)
    (left, top), (right, bottom) = np.rint([corners[0] - 70, corners[1] + 70]).astype(int)
    junk = np.full_like(picture, 150)
    rng = np.random.default_rng(3)
    for x, y, radius, grey in rng.integers([0, 0, 4, 20], [960, 720, 26, 240], (150, 4)):
        cv2.circle(junk, (int(x), int(y)), int(radius), int(grey), -1)
    junk[top:bottom, left:right] = picture[top:bottom, left:right]
    sighting = detect_board(junk, board)
    assert (sighting.status, sighting.message) == ("ok", "")
    assert np.sqrt(np.mean((sighting.pixels - truth)[sighting.seen] ** 2)) < 0.3


@pytest.mark.parametrize(
    ("kind", "tilt_deg"),
    [("chessboard", 0.0), ("circles", 60.0), ("asymmetric-circles", 0.0), ("round-target", 60.0)],
)
def test_boards_are_found_in_the_noise_of_the_dark(kind, tilt_deg):
    """Thirty grey levels of 178: specks of it are as dark as circles."""
    picture, truth = picture_of(BOARDS[kind], tilt_deg=tilt_deg, noise=30.0)
    sighting = detect_board(picture, BOARDS[kind])
    assert (sighting.status, sighting.message) == ("ok", "")
    assert np.sqrt(np.mean((sighting.pixels - truth)[sighting.seen] ** 2)) < 0.3


@pytest.mark.parametrize("kind", ["circles", "asymmetric-circles"])
def test_circles_of_which_a_row_is_hidden_are_no_whole_board(kind):
    """Among dots one of these would be taken for a circle, and all others for their neighbours."""
    board = BOARDS[kind]
    picture, truth = picture_of(board, px=640)
    first = board.points[:, 1] == 0.0
    bottom = int(truth[first, 1].max() + 0.35 * np.ptp(truth[:, 1]) / 6)
    picture[:bottom] = 90
    assert not detect_board(picture, board).is_ok


@pytest.mark.parametrize(
    ("columns", "rows", "across", "step"),
    [
        (*size, step)
        for size in [(10, 7, False), (8, 7, False), (8, 7, True), (8, 8, False), (9, 7, False)]
        for step in ([(1, 0), (0, -1)] if size[0] == 8 else [(-1, 0), (0, 1)])
    ],
)
def test_a_row_of_corners_in_the_white_is_none_of_a_chessboard(
    monkeypatch, columns, rows, step, across
):
    """OpenCV saw one in a rehearsal, and the board was refused as a larger one."""
    board = made("chessboard", columns, rows)
    picture, truth = picture_of(board, margin=1.5)
    plane = cv2.findHomography(board.points[:, :2], truth - 0.5)[0]
    xy = board.points[:, :2] + 0.025 * np.array(step)
    if across:  # a row more is seen, and a column less
        xy = np.array([[x, y] for x in range(columns - 2) for y in range(rows)])
        xy = 0.025 * (xy + np.array([max(step[0], 0), min(sum(step), 0)]))
    found = cv2.perspectiveTransform(xy[None], plane)[0, :, None].astype(np.float32)
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda *_, flags: (True, found))
    sighting = detect_board(picture, board)
    assert (sighting.status, sighting.message) == ("ok", "")
    off = [sighting.pixels - way for way in (truth, truth[::-1])]
    assert min(np.abs(each).max() for each in off) < 0.2


@pytest.mark.parametrize(
    ("kind", "columns", "rows", "more"),
    [
        ("chessboard", 6, 8, (1, 0)),
        ("chessboard", 6, 8, (-1, -1)),
        ("circles", 8, 5, (0, 1)),
        ("circles", 8, 5, (1, 1)),
    ],
)
def test_a_board_of_another_size_is_named_by_it(kind, columns, rows, more):
    """In the picture it is of one size, and described of one near to it."""
    picture, _ = picture_of(made(kind, columns, rows), px=560)
    sighting = detect_board(picture, made(kind, columns + more[0], rows + more[1]))
    assert sighting.status == "another board"
    assert f"{columns} x {rows}" in sighting.message or "larger" in sighting.message


@pytest.mark.parametrize("turn", range(4))
def test_an_aprilgrid_of_kalibr_is_found_whichever_way_its_tags_are_turned(turn):
    """Drawn by OpenCV, tag by tag; the first is the left lower one."""
    board = BOARDS["kalibr-aprilgrid"]
    px, side, step = 20, 200, 260  # of a cell, a tag, and from tag to tag
    picture = np.full((4 * step + 160, 6 * step + 160), 255, np.uint8)
    for number in range(24):
        tag = board.markers.generateImageMarker(number, side // px, None, 2)
        tag = np.kron(np.rot90(tag, turn), np.ones((px, px), np.uint8))
        row, column = 3 - number // 6, number % 6
        picture[110 + row * step :, 110 + column * step :][:side, :side] = tag
    for row in range(5):
        for column in range(7):
            picture[50 + row * step :, 50 + column * step :][:60, :60] = 0
    picture = cv2.GaussianBlur(picture, (0, 0), 1.5)
    sighting = detect_board(picture, board)
    assert sighting.is_ok
    assert sighting.seen.mean() > 0.95
    wanted = 110 + 1e4 * board.points[:, :2]
    np.testing.assert_allclose(sighting.pixels[sighting.seen], wanted[sighting.seen], atol=0.03)


def charuco(columns, rows, *, legacy=False, marker_m=0.021):
    return make_board(
        "charuco", columns=columns, rows=rows, square_m=0.03, marker_m=marker_m,
        dictionary="5x5_100", legacy=legacy,
    )  # fmt: skip


@pytest.mark.parametrize("shown", [(7, 5, False), (8, 6, False), (8, 6, True)])
@pytest.mark.parametrize(
    ("columns", "rows", "legacy"),
    [(-1, -1, False), (1, 1, False), (1, 0, False), (-1, 0, False), (0, -1, False), (0, -1, True)],
)
def test_a_charuco_of_another_layout_is_named_with_the_one_that_fits(shown, columns, rows, legacy):
    """Markers of some rows lie as described: they were taken, and all points were a square off."""
    board = charuco(shown[0], shown[1], legacy=shown[2])
    picture, _ = picture_of(board)
    assert detect_board(picture, board).is_ok
    wrong = charuco(shown[0] + columns, shown[1] + rows, legacy=legacy != shown[2])
    sighting = detect_board(picture, wrong)
    assert sighting.status == "another board"
    if "smaller" not in sighting.message:
        assert f"{shown[0]} columns and {shown[1]} rows or more" in sighting.message
        assert ("(legacy)" in sighting.message) == shown[2]


def test_a_charuco_of_more_rows_than_the_picture_shows_is_named():
    """Its markers are numbered alike, so none of them tells."""
    picture, _ = picture_of(charuco(7, 5), margin=0.8)
    sighting = detect_board(picture, charuco(7, 6))
    assert sighting.status == "another board"
    assert "a smaller board" in sighting.message


def test_the_legacy_pattern_is_told():
    picture, _ = picture_of(charuco(8, 6, legacy=True))
    sighting = detect_board(picture, charuco(8, 6))
    assert sighting.status == "another board"
    assert "(legacy)" in sighting.message


def test_the_size_of_the_markers_of_a_charuco_is_told():
    picture, _ = picture_of(charuco(7, 5))
    sighting = detect_board(picture, charuco(7, 5, marker_m=0.0255))
    assert re.search(r"markers of 0\.(69|7\d) of a square", sighting.message)


@pytest.mark.parametrize("kind", ["aruco-grid", "apriltag-grid", "kalibr-aprilgrid"])
@pytest.mark.parametrize(
    ("columns", "rows", "spacing", "said"),
    [
        (4, 4, 1.0, "5 columns and 4 rows"),
        (6, 4, 1.0, "5 columns and 4 rows"),
        (5, 3, 1.0, "5 columns and 4 rows"),
        (5, 5, 1.0, "a smaller board"),
        (5, 4, 1.25 / 1.3, "of the spacing"),
        (5, 4, 1.4 / 1.3, "of the spacing"),
    ],
)
def test_a_grid_of_markers_of_another_layout_is_named(kind, columns, rows, spacing, said):
    step = 0.026
    usual = {"marker_m": 0.02, "dictionary": "4x4_50" if kind == "aruco-grid" else "36h11"}
    board = make_board(kind, columns=5, rows=4, spacing_m=step, **usual)
    picture, _ = picture_of(board, px=960, margin=3.0)
    assert detect_board(picture, board).is_ok
    wrong = make_board(kind, columns=columns, rows=rows, spacing_m=spacing * step, **usual)
    sighting = detect_board(picture, wrong)
    assert sighting.status == "another board"
    assert said in sighting.message


@pytest.mark.parametrize("kind", ["apriltag-grid", "kalibr-aprilgrid"])
def test_grids_of_tags_with_and_without_squares_are_told_apart(kind):
    size = {"columns": 5, "rows": 4, "spacing_m": 0.026, "marker_m": 0.02}
    picture, _ = picture_of(make_board(kind, **size), px=960)
    other = {"apriltag-grid", "kalibr-aprilgrid"} - {kind}
    sighting = detect_board(picture, make_board(other.pop(), **size))
    assert sighting.status == "another board"
    assert kind in sighting.message


def test_a_mirrored_picture_is_named():
    picture, _ = picture_of(BOARDS["charuco"])
    sighting = detect_board(np.ascontiguousarray(picture[:, ::-1]), BOARDS["charuco"])
    assert sighting.status == "another board"
    assert "mirrored" in sighting.message


@pytest.mark.parametrize("kind", ["circles", "asymmetric-circles"])
def test_white_circles_on_black_are_found(kind):
    picture, truth = picture_of(BOARDS[kind])
    sighting = detect_board(255 - picture, BOARDS[kind])
    assert (sighting.status, sighting.message) == ("ok", "")
    assert np.sqrt(np.mean((sighting.pixels - truth) ** 2)) < 0.05


@pytest.mark.parametrize("size", [(10, 10), (7, 5)])
def test_a_large_dot_tells_which_way_up_a_grid_of_circles_is(size):
    board = make_board(
        "circles", columns=size[0], rows=size[1], spacing_m=0.02, diameter_m=0.01,
        large_dot_m=0.015,
    )  # fmt: skip
    picture, truth = picture_of(board, px=960)
    for _ in range(4):
        sighting = detect_board(picture, board)
        assert (sighting.status, sighting.message) == ("ok", "")
        assert np.sqrt(np.mean((sighting.pixels - truth) ** 2)) < 0.1
        width = picture.shape[1]
        picture = np.ascontiguousarray(np.rot90(picture))
        truth = np.stack([truth[:, 1], width - truth[:, 0]], axis=1)


@pytest.mark.parametrize("size", [(10, 8), (9, 7)])
def test_a_chessboard_that_begins_with_white_is_found(size):
    """No turn of it makes its left upper square black: both counts are even, or both odd."""
    board = made("chessboard", *size)
    picture, truth = picture_of(replace(board, white_first=True))
    sighting = detect_board(picture, board)
    assert (sighting.status, sighting.message) == ("ok", "")
    off = [sighting.pixels - way for way in (truth, truth[::-1])]
    assert min(np.abs(each).max() for each in off) < 0.2


@pytest.mark.parametrize("kind", ["charuco", "chessboard", "aruco-grid"])
def test_a_lens_out_of_focus_is_no_reason_to_refuse_points_that_fit(kind):
    picture, truth = picture_of(BOARDS[kind], blur_px=4.5, px=1280)
    sighting = detect_board(picture, BOARDS[kind])
    assert (sighting.status, sighting.message) == ("ok", "")
    assert sighting.sharpness_px > 9.0
    assert np.sqrt(np.mean((sighting.pixels - truth)[sighting.seen] ** 2)) < 0.3


@pytest.mark.parametrize("kind", ["charuco", "aruco-grid", "chessboard", "circles"])
def test_boards_are_found_in_pictures_of_a_fisheye_lens(kind):
    """Equidistant, 0.5 m of board from a hand's breadth: its corners are 50 deg off the axis."""
    board, size, focal = BOARDS[kind], np.array([960, 720]), 330.0
    middle = board.outline.mean(axis=0)
    turn = cv2.Rodrigues(np.array([0.1, -0.15, 0.05]))[0]
    shift = np.array([0.0, 0.0, 0.5 * max(board.size_m)]) - turn @ middle
    x, y = np.meshgrid(*((np.arange(2 * side) + 0.5) / 2 for side in size))
    off = (np.stack([x, y], axis=-1) - size / 2) / focal
    angle = np.linalg.norm(off, axis=-1, keepdims=True)
    rays = np.concatenate([off * np.sin(angle) / angle, np.cos(angle)], axis=-1)
    across, origin = rays @ turn, -shift @ turn
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (origin - across * origin[2] / across[..., 2:])[..., :2]
    at[across[..., 2] < 0.05] = 99.0
    grey = BoardPlate(board, 0.02).pattern(at * [1.0, -1.0])
    grey = 230 * np.where(np.isfinite(grey), grey, 0.4)
    picture = cv2.resize(grey, size.tolist(), interpolation=cv2.INTER_AREA)
    picture = np.rint(cv2.GaussianBlur(picture, (0, 0), 0.8)).astype(np.uint8)
    seen = board.points @ turn.T + shift
    flat = np.linalg.norm(seen[:, :2], axis=1, keepdims=True)
    truth = size / 2 + focal * np.arctan2(flat, seen[:, 2:]) * seen[:, :2] / flat
    sighting = detect_board(picture, board)
    assert (sighting.status, sighting.message) == ("ok", "")
    assert sighting.seen.mean() > 0.95
    error = min(
        np.sqrt(np.mean((sighting.pixels - way)[sighting.seen] ** 2))
        for way in (truth, truth[::-1])
    )
    assert error < 0.05


def test_a_part_of_a_board_with_markers_is_enough():
    board = BOARDS["charuco"]
    picture, truth = picture_of(board)
    picture[:, 320:] = 128
    sighting = detect_board(picture, board)
    assert sighting.is_ok
    assert 10 <= sighting.seen.sum() < 25
    assert (sighting.pixels[sighting.seen, 0] < 320).all()
    assert np.abs(sighting.pixels - truth)[sighting.seen].max() < 0.15


def test_another_board_is_named():
    picture, _ = picture_of(BOARDS["charuco"])
    other = make_board(
        "charuco", columns=8, rows=6, square_m=0.03, marker_m=0.021, dictionary="6x6_250"
    )
    sighting = detect_board(picture, other)
    assert sighting.status == "another board"
    assert "of DICT_5X5_50, not of DICT_6X6_250" in sighting.message
    assert not sighting.seen.any()
    picture, _ = picture_of(BOARDS["chessboard"], px=560)
    for size in ((9, 6), (11, 8)):
        assert detect_board(picture, made("chessboard", *size)).status == "another board", size


ROUND = BOARDS["round-target"]


def test_each_quarter_turn_of_a_round_target_is_told():
    picture, truth = picture_of(ROUND)
    for _ in range(4):
        sighting = detect_board(picture, ROUND)
        assert sighting.is_ok
        assert np.abs(sighting.pixels - truth).max() < 0.1
        width = picture.shape[1]
        picture = np.ascontiguousarray(np.rot90(picture))
        truth = np.stack([truth[:, 1], width - truth[:, 0]], axis=1)


@pytest.mark.parametrize("tilt_deg", [0.0, 60.0])
def test_a_lens_moves_no_corner_of_a_round_target(tilt_deg):
    """Half of a wide picture, far off its middle: there the middle of such a circle is off by 1 px.

    By the lens and, where it is tilted, by perspective.
    """
    lens = Lens("pinhole", 1280, 960, (1100.0, 1100.0, 640.0, 480.0, -0.15, 0.05, 0.0, 0.0, 0.0))
    turn = cv2.Rodrigues(np.deg2rad(tilt_deg) * np.array([0.8, 0.6, 0.0]))[0]
    T = transform(turn, [0.07, -0.03, 0.4])
    picture = Camera(lens, ROUND, noise=2.0).take(T, np.random.default_rng(1))
    sighting = detect_board(picture, ROUND)
    assert sighting.seen.sum() > 20
    error = (sighting.pixels - lens.project(ROUND.points @ turn.T + T[:3, 3]))[sighting.seen]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.abs(error.mean(axis=0)).max() < 0.01
    ellipse = max(next(dark_ellipses(picture)), key=lambda found: found[2] * found[3])
    assert np.linalg.norm(ellipse[:2] + 0.5 - lens.project(T[:3, 3])) > 1.0


def test_a_round_target_that_tells_no_turn_is_named():
    picture, truth = picture_of(ROUND, px=960)
    x, y = np.rint(truth[:12].mean(axis=0)).astype(int)
    dark = int(picture[y + 30, x + 30])
    for square in truth[12:].reshape(-1, 4, 2):
        middle = square.mean(axis=0)
        wider = np.rint(middle + 1.2 * (square - middle)).astype(np.int32)
        cv2.fillPoly(picture, [wider], dark)
    sighting = detect_board(picture, ROUND)
    assert sighting.status == "another board"
    assert "no three squares" in sighting.message


def test_two_round_targets_are_one_too_many():
    picture, _ = picture_of(ROUND)
    half = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    sighting = detect_board(np.hstack([half, half]), ROUND)
    assert (sighting.status, sighting.message[:15]) == ("ambiguous", "2 round targets")


def test_a_round_target_of_few_pixels_is_too_small():
    picture, _ = picture_of(ROUND)
    small = cv2.resize(picture, None, fx=0.08, fy=0.08, interpolation=cv2.INTER_AREA)
    beside = np.full((240, 320), 90, np.uint8)
    beside[60 : 60 + small.shape[0], 90 : 90 + small.shape[1]] = small
    sighting = detect_board(beside, ROUND)
    assert sighting.status in ("too few points", "no board")
    assert not sighting.seen.any()


def test_pictures_without_a_board_show_none():
    rng = np.random.default_rng(7)
    noise = rng.integers(0, 256, (160, 200), dtype=np.uint8)
    stripes = np.tile(np.where(np.arange(200) % 40 < 20, 40, 210).astype(np.uint8), (160, 1))
    for picture in (noise, cv2.GaussianBlur(noise, (0, 0), 5), stripes, stripes * 0 + 90):
        for board in BOARDS.values():
            sighting = detect_board(picture, board)
            assert sighting.status == "no board"
            assert not sighting.seen.any()


def test_light_is_named():
    board = BOARDS["charuco"]
    picture, _ = picture_of(board)
    bright = np.full_like(picture, 255)
    assert detect_board(bright, board).status == "overexposed"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"kind": "charucco"}, "did you mean charuco"),
        ({"marker_m": 0.03}, "do not go into squares"),
        ({"dictionary": "5x5_99"}, "there is no dictionary"),
        ({"dictionary": None}, "needs the dictionary"),
        ({"first_id": 90}, "DICT_5X5_100 has 100"),
        ({"columns": 2.5}, "whole number"),
        ({"square_m": None}, "needs square_m"),
        ({"diameter_m": 0.1}, "has no diameter_m"),
        ({"square_m": float("nan")}, "square_m of the board is nan"),
        ({"square_m": 25.0}, r"square_m of the board is 25000 mm \(.* from 0.1 mm to 10 m"),
        ({"columns": None}, "a charuco needs columns"),
        ({"kind": "round-target", "diameter_m": 0.1}, "a round-target has no columns"),
        ({"inner_corners": [8, 6]}, "8 x 6 inner corners are 9 x 7 squares"),
        ({"inner_corners": [7]}, "give two numbers"),
        ({"kind": "circles", "inner_corners": [7, 5]}, "a circles has no inner_corners"),
    ],
)
def test_a_board_that_cannot_be_is_refused(given, said):
    usual = {
        "kind": "charuco", "columns": 8, "rows": 6, "square_m": 0.03, "marker_m": 0.02,
        "dictionary": "5x5_100",
    }  # fmt: skip
    with pytest.raises(InputError, match=said):
        make_board(**usual | given)


def test_inner_corners_are_one_less_than_squares():
    board = make_board("chessboard", inner_corners=[9, 6], square_m=0.018)
    assert (board.columns, board.rows) == (10, 7)


def test_half_turns_are_known():
    assert not BOARDS["chessboard"].ambiguous_half_turn
    assert make_board("chessboard", columns=9, rows=7, square_m=0.02).ambiguous_half_turn
    assert not BOARDS["asymmetric-circles"].ambiguous_half_turn
    assert BOARDS["circles"].ambiguous_half_turn
    with pytest.raises(InputError, match="quarter turn"):
        make_board("chessboard", columns=7, rows=7, square_m=0.02)


@pytest.mark.parametrize("picture", [None, np.zeros((9, 9), np.uint8), np.zeros((99, 99, 3))])
def test_what_is_no_grey_picture_is_refused(picture):
    with pytest.raises(InputError, match="the picture"):
        detect_board(picture, BOARDS["charuco"])
