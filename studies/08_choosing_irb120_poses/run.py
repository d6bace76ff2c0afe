"""Run the study: ``posedesign study run choosing_irb120_poses``, or this file as a script.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from irb_bench import bench_of  # noqa: E402
from irb_choice import compare, everything  # noqa: E402
from irb_figure import draw  # noqa: E402

from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402
from studies.choices import range_text  # noqa: E402
from studies.real_data import data_with  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
RECOMMENDED = "I"
"""Criterion that is held to the bars: least error of the tool, in the mean over the pool."""

TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""

RECORDINGS = "identification/abb_irb120"
TABLE, FIGURE = "choosing_irb120_poses.csv", "choosing_irb120_poses"


def study(options: Options) -> dict[str, Any]:
    """How many of 36 poses does the IRB 120 need, and which?

    A trial is a choice by lot: so many each choice is held against.
    """
    draws = writing.trials_of(options, SETTINGS["draws"])
    rows = run(data_with(RECORDINGS), draws=draws, advance=options.advance)
    return write(rows, options.out)


def plot(folder: Path) -> list[Path]:
    """What choices by lot and by each criterion leave at the poses not chosen."""
    return writing.save(draw(writing.read_figures(folder)["models"]), folder, FIGURE)


def write(rows: list[dict[str, Any]], out: Path) -> dict[str, Any]:
    """Write table and key figures, and return these."""
    content = {"tolerance": TOLERANCE, "recommended": RECOMMENDED, "models": rows}
    figures: dict[str, Any] = writing.rounded(content, DIGITS)
    writing.write_rows(out, TABLE, flat(figures["models"]), DIGITS)
    writing.write_figures(out, figures)
    return figures


def run(
    data: Path,
    names: Sequence[str] | None = None,
    criteria: Sequence[str] | None = None,
    draws: int = SETTINGS["draws"],
    advance: Advance = lambda what, part: None,
) -> list[dict[str, Any]]:
    """Figures of each model, or of those that are named; by all of its criteria, or by some."""
    rows = []
    wanted = [row for row in SETTINGS["model"] if names is None or row["name"] in names]
    for done, row in enumerate(wanted):
        advance(row["name"], done / len(wanted))
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
                        bench,
                        all36,
                        n,
                        tried,
                        draws,
                        np.random.default_rng([SETTINGS["seed"], n]),
                    )
                    for n in SETTINGS["counts"]
                ],
            }
        )
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The table of the README: all criteria of the first model, the one recommended of others."""
    lines = [
        "| model | poses | chosen by | efficiency | left [mm] | over all 36: left out | in sample "
        "| expected | better than | check points [mm] |",
        "|---" * 10 + "|",
    ]
    for row in rows:
        for of in row["counts"]:
            lot, head = of["by_lot"], f"| {row['model']} ({row['parameters']}) | {of['n']} "
            lines.append(
                head + f"| *lot: median (5 to 95 %)* | | {_range(lot['error_mm'])} "
                f"| {_range(lot['over_all_left_out'], 2)} | | | | {_range(lot['check_mm'])} |"
            )
            lines += [
                head + f"| {c['criterion']} | {c['efficiency']:.2f} | {c['error_mm']:.3f} "
                f"| {c['over_all_left_out']:.2f} | {c['over_all_in_sample']:.2f} "
                f"| {c['expected_over_all']:.2f} | {100 * c['better_than']:.0f} % "
                f"| {c['check_mm']:.3f} |"
                for c in of["chosen"]
                if row is rows[0] or c["criterion"] == RECOMMENDED
            ]
    return "\n".join(lines)


def _range(of: dict[str, Any], digits: int = 3) -> str:
    return range_text(of["quantiles"], digits)


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


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, markdown)


if __name__ == "__main__":
    main()
