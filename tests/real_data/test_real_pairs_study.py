"""Pairs of real robots: residuals against another program's, predictions, proofs, the images."""

import importlib
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from calib.robot_world import PairNoise, difference, residuals, solve, solve_batch
from posedesign.hand_eye.pairs import PairSource

pytestmark = [pytest.mark.real_data, pytest.mark.slow]

FOLDER = Path(__file__).parents[2] / "studies" / "07_real_pairs"
METHODS = ("ml", "shah", "li-kronecker", "zhuang-literal")
"""A short form: the methods that say most."""

LARGEST = pytest.param("UR3e", marks=pytest.mark.slow)
NAMES = (LARGEST, "tag 22, camera 2", "tag 15, camera 1", "Tabb")

Row = dict[str, Any]


@pytest.fixture(scope="module")
def pairs_folder(data_folder) -> Path:
    folder = data_folder / "robot_world"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    return folder


@pytest.fixture(scope="module")
def found(study, data_folder, pairs_folder) -> Row:
    return study.run(data_folder, METHODS, sigma=False)


@pytest.fixture(scope="module")
def pairs(study, data_folder, pairs_folder) -> Row:
    return study.real_pairs(data_folder)


def module(name: str) -> ModuleType:
    """A module of the study's folder, once the study is loaded."""
    return importlib.import_module(f"studies.07_real_pairs.{name}")


def rows(found: Row, name: str) -> dict[str, Row]:
    return {row["method"]: row for row in found["data"][name]["rows"]}


@pytest.mark.parametrize("name", NAMES)
def test_residuals_are_no_larger_than_those_of_the_reference(found, study, name):
    """To the digits that it was printed with, in degrees and in millimetres."""
    row = rows(found, name)["ml, ratio"]
    # the tags' translations are of another scale than those of what carries the camera
    assert row["status"] == ("doubtful" if name.startswith("tag") else "ok")
    for unit, printed in zip(("deg", "mm"), study.SETTINGS["reference"][name], strict=True):
        digits = len(printed.partition(".")[2])
        assert round(row[f"rms_{unit}"], digits) <= float(printed)
        assert row[f"out_rms_{unit}"] > row[f"rms_{unit}"]


@pytest.mark.parametrize("name", [LARGEST, "Tabb"])
def test_left_out_residuals_are_those_of_new_solutions(found, pairs, study, name):
    A, B = pairs[name]
    others = np.array([np.delete(np.arange(len(A)), i) for i in range(len(A))])
    left = solve_batch(A[others], B[others], "ml", module("real_rows").given_noise(study.SETTINGS))
    error = residuals(A[:, None], B[:, None], left.X, left.Z)[:, 0]
    row = rows(found, name)["ml, ratio"]
    for part, scale, unit in ((np.s_[:3], np.degrees(1.0), "deg"), (np.s_[3:], 1e3, "mm")):
        rms = scale * np.sqrt((error[:, part] ** 2).sum(axis=1).mean())
        assert row[f"out_rms_{unit}"] == pytest.approx(rms, rel=1e-3)


@pytest.mark.parametrize("tag", ["tag_15_cam_1", "tag_22_cam_2"])
def test_scalar_first_and_neither_side_inverted_is_what_fits(pairs_folder, tag):
    """Of sixteen readings of the files it leaves the least, in rotation and in translation."""
    first = ("qw", "qx", "qy", "qz", "x_m", "y_m", "z_m")
    last = ("qx", "qy", "qz", "qw", "x_m", "y_m", "z_m")
    a, b = (pairs_folder / "multi_tag" / f"{tag}_{side}.csv" for side in "AB")
    left = {}
    for invert, of_a, of_b in product(("none", "a", "b", "both"), (first, last), (first, last)):
        columns = [f"a_{name}" for name in of_a] + [f"b_{name}" for name in of_b]
        read = PairSource(a=a, b=b, columns=columns, invert=invert).read()
        result = solve_batch(read.A[None], read.B[None], "shah")
        error = residuals(read.A, read.B, result.X[0], result.Z[0])
        sizes = np.sqrt([(error[:, part] ** 2).sum(axis=1).mean() for part in np.s_[:3, 3:]])
        left[invert, of_a == first, of_b == first] = float(np.prod(sizes))
    best, second = sorted(left, key=left.__getitem__)[:2]
    assert best == ("none", True, True)
    assert left[second] > 2.0 * left[best]


