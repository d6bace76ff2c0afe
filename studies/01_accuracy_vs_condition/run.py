"""Run the study: ``posedesign study run accuracy_vs_condition``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.chance import spread_interval
from calib.se3 import FloatArray
from posedesign.report.drawing import (
    CONDITION,
    STYLES,
    condition_axis,
    curve,
    label_ends,
    log_y,
    set_answer,
)
from posedesign.study import Options, Task, Workers, call, each
from studies import writing
from studies.writing import save, trials_by_grid, trials_of, write_figures, write_rows

# what is simulated, tables and figures need is imported where they are made: workers do not wait
# for the one, nor the process that shares the work for the other
if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

OFFSET = "offset_deg"
TOOL = "tool_mm"


def conditions(settings: Mapping[str, Any], workers: Workers) -> list[dict[str, Any]]:
    """One for each preset and threshold, with the poses that the loop returns for it."""
    given = [{**settings, "preset": preset} for preset in settings["presets"]]
    found = each(partial(call, HERE.name, "conditions_of"), given, workers)
    return [condition for of_preset in found for condition in of_preset]


def conditions_of(task: Task) -> list[dict[str, Any]]:
    """The conditions of a preset."""
    from .trials import conditions_of as found_in

    return found_in(task)


def simulate(task: Task) -> dict[str, Any]:
    """Errors of the trials of a task, a column for each estimator and quantity."""
    from .trials import simulate as simulated

    return simulated(task)


QUANTITIES = ("x_deg", "x_mm", "z_deg", "z_mm")
"""Rotation and translation of X, the camera on the flange, and of Z, the target in the base."""

_MOST_REFUSED = 0.5
"""Part of the answers that may be missing for a median to be one of the rest."""


def summary(trials: pd.DataFrame, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each pose set: spread of the offset, medians and 5 to 95 % of errors."""
    rows = []
    for (preset, threshold), part in trials.groupby(["preset", "threshold"], sort=False):
        first = part.iloc[0]
        row: dict[str, Any] = {"preset": preset, "threshold": threshold}
        row |= {key: first[key].item() for key in ("c_g", "d_deg", "poses")}
        row |= {"trials": len(part), "predicted_deg": first[f"predicted_{OFFSET}"].item()}
        offset = part[OFFSET].to_numpy()
        spread = float(np.nanstd(offset, ddof=1))
        low, high = spread_interval(spread, int(np.isfinite(offset).sum()))
        row |= {"spread_deg": spread, "spread_low_deg": low, "spread_high_deg": high}
        row |= _quantiles(TOOL, part[TOOL].to_numpy())
        for solver in solvers:
            refused = float(np.isnan(part[f"x_deg {solver}"]).mean())
            row[f"refused {solver}"] = refused
            for quantity in QUANTITIES:
                name = f"{quantity} {solver}"
                row |= _quantiles(name, part[name].to_numpy(), refused)
        rows.append(row)
    return rows


def _quantiles(name: str, values: FloatArray, refused: float = 0.0) -> dict[str, float | None]:
    good = values[np.isfinite(values)]
    if refused > _MOST_REFUSED or not len(good):
        return {name: None, f"{name} p5": None, f"{name} p95": None}
    low, middle, high = np.quantile(good, [0.05, 0.5, 0.95])
    return {name: float(middle), f"{name} p5": float(low), f"{name} p95": float(high)}


