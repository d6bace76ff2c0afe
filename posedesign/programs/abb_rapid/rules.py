r"""ABB RAPID modules (``.mod``, ``.modx``): the validator's rules of what the grammar cannot say.

Sources: ABB's manuals (RAPID kernel; Instructions, Functions and Data types; Basic
characteristics) and public programs. Nothing was loaded into a controller.

A module has data, routines and types of other modules, and signals of the controller: what is not
declared is a note. A module with the mark of a plan was written whole: there it is an error.

====================  ===========================================================================
rule                  what it asks
====================  ===========================================================================
``syntax``            statements of the grammar
``encoding``          text; in a ``.modx`` or ``.sysx`` UTF-8
``placeholder``       measuring: nothing is left to be filled in, as <SMT> is
``module``            MODULE name ... ENDMODULE, and nothing before or behind
``block``             each block closed by its own end
``place``             instructions in routines; data in front of the instructions of a routine, and
                      of all routines
``name``              names of at most 32 characters; each declared once. In a module of a plan:
                      none of a type; words known, or not one letter beside a known one
``string``            at most 80 characters
``position``          jointtarget [[6],[6]], robtarget [[3],[4],[4],[6]] of plain numbers, lists
                      complete; quaternions of norm 1; confdata. Measuring: the norm within 0.00001,
                      confdata of a six-axis arm
``frame``             the same of tooldata and wobjdata
``argument``          number, types and switches of the arguments of motions and waits; tools and
                      work objects of motions: PERS, with a mass; indices within the list
``standstill``        measuring: between a motion and a call, a pulse or the keeping of a position:
                      WaitTime\InPos, and the motion to a stop point (fine)
``position-used``     measuring: each position ``p1``, ``jp1``, ... is used
====================  ===========================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterator, Sequence, Set
from operator import attrgetter
from pathlib import Path

from lark import Token, Tree

from calib.errors import FileFormatError
from posedesign.programs import rules
from posedesign.programs.abb_rapid import module
from posedesign.programs.abb_rapid.module import FRAMES, ROUTINES, SHAPES, Data, Nested
from posedesign.programs.abb_rapid.reader import StoredPosition, frames_of
from posedesign.programs.language import Block, Node, Statement, block_faults, is_a, nodes, text_of
from posedesign.programs.language import words as token_texts
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.rules import measuring
from posedesign.programs.sets import set_mark

_SIGNATURES = r"""
MoveAbsJ \Conc, jointtarget \ID \NoEOffs, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \TLoad
MoveJ \Conc, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \TLoad
MoveL \Conc, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \Corr \TLoad
MoveC \Conc, robtarget, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \Corr\
 \TLoad
