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

from lark import Token

from posedesign.programs import rules
from posedesign.programs.fanuc_ls.listing import (
    LANGUAGE,
    Instruction,
    Listing,
    Position,
    read_listing,
)
from posedesign.programs.fanuc_ls.reader import EXTENDED, JOINTS, PLACE, RELATIVE, TURN
from posedesign.programs.language import Block, block_faults, nodes, words
from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM
from posedesign.programs.recorded import Level, Problem

_ORDER = ["PROG", "ATTR", "MN", "POS", "END"]
_NAME = re.compile(r"[A-Z_-][A-Z0-9_-]{0,35}(?:\t  (?:Macro|Cond))?[ \t]*")
_POSE = {*PLACE, *TURN}
_KINDS = ({*JOINTS}, _POSE, RELATIVE)
_CONFIG = re.compile(r"[FN] (?:[LR] )?[UD] [TB](?:, ?-?\d){3}")
_GERMAN = re.compile(
    r"(?<![\w$])(?:AUFRUF|WENN|WARTE|DANN|SONST|SPRUNG|MARKE|ENDE|PULS|AN|AUS|sek|WKZ_NUM"
    r"|BENUTZER_NUM|TRAGLST|ZEIT)(?!\w)"
)
_BLOCKS = {"if_": Block("endif", ("else_",)), "for_": Block("endfor")}
_UNKNOWN = re.compile(r"[A-Za-z][A-Za-z_-]{2,}[0-9]{0,3}")
_ATTRIBUTE_NAMES = """
    OWNER COMMENT PROG_SIZE CREATE MODIFIED FILE_NAME VERSION LINE_COUNT MEMORY_SIZE PROTECT
    STORAGE STACK_SIZE TASK_PRIORITY TIME_SLICE BUSY_LAMP_OFF ABORT_REQUEST PAUSE_REQUEST
    DEFAULT_GROUP CONTROL_CODE LOCAL_REGISTERS SUB_TYPE INVISIBLE IGNORE_PAUSE
    EIGN. KOMMENTAR ERSTELL DATEI_NAME ZEILEN SPEICHERGR. SCHUTZ ZEITSCHEIBE BUSY_LAMP_AUS
    ABORT_ANFRAGE HALT_ANFRAGE DEFAULT_GRUP KONTROLLCODE
"""
_ATTRIBUTES = frozenset(_ATTRIBUTE_NAMES.split())
_LONE_CR: rules.Asked = ("text", *rules.LONE_CR[1:])


def check_fanuc_ls(data: bytes) -> list[Problem]:
    """Problems in the content of a file, in the order of its lines."""
    listing = read_listing(data.decode("latin-1"))  # any byte is a character: none is lost
    return rules.told(
        rules.check_line_ends(data),
        rules.check_bytes(data, rules.CONTROL, _LONE_CR, rules.FOREIGN),
        _check_headings(listing),
        _check_lines(listing),
        _check_instructions(listing),
        block_faults([i.statement for i in listing.instructions], _BLOCKS),
        _check_labels(listing),
        _check_positions(listing),
        _check_values(listing),
        _check_use(listing),
        _check_motions(listing),
    )


def _check_headings(listing: Listing) -> Iterator[Problem]:
    order = [section for _, section, _ in listing.headings]
    plain = [section for section in order if section != "APPL"]
    if plain != _ORDER:
        row = listing.headings[-1][0] if listing.headings else 1
        found = " ".join("/" + section for section in order) or "none"
        yield Problem(row, "sections", f"the sections are {found[:200]}")
    elif any(
        order[i] == "APPL" and order[i - 1] not in ("ATTR", "APPL") for i in range(len(order))
    ):
        yield Problem(listing.headings[-1][0], "sections", "/APPL stands between /ATTR and /MN")
    for row, _ in listing.stray:
        yield Problem(row, "sections", "the line is in no section")
    for row, section, text in listing.headings:
        if section == "PROG" and not _NAME.fullmatch(text):
            reason = "behind /PROG: a letter, then A-Z 0-9 _, 36 characters in all"
            yield Problem(row, "program-name", reason)
        elif section != "PROG" and text:
            yield Problem(row, "sections", f"{text[:30]!a} stands behind /{section}")
    for row, fault in listing.unclear:
        yield Problem(row, "attribute", fault)
    for row, name, _ in listing.attributes:
        near = rules.near(name, _ATTRIBUTES, alike=0.75)
        if name not in _ATTRIBUTES and near and name.isascii():
            yield Problem(row, "attribute", f"{name} is no attribute: {near} is")


