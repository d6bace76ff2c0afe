"""MELFA-BASIC programs: the reader.

Positions are the list behind the steps: joints in degrees, poses in mm and degrees. ``J3`` of a
program that carries the mark of a plan is the pose of number 3; other positions are numbered
behind, in their order. Poses are taken without their structure flags, of which public sources do
not say the signs for every arm: the plan settles which posture is meant. That A, B, C turn about
fixed X, Y and Z is from RoboDK's post-processor alone. Positions that were defined, but never
taught, have empty flags, ``(,)``, and are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
from lark import Token, Tree

from posedesign.programs.language import Language, Line, Statement, lines_of, text_of
from posedesign.programs.numbering import Named, Numbering
from posedesign.programs.reading import joint_deg, number, pose_values, poses_of, refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

_REMARK = re.compile(r"""("[^"\n]*")|'.*""")
_NOTE = re.compile(r"\d{1,5} ?' ?(.*)")
_POSE = re.compile(r"POSE (\d{1,6})(?: (.*))?")
_PLANNED = re.compile(r"J([1-9]\d{0,4})", re.IGNORECASE | re.ASCII)
_NEVER = re.compile(r"(?!)")
_MOST = 6
"""Values of a position; those behind are of axes that carry the arm, or a part."""


def _without_remarks(lines: Iterator[Line]) -> Iterator[Line]:
    for line in lines:
        text = _REMARK.sub(lambda found: found[1] or "", line.text).rstrip()
        if text and (text == line.text or not text.isdigit()):
            yield Line(line.row, text)


LANGUAGE = Language(
    __package__ or "", joined=_without_remarks, start="step", signed=True, letters=r"\w"
)


def entry_of(statement: Statement) -> tuple[str, list[Tree[Token]], str]:
    """Name, values and flags of an entry of the list, which has no number of a step; else empty."""
    body = cast("list[Tree[Token]]", statement.tree.children)[-1:]
    if statement.fault or len(statement.tree.children) > 1 or body[0].data != "assignment":
        return "", [], ""
    place, value, *flags = cast("list[Tree[Token]]", body[0].children)
    values = cast("list[Tree[Token]]", value.children) if value.data == "group" else []
    return text_of(place), values, text_of(flags[0]) if flags else "none"


def parse_mitsubishi_melfa(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    notes = [note[1].strip() for line in lines_of(text) if (note := _NOTE.fullmatch(line.text))]
    mark = next((mark for note in notes if (mark := PlanMark.found_in(note))), None)
    names = {int(pose[1]): pose[2] or "" for note in notes if (pose := _POSE.fullmatch(note))}
    found: dict[str, RecordedPosition] = {}
    for statement in LANGUAGE.statements(text):
        if statement.fault and re.match(r"\s*[JPjp]\w*[^=\"']*=", statement.text):
            refuse(f"a position cannot be read: {statement.fault}", path, statement.row)
        name, values, flags = entry_of(statement)
        if name[:1].upper() not in ("J", "P") or flags == ",":
            continue
        if name.upper() in found:
            refuse(f"{name} is there twice", path, statement.row)
        if not all(value.data == "number" for value in values):
            refuse(f"{name} is no list of numbers", path, statement.row)
        at = RecordedPosition(0, name, statement.row)
        found[name.upper()] = _with_values(at, name, [text_of(value) for value in values], path)
    if not found:
        refuse("holds no positions", path, None, "save the program with its positions")
    numbering = Numbering(_PLANNED if mark else _NEVER, _NEVER, mark, names if mark else {})
    numbered = numbering.of([Named(at.name, at.line) for at in found.values()], path)
    pairs = zip(found.values(), numbered, strict=True)
    positions = [replace(at, number=n, name=own.name) for at, (n, own) in pairs]
    positions.sort(key=lambda position: position.number)
    return RecordedProgram(path.stem, "", mark or PlanMark(), tuple(positions), None)


def _with_values(at: RecordedPosition, name: str, texts: list[str], path: Path) -> RecordedPosition:
    joints = name[0] in "Jj"
    if len(texts) > _MOST + joints:
        if any(number(text, name, path, at.line, 1e6) for text in texts[_MOST:]):
            refuse(f"{name} moves additional axes", path, at.line, "measure with them at rest")
        texts = texts[:_MOST]
    if len(texts) < (1 if joints else _MOST):
        refuse(f"{name} has {len(texts)} values", path, at.line)
    if joints:
        return replace(at, shown_deg=np.array([joint_deg(t, name, path, at.line) for t in texts]))
    return replace(at, T_user_tool=poses_of(pose_values(texts, "XYZABC", name, path, at.line))[0])
