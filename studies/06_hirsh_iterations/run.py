"""Run the study: ``posedesign study run hirsh_iterations``, or this file as a script."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

import hirsh_claims as claims  # noqa: E402
from hirsh_figures import draw_counts, draw_iterations  # noqa: E402
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
from calib.se3 import FloatArray, IntArray  # noqa: E402
from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

ITERATIONS, COUNTS = "hirsh_iterations", "hirsh_counts"
"""Tables, and their figures."""

FIRST_CYCLES = 60
"""Cycles that are shown one by one where all orientations are reached."""

DOUBLINGS = 18
"""Of the number of cycles, where poses stay in a cone: up to 131,072."""

SHOWN_AS_PRINTED = 512
"""Cycles of the printed form that are walked for the figure where poses stay in a cone."""

SCATTERED = 150
"""Problems shown as points, for each workspace and number of views."""


def study(options: Options) -> dict[str, Any]:
    """Does the iteration converge from any guess, how fast, and how near under noise?

    A trial is a random problem of a workspace, of which more and more views are used.
    """
    trials = writing.trials_of(options, SETTINGS["trials"])
    said: dict[str, Any] = {"trials": trials, "workspaces": {}}
    errors: list[dict[str, Any]] = []
    counts: list[dict[str, Any]] = []
    for k, workspace in enumerate(SETTINGS["workspaces"]):
        advance = writing.part_of(options.advance, k, len(SETTINGS["workspaces"]), workspace)
        said["workspaces"][workspace] = run(workspace, trials, advance)
        errors += curves(workspace, trials)
        counts += scatter(workspace, trials)
    writing.write_rows(options.out, f"{ITERATIONS}.csv", errors, DIGITS)
    writing.write_rows(options.out, f"{COUNTS}.csv", counts)
    rounded: dict[str, Any] = writing.rounded(said, DIGITS)
    writing.write_figures(options.out, rounded)
    return rounded


def plot(folder: Path) -> list[Path]:
    """Error against cycles; counts, ends of the printed form and runs below the line."""
    errors, counts = (writing.read_rows(folder, f"{name}.csv") for name in (ITERATIONS, COUNTS))
    said = writing.read_figures(folder)["workspaces"]
    drawn = writing.save(draw_iterations(errors, SETTINGS["noise_deg"]), folder, ITERATIONS)
    return drawn + writing.save(draw_counts(said, counts), folder, COUNTS)


def views_of(workspace: str, trials: int | None = None) -> tuple[Views, Views]:
    """Problems of a workspace with all their views, without and with noise."""
    place = list(SETTINGS["workspaces"]).index(workspace)
    rng = np.random.default_rng([SETTINGS["seed"], place])
    cone_deg = SETTINGS["workspaces"][workspace]
    problems = draw(rng, trials or SETTINGS["trials"], max(SETTINGS["views"]), cone_deg)
    return exact(problems), noisy(rng, problems, SETTINGS["noise_deg"])


def run(
    workspace: str, trials: int | None = None, advance: Advance = lambda what, part: None
) -> dict[str, Any]:
    """Everything that the verdicts rest on, in one workspace."""
    free, measured = views_of(workspace, trials)
    tolerance = SETTINGS["tolerance_rad"]
    place = list(SETTINGS["workspaces"]).index(workspace)
    limit, problems = (SETTINGS["printed"][key][place] for key in ("cycles", "problems"))
    rng = np.random.default_rng([SETTINGS["seed"], 100])
    rows = {}
    for done, n in enumerate(SETTINGS["views"]):
        advance(f"{n} views", done / len(SETTINGS["views"]))
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


def curves(workspace: str, trials: int | None = None) -> Iterator[dict[str, Any]]:
    """A row for each point of the figure of errors against cycles."""
    narrow = SETTINGS["workspaces"][workspace] > 0.0
    for data, views in zip(("exact", "noisy"), views_of(workspace, trials), strict=True):
        for n in SETTINGS["shown"]:
            few = views.first(n)
            if narrow:
                cycles = 2 ** np.arange(DOUBLINGS)
                errors = walk_by_squaring(few, DOUBLINGS, IDENTITY)
                kept = cycles[cycles <= SHOWN_AS_PRINTED]
            else:
                kept = cycles = np.arange(FIRST_CYCLES + 1)
                errors = walk(few, cycles, IDENTITY)
            head = {"data": data, "workspace": workspace, "views": n}
            yield from points(head | {"form": "consistent"}, cycles, errors)
            steps = enumerate(walk_as_printed(few, int(kept.max()), IDENTITY))
            printed = [error(z, few.z) for k, z in steps if k in kept]
            yield from points(head | {"form": "printed"}, kept, printed)


def points(
    head: dict[str, Any], cycles: IntArray, errors: Iterable[FloatArray]
) -> Iterator[dict[str, Any]]:
    """Quartiles at each number of cycles, and the mean beside the median."""
    for cycle, values in zip(cycles, errors, strict=True):
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
        row = {"q25_rad": low, "median_rad": middle, "q75_rad": high, "mean_rad": values.mean()}
        yield head | {"cycle": int(cycle)} | row


def scatter(workspace: str, trials: int | None = None) -> Iterator[dict[str, Any]]:
    """Cycles counted and predicted of some problems, a row for each."""
    free, _ = views_of(workspace, trials)
    tolerance = SETTINGS["tolerance_rad"]
    for n in SETTINGS["views"]:
        pairs = free.first(n, SCATTERED).pairs
        both = hirsh.cycles(pairs, tolerance), np.ceil(hirsh.predicted_cycles(pairs, tolerance))
        for counted, predicted in zip(*both, strict=True):
            row = {"cycles": max(int(counted), 1), "predicted_cycles": max(int(predicted), 1)}
            yield {"workspace": workspace, "views": n} | row


def main() -> None:
    """Run and draw."""
    writing.script(study, plot, HERE)


if __name__ == "__main__":
    main()
