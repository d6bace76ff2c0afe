"""FANUC ``.LS``: what a controller refuses, and what would not measure as planned.

Sources: programs loaded and run on ROBOGUIDE's virtual controllers (LeroyDu56/CrossArm,
docs/fanuc_ls_format.md), public post-processors and controller exports.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``text``               no control characters (note: letters beyond ASCII depend on the controller's
                       code page)
``sections``           /PROG, /ATTR, /APPL (optional), /MN, /POS, /END, in this order
``program-name``       a capital letter, then A-Z 0-9 _, 36 in all (R-J3iB: 8, which we write)
``attribute``          the attributes of controllers, in English or German
``line-format``        number, colon, instruction, semicolon
``line-number``        line numbers consecutive from 1, where there are any
``instruction``        the syntax of instructions; note: an application's own, which are not known
``negative-argument``  negative constants in parentheses: ``CALL X(-1)`` is refused, and
                       ``R[1]<-1`` stops the program
``block``              IF ... THEN and FOR are closed by ENDIF and ENDFOR
``label``              a label that is jumped to is there, once
``speed``              from 1% to 100%
``position-format``    each position complete: frames, six joints or X Y Z W P R, commas, ``};``
``configuration``      CONFIG with a pose; none with joints
``unit``               joints, W P R in deg, X Y Z in mm
``range``              joints within +-720 deg, W P R within +-180 deg, within 100 m
``position-defined``   each position that is used is defined
``position-unique``    each position is defined once
``frame``              a position's UF and UT are the frames active where it is moved to: another
                       one stops the program (INTP-251, INTP-253)
=====================  ==========================================================================

What a measuring program needs besides:

=====================  ==========================================================================
``crlf``               each line ended by CR LF, as controllers write them
``line-count``         LINE_COUNT is the number of lines: none is lost
``position-used``      each position that is defined is used
``position-value``     each position has values, not ``****``
``elsewhere``          no motion to another place than that of its position (INC, Offset)
``frames-set``         UFRAME_NUM and UTOOL_NUM set by number before the motion
``fine-before-call``   the arm stands (FINE) where a program is called
=====================  ==========================================================================
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from operator import attrgetter

from lark import Token

from posedesign.programs import rules
from posedesign.programs.fanuc_ls.listing import (
    CHOSEN,
    Group,
    Instruction,
    Listing,
    Position,
    known_words,
    places_of,
    read_listing,
)
from posedesign.programs.fanuc_ls.reader import EXTENDED, JOINTS, PLACE, RELATIVE, TURN
from posedesign.programs.language import Block, Statement, block_faults, nodes
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM
from posedesign.programs.recorded import Level, Problem

_ORDER = ["PROG", "ATTR", "MN", "POS", "END"]
_NEEDED = ["PROG", "MN", "END"]
_STATEMENT = attrgetter("statement")
_NAME = re.compile(r"[A-Z_-][A-Z0-9_-]{0,35}(?-i:[ \t]+[A-Z][a-z]{2,9})?", re.IGNORECASE)
_POSE = {*PLACE, *TURN}
_KINDS = ({*JOINTS}, _POSE, RELATIVE)
_OTHER_ARMS = [{f"J{j}" for j in range(1, n + 1)} for n in (1, 2, 3, 4, 5, 7, 8, 9)]
_CONFIG = re.compile(r"[FN] (?:[LR] )?[UD] [TB](?:, ?-?\d){3}")
_OTHER_CONFIG = re.compile(r"(?:[FN] ?)?(?:[LR] ?)?(?:[UD] ?)?[TB]?(?:, ?-?\d)*|[*, ]*")
_GERMAN = re.compile(
    r"(?<![\w$])(?:AUFRUF|WENN|WARTE|DANN|SONST|SPRUNG|MARKE|ENDE|PULS|AN|AUS|sek|WKZ_NUM"
    r"|BENUTZER_NUM|TRAGLST|ZEIT)(?!\w)"
)
_UNJUDGED = ("motion", "fault", "other")  # by how far they are from the colon
_BLOCKS = {"if_": Block("endif", ("else_",)), "for_": Block("endfor")}
_MACRO = re.compile(
    r"(?!CALL|WAIT(?!( [A-Z]{3,})+$)|AUFRUF|WARTE)[A-Z][\w./-]*( [\w./#&+-]+)+ *(\([^()]*\))?", re.I
)
"""Macros of several words can begin with a word of the language."""
_UNKNOWN = re.compile(r"[A-Za-z][A-Za-z_-]{2,}[0-9]{0,3}")
_ATTRIBUTE_NAMES = """
    OWNER COMMENT PROG_SIZE CREATE MODIFIED FILE_NAME VERSION LINE_COUNT MEMORY_SIZE PROTECT
    STORAGE STACK_SIZE TASK_PRIORITY TIME_SLICE BUSY_LAMP_OFF ABORT_REQUEST PAUSE_REQUEST
    DEFAULT_GROUP CONTROL_CODE LOCAL_REGISTERS SUB_TYPE INVISIBLE IGNORE_PAUSE
