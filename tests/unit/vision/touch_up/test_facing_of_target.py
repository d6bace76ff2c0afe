"""How the target is turned, against known normals."""

import numpy as np
import pytest

from calib.se3 import inverse, rotation_exp, transform
from calib.vision.camera import circle_image
from calib.vision.touch_up import ImageJacobian, TiltBias
from calib.vision.touch_up.sighting import camera_of, find_normal

TURNS = np.deg2rad(
    [[0, 0, 0], [15, 0, 0], [-15, 0, 0], [0, 15, 0], [0, -15, 0], [0, 0, 30], [10, 10, 0]]
)


def ideal_jacobian(bench) -> ImageJacobian:
    """Of the known camera: the rows are against its axes."""
    f, s0, d = bench.camera.focal_px, bench.relation.size_px, 0.35
    return ImageJacobian(
        -np.diag([f / d, f / d, s0 / d]) @ bench.true.T_tip_camera[:3, [1, 0, 2]].T, bench.relation
    )


def seen(bench, normal, noise_px=0.0, stretch=1.0):
    """Orientations of the tip ``(N, 3, 3)``, ellipses, and the normal, given in camera axes."""
    rng = np.random.default_rng(0)
    aside = np.cross(normal, [0.3, 1.0, 0.2])
    aside /= np.linalg.norm(aside)
    face = np.column_stack([aside, np.cross(normal, aside), normal])
    R_tip_camera = bench.true.T_tip_camera[:3, :3]
    R_first = bench.robot.fk(bench.q)[:3, :3] @ R_tip_camera
    R_camera = R_first @ rotation_exp(TURNS)
    T = transform(
        np.swapaxes(R_camera, 1, 2) @ R_first @ face, np.tile([0.0, 0.0, 0.35], (len(TURNS), 1))
    )
    ellipses = circle_image(bench.camera, bench.target.diameter_m, T)
    ellipses[:, 2:4] *= stretch
    ellipses += noise_px * rng.standard_normal(ellipses.shape)
    return R_camera @ R_tip_camera.T, ellipses, R_first @ normal


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, 20.0, 45.0])
@pytest.mark.parametrize("aside_deg", [0.0, 100.0, 250.0])
def test_normal_is_found(bench, tilt_deg, aside_deg):
    tilt, aside = np.deg2rad([tilt_deg, aside_deg])
    normal = np.array([np.sin(tilt) * np.cos(aside), np.sin(tilt) * np.sin(aside), -np.cos(tilt)])
    R, ellipses, in_base = seen(bench, normal)
    exact = find_normal(ideal_jacobian(bench), R, ellipses)
    assert np.arccos(min(exact.normal @ in_base, 1.0)) < 1e-4
    assert exact.flaw == ""
    R, ellipses, in_base = seen(bench, normal, noise_px=0.02)
    noisy = find_normal(ideal_jacobian(bench), R, ellipses)
    off = np.arccos(min(noisy.normal @ in_base, 1.0))
    assert off < 4.0 * np.sqrt(2.0) * noisy.sigma_rad + 1e-6
    assert noisy.sigma_rad < np.deg2rad(1.0)


def test_oval_is_no_circle(bench):
    """One side a tenth shorter whatever the orientation: no tilt looks like that."""
    R, ellipses, _ = seen(bench, np.array([0.0, 0.0, -1.0]), stretch=0.9)
    assert "not those of a flat circle" in find_normal(ideal_jacobian(bench), R, ellipses).flaw


def test_tilt_bias_is_that_of_the_projection(make_bench):
    """Ellipse less image of the middle, and size less that of Eq. 1, at tilts up to 55 deg."""
    bench = make_bench(tilt_deg=25.0)
    jacobian = ideal_jacobian(bench)
    assert camera_of(jacobian).center_px == pytest.approx(bench.camera.center_px)
    bias = TiltBias(bench.robot, jacobian, bench.true.T_base_target[:3, 2])
    tool = bench.true.T_tip_camera @ [0.0, 0.0, 0.35, 1.0]
    R = rotation_exp(bench.true.T_tip_camera[:3, :3] @ np.deg2rad([30.0, 0.0, 0.0]))
    T = bench.robot.fk(bench.q) @ transform(R, tool[:3] - R @ tool[:3])
    q = bench.robot.inverse(T[None], near=bench.q).nearest()[0]
    seen_from = inverse(bench.robot.fk(q[0]) @ bench.true.T_tip_camera) @ bench.true.T_base_target
    ellipse = circle_image(bench.camera, bench.target.diameter_m, seen_from)
    middle = bench.camera.project(seen_from[:3, 3])
    off = bias(q)[0]
    assert off[:2] == pytest.approx((ellipse[:2] - middle)[::-1], abs=0.01)
    assert np.abs(off[:2]).max() > 0.1
    assert np.abs(bench.relation.error(ellipse, off)).max() < 0.02


def test_no_bias_for_the_back(bench):
    bias = TiltBias(bench.robot, ideal_jacobian(bench), -bench.true.T_base_target[:3, 2])
    assert not bias(bench.q[None]).any()
