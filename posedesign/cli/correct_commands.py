"""Commands with an identification, and with a plan: correct, predict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    note_misfit,
    progress,
    rehearsed_words,
    results_in,
    tell,
)
from posedesign.cli.plan_commands import AsJson, CellFile, OutFolder, Overwrite, TrustUnits, Verbose

if TYPE_CHECKING:
    from posedesign.identification.correction import Correction
    from posedesign.pose_programs.correcting import CorrectedProgram
    from posedesign.report.answer import Answer


_TAUGHT = (
    "positions that were taught on the arm are right already: correct what was made offline, and "
    "use it alone: with mastering or a corrected description it corrects twice"
)

Box = Annotated[
    str | None,
    typer.Option(help='Corners "x1,y1,z1,x2,y2,z2" [mm]; default: [task_box] of the cell.'),
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(correct)
    app.command()(predict)


def correct(
    cell: CellFile,
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
    export: Annotated[
        list[str] | None,
        typer.Option(help="Another form, too: dh, dh-modified, dh-hayati, ur-kinematics."),
    ] = None,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Write what corrects the robot: description, mastering, poses; or a corrected program.

    Each of them is enough by itself, with values that are best for it over the task box. A table
    says what error each leaves. Of a program its Cartesian targets keep their place on the real
    arm; nothing else in it changes.
    """
    from posedesign.cell import Cell
    from posedesign.identification.correction import box_of
    from posedesign.identification.correction import correct as run
    from posedesign.pose_programs.correcting import correct_program, is_program, numbers_of
    from posedesign.report.corrections import answer_of_correction

    loaded = Cell.load(cell)
    results = results_in(out, "correct", cell, identification, poses, overwrite=overwrite)
    of_program = poses is not None and is_program(poses, dialect)
    if of_program:
        _check_for_nothing("a program", {"box": box, "export": export})
    else:
        _check_for_nothing("anything but a program", {"joints": joints or None, "leave": leave})
    if poses is not None and of_program:
        with progress("correcting"):
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
            )
        content = _program_as_dict(program) if as_json else None
        first = rehearsed_words(cell, identification)
        tell(_told_program(program), verbose=verbose, first=first, content=content)
        return DONE if program.ok else NOT_REACHED
    with progress("correcting"):
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
            trust_units=trust_units,
        )
    rehearsed = rehearsed_words(cell, identification)
    content = _as_dict(done) if as_json else None
    tell(answer_of_correction(done), verbose=verbose, first=rehearsed, content=content)
    return DONE if done.ok else NOT_REACHED


def _as_dict(done: Correction) -> dict[str, object]:
    found = done.compensated
    return {
        "model": done.identified.name,
        "simulated": done.rehearsed or None,
        "box": done.routes.where,
        "routes": [
            {**row, "tool_mm": (1e3 * route.tool_m).tolist()}
            for row, route in zip(done.routes.rows(), done.routes.routes, strict=True)
        ],
        "verdict": done.verdict(),
        "mastering": done.mastering.rows(),
        "left_out": done.robot.left_out,
        "poses": []
        if found is None or done.poses is None
        else [
            {"name": n, "status": status, "reason": reason, "error_mm": far * 1e3}
            for n, status, reason, far in zip(
                done.poses.names, found.status, found.reasons, found.error_m, strict=True
            )
        ],
        "notes": [*filter(None, [done.routes.tool.said]), *done.notes],
        "files": [str(path) for path in done.files],
    }


def _check_for_nothing(what: str, given: Mapping[str, object]) -> None:
    """Refuse options that would do nothing."""
    from calib.errors import InputError

    name = next((name for name, value in given.items() if value is not None), None)
    if name is not None:
        raise InputError(f"`{name}` does nothing for {what}", hint="leave it out", name=name)


def _told_program(done: CorrectedProgram) -> Answer:
    """The answer of a corrected program."""
    from posedesign.report.answer import Answer, Table

    count, failed = len(done.corrected), done.rows()
    verdict = f"{count} positions keep their place on the real arm"
    figures = {}
    if done.ok:
        figures = {
            "without correction": f"up to {1e3 * done.moved_m.max():.3g} mm off",
            "as written": f"up to {1e6 * done.written_m.max():.2g} um off, by rounding",
        }
    else:
        verdict = f"nothing is written: {len(failed)} of {count} positions cannot be corrected"
    return Answer(
        verdict,
        figures,
        warnings=[f"{row['position']}: {row['reason']}" for row in failed],
        notes=[*done.notes, _TAUGHT],
        tables=[Table("Positions that cannot be corrected", failed)],
        files=[str(path) for path in done.files],
    )


def _program_as_dict(done: CorrectedProgram) -> dict[str, object]:
    """All of it, for programs."""
    written = done.written_m.tolist() or [None] * len(done.corrected)
    rows = zip(done.positions, done.reasons, done.moved_m, done.error_m, written, strict=True)
    return {
        "simulated": done.simulated or None,
        "positions": [
            {
                "number": p.number,
                "name": p.name,
                "reason": reason,
                "without_mm": 1e3 * moved,
                "error_mm": 1e3 * error,
                "written_mm": None if rounded is None else 1e3 * rounded,
            }
            for p, reason, moved, error, rounded in rows
        ],
        "notes": list(done.notes),
        "files": [str(path) for path in done.files],
    }


def predict(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")],
    box: Box = None,
    steps: Annotated[
        str | None, typer.Option(help='Points along x, y and z; default: the cell\'s, or "3,3,3".')
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(help="One of the cell's models, by name; default: its zero offsets."),
    ] = None,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Predict the accuracy over a box, before anything is measured.

    From the noise of the measurement alone.
    """
    from posedesign.cell import Cell
    from posedesign.identification.correction import box_of
    from posedesign.identification.correction import predict as run
    from posedesign.planning.poses_file import read_poses
    from posedesign.report.corrections import answer_of_prediction

    loaded = Cell.load(cell)
    asked = box_of(loaded, box, steps)
    listed = read_poses(
        poses,
        loaded.robot.n,
        slides=loaded.robot.slides,
        controller=loaded.robot.controller,
        trust_units=trust_units,
    )
    note_misfit(poses, listed, loaded)
    results = results_in(out, "predict", cell, poses, overwrite=overwrite)
    with progress("predicting"):
        found = run(loaded, listed, asked, results, model)
    files = [str(out / "predicted_accuracy.csv")]
    content = {"reference": found.reference, "points": found.rows(), "files": files}
    answer = answer_of_prediction(found, files)
    tell(answer, verbose=verbose, content=content if as_json else None)
    return DONE
