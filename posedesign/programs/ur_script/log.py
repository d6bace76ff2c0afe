"""Logs of URScript programs: the joint positions that a run has reported.

A line holds ``POSE 3 q=[0.1, -1.57, 1.57, 0, 1.57, 0]`` [rad] behind anything (the time, the
source), as ``textmsg`` of the written scripts makes it; other lines are ignored. A line with
``PROGRAM NAME PLAN 1a2b3c4d 27`` starts a run: what stands before the last one is of earlier runs
and is left out.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from posedesign.programs.reading import refuse, text_of
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram
from posedesign.programs.ur_script.reader import MOST_JOINT_RAD, six

_REPORT = re.compile(
    r"\bPOSE\s{1,9}(\d{1,6})\s{0,9}q\s{0,9}=\s{0,9}(?:\[([^\[\]]{0,999})(\]?))?", re.ASCII
)
_START = re.compile(
    r"\bPROGRAM\s{1,9}([A-Za-z]\w{0,63})(?!\w)(?:\s{1,9}(PLAN [0-9a-f]{4,16} \d{1,7})(?!\w))?",
    re.ASCII,
)
_IS_LOG = re.compile(rb"\bPOSE\s{1,9}\d{1,6}\s{0,9}q\s{0,9}=\s{0,9}\[")
_IS_SCRIPT = re.compile(rb"^[ \t]*def[ \t]+\w", re.MULTILINE)


def is_log(data: bytes) -> bool:
    """Whether a file is such a log, and no script."""
    return _IS_LOG.search(data) is not None and _IS_SCRIPT.search(data) is None


def parse_log(data: bytes, path: Path | str) -> RecordedProgram:
    """Positions that the last run in a log reported.

    Raises
    ------
    FileFormatError
        The last run reported no pose, or one that cannot be read, or one pose twice.
    """
    lines = text_of(data, path, "name a text file", strict=True).split("\n")
    name, mark, first = "", PlanMark(), 0
    for row, line in enumerate(lines, start=1):
        start = _START.search(line)
        if start:
            name, mark, first = start[1], PlanMark.found_in(start[2] or "") or PlanMark(), row
    found: dict[int, RecordedPosition] = {}
    for row, line in enumerate(lines[first:], start=first + 1):
        report = _REPORT.search(line)
        if report is None:
            continue
        number = int(report[1])
        if report[2] is None or not report[3]:
            refuse(f"POSE {number} has no whole list of joints", path, row, "save the log again")
        parts = [part.strip() for part in report[2].split(",")]
        values = np.degrees(six(parts, f"POSE {number}", MOST_JOINT_RAD, path, row))
        if number < 1:
            refuse("poses are counted from 1", path, row)
        earlier = found.get(number)
        if earlier is not None and earlier.shown_deg is not None:
            if np.array_equal(earlier.shown_deg, values):
                continue
            reason = f"POSE {number} is reported twice in one run, with other joints"
            refuse(reason, path, row, f"which is right? the other is on line {earlier.line}")
        found[number] = RecordedPosition(number, "", row, values)
    if not found:
        refuse("the last run in it reports no POSE", path, first or None, "save the log of a run")
    return RecordedProgram(name or Path(path).stem, "", mark, tuple(found.values()), "ur")
