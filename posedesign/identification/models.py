"""The models that a cell asks for, in words, as calibration models."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.errors import InputError, near_names
from calib.identification import Candidate, Workplace, reduce
from calib.identification.evidence import groups_of
from calib.identification.identifiability import UNSEEN_SCALE, unseen_scale
from calib.identification.least_squares import first_guess
from calib.model import CalibrationModel, KnownDistance
from calib.model.measurements import KINDS, Measurement
from calib.model.parameters import (
    BearingCompliance,
    Frames,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LengthOffsets,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Part,
    TargetFrame,
    ToolFrame,
    ZeroOffsets,
)
from calib.robots import ChainState
from calib.se3 import FloatArray, transform
from posedesign.candidates import workplace
from posedesign.cell import Cell
from posedesign.cell.models import (
    PRIORS,
    WEIGH,
    everything,
    has_weight,
    known_distances,
    measured_with,
    payloads_of,
    robot_blocks,
    set_up_blocks,
)
from posedesign.cell.observations import instrument_frame, place_of, target_named
from posedesign.files.measurements import TOOL, MeasurementTable

FRAMES_ONLY = "frames only"
"""The baseline: errors of the set-up are not the robot's."""

OFFSETS = "offsets"
_NAMES = {"zero_offsets": OFFSETS, "lost_motion": "lost motion"}
EVERYTHING = "everything with priors"
"""Name of the reference, which all models are judged by."""

_GIVES, _RUNS = ("compliance", "bearings"), ("lost_motion", "harmonics")
_ABSENT = (
    *(("bearings",), _GIVES, _RUNS, ("bearings", *_RUNS), (*_GIVES, *_RUNS)),
    *(("geometry", "bearings", *_RUNS), ("geometry", *_GIVES, *_RUNS)),
)
"""What an arm may be without: bearings give way less than reducers, what runs unevenly sticks, too,
and links may be as described: the least size of their errors is not nothing."""

SIZES = 0.05, 2.0
"""Bounds of the standard deviation of a kind of errors that is found from the measurements, over
the one that the cell gives: touch-ups do not see the scale of an arm, and without an upper bound
the likeliest arm may be one that has shrunk."""

_WAVE = re.compile(r"harmonic\..+\.(?:sin|cos)(\d+(?:\.\d+)?)", re.ASCII)
_TOOL_AXIS = re.compile(r"tool(?:\.(.+))?\.r?[xyz]", re.ASCII)
_TARGET_AXIS = re.compile(r"target\.(.+)\.r?[xyz]", re.ASCII)


def name_of(words: Sequence[str]) -> str:
    """Name of the model that frees these words."""
    name = " + ".join(_NAMES.get(word, word) for word in words if word != PRIORS)
    return f"{name} with priors" if PRIORS in words else name


def kinds_of(
    cell: Cell, names: Sequence[str], *, before_measuring: bool = False
) -> list[Measurement]:
    """Kinds of measurement with the noise that the cell gives them, or with none.

    Before measuring there are no residuals to take the noise from: it is the one given.
    """
    given = {noise.kind: noise for noise in cell.config.noise}
    section = cell.config.measurement
    found: list[Measurement] = []
    for name in names:
        if section.estimate_noise and not before_measuring:
            found.append(KINDS[name](None))
        elif name in given:
            found.append(measured_with(given[name]))
        elif name == section.kind and name in ("touch-up", "view-line", "camera-pose"):
            found.append(cell.measurement)
        else:
            found.append(KINDS[name](None))
    return found


