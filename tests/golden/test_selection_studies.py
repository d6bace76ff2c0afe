"""What buys accuracy, and which index predicts it: short forms of both studies."""

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, spearmanr

from calib.identification import identify_batch
from calib.model import simulate
from posedesign.selection import condition_inf
from posedesign.study.library import find_study
from studies.intervals import rank_correlation
from studies.tool_errors import Experiment, ToolErrors, simulated_arm, tool_errors

STUDIES = Path(__file__).parents[2] / "studies"
BUYS = STUDIES / "10_what_buys_accuracy"
INDEX = STUDIES / "11_which_index_predicts"
REFERENCE = "r2000ic165f"
SHORT = 80
KEYS = ("baseline", "unweighted", "I", "2 near known")
DEVIATIONS = 4.0
"""How far two samples may be apart, in standard deviations of their difference."""


def load(folder: Path) -> ModuleType:
    return find_study(folder.name).load()


def written(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "expected.json").read_text(encoding="utf-8"))


def assert_same_size(short: float, row: dict[str, Any], short_trials: int, trials: int) -> None:
    """Root mean squares of two samples, the spread taken from the interval of the larger."""
    sigma = np.log(row["rms_high_mm"] / row["rms_low_mm"]) / (2 * 1.96)
    band = DEVIATIONS * sigma * np.sqrt(1.0 + trials / short_trials)
    assert abs(np.log(short / row["rms_mm"])) < band, (short, row)


@pytest.fixture(scope="module")
def buys() -> ModuleType:
    return load(BUYS)


@pytest.fixture(scope="module")
def index() -> ModuleType:
    return load(INDEX)


@pytest.fixture(scope="module")
def bench(buys) -> Any:
    return buys.Bench(REFERENCE, buys.SETTINGS)


@pytest.fixture(scope="module")
def short(buys) -> dict[str, Any]:
    table = buys.rows(buys.run(REFERENCE, SHORT, KEYS))
    return {row["key"]: row for row in table}


class TestErrorsOverTheBox:
    def test_the_baseline_is_the_set_of_the_reference_cell(self, buys, bench):
        """C_G and sigma of joint 2's offset at 40 deg, of independent code."""
        pool = bench.plan(buys.VARIANTS[0])
        model = bench.model(buys.VARIANTS[0], pool)
        assert len(pool) == 27
        assert condition_inf(pool.linearise(model).jacobian) == pytest.approx(9.719e4, rel=1e-3)
        C = Experiment.of(model, pool).covariance
        assert np.rad2deg(np.sqrt(C[0, 0])) == pytest.approx(0.00540, abs=6e-6)

    def test_touch_ups_without_noise_leave_no_error(self, buys, bench):
        """Offsets of the first and last joint are taken up; in its own base the arm is turned."""
        pool = bench.plan(buys.VARIANTS[0])
        model = bench.model(buys.VARIANTS[0], pool)
        arm = simulated_arm(bench.cell, pool, model.measurement)
        touched = simulate(arm.model, arm.values, pool.postures, setup=pool.setup(model))
        found = identify_batch(model, touched.trials(None))
        for against in ("base", "target"):
            assert np.abs(tool_errors(arm, model, found, bench.box, against)).max() < 1e-8
        own = tool_errors(arm, model, found, bench.box, own_zero=True)
        points = arm.model.view(bench.box, arm.values).tool_points
        turned = np.deg2rad(0.03) * np.linalg.norm(points[..., :2], axis=-1)  # of joint 1
        np.testing.assert_allclose(np.linalg.norm(own, axis=-1)[0], turned.ravel(), rtol=1e-6)

    def test_intervals_are_those_of_normal_errors(self):
        """Against chi-squared, which three equal components of independent trials follow."""
        trials = 400
        drawn = np.random.default_rng(2).standard_normal((trials, 1, 3))
        found = ToolErrors(drawn, np.eye(3)[None], np.arange(trials))
        low, high = found.rms_interval_m
        ends = chi2.ppf([0.975, 0.025], 3 * trials)
        expected = found.rms_m * np.sqrt(3 * trials / ends)
        np.testing.assert_allclose([low, high], expected, rtol=0.01)
        grouped = ToolErrors(np.repeat(drawn, 4, axis=0), np.eye(3)[None], np.repeat(range(400), 4))
        np.testing.assert_allclose(grouped.rms_interval_m, (low, high), rtol=1e-9)


