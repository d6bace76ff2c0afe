"""ABB RAPID: the strict validator's rules of what a motion and a wait look like; see :mod:`.rules`.

Every word of a motion is looked at: a controller does not pass over one that it does not know.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from posedesign.programs.abb_rapid.listing import Listing, arguments
from posedesign.programs.recorded import Problem

_IGNORE = re.IGNORECASE | re.ASCII
_SPEEDS = """
5 10 20 30 40 50 60 80 100 150 200 300 400 500 600 800 1000 1500 2000 2500 3000 4000 5000 6000 7000
"""
_ZONES = "0 1 5 10 15 20 30 40 50 60 80 100 150 200"
_KNOWN = {
    "speeddata": {f"V{v}" for v in _SPEEDS.split()}
    | {"VMAX"}
    | {f"VROT{v}" for v in (1, 2, 5, 10, 20, 50, 100)}
    | {f"VLIN{v}" for v in (10, 20, 50, 100, 200, 500, 1000)},
    "zonedata": {f"Z{z}" for z in _ZONES.split()} | {"FINE"},
}
"""Data that every controller has."""

_KINDS = {"MOVEABSJ": ("jointtarget",), "MOVEC": ("robtarget", "robtarget")}
_LEADING = {"CONC"}
_SWITCHES = {
    "jointtarget": {"ID", "NOEOFFS"},
    "robtarget": {"ID"},
    "speeddata": {"V", "T"},
    "zonedata": {"Z", "INPOS"},
    "tooldata": {"WOBJ", "TLOAD", "CORR"},
}
_ARGUMENT = re.compile(
    r"(?P<name>[A-Z]\w{0,99})?(?P<index> ?\{[^{}]{0,40}\})?(?P<list>[\[(].*[\])])?"
    r"(?P<switches>(?: ?\\ ?[A-Z]\w{0,31}(?: ?:= ?[^\\]{1,99}?)?){0,9})",
    _IGNORE,
)
_SWITCH = re.compile(r"\\ ?(\w+)")
_PARAMETER = re.compile(
    r"(?:(?:INOUT|VAR|PERS) )?(\w{1,99}) (\w{1,99})(?: ?\{[^{}]{0,20}\})?", _IGNORE
)
_HEADING = re.compile(r"(?:LOCAL )?(?:PROC|TRAP|FUNC \w+) \w+ ?\((.*)\)", _IGNORE)
_WAIT = re.compile(r"WaitTime ?(?:\\InPos ?,? ?)?[^\\,]{1,99}", _IGNORE)
_TRAVEL = re.compile(r"(?:fine|z\d{1,3}|v\d{1,4}|vmax)(?: ?\\.*)?", _IGNORE)
_MOVING = re.compile(
    r"(?:Move|Trigg|Search|Path|Mech|IndA|IndR|IndC|IndD|Cap|Arc|Disp|Spot)", _IGNORE
)


def parameters(listing: Listing) -> dict[str, str]:
    """Kinds of the parameters of all routines by their names in capitals."""
    found: dict[str, str] = {}
    for statement in listing.statements:
        heading = _HEADING.match(statement.code) if statement.end == "line" else None
        for part in re.split(r"[,|\\]", heading[1]) if heading else []:
            parameter = _PARAMETER.fullmatch(part.strip())
            if parameter:
                found[parameter[2].upper()] = parameter[1].lower()
    return found


def check_words(listing: Listing) -> Iterator[Problem]:
    """Rule ``motion``."""
    kinds = {**parameters(listing), **{d.name.upper(): d.kind for d in listing.data}}
    sizes = {data.name.upper(): data.size for data in listing.data}
    for row, word, parts in listing.motions:
        wanted = [*_KINDS.get(word, ("robtarget",)), "speeddata", "zonedata", "tooldata"]
        if len(parts) != len(wanted):
            continue  # told by another rule
        for text, kind in zip(parts, wanted, strict=True):
            fault = _fault(text, kind, kinds, sizes)
            if fault:
                yield Problem(row, "motion", fault)
    for statement in listing.statements:
        if statement.word == "WAITTIME" and not _WAIT.fullmatch(statement.code):
            yield Problem(statement.row, "wait", f"{statement.code[:30]!a}: not a time alone")
        elif _looks_like_a_motion(statement.code, statement.word):
            reason = f"{statement.word[:30]} is no motion, and has what one has"
            yield Problem(statement.row, "motion", reason)


def _fault(text: str, kind: str, kinds: dict[str, str], sizes: dict[str, str]) -> str:
    """What is wrong with one argument of a motion; empty for nothing."""
    found = _ARGUMENT.fullmatch(text)
    if found is None or not (found["name"] or found["list"]):
        return f"{text[:40]!a} is no {kind}"
    strange = set(map(str.upper, _SWITCH.findall(found["switches"]))) - _SWITCHES[kind]
    if strange:
        return f"\\{min(strange)[:30]} is no switch of a {kind}"
    name = (found["name"] or "").upper()
    if not name or found["list"]:
        return ""  # a list of numbers, or what a function gives
    if name in kinds:
        if kinds[name] != kind:
            return f"{found['name']} is a {kinds[name]}, not a {kind}"
        if name in sizes and bool(sizes[name]) != bool(found["index"]):
            return f"{found['name']} is {'an array' if sizes[name] else 'no array'}"
        return ""
    unknown = kind in _KNOWN and name not in _KNOWN[kind]
    return f"{found['name'][:40]} is no {kind} that is known" if unknown else ""


def _looks_like_a_motion(code: str, word: str) -> bool:
    """Whether a call has a speed or a zone; calls of other programs cannot be told from it."""
    if ":=" in code.partition("\\")[0] or word in ("CONST", "PERS", "VAR", "IF"):
        return False
    if _MOVING.match(word):
        return word.startswith("MOVE") and word not in _MOTIONS
    return any(_TRAVEL.fullmatch(part) for part in arguments(code.partition(" ")[2]))


_MOTIONS = frozenset(
    f"MOVE{kind}{what}" for kind in "JLC" for what in ("", "DO", "AO", "GO", "SYNC")
) | {"MOVEABSJ", "MOVEEXTJ", "MOVEPNP"}
