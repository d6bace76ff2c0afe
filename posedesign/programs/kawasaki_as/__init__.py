"""Kawasaki AS programs, of joint positions.

A file ``NAME.as`` as controllers save and load it: the program, then its positions ``#NAME.p[1]``,
``#NAME.p[2]``, ... ``BREAK`` behind every move has the arm stop there, also where it passes only.
Touched-up positions are taught into ``#NAME.p[n]``; or, with ``keep = "register"``, ``HERE`` stores
them in ``#NAME.m[n]`` behind the call. Nothing was loaded on a controller.

A file that is read may hold programs, lists and settings of a whole controller. Positions are those
of lists of joint values (``.JOINTS``) and, in a file that no plan has marked, of steps
(``#[...]``). Transformations (``.TRANS``) are as often frames, tools or shifts, and are left out.
Those of the program with the mark of a plan have their numbers in their names, ``#NAME.p[3]``;
where it keeps touched-up ones, ``#NAME.m[3]`` takes their place. Controllers save names in small
letters.

Rules: ``syntax``: lines are as in the grammar; other instructions are noted. ``block``: sections,
loops and branches are closed. ``position``, ``range``: as many plain values each, six at least,
joints within +-720 deg, speeds from 0.01 to 100 percent, outputs from 1 to 999 or from 2001 to 2960
(in the controller). To measure, ``target``: moves go to positions that are in the file, where it
has lists. ``standstill``, ``wait-to-measure``: BREAK behind each move, and a wait. ``speed``: set
for each move. ``unused``: all of an array is moved to.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lark import Token, Tree

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, rules, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import JOINTS, JointDialect, Notes, Standing, Stored, listed
from posedesign.programs.language import (
    Block,
    Language,
    Line,
    Statement,
    lines_of,
    nodes,
    subtrees,
    text_of,
)
from posedesign.programs.numbering import NO_NAME, Numbering
from posedesign.programs.program import PoseProgram
from posedesign.programs.reading import refuse
from posedesign.programs.reading import text_of as text_of_file
from posedesign.programs.recorded import PlanMark, Problem, RecordedProgram
from posedesign.programs.rules import measuring
from posedesign.programs.signatures import Signature
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases, plain_all, shown_deg

SIGNATURES = signatures.table("""
speed percent:number[0.01,100] rotation?:number[0.01,100]
wait seconds:number[0,]
pulse output:whole[1,999] seconds?:number[0,]
""")
SIGNATURES |= {"pulse inside": Signature.parse("pulse output:whole[2001,2960] seconds?:number[0,]")}
"""What steps are given (AS language reference manual, 90209-1017DEB); outputs in the controller."""

_LISTS = ("joints", "trans")
_SECTION = re.compile(r"\.([a-z]\w*)(?=\s*$|\s+[^=\s])", re.I)
_NOTE = re.compile(r"\s*(?:\.PROGRAM\s+([\w.]{1,99})|;\s*(.*)|HERE\s+#[\w.]+\[(\d{1,5})\])", re.I)

_WORDS = """.program .joints .trans .end jmove lmove break twait delay stable pulse call here point
speed if else for while case value do until end"""
_OTHERS = """wait swait scall hmove xmove cmove c1move c2move home home2 base type print ret return
any"""
_FIRST = re.compile(r"(?:\d+ +)?(\.?[a-z]\w*)")
_MOTION = re.compile(r"home|t?draw\b|drive|align|[lj](appro|depart)|\w+move", re.I)
_NOT_JUDGED = re.compile(
    r"(\d+ +)?([.$#\w]+(\[[^\]]*\])* *=(?!=)|[\w.]+ *:|(if\b.*)?\bgoto\b)", re.I
)
_LITERAL = re.compile(r"#?[a-z_][\w.]*(\[[\d,]+\])?")
_BLOCKS = {
    "program": Block("finish"),
    "list": Block("finish"),
    "branch": Block("end", ("divide",)),
    "repeat": Block("until"),
}


_without_remarks = language.without_remarks(r";.*|^\.\*.*", marks=";*")


def _sections(lines: Iterator[Line]) -> Iterator[Line]:
    """Lines of programs and lists, and the heads of all sections."""
    inside = ""
    for line in _without_remarks(lines):
        text = line.text
        head = _SECTION.match(text)
        if head:
            was, inside = inside, head[1].lower()
            if inside == "end" and was not in ("program", *_LISTS, "end", ""):
                continue
        elif inside in _LISTS:
            text = ",".join(text.split())
        elif inside not in ("program", "end", ""):
            continue
        yield Line(line.row, text)


LANGUAGE = Language(__package__ or "", joined=_sections, signed=True, letters=r"\w.")


def _planned(text: str, path: Path) -> tuple[str, Notes, tuple[int, int] | None]:
    """Name and remarks of the program of a plan, and what its first HERE keeps of which pose."""
    first: tuple[int, int] | None = None
    name, notes, first = found = "", Notes(), first
    for line in lines_of(text):
        program, remark, element = ((m := _NOTE.match(line.text)) and m.groups()) or ("", "", "")
        if program:
            name, notes, first = program.lower(), Notes(), None
        elif remark:
            notes.take(line.row, remark)
        elif element and not first and notes.rows:
            first = int(element), [*notes.rows.values()][-1]
        if notes.mark and found[1].mark and name != found[0]:
            refuse("two programs are of a plan", path, line.row, "save them one by one")
        if notes.mark:
            found = name, notes, first
    return found


def parse_kawasaki_as(data: bytes, path: Path) -> RecordedProgram:
    """Program in the content of a file; FileFormatError where it holds no position."""
    text = text_of_file(data, path)
    name, notes, first = _planned(text, path)
    found: list[Stored] = []
    taught: list[Stored] = []
    statements = LANGUAGE.statements(text)
    for s in statements:
        if s.fault and s.text[:1] == "#":
            refuse(f"a position cannot be read: {s.fault}", path, s.row)
        if s.kind == "position" and s.text[0] == "#":
            found.append(Stored(s.word("ENTRY").lower(), s.row, s.words("NUMBER")))
        elif s.kind in ("move", "taught") and notes.mark is None:
            steps = [[text_of(value) for value in nodes(t, "sum")] for t in s.all("inline")]
            taught += [Stored("", s.row, values) for values in steps]
    rows = {p.variable: p.line for p in found}
    found, unread = joints.as_moved(found, _events(statements), path)
    found = sorted([*found, *taught], key=lambda p: rows.get(p.variable, p.line))
    if notes.mark is None:
        name, notes, first = path.stem, Notes(), None
    numbered, element = (re.compile(rf"#{re.escape(name)}\.{x}\[(\d{{1,5}})\]") for x in "pm")
    own = numbered if notes.mark else NO_NAME
    numbering = Numbering(own, element, notes.mark, notes.names, first)
    positions = listed(numbering, found, path, joints.joints_of)
    mark, untouched = notes.mark or PlanMark(), numbering.is_untouched(found)
    return RecordedProgram(
        *(name, "", mark, positions, "kawasaki"), empty_registers=untouched, unread=tuple(unread)
    )


def _events(statements: list[Statement]) -> Iterator[Event]:
    """What the steps give to joint positions, and which ones they move to."""
    several = sum(s.kind == "program" for s in statements) > 1  # in which order nobody knows
    several |= any(re.search(r"\bgoto\b", s.text, re.IGNORECASE) for s in statements)
    depth = 0
    for s in statements:
        depth += (s.kind in ("branch", "repeat")) - (s.kind in ("end", "until"))
        inside = several or depth > 0
        if s.kind not in ("here", "point", "move"):
            continue
        own = [place for place in _places(s) if place[0] == "#"]
        first = _places(s)[:1] if own else []
        if s.kind in ("here", "point") and own[:1] == first and first:
            values = s.texts(_inline)
            plain = values and all(map(joints.PLAIN.fullmatch, values))
            yield Give(
                s.row, first[0].upper(), Values(s.row, tuple(values)) if plain else None, inside
            )
        elif s.kind == "move" and own and own[:1] == first:
            yield Go(s.row, own[0].upper(), inside)


def _check(statements: list[Statement]) -> Iterator[Problem]:
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    for s in statements:
        if (s.fault or s.kind in ("other", "section")) and not _NOT_JUDGED.match(s.text):
            yield joints.not_known(s, _FIRST, f"{_WORDS} {called}", _OTHERS)
    yield from language.block_faults(statements, _BLOCKS)
    yield from _check_positions(statements)
    yield from _check_steps(statements)


def _places(s: Statement) -> list[str]:
    return s.kept(lambda s: [*map(str.lower, s.texts_of("place"))])


def _inline(tree: Tree[Token]) -> list[Tree[Token]]:
    """Values of a position that stands in a step."""
    return [value for part in nodes(tree, "inline") for value in nodes(part, "sum")]


def _check_positions(statements: list[Statement]) -> Iterator[Problem]:
    entries = [s for s in statements if s.kind == "position"]
    listed = [(s, s.word("ENTRY").lower(), s.words("NUMBER")) for s in entries]
    counts = Counter(name for _, name, _ in listed)
    size = max(JOINTS, min((len(v) for _, name, v in listed if name[0] == "#"), default=0))
    moves = [s for s in statements if s.kind == "move"]
    moved = {place for s in moves for place in _places(s)}
    arrays = {place.partition("[")[0] for place in moved if place[0] == "#" and place[-1] == "]"}
    single: list[Statement] = []
    for s, name, values in listed:
        if counts[name] > 1 or (name[0] == "#" and len(values) != size):
            yield Problem(s.row, "position", f"{name[:40]} is no position, or there twice")
        elif name[0] == "#":
            single.append(s)
        if name.partition("[")[0] in arrays and name not in moved:
            yield Problem(s.row, "unused", f"{name[:40]} is never moved to", "measuring")
    yield from rules.judged(
        single, lambda s: joints.check_joints(s.row, s.words("NUMBER"), most=size)
    )
    known = {*counts, *(_places(s)[0] for s in statements if s.kind in ("here", "point"))}
    for s in moves if listed else ():
        for place in set() if "(" in s.text else {*_places(s)} - known:
            if _LITERAL.fullmatch(place):
                yield measuring(s.row, "target", f"{place[:40]} is not in the file")


def _check_steps(statements: list[Statement]) -> Iterator[Problem]:
    speed, standing = "", Standing(("BREAK", "TWAIT"))
    for s in statements:
        if s.kind == "program":
            speed, standing = "", Standing(("BREAK", "TWAIT"))
        if s.kind == "move":
            if not speed:
                yield Problem(s.row, "speed", "no SPEED is set for this move", "measuring")
            speed = speed if speed == "always" else ""
        if s.kind == "speed":
            speed = "always" if s.word("ALWAYS") else "once"
        if s.kind == "pulse":  # outputs are in two ranges
            yield from _check_step(s)
        moves = s.kind in ("move", "taught") or bool(s.kind == "other" and _MOTION.match(s.text))
        stops, measures = s.kind in ("stop", "taught"), s.kind in ("call", "pulse", "here")
        yield from standing.check(s.row, moves, stops, s.kind == "wait", measures)
    steps = (s for s in statements if s.kind in ("speed", "wait"))
    yield from rules.judged(steps, _check_step)


def _check_step(s: Statement) -> Iterator[Problem]:
    first = text_of(Tree("", s.tree.children[:1]))
    inside = s.kind == "pulse" and re.fullmatch(r"2\d{3}", first)  # of the controller
    if not (s.kind == "speed" and (s.word("UNIT") or not first)):
        given, step = map(text_of, subtrees(s.tree)), s.kind + " inside" * bool(inside)
        yield from joints.check_step(s.row, SIGNATURES, step, given)


class KawasakiAs(JointDialect):
    """Programs of Kawasaki arms with their joint positions."""

    name = "kawasaki-as"
    title = "Kawasaki AS program"
    maker = "kawasaki"
    suffixes = (".as", ".pg")
    remark = (r"^\.PROGRAM[^\n]*\n", "  ; {words}")
    # names of variables have at most 15 characters, two of which are ".p"; case does not matter
    names = NameRule("a name of an AS program", 13, small=True)
    newline = "\r\n"
    keeps = True
    phrases = Phrases(
        note="  ; {}",
        move=("  JMOVE #{name}.p[{number}]", "  BREAK"),
        wait="  TWAIT {time:.3f}",
        pulse=(
            "  PULSE {output},{time:.3f}",
            "  TWAIT {time:.3f}",
        ),  # a pulse does not hold the program up
        call=("  CALL {call}({argument})",),
        keep="  HERE #{name}.m[{register}]",
    )
    head = ("  SPEED {percent} ALWAYS",)
    external_axes = 6
    turning_axes = True
    limits = replace(joints.LIMITS, outputs=(1, 999))  # inputs are numbered from 1001
    reader = parse_kawasaki_as
    rules = joints.judged(LANGUAGE, ("program", "position"), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The program, and its positions."""
        rows = zip(program.numbers, shown_deg(arm, program.poses), strict=True)
        listed = [f"#{program.name}.p[{n}] {' '.join(plain_all(row, 6))}" for n, row in rows]
        return [f".PROGRAM {program.name}()", *steps, ".END", ".JOINTS", *listed, ".END"]
