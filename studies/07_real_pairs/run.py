"""Run the study: python studies/07_real_pairs/run.py [--out DIR].

It needs measurements that the project does not contain: the folder that POSEDESIGN_DATA names, or
``../shared/data`` beside the checkout.
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

from real_figure import draw  # noqa: E402
from real_rows import against_images, proof, row_names, row_of, solved  # noqa: E402
from real_sets import MM, Sides, data_folder, from_the_images, real_pairs  # noqa: E402
from real_splits import compared  # noqa: E402
from real_tables import all_tables  # noqa: E402

from calib.robot_world import PairNoise, solve  # noqa: E402
from calib.robot_world.results import residuals  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
TOLERANCE = 2e-3
"""Of the figures on another machine, relative: the noise that is estimated settles to less."""

DIGITS = 8
"""Significant digits of what is written."""


def run(data: Path, methods: Iterable[str] | None = None, sigma: bool = True) -> dict[str, Any]:
    """All figures of the study, of all methods or of some."""
    names = row_names(methods)
    every = real_pairs(data)
    found = {name: of_data_set(sides, name, names, sigma) for name, sides in every.items()}
    return {
        "tolerance": TOLERANCE,
        "data": found,
        "images": images(every["Tabb"], data),
    }


def of_data_set(sides: Sides, name: str, names: list[str], sigma: bool) -> dict[str, Any]:
    """Every method on one data set, their predictions, and what is proven of ``ml``."""
    results = {method: solved(sides, method, SETTINGS) for method in names}
    noted = {method: list(result.warnings) for method, result in results.items()}
    return {
        "reference": SETTINGS["reference"][name],
        "rows": [row_of(method, result, sigma) for method, result in results.items()],
        "splits": compared(sides, names, SETTINGS),
        "certificate": proof(sides, results["ml"]),
        "warnings": {method: said for method, said in noted.items() if said},
        "left_out": {
            method: (np.flatnonzero(~result.used) + 1).tolist()
            for method, result in results.items()
            if not result.used.all()
        },
    }


def images(sides: Sides, data: Path) -> dict[str, Any]:
    """Tabb's X and Z from the images against ours, by the side that the noise is put on."""
    reference = from_the_images(data)
    estimated = solve(*sides, "ml")
    noise = estimated.noise
    if not isinstance(noise, PairNoise):
        raise RuntimeError(f"no noise to weigh by: {estimated.message}")
    found = {"B, estimated": against_images(estimated, reference)}
    for side in ("A", "both"):
        moved = PairNoise(noise.rotation_rad, noise.translation_m, side)
        found[f"{side}, of the same size"] = against_images(solve(*sides, "ml", moved), reference)
    error = residuals(*sides, *reference)
    rms = [float(np.sqrt((error[:, part] ** 2).sum(axis=1).mean())) for part in np.s_[:3, 3:]]
    return {
        "noise_on": found,
        "reference_rms_deg": float(np.degrees(rms[0])),
        "reference_rms_mm": rms[1] / MM,
    }


def rounded(value: Any) -> Any:
    """Numbers with :data:`DIGITS` digits, in whatever holds them."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def write_csv(found: dict[str, Any], path: Path) -> None:
    """A row for each data set and method, with its predictions of halves."""
    rows = []
    for name, of in found["data"].items():
        for row in of["rows"]:
            halves = of["splits"]["methods"][row["method"]]
            halves = {f"half_{key}": value for key, value in halves.items()}
            rows.append(rounded({"data": name, **row, **halves}))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Run, print, and write table, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out: Path = arguments.out
    data = data_folder()
    if not (data / "robot_world").is_dir():
        print(f"skipped: no pairs of real robots in {data}; POSEDESIGN_DATA names another folder")
        return
    found = run(data)
    for name, table in all_tables(found).items():
        print(f"{name}\n{table}\n")
    for name, of in found["data"].items():
        splits = of["splits"]
        print(f"{name}: {splits['splits']} splits, {splits['unidentified']} identify nothing;")
        for method, rows in of["left_out"].items():
            print(f"  {method} leaves out {rows} (counted from 1)")
        for method, said in of["warnings"].items():
            print(f"  {method}: {'; '.join(said)}")
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(rounded(found), indent=1)
    (out / "expected.json").write_text(text + "\n", encoding="utf-8")
    write_csv(found, out / "real_pairs.csv")
    draw(found, out / "real_pairs.png")


if __name__ == "__main__":
    main()
