"""Run the study: ``posedesign study run hirsh_iterations``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.robot_world.methods import hirsh
from calib.se3 import FloatArray, IntArray
from posedesign.report.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    set_answer,
)
from posedesign.study import Advance, Options
from studies import writing

from . import hirsh_iterates as claims
from .hirsh_iterates import (
    ENDS,
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

VIEWS = {3: (VERMILION, "o"), 4: (PURPLE, "D"), 5: (BLUE, "s"), 10: (GREEN, "^")}
PLACES = (BLUE, ORANGE, GREY)
LIGHT = "#CCCCCC"
LOWEST_RAD = 1e-7
"""Errors below are of no interest: the axis of noise-free runs ends here."""

FIRST = ("exact", "all orientations")
FORMS = ("printed", "consistent")

Row = Mapping[str, Any]


def draw_iterations(rows: Sequence[Row], noise_deg: float) -> Figure:
    """Error against cycles: rows without and with noise, a column for each workspace."""
    workspaces = list(dict.fromkeys(row["workspace"] for row in rows))
    figure = Figure(figsize=(12.0, 7.6), layout="constrained")
    panels = figure.subplots(2, len(workspaces), sharex="col", sharey="row")
    for axes, data in zip(panels, ("exact", "noisy"), strict=True):
        for panel, workspace in zip(axes, workspaces, strict=True):
            own = [r for r in rows if (r["data"], r["workspace"]) == (data, workspace)]
            for (views, form), curve in groupby(own, lambda row: (row["views"], row["form"])):
                _curve(panel, list(curve), views, form)
            panel.set_yscale("log")
            panel.grid(True, alpha=0.25)
            what = "no noise" if data == "exact" else f"{noise_deg:g} deg of noise"
            panel.set_title(f"{workspace}, {what}", fontsize=10)
            if data == "noisy":
                line = np.radians(noise_deg) / 2.0
                panel.axhline(line, color=BLACK, lw=1.2, ls="--", label="line of the noise")
                panel.set_xlabel("cycles")
        axes[0].set_ylabel("angle between quaternions\n[rad], log scale")
    panels[0, 0].set_ylim(LOWEST_RAD, 2.0)
    for panel in panels[1, 1:]:
        panel.set_xscale("log")
        panel.set_xlabel("cycles, log scale")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    ends = {(r["form"], r["views"]): r for r in rows if (r["data"], r["workspace"]) == FIRST}
    printed, consistent = (
        [row["median_rad"] for (of, _), row in ends.items() if of == form] for form in FORMS
    )
    set_answer(
        figure,
        f"Over {FIRST[1]} and without noise the median error ends at {min(printed):.2g} rad as "
        f"printed, at {max(consistent):.0e} rad or less with consistent signs, whatever the number "
        "of views",
    )
    return figure


def _curve(panel: Axes, rows: Sequence[Row], views: float, form: str) -> None:
    cycles, colour = [row["cycle"] for row in rows], VIEWS[int(views)][0]
    low, middle, high = (
        [max(row[f"{name}_rad"], 1e-16) for row in rows] for name in ("q25", "median", "q75")
    )
    label = f"{views:g} views"
    if form == "printed":
        panel.plot(cycles, middle, ":", color=colour, lw=1.6, label=f"{label}, as printed")
        return
    panel.fill_between(cycles, low, high, color=colour, alpha=0.2, lw=0)
    panel.plot(cycles, middle, "-", color=colour, lw=1.6, label=f"{label}, signs consistent")


def draw_counts(said: Mapping[str, Any], counts: Sequence[Row]) -> Figure:
    """Predicted against counted cycles, how the printed form ends, and runs below the line."""
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _predictions(left, list(said), counts)
    _outcomes(middle, said)
    _floors(right, said)
    for panel in (left, middle, right):
        panel.grid(True, alpha=0.25)
    views = [row for every in said.values() for row in every["views"].values()]
    first = [
        row["printed"]["arrived"]["share"] for row in next(iter(said.values()))["views"].values()
    ]
    worst = max(row["not_converged"]["share"] for row in views)
    set_answer(
        figure,
        f"As printed {100 * min(first):.0f} to {100 * max(first):.0f} % of runs arrive over "
        f"{next(iter(said))}; with consistent signs {100 * (1 - worst):.4g} % do everywhere",
    )
    return figure


def _predictions(panel: Axes, workspaces: Sequence[str], counts: Iterable[Row]) -> None:
    """A mark for each problem; in a vector graphic they are one picture."""
    last = 1.0
    for (place, views), rows in groupby(counts, lambda row: (row["workspace"], row["views"])):
        counted, predicted = np.transpose([(r["cycles"], r["predicted_cycles"]) for r in rows])
        last = max(last, float(counted.max()))
        panel.plot(
            counted, predicted, VIEWS[int(views)][1], color=PLACES[workspaces.index(place)], ms=3,
            alpha=0.4, mew=0, label=place if views == 3 else None, rasterized=True,
        )  # fmt: skip
    panel.plot([1.0, last], [1.0, last], color=BLACK, lw=1.0, label="predicted = counted")
    panel.set(
        xscale="log",
        yscale="log",
        xlabel="cycles counted, log scale",
        ylabel="cycles predicted, log scale",
    )
    panel.set_title("Cycles to 1e-4 rad, by (σ2/σ1)²", fontsize=10)
    panel.legend(fontsize=8)


def _floors(panel: Axes, said: Mapping[str, Any]) -> None:
    """Shares of runs that end below the line of the noise, with their intervals."""
    for place, (workspace, every) in enumerate(said.items()):
        views = list(every["views"])
        rows = [every["views"][n]["floor"]["below_line"] for n in views]
        middles = np.array([row["share"] for row in rows])
        bars = [middles - [r["low"] for r in rows], [r["high"] for r in rows] - middles]
        panel.errorbar(
            [int(n) for n in views], 100 * middles, yerr=100 * np.array(bars), fmt="-o",
            color=PLACES[place], capsize=3, ms=4, label=workspace,
        )  # fmt: skip
    panel.set(xlabel="views", ylabel="runs below the line of the noise [%]", ylim=(-3, 103))
    panel.set_xticks(list(VIEWS))
    panel.set_title("1 deg of noise; bars: 95 % interval", fontsize=10)
    panel.legend(fontsize=8)


def _outcomes(panel: Axes, said: Mapping[str, Any]) -> None:
    """Stacked shares of the ends of the printed form, with the interval of the last one."""
    colours = dict(zip(ENDS, (GREEN, VERMILION, ORANGE, LIGHT), strict=True))
    at, labels = 0.0, []
    for workspace, every in said.items():
        for views, row in every["views"].items():
            base = 0.0
            for end, colour in colours.items():
                height = 100 * row["printed"][end]["share"]
                label = None if labels else end
                panel.bar(at, height, bottom=base, color=colour, label=label)
                base += height
            low, high = (100 * row["printed"]["arrived"][k] for k in ("low", "high"))
            panel.plot([at, at], [low, high], color=BLACK, lw=1.5)
            labels.append((at, f"{views}"))
            at += 1.0
        panel.text(at - 2.5, 101.5, workspace, ha="center", fontsize=8)
        at += 0.7
    panel.set_xticks([x for x, _ in labels], [text for _, text in labels])
    panel.set(xlabel="views", ylabel="runs [%]", ylim=(0, 100))
    panel.set_title("As printed, no noise, from the identity", fontsize=10, pad=16)
    panel.legend(
        fontsize=8,
        ncols=4,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        handlelength=1.0,
        columnspacing=1.0,
        frameon=False,
    )


SETTINGS = writing.settings_of(__file__)
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
    writing.write_rows(options.out, f"{COUNTS}.csv", counts)
    return writing.write_rounded(options.out, said, DIGITS, {f"{ITERATIONS}.csv": errors})


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
    for n in writing.parts_of(SETTINGS["views"], advance, "{} views".format):
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
