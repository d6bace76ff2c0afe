"""Tables 1 to 3 of Watanabe et al. 2006: a short form of the study against what its folder says."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as t_distribution

from calib.se3 import rotation_exp, transform
from calib.vision.touch_up import Relation

FOLDER = Path(__file__).parents[2] / "studies" / "12_visual_touch_up"
SHORT, PICTURES = 400, 40
FEW = 20
DEVIATIONS = 4.0
"""How far two samples may be apart, in standard deviations of their difference."""

TOUCH, STEREO = ("V", "H", "D"), ("X", "Y", "Z")


@pytest.fixture(scope="module")
def expected(written) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in written["rows"]}


@pytest.fixture
def few_pictures(study, monkeypatch) -> None:
    """Noise of the fast camera from fewer pictures than the study takes."""
    monkeypatch.setitem(study.SETTINGS, "noise_pictures", PICTURES)


def log_error(row: dict[str, Any], name: str) -> float:
    """Standard deviation of the logarithm of a figure, from its interval over the set-ups."""
    width = np.log(row[f"{name}_high_mm"] / row[f"{name}_low_mm"])
    return float(width / 2.0 / t_distribution.ppf(0.975, row["set_ups"] - 1))


def assert_same_scatter(
    short: dict[str, Any], full: dict[str, Any], axes: tuple[str, ...], noise_pictures: int = 0
) -> None:
    """Deviations of two samples; that of a picture's noise is known from so many pictures."""
    for axis in axes:
        # few set-ups do not tell how much they differ: those of the full run do
        of_short = log_error(full, axis) * np.sqrt(full["set_ups"] / short["set_ups"])
        variance = of_short**2 + 0.5 / short["trials"] + log_error(full, axis) ** 2
        if noise_pictures:
            variance += 0.5 / noise_pictures
        ratio = short[f"{axis}_mm"] / full[f"{axis}_mm"]
        assert abs(np.log(ratio)) < DEVIATIONS * np.sqrt(variance), (axis, short, full)


class TestRepeatability:
    @pytest.mark.usefixtures("few_pictures")
    @pytest.mark.parametrize(
        "key", ["fast", pytest.param("any side, tenth", marks=pytest.mark.full)]
    )
    @pytest.mark.slow
    def test_a_short_run_scatters_as_is_written(self, study, expected, key):
        ((row,), _) = study.run(SHORT, keys=(key,))
        assert_same_scatter(row, expected[key], TOUCH + STEREO, PICTURES)

    @pytest.mark.slow
    def test_a_few_pictures_scatter_as_is_written(self, study, expected):
        row, _ = study.tables.row(study.SETTINGS["condition"][0], study.SETTINGS, FEW)
        assert row["seen"] == "image"
        assert row["failed"] == 0
        assert_same_scatter(row, expected["images"], TOUCH + STEREO)

    @pytest.mark.parametrize("pair", [("images", "fast"), ("images, any side", "any side")])
    def test_pictures_and_the_fast_camera_agree(self, expected, pair):
        slow, fast = (expected[key] for key in pair)
        for axis in TOUCH + STEREO:
            error = np.hypot(log_error(slow, axis), log_error(fast, axis))
            assert abs(np.log(slow[f"{axis}_mm"] / fast[f"{axis}_mm"])) < DEVIATIONS * error, axis

    def test_table_2_is_met_within_the_factor(self, study, expected):
        paper, factor = study.SETTINGS["paper"]["touch_up_mm"], study.SETTINGS["paper"]["factor"]
        for axis, figure in zip(TOUCH, paper, strict=True):
            assert figure / factor < expected["images"][f"{axis}_mm"] < figure * factor, axis

    def test_stereo_is_worse_in_depth_only_by_an_arm_that_stops_badly(self, expected):
        for key in ("images", "fast", "looks", "tight", "afresh", "catalogue", "still"):
            assert expected[key]["depth_ratio_high"] < 0.9, key
        for key in ("any side", "any side, tenth", "nominal", "double"):
            assert expected[key]["depth_ratio_low"] > 1.0, key

    def test_depth_of_stereo_is_the_scatter_across_times_its_gain(self, written, expected):
        """Of view lines that only scatter, whose scatter a touch-up shows across."""
        _, _, gain = written["derived"]["stereo_gain"]
        for key in ("fast", "looks", "catalogue", "double", "nominal"):
            row = expected[key]
            assert row["Z_mm"] == pytest.approx(gain * row["V_mm"], rel=0.1), key


