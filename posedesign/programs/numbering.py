"""Numbers of the positions of a file whose positions have names: shared by KUKA and ABB."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

from posedesign.programs.reading import refuse
from posedesign.programs.recorded import PlanMark


class Named(Protocol):
    """A position as it stands in a file; ``variable`` is empty for one without a name."""

    variable: str
    line: int
    name: str
    other: bool


P = TypeVar("P", bound=Named)


@dataclass(frozen=True)
class Numbering:
    """How a program numbers its positions, and what its comments say of them.

    Attributes
    ----------
    numbered : pattern
        Of whole names with a number, which is its first group: ``XP3``.
    element : pattern
        Of whole names of the elements of the array that keeps touched-up positions: ``XM[3]``.
    mark : PlanMark or None
        The plan it was written from.
    names : mapping of int to str
        Names of the planned poses by number.
    first_register : (int, int) or None
        Element of the array, and number of the pose that it keeps; None: there is no array.
    """

    numbered: re.Pattern[str]
    element: re.Pattern[str]
    mark: PlanMark | None = None
    names: Mapping[int, str] = field(default_factory=dict)
    first_register: tuple[int, int] | None = None

    def of(self, positions: Sequence[P], path: Path | str) -> list[tuple[int, P]]:
        """Positions with their numbers, touched-up ones in the place of the planned ones.

        Those without a number come behind all others, and behind all that the plan measures: an
        operator's own position takes neither number nor name of a deleted one. Sets ``name`` and
        ``other`` of each.

        Raises
        ------
        FileFormatError
            A touched-up position is that of no measured pose.
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
