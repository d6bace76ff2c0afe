"""Files of VAL 3 projects as trees: XML with its lines, and the statements of the code in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from defusedxml import DefusedXmlException, ElementTree
from lark import Token, Tree

from calib.errors import FileFormatError
from posedesign.programs.language import (
    Language,
    Statement,
    nodes,
    shared,
    subtrees,
    text_of,
    without_remarks,
)
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM, read_program_bytes

_KEYWORDS = """and begin break call case default do else elseif end endfor endif endswitch endwhile
    for if or return step switch taskcreate taskcreatesync to until while xor"""
KEYWORDS = frozenset(_KEYWORDS.split())

_PREDEFINED = """true false world flange off joint cartesian lefty righty ssame sfree epositive
    enegative esame efree wpositive wnegative wsame wfree"""
PREDEFINED = frozenset(_PREDEFINED.split())
"""Names that no data file declares; in small letters, as all words here."""

_COUNTED = {
    (0, 0): """clock disablepower enablepower esstatus getmonitorspeed getmoveid herej iscalibrated
        isempty ispowered issettled restartmove stopmove waitendmove""",
    (0, 1): "cls getkey libsave resetmotion workingmode",
    (1, 1): """abs acos aioget asin autoconnectmove chr clearbuffer close cos delay dioget exp ln
        isinrange log open round rounddown roundup setmonitorspeed setmutex sin
        sqrt tan taskkill taskstatus tasksuspend trunc wait""",
    (1, 2): "libload logmsg popupmsg put putln size title",
    (0, 2): "userpageset",
    (2, 2): """power aiolink aioset appro diolink dioset distance here max min sioget siolink sioset
        taskresume tostring watch""",
    (3, 3): "limit movej movel sel tonum",
    (4, 4): "movec",
    (0, 99): """accel align alter alterbegin alterend altermovec altermovej altermovel alterstoptime
        append asc atan band bnot bor bxor compose delete find first frombinary get getdate
        getdisplaylen getjointforce getlanguage getlatch getpositionerr getprofile getspeed
        getversion gotoxy help insert interpolatec interpolatel iobusstatus iostatus isdefined
        isin iskeypressed jointtopoint last left len libdelete libexist liblist libpath link mid
        movejf movelf next pointtojoint position pow prev random replace resetturn resize right
        safetyfault setframe setlanguage setlatch setmoveid setprofile sioctrl tobinary userpage""",
}
FUNCTIONS = {name: counts for counts, names in _COUNTED.items() for name in names.split()}
"""Least and most arguments of a function."""

TARGETS = ("pointRx", "pointRs", "point")
JOINT_TARGETS = ("jointRx", "jointRs", "joint", *TARGETS)

JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6")
POINT = ("x", "y", "z", "rx", "ry", "rz")
CONFIG = ("shoulder", "elbow", "wrist")
_COORDINATES = " ".join(POINT)
_SPEEDS = "accel vel decel tmax rmax leave reach"
_CONFIG = " ".join(CONFIG)
VALUES = {
    "jointRx": " ".join(JOINTS),
    "jointRs": " ".join(JOINTS[:4]),
    "pointRx": f"{_COORDINATES} {_CONFIG} fatherId",
    "pointRs": f"{_COORDINATES} shoulder fatherId",
    "frame": f"{_COORDINATES} fatherId",
    "tool": f"{_COORDINATES} fatherId ioLink",
    "trsf": _COORDINATES,
    "config": _CONFIG,
    "mdesc": f"{_SPEEDS} blend",
    **dict.fromkeys(("num", "bool", "string"), "value"),
    **dict.fromkeys(("aio", "dio", "sio"), "link"),
    "screen": "",
}
"""Types of data, and the attributes of their values beside the key; any can be left out."""

LIMITS = {
    **dict.fromkeys(JOINTS, MOST_JOINT_DEG),
    **dict.fromkeys(POINT[:3], MOST_POSITION_MM),
    **dict.fromkeys(POINT[3:], 360.0),
    **dict.fromkeys(_SPEEDS.split(), 1e6),
}
"""Attributes that are numbers, and the largest that is believed [deg, mm, percent]."""

POSITIVE = frozenset(_SPEEDS.split())  # speeds, accelerations and distances: 0 or more

XSI_TYPE = "{http://www.w3.org/2001/XMLSchema-instance}type"

FORMS = {
    "name": r"[A-Za-z]\w{0,99}",
    "type": r"(?:[A-Za-z]\w{0,99}:)?[A-Za-z]\w{0,99}",
    "size": r"\d{1,6}(?: \d{1,6}){0,2}",
    "dimensions": r"[1-3]",
    "shoulder": "lefty|righty|sfree|ssame",
    "elbow": "epositive|enegative|efree|esame",
    "wrist": "wpositive|wnegative|wfree|wsame",
    "blend": "off|joint|[Cc]artesian",
    "access": "public|private",
    "use": "value|reference",
    "file": r"(?:[A-Za-z][\w -]{0,40}[/\\]){0,5}[A-Za-z]\w{0,99}\.(?:pgx|dtx)",
    "version": r"s\d{1,3}(?:\.\d{1,3}){0,2}(?:[A-Za-z][\w.-]{0,30})?",
    "stackSize": r"\d{1,9}",
    "millimeterUnit": "true|false",
    "autoload": "true|false",
    XSI_TYPE: "array|collection|element",
}
"""Patterns of attributes that are one of several words, or have a form."""

_DECLARED = f"name! type! size access {XSI_TYPE}!"
ELEMENTS = {
    ".dtx": {
        "Database": ("", "Datas!"),
        "Datas": ("", "Data*"),
        "Data": (_DECLARED, "Value*"),
        "Field": (_DECLARED, "Value*"),
    },
    ".pjx": {
        "Project": ("", "Parameters! Programs! Database! Libraries Types"),
        "Parameters": ("version! stackSize! millimeterUnit!", ""),
        "Programs": ("", "Program*"),
        "Program": ("file!", ""),
        "Database": ("", "Data!"),
        "Data": ("file!", ""),
        "Libraries": ("", "Library*"),
        "Library": ("alias! path! autoload password", ""),
        "Types": ("", "Type*"),
        "Type": ("name! path!", ""),
    },
    ".pgx": {
        "Programs": ("", "Program!"),
        "Program": ("name! access", "Description Parameters Locals Code!"),
        "Description": ("", ""),
        "Parameters": ("", "Parameter*"),
        "Parameter": (f"name! type! use dimensions {XSI_TYPE}!", ""),
        "Locals": ("", "Local*"),
        "Local": (_DECLARED.removesuffix("!"), "Value*"),
        "Field": (_DECLARED, "Value*"),
        "Code": ("", ""),
    },
}
"""Attributes of elements (! must be there), and what stands in them (! once, * any number of times,
at most once without), by the ending of the file, with the root first.

