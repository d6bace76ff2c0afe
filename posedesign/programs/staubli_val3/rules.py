"""Staubli VAL 3 projects: the rules that a file (``.dtx``, ``.pjx``, ``.pgx``) is checked by.

Nothing was loaded on a controller. Files of VAL 3 s6 have another XML: of them the code is checked.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``xml``                well-formed XML without DTD and entities, with the elements of VAL 3
``attributes``         those that an element needs, and words such as lefty, off, public in them
``root``               Database, Project or Programs of VAL 3, as the ending of the file says
``data-name``          names of data are identifiers, each once; more than 15 characters, which
                       controllers before s8 refuse, are noted
``data-type``          a type of VAL 3; one that a user may have made is noted
``keys``               values have keys inside the size, each once; positions that were never
                       taught would not measure
``number``             plain numbers: no NaN, no 1_0
``range``              joints within +-720 deg, coordinates within 100 m, angles within +-360 deg
``father``             fatherId is world, flange, a frame or tool of the file, or of a library
``project-files``      each file once; start.pgx, stop.pgx and a data file, which a library need
                       not have, are noted
``program-name``       one program, with the name of its file
``syntax``             every line of code is a statement
``code``               begin first, end last, each if, for, while, do, switch closed
``function``           functions of VAL 3 with their number of arguments
``name``               variables are declared: data, locals, parameters; not words of VAL 3
``target``             movej goes to joints or points, movel and movec to points, with a tool and
                       a motion; an index is inside the size; called programs are there
``wait-to-measure``    waitEndMove() between a move and a call or herej(), to measure
``unused``             start moves to all planned positions, to measure
=====================  ==========================================================================

Elements, attributes, types and functions that are not known, and not nearly one that is, are noted.
What a program names is looked for where the one data file of its project lies beside it.
"""

from __future__ import annotations

import difflib
import operator
import re
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from itertools import islice
from pathlib import Path

from lark import Token, Tree

from calib.errors import FileFormatError
from posedesign.programs.language import Block, block_faults, text_of
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.staubli_val3.project import (
    MOVES,
    Names,
    Node,
    XmlFault,
    arguments_of,
    index_of,
    name_of,
    parse_xml,
    statements_of,
)
from posedesign.programs.staubli_val3.words import (
    ELEMENTS,
    FORMS,
    FUNCTIONS,
    JOINT_TARGETS,
    KEYWORDS,
    LIMITS,
    PREDEFINED,
    TARGETS,
    VALUES,
    XSI_TYPE,
)

MOST_PROBLEMS = 1000
"""Most problems told by one check."""

_OLD_ROOTS = ("{DataNameSpace}dataList", "{ProjectNameSpace}project")
_OLD_PROGRAMS = "{ProgramNameSpace}programList"
_SPACE = re.compile(r"\{http://www\.staubli\.com/robotics/VAL3/(?:Data|Project|Program|Param)/\d\}")
_LENGTH = 15
_IDENTIFIER = re.compile(r"[A-Za-z]\w{0,99}", re.ASCII)
_KEY = re.compile(r"\d{1,6}(?:,\d{1,6}){0,2}", re.ASCII)
_NUMBER = re.compile(r"-?\d{1,9}(?:\.\d{0,20})?(?:[eE][-+]?\d{1,3})?", re.ASCII)
_FATHER = re.compile(r"(?:([A-Za-z]\w{0,99}):)?([A-Za-z]\w{0,99})\[\d{1,4}\]", re.ASCII)

_BLOCKS = {
    "if_": Block("endif", ("elseif", "else_")),
    "for_": Block("endfor"),
    "while_": Block("endwhile"),
    "do": Block("until"),
    "switch": Block("endswitch", ("case", "default")),
}


