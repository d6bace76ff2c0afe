"""Universal Robots URScript programs (``.script``): what the grammar cannot say.

Nothing was run on a controller.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``text``               no control characters
``log``                it is a script: there are no rules for the log of a run
``program``            there is something in it
``syntax``             the grammar
``block``              each def, thread, if, while is closed by its end
``function``           a function that is called is URScript's or defined; an unknown one is a note,
                       unless it is nearly the name of a known one; measuring: in a script that
                       reports poses
``variable``           as for functions; measuring: an unknown one in a move
``arguments``          calls have as many arguments as they need, no keywords but theirs, and
                       numbers where numbers are due
``joints``             joints that are moved to are six, and numbers within +-363 deg [rad]
``pose``               a pose has six values, numbers within 10 m and two turns; and no joints where
                       a pose is due
``speed``              a > 0 and v > 0 for ``movej``; measuring: up to 40 rad/s2 and 6.3 rad/s
``range``              times are not negative, and registers those that there are
``output``             standard digital outputs are 0 to 7
``arm-position``       measuring: no ``movej(p[...])``, ``get_inverse_kin`` has qnear: else the
                       controller chooses the arm position
``tcp``                measuring: the TCP is set before poses are moved to
``stop-to-measure``    measuring: no blend radius in the last move before a report or a question
``freedrive``          measuring: freedrive is ended
``report``             measuring: each ``POSE n q=`` is reported once, after a move of its own, with
                       the actual joint positions
=====================  ==========================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from lark import Token, Tree

from posedesign.programs import rules
from posedesign.programs.language import Node, Statement, block_faults, is_a, nodes, subtrees
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import measuring
from posedesign.programs.signatures import Argument, Signature
from posedesign.programs.ur_script import reader
from posedesign.programs.ur_script.reader import BLOCKS, JOINTS, MOST_OUTPUT, MOVES, POSES, shown

_REPORT = re.compile(r'"POSE (\d{1,6}) q="')
_ZERO = re.compile(r"0*\.?0*")
_DIGITS = re.compile(r"\d")

_MOST_JOINT_RAD = math.radians(reader.MOST_LIMIT_DEG) + 1e-6
_MOST_M = 10.0
_MOST_TURN_RAD = 12.6
_MOST_SPEEDS = {"a": 40.0, "v": 6.3}

_NO_NUMBERS = {"TRUE", "FALSE", "STRING", "comparison", "list", "pose"}
_NO_WORDS = {"nan", "inf", "none", "null", "true", "false"}
_VALUED = {"movej", "get_inverse_kin", "set_standard_digital_out"}  # of values besides positions
_SHORTEST = 3  # letters of a name that a misspelt one is told by
_MOST_NAMES = 2000  # of a script in which misspelt ones are looked for
_ASKS = {"popup", "request_boolean_from_primary_client"}
_DEFINES = ("define", "thread", "secondary")


def check_ur_script(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good script. Never fails."""
    if reader.is_log(data):
        return [Problem(1, "log", "this is the log of a run, for which there are no rules", "note")]
    text = data.decode("latin-1").replace("\r\n", "\n")  # any byte is a character
    found = reader.LANGUAGE.statements(text)
    return rules.told(
        rules.check_bytes(data, rules.CONTROL, ("text", *rules.LONE_CR[1:])),
        [] if found else [Problem(1, "program", "there is nothing in it")],
        rules.syntax(found),
        block_faults(found, BLOCKS),
        _Script(found).check(),
    )


