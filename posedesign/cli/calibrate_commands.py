"""Commands with measurements: simulate, identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    note,
    note_misfit,
    print_json,
    results_in,
    say,
    say_rehearsed,
    show_file,
)
from posedesign.cli.plan_commands import (
    LARGEST_SEED,
    AsJson,
    CellFile,
    OutFolder,
    Overwrite,
    TrustUnits,
)


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(simulate)
    app.command()(identify)


def simulate(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")],
    out: OutFolder = Path("rehearsal"),
    seed: Annotated[
        int | None, typer.Option(min=0, max=LARGEST_SEED, help="Of the noise; default: the cell's.")
    ] = None,
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Rehearse: touch up the poses with a simulated robot, into a folder of its own."""
    from posedesign import workflow
    from posedesign.cell import Cell
    from posedesign.planning.poses_file import read_poses

    loaded = Cell.load(cell)
    listed = read_poses(
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
    )
    note_misfit(poses, listed)
    results = results_in(out, "simulate", cell, poses, overwrite=overwrite)
    workflow.simulate(loaded, listed, results, seed)
    count = len(listed.measured.names)
    touched = [] if loaded.is_hand_eye else [str(out / "touchups.csv")]
    files = touched + [str(out / "pairs.csv")] * loaded.has_camera
    if as_json:
        print_json({"touch_ups": count if touched else 0, "files": files})
    else:
        what = "touch-ups" if touched else "pairs of A X = Z B"
        say(f"wrote {' and '.join(files)}: {count} {what}, SIMULATED")
    return DONE


def identify(
    cell: CellFile,
    measurements: Annotated[
        Path, typer.Argument(help="touchups.csv, or any kinds: target, j1_deg, .., kind, x_mm, ..")
    ],
    out: OutFolder = Path(),
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Identify the robot from measurements, by every model of the cell.

    Beside the baselines that leave the robot as it is; each judged by what it did not see.
    """
    from posedesign.cell import Cell
    from posedesign.cli.identification_output import print_identification
    from posedesign.workflow import identify_file

    identified = identify_file(
        Cell.load(cell),
        measurements,
        results_in(out, "identify", cell, overwrite=overwrite),
        trust_units=trust_units,
        warn=lambda text: note(f"warning: {text}"),
    )
    say_rehearsed(cell, measurements, as_json=as_json)
    if as_json:
        show_file((out / "identification.json").read_text(encoding="utf-8"))
    else:
        print_identification(identified)
        say(f"wrote {out / 'identification.json'}")
    return DONE if identified.is_of_this_robot else NOT_REACHED
