"""Figure 11: distances on a plate of 5 x 5 targets, touched up by sight, before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.chance import spread_interval
from calib.correction import compensate
from calib.identification import covariance_of, identify_batch
from calib.model import CalibrationModel
from calib.model.measurements import Measurement, TouchUp, ViewLine, touch_ups
from calib.se3 import FloatArray, transform
from calib.vision.camera.observers import Kind
from posedesign.simulation import PLATE_PITCH_M, PlateTest, effective_truth
from posedesign.simulation.accuracy import PLATE_POINTS, plate_postures, points_around

from .touch_bench import Bench, DataSets, PoseSet

OFFSET = "zero_offset.joint_2"


@dataclass(frozen=True)
class Estimator:
    """One way to come from touch-ups to parameters."""

    name: str
    by_view_line: bool = False  # whether the loop follows the view line only
    uses_size: bool = True
    """Whether all three coordinates go into the identification, or those across the line."""
    weighted: bool = False


PAPER, WEIGHTED, LINE, ACROSS = ESTIMATORS = (
    Estimator("touch-up"),
    Estimator("touch-up, weighted", weighted=True),
    Estimator("view line", by_view_line=True, uses_size=False),
    Estimator("touch-up, size left out", uses_size=False),
)
"""The paper's two, unweighted; the first with weights; and the touch-ups as view lines, which the
paper may have meant by its second."""


@dataclass(frozen=True, eq=False)
class Identified:
    """What an estimator makes of the data sets of a pose set."""

    estimator: Estimator
    model: CalibrationModel
    values: FloatArray  # (T, p) [SI]; NaN where it has not converged
    predicted: FloatArray  # (p,): standard deviations from the noise [SI]
    sigma: FloatArray
    """(3,): the noise, as touch-ups of one pose repeat each other, in the tip's axes [m]."""
    data: DataSets

    @property
    def offset_deg(self) -> FloatArray:
        """Offset of joint 2 ``(T,)`` [deg], of the data sets that converge."""
        offset = self.values[:, self.model.names.index(OFFSET)]
        return np.asarray(np.rad2deg(offset[np.isfinite(offset)]))

    @property
    def failed(self) -> int:
        """Data sets without an answer: a pose not touched, or no convergence."""
        return self.data.failed + int((~np.isfinite(self.values[:, 0])).sum())


def identified(bench: Bench, data: DataSets, chosen: Estimator) -> Identified:
    """Identify every data set; the noise is that of the first ones, as they repeat each other."""
    sigma = data.first(bench.settings["data_sets"]).scatter(bench.cell.robot)
    kind: Measurement = TouchUp(sigma) if chosen.uses_size else ViewLine(sigma[:2])
    model = bench.cell.model(measurement=kind)
    values = identify_batch(model, touch_ups(data.q), weighted=chosen.weighted)
    covariance = covariance_of(model, data.q[0], weighted=chosen.weighted)
    return Identified(chosen, model, values, np.sqrt(np.diag(covariance)), sigma, data)


def every(
    bench: Bench,
    sets: Sequence[PoseSet],
    count: int,
    stream: int,
    estimators: Sequence[Estimator] = ESTIMATORS,
) -> Iterator[tuple[PoseSet, list[Identified]]]:
    """Data sets of each pose set, identified by each estimator; a seed for each pose set."""
    for poses in sets:
        rng = np.random.default_rng([bench.settings["seed"], stream, round(poses.d_deg)])
        data = {
            by_line: bench.touched(poses.postures, count, rng, view_line=by_line)
            for by_line in sorted({each.by_view_line for each in estimators})
        }
        yield poses, [identified(bench, data[each.by_view_line], each) for each in estimators]


def rows(bench: Bench, poses: PoseSet, found: Sequence[Identified]) -> list[dict[str, Any]]:
    """A row for each estimator: the paper's ten data sets, and all of them [deg]."""
    table = []
    for each in found:
        true = np.rad2deg(effective_truth(bench.robot, each.model))
        k = each.model.names.index(OFFSET)
        offset = each.offset_deg
        row: dict[str, Any] = {"d_deg": poses.d_deg, "c_g": poses.c_g}
        row |= {"poses": len(poses.postures), "estimator": each.estimator.name}
        ten = offset[: bench.settings["data_sets"]]
        row |= spread("ten_", ten) | {"ten_range_deg": float(np.ptp(ten))}
        row |= spread("many_", offset)
        row["predicted_deg"] = float(np.rad2deg(each.predicted[k]))
        row["error_deg"] = float(offset.mean() - true[k])
        row |= {"data_sets": len(offset), "failed": each.failed, "moves": each.data.moves}
        row["noise_3s_mm"] = (3e3 * each.sigma).tolist()
        table.append(row)
    return table


