"""Numbers of the positions of a file: of their names, or of comments above the moves."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.programs.reading import MOST_EXTERNAL, carried_off, number, refuse
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram


@dataclass(eq=False)
class Named:
    """Where a position stands in a file; ``other``: it is no numbered one of the program.

    ``variable`` is empty for one that stands in a motion instruction.
    """

    variable: str
    line: int
    name: str = field(default="", kw_only=True)
    other: bool = field(default=False, kw_only=True)
    fault: FileFormatError | None = field(default=None, kw_only=True)  # see `RecordedPosition`

    @property
    def label(self) -> str:
        """What to call it in messages."""
        return self.variable or "the position"


@dataclass(eq=False)
class Stored(Named, ABC):
    """A position with its values as they stand in a file."""

    @property
    @abstractmethod
    def cartesian(self) -> bool:
        """Whether it is a pose of the tool."""

    @property
    @abstractmethod
    def external(self) -> list[tuple[str, str, str, int]]:
        """Label, name, value and line of the external axes that it says something of."""

    @abstractmethod
    def numbers(self, path: Path | str) -> list[float]:
        """Joint values [deg], or what a pose is made of; FileFormatError where they are none."""

    @abstractmethod
    def details(self, path: Path | str) -> dict[str, Any]:
        """Arm position and frames, as `RecordedPosition` has them."""


P = TypeVar("P", bound=Named)

NO_NAME = re.compile(r"(?!)")  # of a program that numbers no positions, or has no such array
_POSE_NAME = re.compile(r"P(\d{1,6}) (.*)", re.ASCII)
_FIRST_REGISTER = re.compile(r"\w+[\[{](\d{1,6})[\]}] IS P(\d{1,6})\s*", re.ASCII)


@dataclass
class Numbering:
    """How a program numbers its positions, and what its comments say of them."""

    numbered: re.Pattern[str]  # of whole names with a number, which is its first group: ``XP3``
    element: re.Pattern[str] = NO_NAME
    """Of whole names of the elements of the array that keeps touched-up positions: ``XM[3]``."""
    mark: PlanMark | None = None  # the plan it was written from
    names: dict[int, str] = field(default_factory=dict)  # names of the planned poses by number
    first_register: tuple[int, int] | None = None
    """Element of the array, and number of the pose that it keeps; None: there is no array."""

    def take(self, remark: str) -> bool:
        """Take what a comment says, if it is of this."""
        named, register = _POSE_NAME.fullmatch(remark), _FIRST_REGISTER.fullmatch(remark)
        if named:
            self.names.setdefault(int(named[1]), named[2].strip())
        elif register:
            self.first_register = int(register[1]), int(register[2])
        elif remark.startswith("PLAN "):
            self.mark = self.mark or PlanMark.found_in(remark)
        else:
            return False
        return True

    def program(
        self,
        named: tuple[str, str, str],
        stored: Sequence[Stored],
        transforms: Callable[[list[list[float]]], FloatArray],
        path: Path | str,
        unread: Sequence[FileFormatError] = (),
    ) -> RecordedProgram:
        """The program of a name, a title and a maker, with all positions that are stored.

        ``transforms`` makes poses ``(N, 4, 4)`` [m] of their numbers; ``unread``: what is read of
        no position.

        What is no position is unread. Raises FileFormatError: there is no other.
        """
        name, title, maker = named
        numbered, values, details, lost = [], [], [], list(unread)
        for n, p in self.of(stored, path):
            try:
                given, more = p.numbers(path), p.details(path)
            except FileFormatError as error:
                lost.append(error)  # of this position alone
                continue
            numbered.append((n, p))
            values.append(given)
            details.append(more)
        for fault in lost if not numbered else ():
            raise fault
        own = [position for _, position in numbered if not position.other]
        rests = own or [p for _, p in numbered]
        carried = carried_off((axis for p in rests for axis in p.external), path)
        posed = [v for v, (_, p) in zip(values, numbered, strict=True) if p.cartesian]
        poses = iter(transforms(posed))
        positions = []
        for (n, p), given, more in zip(numbered, values, details, strict=True):
            of: dict[str, Any] = {}
            of["T_user_tool" if p.cartesian else "shown_deg"] = (
                next(poses) if p.cartesian else np.array(given)
            )
            of["carried"] = carried.get(p.label, {})  # of others it may be anywhere
            of["fault"] = p.fault
            of["external_shown"] = tuple(
                number(text, f"{label}: {axis}", path, row, MOST_EXTERNAL)
                for label, axis, text, row in p.external
            )
            positions.append(RecordedPosition(n, p.name, p.line, **of, **more))
        untouched = self.is_untouched(stored)
        mark = self.mark or PlanMark()
        return RecordedProgram(
            *(name, title, mark, tuple(positions), maker),
            empty_registers=untouched,
            unread=tuple(lost),
        )

    def of(self, positions: Sequence[P], path: Path | str) -> list[tuple[int, P]]:
        """Positions with their numbers, touched-up ones in the place of the planned ones.

        Those without a number come behind all others, and behind all that the plan measures: an
        operator's own position takes neither number nor name of a deleted one. Sets ``name`` and
        ``other`` of each.

        Raises FileFormatError: a touched-up position is that of no measured pose.
        """
        touched = self._touched(positions)
        kept = {id(position) for position in touched.values()}
        chosen = self._by_number([p for p in positions if id(p) not in kept], touched)
        measured = self.mark.measured if self.mark else None
        if touched:
            for n, position in touched.items():
                if n < 1 or (measured is not None and n > measured):
                    reason = f"{position.variable} is the place of no pose that is measured"
                    refuse(reason, path, position.line, "copy the file again")
            vias = [(n, p) for n, p in chosen if measured is not None and n > measured]
            chosen = sorted(touched.items()) + vias
        for n, position in chosen:
            own = touched.get(n) is position or self._number(position) == n
            position.other = bool(position.variable) and not own
            position.name = self.names.get(n, "") if own else position.variable
        return chosen

    def is_untouched(self, positions: Sequence[Named]) -> bool:
        """Whether there is an array for touched-up positions, and none in it."""
        return self.first_register is not None and not self._touched(positions)

    def _number(self, position: Named) -> int:
        """The number in a name; 0 for none."""
        found = self.numbered.fullmatch(position.variable)
        return int(found[1]) if found else 0

    def _touched(self, positions: Sequence[P]) -> dict[int, P]:
        """Touched-up positions in the array, by the numbers of their poses."""
        if self.first_register is None:
            return {}
        register, first = self.first_register
        found = ((self.element.fullmatch(p.variable), p) for p in positions)
        return {int(element[1]) - register + first: p for element, p in found if element}

    def _by_number(self, positions: Sequence[P], touched: Mapping[int, P]) -> list[tuple[int, P]]:
        """Positions by the number in their name, those without behind all others."""
        numbers: list[int] = []
        taken = {0}
        for position in positions:
            n = self._number(position)
            numbers.append(0 if n in taken else n)
            taken.add(n)
        free = max(taken | touched.keys() | self.names.keys())
        if self.mark is not None and self.mark.measured is not None:
            free = max(free, self.mark.measured)
        out = []
        for n, position in zip(numbers, positions, strict=True):
            free += n == 0
            out.append((n or free, position))
        return out


_ANNOUNCED = re.compile(r"POSE\s+(\d{1,6})(?!\w)\s*(.*)", re.ASCII)


@dataclass
class Announced:
    """Numbers and names that comments ``POSE 3 T07`` give to the positions of the moves behind.

    ``found`` has them by what tells a position from the others, ``keys`` that. ``waiting`` is a
    comment whose move has not come yet: number, name, line. ``mark`` is the plan's.
    """

    path: Path | str
    mark: PlanMark = field(default_factory=PlanMark)
    found: dict[Hashable, tuple[int, str]] = field(default_factory=dict)
    keys: dict[int, Hashable] = field(default_factory=dict)
    waiting: tuple[int, str, int] | None = None

    def take(self, remark: str, row: int) -> bool:
        """Take what a comment says of the next move, or of the plan."""
        pose = _ANNOUNCED.fullmatch(remark.strip())
        if pose:
            self.end()
            self.waiting = int(pose[1]), pose[2].strip(), row
        elif remark.lstrip().startswith("PLAN") and not self.mark.fingerprint:
            self.mark = PlanMark.found_in(remark) or self.mark
        return pose is not None

    def move(self, key: Hashable, label: str) -> None:
        """A move goes to a position."""
        if self.waiting is None:
            return
        number, name, row = self.waiting
        self.waiting = None
        if number < 1:
            refuse("poses are counted from 1", self.path, row)
        if self.keys.setdefault(number, key) != key:
            refuse(f"POSE {number} stands before two moves", self.path, row)
        before, _ = self.found.setdefault(key, (number, name))
        if before != number:
            reason = f"{label} is the position of POSE {before} and of POSE {number}"
            refuse(reason, self.path, row, "give each its own position")

    def end(self) -> None:
        """No comment of a pose may be left without its move."""
        if self.waiting is not None:
            reason = f"POSE {self.waiting[0]} is not followed by a move to a position"
            refuse(reason, self.path, self.waiting[2], "put it back, or remove the comment")

    def numbered(
        self, positions: Sequence[tuple[Hashable, str]], usual: Mapping[Any, tuple[int, str]]
    ) -> list[tuple[int, str]]:
        """Number and name of each of the positions, by key and own name; others behind all.

        ``usual`` are those of a file without any such comment.
        """
        found = {key: self.found[key] for key, _ in positions if key in self.found}
        last = self.mark.measured or 0 if found else 0
        found = found or dict(usual)
        last = max([last, *(number for number, _ in found.values())])
        out = []
        for key, name in positions:
            last += key not in found
            out.append(found.get(key, (last, name)))
        return out
