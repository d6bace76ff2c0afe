"""How an identification is printed: before and after, the model to take, what to know of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posedesign.cli.output import note, print_table

if TYPE_CHECKING:
    from calib.identification import IdentificationResult
    from calib.identification.comparison import Trial
    from posedesign.before_after import Identified

_MOST_PAIRS = 5


def print_identification(identified: Identified) -> None:
    """Print all models side by side, then the one to take."""
    comparison = identified.comparison
    before = {"model": "nominal", "parameters": 0, "rms": identified.nominal_rms_m * 1e3}
    rows = [_row(trial) for trial in comparison.trials]
    first = {**dict.fromkeys(rows[0]), **before}
    shown = [first, *rows] if math.isfinite(identified.nominal_rms_m) else rows
    empty = [key for key in rows[0] if all(_is_empty(row.get(key)) for row in shown)]
    table = [{key: row.get(key) for key in rows[0] if key not in empty} for row in shown]
    print_table("Before and after [mm]", table)
    for trial in comparison.trials:
        if trial.error is not None:
            note(f"{trial.name} left out: {trial.error.message}")
    if not identified.is_of_this_robot:
        note(f"warning: {comparison.results[-1].message}")
        return
    if comparison.recommended:
        print(f"recommended: {comparison.recommended}; {comparison.reason}")
    else:
        print(comparison.reason)
    print_parameters(comparison.best)
    for trial in comparison.trials:
        if trial.result is comparison.best:
            _print_merged(trial)


def _row(trial: Trial) -> dict[str, object]:
    result = trial.result
    row: dict[str, object] = dict.fromkeys(
        (
            "model",
            "parameters",
            "rms",
            "max",
            "leave-one-out rms",
            "leave-one-target-out rms",
            "rms deg",
            "leave-one-out rms deg",
            "residual / noise",
        )
    )
    row["model"] = trial.name
    row["parameters"] = trial.candidate.model.p
    if result is not None:
        row |= {
            "rms": result.rms_m * 1e3,
            "max": result.max_m * 1e3,
            "leave-one-out rms": result.leave_one_out_rms_m * 1e3,
            "leave-one-target-out rms": trial.target_out_rms_m * 1e3,
            "rms deg": math.degrees(result.rms_rad),
            "leave-one-out rms deg": math.degrees(result.leave_one_out_rms_rad),
            "residual / noise": result.noise_scale,
        }
    return row


def _is_empty(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def print_parameters(result: IdentificationResult) -> None:
    """Print parameters with their uncertainty, and what has to be known of the fit."""
    from calib.identification.result import DISPLAY

    low, high = result.interval
    factors = [DISPLAY[unit][1] for unit in result.units]
    print_table(
        f"Identified: {result.model}",
        [
            {
                "parameter": name,
                "value": value,
                "change": change,
                "sigma": sigma,
                "95 % from": a * factor,
                "to": b * factor,
                "unit": unit,
            }
            for (name, unit, value, change, sigma), a, b, factor in zip(
                result.displayed(), low, high, factors, strict=True
            )
        ],
    )
    distances = result.distances_m
    worst = sorted(range(len(distances)), key=lambda i: -distances[i])[:3]
    where = ", ".join(f"{result.poses[i]} {distances[i] * 1e3:.3f} mm" for i in worst)
    print(f"largest residuals: {where}")
    for noise in result.noise:
        if noise.estimated:
            lengths = ", ".join(f"{s * 1e3:.3g}" for s in noise.sigma)
            print(f"noise of {noise.kind}, from the residuals: {lengths} mm or mrad")
    pairs = result.strong_correlations
    if pairs:
        listed = "; ".join(f"{a} with {b} {value:+.3f}" for a, b, value in pairs[:_MOST_PAIRS])
        more = f" and {len(pairs) - _MOST_PAIRS} more" if len(pairs) > _MOST_PAIRS else ""
        print(f"correlated beyond 0.9: {listed}{more}")
    if result.held_by_prior:
        print(f"held by their priors alone: {', '.join(result.held_by_prior)}")
    print(result.message)
    for text in result.notes:
        note(f"note: {text}")


def _print_merged(trial: Trial) -> None:
    if trial.candidate.notes:
        notes = trial.candidate.notes
        print(f"{len(notes)} parameters are not told apart by these measurements:")
        for text in notes[:_MOST_PAIRS]:
            print(f"  {text}")
        if len(notes) > _MOST_PAIRS:
            print(f"  and {len(notes) - _MOST_PAIRS} more, see identification.json")
