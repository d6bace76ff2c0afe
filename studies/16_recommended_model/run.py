"""Run the study: ``posedesign study run recommended_model``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from posedesign.report.drawing import BLUE, GREY, VERMILION, set_answer
from posedesign.study import Options
from studies import writing

from .recommended_arms import SETTINGS
from .recommended_table import judged, models_taken, outcomes, summary, worst
from .recommended_table import markdown as markdown
from .recommended_trials import simulate as simulate  # called by its name


def draw(found: pd.DataFrame) -> Figure:
    """A panel for each way to measure, a point for each arm; harm is marked."""
    ways = found["way"].unique()
    figure = Figure(figsize=(4.2 * len(ways), 4.6), layout="constrained")
    panels = figure.subplots(1, len(ways), sharex=True, sharey=True, squeeze=False)[0]
    told = judged(found[found["best"] > 0])
    span = [told["best"].min() / 1.3, 1.3 * told["recommended"].max()]
    for panel, way in zip(panels, ways, strict=True):
        panel.plot(span, span, color=GREY, lw=1.0)
        for harms, colour, mark, label in (
            (False, BLUE, "o", "better than the nominal arm"),
            (True, VERMILION, "X", "worse than the nominal arm"),
        ):
            some = told[(told["way"] == way) & (told["harms"] == harms)]
            panel.plot(
                some["best"], some["recommended"], mark, color=colour, ms=4.0, alpha=0.6, lw=0,
                label=label,
            )  # fmt: skip
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(way)
        panel.set_xlabel("error of the best model [mm], log scale")
        panel.grid(visible=True, alpha=0.3)
    panels[0].set_ylabel("error of the recommended model\n[mm], log scale")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    near = 100.0 * (told["recommended"] <= (1.0 + SETTINGS["near"]) * told["best"]).mean()
    set_answer(
        figure,
        f"The recommended model is worse than the nominal arm on {int(told['harms'].sum())} of "
        f"{len(told)} arms, and within {100 * SETTINGS['near']:.0f} % of the best on {near:.0f} %",
    )
    return figure


HERE = Path(__file__).parent
WORKERS = True
"""Its tasks may be shared."""

ARMS, FIGURE = "recommended_model.csv", "recommended_model"
DIGITS = 5


def study(options: Options) -> dict[str, Any]:
    """Is the recommended model the one to take? A trial is an arm of each preset, in each way."""
    trials = writing.trials_of(options, SETTINGS["trials"], 1)
    settings = SETTINGS | {"trials": trials}
    found = outcomes(writing.trials_by_grid(options, HERE.name, settings, conditions()))
    said = key_figures(found) | {"trials": trials}
    return writing.write_rounded(options.out, said, DIGITS, {ARMS: found.to_dict("records")})


def conditions() -> list[dict[str, str]]:
    """Every preset in every way."""
    return [{"preset": p, "way": w} for w in SETTINGS["ways"] for p in SETTINGS["presets"]]


def key_figures(found: pd.DataFrame) -> dict[str, Any]:
    """What the README has, and where to look."""
    rows = summary(found, SETTINGS["near"])
    return {"rows": rows, "taken": models_taken(found), "worst": worst(found)}


def plot(folder: Path) -> list[Path]:
    """Draw the arms of a table."""
    return writing.save(draw(pd.read_csv(folder / ARMS)), folder, FIGURE)
