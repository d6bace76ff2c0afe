"""What the readers of YAML lists share: the content as a tree with lines, and the comments.

PyYAML's parser (libyaml where it is there) gives events, of which the tree is made here: nothing is
constructed, no word becomes a number or a date in silence, and anchors, aliases, tags and deep
nesting are refused at the first one, before a small file could become a large one.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from calib.errors import FileFormatError
from posedesign.programs.reading import MOST_JOINT_DEG, number, refuse
from posedesign.programs.recorded import PlanMark
from posedesign.programs.ros.yaml_lines import Pairs, Word, json_items

MOST_DEPTH = 12
"""Deepest nesting; that of a trajectory in the goal of an action is 6. The parser's time grows with
the square of the depth."""

MOST_NODES = 1_500_000
"""Most values and lists of a file: 10,000 measured poses of seven joints have 600,000."""

MOST_JOINT_RAD = math.radians(MOST_JOINT_DEG)
"""No arm turns so far."""

Scalar: TypeAlias = tuple[str, int, bool]
"""Text, line, and whether it stands without quotes."""

Node: TypeAlias = "Scalar | YamlList | YamlMap | JsonNode"

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
_LABEL = re.compile(r"(pose|via|hold)\s+(\d{1,7})(?::\s*(.*))?")
_DIGITS = re.compile(r"[-+.0-9eE]+")


@dataclass(frozen=True)
class YamlList:
    """A list, and the line where it begins."""

    items: list[Node]
    line: int


@dataclass(frozen=True)
class YamlMap:
    """Values by their keys, and the line where it begins."""

    items: dict[str, Node]
    line: int


@dataclass(frozen=True)
class JsonNode:
    """A list, or a map as :class:`.Pairs`, that was read as JSON and is not yet made of nodes."""

    value: list[Any]
    line: int


@dataclass(frozen=True)
class Label:
    """A comment that says which pose comes next.

    Attributes
    ----------
    kind : {"pose", "via", "hold"}
        Measured, passed through, or the end of standing at a measured one.
    number : int
    name : str
    line : int
    """

    kind: str
    number: int
    name: str
    line: int


@dataclass(frozen=True)
class Document:
    """A file: its content, and what its comments say.

    Attributes
    ----------
    root : Node
    path : Path
    name, title : str
        Of the program; the name of the file where comments do not say.
    mark : PlanMark
    labels : tuple of Label
        In the order of the file.
    """

    root: Node
    path: Path
    name: str
    title: str
    mark: PlanMark
    labels: tuple[Label, ...]


def read_document(data: bytes, path: Path) -> Document:
    """The content and the comments of a file.

    Raises
    ------
    FileFormatError
        It is not text in UTF-8, not one YAML document, has anchors, aliases or tags, is nested too
        deeply, or is cut off.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        reason = f"holds the byte 0x{data[error.start]:02x}, which is not text in UTF-8"
        raise FileFormatError(reason, path=path, row=row, hint="save it in UTF-8") from error
    root = _tree(text, path)
    words: dict[str, str] = {}
    mark, labels, ended = None, [], False
    for line, comment in _comments(text):
        found = _LABEL.fullmatch(comment)
        key, colon, rest = comment.partition(":")
        if found:
            labels.append(Label(found[1], int(found[2]), (found[3] or "").strip(), line))
        elif colon and key in ("program", "title", "remark"):
            words.setdefault(key, rest.strip())
        elif comment.startswith("end of "):
            ended = True
        else:
            mark = mark or PlanMark.found_in(comment)
    if "program" in words and not ended:
        refuse(
            f"is cut off: there is no comment '# end of {words['program'][:40]}'",
            path,
            hint="copy the file again",
        )
    return Document(
        root,
        path,
        words.get("program") or path.stem,
        words.get("title", ""),
        mark or PlanMark(),
        tuple(labels),
    )


def map_at(node: Node, what: str, path: Path) -> dict[str, Node]:
    """The values of a node that is a map, by key."""
    if isinstance(node, JsonNode) and isinstance(node.value, Pairs):
        out: dict[str, Node] = {}
        for key, value in node.value:
            if key in out:
                refuse(f"has the key {key[:60]!r} twice", path, node.line)
            out[key] = _of_json(value, node.line)
        return out
    if not isinstance(node, YamlMap):
        refuse(f"{what} is not a map of keys and values", path, line_of(node))
    return node.items


def list_at(node: Node | None, what: str, path: Path, line: int) -> list[Node]:
    """The items of a node that is a list; ``line`` is where it is missed."""
    if node is None:
        refuse(f"{what} is missing", path, line)
    if isinstance(node, JsonNode) and not isinstance(node.value, Pairs):
        return [_of_json(value, node.line) for value in node.value]
    if not isinstance(node, YamlList):
        refuse(f"{what} is not a list", path, line_of(node))
    return node.items


def names_at(node: Node | None, what: str, path: Path, line: int) -> tuple[str, ...]:
    """Joint names: at least one, each once."""
    names: dict[str, None] = {}
    for item in list_at(node, what, path, line):
        if not isinstance(item, tuple) or not item[0].strip():
            refuse(f"{what} holds something that is not a name", path, line_of(item))
        if item[0] in names:
            refuse(f"{what} has {item[0][:60]!r} twice", path, item[1])
        names[item[0]] = None
    if not names:
        refuse(f"{what} is empty", path, line)
    return tuple(names)


