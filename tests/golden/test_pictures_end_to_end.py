"""From pictures to the camera's place: rendered by OpenCV, detected, calibrated, held to truth."""

from dataclasses import replace

import numpy as np
import pytest

from calib.chance import chi2_quantile
from calib.hand_eye import HandEyeResult, calibrate
from calib.lens import Lens
from calib.se3 import FloatArray, rotation_exp, transform
from calib.vision.boards import Board, detect_board, make_board
from studies.board_scenes import EXACT, STOPS_OFF, Scene, draw_scene, pose_error
from tests.board_pictures import Camera

LENS = Lens("pinhole", 1280, 800, (1100.0, 1104.0, 652.0, 395.0, -0.12, 0.06, 8e-4, -5e-4, 0.0))
BOARD = make_board("charuco", columns=8, rows=6, square_m=0.03, marker_m=0.022, dictionary="4X4_50")
ROUND = make_board("round-target", diameter_m=0.15)  # its edges are whole pixels of the print
CHANCE = 1e-4

NEAREST_PX = 0.02
"""Rms of what the corners are off: they are rendered blurred, with noise of four grey levels."""


def photographed(
    count: int, carried: str, arm: tuple[float, float], seed: int, board: Board = BOARD
) -> tuple[Scene, HandEyeResult, float]:
    """Scene, result, and the rms that the corners are off [px]."""
    rng = np.random.default_rng(seed)
    scene = draw_scene(rng, count, carried, points=board.points, lens=LENS, far_m=(0.4, 0.55))
    # where the board is seen, of an arm that stops off
    there = replace(scene, flange=stopped(scene, arm, rng))
    camera = Camera(LENS, board)
    pixels = np.stack(
        [detect_board(camera.take(T, rng), board).pixels for T in there.poses(there.flange)]
    )
    truth = there.seen(rng, sigma_px=0.0)
    off = float(np.sqrt(np.nanmean((pixels - truth) ** 2)))
    size = LENS.width_px, LENS.height_px
    return scene, calibrate(scene.shown(pixels, size_px=size)), off


def stopped(scene: Scene, arm: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Where the flange is, of an arm that stops off."""
    N, T = len(scene.flange), scene.flange
    turn = rotation_exp(arm[1] * rng.standard_normal((N, 3)))
    return transform(turn @ T[:, :3, :3], T[:, :3, 3] + arm[0] * rng.standard_normal((N, 3)))


def check(scene: Scene, result: HandEyeResult, off: float) -> float:
    """The camera is where the result says, within what it says; its χ² of six."""
    assert result.warnings == ()
    assert result.used.all()
    assert off < NEAREST_PX
    assert result.sigma_px < NEAREST_PX
    name = "X" if scene.carried == "camera" else "Z"
    error = pose_error(getattr(result, name), getattr(scene, name))
    square = float(error @ np.linalg.solve(result.covariance_of(name), error))
    assert square < chi2_quantile(1 - CHANCE, 6)
    return square


@pytest.mark.parametrize(("carried", "board"), [("camera", BOARD), ("board", ROUND)])
def test_a_handful_of_pictures_tells_where_the_camera_is(carried, board):
    scene, result, off = photographed(6, carried, EXACT, 60, board)
    check(scene, result, off)
    place, turn = result.sigma_of("X" if carried == "camera" else "Z")
    assert np.linalg.norm(place) < 5e-4
    assert np.linalg.norm(turn) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("sets", [2, pytest.param(12, marks=pytest.mark.full)])
@pytest.mark.parametrize("carried", ["camera", "board"])
@pytest.mark.parametrize("board", [BOARD, ROUND], ids=["charuco", "round target"])
def test_many_sets_of_pictures_are_as_near_as_they_say(carried, board, sets):
    """Sets of 15 pictures of an arm that stops off."""
    found = [check(*photographed(15, carried, STOPS_OFF, 100 + k, board)) for k in range(sets)]
    low, high = chi2_quantile([CHANCE / 2, 1 - CHANCE / 2], 6 * sets)
    assert low < sum(found) < high
