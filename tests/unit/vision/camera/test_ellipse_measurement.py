"""Measured ellipses against exact projective geometry, and every outcome that is none."""

from dataclasses import replace

import numpy as np
import pytest

from calib.vision.camera import (
    Camera,
    CircleTarget,
    EllipseMeasurement,
    Glare,
    Imaging,
    Occluder,
    circle_image,
    ellipse_axes,
    measure_ellipse,
    render,
)
from calib.vision.camera.edges import find_edges

QUIET = Imaging(noise_grey=0.3, white_grey=200.0)
"""Just enough noise that rounding to whole grey levels has no preference."""


def image_of(scene, imaging: Imaging = QUIET, seed: int = 0, camera: Camera | None = None):
    return render(camera or Camera.paper(), scene, imaging, np.random.default_rng(seed))


def error(found: EllipseMeasurement, camera: Camera, target: CircleTarget, T) -> np.ndarray:
    """Of x, y, long axis and short axis [px]."""
    true = circle_image(camera, target.diameter_m, T)
    long, short, _ = ellipse_axes(true)
    axes = [found.long_axis_px - long, found.short_axis_px - short]
    return np.concatenate([found.center_px - true[:2], axes])


def test_bias_over_subpixel_shifts(camera, target, looking):
    """A circle shifted through a pixel in steps of an eighth: below 0.02 px everywhere."""
    pixel = 0.35 / 1600.0
    errors = []
    for k in range(8):
        T = looking(25.0, k / 8 * pixel, ((3 * k) % 8) / 8 * pixel)
        errors.append(error(measure_ellipse(image_of([(target, T)])), camera, target, T))
    assert np.abs(errors).max() < 0.02
    assert np.abs(np.mean(errors, axis=0)).max() < 0.006


@pytest.mark.parametrize("blur_px", [0.6, 1.0, 1.5])
def test_blur_does_not_make_a_small_circle_smaller(blur_px, camera, looking):
    """The half height of a blurred disc of radius R lies at ``R - sigma² / (2 R)``.

    With R = 15 px and a blur of 1.5 px the diameter would be 0.15 px short; the area is kept.
    """
    small = CircleTarget(30.0 / 1600.0 * 0.35, cross_length_m=0.0)
    T = looking()
    errors = [
        error(
            measure_ellipse(image_of([(small, T)], replace(QUIET, blur_px=blur_px), seed)),
            camera,
            small,
            T,
        )
        for seed in range(4)
    ]
    assert np.abs(np.mean(errors, axis=0)).max() < 0.03


def test_edges_of_a_disc_of_known_area(camera, target, looking):
    """All of the rim is found, within noise of 0.3 / 154 grey levels over the reach."""
    T = looking(30.0)
    ellipse = circle_image(camera, 0.02, T)
    edges = find_edges(image_of([(target, T)]), ellipse, dark=True)
    assert edges.share == 1.0


@pytest.mark.parametrize(
    "pose", [(0.0,), (45.0, 0.02, -0.01), (30.0, -0.04, 0.02, 0.4, 50.0), (10.0, 0, 0, 0.15)]
)
def test_against_projective_geometry(pose, camera, target, looking):
    T = looking(*pose)
    found = measure_ellipse(image_of([(target, T)]))
    assert found.is_ok
    assert np.abs(error(found, camera, target, T)).max() < 0.02
    assert found.rms_px < 0.02
    np.testing.assert_allclose(found.ellipse, circle_image(camera, 0.02, T), atol=0.02)
    np.testing.assert_allclose(
        found.vhs_px, [found.center_px[1], found.center_px[0], found.long_axis_px]
    )


def test_with_distortion(target, looking):
    bent = Camera(640, 480, 1600.0, distortion=(-0.3, 0.1, 1e-3, -1e-3, 0.0))
    T = looking(30.0, 0.04, 0.02)
    found = measure_ellipse(image_of([(target, T)], camera=bent))
    assert np.abs(error(found, bent, target, T)).max() < 0.02


def test_light_circle_on_a_dark_plate(camera, looking):
    light = CircleTarget(circle=0.85, face=0.08)
    T = looking(20.0)
    found = measure_ellipse(image_of([(light, T)]), dark=False)
    assert np.abs(error(found, camera, light, T)).max() < 0.02


HIDDEN = Occluder(((350.0, 150.0), (420.0, 150.0), (420.0, 260.0), (358.0, 240.0)))


@pytest.mark.parametrize(
    ("imaging", "limit"),
    [
        (replace(QUIET, gradient=(0.8, -0.4), vignetting=0.4), 0.03),
        (replace(QUIET, white_grey=60.0), 0.05),
        (Imaging(noise_grey=8.0), 0.15),
        (replace(QUIET, occluders=(HIDDEN,)), 0.08),
        (replace(QUIET, glares=(Glare((330.0, 240.0), 10.0),)), 0.05),
        (replace(QUIET, glares=(Glare((360.0, 240.0), 8.0),)), 0.15),
        (replace(QUIET, surroundings=0.08), 0.03),
        (replace(QUIET, surroundings=0.8), 0.03),
    ],
    ids=[
        "uneven light",
        "dim",
        "noise",
        "a fifth hidden",
        "glare inside",
        "glare on the rim",
        "dark about",
        "light about",
    ],
)
def test_measured_all_the_same(imaging, limit, camera, target, looking):
    T = looking(25.0, 0.001, -0.001)
    found = measure_ellipse(image_of([(target, T)], imaging))
    assert found.status == "ok", found.message
    assert np.abs(error(found, camera, target, T)).max() < limit


def test_nothing_in_the_image():
    found = measure_ellipse(image_of([], Imaging()))
    assert found.status == "no target"
    assert found.message == "no dark ellipse of 10 px or more in the image"
    assert np.isnan(found.vhs_px).all()
    assert not found.is_ok


def test_an_image_of_one_grey_level():
    assert measure_ellipse(np.full((480, 640), 90, dtype=np.uint8)).status == "no target"


def test_a_square_is_no_target(looking):
    """A dark square on a light plate: its sides are no arcs, its corners none either."""
    square = CircleTarget(0.019, (0.02, 0.02), 0.0, circle=0.08, face=0.0801)
    sheet = CircleTarget(0.001, (0.04, 0.04), 0.0)
    T = looking(10.0)
    assert measure_ellipse(image_of([(sheet, T), (square, T)])).status in ("no target", "poor fit")


@pytest.mark.parametrize("x_m", [0.062, 0.066, -0.064])
def test_cut_by_the_edge_of_the_image(x_m, target, looking):
    found = measure_ellipse(image_of([(target, looking(20.0, x_m))]))
    assert found.status == "touches the edge"
    assert "is cut by the edge" in found.message
    assert np.isnan(found.long_axis_px)


def test_half_a_circle_is_a_poor_fit(target, looking):
    half = Occluder(((322.0, -9.0), (650.0, -9.0), (650.0, 490.0), (322.0, 490.0)))
    found = measure_ellipse(image_of([(target, looking(25.0))], replace(QUIET, occluders=(half,))))
    assert found.status == "poor fit"
    assert "of the rim" in found.message
    assert not found.is_ok


def test_several(camera, target, looking):
    poses = looking(20.0, -0.03), looking(20.0, 0.03)
    image = image_of([(target, T) for T in poses])
    found = measure_ellipse(image)
    assert found.status == "several"
    assert found.message.startswith("2 targets, at (")
    for T in poses:
        nearest = measure_ellipse(image, near_px=camera.project(T[:3, 3]) + 40.0)
        assert np.abs(error(nearest, camera, target, T)).max() < 0.02
