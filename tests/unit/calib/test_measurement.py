"""Measurements: what they see, that whitened noise is white, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

from calib import se3
from calib.errors import ConvergenceError, InputError
from calib.measurement import TouchUp, TouchUps, ViewLine
from calib.measurement.simulate import simulate_touch_ups
from calib.measurement.touch import touch
from calib.parameters import Payload

SAMPLES = 20_000
FIVE_SIGMA = 5 * np.sqrt(2 / SAMPLES)
"""Of the scatter of a variance estimated from that many samples."""


def rotations(count: int) -> np.ndarray:
    return se3.rotation_exp(np.random.default_rng(0).standard_normal((count, 3)))


@pytest.mark.parametrize(
    "measurement",
    [TouchUp([1e-5, 2e-5, 8e-5]), ViewLine([1e-5, 3e-5])],
    ids=["point", "line"],
)
def test_whitened_noise_has_unit_covariance(measurement):
    R = rotations(SAMPLES)
    noise = measurement.sample(R, np.random.default_rng(1))
    assert noise.shape == (SAMPLES, 3)
    rows = measurement.whiten(measurement.observe(noise, R)[..., None], R)[..., 0]
    assert rows.shape == (SAMPLES, measurement.rows)
    covariance = rows.T @ rows / SAMPLES
    np.testing.assert_allclose(covariance, np.eye(measurement.rows), atol=FIVE_SIGMA)
    np.testing.assert_allclose(rows.mean(axis=0), 0.0, atol=5 / np.sqrt(SAMPLES))


def test_noise_lies_along_the_axes_of_the_camera():
    """Depth is along the tip's z, wherever that points."""
    R = np.broadcast_to(rotations(3)[2], (SAMPLES, 3, 3))
    noise = TouchUp([1e-5, 2e-5, 8e-5]).sample(R, np.random.default_rng(2)) @ R[0]
    np.testing.assert_allclose(noise.std(axis=0), [1e-5, 2e-5, 8e-5], rtol=FIVE_SIGMA)
    across = ViewLine([1e-5, 3e-5]).sample(R, np.random.default_rng(3)) @ R[0]
    np.testing.assert_allclose(across[:, :2].std(axis=0), [1e-5, 3e-5], rtol=FIVE_SIGMA)
    np.testing.assert_allclose(across[:, 2], 0.0, atol=1e-18)


def test_noise_is_drawn_anew_for_each_trial_and_posture():
    R = np.broadcast_to(rotations(4), (5, 4, 3, 3))
    noise = TouchUp(1e-5).sample(R, np.random.default_rng(4))
    assert noise.shape == (5, 4, 3)
    assert len(np.unique(noise)) == 60
    np.testing.assert_array_equal(noise, TouchUp(1e-5).sample(R, np.random.default_rng(4)))


def test_a_view_line_does_not_see_along_itself():
    R = rotations(10)
    error = 0.3 * R[:, :, 2]
    np.testing.assert_allclose(ViewLine(1e-5).observe(error, R), 0.0, atol=1e-16)
    np.testing.assert_allclose(
        ViewLine(1e-5).observe(error + R[:, :, 1], R), [[0, 1]] * 10, atol=1e-15
    )
    np.testing.assert_array_equal(TouchUp(1e-5).observe(error, R), error)


def test_one_number_means_the_same_noise_in_every_axis():
    np.testing.assert_array_equal(TouchUp(2e-5).sigma_m, [2e-5] * 3)
    np.testing.assert_array_equal(ViewLine(2e-5).sigma_m, [2e-5] * 2)
    assert TouchUp([1e-5, 2e-5, 2e-5]).mean_sigma_m == pytest.approx(np.sqrt(3) * 1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TouchUp(0.0), "a noise of 0 mm cannot be used: it must be above zero"),
        (lambda: TouchUp([1e-5, -1e-5, 1e-5]), "a noise of -0.01 mm cannot be used"),
        (lambda: TouchUp(np.nan), "a noise of nan mm cannot be used"),
        (lambda: ViewLine([1e-5, np.inf]), "a noise of inf mm cannot be used"),
        (lambda: TouchUp([1e-5, 1e-5]), "the noise needs 3 numbers, 2 were given"),
        (lambda: ViewLine([1e-5] * 3), "the noise needs 2 numbers, 3 were given"),
    ],
)
def test_noise_that_cannot_be_used(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert caught.value.name == "noise"


@pytest.mark.parametrize(
    ("postures", "target", "message"),
    [
        (np.zeros((3, 6)), [0, 0], r"2 targets for postures of shape \(3, 6\)"),
        (np.zeros(6), [0], r"1 targets for postures of shape \(6,\)"),
        (np.full((1, 6), np.nan), [0], "a joint value is not a finite number"),
        (np.zeros((2, 6)), [0, 2], "a target index has no name"),
        (np.zeros((2, 6)), [0, -1], "a target index has no name"),
    ],
)
def test_touch_ups_are_checked(postures, target, message):
    with pytest.raises(InputError, match=message):
        TouchUps(postures, np.array(target), ("left", "right"))


def test_simulated_touch_ups_have_the_noise_of_the_measurement(make_model, touching):
    """Where the true arm stops is scattered about the target, in camera axes."""
    model, q = make_model(), touching(10)
    x = model.nominal.copy()
    x[:5] += [1e-3, -1e-3, 2e-3, 1e-3, 1e-3]
    data = simulate_touch_ups(model, x, q, np.random.default_rng(5), trials=400)
    assert data.postures.shape == (400, 10, 6)
    rows = model.predict(data.postures, x)
    white = model.whiten(data.postures, rows[..., None], x).reshape(-1, 3)
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(3), atol=5 * np.sqrt(2 / 4000))


def test_simulation_without_noise_stands_on_the_target(make_model, touching):
    model, q = make_model(targets=2), touching(4)
    x, target = model.nominal + 1e-3, np.array([0, 1, 1, 0])
    data = simulate_touch_ups(model, x, q, target=target)
    np.testing.assert_allclose(model.predict(data.postures, x, target), 0.0, atol=1e-12)
    assert data.labels == ("T1", "T2")
    many = simulate_touch_ups(model, x, q, target=target, trials=3)
    np.testing.assert_allclose(many.postures, np.broadcast_to(data.postures, (3, 4, 6)), atol=1e-11)


def test_simulation_says_which_pose_cannot_be_touched(make_model, touching):
    model, q = make_model(targets=2), touching(3)
    x = model.nominal.copy()
    x[-3:] = [9.0, 0.0, 0.0]
    with pytest.raises(
        ConvergenceError, match=r"pose 2: the simulated arm stays .* mm off"
    ) as caught:
        simulate_touch_ups(model, x, q, target=np.array([0, 1, 0]))
    assert caught.value.name == "pose 2"


def test_touch_says_how_far_an_arm_out_of_reach_stays(make_model, touching, target_m):
    model = make_model()
    x = model.nominal.copy()
    x[-3:] = target_m + np.array([3.0, 0.0, 0.0])
    q, missing = touch(model, touching(2), x)
    point = model.view(q, x)[0].point
    np.testing.assert_allclose(missing, np.linalg.norm(point - x[-3:], axis=-1), atol=1e-9)
    assert (missing > 0.5).all()


@pytest.mark.parametrize(("mass", "com"), [(-1.0, [0, 0, 0]), (np.nan, [0, 0, 0]), (5.0, [0, 0])])
def test_a_payload_that_cannot_be(mass, com):
    with pytest.raises(InputError, match="a payload needs"):
        Payload(mass, com)
