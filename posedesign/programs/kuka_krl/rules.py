"""KUKA KRL programs (``.src`` and ``.dat``): the validator's rules, beside the grammar's.

Each is one that a controller enforces, or that a measuring program needs to measure what was
planned (*m*: of the level "measuring"). Sources: as for the grammar. Nothing was loaded into a
controller. The rules that ask for the other file look for it beside the one that is checked, with
the same name; what a program of several files has beyond these two nobody knows here.

======================  =  ======================================================================
rule                       what it asks
======================  =  ======================================================================
``syntax``                 each line is a statement of the grammar
``ascii``               m  plain ASCII characters; none is zero, in any program
``line-length``         m  a ``.src`` fewer than 120 characters a line, a ``.dat`` 255, but for what
                           the pendant writes: controllers differ
``module``                 a ``.dat`` is DEFDAT ... ENDDAT, a ``.src`` routines, DEF ... END
``module-name``            24 characters at most; m: the same as the name of the file
``block``                  each IF, FOR, WHILE, LOOP, REPEAT, SWITCH closed by its own end
``data``                   only declarations and values in a ``.dat``
``declarations-first``     no declaration behind the first instruction of a routine
``unique``                 nothing is declared twice in a file or routine, or has two values
``word``                   no name that is all but a word of the language, and declared nowhere
``call``                   BAS and PULSE are given what they take
``constant``               truth values, texts and names of ENUMs are no times and no indices
``companion``           m  the other file is there, and is a module of the same name
``position-format``        A1 to A6, or X Y Z A B C and perhaps S T; E1 to E6 as well; each once;
                           m: all of them
``number``                 numbers in positions; joints within +-720 deg; m: angles of poses within
                           +-180 deg, S from 0 to 31, T from 0 to 63
``form``                   the data of an inline form (FDAT, PDAT, LDAT) have names that there are,
                           and numbers where there are numbers
``position-defined``    m  each position moved to is defined, with the data of its inline form
``position-used``       m  each position ``XP1``, ``XP2``, ... of a ``.dat`` is used
``first-move``          m  the first motion is PTP, and to a position that says all: the controller
                           goes there in block coincidence
``motion``                 LIN, CIRC and SPL go to poses
``speed``                  PTP velocities and accelerations from 1 to 100 percent
``frame-value``            tools and bases from 0; m: tools to 16, bases to 32; a value of $TOOL or
                           $BASE has all of X Y Z A B C
``initialised``         m  BAS(#INITMOV,0) before the first motion
``frame``               m  $TOOL and $BASE set before the first motion
``standstill``          m  between a motion and a call, a pulse or the keeping of a position: WAIT,
                           and the motion not approximated
``array-bounds``           indices within the array declared in the ``.dat``
``routine``                (note) what is called stands in another file
======================  =  ======================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TypeGuard

from lark import Token, Tree

from calib.errors import FileFormatError
from posedesign.programs.kuka_krl.syntax import (
    AXES,
    BEGINS,
    CONFIGURATION,
    EXTERNAL,
    MOST_BASE,
    MOST_TOOL,
    POSE,
    TYPES_OF_POSITIONS,
    Node,
    arguments_of,
    as_number,
    bas_of,
    fields_of,
    items_of,
    key_of,
    kind_of,
    name_of_module,
    settings_of,
    statements_of,
    type_of,
    word_of,
    words_of,
)
from posedesign.programs.language import Block, Statement, block_faults
from posedesign.programs.reading import MOST_JOINT_DEG, read_program_bytes
from posedesign.programs.recorded import Level, Problem

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no program has one in each of its lines."""

MOST_LENGTH, MOST_LENGTH_OF_DATA = 119, 255
"""Characters of a line of a ``.src`` and of a ``.dat``, which the pendant writes itself."""

