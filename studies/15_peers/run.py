"""Run the study: ``posedesign study run peers``."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from posedesign.report.drawing import BLACK, set_answer
from posedesign.study import Options
from studies import writing
from studies.drawing import log_ticks, rows_of_marks, rows_with_intervals
from studies.writing import Cell, cell, span, table, table_across

from . import peer_fits as fits
from . import peer_pairs as pairs
from . import peer_selection as selection

Rows = Sequence[Mapping[str, Any]]
HEIGHT = 0.3
"""Of a row [inches]."""

TICKS_MM = (0.3, 0.5, 1, 2, 3, 5)

PAIRS = "A X = Z B"


RATIO = ("ratio", "ratio_low", "ratio_high")
OFF_MM = ("X_mm", "X_mm_low", "X_mm_high")
TOOL_MM = ("tool_error_mm", "tool_error_low_mm", "tool_error_high_mm")


def draw_times(times: Rows) -> Figure:
    """Their time over ours with the least and the largest of the turns, on logarithmic axes."""
    closed = [r for r in times if r["job"] == PAIRS and r["ours"] == "ml"]
    closed = [r | {"series": f"{r['size']:g} pairs"} for r in closed]
    rest = [r for r in times if r["job"] != PAIRS]
    figure, (above, below) = _stacked(0.5, [(closed, "peer"), (rest, "peer")])
    rows_with_intervals(above, closed, "peer", "series", RATIO)
    above.set_title("A X = Z B: time over that of the likeliest X and Z with their covariance")
    rows_with_intervals(below, rest, "peer", "job", RATIO)
    below.set_title("time over that of identify, or of the exchange with its bound")
    for axes in (above, below):
        axes.set_xscale("log")
        axes.axvline(1.0, color=BLACK, lw=1.0)
        axes.set_xlabel("time over ours [-], log scale; median and range of the turns")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    forms = [row for row in closed if row["peer"] != pairs.SCIPY]
    sizes = list(dict.fromkeys(row["size"] for row in forms))
    few, many = (_ends([r["ratio"] for r in forms if r["size"] == sizes[k]]) for k in (0, -1))
    set_answer(
        figure,
        f"OpenCV's closed forms take {few} times as long as the likeliest X and Z of "
        f"{sizes[0]:g} pairs, {many} times of {sizes[-1]:g}",
    )
    return figure


def draw_accuracy(every: Rows, touch_ups: Rows, chosen: Rows) -> Figure:
    """Medians of errors with their 95 % intervals, and choices over the proven bound."""
    most = max(r["pairs"] for r in every)
    shown = [r for r in every if r["pairs"] == most]
    figure, (above, middle, below) = _stacked(
        1.0, [(shown, "solver"), (touch_ups, "by"), (chosen, "by")]
    )
    rows_with_intervals(above, shown, "solver", "setting", OFF_MM)
    above.set_title(f"A X = Z B from {most:g} pairs")
    above.set_xlabel("X off [mm], log scale; median of the trials and its 95 % interval")
    rows_with_intervals(middle, touch_ups, "by", "noise", TOOL_MM)
    middle.set_title("ten parameters from touch-ups")
    middle.set_xlabel("tool point off elsewhere [mm], log scale; median and its 95 % interval")
    for axes in (above, middle):
        log_ticks(axes, TICKS_MM)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    shares = [r["of_the_bound"] if isinstance(r["of_the_bound"], float) else nan for r in chosen]
    rows_of_marks(below, [r["by"] for r in chosen], {"": shares})
    below.axvline(1.0, color=BLACK, lw=1.0)
    below.set_title("choice of poses by D (line: more than any different poses have)")
    below.set_xlabel("det(information)^(1/p) of a pose, over the proven bound [-]")
    off = _ends(_over_ours(every))
    set_answer(figure, f"OpenCV's X is {off} times as far off as ml's, with the noise on B")
    return figure


def _stacked(apart: float, parts: Sequence[tuple[Rows, str]]) -> tuple[Figure, Any]:
    """Panels one above the other, as high as there are names in a column of their rows."""
    heights = [len({r[key] for r in rows}) + (apart == 1.0) for rows, key in parts]
    figure = Figure(figsize=(9.5, 1.5 + apart + HEIGHT * sum(heights)), layout="constrained")
    return figure, figure.subplots(len(parts), 1, height_ratios=heights)


def markdown(said: Mapping[str, Any]) -> str:
    """Every table, and before them what was left out."""
    closed, rest = (
        [r for r in said["times"] if (r["job"] == PAIRS) is own] for own in (True, False)
    )
    answers = [
        {"pairs": row["pairs"], "by": name, "answer": answer}
        for row in said["refusals"]
        for name, answer in row.items()
        if name != "pairs"
    ]
    tables = (
        table_across(closed, {"by": "{peer}", "ours": "{ours}"}, "size", {"{} pairs": _ratio}),
        table(rest, TIMES),
        table_across(
            said["pairs"], {"pairs": "{pairs}", "by": "{solver}"}, "setting",
            {"{}: X off [mm]": _off},
        ),
        table(said["touch_ups"], TOUCH_UPS),
        table(said["selection"], CHOICE),
        table_across(answers, {"by": "{by}"}, "pairs", {"{}": "{answer}"}),
    )  # fmt: skip
    return "\n\n".join((*said["left_out"].values(), *tables))


def _ratio(row: Mapping[str, Any]) -> str:
    once = row["ratio_low"] == row["ratio_high"]
    return cell(row, "{ratio:n}" if once else span("n", "ratio"))


def _off(row: Mapping[str, Any]) -> str:
    failed = ", {failed} failed" if row["failed"] else ""
    return cell(row, span("n", "X_mm", "X_mm_low", "X_mm_high") + failed)


def _nearer(row: Mapping[str, Any]) -> str:
    ends = "{ours_nearer:p} % ({ours_nearer_low:p} to {ours_nearer_high:p})"
    return "" if row["by"] == fits.OURS else cell(row, ends)


TIMES: Mapping[str, Cell] = {
    "job": "{job}", "by": "{peer}", "ours": "{ours}",
    "their time over ours": _ratio, "theirs [ms]": "{theirs_ms:n}",
}  # fmt: skip
TOUCH_UPS: Mapping[str, Cell] = {
    "noise": "{noise}", "by": "{by}", "trials": "{trials}",
    "tool point off [mm]": span(".3f", "tool_error_mm"), "over ours": "{of_ours:.2f}",
    "ours nearer": _nearer, "left at the touch-ups [mm]": "{left_mm:.3f}",
}  # fmt: skip
CHOICE = {
    "by": "{by}", "poses": "{poses}", "different": "{different}",
    "of the bound": "{of_the_bound:.4f}", "says how far from the best": "{says_of_its_distance}",
}  # fmt: skip


def _over_ours(rows: Rows) -> list[float]:
    """Errors of OpenCV's X over those of the likeliest, where the noise is as told."""
    told = [row for row in rows if row["setting"].endswith("on B")]
    best = {(r["setting"], r["pairs"]): r["X_mm"] for r in told if r["solver"] == "ours: ml"}
    theirs = [r for r in told if r["solver"] in pairs.OPENCV]
    return [r["X_mm"] / best[r["setting"], r["pairs"]] for r in theirs]


