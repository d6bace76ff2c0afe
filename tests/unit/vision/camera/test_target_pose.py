"""Poses from points against the truth, Monte Carlo and OpenCV."""

import cv2
import numpy as np
import pytest

from calib import se3
from calib.errors import InputError
from calib.vision.camera import Camera, pose_from_points

BENT = Camera(
    640, 480, 900.0, principal_px=(331.0, 233.0), distortion=(-0.25, 0.1, 1e-3, -1e-3, 0.0)
)


def errors(T: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(w, v) of R = exp([w]) R_true, p = p_true + v."""
    turn = se3.rotation_log(T[:3, :3] @ true[:3, :3].T)
    return np.concatenate([turn, T[:3, 3] - true[:3, 3]])


@pytest.mark.parametrize("pose", [(0.0,), (30.0, 0.02, -0.02, 0.3, 40.0), (-50.0, 0.01, 0.03)])
def test_without_noise_the_pose_is_exact(pose, target, looking):
    true = looking(*pose)
    for points in (target.corners(), target.rim(12)):
        found = pose_from_points(BENT, points, BENT.project(se3.apply(true, points)))
        assert found.is_ok
        np.testing.assert_allclose(errors(found.T_camera_target, true), 0.0, atol=1e-8)
        assert found.rms_px < 1e-6


def test_as_opencv_refines_it(target, looking):
    true, points = looking(30.0, 0.02, -0.01, 0.3, 10.0), target.corners()
    rng = np.random.default_rng(8)
    pixels = BENT.project(se3.apply(true, points)) + rng.normal(0.0, 0.05, (len(points), 2))
    matrix = np.array([[900.0, 0.0, 330.5], [0.0, 900.0, 232.5], [0.0, 0.0, 1.0]])
    bend = np.array(BENT.distortion)
    start = cv2.Rodrigues(true[:3, :3])[0], true[:3, 3:].copy()
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-14)
    turn, place = cv2.solvePnPRefineLM(points, pixels - 0.5, matrix, bend, *start, criteria)
    found = pose_from_points(BENT, points, pixels).T_camera_target
    np.testing.assert_allclose(found[:3, 3], place[:, 0], atol=1e-8)
    np.testing.assert_allclose(found[:3, :3], cv2.Rodrigues(turn)[0], atol=1e-6)


def test_covariance_by_monte_carlo(target, looking):
    true, points, sigma, trials = looking(30.0, 0.02, -0.01, 0.3, 10.0), target.corners(), 0.05, 200
    rng = np.random.default_rng(9)
    clean = BENT.project(se3.apply(true, points))
    found = [
        pose_from_points(BENT, points, clean + rng.normal(0.0, sigma, clean.shape), sigma)
        for _ in range(trials)
    ]
    scatter = np.array([errors(f.T_camera_target, true) for f in found])
    predicted = pose_from_points(BENT, points, clean, sigma)
    np.testing.assert_allclose(scatter.std(axis=0), predicted.sigma, rtol=4 / np.sqrt(2 * trials))
    # Mahalanobis distances of six normal numbers: mean 6, variance 12
    whole = np.einsum("ti,ij,tj->t", scatter, np.linalg.inv(predicted.covariance), scatter)
    assert whole.mean() == pytest.approx(6.0, abs=4 * np.sqrt(12.0 / trials))


def test_a_small_target_far_away_is_ambiguous(target, looking):
    """At 4 m and 0.3 px the plate leaning towards the camera looks as if leaning away."""
    true, points = looking(30.0, z_m=4.0), target.corners()
    found = pose_from_points(BENT, points, BENT.project(se3.apply(true, points)), 0.3)
    assert found.status == "ambiguous"
    assert "fits as well" in found.message


def test_pixels_that_no_point_is_seen_at(target):
    folded = Camera(640, 480, 200.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    pixels = np.array([[0.0, 0.0], [640.0, 0.0], [640.0, 480.0], [0.0, 480.0]])
    found = pose_from_points(folded, target.plate_corners(), pixels)
    assert found.status == "no pose"
    assert np.isnan(found.T_camera_target).all()


@pytest.mark.parametrize(
    ("points", "pixels", "sigma", "message"),
    [
        (np.zeros((5, 3)), np.zeros((4, 2)), 0.1, "do not belong together"),
        (np.zeros((3, 3)), np.zeros((3, 2)), 0.1, "3 points fix no pose"),
        (np.ones((4, 3)), np.zeros((4, 2)), 0.1, "off the plane"),
        (np.zeros((4, 3)), np.zeros((4, 2)), 0.0, "noise of 0.0 px"),
    ],
)
def test_unusable_points_are_refused(points, pixels, sigma, message):
    with pytest.raises(InputError, match=message):
        pose_from_points(BENT, points, pixels, sigma)
