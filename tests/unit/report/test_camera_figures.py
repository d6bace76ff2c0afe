"""What `camera` draws: sheets of pictures, poses of camera and board, deviations of the board."""

import re
import zlib

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from calib.hand_eye import calibrate
from calib.se3 import rotation_log, transform
from calib.vision.boards import make_board
from posedesign.hand_eye import Asked, Calibrated, Sightings
from posedesign.hand_eye.calibration import OFF_AXES, picture_rows
from posedesign.hand_eye.pictures import PictureSet
from posedesign.report import figures
from posedesign.report.camera_poses import figure_of_poses
from posedesign.report.camera_sheets import pictures_shown, sheets_of_pictures, write_sheets
from posedesign.report.hand_eye import shown_camera
from posedesign.report.pdf import Page, as_pdf
from studies.board_scenes import SIZE, STOPS_OFF, draw_scene

BOARD = make_board("chessboard", columns=8, rows=6, square_m=0.03)
BOTH = pytest.mark.parametrize("carried", ["camera", "board"])
NUMBER = r"-?[\d.]+"


def taken(carried="camera", count=13, change=lambda pixels: None, sigma_px=0.1):
    """A scene, and what was calibrated from it with pixels that are changed."""
    rng = np.random.default_rng(3)
    scene = draw_scene(rng, count, carried, points=BOARD.points)
    pixels = scene.seen(rng, sigma_px, STOPS_OFF)
    change(pixels)
    pictures = scene.shown(pixels, names=tuple(f"img{k}.png" for k in range(count)))
    result = calibrate(pictures)
    asked = Asked("on-flange" if carried == "camera" else "fixed")
    pixels = np.where(np.isfinite(result.pixels), result.pixels, pixels)
    reasons = ("",) * count
    found = (result, asked, BOARD, reasons, pixels, scene.flange, pictures.postures, False)
    return scene, Calibrated(*found)


def looked(calibrated, failed=False):
    """Its pictures as a sheet shows them, grey all over."""
    result = calibrated.result
    names, none = result.names, tuple(np.full((27, 48), 90, np.uint8) for _ in result.names)
    pictures = PictureSet((), names, SIZE, None, None, None, ())
    found = Sightings(calibrated.pixels, calibrated.reasons, none)
    given = {"camera": pictures}, {"camera": found}
    return pictures_shown(*given, None if failed else calibrated)


def lines_of(page: Page, points: int) -> np.ndarray:
    """Lines ``(K, points, 2)`` that a page draws through so many points."""
    content = b"\n".join(page.marks).decode("latin-1")
    line = re.compile(rf"^{NUMBER} {NUMBER} m(?: {NUMBER} {NUMBER} l){{{points - 1}}} S$", re.M)
    rows = [re.findall(NUMBER, found[0]) for found in line.finditer(content)]
    return np.array(rows, dtype=float).reshape(-1, points, 2)


def words_of(page: Page) -> list[str]:
    said = re.findall(rb" Td \((.*)\) Tj", b"\n".join(page.marks))
    return [re.sub(r"\\(.)", r"\1", text.decode("cp1252")) for text in said]


def arrows_and_frames(page: Page) -> tuple[np.ndarray, np.ndarray]:
    """Arrows ``(K, 2, 2)``, from where and to where, and frames ``(N, 5, 2)`` about pictures."""
    lines = lines_of(page, 5)
    closed = (lines[:, 0] == lines[:, -1]).all(axis=1)
    return lines[~closed, :2], lines[closed]


def test_an_arrow_points_from_a_point_to_where_the_result_shows_it():
    """A corner is found 0.9 px too far to the right and 0.7 px too far up."""
    shift, k = np.array([0.9, -0.7]), 4 * len(BOARD.points) + 17

    def change(pixels):
        pixels[4, 17] += shift

    drawn = []
    for changed in (lambda pixels: None, change):
        _, calibrated = taken(change=changed, sigma_px=0.3)
        (page, last) = sheets_of_pictures(looked(calibrated), BOARD, "calibrated")
        longer = float(re.search(r"([\d.]+) times as long", words_of(page)[1])[1])
        assert longer in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
        arrows, frames = arrows_and_frames(page)
        assert (len(frames), len(arrows_and_frames(last)[1])) == (12, 1)
        assert len(arrows) == 12 * len(BOARD.points)
        (left, below), (wide, high) = frames[4].min(axis=0), np.ptp(frames[4], axis=0)
        x, y = calibrated.pixels[4, 17] / SIZE
        assert arrows[k, 0] == pytest.approx([left + x * wide, below + (1.0 - y) * high], abs=0.02)
        drawn.append((arrows[k, 1] - arrows[k, 0]) / longer * SIZE[0] / wide)
    # back to the left and down; on a page up is positive
    np.testing.assert_allclose(drawn[1] - drawn[0], [-0.9, -0.7], atol=0.12)