def values_at(
    node: Node | None, names: tuple[str, ...], what: str, path: Path, line: int
) -> list[float]:
    """Joint values [rad], one for each name, finite and within +-720 deg."""
    if isinstance(node, JsonNode):
        numbers = [float(v) for v in node.value if type(v) in (int, float)]
        if (
            len(numbers) == len(node.value) == len(names)
            and max(map(abs, numbers)) <= MOST_JOINT_RAD
        ):
            return numbers
    items = list_at(node, what, path, line)
    if len(items) != len(names):
        row = line if node is None else line_of(node)
        refuse(f"{what} has {len(items)} values, there are {len(names)} joints", path, row)
    try:
        texts = [item[0] for item in items if isinstance(item, tuple) and item[2]]
        if len(texts) == len(names) and _DIGITS.fullmatch("".join(texts)):
            values = [float(text) for text in texts]
            if max(map(abs, values)) <= MOST_JOINT_RAD:
                return values
    except ValueError:
        pass  # said below, with the joint
    return [_value(item, f"{what}: {n}", path) for item, n in zip(items, names, strict=True)]


def line_of(node: Node) -> int:
    """The line where a node begins."""
    return node[1] if isinstance(node, tuple) else node.line


def _value(item: Node, what: str, path: Path) -> float:
    if not isinstance(item, tuple):
        refuse(f"{what} is not a number", path, line_of(item))
    text, line, plain = item
    if not plain:
        refuse(f"{what} is {text[:30]!r}, a text in quotes, not a number", path, line)
    return number(text, what, path, line, MOST_JOINT_RAD, "rad")


def _comments(text: str) -> Iterator[tuple[int, str]]:
    """Line and words of each line that is a comment."""
    for line, content in enumerate(_LINE_END.split(text), start=1):
        stripped = content.strip(" \t")
        if stripped.startswith("#"):
            yield line, stripped.lstrip("#").strip()


def _tree(text: str, path: Path) -> Node:
    """The one document of a text; empty ones behind it, as ``ros2 topic echo`` adds, count not."""
    short, quick = json_items(text)
    roots: list[Node] = []
    try:
        if _fill(roots, short, path, quick) != len(quick):
            roots = []  # something that looks like an item is part of a text
            _fill(roots, text, path, {})
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        row = None if mark is None else mark.line + 1
        reason = f"is no YAML: {(error.problem or error.context or 'unreadable')[:200]}"
        raise FileFormatError(reason, path=path, row=row, hint="is it the right file?") from error
    except yaml.YAMLError as error:
        reason = f"is no YAML: {str(error).splitlines()[0][:200]}"
        raise FileFormatError(reason, path=path, hint="is it the right file?") from error
    filled = [r for r in roots if not isinstance(r, tuple) or r[0] or not r[2]]
    if not filled:
        refuse("is empty", path, hint="is it the right file?")
    if len(filled) > 1:
        refuse("holds several documents", path, line_of(filled[1]), "keep one of them")
    return filled[0]


def _fill(roots: list[Node], text: str, path: Path, quick: Mapping[str, tuple[Pairs, int]]) -> int:
    """Append the documents of a text, from the parser's events.

    Words of ``quick`` that are items of lists are what these stand for; returns how many were.
    """
    taken = 0
    open_lists: list[tuple[list[Any], int]] = []
    items: list[Any] = roots
    nodes = 0
    for event in yaml.parse(text, Loader=_LOADER):
        kind = type(event)
        if kind is yaml.ScalarEvent:
            if event.anchor is not None or event.tag is not None:
                _refuse_extras(event, path)
            stood_for = quick.get(event.value)
            if stood_for is None:
                items.append((event.value, event.start_mark.line + 1, not event.style))
            else:
                items.append(JsonNode(*stood_for))
                taken += 1
        elif kind is yaml.SequenceStartEvent or kind is yaml.MappingStartEvent:
            _refuse_extras(event, path)
            row = event.start_mark.line + 1
            if len(open_lists) == MOST_DEPTH:
                refuse(f"is nested more than {MOST_DEPTH} deep", path, row, "is it the right file?")
            open_lists.append((items, row))
            items = []
        elif kind is yaml.SequenceEndEvent:
            outer, row = open_lists.pop()
            outer.append(YamlList(items, row))
            items = outer
        elif kind is yaml.MappingEndEvent:
            outer, row = open_lists.pop()
            outer.append(YamlMap(_by_key(items, path), row))
            items = outer
        elif kind is yaml.AliasEvent:
            refuse("has an alias (*)", path, event.start_mark.line + 1, "write the values out")
        else:
            continue
        nodes += 1
        if nodes > MOST_NODES:
            row = event.start_mark.line + 1
            refuse(f"has more than {MOST_NODES} values", path, row, "is it the right file?")
    return taken


def _of_json(value: Any, line: int) -> Node:
    """The node of a value that was read as JSON."""
    if isinstance(value, list):
        return JsonNode(value, line)
    if isinstance(value, str):
        return value, line, isinstance(value, Word)
    return json.dumps(value), line, True


def _refuse_extras(event: Any, path: Path) -> None:
    if event.anchor is not None:
        refuse("has an anchor (&)", path, event.start_mark.line + 1, "write the values out")
    if event.tag is not None:
        reason = f"has a tag ({event.tag[:40]})"
        refuse(reason, path, event.start_mark.line + 1, "write values without tags")


def _by_key(items: list[Node], path: Path) -> dict[str, Node]:
    out: dict[str, Node] = {}
    for key, value in zip(items[::2], items[1::2], strict=True):
        if not isinstance(key, tuple):
            refuse("a key is not a word", path, line_of(key))
        if key[0] in out:
            refuse(f"has the key {key[0][:60]!r} twice", path, key[1])
        out[key[0]] = value
    return out
