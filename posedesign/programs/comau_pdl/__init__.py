"""Comau PDL2 programs, of joint positions.

A file ``NAME.pdl``: ``MOVE JOINT TO {...}`` to each position, which stands in it. The measuring
call is the routine ``R_MEASURE`` of another program, which exports it (``ROUTINE R_MEASURE(n :
INTEGER) EXPORTED FROM MEASURE GLOBAL``). Touched-up positions are typed into the moves. Nothing was
translated, nor loaded on a controller; joints are those of the description: arms with parallel
links show joint 3 in another way.

Read are the joint values in degrees that moves go to, all of them: ``{...}``, there or in a
variable of the program. Poses (``POS(...)``), and positions that are taught into variables
(``.var``), are left out. Computed and relative moves are unread.

Rules: ``syntax``: lines are as in the grammar; other statements are noted. ``block``: the program,
routines, branches and loops are closed, by their names. ``position``, ``range``: six to ten plain
numbers, joints within +-720 deg, speeds from 1 to 100 percent, times not negative. ``name``: system
variables and their values are none that are nearly known. To measure, ``name``: variables are
declared, and routines imported; ``standstill``, ``wait-to-measure``: a MOVE without ADVANCE, and a
DELAY, before an output is set or a routine called.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from lark import Tree

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.joint_programs import PLAIN, DescribedDialect, Standing
from posedesign.programs.language import Block, Language, Statement, subtrees, text_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import measuring, near
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases

LANGUAGE = Language(
    __package__ or "",
    joined=language.without_remarks(r"--.*", r"('[^'\n]*')"),
    signed=True,
    letters=r"\w",
)

SIGNATURES = signatures.table("""
delay ms:number[0,]
$prog_spd_ovr,$arm_spd_ovr,$jnt_ovr percent:number[1,100]
""")

_FIRST = re.compile(r"(\$?[a-z]\w*)")
_WORDS = """program import routine begin end var const type move movefly to joint linear circular
delay if then else endif select case endselect for endfor while endwhile repeat until of do"""
_OTHERS = "with wait signal pause hold open close write read call return goto attach"
_SYSTEM = """$move_type $term_type $prog_spd_ovr $arm_spd_ovr $jnt_ovr $dout $din $aout $ain $uframe
$tool $base $fly_type $fly_traj $fly_dist $lin_spd $rot_spd $spd_opt $ornt_type $jnt_mturn
$cnfg_care $turn_care $sing_care $stress_per $timer"""
_VALUES = """joint linear circular seglinear fine coarse nosettle jnt_fine jnt_coarse on off true
false rs_world fly_cart fly_norm fly_pass spd_lin"""
_ATTRIBUTES = r"(ez|(no)?hold|attach|detach|const|(stack|priority|prog_arm) *= *\d+)\b.*"
_BLOCKS = {
    "begin": Block("end"),
    "branch": Block("close", ("divide",)),
    "loop": Block("again"),
}


def _values(tree: Tree) -> list[str] | None:  # type: ignore[type-arg]
    """Texts of the joint values that an expression is; None: it is no such."""
    found = re.fullmatch(r"\{([^{}]*)\}", text_of(tree))
    return found[1].split(",") if found else None


def _events(text: str) -> Iterator[Event]:
    """What the steps give to variables, and where they move."""
    statements = LANGUAGE.statements(text)
    own = {
        text_of(subtrees(s.tree)[0]).lower().partition(".")[0]
        for s in statements
        if s.kind == "assign" and "{" in s.text
    }
    several = sum(s.kind == "begin" for s in statements) > 1
    several |= any(re.search(r"\bgoto\b", s.text, re.I) for s in statements)
    depth = 0
    for s in statements:
        depth += (s.kind in ("branch", "loop")) - (s.kind in ("close", "again"))
        inside = several or depth > 0
        if s.kind == "move":
            target = subtrees(s.tree)[0]
            values, name = _values(target), text_of(target).lower()
            via = "{" in s.word("REST")
            if values and all(map(PLAIN.fullmatch, values)) and not via:
                yield Go(s.row, Values(s.row, tuple(values)), inside)
            elif values or "{" in name or via or name.partition("[")[0] in own:
                reason = "" if name in own and not via else f"{s.text[:60]!a}: no list of numbers"
                yield Go(s.row, name, inside, reason)
            elif {*re.findall(r"\w+", name)} & own:
                yield Go(s.row, "", inside, f"{s.text[:60]!a}: is computed")
        elif s.kind == "assign":
            place, value = subtrees(s.tree)
            name, _, part = text_of(place).lower().partition(".")
            if name not in own and name.partition("[")[0] in own:  # a joint of a position
                name, part = name.partition("[")[0], name
            values = _values(value) or []
            plain = bool(values) and all(map(PLAIN.fullmatch, values)) and not part
            if name.partition("[")[0] in {n.partition("[")[0] for n in own}:
                yield Give(s.row, name, Values(s.row, tuple(values)) if plain else None, inside)
        elif s.fault or s.kind in ("other", "call"):
            if re.search(r"\bmove|\{", s.text, re.I):
                yield Go(s.row, "", inside, f"a position cannot be read: {s.fault or s.text[:40]}")
            names = {*re.findall(r"\w+", s.text.lower())} & own
            yield from (Give(s.row, name, None, inside) for name in sorted(names))


def _check(statements: list[Statement]) -> Iterator[Problem]:
    yield from language.block_faults(statements, _BLOCKS)
    names = {s.word("NAME").lower() for s in statements if s.kind in ("program", "routine")}
    known = names | {w.lower() for s in statements if s.kind == "declare" for w in s.words("NAME")}
    called = " ".join(s.word("NAME").lower() for s in statements if s.kind == "call")
    imports = any(s.kind == "import_" for s in statements)
    standing = Standing(("MOVE without ADVANCE", "DELAY"))
    for s in statements:
        if s.fault or s.kind == "other":
            told = joints.not_known(s, _FIRST, f"{_WORDS} {called}", _OTHERS)
            wrong = s.fault and re.search(r"[{}]|:=|^\$|^\w+\W?\(", s.text)
            yield replace(told, level="error") if wrong else told
        if s.kind == "program" and not re.match(f"({_ATTRIBUTES})?$", s.word("REST"), re.I):
            yield Problem(s.row, "syntax", f"{s.word('REST')[:40]!a} is no attribute")
        if s.kind == "end" and s.word("NAME").lower() not in names:
            yield Problem(s.row, "block", f"{s.text[:40]!a} ends nothing of that name")
        if s.kind == "delay":
            given = map(text_of, subtrees(s.tree))
            yield from joints.check_step(s.row, SIGNATURES, "delay", given)
        if s.kind == "call" and not imports and s.word("NAME").lower() not in names:
            yield measuring(s.row, "name", f"{s.word('NAME')[:40]} is not there, nor imported")
        if s.kind == "assign":
            yield from _check_assign(s, known)
        if s.kind == "move":
            yield from _check_move(s)
        fly = re.search(r"\badvance\b", s.word("REST"), re.I) or s.word("MOVE").lower() == "movefly"
        moves = s.kind == "move" or bool(s.kind != "assign" and re.match(r"move", s.text, re.I))
        output = s.kind == "assign" and re.match(r"\$dout\b.*(on|true)$", s.text, re.I)
        measures = s.kind == "call" or bool(output)
        yield from standing.check(
            s.row, moves, s.kind == "move" and not fly, s.kind == "delay", measures
        )


def _check_assign(s: Statement, known: set[str]) -> Iterator[Problem]:
    place, value = (text_of(part).lower() for part in subtrees(s.tree))
    name = re.split(r"[.\[(]", place)[0]
    if name[0] == "$":
        meant = near(name, _SYSTEM.split(), least=5)
        if meant:
            yield Problem(s.row, "name", f"{name[:40]} is nearly {meant}")
        if name in SIGNATURES:
            yield from joints.check_step(s.row, SIGNATURES, name, [value])
        if name in ("$move_type", "$term_type", "$dout") and re.fullmatch(r"[a-z]\w*", value):
            if value not in _VALUES.split() and value not in known:
                yield Problem(s.row, "name", f"{value[:40]} is no value of {name}")
        elif name == "$dout" or (name in ("$move_type", "$term_type") and value[:1] != "$"):
            yield Problem(s.row, "name", f"{value[:40]} is no value of {name}")
        if name == "$dout" and not re.match(r"\$dout\[[^,]+\]$", place):
            yield Problem(s.row, "name", f"{place[:40]} is no output")
    elif name not in known:
        yield measuring(s.row, "name", f"{name[:40]} is not declared")


def _check_move(s: Statement) -> Iterator[Problem]:
    target = subtrees(s.tree)[0]
    values, text = _values(target), text_of(target)
    if values:
        yield from joints.check_joints(s.row, values, most=10)
    elif text[0] in "'(-." or text[0].isdigit():
        yield Problem(s.row, "position", f"{text[:40]} is no position")
    rest = s.word("REST")
    if rest and not re.match(r"(via|with|advance|until|nodal|break)\b", rest, re.I):
        yield Problem(s.row, "syntax", f"{rest[:30]!a} cannot stand behind a move")


class ComauPdl(DescribedDialect):
    """Programs of Comau arms of six joints; joints are those of the description."""

    name = "comau-pdl"
    title = "Comau PDL2 program"
    maker = None
    suffixes = (".pdl",)
    remark = (r"^PROGRAM [^\n]*\n", "-- {words}")
    names = NameRule(
        "a PDL2 name", 30, small=True, reserved=frozenset(f"{_WORDS} {_OTHERS}".upper().split())
    )
    newline = "\r\n"
    limits = replace(joints.LIMITS, outputs=(1, 512))
    phrases = Phrases(
        note="  -- {}",
        move=("  MOVE JOINT TO {{{target}}}",),
        wait="  DELAY {ms:.0f}",
        pulse=("  $DOUT[{output}] := ON", "  DELAY {ms:.0f}", "  $DOUT[{output}] := OFF"),
        call=("  R_{call}({argument})",),
    )
    head = ("  $MOVE_TYPE := JOINT", "  $TERM_TYPE := FINE", "  $PROG_SPD_OVR := {percent}")
    reader = joints.in_moves(_events, joints.remark_lines("--"), None)
    rules = joints.judged(LANGUAGE, ("program",), _check)

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The program around the steps."""
        call = program.options.measure_call
        imported = [f"IMPORT '{call}'"] if call else []
        return [f"PROGRAM {program.name}", *imported, "BEGIN", *steps, f"END {program.name}"]
