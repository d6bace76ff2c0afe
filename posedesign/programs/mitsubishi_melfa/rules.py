"""MELFA-BASIC programs: the rules that a program is checked by.

``syntax``: steps and positions are as in the grammar; another command is noted. ``step``: numbers
of steps rise from 1 to 32767, with 127 characters at most. ``position``: six to eight plain numbers
(joints: one to eight), each name once. ``range``: joints within +-720 deg, overrides from 1 to 100
percent. ``target``: moves go to positions that are in the list, or defined. ``wait-to-measure``:
Dly between a move and CallP. ``unused``: all joint positions of the list are moved to.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import cast

from lark import Token, Tree

from posedesign.programs import rules
from posedesign.programs.language import Statement, text_of, words
from posedesign.programs.mitsubishi_melfa.reader import LANGUAGE, entry_of
from posedesign.programs.recorded import Level, Problem

_COMMANDS = "mov mvs dly m_out jovrd ovrd spd cnt servo callp end hlt return wait hopen hclose"
_OTHERS = "open close print input if else elseif endif for next while wend select case on dim fine"
_STEP = re.compile(r"\s*\d{1,5} +([A-Za-z]\w*)(?: .*)?")


def check_mitsubishi_melfa(data: bytes, path: Path) -> list[Problem]:
    """Problems in a program, at most 1000. Never fails."""
    statements = LANGUAGE.statements(data.decode("latin-1").replace("\r", ""))
    if not any(statement.fault == "" for statement in statements):
        return [Problem(1, "syntax", "there is no step in it")]
    return rules.told(_check(statements))


def _check(statements: list[Statement]) -> Iterator[Problem]:
    names = [entry_of(s)[0].upper() for s in statements]
    counts = Counter(names)
    defined = {w.upper() for s in statements for t in s.all("definition") for w in words(t, "NAME")}
    moved: set[str] = set()
    step, stands = 0, True
    for s, name in zip(statements, names, strict=True):
        if s.fault:
            yield Problem(s.row, "syntax", s.fault, _level(s.text))
            continue
        *first, body = s.tree.children
        body = cast("Tree[Token]", body)
        if name:
            yield from _check_position(s, counts[name] > 1)
            continue
        own = int(str(first[0])) if first and re.fullmatch(r"\d{1,5}", str(first[0])) else 0
        if not step < own <= 32767 or len(s.text) > 127:
            yield Problem(s.row, "step", f"step {own} behind {step}, {len(s.text)} characters")
        step = max(step, own)
        if body.data == "move":
            target = text_of(cast("Tree[Token]", body.children[0])).upper()
            moved.add(target)
            if re.fullmatch(r"[JP][A-Z0-9]*", target) and not (
                target in counts or target in defined
            ):
                yield Problem(s.row, "target", f"{target[:40]} is not in the list")
        if body.data == "override" and not 1 <= float(words(body, "NUMBER")[0][:9]) <= 100:
            yield Problem(s.row, "range", "an override is from 1 to 100 percent")
        if body.data == "call" and not stands:
            yield Problem(s.row, "wait-to-measure", "no Dly since the last move", "measuring")
        stands = body.data == "dly" or (stands and body.data != "move")
    for s, name in zip(statements, names, strict=True):
        if name.startswith("J") and name not in moved:
            yield Problem(s.row, "unused", f"{name[:40]} is never moved to", "measuring")


def _level(text: str) -> Level:
    """Error for a step that begins with a word of the grammar, or nearly; others may be options."""
    found = _STEP.fullmatch(text)
    word = found[1].lower() if found else ""
    if word in _OTHERS.split():
        return "error" if text.lower().endswith(" on") else "note"  # On says of what
    near = word in _COMMANDS.split() or rules.near(word, _COMMANDS.split(), alike=0.7)
    return "error" if near or not word or re.fullmatch(r"[jpm]\d*", word) else "note"


def _check_position(s: Statement, twice: bool) -> Iterator[Problem]:
    name, values, _ = entry_of(s)
    joints = name[0] in "Jj"
    plain = bool(values) and all(value.data == "number" for value in values)
    if twice or not plain or not (1 if joints else 6) <= len(values) <= 8:
        yield Problem(s.row, "position", f"{name[:40]} is no position, or there twice")
    elif joints and not all(abs(float(text_of(value))) <= 720 for value in values):
        yield Problem(s.row, "range", f"{name[:40]} has a joint beyond +-720 deg")
