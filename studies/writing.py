"""What all studies share: tables and key figures on disk, figures in two forms, and the script."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posedesign.csv_tables import write_table
from posedesign.files import make_folder, write_json_atomic
from posedesign.study.library import Options
from posedesign.study.runner import Workers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = "figures.json"
"""Key figures of a run, beside its tables: what ``expected.json`` has of the full one."""


def write_figures(out: Path, figures: Mapping[str, Any] | Sequence[Any]) -> Path:
    """Write the key figures of a run."""
    make_folder(out)
    return write_json_atomic(out / FIGURES, figures)


def read_figures(out: Path) -> Any:
    """Key figures of a run; those of the full one where the folder is the study's own."""
    path = out / FIGURES
    if not path.exists():
        path = out / "expected.json"
    return json.loads(path.read_text(encoding="utf-8"))


def write_rows(out: Path, name: str, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write a table, columns as in its first row."""
    make_folder(out)
    return write_table(out / name, list(rows[0]), list(rows))


def save(figure: Figure, out: Path, name: str) -> list[Path]:
    """Save a figure as PNG and SVG, the same bytes for the same figure."""
    import matplotlib
    import matplotlib.pyplot as plt

    make_folder(out)
    paths = [out / f"{name}.png", out / f"{name}.svg"]
    with matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(paths[0], dpi=150, metadata={"Software": None})
        figure.savefig(paths[1], metadata={"Date": None, "Creator": None})
    plt.close(figure)
    return paths


def script(
    study: Callable[[Options], Mapping[str, Any] | Sequence[Any]],
    plot: Callable[[Path], list[Path]],
    here: Path,
) -> None:
    """Run a study as a script: ``python studies/NN_name/run.py [--trials N] [--jobs N] [--out]``.

    Without ``--out`` and ``--trials`` the results are those of the study's own folder, key figures
    included.
    """
    parser = argparse.ArgumentParser(description=study.__doc__)
    parser.add_argument("--trials", type=int, help="in place of the study's own number")
    parser.add_argument("--jobs", type=int, default=1, help="processes, where it uses several")
    parser.add_argument("--out", type=Path, default=here, help="folder for the results")
    given = parser.parse_args()
    options = Options(given.out, given.trials, Workers(given.jobs))
    figures = study(options)
    if given.out == here and given.trials is None:
        write_json_atomic(here / "expected.json", figures)
        (here / FIGURES).unlink(missing_ok=True)
    for path in plot(given.out):
        print(f"drew {path}")
