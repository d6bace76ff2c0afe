"""How fast a camera, its lens and its board are estimated from pixels. Run with ``make bench``."""

import time

import cv2
import numpy as np
import pytest

from calib.hand_eye import calibrate
from calib.lens import Lens
from posedesign.cell import Cell, cell_template
from posedesign.files import Results
from posedesign.hand_eye import Asked, Sightings, calibrate_camera
from posedesign.hand_eye.pictures import read_picture_set
from posedesign.report import figures
from posedesign.report.camera_poses import figure_of_poses
from posedesign.report.camera_sheets import CAMERA_SHEETS, write_sheets
from posedesign.report.hand_eye import figure_of_camera, shown_camera
from posedesign.workflow import CAMERA_DRAWN, CAMERA_POSES_DRAWN
from studies.board_scenes import EXACT, SIZE, STOPS_OFF, Scene, draw_scene
from tests.board_pictures import Camera, take_pictures
from tests.cli.test_camera import BOARD, NEAR, X, Z, write_rows

SECONDS = 0.5
"""Of 20 pictures: .18 measured."""

TIMES = 8.0
"""Five times the pictures, and half again for a busy machine; squares would make 25."""


def seconds(scene: Scene, arm: tuple[float, float], rounds: int = 3) -> float:
    """Of the processor, at the fastest of some rounds."""
    pictures = scene.shown(scene.seen(np.random.default_rng(1), arm=arm))
    times = []
    for _ in range(rounds):
        start = time.process_time()
        calibrate(pictures)
        times.append(time.process_time() - start)
    return min(times)


@pytest.mark.parametrize("arm", [EXACT, STOPS_OFF], ids=["exact arm", "arm stops off"])
def test_twenty_pictures(benchmark, capsys, arm):
    """Beside OpenCV's calibrateCamera, which knows no robot and states no covariance of it."""
    scene = draw_scene(np.random.default_rng(5), 20)
    own = seconds(scene, arm)
    pixels = [p.astype(np.float32) for p in scene.seen(np.random.default_rng(1), arm=arm)]
    points = [scene.points.astype(np.float32)] * len(pixels)
    cv2.setNumThreads(1)
    start = time.process_time()
    cv2.calibrateCamera(points, pixels, SIZE, None, None)  # type: ignore[call-overload]
    theirs = time.process_time() - start
    with capsys.disabled():
        print(f"\n20 pictures: {own:.2f} s, OpenCV's calibrateCamera {theirs:.3f} s")
    pictures = scene.shown(scene.seen(np.random.default_rng(1), arm=arm))
    benchmark.pedantic(calibrate, args=(pictures,), rounds=2)
    assert own < SECONDS


@pytest.mark.parametrize("arm", [EXACT, STOPS_OFF], ids=["exact arm", "arm stops off"])
def test_cost_grows_linearly_to_a_thousand_pictures(benchmark, capsys, arm):
    rng = np.random.default_rng(5)
    few, many = draw_scene(rng, 200), draw_scene(rng, 1000)
    once, five = seconds(few, arm), seconds(many, arm, rounds=2)
    with capsys.disabled():
        print(f"\n200 pictures {once:.2f} s, 1,000 pictures {five:.2f} s: {five / once:.2f} times")
    pictures = few.shown(few.seen(np.random.default_rng(1), arm=arm))
    benchmark.pedantic(calibrate, args=(pictures,), rounds=1)
    assert five / once < TIMES


def test_what_a_camera_draws_beside_finding_and_calibrating(tmp_path, capsys):
    """Sixteen pictures of 1600 x 1200; matplotlib is loaded before, as every figure needs it.

    Of the whole command, which loads its libraries besides, poses and sheets are a ninth.
    """
    (tmp_path / "cell.toml").write_text(cell_template("ur10e", surroundings=False) + BOARD)
    cell = Cell.load(tmp_path / "cell.toml")
    lens = Lens("pinhole", 1600, 1200, (1400.0, 1405.0, 805.0, 595.0, -0.1, 0.05, 5e-4, -3e-4, 0.0))
    camera = Camera(lens, cell.board, blur_px=0.8, noise=2.0, light=0.1)
    q = take_pictures(
        tmp_path / "pictures", cell.robot, camera, X, Z, 16, np.random.default_rng(4), near=NEAR
    )
    write_rows(
        tmp_path / "joints.csv", ["picture", *(f"j{k}_deg" for k in range(1, 7))], np.degrees(q)
    )
    pictures = {
        "camera": read_picture_set(tmp_path / "pictures", tmp_path / "joints.csv", cell.robot)
    }
    looked: dict[str, Sightings] = {}
    out = Results(tmp_path, "camera")
    claims = out.claim("computed", *CAMERA_DRAWN, *CAMERA_POSES_DRAWN, CAMERA_SHEETS)
    loaded = figures.new_figure()
    figures.panels_of(loaded)
    figures.as_png(loaded)
    times = [time.process_time()]
    found = calibrate_camera(cell, pictures, Asked(), out, look=looked.__setitem__)
    times.append(time.process_time())
    figures.draw(out, claims[:2], lambda: figure_of_camera(found.result))
    times.append(time.process_time())
    figures.draw(out, claims[2:4], lambda: figure_of_poses(shown_camera(found)))
    times.append(time.process_time())
    write_sheets(claims[4], pictures, looked, found.board, found)
    times.append(time.process_time())
    work, residuals, poses, sheets = np.diff(times).tolist()
    with capsys.disabled():
        print(f"\nfound and calibrated {work:.2f} s; drawn: residuals {residuals:.2f} s, ", end="")
        print(f"poses {poses:.2f} s, sheets {sheets:.3f} s")
    assert sheets < 0.1 * work  # .03 measured
    assert poses < 0.8 * work  # .50 measured
