"""FANUC teach pendant programs in ASCII (``.LS``): the strict validator.

Each rule is one that a controller enforces at load, or that a measuring program needs to measure
what was planned. Sources: programs loaded and run on ROBOGUIDE's virtual controllers
(LeroyDu56/CrossArm, docs/fanuc_ls_format.md), public post-processors and controller exports.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``ascii``              plain ASCII characters
``crlf``               each line ended by CR LF
``sections``           /PROG, /ATTR, /APPL (optional), /MN, /POS, /END, in this order
``program-name``       a capital letter, then A-Z 0-9 _, 36 in all (R-J3iB: 8, which we write)
``line-format``        number, colon, instruction, semicolon
``line-number``        line numbers consecutive from 1
``line-count``         LINE_COUNT is the number of lines
``position-format``    each position complete: frames, six joints or X Y Z W P R, commas, ``};``
``configuration``      CONFIG with a pose, F or N, U or D, T or B and three turns; none with joints
``unit``               joints, W P R in deg, X Y Z in mm
``range``              joints within +-720 deg, W P R in (-180, 180], within 100 m
``motion``             position, speed, FINE or CNT, known options; none that move elsewhere
``instruction``        instructions of the base language
``position-defined``   each position that is used is defined
``position-unique``    each position is defined once
``position-used``      each position that is defined is used
``frame``              a position's UF and UT are the frames active where it is moved to: another
                       one stops the program (INTP-251, INTP-253)
``fine-before-call``   the arm stands (FINE) where a program is called
``number``             plain decimal numbers: no exponent, no NaN, no ``-0.000``
``negative-argument``  negative constants in parentheses: ``CALL X(-1)`` is refused, and
                       ``R[1]<-1`` stops the program
=====================  ==========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice

from posedesign.programs.fanuc_ls.instructions import instruction_fault, motion_fault
from posedesign.programs.fanuc_ls.listing import Listing, Position, split_listing
from posedesign.programs.recorded import Problem

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no program has one in each of its lines."""

_PROG = re.compile(r"/PROG  ([A-Z][A-Z0-9_]{0,35})(?:\t  Macro)?")
_LINE_COUNT = re.compile(r"LINE_COUNT\s*=\s*(\d{1,9})\s*;")
_USED = re.compile(r"\bP\[(\d{1,6})\]")
_INDIRECT = re.compile(r"\bP\[(?!\d)")
_FRAME = re.compile(r"(UFRAME|UTOOL)_NUM\s*=\s*(\d{1,3}$)?")
_DECIMAL = re.compile(r"-?(?:\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})")
_NEGATIVE_ZERO = re.compile(r"-0+(?:\.0*)?")
_ODD_NUMBER = re.compile(
    r"(?<![\w.])[\d.]{1,40}[eE][-+]?\d|(?:[=(,<>]|WAIT )\s*[-+]?(?:nan|inf)\b", re.IGNORECASE
)
_NEGATIVE = re.compile(r"(?:[=<>,]|\bTO|\bCALL \w{1,40}\()\s*-\s*[\d.]")

_CONFIG = re.compile(r"[FN] [UD] [TB], ?-?\d, ?-?\d, ?-?\d")
_MOST_DEG, _MOST_MM = 720.0, 100_000.0

_ORDER = ["PROG", "ATTR", "MN", "POS", "END"]
_JOINT_FORM = {"J1", "J2", "J3", "J4", "J5", "J6"}
_CARTESIAN_FORM = {"X", "Y", "Z", "W", "P", "R"}
_EXTENDED = {"E1", "E2", "E3"}


def check_fanuc_ls(data: bytes) -> list[Problem]:
    """Problems in the content of a file, in the order of its lines."""
    listing = split_listing(data.decode("latin-1"))  # any byte is a character: none is lost
    checks = (
        _check_bytes(data),
        _check_headings(listing),
        _check_lines(listing),
        _check_positions(listing),
        _check_values(listing),
        _check_use(listing),
        _check_motion(listing),
        _check_numbers(listing),
    )
    problems = [problem for check in checks for problem in islice(check, MOST_PROBLEMS)]
    return sorted(problems, key=lambda p: (p.line, p.rule, p.message))


