"""Pixels against poses and A X = Z B: a short form, what its figures stand on, and what it says."""

import json
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from calib.se3 import rotation_exp, transform
from posedesign.study import Options
from posedesign.study.library import find_study
from studies.board_scenes import draw_scene

STUDY = find_study("pictures_of_a_board")
EXPECTED: dict[str, Any] = json.loads((STUDY.folder / "expected.json").read_text(encoding="utf-8"))
TEXT = (STUDY.folder / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def run():
    return STUDY.load()


@pytest.fixture(scope="module")
def peers(run):
    return import_module("studies.17_pictures_of_a_board.board_peers")


def row_of(arm: str, lens: str, method: str) -> dict[str, Any]:
    return next(
        row
        for row in EXPECTED["rows"]
        if (row["arm"], row["lens"], row["method"]) == (arm, lens, method)
    )


@pytest.mark.parametrize("lens", ["lens given", "lens from the pictures"])
def test_without_noise_every_method_that_converges_is_exact(peers, lens):
    """Frames and orders are right: those of OpenCV, and of the poses that it gives."""
    rng = np.random.default_rng(1)
    scene = draw_scene(rng, 12)
    pixels = scene.seen(rng, sigma_px=1e-4)
    for method, found in peers.estimates(scene, pixels, lens):
        if method in ("hirsh-literal", "zhuang-literal"):  # as printed they end anywhere
            continue
        assert found is not None, method
        off = peers.judged(found, scene.X, 0.5)
        assert off["off_mm"] < 0.05, method
        assert off["off_deg"] < 0.01, method


def test_sizes_are_those_of_draws(peers):
    rng = np.random.default_rng(2)
    X = transform(rotation_exp(np.array([0.3, -0.8, 1.0])), np.array([0.1, 0.2, 0.3]))
    root = rng.standard_normal((6, 6)) * 1e-4
    draws = rng.standard_normal((4000, 6)) @ root.T
    off = [
        peers.judged((transform(rotation_exp(w) @ X[:3, :3], X[:3, 3] + v), root @ root.T), X, 0.5)
        for v, w in zip(draws[:, :3], draws[:, 3:], strict=True)
    ]
    mm, deg = peers.sizes(root @ root.T, X, 0.5)
    rms = {key: np.sqrt(np.mean([one[key] ** 2 for one in off])) for key in ("off_mm", "off_deg")}
    assert rms["off_mm"] == pytest.approx(mm, rel=0.05)  # 4000 draws: 1.5 %
    assert rms["off_deg"] == pytest.approx(deg, rel=0.05)
    assert np.mean([one["nees"] for one in off]) == pytest.approx(1.0, abs=0.05)


def test_the_bound_of_a_lens_that_is_estimated_is_above_that_of_one_that_is_known(peers):
    scene = draw_scene(np.random.default_rng(3), 15)
    known, free = (
        peers.sizes(peers.bound_of(scene, 0.2, (0.0, 0.0), free_lens=free), scene.X, 0.5)
        for free in (False, True)
    )
    assert np.all(np.array(free) > 2 * np.array(known))


@pytest.mark.slow
def test_a_short_form_has_the_structure_of_the_full_one(run, tmp_path):
    said: list[float] = []
    found = STUDY.run(Options(tmp_path, 2, advance=lambda what, part: said.append(part)))
    assert said == [0.25, 0.5, 0.75, 1.0]
    assert set(found) == set(EXPECTED)
    assert [set(row) for row in found["rows"]] == [set(row) for row in EXPECTED["rows"]]
    assert [row["method"] for row in found["rows"]] == [row["method"] for row in EXPECTED["rows"]]
    assert {path.suffix for path in STUDY.plot(tmp_path)} == {".png", ".svg"}


def test_pixels_are_at_the_bound_and_say_so(run):
    """Four standard errors about one, in each condition."""
    low, high = run.nees_band(EXPECTED["trials"])
    spread = 4 * (high - low) / 3.92
    for arm in run.SETTINGS["arms"]:
        for lens in run.LENSES:
            row = row_of(arm, lens, run.PIXELS)
            assert row["failed"] == 0
            for unit in ("mm", "deg"):
                assert abs(row[f"over_{unit}"] - 1.0) < 4 * row[f"error_{unit}"], (arm, lens)
            assert abs(row["nees"] - 1.0) < spread


def test_its_readme_says_how_many_scenes():
    text = (STUDY.folder / "README.md").read_text(encoding="utf-8")
    assert f"{EXPECTED['trials']} scenes" in text
