"""Denso PacScript programs, of joint positions.

A file ``NAME.pcs``: a ``Move`` to each position, which stands in it. ``@E`` has the arm stop there,
its encoders asked, before the next step. The measuring call is another program. Touched-up
positions are typed into the moves; positions in the controller's variables (``J[1]``) are not in
the file. Nothing was loaded on a controller.

Read are the joint values ``J(...)`` that ``Move`` goes to, there or in a variable of the program;
moves to what is computed of these are refused. Positions in variables of the controller have no
values in the file, and poses (``P(...)``) none that say which posture takes them: both are left
out. Numbers are those of remarks ``' POSE n`` in front of the moves, where a program has the mark
of a plan; others in their order, behind all.

Rules: ``syntax``: lines are as in the grammar, of 1024 characters at most; other commands are
noted. ``block``: routines, loops and branches are closed. ``main``: there is a routine Main, or a
program. ``arm``: the arm is taken before it moves. ``position``: ``J`` has six to eight plain
numbers. ``range``: joints within +-720 deg, speeds from 0.1 to 100 percent. ``standstill``,
``wait-to-measure``: a move that stops (``@0``, ``@E``), and a Delay, before an output is set or a
program called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from lark import Token, Tree

from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import (
    PLAIN,
    Found,
    JointDialect,
    Standing,
    check_joints,
    in_moves,
    judged,
    level_of,
)
from posedesign.programs.language import (
    Block,
    Language,
    Statement,
    block_faults,
    nodes,
    subtrees,
    text_of,
    without_remarks,
)
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import refuse
from posedesign.programs.recorded import Problem
from posedesign.programs.writing import NameRule, Phrases

__all__ = ["DensoPac"]

LANGUAGE = Language(
    __package__ or "",
    joined=without_remarks(r"'.*|^\s*rem\b.*"),
    signed=True,
    letters=r"\w",
)

_MOVE = re.compile(r"\bmove\b")
_JOINT = re.compile(r"(\bmove\b.*|=.*)\bj *\(")
_NAME = re.compile(r"\b[a-z]\w*[!#%$&]?")
_JOINTS = re.compile(r"\bj *\(")

_WORDS = """sub end program move delay set reset call takearm givearm speed dim if then else elseif
for next do loop while wend select case keep"""
_OTHERS = "wait depart approach draw drive drivea rotate motor print printdbg accel decel let send"
_MOTION = re.compile(r"(depart|approach|draw|drivea?|rotateh?|archmove)\b", re.I)
_BLOCKS = {
    "sub": Block("finish"),
    "branch": Block("close", ("divide",)),
    "loop": Block("again"),
}


def _joints_in(tree: Tree[Token]) -> list[str] | None:
    """Texts of the values of the ``J(...)`` that an expression is; None: it is no such."""
    text = text_of(next(nodes(tree, "sum")))
    group = next(nodes(tree, "group"), None)
    if group is None or not re.fullmatch(r"[jJ]\([^()]*\)", text):
        return None
    return [text_of(value) for value in subtrees(group)]


def _targets(s: Statement) -> Iterator[tuple[str, str, list[str] | None]]:
    """How a move stops at each of its targets, the expression, and the joints that it is."""
    for target in nodes(s.tree, "target") if s.kind == "move" else ():
        stop = target.children[0]
        how = str(stop).upper() if isinstance(stop, Token) else "@0"
        yield how, text_of(next(nodes(target, "sum"))), _joints_in(target)


Variables = dict[str, list[str] | None]
"""Texts of the values of joint variables; None: it had some, and may have others now."""


def _bases(variables: Variables) -> set[str]:
    """Names of the variables, without an index; those of the controller are not told of."""
    return {name.partition("[")[0] for name in variables} - {"j"}


def _change(s: Statement, variables: Variables) -> None:
    """Take the values that a statement gives to variables, and forget those it may change."""
    text = s.text.lower()
    if s.fault or s.kind in ("other", "call"):
        words = set(_NAME.findall(text))
        variables |= dict.fromkeys(v for v in variables if v.partition("[")[0] in words)
        variables |= dict.fromkeys(re.findall(r"#define +(\w+) .*\bj *\(", text))
    trees = subtrees(s.tree)
    for k, place in enumerate(trees if s.kind in ("assign", "dim") else ()):
        if place.data != "place":
            continue
        name, value = text_of(place).lower(), next(iter(trees[k + 1 : k + 2]), place)
        base, _, index = name.partition("[")
        values = _joints_in(value) if value.data == "sum" else None
        if index and not index[:-1].isdigit():
            variables |= dict.fromkeys(v for v in variables if v.partition("[")[0] == base)
            values = None
        if value.data != "sum":
            variables.pop(name, None)
        elif values or name in variables or _JOINTS.search(text_of(value).lower()):
            variables[name] = values


def _positions(text: str, path: Path) -> list[Found]:
    """Positions that the program moves to."""
    found: list[Found] = []
    variables: Variables = {}
    for s in LANGUAGE.statements(text):
        low = s.text.lower() if s.fault else ""
        moved = set(_NAME.findall(low)) & _bases(variables) if _MOVE.search(low) else ()
        if moved or _JOINT.search(low):
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        for _, target, joints in _targets(s):
            name = target.lower()
            values = joints or variables.get(name)
            known = set(_NAME.findall(name)) & _bases(variables) or name in variables
            if not all(map(PLAIN.fullmatch, values or ())) or (
                not values and (known or _JOINTS.search(name))
            ):
                refuse(f"{s.text[:60]!a}: no list of numbers", path, s.row)
            found += [("the position", s.row, values)] if values else []
        _change(s, variables)
    return found


def _check(statements: list[Statement]) -> Iterator[Problem]:
    if statements[0].text[:7].lower() != "program":
        yield from block_faults(statements, _BLOCKS)
        if not any(s.kind == "sub" and s.word("NAME").lower() == "main" for s in statements):
            yield Problem(1, "main", "there is no routine Main")
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    standing, taken = Standing(("stop", "Delay")), False
    for s in statements:
        if s.fault or s.kind == "other" or len(s.text) > 1024:
            word = re.match(r"[#*]?[a-z]\w*(?! *[,@)\]])|", s.text.lower())
            level = level_of(word[0] if word else "", f"{_WORDS} {called}", _OTHERS)
            yield Problem(s.row, "syntax", s.fault or f"{s.text[:40]!a} is not known", level)
        taken = taken or s.kind == "arm"
        if s.kind == "move" and not taken:
            yield Problem(s.row, "arm", "no TakeArm before this move")
        speed = text_of(next(nodes(s.tree, "sum"))) if s.kind == "speed" else "1"
        if PLAIN.fullmatch(speed[:9]) and not 0.1 <= float(speed[:9]) <= 100:
            yield Problem(s.row, "range", "a speed is from 0.1 to 100 percent")
        targets = list(_targets(s))
        for _, text, values in targets:
            if text[0] in '(-".' or text[0].isdigit():
                yield Problem(s.row, "position", f"{text[:40]} is no position")
            if values is not None:
                yield from check_joints(s.row, values, most=8)
        moves = s.kind == "move" or _MOTION.match(s.text) is not None
        stops = s.kind == "move" and all(how in ("@0", "@E") for how, *_ in targets)
        measures = s.kind == "call" or (s.kind == "output" and s.text[:1].lower() == "s")
        stops = stops and not s.word("NEXT")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)


class DensoPac(JointDialect):
    """Programs of Denso arms with an RC8 or RC9 controller."""

    name = "denso-pac"
    title = "Denso PacScript program"
    maker = "denso"
    suffixes = (".pcs",)
    remark = (r"^[ \t]*(?:Sub|Program)[ \t][^\n]*\n", "  ' {words}")
    names = NameRule("a PacScript name", 32, small=True)  # no limit of its length is known
    newline = "\r\n"
    phrases = Phrases(
        note="  ' {}",
        move=("  Move P, @E J({target})",),
        wait="  Delay {ms:.0f}",
        pulse=("  Set IO[{output}]", "  Delay {ms:.0f}", "  Reset IO[{output}]"),
        call=("  Call {call}({argument})",),
        bare=("  Call {call}",),
    )
    head = ("  TakeArm Keep = 0", "  Speed {percent}")
    reader = in_moves(_positions, "'", "denso")
    rules = judged(LANGUAGE, ("sub",), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The routine that a program begins with."""
        return ["Sub Main", *steps, "End Sub"]
