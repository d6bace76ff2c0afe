"""The command that does it all by sight: calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import DONE, NOT_REACHED, note, print_json, print_table, progress, say
from posedesign.cli.plan_commands import LARGEST_SEED, AsJson, CellFile, Overwrite

if TYPE_CHECKING:
    from posedesign.autonomous import SightResult


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command()(calibrate)


def calibrate(
    cell: CellFile,
    out: Annotated[
        Path, typer.Option("--out", help="Folder for the results, and for going on after a stop.")
    ] = Path("calibration"),
    folder: Annotated[
        Path | None,
        typer.Option(
            "--robot-folder",
            help="A real robot behind a folder: programs out, pictures in. Default: simulated.",
        ),
    ] = None,
    images: Annotated[
        bool, typer.Option(help="Simulated: render and measure pictures, or draw their noise.")
    ] = True,
    dialect: Annotated[
        str | None,
        typer.Option(help="Of the programs in the folder; default: the robot's controller's."),
    ] = None,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait-s", min=1.0, max=1e6, help="With a folder: longest wait for a picture."
        ),
    ] = 600.0,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=LARGEST_SEED, help="Of the simulated noise; default: the cell's."),
    ] = None,
    restart: Annotated[
        bool,
        typer.Option(
            "--restart", help="Begin anew: the files made before are put aside, together."
        ),
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> int:
    """Calibrate by sight: find camera and target, plan, touch up, identify.

    From the base pose with the target in view, without knowing where camera and target are. Stop it
    at any time; the same command goes on where it was.
    """
    from posedesign.autonomous import run_by_sight

    with progress("calibrating") as advance:
        done = run_by_sight(
            cell,
            out,
            folder=folder,
            dialect=dialect,
            wait_s=wait_s,
            kind="image" if images else "fast",
            seed=seed,
            restart=restart,
            overwrite=overwrite,
            progress=advance,
            warn=lambda text: note(f"warning: {text}"),
        )
    identified = done.calibration.identified
    if as_json:
        print_json(done.as_dict())
    else:
        if folder is None:
            say("SIMULATED, not for a robot: this is a rehearsal")
        print_calibration(done)
        say(f"everything is in {out}")
    good = done.calibration.plan.reached and not done.calibration.missed
    return DONE if good and identified.is_of_this_robot else NOT_REACHED


def print_calibration(done: SightResult) -> None:
    """Print what was found, what it is worth, and the plate before and after."""
    from posedesign.cli.identification_output import print_identification

    found = done.calibration
    print_table("Camera and target, found by inching around the target", done.set_up_rows())
    for line in done.noise_in_words().splitlines():
        say(line)
    say(f"planned: {found.plan.message}")
    count = len(found.touch_ups.names)
    say(f"touched up: {count} of {count + len(found.missed)} poses")
    print_identification(found.identified)
    if isinstance(done.plate, str):
        say(f"no plate test: {done.plate}")
    elif done.plate is not None:
        print_table(
            "Plate of 5 x 5 targets, 100 mm apart: worst error of a distance [mm]",
            done.plate_rows(),
        )
