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

from calib.robot_world import METHODS, PairSets, residuals, solve_batch
from calib.se3 import FloatArray
from posedesign.report.drawing import STYLES, curve, label_ends, log_y, set_answer
from posedesign.study import Advance, Options
from studies import writing
from studies.drawing import log_ticks
from studies.intervals import median_interval
from studies.real_data import Sides, data_folder, real_pairs

from . import li_cases as li

UNPROJECTED = "Kronecker, mm, not orthonormal"
METHODS_OF_TABLE = (li.QUATERNION, li.SAFE, li.DUAL, li.KRONECKER, UNPROJECTED, li.SCALED, li.FLOOR)


def table_row(data: li.Measured) -> dict[str, FloatArray]:
    """E ``(T,)`` [mm²] of every method, rotations and translations in one norm."""
    answers = {name: li.SOLVERS[name](data) for name in METHODS_OF_TABLE if name != UNPROJECTED}
    found = {name: (li.in_mm(X), li.in_mm(Z)) for name, (X, Z) in answers.items()}
    found[UNPROJECTED] = li.linear_minimum(data.millimetres)
    return {name: li.sum_of_squares(data.millimetres, *found[name]) for name in METHODS_OF_TABLE}


def summary(E: dict[str, FloatArray]) -> dict[str, Any]:
    """Medians, and how often the three methods stand as in the paper."""
    q, d, k = (E[name] for name in (li.QUATERNION, li.DUAL, li.KRONECKER))
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
            data = li.draw(rng, trials, poses, noisy, cone_deg, settings)
            row = summary(table_row(data))
            X, Z = (li.in_mm(T) for T in li.SOLVERS[li.SAFE](data))
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
    mm = PairSets(li.in_mm(inside.A), li.in_mm(inside.B))
    left_out = PairSets(li.in_mm(A[:, size:]), li.in_mm(B[:, size:]))
    answers = {
        li.QUATERNION: METHODS["zhuang-literal"].run(mm, None),
        li.SAFE: METHODS["zhuang"].run(mm, None),
        li.DUAL: METHODS["li-dual-quaternion"].run(mm, None),
        li.KRONECKER: METHODS["li-kronecker-literal"].run(mm, None),
        li.SCALED: METHODS["li-kronecker"].run(mm, None),
    }
    found = {name: (answer.X, answer.Z) for name, answer in answers.items()}
    likeliest = METHODS["ml"].run(inside, None)
    found[li.FLOOR] = (li.in_mm(likeliest.X), li.in_mm(likeliest.Z))
    found[UNPROJECTED] = li.linear_minimum(mm)
    row = summary({name: li.sum_of_squares(mm, *found[name]) for name in METHODS_OF_TABLE})
    row["left_out_a_pose"] = {
        name: float(np.median(li.sum_of_squares(left_out, *found[name])) / left_out.N)
        for name in METHODS_OF_TABLE
    }
    return row


OF_THE_PAPER = (li.QUATERNION, li.DUAL, li.KRONECKER)
AS = {
    li.QUATERNION: "zhuang",
    li.DUAL: "li-dual-quaternion",
    li.DUAL_M: "li-dual-quaternion",
    li.KRONECKER: "li-kronecker",
    li.KRONECKER_M: "li-kronecker",
    li.FLOOR: "ml",
}
"""Methods whose style each has."""

UNITS = {"mm": (li.DUAL, li.KRONECKER), "m": (li.DUAL_M, li.KRONECKER_M)}
"""Methods that the unit of the lengths matters to."""

LABELS = {"rotation_deg": "rotation: X + Z, median\n[deg]"}
LABELS["translation_mm"] = "translation: X + Z, median\n[mm]"
"""By the columns of the tables."""

NOISY = "both"
"""Side of the noise that is drawn."""

MANY = 10
"""Poses from which on methods are counted against each other."""

Row = Mapping[str, Any]
Panels = dict[tuple[str, str, str], dict[str, list[float]]]


def draw_medians(rows: Iterable[Row]) -> Figure:
    """Median of each error against the number of poses, with lengths in mm and in metres."""
    found = _by_panel(rows)
    workspace = next(iter(found))[0]
    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    for (title, label), axes in zip(LABELS.items(), panels, strict=True):
        for panel, (unit, methods) in zip(axes, UNITS.items(), strict=True):
            for name in (li.QUATERNION, *methods, li.FLOOR):
                of, style = found[workspace, NOISY, name], STYLES[AS[name]]
                ends = of[f"{title}_median_low"], of[f"{title}_median_high"]
                curve(panel, of["poses"], of[f"{title}_median"], style, name, ends=ends)
            panel.set_title(f"lengths in {unit}", fontsize=10)
        _dress(axes, of["poses"], label)
    _finish(panels)
    wins, best, cells, every = _counts(found)
    set_answer(
        figure,
        f"From {MANY} poses on the Kronecker form beats the other two of the paper in "
        f"{wins['mm']} of {cells} medians in mm, in {wins['m']} in metres; maximum likelihood is "
        f"best in {best} of {every}",
        f"Shown: noise on A and B, poses of {workspace}. Bars: 95 % intervals of the medians.",
    )
    return figure


def _counts(found: Panels) -> tuple[dict[str, int], int, int, int]:
    """Medians in which Kronecker is before both others, and maximum likelihood before all.

    Kronecker by unit and of many poses; then the number of such medians, and of all.
    """
    wins, best, cells, every = dict.fromkeys(UNITS, 0), 0, 0, 0
    for workspace, noisy in dict.fromkeys(key[:2] for key in found):
        for title in LABELS:
            of = {n: np.array(found[workspace, noisy, n][f"{title}_median"]) for n in li.SHOWN}
            many = np.array(found[workspace, noisy, li.FLOOR]["poses"]) >= MANY
            for unit, (dual, kronecker) in UNITS.items():
                less = np.minimum(of[dual], of[li.QUATERNION])
                wins[unit] += int((of[kronecker] < less)[many].sum())
            best += int((of[li.FLOOR] <= np.min(list(of.values()), axis=0)).sum())
            cells, every = cells + int(many.sum()), every + len(many)
    return wins, best, cells, every


