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
from studies.writing import span, table, table_across

from . import touch_claims as claims
from .touch_bench import Bench, PoseSet, pose_set
from .touch_plate import PAPER, causes, drawn_ratios, every, plate_rows, rows, through_pictures

NAMES = {
    "touch-up": "touch-up unweighted",
    "touch-up, weighted": "touch-up weighted",
    "view line": "view line",
}
"""Of the estimators that are drawn, in the table of styles."""

ESTIMATED = ("touch-up", "touch-up, weighted")
"""Of the paper, and what weights make of it."""

SHARES = ("below_half", "worse_than_before")

ASIDE = 1.06
"""Factor by which marks at one C_G are moved aside."""


PANELS = {
    "touch-up (Figure 9)": ESTIMATED,
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
    return [*writing.save(variation, folder, "variation"), *writing.save(plate, folder, "plate")]


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


SET = ("{d_deg:g}", "{c_g:.2e}")
"""Of each row."""


def _of(estimator: str, *keys: str) -> str:
    """Figures of an estimator: ten data sets with the interval, all of them, or another one."""
    names = [f"{estimator}[{key}]" for key in keys]
    return span("d", *names) if len(names) > 1 else f"{{{names[0]}:d}}"


TEN = ("ten_std_deg", "ten_low_deg", "ten_high_deg")
VARIATION = (
    *SET,
    *(_of(e, *keys) for e in (*NAMES,) for keys in (TEN, ("many_std_deg",))),
    _of("touch-up, size left out", "many_std_deg"),
    span(".2f", "ratio", "low", "high"),
    *(_of(e, "error_deg") for e in ESTIMATED),
)
CAUSES = (*SET, "{away}", *(f"{{{name} error_deg:d}}" for name in NAMES))
ARMS = (
    span(".2f", "ratio"),
    *(span("p", *(f"{k}[{end}]" for end in ("share", "low", "high"))) for k in SHARES),
)


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read: variation, causes, plate, arms drawn."""
    shown = said["arms"][SHOWN]
    variation = [dict(row) for row in shown["claims"]["view line over touch-up"]]
    for row in variation:
        row |= {r["estimator"]: r for r in shown["variation"] if r["d_deg"] == row["d_deg"]}
    robots = [row | {"by": name} for name in ESTIMATED for row in said["robots"][name]["rows"]]
    return "\n\n".join(
        [
            table(variation, VARIATION),
            table(said["causes"], CAUSES),
            _table_of_plates({arm: part["plate"] for arm, part in said["arms"].items()}),
            table_across(robots, SET, "by", ARMS),
        ]
    )


def _table_of_plates(plates: Mapping[str, Any]) -> str:
    """Distances before, and after for each pose set: of the arm shown, the worst of all arms."""
    every = [(arm, name) for arm in plates for name in ESTIMATED]
    parts = [f"{{d{d}_mm:.3f}}" for d in (100, 200, 300, 400)]
    rows = [{"arm": arm} | row for arm, plate in plates.items() for row in plate["rows"]]
    of = {(row["arm"], row["estimator"], row["d_deg"]): row for row in rows}
    sets = [
        row | {f"{k}": of[(*one, row["d_deg"])] for k, one in enumerate(every)}
        for row in plates[SHOWN]["rows"]
        if row["estimator"] == ESTIMATED[0]
    ]
    after = [f"{{{k}[worst_mm]:.3f}} ({{{k}[ratio]:.2f}})" for k in range(len(every))]
    before = [f"{plates[arm]['before']['worst_mm']:.3f}" for arm, _ in every]
    first = table([plates[SHOWN]["before"]], ["", "before", *parts, *before])
    return "\n".join([first, table(sets, [*SET, *parts, *after])])
