"""URScript as the strict validator sees it: lines without comments and texts, calls taken apart.

This shares no code with the readers and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_CALLED = re.compile(r"(?<![\w.])([A-Za-z_]\w{0,99})\s*\(", re.ASCII)
_BRACKETS = re.compile(r"[()\[\]]")
_BRACKETS_AND_COMMAS = re.compile(r"[()\[\],]")
_MATES = {")": "(", "]": "["}


@dataclass(frozen=True)
class Statement:
    """A line with something in it.

    Attributes
    ----------
    line : int
    code : str
        Without the comment, spaces around it, and what is inside quotes.
    texts : tuple of str
        What is inside quotes.
    fault : str
        What is malformed.
    """

    line: int
    code: str
    texts: tuple[str, ...]
    fault: str

    @property
    def calls(self) -> list[str]:
        """Names of the functions called, from the left."""
        return [] if self.code.startswith(("def ", "thread ")) else _CALLED.findall(self.code)


def statements(text: str) -> Iterator[Statement]:
    """Split a script; never fails."""
    for row, line in enumerate(text.split("\n"), start=1):
        parts = line.rstrip("\r").split('"')
        code, texts, fault = [], [], ""
        for k, part in enumerate(parts):
            if k % 2:
                texts.append(part)
            else:
                before, mark, _ = part.partition("#")
                code.append(before)
                if mark:
                    break
        else:
            if len(parts) % 2 == 0:
                fault = "a quote is not closed"
        joined = '""'.join(code).strip()
        if joined or fault:
            yield Statement(row, joined, tuple(texts), fault or _bracket_fault(joined))


def _bracket_fault(code: str) -> str:
    stack: list[str] = []
    for character in _BRACKETS.findall(code):
        if character in "([":
            stack.append(character)
        elif not stack or stack.pop() != _MATES[character]:
            return f"{character} closes nothing"
    return f"{stack[-1]} is not closed" if stack else ""


def arguments(code: str, name: str) -> list[str] | None:
    """Arguments of the first call of a function in a line, spaces removed; None without one."""
    start = re.search(rf"(?<![\w.]){name}\s*\(", code)
    if start is None:
        return None
    depth, begin, out = 0, start.end(), []
    for found in _BRACKETS_AND_COMMAS.finditer(code, start.end()):
        character = found[0]
        if character in "([":
            depth += 1
        elif character != "," and depth > 0:
            depth -= 1
        elif depth == 0:
            out.append("".join(code[begin : found.start()].split()))
            begin = found.end()
            if character != ",":
                return out
    return [*out, "".join(code[begin:].split())]
