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
from dataclasses import dataclass, field

from lark import Token, Tree

from posedesign.programs import rules
from posedesign.programs.language import Statement, block_faults
from posedesign.programs.recorded import Problem
from posedesign.programs.ur_script import reader
from posedesign.programs.ur_script.functions import FUNCTIONS, MOVES, PARAMETERS, POSES
from posedesign.programs.ur_script.log import is_log
from posedesign.programs.ur_script.reader import BLOCKS, JOINTS, Node, shown

_REPORT = re.compile(r'"POSE (\d{1,6}) q="')
_ZERO = re.compile(r"0*\.?0*")
_DIGITS = re.compile(r"\d")

_MOST_JOINT_RAD = math.radians(363.0) + 1e-6
_MOST_M = 10.0
_MOST_TURN_RAD = 12.6
_MOST_SPEEDS = {"a": 40.0, "v": 6.3}
_MOST_OUTPUT = 7

_NUMBERS = {*"avtrnm"}
"""Parameters that are numbers."""

_NO_NUMBERS = {"TRUE", "FALSE", "STRING", "comparison", "list", "pose"}
_NO_WORDS = {"nan", "inf", "none", "null", "true", "false"}
_SHORTEST = 3
"""Letters of a name that a misspelt one is told by."""

_MOST_NAMES = 2000
"""Of a script in which misspelt ones are looked for."""


