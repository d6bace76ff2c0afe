"""The study of peers: a short form of it against what its folder says."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posedesign.study import Options

FOLDER = Path(__file__).parents[2] / "studies" / "15_peers"
FEW = 8
LOOSE = 4.0
"""Of a ratio of times, either way: what else runs on the machine."""

SHORT_APART = 1e-6
"""Of X, in m and as numbers of a rotation: where two optimizers end is one place."""

LIKELIEST = ("ours: ml", "scipy from OpenCV's SHAH")
"""Solvers of the same likelihood."""

needs_figaroh = pytest.mark.skipif(
    importlib.util.find_spec("figaroh") is None, reason="needs figaroh (posedesign[peers])"
)
needs_pybotics = pytest.mark.skipif(
    importlib.util.find_spec("pybotics") is None, reason="needs pybotics, see the study's README"
)


def by(rows: list[dict[str, Any]], *keys: str) -> dict[tuple[Any, ...], dict[str, Any]]:
    return {tuple(row[key] for key in keys): row for row in rows}


def assert_intervals_meet(
    short: list[dict[str, Any]], full: list[dict[str, Any]], keys: tuple[str, ...], value: str
) -> None:
    """Medians of two samples whose 95 % intervals have something in common."""
    low, high = (value.replace("*", f"_{end}") for end in ("low", "high"))
    expected = by(full, *keys)
    for key, row in by(short, *keys).items():
        said = expected[key]
        assert row[low] <= said[high], (key, row, said)
        assert row[high] >= said[low], (key, row, said)


class TestPairs:
    @pytest.mark.slow
    def test_errors_are_those_of_the_folder(self, study, written):
        short = study.pairs.errors(study.SETTINGS, FEW)
        keys = ("setting", "pairs", "solver")
        assert by(short, *keys).keys() == by(written["pairs"], *keys).keys()
        for value in ("X_deg*", "X_mm*"):
            assert_intervals_meet(short, written["pairs"], keys, value)

    def test_scipy_ends_where_the_likeliest_are(self, study, written):
        for said in (written["optimum"], study.pairs.optimum(study.SETTINGS, FEW)):
            assert said["largest_difference_of_X"] < SHORT_APART
            assert said["scipy_higher"] == said["ours_higher"] == 0

    def test_likeliest_are_nearest_where_the_noise_is_as_told(self, written):
        """In a cone, by intervals that have nothing in common."""
        rows = by(written["pairs"], "setting", "pairs", "solver")
        for (setting, n, solver), row in rows.items():
            if setting == "cone of 40 deg, noise on B" and solver not in LIKELIEST:
                best = rows[setting, n, "ours: ml"]
                assert best["X_mm_high"] < row["X_mm_low"], (n, solver)

    def test_what_cannot_be_solved_is_refused_here(self, study, written):
        """What others make of a NaN differs from run to run; whether they answer is looked at."""
        short = by(study.pairs.refusals(study.SETTINGS), "pairs")
        for key, said in by(written["refusals"], "pairs").items():
            assert said["ours: ml"] == short[key]["ours: ml"]
            assert said["ours: ml"].endswith("Error")
            for solver in ("SHAH", "LI", "ANDREFF"):
                assert said[solver].split(",")[0] == short[key][solver].split(",")[0]
        assert all(row["LI"].startswith("returns") for row in short.values())


class TestTouchUps:
    def test_errors_are_those_of_the_folder(self, study, written):
        short = study.fits.errors(study.SETTINGS, FEW, 0, ())
        assert len(short) == 4
        assert_intervals_meet(short, written["touch_ups"], ("noise", "by"), "tool_error*_mm")
        for row in short:
            assert row["of_ours"] == pytest.approx(1.0, abs=study.fits.SAME)

    def test_peers_weigh_all_axes_alike(self, written):
        """As good with equal noise, and further off where depth is less certain."""
        rows = by(written["touch_ups"], "noise", "by")
        for name in ("figaroh", "pybotics' arm, coordinates"):
            assert rows["equal", name]["of_ours"] == pytest.approx(1.0, abs=1e-3)
            deep = rows["depth six times as uncertain", name]
            assert deep["of_ours"] > 1.3
            assert deep["ours_nearer_low"] > 0.5

    def test_what_cannot_be_told_is_refused(self, study, written):
        facts = study.fits.facts(study.SETTINGS, ())["offset_that_cannot_be_told"]
        assert facts["ours"] == written["facts"]["offset_that_cannot_be_told"]["ours"]
        assert set(facts["ours"].values()) == {"NotIdentifiableError"}

    @needs_figaroh
    @pytest.mark.slow
    def test_figaroh_says_what_the_folder_has(self, study, written):
        facts = study.fits.facts(study.SETTINGS, ("figaroh",))
        assert facts["figaroh_apart_m"] < 1e-9
        name = "offset_that_cannot_be_told"
        assert facts[name] == written["facts"][name]
        short = study.fits.errors(study.SETTINGS, FEW, 0, ("figaroh",))
        assert_intervals_meet(short, written["touch_ups"], ("noise", "by"), "tool_error*_mm")

    @needs_pybotics
    def test_pybotics_has_the_same_arm_and_answers(self, study, written):
        assert study.fits.facts(study.SETTINGS, ("pybotics",))["pybotics_apart_m"] < 1e-9
        short = study.fits.errors(study.SETTINGS, FEW, 0, ("pybotics",))
        assert_intervals_meet(short, written["touch_ups"], ("noise", "by"), "tool_error*_mm")


class TestChoice:
    def test_ours_is_that_of_the_folder(self, study, written):
        expected = by(written["selection"], "by")
        for row in study.selection.compared(study.SETTINGS, with_figaroh=False):
            said = expected[(row["by"],)]
            assert row["of_the_bound"] == pytest.approx(said["of_the_bound"], abs=2e-3)
            assert row["different"] == said["different"] == row["poses"]

    @needs_figaroh
    @pytest.mark.slow
    def test_figaroh_chooses_as_the_folder_says(self, study, written):
        expected = by(written["selection"], "by")
        for row in study.selection.compared(study.SETTINGS, with_figaroh=True):
            share = expected[(row["by"],)]["of_the_bound"]
            assert row["of_the_bound"] == pytest.approx(share, abs=5e-3)

    def test_more_than_the_bound_takes_a_pose_twice(self, written):
        for row in written["selection"]:
            assert row["of_the_bound"] < 1.0 + 1e-6 or row["different"] < row["poses"]


class TestWhole:
    @pytest.mark.slow
    def test_short_form_writes_draws_and_keeps_the_ratios(self, study, written, tmp_path):
        said = study.study(Options(tmp_path, FEW))
        drawn = study.plot(tmp_path)
        assert {path.name for path in drawn} == {
            f"{name}.{kind}" for name in ("peer_times", "peer_accuracy") for kind in ("png", "svg")
        }
        keys = ("job", "size", "peer", "ours")
        expected = by(written["times"], *keys)
        for key, row in by(said["times"], *keys).items():
            assert abs(np.log(row["ratio"] / expected[key]["ratio"])) < np.log(LOOSE), key

    def test_peers_that_are_not_there_are_left_out_with_a_sentence(self, study, monkeypatch):
        monkeypatch.setattr(study.importlib.util, "find_spec", lambda name: None)
        assert study.installed() == ()
        assert set(study.versions(())) == {"opencv", "scipy"}
        for name in study.EXTRA:
            assert study._sentence(name).startswith(f"{name} is not installed and left out; to")
