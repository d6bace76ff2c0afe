"""Run the study: ``posedesign study run pictures_of_a_board``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from calib.chance import chi2_quantile
from posedesign.report.drawing import set_answer
from posedesign.study import Options
from studies import writing
from studies.drawing import log_ticks, rows_of_marks
from studies.writing import Cell, cell, table

from .board_peers import EVERY, LENSES, PIXELS, trial_rows

SETTINGS = writing.settings_of(__file__)
TABLE, FIGURE = "pictures.csv", "pictures"
DIGITS = 5

TICKS = (1, 1.5, 2, 3, 5, 10, 20, 40)

Found = Mapping[str, Any]


def study(options: Options) -> dict[str, Any]:
    """How much nearer is an estimate over pixels than poses, then A X = Z B?"""
    trials = writing.trials_of(options, SETTINGS["trials"], 2)
    rows = []
    total = trials * len(SETTINGS["arms"])
    for k, (name, (mm, mrad)) in enumerate(SETTINGS["arms"].items()):
        for trial in range(trials):
            rng = np.random.default_rng([SETTINGS["seed"], k, trial])
            found = trial_rows(
                SETTINGS["pictures"], SETTINGS["sigma_px"], (1e-3 * mm, 1e-3 * mrad), rng
            )
            rows += [{"arm": name, "trial": trial} | row for row in found]
            done = k * trials + trial + 1
            options.advance(f"{done} of {total} scenes", done / total)
    summary = summarised(pd.DataFrame(rows))
    said = {"trials": trials, "rows": summary}
    return writing.write_rounded(options.out, said, DIGITS, {TABLE: summary})


def summarised(trials: pd.DataFrame) -> list[dict[str, Any]]:
    """A row for each arm, lens and method."""
    rows = []
    for (arm, lens, method), own in trials.groupby(["arm", "lens", "method"], sort=False):
        there = own[np.isfinite(own["off_mm"])]
        row: dict[str, Any] = {"arm": arm, "lens": lens, "method": method}
        row["failed"] = len(own) - len(there)
        for unit in ("mm", "deg"):
            off, bound = there[f"off_{unit}"], there[f"bound_{unit}"]
            row[f"bound_{unit}"] = rms(bound)
            row[f"rms_{unit}"] = rms(off)
            row[f"over_{unit}"] = rms(off) / rms(bound)
            row[f"error_{unit}"] = error_of_ratio(off.to_numpy(), bound.to_numpy())
        nees = there["nees"].dropna()
        row["nees"] = float(nees.mean()) if len(nees) else None
        rows.append(row)
    return rows


def rms(values: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(values)))))


def error_of_ratio(off: np.ndarray, bound: np.ndarray) -> float:
    """Standard error of rms over rms, of the trials as they scatter."""
    ratio = np.sum(off**2) / np.sum(bound**2)
    left = off**2 - ratio * bound**2
    of_square = np.sqrt(np.sum(left**2)) / np.sum(bound**2)
    return float(of_square / (2.0 * np.sqrt(ratio)))


def plot(folder: Path) -> list[Path]:
    """Draw the ratios of a table."""
    return writing.save(draw(pd.DataFrame(writing.read_rows(folder, TABLE))), folder, FIGURE)


def draw(found: pd.DataFrame) -> Figure:
    """Error over the bound, at the board's distance: a panel for each arm, a mark for each lens."""
    arms = list(found["arm"].unique())
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    panels = figure.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    for panel, arm in zip(panels, arms, strict=True):
        own = found[found["arm"] == arm].set_index(["lens", "method"])
        ratios = {
            lens: [float(own.loc[(lens, method), "over_mm"]) for method in EVERY] for lens in LENSES
        }
        panel.axvline(1.0, color="0.4", lw=1.0)
        rows_of_marks(panel, EVERY, ratios, apart=0.2)
        log_ticks(panel, TICKS)
        panel.set_xlim(0.85, 45.0)  # the two iterations as printed lie beyond
        panel.set_title(arm)
        panel.set_xlabel("error of X over the bound, log scale; better left")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower right", ncols=2)
    set_answer(
        figure, answer_of(found), "Rms over 100 scenes; standard errors stand in the tables."
    )
    return figure


def answer_of(found: pd.DataFrame) -> str:
    """What the figure shows, in a sentence."""
    pixels = found[found["method"] == "pixels"]["over_mm"].astype(float)
    others = found[(found["method"] != "pixels") & ~found["method"].str.endswith("literal")]
    of_arm = others.astype({"over_mm": float}).groupby("arm", sort=False)["over_mm"].median()
    medians = "; ".join(f"{median:.2g} times on {arm}" for arm, median in of_arm.items())
    return (
        f"Pixels are at {pixels.min():.2f} to {pixels.max():.2f} of the bound; poses of the board, "
        f"then A X = Z B, at a median of {medians}"
    )


def markdown(found: Found) -> str:
    """A table for each arm and lens."""
    every = []
    for arm in SETTINGS["arms"]:
        for lens in LENSES:
            rows = [r for r in found["rows"] if r["arm"] == arm and r["lens"] == lens]
            bound = cell(rows[0], "bound {bound_mm:.3f} mm, {bound_deg:.4f} deg")
            every.append(f"**{arm.capitalize()}, {lens}** ({bound})\n\n{table(rows, COLUMNS)}")
    return "\n\n".join(every)


COLUMNS: Mapping[str, Cell] = {
    "method": lambda row: "**pixels**" if row["method"] == PIXELS else row["method"],
    "rms [mm]": "{rms_mm:.3g}", "over the bound": "{over_mm:.2f} ± {error_mm:.2f}",
    "rms [deg]": "{rms_deg:.3g}", "over the bound, rotation": "{over_deg:.2f} ± {error_deg:.2f}",
    "NEES": "{nees:.2f}", "no result": "{failed}",
}  # fmt: skip


def nees_band(trials: int) -> tuple[float, float]:
    """Where the NEES of right covariances lies, 95 %."""
    low, high = chi2_quantile([0.025, 0.975], 6 * trials) / (6 * trials)
    return float(low), float(high)
