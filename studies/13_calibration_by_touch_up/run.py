"""Run the study: ``posedesign study run calibration_by_touch_up``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posedesign.report.drawing import (
    GREY,
    STYLES,
    condition_axis,
    curve,
    label_ends,
    log_y,
    set_answer,
)
from posedesign.study import Options
from studies import writing
from studies.writing import table_line

from . import touch_claims as claims
from .touch_bench import Bench, PoseSet, pose_set
from .touch_plate import (
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


NAMES = {
    "touch-up": "touch-up unweighted",
    "touch-up, weighted": "touch-up weighted",
    "view line": "view line",
}
"""Of the estimators that are drawn, in the table of styles."""

ASIDE = 1.06
"""Factor by which marks at one C_G are moved aside."""


PANELS = {
    "touch-up (Figure 9)": ("touch-up", "touch-up, weighted"),
    "view line beside touch-up (Figure 10)": ("touch-up", "view line"),
}


def draw_variation(said: Mapping[str, Any]) -> Figure:
    """Standard deviations of ten data sets and of many, against C_G."""
    figure = Figure(figsize=(11.5, 4.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    rows, found = said["variation"], said["claims"]
    for panel, (title, names) in zip(panels, PANELS.items(), strict=True):
        for name, aside in zip(names, (1.0 / ASIDE, ASIDE), strict=True):
            _deviation(panel, [row for row in rows if row["estimator"] == name], aside)
        panel.set_title(title, fontsize=10)
        condition_axis(panel)
        log_y(panel)
    log_y(panels[0], "standard deviation of the offset of joint 2\n[deg]")
    for panel in panels:
        label_ends(panel)
    touched, line = (found["falls"][name]["rho_median"] for name in ("touch-up", "view line"))
    worst, *_, best = (row["ratio"] for row in found["view line over touch-up"])
    set_answer(
        figure,
        f"With better poses the offset of joint 2 varies less (rank correlation {touched:.2f} by "
        f"touch-up, {line:.2f} by view line); the view line varies {worst:.2g} times as much as "
        f"touch-up with the worst poses, {best:.2g} times with the best",
        f"Marks: ten data sets, with 95 % intervals. Bands: {rows[0]['data_sets']}, 95 %. "
        "Lines: predicted from the noise. Touch-up: as in the paper, without weights.",
    )
    return figure


def _deviation(panel: Axes, rows: Sequence[Mapping[str, Any]], aside: float) -> None:
    name = rows[0]["estimator"]
    style = STYLES[NAMES[name]]
    x = np.array([row["c_g"] for row in rows])
    ends = [[row[f"ten_{key}_deg"] for row in rows] for key in ("low", "high")]
    middle = [row["ten_std_deg"] for row in rows]
    curve(panel, aside * x, middle, style._replace(line=""), ends=ends)
    ends = [[row[f"many_{key}_deg"] for row in rows] for key in ("low", "high")]
    panel.fill_between(x, *ends, color=style.colour, alpha=0.3, lw=0)
    predicted = [row["predicted_deg"] for row in rows]
    panel.plot(x, predicted, style.line, color=style.colour, lw=1.3, label=name)


def draw_plate(arms: Mapping[str, Any], robots: Mapping[str, Any], estimator: str) -> Figure:
    """Worst distance errors of the arms shown, and of many arms in parts of those before."""
    figure = Figure(figsize=(11.5, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True)
    for (arm, part), line in zip(arms.items(), ("-", ":"), strict=True):
        plate = part["plate"]
        rows = [row for row in plate["rows"] if row["estimator"] == estimator]
        x, *errors = np.transpose([[row[key] for key in ("c_g", *_WORST)] for row in rows])
        style = STYLES[NAMES[estimator]]._replace(line=line)
        curve(left, x, errors[0], style, f"after, {arm} arm", ends=errors[1:])
        before = STYLES["uncalibrated"]._replace(line=line, mark="")
        curve(left, x, np.full_like(x, plate["before"]["worst_mm"]), before, f"before, {arm} arm")
    for k, name in enumerate(key for key in robots if key in NAMES):
        columns = ("c_g", "ratio", "ratio_low", "ratio_high")
        x, *ratios = np.transpose([[row[c] for c in columns] for row in robots[name]["rows"]])
        style = STYLES[NAMES[name]]
        curve(right, ASIDE ** (2 * k - 1) * x, ratios[0], style, name, ends=ratios[1:])
    right.axhline(1.0, color=GREY, ls="--", lw=1.2, label="as before")
    right.axhline(0.5, color=GREY, ls=":", lw=1.2, label="half of it")
    left.set_title(f"one arm, {estimator} as in the paper (Figure 11)", fontsize=10)
    right.set_title(f"{robots['count']} deflecting arms drawn at random", fontsize=10)
    log_y(left, "worst error of a distance on the plate\n[mm]")
    log_y(right, "worst error of a distance\nafter over before [-]")
    for panel in (left, right):
        condition_axis(panel)
        label_ends(panel)
    rigid = arms["rigid"]["claims"]["plate"][estimator]
    first, last = (rigid[f"ratio_at_{end}_c_g"] for end in ("largest", "smallest"))
    best = 100 * robots[estimator]["smallest_c_g_is_best"]["share"]
    set_answer(
        figure,
        "Better poses make the plate right where the model is: on the rigid arm after over before "
        f"goes from {first:.2f} to {last:.2f}; the smallest C_G is the best set on {best:.0f} % of "
        "deflecting arms",
        "Medians; bars: 95 % of the data sets (left), 80 % of the arms (right).",
    )
    return figure


_WORST = ("worst_mm", "worst_low_mm", "worst_high_mm")

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
    tables = {f"{part}.csv": _every(said, part) for part in ("variation", "plate")}
    return writing.write_rounded(options.out, said, DIGITS, tables | {DATA_SETS: ten})


def plot(folder: Path) -> list[Path]:
    """Variation of the offset of joint 2, and distances on the plate, against C_G."""
    said = writing.read_figures(folder)
    variation = draw_variation(said["arms"][SHOWN])
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
