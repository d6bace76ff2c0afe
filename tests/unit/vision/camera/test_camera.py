"""The ideal camera: pixels of points, and how far they are from the edge of the image."""

import numpy as np
import pytest

from calib.vision.camera import PinholeCamera

CAMERA = PinholeCamera(640, 480, 800.0)


def test_against_opencv():
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")
    points = np.random.default_rng(1).uniform([-0.2, -0.2, 0.3], [0.2, 0.2, 1.0], (20, 3))
    matrix = np.array([[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]])
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, None)
    np.testing.assert_allclose(CAMERA.project(points), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("pixel", "room"),
    [((320, 240), 240), ((10, 240), 10), ((635, 240), 5), ((320, 475), 5), ((-7, 240), -7)],
)
def test_room_is_the_distance_from_the_nearest_edge(pixel, room):
    x, y = (np.array(pixel) - [320.0, 240.0]) / 800.0
    assert CAMERA.margin_px(np.array([x, y, 1.0])) == pytest.approx(room)


@pytest.mark.parametrize("depth", [0.0, -0.5])
def test_nothing_behind_the_lens_is_seen(depth):
    point = np.array([0.01, 0.0, depth])
    assert np.isnan(CAMERA.project(point)).all()
    assert CAMERA.margin_px(point) == -np.inf
