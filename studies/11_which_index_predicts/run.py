"""Run the study: ``posedesign study run which_index_predicts``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from posedesign.report.drawing import set_answer
from posedesign.study import Options
from studies import writing
from studies.drawing import rows_with_intervals
from studies.writing import cell, span, table_across

from .index_ranks import Bank, correlations
from .index_truths import chosen, held

TITLES = {"same": "random sets of 27 poses", "mixed": "random sets of 8 to 60 poses, 15 to 60 deg"}


def draw(said: dict[str, Any]) -> Figure:
    """Above the error against that of I; below rank correlations of indices with the error."""
    problems = {row["problem"] for row in said["chosen"]}
    figure = Figure(figsize=(12.5, 10.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.0, 1.15])
    counts = list(dict.fromkeys(row["poses"] for row in said["chosen"]))
    for column, poses in enumerate(counts[:2]):
        panel = figure.add_subplot(grid[0, column])
        rows = [row for row in said["chosen"] if row["poses"] == poses]
        columns = ("times_I", "times_I_low", "times_I_high")
        rows_with_intervals(panel, rows, "criterion", "problem", columns)
        panel.axvline(1.0, color="#555555", lw=1.0)
        panel.set_title(f"{poses} poses chosen by each criterion", fontsize=11)
        panel.set_xlabel("error over the box, times that of the choice by I")
    for column, (kind, title) in enumerate(TITLES.items()):
        panel = figure.add_subplot(grid[1, column])
        rows = [row for row in said["ranked"] if row["sets"] == kind]
        rows_with_intervals(panel, rows, "index", "problem", ("rho", "low", "high"))
        panel.set_title(title, fontsize=11)
        panel.set_xlabel("rank correlation with the error over the box")
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(problems), frameon=False)
    more = {
        name: [100.0 * (row["times_I"] - 1.0) for row in said["chosen"] if row["criterion"] == name]
        for name in ("C_G", "D")
    }
    set_answer(
        figure,
        f"Choosing by C_G leaves {min(more['C_G']):.0f} to {max(more['C_G']):.0f} % more error "
        f"than choosing by I, the predicted error; by D up to {max(more['D']):.0f} % more",
    )
    return figure


SETTINGS = writing.settings_of(__file__)
KINDS = ("same", "mixed")
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

FIGURE = "which_index_predicts"


def study(options: Options) -> dict[str, Any]:
    """Which index predicts accuracy, and how far is the prediction to be trusted?

    A trial is a set of touch-ups of one set of poses. A short form of N has as many in all three
    parts, and N random sets of each kind at most.
    """
    if options.trials is None:
        trials, sets = None, SETTINGS["ranked"]["sets"]
    else:
        trials = writing.trials_of(options, options.trials)
        sets = min(trials, SETTINGS["ranked"]["sets"])
    problems = SETTINGS["problems"]
    said: dict[str, Any] = {"chosen": [], "ranked": []}
    for k, problem in enumerate(problems):
        options.advance(f"{problem}: chosen poses", k / (len(problems) + 1))
        said["chosen"] += chosen(problem, SETTINGS, trials=trials)
        options.advance(f"{problem}: random sets", (k + 0.5) / (len(problems) + 1))
        said["ranked"] += ranked(problem, trials, sets)
    options.advance("models right and wrong", len(problems) / (len(problems) + 1))
    said["held"] = held(next(iter(SETTINGS["arms"])), SETTINGS, trials=trials)
    tables = {f"{name}.csv": rows for name, rows in said.items()}
    return writing.write_rounded(options.out, said, DIGITS, tables)


def plot(folder: Path) -> list[Path]:
    """What choosing by each criterion costs, and how each index ranks random sets."""
    return writing.save(draw(writing.read_figures(folder)), folder, FIGURE)


def ranked(
    problem: str, trials: int | None = None, sets: int | None = None
) -> list[dict[str, Any]]:
    """Rank correlation of every index with the error, over random sets of both kinds."""
    own = SETTINGS["ranked"]
    bank = Bank(problem, SETTINGS, trials or own["trials"])
    rows = []
    for kind in KINDS:
        found = bank.sets(kind, SETTINGS, sets or own["sets"])
        middle = 1e3 * float(np.median(found.error_m))
        head = {"problem": problem, "sets": kind, "median_error_mm": middle}
        rows += [head | row for row in correlations(found)]
    return rows


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read: a column, or two, for each problem or set of poses."""
    places = [(kind, problem) for kind in KINDS for problem in SETTINGS["problems"]]
    ranked_ = [row | {"at": (row["sets"], row["problem"])} for row in said["ranked"]]
    ranked_.sort(key=lambda row: places.index(row["at"]))
    return "\n\n".join(
        [
            table_across(
                said["chosen"], ("{criterion}", "{poses}"), "problem", ("{rms_mm:s.4f}", _times)
            ),
            table_across(ranked_, ("{index}",), "at", (span(".2f", "rho", "low", "high"),)),
            table_across(said["held"], ("{says}",), "set", ("{rms_mm:s.3f}", _ratio)),
        ]
    )


def _times(row: Mapping[str, Any]) -> str:
    known = row["times_I_low"] < row["times_I_high"]
    return cell(row, span(".2f", "times_I") if known else "{times_I:.2f}")


def _ratio(row: Mapping[str, Any]) -> str:
    return cell(row, span(".2f" if row["ratio"] < 10 else ".0f", "ratio"))
