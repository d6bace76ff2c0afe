"""Kawasaki AS programs: the rules that a program is checked by.

``syntax``: lines are as in the grammar; other instructions are noted. ``block``: sections, loops
and branches are closed. ``position``, ``range``: as many plain values each, six at least, joints
within +-720 deg, speeds from 0.01 to 100 percent, outputs from 1 to 999. ``target``: moves go to
positions that are in the file, where it has lists. ``standstill``, ``wait-to-measure``: BREAK
behind each move, and a wait. ``speed``: set for each move. ``unused``: all of an array is moved to.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from lark import Tree

from posedesign.programs.joint_programs import (
    JOINTS,
    PLAIN,
    Standing,
    check_joints,
    judged,
    level_of,
)
from posedesign.programs.kawasaki_as.reader import LANGUAGE
from posedesign.programs.language import Block, Statement, block_faults, nodes, text_of
from posedesign.programs.recorded import Problem

_WORDS = """.program .joints .trans .end jmove lmove break twait delay stable pulse call here point
speed if else for while case value do until end"""
_OTHERS = (
    """wait swait scall hmove xmove cmove c1move c2move home home2 base type print ret return any"""
)
_MOTION = re.compile(r"home|t?draw\b|drive|align|[lj](appro|depart)|\w+move", re.I)
_NOT_JUDGED = re.compile(r"[.$#\w]+(\[[^\]]*\])? *=(?!=)|[\w.]+ *:|(if\b.*)?\bgoto\b", re.I)
_LITERAL = re.compile(r"#?[a-z_][\w.]*(\[[\d,]+\])?")
_BLOCKS = {
    "program": Block("finish"),
    "list": Block("finish"),
    "branch": Block("end", ("divide",)),
    "repeat": Block("until"),
}


def check_kawasaki_as(data: bytes, path: Path) -> list[Problem]:
    """Problems in a program, at most 1000. Never fails."""
    return judged(data, LANGUAGE, ("program", "position"), _check)


def _check(statements: list[Statement]) -> Iterator[Problem]:
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    for s in statements:
        if (s.fault or s.kind in ("other", "section")) and not _NOT_JUDGED.match(s.text):
            word = re.match(r"(?:\d+ +)?(\.?[a-z]\w*)", s.text, re.I)
            level = level_of(word[1].lower() if word else "", f"{_WORDS} {called}", _OTHERS)
            yield Problem(s.row, "syntax", s.fault or f"{s.text[:40]!a} is not known", level)
    yield from block_faults(statements, _BLOCKS)
    yield from _check_positions(statements)
    yield from _check_steps(statements)


def _places(s: Statement) -> list[str]:
    return [text_of(place).lower() for place in nodes(s.tree, "place")]


def _check_positions(statements: list[Statement]) -> Iterator[Problem]:
    entries = [s for s in statements if s.kind == "position"]
    listed = [(s, s.word("ENTRY").lower(), s.words("NUMBER")) for s in entries]
    counts = Counter(name for _, name, _ in listed)
    size = max(JOINTS, min((len(v) for _, name, v in listed if name[0] == "#"), default=0))
    moves = [s for s in statements if s.kind == "move"]
    moved = {place for s in moves for place in _places(s)}
    arrays = {place.partition("[")[0] for place in moved if place[0] == "#" and place[-1] == "]"}
    for s, name, values in listed:
        if counts[name] > 1 or (name[0] == "#" and len(values) != size):
            yield Problem(s.row, "position", f"{name[:40]} is no position, or there twice")
        elif name[0] == "#":
            yield from check_joints(s.row, values, most=size)
        if name.partition("[")[0] in arrays and name not in moved:
            yield Problem(s.row, "unused", f"{name[:40]} is never moved to", "measuring")
    known = {*counts, *(_places(s)[0] for s in statements if s.kind in ("here", "point"))}
    for s in moves if listed else ():
        for place in set() if "(" in s.text else {*_places(s)} - known:
            if _LITERAL.fullmatch(place):
                yield Problem(s.row, "target", f"{place[:40]} is not in the file")


def _check_steps(statements: list[Statement]) -> Iterator[Problem]:
    speed, standing = "", Standing(("BREAK", "TWAIT"))
    for s in statements:
        first = text_of(Tree("", s.tree.children[:1]))
        if s.kind == "program":
            speed, standing = "", Standing(("BREAK", "TWAIT"))
        if s.kind == "move":
            if not speed:
                yield Problem(s.row, "speed", "no SPEED is set for this move", "measuring")
            speed = speed if speed == "always" else ""
        if s.kind == "speed":
            speed = "always" if s.word("ALWAYS") else "once"
        if PLAIN.fullmatch(first) and not s.word("UNIT"):
            if s.kind == "speed" and not 0.01 <= float(first[:99]) <= 100:
                yield Problem(s.row, "range", "a speed is from 0.01 to 100 percent")
            if s.kind == "pulse" and not re.fullmatch(r"[1-9]\d{0,2}", first):
                yield Problem(s.row, "range", f"{first[:20]} is no output")
        moves = s.kind in ("move", "taught") or bool(s.kind == "other" and _MOTION.match(s.text))
        stops, measures = s.kind in ("stop", "taught"), s.kind in ("call", "pulse", "here")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)
