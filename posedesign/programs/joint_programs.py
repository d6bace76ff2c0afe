"""Programs of joint positions in one file: what dialects of such programs share."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.language import Language, Statement, lines_of
from posedesign.programs.program import Form, PoseProgram, ProgramOptions
from posedesign.programs.reading import MOST_JOINT_DEG, carried_off, joint_deg, refuse, text_of
from posedesign.programs.recorded import (
    Level,
    PlanMark,
    Problem,
    RecordedPosition,
    RecordedProgram,
)
from posedesign.programs.rules import CONTROL, check_bytes, near, told
from posedesign.programs.writing import (
    Limits,
    Phrases,
    check_call,
    plain,
    plain_all,
    shown_deg,
    title_lines,
)

TEXT_LENGTH = 100
"""Characters of a remark: lines have at most 127 on the oldest controllers."""

JOINTS = 6
"""Of an arm; values behind them are of axes that carry it, or a part."""

LIMITS = Limits(TEXT_LENGTH, TEXT_LENGTH, begins=("POSE ", "PLAN "), settle_s=1e4)
"""Outputs are of each language."""

LEAST_S = 0.1
"""Shortest time that is waited: in it the arm comes to a stop, and an input sees a pulse."""

USUAL_SPEED_RAD_S = np.pi / 2
"""Joint speed of 100 percent where the robot is not known: no arm's slowest joint is far slower."""

PLAIN = re.compile(r"-?(\d+(\.\d*)?|\.\d+)")
"""A number as it stands in a program."""

_NOTE = re.compile(r"POSE (\d{1,6})(?: (.*))?")


def _speed(arm: Arm, options: ProgramOptions) -> str:
    """So many percent of the speed of the slowest joint [deg/s]."""
    known = arm.robot.speed[np.isfinite(arm.robot.speed)] if arm.robot is not None else ()
    slowest = np.degrees(min(known, default=USUAL_SPEED_RAD_S))
    return plain(max(slowest * options.speed_percent / 100, 0.01), 2)


class JointDialect(Dialect, ABC):
    """A dialect of joint positions in one file.

    Attributes
    ----------
    phrases : Phrases
        Moves are of ``name``, ``number``, ``target``, joints [deg], ``percent``, ``speed`` [deg/s].
    head : tuple of str
        Steps behind the first remarks, of ``name``, ``percent``, ``speed``.
    most_output : int
        Largest number of an output.
    """

    forms: ClassVar[tuple[Form, ...]] = ("joint",)
    keeps: ClassVar[bool] = False
    phrases: ClassVar[Phrases]
    head: ClassVar[tuple[str, ...]] = ()
    most_output: ClassVar[int] = 4096

    def most_poses(self, program: PoseProgram) -> int | None:
        """Longer programs are split: up to nine steps a pose, whose numbers have four digits."""
        return 1000

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """Text of the file; InputError for what cannot stand in it."""
        check_call(self.names, program.options, program.name)
        replace(LIMITS, outputs=(1, self.most_output)).check(program)
        lines = self.lines(program, arm, list(self._steps(program, arm)))
        return {f"{program.name}{self.suffixes[0]}": "\n".join([*lines, ""])}

    @abstractmethod
    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """Lines of the file of these steps."""

    def _steps(self, program: PoseProgram, arm: Arm) -> Iterator[str]:
        options, phrases = program.options, replace(self.phrases, least_s=LEAST_S, always=True)
        for note in title_lines(program, TEXT_LENGTH):
            yield phrases.note.format(note)
        percent, speed = options.speed_percent, _speed(arm, options)
        own = {"name": program.name, "percent": percent, "speed": speed}
        yield from (line.format(**own) for line in self.head)
        joints = (", ".join(plain_all(row, 6)) for row in shown_deg(arm, program.poses))
        yield from phrases.visit(program, LIMITS, joints, **own)


@dataclass
class Notes:
    """What the remarks of a program say of its plan."""

    mark: PlanMark | None = None  # None: it is of no plan
    names: dict[int, str] = field(default_factory=dict)  # names of poses by number
    rows: dict[int, int] = field(default_factory=dict)
    """Lines of the remarks that name them, and the numbers."""

    def take(self, row: int, text: str) -> None:
        """Take what a remark says."""
        self.mark = self.mark or PlanMark.found_in(text)
        found = _NOTE.fullmatch(text.strip()) if self.mark else None
        if found:
            self.names[int(found[1])] = found[2] or ""
            self.rows[row] = int(found[1])


def joints_of(label: str, row: int, texts: Sequence[str], path: Path) -> FloatArray:
    """Joint values ``(6,)`` [deg] as they stand in a file; FileFormatError where they do not."""
    if len(texts) < JOINTS:
        refuse(f"{label} has {len(texts)} values", path, row)
    return np.array([joint_deg(text, label, path, row) for text in texts[:JOINTS]])


