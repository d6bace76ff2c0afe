"""Run the study: ``posedesign study run what_buys_accuracy``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from posedesign.study import Advance, Options
from studies import writing
from studies.drawing import BLACK, BLUE, VERMILION
from studies.tool_errors import ToolErrors

from .buys import Bench, Measured, Variant

TITLES = {"r2000ic165f": "R-2000iC/165F", "ur10e": "UR10e"}
RIGID, PREDICTED, DEFLECTING = BLUE, BLACK, VERMILION


def draw(arms: dict[str, Any]) -> Figure:
    """Root mean square over box and trials, a line for each variant, a panel for each arm."""
    first = next(iter(arms.values()))["rows"]
    places = list(range(len(first)))[::-1]
    figure = Figure(figsize=(12.5, 0.27 * len(first) + 1.8), layout="constrained")
    panels = figure.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    for panel, (arm, part) in zip(panels, arms.items(), strict=True):
        for place in places[::2]:
            panel.axhspan(place - 0.5, place + 0.5, color="#eeeeee", lw=0)
        columns = {key: [row.get(key) for row in part["rows"]] for key in part["rows"][0]}
        _intervals(panel, places, columns, "rms", RIGID, "o")
        panel.plot(columns["predicted_rms_mm"], places, "|", color=PREDICTED, ms=11, mew=1.5)
        if "deflecting_rms_mm" in columns:
            _intervals(panel, places, columns, "deflecting_rms", DEFLECTING, "x")
        for place, minutes in zip(places, columns["minutes"], strict=True):
            panel.annotate(
                f"{minutes:.0f} min",
                (1.01, place),
                xycoords=("axes fraction", "data"),
                fontsize=8,
                va="center",
            )
        for name, colour in (("rigid", RIGID), ("deflecting", DEFLECTING)):
            if f"{name}_mm" in part["before"]:
                panel.axvline(part["before"][f"{name}_mm"], color=colour, ls=":", lw=1.2)
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.grid(True, axis="x", which="both", alpha=0.3)
        panel.set_title(TITLES.get(arm, arm), fontsize=11)
        panel.set_xlabel("error of the tool point over the box, rms [mm]")
        panel.set_ylim(-0.6, len(first) - 0.4)
    panels[0].set_yticks(places, [row["says"] for row in first], fontsize=9)
    panels[0].plot([], [], "o-", color=RIGID, lw=4, alpha=0.7, label="simulated, 95 % interval")
    panels[0].plot([], [], "|", color=PREDICTED, ms=11, mew=1.5, ls="", label="predicted")
    panels[0].plot(
        [], [], "x-", color=DEFLECTING, lw=4, alpha=0.7, label="arm that deflects, 95 % interval"
    )
    panels[0].plot([], [], ":", color="#555555", label="before calibration")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _intervals(
    panel: Axes,
    places: list[int],
    columns: dict[str, list[float]],
    name: str,
    colour: str,
    mark: str,
) -> None:
    """What was simulated, with its 95 % interval."""
    low, high = columns[f"{name}_low_mm"], columns[f"{name}_high_mm"]
    panel.hlines(places, low, high, color=colour, lw=6, alpha=0.4)
    panel.plot(columns[f"{name}_mm"], places, mark, color=colour, ms=3.5)


SETTINGS = writing.settings_of(__file__)
VARIANTS = [Variant(**given) for given in SETTINGS["variant"]]
BASELINE = VARIANTS[0].key
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

TABLE, FIGURE = "what_buys_accuracy.csv", "what_buys_accuracy"


def study(options: Options) -> dict[str, Any]:
    """What buys accuracy, and what does it cost?

    A trial is a set of touch-ups of a variant, identified and held against the true arm. On the arm
    that deflects there are ``deflecting_trials`` at most.
    """
    trials = writing.trials_of(options, SETTINGS["trials"])
    said: dict[str, Any] = {"trials": trials, "arms": {}}
    for k, arm in enumerate(SETTINGS["arms"]):
        advance = writing.part_of(options.advance, k, len(SETTINGS["arms"]), arm)
        table = rows(run(arm, trials, advance=advance))
        said["arms"][arm] = {"before": before(arm), "rows": table}
    every = [{"arm": arm} | row for arm, part in said["arms"].items() for row in part["rows"]]
    writing.write_rows(options.out, TABLE, every, DIGITS)
    writing.write_figures(options.out, said)
    return said


def plot(folder: Path) -> list[Path]:
    """The error over the box of each way to measure, and its time."""
    return writing.save(draw(writing.read_figures(folder)["arms"]), folder, FIGURE)


def run(
    arm: str,
    trials: int | None = None,
    keys: Sequence[str] | None = None,
    advance: Advance = lambda what, part: None,
) -> dict[str, Measured]:
    """What each variant comes to on an arm; each has random numbers of its own."""
    bench = Bench(arm, SETTINGS)
    count = trials or SETTINGS["trials"]
    deflecting = min(count, SETTINGS["deflecting_trials"])
    found = {}
    wanted = [v for v in VARIANTS if keys is None or v.key in keys]
    for done, variant in enumerate(wanted):
        advance(variant.says, done / len(wanted))
        stream = VARIANTS.index(variant)
        found[variant.key] = bench.measure(variant, count, deflecting, stream)
    return found


def rows(found: dict[str, Measured]) -> list[dict[str, Any]]:
    """A row for each variant: time, error over the box in mm, what it is worth a minute."""
    base = found[BASELINE]
    table = []
    for key, measured in found.items():
        information = (base.rigid.predicted_rms_m / measured.rigid.predicted_rms_m) ** 2
        row: dict[str, Any] = {"key": key, "says": measured.variant.says}
        row |= {"measurements": measured.measurements, "targets": measured.targets}
        row |= {"minutes": measured.minutes}
        row |= {"moving_minutes": measured.moving_minutes}
        row |= _figures("", measured.rigid)
        row["worth_a_minute"] = information * base.minutes / measured.minutes
        if measured.deflecting is not None:
            row |= _figures("deflecting_", measured.deflecting)
        table.append(row)
    rounded: list[dict[str, Any]] = writing.rounded(table, DIGITS)
    return rounded


def _figures(prefix: str, errors: ToolErrors) -> dict[str, float]:
    (low, high), (worst_low, worst_high) = errors.rms_interval_m, errors.worst_interval_m
    found = {
        "predicted_rms": errors.predicted_rms_m,
        "rms": errors.rms_m,
        "rms_low": low,
        "rms_high": high,
        "median_of_trials": float(np.median(errors.of_trials_m)),
        "predicted_worst": errors.predicted_worst_m,
        "worst": errors.worst_m,
        "worst_low": worst_low,
        "worst_high": worst_high,
        "median_of_worst": float(np.median(errors.worst_of_trials_m)),
    }
    if prefix:  # the same plan: the same prediction
        del found["predicted_rms"], found["predicted_worst"]
    in_mm: dict[str, float] = {f"{prefix}{name}_mm": 1e3 * value for name, value in found.items()}
    return in_mm | {f"{prefix}failed": errors.failed}


def before(arm: str) -> dict[str, float]:
    """Error over the box before calibration [mm]."""
    bench = Bench(arm, SETTINGS)
    said = {"rigid_mm": 1e3 * bench.before_m(deflects=False)}
    if bench.cell.deflects:
        said["deflecting_mm"] = 1e3 * bench.before_m(deflects=True)
    rounded: dict[str, float] = writing.rounded(said, DIGITS)
    return rounded


def markdown(said: Mapping[str, Any]) -> str:
    """What the README has of each arm."""
    return "\n\n".join(
        f"{arm}, before calibration {part['before']}\n{table(part['rows'])}"
        for arm, part in said["arms"].items()
    )


def table(table: list[dict[str, Any]]) -> str:
    """The table that people read."""
    lines = []
    for row in table:
        cells = [row["says"], f"{row['measurements']}", f"{row['minutes']:.1f}"]
        cells += [_short(row["predicted_rms_mm"]), _short(row["rms_mm"])]
        cells += [f"{_short(row['rms_low_mm'])} to {_short(row['rms_high_mm'])}"]
        cells += [_short(row["median_of_trials_mm"])]
        cells += [_short(row["predicted_worst_mm"]), _short(row["worst_mm"])]
        cells += [_digits(row["worth_a_minute"], 2)]
        if "deflecting_rms_mm" in row:
            cells += [_digits(row["deflecting_rms_mm"], 3)]
        lines.append(writing.table_line(cells))
    return "\n".join(lines)


def _digits(value: float, count: int) -> str:
    return f"{float(f'{value:.{count}g}'):g}"


def _short(value_mm: float) -> str:
    return f"{value_mm:.4f}".lstrip("0")