def _check_lines(listing: Listing) -> Iterator[Problem]:
    expected = 1
    for line in listing.instructions:
        if line.inner:
            continue
        if line.number is None and line.head.strip():
            reason = "a line starts with its number, right-aligned in four characters, and a colon"
            yield Problem(line.row, "line-format", reason)
        elif line.number is not None and line.head != f"{line.number:4d}":
            reason = "the number is right-aligned in four characters"
            yield Problem(line.row, "line-format", reason, "measuring")
        elif not line.closed:
            yield Problem(line.row, "line-format", "a line ends in ' ;'")
        if line.number not in (None, expected):
            reason = f"line number {line.number} where {expected} is due"
            yield Problem(line.row, "line-number", reason)
        expected = (line.number or expected) + 1
    outer = sum(not line.inner for line in listing.instructions)
    named = ("LINE_COUNT", "ZEILEN")
    counts = [(row, text.strip()) for row, key, text in listing.attributes if key in named]
    for row, text in counts or [(1, "there is no LINE_COUNT")]:
        if "".join(filter(str.isdigit, text)) != str(outer):
            reason = f"{text[:40]}, /MN has {outer} lines"
            yield Problem(row, "line-count", reason, "measuring")


def _check_instructions(listing: Listing) -> Iterator[Problem]:
    english = any(name == "LINE_COUNT" for _, name, _ in listing.attributes)
    for line in listing.instructions:
        fault = line.statement.fault
        mixed = _GERMAN.search(re.sub(r"\[[^\[\]]*\]|'[^']*'", "", line.code))
        if mixed and english and line.kind not in ("remark", "message"):
            reason = f"{mixed[0]} is a word of German controllers, the program an English one"
            yield Problem(line.row, "instruction", reason)
        if fault and re.search(r"(?:[=<>,(]|TO) ?-\s*[\d.]", line.code):
            reason = f"a negative constant stands in parentheses, (-1): {fault}"
            yield Problem(line.row, "negative-argument", reason)
        elif fault:
            yield Problem(line.row, "instruction", fault)
        elif line.kind == "other":
            yield from _unknown(line, line.statement.word("OTHER"), line.statement.word("REST"))
        elif line.kind == "motion":
            yield from _check_motion(line)
        elif not line.inner and line.code.strip() and not line.code.startswith("  "):
            reason = "two spaces stand between the colon and an instruction"
            yield Problem(line.row, "line-format", reason, "measuring")


def _check_motion(line: Instruction) -> Iterator[Problem]:
    if line.code.startswith(" "):
        reason = "the letter of a motion stands right behind the colon"
        yield Problem(line.row, "line-format", reason, "measuring")
    for option in line.statement.all("other_option"):
        yield from _unknown(line, str(option.children[0]), "")
    joint, unit = line.code.lstrip().startswith("J"), line.statement.word("UNIT")
    speed = next((words(tree, "INT", "DECIMAL") for tree in line.statement.all("speed")), [])
    if unit == "%" and speed and not 0 < float(speed[0][:20]) <= 100:
        yield Problem(line.row, "speed", f"a speed of {speed[0][:20]}%: from 1% to 100%")
    if unit and joint != (unit == "%") and unit not in ("sec", "msec", "sek"):
        yield Problem(line.row, "speed", f"{unit} is no speed of this kind of motion")