_OF_THE_PENDANT = re.compile(
    r"\s*(?:;\s*(?:END)?FOLD|;\s*Params|&)|.* WITH \$"
    r"|\s*DECL (?:GLOBAL )?(?:MODULEPARAM_T|\w+_SUGG_T) ",
    re.IGNORECASE | re.ASCII,
)


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_BLOCKS = {
    "if_": Block("endif", ("else_",)),
    "for_": Block("endfor"),
    "while_": Block("endwhile"),
    "loop": Block("endloop"),
    "repeat": Block("until"),
    "switch": Block("endswitch", ("case", "default")),
    "spline": Block("endspline"),
}
_DECLARE = ("declaration", "external", "structure", "enumeration", "signal", "import_")
_COMMANDS = _words(
    """INITMOV ACC_CP ACC_PTP ACC_GLUE VEL_CP VEL_PTP TOOL BASE EX_BASE PTP_DAT CP_DAT PTP_PARAMS
    CP_PARAMS OUT_SYNC OUT_ASYNC GROUP FRAMES"""
)
_TYPES = _words(
    """INT REAL BOOL CHAR AXIS E3AXIS E6AXIS POS E3POS E6POS FRAME LOAD INERTIA FDAT PDAT LDAT
    BAS_COMMAND"""
)
_STATES = frozenset(("FDAT_ACT", "PDAT_ACT", "LDAT_ACT"))
_WORDS = _words(
    """CASE CIRC CONFIRM CONTINUE DECL DEFAULT DEFDAT DEFFCT ELSE ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP
    ENDSWITCH ENDWHILE ENUM EXIT EXTFCT FALSE GLOBAL GOTO HALT IMPORT INTERRUPT LOOP REPEAT RESUME
    RETURN SCIRC SIGNAL SLIN SPLINE SPTP STRUC SWITCH TRIGGER TRUE UNTIL WAIT WHILE"""
)
_BAS = frozenset(("BAS",))
_TRUTHS = frozenset(("TRUE", "FALSE"))
_CALLED = _WORDS | {"BAS", "PULSE"}
_TYPES_OR_WORDS = _TYPES | _WORDS | {"PTP", "LIN"}
_SYSTEM = _words(
    """$OUT $TOOL $BASE $LOAD $AXIS_ACT $POS_ACT $BWDSTART $IPO_MODE $STOPMESS $NULLFRAME $ADVANCE
    $H_POS $VEL_AXIS $ACC_AXIS"""
)
_KEPT = frozenset(("$AXIS_ACT", "$POS_ACT", "$AXIS_ACT_MEAS", "$POS_ACT_MES"))
_FORM_WORDS = _words("IPO_FRAME APO_MODE ORI_TYP CIRC_TYP")
_FORMS = {
    "FDAT": _words("TOOL_NO BASE_NO IPO_FRAME POINT2[] TQ_STATE"),
    "PDAT": _words("VEL ACC APO_DIST APO_MODE GEAR_JERK EXAX_IGN"),
    "LDAT": _words(
        "VEL ACC APO_DIST APO_FAC AXIS_VEL AXIS_ACC ORI_TYP CIRC_TYP JERK_FAC GEAR_JERK EXAX_IGN"
    ),
}
_GLOBALS = frozenset(
    (
        "FDAT_ACT",
        "PDAT_ACT",
        "LDAT_ACT",
        "XHOME",
        "HOME",
        "FHOME",
        "PDEFAULT",
        "TOOL_DATA",
        "BASE_DATA",
        "LOAD_DATA",
        "SVEL_JOINT",
        "STOOL",
        "SBASE",
        "SLOAD",
        "SACC_JOINT",
        "SAPO_PTP",
        "SIPO_MODE",
        "SGEAR_JERK",
        "USE_CM_PRO_VALUES",
    )
)
_CONSTANTS = ("BOOLEAN", "STRING", "ENUM")
_LARGEST = {"S": 31, "T": 63}


