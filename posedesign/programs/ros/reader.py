"""Lists for ROS: the reader.

Takes what people write and what ``ros2 topic echo`` prints: keys in any order, any style of YAML,
the goal of an action around a trajectory, points without velocities, capture poses as the message
CaptureConfig (``joint_states``). Times and features are for the validator. Comments say which pose
comes next: ``pose`` is measured, ``via`` passed through, ``hold`` the end of standing at a measured
one. Where there are none, entries are counted from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from posedesign.files.yaml_tree import Fault, documents, text_of
from posedesign.programs.notation import Literal, literals_of
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram
from posedesign.programs.ros.rules import Entry, Layout, Walk, only

_COMMENT = re.compile(r"^[ \t]*#+(.*)$", re.MULTILINE)
_LABEL = re.compile(r"(pose|via|hold)\s+(\d{1,7})(?::\s*(.*))?")


class _Label(NamedTuple):
    """A comment that says which pose comes next."""

    kind: str
    number: int
    name: str
    line: int


_NONE = _Label("", 0, "", 0)


def read_list(data: bytes, path: Path, layout: Layout) -> RecordedProgram:
    """The program in the content of a file.

    Raises FileFormatError: the content is no such list or is cut off; an entry has not one finite
    joint value for each joint, within +-720 deg, or other joints than the first; or comments do not
    fit: only some entries have a number, one is there twice, or the arm moves while it is to stand.
    """
    try:
        text = text_of(data)
        root = only(documents(text))
        words, mark, labels = _comments(text)
        entries = Walk(layout, path, strict=False).entries(root)
        positions = _positions(entries, labels, mark, timed=layout.timed)
    except Fault as fault:
        refuse(fault.message, path, fault.line, fault.hint)
    passed = [label.number for label in labels if label.kind == "via"]
    if passed and mark.measured is None:
        mark = replace(mark, measured=min(passed) - 1)  # they are numbered behind all measured ones
    name = words.get("program") or path.stem
    return RecordedProgram(name, words.get("title", ""), mark, tuple(positions), None)


_KEY = re.compile(r"""(?:^|(?<=[\s,{]))["']?(\w+)["']?[ \t]*:(?=\s|$)""", re.MULTILINE)


def joints_of(text: str) -> Iterator[Literal]:
    """The numbers of joint values in the text of a list: those behind their keys."""
    code = re.sub(r"(?m)(^|(?<=\s))#.*$", lambda found: " " * len(found[0]), text)
    keys = [*_KEY.finditer(code)]
    ends = [*(key.start() for key in keys[1:]), len(code)]
    for key, end in zip(keys, ends, strict=False):
        if key[1] in ("positions", "position", "joint_values"):
            for found in literals_of(code[key.end() : end]):
                start = key.end() + found.start
                yield Literal(start, start + len(found.text), found.text)


def _comments(text: str) -> tuple[dict[str, str], PlanMark, list[_Label]]:
    """Name and title of the program, its plan, and the labels of its poses."""
    words: dict[str, str] = {}
    mark, labels, ended = None, [], False
    line, last = 1, 0
    for found in _COMMENT.finditer(text):
        line += text.count("\n", last, found.start())
        last, comment = found.start(), found[1].strip()
        label = _LABEL.fullmatch(comment)
        key, colon, rest = comment.partition(":")
        if label:
            labels.append(_Label(label[1], int(label[2]), (label[3] or "").strip(), line))
        elif colon and key in ("program", "title", "remark"):
            words.setdefault(key, rest.strip())
        elif comment.startswith("end of "):
            ended = True
        else:
            mark = mark or PlanMark.found_in(comment)
    if "program" in words and not ended:
        reason = f"is cut off: there is no comment '# end of {words['program'][:40]}'"
        raise Fault(reason, None, hint="copy the file again")
    return words, mark or PlanMark(), labels


def _positions(
    entries: list[Entry], labels: list[_Label], mark: PlanMark, *, timed: bool
) -> list[RecordedPosition]:
    """Entries with their numbers, in the order of the file.

    In a list with times an entry with the joint values of the one before is the arm standing there,
    and counts once.
    """
    positions: list[RecordedPosition] = []
    seen = {0}
    before: list[float] = []
    for entry, label in zip(entries, _labels_of(entries, labels), strict=True):
        stands = timed and entry.values_rad == before
        at = positions[-1].number if positions else None
        if stands and (label is _NONE or (label.kind, label.number) == ("hold", at)):
            continue
        if labels:
            _check_label(label, entry, mark, at)
        number = label.number or len(positions) + 1
        if number in seen:
            raise Fault(f"pose {number} is there twice", entry.line)
        seen.add(number)
        before = entry.values_rad
        shown = np.degrees(before)
        positions.append(
            RecordedPosition(number, label.name, entry.line, shown, joint_names=entry.names)
        )
    return positions


def _labels_of(entries: list[Entry], labels: list[_Label]) -> list[_Label]:
    """The comment in front of each entry, by the lines where entries begin."""
    found = [_NONE] * len(entries)
    at = 0
    for label in labels:
        while at < len(entries) and entries[at].line < label.line:
            at += 1
        lost = label if at == len(entries) else found[at]
        if lost is not _NONE:  # two in front of one entry, or one behind the last
            reason = f"the comment says that pose {lost.number} comes next, but it does not"
            raise Fault(reason, lost.line, hint="remove the comment with its pose")
        found[at] = label
    return found


def _check_label(label: _Label, entry: Entry, mark: PlanMark, at: int | None) -> None:
    """Refuse what a comment says of an entry that is not the arm standing ``at`` a pose."""
    number, most = label.number, mark.measured
    hint, line = "restore the number of the pose", label.line
    if label is _NONE:
        reason, line = "no comment says which pose this is, as others do", entry.line
        hint = "write a comment like '# pose 3: name' in front of it"
    elif label.kind == "hold" and at != number:
        reason = f"the arm is to stand at pose {number}, but that is not the one before"
    elif label.kind == "hold":
        reason = f"the arm is to stand at pose {number}, but its joint values change"
        hint = "change both points of the pose alike"
    elif number < 1:
        reason = "poses are counted from 1"
    elif most is not None and (number <= most) != (label.kind == "pose"):
        reason = f"pose {number} is called {label.kind}, but the first {most} are measured"
    else:
        return
    raise Fault(reason, line, hint=hint)
