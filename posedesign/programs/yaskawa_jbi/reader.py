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
positions in a frame that moves, lost lines, steps that are no INFORM and name a position.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import NoReturn

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.programs.configurations import YaskawaConfiguration
from posedesign.programs.language import Statement, nodes
from posedesign.programs.numbering import Announced
from posedesign.programs.reading import MOST_JOINT_DEG, pose_values, poses_of, refuse, text_of
from posedesign.programs.recorded import RecordedPosition, RecordedProgram
from posedesign.programs.rules import near
from posedesign.programs.yaskawa_jbi import inform
from posedesign.programs.yaskawa_jbi.inform import INSTRUCTIONS, Job, Name, Stored, label_of
from posedesign.programs.yaskawa_jbi.pulses import AXES, checked, found_in

_WHOLE = re.compile(r"[-+]?\d{1,10}", re.ASCII)
_FRAME = re.compile(r"\d{1,3}", re.ASCII)
_NAMED = re.compile(r"(?<![\w#$])(?:C|BC|EC|P|BP|EX)\d{1,5}(?!\w)", re.ASCII)
_BASE_FRAMES = ("BASE", "ROBOT")
"""The frame on the robot's foot; they differ where a base axis carries the robot, whose positions
are then in BC variables."""

_configuration = lru_cache(maxsize=64)(YaskawaConfiguration.parse)
"""A job has few different ones."""


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
    hint = "name a job saved by the controller, .JBI"
    # comments may be in any language: positions and instructions are in ASCII
    job = inform.read_job(text_of(data, path, hint, strict=True))
    for problem in inform.faults_of(job):
        if problem.level == "error":
            refuse(problem.message, path, problem.line, hint)
    reader = _Reader(job, path, pulses_per_deg)
    name = next((s.word("TEXT") for s in job.head if s.kind == "name"), "")
    if not name:
        refuse("has no name behind //NAME", path, job.marks[0].row)
    for statement in job.inst:
        reader.take(statement)
    reader.announced.end()
    positions = reader.positions()
    if not positions:
        refuse("holds no positions", path, job.marks[1].row, "save the job that was touched up")
    comment = next((s.word("TEXT").strip() for s in job.kinds["comm"]), "")
    mark, untouched = reader.announced.mark, reader.untouched
    return RecordedProgram(name, comment, mark, positions, "yaskawa", empty_registers=untouched)