def draw_averages(rows: Iterable[Row], of_ten: Iterable[Row], said: Iterable[Row]) -> Figure:
    """The paper's three curves: averages of few problems beside the median of many."""
    found, few = _by_panel(rows), _by_panel(of_ten)
    workspace = next(iter(found))[0]
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for panel, (title, label) in zip(panels, LABELS.items(), strict=True):
        for name in OF_THE_PAPER:
            own, many = few[workspace, NOISY, name], found[workspace, NOISY, name]
            style = STYLES[AS[name]]
            curve(panel, own["poses"], own[f"{title}_mean"], style._replace(line="-"), name)
            ends = many[f"{title}_median_low"], many[f"{title}_median_high"]
            panel.fill_between(many["poses"], *ends, color=style.colour, alpha=0.25, lw=0)
            panel.plot(many["poses"], many[f"{title}_median"], ":", color=style.colour)
        _dress([panel], many["poses"], label.replace(", median", ""))
    _finish(panels[None])
    rows = [row for row in said if row["poses"] >= SETTINGS["table_1"]["poses"]]
    shares = {row["error"]: row for row in rows[::-1] if row["poses"] == rows[0]["poses"]}
    of = " and ".join(
        f"{100 * row['least']:.0f} to {100 * row['most']:.0f} % in {error.partition('_')[0]}"
        for error, row in sorted(shares.items())
    )
    set_answer(
        figure,
        f"An average of ten tells little: with {rows[0]['poses']} poses so many of its repetitions "
        f"have the paper's order: {of}",
        "Marks: averages of ten. Dotted: medians of many with their 95 % interval. Noise on A and "
        f"B, poses of {workspace}.",
    )
    return figure


def _by_panel(rows: Iterable[Row]) -> Panels:
    """Columns by workspace, noisy side and method, in the order of the numbers of poses."""
    found: Panels = {}
    for row in rows:
        columns = found.setdefault((row["workspace"], row["noisy"], row["method"]), {})
        for title, value in row.items():
            columns.setdefault(title, []).append(value)
    return found


def _dress(axes: Iterable[Axes], poses: Sequence[float], label: str) -> None:
    """Shared axes; the first panel says what is along y."""
    for k, panel in enumerate(axes):
        log_ticks(panel, poses)
        log_y(panel, "" if k else label)


def _finish(panels: np.ndarray) -> None:
    for panel in panels.flat:
        label_ends(panel)
    for panel in panels[-1]:
        panel.set_xlabel("number of poses, log scale")


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
            | {title: row[f"{title}_median"] for title in li.MEASURES}
            for row in rows
            if row["method"] in li.SHOWN
        ],
        **li.claims(found, few),
        "table_1": table_1(trials, options.advance),
    }
    tables = {f"{MEDIANS}.csv": rows, f"{AVERAGES}.csv": averages(paper)}
    return writing.write_rounded(options.out, said, DIGITS, tables)


def plot(folder: Path) -> list[Path]:
    """Medians with their intervals, and the paper's own averages."""
    rows, of_ten = (writing.read_rows(folder, f"{name}.csv") for name in (MEDIANS, AVERAGES))
    drawn = writing.save(draw_medians(rows), folder, MEDIANS)
    few = draw_averages(rows, of_ten, writing.read_figures(folder)["averages"])
    return drawn + writing.save(few, folder, AVERAGES)


def cells(poses: Iterable[int] | None = None) -> list[li.Cell]:
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
) -> li.Found:
    """Errors of every method in every cell; each cell has random numbers of its own."""
    found = {}
    every = cells(SETTINGS["poses"])
    said = "{0[0]}, noise on {0[1]}, {0[2]} poses".format
    for cell in writing.parts_of(cells(poses), advance, said):
        workspace, noisy, n = cell
        rng = np.random.default_rng([SETTINGS["seed"], stream, every.index(cell)])
        cone_deg = SETTINGS["workspaces"][workspace]
        data = li.draw(rng, trials or SETTINGS["trials"], n, noisy, cone_deg, SETTINGS)
        found[cell] = {name: li.errors(data, solve(data)) for name, solve in li.SOLVERS.items()}
    return found


def table(found: li.Found) -> list[dict[str, Any]]:
    """A row for each cell and method: medians with intervals, means, what 95 % stay below."""
    rows = []
    for (workspace, noisy, n), methods in found.items():
        for name, values in methods.items():
            row: dict[str, Any] = {"workspace": workspace, "noisy": noisy, "poses": n}
            row["method"] = name
            for title, column in zip(li.MEASURES, values.T, strict=True):
                low, high = median_interval(column)
                row[f"{title}_median"] = np.median(column)
                row[f"{title}_median_low"], row[f"{title}_median_high"] = low, high
                row[f"{title}_mean"] = column.mean()
                row[f"{title}_95"] = np.quantile(column, 0.95)
            rows.append(row)
    return rows


def averages(paper: li.Found) -> list[dict[str, Any]]:
    """A row for each cell and method of the paper: means over its few problems."""
    return [
        {"workspace": workspace, "noisy": noisy, "poses": n, "method": name}
        | {f"{t}_mean": m for t, m in zip(li.MEASURES, methods[name].mean(axis=0), strict=True)}
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
