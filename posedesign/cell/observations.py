"""What is measured at a posture: how, of which points of the tool, from where, with what load.

A cell has one observation where a pin touches a target, and more where there are several targets,
pins or payloads: each pose of a plan is of one of them. An instrument reads all marks of the tool
that it sees at once: they are one observation of several tools.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import InputError, near_names
from calib.geometry import Scene
from calib.model import CalibrationModel, Setup
from calib.model.measurements import KINDS
from calib.se3 import FloatArray, IntArray, rotation_from_wpr, transform
from posedesign.cell.data import CellData
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import TargetSection
from posedesign.constraints.checker import Situation
from posedesign.constraints.mark_sight import Mark, MarkSight
from posedesign.files.measurements import OWN_PAYLOAD, TOOL

POSES = ("pose", "camera-pose")
"""Kinds that turn with the tool: it is a frame."""
_FARTHEST_MM = 50_000.0
"""Range of an instrument that the cell says nothing of: that of laser trackers."""


@dataclass(frozen=True)
class Observation:
    """What is measured at a posture."""

    kind: str  # of :data:`~calib.model.measurements.KINDS`
    tools: tuple[str, ...]  # labels of the points of the tool that are measured, all at once
    target: str  # label of what they are measured from
    payload: str = OWN_PAYLOAD  # name of what the flange carries besides; empty for the tool alone

    @property
    def reads(self) -> bool:
        """Whether something is read; otherwise the arm is moved until tool and target meet."""
        return KINDS[self.kind].reads

    @property
    def labels(self) -> dict[str, str]:
        """What tells it from others, by the columns of a list of poses."""
        tool = self.tools[0] if len(self.tools) == 1 else ""
        return {"target": self.target, "tool": tool, "payload": self.payload}

    def __str__(self) -> str:
        said = self.target
        if self.tools != (TOOL,):
            said += f" by {', '.join(self.tools)}"
        return said + f" with {self.payload}" * bool(self.payload)


def observations_of(config: CellConfig) -> tuple[Observation, ...]:
    """All that a pose of a cell can be of: targets by tools, if they touch, by payloads."""
    marks = tuple(mark.name for mark in config.tool.mark) or (TOOL,)
    found = []
    for payload in (OWN_PAYLOAD, *config.measurement.payloads):
        for target in config.targets:
            kind = kind_of(config, target)
            together = [marks] if kind == "point" else [(mark,) for mark in marks]
            if kind in POSES:
                together = [(TOOL,)]
            found += [Observation(kind, tools, target.name, payload) for tools in together]
    return tuple(found)


def kind_of(config: CellConfig, target: TargetSection) -> str:
    """How a target is measured."""
    return target.kind or config.measurement.kind


def touched_by_tool(config: CellConfig) -> bool:
    """Whether the tool point is at the target at the base pose: it touches it, or a camera looks.

    Otherwise the target is an instrument, and the pose is only the middle of those to come.
    """
    kind = kind_of(config, config.target)
    return kind == "board" or kind.startswith("camera") or not KINDS[kind].reads


def mark_named(cell: CellData, label: str) -> Mark:
    """A mark of the tool, or the tool point."""
    for mark in cell.config.tool.mark:
        if mark.name == label:
            axis = None if mark.axis is None else np.array(mark.axis) / np.linalg.norm(mark.axis)
            largest = np.pi if axis is None else float(np.deg2rad(mark.largest_angle_deg))
            return Mark(label, np.array(mark.point_mm) / 1e3, axis, largest)
    return Mark("the tool point", cell.tool_m)


def target_named(config: CellConfig, label: str) -> TargetSection | None:
    """A target of a cell; None where the cell does not know it."""
    return next((target for target in config.targets if target.name == label), None)


def place_of(cell: CellData, target: TargetSection) -> FloatArray:
    """Where a target is ``(3,)`` [m] in the base frame; by default at the cell's own."""
    given = target.position_mm
    return cell.target_m if given is None else np.array(given) / 1e3


def mark_sight(cell: CellData, seen: Observation, scene: Scene) -> MarkSight | None:
    """What an instrument has to see of the tool; None where the tool touches."""
    target = target_named(cell.config, seen.target)
    if not seen.reads or seen.kind == "camera-pose" or target is None:
        return None
    farthest = _FARTHEST_MM if target.farthest_mm is None else target.farthest_mm
    marks = [mark_named(cell, label) for label in seen.tools]
    if not cell.config.constraints.collisions:
        scene = Scene(cell.robot.chain)
    return MarkSight(
        marks,
        place_of(cell, target),
        target.nearest_mm / 1e3,
        farthest / 1e3,
        scene,
        min(cell.config.measurement.least_marks, len(marks)),
    )