def _ends(values: Sequence[float]) -> str:
    return f"{min(values):.2g} to {max(values):,{'.2g' if max(values) < 100 else '.0f'}}"


SETTINGS = writing.settings_of(__file__)
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

TABLES = ("times", "pairs", "touch_ups", "selection", "refusals")

ALWAYS = {"opencv": "opencv-python-headless", "scipy": "scipy"}
EXTRA = {
    "figaroh": 'pip install -c constraints.txt -e ".[peers]"',
    "pybotics": 'pip install -c constraints.txt -e ".[peers]", then '
    "pip install --no-deps pybotics==3.1.2",
}
"""Peers that may not be there, and what installs them."""


def study(options: Options) -> dict[str, Any]:
    """What do others make of the same work, how fast, and what do they not do?

    A trial is a random set of pairs, or a set of touch-ups. A short form takes its times by fewer
    rounds and leaves out what takes minutes: the peers' own slow residuals, a thousand pairs by
    methods whose cost is square.
    """
    short = options.trials is not None
    peers = installed()
    left_out = {name: _sentence(name) for name in EXTRA if name not in peers}
    for sentence in left_out.values():
        print(sentence, file=sys.stderr)
    own = SETTINGS["touch_ups"]
    kinked = 0 if short else own["kinked_trials"]
    trials = {
        name: writing.trials_of(options, SETTINGS[name]["trials"])
        for name in ("pairs", "touch_ups")
    }
    settings = SETTINGS | {"clock": SETTINGS["short"]} if short else SETTINGS
    options.advance("times of A X = Z B", 0.0)
    times = pairs.times(settings, short)
    options.advance("times of ten parameters", 0.35)
    times += fits.times(settings, settings["clock"], kinked, peers)
    times += selection.times(settings, settings["clock"], with_figaroh="figaroh" in peers)
    options.advance("A X = Z B", 0.5)
    said: dict[str, Any] = {
        "versions": versions(peers),
        "left_out": left_out,
        "trials": trials,
        "times": times,
        "pairs": pairs.errors(SETTINGS, trials["pairs"]),
        "optimum": pairs.optimum(SETTINGS, trials["pairs"]),
        "refusals": pairs.refusals(SETTINGS),
    }
    options.advance("ten parameters", 0.75)
    said["touch_ups"] = fits.errors(SETTINGS, trials["touch_ups"], kinked, peers)
    said["facts"] = fits.facts(SETTINGS, peers)
    options.advance("choice of poses", 0.9)
    said["selection"] = selection.compared(SETTINGS, with_figaroh="figaroh" in peers)
    tables = {f"peer_{name}.csv": said[name] for name in TABLES}
    return writing.write_rounded(options.out, said, DIGITS, tables)


def plot(folder: Path) -> list[Path]:
    """Ratios of times, and what the answers are worth."""
    times, errors, touch_ups, chosen = (
        writing.read_rows(folder, f"peer_{name}.csv") for name in TABLES[:-1]
    )
    drawn = writing.save(draw_times(times), folder, "peer_times")
    return drawn + writing.save(draw_accuracy(errors, touch_ups, chosen), folder, "peer_accuracy")


def installed() -> tuple[str, ...]:
    """Peers of the extra that are there."""
    return tuple(name for name in EXTRA if importlib.util.find_spec(name) is not None)


def versions(peers: tuple[str, ...]) -> dict[str, str]:
    """Of everybody who takes part."""
    names = ALWAYS | {name: name for name in peers}
    return {name: importlib.metadata.version(package) for name, package in names.items()}


def _sentence(name: str) -> str:
    return f"{name} is not installed and left out; to have it: {EXTRA[name]}"
