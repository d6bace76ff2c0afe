"""Staubli VAL 3 projects: the strict validator of one file (``.dtx``, ``.pjx``, ``.pgx``).

Sources: the maker's XML format as public post-processors, example projects and ros-industrial's
driver use it. Nothing was loaded on a controller.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``xml``                well-formed XML without DTD and entities
``root``               Database, Project or Programs of VAL 3, as the ending of the file says
``data-name``          names of data: a letter, then letters, digits, _, 15 in all; each once
``data-type``          a type of VAL 3, ``xsi:type="array"``, a size
``keys``               values with keys from 0 to size - 1, each once
``attributes``         joints have j1 to j6, points x y z rx ry rz (where they are not zero), arm
                       position and fatherId, and no others
``number``             plain decimal numbers: no exponent, no NaN
``range``              joints within +-720 deg, coordinates within 10 m, angles in (-180, 180]
``config``             lefty, righty; epositive, enegative; wpositive, wnegative; free, same
``father``             fatherId is world, flange, or a frame or tool of the file
``project-files``      a project has start.pgx, stop.pgx, and one data file; each file once
``program-name``       one program, with the name of its file
``code``               begin first, end last, each if, for, while, switch closed
``identifier``         names in calls and moves have at most 15 characters
``instruction``        lines of code are assignments, calls, or begin with words of VAL 3
``target``             where the data file lies beside: movej moves to joints or points, movel and
                       movec to points, that are in it, with a tool and a motion of it, and calls
                       are of programs beside
``wait-to-measure``    waitEndMove() between a move and a call or herej()
=====================  ==========================================================================
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from calib.errors import FileFormatError
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import Problem
from posedesign.programs.staubli_val3.instructions import line_fault
from posedesign.programs.staubli_val3.listing import NAMESPACE, Node, parsed

MOST_PROBLEMS = 1000
"""Most problems told by one check."""

_ROOTS = {
    ".dtx": ("Database", "Data"),
    ".pjx": ("Project", "Project"),
    ".pgx": ("Programs", "Program"),
}
_XSI_TYPE = "{http://www.w3.org/2001/XMLSchema-instance}type"
_NAMES_OF_TYPES = (
    "aio bool config dio frame jointRs jointRx mdesc num pointRs pointRx screen sio string tool "
    "trsf"
)
_TYPES = frozenset(_NAMES_OF_TYPES.split())
_IDENTIFIER = re.compile(r"[A-Za-z]\w{0,14}", re.ASCII)
_WHOLE = re.compile(r"0|[1-9]\d{0,5}", re.ASCII)
_NUMBER = re.compile(r"-?\d{1,6}(?:\.\d{0,12})?", re.ASCII)
_JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6")
_COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
_CONFIG = {
    "shoulder": ("lefty", "righty", "sfree", "ssame"),
    "elbow": ("epositive", "enegative", "efree", "esame"),
    "wrist": ("wpositive", "wnegative", "wfree", "wsame"),
}
_EXPECTED = {
    "jointRx": frozenset(["key", *_JOINTS]),
    "pointRx": frozenset(["key", *_COORDINATES, *_CONFIG, "fatherId"]),
}
_CLOSERS = {"if": "endif", "for": "endfor", "while": "endwhile", "switch": "endswitch"}
_MOVE = re.compile(r"\bmove[jlc]\s*\(\s*(\w+)", re.ASCII)
_WHOLE_MOVE = re.compile(r"\bmove([jlc])\s*\(([^()]*)\)", re.ASCII)
_VARIABLE = re.compile(
    r"([A-Za-z]\w{0,31})\s{0,9}(?:\[\s{0,9}([^\[\]]{1,40}?)\s{0,9}\])?", re.ASCII
)
_CALL = re.compile(r"call\s+(\w+)", re.ASCII)


def check_staubli_val3(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good file. Never fails."""
    root, line, fault = parsed(data)
    if root is None:
        return [Problem(max(line, 1), "xml", fault or "there is nothing in it")]
    suffix = Path(path).suffix.lower()
    name, part = _ROOTS.get(suffix, _ROOTS[".dtx"])
    if not re.fullmatch(rf"{re.escape(NAMESPACE)}/{part}/\d}}{name}", root.tag):
        return [Problem(root.line, "root", f"{root.tag[:80]!a} is not {name} of VAL 3")]
    checks = {".pjx": _check_project, ".pgx": _check_programs}
    found = checks.get(suffix, _check_database)(root, Path(path))
    return list(islice(found, MOST_PROBLEMS))


