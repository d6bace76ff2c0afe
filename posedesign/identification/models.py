"""The models that a cell asks for, in words, as calibration models."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.errors import InputError, near_names
from calib.identification import Candidate, PriorGroup, reduce
from calib.identification.report import UNSEEN_SCALE, unseen_scale
from calib.identification.start import first_guess
from calib.model import CalibrationModel, KnownDistance
from calib.model.measurements import KINDS, Measurement
from calib.model.parameters import (
    BearingCompliance,
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
from calib.se3 import FloatArray, transform
from posedesign.cell import Cell
from posedesign.cell.arm_errors import PRIORS, WEIGH, has_weight, payloads_of, robot_blocks
from posedesign.cell.measuring import measured_with
from posedesign.cell.observations import instrument_frame, target_named
from posedesign.files.measurements import TOOL, MeasurementTable
from posedesign.identification.measurement_set_up import set_up_blocks

FRAMES_ONLY = "frames only"
"""The baseline: errors of the set-up are not the robot's."""

OFFSETS = "offsets"
_NAMES = {"zero_offsets": OFFSETS, "lost_motion": "lost motion"}
EVERYTHING = "everything with priors"
"""Name of the reference, which all models are judged by."""

_EVERYTHING = ("geometry", "compliance", "bearings", "lost_motion", "harmonics", PRIORS)
"""What may be off on any arm."""

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

_KINDS = {
    ("zero_offset", "rad"): "offsets",
    ("link", "m"): "lengths",
    ("link", "rad"): "angles",
    ("lost_motion", "rad"): "lost motion",
}
"""What parameters of one size are called in reports, where not by the first word of their name."""

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


def arm_as_dict(cell: Cell) -> dict[str, Any]:
    """What of the cell gives parameters their meaning, besides the robot."""
    return {
        "lost_motion_nm": cell.config.parameters.lost_motion_nm,
        "payloads": [[load.mass_kg, *(1e3 * load.com_m)] for load in payloads_of(cell)],
        "link_masses_kg": cell.robot.link_mass.tolist(),
    }


def candidates(
    cell: Cell,
    table: MeasurementTable,
    kinds: Sequence[Measurement] | None = None,
    *,
    without: Sequence[str] = (),
    own_noise: bool = False,
    before_measuring: bool = False,
) -> list[Candidate]:
    """The baseline and every model that the cell asks for, smallest first.

    Models that free what these measurements cannot tell are reduced, and say so; zero offsets
    that the cell lists by name are not left out in silence: their model is refused.

    ``kinds``: with their noise; by default that of the cell. ``without``: names of models that are
    not to be tried, such as those of :func:`held_only`. ``own_noise``: where the noise was found,
    estimate that of models without priors anew, each its own: a robust loss would weigh down most
    of what a model that leaves much of the arm out misses. ``before_measuring``: see
    :func:`kinds_of`.
    """
    if kinds is None:
        kinds = kinds_of(cell, table.kinds, before_measuring=before_measuring)
    alone = [k.of_unknown_noise() if own_noise and k.found else k for k in kinds]
    baseline = _model(cell, table, (), alone)
    found = [Candidate(FRAMES_ONLY, baseline)]
    sized = cell.config.parameters.tune_priors and not before_measuring
    for words in asked_for(cell):
        name = name_of(words)
        if name in without:
            continue
        whole = _model(cell, table, words, kinds if PRIORS in words else alone)
        if words == ("zero_offsets",):
            found.append(Candidate(name, whole))
            continue
        reduced = reduce(whole, table.data)
        if reduced.model.p > baseline.p:  # something of the arm is left
            groups = size_groups(reduced.model) if PRIORS in words and sized else ()
            found.append(Candidate(name, reduced.model, reduced.merged, groups))
    return sorted(found, key=lambda candidate: candidate.model.p)


