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
``module-name``         m  24 characters at most; the same as the name of the file
``block``                  each routine, IF, FOR, WHILE, LOOP, REPEAT, SWITCH closed by its own end
``data``                   only declarations and values in a ``.dat``
``declarations-first``     no declaration behind the first instruction of a routine
``unique``                 nothing is declared twice in a file or routine, or has two values
``word``                   no name that is all but a word of the language, and declared nowhere
``call``                   BAS and PULSE are given what they take
``constant``               an array is given its size, and no single value
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
``speed``                  PTP and axis velocities and accelerations from 1 to 100 percent, those
                           of paths above 0; indices of $VEL_AXIS and $ACC_AXIS from 1 to 6
``loop``                   an endless loop moves, waits, or is left
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
from collections.abc import Hashable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path

from lark import Token

from calib.errors import FileFormatError
from posedesign.programs import rules, signatures
from posedesign.programs.kuka_krl import syntax as krl
from posedesign.programs.kuka_krl.syntax import (
    AXES,
    BEGINS,
    CONFIGURATION,
    EXTERNAL,
    POSE,
    Braces,
    Value,
)
from posedesign.programs.language import Block, Statement, block_faults, text_of
from posedesign.programs.reading import MOST_JOINT_DEG, read_program_bytes
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.rules import measuring
from posedesign.programs.sets import set_mark
from posedesign.programs.signatures import Argument

MOST_LENGTH, MOST_LENGTH_OF_DATA = 119, 255
"""Characters of a line of a ``.src`` and of a ``.dat``, which the pendant writes itself."""

_OF_THE_PENDANT = re.compile(
    r"\s*(?:;\s*(?:END)?FOLD|;\s*Params|&)|.* WITH \$"
    r"|\s*DECL (?:GLOBAL )?(?:MODULEPARAM_T|\w+_SUGG_T) ",
    re.IGNORECASE | re.ASCII,
)


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_BLOCKS = krl.BLOCKS | {begin: Block(end) for begin, end in BEGINS.items()}
_DECLARE = _words("declaration external structure enumeration signal channel import_")
_COMMANDS = _words(
    """INITMOV ACC_CP ACC_PTP ACC_GLUE VEL_CP VEL_PTP TOOL BASE EX_BASE PTP_DAT CP_DAT PTP_PARAMS
    CP_PARAMS OUT_SYNC OUT_ASYNC GROUP FRAMES"""
)
_TYPES = _words(
    """INT REAL BOOL CHAR AXIS E3AXIS E6AXIS POS E3POS E6POS FRAME LOAD INERTIA FDAT PDAT LDAT
    BAS_COMMAND"""
)
_TYPES_OF_THE_LANGUAGE = _words("INT REAL BOOL CHAR")
_STATES = _words("FDAT_ACT PDAT_ACT LDAT_ACT")
_WORDS = _words(
    """CASE CIRC CONFIRM CONTINUE DECL DEFAULT DEFDAT DEFFCT ELSE ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP
    ENDSWITCH ENDWHILE ENUM EXIT EXTFCT FALSE GLOBAL GOTO HALT IMPORT INTERRUPT LOOP REPEAT RESUME
    RETURN SCIRC SIGNAL SLIN SPLINE SPTP STRUC SWITCH TRIGGER TRUE UNTIL WAIT WHILE"""
)
_TRUTHS = _words("TRUE FALSE")
_TRIVIAL = _words("NAN INF INFINITY")
_CALLED = _WORDS | {"BAS", "PULSE"}
_TYPES_OR_WORDS = _TYPES | _WORDS | {"PTP", "LIN"}
_SYSTEM = _words(
    """$OUT $TOOL $BASE $LOAD $AXIS_ACT $POS_ACT $BWDSTART $IPO_MODE $STOPMESS $NULLFRAME $ADVANCE
    $H_POS $VEL_AXIS $ACC_AXIS"""
)
_KEPT = _words("$AXIS_ACT $POS_ACT $AXIS_ACT_MEAS $POS_ACT_MES")
_FORMS = {
    "FDAT": _words("TOOL_NO BASE_NO IPO_FRAME POINT2[] TQ_STATE"),
    "PDAT": _words("VEL ACC APO_DIST APO_MODE GEAR_JERK EXAX_IGN"),
    "LDAT": _words(
        "VEL ACC APO_DIST APO_FAC AXIS_VEL AXIS_ACC ORI_TYP CIRC_TYP JERK_FAC GEAR_JERK EXAX_IGN"
    ),
}
"""Names in the data of inline forms. Their values are numbers, but for these."""

