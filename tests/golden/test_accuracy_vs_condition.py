"""Accuracy against condition on four arms: a short form against what its folder says."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import f as f_distribution

from posedesign.study import Options, read_table
from posedesign.study.library import find_study
from tests.cli.conftest import empty_pictures

STUDY = find_study("accuracy_vs_condition")
SHORT, CHANCE = 30, 1e-4
EXPECTED: dict[str, Any] = json.loads((STUDY.folder / "expected.json").read_text())
WRITTEN = pd.read_csv(STUDY.folder / "accuracy_vs_condition.csv")


@pytest.fixture(scope="module", params=["irb120", pytest.param("all", marks=pytest.mark.slow)])
def short(request, tmp_path_factory) -> tuple[dict[str, Any], pd.DataFrame, Path]:
    """Sixty data sets of each pose set, of one arm or of all."""
    out = tmp_path_factory.mktemp("short")
    settings = STUDY.load().SETTINGS
    presets = settings["presets"]
    if request.param != "all":
        settings["presets"] = [request.param]
    try:
        figures = STUDY.run(Options(out, SHORT))
    finally:
        settings["presets"] = presets
    return figures, pd.read_csv(out / "accuracy_vs_condition.csv"), out


def full_of(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of the full run for the same pose sets, in the same order."""
    full = WRITTEN[WRITTEN["preset"].isin(set(rows["preset"]))].reset_index(drop=True)
    assert len(full) == len(rows)
    np.testing.assert_allclose(rows["c_g"], full["c_g"], rtol=1e-6)
    return full


@pytest.mark.slow
def test_spread_is_that_of_the_full_run(short):
    _, rows, _ = short
    full = full_of(rows)
    ratio = rows["spread_deg"] / full["spread_deg"]
    trials = EXPECTED["trials"]
    low, high = np.sqrt(f_distribution.ppf([CHANCE / 2, 1 - CHANCE / 2], SHORT - 1, trials - 1))
    assert ((ratio > low) & (ratio < high)).all()


def test_medians_are_those_of_the_full_run(short):
    """Within the quarter that a median of sixty may be off: five standard errors."""
    _, rows, _ = short
    full = full_of(rows)
    for name in ("tool_mm", "x_mm ml", "x_mm hirsh", "x_deg ml", "x_deg li-dual-quaternion"):
        np.testing.assert_allclose(rows[name], full[name], rtol=0.75)
        assert np.median(rows[name] / full[name]) == pytest.approx(1.0, abs=0.2)


def test_slopes_and_ranks(short):
    figures, _, _ = short
    full = {(r["preset"], r["estimator"], r["quantity"]): r for r in EXPECTED["relations"]}
    assert figures["relations"]
    for row in figures["relations"]:
        written = full[row["preset"], row["estimator"], row["quantity"]]
        assert row["slope"] == pytest.approx(written["slope"], abs=0.08)
        assert row["rank"] > 0.9


def test_predicted_is_what_was_found(short):
    """The covariance, before any measurement, against the spread of the full run."""
    np.testing.assert_allclose(WRITTEN["spread_deg"] / WRITTEN["predicted_deg"], 1.0, atol=0.12)


def test_trials_are_all_there(short):
    _, rows, out = short
    (table,) = out.glob("trials.*")
    trials = read_table(table)
    assert len(trials) == SHORT * len(rows)
    assert trials.groupby(["preset", "threshold"], sort=False)["trial"].nunique().eq(SHORT).all()
    assert not (out / "parts").exists()


def test_figures_come_from_the_tables(short):
    """What is in them is looked at in those of the full run."""
    _, _, out = short
    with empty_pictures():
        drawn = STUDY.plot(out)
    names = ("accuracy_vs_condition", "solvers_vs_condition")
    assert {*drawn} == {out / f"{name}.{kind}" for name in names for kind in ("png", "svg")}


def test_readme_has_the_figures_of_the_run():
    """Every row of its table, to the last digit."""
    text = (STUDY.folder / "README.md").read_text()
    found = {(r["preset"], r["estimator"], r["quantity"]): r for r in EXPECTED["relations"]}
    rows = re.findall(r"^\| (\w+) \| (.+) \|$", text, flags=re.MULTILINE)
    rows = [
        (preset, cells.split(" | ")) for preset, cells in rows if preset in set(WRITTEN["preset"])
    ]
    assert len(rows) == 4
    for preset, (c_g, spread, spread_slope, tool, tool_slope, x_mm, x_slope) in rows:
        part = WRITTEN[WRITTEN["preset"] == preset]
        offset = found[preset, "identification", "spread of the offset [deg]"]
        moved = found[preset, "identification", "tool point elsewhere [mm]"]
        camera = found[preset, "ml", "X translation [mm]"]
        assert c_g == f"{part['c_g'].iloc[0]:.2g} to {part['c_g'].iloc[-1]:.2g}"
        for cell, row in ((spread, offset), (tool, moved), (x_mm, camera)):
            assert cell == f"{row['first']:.2g} to {row['last']:.2g}"
        for cell, row in ((spread_slope, offset), (tool_slope, moved), (x_slope, camera)):
            assert cell == f"{row['slope']:.2f} ({row['slope_low']:.2f} to {row['slope_high']:.2f})"