class _Reader:
    """Collects what the steps say of the positions, and then reads those."""

    def __init__(self, job: Job, path: Path | str, given: tuple[float, ...]) -> None:
        self.stored = {stored.name: stored for stored in job.stored}
        self.path, self.given = path, given
        self.announced = Announced(path)
        self.ratios: dict[str, float] = {}  # pulses/deg of the axes
        self.used: set[Name] = set()
        self.other_robot: set[Name] = set()
        self.kept: dict[Name, Name] = {}  # the variable that a position was stored in
        self.axes: dict[Name, tuple[int, list[Name]]] = {}  # line, base and station variables
        self._at: Name | None = None
        self._ratios: tuple[float, ...] = ()

    @property
    def untouched(self) -> bool:
        """Whether steps store positions in variables, and none of these is in the file."""
        return bool(self.kept) and not set(self.kept.values()) & self.stored.keys()

    def refuse(self, message: str, row: int, hint: str = "save the job again") -> NoReturn:
        refuse(message, self.path, row, hint)

    def take(self, statement: Statement) -> None:
        """Take one more step."""
        kind = statement.kind
        if kind == "comment":
            self._comment(statement.text[1:].strip(), statement.row)
        elif kind == "move":
            self._move(statement)
        elif kind == "also":
            self.other_robot.update(inform.names_in(statement.tree))
        elif kind == "gets" and self._at is not None and statement.word("SYSTEM") == "$PX000":
            place = statement.word("VARIABLE")
            if place.startswith("PX"):
                self.kept[self._at] = ("P", int(place[2:7]))
        elif kind in ("fault", "other") and _NAMED.search(statement.text):
            fault = statement.fault
            if kind == "other" and near(statement.word("WORD"), INSTRUCTIONS):
                fault = f"{statement.word('WORD')!a} is no instruction"
            if fault:
                self.refuse(fault, statement.row, "is it a move?")

    def _comment(self, text: str, row: int) -> None:
        ratio = found_in(text)
        if ratio:
            axis, value = ratio
            if self.ratios.setdefault(axis, value) != value:
                self.refuse(f"says the pulses/deg of {axis} twice", row)
        else:
            self.announced.take(text, row)

    def _move(self, statement: Statement) -> None:
        names = inform.names_in(statement.tree)
        others = [n for also in nodes(statement.tree, "also") for n in inform.names_in(also)]
        self.other_robot.update(name for name in others if name[0] in "CP")
        for name in names:
            if "C" in name[0] and name not in self.stored:
                self.refuse(f"{label_of(name)} is moved to, but not there", statement.row)
        at = self._at = next((name for name in names if name[0] in "CP"), None)
        if at is None:
            self.announced.end()
            return
        self.used.add(at)
        self.axes[at] = (statement.row, [name for name in names + others if name[0] not in "CP"])
        self.announced.move(at, label_of(at))

    def positions(self) -> tuple[RecordedPosition, ...]:
        """All that the robot moves to, with its own C variables."""
        untouched = self.untouched
        source = {name: name if untouched else self.kept.get(name, name) for name in self.stored}
        wanted = [
            name
            for name in self.stored
            if source[name] in self.stored
            and (name in self.used or (name[0] == "C" and name not in self.other_robot))
        ]
        self._check_carriers(wanted)
        taken = [self.stored[source[name]] for name in wanted]
        values = [self._values(stored) for stored in taken if stored.form != "PULSE"]
        poses = iter(poses_of(values))
        # without any comment, that of the variable
        usual = {(kind, n): (n + 1, "") for kind, n in wanted if kind == "C"}
        numbers = self.announced.numbered([(name, "") for name in wanted], usual)
        return tuple(
            self._position(*number, stored, None if stored.form == "PULSE" else next(poses))
            for number, stored in zip(numbers, taken, strict=True)
        )

    def _position(
        self, number: int, name: str, stored: Stored, T_user_tool: FloatArray | None
    ) -> RecordedPosition:
        tool = self._frame("TOOL", stored.tool.split(",")[0], stored.row)
        row = stored.row
        if T_user_tool is None:
            joints = self._joints_deg(stored)
            return RecordedPosition(number, name, row, shown_deg=joints, tool_frame=tool)
        user = self._frame("USER", stored.user, row)
        if stored.frame == "USER" and user is None:
            self.refuse(f"{stored.label} is in a user frame, and no ///USER says which", row)
        if stored.frame not in ("USER", *_BASE_FRAMES):
            reason = f"{stored.label} is in the frame {stored.frame[:20]!a}"
            self.refuse(reason, row, "store it in pulses, or in the base or a user frame")
        try:
            configuration = _configuration(stored.rconf)
        except InputError as error:
            said = f"{stored.label}: {error.message}"
            what = said if stored.rconf else f"{stored.label} has no ///RCONF above"
            self.refuse(what, row, error.hint)
        user = user if stored.frame == "USER" else 0
        # the base frame is the controller's world, whatever the cell's frame
        world = None if user else np.eye(4)
        return RecordedPosition(
            number, name, row, None, T_user_tool, configuration, user, tool, T_world_user=world
        )

    def _frame(self, word: str, text: str, row: int) -> int | None:
        if text and not _FRAME.fullmatch(text):
            self.refuse(f"///{word} {text[:30]!a} is not a number", row)
        return int(text) if text else None

    def _six(self, stored: Stored) -> tuple[str, ...]:
        if len(stored.values) != len(AXES):
            reason = f"{stored.label} has {len(stored.values)} values, a six-axis arm six"
            self.refuse(reason, stored.row, "is this the job of another robot?")
        return stored.values

    def _values(self, stored: Stored) -> list[float]:
        """X, Y, Z [mm], Rx, Ry, Rz [deg]."""
        names = ("X", "Y", "Z", "Rx", "Ry", "Rz")
        return pose_values(self._six(stored), names, stored.label, self.path, stored.row)

    def _joints_deg(self, stored: Stored) -> FloatArray:
        values = []
        self._ratios = self._ratios or self._all_ratios(stored.row)
        for axis, text, ratio in zip(AXES, self._six(stored), self._ratios, strict=True):
            if not _WHOLE.fullmatch(text):
                reason = f"{stored.label}: {axis} is {text[:30]!a}, not a whole number"
                self.refuse(reason, stored.row)
            values.append(int(text) / ratio)
            if abs(values[-1]) > MOST_JOINT_DEG:
                reason = f"{stored.label}: {axis} is {text} pulses, {values[-1]:.0f} deg"
                self.refuse(reason, stored.row, "are the pulses/deg those of this arm?")
        return np.array(values)

    def _all_ratios(self, row: int) -> tuple[float, ...]:
        """Pulses/deg of the job, or those given; they must not contradict each other."""
        missing = [axis for axis in AXES if axis not in self.ratios]
        if missing and self.ratios:
            self.refuse(f"the comment 'PULSES {missing[0]} is lost", row, "put it back")
        if missing and not self.given:
            self.refuse(
                "positions are in encoder pulses, and the job does not say how many are a degree",
                row,
                "give the six of S L U R B T as pulses_per_deg (of the cell's program, or of "
                "YaskawaJbi), or in comments like 'PULSES S 1638.4 of the job; they stand in the "
                "controller's parameter file",
            )
        if missing:
            return self.given
        try:
            ratios = checked([self.ratios[axis] for axis in AXES])
        except InputError as error:
            self.refuse(error.message, row, error.hint)
        if self.given and not np.allclose(ratios, self.given, rtol=1e-6, atol=0.0):
            self.refuse(
                "the pulses/deg of its comments are not those given", row, "which are right?"
            )
        return ratios

    def _check_carriers(self, wanted: list[Name]) -> None:
        """Refuse poses between which a base axis or a station moves: it carries arm or target."""
        announced = self.announced.found
        first: list[tuple[str, object]] | None = None
        for name in wanted:
            if name not in self.axes or (announced and name not in announced):
                continue
            row, axes = self.axes[name]
            values: list[tuple[str, object]] = [
                (axis[0], self.stored[axis].values if axis in self.stored else axis)
                for axis in axes
            ]
            first = values if first is None else first
            if values != first:
                reason = "base or station axes stand elsewhere than at the poses before"
                self.refuse(reason, row, "measure with these axes at rest")
