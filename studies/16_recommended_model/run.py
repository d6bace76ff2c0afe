"""Run the study: posedesign study run recommended_model [--trials N] [--jobs N] [--out DIR]."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from recommended_arms import SETTINGS  # noqa: E402
from recommended_figure import draw  # noqa: E402
from recommended_table import Outcome, markdown, models_taken, outcomes, summary, worst  # noqa: E402
from recommended_trials import simulate  # noqa: E402, F401 -- called by its name

from posedesign.study.grid import Grid  # noqa: E402
from posedesign.study.library import Options, call  # noqa: E402
from posedesign.study.runner import run_grid  # noqa: E402
from posedesign.study.store import Store, read_table  # noqa: E402
from studies import writing  # noqa: E402

WORKERS = True
"""Its tasks may be shared."""

ARMS, FIGURE = "recommended_model.csv", "recommended_model"
DIGITS = 5


def study(options: Options) -> dict[str, Any]:
    """Is the recommended model the one to take? A trial is an arm of each preset, in each way."""
    trials = writing.trials_of(options, SETTINGS["trials"], 1)
    about = {"study": HERE.name, **SETTINGS, "trials": trials}
    grid = Grid(conditions(), trials, SETTINGS["batch"], SETTINGS["seed"])
    table = run_grid(
        partial(call, HERE.name, "simulate"),
        grid,
        Store(options.out, "trials", about | {"tasks": len(grid)}),
        options.workers,
        restart=options.restart,
        advance=lambda done, total: options.advance(f"{done} of {total} tasks", done / total),
    )
    found = outcomes(read_table(table))
    writing.write_rows(options.out, ARMS, [asdict(one) for one in found], DIGITS)
    said = writing.rounded(key_figures(found) | {"trials": trials}, DIGITS)
    writing.write_figures(options.out, said)
    return dict(said)


def conditions() -> list[dict[str, str]]:
    """Every preset in every way."""
    return [{"preset": p, "way": w} for w in SETTINGS["ways"] for p in SETTINGS["presets"]]


def key_figures(found: list[Outcome]) -> dict[str, Any]:
    """What the README has, and where to look."""
    rows = summary(found, SETTINGS["near"])
    return {"rows": rows, "taken": models_taken(found), "worst": worst(found)}


def plot(folder: Path) -> list[Path]:
    """Draw the arms of a table."""
    rows = writing.read_rows(folder, ARMS)
    return writing.save(draw([_outcome(row) for row in rows]), folder, FIGURE)


def _outcome(row: Mapping[str, Any]) -> Outcome:
    """An arm of the table, whose numbers are all read as such and its flags as words."""
    given: dict[str, Any] = {}
    for field in fields(Outcome):
        value = row[field.name]
        if field.type == "bool":
            value = str(value).lower() in ("true", "1", "1.0")
        elif field.type == "float":
            value = float(value) if value != "" else float("nan")
        elif field.type == "int":
            value = int(value)
        given[field.name] = value
    return Outcome(**given)


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, markdown)


if __name__ == "__main__":
    main()
