"""ABB RAPID: the strict validator's rules of data and motions; see :mod:`.rules`."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterator

from posedesign.programs.abb_rapid.listing import Data, Listing, elements
from posedesign.programs.abb_rapid.motion_rules import parameters
from posedesign.programs.recorded import Problem

NORM_WITHIN = 1e-5
"""Of the norm of a quaternion from 1."""

_IGNORE = re.IGNORECASE | re.ASCII
_KEYWORDS = """
ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE
ENDPROC ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MOD
MODULE NOSTEPIN NOT NOVIEW OR PERS PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TEST THEN
TO TRAP TRUE TRYNEXT UNDO VAR VIEWONLY WHILE WITH XOR
"""
_RESERVED = frozenset(_KEYWORDS.split())
_NAME = re.compile(r"[A-Z]\w{0,31}", _IGNORE)
_NUMBER = re.compile(r"[-+]?(?:\d{1,12}(?:\.\d{0,20})?|\.\d{1,20})(?:E[-+]?\d{1,3})?", _IGNORE)
_WHOLE = re.compile(r"[-+]?\d{1,3}")
_SHAPES = {"jointtarget": (6, 6), "robtarget": (3, 4, 4, 6)}
_HEADING = re.compile(r"(?:LOCAL )?(MODULE|PROC|TRAP|FUNC \w+) ([^\s(]+)", _IGNORE)
_NAMED_POSITION = re.compile(r"J?P\d+", _IGNORE)
_INSTRUCTIONS = """
ACCSET CONFJ CONFL EXIT RETURN SINGAREA STOP TPERASE TPWRITE VELSET WAITDI WAITDO WAITROB WAITTIME
WAITUNTIL MOVEABSJ MOVEJ MOVEL MOVEC CONST PERS VAR GOTO BREAK INCR ADD CLEAR SET RESET SETDO
"""
_STANDING = frozenset(_INSTRUCTIONS.split())
_INDEXED = re.compile(r"\b([A-Z]\w{0,31}) ?\{ ?(\d{1,7}) ?\}", _IGNORE)
_WAITS = re.compile(r"WaitTime ?\\InPos|WaitRob ?\\(?:InPos|ZeroSpeed)", _IGNORE)


def check_names(listing: Listing) -> Iterator[Problem]:
    """Rules ``identifier`` and ``unique``."""
    named = [(data.row, data.name) for data in listing.data]
    for statement in listing.statements:
        heading = _HEADING.match(statement.code) if statement.end == "line" else None
        if heading:
            named.append((statement.row, heading[2]))
    for row, name in named:
        if not _NAME.fullmatch(name) or name.upper() in _RESERVED:
            reason = f"{name[:40]!a} is no name: a letter, then letters, digits, _, 32 in all"
            yield Problem(row, "identifier", reason)
    routines = [s.row for s in listing.statements if s.word in ("PROC", "FUNC", "TRAP")]
    seen: dict[tuple[int, str], int] = {}
    for row, name in named:
        # data of a routine are its own
        key = (bisect_left(routines, row), name.upper())
        if key in seen:
            yield Problem(row, "unique", f"{name} is declared in line {seen[key]} too")
        seen.setdefault(key, row)


def check_positions(listing: Listing) -> Iterator[Problem]:
    """Rules ``position-format``, ``number``, ``quaternion``, ``confdata``."""
    for data in listing.data:
        if data.kind not in _SHAPES or data.value is None:
            continue
        if not data.size:
            yield from _check_position(data.row, data.name, data.kind, data.value)
            continue
        size = re.fullmatch(r"\{ ?(\d{1,7}) ?\}", data.size)
        items = elements(data.value)
        if size is None or items is None or len(items) != int(size[1]):
            count = "no list" if items is None else f"{len(items)} elements"
            reason = f"{data.name}{data.size[:20]} has {count}"
            yield Problem(data.row, "position-format", reason)
            continue
        for k, item in enumerate(items, start=1):
            yield from _check_position(data.row, f"{data.name}{{{k}}}", data.kind, item)
    for row, word, parts in listing.motions:
        if parts[0].startswith("["):
            kind = "jointtarget" if word == "MOVEABSJ" else "robtarget"
            value = parts[0][: parts[0].rindex("]") + 1] if "]" in parts[0] else parts[0]
            yield from _check_position(row, "the position", kind, value)


def _check_position(row: int, label: str, kind: str, value: str) -> Iterator[Problem]:
    lists = [elements(part) for part in elements(value) or []]
    numbers = [part for part in lists if part is not None]
    if len(numbers) != len(lists) or tuple(map(len, numbers)) != _SHAPES[kind]:
        reason = f"{label} has not the lists of {_SHAPES[kind]} numbers of a {kind}"
        yield Problem(row, "position-format", reason)
        return
    odd = [text for part in numbers for text in part if not _NUMBER.fullmatch(text)]
    if odd:
        yield Problem(row, "number", f"{label}: {odd[0][:30]!a} is not a plain number")
    elif kind == "robtarget":
        if _norm_fault(numbers[1]):
            yield Problem(row, "quaternion", f"{label}: {_norm_fault(numbers[1])}")
        if not all(map(_WHOLE.fullmatch, numbers[2])) or not 0 <= float(numbers[2][3]) <= 7:
            found = ",".join(numbers[2])
            yield Problem(row, "confdata", f"{label}: [{found[:40]}] is no confdata")


def _norm_fault(texts: list[str]) -> str:
    if len(texts) != 4 or not all(map(_NUMBER.fullmatch, texts)):
        return "no four numbers"
    norm = math.hypot(*map(float, texts))
    return "" if abs(norm - 1.0) <= NORM_WITHIN else f"the quaternion's norm is {norm:.6g}"


def check_use(listing: Listing) -> Iterator[Problem]:
    """Rules ``position-defined`` and ``position-used``."""
    known = {data.name.upper() for data in listing.data} | parameters(listing).keys()
    for row, _, parts in listing.motions:
        target = re.match(r"[A-Z]\w*", parts[0], _IGNORE)
        if target and not re.match(r"\w+ ?\(", parts[0]) and target[0].upper() not in known:
            yield Problem(row, "position-defined", f"{target[0][:40]} is not declared")
    declared = {data.row for data in listing.data}
    used: set[str] = set()
    for statement in listing.statements:
        if statement.row not in declared or statement.word not in ("CONST", "PERS", "VAR"):
            used.update(word.upper() for word in re.findall(r"[A-Za-z]\w*", statement.code))
    for data in listing.data:
        numbered = data.kind in _SHAPES and _NAMED_POSITION.fullmatch(data.name)
        if numbered and data.name.upper() not in used:
            yield Problem(data.row, "position-used", f"{data.name} is never used")


def check_frames(listing: Listing) -> Iterator[Problem]:
    """Rules ``frame-format`` and ``frame``."""
    names = {"tooldata": {"TOOL0"}, "wobjdata": {"WOBJ0"}}
    for data in listing.data:
        if data.kind in names:
            names[data.kind].add(data.name.upper())
            fault = _frame_fault(data)
            if fault:
                yield Problem(data.row, "frame-format", f"{data.name}: {fault}")
    for row, word, parts in listing.motions:
        place = 4 if word == "MOVEC" else 3
        last = re.fullmatch(r"(\w+)((?: ?\\\w+ ?:= ?\w+)*)", parts[-1])
        if len(parts) != place + 1 or last is None:
            yield Problem(row, "frame", "a motion has a position, a speed, a zone and a tool")
            continue
        work_object = re.search(r"\\WObj ?:= ?(\w+)", last[2], _IGNORE)
        for kind, name in (
            ("tooldata", last[1]),
            ("wobjdata", work_object[1] if work_object else "wobj0"),
        ):
            if name.upper() not in names[kind]:
                yield Problem(row, "frame", f"{name} is no {kind} of this module")


def _frame_fault(data: Data) -> str:
    if data.storage != "PERS":
        return f"{data.kind} is PERS, not {data.storage}"
    parts = elements(data.value or "") or []
    if data.kind == "tooldata":
        if len(parts) != 3 or parts[0].upper() not in ("TRUE", "FALSE"):
            return "not [robhold, frame, load]"
        load = elements(parts[2]) or []
        if len(load) != 6 or not _NUMBER.fullmatch(load[0]) or float(load[0]) <= 0:
            return "the load is not [mass above 0, centre, axes, three inertias]"
        frames = [parts[1]]
    else:
        if len(parts) != 5 or parts[2] != '""':
            return 'not [robhold, ufprog, "ufmec", uframe, oframe]'
        frames = parts[3:]
    for frame in frames:
        pose = [elements(part) or [] for part in elements(frame) or []]
        if len(pose) != 2 or len(pose[0]) != 3 or not all(map(_NUMBER.fullmatch, pose[0])):
            return "a frame is not [[x,y,z],[q1,q2,q3,q4]]"
        if _norm_fault(pose[1]):
            return _norm_fault(pose[1])
    return ""


def check_motions(listing: Listing) -> Iterator[Problem]:
    """Rules ``speed`` and ``standstill``, statement by statement."""
    motions = {row: parts for row, _, parts in listing.motions}
    stands = stopped = True
    for statement in listing.statements:
        row, code, word = statement.row, statement.code, statement.word
        if word in ("PROC", "FUNC", "TRAP"):
            stands = stopped = True  # whoever calls it sees to that
        if statement.end == "line" or not code:
            continue
        if row in motions and word.startswith("MOVE"):
            zone = motions[row][-2] if len(motions[row]) > 2 else ""
            stopped = zone.partition("\\")[0].strip().lower() == "fine"
            stands = False
            continue
        speed = re.fullmatch(r"VelSet (\d{1,3}) ?, ?\d{1,5}", code, _IGNORE)
        if word == "VELSET" and not (speed and 1 <= int(speed[1]) <= 100):
            yield Problem(row, "speed", f"{code[:30]!a}: not from 1 to 100 percent")
        stands = stands or _WAITS.match(code) is not None
        acts = word not in _STANDING and (":=" not in code or word == "PULSEDO")
        if not (acts or "CJOINTT(" in code.upper() or "CROBT(" in code.upper()):
            continue
        if not stopped:
            yield Problem(row, "standstill", "the motion before it has no stop point (fine)")
        elif not stands:
            reason = "no WaitTime\\InPos between the motion and this: the arm may still move"
            yield Problem(row, "standstill", reason)


def check_arrays(listing: Listing) -> Iterator[Problem]:
    """Rule ``array-bounds``."""
    sizes: dict[str, int] = {}
    for data in listing.data:
        size = re.fullmatch(r"\{ ?(\d{1,7}) ?\}", data.size)
        if size:
            sizes[data.name.upper()] = int(size[1])
    for statement in listing.statements:
        if statement.word in ("CONST", "PERS", "VAR"):
            continue
        for name, index in _INDEXED.findall(statement.code):
            most = sizes.get(name.upper())
            if most is not None and not 1 <= int(index) <= most:
                yield Problem(statement.row, "array-bounds", f"{name}{{{index}}} of {most}")
