r"""ABB RAPID modules (``.mod``, ``.modx``): the strict validator.

Each rule is one that a controller enforces, or that a measuring program needs to measure what was
planned. Sources: RAPID's manual, Basic characteristics; public post-processors. Nothing was loaded
into a controller. A module that uses data of other modules has problems here: they cannot be seen.

=======================  ========================================================================
rule                     what it asks
=======================  ========================================================================
``encoding``             plain ASCII characters; in a ``.modx`` UTF-8 in remarks and strings
``module``               MODULE name ... ENDMODULE, and nothing before or behind
``identifier``           names: a letter, then letters, digits, ``_``, 32 in all, no word of RAPID
``string``               strings closed on their line, at most 80 characters
``semicolon``            each declaration and instruction ended by ``;``
``statement``            each statement is a declaration, an assignment, or an instruction
``brackets``             each bracket closed in its statement
``block``                each PROC, FUNC, TRAP, IF, FOR, WHILE, TEST closed by its own end
``declarations-first``   data before the instructions of a routine, and before all routines
``position-format``      jointtarget [[6],[6]], robtarget [[3],[4],[4],[6]]; arrays of them
``position-defined``     each position moved to is declared
``unique``               each name is declared once
``position-used``        each position ``p1``, ``jp1``, ... is used
``number``               plain numbers: no NaN, no ``-0.0``; 9E9 for axes that are not there
``quaternion``           norm 1 within 0.00001
``confdata``             whole numbers, the last from 0 to 7
``frame-format``         tooldata and wobjdata: PERS, complete, quaternions of norm 1, mass above 0
``frame``                tool and work object of a motion are declared, or tool0 and wobj0
``motion``               MoveAbsJ to a jointtarget, MoveJ, MoveL, MoveC to robtargets; then a speed,
                         a zone and a tool of these types, each with its own switches only
``wait``                 WaitTime: \InPos, or nothing, and a time
``speed``                VelSet from 1 to 100 percent
``standstill``           between a motion and a call, a pulse or the keeping of a position: WaitTime
                         \InPos, and the motion to a stop point (fine)
``array-bounds``         indices within the declared array
=======================  ========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from posedesign.programs.abb_rapid.data_rules import (
    check_arrays,
    check_frames,
    check_motions,
    check_names,
    check_positions,
    check_use,
)
from posedesign.programs.abb_rapid.listing import Listing, split_listing
from posedesign.programs.abb_rapid.motion_rules import check_words
from posedesign.programs.recorded import Problem

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no program has one in each of its lines."""

MOST_STRING = 80
"""Characters of a string."""

_IGNORE = re.IGNORECASE | re.ASCII
_INSTRUCTION = re.compile(
    r"[A-Z]\w*(?: *\{[^{}]*\})*(?:\.[A-Z]\w*)* ?(?::=.*|:|(?:[\\ ].*)?)", _IGNORE
)
_OPERATOR = re.compile(r" (?:AND|OR|XOR|DIV|MOD|WITH)(?= )| NOT\b", _IGNORE)
_AGAIN = re.compile(r":=.*[^ ] (?:CONST|PERS|VAR) \w+ \w", _IGNORE)
_ADJACENT = re.compile(r"[\w)\]}\"] [\w\"]")
_ODD_NUMBER = re.compile(r"(?:[\[(,=]|:=|\b[A-Z]\w{0,31} )\s?-?(?:nan|inf)\b", _IGNORE)
_NEGATIVE_ZERO = re.compile(r"(?<![\w.)\]}])-0+(?:\.0*)?(?![\d.])")
_BLOCKS = {"PROC", "FUNC", "TRAP", "RECORD", "FOR", "WHILE", "TEST", "MODULE"}
_CLOSING = {")": "(", "]": "[", "}": "{"}
_ROUTINES = ("PROC", "FUNC", "TRAP")


