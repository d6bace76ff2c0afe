"""Yaskawa INFORM jobs (``.JBI``): the validator; what the grammar cannot say.

Sources: those of the grammar. Nothing was loaded on a controller. What the jobs of others have, and
the manuals leave open, is no error.

=====================  ==========================================================================
rule                   what it asks (m: of programs that measure; n: only noted)
=====================  ==========================================================================
``syntax``             what the grammar says
``ascii``              no control characters; n: letters of other scripts
``crlf``               no CR inside a line; m: each line ended by CR LF
``sections``           /JOB, //POS, //INST in this order; the steps from NOP to END; m: comments
                       only there
``job-name``           //NAME: letters, digits, _ and -, 32 in all (DX100 on; NX100 takes 8)
``header``             ///DATE and ///ATTR with SC or CJ and one of RW, RO, WO; ///GROUP1 where
                       something moves, with BS where a base axis does; each once; ///COMM of at
                       most 32 characters; n: unknown headings
``npos``               ///NPOS: the number of positions of each kind
``position-format``    each position with tool, ///POSTYPE and ///PULSE, ///ANGLE or ///RECTAN
                       above; if it is an arm's six to eight values, as all others, if a base axis's
                       one to three; frames 0 to 63
``number``             pulses whole, of 32 bits; m: at most 3 decimals of a mm and 4 of a degree,
                       no ``-0.000``, degrees in [-180, 180]
``rconf``              poses have ///RCONF of 6 (the manual of NX100), 8 or 24 values, the first six
                       0 or 1; m: the others 0
``relative-job``       ////FRAME BASE, ROBOT or USER n; m: poses need RJ in ///ATTR and a ////FRAME
                       that is theirs
``instruction``        no step begins with what is nearly an instruction, or no word of any; n: with
                       another unknown word, which an option may know
``move``               one position of each kind; options that moves have, once each; m: a speed,
                       and a position of the base axes where other moves have one
``block``              what IFTHEN, WHILE, FOR and SWITCH open is closed
``position-unique``    each position is there once
``position-defined``   each position that is moved to is there
``position-used``      m: each position that is there is used
``stop-before-call``   m: the last move before a CALL has PL=0: the arm has arrived
``argument``           VJ= 0.01 to 100.00, times 0.01 to 655.35 s, B and I variables within 8 and
                       16 bits, GETS to a variable of the kind, names of jobs of 32 characters
``comment``            m: a comment has at most 32 characters
``length``             at most 9999 steps: the pendant shows four digits
=====================  ==========================================================================
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterator
from datetime import datetime
from functools import lru_cache
from itertools import chain
from pathlib import Path

from lark import Token, Tree

from posedesign.programs import rules
from posedesign.programs.language import NOTHING, Block, Statement, block_faults, subtrees, text_of
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.rules import near
from posedesign.programs.yaskawa_jbi import reader
from posedesign.programs.yaskawa_jbi.reader import INSTRUCTIONS, MOST_COMMENT, Job, Name, Stored

_MOST_STEPS = 9999
_WIDTHS = {"": (6, 7, 8), "B": (1, 2, 3)}
"""Values of a position of an arm, those of seven axes having more than six; of base axes."""

_OF_INST = ("date", "comm", "attr", "frame", "group", "heading", "local")
_NAME = re.compile(r"[\w\x80-\xff][\w\x80-\xff-]{0,31}", re.ASCII)
_PULSES = re.compile(r"0|-?[1-9]\d{0,9}", re.ASCII)
_DECIMALS = re.compile(r"[-+]?\d{0,9}(?:\.(\d{0,9}))?", re.ASCII)
_RCONF = re.compile(r"[01](?:,[01]){5}((?:,\d){2}|(?:,\d){18})?", re.ASCII)
_TIME = re.compile(r"[-+]?\d*(?:\.\d{0,2})?", re.ASCII)
_NUMBER = re.compile(r"[-+]?[\d.]+", re.ASCII)
_FEW_DIGITS = re.compile(
    r"(?<![\w#])(?:\$?L?(?:[BIDRSP]|PX|BP|EX)\d{1,2}|[BE]?C\d{1,4}|\$(?:PX|[BIDRS])[A-Z]\w*)(?!\w)",
    re.ASCII,
)
_OPTION = re.compile(r"(?!POSE|PLAN|PULSES)[A-Z][A-Z_-]{2}[A-Z0-9_-]{0,29}", re.ASCII)
"""First words of the steps of options, and their flags; those of our comments are none."""

_WITH_VARIABLES = ("move", "also", "set", "gets", "element")
_SPEEDS = frozenset(("VJ=", "V=", "VR=", "VE="))
_TAGS = frozenset(("PL=", "CR=", "ACC=", "DEC=", "CTP=", "TM=", "MT=", "SRCH=", "DIS="))
_FLAGS = frozenset(("NWAIT", "ENWAIT", "FPT", "CV", "UF", "TL"))
_LIMITS = {"B": (0, 255), "I": (-32768, 32767)}
_BLOCKS = {
    "if_": Block("endif", ("elseif", "else_")),
    "while_": Block("endwhile"),
    "for_": Block("next"),
    "switch": Block("endswitch", ("case",)),
}


def check_yaskawa_jbi(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good job. Never fails."""
    job = reader.read_job(data.decode("latin-1"))  # any byte is a character: none is lost
    foreign, control = (("ascii", *asked[1:]) for asked in (rules.FOREIGN, rules.CONTROL))
    return rules.told(
        rules.syntax((*job.head, *job.inst, *job.after)),
        reader.faults_of(job),
        rules.check_line_ends(data),
        rules.check_bytes(data, rules.LONE_CR, control, foreign),
        _check_sections(job),
        _check_header(job),
        _check_positions(job),
        _check_use(job),
        _check_order(job),
        rules.judged(job.inst, _check_step, names=_names_of),
        block_faults(job.inst, _BLOCKS),
    )


