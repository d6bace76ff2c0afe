"""Run the study: ``posedesign study run kinhec``."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from calib.errors import InputError
from posedesign.report.drawing import BLACK, set_answer
from posedesign.study import Options
from studies import writing
from studies.drawing import log_ticks, rows_with_intervals
from studies.writing import Cell, cell, span, table

from . import kinhec_rows as sequences
from . import kinhec_table as tables

SETTINGS = writing.settings_of(__file__)
DIGITS = 4
TABLES = ("errors", "compared", "stated", "clocks")
FIGURE = "kinhec"
TICKS = (1, 2, 5, 10, 20)

NAMED_BY = "POSEDESIGN_KINHEC"
"""Variable of the environment that names a folder with the tier, generated before."""

Found = Mapping[str, Any]


def study(options: Options) -> dict[str, Any]:
    """How near are ours and the eleven baselines of KinHEC on its own sequences?

    A trial is a sequence: a short form takes the first ones of each track.
    """
    sequences.check_installed(SETTINGS["version"])
    limit = None if options.trials is None else writing.trials_of(options, 2)
    with TemporaryDirectory() as scratch:
        folder = data_folder(Path(scratch), limit, options)
        rows = pd.DataFrame(evaluated(folder, limit, options))
    said: dict[str, Any] = {"version": SETTINGS["version"], "tier": SETTINGS["tier"]}
    said |= {name: getattr(tables, name)(rows) for name in TABLES}
    files = {f"kinhec_{name}.csv": said[name] for name in TABLES}
    return writing.write_rounded(options.out, said, DIGITS, files)


def data_folder(scratch: Path, limit: int | None, options: Options) -> Path:
    """The folder of the data: one that is named, or one that KinHEC generates here."""
    named = os.environ.get(NAMED_BY)
    if not named:
        options.advance("KinHEC generates its sequences", 0.0)
        sequences.generate(SETTINGS["tier"], scratch, limit)
        return scratch
    folder = Path(named)
    if not (folder / "sequences.parquet").is_file():
        raise InputError(
            f"{folder} has no sequences of KinHEC",
            hint=f"generate them: kinhec generate --tier {SETTINGS['tier']} --out {folder}",
            name=NAMED_BY,
            value=named,
        )
    return folder


def evaluated(folder: Path, limit: int | None, options: Options) -> list[dict[str, Any]]:
    """Rows of all sequences, clocks and solvers."""
    rows = []
    with sequences.registered() as solvers:
        for part, number, sequence in sequences.sequences(folder, limit):
            options.advance(sequence.id, part)
            scaled = sequence.manifest["track"] in SETTINGS["scaled"]
            rows += sequences.rows_of(sequence, number, solvers, scaled)
    return rows


def plot(folder: Path) -> list[Path]:
    """How many times as far off as ours the best baseline is."""
    rows = writing.read_rows(folder, "kinhec_compared.csv")
    return writing.save(draw(rows), folder, FIGURE)


def draw(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Errors of the best baseline over ours, with intervals: a row for each setting."""
    shown = [r for r in rows if r["of"] == "all answers" and r["figure"] in ("X_mm", "X_deg")]
    names = {"X_mm": "translation", "X_deg": "rotation"}
    shown = [r | {"series": names[str(r["figure"])]} for r in shown]
    settings = list(dict.fromkeys(r["setting"] for r in shown))
    figure = Figure(figsize=(8.5, 1.6 + 0.4 * len(settings)), layout="constrained")
    axes = figure.subplots()
    rows_with_intervals(axes, shown, "setting", "series", ("ratio", "ratio_low", "ratio_high"))
    log_ticks(axes, TICKS)
    axes.axvline(1.0, color=BLACK, lw=1.0)
    axes.set_xlabel("error of the best baseline over ours, log scale; ours is nearer on the right")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    set_answer(figure, answer_of(shown), "Medians over sequences that both answer, 95 % intervals.")
    return figure