def check_staubli_val3(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good file. Never fails."""
    try:
        root = parse_xml(data)
    except XmlFault as fault:
        return [Problem(fault.line, "xml", fault.reason)]
    return list(islice(_check(root, Path(path)), MOST_PROBLEMS))


def _check(root: Node, path: Path) -> Iterator[Problem]:
    if root.tag in _OLD_ROOTS:
        return
    if root.tag == _OLD_PROGRAMS:
        yield from _check_code(root, path)
        return
    suffix = path.suffix.lower() if path.suffix.lower() in ELEMENTS else ".dtx"
    expected = next(iter(ELEMENTS[suffix]))
    if root.name != expected or not _SPACE.match(root.tag):
        yield Problem(root.line, "root", f"{root.tag[:80]!a} is not {expected} of VAL 3")
        return
    yield from _check_elements(root, ELEMENTS[suffix])
    yield from {".dtx": _check_data, ".pjx": _check_project, ".pgx": _check_programs}[suffix](
        root, path
    )


def _level(word: str, known: Collection[str]) -> Level:
    """Error where a word is nearly a known one: it may otherwise be of a library or newer."""
    return "error" if difflib.get_close_matches(word, known, 1, 0.75) else "note"


def _check_elements(root: Node, elements: dict[str, tuple[str, str]]) -> Iterator[Problem]:
    waiting = [root]
    while waiting:
        node = waiting.pop()
        attributes, inside = elements[node.name]
        yield from _check_attributes(node, attributes, node.get("name"))
        if "type" in node.attributes:
            yield from _check_array(node)
        if node.text.strip() and node.name not in ("Code", "Description"):
            yield Problem(node.line, "xml", f"{node.text.strip()[:30]!a} stands in {node.name}")
        for child in node.children:
            if child.name not in inside.split() or not _SPACE.match(child.tag):
                reason = f"{child.tag[-60:]!a} stands in {node.name}"
                level = _level(child.name, ["Value", *elements])
                yield Problem(child.line, "xml", reason, level)
            elif child.name == "Value":
                waiting += [field for field in child.children if field.name == "Field"]
            else:
                waiting.append(child)


@cache
def _names(known: str) -> dict[str, bool]:
    """Attributes of a table, and whether they must be there."""
    return {name.rstrip("!"): name.endswith("!") for name in known.split()}


def _check_attributes(node: Node, known: str, label: str) -> Iterator[Problem]:
    names = _names(known)
    for name, needed in names.items():
        if needed and name not in node.attributes:
            yield Problem(node.line, "attributes", f"{label[:40]}: {name} is missing")
    for name, text in node.attributes.items():
        said = f"{label[:40]}: {name[-40:]} is {text[:30]!a}"
        if name not in names:
            yield Problem(node.line, "attributes", f"{said}, of no meaning", _level(name, names))
        elif name in LIMITS:
            if not _NUMBER.fullmatch(text):
                yield Problem(node.line, "number", f"{said}, not a plain number")
            elif not abs(float(text)) <= LIMITS[name]:
                yield Problem(node.line, "range", said)
        elif name in FORMS and not re.fullmatch(FORMS[name], text, re.ASCII):
            yield Problem(node.line, "attributes", said)


def _check_array(array: Node) -> Iterator[Problem]:
    """Type, size and values of data, a field, a local or a parameter."""
    name, kind = array.get("name")[:40], array.get("type")
    own = kind not in VALUES and kind not in ("joint", "point")
    if own and not any(value.children for value in array.children):
        reason = f"{name} is of type {kind[:30]!a}"
        yield Problem(array.line, "data-type", reason, _level(kind, VALUES))
    if array.get(XSI_TYPE) == "collection":
        return
    size = re.fullmatch(FORMS["size"], array.attributes.get("size", "1"), re.ASCII)
    bounds = [int(text) for text in size[0].split()] if size else []
    known = "key! " + VALUES.get(kind, "")
    seen: set[str] = set()
    for value in array.children:
        key = value.get("key")
        label = f"{name}[{key[:20]}]"
        parts = [int(text) for text in key.split(",")] if _KEY.fullmatch(key) else []
        inside = len(parts) == len(bounds) and all(map(operator.lt, parts, bounds))
        if size and (not inside or key in seen):
            yield Problem(value.line, "keys", f"{label} is none of {size[0]}, or there twice")
        seen.add(key)
        if not own:
            yield from _check_attributes(value, known, label)
        text = value.get("value")
        if kind == "num" and text and not _NUMBER.fullmatch(text):
            yield Problem(value.line, "number", f"{label} is {text[:30]!a}, not a plain number")
        if kind == "bool" and text not in ("", "true", "false"):
            yield Problem(value.line, "attributes", f"{label} is {text[:30]!a}")
    if kind in JOINT_TARGETS and len(bounds) == 1 and len(seen) < bounds[0]:
        reason = f"{name} has {len(seen)} positions, its size is {bounds[0]}"
        yield Problem(array.line, "keys", reason, "measuring")


def _check_data(root: Node, path: Path) -> Iterator[Problem]:
    arrays = list(root.all("Data"))
    counts = Counter(array.get("name") for array in arrays)
    frames = {a.get("name") for a in arrays if a.get("type") in ("frame", "tool")}
    for array in arrays:
        name = array.get("name")
        if counts[name] > 1:
            yield Problem(array.line, "data-name", f"{name[:40]!a} is there twice")
        if len(name) > _LENGTH:
            reason = f"{name[:40]!a} has more than {_LENGTH} characters"
            yield Problem(array.line, "data-name", reason, "note")
        for value in array.children:
            father = value.attributes.get("fatherId", "world[0]")
            found = _FATHER.fullmatch(father)
            if not found or not (found[1] or found[2] in {"world", "flange", *frames}):
                yield Problem(value.line, "father", f"{father[:40]!a} is not there")


def _check_project(root: Node, path: Path) -> Iterator[Problem]:
    programs = [node.get("file") for node in root.all("Program")]
    data = [node.get("file") for node in root.all("Data")]
    for file, count in Counter(programs + data).items():
        ending = ".pgx" if file in programs else ".dtx"
        stem = file.rpartition("\\")[2].removesuffix(ending)
        if count > 1 or not file.endswith(ending) or not _IDENTIFIER.fullmatch(stem):
            reason = f"{file[:40]!a} is there twice" if count > 1 else f"{file[:40]!a} is no file"
            yield Problem(root.line, "project-files", reason)
    missing = {"start.pgx", "stop.pgx"} - set(programs)
    if missing or len(data) != 1:
        reason = f"missing {sorted(missing)}, {len(data)} data files"
        yield Problem(root.line, "project-files", reason, "note")


def _check_programs(root: Node, path: Path) -> Iterator[Problem]:
    names = [node.get("name") for node in root.all("Program")]
    if names != [path.stem]:
        yield Problem(root.line, "program-name", f"{path.name} holds {names[:5]!a}")
    yield from _check_code(root, path)


def _check_code(root: Node, path: Path) -> Iterator[Problem]:
    project = _Project(path, root)
    for code in root.all("Code", "code"):
        statements = statements_of(code)
        kinds = [statement.kind for statement in statements]
        ends = kinds[:1] + kinds[1:][-1:]
        if ends != ["begin", "end"] or kinds.count("begin") + kinds.count("end") != 2:
            reason = "the code does not begin with begin and end with end, once each"
            yield Problem(code.text_line, "code", reason)
        yield from block_faults(statements, _BLOCKS, "code")
        stands, moved = True, set()
        for statement in statements:
            if statement.fault:
                yield Problem(statement.row, "syntax", statement.fault)
                continue
            names = Names.of(statement)
            for rule, reason, level in project.faults(names):
                yield Problem(statement.row, rule, reason, level)
            called = {name_of(function).lower() for function in names.function}
            if not stands and (statement.kind == "call" or "herej" in called):
                reason = "no waitEndMove() since the last move"
                yield Problem(statement.row, "wait-to-measure", reason, "measuring")
            stands = "waitendmove" in called or (stands and not called & MOVES.keys())
            moved |= {(name_of(t), index_of(t)) for t in names.targets() if t.data == "place"}
        own = next((name for name in ("jPose", "pPose") if name in project.known), "")
        if path.stem == "start" and own and "sPlan" in project.known:
            size = project.known[own][1] or 0
            left = size - sum(name == own for name, _ in moved)
            if left > 0:
                reason = f"{left} of {size} positions in {own} are never moved to"
                yield Problem(code.text_line, "unused", reason, "measuring")


Fault = tuple[str, str, Level]


class _Project:
    """What a program can name: data and programs of its project, its parameters and locals."""

    def __init__(self, path: Path, root: Node) -> None:
        self.path = path
        self.known: dict[str, tuple[str, int | None]] = {}
        self.programs: dict[str, int | None] = {}
        beside = _data_beside(path)
        self.whole = beside is not None
        for node in [*(beside or []), *root.all("Parameter", "Local", "param", "local")]:
            size = node.get("size")
            whole = int(size) if re.fullmatch(r"\d{1,6}", size, re.ASCII) else None
            self.known[node.get("name")] = node.get("type") or node.name, whole

    def faults(self, names: Names) -> Iterator[Fault]:
        """What is wrong with the names in a statement."""
        for function in names.function:
            yield from self._of_function(function)
        for routine in names.routine:
            yield from self._of_routine(routine)
        for place in names.place:
            yield from self._of_place(place)

    def _of_function(self, function: Tree[Token]) -> Iterator[Fault]:
        name, given = name_of(function), arguments_of(function)
        word = name.lower()
        if ":" in name or name.startswith("$"):
            return  # of a library
        least, most = FUNCTIONS.get(word, (0, 99))
        if word not in FUNCTIONS:
            yield "function", f"{name[:40]} is no function of VAL 3", _level(word, FUNCTIONS)
        elif not least <= len(given) <= most:
            takes = str(least) if least == most else f"{least} to {most}"
            yield "function", f"{name} takes {takes} arguments, not {len(given)}", "error"
        elif word in MOVES:
            targets = JOINT_TARGETS if word == "movej" else TARGETS
            kinds = [targets] * MOVES[word] + [("tool",), ("mdesc",)]
            for tree, types in zip(given, kinds, strict=True):
                kind = self._type(tree)
                if kind and kind not in types:
                    reason = f"{text_of(tree)[:40]} is of type {kind[:20]}"
                    yield "target", f"{reason}, not {' or '.join(types[:2])}", "error"

    def _type(self, tree: Tree[Token]) -> str:
        """Type of a value; empty where that is not looked into."""
        if tree.data in ("number", "text", "signed"):
            return str(tree.data)
        if tree.data != "place" or any(getattr(c, "type", "") == "FIELD" for c in tree.children):
            return ""
        return self.known.get(name_of(tree), ("",))[0]

    def _of_place(self, place: Tree[Token]) -> Iterator[Fault]:
        name = name_of(place)
        word = name.lower()
        if ":" in name:
            return  # of a library
        if word in KEYWORDS or word in FUNCTIONS:
            yield "name", f"{name[:40]} is a word of VAL 3, and no variable", "error"
        elif name not in self.known and word not in PREDEFINED and self.whole:
            level = _level(name, [*self.known, *PREDEFINED])
            yield "name", f"{name[:40]} is neither in the data file nor a local", level
        size = self.known.get(name, ("", None))[1]
        if size is not None and int(index_of(place) or 0) >= size:
            yield "target", f"{text_of(place)[:40]} is beyond its size {size}", "error"

    def _of_routine(self, routine: Tree[Token]) -> Iterator[Fault]:
        name, given = name_of(routine), len(arguments_of(routine))
        if ":" in name or not self.whole:
            return  # of a library, or of a project that is not there
        if name not in self.programs:
            self.programs[name] = _parameters(self.path.with_name(f"{name}.pgx"))
        takes = self.programs[name]
        if takes is None:
            yield "target", f"there is no program {name[:40]}", "error"
        elif takes != given:
            yield "target", f"{name[:40]} takes {takes} arguments, not {given}", "error"


def _parameters(path: Path) -> int | None:
    """Number of arguments of a program; None where it is not there."""
    try:
        root = parse_xml(read_program_bytes(path))
    except (FileFormatError, XmlFault):
        return None
    return sum(1 for _ in root.all("Parameter", "param"))


def _data_beside(path: Path) -> list[Node] | None:
    """Data of the project; None where there is not one file of them beside."""
    try:
        files = sorted(path.parent.glob("*.dtx"))
        root = parse_xml(read_program_bytes(files[0])) if len(files) == 1 else None
    except (OSError, FileFormatError, XmlFault):
        return None
    if root is None:
        return None
    if root.name == "dataList":
        return [data for section in root.children for data in section.children]
    return list(root.all("Data"))