def _check_bytes(data: bytes) -> Iterator[Problem]:
    rows = data.split(b"\n")
    bare = [row for row, line in enumerate(rows[:-1], start=1) if not line.endswith(b"\r")]
    if rows[-1]:
        bare.append(len(rows))
    if bare:
        # A file has one kind of line end: thousands of equal messages would hide the others.
        yield Problem(bare[0], "crlf", f"{len(bare)} lines are not ended by CR LF, this the first")
    for row, line in enumerate(rows, start=1):
        if b"\r" in line[:-1]:
            yield Problem(row, "crlf", "there is a CR inside the line")
        bad = re.search(rb"[^\t\r -~]", line)
        if bad:
            yield Problem(row, "ascii", f"the byte 0x{bad[0][0]:02x} is not plain ASCII text")


def _check_headings(listing: Listing) -> Iterator[Problem]:
    order = [section for _, section, _ in listing.headings]
    plain = [section for section in order if section != "APPL"]
    if plain != _ORDER:
        row = listing.headings[-1][0] if listing.headings else 1
        found = " ".join("/" + section for section in order) or "none"
        yield Problem(row, "sections", f"the sections are {found[:200]}")
    elif any(
        order[i] == "APPL" and order[i - 1] not in ("ATTR", "APPL") for i in range(len(order))
    ):
        yield Problem(listing.headings[-1][0], "sections", "/APPL stands between /ATTR and /MN")
    for row in listing.stray:
        yield Problem(row, "sections", "the line is in no section")
    for row, section, text in listing.headings:
        if section == "PROG" and not _PROG.fullmatch(text):
            reason = "behind /PROG and two spaces: a letter, then A-Z 0-9 _, 36 characters in all"
            yield Problem(row, "program-name", reason)


def _check_lines(listing: Listing) -> Iterator[Problem]:
    expected = 1
    for instruction in listing.instructions:
        if instruction.fault:
            yield Problem(instruction.line, "line-format", instruction.fault)
        if instruction.number not in (None, expected):
            reason = f"line number {instruction.number} where {expected} is due"
            yield Problem(instruction.line, "line-number", reason)
        expected = (instruction.number or expected) + 1
    counts = [(row, _LINE_COUNT.fullmatch(line)) for row, line in listing.attributes]
    stated = [(row, int(found[1])) for row, found in counts if found]
    count = len(listing.instructions)
    if not stated:
        yield Problem(1, "line-count", "/ATTR has no LINE_COUNT")
    for row, value in stated:
        if value != count:
            yield Problem(row, "line-count", f"LINE_COUNT is {value}, /MN has {count} lines")


def _check_positions(listing: Listing) -> Iterator[Problem]:
    for row, fault in listing.faults:
        yield Problem(row, "position-format", fault)
    seen: set[int] = set()
    for position in listing.positions:
        label = f"P[{position.number}]"
        for row, fault in position.faults:
            yield Problem(row, "position-format", f"{label} {fault}")
        if position.frames is None:
            yield Problem(position.line, "position-format", f"{label} has no UF and UT in GP1")
        if position.joints - _EXTENDED not in (_JOINT_FORM, _CARTESIAN_FORM):
            found = " ".join(sorted(position.joints)) or "nothing"
            reason = f"{label} has {found}, not J1 to J6 or X Y Z W P R"
            yield Problem(position.line, "position-format", reason)
        if position.number in seen:
            yield Problem(position.line, "position-unique", f"{label} is defined twice")
        seen.add(position.number)


