"""Yaskawa INFORM jobs (``.JBI``): the reader of what controllers save and people write.

All C variables are taken, in pulses or as poses, and the P variables that steps move to. Their
numbers are those of the comments ``'POSE n name`` before the moves, where the job has such
comments: other positions, of steps that were added, then stand behind all. Without any comment
C00000 is number 1. Where ``GETS PX007 $PX000`` stands behind a move, P00007 is what was measured,
and is taken in place of the C variable: where the file holds some of them, poses whose own is not
there are left out; where it holds none, the planned positions are read, and marked as such.

The numbers of ``///USER`` and ``///TOOL`` go with the positions; frame 0 is the base frame.

Pulses become degrees with the ratios in the comments ``'PULSES S 1638.4``, or with those that the
dialect was made with; ///ANGLE has degrees. So do pulses of base axes (BC, BP), in millimetres;
without their ratios they are only compared, and in a frame they are distances from its origin,
which is not known. Steps of a second robot (``+MOVJ``) are left out. What would be read wrong in
silence is refused with its line: station axes that stand elsewhere at some of the poses, base axes
where the arm's description has none, positions in a frame that moves, lost lines, steps that are no
INFORM and name a position.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from lark import Token, Tree

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray
from posedesign.programs.configurations import YaskawaConfiguration
from posedesign.programs.language import (
    Language,
    Line,
    Node,
    Statement,
    nodes,
    shared,
    subtrees,
)
from posedesign.programs.numbering import Announced
from posedesign.programs.reading import (
    MOST_JOINT_DEG,
    no_positions,
    pose_values,
    poses_of,
    refuse,
    text_of,
)
from posedesign.programs.recorded import Problem, RecordedPosition, RecordedProgram
from posedesign.programs.rules import near
from posedesign.programs.writing import NameRule

KINDS = ("C", "BC", "EC", "P", "BP", "EX")
"""Of positions, in the order of ///NPOS: of the job, and variables; of arms, bases, stations."""

_HEADINGS = """
///NPOS ///TOOL ///USER ///POSTYPE ///PULSE ///RECTAN ///RCONF ///MTOOL ///DATE ///COMM ///ATTR
///FRAME ////FRAME ///GROUP ///LVARS ///ARGTYPE ///COMMENT ///FOLDERNAME
"""
_INSTRUCTIONS = """
ABORT ADD ADVINIT ADVSTOP AND ANTOUT AOUT ARATIOF ARATION ARCCTE ARCCTOF ARCCTON ARCCTS ARCCUR ARCOF
ARCON ARCSET ARCVOL ASC ATAN AWELD BREAK CALL CASE CAT$ CHR$ CLEAR CLS CNVRT COMM COS CWAIT DEC
DEFAULT DELETEJ DI DIALOG DIN DIV DOUT DROPVAL EI ELSE ELSEIF ELSEIFEXP END ENDFOR ENDIF ENDSWITCH
ENDWHILE EVCMP FOR FORMAPR FORMCUT GETARG GETE GETFILE GETNAME GETPOS GETPRM GETREG GETS GETTOOL
GETUALM GUNCHG GUNCL HAND HOLD HPMMVOF HPMMVON HPVELOF HPVELON HSEN HTRAJOF HTRAJON IF IFTHEN
IFTHENEXP IMOV INC INIWIN INPUT INTR INVMAT JUMP LATCH LATESTJOB LEN LOADJ LOADV MACRO MFRAME MID$
MOVC MOVJ MOVL MOVS MSG MSHIFT MUL MULMAT NEXT NOP NOT NSRCH OR PALINI PAUSE PLATEOF PLATEON POINT
PRINT PSTART PULSE PWAIT REFP REPLAY RET RETRY SAVEJ SAVEV SET SETE SETFILE SETPRM SETREG SETTM
SETTOOL SETUALM SFTOF SFTOF3D SFTON SFTON3D SHCKRST SHCKSET SIN SKILLSND SKIP SMOOTH SMOVC SMOVJ
SMOVL SMOVS SPEED SPOT SQRT SRCH SSFTOF SSFTON STRSTR STROKE STRWAIT SUB SVGUNCL SVSPOT SVSPOTMOV
SWAIT SWITCH SYEND SYMOVC SYMOVJ SYMOVL SYSTART TIMER TOOLOF TOOLON TSYNC UNTIL VAL VAL2STR VWELD
WAIT WAVEOF WAVEON WHILE WHILEEXP WVOF WVON XOR
"""
HEADINGS = frozenset(_HEADINGS.split())
INSTRUCTIONS = frozenset(_INSTRUCTIONS.split())
"""First words of steps: of the INFORM manuals, with the options for handling, cutting, welding."""

