"""What touch-ups make of the robot, beside the baseline that leaves it as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.identification import IdentificationResult, identify
from calib.measurement import TouchUps
from calib.parameters import TargetPoints
from posedesign.cell import Cell


def identify_models(cell: Cell, touch_ups: TouchUps) -> tuple[IdentificationResult, ...]:
    """Identify what the cell asks for, and the baseline it has to beat.

    The first result, ``frames only``, places tool point and targets and leaves the robot as it
    is: errors of the set-up are not the robot's, and a "before" that contains them flatters every
    calibration. The second, ``offsets``, frees the zero offsets as well.

    Parameters
    ----------
    cell : Cell
    touch_ups : TouchUps
        Of any targets; their positions need not be known.

    Raises
    ------
    InputError, NotIdentifiableError, ConvergenceError
        As :func:`calib.identification.identify`.
    """
    # a target that the cell does not know is taken to be where the nominal arm sees it: any guess
    # will do, tool and targets are fitted first
    points = cell.robot.state(touch_ups.postures).point(cell.tool_m)
    guesses = [
        cell.target_m
        if label == cell.config.target.name
        else points[touch_ups.target == k].mean(axis=0)
        for k, label in enumerate(touch_ups.labels)
    ]
    targets = TargetPoints(guesses, touch_ups.labels)
    weighted = cell.config.measurement.weighted
    return tuple(
        identify(
            cell.model(offsets, targets=targets),
            touch_ups,
            weighted=weighted,
            method=cell.config.parameters.method,
            name=name,
        )
        for name, offsets in (("frames only", ()), ("offsets", cell.offset_joints))
    )


def results_as_dict(
    cell: Cell, touch_ups: TouchUps, results: Sequence[IdentificationResult]
) -> dict[str, Any]:
    """The content of ``identification.json``: degrees and millimetres."""
    # errors left out over different postures cannot be compared
    best: IdentificationResult | None
    comparable = len({r.indispensable for r in results}) == 1
    best = min(results, key=lambda r: r.leave_one_out_rms_m)
    if not comparable or not np.isfinite(best.leave_one_out_rms_m):
        best = None
    return {
        "robot": cell.robot.name,
        "touch_ups": touch_ups.count,
        "targets": list(touch_ups.labels),
        "weighted": cell.config.measurement.weighted,
        "recommended": best.model if best else None,
        "models": [
            {
                "name": r.model,
                "status": r.status,
                "message": r.message,
                "iterations": r.iterations,
                "rms_mm": r.rms_m * 1e3,
                "max_mm": r.max_m * 1e3,
                "leave_one_out_rms_mm": r.leave_one_out_rms_m * 1e3,
                "not_left_out": r.indispensable,
                "chi2": r.chi2,
                "degrees_of_freedom": r.degrees_of_freedom,
                "noise_scale": r.noise_scale,
                "residuals_mm": [1e3 * far for far in r.distances_m],
                "parameters": [
                    {"name": name, "value": value, "unit": unit, "sigma": sigma, "change": change}
                    for name, unit, value, change, sigma in r.displayed()
                ],
            }
            for r in results
        ],
    }
