"""Models that hold something as measured once, and the figures of every model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from arm_recordings import ARM, POINTS, SETTINGS, Recorded

from calib import CalibrationModel, IdentificationResult, identify
from calib.identification.least_squares import minimise
from calib.model.measurements import Measurements, Point, Setup
from calib.model.parameters import TargetFrame, ToolBody, ToolPoints, ZeroOffsets
from calib.model.parameters.frames import Frames
from calib.se3 import FloatArray, apply, inverse, transform
from posedesign.identification.comparison import Identified

GEOMETRY, WITH_COMPLIANCE = "geometry", "geometry + compliance"


def other_models(
    identified: Identified, recorded: Recorded
) -> dict[str, tuple[CalibrationModel, Measurements]]:
    """Models in which something is held as measured at the zero posture, each with its data."""
    data = identified.table.data
    geometry = next(t for t in identified.comparison.trials if t.name == GEOMETRY).candidate.model
    robot = geometry.robot
    at_zero = apply(inverse(robot.fk(np.zeros(robot.n))) @ recorded.T_base_arm, recorded.zero)
    held = [ToolPoints(at_zero, POINTS, free=""), TargetFrame(recorded.T_base_arm, ARM, free=())]
    offsets = ZeroOffsets(robot, robot.joint_names)
    middle = at_zero.mean(axis=0)
    body = ToolBody(at_zero - middle, POINTS, transform(np.eye(3), middle))
    pinned = Point(SETTINGS["zero_sigma_mm"] / 1e3)

    def model(*blocks: Any) -> CalibrationModel:
        return CalibrationModel(robot, blocks, Point(None))

    return {
        "nothing fitted": (model(*held), data),
        "base, points held": (model(held[0], TargetFrame(recorded.T_base_arm, ARM)), data),
        "offsets, base and points held": (model(offsets, *held), data),
        "geometry, points pinned": (
            geometry.with_measurements([Point(None), pinned]),
            _with_zero(data, recorded),
        ),
        "geometry, shape of the points held": (
            model(*(block for block in geometry.parameters if not block.tools), body),
            data,
        ),
    }


def _with_zero(data: Measurements, recorded: Recorded) -> Measurements:
    """The zero posture as a 37th configuration, of the second kind: nearly without noise."""
    setup = Setup.of(
        data.count + len(POINTS),
        kind=np.append(data.setup.kind, np.ones(len(POINTS), dtype=int)),
        tool=np.append(data.setup.tool, np.arange(len(POINTS))),
    )
    q = np.vstack([data.postures, np.zeros((len(POINTS), data.postures.shape[1]))])
    read = np.vstack([data.observed, recorded.zero])
    names = (*data.names, *("zero" for _ in POINTS))
    return replace(data, postures=q, setup=setup, observed=read, names=names)


def without_each(
    model: CalibrationModel, data: Measurements, result: IdentificationResult | None, count: int
) -> FloatArray:
    """Parameters ``(count, p)`` from refits without each of the first so many configurations."""
    if result is None:
        return np.zeros((count, 0))
    kinds = [
        kind.with_noise(noise.sigma / kind.sigma)
        for kind, noise in zip(model.measurements, result.noise, strict=True)
    ]
    weights = (data.pose != np.arange(count)[:, None]).astype(float)
    start = np.tile(result.values, (count, 1))
    noisy = model.with_measurements(kinds)
    fit = minimise(noisy, data.repeated(count), start, weights=weights)
    if not fit.converged.all():
        raise RuntimeError("a fit without one configuration has not converged")
    return fit.x


def off_at_check_points(
    model: CalibrationModel, x: FloatArray, recorded: Recorded
) -> tuple[FloatArray, FloatArray]:
    """How far check points are off ``(36, K)`` [m] in configurations that took no part in a fit.

    Their places on the tip are taken from the zero posture alone, or from all configurations but
    the one predicted.
    """
    count = len(recorded.q)
    frame = next(b for b in model.parameters if isinstance(b, Frames) and b.targets)
    part = model.slices[model.parameters.index(frame)]
    T_base_arm = np.stack([frame.poses(values[part])[0] for values in x])
    T_base_tip = model.view(recorded.q_with_zero, x).T_base_tip
    T_arm_tip = inverse(T_base_arm)[:, None] @ T_base_tip  # (36, 37, 4, 4)
    on_tip = apply(inverse(T_arm_tip)[:, :, None], recorded.check[None])
    left = np.arange(count)
    others = np.stack([np.delete(on_tip[i, :count], i, axis=0).mean(axis=0) for i in left])
    zero, rest = (
        np.linalg.norm(apply(T_arm_tip[left, left][:, None], p) - recorded.check[:count], axis=-1)
        for p in (on_tip[:, count], others)
    )
    return zero, rest


def row_of(
    name: str, model: CalibrationModel, data: Measurements, recorded: Recorded
) -> tuple[dict[str, Any], FloatArray]:
    """The figures of a model [mm], and its squares at the check points of each posture [mm²]."""
    count = len(recorded.q)
    rows = count * len(POINTS)
    result = identify(model, data, name=name) if model.p else None
    x = without_each(model, data, result, count)
    whole = np.zeros(0) if result is None else result.values
    fitted = model.linearise(data.postures, whole, data.setup, data.observed).rows[:rows]
    seen = model.linearise(data.postures, x, data.setup, data.observed).rows
    refitted = np.stack([seen[i, np.flatnonzero(data.pose == i)] for i in range(count)])
    zero, others = off_at_check_points(model, x, recorded)
    out = fitted if result is None else result.leave_one_out[:rows]
    figures = {
        "model": name,
        "parameters": model.p,
        "rms_mm": rms_mm(np.linalg.norm(fitted, axis=-1)),
        "max_mm": float(1e3 * np.linalg.norm(fitted, axis=-1).max()),
        "leave_one_out_mm": rms_mm(np.linalg.norm(out, axis=-1)),
        "refitted_mm": rms_mm(np.linalg.norm(refitted, axis=-1)),
        "check_mm": rms_mm(others),
        "check_from_zero_mm": rms_mm(zero),
    }
    return figures, 1e6 * np.mean(others**2, axis=1)


def rms_mm(far: FloatArray) -> float:
    return float(1e3 * np.sqrt(np.mean(far**2)))
