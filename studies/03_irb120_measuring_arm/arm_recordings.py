"""What the measuring arm recorded, and as tables for ``posedesign identify``."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.se3 import FloatArray, inverse, transform
from posedesign.files import make_folder
from posedesign.files.csv_tables import write_table

SETTINGS: dict[str, Any] = tomllib.loads(
    (Path(__file__).parent / "study.toml").read_text(encoding="utf-8")
)
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
