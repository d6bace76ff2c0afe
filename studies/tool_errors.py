"""Cells, task boxes and errors of the tool point over them: studies 10 and 11.

A simulated arm is touched up many times, each set of touch-ups is identified, and the tool point of
the arm so identified is held against the true one at the points of the box, by the kinematics of
both and not by a derivative. The frame is that of
:func:`calib.identification.prediction.predict_accuracy`: the base as the targets were found in it,
turned by the zero offset of joint 1 that they take up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.identification import Against, covariance_of, identify_batch, predict_accuracy
from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import Measurement
from calib.model.parameters import (
    JointCompliance,
    LinkGeometry,
    ParameterBlock,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import BoolArray, FloatArray, IntArray, apply, wpr_from_rotation
from posedesign.candidates import CandidatePoses
from posedesign.cell import (
    Cell,
    TaskBox,
    cell_template,
    touching_poses,
    usual_offsets,
    wpr_rotations,
)
from posedesign.cell.task_box import reached_points
from posedesign.constraints import nearest_postures
from posedesign.simulation import SimulatedRobot


def study_cell(name: str, smallest_singular_value: float) -> Cell:
    """The cell of a preset, bounded by joint limits and a distance from singular postures."""
    cell = Cell.from_text(cell_template(name, surroundings=False))
    constraints = cell.config.constraints.model_copy(
        update={"smallest_singular_value": smallest_singular_value}
    )
    config = cell.config.model_copy(update={"constraints": constraints})
    return Cell.from_config(config, Path("cell.toml"))


def box_postures(cell: Cell, box: Mapping[str, Sequence[float]]) -> FloatArray:
    """Postures ``(K, n)`` [rad] at the points of a box ``lowest_mm`` to ``highest_mm``."""
    lowest, highest = (np.array(box[key]) / 1e3 for key in ("lowest_mm", "highest_mm"))
    found = reached_points(cell, TaskBox(lowest, highest))
    return found.q[found.feasible]


def grid_pool(cell: Cell, width_deg: float, part: BoolArray | None = None) -> CandidatePoses:
    """Poses of the W P R grid that can be taken, or of a part ``(27,)`` of it."""
    wpr = wpr_from_rotation(cell.robot.fk(cell.base_posture)[:3, :3])
    rotations = wpr_rotations(wpr, np.deg2rad([width_deg] * 3))
    poses = touching_poses(
        rotations if part is None else rotations[part], cell.tool_m, cell.target_m
    )
    found = nearest_postures(cell.checker, poses, cell.base_posture)
    return pool_at_target(cell, found.q[found.feasible])


def pool_at_target(cell: Cell, postures: FloatArray) -> CandidatePoses:
    """Postures ``(N, n)`` [rad] at the one target of a cell, as a pool."""
    return CandidatePoses(
        postures,
        cell.robot.fk(postures)[:, :3, :3],
        np.zeros(len(postures), dtype=np.intp),
        cell.target_m[None],
        (cell.config.target.name,),
        len(postures),
        "given postures",
    )


CONFIDENCE = 0.95
RESAMPLES = 1000
"""Bootstrap samples of an interval."""

RESAMPLING_SEED = 0
"""Of the bootstrap alone: an interval is the same whatever was drawn before it."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Poses that are measured, and the model that is identified from them."""

    model: CalibrationModel
    postures: FloatArray  # (N, n) [rad]
    setup: Setup  # what each touches
    weighted: bool = True  # whether rows are weighted by their noise

    @classmethod
    def of(
        cls,
        model: CalibrationModel,
        pool: CandidatePoses,
        repeats: int = 1,
        *,
        weighted: bool = True,
    ) -> Experiment:
        """All postures of a pool, each measured so many times."""
        rows = np.tile(np.arange(len(pool)), repeats)
        return cls(model, pool.postures[rows], pool.setup(model)[rows], weighted)

    @property
    def covariance(self) -> FloatArray:
        """Predicted, ``(p, p)`` [SI]."""
        return covariance_of(self.model, self.postures, setup=self.setup, weighted=self.weighted)