class TestParts:
    def test_a_line_without_noise_is_found_and_met(self, study):
        lines = import_module(f"studies.{FOLDER.name}.visual_tables")
        rng = np.random.default_rng(3)
        line, m = np.array([0.02, -0.05, 0.03, -0.01]), np.array([1.2, 0.1, 0.4])
        along = rng.uniform(0.25, 0.45, (2, 9))
        on_line = np.stack([line[0] + line[2] * along, line[1] + line[3] * along, along], axis=-1)
        R = rotation_exp(rng.uniform(-0.4, 0.4, (2, 9, 3)))
        T = transform(R, m - (R @ on_line[..., None])[..., 0])
        found = lines.identify_line(T, np.zeros(4))
        np.testing.assert_allclose(found, [line, line], atol=1e-9)
        np.testing.assert_allclose(lines.meet(T, found), [m, m], atol=1e-9)

    def test_the_gain_of_stereo_is_that_of_lines_that_scatter(self, study):
        lines = import_module(f"studies.{FOLDER.name}.visual_tables")
        rng = np.random.default_rng(4)
        turns = np.deg2rad([-15.0, 0.0, 15.0])
        R = rotation_exp(turns[:, None] * [1.0, 0.0, 0.0])
        T = np.tile(transform(R, -R[..., 2] * 0.35), (20000, 1, 1, 1))
        across = rng.standard_normal((20000, 3, 2)) * 1e-5
        T[..., :3, 3] += (R[..., :2] @ across[..., None])[..., 0]
        met = lines.meet(T, np.zeros((20000, 4)))
        gain = study.tables.depth_of_stereo([-15.0, 0.0, 15.0])
        np.testing.assert_allclose(met.std(axis=0) / 1e-5, gain, rtol=0.03)

    def test_repeatability_is_that_of_the_standard(self, study):
        """ISO 9283 in full: joints drawn, the tool's distances from their mean."""
        cell = study.cell_of(study.SETTINGS, study.SETTINGS["base"])
        rng = np.random.default_rng(5)
        scatter = study.joint_scatter(cell, 25e-6)
        q = cell.base_posture + scatter * rng.standard_normal((4000, cell.robot.n))
        T = cell.robot.fk(q)
        places = T[:, :3, :3] @ cell.tool_m + T[:, :3, 3]
        distance = np.linalg.norm(places - places.mean(axis=0), axis=1)
        assert distance.mean() + 3 * distance.std() == pytest.approx(25e-6, rel=0.15)

    def test_intervals_cover_where_set_ups_differ(self, study):
        """A hundred trials of one set-up would claim to know what another set-up contradicts."""
        rng = np.random.default_rng(6)
        true = np.exp(0.3 * rng.standard_normal((2000, 20))) / np.exp(0.3**2 / 2.0)
        found = true * rng.chisquare(99, true.shape) / 99
        log, half = np.array([study.tables.over_set_ups(each) for each in found]).T
        assert (np.abs(log) < half).mean() == pytest.approx(0.95, abs=0.02)
        ratio = np.array(
            [
                study.tables.over_set_ups(each, other)
                for each, other in zip(found[::2], found[1::2], strict=True)
            ]
        )
        assert (np.abs(ratio[:, 0]) < ratio[:, 1]).mean() == pytest.approx(0.95, abs=0.025)
        alone = np.sqrt(0.5 / 99) * 1.96  # what one set-up says of itself
        assert (np.abs(0.5 * np.log(found[:, 0])) < alone).mean() < 0.7

    def test_eq_2_as_printed_is_the_same_data_once_scaled(self, study):
        visual_bench = import_module(f"studies.{FOLDER.name}.visual_bench")
        views = np.array([[330.0, 236.0, 40.0, 0.3, 39.0], [310.0, 250.0, 52.0, 0.0, 50.0]])
        relation = (320.0, 240.0), 91.4
        error = Relation(*relation).error(views)
        plain = visual_bench.PlainRelation(*relation).error(views)
        np.testing.assert_allclose(plain[:, :2], [[-4.0, 10.0], [10.0, -10.0]], atol=1e-12)
        s = 91.4 / (1.0 + plain[:, 2:] / 91.4)
        np.testing.assert_allclose(plain[:, :2] * 91.4 / s, error[:, :2], rtol=1e-12)
        np.testing.assert_allclose(plain[:, 2], error[:, 2], rtol=1e-12)


class TestAgainstPin:
    @pytest.mark.usefixtures("few_pictures")
    @pytest.mark.slow
    def test_the_bias_is_that_of_the_ellipse_and_is_taken_off(self, study):
        trials = 100
        for row in study.against_pin(trials, "fast")["rows"]:
            left = np.subtract(row["mean_mm"], row["predicted_mm"])
            band = DEVIATIONS * np.array(row["sigma_mm"]) / np.sqrt(trials)
            assert (np.abs(left) < band + 0.004).all(), row

    def test_table_3_stays_below_its_bar(self, study, written):
        bar = study.SETTINGS["paper"]["pin_bar_mm"]
        rows = written["pin"]["rows"]
        worst = dict.fromkeys((row["variant"] for row in rows), 0.0)
        for row in rows:
            assert row["failed"] == 0
            worst[row["variant"]] = max(worst[row["variant"]], *np.abs(row["mean_mm"]))
        assert 0.1 < worst["as in the paper"] < bar
        assert worst["tilt taken off"] < 0.03
        largest = written["pin"]["largest"]
        assert largest["low_mm"] < bar < largest["high_mm"]
