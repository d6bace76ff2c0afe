"""Run the study: ``posedesign study run irb120_measuring_arm``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import CalibrationModel, IdentificationResult, identify
from calib.model import Setup
from calib.model.measurements import Measurements, Point
from calib.model.parameters import Frames, TargetFrame, ToolBody, ToolPoints, ZeroOffsets
from calib.se3 import FloatArray, apply, inverse, transform
from posedesign.cell import Cell
from posedesign.files import make_folder
from posedesign.files.csv_tables import write_table
from posedesign.files.measurements import read_measurements
from posedesign.identification import Identified, identify_models
from posedesign.study import Advance, Options
from studies import drawing, writing
from studies.real_data import data_with, folder_for_recordings, refitted

SETTINGS = writing.settings_of(__file__)
POINTS: list[str] = SETTINGS["points"]
ARM = "arm"
RECORDINGS = "identification/abb_irb120"

CELL = """# The cell of the IRB 120, as far as an identification needs one.
[robot]
urdf = {urdf}
tip = {tip}
[tool]
point_mm = [0.0, 0.0, 0.0] # the points measured are found by every fit
[base_pose]
posture_deg = [0.0, 0.0, 0.0, 0.0, 30.0, 0.0]
[parameters]
models = {models}
"""


@dataclass(frozen=True)
class Recorded:
    """What was measured, in the frame of the measuring arm.

    Postures (36, 6) [rad]; points (36, 3, 3) and at the zero posture (3, 3) [m]; check points
    (37, K, 3) [m], the zero posture last; the base of the robot as measured by itself (4, 4).
    """

    q: FloatArray
    points: FloatArray
    zero: FloatArray
    check: FloatArray
    T_base_arm: FloatArray

    @property
    def q_with_zero(self) -> FloatArray:
        return np.vstack([self.q, np.zeros(self.q.shape[1])])


def load(data: Path) -> Recorded:
    folder = data / RECORDINGS
    q = np.deg2rad(np.loadtxt(folder / "CaliJointAngles.csv", delimiter=","))
    points = np.loadtxt(folder / "CaliPosition.csv", delimiter=",").reshape(len(q), -1, 3) / 1e3
    rows = np.loadtxt(folder / "CaliFullPose.csv", delimiter=",").reshape(len(q) + 1, -1, 6)
    meta = (folder / "META.yaml").read_text(encoding="utf-8")
    check = rows[:, np.array(SETTINGS["check_rows"]) - 1, :3] / 1e3
    zero = np.array(_given(meta, "calibration_points_at_zero_config_meas_frame_mm")) / 1e3
    circle = np.loadtxt(folder / "BaseCirclePoints.csv", delimiter=",") / 1e3
    return Recorded(q, points, zero, check, _measured_base(meta, circle))


def _given(meta: str, name: str) -> Any:
    """A list of numbers by its name."""
    found = re.search(name + r":\s*(\[[-\d.,\s\[\]]*\])", meta)
    if found is None:
        raise ValueError(f"META.yaml lacks {name}")
    return json.loads(found[1])


def _measured_base(meta: str, circle: FloatArray) -> FloatArray:
    """T_base_arm as the data's own protocol has it: axes and a plane, and the circle of axis 1."""
    z, x = (np.array(_given(meta, name)) for name in ("BaseDirZ", "BaseDirX"))
    z = z / np.linalg.norm(z)
    y = np.cross(z, x)
    y = y / np.linalg.norm(y)
    R = np.column_stack([np.cross(y, z), y, z])
    flat = np.linalg.svd(circle - circle.mean(axis=0))[2][:2]
    within = (circle - circle.mean(axis=0)) @ flat.T
    # |u|² = 2 u·c + const for every point u of a circle about c
    A = np.column_stack([2.0 * within, np.ones(len(within))])
    centre = np.linalg.lstsq(A, np.sum(within**2, axis=1), rcond=None)[0][:2]
    C = circle.mean(axis=0) + centre @ flat
    origin = C + z * (z @ (np.array(_given(meta, "BasePZ_mm")) / 1e3 - C))
    return inverse(transform(R, origin))


def write_tables(data: Path, out: Path) -> tuple[Path, Path]:
    """Write ``cell.toml`` and ``measurements.csv``: what ``posedesign identify`` takes."""
    recorded = load(data)
    joints = [f"j{k + 1}_deg" for k in range(recorded.q.shape[1])]
    rows: list[dict[str, object]] = []
    for i, (q, points) in enumerate(zip(recorded.q, recorded.points, strict=True)):
        for label, place in zip(POINTS, points, strict=True):
            row: dict[str, object] = {"pose": f"C{i + 1:02d}", "kind": "point", "target": ARM}
            row |= {"tool": label} | dict(zip(joints, np.rad2deg(q), strict=True))
            rows.append(row | dict(zip(("x_mm", "y_mm", "z_mm"), 1e3 * place, strict=True)))
    make_folder(out)
    text = CELL.format(
        urdf=json.dumps(str((data / SETTINGS["urdf"]).resolve())),
        tip=json.dumps(SETTINGS["tip"]),
        models=json.dumps(SETTINGS["models"]),
    )
    (out / "cell.toml").write_text(text, encoding="utf-8")
    return out / "cell.toml", write_table(out / "measurements.csv", list(rows[0]), rows)


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
    return refitted(model, data, result, (data.pose != np.arange(count)[:, None]).astype(float))


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


