"""Commands that do more than one step: study, report and demo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    print_json,
    print_table,
    progress,
    results_in,
    say,
    tell,
)
from posedesign.cli.plan_commands import LARGEST_SEED, AsJson, OutFolder, Overwrite, Verbose
from posedesign.report.answer import WIDTH

MOST_TRIALS = 10_000_000
"""Of a study; its own numbers are thousands."""

if TYPE_CHECKING:
    from posedesign.cli.demo import DemoResults
    from posedesign.report.answer import Answer

Draws = Annotated[
    int, typer.Option(min=10, max=100_000, help="Noise draws for each pose set, at least 10.")
]
Seed = Annotated[int, typer.Option(min=0, max=LARGEST_SEED, help="Of the noise.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    studies = typer.Typer(help="Studies by simulation.")
    studies.command("accuracy")(accuracy)
    studies.command("list")(list_all)
    studies.command("run")(run)
    studies.command("plot")(plot)
    app.add_typer(studies, name="study")
    app.command()(demo)
    app.command()(report)


def accuracy(
    cell: Annotated[
        Path | None, typer.Argument(help="The cell; default: the reference cell.")
    ] = None,
    out: OutFolder = Path(),
    draws: Draws = 50,
    seed: Seed = 1,
    as_json: AsJson = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> int:
    """Accuracy against condition number: what better poses buy."""
    from posedesign.cell import Cell, cell_template
    from posedesign.report.accuracy import answer_of_study
    from posedesign.simulation import accuracy_study
    from posedesign.workflow import STUDY, write_study

    loaded = Cell.load(cell) if cell is not None else Cell.from_text(cell_template())
    results = results_in(out, "study accuracy", cell, overwrite=overwrite)
    results.claim("simulated", *STUDY)
    with progress("accuracy study") as advance:
        study = accuracy_study(loaded, draws=draws, seed=seed, progress=advance)
    table, figure = write_study(study, results)
    if as_json:
        print_json([finding.__dict__ for finding in study.findings])
    else:
        tell(answer_of_study(study, [str(table), str(figure)]), verbose=verbose)
    return DONE


StudyName = Annotated[str, typer.Argument(help="The study, see: posedesign study list")]
StudyOut = Annotated[
    Path | None,
    typer.Option("--out", help="Folder for the results; default: study-results/NAME."),
]


def list_all(as_json: AsJson = False) -> int:
    """List the studies and what they ask."""
    from posedesign.study.library import list_studies

    rows = [
        {
            "number": study.number,
            "study": study.name,
            "question": study.question,
            "needs": study.needs,
        }
        for study in list_studies()
    ]
    if as_json:
        print_json(rows)
    else:
        print_table("Studies", rows, WIDTH)
    return DONE


def run(
    name: StudyName,
    trials: Annotated[
        int | None,
        typer.Option(
            min=1, max=MOST_TRIALS, help="In place of the study's own number; each has its least."
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler: tcp://host:8786")
    ] = None,
    out: StudyOut = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Begin anew, whatever results are there.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Run a study and draw its figures.

    Stop it at any time: the same command goes on where it was.
    """
    from posedesign.study import Options, Workers
    from posedesign.study.library import PICTURES, find_study

    found = find_study(name)
    folder = out or results_of(found.name)
    with found.writing_to(folder), progress(found.name, with_time_left=True) as advance:
        workers = Workers(jobs, scheduler)
        options = Options(folder, trials, workers, restart=restart, advance=advance)
        figures = found.run(options)
    with found.writing_to(folder, PICTURES):
        drawn = found.plot(folder)
    if as_json:
        print_json(figures)
    else:
        for path in (*sorted(folder.glob("*.csv")), *drawn):
            say(f"wrote {path}")
        # a short form cannot tell all that the README's tables have
        if trials is None and (tables := found.markdown(figures)):
            for line in tables.splitlines():
                say(line)
        say(f"how to read them, and what its own numbers gave: {found.folder / 'README.md'}")
    return DONE


def plot(name: StudyName, out: StudyOut = None) -> int:
    """Draw the figures of a study again, from the tables of a run."""
    from posedesign.study.library import PICTURES, find_study

    found = find_study(name)
    folder = out or results_of(found.name)
    with found.writing_to(folder, PICTURES):
        drawn = found.plot(folder)
    for path in drawn:
        say(f"wrote {path}")
    return DONE


