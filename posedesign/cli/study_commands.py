"""Commands that do more than one step: study and demo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import DONE, NOT_REACHED, note, print_json, print_table, progress
from posedesign.cli.plan_commands import AsJson, OutFolder

if TYPE_CHECKING:
    from posedesign.accuracy_study import AccuracyStudy
    from posedesign.demo import DemoResults

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
    from posedesign.files import make_folder
    from posedesign.template import cell_template
    from posedesign.workflow import write_study

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
    from posedesign.report.accuracy_table import LEGEND, accuracy_rows

    for text in study.notes:
        note(f"note: {text}")
    print_table(
        f"Accuracy against condition number ({study.draws} draws a pose set)", accuracy_rows(study)
    )
    print(LEGEND)


def demo(
    out: OutFolder = Path("posedesign-demo"),
    draws: Draws = 50,
    as_json: AsJson = False,
) -> int:
    """Run the main job on the reference cell."""
    from posedesign.cli.identification_output import print_identification
    from posedesign.cli.plan_commands import print_plan
    from posedesign.cli.robot_world_output import print_solvers
    from posedesign.demo import run_demo

    with progress("demo") as advance:
        results = run_demo(out, draws=draws, progress=advance)
    program = results.program
    code = DONE if results.plan.reached and not program.problems else NOT_REACHED
    files = sorted(path.name for path in out.iterdir())
    if as_json:
        print_json(
            {
                "message": results.plan.message,
                "reached": results.plan.reached,
                "identified": truth_rows(results),
                "program_problems": program.problems,
                "accuracy": [finding.__dict__ for finding in results.study.findings],
                "files": [str(out / name) for name in files],
            }
        )
        return code
    print_plan(results.plan, out, as_json=False)
    print_identification(results.identification)
    print_table("Against the simulated truth", truth_rows(results))
    print(
        "truth: zero offset plus deflection under gravity at the base pose. The rest of the "
        "deflection changes from pose to pose: no constant offset can follow it, and a model that "
        "leaves it out is off by more than its sigma."
    )
    print_solvers(results.robot_world)
    print(f"wrote {program.paths[0]}: {program.poses} poses, {len(program.problems)} objections")
    print_study(results.study)
    print(f"everything is in {out}: " + ", ".join(files))
    return code


def truth_rows(results: DemoResults) -> list[dict[str, object]]:
    """Identified parameters beside what the simulation used."""
    from posedesign.pose_plan import displayed

    shown = zip(
        results.offsets.displayed(), displayed(results.plan.model, results.truth), strict=True
    )
    return [
        {"parameter": name, "truth": true, "identified": value, "sigma": sigma, "unit": unit}
        for (name, unit, value, _, sigma), (_, _, true) in shown
    ]