def _check_sections(job: Job) -> Iterator[Problem]:
    steps = [s for s in job.inst if s.kind not in _OF_INST and not s.fault]
    first = steps[0].row if steps else 0
    strays = [s for s in job.head if s.kind != "name" and s.word("HEADING") != "///FOLDERNAME"]
    strays += job.after
    strays += [s for kind in (*reader.OF_POS, "name") for s in job.kinds[kind]]
    strays += [s for kind in _OF_INST for s in job.kinds[kind] if s.row > first > 0]
    strays += [m for k, m in enumerate(job.marks) if m.kind in ("arginfo", "macro") and k != 2]
    for statement in strays:
        if not statement.fault:
            level: Level = "measuring" if statement.kind == "comment" else "error"
            reason = f"{statement.text[:30]!a} belongs nowhere"
            yield Problem(statement.row, "sections", reason, level)
    if not steps or steps[0].kind != "nop":
        yield Problem(first or 1, "sections", "NOP is due as the first step")
    if len(steps) >= _MOST_STEPS:
        reason = f"{len(steps) + 1} steps, at most {_MOST_STEPS} fit"
        yield Problem(steps[_MOST_STEPS - 1].row, "length", reason)
    names = [s for s in job.head if s.kind == "name"]
    if len(names) != 1 or not _NAME.fullmatch(names[0].word("TEXT")):
        reason = "one //NAME: letters, digits, _ and -, 32 characters in all"
        yield Problem(names[0].row if names else 1, "job-name", reason)


