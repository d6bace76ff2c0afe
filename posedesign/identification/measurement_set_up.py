"""The measuring set-up that a table of measurements speaks of, as parameters to be fitted.

What was measured says what there must be: a touched target or a ball bar's foot is a point, what
points and poses are read in is a frame, what a plane contact meets is a plane. Where the cell does
not say where they are, the nominal arm does: any guess is good enough for a fit that places the
set-up first.
"""

from __future__ import annotations

import numpy as np

from calib.model.measurements import Measurements
from calib.model.parameters import (
    Frames,
    ParameterBlock,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoints,
)
from calib.se3 import FloatArray, transform
from posedesign.cell import Cell
from posedesign.files.measurements import TOOL, MeasurementTable

FAR_M, MUCH_FARTHER = 0.1, 10.0
"""Distance of a nominal tool point from the middle of those of its target, and the same over the
median of all of them, beyond which a row is another thing than the others."""

_FRAMES = ("point", "pose", "camera-pose")
_POSES = ("pose", "camera-pose")


def set_up_blocks(cell: Cell, table: MeasurementTable) -> list[ParameterBlock]:
    """Blocks that place the tools and targets of a table, in the order of its labels."""
    data, kinds = table.data, np.array(table.kinds, dtype=object)[table.data.setup.kind]
    points = cell.robot.state(data.postures).point(cell.tool_m)
    blocks: list[ParameterBlock] = []
    for k, label in enumerate(data.tools):
        met = set(kinds[data.setup.tool == k])
        if met & set(_POSES):
            blocks.append(ToolFrame(transform(np.eye(3), cell.tool_m), label))
        else:
            free = _tool_axes(cell, label, met)
            blocks.append(ToolPoints([cell.tool_m], [label], free))
    for k, label in enumerate(data.targets):
        own = data.setup.target == k
        blocks.append(_target(cell, label, set(kinds[own]), points[own]))
    return blocks


def _tool_axes(cell: Cell, label: str, met: set[str]) -> str:
    """Axes along which a tool point can be seen: not along a view line."""
    asked = cell.config.parameters.tool_axes
    if label == TOOL and asked is not None:
        return asked
    return "xy" if met == {"view-line"} else "xyz"


def _target(cell: Cell, label: str, met: set[str], points: FloatArray) -> ParameterBlock:
    if met & set(_FRAMES):
        return TargetFrame(np.eye(4), label)
    if met == {"plane"}:
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][-1]
        return TargetPlane(middle, normal if normal[2] >= 0 else -normal, label)
    known = label == cell.config.target.name
    return TargetPoints([cell.target_m if known else points.mean(axis=0)], [label])


def nominal_distances(cell: Cell, table: MeasurementTable) -> FloatArray:
    """How far the tool point is off with arm and set-up as the cell has them, ``(N,)`` [m].

    Touched targets that the cell does not place stand where the nominal arm sees them on average.
    NaN for what an instrument has read: where that stands the cell does not say.
    """
    data, kinds = table.data, np.array(table.kinds, dtype=object)[table.data.setup.kind]
    points = cell.robot.state(data.postures).point(cell.tool_m)
    out = np.full(data.count, np.nan)
    for k, label in enumerate(data.targets):
        own = (data.setup.target == k) & np.isin(kinds, ("touch-up", "view-line"))
        if own.any():
            known = label == cell.config.target.name
            place = cell.target_m if known else points[own].mean(axis=0)
            out[own] = np.linalg.norm(points[own] - place, axis=1)
    return out


def far_rows(cell: Cell, table: MeasurementTable) -> list[str]:
    """Touch-ups that the nominal arm sees far from all others of their target, with their lines.

    Rows in another unit, or of another target. They can be told before anything is identified, and
    keep the rest from being identified at all.
    """
    data, touched = table.data, table.of_kind("touch-up", "view-line")
    points = cell.robot.state(data.postures).point(cell.tool_m)
    said = []
    for k in range(len(data.targets)):
        own = touched[data.setup.target[touched] == k]
        if not own.size:
            continue
        off = np.linalg.norm(points[own] - np.median(points[own], axis=0), axis=1)
        usual = float(np.median(off))
        said += [
            f"line {table.lines[i]}: the tool point as described is {far * 1e3:.0f} mm from where "
            f"the others of {data.targets[k]} have it, which lie within {usual * 1e3:.0f} mm"
            for i, far in zip(own.tolist(), off.tolist(), strict=True)
            if far > FAR_M and far > MUCH_FARTHER * usual
        ]
    return said


def frames_of(
    blocks: list[ParameterBlock], values: FloatArray, names: tuple[str, ...]
) -> dict[str, dict[str, FloatArray]]:
    """Poses of tools and targets ``(4, 4)`` [m] by label, at identified values of all names."""
    found: dict[str, dict[str, FloatArray]] = {"tools": {}, "targets": {}}
    for block in blocks:
        if isinstance(block, Frames):
            own = np.array([values[names.index(name)] for name in block.names])
            for label, T in zip(block.labels, block.poses(own), strict=True):
                found["tools" if block.tools else "targets"][label] = T
    return found


def seen_once(data: Measurements) -> list[str]:
    """Targets of which there is a single measurement: it says nothing but where they are."""
    count = np.bincount(data.setup.target, minlength=len(data.targets))
    return [label for label, n in zip(data.targets, count, strict=True) if n == 1]