What stands in a ``Value`` depends on the type.
"""


MOST_NODES = 300_000  # elements of a file that are read: ten times those of 10,000 poses
_MOST_DEPTH = 60


@dataclass(slots=True)
class Node:
    """An element: its name without, and with, the namespace, and the text that stands in it."""

    line: int
    name: str
    tag: str
    attributes: dict[str, str]
    children: list[Node] = field(default_factory=list)
    text: str = ""
    text_line: int = 0

    def get(self, attribute: str) -> str:
        """An attribute; empty where it is not there."""
        return self.attributes.get(attribute, "")

    def all(self, *names: str) -> Iterator[Node]:
        """Elements of these names, itself included, from the top; none inside another of them."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            if node.name in names:
                yield node
            else:
                waiting.extend(reversed(node.children))


class XmlFault(Exception):
    """A file is no XML that is read: its line, what is wrong, and a hint."""

    def __init__(self, line: int, reason: str, hint: str) -> None:
        super().__init__(reason)
        self.line, self.reason, self.hint = max(line, 1), reason, hint


def parse_xml(data: bytes) -> Node:
    """Root of a file; XmlFault where it is no well-formed XML, or has a DTD or entities."""
    return shared(("xml", data), lambda: _parsed(data))


def _parsed(data: bytes) -> Node:
    builder = _Builder()
    try:
        builder.parser.feed(data)
        builder.parser.close()
    except DefusedXmlException:
        reason, hint = "has a DTD or entities", "save the application again"
        raise XmlFault(builder.line, reason, hint) from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        hint = "name the project's data file, NAME.dtx, or copy it again"
        raise XmlFault(builder.line, f"is no whole XML file: {error}"[:200], hint) from None
    return builder.root


