"""How fast a camera, its lens and its board are estimated from pixels. Run with ``make bench``."""

import time

import cv2
import numpy as np
import pytest

from calib.hand_eye import calibrate
from studies.board_scenes import EXACT, SIZE, STOPS_OFF, Scene, draw_scene

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