def results_of(name: str) -> Path:
    """Folder that the results of a study go to by default."""
    return Path("study-results") / name


def report(
    folder: Annotated[Path, typer.Argument(help="With cell.toml, poses.csv, identification.json.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for report.html. [that of the files]")
    ] = None,
    overwrite: Overwrite = False,
) -> int:
    """Write one page of HTML, report.html, of all that is in a folder."""
    from posedesign.report.page import write_report

    with progress("report"):
        page = write_report(folder, results_in(out or folder, "report", overwrite=overwrite))
    say(f"wrote: {page}, {page.stat().st_size / 1e6:.1f} MB")
    return DONE


def demo(
    out: OutFolder = Path("posedesign-demo"),
    draws: Draws = 50,
    as_json: AsJson = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> int:
    """Run the main job on the reference cell."""
    from posedesign.cli.demo import run_demo

    with progress("demo") as advance:
        folder = results_in(out, "demo", overwrite=overwrite, remakes=True)
        results = run_demo(folder, draws=draws, progress=advance)
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
    tell(
        _told(results, out, files),
        verbose=verbose,
        then="posedesign new > cell.toml",
        first="SIMULATED, not for a robot: all of this is a rehearsal on the reference cell",
    )
    return code


_TRUTH = (
    "truth: zero offset plus deflection under gravity at the base pose. The rest of the deflection "
    "changes from pose to pose: no constant offset can follow it, so the model of the paper is off "
    "by more than its sigma, and the recommended one has compliances. In the study, which is of "
    "the paper's model too, the plate is for the same reason not best at the smallest C_G."
)


def _told(results: DemoResults, out: Path, files: Sequence[str]) -> Answer:
    """The story of the demo, with the tables of its steps."""
    from posedesign.cell import Cell
    from posedesign.planning.optimal.outlook import outlook_of
    from posedesign.report.accuracy import answer_of_study
    from posedesign.report.answer import Answer, Table
    from posedesign.report.identification import answer_of_identification
    from posedesign.report.pairs import answer_of_pairs
    from posedesign.report.plans import answer_of_plan

    plan, program = results.plan, results.program
    outlook = outlook_of(Cell.load(out / "cell.toml"), plan.model, plan.postures)
    steps = {
        "planned": answer_of_plan(Cell.load(out / "cell.toml"), plan, outlook),
        "identified": answer_of_identification(results.identification),
        "A X = Z B": answer_of_pairs(results.robot_world),
        "studied": answer_of_study(results.study),
    }
    truth = Table(
        f"The smallest model ({results.offsets.model}) against the simulated truth",
        truth_rows(results),
    )
    error = steps["identified"].figures.get("expected error", "")
    pictures = sum(name.endswith(".png") for name in files)
    tables = [name for name in files if not name.endswith((".png", ".svg"))]
    return Answer(
        f"planned: {plan.verdict}",
        {
            "program": f"{program.paths[0].name}, {program.poses} poses, "
            f"{len(program.problems)} objections",
            "identified": f"{steps['identified'].verdict}; {error.split('; ')[0]}",
            "A X = Z B": steps["A X = Z B"].figures.get("methods", ""),
            "study": steps["studied"].verdict,
            "picture": str(out / "accuracy_vs_condition.png"),
        },
        warnings=[text for step in steps.values() for text in step.warnings],
        not_checked=plan.not_checked,
        details=[_TRUTH, *(text for step in steps.values() for text in step.details)],
        tables=[table for step in steps.values() for table in step.tables] + [truth],
        files=[f"into {out}: {', '.join(tables)}, {pictures} pictures"],
    )


def truth_rows(results: DemoResults) -> list[dict[str, object]]:
    """Identified parameters beside what the simulation used."""
    from posedesign.planning import displayed

    shown = zip(
        results.offsets.displayed(), displayed(results.plan.model, results.truth), strict=True
    )
    return [
        {
            "parameter": row.name,
            "truth": true,
            "identified": row.value,
            "sigma": row.sigma,
            "unit": row.unit,
        }
        for row, (_, _, true) in shown
    ]
