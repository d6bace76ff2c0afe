"""Run the study: ``posedesign study run what_buys_accuracy``, or this file as a script."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from buys import Bench, Measured, Variant  # noqa: E402
from buys_figure import draw  # noqa: E402

from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402
from studies.tool_errors import ToolErrors  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
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
    for done, variant in enumerate(wanted):
        advance(variant.says, done / len(wanted))
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
    (low, high), (worst_low, worst_high) = errors.rms_interval_m, errors.worst_interval_m
    found = {
        "predicted_rms": errors.predicted_rms_m,
        "rms": errors.rms_m,
        "rms_low": low,
        "rms_high": high,
        "median_of_trials": float(np.median(errors.of_trials_m)),
        "predicted_worst": errors.predicted_worst_m,
        "worst": errors.worst_m,
        "worst_low": worst_low,
        "worst_high": worst_high,
        "median_of_worst": float(np.median(errors.worst_of_trials_m)),
    }
    if prefix:  # the same plan: the same prediction
        del found["predicted_rms"], found["predicted_worst"]
    in_mm: dict[str, float] = {f"{prefix}{name}_mm": 1e3 * value for name, value in found.items()}
    return in_mm | {f"{prefix}failed": errors.failed}


def before(arm: str) -> dict[str, float]:
    """Error over the box before calibration [mm]."""
    bench = Bench(arm, SETTINGS)
    said = {"rigid_mm": 1e3 * bench.before_m(deflects=False)}
    if bench.cell.deflects:
        said["deflecting_mm"] = 1e3 * bench.before_m(deflects=True)
    rounded: dict[str, float] = writing.rounded(said, DIGITS)
    return rounded


def tables(said: Mapping[str, Any]) -> str:
    """What the README has of each arm."""
    return "\n\n".join(
        f"{arm}, before calibration {part['before']}\n{markdown(part['rows'])}"
        for arm, part in said["arms"].items()
    )


def markdown(table: list[dict[str, Any]]) -> str:
    """The table that people read."""
    lines = []
    for row in table:
        cells = [row["says"], f"{row['measurements']}", f"{row['minutes']:.1f}"]
        cells += [_short(row["predicted_rms_mm"]), _short(row["rms_mm"])]
        cells += [f"{_short(row['rms_low_mm'])} to {_short(row['rms_high_mm'])}"]
        cells += [_short(row["median_of_trials_mm"])]
        cells += [_short(row["predicted_worst_mm"]), _short(row["worst_mm"])]
        cells += [_digits(row["worth_a_minute"], 2)]
        if "deflecting_rms_mm" in row:
            cells += [_digits(row["deflecting_rms_mm"], 3)]
        lines.append(writing.table_line(cells))
    return "\n".join(lines)


def _digits(value: float, count: int) -> str:
    return f"{float(f'{value:.{count}g}'):g}"


def _short(value_mm: float) -> str:
    return f"{value_mm:.4f}".lstrip("0")


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, tables)


if __name__ == "__main__":
    main()
