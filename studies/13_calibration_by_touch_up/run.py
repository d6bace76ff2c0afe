"""Run the study: ``posedesign study run calibration_by_touch_up``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from posedesign.study import Options
from studies import writing
from studies.drawing import BLUE, GREEN, GREY, PURPLE, VERMILION
from studies.writing import table_line

from . import touch_claims as claims
from .touch_bench import Bench, PoseSet, pose_set
from .touch_plate import (
    DISTANCES,
    PAPER,
    causes,
    drawn_ratios,
    every,
    plate_rows,
    rows,
    through_pictures,
)


def tables(said: Mapping[str, Any]) -> list[list[str]]:
    """The tables that people read, line by line: variation, causes, plate, arms drawn, verdicts."""
    shown = said["arms"]["deflecting"]
    return [
        variation_table(shown["variation"], shown["claims"]),
        causes_table(said["causes"]),
        plate_table({arm: part["plate"] for arm, part in said["arms"].items()}),
        arms_table(said["robots"]),
        verdicts(said),
    ]


def variation_table(rows: list[Mapping[str, Any]], found: Mapping[str, Any]) -> list[str]:
    """Ten data sets and all of them, a line for each pose set."""
    lines = []
    ratios = found["view line over touch-up"]
    for ratio in ratios:
        own = {row["estimator"]: row for row in rows if row["d_deg"] == ratio["d_deg"]}
        cells = [f"{ratio['d_deg']:g}", power(ratio["c_g"])]
        for name in ("touch-up", "touch-up, weighted", "view line", "touch-up, size left out"):
            row = own[name]
            if name != "touch-up, size left out":
                ends = f"{digits(row['ten_low_deg'])} to {digits(row['ten_high_deg'])}"
                cells.append(f"{digits(row['ten_std_deg'])} ({ends})")
            cells.append(digits(row["many_std_deg"]))
        cells.append(f"{ratio['ratio']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})")
        cells += [digits(own[name]["error_deg"]) for name in ("touch-up", "touch-up, weighted")]
        lines.append(table_line(cells))
    return lines


def causes_table(rows: list[Mapping[str, Any]]) -> list[str]:
    """Errors with one cause away, a line for each pose set and cause."""
    lines = []
    for row in rows:
        errors = [digits(value) for key, value in row.items() if key.endswith("error_deg")]
        cells = [f"{row['d_deg']:g}", power(row["c_g"]), row["away"], *errors]
        lines.append(table_line(cells))
    return lines


def plate_table(plates: Mapping[str, Any]) -> list[str]:
    """Distances before and after, the paper's way and weighted, a line for each pose set."""
    first = next(iter(plates.values()))
    before = [f"{plate['before']['worst_mm']:.3f}" for plate in plates.values() for _ in range(2)]
    distances = (100, 200, 300, 400)
    cells = ["", "before", *(f"{first['before'][f'd{d}_mm']:.3f}" for d in distances), *before]
    lines = [table_line(cells)]
    for row in (r for r in first["rows"] if r["estimator"] == "touch-up"):
        cells = [f"{row['d_deg']:g}", power(row["c_g"])]
        cells += [f"{row[f'd{d}_mm']:.3f}" for d in distances]
        for plate in plates.values():
            for name in ("touch-up", "touch-up, weighted"):
                (own,) = (
                    r for r in plate["rows"] if (r["estimator"], r["d_deg"]) == (name, row["d_deg"])
                )
                cells.append(f"{own['worst_mm']:.3f} ({own['ratio']:.2f})")
        lines.append(table_line(cells))
    return lines


def arms_table(robots: Mapping[str, Any]) -> list[str]:
    """Arms drawn at random: ratio and shares, a line for each pose set."""
    names = [name for name in robots if name != "count"]
    lines = []
    for k, first in enumerate(robots[names[0]]["rows"]):
        cells = [f"{first['d_deg']:g}", power(first["c_g"])]
        for name in names:
            row = robots[name]["rows"][k]
            cells.append(f"{row['ratio']:.2f} ({row['ratio_low']:.2f} to {row['ratio_high']:.2f})")
            cells += [percent(row["below_half"]), percent(row["worse_than_before"])]
        lines.append(table_line(cells))
    return lines