NAMES = NameRule("a Yaskawa job name", 8)  # what every controller takes, NX100 too
MOST_COMMENT = 32  # characters of a job's comment and of a comment line
MOST_FRAME = 63  # NX100 has fewer frames
AXES = ("S", "L", "U", "R", "B", "T")  # Yaskawa's names of the six axes, from the base on
EXTERNAL = ("E1", "E2", "E3")
"""Our names of the base axes, in the order of a BC position, which has up to three values."""

DECIMALS = 9  # decimals of a ratio that are kept: 1e-9 pulses in 720 deg are none
_LEAST, _MOST = 1.0, 1e6
"""Arms have some hundreds to thousands of pulses a degree, base axes of pulses a millimetre."""

_COMMENT = re.compile(r"PULSES\s+([SLURBT]|E[1-3])\s+([-+]?\d{1,7}(?:\.\d{0,12})?)\s*", re.ASCII)

_HINTS = {
    "pulses_per_deg": "give six signed numbers, S L U R B T in pulses/deg: of the controller's "
    "parameter file (ALL.PRM), or a pulse count that the pendant shows divided by its angle",
    "pulses_per_mm": "give a signed number for each base axis in pulses/mm: a pulse count that the "
    "pendant shows divided by the way from the axis's zero",
}


def checked(
    pulses: Sequence[float], name: str = "pulses_per_deg", axes: Sequence[str] = AXES
) -> tuple[float, ...]:
    """The ratios of axes, rounded as they are written; InputError where they are none of an arm."""
    values = tuple(pulses)
    if len(values) != len(axes):
        raise InputError(
            f"{name} has {len(values)} values: joints are written in encoder pulses, "
            f"which need one for each of {', '.join(axes)}",
            hint=_HINTS[name],
            name=name,
            value=values,
            bound=len(axes),
        )
    for axis, value in zip(axes, values, strict=True):
        if not (math.isfinite(value) and _LEAST <= abs(value) <= _MOST):
            raise InputError(
                f"{name} of {axis} is {value}, not {_LEAST:g} to {_MOST:g} either way",
                hint=_HINTS[name],
                name=name,
                value=value,
                bound=(_LEAST, _MOST),
            )
    return tuple(round(float(value), DECIMALS) for value in values)


def comments(pulses: Sequence[float]) -> list[str]:
    """Texts of the comments, one an axis, that carry the ratios in a job: ``PULSES S 1638.4``.

    ``pulses``: of S, L, U, R, B, T in a degree, then of the base axes in a millimetre.
    """
    texts = (f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".") for value in pulses)
    return [f"PULSES {axis} {text}" for axis, text in zip((*AXES, *EXTERNAL), texts, strict=False)]


def found_in(text: str) -> tuple[str, float] | None:
    """Axis and ratio of such a comment, or None."""
    found = _COMMENT.fullmatch(text)
    return (found[1], float(found[2])) if found else None


OF_POS = ("npos", "tool", "user", "postype", "pulse", "angle", "rectan", "rconf", "stored")
"""Kinds of statements that only //POS has."""

_MOST_NUMBER = 99_999
_MOST_LINES = 100_000
"""Read of a job: 9,999 steps and positions of all kinds have half of them. A longer file has no
END then."""

_OF_AXES = ("PULSE", "ANGLE")  # forms of positions that have values of axes
_JOB_MARKS = {"job": "/JOB", "pos": "//POS", "inst": "//INST", "end": "END"}

_OF_NAMES = ("///COMMENT", "///ARGNAME", "///ARGUNIT", "///TAGCOMM")

