"""Ellipses of circles and of points against projected points, OpenCV and central differences."""

import cv2
import numpy as np
import pytest

from calib import se3
from calib.vision.camera import Camera, circle_image, ellipse_axes
from calib.vision.camera.conic import ellipse_distance, ellipse_points, fit_ellipse, half_axes

BENT = Camera(640, 480, 800.0, distortion=(-0.3, 0.15, 2e-3, -1e-3, 0.02))


def poses(looking) -> np.ndarray:
    return np.array(
        [
            looking(tilt, x, -0.02, 0.3, spin)
            for tilt in (0.0, 25.0, -50.0)
            for x in (-0.03, 0.0, 0.04)
            for spin in (0.0, 70.0)
        ]
    )


def test_projected_rim_lies_on_the_ellipse(camera, target, looking):
    T = poses(looking)
    rim = se3.apply(T[:, None], target.rim(40))
    distance, _ = ellipse_distance(circle_image(camera, 0.02, T), camera.project(rim))
    assert np.abs(distance).max() < 1e-9


def test_rectangular_pixels(target, looking):
    camera = Camera(640, 480, 900.0, focal_y_px=700.0, principal_px=(300.0, 260.0))
    T = looking(35.0, 0.01, 0.02, 0.3)
    distance, _ = ellipse_distance(
        circle_image(camera, 0.02, T), camera.project(se3.apply(T, target.rim(40)))
    )
    assert np.abs(distance).max() < 1e-9


def test_with_distortion_as_opencv_fits_the_rim(target, looking):
    """OpenCV's fit is algebraic: it differs from least distances by the square of the misfit."""
    for T in poses(looking):
        rim = BENT.project(se3.apply(T, target.rim(720)))
        ellipse = circle_image(BENT, 0.02, T)
        (x, y), axes, _ = cv2.fitEllipseDirect(rim.astype(np.float32))
        long, short, _ = ellipse_axes(ellipse)
        np.testing.assert_allclose(ellipse[:2], [x, y], atol=5e-3)
        np.testing.assert_allclose([short, long], sorted(axes), atol=1e-2)


@pytest.mark.parametrize("pose", [(180.0,), (0.0, 0.0, 0.0, -0.3), (80.0, 0.0, 0.0, 0.009)])
def test_circles_that_are_not_seen_whole_are_nan(pose, camera, looking):
    """From behind, behind the lens, and with one half of it behind the lens."""
    assert np.isnan(circle_image(camera, 0.02, looking(*pose))).all()


def test_axes():
    turn = np.deg2rad(30.0)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    S = R @ np.diag([40.0, 25.0]) @ R.T
    ellipse = np.array([300.0, 200.0, S[0, 0], S[0, 1], S[1, 1]])
    long, short, angle = ellipse_axes(ellipse)
    assert (long, short, angle) == pytest.approx((80.0, 50.0, turn))
    np.testing.assert_allclose(half_axes(ellipse), S)
    end = ellipse[:2] + 40.0 * R[:, 0]
    assert ellipse_distance(ellipse, end[None])[0] == pytest.approx(0.0, abs=1e-12)


def test_distance_and_its_derivatives():
    ellipse = np.array([300.0, 200.0, 40.0, 6.0, 30.0])
    rng = np.random.default_rng(2)
    points = ellipse_points(ellipse, 11) + rng.normal(0.0, 0.05, (11, 2))
    distance, jacobian = ellipse_distance(ellipse, points)
    dense = ellipse_points(ellipse, 200_000)
    nearest = [np.linalg.norm(dense - p, axis=1).min() for p in points]
    np.testing.assert_allclose(np.abs(distance), nearest, atol=3e-4)
    step = 1e-5 * np.eye(5)
    for k in range(5):
        up, _ = ellipse_distance(ellipse + step[k], points)
        down, _ = ellipse_distance(ellipse - step[k], points)
        # the derivatives leave out terms of the size of the distance over the axes
        np.testing.assert_allclose((up - down) / 2e-5, jacobian[:, k], atol=0.02)


def test_fit_has_the_scatter_that_its_derivatives_predict():
    true = np.array([300.0, 200.0, 40.0, 6.0, 30.0])
    rng, trials, sigma = np.random.default_rng(6), 2000, 0.05
    clean = ellipse_points(true, 60)
    fitted = fit_ellipse(clean + rng.normal(0.0, sigma, (trials, 60, 2)))
    _, jacobian = ellipse_distance(true, clean)
    predicted = sigma * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    # a standard deviation of T trials is good to 1 / sqrt(2 T) of itself: 4 of these are 6 %
    np.testing.assert_allclose(fitted.std(axis=0), predicted, rtol=4 / np.sqrt(2 * trials))
    assert (np.abs(fitted.mean(axis=0) - true) < 4 * predicted / np.sqrt(trials) + 1e-4).all()
