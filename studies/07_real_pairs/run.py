"""Run the study: ``posedesign study run real_pairs``, or this file as a script.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from real_figure import draw  # noqa: E402
from real_rows import ON_B, against_images, proof, row_names, row_of, solved  # noqa: E402
from real_splits import compared  # noqa: E402
from real_tables import said  # noqa: E402

from calib.robot_world import PairNoise, solve  # noqa: E402
from calib.robot_world.results import residuals  # noqa: E402
from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402
from studies.real_data import data_with  # noqa: E402
from studies.real_pairs import (  # noqa: E402
    MM,
    TABB,
    TAGS,
    UR3E,
    Sides,
    from_the_images,
    real_pairs,
)

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
TOLERANCE = 2e-3
"""Of the figures on another machine, relative: the noise that is estimated settles to less."""

DIGITS = 8
"""Significant digits of what is written."""

TABLE, FIGURE = "real_pairs.csv", "real_pairs"


def study(options: Options) -> dict[str, Any]:
    """Which method fits and predicts pairs of real robots best?

    The pairs are what they are, and every half of their runs has its turn: nothing is drawn at
    random, and a number of trials is ignored.
    """
    found = run(data_with(UR3E, TAGS, TABB), advance=options.advance)
    writing.write_rows(options.out, TABLE, flat(found), DIGITS)
    rounded: dict[str, Any] = writing.rounded(found, DIGITS)
    writing.write_figures(options.out, rounded)
    return rounded


def plot(folder: Path) -> list[Path]:
    """What each method leaves of pairs held out."""
    return writing.save(draw(writing.read_rows(folder, TABLE)), folder, FIGURE)


def run(
    data: Path,
    methods: Iterable[str] | None = None,
    sigma: bool = True,
    advance: Advance = lambda what, part: None,
) -> dict[str, Any]:
    """All figures of the study, of all methods or of some."""
    names = row_names(methods)
    every = real_pairs(data)
    found = {}
    for k, (name, sides) in enumerate(every.items()):
        own = writing.part_of(advance, k, len(every), name)
        found[name] = of_data_set(sides, name, names, sigma, own)
    return {
        "tolerance": TOLERANCE,
        "data": found,
        "images": images(every["Tabb"], data),
    }


def of_data_set(
    sides: Sides, name: str, names: list[str], sigma: bool, advance: Advance
) -> dict[str, Any]:
    """Every method on one data set, their predictions, and what is proven of ``ml``."""
    results = {}
    for k, method in enumerate(names):
        advance(method, 0.5 * k / len(names))
        results[method] = solved(sides, method, SETTINGS)
    advance("predictions", 0.5)
    noted = {method: list(result.warnings) for method, result in results.items()}
    return {
        "reference": SETTINGS["reference"][name],
        "rows": [row_of(method, result, sigma) for method, result in results.items()],
        "splits": compared(sides, names, SETTINGS),
        "certificate": proof(sides, results[ON_B]),
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
    estimated = solve(*sides, "ml", "B")
    noise = estimated.noise
    if not isinstance(noise, PairNoise):
        raise RuntimeError(f"no noise to weigh by: {estimated.message}")
    found = {"B, estimated": against_images(estimated, reference)}
    for side in ("A", "both"):
        moved = PairNoise(noise.rotation_rad, noise.translation_m, side)
        found[f"{side}, of the same size"] = against_images(solve(*sides, "ml", moved), reference)
    found["both, as the residuals show it"] = against_images(solve(*sides, "ml"), reference)
    error = residuals(*sides, *reference)
    rms = [float(np.sqrt((error[:, part] ** 2).sum(axis=1).mean())) for part in np.s_[:3, 3:]]
    return {
        "noise_on": found,
        "reference_rms_deg": float(np.degrees(rms[0])),
        "reference_rms_mm": rms[1] / MM,
    }


def flat(found: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each data set and method, with its predictions of halves."""
    rows = []
    for name, of in found["data"].items():
        for row in of["rows"]:
            halves = of["splits"]["methods"][row["method"]]
            rows.append({"data": name, **row} | {f"half_{key}": v for key, v in halves.items()})
    return rows


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, said)


if __name__ == "__main__":
    main()