_WHOLE = re.compile(r"[-+]?\d{1,10}", re.ASCII)
_DECIMAL = re.compile(r"[-+]?\d{1,5}(?:\.\d{0,9})?", re.ASCII)
_FRAME = re.compile(r"\d{1,3}", re.ASCII)
_NAMED = re.compile(r"(?<![\w#$])(?:C|BC|EC|P|BP|EX)\d{1,5}(?!\w)", re.ASCII)
_POSE = ("X", "Y", "Z", "Rx", "Ry", "Rz")
_BASES = ("BC", "BP")  # kinds of positions of base axes
_BASE_FRAMES = ("BASE", "ROBOT")
"""The frame on the robot's foot; they differ where a base axis carries the robot, whose positions
are then in BC variables."""

_configuration = lru_cache(maxsize=64)(YaskawaConfiguration.parse)  # a job has few different ones


_SILENT = ("comment", "move", "also", "timer", "call")  # steps that give no variable a value
_GIVEN = re.compile(
    r"\s*(?:SETE?|GETE|GETPOS|ADD|SUB|MULMAT|INVMAT|MFRAME|CNVRT)\s+PX?(\d{1,5})\b", re.ASCII
)
"""A step that gives a position variable a value; of GETS see `_Reader.kept`."""


class Name(NamedTuple):
    """Kind and number of a position: ("C", 7) for C00007."""

    kind: str
    number: int

    @property
    def label(self) -> str:
        """As it stands in a job."""
        return f"{self.kind}{self.number:05d}"

    @classmethod
    def of(cls, text: str) -> Name:
        """Of C00007; far too large numbers are cut off."""
        kind = text.rstrip("0123456789")
        return cls(kind, int(text[len(kind) :][:9]))


@dataclass(frozen=True)
class Stored:
    """A position with the pseudo-instructions in force above it, as texts; empty for none."""

    row: int
    name: Name
    values: tuple[str, ...]
    form: str
    frame: str
    tool: str
    user: str
    rconf: str

    @property
    def label(self) -> str:
        """Its name, as it stands in a job."""
        return self.name.label

    @property
    def posed(self) -> bool:
        """Whether it is a pose, in a frame."""
        return self.form == "RECTAN" and self.frame not in _OF_AXES


@dataclass
class Job:
    """A job: the statements that begin a section, those in each, and the positions.

    ``kinds`` has those of //INST by their kind.
    """

    marks: list[Statement] = field(default_factory=list)
    head: list[Statement] = field(default_factory=list)
    pos: list[Statement] = field(default_factory=list)
    inst: list[Statement] = field(default_factory=list)
    after: list[Statement] = field(default_factory=list)
    stored: list[Stored] = field(default_factory=list)
    kinds: dict[str, list[Statement]] = field(default_factory=lambda: defaultdict(list))


def read_job(text: str) -> Job:
    """Sort the lines of a job; never fails."""
    plain = text.replace("\r\n", "\n")
    return shared(("jbi", plain), lambda: _sorted(plain))


def _children(tree: Tree[Token]) -> Sequence[Node]:
    return tree.children


def _sorted(text: str) -> Job:
    job = Job()
    part = job.head
    parts = {"job": job.head, "pos": job.pos, "inst": job.inst, "end": job.after}
    parts |= {"arginfo": [], "macro": []}
    above = dict.fromkeys(("form", "frame", "tool", "user", "rconf"), "")
    for statement in INFORM.statements(text):
        kind = statement.kind
        if kind in parts:
            job.marks.append(statement)
            part = parts[kind]
            continue
        part.append(statement)
        if part is job.inst:
            job.kinds[kind].append(statement)
        if part is not job.pos:
            continue
        if kind == "stored":
            name, *numbers = statement.texts(_children)
            job.stored.append(Stored(statement.row, Name.of(name), tuple(numbers), **above))
        elif kind in ("pulse", "angle", "rectan"):
            above["form"] = kind.upper()
        elif kind in ("tool", "user", "rconf", "postype"):
            values = ",".join(statement.texts(_children))
            above["frame" if kind == "postype" else kind] = values
    return job