def check_kuka_krl(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    module = _Module.of(data)
    other, missing = _companion(path, module)
    dat, src = (module, other) if module.is_data else (other, module)
    checks = [
        _check_lines(module),
        _check_modules(module, path),
        _check_order(module),
        _check_unique(module),
        _check_words(module, other),
        _check_positions(module),
        _check_forms(module),
        missing,
    ]
    if module.is_data:
        checks.append(_check_use(module, src))
    else:
        checks += [_check_motions(module, dat), _check_settings(module)]
        checks += [_check_targets(module, dat)]
    if dat is not None and src is not None:
        checks.append(_check_bounds(module, dat, src))
    found = [problem for check in checks for problem in islice(check, MOST_PROBLEMS)]
    return sorted(found, key=lambda p: (p.line, p.rule, p.message))[:MOST_PROBLEMS]


@dataclass
class _Module:
    """A file: its text, statements, and what it declares."""

    text: str
    statements: list[Statement]
    declared: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    """Variables by their names, with line and type of each declaration."""
    aggregates: list[tuple[int, str, str, Tree[Token]]] = field(default_factory=list)
    """Positions between braces: line, variable, type, tree."""

    kinds: dict[str, list[Statement]] = field(default_factory=dict)

    @classmethod
    def of(cls, data: bytes) -> _Module:
        text = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")  # any byte is a character
        module = cls(text, statements_of(text))
        for statement in module.statements:
            module.kinds.setdefault(statement.kind, []).append(statement)
            module._take(statement)
        return module

    def of_kind(self, *kinds: str) -> Iterator[Statement]:
        """Statements of these kinds, one kind behind the other."""
        for kind in kinds:
            yield from self.kinds.get(kind, ())

    @cached_property
    def begins(self) -> list[Statement]:
        return [statement for statement in self.statements if statement.kind in BEGINS]

    @property
    def is_data(self) -> bool:
        return bool(self.begins) and self.begins[0].kind == "begin_data"

    @property
    def name(self) -> str:
        return name_of_module(self.begins[0]) if self.begins else ""

    @cached_property
    def routines(self) -> list[list[Statement]]:
        """Statements of each routine, its begin and end included."""
        found: list[list[Statement]] = [[]]
        for statement in self.statements:
            if statement.kind in BEGINS:
                found.append([])
            found[-1].append(statement)
        return found

    @cached_property
    def names(self) -> set[str]:
        """All that is declared here: variables, types, routines and their parameters."""
        found = set(self.declared)
        for statement in self.of_kind(*BEGINS, *_DECLARE[2:]):
            found.update(map(str.upper, statement.words("NAME")))
        for statement in self.of_kind("external"):
            found.add(key_of(_own_name(statement)))
        return found

    def _take(self, statement: Statement) -> None:
        kind, row = statement.kind, statement.row
        if kind == "declaration":
            of_type = type_of(statement)
            for item in items_of(statement):
                name = str(item.children[0]).upper()
                self.declared.setdefault(name, []).append((row, of_type))
                value = item.children[-1]
                if of_type in TYPES_OF_POSITIONS and _is_aggregate(value):
                    self.aggregates.append((row, name, of_type, value))
        elif kind in ("motion", "assignment"):
            self._take_aggregate(statement)

    def _take_aggregate(self, statement: Statement) -> None:
        motion = statement.kind == "motion"
        variable = "" if motion else key_of(statement.tree.children[0])
        for value in statement.tree.children[1:]:
            if not _is_aggregate(value):
                continue
            names = {name for name, _ in fields_of(value)}
            known = kind_of(value) in TYPES_OF_POSITIONS or names & {"A1", "S", "T"}
            if motion or (known and "$" not in variable):
                self.aggregates.append((statement.row, variable, kind_of(value), value))


def _own_name(external: Statement) -> Token:
    """Name of the routine that is declared."""
    return next(child for child in external.tree.children if isinstance(child, Token))


def _is_aggregate(node: Node) -> TypeGuard[Tree[Token]]:
    return isinstance(node, Tree) and node.data == "aggregate"


def _companion(path: Path, module: _Module) -> tuple[_Module | None, Iterator[Problem]]:
    """The other file of the program, and what is wrong with it."""
    ending = ".src" if module.is_data else ".dat"
    for name in (path.with_suffix(ending), path.with_suffix(ending.upper())):
        if not name.is_file():
            continue
        try:
            other = _Module.of(read_program_bytes(name))
        except FileFormatError as error:
            return None, _measuring(1, "companion", f"{name.name}: {error.message}")
        mine, its = module.name.upper(), other.name.upper()
        if not mine or not its:
            return None, iter(())
        if mine != its or module.is_data == other.is_data:
            reason = f"{name.name} is the module {its[:40]!a}, not the other file of {mine[:40]!a}"
            return None, _measuring(1, "companion", reason)
        return other, iter(())
    if not module.is_data and not any(_target(s) for s in module.statements):
        return None, iter(())  # all its positions stand in the motions
    return None, _measuring(1, "companion", f"{path.stem}{ending} is not beside it")


def _measuring(row: int, rule: str, reason: str) -> Iterator[Problem]:
    yield Problem(row, rule, reason, "measuring")


def _target(statement: Statement) -> str:
    """The variable that a motion goes to; empty for braces, system variables and the home."""
    key = key_of(statement.tree.children[1]) if statement.kind == "motion" else ""
    return "" if key in ("XHOME", "HOME") or key.startswith("$") else key


def _check_lines(module: _Module) -> Iterator[Problem]:
    text = module.text
    row = last = 0
    for found in re.finditer(r"[^\t\r\n -~]", text):
        if row and "\n" not in text[last : found.start()]:
            continue
        row = max(row, 1) + text.count("\n", last, found.start())
        last = found.start()
        level: Level = "measuring" if found[0] > " " else "error"
        yield Problem(
            row, "ascii", f"the byte 0x{ord(found[0]):02x} is not plain ASCII text", level
        )
    most = MOST_LENGTH_OF_DATA if module.is_data else MOST_LENGTH
    row, last = 1, 0
    for found in re.finditer(rf"[^\r\n]{{{most + 1},}}", text):
        row += text.count("\n", last, found.start())
        last = found.start()
        if not _OF_THE_PENDANT.match(found[0][:1000]):
            reason = f"{len(found[0])} characters, more than {most}"
            yield Problem(row, "line-length", reason, "measuring")


def _check_modules(module: _Module, path: Path) -> Iterator[Problem]:
    if not module.begins:
        yield Problem(1, "module", "there is no DEFDAT and no DEF")
        return
    yield from _check_ends(module)
    first = module.begins[0]
    for begin in module.begins[1:]:
        if "begin_data" in (first.kind, begin.kind):
            yield Problem(begin.row, "module", "a .dat holds one DEFDAT, a .src none")
    suffix = path.suffix.lower()
    if suffix in (".dat", ".src") and module.is_data != (suffix == ".dat"):
        yield Problem(first.row, "module", f"{first.text[:20]!a} in a {suffix}")
    for begin in module.begins:
        name = name_of_module(begin)
        if len(name) > 24:
            yield Problem(
                begin.row, "module-name", f"{name[:40]} has {len(name)} characters, not 24"
            )
        if begin.kind != "begin_data" and begin.one("parameters") is None:
            yield Problem(begin.row, "module", f"no brackets behind the name {name}")
    if module.name.upper() != path.stem.upper():
        # a file that was renamed on its way runs under its own name
        reason = f"{module.name} in the file {path.name}"
        yield Problem(first.row, "module-name", reason, "measuring")


def _check_ends(module: _Module) -> Iterator[Problem]:
    """Each module and routine has its own end, and nothing stands outside."""
    opened: Statement | None = None
    stray = False
    for statement in module.statements:
        kind, word = statement.kind, statement.text[:30].strip()
        if kind in BEGINS:
            if opened is not None:
                yield Problem(statement.row, "module", f"{word!a} before {_end_of(opened)}")
            opened = statement
        elif kind in BEGINS.values():
            if opened is None or BEGINS[opened.kind] != kind:
                yield Problem(statement.row, "module", f"{word.upper()} closes nothing")
            opened = None
        elif opened is None and not stray:
            stray = True
            yield Problem(statement.row, "module", "the line is in no routine and no data list")
    if opened is not None:
        row = module.text.count("\n") + 1
        yield Problem(row, "module", f"there is no {_end_of(opened)}")


def _end_of(begin: Statement) -> str:
    return {"begin": "END", "begin_function": "ENDFCT"}.get(begin.kind, "ENDDAT")


def _check_order(module: _Module) -> Iterator[Problem]:
    """Rules ``syntax``, ``block``, ``data`` and ``declarations-first``."""
    for routine in module.routines:
        yield from block_faults(routine, _BLOCKS)
        begun = False
        for statement in routine:
            kind, row = statement.kind, statement.row
            if statement.fault:
                yield Problem(row, "syntax", statement.fault)
            elif kind in BEGINS or kind in BEGINS.values():
                continue
            elif module.is_data and kind not in (*_DECLARE, "assignment"):
                yield Problem(row, "data", f"{statement.text[:30]!a} in a data list")
            elif kind in _DECLARE:
                if begun and not module.is_data:
                    reason = "a declaration behind an instruction"
                    yield Problem(row, "declarations-first", reason)
            else:
                begun = True


def _check_unique(module: _Module) -> Iterator[Problem]:
    for routine in module.routines:
        seen: set[str] = set()
        for statement in routine:
            if statement.kind == "declaration":
                names = [str(item.children[0]).upper() for item in items_of(statement)]
            elif statement.kind == "external":
                names = ["EXT " + statement.word("NAME").upper()]
            elif statement.kind == "assignment" and module.is_data:
                names = ["=" + key_of(statement.tree.children[0])]
            else:
                continue
            for name in names:
                if name in _TYPES:
                    yield Problem(statement.row, "word", f"{name} is a type, no name")
                if name in seen:
                    label = name.removeprefix("EXT ").removeprefix("=")
                    yield Problem(statement.row, "unique", f"{label} is defined twice")
                seen.add(name)


def is_near(word: str, known: frozenset[str]) -> str:
    """The known word that differs in one letter, or by two that are swapped; empty for none."""
    for other in known:
        if abs(len(other) - len(word)) > 1 or len(other) < 3:
            continue
        left, right = _behind_same(word, other)
        left, right = _behind_same(left[::-1], right[::-1])
        if max(len(left), len(right)) == 1 or (len(left) == 2 and left == right[::-1]):
            return other
    return ""


def _behind_same(one: str, other: str) -> tuple[str, str]:
    """What is left of two texts behind the characters that they begin with both."""
    pairs = zip(one, other, strict=False)
    same = next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))
    return one[same:], other[same:]