_FORM_VALUES = {
    "IPO_FRAME": ("#(BASE|TCP|NONE)", "#BASE or #TCP"),
    "TQ_STATE": ("TRUE|FALSE", "TRUE or FALSE"),
    "POINT2[]": (".*", "a text"),
    **dict.fromkeys(("APO_MODE", "ORI_TYP", "CIRC_TYP"), ("#.*", "a name with #")),
}
_GLOBALS = _STATES | _words(
    """XHOME HOME FHOME PDEFAULT TOOL_DATA BASE_DATA LOAD_DATA SVEL_JOINT STOOL SBASE SLOAD
    SACC_JOINT SAPO_PTP SIPO_MODE SGEAR_JERK USE_CM_PRO_VALUES"""
)
_A_NUMBER = rf"(?!.{{41}}){krl.NUMBER}", "a number"
SETTINGS = signatures.table("""
$VEL_AXIS,$ACC_AXIS,$VEL_EXTAX,$ACC_EXTAX index:whole[1,6] value:number[1,100]
$VEL.CP,$ACC.CP,$VEL.ORI1,$VEL.ORI2,$ACC.ORI1,$ACC.ORI2 value:number(0,]
$OV_PRO value:number[0,100]
$ADVANCE value:whole[0,5]
BAS(#VEL_CP),BAS(#ACC_CP) value(0,]
BAS(#VEL_PTP),BAS(#ACC_PTP),BAS(#PTP_PARAMS) value[1,100]
""")
"""What system variables and commands of BAS are given (KUKA, system variables, KSS 8.3)."""

_DATA_SETTINGS: dict[str, dict[str, tuple[float, float]]] = {
    "PDAT": {"VEL": (1, 100), "ACC": (1, 100)},
    "LDAT": {"VEL": (1e-9, 10), "ACC": (1, 1000)},
}
"""Ranges of the numbers in the data of inline forms [percent; of VEL of LDAT m/s]."""

_DOES = _words(
    """motion spline call wait_sec wait_for halt goto return_ trigger interrupt asynchronous analog
    brake"""
)
"""Statements of a loop that is not idle, or ends."""
_NUMBERED = re.compile(r"X?P\d+")
_LARGEST = {"S": 31, "T": 63}
_WHOLE = ("[]", ",]")  # how indices of a whole array or of one of its rows end
_FRAMES = {"TOOL": krl.MOST_TOOL, "BASE": krl.MOST_BASE}
_CONTROL: rules.Asked = ("ascii", *rules.CONTROL[1:])
_NOT_ASCII: rules.Asked = ("ascii", *rules.FOREIGN[1:3], "measuring")


def check_kuka_krl(data: bytes, path: Path, *, alone: bool = False) -> list[Problem]:
    """Problems in the content of a file; never fails.

    ``alone``: a ``.dat`` is judged without the ``.src``, of which nothing in it can be an error.
    """
    module = _Module(data)
    other, missing = (None, []) if alone and module.is_data else _companion(path, module)
    dat, src = (module, other) if module.is_data else (other, module)
    blocks = list(block_faults(module.statements, _BLOCKS))
    return rules.told(
        rules.syntax(module.statements),
        rules.check_bytes(module.text.encode("latin-1"), _CONTROL, _NOT_ASCII),
        _check_length(module),
        _check_module(module, path),
        blocks,
        () if blocks else _check_loops(module.statements),
        _check_places(module),
        _check_words(module, other),
        _check_statements(module),
        _check_positions(module),
        missing,
        () if module.is_data else _check_motions(module, dat),
        () if dat is None or src is None else _check_names(module, dat, src),
    )


