"""Run the study: python studies/06_hirsh_iterations/run.py [--trials N] [--out DIR]."""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

import hirsh_claims as claims  # noqa: E402
from hirsh_figures import Curve, draw_counts, draw_iterations  # noqa: E402
from hirsh_iterates import (  # noqa: E402
    IDENTITY,
    Views,
    draw,
    error,
    exact,
    noisy,
    walk,
    walk_as_printed,
    walk_by_squaring,
)

from calib.robot_world.methods import hirsh  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

FIRST_CYCLES = 60
"""Cycles that are shown one by one where all orientations are reached."""

DOUBLINGS = 18
"""Of the number of cycles, where poses stay in a cone: up to 131,072."""

SHOWN_AS_PRINTED = 512
"""Cycles of the printed form that are walked for the figure where poses stay in a cone."""

SCATTERED = 150
"""Problems shown as points, for each workspace and number of views."""


def views_of(workspace: str, trials: int | None = None) -> tuple[Views, Views]:
    """Problems of a workspace with all their views, without and with noise."""
    place = list(SETTINGS["workspaces"]).index(workspace)
    rng = np.random.default_rng([SETTINGS["seed"], place])
    cone_deg = SETTINGS["workspaces"][workspace]
    problems = draw(rng, trials or SETTINGS["trials"], max(SETTINGS["views"]), cone_deg)
    return exact(problems), noisy(rng, problems, SETTINGS["noise_deg"])


def run(workspace: str, trials: int | None = None) -> dict[str, Any]:
    """Everything that the verdicts rest on, in one workspace."""
    free, measured = views_of(workspace, trials)
    tolerance = SETTINGS["tolerance_rad"]
    place = list(SETTINGS["workspaces"]).index(workspace)
    limit, problems = (SETTINGS["printed"][key][place] for key in ("cycles", "problems"))
    rng = np.random.default_rng([SETTINGS["seed"], 100])
    rows = {}
    for n in SETTINGS["views"]:
        few = free.first(n)
        rows[str(n)] = {
            **claims.speed(few, tolerance),
            "printed": claims.as_printed(free.first(n, problems), limit, tolerance),
            "floor": claims.floor(measured.first(n), SETTINGS["noise_deg"]),
            **claims.in_a_second(few, tolerance, SETTINGS["computer"]),
        }
    found = {"views": rows, "more_views": claims.more_views(free, SETTINGS["views"], tolerance)}
    if SETTINGS["workspaces"][workspace] == 0.0:  # in a cone the walk is too long
        found["many_guesses"] = {
            str(n): claims.from_many_guesses(
                rng, free.first(n), SETTINGS["guesses"], limit, tolerance
            )
            for n in SETTINGS["shown"]
        }
    return found


def curves(workspace: str, trials: int | None = None) -> dict[tuple[str, str, int, str], Curve]:
    """Errors against cycles, as the figure shows them."""
    narrow = SETTINGS["workspaces"][workspace] > 0.0
    found = {}
    for data, views in zip(("exact", "noisy"), views_of(workspace, trials), strict=True):
        for n in SETTINGS["shown"]:
            few = views.first(n)
            if narrow:
                cycles, errors = (
                    2 ** np.arange(DOUBLINGS),
                    walk_by_squaring(few, DOUBLINGS, IDENTITY),
                )
                kept = cycles[cycles <= SHOWN_AS_PRINTED]
            else:
                kept = cycles = np.arange(FIRST_CYCLES + 1)
                errors = walk(few, cycles, IDENTITY)
            found[data, workspace, n, "consistent"] = (cycles, errors)
            steps = enumerate(walk_as_printed(few, int(kept.max()), IDENTITY))
            printed = [error(z, few.z) for k, z in steps if k in kept]
            found[data, workspace, n, "printed"] = (kept, np.array(printed))
    return found


def table(every: dict[tuple[str, str, int, str], Curve]) -> list[dict[str, Any]]:
    """A row for each point of the figure: quartiles, and the mean beside the median."""
    rows = []
    for (data, workspace, n, form), (cycles, errors) in every.items():
        for cycle, values in zip(cycles, errors, strict=True):
            q = np.quantile(values, [0.25, 0.5, 0.75])
            numbers = dict(zip(("q25", "median", "q75"), q, strict=True)) | {"mean": values.mean()}
            row = {"data": data, "workspace": workspace, "views": n, "form": form, "cycle": cycle}
            rows.append(row | {f"{k}_rad": rounded(float(v)) for k, v in numbers.items()})
    return rows


def rounded(value: Any) -> Any:
    """Numbers with :data:`DIGITS` digits, in whatever holds them."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def scatter(workspace: str, trials: int | None = None) -> dict[tuple[str, int], tuple[Any, Any]]:
    """Cycles counted and predicted of some problems."""
    free, _ = views_of(workspace, trials)
    found = {}
    for n in SETTINGS["views"]:
        pairs, tolerance = free.first(n).pairs, SETTINGS["tolerance_rad"]
        counted = hirsh.cycles(pairs, tolerance)[:SCATTERED]
        predicted = np.ceil(hirsh.predicted_cycles(pairs, tolerance))[:SCATTERED]
        found[workspace, n] = (np.maximum(counted, 1), np.maximum(predicted, 1.0))
    return found


def main() -> None:
    """Run, print, and write tables, figures and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, help="problems in each workspace")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out, trials = arguments.out, arguments.trials
    out.mkdir(parents=True, exist_ok=True)
    workspaces = list(SETTINGS["workspaces"])
    said = {workspace: run(workspace, trials) for workspace in workspaces}
    content = {"trials": trials or SETTINGS["trials"], "workspaces": rounded(said)}
    (out / "expected.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    every: dict[tuple[str, str, int, str], Curve] = {}
    counts: dict[tuple[str, int], tuple[Any, Any]] = {}
    for workspace in workspaces:
        every |= curves(workspace, trials)
        counts |= scatter(workspace, trials)
    rows = table(every)
    with (out / "hirsh_iterations.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw_iterations(every, SETTINGS["noise_deg"], out / "hirsh_iterations.png")
    draw_counts(said, counts, out / "hirsh_counts.png")
    print(json.dumps(content["workspaces"], indent=1))


if __name__ == "__main__":
    main()
