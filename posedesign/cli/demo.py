"""The demonstration: the main job on the reference cell, each step from the files before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.identification import IdentificationResult
from calib.se3 import FloatArray
from posedesign import workflow
from posedesign.cell import Cell, cell_template
from posedesign.files import Results, write_text_atomic
from posedesign.hand_eye.pairs import SolverOutcome, read_pairs
from posedesign.identification import Identified
from posedesign.planning import PosePlan, displayed
from posedesign.planning.optimal.outlook import outlook_of
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs import WrittenProgram, program_options, write_program
from posedesign.programs import find_dialect
from posedesign.report.accuracy import answer_of_study
from posedesign.report.answer import Answer, Table
from posedesign.report.identification import answer_of_identification
from posedesign.report.pairs import ROBOT_WORLD, answer_of_pairs, solve_and_draw
from posedesign.report.plans import answer_of_plan
from posedesign.simulation import AccuracyStudy, accuracy_study, effective_truth

_STEPS_BEFORE_STUDY = 0.2
"""Part of the time that everything but the study takes."""


@dataclass(frozen=True)
class DemoResults:
    """What the demo made, besides its files.

    ``truth`` is what the identified parameters are held against, see
    :func:`~posedesign.simulation.accuracy.effective_truth` [SI].
    """

    plan: PosePlan
    program: WrittenProgram
    identification: Identified
    truth: FloatArray
    robot_world: tuple[SolverOutcome, ...]
    study: AccuracyStudy

    @property
    def offsets(self) -> IdentificationResult:
        """The model of the paper, which the truth is known for."""
        return next(r for r in self.identification.comparison.results if r.model == "offsets")


def run_demo(
    out: Path | Results,
    *,
    draws: int = 50,
    progress: Callable[[str, float], None] = lambda what, part: None,
) -> DemoResults:
    """Write a cell, plan, write the program, touch up, identify, solve AX=ZB, and study.

    ``out``: folder for the files; those of an earlier run in it are replaced. ``draws``: noise
    draws for each pose set of the study. ``progress``: called with what is being done and the part
    of all work that is done.
    """
    results = out if isinstance(out, Results) else Results(out, "demo", remakes=True)
    (file,) = results.claim("computed", ("cell.toml", "reference cell"))
    results.claim("planned", workflow.POSES, workflow.ROUNDS)
    results.claim(
        "simulated",
        workflow.TOUCH_UPS,
        workflow.PAIRS,
        workflow.IDENTIFICATION,
        *ROBOT_WORLD,
        *workflow.STUDY,
    )
    text = cell_template()
    find_dialect("fanuc-ls").claim(Cell.from_text(text).config.program.name, results)
    path, folder = write_text_atomic(file, text), results.folder
    progress("planning", 0.0)
    cell = Cell.load(path)
    plan = workflow.plan_poses(cell, results)
    poses = read_poses(folder / "poses.csv", cell.robot.n)
    name = cell.config.program.name
    made = replace(results, inputs=(*results.inputs, folder / "poses.csv", path))
    program = write_program(poses, made, "fanuc-ls", program_options(cell, poses), name, cell)
    progress("touching up", 0.05)
    robot = workflow.simulate(cell, poses, results)
    identification = workflow.identify_file(cell, folder / "touchups.csv", results)
    progress("solving A X = Z B", 0.1)
    pairs = folder / "pairs.csv"
    robot_world = solve_and_draw(
        read_pairs(pairs), results, noise=workflow.camera_noise(cell), inputs=[pairs]
    )
    study = accuracy_study(
        cell,
        draws=draws,
        progress=lambda what, part: progress(
            f"accuracy study, {what}", _STEPS_BEFORE_STUDY + (1.0 - _STEPS_BEFORE_STUDY) * part
        ),
    )
    workflow.write_study(study, results)
    truth = effective_truth(robot, cell.model())
    return DemoResults(plan, program, identification, truth, robot_world, study)


_TRUTH = (
    "truth: zero offset plus deflection under gravity at the base pose. The rest of the deflection "
    "changes from pose to pose: no constant offset can follow it, so the model of the paper is off "
    "by more than its sigma, and the recommended one has compliances. In the study, which is of "
    "the paper's model too, the plate is for the same reason not best at the smallest C_G."
)


def answer_of_demo(results: DemoResults, out: Path, files: Sequence[str]) -> Answer:
    """The story of the demo, with the tables of its steps."""
    plan, program = results.plan, results.program
    cell = Cell.load(out / "cell.toml")
    steps = {
        "planned": answer_of_plan(cell, plan, outlook_of(cell, plan.postures)),
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
