"""Items of YAML lists that stand on one line each and are JSON, which is YAML too: the quick way.

A trajectory of 10,000 measured poses has 20,000 points of some thirty values, and a parser of YAML
makes an event of every value. Lines that are JSON are read as such; where the rest is read as YAML,
a word stands in for each.
"""

from __future__ import annotations

import json
from typing import Any

_LONGEST = 20_000
"""Characters of a line that is tried: a point of a hundred joints has 5,000."""

_MOST_DIGITS = 19
"""Of an integer: nanoseconds since 1970 have as many."""


class Pairs(list[tuple[str, Any]]):
    """Keys and values of an object, as they stand."""


class Word(str):
    """NaN or Infinity, or an integer that no float can be, as it stands."""


def json_items(text: str) -> tuple[str, dict[str, tuple[Pairs, int]]]:
    """A text with items of lists that are JSON replaced by words, and what these stand for.

    Returns
    -------
    text : str
        Of as many lines.
    items : dict of str to (Pairs, line)
        By the word. Values are those of JSON; objects are :class:`Pairs`.
    """
    if '\n- {"' not in text:
        return text, {}
    found: dict[str, tuple[Pairs, int]] = {}
    lines = text.split("\n")
    for row, content in enumerate(lines, start=1):
        if content.startswith('- {"') and len(content) < _LONGEST:
            try:
                value = _DECODER.decode(content[2:])
            except (ValueError, RecursionError):
                continue  # a parser of YAML says what is wrong, or takes it
            word = f"json-in-line-{row}"
            found[word] = (value, row)
            lines[row - 1] = f"- {word}"
    return "\n".join(lines), found


def _whole(text: str) -> int | Word:
    return int(text) if len(text) <= _MOST_DIGITS else Word(text)


_DECODER = json.JSONDecoder(object_pairs_hook=Pairs, parse_constant=Word, parse_int=_whole)
