"""KUKA KRL: the strict validator's rules of positions and motions; see :mod:`.rules`."""

from __future__ import annotations

import re
from collections.abc import Iterator

from posedesign.programs.kuka_krl.listing import (
    DECLARES,
    Fields,
    Module,
    instructions,
    named_target,
)
from posedesign.programs.recorded import Problem

MOST_JOINT_DEG = 720.0
"""No arm turns so far."""

_IGNORE = re.IGNORECASE | re.ASCII
_DECIMAL = re.compile(r"[-+]?(?:\d{1,9}(?:\.\d{0,20})?|\.\d{1,20})(?:E[-+]?\d{1,3})?", _IGNORE)
_NEGATIVE_ZERO = re.compile(r"-0*\.?0*(?:E[-+]?\d+)?", _IGNORE)
_INTEGER = re.compile(r"(\d{1,3})|'B([01]{1,8})'", _IGNORE)
_NAN = re.compile(r"(?<![\w$#.])(?:nan|inf|infinity)(?![\w(\[])", _IGNORE)
_JOINTS = {"A1", "A2", "A3", "A4", "A5", "A6"}
_POSE = {"X", "Y", "Z", "A", "B", "C"}
_EXTERNAL = {"E1", "E2", "E3", "E4", "E5", "E6"}
_MOST = {"S": 31, "T": 63}
_SETS = {
    "initialised": re.compile(r"BAS *\( *#INITMOV\b", _IGNORE),
    "tool": re.compile(r"BAS *\( *#(?:TOOL|FRAMES)\b|\$TOOL *=|FDAT_ACT *=", _IGNORE),
    "base": re.compile(r"BAS *\( *#(?:BASE|FRAMES)\b|\$BASE *=|FDAT_ACT *=", _IGNORE),
}
_WAITS = re.compile(r"(?:WAIT\b|HALT\b)", _IGNORE)
_ACTS = re.compile(r"([A-Z_]\w*) *\(|[A-Z_]\w* *(?:\[.*\])? *= *\$(AXIS_ACT|POS_ACT)\b", _IGNORE)
_APPROXIMATED = re.compile(r"(?<!\w)C_(?:PTP|DIS|ORI|VEL|SPL)\b", _IGNORE)
_INDEXED = re.compile(r"(?<![\w$])([A-Z_]\w*)\[ *(\d{1,7}) *\]", _IGNORE)


def check_fields(module: Module) -> Iterator[Problem]:
    """Rule ``position-format``."""
    for fields in module.fields:
        label = fields.variable or "the position"
        if fields.fault:
            yield Problem(fields.row, "position-format", f"{label}: {fields.fault}")
            continue
        names = fields.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            yield Problem(fields.row, "position-format", f"{label} has {twice[0]} twice")
        kept = set(names) - _EXTERNAL
        if kept not in (_JOINTS, _POSE, _POSE | {"S", "T"}):
            found = " ".join(names) or "nothing"
            reason = f"{label} has {found[:60]}, not A1 to A6 or X Y Z A B C S T"
            yield Problem(fields.row, "position-format", reason)
        elif fields.kind and (kept == _JOINTS) != fields.kind.endswith("AXIS"):
            yield Problem(fields.row, "position-format", f"{label}: {fields.kind} of {names[0]}")


def check_numbers(module: Module) -> Iterator[Problem]:
    """Rule ``number``."""
    for fields in module.fields:
        label = fields.variable or "the position"
        for name, text in fields.values:
            fault = _number_fault(name, text)
            if fault:
                yield Problem(fields.row, "number", f"{label}: {name} {text[:30]!a} {fault}")
    for line in instructions(module):
        if _NAN.search(re.sub(r'"[^"]*"', "", line.code)):
            yield Problem(line.row, "number", "NaN and infinity are no numbers of KRL")


def _number_fault(name: str, text: str) -> str:
    if name in _MOST:
        bits = _INTEGER.fullmatch(text)
        value = (int(bits[1]) if bits[1] else int(bits[2], 2)) if bits else -1
        return "" if 0 <= value <= _MOST[name] else f"is not from 0 to {_MOST[name]}"
    if not _DECIMAL.fullmatch(text) or _NEGATIVE_ZERO.fullmatch(text):
        return "is not a plain number"
    if name in ("A", "B", "C") and abs(float(text)) > 180.0:
        return "is beyond +-180 deg"
    if name in _JOINTS and abs(float(text)) > MOST_JOINT_DEG:
        return f"is beyond +-{MOST_JOINT_DEG:g} deg"
    return ""