@dataclass(frozen=True, eq=False)
class ToolErrors:
    """Errors of the tool point at K points of a box in T trials."""

    errors_m: FloatArray  # (T, K, 3): identified less true [m], base axes
    covariance: FloatArray  # (K, 3, 3): as predicted [m²]
    group: IntArray
    """(T,): trials of one group share what was drawn for all of them: they are resampled
    together."""
    failed: int = 0  # trials that gave no answer

    @classmethod
    def joined(cls, parts: Sequence[ToolErrors]) -> ToolErrors:
        """Trials of several arms or models as one, each a group of its own."""
        return cls(
            np.concatenate([part.errors_m for part in parts]),
            np.mean([part.covariance for part in parts], axis=0),
            np.repeat(np.arange(len(parts)), [len(part.errors_m) for part in parts]),
            sum(part.failed for part in parts),
        )

    @cached_property
    def squares(self) -> FloatArray:
        """Squared errors ``(T, K)`` [m²]."""
        return np.asarray((self.errors_m**2).sum(axis=-1))

    @property
    def of_trials_m(self) -> FloatArray:
        """Root mean square over the box in each trial, ``(T,)`` [m]."""
        return np.asarray(np.sqrt(self.squares.mean(axis=1)))

    @property
    def worst_of_trials_m(self) -> FloatArray:
        """Error at the worst point in each trial, ``(T,)`` [m]."""
        return np.asarray(np.sqrt(self.squares.max(axis=1)))

    @property
    def rms_m(self) -> float:
        """Root mean square over the box and the trials [m]."""
        return float(np.sqrt(self.squares.mean()))

    @property
    def worst_m(self) -> float:
        """Root mean square over the trials at the point where it is largest [m]."""
        return float(np.sqrt(self.squares.mean(axis=0).max()))

    @property
    def predicted_rms_m(self) -> float:
        """What the covariance says that :attr:`rms_m` will be [m]."""
        return float(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2).mean()))

    @property
    def predicted_worst_m(self) -> float:
        """What it says that :attr:`worst_m` will be [m]."""
        return float(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2).max()))

    @cached_property
    def resampled(self) -> FloatArray:
        """Mean squares ``(B, K)`` [m²] of bootstrap samples of the groups."""
        groups, index = np.unique(self.group, return_inverse=True)
        sums = np.zeros((len(groups), self.squares.shape[1]))
        np.add.at(sums, index, self.squares)
        counts = np.bincount(index)
        rng = np.random.default_rng(RESAMPLING_SEED)
        drawn = rng.multinomial(len(groups), np.full(len(groups), 1 / len(groups)), RESAMPLES)
        return np.asarray((drawn @ sums) / (drawn @ counts)[:, None])

    @property
    def rms_interval_m(self) -> tuple[float, float]:
        """Of :attr:`rms_m` [m]."""
        return interval(np.sqrt(self.resampled.mean(axis=1)))

    @property
    def worst_interval_m(self) -> tuple[float, float]:
        """Of :attr:`worst_m` [m]."""
        return interval(np.sqrt(self.resampled.max(axis=1)))

    @property
    def figures_mm(self) -> dict[str, float]:
        """Predicted and found, with intervals, over the box and at its worst point [mm]."""
        (low, high), (worst_low, worst_high) = self.rms_interval_m, self.worst_interval_m
        found = {
            "predicted_rms": self.predicted_rms_m, "rms": self.rms_m,
            "rms_low": low, "rms_high": high,
            "median_of_trials": float(np.median(self.of_trials_m)),
            "predicted_worst": self.predicted_worst_m, "worst": self.worst_m,
            "worst_low": worst_low, "worst_high": worst_high,
            "median_of_worst": float(np.median(self.worst_of_trials_m)),
        }  # fmt: skip
        return {f"{name}_mm": 1e3 * value for name, value in found.items()}

    @property
    def ratio(self) -> float:
        """Simulated over predicted root mean square."""
        return self.rms_m / self.predicted_rms_m


