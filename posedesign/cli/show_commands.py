"""Commands that show what there is: view, report, board."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli import output


def view(
    cell: output.CellFile,
    poses: Annotated[
        Path | None, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Of the address; the next that is free.")
    ] = 8080,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write one HTML file that needs no server.")
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(help="Cameras and targets of a pairs.csv, its A in the base of the cell."),
    ] = None,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Show the cell in 3-D in the browser, with its poses and the motions between them."""
    from posedesign.cell import Cell
    from posedesign.hand_eye.pairs import read_pairs
    from posedesign.planning import off_target
    from posedesign.planning.checks import ON_TARGET_M
    from posedesign.report.plans import answer_of_check
    from posedesign.report.scene import LiveScene, write_scene
    from posedesign.report.tour import Tour

    loaded = Cell.load(cell)
    listed = None if poses is None else output.poses_of(loaded, poses, trust_units=trust_units)
    measured = None if pairs is None else read_pairs(pairs, trust_units=trust_units)
    output.note(output.rehearsed_words(poses, pairs))
    claims = []
    if out is not None:
        results = output.results_in(out.parent, "view", cell, poses, pairs, overwrite=overwrite)
        claims = results.claim("planned", (out.name, "scene in 3-D"))
    with output.knowing(loaded), output.progress("checking poses and motions"):
        tour = Tour.of(loaded, listed, measured)
    for said in loaded.not_checked:
        output.note(f"not checked: {said}")
    if listed is not None:
        touching = listed.measured
        off = off_target(
            loaded, touching.names, touching.postures, ON_TARGET_M, loaded.which(touching.labels)
        )
        output.say(answer_of_check(loaded, tour.verdicts[1:], off).verdict)
    if claims:
        write_scene(loaded, tour, claims[0])
        output.say(f"wrote {out}")
        return output.DONE
    live = LiveScene(loaded, tour, port)
    output.say(f"the cell is at {live.address}, until Ctrl-C")
    sys.stdout.flush()  # there is no end to wait for
    try:
        live.run()
    except KeyboardInterrupt:  # how a person ends it
        live.server.stop()
    return output.DONE


def report(
    folder: Annotated[Path, typer.Argument(help="With cell.toml, poses.csv, identification.json.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for report.html. [that of the files]")
    ] = None,
    overwrite: output.Overwrite = False,
) -> int:
    """Write one page of HTML, report.html, of all that is in a folder."""
    from posedesign.report.page import write_report

    with output.progress("report"):
        page = write_report(folder, output.results_in(out or folder, "report", overwrite=overwrite))
    output.say(f"wrote: {page}, {page.stat().st_size / 1e6:.1f} MB")
    return output.DONE


def board(
    cell: output.CellFile,
    out: Annotated[Path, typer.Option("--out", help="The drawing: a .pdf or a .svg file.")],
    page: Annotated[
        str, typer.Option(help="a4, a3, letter, or board: as large as the board needs.")
    ] = "a4",
    overwrite: output.Overwrite = False,
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
    results = output.results_in(out.parent, "board", cell, overwrite=overwrite)
    # a PDF has no place for its origin
    bare = out.suffix.lower() == ".pdf"
    (claim,) = results.claim("planned", (out.name, "calibration board"), bare=bare)
    write_board(described, claim, page=page)
    output.say(f"{described.words}, on {sheet.width_mm:g} x {sheet.height_mm:g} mm: wrote {out}")
    output.say("print at 100 %, and measure the ruler: it is 100 mm long")
    return output.DONE