def check_ur_script(data: bytes) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good script. Never fails."""
    if is_log(data):
        return [Problem(1, "log", "this is the log of a run, for which there are no rules")]
    found = reader.LANGUAGE.statements(
        data.decode("latin-1")
    )  # any byte is a character: none is lost
    return rules.told(
        rules.check_bytes(data, rules.CONTROL, ("text", *rules.LONE_CR[1:])),
        [] if found else [Problem(1, "program", "there is nothing in it")],
        rules.syntax(found),
        block_faults(found, BLOCKS),
        _Script(found).check(),
    )


@dataclass
class _Uses:
    """What a statement uses: functions, poses, texts, and variables."""

    calls: list[tuple[str, list[tuple[str, Node]]]] = field(default_factory=list)
    poses: list[Tree[Token]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def collect(self, tree: Tree[Token]) -> None:
        """Take what is in a tree."""
        children: Sequence[Node] = tree.children
        kind, first = tree.data, children[0] if children else None
        if kind == "call" and isinstance(first, Token):
            self.calls.append((str(first), reader.arguments(tree)))
            children = children[1:]
        elif kind == "run":
            self.calls.append((str(children[1]), reader.arguments(tree)))
            children = children[2:]
        elif kind == "member":
            children = children[:1]
        elif kind == "argument" and len(children) > 1:
            children = children[2:]
        elif kind == "pose":
            self.poses.append(tree)
        for child in children:
            if isinstance(child, Tree):
                self.collect(child)
            elif child.type == "NAME":
                self.names.append(str(child))
            elif child.type == "STRING":
                self.texts.append(str(child))


class _Script:
    """The statements of a script, and the names that it defines."""

    def __init__(self, found: Sequence[Statement]) -> None:
        self.found = found
        self.functions: dict[str, tuple[int, tuple[str, ...]] | None] = {}
        self.variables = {"True", "False"}
        for statement in found:
            children = statement.tree.children
            if statement.kind in ("define", "thread", "secondary"):
                self._define(str(children[0]), [p.children for p in children[1:]])  # type: ignore[union-attr]
            elif statement.kind == "assign" and isinstance(children[0], Token):
                self.variables.add(str(children[0]))
        self.known = self.functions.keys() | FUNCTIONS
        self._told: set[str] = set()
        self._measures = any(_REPORT.search(statement.text) for statement in found)
        self._has_tcp = self._is_blended = self._moved = False
        self._moves = 0
        self._reported: set[str] = set()

    def _define(self, name: str, parameters: Sequence[Sequence[Node]]) -> None:
        names = tuple(str(children[0]) for children in parameters)
        least = sum(len(children) == 1 for children in parameters)
        self.functions[name] = None if name in self.functions else (least, names)
        self.variables.update(names)

    def check(self) -> Iterator[Problem]:
        """Problems of all statements that the grammar takes."""
        called: dict[str, int] = {}
        for statement in self.found:
            uses = _Uses()
            uses.collect(statement.tree)
            yield from self._check_names(statement, uses)
            for name, given in uses.calls:
                called.setdefault(name, statement.row)
                yield from self._check_call(name, given, statement.row)
            for pose in uses.poses:
                yield from _check_pose(pose, statement.row)
            yield from self._check_measuring(uses, statement.row)
        if "freedrive_mode" in called and "end_freedrive_mode" not in called and self._moved:
            reason = "freedrive is never ended: the arm does not move then"
            yield Problem(called["freedrive_mode"], "freedrive", reason, "measuring")

    def _check_names(self, statement: Statement, uses: _Uses) -> Iterator[Problem]:
        if statement.kind in ("define", "thread", "secondary"):
            return
        moves = any(name in MOVES for name, _ in uses.calls)
        for name in uses.names:
            if name not in self.variables:
                yield from self._unknown(name, statement.row, "variable", matters=moves)

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
        own = name in self.functions
        signature = self.functions[name] if own else PARAMETERS.get(name)
        if signature is None:
            return
        least, parameters = signature
        known = {*parameters, "q", "pose"} if name in MOVES else {*parameters}
        keywords = [keyword for keyword, _ in given if keyword]
        odd = sorted({*keywords} - known)
        if odd:
            yield Problem(row, "arguments", f"{name} has no {odd[0][:30]}")
        elif len({*keywords}) < len(keywords):
            yield Problem(row, "arguments", f"{name}: an argument is given twice")
        elif any(given[k][0] and not given[k + 1][0] for k in range(len(given) - 1)):
            yield Problem(row, "arguments", f"{name}: an argument without a name behind one with")
        elif not least <= len(given) <= len(parameters):
            reason = f"{name} has {len(given)} arguments, not {least} to {len(parameters)}"
            yield Problem(row, "arguments", reason)
        elif not own:
            yield from _check_values(name, reader.by_name(name, given), row)

    def _check_measuring(self, uses: _Uses, row: int) -> Iterator[Problem]:
        """Whether the arm is, and stands still, where it is measured."""
        names = {name for name, _ in uses.calls}
        self._has_tcp = self._has_tcp or "set_tcp" in names
        for name, given in uses.calls:
            if name in MOVES:
                radius = reader.by_name(name, given).get("r")
                self._is_blended = radius is not None and not _ZERO.fullmatch(shown(radius))
                self._moves += 1
                self._moved = True
                if uses.poses and not self._has_tcp:
                    reason = "no set_tcp above: whose pose is it?"
                    yield Problem(row, "tcp", reason, "measuring")
        report = next((m for m in map(_REPORT.fullmatch, uses.texts) if m), None)
        asks = names & {"popup", "request_boolean_from_primary_client"}
        if self._is_blended and (report or asks):
            reason = "the move before has a blend radius: the arm does not stop"
            yield Problem(row, "stop-to-measure", reason, "measuring")
        if report is None:
            return
        reasons = {
            f"POSE {report[1]} is reported twice": report[1] in self._reported,
            "no move since the report before": not self._moves,
            "without the actual joint positions: get_actual_joint_positions()": (
                "get_actual_joint_positions" not in names
            ),
        }
        yield from (Problem(row, "report", r, "measuring") for r, holds in reasons.items() if holds)
        self._reported.add(report[1])
        self._moves = 0


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


def _check_values(name: str, given: dict[str, Node], row: int) -> Iterator[Problem]:
    """Arguments of URScript's own functions."""
    for key, value in given.items():
        kind = value.data if isinstance(value, Tree) else value.type
        what = f"{name}: {key} is {shown(value)[:60]}"
        if key in _NUMBERS and kind in _NO_NUMBERS:
            yield Problem(row, "arguments", f"{what}, no number")
        elif kind == "list" and (name, key) in POSES:
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
        yield Problem(row, "arm-position", "get_inverse_kin without qnear", "measuring")
    n = _number(given.get("n")) if name == "set_standard_digital_out" else None
    if n is not None and not 0 <= n <= _MOST_OUTPUT:
        yield Problem(row, "output", f"output {n:g}, not 0 to {_MOST_OUTPUT}")
    if name == "movej":
        yield from _check_movej(given, row)


def _check_movej(given: dict[str, Node], row: int) -> Iterator[Problem]:
    target = given.get("q")
    if isinstance(target, Tree) and target.data == "pose":
        reason = "movej to a pose: the controller chooses the arm position"
        yield Problem(row, "arm-position", reason, "measuring")
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


def _number(node: Node | None) -> float | None:
    """The number that an expression is, where it is one."""
    text = shown(node)
    last = node.children[-1] if isinstance(node, Tree) and node.data == "sign" else node
    return float(text) if isinstance(last, Token) and last.type == "NUMBER" else None
