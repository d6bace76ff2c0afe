"""Commands with an identification, and with a plan: correct, predict."""

from __future__ import annotations

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
        Path | None, typer.Argument(help="Poses to correct, with columns j1_deg, j2_deg, ...")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(help="A model to use as it is; default: the values best for each way."),
    ] = None,
    tool: Annotated[
        str | None, typer.Option(help="Which identified tool point is the cell's tool.")
    ] = None,
    box: Box = None,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    verbose: Verbose = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Write what corrects the robot: description, mastering, poses.

    Each of them is enough by itself, with values that are best for it over the task box. A table
    says what error each leaves.
    """
    from posedesign.cell import Cell
    from posedesign.identification.correction import box_of
    from posedesign.identification.correction import correct as run
    from posedesign.report.corrections import answer_of_correction

    loaded = Cell.load(cell)
    with progress("correcting"):
        done = run(
            loaded,
            cell,
            identification,
            results_in(out, "correct", cell, identification, poses, overwrite=overwrite),
            poses=poses,
            name=model,
            tool=tool,
            box=None if box is None else box_of(loaded, box, None),
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
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
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
