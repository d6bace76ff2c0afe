"""Run the study: ``posedesign study run calibration_by_touch_up``, or this file as a script."""

from __future__ import annotations

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
from touch_tables import tables  # noqa: E402
from touch_variation import PAPER, causes, every, rows, through_pictures  # noqa: E402

from posedesign.study.library import Options  # noqa: E402
from studies import writing  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
SHOWN = next(iter(SETTINGS["arms"]))
"""The arm whose variation is drawn."""

DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

DATA_SETS = "data_sets.csv"
_STREAM = 5


def study(options: Options) -> dict[str, Any]:
    """Does a low condition number make calibration by visual touch-up stable, and right?

    A trial is a data set: one round of touch-ups of a pose set. A short form of N has no more than
    N arms drawn at random either, and no more data sets than N wherever the full one has fewer.
    Twice the data sets of one experiment are the least.
    """
    settings = shortened(options)
    benches = {arm: bench_of(arm, settings) for arm in settings["arms"]}
    cell = benches[SHOWN].cell
    sets = [pose_set(cell, threshold) for threshold in settings["thresholds"]]
    steps = len(benches) + 3
    said: dict[str, Any] = {"many": settings["many"], "arms": {}}
    ten: list[dict[str, Any]] = []
    for k, (arm, bench) in enumerate(benches.items()):
        options.advance(f"{arm} arm", k / steps)
        said["arms"][arm], own = run(bench, sets, arm)
        ten += own
    options.advance("causes of errors", (steps - 3) / steps)
    said["causes"] = causes(benches[SHOWN], settings["arms"][SHOWN], sets)
    options.advance("through pictures", (steps - 2) / steps)
    said["pictures"] = through_pictures(benches[SHOWN], sets)
    options.advance("arms drawn at random", (steps - 1) / steps)
    said["robots"] = robots(benches[SHOWN])
    figures: dict[str, Any] = writing.rounded(said, DIGITS)
    for part in ("variation", "plate"):
        writing.write_rows(options.out, f"{part}.csv", _every(figures, part), DIGITS)
    writing.write_rows(options.out, DATA_SETS, ten, DIGITS)
    writing.write_figures(options.out, figures)
    return figures


def plot(folder: Path) -> list[Path]:
    """Variation of the offset of joint 2, and distances on the plate, against C_G."""
    said = writing.read_figures(folder)
    shown = [row for row in writing.read_rows(folder, DATA_SETS) if row["arm"] == SHOWN]
    variation = draw_variation(said["arms"][SHOWN]["variation"], shown)
    plate = draw_plate(said["arms"], said["robots"], PAPER.name)
    return [
        *writing.save(variation, folder, "variation"),
        *writing.save(plate, folder, "plate"),
    ]


def shortened(options: Options) -> dict[str, Any]:
    """The settings, with the numbers of a short form where that is asked for."""
    many = writing.trials_of(options, SETTINGS["many"], 2 * SETTINGS["data_sets"])
    own = {k: min(SETTINGS[k], many) for k in ("pictures_data_sets", "causes_data_sets")}
    drawn = SETTINGS["robots"] | {"count": min(SETTINGS["robots"]["count"], many)}
    return SETTINGS | own | {"many": many, "robots": drawn}


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


def robots(bench: Bench) -> dict[str, Any]:
    """What a calibration does for arms drawn at random."""
    drawn = bench.settings["robots"]
    sets = [pose_set(bench.cell, threshold) for threshold in drawn["thresholds"]]
    return claims.many_arms(drawn_ratios(bench, sets, drawn["count"]), sets)


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


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read."""
    return "\n\n".join("\n".join(lines) for lines in tables(said))


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, markdown)


if __name__ == "__main__":
    main()
