"""Run the study: posedesign study run accuracy_vs_condition [--trials N] [--jobs N] [--out DIR]."""

from __future__ import annotations

import sys
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from condition_figures import draw_identification, draw_solvers  # noqa: E402
from condition_summary import relations, summary  # noqa: E402
from condition_trials import conditions, simulate  # noqa: E402, F401 -- called by its name

from posedesign.study.grid import Grid  # noqa: E402
from posedesign.study.library import Options, call  # noqa: E402
from posedesign.study.runner import run_grid  # noqa: E402
from posedesign.study.store import Store, read_table  # noqa: E402
from studies.writing import save, script, trials_of, write_figures, write_rows  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
WORKERS = True
"""Its tasks may be shared."""

SETS, RELATIONS = "accuracy_vs_condition.csv", "relations.csv"


def study(options: Options) -> dict[str, Any]:
    """What does a lower condition number buy? A trial is one data set of each pose set."""
    settings = SETTINGS | {"trials": trials_of(options, SETTINGS["trials"])}
    options.advance("planning", 0.0)
    grid = Grid(conditions(settings), settings["trials"], settings["batch"], settings["seed"])
    about = {"study": HERE.name, "tasks": len(grid), **settings}
    table = run_grid(
        partial(call, HERE.name, "simulate"),
        grid,
        Store(options.out, "trials", about),
        options.workers,
        restart=options.restart,
        advance=lambda done, total: options.advance(f"{done} of {total} tasks", done / total),
    )
    rows = summary(read_table(table), settings["solvers"])
    write_rows(options.out, SETS, rows)
    import pandas as pd

    related = relations(pd.DataFrame(rows), settings["solvers"])
    write_rows(options.out, RELATIONS, related)
    figures = {"trials": settings["trials"], "relations": [_rounded(row) for row in related]}
    write_figures(options.out, figures)
    return figures


def plot(folder: Path) -> list[Path]:
    """Draw what the tables of a folder say."""
    import pandas as pd

    rows = pd.read_csv(folder / SETS)
    return [
        *save(draw_identification(rows), folder, "accuracy_vs_condition"),
        *save(draw_solvers(rows, SETTINGS["solvers"]), folder, "solvers_vs_condition"),
    ]


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    return {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in row.items()}


if __name__ == "__main__":
    script(study, plot, HERE)