def _check_words(module: _Module, other: _Module | None) -> Iterator[Problem]:
    """Rules ``word``, ``call``, ``constant`` and ``routine``."""
    declared = module.names | (other.names if other else set())
    told: set[tuple[str, frozenset[str]]] = set()
    for statement in module.statements:
        row = statement.row
        yield from _check_constants(statement, module.is_data)
        if statement.kind == "call":
            yield from _check_call(statement)
        elif statement.kind == "external":
            is_bas = key_of(_own_name(statement)) == "BAS"
            if not is_bas and "BAS_COMMAND" in statement.text.upper():
                yield Problem(row, "word", "what takes a BAS_COMMAND is BAS")
        if statement.kind == "declaration" and type_of(statement).startswith("DECL"):
            yield Problem(row, "word", "no blank behind DECL")
        for word, known in _spelt(statement):
            if not word or word in declared or word in known or (word, known) in told:
                continue
            told.add((word, known))
            near = is_near(word, known)
            if near:
                yield Problem(row, "word", f"{word} is no word that is known here: {near}?")
            elif known is _CALLED:
                yield Problem(row, "routine", f"{word} stands in another file", "note")


def _spelt(statement: Statement) -> Iterator[tuple[str, frozenset[str]]]:
    """Names of a statement in capitals, each with the words that it could be meant to be."""
    kind = statement.kind
    if kind == "declaration":
        plain = statement.words("DECL", "GLOBAL", "CONST")
        yield type_of(statement), _TYPES if plain else _TYPES_OR_WORDS
    elif kind == "external":
        types = [words_of(child.children[0]).upper() for child in statement.all("type")]
        yield from ((name, _TYPES) for name in types)
    elif kind == "assignment":
        variable, value = statement.tree.children
        yield _base_of(variable), _STATES
        yield _base_of(value), _TRUTHS
    elif kind == "call":
        yield key_of(statement.tree.children[0]), _CALLED
        for argument in arguments_of(statement):
            yield _base_of(argument), _TRUTHS
    for name in statement.words("NAME"):
        if name[0] == "$":
            yield name.upper(), _SYSTEM


