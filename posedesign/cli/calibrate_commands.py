"""Commands with measurements: simulate, identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    command_line,
    note,
    note_misfit,
    print_json,
    progress,
    rehearsed_words,
    results_in,
    say,
    show_file,
    tell,
)
from posedesign.cli.plan_commands import (
    LARGEST_SEED,
    AsJson,
    CellFile,
    OutFolder,
    Overwrite,
    TrustUnits,
    Verbose,
)


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(simulate)
    app.command()(identify)
    app.command()(calibrate)


def simulate(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")],
    out: OutFolder = Path("rehearsal"),
    seed: Annotated[
        int | None, typer.Option(min=0, max=LARGEST_SEED, help="Of the noise; default: the cell's.")
    ] = None,
    cycles: Annotated[
        int, typer.Option(min=1, max=1000, help="Times that an instrument reads all poses.")
    ] = 1,
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Rehearse: touch up the poses with a simulated robot, into a folder of its own."""
    from posedesign import workflow
    from posedesign.cell import Cell
    from posedesign.planning import check_fit
    from posedesign.planning.poses_file import read_poses
    from posedesign.simulation.pictures import JOINTS, simulate_pictures

    loaded = Cell.load(cell)
    listed = read_poses(
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
    )
    note_misfit(poses, listed)
    results = results_in(out, "simulate", cell, poses, overwrite=overwrite)
    if loaded.sees_board:
        check_fit(loaded, listed)
        with progress("taking pictures", with_time_left=True) as advance:
            own_seed = loaded.config.truth.seed if seed is None else seed
            taken = simulate_pictures(loaded, listed, results, own_seed, advance)
        folder, joints = taken[0].parent, out / JOINTS[0]
        if as_json:
            print_json({"pictures": [str(path) for path in taken], "files": [str(joints)]})
        else:
            say(f"wrote {folder} and {joints}: {len(taken)} pictures of the board, SIMULATED")
            mount = ("--camera", "fixed") if loaded.board_set_up.carried == "board" else ()
            then = ("camera", cell, folder, "--joints", joints, *mount, "--out", out)
            say(f"next: {command_line(*then)}")
        return DONE
    with progress("rehearsing"):
        workflow.simulate(loaded, listed, results, seed, cycles)
    count = len(listed.measured.names)
    written = workflow.simulated_files(loaded)
    files, (_, what) = [str(out / name) for name, _ in written], written[0]
    measures = not loaded.is_hand_eye
    if as_json:
        print_json({"touch_ups": count if measures else 0, "files": files})
    else:
        counted = f"{count} poses, {what}" if what == "measurements" else f"{count} {what}"
        said = counted if measures else f"{count} pairs of A X = Z B"
        say(f"wrote {' and '.join(files)}: {said}, SIMULATED")
        then = ("identify", cell, files[0]) if measures else ("robot-world", *files)
        say(f"next: {command_line(*then, '--out', out)}")
    return DONE


def identify(
    cell: CellFile,
    measurements: Annotated[
        Path,
        typer.Argument(
            help="touchups.csv, or any kinds: target, j1_deg, .., kind, x_mm, ..; or the file of "
            "an instrument, as [instrument] of the cell says"
        ),
    ],
    joints: Annotated[
        Path | None,
        typer.Option(
            "--joints",
            help="Joints for the file of an instrument: a table (j1_deg ..), a log (RTDE, EGM, "
            "RSI, ROS), a program.",
        ),
    ] = None,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Identify the robot from measurements, by every model of the cell.

    Beside the baselines that leave the robot as it is; each judged by what it did not see.
    """
    from posedesign.cell import Cell
    from posedesign.report.identification import answer_of_identification
    from posedesign.workflow import identify_file

    file = out / "identification.json"
    with progress("identifying"):
        identified = identify_file(
            Cell.load(cell),
            measurements,
            results_in(out, "identify", cell, overwrite=overwrite),
            joints=joints,
            trust_units=trust_units,
            warn=lambda text: note(f"warning: {text}"),
        )
    rehearsed = rehearsed_words(cell, measurements)
    if as_json:
        note(rehearsed)
        show_file(file.read_text(encoding="utf-8"))
    else:
        then = (
            command_line("correct", cell, file, "--out", out) if identified.is_of_this_robot else ""
        )
        drawn = file.with_suffix(".png")
        beside = [out / name for name in ("joined.csv", "residuals.csv")] * bool(
            identified.measured
        )
        files = [str(path) for path in (file, drawn, *beside) if path.is_file()]
        answer = answer_of_identification(identified, files)
        tell(answer, verbose=verbose, then=then, first=rehearsed)
    return DONE if identified.is_of_this_robot else NOT_REACHED


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
    camera: Annotated[
        str | None,
        typer.Option(
            help="With a folder: take the pictures here, by device number (0), stream or file."
        ),
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
    pictures_mb: Annotated[
        float | None,
        typer.Option(
            "--pictures-mb",
            min=0.0,
            max=1e6,
            help="Disk that kept pictures may take; default: 1000, of a rehearsal 0.",
        ),
    ] = None,
    restart: Annotated[
        bool,
        typer.Option(
            "--restart", help="Begin anew: the files made before are put aside, together."
        ),
    ] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
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
            camera=camera,
            wait_s=wait_s,
            kind="image" if images else "fast",
            seed=seed,
            pictures_mb=pictures_mb,
            restart=restart,
            overwrite=overwrite,
            progress=advance,
            warn=lambda text: note(f"warning: {text}"),
        )
    identified = done.calibration.identified
    tell(
        done.answer([str(out)]),
        verbose=verbose,
        then=command_line("correct", cell, out / "identification.json", "--out", out),
        first="" if folder else "SIMULATED, not for a robot: this is a rehearsal",
        content=done.as_dict() if as_json else None,
    )
    good = done.calibration.plan.reached and not done.calibration.missed
    return DONE if good and identified.is_of_this_robot else NOT_REACHED