class _Script:
    """The statements of a script, and the names that it defines."""

    def __init__(self, found: Sequence[Statement]) -> None:
        self.found = found
        self.functions: dict[str, Signature | None] = {}
        self.variables = {"True", "False"}
        for statement in found:
            if statement.kind not in (*_DEFINES, "assign"):
                continue
            first = statement.tree.children[0]
            if statement.kind in _DEFINES:
                parameters = [parameter.children for parameter in subtrees(statement.tree)]
                own = " ".join(f"{c[0]}{'?' * (len(c) > 1)}" for c in parameters)
                twice = str(first) in self.functions
                self.functions[str(first)] = None if twice else Signature.parse(f"{first} {own}")
                self.variables.update(str(children[0]) for children in parameters)
            elif isinstance(first, Token):
                self.variables.add(str(first))
        self.known = self.functions.keys() | reader.FUNCTIONS
        self._told: set[str] = set()
        self._measures = any(_REPORT.search(statement.text) for statement in found)
        self._has_tcp = self._is_blended = False
        self._moves = 0
        self._reported: set[str] = set()

    def check(self) -> Iterator[Problem]:
        called: dict[str, int] = {}
        yield from rules.judged(self.found, self._check_statement)
        for statement in self.found:
            names = statement.words("FUNCTION")
            for name in names:
                called.setdefault(name, statement.row)
            texts = statement.words("STRING")
            if names or texts:
                yield from self._check_measuring(statement, {*names}, texts)
        moved = not called.keys().isdisjoint(MOVES)
        if "freedrive_mode" in called and "end_freedrive_mode" not in called and moved:
            said = "freedrive is never ended: the arm does not move then"
            yield measuring(called["freedrive_mode"], "freedrive", said)

    def _check_statement(self, statement: Statement) -> Iterator[Problem]:
        """What is wrong with a statement, whatever stands before it."""
        row, moves = statement.row, bool(statement.once(_moves))
        for name in statement.words("NAME") if statement.kind not in _DEFINES else ():
            if name not in self.variables:
                yield from self._unknown(name, row, "variable", matters=moves)
        for tree in statement.all("call", "run"):
            for token in tree.children[:2]:
                if isinstance(token, Token) and token.type == "FUNCTION":
                    yield from self._check_call(str(token), reader.arguments(tree), row)
        for pose in statement.all("pose"):
            yield from _check_pose(pose, row)
        yield from _check_operands(statement)

    def _unknown(self, name: str, row: int, rule: str, *, matters: bool) -> Iterator[Problem]:
        if name in self._told and not matters:
            return
        self._told.add(name)
        is_variable = rule == "variable"
        near = _nearly(name, self.variables if is_variable else self.known, is_variable=is_variable)
        if near:
            yield Problem(row, rule, f"{name[:40]} is nearly {near}")
        elif name.lower() in _NO_WORDS or name in self.known:
            yield Problem(row, rule, f"{name} is no variable")
        else:
            reason = f"{name[:40]} is given nowhere in the script"
            yield Problem(row, rule, reason, "measuring" if matters else "note")

    def _check_call(self, name: str, given: list[tuple[str, Node]], row: int) -> Iterator[Problem]:
        if name not in self.known:
            yield from self._unknown(name, row, "function", matters=self._measures)
        own = self.functions.get(name) if name in self.functions else reader.SIGNATURES.get(name)
        if own is None:
            return
        arguments = [Argument("", word, _kind(v), _number(v, math.nan)) for word, v in given]
        faults = list(own.faults(arguments))
        if faults:  # texts of positions are long, and of most calls not asked for
            told = (a._replace(shown=shown(v)) for a, (_, v) in zip(arguments, given, strict=True))
            faults = list(own.faults([*told]))
        yield from (Problem(row, rule, said) for rule, said in faults)
        valued = name in _VALUED or any(is_a(v, "list") or is_a(v, "pose") for _, v in given)
        if valued and name not in self.functions and not faults:
            yield from _check_values(name, reader.by_name(name, given), row)

    def _check_measuring(
        self, statement: Statement, names: set[str], texts: list[str]
    ) -> Iterator[Problem]:
        """Whether the arm is, and stands still, where it is measured."""
        row = statement.row
        self._has_tcp = self._has_tcp or "set_tcp" in names
        if moves := statement.once(_moves):
            self._moves += moves
            self._is_blended = not all(map(_ZERO.fullmatch, statement.texts(_radius)))
            if not self._has_tcp and statement.one("pose"):
                yield from [measuring(row, "tcp", "no set_tcp above: whose pose is it?")] * moves
        report = next(filter(None, map(_REPORT.fullmatch, texts)), None)
        if self._is_blended and (report or names & _ASKS):
            said = "the move before has a blend radius: the arm does not stop"
            yield measuring(row, "stop-to-measure", said)
        if report is None:
            return
        if report[1] in self._reported:
            yield measuring(row, "report", f"POSE {report[1]} is reported twice")
        if not self._moves:
            yield measuring(row, "report", "no move since the report before")
        if "get_actual_joint_positions" not in names:
            said = "without the actual joint positions: get_actual_joint_positions()"
            yield measuring(row, "report", said)
        self._reported.add(report[1])
        self._moves = 0


def _moves_in(tree: Tree[Token]) -> list[Tree[Token]]:
    return [call for call in nodes(tree, "call") if str(call.children[0]) in MOVES]


def _moves(statement: Statement) -> int:
    """Number of moves in a statement."""
    return len(_moves_in(statement.tree))


def _radius(tree: Tree[Token]) -> list[Node]:
    """Blend radius of the last move, where it has one."""
    call = _moves_in(tree)[-1]
    radius = reader.by_name(str(call.children[0]), reader.arguments(call)).get("r")
    return [] if radius is None else [radius]


def _nearly(name: str, known: Collection[str], *, is_variable: bool) -> str:
    """A known name that differs by one letter; empty for none.

    Of three letters one was lost. Variables that differ in a digit, or in a part of one or two
    letters (``tm_s`` and ``tm_e``), are two.
    """
    size = len(name)
    if size < _SHORTEST or len(known) > _MOST_NAMES:
        return ""
    near = rules.near(name, known, least=_SHORTEST + (size == _SHORTEST))
    parts, others = name.split("_"), near.split("_")
    differ = [(a, b) for a, b in zip(parts, others, strict=False) if a != b]
    if is_variable and (
        _DIGITS.sub("", near) == _DIGITS.sub("", name)
        or any(min(len(a), len(b)) < _SHORTEST for a, b in differ)
    ):
        return ""
    return near


