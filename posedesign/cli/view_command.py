"""The command that shows a cell in 3-D: view."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import DONE, note_misfit, results_in, say, say_what_to_know
from posedesign.cli.plan_commands import CellFile, Overwrite, TrustUnits


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(view)


def view(
    cell: CellFile,
    poses: Annotated[
        Path | None, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of the address in the browser.")] = (
        8080
    ),
    out: Annotated[
        Path | None, typer.Option("--out", help="Write one HTML file that needs no server.")
    ] = None,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Show the cell in 3-D in the browser, with its poses and the motions between them."""
    from posedesign.cell import Cell
    from posedesign.planning.poses_file import read_poses
    from posedesign.report.scene import LiveScene, write_scene
    from posedesign.report.tour import Tour

    loaded = Cell.load(cell)
    listed = None
    if poses is not None:
        listed = read_poses(
            poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
        )
        note_misfit(poses, listed)
    say_what_to_know(loaded)
    if out is not None:
        (file,) = results_in(out.parent, "view", cell, poses, overwrite=overwrite).claim(
            "planned", (out.name, "scene in 3-D")
        )
        write_scene(loaded, Tour.of(loaded, listed), file)
        say(f"wrote {out}")
        return DONE
    live = LiveScene(loaded, Tour.of(loaded, listed), port)
    say(f"the cell is at {live.address}, until Ctrl-C")
    sys.stdout.flush()  # there is no end to wait for
    try:
        live.run()
    except KeyboardInterrupt:  # how a person closes it
        live.server.stop()
    return DONE