def miss_m(cell: CellData, seen: Observation, postures: FloatArray) -> FloatArray:
    """How far the tool is from where it can be measured, ``(N,)`` [m], at postures [rad].

    From a point that is touched, or from a plane; nothing for an instrument, whose range and line
    of sight are a constraint.
    """
    target = target_named(cell.config, seen.target)
    if seen.reads or target is None:
        return np.zeros(len(postures))
    points = cell.robot.state(postures).point(mark_named(cell, seen.tools[0]).point_m)
    off = points - place_of(cell, target)
    if seen.kind == "plane":
        normal = normal_of(target)
        return np.asarray(np.abs(off @ normal) / np.linalg.norm(normal))
    return np.asarray(np.linalg.norm(off, axis=1))


def normal_of(target: TargetSection) -> FloatArray:
    """Direction ``(3,)`` out of a plane, in base axes; upwards where nothing is said."""
    return np.array([0.0, 0.0, 1.0] if target.normal is None else target.normal)


def instrument_frame(cell: CellData, target: TargetSection) -> FloatArray:
    """Pose ``(4, 4)`` of the frame that an instrument reads in, in the base frame."""
    return transform(rotation_from_wpr(np.deg2rad(target.wpr_deg)), place_of(cell, target))


def setup_of(
    cell: CellData,
    model: CalibrationModel,
    observations: Sequence[Observation],
    which: IntArray,
    sights: Sequence[MarkSight | None],
    postures: FloatArray,
) -> Setup:
    """What is measured at postures ``(N, n)`` [rad], as indices of a model.

    ``which`` (N,): the observation of each. ``sights``: what of each is to be seen. Where several
    tools are measured at once there are as many measurements of each posture, one after another;
    those of tools that are not in sight, or not of the observation, are not seen.
    """
    used = np.unique(which).tolist()
    width = max((len(observations[k].tools) for k in used), default=1)
    names = tuple(kind.name for kind in model.measurements)
    loads = [OWN_PAYLOAD, *(load.name for load in cell.config.payload)]
    rows = np.zeros((4, len(observations), width), dtype=np.intp)
    there = np.zeros((len(observations), width), dtype=bool)
    for k in used:
        seen = observations[k]
        tools = [model.tools.index(label) for label in seen.tools]
        rows[0, k], rows[2, k] = names.index(seen.kind), model.targets.index(seen.target)
        rows[1, k], rows[1, k, : len(tools)] = tools[0], tools
        rows[3, k] = loads.index(seen.payload)
        there[k, : len(tools)] = True
    kind, tool, target, payload = rows[:, which].reshape(4, -1)
    if width == 1:
        return Setup(kind, tool, target, payload)
    visible = there[which]
    for k in used:
        sight, own = sights[k], np.flatnonzero(which == k)
        if sight is not None:
            count = len(sight.marks)
            visible[own, :count] &= sight.seen(Situation(cell.robot.chain, postures[own]))
    every = np.repeat(visible.reshape(-1, 1), model.rows, axis=1)
    return Setup(kind, tool, target, payload, every, together=width)


def which_observations(
    observations: Sequence[Observation], labels: Sequence[Mapping[str, str]]
) -> IntArray:
    """Index ``(N,)`` of the observation that each pose is of, by its labels.

    A label that is not given fits all: a list of poses need not say what there is one of.

    Raises
    ------
    InputError
        A pose that is of none, or may be of several.
    """
    found = np.zeros(len(labels), dtype=np.intp)
    for i, given in enumerate(labels):
        fits = [
            k
            for k, seen in enumerate(observations)
            if all(_fits(given, key, value) for key, value in seen.labels.items())
        ]
        if len(fits) != 1:
            raise _undecided(observations, given, i, fits)
        found[i] = fits[0]
    return found


def _fits(given: Mapping[str, str], key: str, value: str) -> bool:
    """Whether a label that is given is this one; an empty payload is the tool alone."""
    if key == "payload":
        return given.get(key, value) == value
    return not given.get(key) or given[key] == value


def _undecided(
    observations: Sequence[Observation], given: Mapping[str, str], i: int, fits: list[int]
) -> InputError:
    said = " ".join(value for value in given.values() if value)
    words = [str(seen) for seen in observations]
    if said and not fits:
        return InputError(
            f"pose {i + 1} is of {said[:60]}, which the cell does not measure",
            hint=near_names(said, words),
            name="target",
        )
    return InputError(
        f"pose {i + 1} does not say which of {len(observations)} it is of: {'; '.join(words[:4])}",
        hint="name them in the columns target, tool and payload, as plan writes them",
        name="target",
    )