def _check_header(job: Job) -> Iterator[Problem]:
    of = job.kinds
    for kind in ("date", "comm", "attr", "frame"):
        for statement in of[kind][1:]:
            yield Problem(statement.row, "header", f"{statement.text[:10]!a} is there twice")
        if not of[kind] and kind in ("date", "attr"):
            yield Problem(1, "header", f"///{kind.upper()} is missing")
    groups = [s.word("NUMBER") for s in of["group"]]
    moves = bool(of["move"] or of["also"])
    if groups != [str(k + 1) for k in range(len(groups))] or (moves and not groups):
        row = of["group"][0].row if groups else 1
        yield Problem(row, "header", "///GROUP1 is due, and then 2 and 3 for further ones")
    controls = {word[:2] for s in of["group"] for word in s.words("CONTROL")}
    based = next((s for s in of["move"] if _has_base(s)), None)
    if based and groups and "BS" not in controls:
        yield Problem(based.row, "header", "a base axis moves, and no ///GROUP has BS1")
    for s in of["date"]:
        try:
            datetime.strptime(" ".join(s.words("DATE", "TIME"))[:16], "%Y/%m/%d %H:%M")
        except ValueError:
            yield Problem(s.row, "header", "///DATE is not like 2026/01/31 23:59")
    for s in of["attr"]:
        said = Counter(s.words("ATTRIBUTE"))
        access = said["RW"] + said["RO"] + said["WO"]
        if max(said.values()) > 1 or not said["SC"] + said["CJ"] or access != 1:
            reason = "///ATTR is SC or CJ, one of RW, RO, WO, and RJ where the job is relative"
            yield Problem(s.row, "header", reason)
    for s in of["comm"]:
        text = s.word("TEXT")
        if len(text) > MOST_COMMENT:
            # another editor may have saved letters of other scripts as several bytes
            level: Level = "error" if text.isascii() else "measuring"
            yield Problem(s.row, "header", "the job's comment is longer than 32 characters", level)


def _check_positions(job: Job) -> Iterator[Problem]:
    widths: dict[str, int] = {}
    relative = any("RJ" in s.words("ATTRIBUTE") for s in job.kinds["attr"])
    frame = " ".join(str(word) for s in job.kinds["frame"] for word in s.tree.children)
    for stored in job.stored:
        for fault in _frame_faults(stored.frame, stored.tool, stored.user):
            yield Problem(stored.row, "position-format", f"{stored.label} {fault}")
        yield from _number_faults(stored)
        carrier, count = stored.name.kind.rstrip("CPX"), len(stored.values)
        if carrier not in _WIDTHS:
            continue
        if count not in _WIDTHS[carrier] or count != widths.setdefault(carrier, count):
            due = "one to three, as all others" if carrier else "six"
            reason = f"{stored.label} has {count} values, not {due}"
            yield Problem(stored.row, "position-format", reason)
        if not stored.posed or carrier:
            continue
        fault, level = _rconf_fault(stored.rconf)
        if fault:
            yield Problem(stored.row, "rconf", f"{stored.label}: {fault}", level)
        own = f"USER {stored.user}" if stored.frame == "USER" else stored.frame
        if stored.name.kind == "C" and not (relative and frame == own):
            reason = f"{stored.label} is in {own}, the job is{' ' if relative else ' not '}relative"
            reason += f" and has {'////FRAME ' + frame if frame else 'no ////FRAME'}"
            yield Problem(stored.row, "relative-job", reason, "measuring")


@lru_cache(maxsize=64)
def _frame_faults(frame: str, tool: str, user: str) -> list[str]:
    faults = [] if tool else ["has no ///TOOL above"]
    if frame == "USER" and not user:
        faults.append("is in a user frame, and no ///USER says which")
    for word, text in (("TOOL", tool), ("USER", user)):
        numbers = [number for number in text.split(",") if number]
        if any(not n.isdecimal() or len(n) > 3 or int(n) > reader.MOST_FRAME for n in numbers):
            faults.append(f"has ///{word} {text[:20]}, not 0 to {reader.MOST_FRAME}")
    return faults


@lru_cache(maxsize=64)
def _rconf_fault(rconf: str) -> tuple[str, Level]:
    found = _RCONF.fullmatch(rconf)
    if not found:
        return f"///RCONF is {rconf[:60]!a}", "error"
    other = (found[1] or "").strip(",0")
    return (f"///RCONF {rconf} is not of a six-axis arm" if other else ""), "measuring"