_CONDITIONS = ("if_", "elif_", "while_")
_TRUTHS = re.compile(r'"|\b(?:not|and|or|xor|True|False)\b')
_WORD_OF = {"STRING": "text", "TRUE": "flag", "FALSE": "flag", "NUMBER": "number"}
_KIND_OF = {
    **dict.fromkeys(("list", "pose"), ""),
    **dict.fromkeys(("comparison", "negation", "conjunction"), "flag"),
    **dict.fromkeys(("product", "sign"), "number"),
}


def _kind(node: Node) -> str:
    """Kind of a value as the text tells it, by the words of `signatures`; else empty."""
    if isinstance(node, Token):
        return _WORD_OF.get(node.type, "")
    if node.data == "group":
        return _kind(node.children[1])
    return _KIND_OF.get(node.data, "") or (str(node.data) if node.data in _KIND_OF else "")


def _check_operands(statement: Statement) -> Iterator[Problem]:
    """Rule ``arguments`` of texts and lists where a truth or a number is due."""
    if statement.kind not in _CONDITIONS and not _TRUTHS.search(statement.text):
        return
    conditions = statement.tree.children if statement.kind in _CONDITIONS else []
    truths = [t.children for t in statement.all("negation", "conjunction")]
    for found in (conditions, *truths):
        wrong = next((n for n in found if _kind(n) in ("text", "list", "pose")), None)
        if wrong is not None:
            yield Problem(statement.row, "arguments", f"{shown(wrong)[:60]} is no condition")
    for tree in statement.all("product", "sign"):
        wrong = next((n for n in tree.children if _kind(n) in ("text", "flag")), None)
        if wrong is not None:
            yield Problem(statement.row, "arguments", f"{shown(wrong)[:60]} is no number")


def _check_values(name: str, given: dict[str, Node], row: int) -> Iterator[Problem]:
    for key, value in given.items():
        kind = value.data if isinstance(value, Tree) else ""
        if kind not in ("list", "pose"):
            continue
        what = f"{name}: {key} is {shown(value)[:60]}"
        if kind == "list" and (name, key) in POSES:
            yield Problem(row, "pose", f"{what}, no pose p[...]")
        elif kind == "list" and key in ("q", "qnear"):
            values = _numbers(value)
            if len(values) != JOINTS or any(v and abs(v) > _MOST_JOINT_RAD for v in values):
                yield Problem(row, "joints", f"{what}, not six joint values in radians")
        elif kind == "pose" and key == "qnear":
            yield Problem(row, "joints", f"{what}, no joints")
        elif kind == "list" and key == "cog" and len(_numbers(value)) != 3:
            yield Problem(row, "arguments", f"{what}, not three numbers")
    if name == "get_inverse_kin" and "qnear" not in given:
        yield measuring(row, "arm-position", "get_inverse_kin without qnear")
    n = _number(given.get("n")) if name == "set_standard_digital_out" else None
    if n is not None and not 0 <= n <= MOST_OUTPUT:
        yield Problem(row, "output", f"output {n:g}, not 0 to {MOST_OUTPUT}")
    if name == "movej":
        yield from _check_movej(given, row)


def _check_movej(given: dict[str, Node], row: int) -> Iterator[Problem]:
    target = given.get("q")
    if isinstance(target, Tree) and target.data == "pose":
        said = "movej to a pose: the controller chooses the arm position"
        yield measuring(row, "arm-position", said)
    if not _ZERO.fullmatch(shown(given.get("t"))):
        return  # the time says how fast
    for key, most in _MOST_SPEEDS.items():
        value = _number(given.get(key))
        if value is not None and not 0 < value <= most:
            reason = f"{key} is {value:g}, not above 0 up to {most:g}"
            yield Problem(row, "speed", reason, "measuring" if value > 0 else "error")


def _check_pose(pose: Tree[Token], row: int) -> Iterator[Problem]:
    values = _numbers(pose)
    if len(values) == 1:
        return  # an element of a variable p
    far = any(v and abs(v) > _MOST_M for v in values[:3])
    turned = any(v and abs(v) > _MOST_TURN_RAD for v in values[3:])
    if len(values) != JOINTS or far or turned:
        yield Problem(row, "pose", f"{shown(pose)[:60]} is not six numbers in metres and radians")


def _numbers(node: Node) -> list[float | None]:
    """Elements of a list or a pose, None for an expression; nothing where one can be no number."""
    found = reader.elements(node) if isinstance(node, Tree) else []
    if any(isinstance(child, Token) and child.type in _NO_NUMBERS for child in found):
        return []
    return [_number(child) for child in found]


def _number(node: Node | None, none: Any = None) -> Any:
    """A number as it stands there; ``none`` for anything else."""
    last = node.children[-1] if isinstance(node, Tree) and node.data == "sign" else node
    return float(shown(node)) if isinstance(last, Token) and last.type == "NUMBER" else none