def test_a_point_in_a_wrong_place_is_crossed_out_and_a_picture_that_is_left_out_says_why():
    def change(pixels):
        pixels[2, 5] += 40.0
        pixels[7] = pixels[7, :, :] * 0.9  # of another camera, say

    _, calibrated = taken(change=change)
    shown = looked(calibrated)
    (page, _) = sheets_of_pictures(shown, BOARD, "calibrated")
    assert [one.passed_over.nonzero()[0].tolist() for one in shown][2] == [5]
    assert len(lines_of(page, 2)) == 2  # of one cross
    said = words_of(page)
    assert "1 of them in wrong places (crosses), not used" in " ".join(said)
    first = said.index("img7.png") + 1
    # its arrows have a length of their own
    why = r"left out, arrows [\d.]+ times as long: contradicts the others; 35 points, rms"
    assert re.match(why, " ".join(said[first : first + 2]))
    assert [row["status"] for row in picture_rows(calibrated)].count("used") == 12


@BOTH
def test_the_deviation_is_that_of_the_board_as_opencv_sees_it(carried):
    """OpenCV places the board in each picture alone, with the lens that was found."""
    scene, calibrated = taken(carried)
    result, points = calibrated.result, BOARD.points
    K, distortion = result.lens.to_opencv()
    middle = points.mean(axis=0)
    for flange, own, row in zip(
        scene.flange, calibrated.pixels, picture_rows(calibrated), strict=True
    ):
        _, turn, shift = cv2.solvePnP(points, own - 0.5, K, distortion)
        turn, shift = cv2.solvePnPRefineLM(points, own - 0.5, K, distortion, turn, shift)
        T = transform(cv2.Rodrigues(turn)[0], shift[:, 0])
        in_hand = carried == "camera"
        seen = flange @ result.X @ T if in_hand else result.Z @ T
        place = result.Z if in_hand else flange @ result.X
        off = [*1e3 * ((seen - place)[:3, :3] @ middle + (seen - place)[:3, 3])]
        off += [*np.degrees(rotation_log(seen[:3, :3] @ place[:3, :3].T))]
        np.testing.assert_allclose([row[key] for key in OFF_AXES], off, atol=0.01)
        assert row["off_mm"] == pytest.approx(np.linalg.norm([row[k] for k in OFF_AXES[:3]]))
        assert row["points"] == len(points)
    assert np.abs(off[:3]).max() > 0.1  # mm: the arm stops off


@BOTH
def test_camera_and_board_stand_where_they_were_at_one_scale(carried):
    def change(pixels):
        pixels[7] += [60.0, 0.0]

    scene, calibrated = taken(carried, change=change)
    file = shown_camera(calibrated)
    space = figure_of_poses(file).get_axes()[0]
    result, flange = calibrated.result, scene.flange
    wanted = flange @ result.X
    axes = space.collections
    kinds = [type(each).__name__ for each in space.collections]
    assert kinds.count("Line3DCollection") == 4 + (carried == "camera")
    # frames begin where things are: the base, what is on the flange, and what stands around
    starts = np.array([segment[0] for segment in axes[-1]._segments3d])
    expected = [[0, 0, 0], *1e3 * wanted[:, :3, 3], 1e3 * result.Z[:3, 3]]
    assert np.sort(starts, axis=0) == pytest.approx(np.sort(expected, axis=0), abs=1e-6)
    ranges = np.ptp([space.get_xlim(), space.get_ylim(), space.get_zlim()], axis=1)
    box = np.array(space.get_box_aspect())
    assert box / box.max() == pytest.approx(ranges / ranges.max())
    assert [text.get_text().strip() for text in space.texts] == ["base", "img7.png"]