class _Module:
    """A file: its text, statements, and what it declares.

    ``names`` are all that it declares, in capitals; ``positions`` those between braces: line,
    variable, type, braces.
    """

    def __init__(self, data: bytes) -> None:
        self.text = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")  # any byte is a character
        self.whole = set_mark(data) is not None
        self.statements = krl.LANGUAGE.statements(self.text)
        self.begins = [statement for statement in self.statements if statement.kind in BEGINS]
        self.is_data = bool(self.begins) and self.begins[0].kind == "begin_data"
        self.name = krl.name_of_module(self.begins[0]) if self.begins else ""
        self.names: set[str] = set()
        self.positions: list[tuple[int, str, str, Braces]] = []
        for statement in self.statements:
            self._take(statement)

    def of_kind(self, *kinds: str) -> Iterator[Statement]:
        return (statement for statement in self.statements if statement.kind in kinds)

    def _take(self, statement: Statement) -> None:
        kind = statement.kind
        if kind == "declaration":
            of_type = krl.type_of(statement)
            for name, _, value in krl.items_of(statement):
                self.names.add(name.upper())
                if of_type in krl.TYPES_OF_POSITIONS and value and value.braces:
                    self.positions.append((statement.row, name.upper(), of_type, value.braces))
        elif kind in ("motion", "assignment"):
            if "{" not in statement.text:
                return
            first, *values = krl.values_of(statement)
            variable = "" if kind == "motion" else first.key
            for braces in filter(None, (value.braces for value in values)):
                of_type, names = braces.kind, {*braces.names}
                known = of_type in krl.TYPES_OF_POSITIONS or "A1" in names
                known = known or ("X" in names and bool(names & {"S", "T"}))
                if kind == "motion" or (known and "$" not in variable):
                    self.positions.append((statement.row, variable, of_type, braces))
        elif kind == "external":
            self.names.add(_external(statement))
        elif kind in BEGINS or kind in _DECLARE:
            self.names.update(map(str.upper, statement.words("NAME")))


def _external(statement: Statement) -> str:
    tokens = (c for c in statement.tree.children if isinstance(c, Token))
    return next(str(token).upper() for token in tokens if token.type == "NAME")


def _companion(path: Path, module: _Module) -> tuple[_Module | None, list[Problem]]:
    """The other file of the program, and what is wrong with it."""
    ending = ".src" if module.is_data else ".dat"
    files = (path.with_suffix(ending), path.with_suffix(ending.upper()))
    found = next(filter(Path.is_file, files), None)
    if found is None:
        if not module.is_data and not any(map(_target, module.statements)):
            return None, []  # all its positions stand in the motions
        return None, [measuring(1, "companion", f"{path.stem}{ending} is not beside it")]
    try:
        other = _Module(read_program_bytes(found))
    except FileFormatError as error:
        return None, [measuring(1, "companion", f"{found.name}: {error.message}")]
    mine, its = module.name.upper(), other.name.upper()
    if not mine or not its:
        return None, []
    if mine == its and module.is_data != other.is_data:
        return other, []
    said = f"{found.name} is the module {its[:40]!a}, not the other file of {mine[:40]!a}"
    return None, [measuring(1, "companion", said)]


def _target(statement: Statement) -> str:
    """The variable that a motion goes to; empty for braces, system variables and the home."""
    key = krl.values_of(statement)[1].key if statement.kind == "motion" else ""
    return "" if key in ("XHOME", "HOME") or key.startswith("$") else key


def _check_length(module: _Module) -> Iterator[Problem]:
    most = MOST_LENGTH_OF_DATA if module.is_data else MOST_LENGTH
    if max(map(len, module.text.split("\n"))) <= most:
        return
    for found in re.finditer(rf"[^\r\n]{{{most + 1},}}", module.text):
        if not _OF_THE_PENDANT.match(found[0][:1000]):
            row = module.text.count("\n", 0, found.start()) + 1
            yield measuring(row, "line-length", f"{len(found[0])} characters, more than {most}")


