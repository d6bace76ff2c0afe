"""Run the study: ``posedesign study run peers``."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posedesign.report.drawing import BLACK, GREY, set_answer
from posedesign.study import Options
from studies import writing
from studies.drawing import MARKS, log_ticks
from studies.writing import table_by, table_of

from . import peer_fits as fits
from . import peer_pairs as pairs
from . import peer_selection as selection

Rows = Sequence[Mapping[str, Any]]
HEIGHT = 0.3
"""Of a row [inches]."""

TICKS_MM = (0.3, 0.5, 1, 2, 3, 5)
APART = 0.22
"""Of the series in a row, whose height is one."""


def draw_times(times: Rows) -> Figure:
    """Their time over ours with the least and the largest of the turns, on logarithmic axes."""
    closed = [r for r in times if r["job"] == "A X = Z B" and r["ours"] == "ml"]
    rest = [r for r in times if r["job"] != "A X = Z B"]
    names = [list(dict.fromkeys(r["peer"] for r in rows)) for rows in (closed, rest)]
    heights = [len(each) for each in names]
    figure = Figure(figsize=(9.5, 2.0 + HEIGHT * sum(heights)), layout="constrained")
    axes = figure.subplots(2, 1, height_ratios=heights)
    sizes = list(dict.fromkeys(r["size"] for r in closed))
    series = {f"{size:g} pairs": [r for r in closed if r["size"] == size] for size in sizes}
    _intervals(axes[0], names[0], series, "peer", ("ratio", "ratio_low", "ratio_high"))
    axes[0].set_title("A X = Z B: time over that of the likeliest X and Z with their covariance")
    series = {r["job"]: [k for k in rest if k["job"] == r["job"]] for r in rest}
    _intervals(axes[1], names[1], series, "peer", ("ratio", "ratio_low", "ratio_high"))
    axes[1].set_title("time over that of identify, or of the exchange with its bound")
    for each in axes:
        each.set_xscale("log")
        each.axvline(1.0, color=BLACK, lw=1.0)
        each.set_xlabel("time over ours [-], log scale; median and range of the turns")
        each.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    forms = [row for row in closed if row["peer"] != pairs.SCIPY]
    of = [_ends([r["ratio"] for r in forms if r["size"] == size]) for size in (sizes[0], sizes[-1])]
    set_answer(
        figure,
        f"OpenCV's closed forms take {of[0]} times as long as the likeliest X and Z of "
        f"{sizes[0]:g} pairs, {of[1]} times of {sizes[-1]:g}",
    )
    return figure


def draw_accuracy(pairs: Rows, touch_ups: Rows, chosen: Rows) -> Figure:
    """Medians of errors with their 95 % intervals, and choices over the proven bound."""
    most = max(r["pairs"] for r in pairs)
    shown = [r for r in pairs if r["pairs"] == most]
    names = [
        list(dict.fromkeys(r[key] for r in rows))
        for rows, key in ((shown, "solver"), (touch_ups, "by"), (chosen, "by"))
    ]
    heights = [len(each) + 1 for each in names]
    figure = Figure(figsize=(9.5, 2.5 + HEIGHT * sum(heights)), layout="constrained")
    axes = figure.subplots(3, 1, height_ratios=heights)
    series = _by(shown, "setting")
    _intervals(axes[0], names[0], series, "solver", ("X_mm", "X_mm_low", "X_mm_high"))
    axes[0].set_title(f"A X = Z B from {most:g} pairs")
    axes[0].set_xlabel("X off [mm], log scale; median of the trials and its 95 % interval")
    columns = ("tool_error_mm", "tool_error_low_mm", "tool_error_high_mm")
    _intervals(axes[1], names[1], _by(touch_ups, "noise"), "by", columns)
    axes[1].set_title("ten parameters from touch-ups")
    axes[1].set_xlabel("tool point off elsewhere [mm], log scale; median and its 95 % interval")
    for each in axes[:2]:
        log_ticks(each, TICKS_MM)
        each.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    rows = [r for r in chosen if isinstance(r["of_the_bound"], float)]
    values = [r["of_the_bound"] for r in rows]
    place = {name: len(names[2]) - 1 - k for k, name in enumerate(names[2])}
    axes[2].plot(
        values, [place[r["by"]] for r in rows], "o", color=MARKS[0][0], mfc="none", mew=1.5
    )
    axes[2].axvline(1.0, color=BLACK, lw=1.0)
    axes[2].set_yticks(list(place.values()), list(place))
    axes[2].set_title("choice of poses by D (line: more than any different poses have)")
    axes[2].set_xlabel("det(information)^(1/p) of a pose, over the proven bound [-]")
    axes[2].grid(visible=True, alpha=0.3)
    off = _ends(_over_ours({"pairs": pairs}))
    set_answer(figure, f"OpenCV's X is {off} times as far off as ml's, with the noise on B")
    return figure


def _by(rows: Rows, key: str) -> dict[str, Rows]:
    names = dict.fromkeys(r[key] for r in rows)
    return {name: [r for r in rows if r[key] == name] for name in names}


def _intervals(
    axes: Axes,
    names: Sequence[str],
    series: Mapping[str, Rows],
    key: str,
    columns: tuple[str, str, str],
) -> None:
    """A row for each name, the first on top, with a mark and its interval for each series."""
    for k, ((label, rows), (colour, mark)) in enumerate(zip(series.items(), MARKS, strict=False)):
        shown = [r for r in rows if all(isinstance(r[column], float) for column in columns)]
        value, low, high = np.array([[r[c] for c in columns] for r in shown]).T
        at = [len(names) - 1 - names.index(r[key]) for r in shown]
        axes.errorbar(
            value,
            np.array(at) + APART * ((len(series) - 1) / 2.0 - k),
            xerr=[value - low, high - value],
            fmt=mark,
            color=colour,
            mfc="none",
            mew=1.5,
            ms=5,
            capsize=2.5,
            label=label,
        )
    axes.set_yticks(range(len(names)), names[::-1])
    axes.tick_params(axis="y", colors=GREY)
    axes.grid(visible=True, alpha=0.3)


Said = Mapping[str, Any]
CONE = "figaroh: cone programme"


def markdown(said: Said) -> str:
    """Every table, and before them what was left out."""
    tables = (
        times_of_pairs(said),
        times_of_the_rest(said),
        accuracy_of_pairs(said),
        accuracy_of_touch_ups(said),
        choice(said),
        _table_of_refusals(said),
    )
    return "\n\n".join((*said["left_out"].values(), *tables))


def times_of_pairs(said: Said) -> str:
    """A X = Z B: a line for each peer, a pair of columns for each number of pairs."""
    rows = [row for row in said["times"] if row["job"] == "A X = Z B"]
    sizes = list(dict.fromkeys(row["size"] for row in rows))
    head = ["by", "ours"] + [f"{size} pairs" for size in sizes]
    lines: dict[tuple[str, str], dict[int, str]] = {}
    for row in rows:
        lines.setdefault((row["peer"], row["ours"]), {})[row["size"]] = _ratio(row)
    return table_of(
        head,
        [[*names, *(cells.get(size, "") for size in sizes)] for names, cells in lines.items()],
    )


def times_of_the_rest(said: Said) -> str:
    """Ten parameters and the choice of poses."""
    columns = {
        "job": lambda row: row["job"],
        "by": lambda row: row["peer"],
        "ours": lambda row: row["ours"],
        "their time over ours": _ratio,
        "theirs [ms]": lambda row: _number(row["theirs_ms"]),
    }
    return table_by((row for row in said["times"] if row["job"] != "A X = Z B"), columns)


def accuracy_of_pairs(said: Said) -> str:
    """Errors of X: a line for each solver and number of pairs, a column for each setting."""
    rows = said["pairs"]
    settings = list(dict.fromkeys(row["setting"] for row in rows))
    lines: dict[tuple[int, str], dict[str, str]] = {}
    for row in rows:
        failed = f", {row['failed']} failed" if row["failed"] else ""
        cell = _interval(row, "X_mm") + failed
        lines.setdefault((row["pairs"], row["solver"]), {})[row["setting"]] = cell
    head = ["pairs", "by", *(f"{name}: X off [mm]" for name in settings)]
    return table_of(
        head, [[str(n), by, *(cells[s] for s in settings)] for (n, by), cells in lines.items()]
    )


def accuracy_of_touch_ups(said: Said) -> str:
    """Error of the tool point in postures that were not measured."""
    lines = []
    for row in said["touch_ups"]:
        off = f"{row['tool_error_mm']:.3f}"
        off += f" ({row['tool_error_low_mm']:.3f} to {row['tool_error_high_mm']:.3f})"
        nearer = f"{100 * row['ours_nearer']:.0f} % "
        nearer += f"({100 * row['ours_nearer_low']:.0f} to {100 * row['ours_nearer_high']:.0f})"
        cells = [row["noise"], row["by"], str(row["trials"]), off, f"{row['of_ours']:.2f}"]
        lines.append([*cells, "" if row["by"] == "ours" else nearer, f"{row['left_mm']:.3f}"])
    head = ["noise", "by", "trials", "tool point off [mm]", "over ours", "ours nearer"]
    return table_of([*head, "left at the touch-ups [mm]"], lines)


def choice(said: Said) -> str:
    """Share of the proven bound that every choice has."""

    def share(row: Said) -> str:
        return "" if row["of_the_bound"] is None else f"{row['of_the_bound']:.4f}"

    columns = {
        "by": lambda row: row["by"],
        "poses": lambda row: str(row["poses"]),
        "different": lambda row: str(row["different"]),
        "of the bound": share,
        "says how far from the best": lambda row: row["says_of_its_distance"],
    }
    return table_by(said["selection"], columns)


def _table_of_refusals(said: Said) -> str:
    """What pairs that cannot be solved are answered with: a line for each solver."""
    cases = [row["pairs"] for row in said["refusals"]]
    solvers = [name for name in said["refusals"][0] if name != "pairs"]
    lines = [[name, *(row[name] for row in said["refusals"])] for name in solvers]
    return table_of(["by", *cases], lines)


def _ratio(row: Said) -> str:
    low, high = row["ratio_low"], row["ratio_high"]
    text = f"{_number(row['ratio'])}"
    return text if low == high else f"{text} ({_number(low)} to {_number(high)})"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    if value >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _interval(row: Said, name: str) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return f"{_number(row[name])} ({_number(low)} to {_number(high)})"


def sentences(said: Said) -> dict[str, str]:
    """What the README says of the key figures, each under a name."""
    return {"answer": _answer(said)} | _of_accuracy(said) | _of_facts(said)


def _answer(said: Said) -> str:
    closed = [row for row in said["times"] if row["ours"] == "ml" and row["peer"] != pairs.SCIPY]
    few, many = (end(row["size"] for row in closed) for end in (min, max))
    ratio = {size: [r["ratio"] for r in closed if r["size"] == size] for size in (few, many)}
    rest = {row["peer"]: _number(row["ratio"]) for row in said["times"]}
    deep = _deep(said)
    return (
        f"**Answer.** At {few} pairs OpenCV's closed forms need {_ends(ratio[few])} of the time of "
        f"the likeliest X and Z, at {many} pairs {_ends(ratio[many])} times as long; for ten "
        f"parameters figaroh and pybotics need {rest['figaroh']} and "
        f"{rest[fits.COORDINATES]} times as long, for a choice of poses figaroh's cone programme "
        f"{rest[CONE]} times. With noise that "
        f"is alike on all axes their touch-ups are worth as much as ours, with depth six times as "
        f"uncertain they are {deep['figaroh']['of_ours']:.1f} times as far off; OpenCV's X is "
        f"{_ends(_over_ours(said))} times as far off, and most of its methods answer pairs that "
        f"have no answer."
    )


def _of_accuracy(said: Said) -> dict[str, str]:
    deep, nearer = _deep(said), _deep(said)["figaroh"]
    kink = next(row for row in said["touch_ups"] if row["by"] == fits.DISTANCES)
    choice = {row["by"]: row for row in said["selection"]}
    every, heavy = (choice[f"{CONE}, {which}"] for which in ("all it keeps", "the heaviest"))
    top = choice["ours: exchange"]
    repeated = [row for row in said["selection"] if row["different"] < row["poses"]]
    counts = " and ".join(str(row["different"]) for row in repeated)
    shares = " and ".join(f"{row['of_the_bound']:.4f}" for row in repeated)
    return {
        "pairs": (
            f"scipy ends where `ml` does, in all of {said['optimum']['trials']} trials: X apart by "
            f"{said['optimum']['largest_difference_of_X']:.0e} at most."
        ),
        "touch-ups": (
            f"With equal noise all who take coordinates have the same answer. With depth six times "
            f"as uncertain the weights matter: {deep['ours']['tool_error_mm']:.2f} mm against "
            f"{nearer['tool_error_mm']:.2f}, ours nearer in {100 * nearer['ours_nearer']:.0f} % of "
            f"trials."
        ),
        "distances": (
            f"pybotics' own residuals, the distances, end {kink['of_ours']:.1f} times as far off "
            f"in the {kink['trials']} trials with equal noise"
        ),
        "choice": (
            f"Ours has {top['of_the_bound']:.4f} of the bound with 20 different poses, and says "
            f"so. figaroh's cone programme keeps {every['poses']} poses, of which the heaviest 20 "
            f"come to {heavy['of_the_bound']:.4f}; its DetMax takes some poses twice ({counts} "
            f"different ones) and so comes to {shares}, above ours. It starts at random and says "
            f"nothing of how far the best is."
        ),
    }


def _of_facts(said: Said) -> dict[str, str]:
    facts = said["facts"]
    told = facts["offset_that_cannot_be_told"]["figaroh"]
    first, last = told
    return {
        "apart": (
            f"Kinematics agree to {facts['figaroh_apart_m']:.0e} m (figaroh) and "
            f"{facts['pybotics_apart_m']:.0e} m (pybotics) in 200 postures."
        ),
        "own list": (
            f"frees {len(facts['figaroh_own_parameters'])} parameters, the axes of an unknown "
            f"frame of the target among them"
        ),
        "offsets": (
            f"Touch-ups of one point tell neither the offset of the first joint nor that of the "
            f"last. figaroh's selection {told[first].split()[0]} the first and "
            f"{told[last].split()[0]} the last; `identify` refuses both, and says which "
            f"parameters absorb them."
        ),
    }


def _deep(said: Said) -> dict[str, Said]:
    return {r["by"]: r for r in said["touch_ups"] if r["noise"].startswith("depth")}


def _over_ours(said: Said) -> list[float]:
    """Errors of OpenCV's X over those of the likeliest, where the noise is as told."""
    rows = [row for row in said["pairs"] if row["setting"].endswith("on B")]
    best = {(r["setting"], r["pairs"]): r["X_mm"] for r in rows if r["solver"] == "ours: ml"}
    theirs = [r for r in rows if not r["solver"].startswith(("ours", "scipy"))]
    return [r["X_mm"] / best[r["setting"], r["pairs"]] for r in theirs]


def _ends(values: Sequence[float]) -> str:
    return f"{min(values):.2g} to {max(values):,.2g}" if max(values) < 100 else _wide(values)


def _wide(values: Sequence[float]) -> str:
    return f"{min(values):.2g} to {max(values):,.0f}"


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
