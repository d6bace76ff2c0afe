"""Simulated arms: where camera and target are, against the calibration model."""

from dataclasses import replace

import numpy as np
import pytest

from calib.se3 import inverse, transform
from calib.vision.camera import FastObserver, ImageObserver, Imaging, MeasurementNoise
from calib.vision.touch_up import SimulatedArms
from calib.vision.touch_up.arms import LostMotion

SILENT = MeasurementNoise.from_sigma([0.0, 0.0, 0.0])


def test_target_is_seen_from_where_the_model_has_the_arm(make_bench):
    bench = make_bench(offsets_deg=0.3)
    q = bench.q + np.random.default_rng(1).uniform(-0.2, 0.2, (4, 6))
    arms = bench.arms(4)
    arms.move(np.arange(4), q)
    T_base_tip = bench.true.model.view(q, bench.true.values).T_base_tip
    expected = inverse(T_base_tip @ bench.true.T_tip_camera) @ bench.true.T_base_target
    assert arms.T_camera_target(np.arange(4)) == pytest.approx(expected)
    assert np.abs(T_base_tip - bench.robot.fk(q)).max() > 1e-3, "its errors are in it"
    assert np.array_equal(arms.joints(np.arange(4)), q), "the controller knows nothing of them"


def test_each_arm_may_have_a_target_of_its_own(bench):
    shifts = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.02, 0.0]])
    own = transform(np.eye(3), shifts) @ bench.true.T_base_target
    true = replace(bench.true, T_base_target=own)
    observer = FastObserver(bench.camera, bench.target, SILENT)
    arms = SimulatedArms(true, observer, 3, np.random.default_rng(0), bench.q)
    seen = arms.T_camera_target(np.array([2, 0]))
    T_base_camera = bench.robot.fk(bench.q) @ bench.true.T_tip_camera
    assert T_base_camera @ seen == pytest.approx(own[[2, 0]])


def test_vibration_and_scatter_are_as_large_as_said(make_bench):
    """Standard deviations of 3000 numbers are good to 1.3 %; four of these are allowed."""
    lost = LostMotion.of(6, scatter_rad=[1e-5, 0, 0, 0, 0, 0])
    bench = make_bench(lost_motion=lost, vibration_m=3e-6)
    arms = bench.arms(1000)
    which = np.arange(1000)
    shaken = arms.T_camera_target(which)[:, :3, 3]
    assert (shaken - shaken.mean(axis=0)).std() == pytest.approx(3e-6, rel=0.05)
    arms.move(which, np.tile(bench.q, (1000, 1)))
    stopped = arms._stopped[:, 0]
    assert stopped.std() == pytest.approx(1e-5, rel=4 / np.sqrt(2 * 1000))
    assert not arms._stopped[:, 1:].any()


def test_same_seed_same_noise(bench):
    noise = MeasurementNoise.from_sigma([0.1, 0.1, 0.1])
    arms = bench.arms(3, noise, seed=5)
    first = arms.look(np.arange(3)).ellipses
    assert not np.array_equal(first, arms.look(np.arange(3)).ellipses)
    arms.reseed(np.random.default_rng(5))
    assert np.array_equal(first, arms.look(np.arange(3)).ellipses)
    assert arms.pictures == 9


def test_pictures_only_where_there_are_pictures(bench):
    assert bench.arms().picture(0) is None
    observer = ImageObserver(bench.camera, bench.target, Imaging())
    arms = SimulatedArms(bench.true, observer, 1, np.random.default_rng(0), bench.q)
    assert arms.picture(0).shape == (480, 640)
    assert arms.image_px == (640, 480)
