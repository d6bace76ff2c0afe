"""Epson SPEL+ programs, of joint positions.

A file ``NAME.prg`` with one function of the program's name: call it from ``main``, or run it from
the Run window. ``Go AglToPls(...)`` to each position, which stands in it. The measuring call is
another function of the project. Touched-up positions are typed into the moves. Nothing was loaded
on a controller; joints are those of the description, as makers' arms differ in their signs.

By the manual ``Go AglToPls(...)`` reaches exactly these joints. ``JA(...)`` does not where joint 5
is at 0, to 0.0005 deg: the arm takes other values of J4 and J6. A point that was given either, and
``Move`` and arcs to them, may end at other joints, too. So written is AglToPls; read are plain
numbers in ``Go AglToPls(...)``, and in ``Go JA(...)`` with joint 5 off 0. Moves to what else is
computed of these are unread. Points (``P1``, ``XY(...)``, files ``.pts``) are poses, and public
sources disagree on how U, V and W turn: they are left out.

Rules: ``syntax``: lines are as in the grammar; other commands are noted. ``block``: functions,
loops and branches are closed. ``position``, ``range``: six to nine plain numbers, joints within
+-720 deg, speeds from 1 to 100 percent, outputs from 0 on, times not negative. To measure,
``standstill``, ``wait-to-measure``: a Go without CP, and a Wait, before an output is set or a
function called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import PLAIN, DescribedDialect, Standing
from posedesign.programs.language import Block, Language, Statement, nodes, subtrees, text_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Level, Problem
from posedesign.programs.rules import near
from posedesign.programs.straight_line import Event, Go, Values
from posedesign.programs.writing import NameRule, Phrases

LANGUAGE = Language(
    __package__ or "",
    joined=language.without_remarks(r"'.*"),
    signed=True,
    letters=r"\w",
)

SIGNATURES = signatures.table("""
speed percent:number[1,100] depart?:number[1,100] approach?:number[1,100]
accel up:number[1,200] down:number[1,200] a?:number b?:number c?:number d?:number
wait seconds:number[0,]
output bit:number[0,] seconds?:number[0.01,10] parallel?
""")
"""What commands are given (SPEL+ Language Reference)."""

_MADE = re.compile(r"\b(agltopls|ja)\b", re.I)
_MOTION = re.compile(
    r"(jump\w*|move|arc3?|pass|b?go|tgo|tmove|bmove|cvmove|home|pulse|p?j?tran)\b", re.I
)
_FIRST = re.compile(r"#?([a-z_]\w*)")
_WORDS = """function fend motor power speed accel go wait on off call if then else elseif endif
select send case default for next do loop while wend agltopls ja high
low"""
_OTHERS = """jump move arc pass home pulse pause print input here tool local int real long short
byte boolean string double goto gosub exit quit reset fine speeds accels
speedr to as"""
_POINTS = "p xy ja agltopls pallet here pls align xylim st x y z u v w tlx tly tlz tlu tlv tlw"
_BLOCKS = {
    "function": Block("finish"),
    "branch": Block("close", ("divide",)),
    "loop": Block("again"),
}
_UNREAD = ("other", "single", "fault")  # kinds of statements of which only words are known
_STRAIGHT_DEG = 0.0005
"""Of joint 5: nearer to 0 a controller takes other joints 4 and 6."""


def _joints_in(s: Statement) -> tuple[str, list[str]] | None:
    """Function that a target is, and the texts of its joint values; None: it is no such."""
    target = text_of(next(nodes(s.tree, "sum")))
    found = re.fullmatch(r"(agltopls|ja)\([^()]*\)", target, re.I)
    if found is None:
        return None
    return found[1].lower(), [text_of(a) for a in subtrees(next(nodes(s.tree, "group")))]


def _events(text: str) -> Iterator[Event]:
    """Where the moves go."""
    statements = LANGUAGE.statements(text)
    given = {
        text_of(subtrees(s.tree)[0]).lower()
        for s in statements
        if s.kind == "assign" and _MADE.search(s.text)
    }
    for s in statements:
        if s.kind == "go" and (told := _joints_in(s)):
            name, values = told
            plain = all(map(PLAIN.fullmatch, values))
            straight = (
                name == "ja" and plain and len(values) > 4 and abs(float(values[4])) < _STRAIGHT_DEG
            )
            reason = "joint 5 is at 0, where JA takes other joints 4 and 6" if straight else ""
            reason = reason if plain else f"{s.text[:60]!a}: no list of numbers"
            yield Go(s.row, "" if reason else Values(s.row, tuple(values)), fault=reason)
        elif _MADE.search(s.text) and s.kind != "assign":
            yield Go(s.row, "", fault=f"{s.text[:60]!a}: joints are not sure to be these")
        elif s.kind == "go" or (s.kind in _UNREAD and _MOTION.search(s.text)):
            low = s.text.lower()
            if named := next(
                (n for n in sorted(given) if re.search(rf"\b{re.escape(n)}(?!\w)", low)), ""
            ):
                yield Go(
                    s.row, "", fault=f"{named} is a point: joints are not sure to be the given"
                )


def _check(statements: list[Statement]) -> Iterator[Problem]:
    yield from language.block_faults(statements, _BLOCKS)
    own = " ".join(s.word("NAME").lower() for s in statements if s.kind in ("function", "call"))
    standing = Standing(("Go without CP", "Wait"))
    for s in statements:
        if s.fault or s.kind == "other":
            yield joints.not_known(s, _FIRST, f"{_WORDS} {own}", _OTHERS)
        if s.kind in SIGNATURES:
            first = s.words("NUMBER", "NAME")[:1] if s.kind == "output" else []
            yield from joints.check_step(
                s.row, SIGNATURES, s.kind, [*first, *map(text_of, subtrees(s.tree))]
            )
        yield from _check_target(s) if s.kind == "go" else ()
        told = _joints_in(s) if s.kind == "go" else None
        if told is not None:
            yield from joints.check_joints(s.row, told[1], most=9)
        if s.kind == "call" and s.word("NAME").lower() in _WORDS.split():
            yield Problem(s.row, "syntax", f"{s.text[:40]!a} is no command")
        moves = s.kind == "go" or (s.kind in _UNREAD and bool(_MOTION.match(s.text)))
        stops = s.kind == "go" and not re.search(r"\bcp\b", s.word("REST"), re.I)
        measures = s.kind == "call" or (s.kind == "output" and s.text[:2].lower() == "on")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)


def _check_target(s: Statement) -> Iterator[Problem]:
    target = text_of(next(nodes(s.tree, "sum")))
    if target[0] in '(-".' or target[0].isdigit():
        yield Problem(s.row, "position", f"{target[:40]} is no position")
    for place in nodes(s.tree, "place"):
        name, arguments = str(place.children[0]).lower(), [*nodes(place, "argument")]
        if name not in _POINTS.split() and arguments:
            level: Level = "error" if len(arguments) > 3 or near(name, _POINTS.split()) else "note"
            yield Problem(s.row, "position", f"{name[:40]} is no function of a point", level)


class EpsonSpel(DescribedDialect):
    """Programs of Epson arms of six joints; joints are those of the description."""

    name = "epson-spel"
    title = "Epson SPEL+ program"
    suffixes = (".prg",)
    begins = re.compile(rb"^[ \t]*function[ \t]+[a-z_]\w*", re.IGNORECASE | re.MULTILINE)
    remark = (r"^[ \t]*Function[ \t][^\n]*\n", "  ' {words}")
    names = NameRule(
        "an Epson name", 32, small=True, reserved=frozenset(f"{_WORDS} {_OTHERS}".upper().split())
    )
    newline = "\r\n"
    limits = replace(joints.LIMITS, outputs=(0, 511))
    phrases = Phrases(
        note="  ' {}",
        move=("  Go AglToPls({target})",),
        wait="  Wait {time:.3f}",
        pulse=("  On {output}", "  Wait {time:.3f}", "  Off {output}"),
        call=("  Call {call}({argument})",),
        bare=("  Call {call}",),
    )
    head = ("  Motor On", "  Power High", "  Speed {percent}")
    reader = joints.in_moves(_events, joints.remark_lines("'"), None)
    rules = joints.judged(LANGUAGE, ("function",), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The function of the program."""
        return [f"Function {program.name}", *steps, "Fend"]
