"""Programs of joint positions in one file: what dialects of such programs share."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from calib.errors import FileFormatError, InputError
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.language import Language, Line, Statement, lines_of
from posedesign.programs.numbering import Named, Numbering
from posedesign.programs.program import Form, PoseProgram, ProgramOptions
from posedesign.programs.reading import (
    MOST_JOINT_DEG,
    carried_off,
    joint_deg,
    no_positions,
    refuse,
    text_of,
)
from posedesign.programs.recorded import Level, PlanMark, Problem, RecordedPosition, RecordedProgram
from posedesign.programs.rules import CONTROL, check_bytes, near, told
from posedesign.programs.signatures import Argument, Signature
from posedesign.programs.straight_line import Event, Values, follow
from posedesign.programs.writing import Limits, Phrases, plain, plain_all, shown_deg

TEXT_LENGTH = 100  # characters of a remark: lines have at most 127 on the oldest controllers
JOINTS = 6  # of an arm; values behind them are of axes that carry it, or a part
LIMITS = Limits(TEXT_LENGTH, TEXT_LENGTH, begins=("POSE ", "PLAN "), settle_s=1e4)
"""Outputs are of each language."""

LEAST_S = 0.1
"""Shortest time that is waited: in it the arm comes to a stop, and an input sees a pulse."""

USUAL_SPEED_RAD_S = np.pi / 2
"""Joint speed of 100 percent where the robot is not known: no arm's slowest joint is far slower."""

PLAIN = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)")  # a number as it stands in a program
_NOTE = re.compile(r"POSE (\d{1,6})(?: (.*))?")


def _speed(arm: Arm, options: ProgramOptions) -> str:
    """So many percent of the speed of the slowest joint [deg/s]."""
    slowest = np.degrees(arm.slowest_rad_s(USUAL_SPEED_RAD_S))
    return plain(max(slowest * options.speed_percent / 100, 0.01), 2)


class JointDialect(Dialect, ABC):
    """A dialect of joint positions in one file.

    Attributes
    ----------
    phrases : Phrases
        Moves are of ``name``, ``number``, ``target``, joints as in the notation, ``percent``,
        ``speed`` [deg/s].
    head : tuple of str
        Steps behind the first remarks, of ``name``, ``percent``, ``share`` (of 1), ``speed``.
    """

    forms: ClassVar[tuple[Form, ...]] = ("joint",)
    keeps: ClassVar[bool] = False
    phrases: ClassVar[Phrases]
    head: ClassVar[tuple[str, ...]] = ()
    limits = LIMITS

    def most_poses(self, program: PoseProgram) -> int | None:
        """Longer programs are split: up to nine steps a pose, whose numbers have four digits."""
        return 1000

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        lines = self.lines(program, arm, list(self._steps(program, arm)))
        return {f"{program.name}{self.suffixes[0]}": "\n".join([*lines, ""])}

    @abstractmethod
    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """Lines of the file of these steps."""

    def _steps(self, program: PoseProgram, arm: Arm) -> Iterator[str]:
        options, phrases = program.options, replace(self.phrases, least_s=LEAST_S, always=True)
        for note in writing.title_lines(program, TEXT_LENGTH):
            yield phrases.note.format(note)
        percent, speed = options.speed_percent, _speed(arm, options)
        own = {"name": program.name, "percent": percent, "speed": speed}
        own |= {"share": plain(percent / 100, 2)}
        yield from (line.format(**own) for line in self.head)
        values = shown_deg(arm, program.poses) * self.notation.joint_units
        joints = (", ".join(plain_all(row, self.notation.joint)) for row in values)
        yield from phrases.visit(program, LIMITS, joints, **own)


SIGNS = "signs, zeros and couplings of the joints, which are those of the robot's description"


