"""Run the study: ``posedesign study run li_noise_cases``, or this file as a script.

The part on real pairs needs measurements that the project does not contain, see
:mod:`studies.real_data`. It is left out without them.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from li_cases import MEASURES, SHOWN, SOLVERS, draw, errors  # noqa: E402
from li_claims import Cell, Found, claims  # noqa: E402
from li_figures import OF_THE_PAPER, draw_averages, draw_medians  # noqa: E402
from li_table import measured, simulated  # noqa: E402

from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402
from studies.intervals import median_interval  # noqa: E402
from studies.real_data import data_folder  # noqa: E402
from studies.real_pairs import real_pairs  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

MEDIANS, AVERAGES = "li_noise_cases", "li_averages_of_ten"
"""Tables, and their figures."""


def study(options: Options) -> dict[str, Any]:
    """Is the Kronecker product better than dual quaternions, and both better than quaternions?

    A trial is a random problem of a cell: workspace, noisy side, number of poses. Of real pairs
    as many subsets are drawn at most.
    """
    few = SETTINGS["paper_trials"]
    trials = writing.trials_of(options, SETTINGS["trials"], few)
    found = run(trials, advance=writing.part_of(options.advance, 0, 2, "Fig. 1"))
    options.advance("Fig. 1, averages of ten", 0.5)
    paper = run(few, stream=1)
    options.advance("Table 1", 0.6)
    rows = writing.rounded(table(found), DIGITS)
    said = {
        "trials": trials,
        "medians": [
            {k: row[k] for k in ("workspace", "noisy", "poses", "method")}
            | {title: row[f"{title}_median"] for title in MEASURES}
            for row in rows
            if row["method"] in SHOWN
        ],
        **claims(found, few),
        "table_1": table_1(trials, options.advance),
    }
    writing.write_rows(options.out, f"{MEDIANS}.csv", rows, DIGITS)
    writing.write_rows(options.out, f"{AVERAGES}.csv", averages(paper), DIGITS)
    rounded: dict[str, Any] = writing.rounded(said, DIGITS)
    writing.write_figures(options.out, rounded)
    return rounded


def plot(folder: Path) -> list[Path]:
    """Medians with their intervals, and the paper's own averages."""
    rows, of_ten = (writing.read_rows(folder, f"{name}.csv") for name in (MEDIANS, AVERAGES))
    drawn = writing.save(draw_medians(rows), folder, MEDIANS)
    return drawn + writing.save(draw_averages(rows, of_ten), folder, AVERAGES)


def cells(poses: Iterable[int] | None = None) -> list[Cell]:
    """Workspace, noisy side and number of poses of every cell."""
    return [
        (workspace, noisy, n)
        for workspace in SETTINGS["workspaces"]
        for noisy in SETTINGS["noisy"]
        for n in poses or SETTINGS["poses"]
    ]


def run(
    trials: int | None = None,
    poses: Iterable[int] | None = None,
    stream: int = 0,
    advance: Advance = lambda what, part: None,
) -> Found:
    """Errors of every method in every cell; each cell has random numbers of its own."""
    found = {}
    every = cells(SETTINGS["poses"])
    wanted = cells(poses)
    for done, cell in enumerate(wanted):
        workspace, noisy, n = cell
        advance(f"{workspace}, noise on {noisy}, {n} poses", done / len(wanted))
        rng = np.random.default_rng([SETTINGS["seed"], stream, every.index(cell)])
        cone_deg = SETTINGS["workspaces"][workspace]
        data = draw(rng, trials or SETTINGS["trials"], n, noisy, cone_deg, SETTINGS)
        found[cell] = {name: errors(data, solve(data)) for name, solve in SOLVERS.items()}
    return found


def table(found: Found) -> list[dict[str, Any]]:
    """A row for each cell and method: medians with intervals, means, what 95 % stay below."""
    rows = []
    for (workspace, noisy, n), methods in found.items():
        for name, values in methods.items():
            row: dict[str, Any] = {"workspace": workspace, "noisy": noisy, "poses": n}
            row["method"] = name
            for title, column in zip(MEASURES, values.T, strict=True):
                low, high = median_interval(column)
                row[f"{title}_median"] = np.median(column)
                row[f"{title}_median_low"], row[f"{title}_median_high"] = low, high
                row[f"{title}_mean"] = column.mean()
                row[f"{title}_95"] = np.quantile(column, 0.95)
            rows.append(row)
    return rows


def averages(paper: Found) -> list[dict[str, Any]]:
    """A row for each cell and method of the paper: means over its few problems."""
    return [
        {"workspace": workspace, "noisy": noisy, "poses": n, "method": name}
        | {f"{t}_mean": m for t, m in zip(MEASURES, methods[name].mean(axis=0), strict=True)}
        for (workspace, noisy, n), methods in paper.items()
        for name in OF_THE_PAPER
    ]


def table_1(trials: int, advance: Advance = lambda what, part: None) -> dict[str, Any]:
    """E of seven poses: by simulation, and of real pairs where there are any."""
    rng = np.random.default_rng([SETTINGS["seed"], 1])
    found = {"simulated": simulated(rng, trials, SETTINGS)}
    pairs = real_pairs(data_folder())
    if not pairs:
        advance(f"Table 1 without real pairs: there are none in {data_folder()}", 1.0)
        return found
    of = SETTINGS["table_1"]
    advance("Table 1, real pairs", 0.8)
    found["measured"] = measured(rng, pairs, min(trials, of["subsets"]), of["poses"])
    return found


def main() -> None:
    """Run and draw."""
    writing.script(study, plot, HERE)


if __name__ == "__main__":
    main()
