"""Lenses: pixels as OpenCV has them, and every derivative."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import InputError
from calib.lens import DISTORTION, NEAREST_M, Lens, project

WIDE = {"pinhole": 0.5, "rational": 0.5, "fisheye": 1.2}
"""Largest x and y over depth of the points: where such distortions are those of lenses."""

PX_ROUNDING = 1e-8
"""Of pixels of some thousands, computed in another order."""

seeds = st.integers(0, 2**32 - 1)
models = st.sampled_from(sorted(DISTORTION))


def draw_lens(name: str, rng: np.random.Generator) -> Lens:
    terms = 0.03 * rng.standard_normal(len(DISTORTION[name]))
    if name != "fisheye":
        terms[2:4] *= 0.1
    focal = rng.uniform(500, 2000) * np.array([1.0, rng.uniform(0.95, 1.05)])
    middle = rng.uniform(0.45, 0.55, 2) * [1280, 1024]
    return Lens(name, 1280, 1024, (*focal, *middle, *terms))


def draw_points(name: str, rng: np.random.Generator, count: int = 20) -> np.ndarray:
    depth = rng.uniform(0.2, 2.0, count)
    sides = rng.uniform(-1, 1, (count, 2)) * WIDE[name] * depth[:, None]
    return np.column_stack([sides, depth])


@given(name=models, seed=seeds)
def test_pixels_are_those_of_opencv(name, seed):
    """OpenCV counts from the middle of the first pixel, we from its corner."""
    rng = np.random.default_rng(seed)
    lens = draw_lens(name, rng)
    points = draw_points(name, rng)
    K, terms = lens.to_opencv()
    shown = cv2.fisheye.projectPoints if name == "fisheye" else cv2.projectPoints
    theirs = shown(points[:, None], np.zeros(3), np.zeros(3), K, terms)[0][:, 0]
    np.testing.assert_allclose(lens.project(points), theirs + 0.5, rtol=0, atol=PX_ROUNDING)


@given(name=models, seed=seeds)
def test_derivatives_are_central_differences(name, seed):
    rng = np.random.default_rng(seed)
    lens = draw_lens(name, rng)
    points = draw_points(name, rng).T[:, :, None]
    values = np.array(lens.values)[:, None]
    found = project(name, values, points)

    def difference(by_values: np.ndarray, by_points: np.ndarray, step: float) -> np.ndarray:
        ahead = project(name, values + step * by_values, points + step * by_points).pixels
        behind = project(name, values - step * by_values, points - step * by_points).pixels
        return (ahead - behind) / (2 * step)

    for k in range(3):
        unit = np.eye(3)[k][:, None, None]
        scale = np.abs(found.by_point[:, k]).max() + 1.0
        off = difference(0 * values, unit, 1e-6) - found.by_point[:, k]
        assert np.abs(off).max() / scale < 1e-6
    for k in range(len(values)):
        unit = np.eye(len(values))[k][:, None]
        scale = np.abs(found.by_lens[k]).max() + 1e-3
        off = difference(unit, np.zeros((3, 1, 1)), 1e-5) - found.by_lens[k]
        assert np.abs(off).max() / scale < 1e-6


def test_a_fisheye_has_derivatives_on_its_axis():
    lens = draw_lens("fisheye", np.random.default_rng(0))
    found = project(
        "fisheye", np.array(lens.values)[:, None], np.array([[[0.0]], [[0.0]], [[2.0]]])
    )
    np.testing.assert_allclose(found.pixels[:, 0, 0], lens.values[2:4], atol=1e-9)
    slope = np.diag(lens.values[:2]) / 2.0
    np.testing.assert_allclose(found.by_point[:, :2, 0, 0], slope, rtol=1e-6, atol=1e-6)
    assert not found.by_point[:, 2].any()


@given(name=models, seed=seeds)
def test_rays_undo_the_projection_and_what_was_not_seen_stays_so(name, seed):
    rng = np.random.default_rng(seed)
    lens = draw_lens(name, rng)
    points = draw_points(name, rng) * [0.5, 0.5, 1.0]
    pixels = lens.project(points)
    pixels[3] = np.nan
    rays = lens.rays(pixels.reshape(4, 5, 2)).reshape(-1, 2)
    assert np.isnan(rays[3]).all()
    others = np.arange(len(points)) != 3
    wanted = points[others, :2] / points[others, 2:]
    np.testing.assert_allclose(rays[others], wanted, rtol=0, atol=1e-7)


def test_nothing_is_seen_behind_a_lens_and_a_fit_still_sees_a_residual():
    lens = draw_lens("pinhole", np.random.default_rng(1))
    assert np.isnan(lens.project(np.array([0.1, 0.1, -0.5]))).all()
    behind = np.array([0.1, 0.1, -0.5])[:, None, None]
    found = project("pinhole", np.array(lens.values)[:, None], behind)
    at_least = project(
        "pinhole", np.array(lens.values)[:, None], behind * 0 + [[[0.1]], [[0.1]], [[NEAREST_M]]]
    )
    np.testing.assert_allclose(found.pixels, at_least.pixels)
    assert not found.by_point[:, 2].any()


@given(name=models, seed=seeds)
def test_a_lens_goes_to_opencv_and_back(name, seed):
    lens = draw_lens(name, np.random.default_rng(seed))
    again = Lens.from_opencv(name, (1280, 1024), *lens.to_opencv())
    np.testing.assert_allclose(again.values, lens.values, rtol=1e-12)


def test_missing_terms_of_distortion_are_zero_and_too_many_are_refused():
    K = np.array([[900.0, 0, 640], [0, 900, 512], [0, 0, 1]])
    assert Lens.from_opencv("pinhole", (1280, 1024), K, np.array([0.1])).distortion == (
        *(0.1, 0.0, 0.0),
        *(0.0, 0.0),
    )
    zeros = np.append(np.full(5, 0.1), np.zeros(9))
    assert len(Lens.from_opencv("pinhole", (1280, 1024), K, zeros).distortion) == 5
    with pytest.raises(InputError, match="a pinhole lens has 5 terms of distortion, 8 were given"):
        Lens.from_opencv("pinhole", (1280, 1024), K, np.full(8, 0.1))


FOUR = (900.0, 900.0, 640.0, 512.0)


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("pinhol", (*FOUR, 0, 0, 0, 0, 0), "no lens 'pinhol'"),
        ("fisheye", (*FOUR, 0, 0, 0, 0, 0), "a fisheye lens has 8 values, 9 were given"),
        ("pinhole", (-1.0, *FOUR[1:], 0, 0, 0, 0, 0), "cannot be"),
        ("pinhole", (*FOUR, 0, 0, np.nan, 0, 0), "cannot be"),
        ("pinhole", (*FOUR[:3], np.inf, 0, 0, 0, 0, 0), "cannot be"),
    ],
)
def test_what_is_no_lens_is_refused(name, values, said):
    with pytest.raises(InputError, match=said) as refused:
        Lens(name, 1280, 1024, values)
    assert refused.value.hint
    assert "\n" not in str(refused.value)
