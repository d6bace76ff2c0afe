"""Commands with measurements, and with what they identify: simulate, identify, calibrate, correct.

And predict: what poses will identify.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli import output

Box = Annotated[
    str | None,
    typer.Option(help='Corners "x1,y1,z1,x2,y2,z2" [mm]; default: [task_box] of the cell.'),
]


def simulate(
    cell: output.CellFile,
    poses: output.PlannedPoses,
    out: output.OutFolder = Path("rehearsal"),
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=output.LARGEST_SEED, help="Of the noise; default: the cell's."),
    ] = None,
    cycles: Annotated[
        int, typer.Option(min=1, max=1000, help="Times that an instrument reads all poses.")
    ] = 1,
    as_json: output.AsJson = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Rehearse: touch up the poses with a simulated robot, into a folder of its own."""
    from posedesign import workflow
    from posedesign.cell import Cell
    from posedesign.planning import check_fit
    from posedesign.simulation.pictures import JOINTS, simulate_pictures

    loaded = Cell.load(cell)
    listed = output.poses_of(loaded, poses, trust_units=trust_units, of_any_robot=True)
    results = output.results_in(out, "simulate", cell, poses, overwrite=overwrite)
    then: tuple[object, ...]
    if loaded.sees_board:
        check_fit(loaded, listed)
        with output.progress("taking pictures", with_time_left=True) as advance:
            own_seed = loaded.config.truth.seed if seed is None else seed
            taken = simulate_pictures(loaded, listed, results, own_seed, advance)
        folder, joints = taken[0].parent, out / JOINTS[0]
        mount = ("--camera", "fixed") if loaded.board_set_up.carried == "board" else ()
        then = ("camera", cell, folder, "--joints", joints, *mount)
        said = f"{folder} and {joints}: {len(taken)} pictures of the board"
        content: dict[str, object] = {
            "pictures": [str(path) for path in taken],
            "files": [str(joints)],
        }
    else:
        with output.progress("rehearsing"):
            workflow.simulate(loaded, listed, results, seed, cycles)
        count, written = len(listed.measured.names), workflow.simulated_files(loaded)
        files = [str(out / name) for name, _ in written]
        what = "pairs of A X = Z B" if loaded.is_hand_eye else written[0][1]
        counted = f"{count} poses, {what}" if what == "measurements" else f"{count} {what}"
        then = output.after_measuring(cell, poses, files[0])
        if loaded.is_hand_eye:
            then = ("robot-world", *files)
        said = f"{' and '.join(files)}: {counted}"
        content = {"touch_ups": 0 if loaded.is_hand_eye else count, "files": files}
    if as_json:
        output.print_json(content)
    else:
        output.say(f"wrote {said}, SIMULATED")
        output.say(f"next: {output.command_line(*then, '--out', out)}")
    return output.DONE


