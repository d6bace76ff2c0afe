"""The tables of the README, from the figures of the study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from studies.writing import table_of

Found = Mapping[str, Any]


def _pair(row: Found, name: str) -> str:
    return f"{row[f'{name}_deg']:.3f} / {row[f'{name}_mm']:.4g}"


def _sigma(row: Found, letter: str) -> str:
    deg, mm = (row[f"sigma_{letter}_{unit}"] for unit in ("deg", "mm"))
    return "-" if deg is None else f"{deg:.2g} / {mm:.3g}"


def of_data_set(rows: Iterable[Found]) -> str:
    """Every method on one data set."""
    head = [
        "method",
        "rms [deg / mm]",
        "left-out rms",
        "median",
        "left-out median",
        "σ of X [deg / mm]",
        "σ of Z",
        "pairs left out",
        "status",
    ]
    cells = [
        [
            row["method"],
            *(_pair(row, name) for name in ("rms", "out_rms", "median", "out_median")),
            *(_sigma(row, letter) for letter in "XZ"),
            str(row["left_out"]),
            row["status"],
        ]
        for row in rows
    ]
    return table_of(head, cells)


def against_reference(found: Found) -> str:
    """The other program's maximum likelihood, and this one's."""
    head = [
        "data",
        "pairs",
        "reference",
        "here",
        "left-out rms",
        "noise on B estimated",
        "left-out",
    ]
    cells = []
    for name, of in found["data"].items():
        first, second = of["rows"][:2]
        cells.append(
            [
                name,
                str(first["pairs"]),
                " / ".join(of["reference"]),
                _pair(first, "rms"),
                _pair(first, "out_rms"),
                _pair(second, "rms"),
                _pair(second, "out_rms"),
            ]
        )
    return table_of(head, cells)


def prediction(found: Found) -> str:
    """Prediction by halves: the method's error over that of ml, and in how many splits it loses."""
    names = list(found["data"])
    head = ["method", *(f"{name}: rms [deg], [mm]" for name in names), "worse in mm [%]"]
    methods = found["data"][names[0]]["splits"]["methods"]
    cells = []
    for method in methods:
        of = [found["data"][name]["splits"]["methods"][method] for name in names]
        worse = [row["rms_mm_worse"] for row in of]
        cells.append(
            [
                method,
                *(f"{row['rms_deg_ratio']:.3f}, {row['rms_mm_ratio']:.3f}" for row in of),
                "-" if worse[0] is None else ", ".join(f"{100 * share:.0f}" for share in worse),
            ]
        )
    return table_of(head, cells)


def certificates(found: Found) -> str:
    """What is proven of each solution of ml."""
    head = ["data", "noise on B [deg / mm]", "χ²", "relative gap", "status", "only one"]
    cells = []
    for name, of in found["data"].items():
        proof, row = of["certificate"], of["rows"][1]
        cells.append(
            [
                name,
                f"{row['noise_deg']:.3f} / {row['noise_mm']:.3g}",
                f"{proof['chi2']:.1f}",
                f"{proof['relative_gap']:.0e}",
                proof["status"],
                "yes" if proof["unique"] else "no",
            ]
        )
    return table_of(head, cells)


def images(found: Found) -> str:
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
        "images": images(found),
    }
    return every | {name: of_data_set(of["rows"]) for name, of in found["data"].items()}


def said(found: Found) -> str:
    """All of them, each with its name."""
    return "\n\n".join(f"{name}\n{table}" for name, table in all_tables(found).items())