def reference(cell: Cell, table: MeasurementTable) -> tuple[Candidate, list[Candidate]]:
    """Everything that may be off on an arm, or that the cell asks for, held by priors.

    Nothing is left out of it: priors hold what the measurements do not tell. And its alternatives:
    arms that have not all of it.
    """
    asked = {word for words in cell.config.parameters.models for word in words}
    every = tuple(dict.fromkeys([*_EVERYTHING, *sorted(asked - {"zero_offsets"})]))
    if not has_weight(cell):
        every = tuple(word for word in every if word not in WEIGH)
    kinds = kinds_of(cell, table.kinds)

    def without(absent: Sequence[str]) -> Candidate:
        words = tuple(word for word in every if word not in absent)
        if "geometry" in absent:
            words = ("zero_offsets", *words)
        model = _model(cell, table, words, kinds)
        return Candidate(name_of(words) if absent else EVERYTHING, model, (), size_groups(model))

    absences = dict.fromkeys(tuple(w for w in absent if w in every) for absent in _ABSENT)
    return without(()), [without(absent) for absent in absences if absent]


def size_groups(model: CalibrationModel) -> tuple[PriorGroup, ...]:
    """Parameters with a prior that are of one kind, to be found how large they are."""
    members: dict[tuple[str, str], list[int]] = {}
    for k in np.flatnonzero(np.isfinite(model.prior)).tolist():
        members.setdefault((model.names[k].partition(".")[0], model.units[k]), []).append(k)
    return tuple(
        PriorGroup(
            _KINDS.get(kind, kind[0]),
            tuple(model.names[k] for k in own),
            SIZES[0] * usual,
            SIZES[1] * usual,
            usual,
        )
        for kind, own in members.items()
        for usual in [float(np.sqrt(np.mean(model.prior[own] ** 2)))]
    )


def asked_for(cell: Cell) -> list[tuple[str, ...]]:
    """Models that the cell asks for and can have, in its words."""
    asked = cell.config.parameters.models
    return [words for words in asked if has_weight(cell) or not set(words) & set(WEIGH)]


def _model(
    cell: Cell, table: MeasurementTable, words: Sequence[str], kinds: Sequence[Measurement]
) -> CalibrationModel:
    blocks = [*robot_blocks(cell, words), *set_up_blocks(cell, table)]
    return CalibrationModel(cell.robot, blocks, kinds, _distances(cell, table))


def left_out(cell: Cell) -> list[str]:
    """Models that the cell asks for and cannot have, with the reason: all in one, or none."""
    able = asked_for(cell)
    names = [name_of(words) for words in cell.config.parameters.models if words not in able]
    return [f"{', '.join(names)}: the masses of the links are not known"] if names else []


def held_only(cell: Cell, table: MeasurementTable) -> list[str]:
    """Names of models that the cell asks for, and that need priors: nothing sees the scale.

    Models are asked before they are reduced: a link that is left out of one would hold the scale,
    and a short one holds it badly.
    """
    kinds, data, found = kinds_of(cell, table.kinds), table.data, []
    for words in asked_for(cell):
        if "geometry" in words and PRIORS not in words:
            whole = _model(cell, table, words, kinds)
            x = first_guess(whole, data)
            linear = whole.linearise_at(data, x)
            if unseen_scale(linear, x) > UNSEEN_SCALE:
                found.append(name_of(words))
    return found


def _distances(cell: Cell, table: MeasurementTable) -> list[KnownDistance]:
    known = []
    for section in cell.config.known_distance:
        missing = next((name for name in section.targets if name not in table.data.targets), None)
        if missing is not None:
            raise InputError(
                f"a distance to the target {missing!r} is known, and it was not measured",
                hint=f"in the cell's [[known_distance]], {near_names(missing, table.data.targets)}",
                name="known_distance",
            )
        first, second = section.targets
        known.append(
            KnownDistance(first, second, section.length_mm / 1e3, section.three_sigma_mm / 3e3)
        )
    return known


def model_of(cell: Cell, names: Sequence[str]) -> CalibrationModel:
    """The model that has these parameters, by their names: of a result that is read from a file.

    ``names``: such as ``zero_offset.joint_2``, ``link.joint_3.rx``, ``tool.x``, ``target.T1.z``.
    Raises InputError: a name that is no parameter of this cell's robot; the hint lists near ones.
    """
    robot, payloads, wanted = cell.robot, payloads_of(cell), set(names)
    joints, section = robot.arm_joints, cell.config.parameters
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