class TestWhatBuys:
    @pytest.mark.slow
    def test_a_short_run_has_the_figures_that_are_written(self, short):
        full = written(BUYS)
        expected = {row["key"]: row for row in full["arms"][REFERENCE]["rows"]}
        assert set(short) == set(KEYS)
        for key, row in short.items():
            other = expected[key]
            # choices by exchange may differ by a pose or two that matter little
            near = 1e-4 if key in ("baseline", "unweighted") else 0.02
            for name in ("predicted_rms_mm", "predicted_worst_mm"):
                assert row[name] == pytest.approx(other[name], rel=near), (key, name)
            assert row["minutes"] == pytest.approx(other["minutes"], rel=0.05)
            assert_same_size(row["rms_mm"], other, SHORT, full["trials"])
            assert row["deflecting_rms_mm"] > 10.0 * row["rms_mm"]

    def test_what_is_predicted_is_what_is_found(self):
        """All variants of both arms: 0.9 to 1.1, beyond which the interval may reach."""
        for part in written(BUYS)["arms"].values():
            for row in part["rows"]:
                low, high = row["rms_low_mm"], row["rms_high_mm"]
                assert low / 1.1 < row["predicted_rms_mm"] < high / 0.9, row["key"]


class TestWhichIndex:
    def test_ranks_are_those_of_scipy(self, index):
        a, b = np.random.default_rng(3).integers(9, size=(2, 4, 30)).astype(float)  # with ties
        found = rank_correlation(a, b)
        expected = [spearmanr(x, y).statistic for x, y in zip(a, b, strict=True)]
        np.testing.assert_allclose(found, expected, atol=1e-12)

    def test_a_short_choice_has_the_figures_that_are_written(self, index):
        problem = next(iter(index.SETTINGS["problems"]))
        short = index.chosen(
            problem, index.SETTINGS, trials=SHORT, criteria=("I", "D", "C_G"), counts=(15,)
        )
        full = {
            row["criterion"]: row
            for row in written(INDEX)["chosen"]
            if (row["problem"], row["poses"]) == (problem, 15)
        }
        for row in short:
            other = full[row["criterion"]]
            near = 0.1 if row["criterion"] == "C_G" else 0.02  # it is rugged
            predicted = other["predicted_rms_mm"]
            assert row["predicted_rms_mm"] == pytest.approx(predicted, rel=near)
            if row["criterion"] != "C_G":
                trials = index.SETTINGS["chosen"]["trials"]
                assert_same_size(row["rms_mm"], other, SHORT, trials)

    def test_the_deviation_predicted_is_the_error_where_the_model_is_right(self):
        for row in written(INDEX)["held"]:
            if row["case"] in ("right", "all compliances"):
                assert 0.9 < row["ratio"] < 1.1, row
            if row["case"] == "noise":
                assert 1.8 < row["ratio"] < 2.2, row
            if row["case"] in ("deflection", "links", "joint 3"):
                assert row["ratio_low"] > 10.0, row

    def test_a_short_run_holds_the_model_against_the_error(self, index):
        rows = index.held(REFERENCE, index.SETTINGS, trials=SHORT, keys=("right", "noise"))
        assert len(rows) == 6
        for row in rows:
            factor = 2.0 if row["case"] == "noise" else 1.0
            sigma = np.log(row["ratio_high"] / row["ratio_low"]) / (2 * 1.96)
            assert abs(np.log(row["ratio"] / factor)) < DEVIATIONS * sigma

    @pytest.mark.slow
    def test_a_short_sample_of_random_sets_ranks_indices_alike(self, index):
        """The predicted error ranks sets as the error does, and better than C_G or D do."""
        problem = next(iter(index.SETTINGS["problems"]))
        rows = {r["index"]: r for r in index.ranked(problem, 60, 60) if r["sets"] == "mixed"}
        full = {
            r["index"]: r
            for r in written(INDEX)["ranked"]
            if (r["problem"], r["sets"]) == (problem, "mixed")
        }
        first = next(iter(rows))
        assert first.startswith("I")
        for name in (first, "C_G", "D"):
            low, high = rows[name]["low"], rows[name]["high"]
            assert low - 0.05 < full[name]["rho"] < high + 0.05, name
        assert rows[first]["rho"] > max(rows["C_G"]["rho"], rows["D"]["rho"])
