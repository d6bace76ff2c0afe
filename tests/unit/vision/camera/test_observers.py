"""Images and geometry give the same measurements: means, scatter and outcomes."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import ConvergenceError, InputError
from calib.vision.camera import (
    Camera,
    FastObserver,
    ImageObserver,
    Imaging,
    MeasurementNoise,
    Occluder,
    circle_image,
    ellipse_axes,
    make_observer,
    noise_from_images,
)

CLOSE = Camera(160, 120, 400.0, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
"""A small image is rendered in a third of the time."""

TRIALS = 300


@pytest.mark.slow
@pytest.mark.parametrize("tilt_deg", [0.0, 35.0])
def test_both_agree(tilt_deg, target, looking):
    """Means within 3 standard errors of both, standard deviations within 15 %.

    The images of the test are others than those that the noise comes from. A standard deviation of
    300 trials is good to 4 %, so the difference of two to 5.8 %.
    """
    T, imaging = looking(tilt_deg, 0.01, -0.005, 0.25), Imaging()
    noise = noise_from_images(CLOSE, target, T, imaging, TRIALS, np.random.default_rng(1))
    rng = np.random.default_rng(2)
    shifts = rng.uniform(-0.5, 0.5, (TRIALS, 2)) * 0.25 / 400.0
    poses = np.repeat(T[None], TRIALS, axis=0)
    poses[:, :2, 3] += shifts
    slow = ImageObserver(CLOSE, target, imaging)
    seen = slow.views(poses, rng).vhs_px
    fast = FastObserver(CLOSE, target, noise).views(poses, rng).vhs_px
    true = circle_image(CLOSE, target.diameter_m, poses)
    exact = np.stack([true[:, 1], true[:, 0], ellipse_axes(true)[0]], axis=1)
    seen, fast = seen - exact, fast - exact

    both = np.sqrt(seen.var(axis=0) / TRIALS + fast.var(axis=0) / TRIALS)
    calibrated = np.sqrt(both**2 + seen.var(axis=0) / TRIALS)
    assert (np.abs(seen.mean(axis=0) - fast.mean(axis=0)) < 3 * calibrated).all()
    np.testing.assert_allclose(fast.std(axis=0), seen.std(axis=0), rtol=0.15)
    np.testing.assert_allclose(noise.sigma_vhs_px, seen.std(axis=0), rtol=0.2)


def test_noise_of_given_standard_deviations(camera, target, looking):
    """For tilted targets, whatever the direction of the long axis; 4 sigma of 20000 trials."""
    sigma = np.array([0.01, 0.02, 0.03])
    observer = FastObserver(camera, target, MeasurementNoise.from_sigma(sigma))
    turned = looking(40.0)
    turned[:3, :3] = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]) @ turned[:3, :3]
    for T in (looking(40.0), turned):
        seen = observer.views(np.repeat(T[None], 20_000, axis=0), np.random.default_rng(4)).vhs_px
        np.testing.assert_allclose(seen.std(axis=0), sigma, rtol=4 / np.sqrt(40_000))


def test_the_same_outcomes(camera, target, looking):
    noise = MeasurementNoise.from_sigma([0.003, 0.003, 0.005])
    slow = make_observer("image", camera, target, imaging=Imaging())
    fast = make_observer("fast", camera, target, noise=noise)
    rng = np.random.default_rng(5)
    expected = {
        "": looking(20.0),
        "touches the edge": looking(20.0, 0.064),
        "no target": looking(20.0, 0.2),
    }
    unseen = [looking(180.0), looking(z_m=-0.35), looking(z_m=4.0)]
    poses = np.array([*expected.values(), *unseen])
    for observer in (slow, fast):
        statuses = [said.partition(":")[0] for said in observer.views(poses, rng).reasons]
        assert statuses == ["", "touches the edge", *["no target"] * 4]
    poses = np.array([*expected.values(), looking(180.0)])
    batch = FastObserver(camera, target, noise).views(poses, rng).vhs_px
    assert np.isfinite(batch[0]).all()
    assert np.isnan(batch[1:]).all()


def test_an_observer_needs_its_noise(camera, target):
    with pytest.raises(InputError, match="has no noise"):
        make_observer("fast", camera, target)
    with pytest.raises(InputError, match="did you mean fast"):
        make_observer("fats", camera, target)


def test_noise_that_cannot_be_had(camera, target, looking):
    with pytest.raises(InputError, match="9 images give no noise"):
        noise_from_images(camera, target, looking(), Imaging(), 9, np.random.default_rng(0))
    half = Occluder(((332.0, -9.0), (650.0, -9.0), (650.0, 490.0), (332.0, 490.0)))
    hidden = replace(Imaging(), occluders=(half,))
    with pytest.raises(ConvergenceError, match="10 of 10 images could not be measured: an ellipse"):
        noise_from_images(camera, target, looking(), hidden, 10, np.random.default_rng(0))