def _check_values(listing: Listing) -> Iterator[Problem]:
    """Units, ranges and CONFIG of the first group of each position."""
    for position in listing.positions:
        label = f"P[{position.number}]"
        cartesian = bool(position.joints & _CARTESIAN_FORM)
        if position.frames is not None and cartesian != (position.config is not None):
            reason = f"{label} has {'no' if cartesian else 'a'} CONFIG"
            yield Problem(position.line, "configuration", reason)
        elif position.config is not None and not _CONFIG.fullmatch(position.config):
            reason = f"{label}: there is no CONFIG {position.config[:30]!a}"
            yield Problem(position.line, "configuration", reason)
        for row, name, text, unit in position.own:
            wanted = "mm" if name in "XYZ" else "deg"
            if name not in _EXTENDED and unit != wanted:
                yield Problem(row, "unit", f"{label}: {name} is in {unit}, not in {wanted}")
            elif _DECIMAL.fullmatch(text) and not _in_range(name, float(text)):
                yield Problem(row, "range", f"{label}: {name} is {text}")


def _in_range(name: str, value: float) -> bool:
    if name in ("W", "P", "R"):
        return -180.0 < value <= 180.0
    return abs(value) <= (_MOST_MM if name in "XYZ" or name in _EXTENDED else _MOST_DEG)


def _check_use(listing: Listing) -> Iterator[Problem]:
    defined = {position.number for position in listing.positions}
    used: set[int] = set()
    for instruction in listing.instructions:
        numbers = {int(number) for number in _USED.findall(instruction.code)}
        for number in sorted(numbers - defined):
            yield Problem(instruction.line, "position-defined", f"P[{number}] is not defined")
        used |= numbers
    if any(_INDIRECT.search(instruction.code) for instruction in listing.instructions):
        return  # a register chooses the position: any may be used
    for position in listing.positions:
        if position.number not in used:
            reason = f"P[{position.number}] is never used"
            yield Problem(position.line, "position-used", reason)


def _check_motion(listing: Listing) -> Iterator[Problem]:
    """Rules that follow the program line by line: active frames, and whether the arm stands."""
    stored = {position.number: position for position in listing.positions}
    active: dict[str, int | None] = {"UFRAME": None, "UTOOL": None}
    stands = False
    for instruction in listing.instructions:
        frame = _FRAME.search(instruction.code)
        if frame:
            active[frame[1]] = int(frame[2]) if frame[2] else None
        motion = instruction.motion
        fault = "" if instruction.fault else _fault(motion, instruction.code)
        if fault:
            yield Problem(instruction.line, "motion" if motion else "instruction", fault)
        if motion:
            stands = re.search(r"\bFINE\b", instruction.code) is not None
            for number in _USED.findall(instruction.code):
                reason = _frame_fault(stored.get(int(number)), active)
                if reason:
                    yield Problem(instruction.line, "frame", reason)
        if not stands and re.search(r"\bCALL\b", instruction.code):
            reason = "no motion to a standstill (FINE) before the CALL"
            yield Problem(instruction.line, "fine-before-call", reason)


def _fault(motion: str, code: str) -> str:
    return motion_fault(motion, code) if motion else instruction_fault(code)


def _frame_fault(position: Position | None, active: dict[str, int | None]) -> str:
    if position is None or position.frames is None:
        return ""  # other rules say so
    for name, letters, frame in zip(active, ("UF", "UT"), position.frames, strict=True):
        if frame is None:
            continue  # left open: whatever is active
        if letters == "UT" and frame == 0:
            return f"P[{position.number}] has UT 0: tool frames count from 1"
        if active[name] is None:
            return f"{name}_NUM is not set to a number before the motion"
        if active[name] != frame:
            return f"P[{position.number}] has {letters} {frame}, {name}_NUM is {active[name]}"
    return ""


def _check_numbers(listing: Listing) -> Iterator[Problem]:
    for position in listing.positions:
        for row, name, text in position.values:
            if not _DECIMAL.fullmatch(text) or _NEGATIVE_ZERO.fullmatch(text):
                reason = f"P[{position.number}]: {name} is {text[:30]!a}, not a plain number"
                yield Problem(row, "number", reason)
    for instruction in listing.instructions:
        if _ODD_NUMBER.search(instruction.code):
            yield Problem(instruction.line, "number", "exponents and NaN are refused")
        if _NEGATIVE.search(instruction.code):
            reason = "a negative constant stands in parentheses: (-1)"
            yield Problem(instruction.line, "negative-argument", reason)