def _check_module(module: _Module, path: Path) -> Iterator[Problem]:
    """Rules ``module``, but for what stands in none, and ``module-name``."""
    if not module.begins:
        yield Problem(1, "module", "there is no DEFDAT and no DEF")
        return
    first, suffix = module.begins[0], path.suffix.lower()
    if suffix in (".dat", ".src") and module.is_data != (suffix == ".dat"):
        yield Problem(first.row, "module", f"{first.text[:20]!a} in a {suffix}")
    for begin in module.begins:
        name = krl.name_of_module(begin)
        if begin is not first and "begin_data" in (first.kind, begin.kind):
            yield Problem(begin.row, "module", "a .dat holds one DEFDAT, a .src none")
        if len(name) > 24:
            said = f"{name[:40]} has {len(name)} characters, not 24"
            yield measuring(begin.row, "module-name", said)
        if begin.kind != "begin_data" and begin.one("parameters") is None:
            yield Problem(begin.row, "module", f"no brackets behind the name {name}")
    if module.name.upper() != path.stem.upper():
        # a file that was renamed on its way runs under its own name
        yield measuring(first.row, "module-name", f"{module.name} in the file {path.name}")


def _check_loops(statements: Sequence[Statement]) -> Iterator[Problem]:
    """Rule ``loop``: an endless loop moves, waits, or is left."""
    opened: list[tuple[Statement, bool]] = []
    for s in statements:
        if s.kind in ("loop", "while_", "repeat"):
            opened.append((s, s.kind == "loop" or text_of(s.tree).upper() == "TRUE"))
        elif s.kind in ("endloop", "endwhile", "until") and opened:
            begin, endless = opened.pop()
            if endless or (s.kind == "until" and text_of(s.tree).upper() == "FALSE"):
                yield Problem(begin.row, "loop", "an endless loop without a motion or a wait")
        elif s.kind in _DOES or s.fault or (s.kind == "simple" and s.text[:4].upper() != "SKIP"):
            opened = [(begin, False) for begin, _ in opened]
            if s.kind not in ("fault", "simple"):
                opened = []


def _check_places(module: _Module) -> Iterator[Problem]:
    """Statements where they can stand, and names once: ``module``, ``data``, ``unique``, ..."""
    inside = begun = stray = False
    seen: set[str] = set()
    types = _TYPES if module.whole else _TYPES_OF_THE_LANGUAGE
    for statement in module.statements:
        kind, row, reason = statement.kind, statement.row, ""
        if kind in BEGINS:
            reason = "before the end of the one before it" * inside
            inside, begun, seen = True, False, set()
        elif kind in BEGINS.values():
            inside = False
        elif not inside and not stray:
            stray = True
            yield Problem(row, "module", "the line is in no routine and no data list")
        elif statement.fault:
            continue
        elif module.is_data and kind not in (*_DECLARE, "assignment"):
            yield Problem(row, "data", f"{_begin(statement)} in a data list")
        elif kind in _DECLARE and begun and not module.is_data:
            yield Problem(row, "declarations-first", "a declaration behind an instruction")
        if reason:
            yield Problem(row, "module", f"{_begin(statement)} {reason}")
        begun = begun or kind not in (*_DECLARE, *BEGINS)
        for name in _defined(statement, module.is_data):
            if name in types:
                yield Problem(row, "word", f"{name} is a type, no name")
            if name in seen:
                yield Problem(row, "unique", f"{name.split()[-1]} is defined twice")
            seen.add(name)


def _begin(statement: Statement) -> str:
    return f"{statement.text[:30].strip()!a}"


def _defined(statement: Statement, is_data: bool) -> list[str]:
    """What a statement declares; values and other modules' routines behind a word of their own."""
    if statement.kind == "declaration":
        return [item.name.upper() for item in krl.items_of(statement)]
    if statement.kind == "external":
        return ["EXT " + statement.word("NAME").upper()]
    valued = statement.kind == "assignment" and is_data
    return ["= " + krl.values_of(statement)[0].key] if valued else []


