"""What the validators of YAML lists share: a strict walk through the content, and rules for values.

Own code, apart from writer and reader: of them only the parser of PyYAML is shared.

==================  =============================================================================
rule                what it asks
==================  =============================================================================
``utf-8``           text in UTF-8
``yaml``            one well-formed YAML document
``plain-yaml``      no anchors, aliases and tags, no key twice, nothing nested more than 16 deep,
                    at most 2,000,000 values: tools read them in different ways or not at all
``keys``            the keys of the format, all of them and no others
``joint-names``     at least one joint name, texts that YAML reads as texts, each once
``length``          as many values as joint names
``number``          plain decimal numbers without quotes: no NaN, no exponent, nothing that YAML 1.1
                    takes for another number (010, 1_000, 1:30) or for a text (1e5)
``range``           joint values within +-720 deg
``entries``         at least one pose
==================  =============================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import yaml

from posedesign.programs.recorded import Problem

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no list has one in each of its lines."""

LIMIT_RAD = math.radians(720.0)

_DEEPEST = 16
_MOST_VALUES = 2_000_000
_PARSER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DECIMAL = re.compile(r"-?(?:0|[1-9][0-9]{0,8})(?:\.[0-9]{1,20})?")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,18}")
_NO_TEXT = re.compile(
    r"|~|null|y|n|yes|no|true|false|on|off|<<|=|[-+]?\.?[0-9][0-9_.:eExXa-fA-F+-]*"
    r"|[-+]?\.(?:inf|nan)",
    re.IGNORECASE,
)


class Fault(Exception):
    """A problem behind which the rest of the file cannot be understood."""

    def __init__(self, line: int, rule: str, message: str) -> None:
        super().__init__(message)
        self.problem = Problem(line, rule, message)


@dataclass(slots=True)
class Element:
    """A value, a list or a map of the file.

    Attributes
    ----------
    line : int
    text : str or None
        Of a value.
    bare : bool
        Whether a value stands without quotes.
    children : list of Element or None
        Of a list, or of a map.
    keys : list of Element or None
        Of a map, one for each child.
    """

    line: int
    text: str | None = None
    bare: bool = True
    children: list[Element] | None = None
    keys: list[Element] | None = None

    @property
    def kind(self) -> str:
        """In a word."""
        if self.keys is not None:
            return "map"
        return "value" if self.children is None else "list"


def content(data: bytes) -> Element:
    """The one document of a file; Fault where there is none."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise Fault(line, "utf-8", f"the byte 0x{data[error.start]:02x} is no UTF-8") from error
    events = islice(yaml.parse(text, Loader=_PARSER), _MOST_VALUES)
    documents: list[Element] = []
    try:
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents.append(_element(next(events), events, 0))
                if len(documents) > 1:
                    raise Fault(documents[1].line, "yaml", "there is more than one document")
    except yaml.MarkedYAMLError as error:
        line = 1 if error.problem_mark is None else error.problem_mark.line + 1
        raise Fault(line, "yaml", str(error.problem or error.context)[:200]) from error
    except yaml.YAMLError as error:
        raise Fault(1, "yaml", str(error).splitlines()[0][:200]) from error
    except StopIteration as error:
        raise Fault(1, "plain-yaml", f"there are more than {_MOST_VALUES} values") from error
    if not documents:
        raise Fault(1, "yaml", "the file is empty")
    return documents[0]


def _element(event: Any, events: Iterator[Any], depth: int) -> Element:
    """The element that begins with an event, with all in it."""
    line = event.start_mark.line + 1
    if isinstance(event, yaml.AliasEvent):
        raise Fault(line, "plain-yaml", "there is an alias")
    if event.anchor is not None or event.tag is not None:
        raise Fault(line, "plain-yaml", "there is an anchor or a tag")
    if isinstance(event, yaml.ScalarEvent):
        return Element(line, event.value, not event.style)
    if depth == _DEEPEST:
        raise Fault(line, "plain-yaml", f"lists are nested more than {_DEEPEST} deep")
    parts: list[Element] = []
    inner = next(events)
    while not isinstance(inner, yaml.CollectionEndEvent):
        parts.append(_element(inner, events, depth + 1))
        inner = next(events)
    if isinstance(event, yaml.SequenceStartEvent):
        return Element(line, children=parts)
    return Element(line, keys=parts[::2], children=parts[1::2])


def first_problems(data: bytes, rules: Callable[[Element], Iterator[Problem]]) -> list[Problem]:
    """At most a thousand problems that rules find in the content of a file."""
    found: list[Problem] = []
    try:
        found.extend(islice(rules(content(data)), MOST_PROBLEMS - 1))
    except Fault as fault:
        found.append(fault.problem)
    return found


def fields(element: Element, keys: Sequence[str], what: str) -> Iterator[Problem]:
    """Problems with the keys of a map; Fault where it is none."""
    if element.keys is None:
        raise Fault(element.line, "keys", f"{what} is a {element.kind}, not a map")
    seen: set[str] = set()
    for key in element.keys:
        name = key.text or ""
        if name not in keys:
            yield Problem(key.line, "keys", f"{what} has no key {name[:60]!a}")
        elif name in seen:
            yield Problem(key.line, "plain-yaml", f"{what} has the key {name} twice")
        seen.add(name)
    for name in keys:
        if name not in seen:
            yield Problem(element.line, "keys", f"{what} lacks the key {name}")


def at(element: Element, key: str) -> Element | None:
    """The value of a key; None where it is not there."""
    for name, child in zip(element.keys or [], element.children or [], strict=False):
        if name.text == key:
            return child
    return None


def items(element: Element | None, what: str) -> list[Element]:
    """Items of a list; Fault where it is none, nothing where it is not there."""
    if element is None:
        return []
    if element.children is None or element.keys is not None:
        raise Fault(element.line, "keys", f"{what} is a {element.kind}, not a list")
    return element.children


def joint_names(element: Element | None, what: str) -> Iterator[Problem]:
    """Problems with a list of joint names."""
    names = items(element, what)
    if element is not None and not names:
        yield Problem(element.line, "joint-names", f"{what} is empty")
    seen: set[str] = set()
    for item in names:
        if item.text is None or (item.bare and _NO_TEXT.fullmatch(item.text)) or not item.text:
            yield Problem(item.line, "joint-names", f"{what} holds what is no text")
        elif item.text in seen:
            yield Problem(item.line, "joint-names", f"{what} has {item.text[:60]!a} twice")
        seen.add(item.text or "")


def joint_values(
    element: Element | None, joints: int, what: str, most: float = LIMIT_RAD
) -> Iterator[Problem]:
    """Problems with a list of one number for each joint."""
    values = items(element, what)
    if element is not None and len(values) != joints:
        reason = f"{what} has {len(values)} values for {joints} joints"
        yield Problem(element.line, "length", reason)
    for item in values:
        value = decimal(item)
        if value is None:
            shown = item.kind if item.text is None else ascii(item.text[:30])
            yield Problem(item.line, "number", f"{what} has {shown}, not a plain number")
        elif abs(value) > most:
            yield Problem(item.line, "range", f"{what} has {item.text} rad, beyond +-720 deg")


def decimal(item: Element) -> float | None:
    """A plain decimal number, or None."""
    text = item.text if item.bare else None
    return float(text) if text is not None and _DECIMAL.fullmatch(text) else None


def whole(item: Element | None) -> int | None:
    """A whole number that is not negative, or None."""
    text = item.text if item is not None and item.bare else None
    return int(text) if text is not None and _WHOLE.fullmatch(text) else None