class DescribedDialect(JointDialect, ABC):
    """A dialect of a maker of whose arms no convention is known: joints are the description's.

    ``counts``: numbers of joints that its arms have.
    """

    maker = None
    counts: ClassVar[tuple[int, ...]] = (JOINTS,)

    def unchecked(self, arm: Arm) -> tuple[str, ...]:
        """What the joints count."""
        return (SIGNS,)

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file; the arm has as many joints as those of the maker."""
        if arm.n not in self.counts:
            least, most = self.counts[0], self.counts[-1]
            said = f"{least} to {most}" if least < most else f"{most}"
            raise InputError(
                f"arms that {self.name} moves have {said} joints, this one {arm.n}",
                hint="write the language of its controller",
                name="poses",
                value=arm.n,
            )
        return super().render(program, arm)


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


@dataclass(eq=False)
class Stored(Named):
    """A position as it stands in a file; in moves they have no names."""

    values: Sequence[str]  # texts of its numbers


def carried_in(
    found: Sequence[Stored], path: Path, most: int = JOINTS
) -> dict[str, dict[int, FileFormatError]]:
    """Positions in which axes behind the arm's have moved, by label; refuses a file without any."""
    if not found:
        no_positions(path, "save the program with its positions")
    values = [
        (p.label, f"axis {j}", text, p.line)
        for p in found
        for j, text in enumerate(p.values[most:], start=most + 1)
    ]
    return carried_off(values, path)


def joints_of(p: Stored, path: Path, least: int = JOINTS, most: int = JOINTS) -> dict[str, Any]:
    """Joint values [deg] as they stand in a file; FileFormatError where they do not."""
    if len(p.values) < least:
        refuse(f"{p.label} has {len(p.values)} values", path, p.line)
    shown = [joint_deg(text, p.label, path, p.line) for text in p.values[:most]]
    return {"shown_deg": np.array(shown)}


def listed(
    numbering: Numbering,
    found: Sequence[Stored],
    path: Path,
    values_of: Callable[[Stored, Path], dict[str, Any]],
    *,
    rest: bool = True,
) -> tuple[RecordedPosition, ...]:
    """Positions of a list by their numbers.

    ``values_of``: what `RecordedPosition` has of joint values, or of a pose. ``rest``: whether
    axes behind the arm's are told where they move.
    """
    there: set[str] = set()
    for p in found:
        if p.variable.upper() in there:
            refuse(f"{p.label} is there twice", path, p.line)
        there |= {p.variable.upper()} - {""}
    carried = carried_in(found, path) if rest else {}
    return tuple(
        RecordedPosition(
            *(n, p.name, p.line),
            **values_of(p, path),
            external_shown=tuple(map(float, p.values[JOINTS:])),
            carried=carried.get(p.label, {}),
        )
        for n, p in numbering.of(found, path)
    )


def as_moved(
    found: Sequence[Stored], events: Iterable[Event], path: Path
) -> tuple[list[Stored], list[FileFormatError]]:
    """Positions of a list with the values that they have when the program moves to them.

    One that has none then, or several, is left out, and said to be unread. Others that steps give
    values to, and move to, stand behind.
    """
    listed = {p.variable.upper().replace("(", "[").replace(")", "]"): p for p in found}
    known: dict[str, Values | None] = {
        n: Values(p.line, tuple(p.values)) for n, p in listed.items()
    }
    moved: dict[str, Values] = {}
    lost: dict[str, FileFormatError] = {}
    for at in follow(events, known):
        several = at.values and moved.setdefault(at.name, at.values).texts != at.values.texts
        if at.values is None or several:
            reason = at.fault or f"{at.name} has several values where the program moves to it"
            hint = "give it one, or teach it"
            lost.setdefault(at.name, FileFormatError(reason, path=path, row=at.row, hint=hint))
    out = [
        Stored(p.variable, moved[n].row, moved[n].texts) if n in moved else p
        for n, p in listed.items()
        if n not in lost
    ]
    told = listed.keys() | lost
    out += [Stored(n, v.row, v.texts) for n, v in moved.items() if n not in told]
    for error in lost.values() if not out else ():
        raise error
    return out if len(listed) == len(found) else list(found), [*lost.values()]