def check_unique(module: Module) -> Iterator[Problem]:
    """Rule ``position-unique``."""
    for name, places in module.declared.items():
        # a variable can be declared in one line and be given its value in another
        values = [row for row, what in places if what]
        for row in values[1:]:
            yield Problem(row, "position-unique", f"{name} is defined twice")


def check_targets(source: Module, data: Module | None) -> Iterator[Problem]:
    """Rule ``position-defined``."""
    if data is None:
        return
    known = source.declared.keys() | data.declared.keys()
    arrays = {name.partition("[")[0] for name in known if "[" in name}
    for row, _, target in source.motions:
        name = named_target(target)
        if name and name not in known and name.partition("[")[0] not in arrays:
            yield Problem(row, "position-defined", f"{name[:40]} is not defined")


def check_use(data: Module, source: Module | None) -> Iterator[Problem]:
    """Rule ``position-used``."""
    if source is None:
        return
    code = "\n".join(line.code.upper() for line in instructions(source))
    used = set(re.findall(r"[A-Z_]\w*", code, re.ASCII))
    for fields in data.fields:
        if re.fullmatch(r"X?P\d+", fields.variable) and fields.variable not in used:
            yield Problem(fields.row, "position-used", f"{fields.variable} is never used")


def check_motions(source: Module, data: Module | None) -> Iterator[Problem]:
    """Rules that follow the program line by line: first motion, frames, standstill."""
    motions = {row: (word, target) for row, word, target in source.motions}
    ready: set[str] = set()
    moved = approximated = False
    stands = True
    begins = {row for row, _, _, _ in source.begins}
    for line in instructions(source):
        if line.row in begins:
            stands, approximated = True, False  # whoever calls the routine sees to that
            continue
        motion = motions.get(line.row)
        if motion:
            ready |= {what for what in ("tool", "base") if f"${what.upper()}=" in motion[1].upper()}
            if not moved:
                yield from _check_first(line.row, motion, ready, source, data)
            moved, stands = True, False
            approximated = _APPROXIMATED.search(motion[1]) is not None
            continue
        ready |= {name for name, pattern in _SETS.items() if pattern.match(line.code)}
        stands = stands or _WAITS.match(line.code) is not None
        acts = _ACTS.match(line.code)
        if not acts or (acts[1] or "").upper() in _HARMLESS:
            continue
        if approximated:
            yield Problem(line.row, "standstill", "the motion before it is approximated")
        elif not stands:
            reason = "no WAIT between the motion and this: the arm may still move"
            yield Problem(line.row, "standstill", reason)


_HARMLESS = frozenset({"BAS", "IF", "FOR", "WHILE", "SWITCH", "UNTIL", "RETURN", "WAIT"})
"""Words before a bracket that call no program; BAS sets what motions are like."""


def _check_first(
    row: int, motion: tuple[str, str], ready: set[str], source: Module, data: Module | None
) -> Iterator[Problem]:
    word, target = motion
    if word not in ("PTP", "SPTP"):
        yield Problem(row, "first-move", f"{word} is the first motion, not PTP")
    else:
        name = named_target(target)
        defined = [*source.fields, *(data.fields if data else [])]
        whole: list[Fields] = [f for f in defined if f.variable == name and (name or f.row == row)]
        if whole and not ({"S", "T"} | _POSE <= set(whole[0].names) or "A1" in whole[0].names):
            yield Problem(row, "first-move", "the first position has no S and T")
    if "initialised" not in ready:
        yield Problem(row, "initialised", "no BAS(#INITMOV,0) before the first motion")
    for what in ("tool", "base"):
        if what not in ready:
            yield Problem(row, "frame", f"${what.upper()} is not set before the first motion")


def check_bounds(module: Module, data: Module, source: Module) -> Iterator[Problem]:
    """Rule ``array-bounds``."""
    sizes: dict[str, int] = {}
    for name, places in [*data.declared.items(), *source.declared.items()]:
        size = re.fullmatch(r"(\w+)\[(\d{1,7})\]", name)
        if size and any(not what for _, what in places):
            sizes[size[1]] = int(size[2])
    for line in instructions(module):
        if DECLARES.match(line.code):
            continue
        for name, index in _INDEXED.findall(line.code):
            most = sizes.get(name.upper())
            if most is not None and not 1 <= int(index) <= most:
                yield Problem(line.row, "array-bounds", f"{name}[{index}] of {most}")
