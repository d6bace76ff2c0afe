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
from studies.writing import Cell, cell, table, table_across

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


def _pair(name: str) -> str:
    return f"{{{name}_deg:.3f}} / {{{name}_mm:.4g}}"


OF_DATA_SET: Mapping[str, Cell] = {
    "method": "{method}", "rms [deg / mm]": _pair("rms"), "left-out rms": _pair("out_rms"),
    "median": _pair("median"), "left-out median": _pair("out_median"),
    "σ of X [deg / mm]": "{sigma_X_deg:.2g} / {sigma_X_mm:.3g}",
    "σ of Z": "{sigma_Z_deg:.2g} / {sigma_Z_mm:.3g}",
    "pairs left out": "{left_out}", "status": "{status}",
}  # fmt: skip
REFERENCE: Mapping[str, Cell] = {
    "data": "{data}", "pairs": "{pairs}", "reference": "{reference[0]} / {reference[1]}",
    "here": _pair("rms"), "left-out rms": _pair("out_rms"),
    "noise on B estimated": "{on_B[rms_deg]:.3f} / {on_B[rms_mm]:.4g}",
    "left-out": "{on_B[out_rms_deg]:.3f} / {on_B[out_rms_mm]:.4g}",
}  # fmt: skip
CERTIFICATES: Mapping[str, Cell] = {
    "data": "{data}", "noise on B [deg / mm]": "{noise_deg:.3f} / {noise_mm:.3g}",
    "χ²": "{chi2:.1f}", "relative gap": "{relative_gap:.0e}", "status": "{status}",
    "only one": lambda row: "yes" if row["unique"] else "no",
}  # fmt: skip


def all_tables(found: Mapping[str, Any]) -> dict[str, str]:
    """Every table that the README has."""
    data = found["data"]
    of_ml = [
        first | {"data": name, "reference": of["reference"], "on_B": second}
        for name, of in data.items()
        for first, second in [of["rows"][:2]]
    ]
    proven = [{"data": name} | of["rows"][1] | of["certificate"] for name, of in data.items()]
    by_method = [
        {"method": method} | {name: of["splits"]["methods"][method] for name, of in data.items()}
        for method in next(iter(data.values()))["splits"]["methods"]
    ]
    worse = ", ".join(f"{{{name}[rms_mm_worse]:p}}" for name in data)
    prediction: dict[str, Cell] = {"method": "{method}"}
    for name in data:
        ratios = f"{{{name}[rms_deg_ratio]:.3f}}, {{{name}[rms_mm_ratio]:.3f}}"
        prediction[f"{name}: rms [deg], [mm]"] = ratios
    prediction["worse in mm [%]"] = worse
    every = {
        "reference": table(of_ml, REFERENCE),
        "prediction": table(by_method, prediction),
        "certificates": table(proven, CERTIFICATES),
        "images": _table_of_images(found["images"]["noise_on"]),
    }
    return every | {name: table(of["rows"], OF_DATA_SET) for name, of in data.items()}


def _table_of_images(sides: Mapping[str, Any]) -> str:
    """Tabb's reference from images: differences ± sigma by the side that the noise is put on."""
    rows = []
    for side, of in sides.items():
        for letter, frame in (("X", "target"), ("Z", "camera")):
            for what, unit, how in (("turn", "deg", ".2f"), ("shift", "mm", ".0f")):
                parts = (of["components"][f"{letter} {what} {axis}"] for axis in "xyz")
                shown = f"{{difference:{how}}} ± {{sigma:{how}}}"
                said = ", ".join(cell(part, shown) for part in parts)
                name = f"{what} of {letter}, x y z of the {frame} [{unit}]"
                rows.append({"side": side, "name": name, "said": said})
        rows.append({"side": side, "name": "χ² of 12", "said": f"{of['chi2']:.0f}"})
    columns = {"noise on {}": "{said}"}
    return table_across(rows, {"to the reference": "{name}"}, "side", columns)


def markdown(found: Mapping[str, Any]) -> str:
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
    return {"tolerance": TOLERANCE, "data": found, "images": images(every["Tabb"], data)}


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
