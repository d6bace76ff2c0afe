"""KUKA KRL programs (``.src`` and ``.dat``): the strict validator.

Each rule is one that a controller enforces, or that a measuring program needs to measure what was
planned. Sources: the public grammar of KRL (antlr/grammars-v4, kuka), public post-processors,
programs written by controllers. Nothing was loaded into a controller. The rules that ask for the
other file look for it beside the one that is checked, with the same name.

=======================  ========================================================================
rule                     what it asks
=======================  ========================================================================
``ascii``                plain ASCII characters
``line-length``          a ``.src`` fewer than 120 characters a line, but for headers and what the
                         pendant writes (FOLD, WITH), a ``.dat`` 255, but for what the pendant
                         keeps of its forms (MODULEPARAM_T, SUGG_T): controllers differ
``module``               a ``.dat`` is DEFDAT ... ENDDAT, a ``.src`` routines, DEF ... END
``module-name``          a letter, then letters, digits, ``_``, 24 in all, no word of the
                         language; the same as the name of the file
``brackets``             each bracket and quote closed on its line
``block``                each IF, FOR, WHILE, LOOP, REPEAT, SWITCH closed by its own end
``instruction``          each line begins with a word of KRL, a declaration, an assignment or a
                         call
``declarations-first``   no declaration behind the first instruction of a routine
``companion``            the other file is there, and is a module of the same name
``position-format``      A1 to A6, or X Y Z A B C and perhaps S T; E1 to E6 as well; each once
``position-defined``     each position moved to is defined
``position-unique``      each position is defined once
``position-used``        each position ``XP1``, ``XP2``, ... of a ``.dat`` is used
``number``               plain decimal numbers: no NaN, no ``-0.0``; angles within +-180 deg in a
                         pose; joints within +-720 deg; S from 0 to 31, T from 0 to 63
``first-move``           the first motion is PTP, and to a position that says all: the controller
                         goes there in block coincidence
``motion``               a target, then only C_PTP, C_DIS, C_ORI, C_VEL, C_SPL, #BASE, #TOOL, WITH;
                         LIN, CIRC and SPL go to poses
``speed``                VEL_PTP and ACC_PTP from 1 to 100 percent
``frame-value``          tools 0 to 16, bases 0 to 32; a value of $TOOL or $BASE has all of X Y Z
                         A B C
``initialised``          BAS(#INITMOV,0) before the first motion
``frame``                $TOOL and $BASE set before the first motion
``standstill``           between a motion and a call, a pulse or the keeping of a position: WAIT,
                         and the motion not approximated
``array-bounds``         indices within the array declared in the ``.dat``
=======================  ========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from calib.errors import FileFormatError
from posedesign.programs.kuka_krl.listing import (
    DECLARES,
    Module,
    instructions,
    named_target,
    split_module,
)
from posedesign.programs.kuka_krl.motion_rules import check_settings, check_words
from posedesign.programs.kuka_krl.position_rules import (
    check_bounds,
    check_fields,
    check_motions,
    check_numbers,
    check_targets,
    check_unique,
    check_use,
)
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import Problem

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no program has one in each of its lines."""

MOST_LENGTH, MOST_LENGTH_OF_DATA = 119, 255
"""Characters of a line of a ``.src`` and of a ``.dat``, which the pendant writes itself."""

