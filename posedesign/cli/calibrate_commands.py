"""Commands with measurements: simulate, identify, robot-world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import DONE, NOT_REACHED, note, print_json, print_table
from posedesign.cli.plan_commands import AsJson, CellFile, OutFolder, TrustUnits

if TYPE_CHECKING:
    from posedesign.workflow import SolverOutcome

ALL = "all"


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(simulate)
    app.command()(identify)
    app.command("robot-world")(robot_world)


def simulate(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")],
    out: OutFolder = Path(),
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the noise; default: the cell's.")
    ] = None,
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
) -> int:
    """Rehearse: touch up the poses with a simulated robot."""
    from posedesign import workflow
    from posedesign.cell import Cell
    from posedesign.tables import read_poses

    loaded = Cell.load(cell)
    listed = read_poses(
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
    )
    workflow.simulate(loaded, listed, out, seed)
    count = len(listed.measured.names)
    touched = [] if loaded.is_hand_eye else [str(out / "touchups.csv")]
    files = [*touched, str(out / "pairs.csv")]
    if as_json:
        print_json({"touch_ups": count if touched else 0, "files": files})
    else:
        what = "touch-ups" if touched else "pairs of A X = Z B"
        print(f"wrote {' and '.join(files)}: {count} {what}")
    return DONE


def identify(
    cell: CellFile,
    measurements: Annotated[
        Path, typer.Argument(help="touchups.csv, or any kinds: target, j1_deg, .., kind, x_mm, ..")
    ],
    out: OutFolder = Path(),
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
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
        out,
        trust_units=trust_units,
        warn=lambda text: note(f"warning: {text}"),
    )
    if as_json:
        print((out / "identification.json").read_text(encoding="utf-8"), end="")
    else:
        print_identification(identified)
        print(f"wrote {out / 'identification.json'}")
    return DONE if identified.is_of_this_robot else NOT_REACHED


def robot_world(
    pairs: Annotated[Path, typer.Argument(help="Pairs A, B of A X = Z B (columns a_x_mm, ...)")],
    method: Annotated[str, typer.Option(help="A solver, or all for the papers' four.")] = ALL,
    noise_deg: Annotated[
        float | None, typer.Option(help="Standard deviation of B's rotation, for the covariance.")
    ] = None,
    noise_mm: Annotated[
        float | None, typer.Option(help="Standard deviation of B's translation, likewise.")
    ] = None,
    out: OutFolder = Path(),
    as_json: AsJson = False,
) -> int:
    """Solve A X = Z B for camera and target.

    X is the camera on the flange, Z the target in the base.
    """
    import math

    from calib.errors import InputError
    from calib.robot_world import PAPER_METHODS, PairNoise
    from posedesign.workflow import solve_file, solver_row

    noise = None
    if (noise_deg is None) != (noise_mm is None):
        raise InputError("give both --noise-deg and --noise-mm, or neither", name="noise")
    if noise_deg is not None and noise_mm is not None:
        noise = PairNoise(math.radians(noise_deg), noise_mm / 1e3, on="B")
    outcomes = solve_file(pairs, out, PAPER_METHODS if method == ALL else [method], noise)
    if as_json:
        print_json([solver_row(outcome) for outcome in outcomes])
    else:
        print_solvers(outcomes)
        print(f"wrote {out / 'robot_world.csv'}")
    return DONE if all(outcome.ok for outcome in outcomes) else NOT_REACHED


def print_solvers(outcomes: Sequence[SolverOutcome]) -> None:
    """Print X and Z of every solver, with what is left over."""
    from posedesign.tables import POSE_AXES
    from posedesign.workflow import solver_row

    rows = [solver_row(outcome) for outcome in outcomes]
    for letter, what in (("x", "X = T_flange_camera"), ("z", "Z = T_base_target")):
        keep = ["method", "status", *(f"{letter}_{axis}" for axis in POSE_AXES)]
        print_table(what, [{key: row[key] for key in keep} for row in rows])
    keep = ["method", "status", "iterations", "residual_rotation_deg", "residual_translation_mm"]
    print_table("Left over (rms)", [{key: row[key] for key in keep} for row in rows])
    for outcome in outcomes:
        said = outcome.result.message if outcome.result else outcome.problem
        if outcome.ok:
            print(f"{outcome.method}: {said}")
        else:
            note(f"warning: {outcome.method}: {said}")
