"""Real pictures of two arms: findings that hold, and none that the order of pictures makes."""

import re
from pathlib import Path

import numpy as np
import pytest

from calib.hand_eye import Pictures, calibrate
from calib.robots import flange_robot, posture_of_pose
from calib.se3 import FloatArray, rotation_exp, rotation_from_quaternion, transform
from calib.vision.boards import detect_board, make_board
from posedesign.files.pictures import read_grey

pytestmark = pytest.mark.slow


def _pictures(board, carried, flange: list[FloatArray], paths: list[Path]) -> Pictures:
    images = [read_grey(path) for path in paths]
    pixels = np.array([detect_board(image, board).pixels for image in images])
    postures, size = posture_of_pose(np.array(flange)), images[0].shape[1::-1]
    return Pictures(flange_robot(), postures, pixels, board.points, size, carried)


@pytest.fixture(scope="module")
def chessboard(data_folder) -> Pictures:
    """The camera is on the flange."""
    folder = data_folder / "pictures" / "chessboard_eye_in_hand"
    text = (folder / "robot_poses.yaml").read_text()
    flange, paths = [], []
    for i in range(1, 17):
        (row,) = re.findall(rf"pose{i}: \[(.*?)\]", text, flags=re.DOTALL)
        six = np.array([float(value) for value in row.split(",")])
        flange.append(transform(rotation_exp(six[3:]), six[:3] / 1e3))
        paths.append(folder / "pictures" / f"{i}_Color.png")
    board = make_board("chessboard", columns=10, rows=7, square_m=0.018)
    return _pictures(board, "camera", flange, paths)


@pytest.fixture(scope="module")
def charuco(data_folder) -> Pictures:
    """The camera stands still; the squares are .47 % larger than described."""
    folder = data_folder / "pictures" / "charuco_eye_to_hand"
    flange = []
    for i in range(16):
        pairs = re.findall(r"(\w+): (\S+)", (folder / "poses" / f"{i}.yaml").read_text())
        value = {key: float(text) for key, text in pairs}
        quaternion = np.array([value[key] for key in ("qw", "qx", "qy", "qz")])
        place = np.array([value[key] for key in "xyz"])
        flange.append(transform(rotation_from_quaternion(quaternion), place))
    board = make_board(
        "charuco",
        columns=5,
        rows=7,
        square_m=0.036195,
        marker_m=0.018256,
        dictionary="6x6_250",
    )
    paths = [folder / "pictures" / f"{i}.png" for i in range(16)]
    return _pictures(board, "board", flange, paths)


def _charuco(columns: int, rows: int, *, legacy: bool = False):
    return make_board(
        "charuco",
        columns=columns,
        rows=rows,
        square_m=0.036195,
        marker_m=0.018256,
        dictionary="6x6_250",
        legacy=legacy,
    )


def test_all_corners_are_found_in_all_pictures(charuco, chessboard):
    """Of one of them OpenCV's detector reads 6 of 17 markers."""
    assert np.isfinite(charuco.pixels).all(axis=-1).mean() > 0.99
    assert np.isfinite(chessboard.pixels).all()


@pytest.mark.parametrize(
    "wrong",
    [_charuco(4, 6), _charuco(6, 8), _charuco(6, 7), _charuco(7, 5), _charuco(5, 6, legacy=True)],
)
def test_a_charuco_described_otherwise_is_found_in_no_picture(data_folder, wrong):
    folder = data_folder / "pictures" / "charuco_eye_to_hand" / "pictures"
    said = [detect_board(read_grey(path), wrong) for path in sorted(folder.iterdir())]
    assert not any(sighting.is_ok for sighting in said)
    assert sum("5 columns and 7 rows or more" in sighting.message for sighting in said) > 2


def shuffled(pictures: Pictures, rng: np.random.Generator) -> Pictures:
    """The pictures in another order, each with its pose."""
    order = rng.permutation(len(pictures.pixels))
    return Pictures(
        pictures.robot,
        pictures.postures[order],
        pictures.pixels[order],
        pictures.board,
        pictures.size_px,
        pictures.carried,
    )


def test_the_size_of_the_printed_board_is_found(charuco):
    result = calibrate(charuco)
    assert result.scale[0] == pytest.approx(0.0047, abs=3 * result.scale[1])
    assert "larger than described" in result.warnings[0]
    assert "estimated with the rest" in result.warnings[0]
    assert result.is_ok


def test_a_bend_is_estimated_whether_it_matters_or_not(chessboard):
    """The board is bent by less than a tenth of a millimetre: surely, and without effect."""
    result = calibrate(chessboard)
    (finding,) = result.findings
    assert "bent" in finding.text
    assert finding.is_accounted
    assert finding.sigmas < 1.0
    assert result.is_ok
    assert np.linalg.norm(result.sigma_of("X")[0]) == pytest.approx(6.3e-3, rel=0.1)


@pytest.mark.parametrize("name", ["chessboard", "charuco"])
def test_no_order_of_the_pictures_is_a_move(request, name):
    """One in two hundred is allowed: two of thirty happen once in a hundred times."""
    pictures = request.getfixturevalue(name)
    rng = np.random.default_rng(5)
    said = [calibrate(shuffled(pictures, rng)).warnings for _ in range(30)]
    assert sum(any("moved" in text for text in texts) for texts in said) <= 1


def test_halves_of_the_pictures_are_calibrated_with(chessboard, charuco):
    """Eight pictures in a random order: nothing was moved, and what prints are off is estimated."""
    rng = np.random.default_rng(0)
    for pictures in (chessboard, charuco):
        told = np.flatnonzero(np.isfinite(pictures.pixels).all(axis=-1).sum(axis=1) > 7)
        for _ in range(6):
            half = rng.permutation(told)[: len(told) // 2]
            result = calibrate(
                Pictures(
                    pictures.robot,
                    pictures.postures[half],
                    pictures.pixels[half],
                    pictures.board,
                    pictures.size_px,
                    pictures.carried,
                )
            )
            assert result.is_ok, result.warnings
