"""The command that prints a calibration board: board."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import DONE, results_in, say
from posedesign.cli.plan_commands import CellFile, Overwrite


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(board)


def board(
    cell: CellFile,
    out: Annotated[Path, typer.Option("--out", help="The drawing: a .pdf or a .svg file.")],
    page: Annotated[
        str,
        typer.Option(help="a4, a3, letter, or board: as large as the board needs."),
    ] = "a4",
    overwrite: Overwrite = False,
) -> int:
    """Print the calibration board of the cell to scale, with a ruler to check it by."""
    from calib.errors import InputError
    from posedesign.cell import Cell
    from posedesign.report.boards import Sheet, write_board

    described = Cell.load(cell).board
    if described is None:
        raise InputError(
            f"{cell}: describes no calibration board",
            hint="add a section [board]; posedesign new shows one",
            name="board",
        )
    sheet = Sheet.of(described, page)
    results = results_in(out.parent, "board", cell, overwrite=overwrite)
    # a PDF has no place for its origin
    bare = out.suffix.lower() == ".pdf"
    (claim,) = results.claim("planned", (out.name, "calibration board"), bare=bare)
    write_board(described, claim, page=page)
    say(f"{described.words}, on {sheet.width_mm:g} x {sheet.height_mm:g} mm: wrote {out}")
    say("print at 100 %, and measure the ruler: it is 100 mm long")
    return DONE