def spread(prefix: str, offset_deg: FloatArray) -> dict[str, float]:
    """Standard deviation with its 95 % interval (chi-squared)."""
    std = float(offset_deg.std(ddof=1))
    low, high = spread_interval(std, len(offset_deg))
    return {f"{prefix}std_deg": std, f"{prefix}low_deg": low, f"{prefix}high_deg": high}


def through_pictures(bench: Bench, sets: Sequence[PoseSet]) -> dict[str, float]:
    """One pose set touched up through rendered pictures, beside the fast camera [deg, mm]."""
    wanted, seed = bench.settings["pictures_d_deg"], bench.settings["seed"]
    poses = next(s for s in sets if s.d_deg == wanted)
    said: dict[str, float] = {"d_deg": wanted, "c_g": poses.c_g}
    counts: dict[Kind, int] = {"image": bench.settings["pictures_data_sets"]}
    counts["fast"] = bench.settings["many"]
    for kind, count in counts.items():
        rng = np.random.default_rng([seed, 3, len(kind)])
        data = bench.touched(poses.postures, count, rng, kind=kind)
        found = identified(bench, data, PAPER)
        said |= spread(f"{kind}_", found.offset_deg)
        said[f"{kind}_mean_deg"] = float(found.offset_deg.mean())
        said |= {f"{kind}_data_sets": count, f"{kind}_moves": data.moves}
        for axis, sigma in zip("vhd", data.scatter(bench.cell.robot), strict=True):
            said[f"{kind}_{axis}_3s_mm"] = float(3e3 * sigma)
    return said


def causes(bench: Bench, truth: Mapping[str, Any], sets: Sequence[PoseSet]) -> list[dict[str, Any]]:
    """What makes the mean wrong: errors of the offset [deg] with one cause at a time away.

    A row for each pose set of ``causes_d_deg`` and each cause; a column for each estimator.
    """
    count = bench.settings["causes_data_sets"]
    tight = bench.with_arm(dict(truth) | {"backlash_deg": 0.0})
    cases = (("nothing", bench, False), ("tilt of the target", bench, True))
    table = []
    for poses in (s for s in sets if s.d_deg in bench.settings["causes_d_deg"]):
        for away, arm, tilt_known in (*cases, ("backlash", tight, False)):
            row: dict[str, Any] = {"d_deg": poses.d_deg, "c_g": poses.c_g, "away": away}
            for each in (PAPER, WEIGHTED, LINE):
                rng = np.random.default_rng([bench.settings["seed"], 31, round(poses.d_deg)])
                data = arm.touched(
                    poses.postures, count, rng, view_line=each.by_view_line, tilt_known=tilt_known
                )
                found = identified(arm, data, each)
                k = found.model.names.index(OFFSET)
                true = np.rad2deg(effective_truth(arm.robot, found.model)[k])
                row[f"{each.name} error_deg"] = float(found.offset_deg.mean() - true)
            table.append(row)
    return table


DISTANCES = tuple(round(1e3 * PLATE_PITCH_M) * k for k in range(1, PLATE_POINTS))
"""Distances between points of a row or column [mm]."""

OF_MANY_ARMS = (PAPER, WEIGHTED)
"""Estimators that arms drawn at random are calibrated by."""


@dataclass(frozen=True, eq=False)
class Plate:
    """The plate about the target, across the tool."""

    bench: Bench
    postures: FloatArray  # (25, n): of the nominal arm there [rad]
    T_base_target: FloatArray
    """(25, 4, 4): where each point really is, and how its target faces [m]."""

    @classmethod
    def of(cls, bench: Bench) -> Plate:
        """The plate of a cell. Raises UnreachableError."""
        cell, facing = bench.cell, bench.truth.T_base_target[:3, :3]
        there = transform(facing, points_around(cell, bench.robot.target_m))
        return cls(bench, plate_postures(cell, cell.target_m), there)

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