def check_abb_rapid(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    utf8 = path.suffix.lower() == ".modx"
    # any byte is a character: none is lost
    listing = split_listing(data.decode("latin-1"))
    checks = (
        _check_bytes(data, listing, utf8=utf8),
        _check_module(listing),
        check_names(listing),
        _check_strings(listing),
        _check_statements(listing),
        _check_brackets(listing),
        _check_blocks(listing),
        _check_order(listing),
        _check_numbers(listing),
        check_positions(listing),
        check_use(listing),
        check_frames(listing),
        check_motions(listing),
        check_words(listing),
        check_arrays(listing),
    )
    problems = [problem for check in checks for problem in islice(check, MOST_PROBLEMS)]
    return sorted(problems, key=lambda p: (p.line, p.rule, p.message))[:MOST_PROBLEMS]


def _check_bytes(data: bytes, listing: Listing, *, utf8: bool) -> Iterator[Problem]:
    if utf8:
        try:
            data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            row = data.count(b"\n", 0, error.start) + 1
            yield Problem(row, "encoding", "a .modx is UTF-8, and this is not")
    for row, line in enumerate(listing.lines, start=1):
        bad = re.search(r"[^\t -~\x80-\xff]" if utf8 else r"[^\t -~]", line)
        if bad:
            yield Problem(row, "encoding", f"the byte 0x{ord(bad[0]):02x} is no plain character")


def _check_module(listing: Listing) -> Iterator[Problem]:
    found = [s for s in listing.statements if s.code]
    begins = [s for s in found if s.word == "MODULE"]
    ends = [s for s in found if s.word == "ENDMODULE"]
    if not found or not begins or found[0] is not begins[0]:
        yield Problem(found[0].row if found else 1, "module", "MODULE is not the first word")
    elif not ends or found[-1] is not ends[-1]:
        yield Problem(found[-1].row, "module", "ENDMODULE is not the last word")
    elif len(begins) > 1 or len(ends) > 1:
        yield Problem((begins + ends)[1].row, "module", "a file holds one module")


def _check_strings(listing: Listing) -> Iterator[Problem]:
    for row, string in listing.strings:
        if len(string) < 2 or not string.endswith('"'):
            yield Problem(row, "string", "a string is not closed on its line")
        elif len(string) - 2 > MOST_STRING:
            yield Problem(row, "string", f"a string of {len(string) - 2} characters")


def _check_statements(listing: Listing) -> Iterator[Problem]:
    declared = {data.row for data in listing.data}
    for statement in listing.statements:
        if statement.end == "line" or not statement.code:
            continue
        row, code = statement.row, statement.code
        declares = statement.word in ("CONST", "PERS", "VAR")
        # behind its first word an instruction has no two words with nothing between them
        rest = "" if declares else _OPERATOR.sub("+", code.partition(" ")[2])
        if not statement.end or _ADJACENT.search(rest) or (declares and _AGAIN.search(code)):
            yield Problem(row, "semicolon", f"{code[:30]!a} is not ended by a semicolon")
        elif not declares and not _INSTRUCTION.fullmatch(code):
            yield Problem(row, "statement", f"{code[:30]!a} is no statement")
        elif declares and row not in declared:
            yield Problem(row, "statement", f"{code[:30]!a} is no declaration")


def _check_brackets(listing: Listing) -> Iterator[Problem]:
    for statement in listing.statements:
        opened: list[str] = []
        fault = ""
        for mark in re.finditer(r"[\[\](){}]", statement.code):
            if mark[0] in "[({":
                opened.append(mark[0])
            elif not opened or opened.pop() != _CLOSING[mark[0]]:
                fault = f"{mark[0]} closes nothing"
                break
        if opened and not fault:
            fault = f"{opened[-1]} is not closed"
        if fault:
            yield Problem(statement.row, "brackets", fault)


def _check_blocks(listing: Listing) -> Iterator[Problem]:
    opened: list[tuple[int, str]] = []
    for statement in listing.statements:
        word = statement.word
        if statement.end != "line":
            continue
        if word in _BLOCKS or (word == "IF" and re.search(r"\bTHEN$", statement.code, _IGNORE)):
            opened.append((statement.row, word))
        elif word.startswith("END"):
            if opened and word == "END" + opened[-1][1]:
                opened.pop()
            elif word == "ENDMODULE":
                yield from _unclosed(opened[1:])
                opened = []
            else:
                yield Problem(statement.row, "block", f"{word} closes nothing")
    yield from _unclosed(opened[1:])


def _unclosed(opened: list[tuple[int, str]]) -> Iterator[Problem]:
    for row, word in opened:
        yield Problem(row, "block", f"{word} has no END{word}")


def _check_order(listing: Listing) -> Iterator[Problem]:
    inside = begun = routines = False
    for statement in listing.statements:
        word = statement.word
        if statement.end == "line" and word in _ROUTINES:
            inside, begun, routines = True, False, True
        elif statement.end == "line" and word in ("ENDPROC", "ENDFUNC", "ENDTRAP"):
            inside = False
        elif word in ("CONST", "PERS", "VAR"):
            if begun and inside:
                reason = "a declaration behind an instruction"
                yield Problem(statement.row, "declarations-first", reason)
            elif routines and not inside:
                reason = "data of the module behind a routine"
                yield Problem(statement.row, "declarations-first", reason)
        else:
            begun = begun or (inside and bool(statement.code))


def _check_numbers(listing: Listing) -> Iterator[Problem]:
    for statement in listing.statements:
        if _ODD_NUMBER.search(statement.code):
            yield Problem(statement.row, "number", "NaN and infinity are no numbers of RAPID")
        if _NEGATIVE_ZERO.search(statement.code):
            yield Problem(statement.row, "number", "a zero with a sign")