def _base_of(node: Node) -> str:
    """The variable in capitals, without indices and components."""
    return re.split(r"[\[.]", key_of(node))[0]


def _check_call(statement: Statement) -> Iterator[Problem]:
    row, name = statement.row, key_of(statement.tree.children[0])
    given = arguments_of(statement)
    if name == "BAS":
        command, value = bas_of(statement)
        whole = len(given) in (1, 2) and not any(words_of(one) == "" for one in given)
        if not whole or command not in _COMMANDS or words_of(given[0])[0] != "#":
            yield Problem(row, "call", "BAS takes #INITMOV, #VEL_PTP or the like, and a number")
        elif len(given) == 2 and _is_constant(given[1]):
            yield Problem(row, "call", f"BAS(#{command}): {value[:20]} is no number")
    elif given and words_of(given[0]).upper().lstrip("# ") in _COMMANDS and is_near(name, _BAS):
        yield Problem(row, "word", f"{name} is no word that is known here: BAS?")
    elif name == "PULSE" and (
        len(given) != 3
        or "" in map(words_of, given)
        or _is_constant(given[2])
        or key_of(given[0]).endswith("[]")
    ):
        yield Problem(row, "call", "PULSE takes an output, its state, and a time")


def _is_constant(node: Node) -> bool:
    return isinstance(node, Token) and node.type in _CONSTANTS