def read_xml(path: Path) -> Node | None:
    """Root of a file beside another one; None where it is not there, or no XML that is read."""
    try:
        return parse_xml(read_program_bytes(path))
    except (FileFormatError, XmlFault):
        return None


class _Builder:
    def __init__(self) -> None:
        self.parser = ElementTree.DefusedXMLParser(target=self, forbid_dtd=True)
        self.root = Node(1, "", "", {})
        self.open: list[tuple[Node, list[str]]] = []
        self.count = 0

    @property
    def line(self) -> int:
        return int(self.parser.parser.CurrentLineNumber)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MOST_NODES or len(self.open) >= _MOST_DEPTH:
            what = "too many" if self.count > MOST_NODES else "too deep"
            raise XmlFault(self.line, f"has {what} elements", "is it the file of a project?")
        node = Node(self.line, tag.rpartition("}")[2], tag, attributes)
        if self.open:
            self.open[-1][0].children.append(node)
        else:
            self.root = node
        self.open.append((node, []))

    def end(self, tag: str) -> None:
        # the parser keeps text back until it ends: its first line is told from its last
        node, pieces = self.open.pop()
        node.text = "".join(pieces)
        node.text_line = self.line - node.text.count("\n")

    def data(self, text: str) -> None:
        self.open[-1][1].append(text)

    def close(self) -> None:
        """Take the end of the file."""


LANGUAGE = Language(__package__ or "", joined=without_remarks("//.*", marks="/"), letters=r"\w")


def statements_of(code: Node) -> list[Statement]:
    """Statements of a program's code, with their lines of the file."""
    # a quotation mark in a text has a backslash before it
    text = code.text.replace('\\"', "''")
    return LANGUAGE.statements("\n" * (code.text_line - 1) + text)


MOVES = {"movej": 1, "movel": 1, "movec": 2}
"""Functions that move the arm, with how many targets they begin."""

_INDEX = re.compile(r"0*(\d{1,9})", re.ASCII)


def targets_of(statement: Statement) -> list[tuple[str, str]]:
    """Variables that a statement moves to: name, and index; see :func:`index_of`."""
    return statement.kept(_named)


def _named(statement: Statement) -> list[tuple[str, str]]:
    return [(name_of(place), index_of(place)) for place in statement.nodes(_targets)]


def _targets(tree: Tree[Token]) -> Iterator[Tree[Token]]:
    for function in nodes(tree, "function"):
        for target in subtrees(function)[: MOVES.get(name_of(function).lower(), 0)]:
            if target.data == "place":
                yield target


def functions_in(statement: Statement) -> set[str]:
    """Names of the functions in a statement, in small letters."""
    return {name_of(function).lower() for function in statement.all("function")}


def given_in(statement: Statement) -> str:
    """Name of the variable that a statement gives a value; empty for none."""
    return "".join(statement.texts(_given))


def _given(tree: Tree[Token]) -> list[Token]:
    place = subtrees(tree)[0].children if tree.data == "assignment" else []
    return [c for c in place[:1] if isinstance(c, Token)]


def name_of(tree: Tree[Token]) -> str:
    """Name of a function, program or variable, with its library before a colon."""
    first, *more = tree.children[:2]
    own = [str(child) for child in more if isinstance(child, Token) and child.type == "NAME"]
    return ":".join([str(first), *own])


def index_of(place: Tree[Token]) -> str:
    """First index of a variable: 0 without one, empty where it is computed."""
    own = place.children[1 + (":" in name_of(place)) :][:1]  # not of a field: s.body.nData[44]
    indices = [child for child in own if isinstance(child, Tree)]
    found = _INDEX.fullmatch(text_of(indices[0])) if indices else None
    return "" if indices and not found else found[1] if found else "0"