def verdicts(said: Mapping[str, Any]) -> list[str]:
    """A line for each claim of the paper."""
    arm, robots = said["arms"]["deflecting"], said["robots"]
    found, plate = arm["claims"], arm["claims"]["plate"]
    rigid = said["arms"]["rigid"]["claims"]["plate"]["touch-up"]
    paper, line = (found["falls"][name] for name in ("touch-up", "view line"))
    lines = []
    for figure, one in (("9: touch-up", paper), ("10: view line", line)):
        verdict = "reproduced" if one["rho_low"] > 0.8 else "not reproduced"
        lines.append(
            f"| Figure {figure}: small C_G, stable identification | {verdict} | rank correlation "
            f"{one['rho_median']:.2f} ({one['rho_low']:.2f} to {one['rho_high']:.2f}); of four "
            f"sets at random the outer two are in order in {100 * one['four_ends_in_order']:.1f} "
            f"%, all four in {100 * one['four_in_order']:.0f} % |"
        )
    for key, what in (
        ("view line over touch-up", "unweighted, as in the paper"),
        ("view line over touch-up, weighted", "touch-up weighted"),
    ):
        lines.append(_better(found[key], what))
    own = robots["touch-up"]
    beats = percent(own["smallest_beats_largest_c_g"])
    lines.append(
        "| Figure 11: C_G is an adequate index of accuracy | "
        f"{_index_verdict(own, rigid)} | rank correlation {plate['touch-up']['rho']:.2f} on the "
        f"arm shown, {own['rho_median']:.2f} ({own['rho_low']:.2f} to {own['rho_high']:.2f}) over "
        f"{robots['count']} arms; smallest C_G better than largest on {beats} %, best of all on "
        f"{percent(own['smallest_c_g_is_best'])} %; rigid arm: after over before falls from "
        f"{rigid['ratio_at_largest_c_g']:.2f} to {rigid['ratio_at_smallest_c_g']:.2f} |"
    )
    half = own["rows"][-1]["below_half"]
    mine = plate["touch-up"]
    verdict = "reproduced" if half["low"] > 0.5 else "under conditions"
    lines.append(
        f"| Figure 11: below 1/2 with the smallest C_G | {verdict} | arm shown: "
        f"{mine['ratio_at_smallest_c_g']:.2f} there, {mine['best_ratio']:.2f} at best (D = "
        f"{mine['best_d_deg']:g} deg), below 1/2 with {mine['sets_below_half']} of {mine['sets']} "
        f"sets; {percent(half)} % of arms at the smallest C_G; rigid arm: "
        f"{rigid['ratio_at_smallest_c_g']:.2f} |"
    )
    return lines


def _better(rows: list[Mapping[str, Any]], what: str) -> str:
    """Where touch-up varies less than the view line, and where more."""
    less = [row for row in rows if row["low"] > 1.0]
    more = [row for row in rows if row["high"] < 1.0]
    verdict = "reproduced" if not more else "under conditions" if less else "not reproduced"
    said = [f"view line over touch-up {rows[0]['ratio']:.2f} at C_G = {power(rows[0]['c_g'])}"]
    if less:
        said.append(f"touch-up varies less from {power(less[-1]['c_g'])} up")
    if more:
        said.append(f"more from {power(more[0]['c_g'])} down ({rows[-1]['ratio']:.2f} at the end)")
    return f"| Figure 10: improved by touch-up, {what} | {verdict} | {'; '.join(said)} |"


def _index_verdict(own: Mapping[str, Any], rigid: Mapping[str, Any]) -> str:
    """Of arms that deflect, and of one that is as the model has it."""
    if own["rho_low"] > 0.0:
        return "reproduced"
    falls = rigid["ratio_at_smallest_c_g"] < 0.5 * rigid["ratio_at_largest_c_g"]
    return "only where the model is right" if falls else "not reproduced"


