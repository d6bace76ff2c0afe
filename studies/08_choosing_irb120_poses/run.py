"""Run the study: ``posedesign study run choosing_irb120_poses``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.report.drawing import GREY, label_ends, log_y, set_answer
from posedesign.selection import Selection, largest_deviation, mean_deviation, select
from posedesign.study import Advance, Options
from studies import writing
from studies.choices import by_lot, draw_choices, range_text, spread, write
from studies.real_data import data_with

from .irb_bench import Bench, bench_of

D_OF_ARM = "D of the arm"


@dataclass(frozen=True, eq=False)
class Everything:
    """What all configurations together are worth, ``(36,)`` [m²] each."""

    left_out: FloatArray
    check_left_out: FloatArray
    """left_out, check_left_out: of each configuration, from a fit to the other 35: the points, the
    check points."""
    in_sample: FloatArray  # from the fit to all 36


def everything(bench: Bench) -> Everything:
    """All 36, and each left out."""
    others = ~np.eye(bench.count, dtype=bool)
    x = bench.fit(others)
    whole = bench.fit(np.ones((1, bench.count), dtype=bool))
    return Everything(
        np.diag(bench.squares(x)), np.diag(bench.check_squares(x, others)), bench.squares(whole)[0]
    )


def chosen_by(bench: Bench, n: int, criterion: str) -> Selection:
    """n configurations by a criterion, from nominal blocks alone."""
    given: Any = criterion
    interest: Sequence[int] | None = None
    if criterion == "I":
        given = mean_deviation(bench.functions)
    elif criterion == "G":
        given = largest_deviation(bench.functions)
    elif criterion == D_OF_ARM:
        given, interest = "D", bench.arm
    elif criterion in ("A", "E"):
        interest = bench.arm
    known = bench.known if len(bench.known) else None
    return select(bench.blocks, n, given, known=known, interest=interest, names=bench.model.names)


def figures(bench: Bench, all36: Everything, chosen: BoolArray) -> dict[str, FloatArray]:
    """What fits to the chosen ``(T, 36)`` leave at the poses not chosen, ``(T,)`` each [mm].

    Beside it stands what all 36 leave at the same poses: each predicted from the other 35, and in
    the fit that has seen it.
    """
    x = bench.fit(chosen)
    rest = ~chosen

    def rms_mm(squares: FloatArray) -> FloatArray:
        mean = (squares * rest).sum(axis=1) / rest.sum(axis=1)
        return np.asarray(1e3 * np.sqrt(mean))

    return {
        "error_mm": rms_mm(bench.squares(x)),
        "all_left_out_mm": rms_mm(all36.left_out),
        "all_in_sample_mm": rms_mm(all36.in_sample),
        "check_mm": rms_mm(bench.check_squares(x, chosen)),
        "check_all_left_out_mm": rms_mm(all36.check_left_out),
    }


def expected_mm(bench: Bench, chosen: IntArray) -> float:
    """Rms distance of new readings in all 36, of a fit to the chosen, by the noise model."""
    rows = np.concatenate([bench.blocks[chosen].reshape(-1, bench.model.p), bench.known])
    C = np.linalg.inv(rows.T @ rows)
    L = bench.functions
    spread = np.einsum("krp,pq,krq->k", L, C, L, optimize=True).mean()
    return float(1e3 * np.sqrt(bench.noise_m**2 + spread))


def row_of(
    bench: Bench, all36: Everything, n: int, criterion: str, lot: dict[str, FloatArray]
) -> dict[str, Any]:
    """Figures of the choice by one criterion, held against those by lot."""
    selection = chosen_by(bench, n, criterion)
    chosen = np.zeros((1, bench.count), dtype=bool)
    chosen[0, selection.indices] = True
    found = {name: float(value[0]) for name, value in figures(bench, all36, chosen).items()}
    row: dict[str, Any] = {
        "criterion": criterion,
        "poses": [int(i) + 1 for i in selection.indices],
        "efficiency": selection.efficiency,
        **found,
        "over_all_left_out": found["error_mm"] / found["all_left_out_mm"],
        "over_all_in_sample": found["error_mm"] / found["all_in_sample_mm"],
        "check_over_all": found["check_mm"] / found["check_all_left_out_mm"],
        "better_than": float(np.mean(lot["error_mm"] > found["error_mm"])),
        "better_than_over_all": float(
            np.mean(
                lot["error_mm"] / lot["all_left_out_mm"]
                > found["error_mm"] / found["all_left_out_mm"]
            )
        ),
        "expected_over_all": expected_mm(bench, selection.indices)
        / expected_mm(bench, np.arange(bench.count)),
    }
    if criterion == "I":
        best = np.hypot(1e3 * bench.noise_m, 1e3 * selection.bound)
        row["expected_bound"] = float(best / expected_mm(bench, np.arange(bench.count)))
    return row


def compare(
    bench: Bench,
    all36: Everything,
    n: int,
    criteria: Sequence[str],
    draws: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Choices of n by lot and by each criterion."""
    lot = figures(bench, all36, by_lot(bench.count, n, draws, rng))
    return {
        "n": n,
        "left_out_of_all_mm": float(1e3 * np.sqrt(all36.left_out.mean())),
        "by_lot": {
            "error_mm": spread(lot["error_mm"]),
            "over_all_left_out": spread(lot["error_mm"] / lot["all_left_out_mm"]),
            "check_mm": spread(lot["check_mm"]),
        },
        "chosen": [row_of(bench, all36, n, name, lot) for name in criteria],
    }


