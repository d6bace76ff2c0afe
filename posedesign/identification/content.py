"""The content of ``identification.json``: everything that was found, in degrees and millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.identification import DISPLAY, IdentificationResult, KindNoise, Trial
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.identification.comparison import Identified, why_another
from posedesign.identification.findings import as_dict
from posedesign.identification.measurement_set_up import frames_of
from posedesign.identification.models import arm_as_dict


def results_as_dict(cell: Cell, identified: Identified) -> dict[str, Any]:
    """The content of ``identification.json``: degrees and millimetres."""
    comparison, data = identified.comparison, identified.table.data
    return {
        "robot": cell.robot.name,
        "joints": list(cell.robot.joint_names),
        "arm": arm_as_dict(cell),
        "measurements": data.count,
        "kinds": list(identified.table.kinds),
        "targets": list(data.targets),
        "tools": list(data.tools),
        "weighted": cell.config.measurement.weighted,
        "loss": cell.config.parameters.loss,
        "nominal_rms_mm": _or_none(identified.nominal_rms_m * 1e3),
        "recommended": comparison.recommended if identified.is_of_this_robot else None,
        "reason": comparison.reason if identified.is_of_this_robot else why_another(identified),
        "criterion": comparison.criterion,
        "reference": comparison.reference,
        "workplace": identified.workplace,
        "probabilities": identified.probabilities,
        "not_tried": list(identified.held_only),
        "contradictions": [each.said for each in identified.contradictions],
        "warnings": list(identified.warnings),
        "findings": [as_dict(finding, identified.table) for finding in identified.findings],
        "models": [_trial_as_dict(trial, identified) for trial in comparison.trials],
    }


def _trial_as_dict(trial: Trial, identified: Identified) -> dict[str, Any]:
    result = trial.result
    if result is None:
        message = trial.error.message if trial.error else ""
        return {"name": trial.name, "status": "refused", "message": message, "parameters": []}
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
        "expected_box_mm": None if trial.expected is None else 1e3 * trial.expected.rms_m,
        "expected_box_interval_mm": None
        if trial.expected is None
        else [1e3 * trial.expected.low_m, 1e3 * trial.expected.high_m],
        "not_left_out": result.indispensable,
        "chi2": result.chi2,
        "degrees_of_freedom": result.degrees_of_freedom,
        "noise_scale": _or_none(result.noise_scale),
        "noise": [_noise_as_dict(noise) for noise in result.noise],
        "residuals": _residuals_as_dicts(result, identified),
        "parameters": _parameters_as_dicts(result),
        "strong_correlations": [
            {"first": a, "second": b, "value": value} for a, b, value in result.strong_correlations
        ],
        "held_by_prior": result.held_by_prior,
        "singular_values": result.singular_values.tolist(),
        "covariance_si": result.covariance.tolist(),
        "frames": _frames_as_dict(trial, result),
    }


def _residuals_as_dicts(
    result: IdentificationResult, identified: Identified
) -> list[dict[str, Any]]:
    data = identified.table.data
    # each of all rows, asked for once
    far, lost = result.distances_m, result.leave_one_out_m
    return [
        {
            "pose": data.names[i],
            "target": data.targets[data.target[i]],
            "mm": 1e3 * far[i],
            "leave_one_out_mm": _or_none(1e3 * lost[i]),
            "weight": float(result.weights[i]),
            "outlier": bool(result.outliers[i]),
            "rows_si": result.residuals[i].tolist(),
        }
        for i in range(data.count)
    ]


def _parameters_as_dicts(result: IdentificationResult) -> list[dict[str, Any]]:
    low, high = result.interval
    found = []
    for k, (name, unit, value, change, sigma) in enumerate(result.displayed()):
        factor = DISPLAY[result.units[k]][1]
        found.append(
            {
                "name": name,
                "value": value,
                "unit": unit,
                "sigma": sigma,
                "change": change,
                "low": low[k] * factor,
                "high": high[k] * factor,
                "prior_sigma": _or_none(result.prior[k] * factor),
            }
        )
    return found


def _noise_as_dict(noise: KindNoise) -> dict[str, Any]:
    return {
        "kind": noise.kind,
        "sigma_si": noise.sigma.tolist(),
        "estimated": noise.estimated,
        "doubted": noise.doubted,
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
