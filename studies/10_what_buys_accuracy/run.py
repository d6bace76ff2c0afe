"""Run the study: ``posedesign study run what_buys_accuracy``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from posedesign.report.drawing import BLUE, SMALL, VERMILION, set_answer
from posedesign.study import Advance, Options
from studies import writing
from studies.tool_errors import ToolErrors

from .buys import Bench, Measured, Variant

TITLES = {"r2000ic165f": "R-2000iC/165F", "ur10e": "UR10e"}

CHANGES = (
    ("identify compliance, if it deflects", "baseline", "compliance"),
    ("over the arm's back too", "I", "all"),
    ("a second target, far apart", "I", "2 far"),
    ("grid tilted by 60, not 40 deg", "baseline", "grid 60 deg"),
    ("choose poses by I, rolled freely", "baseline", "I"),
    ("weight by the noise", "unweighted", "baseline"),
    ("108 chosen poses, not 27", "I", "I 108"),
    ("a third target", "2 far", "3"),
    ("know the distance of targets", "2 far", "2 far known"),
)
"""What is changed, from which variant to which, in the order of the answer."""


def draw(arms: dict[str, Any]) -> Figure:
    """Errors without and with each change, a row for each, a panel for each arm.

    The first is drawn as found on the arm that deflects, where there is one: it is for that arm.
    """
    figure = Figure(figsize=(12.5, 0.42 * len(CHANGES) + 2.0), layout="constrained")
    panels = figure.subplots(1, len(arms), sharex=True, sharey=True, squeeze=False)[0]
    gains = {}
    for panel, (arm, part) in zip(panels, arms.items(), strict=True):
        rows = {row["key"]: row for row in part["rows"]}
        for at, (says, *keys) in enumerate(CHANGES):
            if not all(key in rows for key in keys):
                continue
            without, with_ = (rows[key] for key in keys)
            deflects = at == 0 and "deflecting_rms_mm" in without
            gain = _change(panel, at, without, with_, "deflecting_" if deflects else "")
            gains.setdefault(says, gain)
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.grid(True, axis="x", alpha=0.25)
        panel.set_title(TITLES[arm], fontsize=10)
        panel.set_xlabel("error of the tool point over the box, rms [mm], log scale; better left")
    panels[0].set_yticks(range(len(CHANGES)), [says for says, *_ in CHANGES])
    panels[0].set_ylim(len(CHANGES) - 0.4, -0.6)
    most = sorted(gains, key=lambda says: -gains[says])[:3]
    set_answer(
        figure,
        f"What buys most on the {TITLES[next(iter(arms))]}: "
        + "; ".join(f"{says} ({gains[says]:.2g} times better)" for says in most),
        "From without (hollow) to with (full): predicted, bars: 95 % interval of the simulation. "
        "Red: found on an arm that deflects. Beside: times better, and the minutes that it adds.",
    )
    return figure


def _change(
    panel: Axes, at: int, without: Mapping[str, Any], with_: Mapping[str, Any], prefix: str
) -> float:
    """A line from one error to the other, and how many times better: returns that."""
    colour = VERMILION if prefix else BLUE
    name = f"{prefix}rms_mm" if prefix else "predicted_rms_mm"
    for row, face in ((without, "white"), (with_, colour)):
        low, high = row[f"{prefix}rms_low_mm"], row[f"{prefix}rms_high_mm"]
        panel.plot([low, high], [at, at], color=colour, lw=11.0, alpha=0.3, solid_capstyle="butt")
        panel.plot(row[name], at, "o", color=colour, mfc=face, ms=4.5, zorder=3)
    ends = without[name], with_[name]
    panel.plot(ends, [at, at], color=colour, lw=1.3, zorder=2)
    gain, minutes = ends[0] / ends[1], with_["minutes"] - without["minutes"]
    added = f", {minutes:+.1f} min" if abs(minutes) >= LEAST_MIN else ""
    panel.annotate(
        f"x{gain:.2g}{added}", (1.01, at), xycoords=("axes fraction", "data"), fontsize=SMALL,
        va="center",
    )  # fmt: skip
    return float(gain)


LEAST_MIN = 0.1
"""Less time is not told."""

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
    for variant in writing.parts_of(wanted, advance, attrgetter("says")):
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
    found = errors.figures_mm
    if prefix:  # the same plan: the same prediction
        found = {k: v for k, v in found.items() if not k.startswith("predicted")}
    return {f"{prefix}{k}": v for k, v in found.items()} | {f"{prefix}failed": errors.failed}


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


def table(rows: list[dict[str, Any]]) -> str:
    """The table that people read."""
    deflects = ["{deflecting_rms_mm:.3g}"] if "deflecting_rms_mm" in rows[0] else []
    return writing.table(rows, [*COLUMNS, *deflects])


def _worth(row: Mapping[str, Any]) -> str:
    two_digits = float(f"{row['worth_a_minute']:.2g}")
    return f"{two_digits:g}"


COLUMNS: Sequence[writing.Cell] = (
    "{says}", "{measurements}", "{minutes:.1f}", "{predicted_rms_mm:s.4f}", "{rms_mm:s.4f}",
    "{rms_low_mm:s.4f} to {rms_high_mm:s.4f}", "{median_of_trials_mm:s.4f}",
    "{predicted_worst_mm:s.4f}", "{worst_mm:s.4f}", _worth,
)  # fmt: skip
