"""What touch-ups make of the robot: before and after, and the test on a plate of known pitch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from calib.errors import CalibError, UnreachableError
from calib.identification import IdentificationResult, identify
from calib.measurement import TouchUp, TouchUps
from calib.measurement.simulate import touch
from calib.model import CalibrationModel
from calib.parameters import TargetPoints
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.feasibility import nearest_postures
from posedesign.generation import touching_poses
from posedesign.simulation import SimulatedRobot

PLATE_POINTS = 5
PLATE_PITCH_M = 0.1
"""The plate of section 3.4 of Watanabe et al. 2006: 5 x 5 targets, 100 mm apart."""


def identify_models(cell: Cell, touch_ups: TouchUps) -> tuple[IdentificationResult, ...]:
    """Identify what the cell asks for, and the baseline it has to beat.

    The first result, ``frames only``, places tool point and targets and leaves the robot as it
    is: errors of the set-up are not the robot's, and a "before" that contains them flatters every
    calibration. The second, ``offsets``, frees the zero offsets as well.

    Parameters
    ----------
    cell : Cell
    touch_ups : TouchUps
        Of any targets; their positions need not be known.

    Raises
    ------
    InputError, NotIdentifiableError, ConvergenceError
        As :func:`calib.identification.identify`.
    """
    # where the nominal arm sees each target: any guess will do, tool and targets are fitted first
    points = cell.robot.state(touch_ups.postures).point(cell.tool_m)
    guesses = [points[touch_ups.target == k].mean(axis=0) for k in range(len(touch_ups.labels))]
    targets = TargetPoints(guesses, touch_ups.labels)
    weighted = cell.config.measurement.weighted
    return tuple(
        identify(cell.model(offsets, targets=targets), touch_ups, weighted=weighted, name=name)
        for name, offsets in (("frames only", ()), ("offsets", cell.offset_joints))
    )


def results_as_dict(
    cell: Cell, touch_ups: TouchUps, results: Sequence[IdentificationResult]
) -> dict[str, Any]:
    """The content of ``identification.json``: degrees and millimetres."""
    best = min(results, key=lambda r: r.leave_one_out_rms_m)
    return {
        "robot": cell.robot.name,
        "touch_ups": touch_ups.count,
        "targets": list(touch_ups.labels),
        "weighted": cell.config.measurement.weighted,
        "recommended": best.model,
        "models": [
            {
                "name": r.model,
                "status": r.status,
                "message": r.message,
                "iterations": r.iterations,
                "rms_mm": r.rms_m * 1e3,
                "max_mm": r.max_m * 1e3,
                "leave_one_out_rms_mm": r.leave_one_out_rms_m * 1e3,
                "chi2": r.chi2,
                "degrees_of_freedom": r.degrees_of_freedom,
                "noise_scale": r.noise_scale,
                "parameters": [
                    {"name": name, "value": value, "unit": unit, "sigma": sigma, "change": change}
                    for name, unit, value, change, sigma in r.displayed()
                ],
            }
            for r in results
        ],
    }


@dataclass(frozen=True, eq=False)
class PlateTest:
    """The plate as seen by one robot after another: section 3.4 and Fig. 11 of the paper.

    Attributes
    ----------
    postures : array (T, 25, n)
        Joint values with the tool point on each point of the plate, a trial a row [rad].
    """

    postures: FloatArray

    @classmethod
    def measure(cls, robot: SimulatedRobot, rng: np.random.Generator, trials: int) -> PlateTest:
        """Touch up every point of a plate around the target, the tool held as at the base pose.

        Raises
        ------
        UnreachableError
            The arm cannot reach all of the plate.
        """
        cell = robot.cell
        rotation = cell.robot.fk(cell.base_posture)[:3, :3]
        points = robot.target_m + plate_points() @ rotation.T  # in the plane across the tool
        poses = touching_poses(np.broadcast_to(rotation, (len(points), 3, 3)), cell.tool_m, points)
        found = nearest_postures(cell.robot, poses, cell.base_posture, cell.margin)
        if not found.feasible.all():
            worst = int(np.argmin(found.feasible))
            raise UnreachableError(
                f"point {worst + 1} of the test plate cannot be touched: {found.reasons[worst]}",
                hint="the plate test needs 400 mm around the target",
            )
        # each point is a target of its own, touched once
        labels = [f"plate{i}" for i in range(len(points))]
        targets = TargetPoints(points, labels)
        model = CalibrationModel(
            cell.robot,
            [*(b for b in robot.model.parameters if not isinstance(b, TargetPoints)), targets],
            TouchUp(np.array(cell.config.measurement.three_sigma_mm) / 3e3),
        )
        values = np.concatenate([robot.values[:-3], targets.nominal])
        index = np.arange(len(points))
        start, _ = touch(model, found.q, values, index)
        R = model.view(start, values, index)[0].state.R_base_tip
        off = model.measurement.sample(np.broadcast_to(R, (trials, *R.shape)), rng)
        postures, _ = touch(model, start, values, index, off)
        return cls(postures)

    def worst_error(self, model: CalibrationModel, x: FloatArray) -> FloatArray:
        """Largest error of a distance between two points of one row or column.

        Parameters
        ----------
        model : CalibrationModel
            The robot that turns joint values into positions.
        x : array (p,) or (T, p)
            Its parameters.

        Returns
        -------
        array (T, 4)
            [m], for distances of 1, 2, 3 and 4 pitches.
        """
        view, _ = model.view(self.postures, x)
        grid = view.point.reshape(-1, PLATE_POINTS, PLATE_POINTS, 3)
        worst = np.zeros((len(grid), PLATE_POINTS - 1))
        for a, b in combinations(range(PLATE_POINTS), 2):
            apart = b - a
            for first, second in ((grid[:, a], grid[:, b]), (grid[:, :, a], grid[:, :, b])):
                length = np.linalg.norm(first - second, axis=-1)
                error = np.abs(length - apart * PLATE_PITCH_M).max(axis=-1)
                worst[:, apart - 1] = np.maximum(worst[:, apart - 1], error)
        return worst


def plate_points() -> FloatArray:
    """Points of the plate ``(25, 3)`` [m] about its centre, in its own plane z = 0."""
    steps = PLATE_PITCH_M * (np.arange(PLATE_POINTS) - (PLATE_POINTS - 1) / 2.0)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    return np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)


def try_plate(robot: SimulatedRobot, rng: np.random.Generator, trials: int) -> PlateTest | str:
    """The plate test, or in words why this cell has no room for it."""
    try:
        return PlateTest.measure(robot, rng, trials)
    except CalibError as error:
        return error.message