def _check_constants(statement: Statement, is_data: bool) -> Iterator[Problem]:
    if any(name.upper() in ("NAN", "INF", "INFINITY") for name in statement.words("NAME")):
        yield Problem(statement.row, "number", "NaN and infinity are no numbers of KRL")
    if statement.kind == "wait_sec" and _is_constant(statement.tree.children[0]):
        yield Problem(statement.row, "constant", "the time is no number")
    for index in statement.all("index"):
        if any(_is_constant(child) for child in index.children):
            yield Problem(statement.row, "constant", "an index is no number")
    if is_data and statement.kind == "declaration" and type_of(statement) != "CHAR":
        for item in items_of(statement):
            size = item.children[1] if len(item.children) > 1 else None
            if isinstance(size, Tree) and size.data == "index" and not size.children:
                yield Problem(statement.row, "constant", "the size of the array is missing")
    if statement.kind == "assignment":
        variable, value = statement.tree.children
        if key_of(variable).endswith("[]") and not (
            _is_constant(value) or key_of(value).endswith("[]")
        ):
            yield Problem(statement.row, "constant", "a whole array is given one value")


def _check_positions(module: _Module) -> Iterator[Problem]:
    """Rules ``position-format`` and ``number``."""
    for row, variable, of_type, aggregate in module.aggregates:
        label, fields = variable or "the position", fields_of(aggregate)
        names = [name for name, _ in fields]
        joints = "A1" in names or any(name in AXES for name in names)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            yield Problem(row, "position-format", f"{label} has {twice[0]} twice")
        allowed = {*AXES, *EXTERNAL} if joints else {*POSE, *CONFIGURATION, *EXTERNAL}
        whole = set(AXES if joints else POSE)
        if not set(names) <= allowed:
            reason = f"{label} has {' '.join(names)[:60]}, not A1 to A6 or X Y Z A B C S T"
            yield Problem(row, "position-format", reason)
        elif of_type and joints != of_type.endswith("AXIS") and set(names) - {*EXTERNAL}:
            yield Problem(row, "position-format", f"{label}: {of_type} of {names[0]}")
        elif not whole <= set(names) or len({"S", "T"} & set(names)) == 1:
            reason = f"{label} has {' '.join(names)[:60]}: the others stay as they are"
            yield Problem(row, "position-format", reason, "measuring")
        for name, text in fields:
            fault, level = _number_fault(name, text, module.is_data)
            if fault:
                yield Problem(row, "number", f"{label}: {name} {text[:30]!a} {fault}", level)


