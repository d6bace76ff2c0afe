"""The lens against OpenCV, and where no point is seen."""

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from calib.vision.camera import Camera, PinholeCamera

CAMERA = Camera(
    1280,
    1024,
    900.0,
    focal_y_px=905.0,
    principal_px=(655.5, 498.0),
    distortion=(-0.28, 0.11, 1.2e-3, -0.7e-3, -0.02),
)
MATRIX = np.array([[900.0, 0.0, 655.0], [0.0, 905.0, 497.5], [0.0, 0.0, 1.0]])
"""The same in OpenCV's coordinates, which count from the middle of the first pixel."""


def points(count: int = 200) -> np.ndarray:
    return np.random.default_rng(3).uniform([-0.25, -0.2, 0.4], [0.25, 0.2, 1.0], (count, 3))


def test_projects_as_opencv():
    there, _ = cv2.projectPoints(
        points(), np.zeros(3), np.zeros(3), MATRIX, np.array(CAMERA.distortion)
    )
    np.testing.assert_allclose(CAMERA.project(points()), there[:, 0] + 0.5, atol=1e-9)


def test_rays_as_opencv():
    pixels = np.random.default_rng(4).uniform([0, 0], [1280, 1024], (200, 2))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-14)
    there = cv2.undistortPointsIter(
        pixels[:, None] - 0.5, MATRIX, np.array(CAMERA.distortion), None, None, criteria
    )
    rays = CAMERA.rays(pixels)
    np.testing.assert_allclose(rays[:, :2], there[:, 0], atol=1e-10)
    assert (rays[:, 2] == 1.0).all()


def test_rays_lead_back_to_their_pixels():
    x, y = np.meshgrid(np.linspace(0, 1280, 33), np.linspace(0, 1024, 27))
    pixels = np.stack([x, y], axis=-1)
    np.testing.assert_allclose(CAMERA.project(0.7 * CAMERA.rays(pixels)), pixels, atol=1e-8)


def test_derivatives_by_central_differences():
    step = 1e-6
    moved = step * np.eye(3)
    p = points(20)[:, None]
    central = (CAMERA.project(p + moved) - CAMERA.project(p - moved)) / (2 * step)
    np.testing.assert_allclose(
        CAMERA.project_jacobian(points(20)), np.swapaxes(central, -1, -2), atol=1e-3, rtol=1e-6
    )


def test_camera_of_the_paper():
    """12 mm on 4.8 mm over 640 pixels: 1600 px; 20 mm at 350 mm are 1600 * 20 / 350 = 91.4 px."""
    camera = Camera.paper()
    np.testing.assert_allclose(camera.focal_xy_px, [1600.0, 1600.0])
    a, b = camera.project(np.array([[0.0, 0.0, 0.35], [0.02, 0.0, 0.35]]))
    np.testing.assert_allclose(a, [320.0, 240.0])
    assert b[0] - a[0] == pytest.approx(91.428571)


def test_without_distortion_it_is_the_ideal_camera():
    ideal, camera = PinholeCamera(640, 480, 800.0), Camera(640, 480, 800.0)
    np.testing.assert_allclose(camera.project(points()), ideal.project(points()))
    np.testing.assert_allclose(camera.margin_px(points()), ideal.margin_px(points()))
    pixels = ideal.project(points())
    np.testing.assert_allclose(camera.rays(pixels), ideal.rays(pixels))
    np.testing.assert_allclose(ideal.rays(pixels) * points()[:, 2:], points(), atol=1e-12)


def test_points_far_outside_do_not_fold_back_into_the_image():
    """Barrel distortion k1 = -0.3 turns back at r = sqrt(1 / 0.9); OpenCV draws what is beyond."""
    camera = Camera(640, 480, 400.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    assert camera.largest_radius == pytest.approx(np.sqrt(1 / 0.9))
    beyond = np.array([1.8, 0.0, 1.0])
    there, _ = cv2.projectPoints(
        beyond, np.zeros(3), np.zeros(3), np.diag([400.0, 400.0, 1.0]), np.array([-0.3, 0, 0, 0])
    )
    assert abs(there[0, 0, 0]) < 320.0
    assert np.isnan(camera.project(beyond)).all()
    assert camera.margin_px(beyond) == -np.inf
    # no point is seen beyond the image of that radius: 400 * r (1 - 0.3 r²) = 281 px
    assert np.isnan(camera.rays([320.0 + 300.0, 240.0])[:2]).all()
    assert np.isfinite(camera.rays([320.0 + 275.0, 240.0])).all()


@pytest.mark.parametrize("depth", [0.0, -0.3])
def test_nothing_behind_the_lens(depth):
    assert np.isnan(CAMERA.project(np.array([0.01, 0.0, depth]))).all()


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"focal_px": 0.0}, "focal_px"),
        ({"focal_px": float("nan")}, "focal_px"),
        ({"focal_px": 800.0, "focal_y_px": -1.0}, "focal_y_px"),
        ({"focal_px": 800.0, "distortion": (0.1, 0.0)}, "distortion"),
    ],
)
def test_unusable_cameras_are_refused(arguments, name):
    with pytest.raises(InputError) as caught:
        Camera(640, 480, **arguments)
    assert caught.value.name == name