def test_deviations_are_drawn_with_their_rms_and_those_left_out_are_named():
    def change(pixels):
        pixels[7] += [60.0, 0.0]

    _, calibrated = taken(change=change)
    _, position, rotation = figure_of_poses(shown_camera(calibrated)).get_axes()
    rows = picture_rows(calibrated)
    used = calibrated.result.used
    for panel, keys, unit in ((position, OFF_AXES[:3], "mm"), (rotation, OFF_AXES[3:], "deg")):
        drawn = [line for line in panel.lines if "rms" in str(line.get_label())]
        for line, key in zip(drawn, keys, strict=True):
            values = np.array([row[key] for row in rows])[used]
            assert line.get_ydata() == pytest.approx(values)
            rms = np.sqrt(np.mean(values**2))
            assert str(line.get_label()).endswith(f"rms {rms:.2g} {unit}")
        low, high = panel.get_ylim()
        assert all((low < np.asarray(line.get_ydata())).all() for line in panel.lines)
        assert all((np.asarray(line.get_ydata()) < high).all() for line in panel.lines)
    assert rotation.get_xlabel().startswith("left out, hollow marks: img7.png (")


def test_pictures_are_shown_where_there_is_no_result(tmp_path):
    _, calibrated = taken()
    shown = looked(calibrated, failed=True)
    (page, _) = sheets_of_pictures(shown, BOARD, "not calibrated")
    assert not arrows_and_frames(page)[0].size
    assert "35 of 35 points found" in words_of(page)
    pictures = {"camera": PictureSet((), ("a.png",), SIZE, None, None, None, ())}
    blank = np.full((1, len(BOARD.points), 2), np.nan)
    found = {"camera": Sightings(blank, ("no board: none",), (np.zeros((9, 16), np.uint8),))}
    write_sheets(tmp_path / "a.pdf", pictures, found, BOARD, InputError("nothing fits"))
    assert b"/Count 1 " in (tmp_path / "a.pdf").read_bytes()


def test_names_that_are_long_or_of_other_letters_are_written_to_be_told_apart():
    page = Page(100.0, 100.0)
    page.add_text("a(1)\\\n画.png", (0.0, 0.0), 5.0)
    assert rb"(a\(1\)\\ \\u753b.png)" in page.marks[0]
    assert words_of(page) == ["a(1)\\ \\u753b.png"]
    assert figures.shortened("left_picture_of_the_board_001.png", 20) == "left_pictu…rd_001.png"
    figure = figures.new_figure()
    figures.residuals_by_pose(figure, ["画像.png"] * 2, {"a": np.ones(2)}, np.zeros(2, dtype=bool))
    figures.as_png(figure)  # a warning would be an error here
    assert "画像.png" in figures.as_svg(figure)


def test_a_file_says_where_its_objects_are():
    page = Page(100.0, 100.0)
    page.add_picture(np.arange(12, dtype=np.uint8).reshape(3, 4), (0.0, 0.0, 4.0, 3.0))
    page.add_circles(np.array([[2.0, 1.0]]), 1.0, "#0072B2", 0.4)
    data = as_pdf([page, page], "two")
    assert data == as_pdf([page, page], "two")
    entries = re.findall(rb"(\d{10}) 00000 n ", data)
    assert all(data[int(at) :].startswith(b"%d 0 obj" % k) for k, at in enumerate(entries, 1))
    start = int(re.search(rb"startxref\n(\d+)", data)[1])
    assert data[start:].startswith(b"xref\n0 %d\n" % (len(entries) + 1))
    (at, length), *_ = [
        (found.end(), int(found[1]))
        for found in re.finditer(rb"/DCTDecode /Length (\d+) >>\nstream\n", data)
    ]
    picture = cv2.imdecode(np.frombuffer(data[at : at + length], np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture == pytest.approx(page.pictures[0], abs=3)
    content = re.search(rb"/FlateDecode /Length (\d+) >>\nstream\n", data)
    drawn = zlib.decompress(data[content.end() : content.end() + int(content[1])])
    assert drawn == b"\n".join(page.marks)
    # the circle passes four points at its radius
    ends = np.array(re.findall(rf"({NUMBER}) ({NUMBER}) [mc]", drawn.decode()), dtype=float)
    assert np.linalg.norm(ends[-5:] - [2.0, 1.0], axis=1) == pytest.approx(np.ones(5), abs=0.01)