def faults_of(job: Job) -> Iterator[Problem]:
    """What makes positions of a job doubtful: sections, lines or positions are lost or doubled."""
    marks = [mark for mark in job.marks if mark.kind in _JOB_MARKS]
    if [mark.kind for mark in marks] != [*_JOB_MARKS]:
        found = ", ".join(_JOB_MARKS[mark.kind] for mark in marks[:8]) or "nothing of it"
        reason = f"is no whole job: /JOB, //POS, //INST, END are due, there is {found}"
        yield Problem(marks[-1].row if marks else 1, "sections", reason)
    for statement in job.pos:
        if statement.fault:
            yield Problem(statement.row, "syntax", statement.fault)
        elif statement.kind not in (*OF_POS, "heading"):
            yield Problem(statement.row, "sections", f"{statement.text[:30]!a} is not of //POS")
    for statement in (*job.pos, *job.kinds["heading"]):
        word = statement.word("HEADING") if statement.kind == "heading" else ""
        if word and word not in HEADINGS:
            meant = near(word, HEADINGS)
            reason = f"{word[:30]!a} is no heading" + f"; did you mean {meant}?" * bool(meant)
            yield Problem(statement.row, "header", reason, "error" if meant else "note")
    seen: set[Name] = set()
    for stored in job.stored:
        if stored.name in seen or stored.name.number > _MOST_NUMBER:
            what = "is there twice" if stored.name in seen else "has too large a number"
            yield Problem(stored.row, "position-unique", f"{stored.label} {what}")
        seen.add(stored.name)
        if not stored.form or (stored.form != stored.frame and not stored.posed):
            reason = f"{stored.label} is neither in pulses nor in a frame: ///POSTYPE and "
            reason += "///PULSE, ///ANGLE or ///RECTAN are due above"
            yield Problem(stored.row, "position-format", reason)
    yield from _count_faults(job)


def _count_faults(job: Job) -> Iterator[Problem]:
    counts = [statement for statement in job.pos if statement.kind == "npos"]
    if len(counts) != 1:
        row = counts[1].row if counts else next((m.row for m in job.marks if m.kind == "pos"), 1)
        yield Problem(row, "npos", f"//POS has {'a second' if counts else 'no'} ///NPOS")
        return
    there = Counter(stored.name.kind for stored in job.stored)
    for kind, number in zip(KINDS, counts[0].words("NUMBER"), strict=True):
        if number != str(there[kind]):
            reason = f"///NPOS says {number[:9]} {kind} positions, there are {there[kind]}"
            yield Problem(counts[0].row, "npos", reason)


def positions_in(statement: Statement) -> list[list[Name]]:
    """Positions of the job and variables that a move has, and those of each other robot."""
    return statement.kept(_positions)


def _positions(statement: Statement) -> list[list[Name]]:
    names = map(Name.of, statement.texts(_points))
    return [[*islice(names, count)] for count in statement.once(_counts)]


def _points_of(move: Tree[Token]) -> list[Token]:
    points = [part.children[0] for part in subtrees(move) if part.data == "target"]
    return [p for p in points if isinstance(p, Token) and p.type == "POINT"]


def _points(tree: Tree[Token]) -> Iterator[Token]:
    return chain.from_iterable(map(_points_of, nodes(tree, "move", "also")))


def _counts(statement: Statement) -> list[int]:
    return [len(_points_of(move)) for move in statement.all("move", "also")]


def _without_argument_names(lines: Iterator[Line]) -> Iterator[Line]:
    """What people call the arguments of a job or a macro is any text."""
    inside = told = False
    for line in islice(lines, _MOST_LINES):
        if not (inside and told) or line.text.startswith("//"):
            yield line
            told = line.text in _OF_NAMES
            if line.text[2:3] != "/":
                inside = line.text in ("//ARGINFO", "//MACRO")


INFORM = Language(__package__, joined=_without_argument_names, signed=True, letters=r"\w$-")