@dataclass(frozen=True, eq=False)
class Models:
    """Models of one table of measurements, in the words of a cell."""

    cell: Cell
    table: MeasurementTable

    @cached_property
    def set_up(self) -> list[ParameterBlock]:
        """Blocks that place the tools and targets of the table, in the order of its labels.

        What was measured says what there must be: a touched target or a ball bar's foot is a point,
        what points and poses are read in is a frame, what a plane contact meets is a plane. Where
        the cell does not say where they are, the nominal arm does: any guess is good enough for a
        fit that places the set-up first.
        """
        data = self.table.data
        kinds, points = self.table.kind_of_each, self._nominal.point(self.cell.tool_m)
        tools = [(name, set(kinds[data.setup.tool == k])) for k, name in enumerate(data.tools)]
        of_targets = [data.setup.target == k for k in range(len(data.targets))]
        targets = [
            (name, set(kinds[own]), points[own])
            for name, own in zip(data.targets, of_targets, strict=True)
        ]
        return set_up_blocks(self.cell, tools, targets)

    @cached_property
    def _nominal(self) -> ChainState:
        """The arm as described at all measurements."""
        return self.cell.robot.state(self.table.data.postures)

    @cached_property
    def distances(self) -> list[KnownDistance]:
        """Distances between targets that the cell knows.

        Raises InputError: one of a target that was not measured.
        """
        targets = self.table.data.targets
        for section in self.cell.config.known_distance:
            for name in section.targets:
                if name not in targets:
                    raise InputError(
                        f"a distance to the target {name!r} is known, and it was not measured",
                        hint=f"in the cell's [[known_distance]], {near_names(name, targets)}",
                        name="known_distance",
                    )
        return known_distances(self.cell, {*targets})

    def of(self, words: Sequence[str], kinds: Sequence[Measurement]) -> CalibrationModel:
        """The model that frees what words say, besides the set-up."""
        blocks = [*robot_blocks(self.cell, words), *self.set_up]
        return CalibrationModel(self.cell.robot, blocks, kinds, self.distances)

    @cached_property
    def held_only(self) -> tuple[str, ...]:
        """Names of models that the cell asks for, and that need priors: nothing sees the scale.

        Models are asked before they are reduced: a link that is left out of one would hold the
        scale, and a short one holds it badly.
        """
        kinds, data, found = kinds_of(self.cell, self.table.kinds), self.table.data, []
        for words in asked_for(self.cell):
            if "geometry" in words and PRIORS not in words:
                whole = self.of(words, kinds)
                x = first_guess(whole, data)
                if unseen_scale(whole.linearise_at(data, x)) > UNSEEN_SCALE:
                    found.append(name_of(words))
        return tuple(found)

    def candidates(
        self,
        kinds: Sequence[Measurement] | None = None,
        *,
        own_noise: bool = False,
        before_measuring: bool = False,
    ) -> list[Candidate]:
        """The baseline and every model that the cell asks for, smallest first.

        Models that free what these measurements cannot tell are reduced, and say so; zero offsets
        that the cell lists by name are not left out in silence: their model is refused. Without
        those of :attr:`held_only`.

        ``kinds``: with their noise; by default that of the cell. ``own_noise``: where the noise was
        found, estimate that of models without priors anew, each its own: a robust loss would weigh
        down most of what a model that leaves much of the arm out misses. ``before_measuring``: all
        of them, with the noise and the priors that the cell gives.
        """
        cell, data = self.cell, self.table.data
        if kinds is None:
            kinds = kinds_of(cell, self.table.kinds, before_measuring=before_measuring)
        alone = [k.of_unknown_noise() if own_noise and k.found else k for k in kinds]
        baseline = self.of((), alone)
        found = [Candidate(FRAMES_ONLY, baseline)]
        sized = cell.config.parameters.tune_priors and not before_measuring
        for words in asked_for(cell):
            name = name_of(words)
            if not before_measuring and name in self.held_only:
                continue
            whole = self.of(words, kinds if PRIORS in words else alone)
            if words == ("zero_offsets",):
                found.append(Candidate(name, whole))
                continue
            reduced = reduce(whole, data)
            if reduced.model.p > baseline.p:  # something of the arm is left
                groups = groups_of(reduced.model, *SIZES, usual=True) if sized else ()
                found.append(Candidate(name, reduced.model, reduced.merged, groups))
        return sorted(found, key=lambda candidate: candidate.model.p)

    def reference(self) -> tuple[Candidate, list[Candidate]]:
        """Everything that may be off on an arm, or that the cell asks for, held by priors.

        Nothing is left out of it: priors hold what the measurements do not tell. And its
        alternatives: arms that have not all of it.
        """
        every = everything(self.cell)
        kinds = kinds_of(self.cell, self.table.kinds)

        def without(absent: Sequence[str]) -> Candidate:
            words = tuple(word for word in every if word not in absent)
            if "geometry" in absent:
                words = ("zero_offsets", *words)
            name, model = name_of(words) if absent else EVERYTHING, self.of(words, kinds)
            return Candidate(name, model, (), groups_of(model, *SIZES, usual=True))

        absences = dict.fromkeys(tuple(w for w in absent if w in every) for absent in _ABSENT)
        return without(()), [without(absent) for absent in absences if absent]

    def of_arm(self) -> CalibrationModel:
        """All that may be off in the arm, held by priors: what mistakes are told apart from."""
        words = ["geometry", "harmonics", PRIORS]
        if has_weight(self.cell):
            words.append("compliance")
        kinds = kinds_of(self.cell, self.table.kinds, before_measuring=True)
        blocks = [*robot_blocks(self.cell, words), *self.set_up]
        return CalibrationModel(self.cell.robot, blocks, kinds)

    def nominal_m(self) -> FloatArray:
        """How far the tool point is off with arm and set-up as the cell has them, ``(N,)`` [m].

        Touched targets that the cell does not place stand where the nominal arm sees them on
        average. NaN for what an instrument has read: where that stands the cell does not say.
        """
        data, kinds = self.table.data, self.table.kind_of_each
        points = self._nominal.point(self.cell.tool_m)
        out = np.full(data.count, np.nan)
        for k, label in enumerate(data.targets):
            own = (data.setup.target == k) & np.isin(kinds, ("touch-up", "view-line"))
            if own.any():
                known = target_named(self.cell.config, label)
                place = points[own].mean(axis=0) if known is None else place_of(self.cell, known)
                out[own] = np.linalg.norm(points[own] - place, axis=1)
        return out

    def workplace(self) -> Workplace:
        """Postures at which the arm will work, by those of the table: see :func:`workplace`."""
        return workplace(self.cell, self.table.data.postures, self.table.data.setup)