def _check_database(root: Node, path: Path) -> Iterator[Problem]:
    arrays = list(root.all("Data"))
    counts = Counter(array.attributes.get("name", "") for array in arrays)
    frames = {
        a.attributes.get("name", "")
        for a in arrays
        if a.attributes.get("type") in ("frame", "tool")
    }
    for array in arrays:
        name = array.attributes.get("name", "")
        if not _IDENTIFIER.fullmatch(name) or counts[name] > 1:
            reason = f"{name[:40]!a} is no name, or there twice"
            yield Problem(array.line, "data-name", reason)
        yield from _check_array(array, name, frames)


def _check_array(array: Node, name: str, frames: set[str]) -> Iterator[Problem]:
    kind, size = array.attributes.get("type", ""), array.attributes.get("size", "")
    whole = _WHOLE.fullmatch(size) is not None
    if kind not in _TYPES or array.attributes.get(_XSI_TYPE) != "array" or not whole:
        yield Problem(array.line, "data-type", f"{name[:15]}: {kind[:20]!a} of size {size[:20]!a}")
    seen: set[str] = set()
    for value in array.all("Value"):
        key = value.attributes.get("key", "")
        if not _WHOLE.fullmatch(key) or (whole and int(key) >= int(size)) or key in seen:
            yield Problem(value.line, "keys", f"{name[:15]}[{key[:20]}] is none of {size[:20]}")
        seen.add(key)
        for rule, reason in _value_faults(kind, value.attributes, frames):
            yield Problem(value.line, rule, f"{name[:15]}[{key[:20]}] {reason}")
    if whole and kind in _EXPECTED and len(seen) < int(size):
        yield Problem(array.line, "keys", f"{name[:15]} has {len(seen)} values, its size is {size}")


def _value_faults(
    kind: str, attributes: dict[str, str], frames: set[str]
) -> Iterator[tuple[str, str]]:
    expected = _EXPECTED.get(kind)
    zeros = {*_JOINTS, *_COORDINATES} - set(attributes)  # what is left out is zero
    if expected is not None and set(attributes) | (expected & zeros) != expected:
        wrong = " ".join(sorted((set(attributes) | (expected & zeros)) ^ expected))
        yield "attributes", f"lacks or should not have {wrong[:80]}"
    for name in (*_JOINTS, *_COORDINATES):
        if name in attributes:
            yield from _number_faults(name, attributes[name])
    for name, known in _CONFIG.items():
        if kind == "pointRx" and attributes.get(name, known[0]) not in known:
            yield "config", f"has {name} {attributes[name][:20]!a}"
    father = attributes.get("fatherId")
    if father is not None:
        own = re.fullmatch(r"([A-Za-z]\w{0,14})\[\d{1,4}\]", father, re.ASCII)
        if own is None or own[1] not in {"world", "flange", *frames}:
            yield "father", f"is in {father[:30]!a}, which is not there"


def _number_faults(name: str, text: str) -> Iterator[tuple[str, str]]:
    if not _NUMBER.fullmatch(text):
        yield "number", f"{name} is {text[:30]!a}, not a plain number"
        return
    value = float(text)
    if name in _JOINTS:
        good = abs(value) <= 720.0
    elif name.startswith("r"):
        good = -180.0 < value <= 180.0
    else:
        good = abs(value) <= 10_000.0
    if not good:
        yield "range", f"{name} is {text[:30]}"


def _check_project(root: Node, path: Path) -> Iterator[Problem]:
    programs = [node.attributes.get("file", "") for node in root.all("Program")]
    data = [node.attributes.get("file", "") for node in root.all("Data")]
    twice = [file for file, count in Counter(programs + data).items() if count > 1]
    missing = {"start.pgx", "stop.pgx"} - set(programs)
    if missing or twice or len(data) != 1:
        reason = f"missing {sorted(missing)}, twice {twice[:5]!a}, {len(data)} data files"
        yield Problem(root.line, "project-files", reason)
    for node in root.all("Program"):
        file = node.attributes.get("file", "")
        stem, dot, ending = file.rpartition(".")
        if not dot or ending != "pgx" or not _IDENTIFIER.fullmatch(stem):
            yield Problem(node.line, "project-files", f"{file[:40]!a} is no program")