def parse_yaskawa_jbi(
    data: bytes,
    path: Path | str,
    pulses_per_deg: tuple[float, ...] = (),
    pulses_per_mm: tuple[float, ...] = (),
) -> RecordedProgram:
    """Job in the content of a file; see the module.

    ``pulses_per_deg``, ``pulses_per_mm`` are for jobs that do not say them; refused where the job
    says otherwise.

    Raises FileFormatError: the file is no job, is cut off, or holds no position that can be read.
    """
    hint = "name a job saved by the controller, .JBI"
    # comments may be in any language: positions and instructions are in ASCII
    job = read_job(text_of(data, path, hint, strict=True))
    for problem in faults_of(job):
        if problem.level == "error":
            refuse(problem.message, path, problem.line, hint)
    reader = _Reader(job, path, pulses_per_deg, pulses_per_mm)
    name = next((s.word("TEXT") for s in job.head if s.kind == "name"), "")
    if not name:
        refuse("has no name behind //NAME", path, job.marks[0].row)
    for statement in job.inst:
        reader.take(statement)
    reader.announced.end()
    positions = reader.positions()
    if not positions:
        no_positions(path, "save the job that was touched up", row=job.marks[1].row)
    comment = next((s.word("TEXT").strip() for s in job.kinds["comm"]), "")
    mark, untouched = reader.announced.mark, reader.untouched
    return RecordedProgram(
        *(name, comment, mark, positions, "yaskawa"),
        empty_registers=untouched,
        unread=tuple(reader.unread),
    )


