"""The test of section 3.4 of Watanabe et al. 2006: distances on a plate of known pitch."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.errors import CalibError, ConvergenceError, UnreachableError
from calib.measurement import Setup, TouchUp
from calib.measurement.simulate import simulate
from calib.model import CalibrationModel
from calib.parameters import TargetPoints
from calib.se3 import FloatArray
from posedesign.feasibility import Checker, nearest_postures
from posedesign.generation import touching_poses
from posedesign.simulation import SimulatedRobot

PLATE_POINTS = 5
PLATE_PITCH_M = 0.1
"""The plate of section 3.4 of Watanabe et al. 2006: 5 x 5 targets, 100 mm apart."""


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
        limits = Checker(cell.robot, margin=cell.margin)  # the plate is thought of, not there
        found = nearest_postures(limits, poses, cell.base_posture)
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
        is_target = np.array([name.startswith("target.") for name in robot.model.names])
        values = np.concatenate([robot.values[~is_target], targets.nominal])
        setup = Setup.of(len(points), target=np.arange(len(points)))
        try:
            return cls(simulate(model, values, found.q, rng, trials=trials, setup=setup).postures)
        except ConvergenceError as error:
            raise UnreachableError(f"the test plate cannot be touched: {error.message}") from error

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
        grid = model.view(self.postures, x).tool_points.reshape(-1, PLATE_POINTS, PLATE_POINTS, 3)
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