def answer_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """What the figure shows, in a sentence."""
    mm = [r for r in rows if r["figure"] == "X_mm"]
    ours = [r["setting"] for r in mm if r["ratio_low"] > 1.0]
    theirs = [r["setting"] for r in mm if r["ratio_high"] < 1.0]
    return (
        f"X in mm: ours is nearer in {len(ours)} of {len(mm)} settings, "
        f"the best baseline in {len(theirs)}; the rest cannot be told apart"
    )


def markdown(found: Found) -> str:
    """Every table of the README."""
    parts = [
        table(compared_rows(found["compared"]), COMPARED),
        table(found["stated"], STATED),
        table(found["clocks"], CLOCKS),
    ]
    for setting in dict.fromkeys(row["setting"] for row in found["errors"]):
        own = [row for row in found["errors"] if row["setting"] == setting]
        count = own[0]["sequences"]
        parts.append(f"**{setting}** ({count} sequences)\n\n{table(own, ERRORS)}")
    return "\n\n".join(parts)


def compared_rows(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Rows of the README: all figures of all answers, X in mm of those that are ok."""
    return [r for r in rows if r["of"] == "all answers" or r["figure"] == "X_mm"]


def _median(name: str) -> Cell:
    """Median with its interval; the median alone where its upper end is without an answer."""

    def shown(row: Mapping[str, Any]) -> str:
        if name not in row:
            return ""
        none = cell(row, f"{{{name}:n}}", "none")
        return cell(row, span("n", name, f"{name}_low", f"{name}_high"), none)

    return shown


def _largest(name: str) -> Cell:
    return lambda row: cell(row, f"{{{name}_90:n}}", "none") if name in row else ""


def _solver(row: Mapping[str, Any]) -> str:
    name = str(row["solver"])
    return f"**{name}**" if name in tables.EVERY_OURS else name


def _cpu(row: Mapping[str, Any]) -> str:
    every = cell(row, " ({cpu_all_ms:n})") if row.get("cpu_all_ms") is not None else ""
    return cell(row, "{cpu_ms:n}") + every


ERRORS: Mapping[str, Cell] = {
    "solver": _solver, "no answer": "{without_answer}",
    "X [deg]": _median("X_deg"), "90 % of X [deg]": _largest("X_deg"),
    "X [mm]": _median("X_mm"), "90 % of X [mm]": _largest("X_mm"),
    "Y [deg]": _median("Y_deg"), "90 % of Y [deg]": _largest("Y_deg"),
    "Y [mm]": _median("Y_mm"), "90 % of Y [mm]": _largest("Y_mm"),
    "CPU [ms]": _cpu,
}  # fmt: skip
COMPARED: Mapping[str, Cell] = {
    "setting": "{setting}", "our answers": "{of}",
    "figure": lambda r: r["figure"].replace("_", " "), "best baseline": "{best}",
    "sequences": "{sequences}", "ours": "{ours:n}", "theirs": "{theirs:n}",
    "90 % ours": "{ours_90:n}", "90 % theirs": "{theirs_90:n}",
    "theirs over ours": span("n", "ratio"), "ours nearer [%]": span("p", "nearer"),
}  # fmt: skip
STATED: Mapping[str, Cell] = {
    "setting": "{setting}", "solver": "{solver}", "sequences": "{sequences}", "ok": "{ok}",
    "not ok": "{other_status}", "refused": "{refused}",
    "X covered [%]": span("p", "covered_X"), "Y covered [%]": span("p", "covered_Y"),
    "ok, beyond 4 sigma": "{ok_beyond_4_sigma}",
}  # fmt: skip
CLOCKS: Mapping[str, Cell] = {
    "setting": "{setting}", "by": "{by}", "sequences": "{sequences}",
    "no answer": "{without_answer}", "offset off [ms]": _median("ms"), "90 %": _largest("ms"),
    "covered, ok answers [%]": lambda r: cell(r, span("p", "covered")) if "covered" in r else "-",
}  # fmt: skip
