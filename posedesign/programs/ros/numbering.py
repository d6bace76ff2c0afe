"""Which pose each entry of a list is, from the comments in front of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posedesign.programs.reading import refuse
from posedesign.programs.recorded import RecordedPosition, RecordedProgram
from posedesign.programs.ros.yaml_reading import Document, Label


def numbered(
    document: Document,
    entries: list[tuple[int, tuple[str, ...], list[float]]],
    *,
    timed: bool,
) -> RecordedProgram:
    """The program of entries (line, joint names, joint values [rad]) in the order of the file.

    In a list with times an entry with the joint values of the one before is the arm standing there,
    and counts once. Where no entry has a comment with its number, they are counted from 1.

    Raises
    ------
    FileFormatError
        Only some have one, one number is there twice, or the arm moves while it is to stand.
    """
    labels = _labels_of(document, [line for line, _, _ in entries])
    positions: list[RecordedPosition] = []
    seen: set[int] = set()
    before: list[float] | None = None
    for (line, names, values), label in zip(entries, labels, strict=True):
        stands = timed and values == before
        if label is not None and label.kind == "hold":
            _check_standing(document, label, positions, stands)
        if stands and (label is None or label.kind == "hold"):
            continue
        before = values
        number = _number(document, label, line, len(positions) + 1)
        if number in seen:
            refuse(f"pose {number} is there twice", document.path, line)
        seen.add(number)
        positions.append(
            RecordedPosition(
                number,
                "" if label is None else label.name,
                line,
                np.degrees(values),
                joint_names=names,
            )
        )
    mark = document.mark
    passed = [label.number for label in labels if label is not None and label.kind == "via"]
    if passed and mark.measured is None:
        mark = replace(mark, measured=min(passed) - 1)  # they are numbered behind all measured ones
    return RecordedProgram(document.name, document.title, mark, tuple(positions), None)


def _labels_of(document: Document, lines: list[int]) -> list[Label | None]:
    """The comment in front of each entry, by the lines where entries begin.

    Raises
    ------
    FileFormatError
        Two stand in front of one entry, or one behind the last: an entry is lost.
    """
    found: list[Label | None] = [None] * len(lines)
    at = 0
    for label in document.labels:
        while at < len(lines) and lines[at] < label.line:
            at += 1
        if at == len(lines) or found[at] is not None:
            lost = label if at == len(lines) else found[at]
            number_, row = (lost.number, lost.line) if lost else (0, label.line)
            reason = f"the comment says that pose {number_} comes next, but it does not"
            refuse(reason, document.path, row, "remove the comment with its pose")
        found[at] = label
    return found


def _number(document: Document, label: Label | None, line: int, counted: int) -> int:
    if label is None and document.labels:
        refuse(
            "no comment says which pose this is, as others do",
            document.path,
            line,
            "write a comment like '# pose 3: name' in front of it",
        )
    number = counted if label is None else label.number
    if label is not None and number < 1:
        refuse("poses are counted from 1", document.path, label.line)
    measured = document.mark.measured
    if label is not None and measured is not None and (number <= measured) != (label.kind != "via"):
        reason = f"pose {number} is called {label.kind}, but the first {measured} are measured"
        refuse(reason, document.path, label.line, "restore the number of the pose")
    return number


def _check_standing(
    document: Document, label: Label, positions: list[RecordedPosition], stands: bool
) -> None:
    if not positions or positions[-1].number != label.number:
        reason = f"the arm is to stand at pose {label.number}, but that is not the one before"
        refuse(reason, document.path, label.line)
    if not stands:
        reason = f"the arm is to stand at pose {label.number}, but its joint values change"
        refuse(reason, document.path, label.line, "change both points of the pose alike")
