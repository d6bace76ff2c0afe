"""FANUC ``.LS`` as the strict validator sees it: lines sorted into sections, nothing interpreted.

This shares no code with the reader and the writer, so that a mistake in one of them shows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_SECTION = re.compile(r"/(PROG|ATTR|APPL|MN|POS|END)(?![A-Za-z_])")
_MOTION = re.compile(r"[JLCAS](?= )")
_HEADER = re.compile(r'P\[(\d{1,6})(?::"[^"\[\]]{0,99}")?\] ?\{')
_GROUP = re.compile(r"GP(\d):")
_FRAMES = re.compile(r"UF : (\d{1,3}|F), UT : (\d{1,3}|F)(?:,\s{0,9}CONFIG : '([^']{0,99})')?,")
_FIELD = re.compile(r"\s*([JXYZWPRE]\d?) ?=\s*(\S+?)\s*(deg|mm)\s*")
_SUB_LINE = re.compile(r" {5,20}(?:\d{1,4}| *)")


@dataclass(frozen=True)
class Instruction:
    """A numbered line of /MN with its continuation lines; ``fault`` says what is malformed."""

    line: int
    number: int | None
    motion: str
    code: str
    fault: str


@dataclass
class Position:
    """A position of /POS: frames, CONFIG and fields of its first group, all values of all.

    A frame is None where the file leaves it open (F).
    """

    line: int
    number: int
    frames: tuple[int | None, int | None] | None = None
    config: str | None = None
    values: list[tuple[int, str, str]] = field(default_factory=list)  # line, name, text
    own: list[tuple[int, str, str, str]] = field(default_factory=list)  # and unit, of GP1
    joints: set[str] = field(default_factory=set)
    faults: list[tuple[int, str]] = field(default_factory=list)


@dataclass
class Listing:
    """A whole file: for each section the lines between its heading and the next."""

    headings: list[tuple[int, str, str]] = field(default_factory=list)  # line, section, text
    stray: list[int] = field(default_factory=list)
    attributes: list[tuple[int, str]] = field(default_factory=list)
    instructions: list[Instruction] = field(default_factory=list)
    positions: list[Position] = field(default_factory=list)
    faults: list[tuple[int, str]] = field(default_factory=list)


def split_listing(text: str) -> Listing:
    """Sort the lines of a file into its sections; never fails."""
    listing = Listing()
    bodies: dict[str, list[tuple[int, str]]] = {"ATTR": listing.attributes, "MN": [], "POS": []}
    section = ""
    for row, raw in enumerate(text.split("\n"), start=1):
        line = raw.rstrip("\r")
        heading = _SECTION.match(line)
        if heading:
            section = heading[1]
            listing.headings.append((row, section, line))
        elif section in bodies:
            bodies[section].append((row, line))
        elif section != "APPL" and line.strip():
            listing.stray.append(row)
    _split_instructions(bodies["MN"], listing)
    _split_positions(bodies["POS"], listing)
    return listing


def _split_instructions(lines: list[tuple[int, str]], listing: Listing) -> None:
    joined: list[tuple[int, str, list[str]]] = []  # line, text before the colon, texts behind it
    for row, line in lines:
        head, colon, body = line.partition(":")
        if colon and not head.strip() and joined:
            # A long instruction goes on in lines that have a colon, but no number.
            joined[-1][2].append(body.strip())
        elif joined and (_SUB_LINE.fullmatch(head) if colon else line.startswith("       ---")):
            continue  # instructions inside an instruction (TC_ONLINE) have numbers of their own
        else:
            joined.append((row, head, [body.rstrip()]) if colon else (row, "", [line]))
    listing.instructions.extend(_instruction(row, head, " ".join(b)) for row, head, b in joined)


def _instruction(row: int, head: str, body: str) -> Instruction:
    number = int(head) if re.fullmatch(r" *\d{1,9}", head) else None
    fault = ""
    if number is None or head != f"{number:4d}":
        fault = "a line starts with its number, right-aligned in four characters, and a colon"
    elif not body.rstrip().endswith(";"):
        fault = "a line ends in ' ;'"
    motion = _MOTION.match(body)
    if not fault and not motion and not body.startswith("  "):
        fault = "behind the colon stands a motion letter, or two spaces and an instruction"
    code = body.rstrip().removesuffix(";").strip()
    if code.startswith(("!", "//", "--")):
        code = ""  # a remark, or a line that is switched off
    # Names inside brackets and quotes are free text: they must not be taken for instructions.
    code = re.sub(r"'[^']*'", "''", re.sub(r":[^\[\]:]{0,64}\]", "]", code))
    return Instruction(row, number, motion[0] if motion else "", code, fault)


def _split_positions(lines: list[tuple[int, str]], listing: Listing) -> None:
    position: Position | None = None
    group, comma = "", True
    for row, line in lines:
        text = line.strip()
        header, heading = _HEADER.fullmatch(text), _GROUP.fullmatch(text)
        if header:
            if position is not None:
                position.faults.append((row, "is not closed by };"))
            position = Position(row, int(header[1]))
            listing.positions.append(position)
            group, comma = "", True
        elif position is None:
            if text:
                listing.faults.append((row, f"{text[:30]!a} is outside a position"))
        elif text == "};":
            if comma and position.values:
                position.faults.append((row, "has a comma behind its last value"))
            position = None
        elif heading:
            group, comma = heading[1], True
        elif group:
            comma = _take_fields(position, row, text, group == "1", comma)
        else:
            position.faults.append((row, "has no group GP1: before its values"))
    if position is not None:
        position.faults.append((position.line, "is not closed by };"))


def _take_fields(position: Position, row: int, text: str, first: bool, comma: bool) -> bool:
    """Add one line of values to a position; return whether it ends in a comma."""
    frames = _FRAMES.fullmatch(text)
    if frames:
        if first:
            user, tool = (None if f == "F" else int(f) for f in frames.groups()[:2])
            position.frames, position.config = (user, tool), frames[3]
        return True
    if not comma:
        position.faults.append((row, "has no comma before this line"))
    parts = text.split(",")
    ends_in_comma = parts[-1] == ""
    for part in parts[:-1] if ends_in_comma else parts:
        found = _FIELD.fullmatch(part)
        if not found:
            position.faults.append((row, f"cannot be understood: {part.strip()[:30]!a}"))
            continue
        position.values.append((row, found[1], found[2]))
        if first:
            position.joints.add(found[1])
            position.own.append((row, found[1], found[2], found[3]))
    return ends_in_comma
