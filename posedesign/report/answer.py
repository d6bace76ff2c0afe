"""What a step answers, for people: the verdict and the one figure first, tables on request.

The same parts stand on a terminal and in a report; none of them names an option of a command.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.identification import ExpectedError

WIDTH = 100
"""Columns of a terminal that most people have."""

MOST_LINES = 12
"""Lines of an answer: what is read at a glance."""

MOST_ROWS = 3
"""Of them for one thing."""

_CUT = " ..."


@dataclass(frozen=True)
class Table:
    """Rows under a title; the columns are those of the first row."""

    title: str
    rows: Sequence[Mapping[str, object]]


@dataclass(frozen=True)
class Line:
    """A line of an answer: what it is, and what it says.

    ``what`` is ``warning``, ``not checked`` or ``note`` for remarks; else a word such as ``tool
    point``, or empty for a whole sentence.
    """

    what: str
    text: str

    @property
    def is_remark(self) -> bool:
        """Whether it stays where a program reads the result."""
        return self.what in ("warning", "not checked", "note")

    @property
    def goes_with_result(self) -> bool:
        """Whether it stands where the result stands: what was not checked has to."""
        return self.what not in ("warning", "note")

    def wrapped(self, shown: Callable[[str], str] = str) -> list[str]:
        """As it is printed, in lines of at most `WIDTH` columns; no word is cut.

        ``shown`` makes text of files of others fit to be printed.
        """
        lines = textwrap.wrap(
            shown(f"{self.what}: {self.text}" if self.what else self.text),
            WIDTH,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        return lines or [""]

    def cut(self) -> Line:
        """The same in at most `MOST_ROWS` lines, ended by dots where it was longer."""
        rows = textwrap.wrap(self.text, WIDTH - len(self.what) - 4, break_long_words=False)
        if len(rows) <= MOST_ROWS:
            return self
        return Line(self.what, " ".join(rows[:MOST_ROWS]) + _CUT)

    @property
    def is_cut(self) -> bool:
        """Whether it was longer."""
        return self.text.endswith(_CUT)

    @property
    def height(self) -> int:
        """Lines that it takes."""
        return len(self.wrapped())


@dataclass(frozen=True)
class Answer:
    """What a step found, the most important first."""

    verdict: str  # whether it did what was asked for, in a sentence
    figures: Mapping[str, str]  # what matters most, by its name: ``{"tool point": "0.14 mm rms"}``
    warnings: Sequence[str] = ()  # what may be wrong with it, the most important first
    not_checked: Sequence[str] = ()  # what nobody looked at
    notes: Sequence[str] = ()  # what is good to know of the cell and the files
    details: Sequence[str] = ()  # more of the result, for who asks for the tables
    tables: Sequence[Table] = ()
    files: Sequence[str] = ()  # paths that were written
    then: str = ""  # the next command
    first: str = ""  # what is to be said before all else: that a robot was simulated

    def all_lines(self) -> list[Line]:
        """Everything but the tables."""
        lines = [*self._begin(), *(line for kind in self._kinds() for line in kind)]
        return [*lines, *(Line("", text) for text in self.details), *self._end()]

    def short(self, more: str) -> list[Line]:
        """What fits into `MOST_LINES`; ``more`` says how to see what does not.

        The verdict, the first warning, the first thing not checked, the files and the next command
        are always there; of the rest as much as fits: the first figure, then the other warnings,
        notes last. What is long is cut off, and counted with what is left out.
        """
        first, last = self._begin(), self._end(cut=True)
        kinds = [[line.cut() for line in kind] for kind in self._kinds()]
        figures, warnings, unchecked, notes = kinds
        always = [*warnings[:1], *unchecked[:1]]
        # what may be wrong comes before what is good to know
        rest = (*warnings[1:], *unchecked[1:], *figures[1:], *notes)
        turns = [*always, *figures[:1], *rest]
        room = MOST_LINES - sum(line.height for line in (*first, *last))
        if any(line.is_cut for line in (*turns, *last)) or sum(x.height for x in turns) > room:
            room -= 1
            chosen = []
            for line in turns:
                if line in always or line.height <= room:
                    chosen.append(line)
                    room -= line.height
            left = len(turns) - len(chosen)
            shortened = sum(line.is_cut for line in (*chosen, *last))
            last = [Line("more", f"{left + shortened} more to know: {more}"), *last]
            turns = chosen
        return [*first, *(line for kind in kinds for line in kind if line in turns), *last]

    def _begin(self) -> list[Line]:
        return [Line("", text) for text in (self.first, self.verdict) if text]

    def _kinds(self) -> tuple[list[Line], ...]:
        return (
            [Line(what, text) for what, text in self.figures.items() if text],
            [Line("warning", text) for text in self.warnings],
            [Line("not checked", text) for text in self.not_checked],
            [Line("note", text) for text in self.notes],
        )

    def _end(self, *, cut: bool = False) -> list[Line]:
        """The files, and the next command, which is always whole."""
        files = [Line("wrote", ", ".join(self.files))] if self.files else []
        return [line.cut() if cut else line for line in files] + (
            [Line("next", self.then)] if self.then else []
        )


EXPECTED_ERROR = "expected error"
"""Label of one figure in all answers, pages and figures: the root mean square distance of the tool
point from where the calibrated robot takes it to be, where the arm will work, the base placed
anew."""


def expected_words(expected: ExpectedError, where: str) -> str:
    """An error to expect before measuring, with its range over arms."""
    return (
        f"{1e3 * expected.rms_m:.3g} mm rms over {where}; {expected.share:.0%} of such arms "
        f"{1e3 * expected.low_m:.2g} to {1e3 * expected.high_m:.2g} mm"
    ).replace("%", " %")