def identify(
    cell: output.CellFile,
    measurements: Annotated[
        Path,
        typer.Argument(
            help="touchups.csv, or any kinds: target, j1_deg, .., kind, x_mm, ..; or the file of "
            "an instrument, as [instrument] of the cell says"
        ),
    ],
    joints: output.JointsFile = None,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Identify the robot from measurements, by every model of the cell.

    Beside the baselines that leave the robot as it is; each judged by what it did not see.
    """
    from posedesign.cell import Cell
    from posedesign.report.identification import answer_of_identification
    from posedesign.workflow import identify_file

    file = out / "identification.json"
    with output.progress("identifying"):
        identified = identify_file(
            Cell.load(cell),
            measurements,
            output.results_in(out, "identify", cell, overwrite=overwrite),
            joints=joints,
            trust_units=trust_units,
            warn=lambda text: output.note(f"warning: {text}"),
        )
    rehearsed = output.rehearsed_words(cell, measurements)
    good = identified.is_trusted
    if as_json:
        output.note(rehearsed)
        output.show_file(file.read_text(encoding="utf-8"))
        return output.DONE if good else output.NOT_REACHED
    beside = ("joined.csv", "residuals.csv") if identified.table.facts else ()
    named = (file, file.with_suffix(".png"), *(out / name for name in beside))
    files = [str(path) for path in named if path.is_file()]
    then = output.command_line("correct", cell, file, "--out", out) if good else ""
    answer = answer_of_identification(identified, files)
    return output.tell(answer, good, verbose=verbose, then=then, first=rehearsed)


def calibrate(
    cell: output.CellFile,
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
        typer.Option(
            min=0, max=output.LARGEST_SEED, help="Of the simulated noise; default: the cell's."
        ),
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
    overwrite: output.Overwrite = False,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
) -> int:
    """Calibrate by sight: find camera and target, plan, touch up, identify.

    From the base pose with the target in view, without knowing where camera and target are. Stop it
    at any time; the same command goes on where it was.
    """
    from posedesign.autonomous import run_by_sight

    with output.progress("calibrating") as advance:
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
            warn=lambda text: output.note(f"warning: {text}"),
        )
    identified = done.calibration.identified
    output.tell(
        done.answer([str(out)]),
        verbose=verbose,
        then=output.command_line("correct", cell, out / "identification.json", "--out", out),
        first="" if folder else "SIMULATED, not for a robot: this is a rehearsal",
        content=done.as_dict(),
        as_json=as_json,
    )
    good = done.calibration.plan.reached and not done.calibration.missed
    return output.DONE if good and identified.is_trusted else output.NOT_REACHED


def correct(
    cell: output.CellFile,
    identification: Annotated[
        Path, typer.Argument(help="identification.json, from: posedesign identify")
    ],
    poses: Annotated[
        Path | None,
        typer.Argument(help="Poses to correct, with columns j1_deg, ...; or a robot program."),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(help="A model to use as it is; default: the values best for each way."),
    ] = None,
    tool: Annotated[
        str | None, typer.Option(help="Which identified tool point is the cell's tool.")
    ] = None,
    box: Box = None,
    dialect: Annotated[
        str | None, typer.Option("--format", help="Of a program; default: what it looks like.")
    ] = None,
    joints: Annotated[
        bool, typer.Option("--joints", help="Of a program, correct joint targets, too.")
    ] = False,
    leave: Annotated[
        str | None, typer.Option(help='Positions of a program that stay as they are: "3,7".')
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Correct what is corrected already.")
    ] = False,
    export: Annotated[
        list[str] | None,
        typer.Option(help="Another form, too: dh, dh-modified, dh-hayati, ur-kinematics."),
    ] = None,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Write what corrects the robot: description, mastering, poses; or a corrected program.

    Each of them is enough by itself, with values that are best for it over the task box. A table
    says what error each leaves. Of a program its Cartesian targets keep their place on the real
    arm; nothing else in it changes, but for a comment that says so.
    """
    from posedesign.cell import Cell
    from posedesign.cli.json_forms import correction_as_dict, program_as_dict
    from posedesign.pose_programs.correcting import correct_program, is_program, numbers_of
    from posedesign.pose_programs.correction import box_of
    from posedesign.pose_programs.correction import correct as run
    from posedesign.report.identification import answer_of_correction, answer_of_program

    loaded = Cell.load(cell)
    results = output.results_in(out, "correct", cell, identification, poses, overwrite=overwrite)
    of_program = poses is not None and is_program(poses, dialect)
    if of_program:
        output.refuse_given({"box": box, "export": export}, "does nothing for a program")
    else:
        given = {"joints": joints or None, "leave": leave, "again": (again and not poses) or None}
        output.refuse_given(given, "does nothing for anything but a program")
    if poses is not None and of_program:
        with output.progress("correcting"):
            program = correct_program(
                loaded,
                identification,
                poses,
                results,
                dialect=dialect,
                joints=joints,
                leave=numbers_of(leave),
                name=model,
                tool=tool,
                again=again,
            )
        answer, content, ok = answer_of_program(program), program_as_dict(program), program.ok
    else:
        with output.progress("correcting"):
            done = run(
                loaded,
                cell,
                identification,
                results,
                poses=poses,
                name=model,
                tool=tool,
                box=None if box is None else box_of(loaded, box, None),
                exports=export or (),
                again=again,
                trust_units=trust_units,
            )
        answer, content, ok = answer_of_correction(done), correction_as_dict(done), done.ok
    first = output.rehearsed_words(cell, identification)
    output.tell(answer, verbose=verbose, first=first, content=content, as_json=as_json)
    return output.DONE if ok else output.NOT_REACHED


def predict(
    cell: output.CellFile,
    poses: output.PlannedPoses,
    box: Box = None,
    steps: Annotated[
        str | None, typer.Option(help='Points along x, y and z; default: the cell\'s, or "3,3,3".')
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="One of the cell's models, by name; default: the arm that is fitted, with all "
            "that may be off."
        ),
    ] = None,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Predict the error over a box, before anything is measured."""
    from posedesign.cell import Cell
    from posedesign.cli.json_forms import expected_as_dict
    from posedesign.pose_programs.correction import box_of
    from posedesign.pose_programs.correction import predict as run
    from posedesign.report.identification import answer_of_prediction

    loaded = Cell.load(cell)
    asked = box_of(loaded, box, steps)
    listed = output.poses_of(loaded, poses, trust_units=trust_units)
    results = output.results_in(out, "predict", cell, poses, overwrite=overwrite)
    with output.progress("predicting"):
        found = run(loaded, listed, asked, results, model)
    files = [str(out / "predicted_accuracy.csv")]
    content = {
        "reference": found.reference,
        "expected_error": expected_as_dict(found.expected),
        "points": found.rows(),
        "files": files,
    }
    answer = answer_of_prediction(found, files)
    return output.tell(answer, verbose=verbose, content=content, as_json=as_json)
