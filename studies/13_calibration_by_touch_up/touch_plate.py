"""Figure 11: distances on a plate of 5 x 5 targets, touched up by sight, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest
from touch_bench import Bench, PoseSet
from touch_variation import PAPER, WEIGHTED, Identified, every

from calib.correction.compensation import compensate
from calib.errors import UnreachableError
from calib.model import CalibrationModel
from calib.se3 import FloatArray, transform
from posedesign.cell.orientations import touching_poses
from posedesign.constraints import Checker, nearest_postures
from posedesign.simulation.plate import PLATE_PITCH_M, PLATE_POINTS, PlateTest, plate_points

DISTANCES = tuple(round(1e3 * PLATE_PITCH_M) * k for k in range(1, PLATE_POINTS))
"""Distances between points of a row or column [mm]."""

OF_MANY_ARMS = (PAPER, WEIGHTED)
"""Estimators that arms drawn at random are calibrated by."""


@dataclass(frozen=True, eq=False)
class Plate:
    """The plate about the target, across the tool.

    Attributes
    ----------
    bench : Bench
    poses : array (25, 4, 4)
        Of the tip with the tool point on each point, as the cell is known beforehand [m].
    postures : array (25, n)
        Of the nominal arm there [rad].
    T_base_target : array (25, 4, 4)
        Where each point really is, and how its target faces [m].
    """

    bench: Bench
    poses: FloatArray
    postures: FloatArray
    T_base_target: FloatArray

    @classmethod
    def of(cls, bench: Bench) -> Plate:
        """The plate of a cell.

        Raises
        ------
        UnreachableError
        """
        cell, robot = bench.cell, bench.robot
        R = cell.robot.fk(cell.base_posture)[:3, :3]
        points = plate_points() @ R.T
        poses = touching_poses(np.tile(R, (len(points), 1, 1)), cell.tool_m, cell.target_m + points)
        found = nearest_postures(Checker(cell.robot, margin=cell.margin), poses, cell.base_posture)
        if not found.feasible.all():
            raise UnreachableError("the plate cannot be reached", hint="400 mm about the target")
        facing = bench.truth.T_base_target[:3, :3]
        return cls(bench, poses, found.q, transform(facing, robot.target_m + points))

    def touched(self, count: int, rng: np.random.Generator) -> PlateTest:
        """Touch up all points, so many times."""
        own = self.T_base_target
        return PlateTest(self.bench.touched(self.postures, count, rng, T_base_target=own).q)

    def driven(self, model: CalibrationModel, values: FloatArray) -> FloatArray:
        """Worst errors ``(T, 4)`` [m] of distances that commands drive the real tool point to.

        Commands compensated with values ``(T, p)``, as a program made offline would be run: nothing
        is measured.
        """
        commands = [compensate(model, x, postures=self.postures).postures for x in values]
        robot = self.bench.robot
        return PlateTest(np.array(commands)).worst_error(robot.model, robot.values)


def plate_rows(bench: Bench, found: Sequence[tuple[PoseSet, list[Identified]]]) -> dict[str, Any]:
    """Worst distance errors before and after, a row for each pose set and estimator [mm]."""
    plate, count = Plate.of(bench), bench.settings["many"]
    touched = plate.touched(count, np.random.default_rng([bench.settings["seed"], 7]))
    few = bench.settings["data_sets"]
    model = bench.cell.model()
    driven = plate.driven(model, model.nominal[None])
    before = _errors(touched.worst_error(model, model.nominal)) | _driven(driven)
    table = []
    for poses, every_estimator in found:
        for each in every_estimator:
            values = _padded(each, touched)
            row = {"d_deg": poses.d_deg, "c_g": poses.c_g, "estimator": each.estimator.name}
            row |= _errors(touched.worst_error(each.model, values))
            identified = each.values[np.isfinite(each.values).all(axis=1)]
            row |= _driven(plate.driven(each.model, identified[:few]))
            row["ratio"] = row["worst_mm"] / before["worst_mm"]
            table.append(row)
    return {"before": before, "rows": table}


def _errors(worst: FloatArray) -> dict[str, Any]:
    """Medians over data sets of the worst errors ``(T, 4)`` [m], and where 95 % of them are."""
    said = {}
    every_distance = np.column_stack([worst, worst.max(axis=1)]) * 1e3
    names = [*(f"d{d}" for d in DISTANCES), "worst"]
    for name, column in zip(names, every_distance.T, strict=True):
        low, middle, high = np.nanquantile(column, [0.025, 0.5, 0.975])
        said |= {f"{name}_mm": middle, f"{name}_low_mm": low, f"{name}_high_mm": high}
    return {key: float(value) for key, value in said.items()}


def _driven(worst: FloatArray) -> dict[str, float]:
    return {"driven_worst_mm": float(1e3 * np.median(worst.max(axis=1)))}


def drawn_arm(settings: Mapping[str, Any], k: int, stiffness: FloatArray) -> dict[str, Any]:
    """Truth of the k-th arm drawn, about that of ``arms.deflecting``."""
    drawn = settings["robots"]
    rng = np.random.default_rng([settings["seed"], 11, k])
    offsets, softer = rng.standard_normal((2, len(stiffness)))
    return dict(settings["arms"]["deflecting"]) | {
        "seed": k,
        "zero_offsets_deg": (drawn["offset_deg"] * offsets).tolist(),
        "stiffness_nm_per_rad": (stiffness * np.exp(drawn["stiffness"] * softer)).tolist(),
        "link_error_mm": drawn["link_mm"],
        "link_error_deg": drawn["link_deg"],
    }


def ratio_of_arm(bench: Bench, sets: Sequence[PoseSet]) -> FloatArray:
    """Worst distance error after over before, ``(S, E)``.

    Of pose sets and estimators of :data:`OF_MANY_ARMS`; medians over the data sets.
    """
    count, seed = bench.settings["data_sets"], bench.settings["seed"]
    truth = bench.cell.config.truth.seed
    touched = Plate.of(bench).touched(count, np.random.default_rng([seed, 12, truth]))
    model = bench.cell.model()

    def error(kind: CalibrationModel, values: FloatArray) -> float:
        worst = touched.worst_error(kind, values).max(axis=1)
        return float(np.nanmedian(worst))

    found = every(bench, sets, len(touched.postures), 1000 + truth, OF_MANY_ARMS)
    after = [[error(each.model, _padded(each, touched)) for each in them] for _, them in found]
    return np.array(after) / error(model, model.nominal)


def _padded(each: Identified, touched: PlateTest) -> FloatArray:
    """Values of as many data sets as the plate has, NaN where there are none."""
    out = np.full((len(touched.postures), each.values.shape[1]), np.nan)
    count = min(len(out), len(each.values))
    out[:count] = each.values[:count]
    return out


def drawn_ratios(bench: Bench, sets: Sequence[PoseSet], count: int) -> FloatArray:
    """See :func:`ratio_of_arm`; of so many arms ``(A, S, E)``."""
    stiffness = bench.cell.robot.stiffness
    arms = (bench.with_arm(drawn_arm(bench.settings, k, stiffness)) for k in range(1, count + 1))
    return np.array([ratio_of_arm(arm, sets) for arm in arms])


def share(of: FloatArray) -> dict[str, float]:
    """Share of the true, with its 95 % interval (Clopper and Pearson 1934)."""
    ends = binomtest(int(of.sum()), len(of)).proportion_ci(method="exact")
    return {"share": float(of.mean()), "low": float(ends.low), "high": float(ends.high)}
