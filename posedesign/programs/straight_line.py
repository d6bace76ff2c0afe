"""One interpreter of straight-line programs: where each move goes, by what was given before it.

A language yields what its steps do, in the order of the file, as `Give` and `Go`; nothing else of a
grammar matters here. A value is what the program would have when the move runs. A variable that is
given several values, where a branch, a loop or a function knows of it, has none that is
known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Values:
    """Texts of the numbers of a position, and the line where they stand."""

    row: int
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Give:
    """A variable is given a value; None: one that the text does not tell.

    ``name``: of a variable or of an element, ``p[3]``; ``p`` alone is its array as well. ``inside``
    a branch, a loop or a function it is not sure when, or whether, that is done.
    """

    row: int
    name: str
    value: Values | None
    inside: bool = False


@dataclass(frozen=True)
class Go:
    """A move to a position: values, the name of a variable, or why that cannot be told."""

    row: int
    target: Values | str
    inside: bool = False
    fault: str = ""


@dataclass(frozen=True)
class Reached:
    """Where a move goes: values, or None where the text does not tell, and why."""

    row: int
    name: str  # of the variable; empty for none
    values: Values | None
    fault: str = ""


Event = Give | Go


def _array(name: str) -> str:
    return name.partition("[")[0]


def _uncertain(events: Sequence[Event], known: Mapping[str, Values | None]) -> set[str]:
    """Variables with several values, of which a branch, a loop or a function knows."""
    given: dict[str, set[tuple[str, ...]]] = {
        name: {value.texts if value else ()} for name, value in known.items()
    }
    inside: set[str] = set()
    for event in events:
        name = event.name if isinstance(event, Give) else event.target
        if not isinstance(name, str):
            continue
        if isinstance(event, Give):
            given.setdefault(name, set()).add(event.value.texts if event.value else ())
        inside |= {name, _array(name)} if event.inside else set()
    lost = {n for n, values in given.items() if len(values) > 1 and {n, _array(n)} & inside}
    return lost | {n for n in known if _array(n) in lost}


def follow(events: Iterable[Event], known: Mapping[str, Values | None] = {}) -> Iterator[Reached]:
    """Yield where each move goes, in their order.

    ``known``: values that variables have before the program begins. A variable that is nowhere
    given a value is not told of: it is another file's.
    """
    listed = list(events)
    uncertain = _uncertain(listed, known)
    state: dict[str, Values | None] = {**known, **dict.fromkeys(uncertain)}
    own = {_array(n) for n in [*known, *(e.name for e in listed if isinstance(e, Give))]}
    for event in listed:
        if isinstance(event, Give):
            if event.name not in uncertain:
                state[event.name] = event.value
            if "[" not in event.name:
                state |= {n: None for n in state if _array(n) == event.name and n != event.name}
        elif event.fault:
            yield Reached(event.row, "", None, event.fault)
        elif isinstance(event.target, Values):
            yield Reached(event.row, "", event.target)
        else:
            name = event.target
            value = state.get(name, state.get(_array(name)) if "[" in name else None)
            if value is None and _array(name) in own:
                yield Reached(event.row, name, None, f"{name} is changed by the program")
            elif value is not None:
                yield Reached(event.row, name, value)
