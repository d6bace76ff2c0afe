"""Run the study: ``posedesign study run real_pairs``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.robot_world import PairNoise, residuals, solve
from posedesign.report.drawing import GREY, set_answer
from posedesign.study import Advance, Options
from studies import writing
from studies.drawing import log_ticks, rows_of_marks
from studies.real_data import MM, TABB, TAGS, UR3E, Sides, data_with, from_the_images, real_pairs
from studies.writing import table_by, table_of

from .real_rows import ON_B, against_images, compared, proof, row_names, row_of, solved

LABELS = {
    "deg": "rms rotation left of pairs held out, over that of ml, log scale",
    "mm": "rms distance left of pairs held out, over that of ml, log scale",
}
TICKS = (1, 2, 5, 10, 20)


def draw(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Ratios of every method to ml, in rotation and in translation, one mark a data set."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    sets = list(dict.fromkeys(row["data"] for row in rows))
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for panel, unit in zip(panels, LABELS, strict=True):
        of = {(row["data"], row["method"]): row for row in rows}
        ratios = {
            name: [of[name, method][f"half_rms_{unit}_ratio"] for method in methods]
            for name in sets
        }
        panel.axvline(1.0, color=GREY, lw=1.0)
        rows_of_marks(panel, methods, ratios, apart=0.16)
        log_ticks(panel, TICKS)
        panel.set_xlabel(f"{LABELS[unit]} [-]")
        by_ml = ", ".join(f"{of[name, 'ml'][f'half_rms_{unit}']:.3g}" for name in sets)
        panel.set_title(f"by ml, median of the splits: {by_ml} {unit}", fontsize=9.5)
    panels[0].set_ylim(-0.6, len(methods) - 0.4)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    behind = [
        100.0 * (1.0 / min(row[f"half_rms_{unit}_ratio"] for row in rows) - 1.0) for unit in LABELS
    ]
    set_answer(
        figure,
        f"No method predicts pairs better than ml by more than {behind[0]:.1f} % in rotation and "
        f"{behind[1]:.1f} % in translation, on any of {len(sets)} sets",
    )
    return figure


Found = Mapping[str, Any]


def _pair(row: Found, name: str) -> str:
    return f"{row[f'{name}_deg']:.3f} / {row[f'{name}_mm']:.4g}"


def _sigma(row: Found, letter: str) -> str:
    deg, mm = (row[f"sigma_{letter}_{unit}"] for unit in ("deg", "mm"))
    return "-" if deg is None else f"{deg:.2g} / {mm:.3g}"


def _table_of_data_set(rows: Iterable[Found]) -> str:
    """Every method on one data set."""
    columns = {
        "method": lambda row: row["method"],
        "rms [deg / mm]": lambda row: _pair(row, "rms"),
        "left-out rms": lambda row: _pair(row, "out_rms"),
        "median": lambda row: _pair(row, "median"),
        "left-out median": lambda row: _pair(row, "out_median"),
        "σ of X [deg / mm]": lambda row: _sigma(row, "X"),
        "σ of Z": lambda row: _sigma(row, "Z"),
        "pairs left out": lambda row: str(row["left_out"]),
        "status": lambda row: row["status"],
    }
    return table_by(rows, columns)


def against_reference(found: Found) -> str:
    """The other program's maximum likelihood, and this one's with its ratio and without."""
    columns = {
        "data": lambda item: item[0],
        "pairs": lambda item: str(item[1]["rows"][0]["pairs"]),
        "reference": lambda item: " / ".join(item[1]["reference"]),
        "here": lambda item: _pair(item[1]["rows"][0], "rms"),
        "left-out rms": lambda item: _pair(item[1]["rows"][0], "out_rms"),
        "noise on B estimated": lambda item: _pair(item[1]["rows"][1], "rms"),
        "left-out": lambda item: _pair(item[1]["rows"][1], "out_rms"),
    }
    return table_by(found["data"].items(), columns)


def prediction(found: Found) -> str:
    """Prediction by halves: the method's error over that of ml, and in how many splits it loses."""
    names = list(found["data"])
    head = ["method", *(f"{name}: rms [deg], [mm]" for name in names), "worse in mm [%]"]
    cells = []
    for method in found["data"][names[0]]["splits"]["methods"]:
        of = [found["data"][name]["splits"]["methods"][method] for name in names]
        worse = [row["rms_mm_worse"] for row in of]
        ratios = [f"{row['rms_deg_ratio']:.3f}, {row['rms_mm_ratio']:.3f}" for row in of]
        shares = "-" if worse[0] is None else ", ".join(f"{100 * share:.0f}" for share in worse)
        cells.append([method, *ratios, shares])
    return table_of(head, cells)


def certificates(found: Found) -> str:
    """What is proven of each solution of ml."""
    rows = [
        {"data": name} | of["rows"][1] | of["certificate"] for name, of in found["data"].items()
    ]
    columns = {
        "data": lambda row: row["data"],
        "noise on B [deg / mm]": lambda row: f"{row['noise_deg']:.3f} / {row['noise_mm']:.3g}",
        "χ²": lambda row: f"{row['chi2']:.1f}",
        "relative gap": lambda row: f"{row['relative_gap']:.0e}",
        "status": lambda row: row["status"],
        "only one": lambda row: "yes" if row["unique"] else "no",
    }
    return table_by(rows, columns)


def _table_of_images(found: Found) -> str:
    """Tabb's reference from images: differences ± sigma by the side that the noise is put on."""
    sides = found["images"]["noise_on"]
    head = ["to the reference", *(f"noise on {side}" for side in sides)]
    cells = []
    for letter, frame in (("X", "target"), ("Z", "camera")):
        for what, unit in (("turn", "deg"), ("shift", "mm")):
            digits = 2 if unit == "deg" else 0
            row = [f"{what} of {letter}, x y z of the {frame} [{unit}]"]
            for of in sides.values():
                parts = [of["components"][f"{letter} {what} {axis}"] for axis in "xyz"]
                row.append(
                    ", ".join(
                        f"{p['difference']:.{digits}f} ± {p['sigma']:.{digits}f}" for p in parts
                    )
                )
            cells.append(row)
    cells.append(["χ² of 12", *(f"{of['chi2']:.0f}" for of in sides.values())])
    return table_of(head, cells)


def all_tables(found: Found) -> dict[str, str]:
    """Every table that the README has."""
    every = {
        "reference": against_reference(found),
        "prediction": prediction(found),
        "certificates": certificates(found),
        "images": _table_of_images(found),
    }
    return every | {name: _table_of_data_set(of["rows"]) for name, of in found["data"].items()}


def markdown(found: Found) -> str:
    """All of them, each with its name."""
    return "\n\n".join(f"{name}\n{table}" for name, table in all_tables(found).items())


SETTINGS = writing.settings_of(__file__)
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
    return writing.write_rounded(options.out, found, DIGITS, {TABLE: flat(found)})


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