_IGNORE = re.IGNORECASE | re.ASCII
_FIRST_WORDS = """
ANIN ANOUT BRAKE CASE CCLOSE CIRC CIRC_REL CONFIRM CONTINUE COPEN CREAD CWRITE DECL DEF DEFAULT
DEFDAT DEFFCT DIGIN ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE ENDSWITCH ENDWHILE ENUM
EXIT EXT EXTFCT FOR GLOBAL GOTO HALT IF IMPORT INTERRUPT LIN LIN_REL LOOP PTP PTP_REL PULSE REPEAT
RESUME RETURN SCIRC SIGNAL SLIN SPL SPLINE SPTP STRUC SWITCH TRIGGER UNTIL WAIT WHILE
"""
_OTHER_WORDS = """
AND AXIS B_AND B_EXOR B_NOT B_OR BOOL C_DIS C_ORI C_PTP C_VEL CAST_FROM CAST_TO CHANNEL CHAR CONST
DELAY DO E6AXIS E6POS EXOR FALSE FRAME INT IS MAXIMUM MINIMUM NOT OR POS PRIO PUBLIC REAL SEC STEP
THEN TO TRUE WHEN WITH
"""
_WORDS_IN_DATA = "DECL DEFDAT ENDDAT EXT EXTFCT GLOBAL SIGNAL STRUC ENUM IMPORT CONST"
_BEGINNING = frozenset(_FIRST_WORDS.split())
_RESERVED = _BEGINNING | frozenset(_OTHER_WORDS.split())
_IN_DATA = frozenset(_WORDS_IN_DATA.split())
_TYPED = re.compile(r"[A-Z_]\w* +[A-Z_$]\w*(?: *\[[^\]]*\])?(?: *,.*| *=.*)?", _IGNORE)
_STATEMENT = re.compile(
    r"[A-Z_$][\w$]*(?:\[[^\]]*\])?(?:\.[A-Z_$][\w$\[\]]*)* *(?:=|\(|:$)", _IGNORE
)
_OF_THE_PENDANT = re.compile(r"DECL (?:GLOBAL )?(?:MODULEPARAM_T|[A-Z]\w{0,23}_SUGG_T) ", _IGNORE)
_BLOCKS = {
    "IF": "ENDIF",
    "FOR": "ENDFOR",
    "WHILE": "ENDWHILE",
    "LOOP": "ENDLOOP",
    "REPEAT": "UNTIL",
    "SWITCH": "ENDSWITCH",
    "SPLINE": "ENDSPLINE",
}
_CLOSES = frozenset(_BLOCKS.values())
_CLOSING = {")": "(", "]": "[", "}": "{"}


