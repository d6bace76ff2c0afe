"""A Yaskawa job as the trees of its lines: its sections, and its positions with what they are in.

The reader and the validator take both from here, so that neither understands a job in its own way.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice

from lark import Token, Tree

from posedesign.programs.language import Language, Line, Statement
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import near

KINDS = ("C", "BC", "EC", "P", "BP", "EX")
"""Of positions, in the order of ///NPOS: of the job, and variables; of arms, bases, stations."""

_HEADINGS = """
///NPOS ///TOOL ///USER ///POSTYPE ///PULSE ///RECTAN ///RCONF ///MTOOL ///DATE ///COMM ///ATTR
///FRAME ////FRAME ///GROUP ///LVARS ///ARGTYPE ///COMMENT
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
SMOVL SMOVS SPEED SPOT SQRT SRCH STRSTR STROKE STRWAIT SUB SVGUNCL SVSPOT SVSPOTMOV SWAIT SWITCH
SYEND SYMOVJ SYMOVL SYSTART TIMER TOOLOF TOOLON TSYNC UNTIL VAL VAL2STR VWELD WAIT WAVEOF WAVEON
WHILE WHILEEXP WVOF WVON XOR
"""
HEADINGS = frozenset(_HEADINGS.split())
INSTRUCTIONS = frozenset(_INSTRUCTIONS.split())
"""First words of steps: of the INFORM manuals, with the options for handling, cutting, welding."""

Name = tuple[str, int]
"""Kind and number of a position: ("C", 7) for C00007."""

_OF_POS = ("npos", "tool", "user", "postype", "pulse", "rectan", "rconf", "stored", "heading")
_MOST_NUMBER = 99_999
_MOST_LINES = 100_000
"""Read of a job: 9,999 steps and positions of all kinds have half of them. A longer file has no
END then."""

_WHOLE_JOB = {"job": "/JOB", "pos": "//POS", "inst": "//INST", "end": "END"}


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
        """Its name."""
        return label_of(self.name)


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
    job = Job()
    part = job.head
    parts = {"job": job.head, "pos": job.pos, "arginfo": [], "inst": job.inst, "end": job.after}
    above = dict.fromkeys(("form", "frame", "tool", "user", "rconf"), "")
    for statement in INFORM.statements(text):
        kind, values = statement.kind, statement.tree.children
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
            name, *numbers = map(str, values)
            job.stored.append(Stored(statement.row, name_of(name), tuple(numbers), **above))
        elif kind in ("pulse", "rectan"):
            above["form"] = kind.upper()
        elif kind in ("tool", "user", "rconf", "postype"):
            above["frame" if kind == "postype" else kind] = ",".join(map(str, values))
    return job


def faults_of(job: Job) -> Iterator[Problem]:
    """What makes positions of a job doubtful: sections, lines or positions are lost or doubled."""
    marks = [mark for mark in job.marks if mark.kind in _WHOLE_JOB]
    if [mark.kind for mark in marks] != [*_WHOLE_JOB]:
        found = ", ".join(_WHOLE_JOB[mark.kind] for mark in marks[:8]) or "nothing of it"
        reason = f"is no whole job: /JOB, //POS, //INST, END are due, there is {found}"
        yield Problem(marks[-1].row if marks else 1, "sections", reason)
    for statement in job.pos:
        if statement.fault:
            yield Problem(statement.row, "syntax", statement.fault)
        elif statement.kind not in _OF_POS:
            yield Problem(statement.row, "sections", f"{statement.text[:30]!a} is not of //POS")
    for statement in (*job.pos, *job.kinds["heading"]):
        word = statement.word("HEADING") if statement.kind == "heading" else ""
        if word and word not in HEADINGS:
            meant = near(word, HEADINGS)
            reason = f"{word[:30]!a} is no heading" + f"; did you mean {meant}?" * bool(meant)
            yield Problem(statement.row, "header", reason, "error" if meant else "note")
    seen: set[Name] = set()
    for stored in job.stored:
        if stored.name in seen or stored.name[1] > _MOST_NUMBER:
            what = "is there twice" if stored.name in seen else "has too large a number"
            yield Problem(stored.row, "position-unique", f"{stored.label} {what}")
        seen.add(stored.name)
        if not stored.form or (stored.form == "PULSE") != (stored.frame == "PULSE"):
            reason = f"{stored.label} is neither in pulses nor in a frame: ///POSTYPE and ///PULSE "
            yield Problem(stored.row, "position-format", reason + "or ///RECTAN are due above")
    yield from _count_faults(job)


def _count_faults(job: Job) -> Iterator[Problem]:
    counts = [statement for statement in job.pos if statement.kind == "npos"]
    if len(counts) != 1:
        row = counts[1].row if counts else next((m.row for m in job.marks if m.kind == "pos"), 1)
        yield Problem(row, "npos", f"//POS has {'a second' if counts else 'no'} ///NPOS")
        return
    there = Counter(stored.name[0] for stored in job.stored)
    for kind, number in zip(KINDS, counts[0].words("NUMBER"), strict=True):
        if number != str(there[kind]):
            reason = f"///NPOS says {number[:9]} {kind} positions, there are {there[kind]}"
            yield Problem(counts[0].row, "npos", reason)


def label_of(name: Name) -> str:
    """As it stands in a job: C00007."""
    return f"{name[0]}{name[1]:05d}"


def name_of(text: str) -> Name:
    """Kind and number of C00007; far too large numbers are cut off."""
    kind = text.rstrip("0123456789")
    return kind, int(text[len(kind) :][:9])


def names_in(move: Tree[Token]) -> list[Name]:
    """Positions of the job and variables that a move has, without those of other robots."""
    targets = [part for part in move.children if isinstance(part, Tree) and part.data == "target"]
    points = [target.children[0] for target in targets]
    return [name_of(p) for p in points if isinstance(p, Token) and p.type == "POINT"]


def _without_argument_names(lines: Iterator[Line]) -> Iterator[Line]:
    """What people call the arguments of a job, behind ///COMMENT of //ARGINFO, is any text."""
    inside = told = False
    for line in islice(lines, _MOST_LINES):
        if not (inside and told) or line.text.startswith("//"):
            yield line
            told = line.text == "///COMMENT"
            if line.text[2:3] != "/":
                inside = line.text == "//ARGINFO"


INFORM = Language(__package__, joined=_without_argument_names, signed=True, letters=r"\w$-")
