"""The command that shows a cell in 3-D: view."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import (
    DONE,
    knowing,
    note,
    note_misfit,
    progress,
    rehearsed_words,
    results_in,
    say,
)
from posedesign.cli.plan_commands import CellFile, Overwrite, TrustUnits


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(view)


def view(
    cell: CellFile,
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
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Show the cell in 3-D in the browser, with its poses and the motions between them."""
    from posedesign.cell import Cell
    from posedesign.hand_eye.pairs import read_pairs
    from posedesign.planning import off_target
    from posedesign.planning.checks import ON_TARGET_M
    from posedesign.planning.poses_file import read_poses
    from posedesign.report.plans import answer_of_check
    from posedesign.report.scene import LiveScene, write_scene
    from posedesign.report.tour import Tour

    loaded, listed = Cell.load(cell), None
    if poses is not None:
        listed = read_poses(
            poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
        )
        note_misfit(poses, listed, loaded)
    measured = None if pairs is None else read_pairs(pairs, trust_units=trust_units)
    note(rehearsed_words(poses, pairs))
    claims = []
    if out is not None:
        results = results_in(out.parent, "view", cell, poses, pairs, overwrite=overwrite)
        claims = results.claim("planned", (out.name, "scene in 3-D"))
    with knowing(loaded), progress("checking poses and motions"):
        tour = Tour.of(loaded, listed, measured)
    for said in loaded.not_checked:
        note(f"not checked: {said}")
    if listed is not None:
        touching = listed.measured
        off = off_target(
            loaded, touching.names, touching.postures, ON_TARGET_M, loaded.which(touching.labels)
        )
        say(answer_of_check(loaded, tour.verdicts[1:], off).verdict)
    if claims:
        write_scene(loaded, tour, claims[0])
        say(f"wrote {out}")
        return DONE
    live = LiveScene(loaded, tour, port)
    say(f"the cell is at {live.address}, until Ctrl-C")
    sys.stdout.flush()  # there is no end to wait for
    try:
        live.run()
    except KeyboardInterrupt:  # how a person ends it
        live.server.stop()
    return DONE
