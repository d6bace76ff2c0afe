"""What the validators of all dialects share: limits, bytes, words that are nearly known ones."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator
from difflib import get_close_matches
from functools import lru_cache, partial
from itertools import islice
from typing import Any, TypeVar

from posedesign.programs.language import Statement
from posedesign.programs.recorded import Level, Problem

measuring = partial(Problem, level="measuring")
"""Something that runs, but may not measure what was planned."""

Judged = TypeVar("Judged")

_FEW = 8  # statements of a form that are all looked at

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no program has one in each of its lines."""

Asked = tuple[str, bytes, str, Level]
"""A rule, the bytes that break it, what it says of the first of them, and the level."""

CONTROL: Asked = ("text", rb"[^\t\r\n -~\x80-\xff]", "the byte 0x{:02x} is not text", "error")
LONE_CR: Asked = ("crlf", rb"\r(?!\n)", "CR inside the line", "error")
FOREIGN: Asked = ("text", rb"[\x80-\xff]", "the byte 0x{:02x} is not plain ASCII text", "note")


def told(*checks: Iterable[Problem]) -> list[Problem]:
    """Problems of several checks in the order of the lines: at most 1000 of each, and in all."""
    found = [problem for check in checks for problem in islice(check, MOST_PROBLEMS)]
    return sorted(found, key=lambda p: (p.line, p.rule, p.message))[:MOST_PROBLEMS]


def syntax(statements: Iterable[Statement]) -> Iterator[Problem]:
    """What the grammar says."""
    return (Problem(s.row, "syntax", s.fault) for s in statements if s.fault)


Fault = tuple[str, str, Level]  # a rule, what breaks it, and the level


def each(placed: Iterable[Any], faults: Callable[[Any], Iterable[Fault]]) -> Iterator[Problem]:
    """Faults of each statement, or of what else has a ``row``."""
    return (
        Problem(item.row, rule, message, level)
        for item in placed
        for rule, message, level in faults(item)
    )


def judged(
    items: Iterable[Judged],
    faults: Callable[[Judged], Iterable[Problem]],
    of: Callable[[Judged], Any] = lambda s: s,
    names: Callable[[Judged], Hashable] | None = None,
) -> Iterator[Problem]:
    """Problems of statements, or of what has one, of which few of each form are looked at.

    That holds for rules that ask of each number whether it lies between two others, is whole, or
    how long it is, and nothing of texts in quotes: where the smallest and the largest numbers of a
    form are right, all are. A form has the same names, number for number, or what ``names`` says of
    them.
    """
    groups: dict[Hashable, list[tuple[Judged, Statement]]] = {}
    for item in items:
        s: Statement = of(item)
        key: Hashable = s.shape
        if names or s.shape.named:
            key = s.shape, names(item) if names else (*[s.slots[k] for k in s.shape.named],)
        groups.setdefault(s if s.fault else key, []).append((item, s))
    for group in groups.values():
        chosen = {0}
        for k in group[0][1].shape.numbers if len(group) > _FEW else ():
            texts = [s.slots[k] for _, s in group]
            numbers, lengths = [*map(float, texts)], [*map(len, texts)]
            chosen |= {numbers.index(min(numbers)), numbers.index(max(numbers))}
            chosen.add(lengths.index(max(lengths)))
            chosen.add(next((i for i, number in enumerate(numbers) if number % 1), 0))
        told = {n: [*faults(group[n][0])] for n in sorted(chosen)}
        if len(group) <= _FEW or any(told.values()):
            for n, (item, _) in enumerate(group):
                yield from told[n] if n in told else faults(item)


def check_bytes(data: bytes, *asked: Asked) -> Iterator[Problem]:
    """The first place where each is broken: thousands of equal messages would hide the others."""
    for rule, pattern, reason, level in asked:
        found = re.search(pattern, data)
        if found:
            row = data.count(b"\n", 0, found.start()) + 1
            yield Problem(row, rule, reason.format(found[0][0]), level)


def check_line_ends(data: bytes) -> Iterator[Problem]:
    """Rule ``crlf``: each line is ended by CR LF, as controllers write them."""
    if not data:
        return iter(())
    bare = data.count(b"\n") - data.count(b"\r\n") + (data[-1:] != b"\n")
    reason = f"{bare} lines are not ended by CR LF"
    # behind the last line nothing tells that it is not ended
    whole = data if data.endswith(b"\n") else data + b"\n"
    return check_bytes(whole, ("crlf", rb"(?<!\r)\n", reason, "measuring"))


def check_names(
    there: Iterable[tuple[int, str]], used: Iterable[tuple[int, str]], rules: tuple[str, str, str]
) -> Iterator[Problem]:
    """Whether names, with their lines, are there once, there where they are used, and used at all.

    ``rules``: what each of these is called; empty for one that is not asked.
    """
    rows: dict[str, int] = {}
    for row, name in there:
        if name in rows and rules[0]:
            yield Problem(row, rules[0], f"{name} is there twice")
        rows.setdefault(name, row)
    unused = dict(rows)
    for row, name in used:
        unused.pop(name, None)
        if name not in rows and rules[1]:
            yield Problem(row, rules[1], f"{name} is not there")
    for name, row in unused.items() if rules[2] else ():
        yield Problem(row, rules[2], f"{name} is never used", "measuring")


def near(word: str, known: Iterable[str], least: int = 3, alike: float = 1.0) -> str:
    """The known word that an unknown one was probably meant to be; empty for none.

    ``least``: letters that a known word has at least. ``alike``: below 1: how much of both is the
    same. Else one letter is dropped, added or changed, or two are swapped.
    """
    return _near(word[:60], frozenset(known), least, alike)


@lru_cache(maxsize=1024)
def _near(word: str, known: frozenset[str], least: int, alike: float) -> str:
    others = sorted(other for other in known if len(other) >= least)
    if word in known:
        return ""
    if alike < 1.0:
        return next(iter(get_close_matches(word, others, 1, alike)), "")
    return next((other for other in others if _is_one_edit(word, other)), "")


def _is_one_edit(a: str, b: str) -> bool:
    if abs(len(a) - len(b)) > 1:
        return False
    same = next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), len(a))
    a, b = a[same:], b[same:]
    return a[1:] == b[1:] or a[1:] == b or a == b[1:] or (a[:2] == b[1::-1] and a[2:] == b[2:])