WaitTime \InPos, num
WaitRob \InPos \ZeroSpeed
VelSet num, num
PulseDO \High \PLength, signaldo
ConfJ \On \Off
ConfL \On \Off
""".replace("\\\n", "")


def _names(text: str) -> frozenset[str]:
    return frozenset(text.upper().split())


def _signature(text: str) -> list[tuple[str, frozenset[str]]]:
    found = []
    for part in text.split(","):
        kinds = [word for word in part.split() if word[0] != "\\"]
        switches = _names(" ".join(word[1:] for word in part.split() if word[0] == "\\"))
        found.append(("".join(kinds), switches))
    return found


SIGNATURES = {
    line.split()[0].upper(): _signature(line.partition(" ")[2])
    for line in _SIGNATURES.strip().splitlines()
}
"""Types and switches of the arguments of instructions, by name in capitals; switches in front of
the first argument have no type."""

_RANGES = {"VELSET": (1e-9, 10_000), "WAITTIME": (0, math.inf)}
"""Ranges of the numbers that instructions are given."""

QUIET = _names("""
AccSet Add Break Clear ConfJ ConfL Decr Incr Reset Set SetAO SetDO SetGO SingArea Stop TPErase
TPWrite VelSet WaitDI WaitDO WaitRob WaitTime WaitUntil
""")
"""Instructions that measure nothing and move nothing."""

INSTRUCTIONS = QUIET | _names("""
ActUnit AliasIO BitClear BitSet BookErrNo CallByVar ClearPath ClearRawBytes ClkReset ClkStart
ClkStop Close DeactUnit EOffsOff EOffsOn EOffsSet ErrWrite ExitCycle GripLoad IDelete IDisable
IEnable InvertDO ISignalAI ISignalDI ISignalDO ISignalGI ISleep ITimer IWatch Load MotionSup
MoveAbsJ MoveC MoveCDO MoveExtJ MoveJ MoveJDO MoveJSync MoveL MoveLDO MoveLSync Open PackRawBytes
PathResol PDispOff PDispOn PDispSet PulseDO RestoPath Save SearchC SearchL SocketAccept SocketBind
SocketClose SocketConnect SocketCreate SocketListen SocketReceive SocketSend SpeedRefresh StartLoad
StartMove StopMove StorePath SyncMoveOff SyncMoveOn TPReadFK TPReadNum TPShow TriggC TriggEquip
TriggInt TriggIO TriggJ TriggL UIMsgBox UnLoad UnpackRawBytes WaitAI WaitAO WaitGI WaitGO WaitLoad
WaitSyncTask WorldAccLim Write WriteBin WriteStrBin WZFree
""")

FUNCTIONS = _names("""
Abs ACos AInput AOutput ArgName ASin ATan ATan2 BitAnd BitCheck BitNeg BitOr BitXOr ByteToStr
CalcJointT CalcRobT CDate CJointT ClkRead Cos CPos CRobT CTime CTool CWObj DefFrame Dim DInput
Distance DnumToNum DOutput EulerZYX GetSysInfo GetTime GInput GOutput IsFile IsPers IsVar MirPos
NOrient NumToDnum NumToStr Offs OpMode OrientZYX ORobT PoseInv PoseMult PoseVect Pow Present
RawBytesLen ReadBin ReadMotor ReadNum ReadStr ReadStrBin RelTool RobOS Round RunMode Sin
SocketGetStatus SocketPeek Sqrt StrFind StrLen StrMap StrMatch StrMemb StrPart StrToByte StrToVal
Tan TestDI Trunc UIAlphaEntry UIListView UIMessageBox UINumEntry ValToStr VectMagn
""")

TYPES = _names("""
bool byte clock confdata dnum errnum extjoint identno intnum iodev jointtarget loaddata loadsession
mecunit motsetdata num orient pos pose progdisp rawbytes robjoint robtarget shapedata signalai
signalao signaldi signaldo signalgi signalgo socketdev speeddata stoppointdata string switch
syncident tasks tooldata trapdata triggdata wobjdata zonedata
""")

_DATA = {
    "speeddata": "v5 v10 v20 v30 v40 v50 v60 v80 v100 v150 v200 v300 v400 v500 v600 v800 v1000 "
    "v1500 v2000 v2500 v3000 v4000 v5000 v6000 v7000 vmax vrot1 vrot2 vrot5 vrot10 vrot20 vrot50 "
    "vrot100 vlin10 vlin20 vlin50 vlin100 vlin200 vlin500 vlin1000",
    "zonedata": "z0 z1 z5 z10 z15 z20 z30 z40 z50 z60 z80 z100 z150 z200 fine",
    "tooldata": "tool0",
    "wobjdata": "wobj0",
    "loaddata": "load0",
}
DATA = {name: kind for kind, names in _DATA.items() for name in _names(names)}
"""Types of the data that every controller has, by name in capitals."""


_WITHOUT_MARK = {
    name + switch: f"{name}\\{switch}"
    for name, signature in SIGNATURES.items()
    for switch in signature[0][1]
}
"""Instructions that lack what stands in front of a switch: ``ConfJOn``."""


def misspelt(word: str, known: Set[str]) -> str:
    """The known word that a word in capitals was meant to be; empty for none.

    Figures at the end, and added letters that double none, are none of a mistake: people number
    and lengthen what they name.
    """
    if word in _WITHOUT_MARK:
        return _WITHOUT_MARK[word]
    if word.rstrip("0123456789_") in known:
        return ""
    halved = {word[:i] + word[i + 1 :] for i in range(2, len(word)) if word[i] == word[i - 1]}
    longer = [other for other in known if len(other) >= len(word) or other in halved]
    return rules.near(word, longer, 4)


MOST_NAME, MOST_STRING = 32, 80
WRITTEN_WITHIN = 1e-5  # of the norm of a quaternion from 1, as it is written for measuring
_BLOCKS = {
    **{kind: Block(f"end{kind}", ("error", "undo", "backward")) for kind in ROUTINES},
    **{kind: Block(f"end{kind}") for kind in ("module", "record", "for", "while")},
    "if": Block("endif", ("elseif", "else")),
    "test": Block("endtest", ("case", "default")),
}
_DECLARING = ("declaration", "array", "element", "array_end")
_NAMED_POSITION = re.compile(r"J?P\d+", re.IGNORECASE | re.ASCII)
_NUMBER = re.compile(r"[-+]?[\d.]+(?:E[-+]?\d+)?", re.IGNORECASE | re.ASCII)
_TYPED = {"WOBJ": "wobjdata", "PLENGTH": "num", "V": "num", "T": "num", "Z": "num"}


def check_abb_rapid(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    text, suffix = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1"), path.suffix.lower()
    statements = module.LANGUAGE.statements(text)
    checker = _Checker(statements, whole=set_mark(data) is not None)
    return rules.told(
        rules.check_bytes(data, ("encoding", *rules.CONTROL[1:])),
        _check_encoding(data) if suffix.endswith("x") else (),
        rules.syntax(statements),
        _check_filled(text),
        _check_module(statements, suffix),
        block_faults(statements, _BLOCKS),
        _check_places(statements),
        checker.check_names(),
        checker.check_data(),
        checker.check_instructions(),
        checker.check_standstill(),
    )


def _check_filled(text: str) -> Iterator[Problem]:
    found = next((f for f in module.LEFT_OUT.finditer(text) if f[0].startswith("<")), None)
    if found:
        row = text.count("\n", 0, found.start()) + 1
        yield measuring(row, "placeholder", f"the program stops at {found[0]}")


def _check_encoding(data: bytes) -> Iterator[Problem]:
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        yield Problem(row, "encoding", "this ending says UTF-8, and this is not")


def _check_module(statements: Sequence[Statement], suffix: str) -> Iterator[Problem]:
    begins = [s for s in statements if s.kind == "module"]
    if not begins or statements[0] is not begins[0]:
        row = statements[0].row if statements else 1
        yield Problem(row, "module", "MODULE is not the first word")
    elif statements[-1].kind != "endmodule":
        yield Problem(statements[-1].row, "module", "ENDMODULE is not the last word")
    elif len(begins) > 1 and suffix != ".prg":  # a whole program, of older controllers
        yield Problem(begins[1].row, "module", "a file holds one module")


def _check_places(statements: Sequence[Statement]) -> Iterator[Problem]:
    place, begun, routines = "", False, False
    for s in statements:
        kind, reason = s.kind, ""
        if kind in ("module", "endmodule", "record", *ROUTINES):
            if kind in ROUTINES and place != "module":
                reason = "a routine in a routine"
            place, begun = kind, False
            routines = kind != "module" and (routines or kind in ROUTINES)
        elif kind in ("endproc", "endfunc", "endtrap", "endrecord"):
            place = "module"
        elif kind in ("declaration", "array"):
            if place in ROUTINES and begun:
                reason = "a declaration behind an instruction"
            elif place in ROUTINES and s.one("scope"):
                reason = "LOCAL and TASK are for data of the module"
            elif place == "module" and routines:
                reason = "data of the module behind a routine"
        elif place in ROUTINES:
            begun = begun or kind not in _DECLARING
        elif kind not in (*_DECLARING, "alias", "fault") and (place, kind) != ("record", "call"):
            reason = "an instruction outside of all routines"
        if reason:
            yield Problem(s.row, "place", f"{s.text[:30].strip()!a}: {reason}")


class _Checker:
    """Rules that need what the whole module declares.

    ``names`` has type and declaration of data by routine, counted from 1, and name in capitals;
    those of the module are in routine 0.
    """

    def __init__(self, statements: Sequence[Statement], *, whole: bool) -> None:
        self.statements, self.whole = statements, whole
        self.level: Level = "error" if whole else "note"
        self.data = module.declared(statements)
        self.calls: list[list[tuple[str, list[module.Argument]]]] = []
        kind = ""
        for s in statements:  # components of a record look like calls
            kind = "record" if (kind, s.kind) == ("record", "call") else s.kind
            self.calls.append([] if kind == "record" else module.calls(s))
        self.called = {word for made in self.calls for word, _ in made}
        self.names: dict[tuple[int, str], tuple[str, Data | None]] = {}
        self.routines: list[int] = []
        self.own: set[str] = set()
        self.types: set[str] = set()
        self.told: set[str] = set()
        self.known = DATA.keys() | {"TRUE", "FALSE"}
        self.routine = 0

    def check_names(self) -> Iterator[Problem]:
        """Names that are declared; takes them."""
        data, seen, count = iter(self.data), dict[tuple[int, str], int](), 0
        for s in self.statements:
            new: list[tuple[int, str, str, Data | None]] = []
            if s.kind in ROUTINES:
                count += 1
                self.routine = count
            if s.kind == "module":  # the next one of an old program may have the same LOCAL names
                seen.clear()
            if s.kind in ("module", "record", "alias", *ROUTINES):
                name = str([c for c in s.tree.children if isinstance(c, Token)][-1])
                new.append((-1 if s.kind == "module" else 0, name, s.kind, None))
                kind = self.own if s.kind in ROUTINES else self.types
                kind.add(name.upper() if s.kind != "module" else "")
                for parameter in s.all("parameter"):
                    type_, name = (str(c) for c in parameter.children if _is_name(c))
                    new.append((self.routine, name, type_.lower(), None))
            elif s.kind in ("declaration", "array"):
                found = next(data)
                new.append((self.routine, found.name, found.kind, found))
            elif s.kind == "for":
                self.names.setdefault((self.routine, s.word("NAME").upper()), ("num", None))
            for where, name, known, declaration in new:
                key = where, name.upper()
                of_type = self.whole and name.upper() in TYPES | {"TASK"}
                if len(name) > MOST_NAME or of_type:
                    reason = f"{name[:40]!a} is no name: at most 32 characters, none of a type"
                    yield Problem(s.row, "name", reason)
                if key in seen:
                    yield Problem(s.row, "name", f"{name} is declared in line {seen[key]} too")
                seen.setdefault(key, s.row)
                self.names.setdefault(key, (known, declaration))
            self.routine = 0 if s.kind in ("endproc", "endfunc", "endtrap") else self.routine
            self.routines.append(self.routine)

        self.known |= {name for _, name in self.names if self.whole and len(name) > 4}

    def check_data(self) -> Iterator[Problem]:
        """What is declared, and strings."""
        before = ""
        for s in self.statements:
            if s.kind in ("element", "array_end") and before not in ("array", "element"):
                yield Problem(s.row, "position", "an element of no list")
            before = s.kind
            for string in s.words("STRING") if len(s.text) > MOST_STRING else ():
                doubled = r'""|\\(?:\\|[\dA-Fa-f]{2})|[\xc0-\xff][\x80-\xbf]+'  # or as codes
                length = len(re.sub(doubled, "_", string[1:-1]))
                if length > MOST_STRING:
                    yield Problem(s.row, "string", f"a string of {length} characters")
        joints: list[Data] = []
        for data in self.data:
            kind = data.kind.upper()
            if kind not in TYPES and kind not in self.types | self.told:
                self.told.add(kind)
                yield from self._unknown(data.row, kind, TYPES, "type")
            elements = len(data.listed)
            if not data.whole or (elements and data.count not in (None, elements)):
                reason = f"{data.name}{{{module.inside(data.size)[:20]}}} has {elements} elements"
                yield Problem(data.row, "position", reason + ", and no end" * (not data.whole))
            check = self._check_speed if data.kind == "speeddata" else self._check_position
            if data.kind == "jointtarget" and not elements and data.statement.once(_is_joints):
                joints.append(data)
            elif data.kind in (*SHAPES, "speeddata"):
                for label, value in data.values:
                    yield from check(data.row, label, data.kind, value)
            elif data.kind in FRAMES and is_a(data.value, "list") and not data.size:
                yield from self._check_frame(data)
        yield from rules.judged(joints, self._check_joints, attrgetter("statement"), lambda _: ())

    def _check_joints(self, data: Data) -> Iterator[Problem]:
        (label, value) = data.values[0]
        return self._check_position(data.row, label, data.kind, value)

    def _check_speed(self, row: int, name: str, kind: str, value: Node) -> Iterator[Problem]:
        """Four numbers; also of a speed in a motion."""
        if isinstance(value, Tree) and value.data == "list":
            texts = module.nested(value)
            named = any(map(self._has_names, texts)) and not self._has_odd(value)
            if len(texts) != 4 or not (named or all(map(_is_number, texts))):
                yield Problem(row, "argument", f"{name} has not the four numbers of a {kind}")

    def _check_frame(self, data: Data) -> Iterator[Problem]:
        flags = len(token_texts(data.value, "BOOL")) if isinstance(data.value, Tree) else 0
        if self._has_odd(data.value) or flags > FRAMES.index(data.kind) + 1:
            yield Problem(data.row, "frame", f"{data.name} has not plain numbers")
        elif data.value is not None and not self._has_names(module.nested(data.value)):
            try:
                frames_of(data, "")
            except FileFormatError as error:
                # a number that is only large is loaded, and leads nowhere
                problem = measuring if error.hint and not self.whole else Problem
                yield problem(data.row, "frame", _reason(error))

    def _has_names(self, value: Nested | str) -> bool:
        """Whether a part of a value has a name, or is calculated, and may be right."""
        if isinstance(value, str):
            return not _NUMBER.fullmatch(value) and value.upper() not in ("TRUE", "FALSE")
        return not self.whole and any(map(self._has_names, value))

    def _has_odd(self, value: Node | None) -> bool:
        """Whether a list has a word that stands for no number."""
        if not isinstance(value, Tree):
            return False
        found = {module.name_of(node) for node in value.iter_subtrees()} - {""}
        return bool(found & DATA.keys() or (found and self.whole))

    def _check_position(self, row: int, label: str, kind: str, node: Node) -> Iterator[Problem]:
        """Numbers of a position; parts of it may have names."""
        value = module.nested(node)
        if isinstance(node, Token) or node.data != "list":
            if isinstance(node, Token):
                yield Problem(row, "position", f"{label}: {str(node)[:30]!a} is no {kind}")
            return
        if self._has_odd(node) or token_texts(node, "BOOL", "STRING"):
            yield Problem(row, "position", f"{label} has not plain numbers")
            return
        named = [isinstance(part, str) and self._has_names(part) for part in value]
        if any(named) and len(value) == len(SHAPES[kind]):
            found = zip(named, module.shape(value), SHAPES[kind], strict=True)
            if any(n != wanted for skip, n, wanted in found if not skip):
                yield Problem(row, "position", f"{label} has not the lists of a {kind}")
            return
        level: Level = "error"
        try:
            position = StoredPosition.of(label, row, kind, value, "")
            if position.is_empty or any(map(self._has_names, value)):
                return
            if position.has_fewer_axes and not self.whole:
                level = "measuring"
            numbers = position.numbers("")
            if not position.cartesian:
                return
            norm = math.hypot(*numbers[3:])
            if abs(norm - 1.0) > WRITTEN_WITHIN:
                yield measuring(row, "position", f"{label}: the quaternion's norm is {norm:.6g}")
            if all(re.fullmatch(r"[-+]?\d{1,4}", text) for text in position.parts[2]):
                level = "measuring"  # of an arm of another kind
            position.details("")
        except FileFormatError as error:
            yield Problem(row, "position", _reason(error), level)

    def check_instructions(self) -> Iterator[Problem]:
        """Names and arguments, statement by statement."""
        used: set[str] = set()
        for s in self.statements:
            if s.kind not in _DECLARING:
                used.update(map(str.upper, s.texts(_used)))
        indices = range(len(self.statements))
        of = self.statements.__getitem__
        yield from rules.judged(indices, self._check_instruction, of, self._character)
        for data in self.data:
            numbered = data.kind in SHAPES and _NAMED_POSITION.fullmatch(data.name)
            if numbered and data.name.upper() not in used:
                yield measuring(data.row, "position-used", f"{data.name} is never used")

    def _check_instruction(self, i: int) -> Iterator[Problem]:
        s, self.routine = self.statements[i], self.routines[i]
        for node in s.all("variable", "function"):
            name = str(node.children[0]).upper()
            if node.data == "function":
                yield from self._check_called(s.row, name, FUNCTIONS, INSTRUCTIONS)
            else:
                yield from self._check_variable(s.row, name, node)
        for word, given in self.calls[i]:
            yield from self._check_called(s.row, word, INSTRUCTIONS, FUNCTIONS)
            if word in SIGNATURES and word not in self.own:
                yield from self._check_arguments(s.row, word, given)

    def _character(self, i: int) -> Hashable:
        """What matters of the names of a statement: their types, or else the names."""
        self.routine = self.routines[i]
        found: list[Hashable] = []
        for word in self.statements[i].words("NAME"):
            kind, data = self._find(word.upper()) or ("", None)
            plain = data is not None and kind not in FRAMES
            found.append((kind, data.count, bool(data.size)) if plain and data else word)
        return tuple(found)

    def _find(self, name: str) -> tuple[str, Data | None] | None:
        return self.names.get((self.routine, name)) or self.names.get((0, name))

    def _unknown(self, row: int, name: str, known: frozenset[str], what: str) -> Iterator[Problem]:
        """A word that is not known: a note, or an error in a module that is whole and if it is
        nearly a known one.
        """
        near = misspelt(name, known)
        reason = f"{name[:40]} is no {what} that is known" + f": {near}?" * bool(near)
        yield Problem(row, "name", reason, self.level if near else "note")

    def _check_called(
        self, row: int, name: str, known: frozenset[str], others: frozenset[str]
    ) -> Iterator[Problem]:
        if name in known or name in self.own or name in self.told:
            return
        what = "instruction" if known is INSTRUCTIONS else "function"
        if self._find(name) or (self.whole and name in others):
            yield Problem(row, "name", f"{name} is no {what}")
        else:
            self.told.add(name)
            yield from self._unknown(row, name, known, what)

    def _check_variable(self, row: int, name: str, node: Tree[Token]) -> Iterator[Problem]:
        found = self._find(name)
        for index in node.children[1:2]:
            text = module.inside(index) if isinstance(index, Tree) else ""
            most = found[1].count if found and found[1] else None
            if most is not None and text.isdigit() and not 1 <= int(text[:9]) <= most:
                yield Problem(row, "argument", f"{name}{{{text[:12]}}} of {most}")
            if text.upper() in DATA.keys() | {"TRUE", "FALSE"}:
                yield Problem(row, "argument", f"{text} is no index")
        if found or name in DATA or name in self.told or not self.whole:
            return  # data of another module may have any name
        routines = FUNCTIONS | INSTRUCTIONS | TYPES | self.own | self.called
        if name in routines:
            yield Problem(row, "name", f"{name} is no value")
            return
        self.told.add(name)
        near = misspelt(name, self.known)
        if near:
            yield Problem(row, "name", f"{name} is not known: {near}?")

    def _check_arguments(
        self, row: int, word: str, given: list[module.Argument]
    ) -> Iterator[Problem]:
        alone = given[:1] and given[0][0] is None  # switches in front of the first argument
        wanted = [pair for pair in SIGNATURES[word] if pair[0] or alone]
        if len(given) != len(wanted):
            yield Problem(row, "argument", f"{word} has {len(given)} arguments, not {len(wanted)}")
            return
        for (value, switches), (kind, known) in zip(given, wanted, strict=True):
            for switch, inner in switches.items():
                if switch not in known:
                    said = f"\\{switch[:30]} is no switch there that is known"
                    yield Problem(row, "argument", said, self.level)
                elif inner is not None and switch in _TYPED:
                    yield from self._check_value(row, inner, _TYPED[switch])
            if value is not None:
                yield from self._check_value(row, value, kind)
            least, most = _RANGES.get(word, (-math.inf, math.inf))
            text = module.nested(value) if isinstance(value, Token) else ""
            if _is_number(text) and not least <= float(str(text)) <= most:
                reason = f"{word}: {str(text)[:20]} is not from {least:g} to {most:g}"
                yield Problem(row, "argument", reason)

    def _check_value(self, row: int, value: Node, kind: str) -> Iterator[Problem]:
        """The type of an argument, as far as it is known."""
        if is_a(value, "list") and kind in SHAPES:
            yield from self._check_position(row, "the position", kind, value)
        if kind == "speeddata":
            yield from self._check_speed(row, "the speed", kind, value)
        number = is_a(value, "operation") or (isinstance(value, Token) and value.type == "NUMBER")
        plain = isinstance(value, Token) or value.data in ("operation", "list")
        if plain and number != (kind == "num") and not (is_a(value, "list") and kind != "num"):
            yield Problem(row, "argument", f"{text_of(value)[:40]!a} is no {kind}")
        name = module.name_of(value)
        if not name or any(map(_is_name, value.children[1:])):  # type: ignore[union-attr]
            return
        known, data = self._find(name) or (DATA.get(name, ""), None)
        if not known and kind not in ("num", "signaldo"):
            yield Problem(row, "name", f"{name} is no {kind} of this module", self.level)
        elif known != kind and known.upper() in TYPES and (known, kind) != ("dnum", "num"):
            yield Problem(row, "argument", f"{name} is a {known}, not a {kind}")
        elif data and bool(data.size) != (len(value.children) > 1):  # type: ignore[union-attr]
            yield Problem(row, "argument", f"{name} is {'a' if data.size else 'no'} list")
        elif data and kind in FRAMES:
            load = module.nested(data.value)[2:] if is_a(data.value, "list") else []
            mass = load[0][0] if kind == "tooldata" and load and isinstance(load[0], list) else "1"
            if data.storage != "PERS":
                yield Problem(row, "argument", f"{name}: the {kind} of a motion is PERS")
            elif isinstance(mass, str) and _NUMBER.fullmatch(mass) and float(mass) <= 0:
                level: Level = "error" if self.whole else "measuring"
                yield Problem(row, "argument", f"{name} has no mass above 0", level)

    def check_standstill(self) -> Iterator[Problem]:
        """What is measured while the arm stands."""
        stands = stopped = True
        for s, made in zip(self.statements, self.calls, strict=True):
            if s.kind in ROUTINES:
                stands = stopped = True  # whoever calls it sees to that
            acts = s.kind == "late_call"
            for word, given in made:
                switches = {switch for _, found in given for switch in found}
                if word.startswith("MOVE") and len(given) > 2:
                    zone = [value for value, _ in given if value is not None][-2:-1]
                    stopped, stands = [module.name_of(node) for node in zone] == ["FINE"], False
                elif word in ("WAITTIME", "WAITROB") and switches & {"INPOS", "ZEROSPEED"}:
                    stands = True
                else:
                    acts = acts or word not in QUIET
            if s.kind == "assignment":
                called = {str(node.children[0]).upper() for node in s.all("function")}
                acts = bool(called & {"CJOINTT", "CROBT"})
            if acts and not stopped:
                said = "the motion before it has no stop point (fine)"
                yield measuring(s.row, "standstill", said)
            elif acts and not stands:
                said = "no WaitTime\\InPos between the motion and this: the arm may still move"
                yield measuring(s.row, "standstill", said)


def _used(tree: Tree[Token]) -> list[Node]:
    """Names of variables and functions."""
    return [node.children[0] for node in nodes(tree, "variable", "function")]


def _is_joints(s: Statement) -> bool:
    """Whether the value that is declared is one of joints, in plain numbers."""
    return bool(module.value_of(s.tree)) and module.numbers_in_lists(s) == [6, 6]


def _is_name(node: Node) -> bool:
    return isinstance(node, Token) and node.type == "NAME"


def _is_number(text: Nested | str) -> bool:
    return isinstance(text, str) and _NUMBER.fullmatch(text) is not None


def _reason(error: FileFormatError) -> str:
    """A refusal of the reader without file and line."""
    return error.message.partition(": ")[2]
