"""Commands that do more than one step: study, demo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from posedesign.cli import output
from posedesign.report.answer import WIDTH

MOST_TRIALS = 10_000_000
"""Of a study; its own numbers are thousands."""

Draws = Annotated[
    int, typer.Option(min=10, max=100_000, help="Noise draws for each pose set, at least 10.")
]


def accuracy(
    cell: Annotated[
        Path | None, typer.Argument(help="The cell; default: the reference cell.")
    ] = None,
    out: output.OutFolder = Path(),
    draws: Draws = 50,
    seed: Annotated[int, typer.Option(min=0, max=output.LARGEST_SEED, help="Of the noise.")] = 1,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Accuracy against condition number: what better poses buy."""
    from posedesign.cell import Cell, cell_template
    from posedesign.report.accuracy import answer_of_study
    from posedesign.simulation import accuracy_study
    from posedesign.workflow import STUDY, write_study

    loaded = Cell.load(cell) if cell is not None else Cell.from_text(cell_template())
    results = output.results_in(out, "study accuracy", cell, overwrite=overwrite)
    results.claim("simulated", *STUDY)
    with output.progress("accuracy study") as advance:
        study = accuracy_study(loaded, draws=draws, seed=seed, progress=advance)
    table, figure = write_study(study, results)
    if as_json:
        output.print_json([finding.__dict__ for finding in study.findings])
        return output.DONE
    return output.tell(answer_of_study(study, [str(table), str(figure)]), verbose=verbose)


StudyName = Annotated[str, typer.Argument(help="The study, see: posedesign study list")]
StudyOut = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results; default: study-results/NAME.")
]


def list_all(as_json: output.AsJson = False) -> int:
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
        output.print_json(rows)
    else:
        output.print_table("Studies", rows, WIDTH)
    return output.DONE


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
    as_json: output.AsJson = False,
) -> int:
    """Run a study and draw its figures.

    Stop it at any time: the same command goes on where it was.
    """
    from posedesign.study import Options, Workers
    from posedesign.study.library import PICTURES, find_study

    found = find_study(name)
    folder = out or results_of(found.name)
    with found.writing_to(folder), output.progress(found.name, with_time_left=True) as advance:
        workers = Workers(jobs, scheduler)
        options = Options(folder, trials, workers, restart=restart, advance=advance)
        figures = found.run(options)
    with found.writing_to(folder, PICTURES):
        drawn = found.plot(folder, workers)
    if as_json:
        output.print_json(figures)
    else:
        for path in (*sorted(folder.glob("*.csv")), *drawn):
            output.say(f"wrote {path}")
        # a short form cannot tell all that the README's tables have
        if trials is None and (tables := found.markdown(figures)):
            for line in tables.splitlines():
                output.say(line)
        output.say(f"how to read them, and what its own numbers gave: {found.folder / 'README.md'}")
    return output.DONE


def plot(name: StudyName, out: StudyOut = None) -> int:
    """Draw the figures of a study again, from the tables of a run."""
    from posedesign.study.library import PICTURES, find_study

    found = find_study(name)
    folder = out or results_of(found.name)
    with found.writing_to(folder, PICTURES):
        drawn = found.plot(folder)
    for path in drawn:
        output.say(f"wrote {path}")
    return output.DONE


def results_of(name: str) -> Path:
    """Folder that the results of a study go to by default."""
    return Path("study-results") / name


def demo(
    out: output.OutFolder = Path("posedesign-demo"),
    draws: Draws = 50,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Run the main job on the reference cell."""
    from posedesign.cli.demo import answer_of_demo, run_demo, truth_rows

    with output.progress("demo") as advance:
        folder = output.results_in(out, "demo", overwrite=overwrite, remakes=True)
        results = run_demo(folder, draws=draws, progress=advance)
    program = results.program
    code = output.DONE if results.plan.reached and not program.problems else output.NOT_REACHED
    files = sorted(path.name for path in out.iterdir())
    content = {
        "message": results.plan.message,
        "reached": results.plan.reached,
        "identified": truth_rows(results),
        "program_problems": program.problems,
        "accuracy": [finding.__dict__ for finding in results.study.findings],
        "files": [str(out / name) for name in files],
    }
    if as_json:
        output.print_json(content)
        return code
    output.tell(
        answer_of_demo(results, out, files),
        verbose=verbose,
        then="posedesign new > cell.toml",
        first="SIMULATED, not for a robot: all of this is a rehearsal on the reference cell",
    )
    return code
