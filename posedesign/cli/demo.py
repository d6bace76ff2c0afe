"""The main job on the reference cell, each step reading the files of the one before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from calib.identification import IdentificationResult
from calib.se3 import FloatArray
from posedesign.cell import Cell, cell_template
from posedesign.files import Results, write_text_atomic
from posedesign.hand_eye.pairs import SolverOutcome
from posedesign.hand_eye.pairs.tables import ROBOT_WORLD
from posedesign.identification import Identified
from posedesign.planning import PosePlan
from posedesign.planning.poses_file import read_poses
from posedesign.pose_programs import WrittenProgram, program_options, write_program
from posedesign.programs import find_dialect
from posedesign.simulation import AccuracyStudy, accuracy_study, effective_truth
from posedesign.workflow import (
    IDENTIFICATION,
    PAIRS,
    POSES,
    ROUNDS,
    STUDY,
    TOUCH_UPS,
    camera_noise,
    identify_file,
    plan_poses,
    simulate,
    solve_file,
    write_study,
)

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

    Parameters
    ----------
    out : Path or Results
        Folder for the files; those of an earlier run in it are replaced.
    draws : int
        Noise draws for each pose set of the study.
    progress : callable
        Called with what is being done and the part of all work that is done.
    """
    results = out if isinstance(out, Results) else Results(out, "demo", remakes=True)
    (file,) = results.claim("computed", ("cell.toml", "reference cell"))
    results.claim("planned", POSES, ROUNDS)
    results.claim("simulated", TOUCH_UPS, PAIRS, IDENTIFICATION, *ROBOT_WORLD, *STUDY)
    text = cell_template()
    find_dialect("fanuc-ls").claim(Cell.from_text(text).config.program.name, results)
    path, folder = write_text_atomic(file, text), results.folder
    progress("planning", 0.0)
    cell = Cell.load(path)
    plan = plan_poses(cell, results)
    poses = read_poses(folder / "poses.csv", cell.robot.n)
    name = cell.config.program.name
    made = replace(results, inputs=(*results.inputs, folder / "poses.csv", path))
    program = write_program(poses, made, "fanuc-ls", program_options(cell, poses), name, cell)
    progress("touching up", 0.05)
    robot = simulate(cell, poses, results)
    identification = identify_file(cell, folder / "touchups.csv", results)
    progress("solving A X = Z B", 0.1)
    robot_world = solve_file(folder / "pairs.csv", results, noise=camera_noise(cell))
    study = accuracy_study(
        cell,
        draws=draws,
        progress=lambda what, part: progress(
            f"accuracy study, {what}", _STEPS_BEFORE_STUDY + (1.0 - _STEPS_BEFORE_STUDY) * part
        ),
    )
    write_study(study, results)
    truth = effective_truth(robot, cell.model())
    return DemoResults(plan, program, identification, truth, robot_world, study)