def _number_fault(name: str, text: str, is_data: bool) -> tuple[str, Level]:
    if name in _LARGEST:
        bits = re.fullmatch(r"(\d{1,9})|'B([01]{1,9})'", text, re.IGNORECASE | re.ASCII)
        if bits is None:
            return ("is no whole number", "error") if is_data else ("", "error")
        value = int(bits[1]) if bits[1] else int(bits[2], 2)
        fault = f"is not from 0 to {_LARGEST[name]}" if value > _LARGEST[name] else ""
        return fault, "measuring"
    number = as_number(text)
    if math.isnan(number):
        plain = not is_data and not re.match(r"[-+.\d\"#']|TRUE\b|FALSE\b", text, re.IGNORECASE)
        return ("" if plain else "is not a plain number"), "error"
    if name in ("A", "B", "C") and abs(number) > 180.0:
        return "is beyond +-180 deg", "measuring"
    if name in AXES and abs(number) > MOST_JOINT_DEG:
        return f"is beyond +-{MOST_JOINT_DEG:g} deg", "error"
    return "", "error"


def _check_forms(module: _Module) -> Iterator[Problem]:
    for statement in module.of_kind("declaration"):
        of_type = type_of(statement)
        known = _FORMS.get(of_type, frozenset())
        for item in items_of(statement) if known else ():
            for name, text in fields_of(item.children[-1]):
                fault = ""
                if name not in known and (of_type == "FDAT" or is_near(name, known)):
                    fault = f"is no name of {of_type}"
                elif name in _FORM_WORDS:
                    fault = "" if text[:1] == "#" else f"is {text[:20]}, no name with #"
                    if name == "IPO_FRAME" and text.upper() not in ("#BASE", "#TCP"):
                        fault = fault or f"is {text[:20]}, not #BASE or #TCP"
                elif name == "TQ_STATE" and text.upper() not in _TRUTHS:
                    fault = f"is {text[:20]}, not TRUE or FALSE"
                elif name in known - {"POINT2[]", "TQ_STATE"} and math.isnan(as_number(text)):
                    fault = f"is {text[:20]}, no number"
                if fault:
                    yield Problem(statement.row, "form", f"{item.children[0]}: {name} {fault}")


def _check_use(dat: _Module, src: _Module | None) -> Iterator[Problem]:
    if src is None:
        return
    used = {name.upper() for s in src.statements for name in s.words("NAME")}
    for row, variable, _, _ in dat.aggregates:
        if re.fullmatch(r"X?P\d+", variable) and variable not in used:
            yield Problem(row, "position-used", f"{variable} is never used", "measuring")


def _check_targets(src: _Module, dat: _Module | None) -> Iterator[Problem]:
    """Rule ``position-defined``: of all variables, where a program has its data beside it."""
    if dat is None:
        return
    known = {*src.names, *dat.names, *_GLOBALS}
    for statement in src.of_kind("motion", "assignment", "call"):
        names = statement.words("NAME")[statement.kind == "call" :]
        for name in names:
            if name[0] != "$" and name.upper() not in known:
                # it may be global, of a file that is not here
                known.add(name.upper())
                reason = f"{name[:40]} is not defined"
                yield Problem(statement.row, "position-defined", reason, "measuring")


def _check_motions(src: _Module, dat: _Module | None) -> Iterator[Problem]:
    """Rules that follow the program: first motion, frames, standstill, and what LIN goes to."""
    modules = [src] if dat is None else [src, dat]
    names = {
        variable: {name for name, _ in fields_of(aggregate)}
        for module in modules
        for _, variable, _, aggregate in module.aggregates
        if variable
    }
    ready: set[str] = set()
    moved = approximated = False
    stands = True
    for statement in src.statements:
        kind, row = statement.kind, statement.row
        if kind in BEGINS:
            stands, approximated = True, False  # whoever calls the routine sees to that
        elif kind == "motion":
            word, target = word_of(statement), statement.tree.children[1]
            ready |= {name[1:] for name, _ in settings_of(statement)}
            fields = set(names.get(_target(statement), ()))
            fields |= {name for name, _ in fields_of(target)}
            if not moved:
                yield from _check_first(row, word, fields, ready)
            if "A1" in fields and word not in ("PTP", "SPTP", "PTP_REL", "SPTP_REL"):
                yield Problem(row, "motion", f"{word} goes to a pose, not to joint values")
            moved, stands = True, False
            approximated = bool(statement.word("APPROXIMATION"))
        elif kind in ("wait_sec", "wait_for", "halt"):
            stands = True
        elif kind == "call":
            command, _ = bas_of(statement)
            ready |= {"TOOL", "BASE"} if command == "FRAMES" else {command}
            if not command:
                yield from _check_standstill(row, stands, approximated)
        elif kind == "assignment":
            variable, value = statement.tree.children
            key = key_of(variable)
            ready |= {"TOOL", "BASE"} if key == "FDAT_ACT" else {key[1:]}
            if key_of(value) in _KEPT:
                yield from _check_standstill(row, stands, approximated)


