"""The test of section 3.4 of Watanabe et al. 2006: distances on a plate of known pitch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.errors import CalibError, ConvergenceError, UnreachableError
from calib.model import CalibrationModel, Setup, simulate
from calib.model.parameters import TargetPoints
from calib.se3 import FloatArray
from calib.vision.camera import Observer
from calib.vision.touch_up import Drive, ImageJacobian, Loop, SimulatedArms, TrueCell, touch_up
from posedesign.cell import Cell, touching_poses
from posedesign.cell.measuring import make_touch_up
from posedesign.constraints import Checker, nearest_postures
from posedesign.simulation.rehearsal import SimulatedRobot

PLATE_POINTS = 5
PLATE_PITCH_M = 0.1
"""The plate of section 3.4 of Watanabe et al. 2006: 5 x 5 targets, 100 mm apart."""


@dataclass(frozen=True, eq=False)
class PlateTest:
    """The plate as seen by one robot after another: section 3.4 and Fig. 11 of the paper."""

    postures: FloatArray
    """(T, 25, n): joint values with the tool point on each point of the plate, a trial a row
    [rad]."""

    @classmethod
    def measure(cls, robot: SimulatedRobot, rng: np.random.Generator, trials: int) -> PlateTest:
        """Touch up every point of a plate around the target, the tool held as at the base pose.

        Raises UnreachableError: the arm cannot reach all of the plate.
        """
        cell = robot.cell
        points = _points_around(cell, robot.target_m)
        q = _plate_postures(cell, robot.target_m)
        # each point is a target of its own, touched once
        labels = [f"plate{i}" for i in range(len(points))]
        targets = TargetPoints(points, labels)
        model = CalibrationModel(
            cell.robot,
            [*(b for b in robot.model.parameters if not isinstance(b, TargetPoints)), targets],
            make_touch_up(cell.config, cell.T_tip_camera[:3, :3]),
        )
        is_target = np.array([name.startswith("target.") for name in robot.model.names])
        values = np.concatenate([robot.values[~is_target], targets.nominal])
        setup = Setup.of(len(points), target=np.arange(len(points)))
        try:
            return cls(simulate(model, values, q, rng, trials=trials, setup=setup).postures)
        except ConvergenceError as error:
            raise UnreachableError(f"the test plate cannot be touched: {error.message}") from error

    @classmethod
    def by_sight(
        cls,
        cell: Cell,
        truth: TrueCell,
        observer: Observer,
        jacobian: ImageJacobian,
        loop: Loop,
        rng: np.random.Generator,
        trials: int = 1,
    ) -> PlateTest:
        """Touch up every point of a plate around the target by what a simulated camera sees.

        ``cell``: with camera and target as they were found: where the arm is sent. ``truth``: with
        one target, in the middle of the plate, which lies across the camera of the base pose.
        ``trials``: how often the plate is measured. Raises UnreachableError: a point cannot be
        reached, or was not touched.
        """
        found = _plate_postures(cell, cell.target_m)
        R = cell.robot.fk(cell.base_posture)[:3, :3]
        targets = np.tile(truth.T_base_target, (len(found), 1, 1))
        targets[:, :3, 3] += plate_points() @ R.T
        every = np.tile(targets, (trials, 1, 1))
        q = np.tile(found, (trials, 1))
        arms = SimulatedArms(
            replace(truth, T_base_target=every), observer, len(q), rng, cell.base_posture
        )
        approach = np.deg2rad(cell.config.touch_up.approach_deg)
        done = touch_up(Drive(cell.robot, arms, approach), q, jacobian, loop)
        if not done.touched.all():
            worst = int(np.argmin(done.touched))
            raise UnreachableError(
                f"point {worst % len(found) + 1} of the test plate was not touched up: "
                f"{done.reasons[worst]}",
                hint="the plate test needs 400 mm around the target",
            )
        return cls(done.q.reshape(trials, len(found), -1))

    def worst_error(self, model: CalibrationModel, x: FloatArray) -> FloatArray:
        """Largest error of a distance between two points of one row or column.

        ``model``: the robot that turns joint values into positions. ``x`` (p,) or (T, p): its
        parameters. Returns ``(T, 4)`` [m], for distances of 1, 2, 3 and 4 pitches.
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


def _points_around(cell: Cell, middle: FloatArray) -> FloatArray:
    """Points of a plate ``(25, 3)`` [m] about a point, in the plane across the tool."""
    return np.asarray(middle + plate_points() @ cell.robot.fk(cell.base_posture)[:3, :3].T)


def _plate_postures(cell: Cell, middle: FloatArray) -> FloatArray:
    """Postures ``(25, n)`` [rad] that touch a plate, the tool held as at the base pose."""
    points = _points_around(cell, middle)
    rotation = cell.robot.fk(cell.base_posture)[:3, :3]
    poses = touching_poses(np.broadcast_to(rotation, (len(points), 3, 3)), cell.tool_m, points)
    limits = Checker(cell.robot, margin=cell.margin)  # the plate is thought of, not there
    found = nearest_postures(limits, poses, cell.base_posture)
    if not found.feasible.all():
        worst = int(np.argmin(found.feasible))
        raise UnreachableError(
            f"point {worst + 1} of the test plate cannot be touched: {found.reasons[worst]}",
            hint="the plate test needs 400 mm around the target",
        )
    return found.q


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
