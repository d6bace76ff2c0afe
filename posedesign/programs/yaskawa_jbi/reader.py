"""Yaskawa INFORM jobs (``.JBI``): the reader of what controllers save and people write.

All C variables are taken, in pulses or as poses, and the P variables that steps move to. Their
numbers are those of the comments ``'POSE n name`` before the moves, where the job has such
comments: other positions, of steps that were added, then stand behind all. Without any comment
C00000 is number 1. Where ``GETS PX007 $PX000`` stands behind a move, P00007 is what was measured,
and is taken in place of the C variable: where the file holds some of them, poses whose own is not
there are left out; where it holds none, the planned positions are read, and marked as such.

The numbers of ``///USER`` and ``///TOOL`` go with the positions; frame 0 is the base frame.

Pulses become degrees with the ratios in the comments ``'PULSES S 1638.4``, or with those that the
dialect was made with. Steps of a second robot (``+MOVJ``) are left out. What would be read wrong in
silence is refused with its line: base or station axes that stand elsewhere at some of the poses,
positions in a frame that moves, lost lines.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import rotation_from_wpr, transform
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import RecordedPosition, RecordedProgram
from posedesign.programs.yaskawa_jbi.positions import (
    PositionSection,
    pulse_deg,
    rectangular,
)
from posedesign.programs.yaskawa_jbi.pulses import AXES, checked
from posedesign.programs.yaskawa_jbi.steps import Name, StepReader, Steps

_CONTROL = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]")
_JOB = "name a job saved by the controller, .JBI"
_SECTIONS = ["/JOB", "//POS", "//INST", "END"]


def parse_yaskawa_jbi(
    data: bytes, path: Path | str, pulses_per_deg: tuple[float, ...] = ()
) -> RecordedProgram:
    """Job in the content of a file; see the module.

    Parameters
    ----------
    data : bytes
    path : Path or str
        For messages.
    pulses_per_deg : tuple of float
        For jobs that do not say it; refused where the job says otherwise.

    Raises
    ------
    FileFormatError
        The file is no job, is cut off, or holds no position that can be read.
    """
    data = data.replace(b"\r\n", b"\n")
    bad = _CONTROL.search(data)
    if bad:
        row = data.count(b"\n", 0, bad.start()) + 1
        refuse(f"holds the byte 0x{bad[0][0]:02x}: it is no text", path, row, _JOB)
    # comments may be in any language: positions and instructions are in ASCII
    lines = [line.strip(" \t\r") for line in data.decode("latin-1").split("\n")]
    headings = [(row, text) for row, text in enumerate(lines, start=1) if text in _SECTIONS]
    if [text for _, text in headings] != _SECTIONS:
        found = ", ".join(text for _, text in headings[:8]) or "nothing of it"
        reason = f"is no whole job: /JOB, //POS, //INST, END are due, there is {found}"
        refuse(reason, path, headings[-1][0] if headings else 1, _JOB)
    job, pos, inst, end = (row for row, _ in headings)
    heads = [line.split(maxsplit=1) for line in lines[job:pos]]
    name = next((head[1] for head in heads if len(head) > 1 and head[0] == "//NAME"), "")
    if not name:
        refuse("has no name behind //NAME", path, job)
    section = PositionSection(path)
    for row in range(pos + 1, inst):
        section.feed(lines[row - 1], row)
    section.finish(pos)
    comment, steps = "", StepReader(section, path)
    for row in range(inst + 1, end):
        line = lines[row - 1]
        if line.startswith("///COMM "):
            comment = line[8:].strip()
        else:
            steps.feed(line, row)
    steps.finish()
    positions = _positions(section, steps.found, pulses_per_deg, path)
    if not positions:
        refuse("holds no positions", path, pos, "save the job that was touched up")
    empty = _is_untouched(section, steps.found)
    mark = steps.found.mark
    return RecordedProgram(name, comment, mark, positions, "yaskawa", empty_registers=empty)


def _positions(
    section: PositionSection,
    steps: Steps,
    pulses_per_deg: tuple[float, ...],
    path: Path | str,
) -> tuple[RecordedPosition, ...]:
    untouched = _is_untouched(section, steps)
    wanted = [
        key
        for key in section.variables
        if (key[0] == "C" and not (key in steps.other_robot and key not in steps.used))
        or (key[0] == "P" and key in steps.used)
    ]
    wanted = [key for key in wanted if untouched or steps.kept.get(key, key) in section.variables]
    _check_carriers(section, steps, wanted, path)
    ratios: tuple[float, ...] = ()
    numbers = _numbers(steps, wanted, path)
    out: list[RecordedPosition] = []
    posed: list[tuple[int, list[float]]] = []
    for key in wanted:
        source = key if untouched else steps.kept.get(key, key)
        stored = section.variables[source]
        label = f"{source[0]}{source[1]:05d}"
        found = RecordedPosition(*numbers[key], stored.line, tool_frame=stored.tool)
        if stored.form == "PULSE":
            ratios = ratios or _ratios(steps, pulses_per_deg, path, stored.line)
            found = replace(found, shown_deg=pulse_deg(stored, label, ratios, path))
        else:
            values, configuration, user = rectangular(stored, label, path)
            posed.append((len(out), values))
            found = replace(found, configuration=configuration, user_frame=user)
            if user == 0:  # the base frame is the controller's world, whatever the cell's frame
                found = replace(found, T_world_user=np.eye(4))
        out.append(found)
    return tuple(_with_poses(out, posed))


def _is_untouched(section: PositionSection, steps: Steps) -> bool:
    """Whether steps store touched-up positions in variables, and none of these is in the file."""
    kept = set(steps.kept.values())
    return bool(kept) and not kept & section.variables.keys()


def _with_poses(
    out: list[RecordedPosition], posed: list[tuple[int, list[float]]]
) -> list[RecordedPosition]:
    """Turn X, Y, Z [mm], Rx, Ry, Rz [deg] into poses, all at once."""
    if posed:
        values = np.array([row for _, row in posed])
        poses = transform(rotation_from_wpr(np.radians(values[:, 3:])), values[:, :3] * 1e-3)
        for (i, _), pose in zip(posed, poses, strict=True):
            out[i] = replace(out[i], T_user_tool=pose)
    return out


def _numbers(steps: Steps, wanted: list[Name], path: Path | str) -> dict[Name, tuple[int, str]]:
    """Number and name of each position: of its comment, else of the variable, or behind all."""
    named = {key: steps.poses[key] for key in wanted if key in steps.poses}
    seen: set[int] = set()
    for number, _, row in named.values():
        if number in seen:
            refuse(f"POSE {number} stands before two moves", path, row, "remove one of them")
        seen.add(number)
    if not named:
        last = max((n + 1 for kind, n in wanted if kind == "C"), default=0)
        numbers = {}
        for kind, n in wanted:
            last += kind != "C"
            numbers[kind, n] = (n + 1 if kind == "C" else last, "")
        return numbers
    last = max(*seen, steps.mark.measured or 0)
    numbers = {}
    for key in wanted:
        last += key not in named
        numbers[key] = named[key][:2] if key in named else (last, "")
    return numbers


def _check_carriers(
    section: PositionSection, steps: Steps, wanted: list[Name], path: Path | str
) -> None:
    """Refuse poses between which a base axis or a station moves: it carries arm or target."""
    first: tuple[tuple[str, tuple[str, ...]], ...] | None = None
    for key in wanted:
        if key not in steps.axes or (steps.poses and key not in steps.poses):
            continue
        row, axes = steps.axes[key]
        values = tuple(
            (kind, section.variables[kind, n].values)
            if (kind, n) in section.variables
            else (f"{kind}{n}", ())
            for kind, n in axes
        )
        if first is None:
            first = values
        elif values != first:
            reason = "base or station axes stand elsewhere than at the poses before"
            refuse(reason, path, row, "measure with these axes at rest")


def _ratios(
    steps: Steps, given: tuple[float, ...], path: Path | str, row: int
) -> tuple[float, ...]:
    """Pulses/deg of the job, or those given; they must not contradict each other."""
    missing = [axis for axis in AXES if axis not in steps.ratios]
    if missing and steps.ratios:
        refuse(f"the comment 'PULSES {missing[0]} is lost", path, row, "put it back")
    if missing:
        if not given:
            refuse(
                "positions are in encoder pulses, and the job does not say how many are a degree",
                path,
                row,
                "give the six of S L U R B T as pulses_per_deg (of the cell's program, or of "
                "YaskawaJbi), or in comments like 'PULSES S 1638.4 of the job; they stand in the "
                "controller's parameter file",
            )
        return given
    ratios = tuple(steps.ratios[axis] for axis in AXES)
    try:
        checked(ratios)
    except InputError as error:
        refuse(error.message, path, row, error.hint)
    if given and not all(
        math.isclose(a, b, rel_tol=1e-6) for a, b in zip(ratios, given, strict=True)
    ):
        refuse("the pulses/deg of its comments are not those given", path, row, "which are right?")
    return ratios
