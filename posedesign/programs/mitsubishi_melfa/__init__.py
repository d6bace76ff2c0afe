"""Mitsubishi MELFA-BASIC V and VI programs, of joint positions.

A file ``NAME.mb5`` of numbered steps, with the positions J1, J2, ... in a list behind them, as RT
ToolBox saves them. Touched-up positions are taught into J1, J2, ... themselves. Nothing was loaded
on a controller, and poses are not written: structure flags are not known well enough.

Additional axes, which carry the arm or a part, are J7 and J8 behind the six joints of a joint
position, in mm or deg as a parameter of the controller says (CR1D, 4.3.13): those of a rail are
written and read in mm.

Read is the list behind the steps: joints in degrees, poses in mm and degrees. ``J3`` of a program
that carries the mark of a plan is the pose of number 3; other positions are numbered behind, in
their order. Poses are taken without their structure flags, of which public sources do not say the
signs for every arm: the plan settles which posture is meant. That A, B, C turn about fixed X, Y and
Z is from RoboDK's post-processor alone. Positions that were defined, but never taught, have empty
flags, ``(,)``, and are left out.

Rules: ``syntax``: steps and positions are as in the grammar; another command is noted. ``step``:
numbers of steps, where they have any, rise from 1 to 32767, with 127 characters at most.
``position``: six to eight plain numbers (joints: one to eight), each name once. ``range``: joints
within +-720 deg, overrides from 1 to 100 percent. ``target``: moves go to positions that are in the
list, or defined.
``wait-to-measure``: Dly between a move and CallP. ``unused``: all joint positions of the list are
moved to.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lark import Token, Tree

from calib.errors import InputError
from posedesign.programs import joint_programs as joints
from posedesign.programs import language, rules, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import JOINTS, JointDialect, Notes, Standing, Stored, listed
from posedesign.programs.language import (
    Language,
    Node,
    Statement,
    lines_of,
    subtrees,
    text_of,
    words,
)
from posedesign.programs.notation import Notation
from posedesign.programs.numbering import NO_NAME, Numbering
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import joint_deg, millimetres, pose_values, poses_of, refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import Level, PlanMark, Problem, RecordedProgram
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases, plain_all, shown_deg

_NOTE = re.compile(r"\d{1,5} ?'(.*)")
_PLANNED = re.compile(r"J([1-9]\d{0,4})", re.IGNORECASE | re.ASCII)

_COMMANDS = "mov mvs dly m_out jovrd ovrd spd cnt servo callp end hlt return wait hopen hclose"
_OTHERS = """open close print input if else elseif endif for next while wend select case on dim fine
nvopen nvclose emvs emov espd"""
_STEP = re.compile(r"\s*(?:\d{1,5} +)?([A-Za-z]\w*)(?: .*)?")


LANGUAGE = Language(
    __package__ or "",
    joined=language.without_remarks(
        r"^\s*\d+ *'.*|'.*", marks="'"
    ),  # of a step that is nothing else, too
    signed=True,
    letters=r"\w",
)


SIGNATURES = signatures.table("""
override percent:number[1,100] percent_2?:number[1,100] percent_3?:number[1,100]
dly seconds:number[0,]
""")
"""What steps are given (CR1D detailed explanation of functions, 4.3)."""

_Entry = tuple[str, list[str], bool, str]
"""Name, values, whether they are numbers, flags; empty of a step."""

_NONE: _Entry = ("", [], False, "")
_GIVEN = re.compile(r"\b([jp]\w*)(?:\.\w+|\([^()]*\))*\s*=(?!=)", re.IGNORECASE)
_MOVED = re.compile(r"\bmo?vs?\s+([jp]\w*)", re.IGNORECASE)
_ANY_ORDER = re.compile(r"\b(goto|gosub|for|while|select|if\b.*\bthen$)\b", re.IGNORECASE)
"""Where it stands, steps may run in another order, or not."""


def _entries(statements: list[Statement]) -> tuple[list[_Entry], bool]:
    """Entries of the list, and whether steps have numbers: entries have none, nor what computes.

    Where steps have none, what another entry behind the steps gives again is a step.
    """
    return language.shared(("melfa entries", id(statements)), lambda: _found(statements))


def _found(statements: list[Statement]) -> tuple[list[_Entry], bool]:
    numbered = any(s.once(_has_number) for s in statements)
    found = [_entry_of(s, numbered) for s in statements]
    end = max((k for k, (name, *_) in enumerate(found) if not name), default=0)
    behind = {name.upper() for name, *_ in found[end:]} if not numbered else set()
    steps = (k < end and name.upper() in behind for k, (name, *_) in enumerate(found))
    return [_NONE if is_step else e for e, is_step in zip(found, steps, strict=True)], numbered


def _has_number(s: Statement) -> bool:
    return any(isinstance(child, Token) for child in s.tree.children[:1])


def _body(tree: Tree[Token]) -> list[Tree[Token]]:
    """What a step does, behind its number and label."""
    return subtrees(tree)[-1:]


def _does(s: Statement) -> str:
    return "" if s.fault else _body(s.tree)[0].data


def _given(tree: Tree[Token]) -> list[Tree[Token]]:
    """What is told of a step: a target, times, percents."""
    return [part for body in _body(tree) for part in subtrees(body)]


def _place(tree: Tree[Token]) -> list[Tree[Token]]:
    return _given(tree)[:1]


def _group(tree: Tree[Token]) -> list[Tree[Token]]:
    """Values between the brackets that a variable is given."""
    return [value for part in _given(tree)[1:2] if part.data == "group" for value in subtrees(part)]


def _flags(tree: Tree[Token]) -> list[Tree[Token]]:
    return _given(tree)[2:3]


def _are_numbers(s: Statement) -> bool:
    return all(value.data == "number" for value in _group(s.tree))


def _entry_of(s: Statement, numbered: bool) -> _Entry:
    if s.once(_does) != "assignment" or s.once(_is_step):
        return _NONE
    values, plain = s.texts(_group), s.once(_are_numbers)
    if not numbered and not (values and plain):
        return _NONE
    return s.texts(_place)[0], values, plain, next(iter(s.texts(_flags)), "none")


def _is_step(s: Statement) -> bool:
    return len(s.tree.children) > 1


def parse_mitsubishi_melfa(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    said = [(line.row, n[1]) for line in lines_of(text) if (n := _NOTE.fullmatch(line.text))]
    notes = Notes(next((mark for _, note in said if (mark := PlanMark.found_in(note))), None))
    for row, note in said:
        notes.take(row, note)
    found: list[Stored] = []
    statements = LANGUAGE.statements(text)
    entries = zip(statements, _entries(statements)[0], strict=True)
    for statement, (name, values, plain, flags) in entries:
        if statement.fault and re.match(r"\s*[JPjp]\w*[^=\"']*=", statement.text):
            refuse(f"a position cannot be read: {statement.fault}", path, statement.row)
        if name[:1].upper() not in ("J", "P") or flags == ",":
            continue
        if not plain:
            refuse(f"{name} is no list of numbers", path, statement.row)
        found.append(Stored(name, statement.row, values))
    found, unread = joints.as_moved(found, _events(statements), path)
    numbered = _PLANNED if notes.mark else NO_NAME
    numbering = Numbering(numbered, mark=notes.mark, names=notes.names)
    of_seven = any(p.variable[0] in "Jj" and len(p.values) == JOINTS + 1 for p in found)
    positions = listed(numbering, found, path, _values_of, rest=not of_seven)
    ordered = tuple(sorted(positions, key=lambda position: position.number))
    mark = notes.mark or PlanMark()
    return RecordedProgram(path.stem, "", mark, ordered, None, unread=tuple(unread))


def _events(statements: list[Statement]) -> Iterator[Event]:
    """What the steps give to positions, and which ones they move to."""
    inside = any(_ANY_ORDER.search(s.text) for s in statements)
    for s, (entry, *_) in zip(statements, _entries(statements)[0], strict=True):
        does = s.once(_does)
        if s.fault:
            yield from (Give(s.row, n, None, True) for n in _GIVEN.findall(s.text.upper()))
            yield from (Go(s.row, n, True) for n in _MOVED.findall(s.text.upper()))
        elif does == "move":
            yield Go(s.row, _as_listed(s.texts(_place)[0]), inside)
        elif does == "assignment" and not entry:
            numbers, (place,) = s.texts(_group), s.nodes(_place)
            plain = len(numbers) > 1 and s.once(_are_numbers)
            first, *rest = place.children
            part = any(isinstance(child, Token) for child in rest)
            name = str(first).upper() if part else _as_listed(text_of(place))
            value = Values(s.row, tuple(numbers)) if plain and not part else None
            yield Give(s.row, name, value, inside)


def _as_listed(place: str) -> str:
    """A variable as the list has it, elements in brackets; text that no variable has of another."""
    return place.upper().replace("(", "[").replace(")", "]")


def _values_of(p: Stored, path: Path) -> dict[str, Any]:
    """Values of a position; those behind six are of axes that carry the arm, or a part.

    Seven joint values are all kept: they are an arm's with seven joints, or of one on a rail.
    """
    turned, at = p.variable[0] in "Jj", (p.label, path, p.line)
    texts = p.values[:JOINTS] if len(p.values) > JOINTS + turned else p.values
    if len(texts) < (1 if turned else JOINTS):
        refuse(f"{p.label} has {len(texts)} values", path, p.line)
    if not turned:
        return {"T_user_tool": poses_of(pose_values(texts, "XYZABC", *at))[0]}
    shown = [joint_deg(t, *at) for t in texts[:JOINTS]]
    return {"shown_deg": np.array(shown + [millimetres(t, *at) for t in texts[JOINTS:]])}


def _check(statements: list[Statement]) -> Iterator[Problem]:
    entries, numbered = _entries(statements)
    names = [name.upper() for name, *_ in entries]
    counts = Counter(names)
    known = {w.upper() for s in statements for t in s.all("definition") for w in words(t, "NAME")}
    known |= {s.texts(_place)[0].upper() for s in statements if s.once(_does) == "assignment"}
    moved: set[str] = set()
    step, standing = 0, Standing(("", "Dly"))
    for s, name, entry in zip(statements, names, entries, strict=True):
        if s.fault:
            yield Problem(s.row, "syntax", s.fault, _level(s.text))
            continue
        if name:
            yield from _check_position(s.row, entry, counts[name] > 1)
            continue
        first, does = s.texts(_first)[0], s.once(_does)
        own = int(first) if re.fullmatch(r"\d{1,5}", first) else 0
        if (numbered and not step < own <= 32767) or len(s.text) > 127:
            yield Problem(s.row, "step", f"step {own} behind {step}, {len(s.text)} characters")
        step = max(step, own)
        if does == "move":
            target = s.texts(_place)[0].upper()
            moved.add(target)
            if target not in known and re.fullmatch(r"[JP][A-Z0-9]*", target):
                level: Level = "error" if any(names) else "note"  # lists are saved apart as well
                yield Problem(s.row, "target", f"{target[:40]} is not in the list", level)
        if does in ("move", "dly", "call"):
            moves = does == "move"  # and an arm stops behind every move
            yield from standing.check(s.row, moves, moves, does == "dly", does == "call")
    steps = (s for s, name in zip(statements, names, strict=True) if not name)
    steps = (s for s in steps if s.once(_does) in SIGNATURES)
    yield from rules.judged(steps, _check_step)
    for s, name in zip(statements, names, strict=True):
        if name.startswith("J") and name not in moved:
            yield Problem(s.row, "unused", f"{name[:40]} is never moved to", "measuring")


def _first(tree: Tree[Token]) -> list[Node]:
    return tree.children[:1]


def _check_step(s: Statement) -> Iterator[Problem]:
    return joints.check_step(s.row, SIGNATURES, s.once(_does), s.texts(_given))


def _level(text: str) -> Level:
    """Error for a step that begins with a word of the grammar, or nearly; others may be options."""
    found = _STEP.fullmatch(text)
    word = found[1].lower() if found else ""
    if word in _OTHERS.split():
        return "error" if text.lower().endswith(" on") else "note"  # On says of what
    near = word in _COMMANDS.split() or rules.near(word, _COMMANDS.split(), alike=0.7)
    return "error" if near or not word or re.fullmatch(r"[jpm]\d*", word) else "note"


def _check_position(row: int, entry: _Entry, twice: bool) -> Iterator[Problem]:
    name, values, plain, _ = entry
    turned = name[0] in "Jj"
    if twice or not (values and plain) or not JOINTS * (not turned) <= len(values) <= 8:
        yield Problem(row, "position", f"{name[:40]} is no position, or there twice")
    elif turned:
        yield from joints.check_joints(row, values, most=8, least=1)


SIGNS = "signs of the joints, which are those of the robot's description"
EXTERNAL = "zero, direction and unit of J{}, taken to be those of {} in the description, in mm"


class MitsubishiMelfa(JointDialect):
    """Programs of MELFA arms; joints are those of the description, whatever the pendant shows."""

    name = "mitsubishi-melfa"
    title = "Mitsubishi MELFA-BASIC program"
    maker = None
    suffixes = (".mb5", ".mb6", ".prg")
    begins = re.compile(
        rb"^[ \t]*\d{1,5} +[a-z*']|^[ \t]*(mov|mvs|servo|jovrd|dly)\b|^[ \t]*[jp]\w*=\([-+\d.]",
        re.IGNORECASE | re.MULTILINE,
    )
    remark = (r"(?:^\d+ [^\n]*\n)+", "{number} '{words}")
    names = NameRule("a MELFA program name", 12)
    newline = "\r\n"
    phrases = Phrases(
        note="'{}",
        move=("Mov J{number}",),
        wait="Dly {time:.3f}",
        pulse=("M_Out({output})=1 Dly {time:.3f}",),
        call=('CallP "{call}",{argument}',),
        bare=('CallP "{call}"',),
    )
    head = ("Servo On", "Cnt 0", "JOvrd {percent}")
    notation = Notation(joint=5)
    external_axes = 2
    reader = parse_mitsubishi_melfa
    rules = joints.judged(LANGUAGE, ("statement",), _check)

    def most_poses(self, program: PoseProgram) -> int | None:
        return 3000  # of eight steps, of 32,767

    def render(self, program: PoseProgram, arm: Arm) -> dict[str, str]:
        """The file; the arm has to fit into joint positions."""
        if arm.n > 8:
            raise InputError("a joint position has at most 8 values", name="poses", value=arm.n)
        if arm.n_external and arm.n - arm.n_external != JOINTS:
            raise InputError(
                f"additional axes stand behind six joints, the arm has {arm.n - arm.n_external}",
                hint="hold the slide where it is: robot.held_mm",
                name="poses",
            )
        return super().render(program, arm)

    def unchecked(self, arm: Arm) -> tuple[str, ...]:
        """Signs of joints, and what additional axes count: the maker's arms differ in both."""
        external = arm.joint_names[JOINTS:] if arm.n_external else ()
        numbered = enumerate(external, start=JOINTS + 1)
        return (SIGNS, *(EXTERNAL.format(k, name) for k, name in numbered))

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """Numbered steps, and the positions behind them."""
        rows = zip(program.numbers, shown_deg(arm, program.poses), strict=True)
        listed = [f"J{number}=({','.join(plain_all(row, 5))})" for number, row in rows]
        return [f"{k} {step}" for k, step in enumerate([*steps, "End"], start=1)] + listed