def _check_words(module: _Module, other: _Module | None) -> Iterator[Problem]:
    """Rules ``word`` and ``routine``."""
    told = module.names | (other.names if other else set())
    level: Level = "error" if module.whole else "note"
    harmless: set[Hashable] = set()  # forms without any word to tell of
    for statement in module.statements:
        form = statement.form
        if form in harmless:
            continue
        found, row = [*_suspects(statement)], statement.row
        if not found:
            harmless.add(form)
        for word, near in found:
            if word in _TRIVIAL:
                yield Problem(row, "number", "NaN and infinity are no numbers of KRL")
            elif word not in told:
                told.add(word)
                if near:
                    said = f"{word} is no word that is known here: {near}?"
                    yield Problem(row, "word", said, level)
                else:
                    yield Problem(row, "routine", f"{word} stands in another file", "note")


def _suspects(statement: Statement) -> Iterator[tuple[str, str]]:
    """Words that are no names of KRL, and what they could be meant to be; empty for a routine."""
    trivial = _TRIVIAL & {*map(str.upper, statement.words("NAME"))}
    yield from ((word, "") for word in [*trivial][:1])
    for word, known in _spelt(statement):
        if word and word not in known:
            near = rules.near(word, known)
            if near or known is _CALLED:
                yield word, near


def _spelt(statement: Statement) -> Iterator[tuple[str, frozenset[str]]]:
    """Names of a statement in capitals, each with the words that it could be meant to be."""
    kind = statement.kind
    if kind == "declaration":
        plain = statement.words("DECL", "GLOBAL", "CONST")
        yield krl.type_of(statement), _TYPES if plain else _TYPES_OR_WORDS
    elif kind == "external":
        yield from ((text_of(t.children[0]).upper(), _TYPES) for t in statement.all("type"))
    elif kind == "assignment":
        variable, value = krl.values_of(statement)
        yield _base_of(variable), _STATES
        yield _base_of(value), _TRUTHS
    elif kind == "call":
        called, *given = krl.values_of(statement)
        yield called.key, _CALLED
        yield from ((_base_of(argument), _TRUTHS) for argument in given)
    yield from ((name.upper(), _SYSTEM) for name in statement.words("NAME") if name[0] == "$")


def _base_of(value: Value) -> str:
    """The variable in capitals, without indices and components."""
    return re.split(r"[\[.]", value.key)[0]


def _check_call(statement: Statement, is_data: bool) -> Iterator[Problem]:
    row, values = statement.row, krl.values_of(statement)
    name, given = values[0].key, values[1:]
    texts = [one.text.upper() for one in given]
    if name == "BAS":
        command, value = krl.bas_of(values)
        whole = len(given) in (1, 2) and "" not in texts
        if not whole or command not in _COMMANDS or texts[0][0] != "#":
            yield Problem(row, "call", "BAS takes #INITMOV, #VEL_PTP or the like, and a number")
        elif len(given) == 2 and given[1].is_constant:
            yield Problem(row, "call", f"BAS(#{command}): {value[:20]} is no number")
    elif given and texts[0].lstrip("# ") in _COMMANDS and rules.near(name, ("BAS",)):
        yield Problem(row, "word", f"{name} is no word that is known here: BAS?")
    elif name == "PULSE":
        plain = len(given) == 3 and "" not in texts and not given[2].is_constant
        if not plain or given[0].key.endswith("[]"):
            yield Problem(row, "call", "PULSE takes an output, its state, and a time")


def _check_external(statement: Statement, is_data: bool) -> Iterator[Problem]:
    if _external(statement) != "BAS" and "BAS_COMMAND" in statement.text.upper():
        yield Problem(statement.row, "word", "what takes a BAS_COMMAND is BAS")


