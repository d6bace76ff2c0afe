"""Programs with one token broken, as a slip of the hand or of a transfer breaks it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

_TOKEN = re.compile(r"[A-Za-z_]\w*|\d+(?:\.\d*)?|\.\d+|[^\w\s]")


def mutants(
    text: str, count: int, rng: np.random.Generator, skip: re.Pattern[str]
) -> Iterator[tuple[str, str, str]]:
    """What was done, the line before and behind it, and the whole text, of so many mutants.

    ``skip`` finds the lines, or parts of them, that are free text or user's names.
    """
    lines = text.split("\n")
    tokens = []
    for row, line in enumerate(lines):
        free = [found.span() for found in skip.finditer(line)]
        for token in _TOKEN.finditer(line):
            if not any(a <= token.start() < b for a, b in free):
                tokens.append((row, token.start(), token.end()))
    made = 0
    while made < count:
        row, start, end = tokens[int(rng.integers(len(tokens)))]
        line = lines[row]
        changed = _changed(line, start, end, int(rng.integers(5)), rng)
        if changed is None or changed == line:
            continue
        made += 1
        yield line, changed, "\n".join([*lines[:row], changed, *lines[row + 1 :]])


def _changed(line: str, start: int, end: int, how: int, rng: np.random.Generator) -> str | None:
    token = line[start:end]
    before, behind = line[:start], line[end:]
    word, number = token[0].isalpha(), token[0].isdigit()
    if how == 0 and not number:  # left out
        return before + behind
    if how == 1:  # doubled
        return before + token + (" " if word or number else "") + token + behind
    if how == 2 and word and len(token) > 2:  # misspelt: a letter left out
        at = int(rng.integers(len(token)))
        return before + token[:at] + token[at + 1 :] + behind
    if how == 3 and number:
        return before + token + str(rng.choice(["_0", ".1.2", "e", "x"])) + behind
    if how == 4 and not word and not number:  # another mark
        return before + str(rng.choice([*"()[]{},;:=%#?"])) + behind
    return None
