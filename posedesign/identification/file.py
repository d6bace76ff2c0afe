"""Reading an ``identification.json``: what was identified, for the robot of a cell.

The file is hostile until read: size, JSON, the robot's name, every name and every number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import FileFormatError, InputError, near_names
from calib.identification import DISPLAY, IdentificationResult, KindNoise, Trial
from calib.model import CalibrationModel
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.files import LARGEST_NUMBER, load_json, read_bytes_bounded, usable
from posedesign.identification.comparison import Identified, why_another
from posedesign.identification.findings import as_dict
from posedesign.identification.measurement_set_up import frames_of
from posedesign.identification.models import arm_as_dict, model_of

LARGEST_JSON_BYTES = 20_000_000
"""Ten models of a hundred parameters and a thousand measurements are three megabytes."""

MOST_PARAMETERS = 1000
_LONGEST_SHOWN = 60
_SYMMETRIC = 1e-6
"""Of a covariance over the standard deviations: how far it may be off its transpose, and below
zero. Files have every digit."""


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """One model of an identification, with the calibration model that it is of.

    Attributes
    ----------
    x : array (p,)
        Identified parameters [SI].
    sigma : array (p,)
        Standard deviations [SI]; NaN where the file has none.
    covariance : array (p, p) or None
        [SI]; None where the file has none.
    held : tuple of str
        Parameters of which the measurements say nothing: what is known beforehand holds them.
    """

    name: str
    robot: str
    model: CalibrationModel
    x: FloatArray
    sigma: FloatArray
    covariance: FloatArray | None
    held: tuple[str, ...] = ()


def read_identification(
    path: Path, cell: Cell, name: str | None = None, *, reference: bool = False
) -> IdentifiedModel:
    """Read one model of an ``identification.json``.

    Parameters
    ----------
    cell : Cell
        With the robot that was identified.
    name : str, optional
        Of the model; the recommended one by default.
    reference : bool
        Of the models that the file has, the one that says most of the arm is meant by default: its
        ``reference``, or where it names none the recommended one.

    Raises
    ------
    FileFormatError
        The file is no identification, is of another robot, has no such model, or a number in it
        cannot be used.
    """
    content = _object(_parsed(path), path, "the file")
    robot = _text(content.get("robot"), path, "robot")
    joints = content.get("joints", list(cell.robot.joint_names))
    if robot != cell.robot.name or joints != list(cell.robot.joint_names):
        raise FileFormatError(
            f"is of the robot {_shown(robot)}, the cell has {cell.robot.name}"
            + (" with other joints" if robot == cell.robot.name else ""),
            path=path,
            key="robot",
            hint="give the cell that was identified",
        )
    _check_arm(content, path, cell)
    picked, entry = _picked(content, path, name, reference=reference)
    names, values, units, sigma = _parameters(entry, path, picked)
    try:
        model = model_of(cell, names)
    except InputError as error:
        raise FileFormatError(
            f"model {_shown(picked)}: {error.message}",
            path=path,
            key="parameters",
            hint=error.hint or "is it the identification of this cell?",
        ) from error
    order = [names.index(n) for n in model.names]
    factors = np.ones(model.p)
    for k, (own, unit) in enumerate(zip(model.names, model.units, strict=True)):
        label, factors[k] = DISPLAY[unit]
        if units[order[k]] != label:
            raise FileFormatError(
                f"{_shown(own)} is in {_shown(units[order[k]])}, not in {label}",
                path=path,
                key="unit",
            )
    covariance = _covariance(entry, path, len(names))
    if covariance is not None:
        covariance = covariance[np.ix_(order, order)]
    return IdentifiedModel(
        picked,
        robot,
        model,
        values[order] / factors,
        sigma[order] / factors,
        covariance,
        _held(entry, path),
    )


def _check_arm(content: dict[str, Any], path: Path, cell: Cell) -> None:
    """Refuse a cell that has changed in what gives the parameters their meaning."""
    written, own = content.get("arm"), arm_as_dict(cell)
    if not isinstance(written, dict):
        return
    for key, value in own.items():
        if key in written and written[key] != value:
            raise FileFormatError(
                f"was identified with another {key}",
                path=path,
                key=key,
                hint="identify again with the cell as it is now, or give the cell as it was",
            )


def _parsed(path: Path) -> Any:
    data = read_bytes_bounded(path, most_bytes=LARGEST_JSON_BYTES)
    try:
        return load_json(data)
    except UnicodeDecodeError as error:
        raise FileFormatError(
            "is not UTF-8 text", path=path, hint="is it the right file?"
        ) from error
    except ValueError as error:
        raise FileFormatError(
            f"is no valid JSON: {str(error).splitlines()[0][:100]}",
            path=path,
            hint="give the identification.json that posedesign identify has written",
        ) from error


def _picked(
    content: dict[str, Any], path: Path, name: str | None, *, reference: bool
) -> tuple[str, dict[str, Any]]:
    """Name and entry of the model that is meant."""
    listed = content.get("models")
    if not isinstance(listed, list) or not listed:
        raise FileFormatError(
            "has no list of models", path=path, key="models", hint="is it an identification?"
        )
    entries: dict[str, dict[str, Any]] = {}
    for entry in listed:
        own = _object(entry, path, "a model")
        entries[_text(own.get("name"), path, "models.name")] = own
    wanted = name
    if wanted is None:
        recommended = content.get("recommended")
        if recommended is None:
            raise FileFormatError(
                "recommends no model",
                path=path,
                key="recommended",
                hint="name one with --model: " + ", ".join(map(_shown, entries)),
            )
        wanted = _text(recommended, path, "recommended")
        if reference and content.get("reference") is not None:
            wanted = _text(content["reference"], path, "reference")
    if wanted not in entries:
        raise FileFormatError(
            f"has no model {_shown(wanted)}",
            path=path,
            key="models",
            hint=near_names(wanted, [n[:_LONGEST_SHOWN] for n in entries]),
        )
    return wanted, entries[wanted]


def _parameters(
    entry: dict[str, Any], path: Path, model: str
) -> tuple[list[str], FloatArray, list[str], FloatArray]:
    """Names, values, units and standard deviations, as they stand in the file."""
    listed = entry.get("parameters")
    if not isinstance(listed, list) or len(listed) > MOST_PARAMETERS:
        raise FileFormatError(
            f"model {_shown(model)} has no list of at most {MOST_PARAMETERS} parameters",
            path=path,
            key="parameters",
        )
    if not listed:
        raise FileFormatError(
            f"model {_shown(model)} has no parameters",
            path=path,
            key="parameters",
            hint="it was refused, or nothing was identified: choose another one with --model",
        )
    names, units = [], []
    values, sigma = np.empty(len(listed)), np.full(len(listed), np.nan)
    for k, item in enumerate(listed):
        own = _object(item, path, "a parameter")
        names.append(_text(own.get("name"), path, "parameters.name"))
        units.append(_text(own.get("unit"), path, "parameters.unit"))
        values[k] = _number(own.get("value"), path, names[k], "value")
        if own.get("sigma") is not None:
            sigma[k] = _number(own["sigma"], path, names[k], "sigma")
            if sigma[k] < 0:
                raise FileFormatError(
                    f"the sigma of {_shown(names[k])} is below zero", path=path, key="sigma"
                )
    double = next((n for n in names if names.count(n) > 1), None)
    if double is not None:
        raise FileFormatError(f"{_shown(double)} appears twice", path=path, key="parameters.name")
    return names, values, units, sigma


def _held(entry: dict[str, Any], path: Path) -> tuple[str, ...]:
    listed = entry.get("held_by_prior", [])
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise FileFormatError("is no list of names", path=path, key="held_by_prior")
    return tuple(listed)


def _covariance(entry: dict[str, Any], path: Path, count: int) -> FloatArray | None:
    given = entry.get("covariance_si")
    if given is None:
        return None
    rows = given if isinstance(given, list) and len(given) == count else []
    if not rows or not all(isinstance(row, list) and len(row) == count for row in rows):
        raise FileFormatError(
            f"is no table of {count} by {count} numbers", path=path, key="covariance_si"
        )
    C = np.array([[_number(v, path, "an element", "covariance_si") for v in row] for row in rows])
    sigma = np.sqrt(np.abs(np.diag(C)))
    scaled = C / np.outer(sigma, sigma) if sigma.all() else np.full_like(C, np.nan)
    if not (
        np.isfinite(scaled).all()
        and np.abs(scaled - scaled.T).max() < _SYMMETRIC
        and np.linalg.eigvalsh(scaled).min() > -_SYMMETRIC
    ):
        raise FileFormatError("is no covariance", path=path, key="covariance_si")
    return C


def _object(value: Any, path: Path, what: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise FileFormatError(
            f"{what} is no table of keys",
            path=path,
            hint="give the identification.json that posedesign identify has written",
        )
    return value


def _text(value: Any, path: Path, key: str) -> str:
    if not isinstance(value, str) or not value:
        raise FileFormatError("is no text", path=path, key=key, hint="is it an identification?")
    return value


def _number(value: Any, path: Path, name: str, key: str) -> float:
    number = usable(value)
    if math.isnan(number):
        raise FileFormatError(
            f"the {key} of {_shown(name)} is not a finite number within {LARGEST_NUMBER:g}",
            path=path,
            key=key,
            hint="a model that was refused, or did not converge, cannot be used",
        )
    return number


def _shown(text: str) -> str:
    return repr(text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "...")


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