def _check_assignment(statement: Statement, is_data: bool) -> Iterator[Problem]:
    node, value = krl.values_of(statement)
    variable = node.key
    given = value.is_constant or value.kind == "function" or value.key.endswith(_WHOLE)
    states = {name.partition("[")[0] for name in (variable, value.key)} & _STATES
    if len(states) == 2:
        yield Problem(statement.row, "form", f"{value.key} is none of {variable}")
    yield from _check_value(statement.row, variable, value)
    if variable.endswith(_WHOLE) and not given:
        yield Problem(statement.row, "constant", "a whole array is given one value")


def _check_value(row: int, variable: str, value: Value) -> Iterator[Problem]:
    """What a system variable, or a command of BAS, is given."""
    name, _, index = variable.partition("[")
    signature = SETTINGS.get(name)
    if signature is None:
        return
    texts = [index[:-1]] * (signature.parameters[0].name == "index") + [value.text]
    kind = "text" if value.is_constant else ""
    numbers = [krl.as_number(text) for text in texts]
    given = [
        Argument(text, kind="number" if math.isfinite(n) else kind, number=n)
        for text, n in zip(texts, numbers, strict=True)
    ]
    for rule, said in signature.faults(given):
        yield Problem(row, "speed" if rule == "range" else "constant", said)


def _check_declaration(statement: Statement, is_data: bool) -> Iterator[Problem]:
    row, of_type = statement.row, krl.type_of(statement)
    if of_type.startswith("DECL"):
        yield Problem(row, "word", "no blank behind DECL")
    for name, size, value in krl.items_of(statement):
        if is_data and of_type != "CHAR" and size.endswith(_WHOLE):
            yield Problem(row, "constant", "the size of the array is missing")
        braces = value.braces if value and of_type in _FORMS else None
        for field, text in zip(braces.names, braces.texts, strict=True) if braces else ():
            if fault := _form_fault(of_type, field, text):
                yield Problem(row, "form", f"{name}: {field} {fault}")


_CHECKS = {
    "call": _check_call,
    "external": _check_external,
    "assignment": _check_assignment,
    "declaration": _check_declaration,
}


def _check_statements(module: _Module) -> Iterator[Problem]:
    """Rules of single statements; an equal one with nothing wrong is judged once."""
    clean: set[str] = set()
    for s in module.statements:
        if s.kind in _CHECKS and s.text not in clean:
            found = [*_CHECKS[s.kind](s, module.is_data)]
            if not found:
                clean.add(s.text)
            yield from found


@lru_cache(maxsize=1024)
def _form_fault(of_type: str, name: str, text: str) -> str:
    known = _FORMS[of_type]
    if name not in known:
        return f"is no name of {of_type}" if of_type == "FDAT" or rules.near(name, known) else ""
    pattern, said = _FORM_VALUES.get(name, _A_NUMBER)
    if not re.fullmatch(pattern, text, re.IGNORECASE | re.ASCII | re.DOTALL):
        return f"is {text[:20]}, not {said}"
    least, most = _DATA_SETTINGS.get(of_type, {}).get(name, (-math.inf, math.inf))
    outside = not least <= krl.as_number(text) <= most if math.isfinite(most) else False
    return f"is {text[:20]}, not {least:g} to {most:g}" if outside else ""


def _check_positions(module: _Module) -> Iterator[Problem]:
    for row, variable, of_type, (names, texts, _) in module.positions:
        label = variable or "the position"
        for said, level in _names_faults(of_type, tuple(names)):
            yield Problem(row, "position-format", said.format(label), level)
        for name, text in zip(names, texts, strict=True):
            fault, level = _number_fault(name, text, module.is_data)
            if "beyond" in fault and module.is_data and not _NUMBERED.fullmatch(variable):
                level = "note"  # files of the controller itself have such values for no position
            if fault:
                yield Problem(row, "number", f"{label}: {name} {text[:30]!a} {fault}", level)


