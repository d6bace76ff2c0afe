"""What measurements make of the robot, beside the baselines that leave it as it is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.identification import IdentificationResult, check_enough
from calib.identification.comparison import Comparison, Trial, compare
from calib.identification.report import ANOTHER_ROBOT_M
from calib.identification.result import DISPLAY
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.measurement_table import MeasurementTable
from posedesign.models import OFFSETS, candidates, left_out
from posedesign.set_up import frames_of, nominal_distances, seen_once

_PLANNED = re.compile(r"P(\d{2,4})", re.ASCII)
"""Names that plans give to poses."""


@dataclass(frozen=True, eq=False)
class Identified:
    """All models on one set of measurements.

    Attributes
    ----------
    comparison : Comparison
    table : MeasurementTable
    warnings : tuple of str
    """

    comparison: Comparison
    table: MeasurementTable
    warnings: tuple[str, ...]

    @property
    def nominal_rms_m(self) -> float:
        """Root mean square distance with everything as described [m]; NaN where that says none."""
        known = self.comparison.nominal_m[np.isfinite(self.comparison.nominal_m)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")

    @property
    def best(self) -> IdentificationResult:
        """The result of the recommended model."""
        return self.comparison.best

    @property
    def is_of_this_robot(self) -> bool:
        """Whether any model brings the residuals to what an arm that is switched on can be off."""
        return any(result.rms_m <= ANOTHER_ROBOT_M for result in self.comparison.results)


def identify_models(cell: Cell, table: MeasurementTable) -> Identified:
    """Identify what the cell asks for, and the baselines that it has to beat.

    ``frames only`` places tool and targets and leaves the robot as it is: errors of the set-up are
    not the robot's, and a "before" that contains them flatters every calibration. Then each set of
    ``parameters.models``, from small to large.

    Parameters
    ----------
    cell : Cell
    table : MeasurementTable
        Of any targets; their positions need not be known.

    Raises
    ------
    InputError, NotIdentifiableError, ConvergenceError
        As :func:`calib.identification.identify`, for the baseline or where all else is refused.
    """
    section = cell.config.parameters
    tried = candidates(cell, table)
    # before the baseline, which has fewer parameters and would be refused for another reason
    for candidate in reversed(tried):
        if not candidate.notes:  # a reduced one has as many as there are equations for
            check_enough(candidate.model, table.data)
    comparison = compare(
        tried,
        table.data,
        nominal_m=nominal_distances(cell, table),
        weighted=cell.config.measurement.weighted,
        method=section.method,
        loss=section.loss,
    )
    _refuse_if_asked_for(cell, comparison)
    said = missing_poses(table.data.names)
    said += [
        f"the target {label} was measured once: it says nothing but its own place"
        for label in seen_once(table.data)
    ]
    return Identified(comparison, table, (*said, *left_out(cell)))


def _refuse_if_asked_for(cell: Cell, comparison: Comparison) -> None:
    """Raise what kept a model from being identified that the cell asks for joint by joint.

    Or what kept the first one, where nothing beyond the baseline was left.
    """
    refused = [trial for trial in comparison.trials if trial.error is not None]
    for trial in refused:
        listed = trial.name == OFFSETS and cell.config.parameters.zero_offsets is not None
        if trial.error and (listed or len(comparison.results) == 1):
            raise trial.error


def without_repeats(table: MeasurementTable) -> tuple[MeasurementTable, list[str]]:
    """The table without rows that repeat another number by number, and what was left out.

    A measurement that was made twice differs in its last digits; a row that was pasted twice does
    not, and would count double.
    """
    data = table.data
    first: dict[tuple[Any, ...], int] = {}
    kept, said = [], []
    setup = data.setup
    for i in range(data.count):
        key: tuple[Any, ...] = (setup.kind[i], setup.tool[i], setup.target[i], setup.payload[i])
        key += (data.postures[i].tobytes(),)
        if data.observed is not None:
            key += (data.observed[i].tobytes(),)
        if key in first:
            j = first[key]
            said.append(
                f"line {table.lines[i]} repeats line {table.lines[j]} number by number: left out"
            )
        else:
            first[key] = i
            kept.append(i)
    if not said:
        return table, []
    rows = np.array(kept, dtype=np.intp)
    lines = tuple(table.lines[i] for i in kept)
    return MeasurementTable(data[rows], table.kinds, lines), said


def missing_poses(names: Sequence[str]) -> list[str]:
    """What a numbered plan has between its first and its last pose, and the data have not."""
    found = [_PLANNED.fullmatch(name) for name in dict.fromkeys(names)]
    if not names or not all(found):
        return []
    numbers = {int(match[1]) for match in found if match}
    width = min(len(match[1]) for match in found if match)
    gaps = [k for k in range(1, max(numbers)) if k not in numbers]
    if not gaps:
        return []
    listed = ", ".join(f"P{k:0{width}d}" for k in gaps[:10])
    return [f"the poses {listed}{' and more' if len(gaps) > 10 else ''} were not measured"]


def results_as_dict(cell: Cell, identified: Identified) -> dict[str, Any]:
    """The content of ``identification.json``: degrees and millimetres."""
    comparison, data = identified.comparison, identified.table.data
    return {
        "robot": cell.robot.name,
        "joints": list(cell.robot.joint_names),
        "measurements": data.count,
        "kinds": list(identified.table.kinds),
        "targets": list(data.targets),
        "tools": list(data.tools),
        "weighted": cell.config.measurement.weighted,
        "loss": cell.config.parameters.loss,
        "nominal_rms_mm": _or_none(identified.nominal_rms_m * 1e3),
        "recommended": comparison.recommended if identified.is_of_this_robot else None,
        "reason": comparison.reason,
        "criterion": comparison.criterion,
        "warnings": list(identified.warnings),
        "models": [_trial_as_dict(trial, identified) for trial in comparison.trials],
    }


def _trial_as_dict(trial: Trial, identified: Identified) -> dict[str, Any]:
    result = trial.result
    if result is None:
        message = trial.error.message if trial.error else ""
        return {"name": trial.name, "status": "refused", "message": message, "parameters": []}
    data = identified.table.data
    low, high = result.interval
    factors = [DISPLAY[unit][1] for unit in result.units]
    return {
        "name": result.model,
        "status": result.status,
        "message": result.message,
        "notes": [*trial.candidate.notes, *result.notes],
        "iterations": result.iterations,
        "rms_mm": result.rms_m * 1e3,
        "max_mm": result.max_m * 1e3,
        "leave_one_out_rms_mm": _or_none(result.leave_one_out_rms_m * 1e3),
        "leave_one_target_out_rms_mm": _or_none(trial.target_out_rms_m * 1e3),
        "rms_deg": _or_none(np.rad2deg(result.rms_rad)),
        "leave_one_out_rms_deg": _or_none(np.rad2deg(result.leave_one_out_rms_rad)),
        "not_left_out": result.indispensable,
        "chi2": result.chi2,
        "degrees_of_freedom": result.degrees_of_freedom,
        "noise_scale": _or_none(result.noise_scale),
        "noise": [_noise_as_dict(noise) for noise in result.noise],
        "residuals": [
            {
                "pose": name,
                "target": data.targets[target],
                "mm": 1e3 * far,
                "leave_one_out_mm": _or_none(1e3 * out),
                "weight": float(weight),
            }
            for name, target, far, out, weight in zip(
                data.names,
                data.target,
                result.distances_m,
                result.leave_one_out_m,
                result.weights,
                strict=True,
            )
        ],
        "parameters": [
            {
                "name": name,
                "value": value,
                "unit": unit,
                "sigma": sigma,
                "change": change,
                "low": a * factor,
                "high": b * factor,
            }
            for (name, unit, value, change, sigma), a, b, factor in zip(
                result.displayed(), low, high, factors, strict=True
            )
        ],
        "strong_correlations": [
            {"first": a, "second": b, "value": value} for a, b, value in result.strong_correlations
        ],
        "held_by_prior": result.held_by_prior,
        "singular_values": result.singular_values.tolist(),
        "covariance_si": result.covariance.tolist(),
        "frames": _frames_as_dict(trial, result),
    }


def _noise_as_dict(noise: Any) -> dict[str, Any]:
    return {
        "kind": noise.kind,
        "sigma_si": noise.sigma.tolist(),
        "estimated": noise.estimated,
        "residuals_over_noise": noise.scale,
    }


def _frames_as_dict(trial: Trial, result: IdentificationResult) -> dict[str, Any]:
    """Where tools and targets are: x, y, z [mm] and W, P, R [deg]."""
    blocks = list(trial.candidate.model.parameters)
    return {
        side: {label: _pose(T) for label, T in poses.items()}
        for side, poses in frames_of(blocks, result.values, result.names).items()
    }


def _pose(T: FloatArray) -> list[float]:
    return [*(1e3 * T[:3, 3]), *np.rad2deg(wpr_from_rotation(T[:3, :3]))]


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
