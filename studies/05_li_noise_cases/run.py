"""Run the study: ``posedesign study run li_noise_cases``.

The part on real pairs needs measurements that the project does not contain, see
:mod:`studies.real_data`. It is left out without them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from calib.robot_world import METHODS, PairSets, residuals, solve_batch
from calib.se3 import FloatArray
from posedesign.study import Advance, Options
from studies import writing
from studies.drawing import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILION, log_ticks
from studies.intervals import median_interval
from studies.real_data import Sides, data_folder, real_pairs

from .li_cases import (
    DUAL,
    DUAL_M,
    FLOOR,
    KRONECKER,
    KRONECKER_M,
    MEASURES,
    QUATERNION,
    SAFE,
    SCALED,
    SHOWN,
    SOLVERS,
    Cell,
    Found,
    Measured,
    claims,
    draw,
    errors,
    in_mm,
    linear_minimum,
    sum_of_squares,
)

UNPROJECTED = "Kronecker, mm, not orthonormal"
METHODS_OF_TABLE = (QUATERNION, SAFE, DUAL, KRONECKER, UNPROJECTED, SCALED, FLOOR)


def table_row(data: Measured) -> dict[str, FloatArray]:
    """E ``(T,)`` [mm²] of every method, rotations and translations in one norm."""
    answers = {name: SOLVERS[name](data) for name in METHODS_OF_TABLE if name != UNPROJECTED}
    found = {name: (in_mm(X), in_mm(Z)) for name, (X, Z) in answers.items()}
    found[UNPROJECTED] = linear_minimum(data.millimetres)
    return {name: sum_of_squares(data.millimetres, *found[name]) for name in METHODS_OF_TABLE}


def summary(E: dict[str, FloatArray]) -> dict[str, Any]:
    """Medians, and how often the three methods stand as in the paper."""
    q, d, k = (E[name] for name in (QUATERNION, DUAL, KRONECKER))
    u = E[UNPROJECTED]
    return {
        "sets": len(q),
        "median": {name: float(np.median(values)) for name, values in E.items()},
        "kronecker_least": float(((k < q) & (k < d)).mean()),
        "not_orthonormal_least": float(((u < q) & (u < d)).mean()),
        "paper_order": float(((k < q) & (q < d)).mean()),
        "paper_order_not_orthonormal": float(((u < q) & (q < d)).mean()),
    }


def simulated(rng: np.random.Generator, trials: int, settings: dict[str, Any]) -> dict[str, Any]:
    """Table 1 by simulation, for every workspace and noisy side."""
    found: dict[str, Any] = {}
    poses = settings["table_1"]["poses"]
    for workspace, cone_deg in settings["workspaces"].items():
        for noisy in settings["noisy"]:
            data = draw(rng, trials, poses, noisy, cone_deg, settings)
            row = summary(table_row(data))
            X, Z = (in_mm(T) for T in SOLVERS[SAFE](data))
            e = residuals(data.millimetres.A, data.millimetres.B, X, Z)
            # |R - 1|² is twice the square of a small angle
            row["rotation_part"] = float(np.median(2.0 * (e[..., :3] ** 2).sum(axis=(1, 2))))
            found[f"{workspace}, noise on {noisy}"] = row
    return found


def measured(
    rng: np.random.Generator, every: Mapping[str, Sides], count: int, size: int
) -> dict[str, Any]:
    """Table 1 on random subsets of real pairs, with E of the pairs left out beside it."""
    found: dict[str, Any] = {}
    for name, pairs in every.items():
        order = rng.permuted(np.tile(np.arange(len(pairs[0])), (count, 1)), axis=1)
        A, B = (side[order] for side in pairs)
        # what tells X at all: a subset whose poses turn about one axis has no E worth comparing
        good = ~solve_batch(A[:, :size], B[:, :size], "shah").degenerate
        found[name] = _of_subsets(A[good], B[good], size) | {"pairs": len(pairs[0])}
    return found


def _of_subsets(A: FloatArray, B: FloatArray, size: int) -> dict[str, Any]:
    inside = PairSets(A[:, :size], B[:, :size])
    mm = PairSets(in_mm(inside.A), in_mm(inside.B))
    left_out = PairSets(in_mm(A[:, size:]), in_mm(B[:, size:]))
    answers = {
        QUATERNION: METHODS["zhuang-literal"].run(mm, None),
        SAFE: METHODS["zhuang"].run(mm, None),
        DUAL: METHODS["li-dual-quaternion"].run(mm, None),
        KRONECKER: METHODS["li-kronecker-literal"].run(mm, None),
        SCALED: METHODS["li-kronecker"].run(mm, None),
    }
    found = {name: (answer.X, answer.Z) for name, answer in answers.items()}
    likeliest = METHODS["ml"].run(inside, None)
    found[FLOOR] = (in_mm(likeliest.X), in_mm(likeliest.Z))
    found[UNPROJECTED] = linear_minimum(mm)
    row = summary({name: sum_of_squares(mm, *found[name]) for name in METHODS_OF_TABLE})
    row["left_out_a_pose"] = {
        name: float(np.median(sum_of_squares(left_out, *found[name])) / left_out.N)
        for name in METHODS_OF_TABLE
    }
    return row


STYLES = {
    QUATERNION: (VERMILION, "-", "o"),
    SAFE: (VERMILION, ":", ""),
    DUAL: (BLUE, "-", "s"),
    DUAL_M: (BLUE, ":", ""),
    KRONECKER: (GREEN, "-", "^"),
    KRONECKER_M: (GREEN, ":", ""),
    SCALED: (PURPLE, "-", "D"),
    FLOOR: (BLACK, "--", ""),
}
"""Dotted: the same method in another form."""

OF_THE_PAPER = (QUATERNION, DUAL, KRONECKER)
LABELS = {"rotation_deg": "rotation: X + Z [deg]", "translation_mm": "translation: X + Z [mm]"}
"""By the columns of the tables."""

CASES = {"A": "(a) only A noisy", "B": "(b) only B noisy", "both": "(c) A and B noisy"}


Row = Mapping[str, Any]


def draw_medians(rows: Iterable[Row]) -> Figure:
    """Median of each error against the number of poses, with the 95 % interval as a band."""
    found = _by_panel(rows)
    workspaces = list(dict.fromkeys(workspace for workspace, *_ in found))
    figure = Figure(figsize=(8.6, 9.8), layout="constrained")
    panels = np.atleast_2d(
        figure.subplots(2 * len(workspaces), len(CASES), sharex=True, sharey="row")
    )
    for row, axes in enumerate(panels):
        workspace, (title, label) = workspaces[row // 2], list(LABELS.items())[row % 2]
        for panel, (noisy, case) in zip(axes, CASES.items(), strict=True):
            for name in SHOWN:
                of = found[workspace, noisy, name]
                colour, line, marker = STYLES[name]
                _band(panel, of, title, colour)
                panel.plot(
                    of["poses"], of[f"{title}_median"], line, marker=marker, color=colour, ms=4,
                    lw=1.3, label=name,
                )  # fmt: skip
            _dress(panel, of["poses"])
            panel.set_title(f"{case}, {workspace}", fontsize=9)
        axes[0].set_ylabel(label)
    _legend(figure, panels, 4)
    return figure


def draw_averages(rows: Iterable[Row], of_ten: Iterable[Row]) -> Figure:
    """The paper's three curves: averages of few problems, and median and mean of many."""
    found, few = _by_panel(rows), _by_panel(of_ten)
    workspace = next(iter(found))[0]
    figure = Figure(figsize=(8.6, 5.8), layout="constrained")
    panels = figure.subplots(2, len(CASES), sharex=True, sharey="row")
    for (title, label), axes in zip(LABELS.items(), panels, strict=True):
        for panel, (noisy, case) in zip(axes, CASES.items(), strict=True):
            for name in OF_THE_PAPER:
                own, many = few[workspace, noisy, name], found[workspace, noisy, name]
                colour, _, marker = STYLES[name]
                panel.plot(
                    own["poses"], own[f"{title}_mean"], "-", marker=marker, color=colour, ms=5,
                    label=f"{name}: average of 10",
                )  # fmt: skip
                _band(panel, many, title, colour)
                panel.plot(many["poses"], many[f"{title}_median"], "--", color=colour, lw=1.2)
                panel.plot(many["poses"], many[f"{title}_mean"], ":", color=colour, lw=1.6)
            _dress(panel, many["poses"])
            panel.set_title(case, fontsize=9)
        axes[0].set_ylabel(label)
    panels[0, 0].plot([], [], "--", color=GREY, label="median of many, 95 % interval")
    panels[0, 0].plot([], [], ":", color=GREY, label="mean of many")
    figure.suptitle(f"Poses: {workspace}", fontsize=11)
    _legend(figure, panels, 3)
    return figure


def _by_panel(rows: Iterable[Row]) -> dict[tuple[str, str, str], dict[str, list[float]]]:
    """Columns by workspace, noisy side and method, in the order of the numbers of poses."""
    found: dict[tuple[str, str, str], dict[str, list[float]]] = {}
    for row in rows:
        columns = found.setdefault((row["workspace"], row["noisy"], row["method"]), {})
        for title, value in row.items():
            columns.setdefault(title, []).append(value)
    return found


def _band(panel: Axes, of: Mapping[str, list[float]], title: str, colour: str) -> None:
    low, high = of[f"{title}_median_low"], of[f"{title}_median_high"]
    panel.fill_between(of["poses"], low, high, color=colour, alpha=0.2, lw=0)


def _dress(panel: Axes, poses: Sequence[float]) -> None:
    log_ticks(panel, poses)
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.grid(visible=True, axis="y", alpha=0.25)


def _legend(figure: Figure, panels: np.ndarray, columns: int) -> None:
    for panel in panels[-1]:
        panel.set_xlabel("number of poses")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)


SETTINGS = writing.settings_of(__file__)
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