def power(value: float) -> str:
    """Three digits and a power of ten."""
    return f"{value:.2e}".replace("e+0", "e")


def digits(value: float) -> str:
    """Two digits, or three where it begins with a one."""
    shown = f"{value:.3g}" if f"{abs(value):.1e}"[0] == "1" else f"{value:.2g}"
    return shown.replace("0.", ".", 1) if abs(value) < 1.0 else shown


def percent(share: Mapping[str, float]) -> str:
    """A share with its 95 % interval."""
    low, middle, high = (100.0 * share[key] for key in ("low", "share", "high"))
    return f"{middle:.0f} ({low:.0f} to {high:.0f})"


STYLES = {
    "touch-up": (BLUE, "o"),
    "touch-up, weighted": (VERMILION, "s"),
    "view line": (GREEN, "^"),
    "touch-up, size left out": (PURPLE, "D"),
}
"""Colour and marker of each estimator: told apart without colours, too."""

PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
"""Numbers on an axis as people write them."""

ASIDE = 1.06
"""Factor by which marks at one C_G are moved aside."""

PANELS = (
    ("touch-up (Figure 9)", ("touch-up", "touch-up, weighted")),
    ("view line only (Figure 10)", ("view line", "touch-up, size left out")),
)


def draw_variation(rows: Sequence[Mapping[str, Any]], ten: Sequence[Mapping[str, Any]]) -> Figure:
    """Offsets of ten data sets about their mean, and their standard deviations, against C_G."""
    figure = Figure(figsize=(12.0, 8.4), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, (title, names) in enumerate(PANELS):
        above, below = axes[0, column], axes[1, column]
        above.set_title(title, fontsize=11)
        for k, name in enumerate(names):
            colour, mark = STYLES[name]
            aside = ASIDE if k else 1.0 / ASIDE
            own = [row for row in ten if row["estimator"] == name]
            x = [aside * row["c_g"] for row in own]
            above.plot(
                x, [row["about_mean_deg"] for row in own], mark, color=colour, ms=4, mfc="none"
            )
            _deviation(below, [row for row in rows if row["estimator"] == name], name, aside)
        above.axhline(0.0, color=GREY, lw=0.8)
        above.set_yscale("symlog", linthresh=0.01)
        above.grid(True, which="both", alpha=0.25)
        below.set_xlabel("condition number C_G of the pose set, 27 poses each")
    paper = [row for row in rows if row["estimator"] == "touch-up"]
    x, y = ([row[key] for row in paper] for key in ("c_g", "many_std_deg"))
    axes[1, 1].plot(x, y, color=BLUE, lw=1.2, ls="--", label="touch-up, from the left")
    axes[0, 0].set_ylabel("offset of joint 2, ten data sets, about their mean [deg]")
    axes[1, 0].set_ylabel("standard deviation of the offset of joint 2 [deg]")
    axes[1, 0].set_xscale("log")
    axes[1, 0].set_yscale("log")
    axes[1, 0].plot(
        [], [], color=GREY, lw=6, alpha=0.3, label=f"{rows[0]['data_sets']} data sets, 95 %"
    )
    axes[1, 0].plot([], [], color=GREY, ls=":", lw=1.3, label="predicted from the noise")
    for panel in axes[1]:
        panel.legend(fontsize=8, loc="upper left")
    axes[1, 0].yaxis.set_major_formatter(PLAIN)
    axes[0, 0].yaxis.set_major_formatter(PLAIN)
    return figure


def _deviation(panel: Axes, rows: Sequence[Mapping[str, Any]], name: str, aside: float) -> None:
    colour, mark = STYLES[name]
    x = np.array([row["c_g"] for row in rows])
    low, middle, high = (
        np.array([row[f"ten_{key}_deg"] for row in rows]) for key in ("low", "std", "high")
    )
    panel.errorbar(
        aside * x,
        middle,
        [middle - low, high - middle],
        fmt=mark,
        color=colour,
        ms=5,
        lw=1,
        capsize=2,
        label=f"{name}, ten data sets, 95 %",
    )
    ends = [[row[f"many_{key}_deg"] for row in rows] for key in ("low", "high")]
    panel.fill_between(x, *ends, color=colour, alpha=0.3, lw=0)
    panel.plot(x, [row["predicted_deg"] for row in rows], color=colour, ls=":", lw=1.3)
    panel.grid(True, which="both", alpha=0.25)


def draw_plate(arms: Mapping[str, Any], robots: Mapping[str, Any], estimator: str) -> Figure:
    """Worst distance errors of the arms shown, and of many arms in parts of those before."""
    figure = Figure(figsize=(15.0, 5.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3, sharex=True)
    left.sharey(middle)
    for panel, (arm, part) in zip((left, middle), arms.items(), strict=True):
        _distances(panel, part["plate"], estimator)
        panel.set_title(f"{arm} arm, {estimator}", fontsize=11)
        panel.set_ylabel("worst error of a distance on the plate [mm]")
    for name in (key for key in robots if key in STYLES):
        colour, mark = STYLES[name]
        rows = robots[name]["rows"]
        x = [row["c_g"] for row in rows]
        ends = [[row[f"ratio_{key}"] for row in rows] for key in ("low", "high")]
        right.fill_between(x, *ends, color=colour, alpha=0.2, lw=0)
        median = [row["ratio"] for row in rows]
        right.plot(x, median, mark, ls="-", color=colour, label=f"{name}: median, 80 % of arms")
    right.axhline(0.5, color=GREY, ls="--", lw=1.2, label="half")
    right.set_title(f"{robots['count']} arms drawn at random, deflecting", fontsize=11)
    right.set_ylabel("worst error of a distance, after over before")
    for panel in (left, middle, right):
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("condition number C_G of the pose set")
        panel.grid(True, which="both", alpha=0.25)
        panel.yaxis.set_major_formatter(PLAIN)
        panel.yaxis.set_minor_formatter(NullFormatter())
    left.legend(fontsize=8, ncols=2, loc="upper center")
    right.legend(fontsize=8)
    left.set_ylim(top=2.0)
    return figure


def _distances(panel: Axes, plate: Mapping[str, Any], estimator: str) -> None:
    rows = [row for row in plate["rows"] if row["estimator"] == estimator]
    x = [row["c_g"] for row in rows]
    for d, colour, mark in zip(DISTANCES, (BLUE, VERMILION, GREEN, PURPLE), "osv^", strict=True):
        ends = [[row[f"d{d}_{key}_mm"] for row in rows] for key in ("low", "high")]
        panel.fill_between(x, *ends, color=colour, alpha=0.2, lw=0)
        middle = [row[f"d{d}_mm"] for row in rows]
        panel.plot(x, middle, mark, ls="-", color=colour, ms=4, label=f"d = {d} mm, after")
        panel.axhline(plate["before"][f"d{d}_mm"], color=colour, ls="--", lw=1.1)
    panel.plot([], [], color=GREY, ls="--", lw=1.1, label="before")


SETTINGS = writing.settings_of(__file__)
SHOWN = next(iter(SETTINGS["arms"]))
"""The arm whose variation is drawn."""

DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

DATA_SETS = "data_sets.csv"
_STREAM = 5


def study(options: Options) -> dict[str, Any]:
    """Does a low condition number make calibration by visual touch-up stable, and right?

    A trial is a data set: one round of touch-ups of a pose set. A short form of N has no more than
    N arms drawn at random either, and no more data sets than N wherever the full one has fewer.
    Twice the data sets of one experiment are the least.
    """
    settings = shortened(options)
    benches = {arm: bench_of(arm, settings) for arm in settings["arms"]}
    cell = benches[SHOWN].cell
    sets = [pose_set(cell, threshold) for threshold in settings["thresholds"]]
    steps = len(benches) + 3
    said: dict[str, Any] = {"many": settings["many"], "arms": {}}
    ten: list[dict[str, Any]] = []
    for k, (arm, bench) in enumerate(benches.items()):
        options.advance(f"{arm} arm", k / steps)
        said["arms"][arm], own = run(bench, sets, arm)
        ten += own
    options.advance("causes of errors", (steps - 3) / steps)
    said["causes"] = causes(benches[SHOWN], settings["arms"][SHOWN], sets)
    options.advance("through pictures", (steps - 2) / steps)
    said["pictures"] = through_pictures(benches[SHOWN], sets)
    options.advance("arms drawn at random", (steps - 1) / steps)
    said["robots"] = robots(benches[SHOWN])
    figures: dict[str, Any] = writing.rounded(said, DIGITS)
    for part in ("variation", "plate"):
        writing.write_rows(options.out, f"{part}.csv", _every(figures, part), DIGITS)
    writing.write_rows(options.out, DATA_SETS, ten, DIGITS)
    writing.write_figures(options.out, figures)
    return figures


def plot(folder: Path) -> list[Path]:
    """Variation of the offset of joint 2, and distances on the plate, against C_G."""
    said = writing.read_figures(folder)
    shown = [row for row in writing.read_rows(folder, DATA_SETS) if row["arm"] == SHOWN]
    variation = draw_variation(said["arms"][SHOWN]["variation"], shown)
    plate = draw_plate(said["arms"], said["robots"], PAPER.name)
    return [
        *writing.save(variation, folder, "variation"),
        *writing.save(plate, folder, "plate"),
    ]


def shortened(options: Options) -> dict[str, Any]:
    """The settings, with the numbers of a short form where that is asked for."""
    many = writing.trials_of(options, SETTINGS["many"], 2 * SETTINGS["data_sets"])
    own = {k: min(SETTINGS[k], many) for k in ("pictures_data_sets", "causes_data_sets")}
    drawn = SETTINGS["robots"] | {"count": min(SETTINGS["robots"]["count"], many)}
    return SETTINGS | own | {"many": many, "robots": drawn}


def bench_of(arm: str, settings: Mapping[str, Any] = SETTINGS) -> Bench:
    """The cell with one of the arms of ``study.toml``."""
    return Bench.of(settings, settings["arms"][arm])


def run(bench: Bench, sets: list[PoseSet], arm: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Everything of one arm, and its ten data sets one by one."""
    size, seed = bench.settings["data_sets"], bench.settings["seed"]
    found = list(every(bench, sets, bench.settings["many"], _STREAM))
    plate = plate_rows(bench, found)
    said = {
        "variation": [row for poses, them in found for row in rows(bench, poses, them)],
        "plate": plate,
        "claims": claims.variation(found, size, seed) | {"plate": claims.plate(plate)},
    }
    ten = [
        {"arm": arm, "d_deg": poses.d_deg, "c_g": poses.c_g, "estimator": each.estimator.name}
        | {"data_set": k + 1, "offset_deg": offset, "about_mean_deg": offset - first.mean()}
        for poses, them in found
        for each in them
        for first in [each.offset_deg[:size]]
        for k, offset in enumerate(first.tolist())
    ]
    return said, ten


def robots(bench: Bench) -> dict[str, Any]:
    """What a calibration does for arms drawn at random."""
    drawn = bench.settings["robots"]
    sets = [pose_set(bench.cell, threshold) for threshold in drawn["thresholds"]]
    return claims.many_arms(drawn_ratios(bench, sets, drawn["count"]), sets)


def _every(said: Mapping[str, Any], part: str) -> list[dict[str, Any]]:
    """Rows of all arms; those of the plate after the one before calibration."""
    table = []
    for arm, own in said["arms"].items():
        given = own[part]
        if part == "plate":
            before = {"estimator": "uncalibrated"} | given["before"]
            given = [before, *given["rows"]]
        table += [{"arm": arm} | row for row in given]
    return table


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read."""
    return "\n\n".join("\n".join(lines) for lines in tables(said))
