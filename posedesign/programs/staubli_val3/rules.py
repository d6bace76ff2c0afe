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
``project-files``      each file once, and there; start.pgx and stop.pgx, which a library need
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
What a program names is looked for where its project, which lists it, and the data lie beside.
"""

from __future__ import annotations

import operator
import re
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

from lark import Token, Tree

from posedesign.programs import rules
from posedesign.programs.language import Block, Statement, block_faults, subtrees, text_of
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.staubli_val3 import project
from posedesign.programs.staubli_val3.project import Node, index_of, name_of

_OLD_ROOTS = ("{DataNameSpace}dataList", "{ProjectNameSpace}project")
_OLD_PROGRAMS = "{ProgramNameSpace}programList"
_SPACE = re.compile(r"\{http://www\.staubli\.com/robotics/VAL3/(?:Data|Project|Program|Param)/\d\}")
_HEAD = re.compile(rb"<\?xml version=.1\.[01]. encoding=.(utf-8|us-ascii|iso-8859-1). ?\?>", re.I)
_XSI = b'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_LENGTH = 15
_WHOLE = re.compile(r"\d{1,6}", re.ASCII)
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
        root = project.parse_xml(data)
    except project.XmlFault as fault:
        return [Problem(fault.line, "xml", fault.reason)]
    if b"<?" in data[:8] and not _HEAD.search(data[:200]):
        return [Problem(1, "xml", f"begins with {data[:40]!a}")]
    if b"xmlns:xsi=" in data[:1000] and _XSI not in data[:1000]:
        return [Problem(root.line, "root", "xsi is none of the namespaces of VAL 3")]
    return rules.told(_check(root, Path(path)))


def _check(root: Node, path: Path) -> Iterator[Problem]:
    suffix = path.suffix.lower() if path.suffix.lower() in project.ELEMENTS else ".dtx"
    expected = next(iter(project.ELEMENTS[suffix]))
    if root.tag == _OLD_PROGRAMS:
        yield from _check_code(root, path)
    elif root.name == expected and _SPACE.match(root.tag):
        yield from _check_elements(root, project.ELEMENTS[suffix])
        special = {".dtx": _check_data, ".pjx": _check_project, ".pgx": _check_programs}
        yield from special[suffix](root, path)
    elif root.tag not in _OLD_ROOTS:
        yield Problem(root.line, "root", f"{root.tag[:80]!a} is not {expected} of VAL 3")


def _level(word: str, known: Collection[str], alike: float = 0.7) -> Level:
    """Error where a word is nearly a known one: it may otherwise be of a library or newer."""
    # a known word is one as well
    return "error" if word in known or rules.near(word, known, least=1, alike=alike) else "note"


def _check_elements(root: Node, elements: dict[str, tuple[str, str]]) -> Iterator[Problem]:
    waiting = [root]
    while waiting:
        node = waiting.pop()
        attributes, content = elements[node.name]
        inside = {name.rstrip("!*"): name[-1] for name in content.split()}
        yield from _check_attributes(node, attributes, node.get("name"))
        if "type" in node.attributes:
            yield from _check_array(node)
        if node.text.strip() and node.name not in ("Code", "Description"):
            yield Problem(node.line, "xml", f"{node.text.strip()[:30]!a} stands in {node.name}")
        counts = Counter(child.name for child in node.children)
        for name, mark in inside.items():
            if counts[name] != 1 and (mark == "!" or (mark != "*" and counts[name])):
                yield Problem(node.line, "xml", f"{node.name} has {counts[name]} {name}, not one")
        for child in node.children:
            if child.name not in inside or not _SPACE.match(child.tag):
                # parts of a project or a program may be newer
                known = child.name in elements or node.name not in ("Project", "Program")
                level = "error" if known else _level(child.name, elements)
                yield Problem(child.line, "xml", f"{child.tag[-60:]!a} is in {node.name}", level)
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
    for name in [name for name, needed in names.items() if needed and name not in node.attributes]:
        yield Problem(node.line, "attributes", f"{label[:40]}: {name[-40:]} is missing")
    for name, text in node.attributes.items():
        said = f"{label[:40]}: {name[-40:]} is {text[:30]!a}"
        if name not in names:
            # of a position all are known
            level = "error" if names.keys() & project.LIMITS.keys() else _level(name, names)
            yield Problem(node.line, "attributes", f"{said}, of no meaning", level)
        elif name in project.FORMS and not re.fullmatch(project.FORMS[name], text, re.ASCII):
            yield Problem(node.line, "attributes", said)
        elif name in project.LIMITS and not _NUMBER.fullmatch(text):
            yield Problem(node.line, "number", f"{said}, not a plain number")
        elif name in project.LIMITS and not (
            -project.LIMITS[name] * (name not in project.POSITIVE)
            <= float(text)
            <= project.LIMITS[name]
        ):
            yield Problem(node.line, "range", said)


def _check_array(array: Node) -> Iterator[Problem]:
    """Type, size and values of data, a field, a local or a parameter."""
    name, kind = array.get("name")[:40], array.get("type")
    known = kind in project.VALUES or kind in ("joint", "point")
    if not known and not any(value.children for value in array.children):
        reason = f"{name} is of type {kind[:30]!a}"
        yield Problem(array.line, "data-type", reason, _level(kind, project.VALUES))
    size = re.fullmatch(project.FORMS["size"], array.attributes.get("size", "1"), re.ASCII)
    if array.get(project.XSI_TYPE) == "collection" or not size:
        return
    bounds = [int(text) for text in size[0].split()]
    seen: set[str] = set()
    for value in array.children:
        key, text = value.get("key"), value.get("value")
        label = f"{name}[{key[:20]}]"
        parts = [int(part) for part in key.split(",")] if _KEY.fullmatch(key) else []
        inside = len(parts) == len(bounds) and all(map(operator.lt, parts, bounds))
        if not inside or key in seen:
            yield Problem(value.line, "keys", f"{label} is none of {size[0]}, or there twice")
        seen.add(key)
        if known:
            yield from _check_attributes(value, "key! " + project.VALUES.get(kind, ""), label)
        if kind == "num" and "value" in value.attributes and not _NUMBER.fullmatch(text):
            yield Problem(value.line, "number", f"{label} is {text[:30]!a}, not a plain number")
        if kind == "bool" and text not in ("", "true", "false"):
            yield Problem(value.line, "attributes", f"{label} is {text[:30]!a}")
    count = len(array.children)
    if kind in project.JOINT_TARGETS and len(bounds) == 1 and count < bounds[0]:
        reason = f"{name} has {count} positions, its size is {bounds[0]}"
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
    files = [node.get("file") for node in root.all("Program", "Data")]
    beside = [other.name for other in path.parent.iterdir()] if path.is_file() else []
    beside = [name for name in beside if name != path.name]
    for file, count in Counter(files).items():
        if count > 1:
            yield Problem(root.line, "project-files", f"{file[:40]!a} is there twice")
        if file not in beside and _level(file, beside, 0.85) == "error":
            yield Problem(root.line, "project-files", f"{file[:40]!a} is not there")
    missing = {"start.pgx", "stop.pgx"} - set(files)
    if missing:
        yield Problem(root.line, "project-files", f"has no {' and '.join(sorted(missing))}", "note")


def _check_programs(root: Node, path: Path) -> Iterator[Problem]:
    names = [node.get("name") for node in root.all("Program")]
    if [name.lower() for name in names] != [path.stem.lower()]:
        yield Problem(root.line, "program-name", f"{path.name} holds {names[:5]!a}")
    yield from _check_code(root, path)


def _check_code(root: Node, path: Path) -> Iterator[Problem]:
    scope = _Scope(path, root)
    for code in root.all("Code", "code"):
        statements = project.statements_of(code)
        kinds = [statement.kind for statement in statements]
        if kinds[:1] + kinds[-1:] + sorted(k for k in kinds if k in ("begin", "end")) != _ENDS:
            reason = "the code does not begin with begin and end with end, once each"
            yield Problem(code.text_line, "code", reason)
        yield from block_faults(statements, _BLOCKS, "code")
        yield from rules.judged(statements, scope.check)
        stands, whole, moved = True, True, set()
        for statement in statements:
            if statement.fault:
                whole = False
                continue
            called = statement.once(project.functions_in)
            if not stands and (statement.kind == "call" or "herej" in called):
                reason = "no waitEndMove() since the last move"
                yield Problem(statement.row, "wait-to-measure", reason, "measuring")
            stands = "waitendmove" in called or (stands and not called & project.MOVES.keys())
            moved.update(project.targets_of(statement))
        own = next((name for name in ("jPose", "pPose") if name in scope.known), "")
        if path.stem == "start" and own and "sPlan" in scope.known and whole:
            size = scope.known[own][1] or 0
            left = size - sum(name == own for name, _ in moved)
            if left > 0:
                reason = f"{left} of {size} positions in {own} are never moved to"
                yield Problem(code.text_line, "unused", reason, "measuring")


_ENDS = ["begin", "end", "begin", "end"]


class _Scope:
    """What a program can name: data and programs of its project, its parameters and locals.

    Attributes
    ----------
    known : dict
        Types of variables, and their sizes where they have one.
    whole : bool
        Whether the project is there, so that a name that is not known is wrong.
    programs : dict
        Numbers of arguments of the programs; None where the file is not there.
    """

    def __init__(self, path: Path, root: Node) -> None:
        listed, data = _files_beside(path)
        files = [Path(f) for f in listed if re.fullmatch(project.FORMS["file"], f, re.ASCII)]
        self.whole = path.name in [file.name for file in files]
        self.programs = {f.stem: _parameters(path.parent / f) for f in files if self.whole}
        self.known: dict[str, tuple[str, int | None]] = {}
        for node in [*data, *root.all("Parameter", "Local", "param", "local")]:
            size = int(node.get("size")) if _WHOLE.fullmatch(node.get("size")) else None
            self.known[node.get("name")] = node.get("type") or node.name, size

    def check(self, statement: Statement) -> Iterator[Problem]:
        """What is wrong with a statement, or the names in it."""
        if statement.fault:
            yield Problem(statement.row, "syntax", statement.fault)
        checks = {
            "function": self._of_function,
            "routine": self._of_routine,
            "place": self._of_place,
        }
        for tree in statement.all(*checks):
            if ":" not in name_of(tree):  # else of a library
                for rule, reason, level in checks[tree.data](tree):
                    yield Problem(statement.row, rule, reason, level)

    def _of_function(self, function: Tree[Token]) -> Iterator[rules.Fault]:
        name, given = name_of(function), subtrees(function)
        word = name.lower()
        if name.startswith("$"):
            return  # of an option
        least, most = project.FUNCTIONS.get(word, (0, 99))
        if name in self.programs and word not in project.FUNCTIONS:
            yield "function", f"{name[:40]} is a program, and needs a call", "error"
        elif word not in project.FUNCTIONS:
            yield (
                "function",
                f"{name[:40]} is no function of VAL 3",
                _level(word, project.FUNCTIONS),
            )
        elif not least <= len(given) <= most:
            takes = str(least) if least == most else f"{least} to {most}"
            yield "function", f"{name} takes {takes} arguments, not {len(given)}", "error"
        elif word in project.MOVES:
            targets = project.JOINT_TARGETS if word == "movej" else project.TARGETS
            kinds = [targets] * project.MOVES[word] + [("tool",), ("mdesc",)]
            for tree, types in zip(given, kinds, strict=True):
                kind = self._type(tree)
                if kind and kind not in types:
                    reason = f"{_shown(tree)} is of type {kind[:20]}, not {' or '.join(types)}"
                    yield "target", reason, "error"

    def _type(self, tree: Tree[Token]) -> str:
        """Type of a value; empty where that is not looked into."""
        if tree.data in ("number", "text", "signed"):
            return str(tree.data)
        if tree.data != "place" or any(getattr(c, "type", "") == "FIELD" for c in tree.children):
            return ""
        return self.known.get(name_of(tree), ("",))[0]

    def _of_place(self, place: Tree[Token]) -> Iterator[rules.Fault]:
        name = name_of(place)
        word = name.lower()
        is_data = name in self.known  # and the controller has saved it so
        if word in project.KEYWORDS or (word in project.FUNCTIONS and not is_data):
            yield "name", f"{name[:40]} is a word of VAL 3, and no variable", "error"
        elif name not in self.known and word not in project.PREDEFINED and self.whole:
            yield "name", f"{name[:40]} is neither in the data file nor a local", "error"
        size = self.known.get(name, ("", None))[1]
        if size is not None and int(index_of(place) or 0) >= size:
            yield "target", f"{_shown(place)} is beyond its size {size}", "error"

    def _of_routine(self, routine: Tree[Token]) -> Iterator[rules.Fault]:
        name, given = name_of(routine), len(subtrees(routine))
        takes = self.programs.get(name)
        if self.whole and takes is None:
            yield "target", f"{name[:40]} is no program of the project", "error"
        elif takes not in (None, given):
            yield "target", f"{name[:40]} takes {takes} arguments, not {given}", "error"


def _shown(value: Tree[Token]) -> str:
    if value.data != "place":
        return text_of(value)[:40]
    return name_of(value)[:40] + f"[{index_of(value)}]" * (len(value.children) > 1)


def _parameters(path: Path) -> int | None:
    """Number of arguments of a program; None where it is not there."""
    root = project.read_xml(path)
    return None if root is None else sum(1 for _ in root.all("Parameter", "param"))


def _files_beside(path: Path) -> tuple[list[str], list[Node]]:
    """Programs of the project, and its data, where there is one file of each beside; else none."""
    found = [sorted(path.parent.glob(f"*.{end}")) for end in ("pjx", "dtx")]
    listed, data = (project.read_xml(files[0]) if len(files) == 1 else None for files in found)
    if listed is None or data is None:
        return [], []
    files = [node.get("file").replace("\\", "/") for node in listed.all("Program", "program")]
    old = [array for section in data.children for array in section.children]
    return files, old if data.tag in _OLD_ROOTS else list(data.all("Data"))
