"""Run the study: python studies/08_choosing_irb120_poses/run.py [--out DIR].

It needs measurements that the project does not contain: the folder that POSEDESIGN_DATA names, or
``../shared/data`` beside the checkout.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from irb_bench import bench_of, measuring_arm  # noqa: E402
from irb_choice import compare, everything  # noqa: E402
from irb_figure import draw  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
RECOMMENDED = "I"
"""Criterion that is held to the bars: least error of the tool, in the mean over the pool."""

TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""


def run(
    data: Path, names: Sequence[str] | None = None, criteria: Sequence[str] | None = None
) -> list[dict[str, Any]]:
    """Figures of each model, or of those that are named; by all of its criteria, or by some."""
    rows = []
    for row in SETTINGS["model"]:
        if names is not None and row["name"] not in names:
            continue
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
                        SETTINGS["draws"],
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
    low, _, middle, _, high = (f"{q:.{digits}f}" for q in of["quantiles"])
    return f"{middle} ({low} to {high})"


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


def rounded(value: Any) -> Any:
    """The same with numbers of so many digits; None where there is none."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    return value


def write(rows: list[dict[str, Any]], out: Path) -> None:
    """Key figures, table and figure."""
    out.mkdir(parents=True, exist_ok=True)
    content = {"tolerance": TOLERANCE, "recommended": RECOMMENDED, "models": rows}
    (out / "expected.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    lines = flat(rows)
    columns = list(dict.fromkeys(name for line in lines for name in line))
    with (out / "choosing_irb120_poses.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    draw(rows, out / "choosing_irb120_poses.png")


def main() -> None:
    """Run, print, and write table, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    out: Path = parser.parse_args().out
    data = measuring_arm.data_folder()
    if not (data / "identification" / "abb_irb120").is_dir():
        print(f"skipped: no measurements of the IRB 120 in {data}; POSEDESIGN_DATA names another")
        return
    rows = rounded(run(data))
    print(table(rows))
    write(rows, out)


if __name__ == "__main__":
    main()
