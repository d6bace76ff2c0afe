"""Commands that do more than one step: study and demo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import DONE, NOT_REACHED, note, print_json, print_table, progress
from posedesign.cli.plan_commands import AsJson, OutFolder

if TYPE_CHECKING:
    from posedesign.accuracy_study import AccuracyStudy

Draws = Annotated[int, typer.Option(min=10, help="Noise draws for each pose set, at least 10.")]
Seed = Annotated[int, typer.Option(min=0, help="Of the noise.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    studies = typer.Typer(help="Studies by simulation.")
    studies.command("accuracy")(accuracy)
    app.add_typer(studies, name="study")
    app.command()(demo)


def accuracy(
    cell: Annotated[
        Path | None, typer.Argument(help="The cell; default: the reference cell.")
    ] = None,
    out: OutFolder = Path(),
    draws: Draws = 50,
    seed: Seed = 1,
    as_json: AsJson = False,
) -> int:
    """Accuracy against condition number: what better poses buy."""
    from posedesign.accuracy_study import accuracy_study
    from posedesign.cell import Cell
    from posedesign.template import cell_template
    from posedesign.workflow import make_folder, write_study

    loaded = Cell.load(cell) if cell is not None else Cell.from_text(cell_template())
    make_folder(out)  # before the work rather than after it
    with progress("accuracy study") as advance:
        study = accuracy_study(loaded, draws=draws, seed=seed, progress=advance)
    table, figure = write_study(study, out)
    if as_json:
        print_json([finding.__dict__ for finding in study.findings])
    else:
        print_study(study)
        print(f"wrote {table} and {figure}")
    return DONE


def print_study(study: AccuracyStudy) -> None:
    """Print the key figures of every pose set."""
    from posedesign.report.accuracy_table import accuracy_rows

    for text in study.notes:
        note(f"note: {text}")
    print_table(
        f"Accuracy against condition number ({study.draws} draws a pose set)", accuracy_rows(study)
    )


def demo(
    out: OutFolder = Path("posedesign-demo"),
    draws: Draws = 50,
) -> int:
    """Run the main job on the reference cell, from the robot to the accuracy it buys."""
    from posedesign.cli.calibrate_commands import print_identification, print_solvers
    from posedesign.cli.plan_commands import print_plan
    from posedesign.demo import run_demo

    with progress("demo") as advance:
        results = run_demo(out, draws=draws, progress=advance)
    print_plan(results.plan, out, as_json=False)
    print_identification(results.identification)
    print_solvers(results.robot_world)
    program = results.program
    print(f"wrote {program.path}: {program.poses} poses, {len(program.problems)} objections")
    print_study(results.study)
    print(f"everything is in {out}: " + ", ".join(sorted(p.name for p in out.iterdir())))
    return DONE if results.plan.reached and not program.problems else NOT_REACHED