def in_moves(
    events: Callable[[str], Iterable[Event]],
    remarks: Callable[[str], Iterable[Line]],
    maker: str | None,
    least: int = JOINTS,
    most: int = JOINTS,
) -> Callable[[bytes, Path], RecordedProgram]:
    """A reader of programs in whose moves the positions stand.

    The first behind a remark of a pose has its number; others come behind all that are planned.
    Moves of which the text does not tell where they go are said to be unread.

    Parameters
    ----------
    events : callable
        What the steps of a text do.
    remarks : callable
        Remarks of a text that are lines of their own.
    maker : str or None
        Whose controllers run the programs; None: joints are those of the description.
    least, most : int
        Joints of an arm; values behind them are of axes that carry it, or a part.
    """

    def read(data: bytes, path: Path) -> RecordedProgram:
        text = text_of(data, path)
        notes = Notes()
        for line in remarks(text):
            notes.take(line.row, line.text)
        found: list[Stored] = []
        unread: list[FileFormatError] = []
        for at in follow(events(text)):
            if at.values is None:
                hint = "move to a list of numbers"
                unread.append(FileFormatError(at.fault, path=path, row=at.row, hint=hint))
            else:
                found.append(Stored("", at.row, at.values.texts))
        for error in unread if not found else ():
            raise error
        for fault in (
            e for errors in carried_in(found, path, most).values() for e in errors.values()
        ):
            raise fault
        mark = notes.mark or PlanMark()
        rows, free = sorted(notes.rows), max([*notes.names, mark.measured or 0])
        chosen: dict[int, RecordedPosition] = {}
        above = -1
        for p in found:
            last, above = above, bisect_left(rows, p.line) - 1
            own = notes.rows[rows[above]] if above > last else 0
            free += not own
            if own in chosen:
                refuse(f"pose {own} is there twice", path, p.line)
            chosen[own or free] = RecordedPosition(
                *(own or free, notes.names.get(own, ""), p.line), **joints_of(p, path, least, most)
            )
        positions = tuple(position for _, position in sorted(chosen.items()))
        return RecordedProgram(path.stem, "", mark, positions, maker, unread=tuple(unread))

    return read


def remark_lines(begin: str) -> Callable[[str], Iterator[Line]]:
    """Find the lines of a text that are remarks, without what remarks begin with."""

    def remarks(text: str) -> Iterator[Line]:
        for line in lines_of(text):
            if line.text.startswith(begin):
                yield Line(line.row, line.text[len(begin) :])

    return remarks


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
            yield Problem(row, "standstill", f"no {self.words[0]} since the last move", "measuring")
        elif measures and not self.waited:
            reason = f"no {self.words[1]} since the last move"
            yield Problem(row, "wait-to-measure", reason, "measuring")
        if moves:
            self.waited = False
        self.moves = (self.moves or moves) and not stops
        self.waited = self.waited or waits


def check_joints(
    row: int, values: Sequence[str], most: int = JOINTS, least: int = JOINTS
) -> Iterator[Problem]:
    """Whether these are the joint values of a position: so many plain numbers."""
    plain = [float(value[:99]) for value in filter(PLAIN.fullmatch, values)]
    if len(plain) != len(values) or not least <= len(plain) <= most:
        yield Problem(row, "position", f"{len(plain)} plain numbers of {len(values)} values")
    far = [k for k, value in enumerate(plain[:JOINTS], start=1) if abs(value) > MOST_JOINT_DEG]
    if far:
        yield Problem(row, "range", f"joint {far[0]} is beyond +-{MOST_JOINT_DEG:g} deg")


def check_step(
    row: int, table: Mapping[str, Signature], step: str, texts: Iterable[str]
) -> Iterator[Problem]:
    """Whether a step is given what it takes, as far as numbers and texts in quotes tell."""
    given = []
    for text in texts:
        kind = "number" if PLAIN.fullmatch(text) else "text" if text[:1] == '"' else ""
        given.append(Argument(text, "", kind, float(text[:99]) if kind == "number" else math.nan))
    yield from (Problem(row, rule, said) for rule, said in table[step].faults(given))


def level_of(word: str, known: str, others: str = "") -> Level:
    """Of a step that cannot be read: error where its word is one of a grammar's, or nearly.

    ``others`` are those of options and of other instructions that are near to one.
    """
    words = known.split()
    if word in others.split():
        return "note"
    return "error" if not word or word in words or near(word, words) else "note"


def not_known(s: Statement, word: re.Pattern[str], known: str, others: str) -> Problem:
    """Of a step that the grammar knows nothing of; ``word`` finds its first in small letters."""
    found = word.match(s.text.lower())
    level = level_of(found[1] if found else "", known, others)
    return Problem(s.row, "syntax", s.fault or f"{s.text[:40]!a} is not known", level)


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