def _number_faults(stored: Stored) -> Iterator[Problem]:
    """The first value that is no number as the position has them."""
    in_pulses, in_frame = stored.form == "PULSE", stored.posed
    for k, text in enumerate(stored.values):
        fault, most = "", 3 if in_frame and k < 3 else 4
        if in_pulses:
            if not _PULSES.fullmatch(text) or abs(int(text)) >= 2**31:
                fault = "is not a whole number of pulses"
        elif not (found := _DECIMALS.fullmatch(text)) or len(found[1] or "") > most:
            fault = "is not a number of at most 3 decimals of a mm, 4 of a degree"
        elif text[0] == "-" and not text.strip("-0."):
            fault = "is minus zero"
        elif in_frame and k in (3, 4, 5) and stored.name.kind in "CP" and abs(float(text)) > 180.0:
            fault = "is not in [-180, 180] deg"
        if fault:
            reason = f"{stored.label}: {text[:30]!a} {fault}"
            yield Problem(stored.row, "number", reason, "error" if in_pulses else "measuring")
            return


def _check_use(job: Job) -> Iterator[Problem]:
    there = [(p.row, p.label) for p in job.stored if "C" in p.name.kind]
    moves = [
        (s.row, name.label)
        for s in (*job.kinds["move"], *job.kinds["also"])
        for names in reader.positions_in(s)
        for name in names
        if "C" in name.kind
    ]
    others = [(s.row, Name.of(w).label) for s in job.kinds["other"] for w in s.words("POINT")]
    yield from rules.check_names(there, moves, ("", "position-defined", ""))
    yield from rules.check_names(there, moves + others, ("", "", "position-used"))
    for s in chain(job.pos, *(job.kinds[kind] for kind in _WITH_VARIABLES)):
        found = _FEW_DIGITS.search(s.text)
        if found:
            reason = f"{found[0]!a} has not the digits of B000, P00000 or C00000"
            yield Problem(s.row, "argument", reason, "measuring")


def _check_order(job: Job) -> Iterator[Problem]:
    """Rules that follow the steps: whether the arm stands, has a speed, and a place of its base."""
    stands = has_speed = False
    carried = any(map(_has_base, job.kinds["move"]))
    for s in job.inst:
        if s.kind == "move":
            stands = "PL=0" in s.texts(_options)
            if not has_speed and not s.once(_has_speed):
                yield Problem(s.row, "move", "no speed, and no SPEED above", "measuring")
            if carried and not _has_base(s) and reader.positions_in(s)[0]:
                reason = "no position of the base axes, which other moves have"
                yield Problem(s.row, "move", reason, "measuring")
        elif s.kind == "call" and not stands:
            reason = "no move with PL=0 before the CALL: the arm may not have arrived"
            yield Problem(s.row, "stop-before-call", reason, "measuring")
        elif s.kind == "other":
            has_speed |= s.word("WORD") == "SPEED"
            stands &= s.word("WORD") != "IMOV"


def _has_base(s: Statement) -> bool:
    return any(name.kind in ("BC", "BP") for name in reader.positions_in(s)[0])


def _options(move: Tree[Token]) -> list[Tree[Token]]:
    return [part for part in subtrees(move) if part.data == "option"]


def _has_speed(s: Statement) -> bool:
    return any(part.data.endswith("speed") for part in subtrees(s.tree))


def _check_step(s: Statement) -> Iterator[Problem]:
    if s.kind in ("move", "also"):
        parts = [_move_faults(move) for move in s.all("move", "also")]
    else:
        parts = [_word_faults(s) if s.kind == "other" else _argument_faults(s)]
    return (Problem(s.row, *fault) for fault in chain.from_iterable(parts))