def _check_standstill(row: int, stands: bool, approximated: bool) -> Iterator[Problem]:
    if approximated:
        yield Problem(row, "standstill", "the motion before it is approximated", "measuring")
    elif not stands:
        reason = "no WAIT between the motion and this: the arm may still move"
        yield Problem(row, "standstill", reason, "measuring")


def _check_first(row: int, word: str, fields: set[str], ready: set[str]) -> Iterator[Problem]:
    if word not in ("PTP", "SPTP"):
        yield Problem(row, "first-move", f"{word} is the first motion, not PTP", "measuring")
    elif fields and not ({*CONFIGURATION, *POSE} <= fields or "A1" in fields):
        yield Problem(row, "first-move", "the first position has no S and T", "measuring")
    if "INITMOV" not in ready:
        reason = "no BAS(#INITMOV,0) before the first motion"
        yield Problem(row, "initialised", reason, "measuring")
    for name in ("TOOL", "BASE"):
        if name not in ready:
            yield Problem(row, "frame", f"${name} is not set before the first motion", "measuring")


def _check_settings(src: _Module) -> Iterator[Problem]:
    """Rules ``speed`` and ``frame-value``."""
    for statement in src.of_kind("call", "assignment"):
        row = statement.row
        if statement.kind == "call":
            command, text = bas_of(statement)
            value = as_number(text)
            of_ptp = command in ("VEL_PTP", "ACC_PTP", "PTP_PARAMS")
            if of_ptp and not (math.isnan(value) or 1 <= value <= 100):
                yield Problem(row, "speed", f"{command} {text}: not from 1 to 100 percent")
            elif command in ("TOOL", "BASE"):
                yield from _check_frame(row, command, text)
        elif statement.kind == "assignment":
            variable, given = statement.tree.children
            key, name = key_of(variable)[1:], key_of(given)
            if key not in ("TOOL", "BASE"):
                continue
            if isinstance(given, Tree) and any(map(_is_constant, given.children)):
                yield Problem(row, "frame-value", f"${key} has a value that is no number")
            if name.startswith(("TOOL_DATA[", "BASE_DATA[")):
                yield from _check_frame(row, name[:4], name[10:-1])
            elif _is_aggregate(given) and {axis for axis, _ in fields_of(given)} != set(POSE):
                reason = f"${key} has not X Y Z A B C: the others stay as they are"
                yield Problem(row, "frame-value", reason, "measuring")


def _check_frame(row: int, kind: str, text: str) -> Iterator[Problem]:
    most = {"TOOL": MOST_TOOL, "BASE": MOST_BASE}[kind]
    value = as_number(text)
    if value < 0 or value % 1:
        yield Problem(row, "frame-value", f"{kind} {text}: frames are numbered from 0")
    elif value > most:
        reason = f"{kind} {text}: controllers have 0 to {most} as delivered"
        yield Problem(row, "frame-value", reason, "measuring")


def _check_bounds(module: _Module, dat: _Module, src: _Module) -> Iterator[Problem]:
    sizes: dict[str, int] = {}
    for statement in [*dat.of_kind("declaration"), *src.of_kind("declaration")]:
        for item in items_of(statement):
            index = item.children[1] if len(item.children) > 1 else None
            if isinstance(index, Tree) and index.data == "index":
                text = words_of(index)
                if text.isdigit() and len(text) < 8:
                    sizes[str(item.children[0]).upper()] = int(text)
    for statement in module.of_kind("assignment", "call", "motion") if sizes else ():
        for variable in statement.all("variable"):
            found = re.fullmatch(r"(\w+)\[(\d{1,7})\].*", key_of(variable))
            most = sizes.get(found[1]) if found else None
            if found and most is not None and not 1 <= int(found[2]) <= most:
                yield Problem(statement.row, "array-bounds", f"{found[1]}[{found[2]}] of {most}")