@lru_cache(maxsize=256)
def _names_faults(of_type: str, names: tuple[str, ...]) -> list[tuple[str, Level]]:
    """What is wrong with the names in a position, of which the label is left open."""
    found, joints, faults = {*names}, not {*AXES}.isdisjoint(names), list[tuple[str, Level]]()
    needed, known = ({*AXES}, ()) if joints else ({*POSE}, CONFIGURATION)
    listed = f"{{}} has {' '.join(names)[:60]}"
    if len(found) < len(names):
        twice = min(name for name in names if names.count(name) > 1)
        faults.append((f"{{}} has {twice} twice", "error"))
    if not found <= {*needed, *EXTERNAL, *known}:
        faults.append((f"{listed}, not A1 to A6 or X Y Z A B C S T", "error"))
    elif of_type and joints != of_type.endswith("AXIS") and found - {*EXTERNAL}:
        faults.append((f"{{}}: {of_type} of {names[0]}", "error"))
    elif not needed <= found or len({*CONFIGURATION} & found) == 1:
        faults.append((f"{listed}: the others stay as they are", "measuring"))
    return faults


def _number_fault(name: str, text: str, is_data: bool) -> tuple[str, Level]:
    if name in _LARGEST:
        bits = re.fullmatch(
            r"(\d{1,9})|'B ?([01]{1,9})'|'H ?([\dA-F]{1,9})'", text, re.IGNORECASE | re.ASCII
        )
        if bits is None:
            return "is no whole number" if is_data else "", "error"
        value = int(bits[bits.lastindex or 1], (10, 2, 16)[(bits.lastindex or 1) - 1])
        most = _LARGEST[name]
        return f"is not from 0 to {most}" if value > most else "", "measuring"
    number = krl.as_number(text)
    if math.isnan(number):
        plain = not is_data and not re.match(r"[-+.\d\"#']|TRUE\b|FALSE\b", text, re.IGNORECASE)
        return "" if plain else "is not a plain number", "error"
    if name in ("A", "B", "C") and abs(number) > 180.0:
        return "is beyond +-180 deg", "measuring"
    beyond = name in AXES and abs(number) > MOST_JOINT_DEG
    return f"is beyond +-{MOST_JOINT_DEG:g} deg" if beyond else "", "error"


def _check_names(module: _Module, dat: _Module, src: _Module) -> Iterator[Problem]:
    """Rules of what one file declares and the other uses."""
    if module is dat:
        used = {name.upper() for s in src.statements for name in s.words("NAME")}
        for row, variable, _, _ in dat.positions:
            if re.fullmatch(r"X?P\d+", variable) and variable not in used:
                yield measuring(row, "position-used", f"{variable} is never used")
    known = {*src.names, *dat.names, *_GLOBALS}
    shared = {name: n for s in dat.of_kind("declaration") for name, n in _sizes(s)}
    sizes = dict(shared)
    for statement in module.of_kind("motion", "assignment", "call", "declaration", *BEGINS):
        if statement.kind in BEGINS:
            sizes = dict(shared)  # what a routine declares is its own
        elif statement.kind == "declaration":
            sizes |= _sizes(statement)
            continue
        for node in statement.all("variable") if sizes and "[" in statement.text else ():
            found = re.fullmatch(r"(\w+)\[(\d{1,7})\].*", text_of(node).upper())
            most = sizes.get(found[1]) if found else None
            if found and most is not None and not 1 <= int(found[2]) <= most:
                yield Problem(statement.row, "array-bounds", f"{found[1]}[{found[2]}] of {most}")
        for name in statement.words("NAME")[statement.kind == "call" :] if module is src else ():
            if name[0] != "$" and name.upper() not in known:
                # it may be global, of a file that is not here
                known.add(name.upper())
                yield measuring(statement.row, "position-defined", f"{name[:40]} is not defined")


def _sizes(declaration: Statement) -> Iterator[tuple[str, int | None]]:
    """Arrays of one dimension that are declared, and their sizes; None where that is no number."""
    for item in krl.items_of(declaration):
        size = re.fullmatch(r"\[([0-9]{1,7})\]", item.size) if item.size else None
        yield item.name.upper(), int(size[1]) if size else None


