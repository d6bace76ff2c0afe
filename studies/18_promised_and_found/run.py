"""Run the study: ``posedesign study run promised_and_found``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from posedesign.report.drawing import GREY, set_answer
from posedesign.study import Options, call, each
from studies import writing
from studies.drawing import MARKS, log_ticks

from .promised_arms import EXCHANGE, PLANS, SETTINGS, has_errors
from .promised_table import EVERY, floors, summary
from .promised_table import markdown as markdown
from .promised_trials import limits_of_task as limits_of_task  # called by its name
from .promised_trials import simulate_task

HERE = Path(__file__).parent
WORKERS = True
"""Its tasks may be shared."""

TABLE, FIGURE = "promised_and_found.csv", "promised_and_found"
DIGITS = 5
TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2)

simulate = simulate_task
"""Called by its name."""


def study(options: Options) -> dict[str, Any]:
    """Is what a plan promises what is found? A trial is an arm of each preset and population."""
    most = max(given["arms"] for given in SETTINGS["populations"].values())
    trials = writing.trials_of(options, most, 2)
    every = populations()
    options.advance("plans, and what they promise", 0.0)
    limits = each(partial(call, HERE.name, "limits_of_task"), every, options.workers)
    rows = [row for part in limits for row in part]
    settings = SETTINGS | {"trials": 1, "batch": 1, "most": trials}
    found = writing.trials_by_grid(options, HERE.name, settings, conditions(every, trials))
    said = key_figures(found, rows) | {"trials": trials}
    return writing.write_rounded(options.out, said, DIGITS, {TABLE: said["rows"]})


def populations() -> list[dict[str, str]]:
    """Every population of every preset, but those without errors."""
    return [
        {"preset": preset, "population": population}
        for preset in SETTINGS["presets"]
        for population in SETTINGS["populations"]
        if has_errors(preset, population)
    ]


def conditions(every: Sequence[Mapping[str, str]], trials: int) -> list[dict[str, Any]]:
    """A condition for each batch of arms: populations have different numbers of arms."""
    batch, found = SETTINGS["batch"], []
    for one in every:
        arms = min(trials, SETTINGS["populations"][one["population"]]["arms"])
        for first in range(0, arms, batch):
            found.append({**one, "first": first, "arms": min(batch, arms - first)})
    return found


def key_figures(found: pd.DataFrame, limits: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the README has."""
    return {"rows": summary(found, pd.DataFrame(limits)), "floors": floors(limits)}


def draw(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """A panel for each plan, a mark for each preset and population: found against promised."""
    figure = Figure(figsize=(11.0, 4.9), layout="constrained")
    panels = figure.subplots(1, len(PLANS), sharex=True, sharey=True)
    each_preset = [row for row in rows if row["preset"] != EVERY]
    names = list(SETTINGS["populations"])
    for panel, name in zip(panels, PLANS, strict=True):
        own = [row for row in each_preset if row["plan"] == name]
        panel.axvspan(0.85, 1.2, color="#eeeeee", lw=0)
        panel.axvline(1.0, color=GREY, lw=1.0)
        for k, (preset, (colour, mark)) in enumerate(zip(SETTINGS["presets"], MARKS, strict=False)):
            shown = [row for row in own if row["preset"] == preset]
            at = [len(names) - 1 - names.index(r["population"]) + 0.15 * (1.5 - k) for r in shown]
            middle = [row["over_promised"] for row in shown]
            ends = [[r["over_promised"] - r["over_promised_low"] for r in shown]]
            ends += [[r["over_promised_high"] - r["over_promised"] for r in shown]]
            panel.errorbar(
                middle, at, xerr=ends, fmt=mark, color=colour, mfc="none", mew=1.5, ms=5,
                capsize=2.0, label=preset,
            )  # fmt: skip
        panel.set_yticks(range(len(names)), names[::-1])
        panel.set_title(name)
        panel.set_xlabel("found over promised error, log scale")
        log_ticks(panel, TICKS)
        panel.grid(visible=True, axis="x", alpha=0.3)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    by = {r["population"]: r for r in rows if (r["preset"], r["plan"]) == (EVERY, EXCHANGE)}
    told = [
        f"{by[name]['over_promised']:.2f} on {words}" for name, words in MIXED.items() if name in by
    ]
    set_answer(
        figure,
        f"Found of the error that the exchange promises: {', '.join(told)}",
        "Grey: .85 to 1.2. Intervals are 95 %.",
    )
    return figure


MIXED = {
    "usual": "arms as plans take them to be",
    "as built": "arms as built",
    "uneven": "uneven ones",
}
"""Populations of arms that have errors of several kinds, in words."""


def plot(folder: Path) -> list[Path]:
    """Draw the ratios of the table in a folder."""
    return writing.save(draw(writing.read_rows(folder, TABLE)), folder, FIGURE)