@pytest.mark.parametrize("name", NAMES)
def test_the_likeliest_is_proven_and_predicts_about_best(found, name):
    of = found["data"][name]
    assert of["certificate"]["status"] == "optimal"
    assert of["certificate"]["unique"]
    assert of["certificate"]["relative_gap"] < 1e-8
    # the same optimum by another descent
    assert of["certificate"]["moved_deg"] < 0.01
    assert of["certificate"]["moved_mm"] < 0.1
    for row in of["splits"]["methods"].values():
        assert row["rms_deg_ratio"] > 0.98
        assert row["rms_mm_ratio"] > 0.95


def test_rotations_first_predict_worse_where_poses_hardly_turn(found):
    methods = found["data"]["tag 22, camera 2"]["splits"]["methods"]
    assert methods["shah"]["rms_mm_ratio"] > 3.0
    assert methods["shah"]["rms_mm_worse"] > 0.95
    assert methods["ml, ratio"]["rms_mm_ratio"] < 1.1
    assert rows(found, "tag 22, camera 2")["zhuang-literal"]["status"] == "misfit"


@pytest.mark.parametrize("name", NAMES)
def test_estimated_noise_goes_with_the_residuals_of_every_half(study, pairs, name):
    """Of every half of the runs: residuals in units of the noise estimated are as they must be."""
    A, B = pairs[name]
    for learn in module("real_rows").halves(len(A), study.SETTINGS["splits"]["runs"])[::5]:
        if solve_batch(A[None, learn], B[None, learn], "shah").degenerate[0]:
            continue
        result = solve(A[learn], B[learn], "ml", "B")
        noise = result.noise
        assert isinstance(noise, PairNoise)
        sizes = [result.rotation_rms_rad, result.translation_rms_m]
        square = np.square(sizes / np.array([noise.rotation_rad, noise.translation_m]))
        assert learn.sum() * square.sum() == pytest.approx(6 * learn.sum() - 12, rel=1e-3)


def test_halves_agree_better_by_the_noise_that_shows(study, pairs):
    """X and Z of two halves that share no pair are nearer, and as near as they say."""
    A, B = pairs["UR3e"]
    learn = module("real_rows").halves(len(A), study.SETTINGS["splits"]["runs"])
    apart: dict[str | None, list[Any]] = {"B": [], None: []}
    inside: dict[str | None, list[Any]] = {"B": [], None: []}
    for half in learn[: len(learn) // 2]:
        for noise, own in apart.items():
            one, other = (solve(A[some], B[some], "ml", noise) for some in (half, ~half))
            far = [difference(one.X, other.X), difference(one.Z, other.Z)]
            own.append(np.concatenate(far))
            sigma = np.sqrt(np.diag(one.covariance + other.covariance))
            inside[noise].append(np.abs(own[-1]) < 1.96 * sigma)
    squares = {k: np.square(own).mean(axis=0).reshape(4, 3).sum(axis=1) for k, own in apart.items()}
    assert (np.sqrt(squares[None] / squares["B"]) < 0.95).all()
    assert 0.90 < np.mean(inside[None]) < 0.98
    assert np.mean(inside[None]) >= np.mean(inside["B"])


def test_side_of_the_noise_decides_where_the_camera_ends(found):
    """Against the images: 50 mm off along the view with noise on the robot's side alone."""
    sides = found["images"]["noise_on"]
    b, a, both, shown = sides.values()
    along = [of["components"]["X shift z"] for of in (b, a, both)]
    assert along[0]["difference"] < -4.0 * along[0]["sigma"]
    assert abs(along[1]["difference"]) < along[1]["sigma"]
    assert b["chi2"] > a["chi2"] > both["chi2"]
    # found in the residuals, too
    assert abs(shown["components"]["X shift z"]["difference"]) < 0.2 * abs(along[0]["difference"])
    assert found["images"]["reference_rms_mm"] > rows(found, "Tabb")["ml"]["rms_mm"]


@pytest.mark.parametrize("name", NAMES)
def test_the_study_is_as_written(found, written, name):
    rel = written["tolerance"]
    then = rows(written, name)
    for method, row in rows(found, name).items():
        assert row["status"] == then[method]["status"]
        for figure in ("rms_deg", "rms_mm", "out_rms_deg", "out_rms_mm", "median_mm"):
            assert row[figure] == pytest.approx(then[method][figure], rel=rel), (method, figure)
        halves, before = (of["data"][name]["splits"]["methods"][method] for of in (found, written))
        for figure in ("rms_deg_ratio", "rms_mm_ratio"):
            assert halves[figure] == pytest.approx(before[figure], rel=5.0 * rel), (method, figure)
