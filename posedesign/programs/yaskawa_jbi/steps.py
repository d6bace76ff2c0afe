"""Yaskawa INFORM jobs: what the instructions of a job say of its positions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark
from posedesign.programs.yaskawa_jbi.positions import PositionSection
from posedesign.programs.yaskawa_jbi.pulses import found_in

_POSE = re.compile(r"POSE\s+(\d{1,6})(?!\w)\s*(.*)", re.ASCII)
_MOVE = re.compile(r"MOV[JLCS]\b", re.ASCII)
_NAMED = re.compile(r"(?<![\w#$])(C|BC|EC|P|BP|EX)(\d{1,5})(?!\w)", re.ASCII)
_KEPT = re.compile(r"GETS\s+PX(\d{3,5})\s+\$PX000(?!\w)", re.ASCII)

Name = tuple[str, int]
"""Kind and number of a variable: ("C", 7) for C00007."""


@dataclass
class Steps:
    """What the instructions say of the positions.

    Attributes
    ----------
    mark : PlanMark
    ratios : dict
        Pulses/deg of the axes.
    used : dict
        Line of the first step to each position.
    other_robot : set
        Positions of steps of a second robot.
    poses : dict
        Number, name and line of the comment before the step to each position.
    kept : dict
        Variable that the position was stored in after the step to each position.
    axes : dict
        Line of the last step to each position, and its base and station variables.
    """

    mark: PlanMark = field(default_factory=PlanMark)
    ratios: dict[str, float] = field(default_factory=dict)
    used: dict[Name, int] = field(default_factory=dict)
    other_robot: set[Name] = field(default_factory=set)
    poses: dict[Name, tuple[int, str, int]] = field(default_factory=dict)
    kept: dict[Name, Name] = field(default_factory=dict)
    axes: dict[Name, tuple[int, tuple[Name, ...]]] = field(default_factory=dict)


class StepReader:
    """Goes through the instructions, one line at a time."""

    def __init__(self, section: PositionSection, path: Path | str) -> None:
        self.found = Steps()
        self.section = section
        self.path = path
        self._pose: tuple[int, str, int] | None = None
        self._at: Name | None = None

    def feed(self, line: str, row: int) -> None:
        """Take one more line, without the spaces around it."""
        if line.startswith("'"):
            self._comment(line[1:].strip(), row)
        elif _MOVE.match(line):
            self._move(line, row)
        elif self._at is not None:
            kept = _KEPT.match(line)
            if kept:
                self.found.kept[self._at] = ("P", int(kept[1]))

    def finish(self) -> None:
        """No comment of a pose may be left without its move."""
        if self._pose is not None:
            number, _, row = self._pose
            reason = f"POSE {number} is not followed by a move to a position"
            refuse(reason, self.path, row, "put the move back, or remove the comment")

    def _comment(self, text: str, row: int) -> None:
        pose = _POSE.fullmatch(text)
        ratio = found_in(text)
        if pose:
            self.finish()
            self._pose = (int(pose[1]), pose[2].strip(), row)
        elif ratio:
            axis, value = ratio
            if self.found.ratios.setdefault(axis, value) != value:
                refuse(f"says the pulses/deg of {axis} twice", self.path, row)
        elif text.startswith("PLAN") and not self.found.mark.fingerprint:
            self.found.mark = PlanMark.found_in(text) or self.found.mark

    def _move(self, line: str, row: int) -> None:
        own, _, others = line.partition("+")
        found = self.found
        found.other_robot.update((k, int(n)) for k, n in _NAMED.findall(others) if k in "CP")
        names = [(kind, int(number)) for kind, number in _NAMED.findall(own)]
        for kind, number in names:
            if kind in ("C", "BC", "EC") and (kind, number) not in self.section.variables:
                refuse(f"{kind}{number:05d} is moved to, but not there", self.path, row)
        targets = [key for key in names if key[0] in "CP"]
        self._at = targets[0] if targets else None
        if self._at is None:
            self.finish()
            return
        every = names + [
            (k, int(n)) for k, n in _NAMED.findall(others) if k in ("BC", "EC", "BP", "EX")
        ]
        found.used.setdefault(self._at, row)
        if self._pose is not None:
            self._name(self._at, self._pose)
            self._pose = None
        found.axes[self._at] = (row, tuple(key for key in every if key[0] not in "CP"))

    def _name(self, at: Name, pose: tuple[int, str, int]) -> None:
        number, _, row = pose
        other = self.found.poses.setdefault(at, pose)
        if other[0] != number:
            reason = f"{at[0]}{at[1]:05d} is the position of POSE {other[0]} and of POSE {number}"
            refuse(reason, self.path, row, "give each its own position")
        if number < 1:
            refuse("poses are counted from 1", self.path, row)
