"""Rendered images against brute force, and what light, noise, glare and occluders do."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from calib.vision.camera import Camera, CircleTarget, Glare, Imaging, Occluder, render

CLEAN = Imaging(blur_px=0.0, noise_grey=0.0, white_grey=200.0)
"""Levels of 16, 70 and 170: whole numbers, so that rounding says nothing."""

SMALL = Camera(64, 48, 200.0)
BENT = Camera(64, 48, 170.0, principal_px=(34.0, 22.0), distortion=(-2.0, 1.0, 4e-3, -3e-3, 0.0))


def brute_force(
    camera: Camera, target: CircleTarget, T: np.ndarray, imaging: Imaging, fine: int = 16
) -> np.ndarray:
    """Mean grey of a grid of rays through each pixel, met with the plane one by one."""
    size = np.array([camera.width_px, camera.height_px])
    x, y = ((np.arange(n * fine) + 0.5) / fine for n in size)
    rays = camera.rays(np.stack(np.meshgrid(x, y), axis=-1))
    normal, place = T[:3, 2], T[:3, 3]
    points = rays * ((normal @ place) / (rays @ normal))[..., None]
    seen = target.pattern(((points - place) @ T[:3, :3])[..., :2])
    seen = np.where(np.isnan(seen), imaging.surroundings, seen)
    return imaging.white_grey * seen.reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))


@pytest.mark.parametrize("camera", [SMALL, BENT], ids=["ideal", "distorted"])
@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0, 0.3, 0.0), (40.0, 0.01, -0.012, 0.25, 30.0)])
def test_against_brute_force(camera, pose, looking, target):
    """Corners of cross and plate hide most between the rays of a pixel: a tenth of its contrast."""
    T = looking(*pose)
    image = render(camera, [(target, T)], CLEAN, np.random.default_rng(0))
    difference = image - brute_force(camera, target, T, CLEAN)
    assert np.abs(difference).max() < 0.1 * 154.0
    assert np.sqrt((difference**2).mean()) < 1.0
    assert abs(difference.mean()) < 0.03


def test_a_part_of_the_plate_outside_the_image(looking, target):
    T = looking(20.0, x_m=0.04, y_m=-0.03, z_m=0.3)
    image = render(SMALL, [(target, T)], CLEAN, np.random.default_rng(0))
    assert np.abs(image - brute_force(SMALL, target, T, CLEAN)).max() < 0.1 * 154.0
    assert (image[0, -20:] == 170).sum() > 5


@pytest.mark.parametrize("pose", [(180.0,), (100.0,), (0.0, 0.0, 0.0, -0.35), (0.0, 5.0)])
def test_back_and_what_is_behind_or_beside_are_not_drawn(pose, looking, target):
    image = render(SMALL, [(target, looking(*pose))], CLEAN, np.random.default_rng(0))
    assert (image == 70).all()


def test_several_targets_the_later_in_front(looking, target):
    grey = CircleTarget(0.01, (0.02, 0.02), 0.0, circle=0.5, face=0.6)
    scene = [(target, looking(z_m=0.3)), (grey, looking(z_m=0.25)), (grey, looking(x_m=-0.05))]
    image = render(SMALL, scene, CLEAN, np.random.default_rng(0))
    assert image[24, 32] == 100  # middle: circle of the near one
    assert image[24, 22] == 170  # the plate of the first about it
    assert image[24, 32 - round(200 * 0.05 / 0.35)] == 100


def test_blur_is_a_gaussian(looking, target):
    scene = [(target, looking(25.0, z_m=0.3))]
    sharp = render(SMALL, scene, CLEAN, np.random.default_rng(0))
    image = render(SMALL, scene, replace(CLEAN, blur_px=1.3), np.random.default_rng(0))
    expected = cv2.GaussianBlur(sharp.astype(float), (15, 15), 1.3)
    assert np.abs(image - expected).max() < 1.1


def test_noise_has_its_standard_deviation():
    image = render(Camera.paper(), [], replace(CLEAN, noise_grey=2.0), np.random.default_rng(5))
    # rounding adds a variance of 1/12; 307200 pixels give the deviation to 0.13 %
    assert image.std() == pytest.approx(np.sqrt(4.0 + 1 / 12), rel=0.006)
    assert image.mean() == pytest.approx(70.0, abs=0.02)
    again = render(Camera.paper(), [], replace(CLEAN, noise_grey=2.0), np.random.default_rng(5))
    assert (image == again).all()


def test_uneven_light():
    """From the left edge to the right the light grows by 40 %; in the corners 30 % are lost."""
    flat = replace(CLEAN, surroundings=0.5, white_grey=200.0)
    sloped = render(SMALL, [], replace(flat, gradient=(0.4, 0.0)), np.random.default_rng(0))
    sloped = sloped.astype(int)
    assert sloped[24, 63] - sloped[24, 0] == pytest.approx(40, abs=2)
    assert sloped[24, 32] == pytest.approx(100, abs=1)
    dim = render(SMALL, [], replace(flat, vignetting=0.3), np.random.default_rng(0))
    dim = dim.astype(int)
    assert dim[0, 0] == dim[47, 63] == pytest.approx(70, abs=2)
    assert dim[24, 32] == 100


def test_occluder_and_glare():
    corners = ((5.0, 10.0), (25.0, 10.0), (25.0, 40.0), (5.0, 40.0))
    imaging = replace(
        CLEAN, occluders=(Occluder(corners, 0.1),), glares=(Glare((50.0, 24.0), 3.0, 400.0),)
    )
    image = render(SMALL, [], imaging, np.random.default_rng(0)).astype(int)
    assert (image[12:38, 7:23] == 20).all()
    assert (image < 45).sum() == pytest.approx(20 * 30, abs=20 + 30 + 50)
    assert (image[22:26, 48:52] == 255).all()
    # 400 exp(-(12² / 3²) / 2) = 0.13 is rounded away
    assert image[24, 62] == 70


def test_negative_noise_is_refused():
    with pytest.raises(InputError, match="noise_grey is -1"):
        Imaging(noise_grey=-1.0)
