"""Choosing poses of the IRB 120: what a choice must be worth, and that it has seen no reading."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from calib import identify
from studies import choices
from studies.writing import rounded

pytestmark = pytest.mark.real_data

FOLDER = Path(__file__).parents[2] / "studies" / "08_choosing_irb120_poses"
SHORT = ["priors, common error"]
Row = dict[str, Any]


@pytest.fixture(scope="module")
def measured(data_folder) -> Path:
    folder = data_folder / "identification" / "abb_irb120"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    return data_folder


@pytest.fixture(scope="module")
def short(study, measured) -> Row:
    """The model that is recommended, by the criterion that is, at all three counts."""
    rows = study.run(measured, SHORT, [study.RECOMMENDED])
    return rounded(rows, choices.DIGITS)[0]


def bench(study: ModuleType, data: Path, name: str) -> Any:
    row = next(row for row in study.SETTINGS["model"] if row["name"] == name)
    return study.bench_of(data, row, study.SETTINGS)


@pytest.mark.slow
def test_better_than_the_median_by_lot_at_every_count(study, short):
    assert [of["n"] for of in short["counts"]] == [9, 12, 18]
    for of in short["counts"]:
        (chosen,) = of["chosen"]
        assert chosen["criterion"] == study.RECOMMENDED
        assert chosen["error_mm"] < of["by_lot"]["error_mm"]["quantiles"][2]
        assert len(chosen["poses"]) == of["n"]


@pytest.mark.slow
def test_twelve_poses_cannot_be_expected_to_be_worth_36(short):
    """The bar of 5 % is beyond any choice of 12, by a proof that has no reading in it."""
    (twelve,) = short["counts"][1]["chosen"]
    assert twelve["expected_bound"] > 1.10
    assert twelve["expected_over_all"] >= twelve["expected_bound"]
    # and it is not met: by the same poses left out of all 36, or seen by them
    assert 1.05 < twelve["over_all_left_out"] < 1.45
    assert twelve["over_all_in_sample"] > twelve["over_all_left_out"]


@pytest.mark.slow
def test_the_study_is_as_written(short, written):
    then = next(row for row in written["models"] if row["model"] == short["model"])
    rel = written["tolerance"]
    assert short["parameters"] == then["parameters"]
    assert short["left_out_of_all_mm"] == pytest.approx(then["left_out_of_all_mm"], rel=rel)
    for now, old in zip(short["counts"], then["counts"], strict=True):
        for name, spread in now["by_lot"].items():
            quantiles = old["by_lot"][name]["quantiles"]
            assert spread["quantiles"] == pytest.approx(quantiles, rel=rel), name
        (chosen,) = now["chosen"]
        same = next(c for c in old["chosen"] if c["criterion"] == chosen["criterion"])
        assert chosen["poses"] == same["poses"]
        for name, value in chosen.items():
            if isinstance(value, float):
                assert value == pytest.approx(same[name], rel=rel), name


def test_no_reading_is_seen_by_a_choice(study, measured):
    own = bench(study, measured, SHORT[0])
    noise = np.random.default_rng(1).normal(size=own.data.observed.shape)
    other = replace(own, data=replace(own.data, observed=noise))
    chosen_by = study.chosen_by
    first, second = (chosen_by(of, 9, study.RECOMMENDED).indices for of in (own, other))
    np.testing.assert_array_equal(first, second)


def test_fits_are_those_of_identify(study, measured):
    """To twelve configurations, with rows that are independent, with priors and without."""
    chosen = np.zeros((1, 36), dtype=bool)
    chosen[0, ::3] = True
    for name, parameters in (("priors", 57), ("no priors", 35)):
        own = bench(study, measured, name)
        assert own.model.p == parameters
        rows = np.flatnonzero(np.repeat(chosen[0], own.points))
        result = identify(own.model, own.data[rows])
        x = own.fit(chosen)
        np.testing.assert_allclose((x[0] - result.values) / result.sigma, 0.0, atol=1e-4)
        left = np.sqrt(own.squares(x)[chosen].mean())
        assert left == pytest.approx(result.rms_m, rel=1e-6)


def test_all_36_are_as_in_study_03(study, measured):
    """Its 35 parameters, from nominal Jacobians alone, and what it has for a pose left out."""
    own = bench(study, measured, "no priors")
    all36 = study.everything(own)
    assert own.model.p == 35
    assert 1e3 * np.sqrt(all36.left_out.mean()) == pytest.approx(0.1831, abs=1e-4)
    assert 1e3 * np.sqrt(all36.in_sample.mean()) == pytest.approx(0.1476, abs=1e-4)
    assert 1e3 * np.sqrt(all36.check_left_out.mean()) == pytest.approx(0.1433, abs=2e-4)


def test_an_error_common_to_a_configuration_is_what_is_whitened(study, measured):
    own = bench(study, measured, SHORT[0])
    settings = study.SETTINGS
    sigma, common = (1e-3 * settings[f"{name}_sigma_mm"] for name in ("point", "common"))
    rng = np.random.default_rng(2)
    trials = 20_000
    e = common * rng.normal(size=(trials, 1, 3)) + sigma * rng.normal(size=(trials, own.points, 3))
    white = e.reshape(trials, -1) / sigma @ own.whitening.T
    # entries of a sample covariance scatter by sqrt(2 / trials) at most
    np.testing.assert_allclose(white.T @ white / trials, np.eye(9), atol=5 * np.sqrt(2 / trials))
    assert own.noise_m == pytest.approx(np.sqrt((e**2).sum(-1).mean()), rel=0.02)