def _unknown(line: Instruction, word: str, rest: str) -> Iterator[Problem]:
    """An instruction or option of an application, or a misspelt one of the language."""
    known = _known_words()
    begun = (w for w in known if word.upper().startswith(w.upper()) and len(w) > 3)
    near = next(begun, "") or rules.near(word, known, least=2, alike=0.7)
    near = near or ("CALL" if f"{word}(" in line.code else "")
    opened = re.sub(r"'[^']*'|\[[^\[\]]*\]", "", rest)
    if near or not _UNKNOWN.fullmatch(word) or opened.count("(") != opened.count(")"):
        hint = f": {near} is" if near else ""
        yield Problem(line.row, "instruction", f"{word[:40]!a} is no instruction{hint}")
    elif re.search(r"[\[\]]", opened) and "[" not in rest:
        yield Problem(line.row, "instruction", f"a bracket is not closed: {rest[:40]!a}")
    else:
        reason = f"{word[:40]!a} is not known: an application's own is not checked"
        yield Problem(line.row, "instruction", reason, "note")


def _known_words() -> list[str]:
    """Keywords of the grammar, and the letters of registers and signals."""
    items = re.findall(r"[A-Za-z_]+", _pattern("ITEM"))
    words = [str(t.pattern.value) for t in LANGUAGE.parser.terminals if t.pattern.type == "str"]
    return sorted({w for w in [*items, *words] if re.fullmatch(r"[A-Za-z_]{2,}", w)})


def _pattern(name: str) -> str:
    return next(str(t.pattern.value) for t in LANGUAGE.parser.terminals if t.name == name)


def _check_labels(listing: Listing) -> Iterator[Problem]:
    defined: dict[str, int] = {}
    jumps: list[tuple[int, str]] = []
    for line in listing.instructions:
        for label in line.statement.all("label"):
            number = next(nodes(label, "index")).children[0]
            if not isinstance(number, Token) or number.type != "INT":
                continue  # a register chooses the label
            if line.kind != "label_":
                jumps.append((line.row, number[:9]))
            elif number[:9] in defined:
                yield Problem(line.row, "label", f"LBL[{number[:9]}] is there twice")
            else:
                defined[number[:9]] = line.row
    for row, target in jumps:
        if target not in defined:
            yield Problem(row, "label", f"LBL[{target}] is not there")


def _check_positions(listing: Listing) -> Iterator[Problem]:
    for row, fault in listing.faults:
        yield Problem(row, "position-format", fault)
    seen: set[int] = set()
    for position in listing.positions:
        label = position.label
        if position.number in seen:
            yield Problem(position.row, "position-unique", f"{label} is defined twice")
        seen.add(position.number)
        first = position.groups.get(1)
        if first is None:
            reason = f"{label} has no GP1: the arm stays where it is"
            yield Problem(position.row, "position-format", reason, "measuring")
            continue
        if {*first.frames} != {"UF", "UT"}:
            reason = f"{label} has no UF and UT in GP1"
            yield Problem(position.row, "position-format", reason)
        names = {*first.fields} - {*EXTENDED}
        if names not in _KINDS:
            found = " ".join(sorted(names)) or "nothing"
            other_arm = names == {f"J{j + 1}" for j in range(len(names))} and len(names) != 6
            reason = f"{label} has {found}, not J1 to J6 or X Y Z W P R"
            whole = other_arm and len(names) in (3, 4, 5, 7, 8, 9)
            yield Problem(
                position.row, "position-format", reason, "measuring" if whole else "error"
            )


def _check_values(listing: Listing) -> Iterator[Problem]:
    """Units, ranges and CONFIG of the first group of each position."""
    for position in listing.positions:
        group, label = position.groups.get(1), position.label
        if group is None:
            continue
        cartesian = bool({*group.fields} & (_POSE | RELATIVE))
        if group.frames and group.fields and cartesian != (group.config is not None):
            reason = f"{label} has {'no' if cartesian else 'a'} CONFIG"
            yield Problem(position.row, "configuration", reason)
        elif group.config is not None and not _CONFIG.fullmatch(group.config.strip()):
            unset = not group.config.translate(str.maketrans("", "", "*, "))
            reason = f"{label}: there is no CONFIG {group.config[:30]!a}"
            yield Problem(position.row, "configuration", reason, "measuring" if unset else "error")
        for name, (text, unit) in group.fields.items():
            wanted = "mm" if name.lstrip("R") in PLACE else "deg"
            level: Level = "error"
            rule = reason = ""
            if text.startswith("*"):
                rule, reason, level = "position-value", "has no value", "measuring"
            elif unit != wanted and not (name in EXTENDED and unit):
                rule, reason = "unit", f"is in {unit or 'no unit'}, not in {wanted}"
            elif len(text) > 20 or not _in_range(name, float(text)):
                rule, reason = "range", f"is {text[:20]}"
            if rule:
                yield Problem(group.row_of(name), rule, f"{label}: {name} {reason}", level)


