"""The models that a cell asks for, in words, as calibration models."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.errors import InputError, near_names
from calib.identification.comparison import Candidate
from calib.identification.reduction import reduce
from calib.knowledge import KnownDistance
from calib.measurement import KINDS, Measurement
from calib.model import CalibrationModel
from calib.parameters import (
    BearingCompliance,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LengthOffsets,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Payload,
    TargetFrame,
    ToolFrame,
    ZeroOffsets,
)
from calib.parameters.links import AXES
from calib.parameters.part import Part
from calib.robots import Robot
from calib.se3 import transform
from posedesign.cell import Cell
from posedesign.cell_measurement import noise_sigma
from posedesign.measurement_table import TOOL, MeasurementTable
from posedesign.set_up import set_up_blocks

FRAMES_ONLY = "frames only"
"""The baseline: errors of the set-up are not the robot's."""

OFFSETS = "offsets"
_NAMES = {"zero_offsets": OFFSETS, "lost_motion": "lost motion"}
PRIORS = "priors"
"""Word that holds a model to what is known before measuring."""

_WEIGH = ("compliance", "bearings", "lost_motion")
"""Words that need masses."""


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
            found.append(KINDS[name](noise_sigma(given[name])))
        elif name == section.kind:
            found.append(cell.measurement)
        else:
            found.append(KINDS[name](None))
    return found


def payloads_of(cell: Cell) -> list[Payload]:
    """The tool's own payload, and those listed besides."""
    own = cell.payload or Payload(0.0, np.zeros(3))
    others = [Payload(p.mass_kg, np.array(p.com_mm) / 1e3) for p in cell.config.payload]
    return [own, *others]


def arm_as_dict(cell: Cell) -> dict[str, Any]:
    """What of the cell gives parameters their meaning, besides the robot."""
    return {
        "lost_motion_nm": cell.config.parameters.lost_motion_nm,
        "payloads": [[load.mass_kg, *(1e3 * load.com_m)] for load in payloads_of(cell)],
        "link_masses_kg": cell.robot.link_mass.tolist(),
    }


def robot_blocks(cell: Cell, words: Sequence[str]) -> list[ParameterBlock]:
    """Blocks of the arm that words free; all joints unless the cell lists offsets."""
    robot, section = cell.robot, cell.config.parameters
    joints, payloads = robot.joint_names, payloads_of(cell)
    blocks: list[ParameterBlock] = []
    held, degree = PRIORS in words, np.pi / 180.0
    offset = section.prior_offset_deg * degree if held else None
    length = section.prior_length_mm * 1e-3 if held else None
    angle = section.prior_angle_deg * degree if held else None
    wave = section.prior_harmonic_deg * degree if held else None
    give = section.prior_compliance_urad_nm * 1e-6 if held else None
    if "geometry" in words:
        # offsets first: a turn about a joint's axis is then called by the name of its offset
        blocks.append(ZeroOffsets(robot, joints, offset))
        blocks.append(LinkGeometry(robot, _across_axes(robot) if held else None, length, angle))
    elif "zero_offsets" in words:
        blocks.append(ZeroOffsets(robot, cell.offset_joints, offset))
    if "scale" in words:
        blocks.append(JointScale(robot, joints, wave))  # as much in a radian as a wave
    if "compliance" in words:
        blocks.append(JointCompliance(robot, joints, payloads, prior=give))
    if "bearings" in words:
        blocks.append(BearingCompliance(robot, joints, payloads, prior=give))
    if "lost_motion" in words:
        blocks.append(LostMotion(robot, joints, section.lost_motion_nm, payloads, prior_rad=wave))
    if "harmonics" in words:
        blocks.append(JointHarmonics(robot, joints, section.harmonics, wave))
    return blocks


def _across_axes(robot: Robot) -> list[str]:
    """Parameters of all links but turns about the joints' own axes, which are zero offsets."""
    own = {
        f"link.{joint}.{AXES[3 + int(np.argmax(np.abs(axis)))]}"
        for joint, axis in zip(robot.joint_names, robot.chain.axes, strict=True)
        if np.abs(axis).max() > 1.0 - 1e-9
    }
    return [name for name in LinkGeometry(robot).names if name not in own]


def candidates(
    cell: Cell, table: MeasurementTable, *, before_measuring: bool = False
) -> list[Candidate]:
    """The baseline and every model that the cell asks for, smallest first.

    Models that free what these measurements cannot tell are reduced, and say so; zero offsets
    that the cell lists by name are not left out in silence: their model is refused.
    """
    set_up = set_up_blocks(cell, table)
    kinds = kinds_of(cell, table.kinds, before_measuring=before_measuring)
    distances = _distances(cell, table)

    def model(words: Sequence[str]) -> CalibrationModel:
        return CalibrationModel(cell.robot, [*robot_blocks(cell, words), *set_up], kinds, distances)

    found = [Candidate(FRAMES_ONLY, model(()))]
    for words in cell.config.parameters.models:
        name = name_of(words)
        if set(words) & set(_WEIGH) and not _has_weight(cell):
            continue
        whole = model(words)
        if words == ("zero_offsets",):
            found.append(Candidate(name, whole))
            continue
        reduced = reduce(whole, table.data)
        if reduced.model.p > found[0].model.p:  # something of the arm is left
            found.append(Candidate(name, reduced.model, reduced.merged))
    return sorted(found, key=lambda candidate: candidate.model.p)


def left_out(cell: Cell) -> list[str]:
    """Models that the cell asks for and cannot have, with the reason."""
    return [
        f"{name_of(words)}: neither the robot nor the tool has a mass"
        for words in cell.config.parameters.models
        if set(words) & set(_WEIGH) and not _has_weight(cell)
    ]


def _has_weight(cell: Cell) -> bool:
    return bool(cell.robot.link_mass.any()) or any(p.mass_kg > 0 for p in payloads_of(cell))


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

    Parameters
    ----------
    cell : Cell
    names : sequence of str
        Such as ``zero_offset.joint_2``, ``link.joint_3.rx``, ``tool.x``, ``target.T1.z``.

    Raises
    ------
    InputError
        A name that is no parameter of this cell's robot; the hint lists near ones.
    """
    robot, payloads, wanted = cell.robot, payloads_of(cell), set(names)
    joints, section = robot.joint_names, cell.config.parameters
    waves = sorted({float(m[1]) for name in names if (m := _WAVE.fullmatch(name))})
    whole: list[ParameterBlock] = [
        ZeroOffsets(robot, joints),
        LinkGeometry(robot),
        JointScale(robot, joints),
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
    """Frames of the tools and targets that names speak of, at the origin; one of each at least."""
    tools = dict.fromkeys(m[1] or TOOL for name in names if (m := _TOOL_AXIS.fullmatch(name)))
    targets = dict.fromkeys(m[1] for name in names if (m := _TARGET_AXIS.fullmatch(name)))
    there, on_tip = np.eye(4), transform(np.eye(3), cell.tool_m)
    return [
        *(ToolFrame(on_tip, label) for label in tools or (TOOL,)),
        *(TargetFrame(there, label) for label in targets or ("T1",)),
        LengthOffsets([n.removeprefix("length.") for n in names if n.startswith("length.")]),
    ]