def interval(samples: FloatArray) -> tuple[float, float]:
    """Percentiles of bootstrap samples ``(B,)`` between which :data:`CONFIDENCE` of them lie."""
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)


def simulated_arm(
    cell: Cell,
    pool: CandidatePoses,
    measurement: Measurement,
    *,
    deflects: bool = False,
    tool_z: bool = True,
    geometry: dict[str, float] | None = None,
) -> SimulatedRobot:
    """An arm with the errors of a cell's ``[truth]``, before the targets of a pool.

    Parameters
    ----------
    pool : CandidatePoses
        All its targets are off by the error of the cell's one.
    measurement : Measurement
        With the noise as it really is.
    deflects : bool
        Whether its reducers give way.
    tool_z : bool
        False: the tool point is known along z, which a view line does not show.
    geometry : dict, optional
        Errors of links by name [m, rad].
    """
    truth, robot = cell.config.truth, cell.robot
    given = truth.zero_offsets_deg
    offsets = usual_offsets(robot.n) if given is None else np.deg2rad(given)
    blocks: list[ParameterBlock] = [ZeroOffsets(robot, robot.joint_names)]
    values = [offsets]
    if deflects:
        blocks.append(JointCompliance(robot, robot.joint_names, cell.payload))
        values.append(1.0 / cell.stiffness)
    if geometry:
        links = LinkGeometry(robot, list(geometry))
        blocks.append(links)
        values.append(np.array([geometry[name] for name in links.names]))
    on_tool = np.array(truth.tool_error_mm) / 1e3 * [1.0, 1.0, float(tool_z)]
    there = pool.targets_m + np.array(truth.target_error_mm) / 1e3
    model = CalibrationModel(
        robot, [*blocks, ToolPoint(cell.tool_m), pool.target_points()], measurement
    )
    return SimulatedRobot(cell, model, np.concatenate([*values, cell.tool_m + on_tool, *there]))


def simulate_errors(
    arm: SimulatedRobot,
    experiment: Experiment,
    box: FloatArray,
    trials: int,
    rng: np.random.Generator,
    against: Against = "base",
    *,
    own_zero: bool = False,
) -> ToolErrors:
    """Touch up and identify, and hold the arm so identified against the true one.

    Parameters
    ----------
    arm : SimulatedRobot
        With the targets of the experiment, in the same order.
    box : array (K, n)
        Postures at the points of the box [rad].
    against : {"base", "target"}
        See :func:`calib.identification.prediction.predict_accuracy`; the first target.
    own_zero : bool
        See :func:`tool_errors`.
    """
    model, setup = experiment.model, experiment.setup
    touched = simulate(arm.model, arm.values, experiment.postures, rng, trials=trials, setup=setup)
    found = identify_batch(model, touched, weighted=experiment.weighted)
    good = np.isfinite(found).all(axis=1)
    errors = tool_errors(arm, model, found[good], box, against, own_zero=own_zero)
    spread = predict_accuracy(model, experiment.covariance, box, against=against)
    return ToolErrors(errors, spread, np.arange(good.sum()), int((~good).sum()))


def tool_errors(
    arm: SimulatedRobot,
    model: CalibrationModel,
    found: FloatArray,
    box: FloatArray,
    against: Against = "base",
    *,
    own_zero: bool = False,
) -> FloatArray:
    """Errors ``(T, K, 3)`` [m] of a model with parameters ``(T, p)`` at postures ``(K, n)``.

    With ``own_zero`` in the base as the zero of joint 1 should have it, not as it was found.
    """
    T_shown_base = np.eye(4) if own_zero else arm.T_shown_base
    true, said = arm.model.view(box, arm.values), model.view(box[None], found)
    shown, points = apply(T_shown_base, true.tool_points), said.tool_points
    if against == "target":
        names = [f"target.{model.targets[0]}.{axis}" for axis in "xyz"]
        own = [model.names.index(name) for name in names]
        theirs = arm.values[[arm.model.names.index(name) for name in names]]
        points = points - found[:, None, own]
        shown = shown - apply(T_shown_base, theirs)
    return np.asarray(points - shown)
