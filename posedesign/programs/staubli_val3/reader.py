"""Staubli VAL 3 projects: the reader of their data (``NAME.dtx``).

Of projects as they are written (they have ``sPlan``) the elements of ``jPose`` or ``pPose`` are
read, element k - 1 as number k; where there is ``jActual``, its joints in place of those that were
planned: poses of which it holds nothing but zeros were not measured and are left out; where it
holds nothing else, the planned positions are read, and marked as such. Of other projects the
elements of all arrays of joints and points are taken, in the order of the file; where ``start.pgx``
lies beside it and says which of them are moved to, these, in the order of their moves.

A controller leaves out attributes that are zero; an element of other arrays that is not there at
all is refused. Frames of points that are in the file, and the tool ``tTool`` of a project as it is
written, are taken by value; points in several frames are refused where one is not. Points whose arm
position is ``same`` or not said are taken without one. XML with a DTD or entities is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray, rotation_from_moving_xyz, transform
from posedesign.programs import reading
from posedesign.programs.configurations import StaubliConfiguration
from posedesign.programs.language import Statement, subtrees
from posedesign.programs.notation import Literal
from posedesign.programs.reading import read_program_bytes, refuse
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram
from posedesign.programs.staubli_val3 import project
from posedesign.programs.staubli_val3.project import CONFIG, JOINTS, POINT, Node

MOST_ELEMENTS = 100_000  # largest size of an array that is believed
_KINDS = {"jointRx": "joint", "joint": "joint", "pointRx": "point", "point": "point"}
_ELEMENT = re.compile(r"([A-Za-z]\w{0,31})\[(\d{1,6})\]", re.ASCII)
_DEEPEST = 20  # frames in frames
_SAVE = "save the application again"
_NAME_DATA = "name the project's data file, NAME.dtx"
_WHOLE = re.compile(r"\d{1,6}", re.ASCII)


@dataclass(frozen=True)
class _Array:
    """A ``Data`` and its values by key."""

    line: int
    name: str
    type: str
    size: int
    elements: dict[int, Node] = field(default_factory=dict)


class _Data(dict[str, _Array]):
    """Arrays of a data file by name, in their order."""

    path: Path

    def first(self, name: str) -> Node | None:
        return self[name].elements.get(0) if name in self else None

    def string(self, name: str) -> str:
        first = self.first(name)
        return first.get("value") if first else ""

    def refuse(self, message: str, row: int | None, hint: str = _SAVE) -> NoReturn:
        refuse(message, self.path, row, hint)


def parse_staubli_val3(data: bytes, path: Path) -> RecordedProgram:
    """Project whose data are the content of a file; see the module."""
    if path.suffix.lower() in (".pjx", ".pgx"):
        reading.no_positions(path, _NAME_DATA)
    arrays = _arrays(data, path)
    own = "sPlan" in arrays
    listed, empty = _own(arrays) if own else (_others(arrays), False)
    changed = _changed(arrays.path)
    gone = [p for p in listed if {p[2].name, f"{p[2].name}[{p[3]}]"} & changed.keys()]
    listed = [p for p in listed if p not in gone]
    unread = [_unread(array, key, changed, path) for _, _, array, key in gone]
    for error in unread if not listed else ():
        raise error
    positions = _recorded(listed, arrays, arrays.first("tTool") if own else None)
    if not positions:
        reading.no_positions(path, "save the application that was touched up")
    mark = PlanMark.found_in(arrays.string("sPlan")) or PlanMark()
    title = arrays.string("sTitle")
    return RecordedProgram(
        *(path.stem, title, mark, positions, "staubli"), empty_registers=empty, unread=tuple(unread)
    )


def _unread(array: _Array, key: int, changed: dict[str, int], path: Path) -> FileFormatError:
    label = f"{array.name}[{key}]"
    reason = f"{label} is changed by start.pgx, line {changed.get(label) or changed[array.name]}"
    hint = "give it its values in the data"
    return FileFormatError(reason, path=path, row=array.line, hint=hint)


def _changed(path: Path) -> dict[str, int]:
    """Elements, or whole arrays, that the program beside the data changes and then moves to.

    With the lines of its file.
    """
    found: dict[str, int] = {}
    given: dict[str, int] = {}
    statements = [*_started(path)]
    moved = {name for s in statements for name, _ in project.targets_of(s)}
    if moved.isdisjoint(map(project.given_in, statements)):
        return {}
    for statement in statements:
        for name, index in project.targets_of(statement):
            own = [n for n in given if n.partition("[")[0] == name]
            found |= {n: given[n] for n in own if not index or n in (name, f"{name}[{index}]")}
        if statement.kind == "assignment":
            place = subtrees(statement.tree)[0]
            name, index = project.name_of(place), project.index_of(place)
            given[f"{name}[{index}]" if index else name] = statement.row
    return found


def _arrays(data: bytes, path: Path) -> _Data:
    try:
        root = project.parse_xml(data)
    except project.XmlFault as fault:
        refuse(fault.reason, path, fault.line, fault.hint)
    if root.name not in ("Database", "dataList"):
        refuse("is no data file of a VAL 3 project", path, root.line, _NAME_DATA)
    arrays = _Data()
    arrays.path = path
    old = (_renewed(array) for section in root.children for array in section.children)
    for node in root.all("Data") if root.name == "Database" else old:
        name, kind, size = node.get("name"), node.get("type"), node.attributes.get("size", "1")
        if not name or name in arrays:
            reason = f"{name[:30]!a} is there twice" if name else "an array has no name"
            refuse(reason, path, node.line)
        if " " in size and kind not in _KINDS:
            continue  # a table of several dimensions holds no positions
        if not _WHOLE.fullmatch(size) or int(size) > MOST_ELEMENTS:
            refuse(f"{name[:30]} has the size {size[:20]!a}", path, node.line)
        array = arrays[name] = _Array(node.line, name, kind, int(size))
        for value in node.children:
            key = value.attributes.get("key", "0")
            if value.name != "Value" or not _WHOLE.fullmatch(key):
                continue  # a collection has words for keys, and is no array of positions
            if int(key) >= array.size or int(key) in array.elements:
                reason = "is there twice" if int(key) in array.elements else "is beyond its size"
                refuse(f"{name}[{int(key)}] {reason}", path, value.line)
            array.elements[int(key)] = value
    return arrays


def _renewed(array: Node) -> Node:
    """An array of a data file of version 6 or before, as the versions since then write it.

    Such files, as SRS saves them in public repositories: ``<point name="p1"><pFather name="fPart"
    fatherIndex="0"/><valuePoint index="0"><tpValue x="366.58" .../><cpValue .../></valuePoint>``.
    """
    father: dict[str, str] = {}
    values = []
    for node in array.children:
        if name := node.get("name"):
            alias = f"{node.get('alias')}:" * bool(node.get("alias"))
            father = {"fatherId": f"{alias}{name}[{node.get('fatherIndex')}]"}
        elif node.name.startswith("value"):
            merged = father | node.attributes
            for part in node.children:
                merged |= part.attributes if part.name.endswith("Value") else {}
            merged["key"] = node.attributes.get("index", "0")
            values.append(replace(node, name="Value", attributes=merged))
    said = {"size": str(len(values)), **array.attributes, "type": array.name}
    return replace(array, attributes=said, children=values)


_Listed = list[tuple[int, str, _Array, int]]
"""Number and name of positions, and where they are: array and key."""


def _own(arrays: _Data) -> tuple[_Listed, bool]:
    """Positions of a project as it is written, by their numbers.

    And whether it has a place of its own for touched-up ones, with none in it.
    """
    array, actual = arrays.get("jPose") or arrays.get("pPose"), arrays.get("jActual")
    if array is None or array.type not in _KINDS:
        arrays.refuse("has sPlan, but no jPose and no pPose", None)
    sources = {k: (array, k) for k in range(array.size)}
    stored = None
    if actual is not None:
        if _KINDS.get(actual.type) != "joint":
            arrays.refuse(f"jActual is of type {actual.type[:20]!a}, not jointRx", actual.line)
        first, text = arrays.first("nFirst"), arrays.string("nFirst")
        if not _WHOLE.fullmatch(text) or int(text) < 1:
            reason = f"nFirst is {text[:20]!r}, not a number from 1 on"
            refuse(reason, arrays.path, first.line if first else None)
        before = int(text) - 1
        kept = range(min(actual.size - before, array.size))
        stored = {k: (actual, before + k) for k in kept if _is_touched(actual, before + k)}
        if stored:
            passed = {k: own for k, own in sources.items() if k not in kept}
            sources = dict(sorted((passed | stored).items()))
    names = arrays["sPose"].elements if "sPose" in arrays else {}
    named = {k: names[k].get("value") if k in names else "" for k in sources}
    return [(k + 1, named[k], *source) for k, source in sources.items()], stored == {}


def _is_touched(array: _Array, key: int) -> bool:
    """Whether an element is there, and has another joint value than zero."""
    element = array.elements.get(key)
    texts = [element.get(joint) for joint in JOINTS] if element else []
    return any(re.search(r"[^-+.0]", text) for text in texts)


def _others(arrays: _Data) -> _Listed:
    taught = {name: array for name, array in arrays.items() if array.type in _KINDS}
    everything = [(name, k) for name, array in taught.items() for k in sorted(array.elements)]
    moved: dict[tuple[str, int], None] = {}
    computed: set[str] = set()
    for name, key in dict.fromkeys(_moved(arrays.path)):
        if name in taught and not key and name not in computed:
            computed.add(name)
            moved.update((own, None) for own in everything if own[0] == name)
        elif name in taught and key and int(key) in taught[name].elements:
            moved[name, int(key)] = None
    keys = [*moved] or everything
    return [(i, f"{name}[{k}]", arrays[name], k) for i, (name, k) in enumerate(keys, start=1)]


def _moved(path: Path) -> Iterator[tuple[str, str]]:
    """What the program beside a data file moves to: name and index, empty where it is computed."""
    for statement in _started(path):
        yield from project.targets_of(statement)


def _started(path: Path) -> Iterator[Statement]:
    """Statements of the program beside a data file that a project begins with."""
    try:
        data = read_program_bytes(path.with_name("start.pgx"))
    except FileFormatError:
        return
    try:
        root = project.parse_xml(data)
    except project.XmlFault:  # the code alone
        root = Node(1, "Code", "", {}, text=data.decode("latin-1"), text_line=1)
    for code in root.all("Code", "code"):
        yield from project.statements_of(code)


def _recorded(listed: _Listed, arrays: _Data, tool: Node | None) -> tuple[RecordedPosition, ...]:
    """Positions of elements; poses with the tool of the project where it is on the flange."""
    out: list[RecordedPosition] = []
    points: list[list[float]] = []
    frames: dict[str, FloatArray | None] = {}
    path = arrays.path
    for number, name, array, key in listed:
        element = array.elements.get(key)
        label = f"{array.name}[{key}]"
        if element is None:
            arrays.refuse(f"{label} is not there", array.line)
        at = RecordedPosition(number, name, element.line)
        if _KINDS[array.type] == "joint":
            texts = [(element.attributes.get(j, "0"), f"{label}: {j}") for j in JOINTS]
            shown = [reading.joint_deg(t, what, path, element.line) for t, what in texts]
            out.append(replace(at, shown_deg=np.array(shown)))
            continue
        own = element.attributes.get("fatherId", "world[0]")
        T_world_user = frames.setdefault(own, _frame(own, arrays))
        if len(frames) > 1 and any(T is None for T in frames.values()):
            reason = f"{label} is in {own[:30]!a}, points before in {next(iter(frames))[:30]!a}"
            arrays.refuse(reason, element.line, "teach all points in one frame")
        at = replace(at, T_world_user=T_world_user)
        points.append(_values(element, label, path))
        out.append(replace(at, configuration=_configuration(element, label, path)))
    if not points:
        return tuple(out)
    _check_unit(path)
    T_tip_tool = None
    on_flange = tool is not None and tool.attributes.get("fatherId", "flange[0]") == "flange[0]"
    if tool is not None and on_flange and arrays["tTool"].type == "tool":
        T_tip_tool = _transforms([_values(tool, "tTool[0]", path)])[0]
    poses = iter(_transforms(points))
    return tuple(
        replace(p, T_user_tool=next(poses), T_tip_tool=T_tip_tool) if p.shown_deg is None else p
        for p in out
    )


def _check_unit(path: Path) -> None:
    """Refuse points of a project whose lengths are no millimetres: of inches nothing public says.

    The project beside the data says it.
    """
    for file in sorted(path.parent.glob("*.pjx")) if path.is_file() else ():
        root = project.read_xml(file) or Node(1, "", "", {})
        names = [node.get("file").lower() for node in root.all("Data", "data")]
        for node in root.all("Parameters", "parameters"):
            if path.name.lower() in names and node.get("millimeterUnit") == "false":
                hint = "save the application with lengths in millimetres"
                refuse("the lengths of the project are not in millimetres", file, node.line, hint)


def _transforms(points: list[list[float]]) -> FloatArray:
    """Poses ``(N, 4, 4)`` [m] of x, y, z [mm] and rx, ry, rz [deg]."""
    values = np.array(points)
    return transform(rotation_from_moving_xyz(np.radians(values[:, 3:])), values[:, :3] * 1e-3)


def _frame(father: str, arrays: _Data) -> FloatArray | None:
    """The frame of this name in the world, by the values in the file; None where it is not."""
    T = np.eye(4)
    for _ in range(_DEEPEST):
        if father == "world[0]":
            return T
        named = _ELEMENT.fullmatch(father)
        array = arrays.get(named[1]) if named else None
        element = array.elements.get(int(named[2])) if named and array is not None else None
        if array is None or array.type != "frame" or element is None:
            return None
        T = _transforms([_values(element, father, arrays.path)])[0] @ T
        father = element.attributes.get("fatherId", "world[0]")
    return None


def _values(element: Node, label: str, path: Path) -> list[float]:
    """Numbers of a point [mm, deg]; what is left out is zero."""
    texts = [element.attributes.get(name, "0") for name in POINT]
    return reading.pose_values(texts, POINT, label, path, element.line)


_TAG = re.compile(r"<[\w:]*Value\b[^<>]*", re.ASCII)
_ATTRIBUTE = re.compile(
    rf"""(?<=\s)({"|".join((*JOINTS, *POINT))})\s*=\s*["']\s*([-+\d.eE]+)\s*["']""", re.ASCII
)


def attributes_of(text: str) -> Iterator[Literal]:
    """The numbers of positions in the text of a data file, those that are left out as zeros.

    Of each value those of a posture, and then those of a point.
    """
    for tag in _TAG.finditer(text):
        found = {attribute[1]: attribute for attribute in _ATTRIBUTE.finditer(tag[0])}
        end = tag.start() + len(tag[0].removesuffix("/").rstrip())
        for name in (*JOINTS, *POINT):
            if name in found:
                start, stop = (tag.start() + place for place in found[name].span(2))
                yield Literal(start, stop, found[name][2])
            else:
                yield Literal(end, end, "0", before=f' {name}="', after='"')


def _configuration(element: Node, label: str, path: Path) -> StaubliConfiguration | None:
    words = [element.get(name) for name in CONFIG]
    if not all(words) or any(word.endswith("same") for word in words):
        return None
    said = " ".join(words)
    return reading.configuration_in(StaubliConfiguration, said, label, path, element.line)
