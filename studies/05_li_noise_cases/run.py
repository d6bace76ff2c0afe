"""Run the study: python studies/05_li_noise_cases/run.py [--trials N] [--out DIR].

The part on real pairs needs measurements that the project does not contain: the folder that
POSEDESIGN_DATA names, or ``../shared/data`` beside the checkout. It is left out without them.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from li_cases import MEASURES, SHOWN, SOLVERS, draw, errors  # noqa: E402
from li_claims import Cell, Found, claims, median_interval  # noqa: E402
from li_figures import draw_averages, draw_medians  # noqa: E402
from li_table import data_folder, measured, real_pairs, simulated  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""


def cells(poses: Iterable[int] | None = None) -> list[Cell]:
    """Workspace, noisy side and number of poses of every cell."""
    return [
        (workspace, noisy, n)
        for workspace in SETTINGS["workspaces"]
        for noisy in SETTINGS["noisy"]
        for n in poses or SETTINGS["poses"]
    ]


def run(trials: int | None = None, poses: Iterable[int] | None = None, stream: int = 0) -> Found:
    """Errors of every method in every cell; each cell has random numbers of its own."""
    found = {}
    every = cells(SETTINGS["poses"])
    for cell in cells(poses):
        workspace, noisy, n = cell
        rng = np.random.default_rng([SETTINGS["seed"], stream, every.index(cell)])
        cone_deg = SETTINGS["workspaces"][workspace]
        data = draw(rng, trials or SETTINGS["trials"], n, noisy, cone_deg, SETTINGS)
        found[cell] = {name: errors(data, solve(data)) for name, solve in SOLVERS.items()}
    return found


def table(found: Found) -> list[dict[str, Any]]:
    """A row for each cell and method: medians with intervals, means, what 95 % stay below."""
    rows = []
    for (workspace, noisy, n), methods in found.items():
        for name, values in methods.items():
            row: dict[str, Any] = {"workspace": workspace, "noisy": noisy, "poses": n}
            row["method"] = name
            for title, column in zip(MEASURES, values.T, strict=True):
                low, high = median_interval(column)
                row[f"{title}_median"] = np.median(column)
                row[f"{title}_median_low"], row[f"{title}_median_high"] = low, high
                row[f"{title}_mean"] = column.mean()
                row[f"{title}_95"] = np.quantile(column, 0.95)
            rows.append({k: rounded(v) for k, v in row.items()})
    return rows


def rounded(value: Any) -> Any:
    """Numbers with :data:`DIGITS` digits, in whatever holds them."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def table_1(trials: int | None = None) -> dict[str, Any]:
    """E of seven poses: by simulation, and of real pairs where there are any."""
    rng = np.random.default_rng([SETTINGS["seed"], 1])
    found = {"simulated": simulated(rng, trials or SETTINGS["trials"], SETTINGS)}
    pairs = real_pairs(data_folder())
    if pairs:
        found["measured"] = measured(rng, pairs, SETTINGS)
    else:
        print(f"real pairs left out: none in {data_folder()}; POSEDESIGN_DATA names another folder")
    return found


def main() -> None:
    """Run, print, and write tables, figures and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, help="problems for each cell")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    found = run(arguments.trials)
    paper = run(SETTINGS["paper_trials"], stream=1)
    rows = table(found)
    said = {
        "trials": arguments.trials or SETTINGS["trials"],
        "medians": [
            {k: v for k, v in row.items() if k in ("workspace", "noisy", "poses", "method")}
            | {title: row[f"{title}_median"] for title in MEASURES}
            for row in rows
            if row["method"] in SHOWN
        ],
        **claims(found, SETTINGS["paper_trials"]),
        "table_1": table_1(arguments.trials),
    }
    (out / "expected.json").write_text(json.dumps(rounded(said), indent=1) + "\n")
    with (out / "li_noise_cases.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw_medians(found, out / "li_noise_cases.png")
    draw_averages(found, paper, out / "li_averages_of_ten.png")
    for row in said["order"]:
        print(
            "{better} < {worse}, {error}, {poses} poses: holds {holds}, reversed {reversed}, "
            "undecided {undecided}, share {share_least:.3f} to {share_most:.3f}".format(**row)
        )
    for key in ("steps", "propagation", "averages"):
        print(*said[key], sep="\n")
    print(json.dumps(rounded(said["table_1"]), indent=1))


if __name__ == "__main__":
    main()