def _names_of(s: Statement) -> Hashable:
    """What matters of the names of a step: nothing of those of positions, and all of times."""
    if s.kind == "comment":
        return len(s.text) > 1 + MOST_COMMENT
    types = ("NUMBER",) * (s.kind in ("timer", "pulse_output"))
    return tuple(s.words("WORD", "VARIABLE", "SYSTEM", "TAG", "JOB", "ARGUMENT", *types))


def _argument_faults(s: Statement) -> Iterator[rules.Fault]:
    kind = s.kind
    if kind == "comment" and len(s.text) > 1 + MOST_COMMENT:
        yield "comment", "the comment is longer than 32 characters", "measuring"
    elif kind in ("timer", "pulse_output"):
        time = s.one("time")
        text = text_of(time) if time is not None else ""
        fine = _TIME.fullmatch(text) is not None
        if _NUMBER.fullmatch(text) and not (fine and 0.01 <= float(text) <= 655.35):
            yield "argument", f"T= is {text[:20]!a}, not 0.01 to 655.35", "error"
    elif kind == "set":
        value = s.tree.children[-1]
        if isinstance(value, Token) and value.type == "NUMBER":
            variable = text_of(s.tree)[: -len(value)]
            least, most = _LIMITS.get(variable.lstrip("L")[:1], (-(2**31), 2**31 - 1))
            if not least <= float(value) <= most:
                reason = f"{variable[:20]} is set to {value[:20]!a}, not {least} to {most}"
                yield "argument", reason, "error"
    elif kind == "gets":
        system, variable = s.word("SYSTEM"), text_of(s.one("place") or NOTHING)
        if system and variable.lstrip("L").startswith("PX") != system.startswith("$PX"):
            yield "argument", f"{system[:20]} is stored in {variable[:20]}", "error"
    elif kind == "call":
        called = s.word("JOB")[4:]
        if called and not _NAME.fullmatch(called):
            yield "argument", f"{called[:40]!a} is no name of a job", "error"


def _move_faults(move: Tree[Token]) -> Iterator[rules.Fault]:
    own = str(move.children[0])
    names: list[str] = []
    for part in subtrees(move):
        first = str(part.children[0])
        if part.data == "target":
            kind = first.lstrip("L").rstrip("0123456789")
            names.append("C" if kind == "P" else kind)
        elif part.data == "joint_speed" and _NUMBER.fullmatch(first):
            if not 0.01 <= float(first) <= 100.0:
                yield "argument", f"VJ= is {first[:20]!a}, not 0.01 to 100.00", "error"
        elif part.data == "option":
            names.append(first)
            if first not in _TAGS:
                wrong = first in _SPEEDS or near(first, _TAGS | _SPEEDS)
                reason = f"{first[:30]!a} does not belong there in {own}"
                yield "move", reason, "error" if wrong else "note"
        elif part.data == "flag" and first not in _FLAGS:
            other = _OPTION.fullmatch(first) and first not in INSTRUCTIONS
            wrong = not other or near(first, _FLAGS)
            yield "move", f"{first[:30]!a} is nothing of {own}", "error" if wrong else "note"
    if len(set(names)) < len(names):
        yield "move", f"one of {' '.join(names)[:40]} is there twice in {own}", "error"


def _word_faults(statement: Statement) -> Iterator[rules.Fault]:
    """Of steps with other first words than the grammar knows: of an option or a macro, or none."""
    word, *others = statement.words("WORD")
    if word in INSTRUCTIONS:
        return
    meant = "" if "MJ" in others else near(word, INSTRUCTIONS)
    typed = statement.words("TAG", "STRING", "POINT", "VARIABLE", "SYSTEM", "ARGUMENT")
    told = typed or len(statement.tree.children) == 1 or "#(" in statement.text
    other = _OPTION.fullmatch(word) and told and INSTRUCTIONS.isdisjoint(others)
    reason = f"{word[:30]!a} is no instruction" + f"; did you mean {meant}?" * bool(meant)
    yield "instruction", reason, "error" if meant or not other else "note"