"""
_GERMAN_NAMES = """
    EIGN. KOMMENTAR ERSTELL DATEI_NAME ZEILEN SPEICHERGR. SCHUTZ ZEITSCHEIBE BUSY_LAMP_AUS
    ABORT_ANFRAGE HALT_ANFRAGE DEFAULT_GRUP KONTROLLCODE
"""
_ATTRIBUTES = frozenset(_ATTRIBUTE_NAMES.split())
_ALL_ATTRIBUTES = _ATTRIBUTES.union(_GERMAN_NAMES.split())
_LONE_CR: rules.Asked = ("text", *rules.LONE_CR[1:])


def check_fanuc_ls(data: bytes) -> list[Problem]:
    """Problems in the content of a file, in the order of its lines."""
    listing = read_listing(data.decode("latin-1"))  # any byte is a character: none is lost
    lines = listing.instructions
    return rules.told(
        rules.check_line_ends(data),
        rules.check_bytes(data, rules.CONTROL, _LONE_CR, rules.FOREIGN),
        _check_headings(listing),
        _check_lines(listing),
        rules.each(lines, _line_faults),
        rules.judged(lines, partial(_check_code, english=listing.english), _STATEMENT),
        block_faults([line.statement for line in lines], _BLOCKS),
        _check_labels(listing),
        _check_positions(listing),
        _check_use(listing),
        _check_motions(listing),
    )


def _check_headings(listing: Listing) -> Iterator[Problem]:
    order = [section for _, section, _ in listing.headings]
    plain = [section for section in order if section != "APPL"]
    if plain != _ORDER:
        row = listing.headings[-1][0] if listing.headings else 1
        found = " ".join("/" + section for section in order) or "none"
        # controllers write them all, and load what has no attributes or no positions
        short = plain == [s for s in _ORDER if s in {*plain, *_NEEDED}]
        level: Level = "measuring" if short else "error"
        yield Problem(row, "sections", f"the sections are {found[:200]}", level)
    elif any(
        order[i] == "APPL" and order[i - 1] not in ("ATTR", "APPL") for i in range(len(order))
    ):
        yield Problem(listing.headings[-1][0], "sections", "/APPL stands between /ATTR and /MN")
    for row, _ in listing.stray:
        yield Problem(row, "sections", "the line is in no section")
    for row, section, text in listing.headings:
        if section == "PROG" and (not _NAME.fullmatch(text) or text.split()[0].upper() not in text):
            reason = "behind /PROG: a letter, then A-Z 0-9 _, 36 characters in all"
            level = "measuring" if _NAME.fullmatch(text) else "error"
            yield Problem(row, "program-name", reason, level)
        elif section != "PROG" and text:
            yield Problem(row, "sections", f"{text[:30]!a} stands behind /{section}")
    for row, fault in listing.unclear:
        yield Problem(row, "attribute", fault)
    known = _ATTRIBUTES if listing.english else _ALL_ATTRIBUTES
    for row, name, text in listing.attributes:
        if not text.rstrip().endswith((";", ",")):
            yield Problem(row, "attribute", f"{text[:40]} does not end in ';'", "measuring")
        near = rules.near(name, known, alike=0.75)
        if name not in known and near and name.isascii():
            yield Problem(row, "attribute", f"{name} is no attribute: {near} is")


def _check_lines(listing: Listing) -> Iterator[Problem]:
    outer = [line for line in listing.instructions if not line.inner]
    expected = 1
    for line in outer:
        if line.number not in (None, expected):
            reason = f"line number {line.number} where {expected} is due"
            yield Problem(line.row, "line-number", reason, "measuring")
        expected = (line.number or expected) + 1
    named = ("LINE_COUNT", "ZEILEN")
    counts = [(row, text.strip()) for row, key, text in listing.attributes if key in named]
    for row, text in counts or [(1, "there is no LINE_COUNT")]:
        if "".join(filter(str.isdigit, text)) != str(len(outer)):
            reason = f"{text[:40]}, /MN has {len(outer)} lines"
            yield Problem(row, "line-count", reason, "measuring")


def _line_faults(line: Instruction) -> Iterator[rules.Fault]:
    rule, code = "line-format", line.code
    if line.inner:
        return
    if line.number is None and line.head.strip():
        yield rule, "a line starts with its number, right-aligned in four, and a colon", "error"
    elif line.number is not None and line.head != f"{line.number:4d}":
        yield rule, "the number is right-aligned in four characters", "measuring"
    elif not line.closed:
        yield rule, "a line ends in ' ;'", "error"
    if line.kind == "motion" and code.startswith(" "):
        yield rule, "the letter of a motion stands right behind the colon", "measuring"
    elif line.kind not in _UNJUDGED and code.strip() and not code.startswith("  "):
        yield rule, "two spaces stand between the colon and an instruction", "measuring"


def _check_code(line: Instruction, *, english: bool) -> Iterator[Problem]:
    for fault in (*_code_faults(line), *(_german_faults(line) if english else ())):
        yield Problem(line.row, *fault)


def _code_faults(line: Instruction) -> Iterator[rules.Fault]:
    s, fault = line.statement, line.statement.fault
    if fault and re.search(r"(?:[=<>,(]|TO) ?-\s*[\d.]", line.code):
        reason = f"a negative constant stands in parentheses, (-1): {fault}"
        yield "negative-argument", reason, "error"
    elif fault:
        # what is not filled in yet, controllers write as dots
        open_ = _MACRO.fullmatch(line.code.strip()) or "..." in line.code
        yield "instruction", fault, "measuring" if open_ else "error"
    elif line.kind == "other":
        yield _unknown(line, *re.split(r"(?<=\w)(?![\w-])", line.code.strip(), maxsplit=1))
    for tree in s.all("other_option", "foreign"):
        details = "".join(map(str, tree.children[1:])) if tree.data == "other_option" else "["
        yield _unknown(line, str(tree.children[0]), details)
    for tree in s.all("speed"):
        joint, unit = line.code.lstrip().startswith("J"), s.word("UNIT")
        number = next((w[:20] for w in tree.children[:1] if isinstance(w, Token)), "1")
        if unit == "%" and not 0 < float(number) <= 100:
            yield "speed", f"a speed of {number}%: from 1% to 100%", "error"
        if unit and joint != (unit == "%") and unit not in ("sec", "msec", "sek"):
            yield "speed", f"{unit} is no speed of this kind of motion", "error"
    if s.one("elsewhere") is not None:
        reason = f"moves to another place than its position: {line.code.strip()[-40:]}"
        yield "elsewhere", reason, "measuring"


def _german_faults(line: Instruction) -> Iterator[rules.Fault]:
    """Of an instruction of an English program."""
    mixed = _GERMAN.search(re.sub(r"\[[^\[\]]*\]|'[^']*'|(?:CALL|RUN) \S+|EIN/AUS=", "", line.code))
    if mixed and line.kind not in ("remark", "message", "other"):
        reason = f"{mixed[0]} is a word of German controllers, the program an English one"
        yield "instruction", reason, "error"


def _unknown(line: Instruction, word: str, rest: str = "") -> rules.Fault:
    """A macro, an instruction or option of an application, or a misspelt one of the language."""
    known = known_words()
    begun = (w for w in known.values() if word.upper().startswith(w.upper()) and len(w) > 3)
    near = next(begun, "") or rules.near(word, known.values(), least=2, alike=0.7)
    near = near or ("CALL" if f"{word}(" in line.code else "")
    opened = re.sub(r"'[^']*'|\[[^\[\]]*\]", "", rest)
    if opened.count("(") != opened.count(")") or (re.search(r"[\[\]]", opened) and "[" not in rest):
        return "instruction", f"a bracket is not closed: {rest[:40]!a}", "error"
    if near or not _UNKNOWN.fullmatch(word):
        hint = f": {near} is" if near else ""
        # a macro has any name, and an application's own words may look like those of the language
        wrong = near and re.match(r" ?[=,]", rest) if rest else word.upper() in known
        level: Level = "error" if wrong else "measuring"
        return "instruction", f"{word[:40]!a} is no instruction{hint}", level
    return "instruction", f"{word[:40]!a} is not known: an application's own is not checked", "note"


def _check_labels(listing: Listing) -> Iterator[Problem]:
    labels: dict[bool, list[tuple[int, str]]] = {True: [], False: []}
    for line in listing.instructions:
        for label in line.statement.all("label"):
            number = next(nodes(label, "index")).children[0]
            if isinstance(number, Token) and number.type == "INT":  # else a register chooses it
                labels[line.kind == "label_"].append((line.row, f"LBL[{number[:9]}]"))
    found = rules.check_names(labels[True], labels[False], ("label", "label", ""))
    return (replace(problem, level="measuring") for problem in found)


def _check_positions(listing: Listing) -> Iterator[Problem]:
    for row, fault in listing.faults:
        yield Problem(row, "position-format", fault)
    yield from rules.judged(listing.positions, _check_position, _STATEMENT)


def _check_position(position: Position) -> Iterator[Problem]:
    group = position.groups.get(1)
    if group is None:
        reason = f"{position.label} has no GP1: the arm stays where it is"
        return iter([Problem(position.row, "position-format", reason, "measuring")])
    return _check_group(position, group)


def _check_group(position: Position, group: Group) -> Iterator[Problem]:
    """Fields, CONFIG, units and ranges of the first group of a position."""
    row, label, config = position.row, position.label, group.config
    if {*group.frames} != {"UF", "UT"}:
        yield Problem(row, "position-format", f"{label} has no UF and UT in GP1")
    names = group.fields.keys() - {*EXTENDED}
    if names not in _KINDS:
        level: Level = "measuring" if names in _OTHER_ARMS else "error"
        reason = f"{label} has {' '.join(sorted(names)) or 'nothing'}, not J1 to J6 or X Y Z W P R"
        yield Problem(row, "position-format", reason, level)
    cartesian = bool(names & (_POSE | RELATIVE))
    if group.frames and group.fields and cartesian != (config is not None):
        yield Problem(row, "configuration", f"{label} has {'no' if cartesian else 'a'} CONFIG")
    elif config is not None and not _CONFIG.fullmatch(config.strip()):
        reason = f"{label}: there is no CONFIG {config[:30]!a} of a six-axis arm"
        other = _OTHER_CONFIG.fullmatch(config.strip())
        yield Problem(row, "configuration", reason, "measuring" if other else "error")
    for name, (text, unit) in group.fields.items():
        far = name.lstrip("R") in PLACE
        most = MOST_POSITION_MM if far or name in EXTENDED else MOST_JOINT_DEG
        if text.startswith("*"):
            said = f"{label}: {name} has no value"
            yield Problem(group.row_of(name), "position-value", said, "measuring")
        elif unit != ("mm" if far else "deg") and not (name in EXTENDED and unit):
            wanted = "mm" if far else "deg"
            reason = f"{label}: {name} is in {unit or 'no unit'}, not in {wanted}"
            # a gantry's first joints are in millimetres
            untaught = any(value.startswith("*") for value, _ in group.fields.values())
            level = "measuring" if (name in JOINTS and unit) or untaught else "error"
            yield Problem(group.row_of(name), "unit", reason, level)
        elif len(text) > 20 or abs(float(text)) > (180.0 if name in TURN else most):
            yield Problem(group.row_of(name), "range", f"{label}: {name} is {text[:20]}")


def _check_use(listing: Listing) -> Iterator[Problem]:
    there = [(position.row, position.label) for position in listing.positions]
    broken = {CHOSEN, *(f"P[{number}]" for number in listing.broken)} - {name for _, name in there}
    used = [(s.row, label) for s, label in _places(listing)]
    all_known = all(label != CHOSEN for _, label in used)
    asked = ("position-unique", "position-defined", "position-used" if all_known else "")
    return rules.check_names(there, (use for use in used if use[1] not in broken), asked)


def _places(listing: Listing) -> Iterator[tuple[Statement, str]]:
    """Positions that instructions name."""
    for line in listing.instructions:
        yield from ((line.statement, label) for label in places_of(line.statement))


def _check_motions(listing: Listing) -> Iterator[Problem]:
    """Rules that follow the program line by line: active frames, and whether the arm stands.

    Behind a label, a call or the end of a block nobody knows from the file which frames are
    active: a frame that differs from the one set last is an error only where none is between.
    """
    stored = {position.label: position for position in listing.positions}
    active: dict[str, int | None] = {}
    sure: set[str] = set()
    stands = False
    for line in listing.instructions:
        kind = line.kind
        if kind == "frame":
            if line.statement.word("OTHER").upper() not in ("", "GP1"):
                continue
            letters = "UF" if line.statement.one("uframe") is not None else "UT"
            number = line.statement.tree.children[-1]
            active[letters] = int(number[:9]) if isinstance(number, Token) else None
            sure |= {letters}
        elif kind in ("label_", "call", "run", "else_", "endif", "endfor", "branch", "select"):
            sure = set()
        elif kind == "motion":
            stands = line.statement.one("fine") is not None
            for label in sorted({*places_of(line.statement)} & stored.keys()):
                yield from _frame_problems(line.row, stored[label], active, sure)
        if kind == "call" and not stands:
            reason = "no motion to a standstill (FINE) before the CALL"
            yield Problem(line.row, "fine-before-call", reason, "measuring")


def _frame_problems(
    row: int, position: Position, active: dict[str, int | None], sure: set[str]
) -> Iterator[Problem]:
    frames = position.groups[1].frames if 1 in position.groups else {}
    for letters, name in (("UF", "UFRAME_NUM"), ("UT", "UTOOL_NUM")):
        frame, now = frames.get(letters), active.get(letters)
        if frame is None:
            continue  # left open: whatever is active
        if now is None:
            reason = f"{name} is not set to a number before the motion"
            yield Problem(row, "frames-set", reason, "measuring")
        elif now != frame:
            reason = f"{position.label} has {letters} {frame}, {name} is {now}"
            yield Problem(row, "frame", reason, "error" if letters in sure else "measuring")