def asked_for(cell: Cell) -> list[tuple[str, ...]]:
    """Models that the cell asks for and can have, in its words."""
    asked = cell.config.parameters.models
    return [words for words in asked if has_weight(cell) or not set(words) & set(WEIGH)]


def left_out(cell: Cell) -> list[str]:
    """Models that the cell asks for and cannot have, with the reason: all in one, or none."""
    able = asked_for(cell)
    names = [name_of(words) for words in cell.config.parameters.models if words not in able]
    return [f"{', '.join(names)}: the masses of the links are not known"] if names else []


def frames_of(
    blocks: Sequence[ParameterBlock], values: FloatArray, names: tuple[str, ...]
) -> dict[str, dict[str, FloatArray]]:
    """Poses of tools and targets ``(4, 4)`` [m] by label, at identified values of all names."""
    found: dict[str, dict[str, FloatArray]] = {"tools": {}, "targets": {}}
    for block in blocks:
        if isinstance(block, Frames):
            own = np.array([values[names.index(name)] for name in block.names])
            for label, T in zip(block.labels, block.poses(own), strict=True):
                found["tools" if block.tools else "targets"][label] = T
    return found


def model_of(cell: Cell, names: Sequence[str]) -> CalibrationModel:
    """The model that has these parameters, by their names: of a result that is read from a file.

    ``names``: such as ``zero_offset.joint_2``, ``link.joint_3.rx``, ``tool.x``, ``target.T1.z``.
    Raises InputError: a name that is no parameter of this cell's robot; the hint lists near ones.
    """
    robot, payloads, wanted = cell.robot, payloads_of(cell), set(names)
    joints, section = robot.turning_joints, cell.config.parameters
    waves = sorted({float(m[1]) for name in names if (m := _WAVE.fullmatch(name))})
    whole: list[ParameterBlock] = [
        ZeroOffsets(robot, robot.joint_names),
        LinkGeometry(robot),
        JointScale(robot, robot.joint_names),
        JointCompliance(robot, joints, payloads),
        BearingCompliance(robot, joints, payloads),
        LostMotion(robot, joints, section.lost_motion_nm, payloads),
        JointHarmonics(robot, joints, waves or [1.0]),
        *_frames_named(cell, names),
    ]
    known = {name for block in whole for name in block.names}
    strange = next((name for name in names if name not in known), None)
    if strange is not None:
        raise InputError(
            f"{robot.name} has no parameter {strange[:60]!r}",
            hint=near_names(strange, known),
            name=strange,
        )
    blocks = [Part(block, [n for n in block.names if n in wanted]) for block in whole]
    kept = [block for block in blocks if block.size or block.tools or block.targets]
    return CalibrationModel(robot, kept, cell.measurement)


def _frames_named(cell: Cell, names: Sequence[str]) -> list[ParameterBlock]:
    """Frames of the tools and targets that names speak of, at the origin; one of each at least.

    Turned as the cell has them: rotations that were identified are from there.
    """
    tools = dict.fromkeys(m[1] or TOOL for name in names if (m := _TOOL_AXIS.fullmatch(name)))
    targets = dict.fromkeys(m[1] for name in names if (m := _TARGET_AXIS.fullmatch(name)))
    on_tip = transform(np.eye(3), cell.tool_m)
    return [
        *(ToolFrame(on_tip, label) for label in tools or (TOOL,)),
        *(TargetFrame(_turned(cell, label), label) for label in targets or ("T1",)),
        LengthOffsets([n.removeprefix("length.") for n in names if n.startswith("length.")]),
    ]


def _turned(cell: Cell, label: str) -> FloatArray:
    """A frame ``(4, 4)`` at the origin, turned as the cell has the target."""
    known = target_named(cell.config, label)
    if known is None:
        return np.eye(4)
    return transform(instrument_frame(cell, known)[:3, :3], np.zeros(3))
