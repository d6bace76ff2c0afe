"""The poses that are compared, and the data sets that are simulated at each of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from calib.identification import covariance_of, identify_batch
from calib.robot_world import RobotWorldBatch, solve_batch_by_each
from calib.se3 import FloatArray, inverse, rotation_angle
from posedesign.cell import Cell, cell_template
from posedesign.planning import plan
from posedesign.simulation import SimulatedRobot, effective_truth
from posedesign.simulation.accuracy import improving_rounds, to_the_widest
from posedesign.study import Task
from posedesign.workflow import camera_noise

from . import OFFSET, TOOL


@lru_cache(maxsize=16)
def cell_of(preset: str, start_deg: float, step_deg: float, largest_deg: float) -> Cell:
    """The cell of a preset with joint limits as its only constraints, on a rigid arm."""
    text = cell_template(preset, surroundings=False)
    for key, value in (
        ("start_deg", start_deg),
        ("step_deg", step_deg),
        ("largest_deg", largest_deg),
    ):
        before, _, after = text.partition(f"{key} = [")
        text = f"{before}{key} = [{value}, {value}, {value}]{after[after.index(']') + 1 :]}"
    return Cell.from_text(text.replace("deflection = true", "deflection = false"))


def _cell(given: Mapping[str, Any], preset: str) -> Cell:
    return cell_of(preset, given["start_deg"], given["step_deg"], given["largest_deg"])


def conditions_of(task: Task) -> list[dict[str, Any]]:
    """The conditions of a preset: the loop is run once, to the widest angles.

    Thresholds lie in equal ratios, from just above the first C_G to just above the least.
    """
    given = task.condition
    rounds = improving_rounds(plan(to_the_widest(_cell(given, given["preset"]))))
    first, least = rounds[0][0].c_g, rounds[-1][0].c_g
    found = []
    for threshold in (1.001 * np.geomspace(first, least, given["thresholds"])).tolist():
        turn, postures = next(turn for turn in rounds if turn[0].c_g < threshold)
        own = {"threshold": threshold, "postures": postures.tolist()}
        found.append({**given, **own, "c_g": turn.c_g, "d_deg": turn.variation_deg[0]})
    return found


def simulate(task: Task) -> dict[str, Any]:
    """Errors of the trials of a task, a column for each estimator and quantity."""
    given, rng = task.condition, task.rng()
    cell, postures = _cell(given, given["preset"]), np.array(given["postures"])
    model = cell.model()
    robot = SimulatedRobot.of(cell)
    touched = robot.touch_up(postures, rng, trials=task.trials)
    values = identify_batch(model, touched)
    truth = effective_truth(robot, model)
    sigma = np.sqrt(np.diag(covariance_of(model, postures)))
    good = np.isfinite(values).all(axis=1)  # those that have converged
    q = _elsewhere(cell, given)
    off = np.full((task.trials, len(q), 3), np.nan)
    off[good] = model.view(q, values[good]).tool_points - model.view(q, truth).tool_points
    columns: dict[str, Any] = {
        "preset": [given["preset"]] * task.trials,
        "threshold": np.full(task.trials, given["threshold"]),
        "c_g": np.full(task.trials, given["c_g"]),
        "d_deg": np.full(task.trials, given["d_deg"]),
        "poses": np.full(task.trials, len(postures)),
        "trial": np.arange(task.first, task.first + task.trials),
        f"predicted_{OFFSET}": np.full(task.trials, np.rad2deg(sigma[0])),
        OFFSET: np.rad2deg(values[:, 0] - truth[0]),
        TOOL: 1e3 * np.sqrt((off**2).sum(axis=-1).mean(axis=-1)),
    }
    _, B = robot.camera_poses(touched.postures, rng)
    identified = model.view(touched.postures[good], values[good]).T_base_tip
    true = {
        "x": robot.T_shown_tip @ robot.T_tip_camera,
        "z": robot.T_shown_base @ robot.T_base_target,
    }
    solved: dict[str, RobotWorldBatch] = {}
    for weighing in (False, True):
        methods = [solver for solver in given["solvers"] if (solver == "ml") is weighing]
        noise = camera_noise(cell) if weighing else None
        solved |= solve_batch_by_each(identified, B[good], methods, noise)
    for solver in given["solvers"]:
        found = solved[solver]
        for letter, estimate in (("x", found.X), ("z", found.Z)):
            error = np.full((task.trials, 4, 4), np.nan)
            answered = np.flatnonzero(good)[found.ok]
            error[answered] = inverse(true[letter]) @ estimate[found.ok]
            columns[f"{letter}_deg {solver}"] = _angle_deg(error)
            columns[f"{letter}_mm {solver}"] = 1e3 * np.linalg.norm(error[:, :3, 3], axis=-1)
    return columns


def _angle_deg(T: FloatArray) -> FloatArray:
    """Angles of transforms ``(T, 4, 4)`` [deg]; NaN where there is none."""
    angle = np.full(len(T), np.nan)
    good = np.isfinite(T).all(axis=(1, 2))
    angle[good] = np.rad2deg(rotation_angle(T[good, :3, :3]))
    return angle


def _elsewhere(cell: Cell, given: Mapping[str, Any]) -> FloatArray:
    """Postures ``(V, n)`` [rad] that were not measured, the same for every pose set of an arm."""
    rng = np.random.default_rng([given["seed"], 7])
    turn = np.deg2rad(given["within_deg"])
    q = cell.base_posture + rng.uniform(-turn, turn, (given["elsewhere"], cell.robot.n))
    return np.clip(q, cell.robot.lower, cell.robot.upper)