Found = tuple[str, int, Sequence[str]]
"""What to call a position, its line, and the texts of its values."""


def carried_in(found: Sequence[Found], path: Path) -> dict[str, dict[int, FileFormatError]]:
    """Positions in which axes behind the arm's have moved, by label; refuses a file without any."""
    if not found:
        refuse("holds no positions", path, None, "save the program with its positions")
    values = [
        (label, f"axis {j}", text, row)
        for label, row, texts in found
        for j, text in enumerate(texts[JOINTS:], start=JOINTS + 1)
    ]
    return carried_off(values, path)


def in_moves(
    find: Callable[[str, Path], list[Found]],
    remark: str,
    maker: str,
    code: Callable[[str], str] = str,
) -> Callable[[bytes, Path], RecordedProgram]:
    """A reader of programs in whose moves the positions stand: ``find`` gives them in their order.

    The first behind a remark of a pose has its number; others come behind all that are planned.
    Remarks begin with the mark ``remark``; ``code`` is what of a text is read.
    """

    def read(data: bytes, path: Path) -> RecordedProgram:
        text = code(text_of(data, path))
        notes = Notes()
        for line in lines_of(text):
            if line.text[: len(remark)] == remark:
                notes.take(line.row, line.text[len(remark) :])
        found = find(text, path)
        for fault in (e for errors in carried_in(found, path).values() for e in errors.values()):
            raise fault
        mark = notes.mark or PlanMark()
        rows, free = sorted(notes.rows), max([*notes.names, mark.measured or 0])
        chosen: dict[int, RecordedPosition] = {}
        above = -1
        for label, row, texts in found:
            last, above = above, bisect_left(rows, row) - 1
            own = notes.rows[rows[above]] if above > last else 0
            free += not own
            if own in chosen:
                refuse(f"pose {own} is there twice", path, row)
            shown = joints_of(label, row, texts, path)
            chosen[own or free] = RecordedPosition(
                own or free, notes.names.get(own, ""), row, shown
            )
        positions = tuple(position for _, position in sorted(chosen.items()))
        return RecordedProgram(path.stem, "", mark, positions, maker)

    return read


@dataclass
class Standing:
    """Whether the arm stands, and for how long, where a step begins."""

    words: tuple[str, str]  # what a language calls the stop and the wait
    moves: bool = False
    waited: bool = True

    def check(
        self, row: int, moves: bool, stops: bool, waits: bool, measures: bool
    ) -> Iterator[Problem]:
        """Problems of a step that does these."""
        if self.moves and (moves or measures):
            reason = f"no {self.words[0]} since the last move"
            yield Problem(row, "standstill", reason, "measuring")
        elif measures and not self.waited:
            reason = f"no {self.words[1]} since the last move"
            yield Problem(row, "wait-to-measure", reason, "measuring")
        if moves:
            self.waited = False
        self.moves = (self.moves or moves) and not stops
        self.waited = self.waited or waits


def check_joints(row: int, values: Sequence[str], most: int = JOINTS) -> Iterator[Problem]:
    """Whether these are the joint values of a position: six plain numbers, or up to so many."""
    plain = [float(value[:99]) for value in values if PLAIN.fullmatch(value)]
    if len(plain) != len(values) or not JOINTS <= len(plain) <= most:
        yield Problem(row, "position", f"{len(plain)} plain numbers of {len(values)} values")
    if any(abs(value) > MOST_JOINT_DEG for value in plain[:JOINTS]):
        yield Problem(row, "range", f"a joint is beyond +-{MOST_JOINT_DEG:g} deg")


def level_of(word: str, known: str, others: str) -> Level:
    """Of a step that cannot be read: error where its word is one of a grammar's, or nearly.

    ``others`` are those of options and of other instructions that are near to one.
    """
    words = known.split()
    if word in others.split():
        return "note"
    return "error" if not word or word in words or near(word, words) else "note"


def judged(
    language: Language,
    kinds: tuple[str, ...],
    check: Callable[[list[Statement]], Iterator[Problem]],
) -> Callable[[bytes, Path], list[Problem]]:
    """The rules of files that are checked by their statements; one of these kinds is a program."""

    def problems(data: bytes, path: Path) -> list[Problem]:
        statements = language.statements(data.decode("latin-1").replace("\r", ""))
        if not any(s.kind in kinds for s in statements):
            return [Problem(1, "syntax", f"there is no {' and no '.join(kinds)} in it")]
        return told(check(statements), check_bytes(data, CONTROL))

    return problems
