"""Denso PacScript programs: the rules that a program is checked by.

``syntax``: lines are as in the grammar, of 1024 characters at most; other commands are noted.
``block``: routines, loops and branches are closed. ``main``: there is a routine Main, or a program.
``arm``: the arm is taken before it moves. ``position``: ``J`` has six to eight plain numbers.
``range``: joints within +-720 deg, speeds from 0.1 to 100 percent. ``standstill``,
``wait-to-measure``: a move that stops (``@0``, ``@E``), and a Delay, before an output is set or a
program called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from posedesign.programs.denso_pac.reader import LANGUAGE, joints_in, targets
from posedesign.programs.joint_programs import PLAIN, Standing, check_joints, judged, level_of
from posedesign.programs.language import Block, Statement, block_faults, nodes, text_of
from posedesign.programs.recorded import Problem

_WORDS = """sub end program move delay set reset call takearm givearm speed dim if then else elseif
for next do loop while wend select case keep"""
_OTHERS = "wait depart approach draw drive drivea rotate motor print printdbg accel decel let send"
_MOTION = re.compile(r"(depart|approach|draw|drivea?|rotateh?|archmove)\b", re.I)
_BLOCKS = {
    "sub": Block("finish"),
    "branch": Block("close", ("divide",)),
    "loop": Block("again"),
}


def check_denso_pac(data: bytes, path: Path) -> list[Problem]:
    """Problems in a program, at most 1000. Never fails."""
    return judged(data, LANGUAGE, ("sub",), _check)


def _check(statements: list[Statement]) -> Iterator[Problem]:
    if statements[0].text[:7].lower() != "program":
        yield from block_faults(statements, _BLOCKS)
        if not any(s.kind == "sub" and s.word("NAME").lower() == "main" for s in statements):
            yield Problem(1, "main", "there is no routine Main")
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    standing, taken = Standing(("stop", "Delay")), False
    for s in statements:
        if s.fault or s.kind == "other" or len(s.text) > 1024:
            word = re.match(r"[#*]?[a-z]\w*(?! *[,@)\]])|", s.text.lower())
            level = level_of(word[0] if word else "", f"{_WORDS} {called}", _OTHERS)
            yield Problem(s.row, "syntax", s.fault or f"{s.text[:40]!a} is not known", level)
        taken = taken or s.kind == "arm"
        if s.kind == "move" and not taken:
            yield Problem(s.row, "arm", "no TakeArm before this move")
        speed = text_of(next(nodes(s.tree, "sum"))) if s.kind == "speed" else "1"
        if PLAIN.fullmatch(speed[:9]) and not 0.1 <= float(speed[:9]) <= 100:
            yield Problem(s.row, "range", "a speed is from 0.1 to 100 percent")
        for _, target in targets(s):
            yield from _check_target(s.row, text_of(next(nodes(target, "sum"))), joints_in(target))
        stops = bool(s.tree.children) and all(how in ("@0", "@E") for how, _ in targets(s))
        moves = s.kind == "move" or _MOTION.match(s.text) is not None
        stops = s.kind == "move" and stops and not s.word("NEXT")
        measures = s.kind == "call" or (s.kind == "output" and s.text[:1].lower() == "s")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)


def _check_target(row: int, text: str, values: list[str] | None) -> Iterator[Problem]:
    if text[0] in '(-".' or text[0].isdigit():
        yield Problem(row, "position", f"{text[:40]} is no position")
    if values is not None:
        yield from check_joints(row, values, most=8)