def draw(rows: Sequence[dict[str, Any]]) -> Figure:
    """Errors by the first model and by the one with C_G, and those of the first over all 36."""
    models = [rows[0], *(row for row in rows if "C_G" in errors_of(row["counts"][0]))][:2]
    figure = Figure(figsize=(11.5, 4.4), layout="constrained")
    *left, right = figure.subplots(1, 1 + len(models))
    for panel, row in zip(left, models, strict=True):
        if panel is not left[0]:
            panel.sharey(left[0])
        _by_count(panel, row, "error_mm", row["left_out_of_all_mm"])
        log_y(panel, "" if panel is not left[0] else "error at the poses not chosen, rms\n[mm]")
        panel.set_title(f"{row['model']} ({row['parameters']} parameters)", fontsize=10)
    _by_count(right, rows[0], "over_all_left_out", 1.0)
    right.set_ylabel("error over that of all 36 [-]")
    right.set_title(rows[0]["model"], fontsize=10)
    for panel in (*left, right):
        panel.set_xlabel("number of poses")
        label_ends(panel)
    of = rows[0]["counts"][len(rows[0]["counts"]) // 2]
    own = next(c for c in of["chosen"] if c["criterion"] == RECOMMENDED)
    set_answer(
        figure,
        f"{of['n']} of 36 poses chosen by {RECOMMENDED} leave {own['error_mm']:.3f} mm, less than "
        f"{100 * own['better_than']:.0f} % of choices by lot, but {own['over_all_left_out']:.2f} "
        "times what all 36 leave at the same poses",
        "Bars: 5 to 95 % of the choices by lot. All 36: each pose predicted from the others.",
    )
    return figure


def errors_of(of: Mapping[str, Any], name: str = "error_mm") -> dict[str, float]:
    """A figure of each choice, by its criterion."""
    return {c["criterion"]: c[name] for c in of["chosen"]}


def _by_count(panel: Axes, row: Mapping[str, Any], name: str, all_poses: float) -> None:
    counts = row["counts"]
    lots = [of["by_lot"][name]["quantiles"] for of in counts]
    chosen = [errors_of(of, name) for of in counts]
    draw_choices(panel, [f"{of['n']}" for of in counts], lots, chosen, joined=True)
    panel.axhline(all_poses, color=GREY, lw=1.2, ls="--", label="all 36")


SETTINGS = writing.settings_of(__file__)
RECOMMENDED = "I"
"""Criterion that is held to the bars: least error of the tool, in the mean over the pool."""

RECORDINGS = "identification/abb_irb120"
TABLE, FIGURE = "choosing_irb120_poses.csv", "choosing_irb120_poses"


def study(options: Options) -> dict[str, Any]:
    """How many of 36 poses does the IRB 120 need, and which?

    A trial is a choice by lot: so many each choice is held against.
    """
    draws = writing.trials_of(options, SETTINGS["draws"])
    rows = run(data_with(RECORDINGS), draws=draws, advance=options.advance)
    return write(rows, RECOMMENDED, options.out / TABLE, flat)


def plot(folder: Path) -> list[Path]:
    """What choices by lot and by each criterion leave at the poses not chosen."""
    return writing.save(draw(writing.read_figures(folder)["models"]), folder, FIGURE)


def run(
    data: Path,
    names: Sequence[str] | None = None,
    criteria: Sequence[str] | None = None,
    draws: int = SETTINGS["draws"],
    advance: Advance = lambda what, part: None,
) -> list[dict[str, Any]]:
    """Figures of each model, or of those that are named; by all of its criteria, or by some."""
    rows = []
    for row in writing.named(SETTINGS["model"], names, advance):
        bench = bench_of(data, row, SETTINGS)
        all36 = everything(bench)
        tried = [c for c in row["criteria"] if criteria is None or c in criteria]
        rows.append(
            {
                "model": row["name"],
                "parameters": bench.model.p,
                "left_out_of_all_mm": float(1e3 * np.sqrt(all36.left_out.mean())),
                "counts": [
                    compare(
                        bench, all36, n, tried, draws, np.random.default_rng([SETTINGS["seed"], n])
                    )
                    for n in SETTINGS["counts"]
                ],
            }
        )
    return rows


HEADS = ["model", "poses", "chosen by", "efficiency", "left [mm]", "over all 36: left out"]
HEADS += ["in sample", "expected", "better than", "check points [mm]"]
CHOSEN = (
    "{name} ({p})", "{n}", "{criterion}", "{efficiency:.2f}", "{error_mm:.3f}",
    "{over_all_left_out:.2f}", "{over_all_in_sample:.2f}", "{expected_over_all:.2f}",
    "{better_than:p} %", "{check_mm:.3f}",
)  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The table of the README: all criteria of the first model, the one recommended of others."""
    lines: list[str] = []
    for row in rows:
        for of in row["counts"]:
            lot = {name: own["quantiles"] for name, own in of["by_lot"].items()}
            by_lot = (
                "{name} ({p})", "{n}", "*lot: median (5 to 95 %)*", "", range_text("error_mm"),
                range_text("over_all_left_out", 2), "", "", "", range_text("check_mm"),
            )  # fmt: skip
            head = {"name": row["model"], "p": row["parameters"], "n": of["n"]}
            shown = [
                c | head for c in of["chosen"] if row is rows[0] or c["criterion"] == RECOMMENDED
            ]
            lines.append(writing.table([lot | head], by_lot, () if lines else HEADS))
            lines.append(writing.table(shown, CHOSEN))
    return "\n".join(lines)


def flat(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A line of the CSV for each choice, and one for the median by lot."""
    lines = []
    for row in rows:
        for of in row["counts"]:
            head = {"model": row["model"], "parameters": row["parameters"], "n": of["n"]}
            medians = {name: spread["quantiles"][2] for name, spread in of["by_lot"].items()}
            lines.append(head | {"chosen_by": "lot, median"} | medians)
            for c in of["chosen"]:
                own = {k: v for k, v in c.items() if k not in ("criterion", "poses")}
                poses = " ".join(str(k) for k in c["poses"])
                lines.append(head | {"chosen_by": c["criterion"], "poses": poses} | own)
    return lines


def markdown(found: Mapping[str, Any]) -> str:
    """What the README has of the key figures."""
    return table(found["models"])
