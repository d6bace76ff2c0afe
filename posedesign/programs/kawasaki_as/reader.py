"""Kawasaki AS programs: the reader of what controllers save.

A file may hold programs, lists and settings of a whole controller. Positions are those of lists of
joint values (``.JOINTS``) and, in a file that no plan has marked, of steps (``#[...]``).
Transformations (``.TRANS``) are as often frames, tools or shifts, and are left out. Those of the
program with the mark of a plan have their numbers in their names, ``#NAME.p[3]``; where it keeps
touched-up ones, ``#NAME.m[3]`` takes their place. Controllers save names in small letters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from posedesign.programs.joint_programs import Notes, joints_of, refuse_lost
from posedesign.programs.language import Language, Line, lines_of, nodes, text_of
from posedesign.programs.numbering import Named, Numbering
from posedesign.programs.reading import refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import PlanMark, RecordedPosition, RecordedProgram

LISTS = ("joints", "trans")
_SECTION = re.compile(r"\.([a-z]\w*)(?=\s*$|\s+[^=\s])", re.I)
_REMARK = re.compile(r"""("[^"\n]*")|;.*""")
_NOTE = re.compile(r"\s*(?:\.PROGRAM\s+([\w.]{1,99})|;\s*(.*)|HERE\s+#[\w.]+\[(\d{1,5})\])", re.I)


def _sections(lines: Iterator[Line]) -> Iterator[Line]:
    """Lines of programs and lists, and the heads of all sections."""
    inside = ""
    for line in lines:
        text = _REMARK.sub(lambda found: found[1] or "", line.text).rstrip()
        if not text or text[:2] == ".*":
            continue
        head = _SECTION.match(text)
        if head:
            was, inside = inside, head[1].lower()
            if inside == "end" and was not in ("program", *LISTS, "end", ""):
                continue
        elif inside in LISTS:
            text = ",".join(text.split())
        elif inside not in ("program", "end", ""):
            continue
        yield Line(line.row, text)


LANGUAGE = Language(__package__ or "", joined=_sections, start="line", signed=True, letters=r"\w.")


@dataclass(eq=False)
class _Stored(Named):
    """A position as it stands in the file."""

    values: list[str]


_Planned = tuple[str, Notes, tuple[int, int] | None]


def _planned(text: str, path: Path) -> _Planned:
    """Name and remarks of the program of a plan, and what its first HERE keeps of which pose."""
    found: _Planned = ("", Notes(), None)
    name, notes, first = found
    for line in lines_of(text):
        program, remark, element = ((m := _NOTE.match(line.text)) and m.groups()) or ("", "", "")
        if program:
            name, notes, first = program.lower(), Notes(), None
        elif remark:
            notes.take(line.row, remark)
        elif element and not first and notes.rows:
            first = int(element), [*notes.rows.values()][-1]
        if notes.mark and found[1].mark and name != found[0]:
            refuse("two programs are of a plan", path, line.row, "save them one by one")
        if notes.mark:
            found = name, notes, first
    return found


def parse_kawasaki_as(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    name, notes, first = _planned(text, path)
    stored: dict[str, _Stored] = {}
    for s in LANGUAGE.statements(text):
        if s.fault and s.text[:1] == "#":
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        if s.kind == "position" and s.text[0] == "#":
            variable = s.word("ENTRY").lower()
            if variable in stored:
                refuse(f"{variable} is there twice", path, s.row)
            stored[variable] = _Stored(variable, s.row, [str(v) for v in s.tree.children[1:]])
        elif s.kind in ("move", "taught") and notes.mark is None:
            for step in s.all("inline"):
                values = [text_of(value) for value in nodes(step, "sum")]
                stored[f"step {len(stored)}"] = _Stored("", s.row, values)
    found = list(stored.values())
    refuse_lost([(p.variable, p.line, p.values) for p in found], path)
    numbered, element = (re.compile(rf"#{re.escape(name)}\.{x}\[(\d{{1,5}})\]") for x in "pm")
    numbering = Numbering(numbered, element, notes.mark, notes.names, first)
    positions = []
    for n, p in numbering.of(found, path) if notes.mark else enumerate(found, start=1):
        shown = joints_of(p.label, p.line, p.values, path)
        own = p.name if notes.mark else p.variable
        positions.append(RecordedPosition(n, own, p.line, shown))
    untouched = bool(notes.mark) and numbering.is_untouched(found)
    mark, name = notes.mark or PlanMark(), name if notes.mark else path.stem
    return RecordedProgram(name, "", mark, tuple(positions), "kawasaki", empty_registers=untouched)