def check_kuka_krl(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    module = split_module(data.decode("latin-1"))  # any byte is a character: none is lost
    other, missing = _companion(path, module)
    checks = [
        _check_lines(module),
        _check_modules(module, path),
        _check_brackets(module),
        _check_blocks(module),
        _checkinstructions(module),
        missing,
        check_fields(module),
        check_numbers(module),
        check_unique(module),
    ]
    data_module, source = (module, other) if module.is_data else (other, module)
    if module.is_data:
        checks.append(check_use(module, other))
    else:
        checks += [
            check_targets(module, other),
            check_motions(module, other),
            check_words(module, other),
            check_settings(module),
        ]
    if data_module is not None and source is not None:
        checks.append(check_bounds(module, data_module, source))
    problems = [problem for check in checks for problem in islice(check, MOST_PROBLEMS)]
    return sorted(problems, key=lambda p: (p.line, p.rule, p.message))[:MOST_PROBLEMS]


def _companion(path: Path, module: Module) -> tuple[Module | None, Iterator[Problem]]:
    """The other file of the program, and what is wrong with it."""
    ending = ".src" if module.is_data else ".dat"
    for name in (path.with_suffix(ending), path.with_suffix(ending.upper())):
        if not name.is_file():
            continue
        try:
            other = split_module(read_program_bytes(name).decode("latin-1"))
        except FileFormatError as error:
            return None, iter([Problem(1, "companion", f"{name.name}: {error.message}")])
        mine, its = (m.begins[0][2].upper() if m.begins else "" for m in (module, other))
        if mine != its or module.is_data == other.is_data:
            reason = f"{name.name} is the module {its[:40]!a}, not the other file of {mine[:40]!a}"
            return None, iter([Problem(1, "companion", reason)])
        return other, iter(())
    if not module.is_data and not _moves_to_variables(module):
        return None, iter(())  # all its positions stand in the motions
    return None, iter([Problem(1, "companion", f"{path.stem}{ending} is not beside it")])


def _moves_to_variables(module: Module) -> bool:
    return any(named_target(target) for _, _, target in module.motions)


def _check_lines(module: Module) -> Iterator[Problem]:
    most = MOST_LENGTH_OF_DATA if module.is_data else MOST_LENGTH
    for line in module.lines:
        bad = re.search(r"[^\t -~]", line.text)
        if bad:
            reason = f"the byte 0x{ord(bad[0]):02x} is not plain ASCII text"
            yield Problem(line.row, "ascii", reason)
        # lines of inline forms, which the pendant writes itself
        free = line.text.lstrip().upper().startswith((";FOLD", "&")) or " WITH $" in line.code
        free = free or (module.is_data and _OF_THE_PENDANT.match(line.code) is not None)
        if len(line.text) > most and not free:
            reason = f"{len(line.text)} characters, more than {most}"
            yield Problem(line.row, "line-length", reason)


def _check_modules(module: Module, path: Path) -> Iterator[Problem]:
    if not module.begins:
        yield Problem(1, "module", "there is no DEFDAT and no DEF")
        return
    yield from _check_ends(module)
    yield from _stray(module)
    first = module.begins[0]
    if any(begin[1] == "DEFDAT" for begin in module.begins[module.is_data :]):
        row = module.begins[-1][0]
        yield Problem(row, "module", "a .dat holds one DEFDAT, a .src none")
    suffix = path.suffix.lower()
    if suffix in (".dat", ".src") and module.is_data != (suffix == ".dat"):
        yield Problem(first[0], "module", f"{first[1]} in a {suffix}")
    for row, kind, name, rest in module.begins:
        if not re.fullmatch(r"[A-Z_]\w{0,23}", name, _IGNORE) or name.upper() in _RESERVED:
            reason = f"{name[:40]!a} is no name: a letter, then letters, digits, _, 24 in all"
            yield Problem(row, "module-name", reason)
        elif row == first[0] and name.upper() != path.stem.upper():
            yield Problem(row, "module-name", f"{name} in the file {path.name}")
        rest_form = r"(PUBLIC)?" if kind == "DEFDAT" else r"\([^()]*\)"
        if not re.fullmatch(rest_form, rest.strip(), _IGNORE):
            yield Problem(row, "module", f"{rest[:30]!a} behind the name of the module")


def _check_ends(module: Module) -> Iterator[Problem]:
    """Each module and routine has its own end."""
    wanted = {"DEFDAT": "ENDDAT", "DEF": "END", "DEFFCT": "ENDFCT"}
    open_kind = ""
    for row, kind in sorted([(row, kind) for row, kind, _, _ in module.begins] + module.ends):
        if kind in wanted:
            if open_kind:
                yield Problem(row, "module", f"{kind} before {wanted[open_kind]}")
            open_kind = kind
        elif wanted.get(open_kind) != kind:
            yield Problem(row, "module", f"{kind} closes nothing")
        else:
            open_kind = ""
    if open_kind:
        yield Problem(len(module.lines), "module", f"there is no {wanted[open_kind]}")


def _stray(module: Module) -> Iterator[Problem]:
    """Instructions outside of all routines."""
    begins, ends = [b[0] for b in module.begins], [e[0] for e in module.ends]
    last_end = ends[-1] if ends else len(module.lines)
    for line in module.lines:
        outside = line.row < begins[0] or line.row > last_end
        if outside and line.code and not line.code.startswith("&"):
            yield Problem(line.row, "module", "the line is in no routine and no data list")


def _check_brackets(module: Module) -> Iterator[Problem]:
    for line in instructions(module):
        opened: list[str] = []
        code = re.sub(r'"[^"]*"', "", line.code)
        code = re.sub(r"'[BHbh][0-9A-Fa-f]+'", "0", code)
        fault = "a quote is not closed" if '"' in code or "'" in code else ""
        for character in code:
            if character in "([{":
                opened.append(character)
            elif character in _CLOSING and (not opened or opened.pop() != _CLOSING[character]):
                fault = fault or f"{character} closes nothing"
                break
        if opened and not fault:
            fault = f"{opened[-1]} is not closed"
        if fault:
            yield Problem(line.row, "brackets", fault)


def _first_word(code: str) -> str:
    found = re.match(r"[A-Z_]\w*", code, _IGNORE)
    return found[0].upper() if found else ""


def _check_blocks(module: Module) -> Iterator[Problem]:
    opened: list[tuple[int, str]] = []
    for line in instructions(module):
        word = _first_word(line.code)
        if word in _BLOCKS:
            opened.append((line.row, word))
        elif word in _CLOSES:
            if not opened or _BLOCKS[opened[-1][1]] != word:
                yield Problem(line.row, "block", f"{word} closes nothing")
            else:
                opened.pop()
        elif word in ("END", "ENDFCT"):
            for row, open_word in opened:
                yield Problem(row, "block", f"{open_word} has no {_BLOCKS[open_word]}")
            opened = []


def _checkinstructions(module: Module) -> Iterator[Problem]:
    begun = False
    for line in instructions(module):
        word = _first_word(line.code)
        if word in ("DEF", "DEFFCT", "DEFDAT"):
            begun = False
        declares = bool(DECLARES.match(line.code))
        if not declares and word not in _BEGINNING and not _STATEMENT.match(line.code):
            if not (module.is_data and _TYPED.fullmatch(line.code)):
                reason = f"{line.code[:30]!a} is no instruction"
                yield Problem(line.row, "instruction", reason)
        elif module.is_data and word in _BEGINNING and not declares and word not in _IN_DATA:
            yield Problem(line.row, "instruction", f"{word} in a data list")
        if module.is_data or word in ("DEF", "DEFFCT", "GLOBAL"):
            continue
        if declares and begun and not line.code.upper().startswith("INTERRUPT"):
            yield Problem(line.row, "declarations-first", "a declaration behind an instruction")
        begun = begun or not declares