def _in_range(name: str, value: float) -> bool:
    if name in TURN:
        return abs(value) <= 180.0
    far = name.lstrip("R") in PLACE or name in EXTENDED
    return abs(value) <= (MOST_POSITION_MM if far else MOST_JOINT_DEG)


def _check_use(listing: Listing) -> Iterator[Problem]:
    defined = {position.number for position in listing.positions} | listing.broken
    used: set[int] = set()
    indirect = False
    for line in listing.instructions:
        numbers, chosen = _positions_of(line)
        indirect = indirect or chosen
        for number in sorted(numbers - defined):
            yield Problem(line.row, "position-defined", f"P[{number}] is not defined")
        used |= numbers
    for position in listing.positions:
        if position.number not in used and not indirect:
            reason = f"{position.label} is never used"
            yield Problem(position.row, "position-used", reason, "measuring")


def _positions_of(line: Instruction) -> tuple[set[int], bool]:
    """Numbers of the positions that an instruction names, and whether a register chooses one."""
    numbers: set[int] = set()
    chosen = False
    for tree in line.statement.all("target", "indexed"):
        if str(tree.children[0]) == "P":
            first = next(nodes(tree, "index")).children[0]
            if isinstance(first, Token) and first.type == "INT":
                numbers.add(int(first[:9]))
            else:
                chosen = True
    return numbers, chosen


def _check_motions(listing: Listing) -> Iterator[Problem]:
    """Rules that follow the program line by line: active frames, and whether the arm stands.

    Behind a label, a call or the end of a block nobody knows from the file which frames are
    active: a frame that differs from the one set last is an error only where none is between.
    """
    stored = {position.number: position for position in listing.positions}
    active: dict[str, int | None] = {"UF": None, "UT": None}
    sure: dict[str, bool] = {"UF": False, "UT": False}
    stands = False
    for line in listing.instructions:
        kind = line.kind
        if kind == "frame":
            tree = line.statement.tree
            letters = "UF" if line.statement.one("uframe") is not None else "UT"
            number = [t for t in tree.children if isinstance(t, Token) and t.type == "INT"]
            active[letters] = int(number[0][:9]) if number else None
            sure[letters] = bool(number)
        elif kind in ("label_", "call", "run", "else_", "endif", "endfor", "branch", "select"):
            sure = {"UF": False, "UT": False}
        elif kind == "motion":
            stands = line.statement.one("fine") is not None
            for number_of in _positions_of(line)[0]:
                yield from _frame_problems(line.row, stored.get(number_of), active, sure)
            if line.statement.one("elsewhere") is not None:
                reason = f"moves to another place than its position: {line.code.strip()[-40:]}"
                yield Problem(line.row, "elsewhere", reason, "measuring")
        if kind == "call" and not stands:
            reason = "no motion to a standstill (FINE) before the CALL"
            yield Problem(line.row, "fine-before-call", reason, "measuring")


def _frame_problems(
    row: int, position: Position | None, active: dict[str, int | None], sure: dict[str, bool]
) -> Iterator[Problem]:
    group = position.groups.get(1) if position is not None else None
    if position is None or group is None:
        return  # other rules say so
    for letters, name in (("UF", "UFRAME_NUM"), ("UT", "UTOOL_NUM")):
        frame = group.frames.get(letters)
        if frame is None:
            continue  # left open: whatever is active
        if active[letters] is None:
            reason = f"{name} is not set to a number before the motion"
            yield Problem(row, "frames-set", reason, "measuring")
        elif active[letters] != frame:
            reason = f"{position.label} has {letters} {frame}, {name} is {active[letters]}"
            yield Problem(row, "frame", reason, "error" if sure[letters] else "measuring")