class _Reader:
    """Collects what the steps say of the positions, and then reads those."""

    def __init__(
        self, job: Job, path: Path | str, per_deg: tuple[float, ...], per_mm: tuple[float, ...]
    ) -> None:
        self.stored = {stored.name: stored for stored in job.stored}
        self.path, self.per_deg, self.per_mm = path, per_deg, per_mm
        self.announced = Announced(path)
        self.said: dict[str, float] = {}  # pulses in a degree or a millimetre, of comments
        self.known: dict[str, tuple[float, ...]] = {}  # the same of all axes, by its name
        self.used: set[Name] = set()
        self.other_robot: set[Name] = set()
        self.kept: dict[Name, Name] = {}  # the variable that a position was stored in
        self.axes: dict[Name, tuple[int, list[Name]]] = {}  # line, base and station variables
        self._at: Name | None = None
        self.given: dict[Name, int] = {}  # lines of the steps that give a variable a value
        self.unread: list[FileFormatError] = []

    @property
    def untouched(self) -> bool:
        """Whether steps store positions in variables, and none of these is in the file."""
        return bool(self.kept) and not set(self.kept.values()) & self.stored.keys()

    def refuse(self, message: str, row: int, hint: str = "save the job again") -> NoReturn:
        refuse(message, self.path, row, hint)

    def take(self, statement: Statement) -> None:
        kind = statement.kind
        if kind not in _SILENT and (given := _GIVEN.match(statement.text)):
            self.given[Name("P", int(given[1]))] = statement.row
        if kind == "comment":
            text = statement.text[1:].strip()
            axis, value = found_in(text) or ("", 0.0)
            if axis and self.said.setdefault(axis, value) != value:
                self.refuse(f"says the pulses/deg of {axis} twice", statement.row)
            self.announced.take(text, statement.row)
        elif kind == "move":
            self._move(statement)
        elif kind == "also":
            self.other_robot.update(*positions_in(statement))
        elif kind == "gets" and self._at is not None and statement.word("SYSTEM") == "$PX000":
            place = statement.word("VARIABLE")
            if place.startswith("PX"):
                self.kept[self._at] = Name("P", int(place[2:7]))
        elif kind in ("fault", "other") and _NAMED.search(statement.text):
            fault = statement.fault
            if kind == "other" and near(statement.word("WORD"), INSTRUCTIONS):
                fault = f"{statement.word('WORD')!a} is no instruction"
            if fault:
                self.refuse(fault, statement.row, "is it a move?")

    def _move(self, statement: Statement) -> None:
        names, *also = positions_in(statement)
        others = [name for them in also for name in them]
        self.other_robot.update(name for name in others if name.kind in "CP")
        for name in names:
            if "C" in name.kind and name not in self.stored:
                self.refuse(f"{name.label} is moved to, but not there", statement.row)
        at = self._at = next((name for name in names if name.kind in "CP"), None)
        if at is None:
            self.announced.end()
            return
        self.used.add(at)
        self.axes[at] = (statement.row, [name for name in names + others if name.kind not in "CP"])
        self.announced.move(at, at.label)

    def positions(self) -> tuple[RecordedPosition, ...]:
        """All that the robot moves to, with its own C variables."""
        untouched = self.untouched
        source = {name: name if untouched else self.kept.get(name, name) for name in self.stored}
        wanted = [
            name
            for name in self.stored
            if source[name] in self.stored
            and (name in self.used or (name.kind == "C" and name not in self.other_robot))
        ]
        for name in [name for name in wanted if name in self.given]:  # moved to, and not kept
            row, hint = self.given[name], "move to a position that no step changes"
            reason = f"{name.label} is changed by the job"
            self.unread.append(FileFormatError(reason, path=self.path, row=row, hint=hint))
        wanted = [name for name in wanted if name not in self.given]
        for error in self.unread if not wanted else ():
            raise error
        taken = [self.stored[source[name]] for name in wanted]
        bases = [self._base_of(name, source[name]) for name in wanted]
        carried = self._carried(wanted, bases)
        values = [
            pose_values(self._six(stored), _POSE, stored.label, self.path, stored.row)
            for stored in taken
            if stored.posed
        ]
        poses = iter(poses_of(values))
        # without any comment, that of the variable
        usual = {(kind, n): (n + 1, "") for kind, n in wanted if kind == "C"}
        numbers = self.announced.numbered([(name, "") for name in wanted], usual)
        return tuple(
            replace(
                self._position(*number, stored, next(poses) if stored.posed else None),
                external_shown=self._millimetres(source[name] == name, base),
                carried=carried.get(name, {}),
            )
            for number, name, stored, base in zip(numbers, wanted, taken, bases, strict=True)
        )

    def _position(
        self, number: int, name: str, stored: Stored, T_user_tool: FloatArray | None
    ) -> RecordedPosition:
        tool = self._frame("TOOL", stored.tool.split(",")[0], stored.row)
        row = stored.row
        if T_user_tool is None:
            joints = self._joints_deg(stored)
            return RecordedPosition(number, name, row, shown_deg=joints, tool_frame=tool)
        user = self._frame("USER", stored.user, row)
        if stored.frame == "USER" and user is None:
            self.refuse(f"{stored.label} is in a user frame, and no ///USER says which", row)
        if stored.frame not in ("USER", *_BASE_FRAMES):
            reason = f"{stored.label} is in the frame {stored.frame[:20]!a}"
            self.refuse(reason, row, "store it in pulses, or in the base or a user frame")
        try:
            configuration = _configuration(stored.rconf)
        except InputError as error:
            said = f"{stored.label}: {error.message}"
            what = said if stored.rconf else f"{stored.label} has no ///RCONF above"
            self.refuse(what, row, error.hint)
        user = user if stored.frame == "USER" else 0
        # the base frame is the controller's world, whatever the cell's frame
        world = None if user else np.eye(4)
        return RecordedPosition(
            number, name, row, None, T_user_tool, configuration, user, tool, T_world_user=world
        )

    def _frame(self, word: str, text: str, row: int) -> int | None:
        if text and not _FRAME.fullmatch(text):
            self.refuse(f"///{word} {text[:30]!a} is not a number", row)
        return int(text) if text else None

    def _six(self, stored: Stored) -> tuple[str, ...]:
        if len(stored.values) != len(AXES):
            reason = f"{stored.label} has {len(stored.values)} values, a six-axis arm six"
            self.refuse(reason, stored.row, "is this the job of another robot?")
        return stored.values

    def _joints_deg(self, stored: Stored) -> FloatArray:
        ratios, unit = (1.0,) * len(AXES), ""
        if stored.form == "PULSE":
            ratios, unit = self._ratios("pulses_per_deg", stored.row), " pulses"
        texts = self._six(stored)
        values = self._in_units(stored, AXES, ratios)
        for axis, text, value in zip(AXES, texts, values, strict=True):
            if abs(value) > MOST_JOINT_DEG:
                reason = f"{stored.label}: {axis} is {text}{unit}, {value:.0f} deg"
                self.refuse(reason, stored.row, "are the pulses/deg those of this arm?")
        return np.array(values)

    def _in_units(
        self, stored: Stored, axes: Sequence[str], ratios: Sequence[float]
    ) -> tuple[float, ...]:
        """Values of axes in degrees, or in millimetres; as many as have a ratio."""
        whole = stored.form == "PULSE"
        for axis, text in zip(axes, stored.values, strict=False):
            if not (_WHOLE if whole else _DECIMAL).fullmatch(text):
                reason = f"{stored.label}: {axis} is {text[:30]!a}, not a{' whole' * whole} number"
                self.refuse(reason, stored.row)
        return tuple(float(t) / ratio for t, ratio in zip(stored.values, ratios, strict=False))

    def _ratios(self, name: str, row: int) -> tuple[float, ...]:
        """Pulses of each axis in its unit: of the comments, or as given; both must agree."""
        if name not in self.known:
            self.known[name] = self._said(name, row)
        return self.known[name]

    def _said(self, name: str, row: int) -> tuple[float, ...]:
        of_arm = name == "pulses_per_deg"
        axes, given = (AXES, self.per_deg) if of_arm else (EXTERNAL, self.per_mm)
        said = [axis for axis in axes if axis in self.said]
        lost = next((axis for axis in axes[: 6 if of_arm else len(said)] if axis not in said), "")
        if said and lost:
            self.refuse(f"the comment 'PULSES {lost} is lost", row, "put it back")
        if of_arm and not said and not given:
            self.refuse(
                "positions are in encoder pulses, and the job does not say how many are a degree",
                row,
                "give the six of S L U R B T as pulses_per_deg (of the cell's program, or of "
                "YaskawaJbi), or in comments like 'PULSES S 1638.4 of the job; they stand in the "
                "controller's parameter file",
            )
        if not said:
            return given
        try:
            ratios = checked([self.said[axis] for axis in said], name, said)
        except InputError as error:
            self.refuse(error.message, row, error.hint)
        if given and (len(given) != len(said) or not np.allclose(ratios, given, 1e-6, 0.0)):
            unit = name.removeprefix("pulses_per_")
            reason = f"the pulses/{unit} of its comments are not those given"
            self.refuse(reason, row, "which are right?")
        return ratios

    def _base_of(self, name: Name, source: Name) -> Name | None:
        """Where base axes stand at a position: GETS stores them beside the arm's joints."""
        beside = Name("BP", source.number)
        if source != name and beside in self.stored:
            return beside
        _, axes = self.axes.get(name, (0, []))
        return next((axis for axis in axes if axis.kind in _BASES), None)

    def _millimetres(self, planned: bool, base: Name | None) -> tuple[float, ...]:
        """Values of base axes; none where nothing says what a pulse is, or where they stood."""
        stored = None if base is None else self.stored.get(base)
        if stored is None or stored.form != "PULSE" or not (planned or stored.name.kind == "BP"):
            return ()
        ratios = self._ratios("pulses_per_mm", stored.row)
        return self._in_units(stored, EXTERNAL[: len(ratios)], ratios)

    def _carried(
        self, wanted: list[Name], bases: list[Name | None]
    ) -> dict[Name, dict[int, FileFormatError]]:
        """Positions that a base axis has left its place in, as it may carry the arm's base.

        Refused are those between which a station moves: it carries the target.
        """
        announced = self.announced.found
        found: dict[Name, dict[int, FileFormatError]] = {}
        first: list[tuple[Sequence[object], ...]] = []
        for name, base in zip(wanted, bases, strict=True):
            if name not in self.axes or (announced and name not in announced):
                continue
            row, axes = self.axes[name]
            stations = [axis for axis in axes if axis.kind not in _BASES]
            values: list[tuple[Sequence[object], ...]] = [
                tuple(self.stored[axis].values if axis in self.stored else axis for axis in some)
                for some in ([base] if base else [], stations)
            ]
            first = first or values
            hint = "measure with these axes at rest"
            if values[1] != first[1]:
                self.refuse("station axes stand elsewhere than at the poses before", row, hint)
            if values[0] != first[0]:
                reason = "base axes stand elsewhere than at the poses before"
                hint += ", or describe the slide in the URDF"
                error = FileFormatError(reason, path=self.path, row=row, hint=hint)
                pairs = zip_longest(*(chain.from_iterable(v[0]) for v in (values, first)))
                found[name] = {k: error for k, (own, other) in enumerate(pairs) if own != other}
        return found
