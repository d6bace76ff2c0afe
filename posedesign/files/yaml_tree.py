"""The content of a YAML list as one tree with lines, which serves the reader and the validator.

It is made of the events of PyYAML's parser: no word becomes a number or a date in silence, and
anchors, aliases, tags and deep nesting are refused at the first one, before a small file could
become a large one. (``yaml.compose`` hides anchors, and ends Python where lists are nested deeply.)
A trajectory of 10,000 measured poses has 20,000 points of some thirty values, so that items that
are JSON on one line, which is YAML too, are read as such; a word stands in for each in the rest.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import yaml

MOST_DEPTH = 12
"""Deepest nesting; that of a trajectory in the goal of an action is 6. The parser's time grows with
the square of the depth."""

MOST_NODES = 1_500_000
"""Most values and lists of a file: 10,000 measured poses of seven joints have 600,000."""

_LONGEST = 20_000
"""Characters of a line that is tried as JSON: a point of a hundred joints has 5,000."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_BREAK = re.compile("\r\n?|[\x85\u2028\u2029]")


@dataclass(eq=False)
class Fault(Exception):
    """What is wrong with a file, so that the rest of it cannot be understood."""

    message: str
    line: int | None
    rule: str = "yaml"
    hint: str = "save the program again"


class Plain(str):
    """A value that stands without quotes."""

    __slots__ = ()


class Pairs(list[tuple[Any, Any]]):
    """Keys and values of a map, as they stand."""


class Node(NamedTuple):
    """A value, a list or a map, and the line where it begins; JSON in it is on that line."""

    value: str | list[Any]
    line: int

    @property
    def kind(self) -> str:
        """In a word."""
        kinds = {str: "value", Plain: "value", Pairs: "map", list: "list"}
        return kinds[type(self.value)]

    def items(self, what: str) -> list[Node]:
        """Items of a list; Fault where it is none."""
        if type(self.value) is not list:
            raise Fault(f"{what} is not a list, but a {self.kind}", self.line, "keys")
        own = self.value and type(self.value[0]) is Node
        return self.value if own else [_node(value, self.line) for value in self.value]

    def pairs(self, what: str) -> list[tuple[Node, Node]]:
        """Keys and values of a map; Fault where it is none."""
        if not isinstance(self.value, Pairs):
            raise Fault(f"{what} is not a map, but a {self.kind}", self.line, "keys")
        return [(_node(key, self.line), _node(value, self.line)) for key, value in self.value]


def text_of(data: bytes) -> str:
    r"""Text of a file, its lines ended by ``\n``; Fault where it is not UTF-8."""
    try:
        return _BREAK.sub("\n", data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        reason = f"holds the byte 0x{data[error.start]:02x}, which is not text in UTF-8"
        raise Fault(reason, line, "utf-8", "save it in UTF-8") from error


def documents(text: str) -> list[Node]:
    """The documents of a text.

    Raises Fault: it is no YAML, has anchors, aliases or tags, is nested too deeply, or has too many
    values.
    """
    short, quick = json_items(text)
    try:
        found, taken = _built(short, quick)
        # else something that looks like an item is part of a text
        return found if taken == len(quick) else _built(text, {})[0]
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        said = getattr(error, "problem", None) or str(error).partition("\n")[0]
        line = None if mark is None else mark.line + 1
        reason = f"is no YAML: {said[:200]}"
        raise Fault(reason, line, hint="is it the right file?") from error


def json_items(text: str) -> tuple[str, dict[str, Node]]:
    """A text of as many lines with items that are JSON replaced by words, and the items by word."""
    found: dict[str, Node] = {}
    lines = text.split("\n") if '\n- {"' in text else []
    for row, content in enumerate(lines, start=1):
        if content.startswith('- {"') and len(content) < _LONGEST:
            try:
                value = _DECODER.decode(content[2:])
            except (ValueError, RecursionError):
                continue  # the parser of YAML says what is wrong, or takes it
            lines[row - 1] = f"- json-in-line-{row}"
            found[f"json-in-line-{row}"] = Node(value, row)
    return "\n".join(lines) or text, found


def _distinct(found: list[tuple[str, Any]]) -> Pairs:
    if len({key for key, _ in found}) < len(found):
        raise ValueError("a key stands twice")
    return Pairs(found)


_DECODER = json.JSONDecoder(
    object_pairs_hook=_distinct, parse_float=Plain, parse_int=Plain, parse_constant=Plain
)


def _node(value: Any, line: int) -> Node:
    """The node of a part of a list or map, which JSON has on the line of the whole."""
    if type(value) is Node:
        return value
    return Node(value if isinstance(value, str | list) else Plain(json.dumps(value)), line)


def _built(text: str, quick: Mapping[str, Node]) -> tuple[list[Node], int]:
    """The documents, with items of ``quick`` for their words, and how many were taken."""
    events = iter(yaml.parse(text, Loader=_LOADER))
    count = taken = 0

    def built(event: Any, depth: int) -> Node:
        nonlocal count, taken
        count += 1
        kind, line = type(event), event.start_mark.line + 1
        _check(event, count, depth)
        if kind is yaml.ScalarEvent:
            item = quick.get(event.value)
            taken += item is not None
            return item or Node(event.value if event.style else Plain(event.value), line)
        parts: list[Node] = []
        while type(inner := next(events)) not in (yaml.SequenceEndEvent, yaml.MappingEndEvent):
            parts.append(built(inner, depth + 1))
        if kind is yaml.SequenceStartEvent:
            return Node(parts, line)
        seen: set[str] = set()
        for key in parts[::2]:
            if not isinstance(key.value, str):
                raise Fault("a key is not a word", key.line, "keys")
            if key.value in seen:
                raise Fault(f"has the key {key.value[:60]!r} twice", key.line, "plain-yaml")
            seen.add(key.value)
        return Node(Pairs(zip(parts[::2], parts[1::2], strict=True)), line)

    found = [built(next(events), 0) for e in events if type(e) is yaml.DocumentStartEvent]
    return found, taken


def _check(event: Any, count: int, depth: int) -> None:
    """Refuse what would make a small file large, or stands for something that is not there."""
    bad = ""
    if type(event) is yaml.AliasEvent:
        bad = "has an alias (*)"
    elif event.anchor is not None:
        bad = "has an anchor (&)"
    elif event.tag is not None:
        bad = f"has a tag ({event.tag[:40]})"
    elif count > MOST_NODES:
        bad = f"has more than {MOST_NODES} values"
    elif depth == MOST_DEPTH and type(event) is not yaml.ScalarEvent:
        bad = f"is nested more than {MOST_DEPTH} deep"
    if bad:
        hint = "write values out, as plain lists and maps"
        raise Fault(bad, event.start_mark.line + 1, "plain-yaml", hint)