HERE = Path(__file__).parent

TOLERANCE_MM = 0.002
"""Of the figures on another machine: fits end within a thousandth of what they are worth."""

TABLE, FIGURE = "irb120_measuring_arm.csv", "irb120_measuring_arm"
DIGITS = 6
"""Significant digits in the table."""

SHOWN = ("rms_mm", "max_mm", "leave_one_out_mm", "check_mm", "check_from_zero_mm")


def study(options: Options) -> dict[str, Any]:
    """What does a calibration of a small arm gain, and against what?

    The recordings are what they are and nothing is drawn at random: a number of trials is ignored.
    Beside the results stand ``cell.toml`` and ``measurements.csv``, which ``posedesign identify``
    takes, unless the results go to the study's own folder.
    """
    data = data_with(RECORDINGS)
    with folder_for_recordings(options.out, HERE) as tables:
        found = run(data, tables, options.advance)
    writing.write_rows(options.out, TABLE, found["models"], DIGITS)
    writing.write_figures(options.out, found)
    return found


def plot(folder: Path) -> list[Path]:
    """Leave-one-out and check points of each model."""
    rows = writing.read_rows(folder, TABLE)
    best = min(rows, key=lambda row: row["leave_one_out_mm"])
    before = next(row for row in rows if row["model"] == "frames only")
    figure = drawing.figure_of_marks(
        [f"{row['model']} ({row['parameters']:g})" for row in rows],
        {
            "the three points measured": [row["leave_one_out_mm"] for row in rows],
            "check points on the tool": [row["check_mm"] for row in rows],
        },
        [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0],
        "rms distance in configurations that took no part in the fit",
        f"Configurations left out are predicted to {best['leave_one_out_mm']:.3f} mm by "
        f"{best['model']}, to {before['leave_one_out_mm']:.2f} mm by {before['model']}",
    )
    return writing.save(figure, folder, FIGURE)


def run(data: Path, tables: Path, advance: Advance = lambda what, part: None) -> dict[str, Any]:
    """All figures of the study; the tables are written to a folder, and read from there."""
    advance("models of posedesign identify", 0.0)
    recorded = load(data)
    cell_file, measured = write_tables(data, tables)
    cell = Cell.load(cell_file)
    identified = identify_models(cell, read_measurements(measured, cell.robot.n))
    comparison = identified.comparison
    tried = other_models(identified, recorded)
    tried |= {t.name: (t.candidate.model, identified.table.data) for t in comparison.trials}
    found = {}
    for done, (name, of) in enumerate(tried.items()):
        advance(name, (1.0 + done) / (1.0 + len(tried)))  # the first part is the comparison
        found[name] = row_of(name, *of, recorded)
    gain = found[GEOMETRY][1] - found[WITH_COMPLIANCE][1]
    values, names = comparison.best.values, comparison.best.names
    places = np.array([[values[names.index(f"tool.{p}.{a}")] for a in "xyz"] for p in POINTS])
    at_zero = tried["nothing fitted"][0].parameters[0]
    return {
        "tolerance_mm": TOLERANCE_MM,
        "recommended": comparison.recommended,
        "reason": comparison.reason,
        "check_gain_mm2": float(gain.mean()),
        "check_gain_chance_mm2": float(gain.std(ddof=1) / np.sqrt(len(gain))),
        "points_off_mm": rms_mm(np.linalg.norm(places - at_zero.positions_m, axis=1)),
        "compliance_urad_per_nm": {
            name.rpartition(".")[2]: float(1e6 * value)
            for name, value in zip(names, values, strict=True)
            if name.startswith("compliance")
        },
        "models": sorted((row for row, _ in found.values()), key=lambda r: -r["leave_one_out_mm"]),
    }


def markdown(found: Mapping[str, Any]) -> str:
    """The table of the README."""
    heads = ["model", "p", "rms [mm]", "max", "leave-one-out", "check points"]
    figures = [_three_digits(name) for name in SHOWN]
    cells = ["{model}", "{parameters}", *figures]
    return writing.table(found["models"], cells, [*heads, "from the zero posture"])


def _three_digits(name: str) -> writing.Cell:
    return lambda row: f"{row[name]:.{3 if row['rms_mm'] < 1.0 else 2}f}"