def _check_programs(root: Node, path: Path) -> Iterator[Problem]:
    programs = list(root.all("Program"))
    names = [node.attributes.get("name", "") for node in programs]
    if names != [path.stem] or not _IDENTIFIER.fullmatch(path.stem):
        yield Problem(root.line, "program-name", f"{path.name} holds {names[:5]!a}")
    for code in root.all("Code"):
        lines = [line.partition("//")[0].strip() for line in code.text.split("\n")]
        numbered = [(row, line) for row, line in enumerate(lines, code.text_line) if line]
        yield from _check_code(numbered, code.line)
        yield from _check_targets(numbered, path)


def _check_code(lines: list[tuple[int, str]], row: int) -> Iterator[Problem]:
    if len(lines) < 2 or lines[0][1] != "begin" or lines[-1][1] != "end":
        at = lines[0][0] if lines else row
        yield Problem(at, "code", "the code does not begin with begin and end with end")
    opened: list[tuple[int, str]] = []
    waited = True
    for at, line in lines:
        word = re.split(r"[^A-Za-z]", line, maxsplit=1)[0].lower()
        if word in _CLOSERS:
            opened.append((at, _CLOSERS[word]))
        elif word in _CLOSERS.values() and (not opened or opened.pop()[1] != word):
            yield Problem(at, "code", f"{word} closes nothing")
        moved, called = _MOVE.search(line), _CALL.match(line)
        for name in (moved, called):
            if name and not _IDENTIFIER.fullmatch(name[1]):
                yield Problem(at, "identifier", f"{name[1][:40]!a} is no name")
        if not waited and (called or "herej(" in line):
            yield Problem(at, "wait-to-measure", "no waitEndMove() since the last move")
        waited = "waitEndMove(" in line or (waited and not moved)
    for at, line in lines[1:-1]:
        fault = line_fault(line)
        if fault:
            yield Problem(at, "instruction", fault)
    for at, word in opened:
        yield Problem(at, "code", f"{word} is missing")


def _check_targets(lines: list[tuple[int, str]], path: Path) -> Iterator[Problem]:
    beside = _data_beside(path)
    if beside is None:
        return
    for at, line in lines:
        moved, called = _WHOLE_MOVE.search(line), _CALL.match(line)
        if called and not path.with_name(f"{called[1]}.pgx").is_file():
            yield Problem(at, "target", f"there is no program {called[1][:30]}")
        if not moved:
            continue
        given = [part.strip() for part in moved[2].split(",")]
        targets = 2 if moved[1] == "c" else 1
        kinds = [("pointRx", "jointRx") if moved[1] == "j" else ("pointRx",)] * targets
        kinds += [("tool",), ("mdesc",)]
        if len(given) != len(kinds):
            yield Problem(at, "target", f"move{moved[1]} takes {len(kinds)} arguments")
            continue
        for text, known in zip(given, kinds, strict=True):
            fault = _data_fault(text, known, beside)
            if fault:
                yield Problem(at, "target", fault)


def _data_fault(text: str, kinds: tuple[str, ...], beside: dict[str, tuple[str, int]]) -> str:
    """What is wrong with an argument of a move; expressions are not looked into."""
    named = _VARIABLE.fullmatch(text)
    if named is None or named[1] in ("flange",):
        return "" if text and (named or not text[0].isdigit()) else f"{text[:30]!a} is no target"
    if named[1] not in beside:
        return f"{named[1]} is not in the data file"
    kind, size = beside[named[1]]
    if kind not in kinds:
        return f"{named[1]} is of type {kind[:20]}, not {' or '.join(kinds)}"
    index = named[2] or "0"
    if index.isdecimal() and int(index) >= size:
        return f"{named[1]}[{index}] is beyond its size {size}"
    return ""


def _data_beside(path: Path) -> dict[str, tuple[str, int]] | None:
    """Type and size of the data of the project by name; None where its file is not beside."""
    try:
        files = sorted(path.parent.glob("*.dtx"))
        root = parsed(read_program_bytes(files[0]))[0] if len(files) == 1 else None
    except (OSError, FileFormatError):
        return None
    if root is None:
        return None
    out = {}
    for array in root.all("Data"):
        size = array.attributes.get("size", "1")
        whole = int(size) if _WHOLE.fullmatch(size) else 0
        out[array.attributes.get("name", "")] = (array.attributes.get("type", ""), whole)
    return out
