"""Run the study: python studies/09_choosing_panda_touch_ups/run.py [--out DIR].

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

from panda_bench import SITES, bench_of, touched  # noqa: E402
from panda_choice import compare, spread  # noqa: E402
from panda_figure import draw  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
RECOMMENDED = "I at the sockets"
"""Criterion that is held to the bars: it asks for nothing of the site that is to come."""

EVERY = "all sites"
TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""


def run(
    folder: Path, names: Sequence[str] | None = None, criteria: Sequence[str] | None = None
) -> list[dict[str, Any]]:
    """Figures of each model, or of those that are named; by all of its criteria, or by some."""
    recorded = touched.load(folder)
    rows = []
    for row in SETTINGS["model"]:
        if names is not None and row["name"] not in names:
            continue
        tried = [c for c in row["criteria"] if criteria is None or c in criteria]
        found = {}
        for site, name in enumerate(SITES):
            bench = bench_of(recorded, row, site, SETTINGS)
            rng = np.random.default_rng([SETTINGS["seed"], site])
            found[name] = compare(bench, tried, SETTINGS, rng)
        found[EVERY] = together(list(found.values()))
        for of in found.values():
            del of["drawn_mm"]
        rows.append({"model": row["name"], "parameters": bench.model.p, "sites": found})
    return rows


def together(sites: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The same over all sites: root of the mean square of what is left at each."""

    def rms(values: Any) -> Any:
        return np.sqrt(np.mean(np.square(values), axis=0))

    whole = float(rms([of["all_mm"] for of in sites]))
    drawn = rms([of["drawn_mm"] for of in sites])
    chosen = []
    for k, first in enumerate(sites[0]["chosen"]):
        error = float(rms([of["chosen"][k]["error_mm"] for of in sites]))
        chosen.append(
            {
                "criterion": first["criterion"],
                "error_mm": error,
                "over_all": error / whole,
                "better_than": float(np.mean(drawn > error)),
                "efficiency": min(of["chosen"][k]["efficiency"] for of in sites),
            }
        )
    return {
        "all_mm": whole,
        "by_lot_mm": spread(drawn),
        "drawn_mm": drawn,
        "chosen": chosen,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The table of the README: what is left at each site held out, and how it compares."""
    places = [*SITES, EVERY]
    lines = [
        "| model | touch-ups | efficiency | " + " | ".join(f"{p} [mm]" for p in places) + " |",
        "|---" * (3 + len(places)) + "|",
    ]
    for row in rows:
        of = [row["sites"][place] for place in places]
        head = f"| {row['model']} ({row['parameters']}) "
        lines.append(head + "| all 30 | | " + " | ".join(f"{s['all_mm']:.3f}" for s in of) + " |")
        ranges = (_range(s["by_lot_mm"]["quantiles"]) for s in of)
        lines.append(head + "| *10 by lot: median (5 to 95 %)* | | " + " | ".join(ranges) + " |")
        for k, c in enumerate(of[-1]["chosen"]):
            proven = f"{c['efficiency']:.2f}" if c["efficiency"] is not None else ""
            cells = [
                f"{s['chosen'][k]['error_mm']:.3f} (x{s['chosen'][k]['over_all']:.2f}, "
                f"{100 * s['chosen'][k]['better_than']:.0f} %)"
                for s in of
            ]
            lines.append(
                head + f"| 10 by {c['criterion']} | {proven} | " + " | ".join(cells) + " |"
            )
    return "\n".join(lines)


def _range(quantiles: Sequence[float]) -> str:
    low, _, middle, _, high = (f"{q:.3f}" for q in quantiles)
    return f"{middle} ({low} to {high})"


def flat(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A line of the CSV for each choice at each site."""
    lines = []
    for row in rows:
        for place, of in row["sites"].items():
            head = {"model": row["model"], "parameters": row["parameters"], "held_out": place}
            lines.append(head | {"touch_ups": "all", "error_mm": of["all_mm"]})
            middle = of["by_lot_mm"]["quantiles"][2]
            lines.append(head | {"touch_ups": "lot, median", "error_mm": middle})
            lines += [head | {"touch_ups": c["criterion"]} | c for c in of["chosen"]]
    return [{k: v for k, v in line.items() if k != "criterion"} for line in lines]


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
    with (out / "choosing_panda_touch_ups.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    draw(rows, [*SITES, EVERY], out / "choosing_panda_touch_ups.png")


def main() -> None:
    """Run, print, and write table, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    out: Path = parser.parse_args().out
    folder = touched.measurements_folder()
    if folder is None:
        print("skipped: there are no measurements; POSEDESIGN_DATA names their folder")
        return
    rows = rounded(run(folder))
    print(table(rows))
    write(rows, out)


if __name__ == "__main__":
    main()
