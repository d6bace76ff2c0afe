"""``identification.json``: what stands in it, how it is read for a cell, and how it is written.

The file is hostile until read: size, JSON, the robot's name, every name and every number.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from calib.errors import FileFormatError, InputError, near_names
from calib.identification import DISPLAY, IdentificationResult, Trial
from calib.model import CalibrationModel
from calib.model.measurements import Measurements
from calib.robots import ExternalAxes, Robot
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.cell import Cell
from posedesign.cell.models import payloads_of
from posedesign.files import plain
from posedesign.files.csv_tables import as_read
from posedesign.files.json_files import Number, ReadFromFile, Text, read_json
from posedesign.files.postures import external_as_dict
from posedesign.identification.comparison import Identified
from posedesign.identification.findings import as_dict
from posedesign.identification.models import frames_of, model_of

MOST_PARAMETERS = 1000
_LONGEST_SHOWN = 60
KINEMATICS = "kinematics_si"

SAME_ARM = 1e-6
"""[m, rad]: descriptions that differ by less are of one arm, written with other digits."""

_SYMMETRIC = 1e-6
"""Of a covariance over the standard deviations: how far it may be off its transpose, and below
zero. Files have every digit."""

_IS_ONE = "is it an identification?"
_WRITTEN = "give the identification.json that posedesign identify has written"


class Residual(ReadFromFile):
    """A measurement as one model leaves it."""

    pose: str
    mm: float
    target: str | None = None
    leave_one_out_mm: float | None = None
    weight: float | None = None
    outlier: bool = False


class Parameter(ReadFromFile):
    """A parameter in the unit that it says."""

    name: Text
    value: Number
    unit: str
    sigma: Annotated[Number, Field(ge=0.0)] | None = None
    change: float | None = None
    low: float | None = None
    high: float | None = None


Deviation = tuple[Annotated[Number, Field(ge=0.0)], Annotated[Number, Field(ge=0.0)]]


class Noise(ReadFromFile):
    """Noise that a kind of measurement was weighed by, and what the residuals say of it."""

    kind: Text
    sigma_si: list[Annotated[Number, Field(gt=0.0)]]
    estimated: bool = False
    doubted: bool = False
    residuals_over_noise: Annotated[Number, Field(gt=0.0)] | None = None
    tails: Annotated[Number, Field(gt=0.0)] = 1.0
    """Standard deviation of all residuals over that of most, where a loss weighs some down."""
    arm_sigma_si: Deviation | None = None


class FittedModel(ReadFromFile):
    """A model; one that was refused has no parameters."""

    name: Text
    message: str = ""
    parameters: Annotated[tuple[Parameter, ...], Field(max_length=MOST_PARAMETERS)] = ()
    residuals: tuple[Residual, ...] = ()
    rms_mm: float | None = None
    leave_one_out_rms_mm: float | None = None
    expected_box_mm: float | None = None
    noise_scale: float | None = None
    noise: tuple[Noise, ...] = ()
    held_by_prior: tuple[str, ...] = ()
    covariance_si: list[list[Number]] | None = None


class Source(ReadFromFile):
    """What was identified from."""

    file: str = ""


class NamedFinding(ReadFromFile):
    """What explains the residuals by name."""

    text: str


class IdentificationFile(ReadFromFile):
    """What is read of an identification.json."""

    robot: Text | None = None
    joints: tuple[str, ...] = ()
    positioner: Annotated[int, Field(ge=0)] = 0
    slides: Annotated[int, Field(ge=0)] = 0
    arm_slides: tuple[Annotated[int, Field(ge=0)], ...] = ()
    arm: dict[str, Any] = Field(default_factory=dict)
    models: list[FittedModel]
    recommended: Text | None = None
    reference: Text | None = None
    reason: str | None = None
    arm_deviation_si: Deviation = (0.0, 0.0)
    """How far the arm stops from where it says, along and about each axis [m, rad]."""
    warnings: tuple[str, ...] = ()
    findings: tuple[NamedFinding, ...] = ()
    data: Source = Source()

    @property
    def external(self) -> ExternalAxes:
        """What the first joints are."""
        return ExternalAxes(self.positioner, self.slides, self.arm_slides)

    @property
    def chosen(self) -> FittedModel | None:
        """The recommended model."""
        return next((model for model in self.models if model.name == self.recommended), None)


def read_file(path: Path) -> IdentificationFile:
    """Read an ``identification.json``."""
    return read_json(path, IdentificationFile, _WRITTEN)


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """One model of an identification, with the calibration model that it is of."""

    name: str
    robot: str
    model: CalibrationModel
    x: FloatArray  # (p,): identified parameters [SI]
    sigma: FloatArray  # (p,): standard deviations [SI]; NaN where the file has none
    covariance: FloatArray | None  # (p, p) [SI]; None where the file has none
    held: tuple[str, ...] = ()
    """Parameters of which the measurements say nothing: what is known beforehand holds them."""
    deviation: tuple[float, float] = (0.0, 0.0)
    """How far the arm stops from where it says, along and about each axis [m, rad]."""


def read_identification(
    path: Path, cell: Cell, name: str | None = None, *, reference: bool = False
) -> IdentifiedModel:
    """Read one model of an ``identification.json``.

    ``cell``: with the robot that was identified. ``name``: of the model; the recommended one by
    default. ``reference``: of the models that the file has, the one that says most of the arm is
    meant by default: its ``reference``, or where it names none the recommended one. Raises
    FileFormatError: the file is no identification, is of another robot, has no such model, or a
    number in it cannot be used.
    """
    content = read_file(path)
    if content.robot is None:
        raise FileFormatError("is no text", path=path, key="robot", hint=_IS_ONE)
    joints = content.joints if "joints" in content.model_fields_set else None
    if content.robot != cell.robot.name or joints not in (None, cell.robot.joint_names):
        raise FileFormatError(
            f"is of the robot {_shown(content.robot)}, the cell has {cell.robot.name}"
            + (" with other joints" if content.robot == cell.robot.name else ""),
            path=path,
            key="robot",
            hint="give the cell that was identified",
        )
    for key, value in _arm_as_dict(cell).items():  # gives the parameters their meaning
        given = content.arm.get(key, value)
        if given != value and not (key == KINEMATICS and _alike(given, value)):
            raise FileFormatError(
                f"was identified with another {key}",
                path=path,
                key=key,
                hint="identify again with the cell as it is now, or give the cell as it was",
            )
    entry = _picked(content, path, name, reference=reference)
    names = [parameter.name for parameter in entry.parameters]
    try:
        model = model_of(cell, names)
    except InputError as error:
        raise FileFormatError(
            f"model {_shown(entry.name)}: {error.message}",
            path=path,
            key="parameters",
            hint=error.hint or "is it the identification of this cell?",
        ) from error
    order = [names.index(n) for n in model.names]
    if len(order) != len(names):
        double = next(n for n in names if names.count(n) > 1)
        raise FileFormatError(f"{_shown(double)} appears twice", path=path, key="parameters.name")
    given = [entry.parameters[k] for k in order]
    for own, unit in zip(given, model.units, strict=True):
        if own.unit != DISPLAY[unit][0]:
            raise FileFormatError(
                f"{_shown(own.name)} is in {_shown(own.unit)}, not in {DISPLAY[unit][0]}",
                path=path,
                key="unit",
            )
    factors = np.array([DISPLAY[unit][1] for unit in model.units])
    sigma = np.array([np.nan if own.sigma is None else own.sigma for own in given])
    covariance = _covariance(entry, path)
    return IdentifiedModel(
        entry.name,
        content.robot,
        model,
        np.array([own.value for own in given]) / factors,
        sigma / factors,
        None if covariance is None else covariance[np.ix_(order, order)],
        entry.held_by_prior,
        content.arm_deviation_si,
    )


def _picked(
    content: IdentificationFile, path: Path, name: str | None, *, reference: bool
) -> FittedModel:
    """The model that is meant."""
    entries = {model.name: model for model in content.models}
    if not entries:
        raise FileFormatError("has no list of models", path=path, key="models", hint=_IS_ONE)
    if name is None and content.recommended is None:
        raise FileFormatError(
            "recommends no model",
            path=path,
            key="recommended",
            hint="name one with `model`: " + ", ".join(map(_shown, entries)),
        )
    recommended = (content.reference if reference else None) or content.recommended or ""
    wanted = recommended if name is None else name
    if wanted not in entries:
        raise FileFormatError(
            f"has no model {_shown(wanted)}",
            path=path,
            key="models",
            hint=near_names(wanted, [n[:_LONGEST_SHOWN] for n in entries]),
        )
    if not entries[wanted].parameters:
        raise FileFormatError(
            f"model {_shown(wanted)} has no parameters",
            path=path,
            key="parameters",
            hint="it was refused, or nothing was identified: choose another one with `model`",
        )
    return entries[wanted]


def _covariance(entry: FittedModel, path: Path) -> FloatArray | None:
    given, count = entry.covariance_si, len(entry.parameters)
    if given is None:
        return None
    if [len(row) for row in given] != [count] * count:
        raise FileFormatError(
            f"is no table of {count} by {count} numbers", path=path, key="covariance_si"
        )
    C = np.array(given)
    sigma = np.sqrt(np.abs(np.diag(C)))
    scaled = C / np.outer(sigma, sigma) if sigma.all() else np.full_like(C, np.nan)
    if not (
        np.isfinite(scaled).all()
        and np.abs(scaled - scaled.T).max() < _SYMMETRIC
        and np.linalg.eigvalsh(scaled).min() > -_SYMMETRIC
    ):
        raise FileFormatError("is no covariance", path=path, key="covariance_si")
    return C


def _shown(text: str) -> str:
    return repr(text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "...")


def _arm_as_dict(cell: Cell) -> dict[str, Any]:
    """What of the cell gives parameters their meaning, besides the robot."""
    return {
        "lost_motion_nm": cell.config.parameters.lost_motion_nm,
        "payloads": [[load.mass_kg, *(1e3 * load.com_m)] for load in payloads_of(cell)],
        "link_masses_kg": cell.robot.link_mass.tolist(),
        KINEMATICS: _kinematics(cell.robot).tolist(),
    }


def _kinematics(robot: Robot) -> FloatArray:
    """All that the arm as described is: its Jacobian and its tip with all joints at zero [SI]."""
    zero = np.zeros(robot.n)
    whole = np.concatenate([robot.jacobian(zero).ravel(), robot.fk(zero)[:3].ravel()])
    return np.round(whole, 9) + 0.0


def _alike(given: object, own: list[float]) -> bool:
    """Whether two arms as described are one, but for how their numbers were written."""
    return (
        isinstance(given, list)
        and len(given) == len(own)
        and all(isinstance(v, int | float) for v in given)
        and bool(np.abs(np.array(given, dtype=float) - own).max() <= SAME_ARM)
    )


def results_as_dict(cell: Cell, identified: Identified) -> dict[str, Any]:
    """The content of ``identification.json``: degrees and millimetres."""
    comparison, data = identified.comparison, identified.table.data
    content = {
        "robot": cell.robot.name,
        "joints": list(cell.robot.joint_names),
        **external_as_dict(cell.robot.external),
        "arm": _arm_as_dict(cell),
        "measurements": data.count,
        "kinds": list(identified.table.kinds),
        "targets": list(data.targets),
        "tools": list(data.tools),
        "weighted": cell.config.measurement.weighted,
        "loss": cell.config.parameters.loss,
        "nominal_rms_mm": 1e3 * identified.nominal_rms_m,
        "recommended": identified.recommended,
        "reason": identified.reason,
        "criterion": comparison.criterion,
        "reference": comparison.reference,
        "workplace": identified.workplace,
        "arm_deviation_si": (0.0, 0.0)
        if identified.judge is None
        else identified.judge.arms.deviation,
        "probabilities": identified.probabilities,
        "not_tried": list(identified.held_only),
        "contradictions": [each.said for each in identified.contradictions],
        "warnings": list(identified.warnings),
        "measured": identified.table.facts,
        "findings": [as_dict(finding, identified.table) for finding in identified.findings],
        "models": [_trial_as_dict(trial, identified) for trial in comparison.trials],
    }
    found: dict[str, Any] = plain(content)
    return found


def _trial_as_dict(trial: Trial, identified: Identified) -> dict[str, Any]:
    result, expected = trial.result, trial.expected
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
        "leave_one_out_rms_mm": 1e3 * result.leave_one_out_rms_m,
        "leave_one_target_out_rms_mm": 1e3 * trial.target_out_rms_m,
        "rms_deg": np.rad2deg(result.rms_rad),
        "leave_one_out_rms_deg": np.rad2deg(result.leave_one_out_rms_rad),
        "expected_box_mm": None if expected is None else 1e3 * expected.rms_m,
        "expected_box_interval_mm": None
        if expected is None
        else [1e3 * expected.low_m, 1e3 * expected.high_m],
        "as_measured_again_mm": None
        if trial.as_measured is None
        else [
            1e3 * length
            for length in (
                trial.as_measured.rms_m,
                trial.as_measured.low_m,
                trial.as_measured.high_m,
            )
        ],
        "not_left_out": result.indispensable,
        "chi2": result.chi2,
        "degrees_of_freedom": result.degrees_of_freedom,
        "noise_scale": result.noise_scale,
        "noise": [
            {
                "kind": noise.kind,
                "sigma_si": noise.sigma,
                "arm_sigma_si": noise.arm_sigma,
                "tails": result.tails,
                "estimated": noise.estimated,
                "doubted": noise.doubted,
                "residuals_over_noise": noise.scale,
            }
            for noise in result.noise
        ],
        "residuals": _residuals_as_dicts(result, identified.table.data),
        "parameters": [
            {
                "name": row.name,
                "value": row.value,
                "unit": row.unit,
                "sigma": row.sigma,
                "change": row.change,
                "low": row.low,
                "high": row.high,
                "prior_sigma": row.prior,
            }
            for row in result.displayed()
        ],
        "strong_correlations": [
            {"first": a, "second": b, "value": value} for a, b, value in result.strong_correlations
        ],
        "held_by_prior": result.held_by_prior,
        "singular_values": result.singular_values,
        "covariance_si": result.covariance,
        "frames": _frames_as_dict(trial, result),
    }


def _residuals_as_dicts(result: IdentificationResult, data: Measurements) -> list[dict[str, Any]]:
    # each of all rows, asked for once
    far, lost = result.distances_m, result.leave_one_out_m
    return [
        {
            "pose": data.names[i],
            "target": data.targets[data.target[i]],
            "mm": 1e3 * far[i],
            "leave_one_out_mm": 1e3 * lost[i],
            "weight": result.weights[i],
            "outlier": result.outliers[i],
            "rows_si": result.residuals[i],
        }
        for i in range(data.count)
    ]


def residual_rows(identified: Identified) -> list[dict[str, object]]:
    """Residuals of the model that is shown, with what is kept beside the measurements.

    ``residual_x_mm ..`` are those of lengths in the axes of what was measured from.
    """
    result, table = identified.best, identified.table
    data, far = table.data, result.distances_m
    return [
        {
            "pose": data.names[i],
            "target": data.targets[data.setup.target[i]],
            "tool": data.tools[data.setup.tool[i]],
            "line": table.lines[i],
            **{column: as_read(cells[i]) for column, cells in table.extra.items()},
            **dict(zip(RESIDUALS, 1e3 * result.residuals[i, :3], strict=False)),
            "residual_mm": 1e3 * far[i],
        }
        for i in range(data.count)
    ]


RESIDUALS = ("residual_x_mm", "residual_y_mm", "residual_z_mm")


def _frames_as_dict(trial: Trial, result: IdentificationResult) -> dict[str, Any]:
    """Where tools and targets are: x, y, z [mm] and W, P, R [deg]."""
    blocks = list(trial.candidate.model.parameters)
    return {
        side: {
            label: [*(1e3 * T[:3, 3]), *np.rad2deg(wpr_from_rotation(T[:3, :3]))]
            for label, T in poses.items()
        }
        for side, poses in frames_of(blocks, result.values, result.names).items()
    }
