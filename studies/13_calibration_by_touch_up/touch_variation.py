"""Figures 9 and 10: how much the identified offset of joint 2 varies from data set to data set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from touch_bench import Bench, DataSets, PoseSet

from calib.identification import covariance_of, identify_batch
from calib.model import CalibrationModel
from calib.model.measurements import Measurement, TouchUp, ViewLine, touch_ups
from calib.se3 import FloatArray
from calib.vision.camera.observers import Kind
from posedesign.simulation.accuracy_study import effective_truth, spread_interval

OFFSET = "zero_offset.joint_2"


@dataclass(frozen=True)
class Estimator:
    """One way to come from touch-ups to parameters.

    Attributes
    ----------
    name : str
    by_view_line : bool
        Whether the loop follows the view line only.
    uses_size : bool
        Whether all three coordinates go into the identification, or those across the line.
    weighted : bool
    """

    name: str
    by_view_line: bool = False
    uses_size: bool = True
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
    """What an estimator makes of the data sets of a pose set.

    Attributes
    ----------
    estimator : Estimator
    model : CalibrationModel
    values : array (T, p)
        [SI]
        NaN where it has not converged.
    predicted : array (p,)
        Standard deviations from the noise [SI].
    sigma : array (3,)
        The noise, as touch-ups of one pose repeat each other, in the tip's axes [m].
    data : DataSets
    """

    estimator: Estimator
    model: CalibrationModel
    values: FloatArray
    predicted: FloatArray
    sigma: FloatArray
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