def relations(rows: pd.DataFrame, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """How each error follows C_G on each arm: slope of the logarithms and rank correlation.

    Both with 95 % intervals over the pose sets: by Student's t for the slope, by Fisher's z with
    the variance of [BonettWright2000]_ for the rank correlation.

    References
    ----------
    .. [BonettWright2000] D. G. Bonett, T. A. Wright, Sample size requirements for estimating
       Pearson, Kendall and Spearman correlations, Psychometrika 65.
    """
    from scipy.stats import linregress, spearmanr
    from scipy.stats import t as student

    found = []
    for preset, part in rows.groupby("preset", sort=False):
        for estimator, quantity, column in _columns(solvers):
            c_g, error = part["c_g"].to_numpy(), part[column].to_numpy(dtype=float)
            good = np.isfinite(error)
            if good.sum() < 4:
                continue
            line = linregress(np.log10(c_g[good]), np.log10(error[good]))
            half = float(student.ppf(0.975, good.sum() - 2) * line.stderr)
            rank = float(spearmanr(c_g[good], error[good]).statistic)
            low, high = _rank_interval(rank, int(good.sum()))
            found.append(
                {
                    "preset": preset,
                    "estimator": estimator,
                    "quantity": quantity,
                    "sets": int(good.sum()),
                    "slope": float(line.slope),
                    "slope_low": float(line.slope) - half,
                    "slope_high": float(line.slope) + half,
                    "rank": rank,
                    "rank_low": low,
                    "rank_high": high,
                    "first": float(error[good][0]),
                    "last": float(error[good][-1]),
                }
            )
    return found


def _columns(solvers: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    yield "identification", "spread of the offset [deg]", "spread_deg"
    yield "identification", "tool point elsewhere [mm]", TOOL
    for solver in solvers:
        yield solver, "X rotation [deg]", f"x_deg {solver}"
        yield solver, "X translation [mm]", f"x_mm {solver}"


def _rank_interval(rank: float, count: int) -> tuple[float, float]:
    from scipy.stats import norm as normal

    if abs(rank) >= 1.0 or count < 4:
        return rank, rank  # Fisher's z has no interval there
    half = normal.ppf(0.975) * np.sqrt((1.0 + rank**2 / 2.0) / (count - 3))
    low, high = np.tanh(np.arctanh(rank) + np.array([-half, half]))
    return float(low), float(high)


def draw_identification(rows: pd.DataFrame) -> Figure:
    """Spread of the offset and error of the tool point against C_G, a line for each arm."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.8), layout="constrained")
    left, right = panels = figure.subplots(1, 2)
    gains, falling = [], 0
    for preset, part in rows.groupby("preset", sort=False):
        style, c_g, spread, off = STYLES[preset], part["c_g"], part["spread_deg"], part[TOOL]
        ends = part["spread_low_deg"], part["spread_high_deg"]
        curve(left, c_g, spread, style._replace(line=""), preset, ends=ends)
        left.plot(c_g, part["predicted_deg"], style.line, color=style.colour, lw=1.3)
        curve(right, c_g, off, style, preset, ends=(part[f"{TOOL} p5"], part[f"{TOOL} p95"]))
        falling += spread.is_monotonic_decreasing and off.is_monotonic_decreasing
        gains.append(off.iloc[0] / off.iloc[-1])
    log_y(left, "standard deviation of the J2 offset\n[deg]")
    left.set_title("with its 95 % interval; lines: predicted", fontsize=10)
    log_y(right, "error of the tool point elsewhere, rms\n[mm]")
    right.set_title("median, bars from 5 to 95 % of the trials", fontsize=10)
    for panel in panels:
        condition_axis(panel)
        label_ends(panel)
    set_answer(
        figure,
        f"From each pose set to the next better one standard deviation and error fall on {falling} "
        f"of {len(gains)} arms: the tool point is {min(gains):.0f} to {max(gains):.0f} times more "
        "accurate with the best set than with the worst, where noise is all there is",
    )
    return figure


QUATERNIONS = ("zhuang", "dornaika-horaud", "hirsh")
"""Solvers with nearly the same answers: one line, as wide as they differ."""


def draw_solvers(rows: pd.DataFrame, solvers: Sequence[str]) -> Figure:
    """Error of X against C_G, a panel for each arm, a line for each solver that differs."""
    from matplotlib.figure import Figure

    presets = list(dict.fromkeys(rows["preset"]))
    figure = Figure(figsize=(3.0 * len(presets) + 1.0, 6.4), layout="constrained")
    axes = figure.subplots(2, len(presets), sharex=True, sharey="row", squeeze=False)
    groups = [[name] for name in solvers if name not in QUATERNIONS]
    groups.append([name for name in QUATERNIONS if name in solvers])
    for k, preset in enumerate(presets):
        part = rows[rows["preset"] == preset]
        for panel, quantity in zip(axes[:, k], ("x_mm", "x_deg"), strict=True):
            for group in groups:
                style, c_g = STYLES[group[0]], part["c_g"]
                of = part[[f"{quantity} {name}" for name in group]].astype(float)
                ends = of.min(axis=1), of.max(axis=1)
                if group == ["ml"]:
                    ends = part[f"{quantity} ml p5"], part[f"{quantity} ml p95"]
                panel.fill_between(c_g, *ends, color=style.colour, alpha=0.15, lw=0)
                curve(panel, c_g, of.median(axis=1), style, ", ".join(group))
        axes[0, k].set_title(preset, fontsize=10)
    for panel in axes.flat:
        log_y(panel)
    condition_axis(axes[0, 0], label=False)
    figure.supxlabel(f"{CONDITION} (medians; grey: 5 to 95 % of the trials by ml)", fontsize=10)
    log_y(axes[0, 0], "error of X, translation\n[mm]")
    log_y(axes[1, 0], "error of X, rotation\n[deg]")
    for panel in axes[:, -1]:
        label_ends(panel)
    set_answer(figure, _answer_of_solvers(rows, solvers))
    return figure


def _answer_of_solvers(rows: pd.DataFrame, solvers: Sequence[str]) -> str:
    """How many solvers gain by better poses, and how far the worst are behind the likeliest X."""
    times = {}
    for quantity in ("x_mm", "x_deg"):
        errors = rows[[f"{quantity} {name}" for name in solvers]].astype(float)
        behind = errors.div(errors[f"{quantity} ml"], axis=0).max()
        times[quantity] = f"{behind.max():.1f} times by {str(behind.idxmax()).partition(' ')[2]}"
    translation = rows.groupby("preset")[[f"x_mm {name}" for name in solvers]]
    gaining = int((translation.last() < translation.first()).all().sum())
    return (
        f"By {gaining} of {len(solvers)} solvers X is more accurate with better poses on every "
        f"arm. Over that of ml the error is up to {times['x_mm']} in translation, up to "
        f"{times['x_deg']} in rotation"
    )


HERE = Path(__file__).parent
SETTINGS = writing.settings_of(__file__)
WORKERS = True
"""Its tasks may be shared."""

DIGITS = 5
"""Significant digits of key figures: more than the sampling leaves."""

SETS, RELATIONS = "accuracy_vs_condition.csv", "relations.csv"


def study(options: Options) -> dict[str, Any]:
    """What does a lower condition number buy? A trial is one data set of each pose set."""
    import pandas as pd

    settings = SETTINGS | {"trials": trials_of(options, SETTINGS["trials"])}
    options.advance("planning", 0.0)
    planned = conditions(settings, options.workers)
    trials = trials_by_grid(options, HERE.name, settings, planned)
    rows = summary(trials, settings["solvers"])
    write_rows(options.out, SETS, rows)
    related = relations(pd.DataFrame(rows), settings["solvers"])
    write_rows(options.out, RELATIONS, related)
    figures = {"trials": settings["trials"], "relations": writing.rounded(related, DIGITS)}
    write_figures(options.out, figures)
    return figures


def plot(folder: Path, workers: Workers | None = None) -> list[Path]:
    """Draw what the tables of a folder say, by workers of this machine if there are any."""
    asked = [{"folder": str(folder), "figure": name} for name in FIGURES]
    here = Workers(1 if workers is None else workers.jobs)
    drawn = each(partial(call, HERE.name, "draw"), asked, here)
    return [path for paths in drawn for path in paths]


def draw(task: Task) -> list[Path]:
    """Draw one of the figures."""
    import pandas as pd

    folder, name = Path(task.condition["folder"]), task.condition["figure"]
    return save(FIGURES[name](pd.read_csv(folder / SETS)), folder, name)


FIGURES = {
    "accuracy_vs_condition": draw_identification,
    "solvers_vs_condition": lambda rows: draw_solvers(rows, SETTINGS["solvers"]),
}