def _check_motions(src: _Module, dat: _Module | None) -> Iterator[Problem]:
    """Rules that follow the program: first motion, frames, speeds, standstill, what LIN goes to."""
    names = {
        variable: {*braces.names}
        for module in (src, dat)
        for _, variable, _, braces in (module.positions if module else ())
        if variable
    }
    ready: set[str] = set()
    moved = approximated = False
    stands = True
    for statement in src.statements:
        kind, row, acts = statement.kind, statement.row, False
        if kind in BEGINS:
            stands, approximated = True, False  # whoever calls the routine sees to that
        elif kind == "motion":
            first, target, *_ = krl.values_of(statement)
            word = first.text.upper()
            for name, value in krl.settings_of(statement):
                ready.add(name[1:])
                yield from _check_value(row, name, value)
            fields = {*names.get(_target(statement), ())}
            fields |= {*target.braces.names} if target.braces else set()
            if not moved:
                yield from _check_first(row, word, fields, ready)
            if "A1" in fields and word not in ("PTP", "SPTP", "PTP_REL", "SPTP_REL"):
                yield Problem(row, "motion", f"{word} goes to a pose, not to joint values")
            moved, stands = True, False
            approximated = bool(statement.word("APPROXIMATION"))
        elif kind in ("wait_sec", "wait_for", "halt"):
            stands = True
        elif kind in ("call", "assignment"):
            values = krl.values_of(statement)
            name, text, acts = _setting(kind, values)
            ready |= {"TOOL", "BASE"} if name in ("FRAMES", "FDAT_ACT") else {name}
            yield from _check_setting(row, kind, values, name, text)
        if acts and approximated:
            yield measuring(row, "standstill", "the motion before it is approximated")
        elif acts and not stands:
            said = "no WAIT between the motion and this: the arm may still move"
            yield measuring(row, "standstill", said)


def _setting(kind: str, values: Sequence[Value]) -> tuple[str, str, bool]:
    """What BAS or an assignment sets, the number that it is given, and whether it measures."""
    if kind == "call":
        command, text = krl.bas_of(values)
        return command, text, not command
    name = values[1].key
    numbered = name.startswith(("TOOL_DATA[", "BASE_DATA["))
    return values[0].key.removeprefix("$"), name[10:-1] if numbered else "", name in _KEPT


def _check_first(row: int, word: str, fields: set[str], ready: set[str]) -> Iterator[Problem]:
    if word not in ("PTP", "SPTP"):
        yield measuring(row, "first-move", f"{word} is the first motion, not PTP")
    elif fields and not ({*CONFIGURATION, *POSE} <= fields or "A1" in fields):
        yield measuring(row, "first-move", "the first position has no S and T")
    if "INITMOV" not in ready:
        yield measuring(row, "initialised", "no BAS(#INITMOV,0) before the first motion")
    for name in _FRAMES.keys() - ready:
        yield measuring(row, "frame", f"${name} is not set before the first motion")


def _check_setting(
    row: int, kind: str, values: Sequence[Value], name: str, text: str
) -> Iterator[Problem]:
    called = kind == "call"
    if called and text:
        yield from _check_value(row, f"BAS(#{name})", values[2])
    if name not in _FRAMES:
        return
    value, given = krl.as_number(text), values[-1]
    is_whole = value >= 0 and value % 1 == 0 if called else text.isdigit()
    if not is_whole and (not math.isnan(value) or (called and not text)):
        yield Problem(row, "frame-value", f"{name} {text}: frames are numbered from 0")
    elif value > _FRAMES[name]:
        said = f"{name} {text}: controllers have 0 to {_FRAMES[name]} as delivered"
        yield measuring(row, "frame-value", said)
    if not called and given.braces:
        if any(map(_is_no_number, given.braces.texts)):
            yield Problem(row, "frame-value", f"${name} has a value that is no number")
        if {*given.braces.names} != {*POSE}:
            said = f"${name} has not X Y Z A B C: the others stay as they are"
            yield measuring(row, "frame-value", said)


def _is_no_number(text: str) -> bool:
    """Whether it is a truth, a text or a word with #."""
    return text[:1] in ('"', "#") or text.upper() in _TRUTHS
