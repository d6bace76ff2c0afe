"""Run the study: python studies/11_which_index_predicts/run.py [--trials N] [--sets N] [--out DIR].

Fewer trials for each set, and fewer random sets, for a short look.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from index_choices import chosen  # noqa: E402
from index_figure import draw  # noqa: E402
from index_ranks import Bank, correlations  # noqa: E402
from index_truths import held  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
KINDS = ("same", "mixed")
DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""


def ranked(
    problem: str, trials: int | None = None, sets: int | None = None
) -> list[dict[str, Any]]:
    """Rank correlation of every index with the error, over random sets of both kinds."""
    own = SETTINGS["ranked"]
    bank = Bank(problem, SETTINGS, trials or own["trials"])
    rows = []
    for kind in KINDS:
        found = bank.sets(kind, SETTINGS, sets or own["sets"])
        middle = 1e3 * float(np.median(found.error_m))
        head = {"problem": problem, "sets": kind, "median_error_mm": middle}
        rows += [head | row for row in correlations(found)]
    return rows


def run(trials: int | None = None, sets: int | None = None) -> dict[str, Any]:
    """All three parts."""
    said: dict[str, Any] = {"chosen": [], "ranked": []}
    for problem in SETTINGS["problems"]:
        print(problem, file=sys.stderr)
        said["chosen"] += chosen(problem, SETTINGS, trials=trials)
        said["ranked"] += ranked(problem, trials, sets)
    said["held"] = held(next(iter(SETTINGS["arms"])), SETTINGS, trials=trials)
    return {name: [_rounded(row) for row in rows] for name, rows in said.items()}


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    """Numbers with :data:`DIGITS` digits."""
    return {
        k: float(f"{v:.{DIGITS}g}") if isinstance(v, float | np.floating) else v
        for k, v in row.items()
    }


def markdown(said: dict[str, Any]) -> str:
    """The tables that people read."""
    return "\n\n".join((_chosen_table(said), _ranked_table(said), _held_table(said)))


def _chosen_table(said: dict[str, Any]) -> str:
    lines = []
    by_cell = {(r["criterion"], r["poses"], r["problem"]): r for r in said["chosen"]}
    for name, poses in dict.fromkeys((c, n) for c, n, _ in by_cell):
        cells = [name, f"{poses}"]
        for problem in SETTINGS["problems"]:
            row = by_cell[name, poses, problem]
            cells.append(f"{row['rms_mm']:.4f}".lstrip("0"))
            times = f"{row['times_I']:.2f}"
            if row["times_I_low"] < row["times_I_high"]:
                times += f" ({row['times_I_low']:.2f} to {row['times_I_high']:.2f})"
            cells.append(times)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _ranked_table(said: dict[str, Any]) -> str:
    lines = []
    by_cell = {(r["index"], r["problem"], r["sets"]): r for r in said["ranked"]}
    for name in dict.fromkeys(index for index, _, _ in by_cell):
        cells = [name]
        for kind in KINDS:
            for problem in SETTINGS["problems"]:
                row = by_cell.get((name, problem, kind))
                cells.append(
                    f"{row['rho']:.2f} ({row['low']:.2f} to {row['high']:.2f})" if row else ""
                )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _held_table(said: dict[str, Any]) -> str:
    lines = []
    by_cell = {(r["case"], r["set"]): r for r in said["held"]}
    names = list(dict.fromkeys(s for _, s in by_cell))
    for case in dict.fromkeys(c for c, _ in by_cell):
        cells = [by_cell[case, names[0]]["says"]]
        for name in names:
            row = by_cell[case, name]
            digits = 2 if row["ratio"] < 10 else 0
            cells.append(f"{row['rms_mm']:.3f}".lstrip("0"))
            ends = f"{row['ratio_low']:.{digits}f} to {row['ratio_high']:.{digits}f}"
            cells.append(f"{row['ratio']:.{digits}f} ({ends})")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run, print, and write tables, figure and key figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, help="sets of touch-ups of each set of poses")
    parser.add_argument("--sets", type=int, help="random sets of each kind")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    said = run(arguments.trials, arguments.sets)
    (out / "expected.json").write_text(json.dumps(said, indent=1) + "\n")
    for name, rows in said.items():
        with (out / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    draw(said, out / "which_index_predicts.png")
    print(markdown(said))


if __name__ == "__main__":
    main()
