"""Run the study: python studies/13_calibration_by_touch_up/run.py [--many N] [--arms N] [--out]."""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

import touch_claims as claims  # noqa: E402
from touch_bench import Bench, PoseSet, pose_set  # noqa: E402
from touch_figures import draw_plate, draw_variation  # noqa: E402
from touch_plate import drawn_ratios, plate_rows  # noqa: E402
from touch_tables import rounded, tables  # noqa: E402
from touch_variation import PAPER, causes, every, rows, through_pictures  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
SHOWN = next(iter(SETTINGS["arms"]))
"""The arm whose variation is drawn."""

_STREAM = 5


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


def robots(bench: Bench, count: int | None = None) -> dict[str, Any]:
    """What a calibration does for arms drawn at random."""
    drawn = bench.settings["robots"]
    sets = [pose_set(bench.cell, threshold) for threshold in drawn["thresholds"]]
    return claims.many_arms(drawn_ratios(bench, sets, count or drawn["count"]), sets)


def main() -> None:
    """Run, print, and write tables, figures and key figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--many", type=int, help="data sets of each pose set")
    parser.add_argument("--arms", type=int, help="arms drawn at random")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    settings = SETTINGS | {"many": arguments.many or SETTINGS["many"]}
    benches = {arm: bench_of(arm, settings) for arm in settings["arms"]}
    cell = benches[SHOWN].cell
    sets = [pose_set(cell, threshold) for threshold in settings["thresholds"]]
    said: dict[str, Any] = {"many": settings["many"], "arms": {}}
    ten: list[dict[str, Any]] = []
    for arm, bench in benches.items():
        said["arms"][arm], own = run(bench, sets, arm)
        ten += own
    said["causes"] = causes(benches[SHOWN], settings["arms"][SHOWN], sets)
    said["pictures"] = through_pictures(benches[SHOWN], sets)
    said["robots"] = robots(benches[SHOWN], arguments.arms)
    said = rounded(said)
    (out / "expected.json").write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    _write(out / "variation.csv", _every(said, "variation"))
    _write(out / "plate.csv", _every(said, "plate"))
    _write(out / "data_sets.csv", rounded(ten))
    shown = [row for row in ten if row["arm"] == SHOWN]
    draw_variation(said["arms"][SHOWN]["variation"], shown, out / "variation.png")
    draw_plate(said["arms"], said["robots"], PAPER.name, out / "plate.png")
    print("\n\n".join("\n".join(lines) for lines in tables(said)))


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


def _write(path: Path, table: list[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(name for row in table for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


if __name__ == "__main__":
    main()
