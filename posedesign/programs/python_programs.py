"""Programs in Python that a computer runs: what dialects of such programs share.

They are parsed by Python's own parser, and never run.
"""

from __future__ import annotations

import ast
import builtins
import keyword
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

from posedesign.programs import joint_programs as joints
from posedesign.programs import language
from posedesign.programs.language import Line
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import CONTROL, check_bytes, measuring, near, told
from posedesign.programs.signatures import Argument, Signature
from posedesign.programs.straight_line import Event, Give, Go, Values

_MOST_CHARACTERS = 3_000_000  # of a program that is parsed: ten times those of 10,000 poses
_QUOTED = re.compile(r"""\"[^\"\n]*\"|'[^'\n]*'|#[^\n]*""")
_UNDERSCORED = re.compile(r"(?<![\w.])\d[\d.]*_[\w.]*")
_SILENT = (ast.Constant, ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop)

RESERVED = frozenset(
    word.upper()
    for word in [
        *(*keyword.kwlist, "input", "print", "arm", "robot", "check", "code", "number"),
        *("sys", "time", "xarm", "XArmAPI", "franky", "Robot", "JointMotion", "numpy"),
    ]
)
"""What neither a program, whose file would be taken for a module, nor a function is called."""

Step = tuple[ast.stmt, list[ast.AST], bool]
"""A statement, the expressions in it but for those of its blocks, and whether it is inside of one
that may not be run, or not then."""


def tree_of(text: str) -> ast.Module | Problem:
    """The program as Python has it, or why it is none."""
    plain = text.replace("\r", "")
    return language.shared(("python", plain), lambda: _parsed(plain))


def _parsed(text: str) -> ast.Module | Problem:
    if len(text) > _MOST_CHARACTERS:
        return Problem(1, "syntax", "the program is too long to be read")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of backslashes in texts
            return ast.parse(text)
    except SyntaxError as error:
        rule = "indent" if isinstance(error, IndentationError) else "syntax"
        return Problem(error.lineno or 1, rule, f"{error.msg}"[:200])
    except (ValueError, RecursionError, MemoryError, OverflowError):
        return Problem(1, "syntax", "no program that can be read")


def steps_of(tree: ast.Module) -> list[Step]:
    """Statements in the order of the file."""
    return language.shared(("python steps", id(tree)), lambda: list(_walked(tree)))


def _walked(tree: ast.Module) -> Iterator[Step]:
    waiting: list[tuple[ast.AST, bool]] = [(s, False) for s in reversed(tree.body)]
    while waiting:
        node, inside = waiting.pop()
        parts = list(ast.iter_child_nodes(node))
        blocks = [p for p in parts if isinstance(p, (ast.stmt, ast.excepthandler, ast.match_case))]
        if isinstance(node, ast.stmt):
            yield node, [x for p in parts if p not in blocks for x in _inside(p)], inside
        waiting += [(block, True) for block in reversed(blocks)]


def _inside(node: ast.AST) -> list[ast.AST]:
    """A node and all in it but constants and operators, which are most of a position."""
    found = [node]
    for part in found:
        for name in part._fields:
            value = getattr(part, name, None)
            listed = value if isinstance(value, list) else [value]
            found += [v for v in listed if isinstance(v, ast.AST) and not isinstance(v, _SILENT)]
    return found


def calls(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, str, ast.Call]]:
    """Names of functions that are called, what they are of (empty: of nothing), and the calls."""
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id, "", node
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            yield node.func.attr, ast.unparse(node.func.value)[:80], node


def number_of(node: ast.AST | None) -> float:
    """A number that stands there; NaN for anything else."""
    sign = 1.0
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        sign, node = -1.0 if isinstance(node.op, ast.USub) else 1.0, node.operand
    value = node.value if isinstance(node, ast.Constant) else None
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    try:
        return sign * float(value)
    except OverflowError:
        return math.nan


def values_of(node: ast.AST, *, in_radians: bool) -> Values | None:
    """Joint values of a list or tuple of numbers, in degrees; None: it is no such."""
    listed = node.elts if isinstance(node, (ast.List, ast.Tuple)) else []
    numbers = [_degrees(value, in_radians=in_radians) for value in listed]
    if not numbers or not all(map(math.isfinite, numbers)) or max(map(abs, numbers)) > 1e9:
        return None
    return Values(listed[0].lineno, tuple(f"{v:.15f}" for v in numbers))


def _degrees(node: ast.expr, *, in_radians: bool) -> float:
    """A joint value in degrees, also of ``math.radians(90)``; NaN for anything else."""
    if not in_radians:
        return number_of(node)
    turned = isinstance(node, ast.Call) and len(node.args) == 1 and not node.keywords
    if turned and ast.unparse(node.func).rpartition(".")[2] in ("radians", "deg2rad"):  # type: ignore[attr-defined]
        return number_of(node.args[0])  # type: ignore[attr-defined]
    return math.degrees(number_of(node))


def argument(call: ast.Call, signature: Signature, name: str) -> ast.expr | None:
    """The argument of a call for a parameter; None where it is not given."""
    place = next(k for k, p in enumerate(signature.parameters) if name in p.names)
    named = next((k.value for k in call.keywords if k.arg == name), None)
    return call.args[place] if len(call.args) > place else named


def remarks(text: str) -> Iterator[Line]:
    """Remarks that are lines of their own, and stand in no text of many lines."""
    tree = tree_of(text)
    quoted: set[int] = set()
    quotes = '"""' in text or "'''" in text
    for node in ast.walk(tree) if isinstance(tree, ast.Module) and quotes else ():
        if isinstance(node, (ast.Constant, ast.JoinedStr)) and node.end_lineno:
            quoted |= {*range(node.lineno + 1, node.end_lineno + 1)}
    return (line for line in joints.remark_lines("#")(text) if line.row not in quoted)


def changed(step: ast.stmt, nodes: Iterable[ast.AST], pure: set[str]) -> set[str]:
    """Names that a step may give other values; ``pure`` functions change no list they are given."""
    names: set[str] = {*step.names} if isinstance(step, ast.Global) else set()
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, (ast.Store, ast.Del)):
            names.add(node.id)
        elif isinstance(node, ast.Call):
            func = node.func
            if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name):
                names |= {func.value.id} if func.attr not in pure else set()
            if getattr(func, "id", getattr(func, "attr", "")) not in pure:
                given = [*node.args, *(k.value for k in node.keywords)]
                names |= {n.id for a in given for n in ast.walk(a) if isinstance(n, ast.Name)}
        elif isinstance(node, (ast.Subscript, ast.Attribute, ast.Starred)):
            stored = isinstance(node.ctx, (ast.Store, ast.Del)) and isinstance(node.value, ast.Name)
            names |= {ast.unparse(node.value)} if stored else set()
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name.partition(".")[0])
    return names


def events(
    moves: Callable[[ast.Call, str, ast.Module], Iterator[Values | str]],
    given: Callable[[ast.expr, ast.Module], Values | None],
    pure: set[str],
) -> Callable[[str], Iterator[Event]]:
    """What the steps of a text give to variables, and where they move.

    ``moves``: where a call of a name goes, values, the name of a variable, or why that cannot be
    told, which begins with ``!``. ``given``: the position that an expression is; None for none.
    """

    def found(text: str) -> Iterator[Event]:
        tree = tree_of(text)
        if isinstance(tree, Problem):
            yield Go(tree.line, "", fault=f"a position cannot be read: {tree.message}")
            return
        for step, nodes, inside in steps_of(tree):
            for name, _, call in calls(nodes):
                for goes in moves(call, name, tree):
                    said = goes[1:] if isinstance(goes, str) and goes[:1] == "!" else ""
                    yield Go(call.lineno, "" if said else goes, inside, said)
            names = changed(step, nodes, pure | {*dir(builtins)})
            match step:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    yield Give(step.lineno, name, given(value, tree), inside)
                    names -= {name}
            yield from (Give(step.lineno, name, None, inside) for name in sorted(names))

    return found


@dataclass(frozen=True)
class Checks:
    """What is known of a library.

    ``signatures``: of functions and methods. ``attributes``: names behind a dot besides; one that
    is nearly known is an error. ``modules``: that are imported. ``stops``: whether a call moves
    the arm (None: no), and stops it. ``measures``: whether a call measures or sets an output.
    """

    signatures: Mapping[str, Signature]
    attributes: str
    modules: str
    stops: Callable[[ast.Call, str], bool | None]
    measures: Callable[[ast.Call, str], bool]
    values: Callable[[ast.Call, str], Iterator[tuple[ast.AST, float]]]
    """Lists of joint values in a call, and how many radians or degrees 720 deg are."""
    counts: tuple[int, ...]
    answers: str = ""  # functions whose error is in what they return
    factors: str = ""  # attributes that are given numbers above 0 up to 1

    def rules(self) -> Callable[[bytes, Path], list[Problem]]:
        """Problems in the content of a file; never fails."""

        def problems(data: bytes, path: Path) -> list[Problem]:
            text = data.decode("latin-1")
            tree = tree_of(text)
            if isinstance(tree, Problem):
                return told([tree], check_bytes(data, CONTROL))
            if not any(calls(n for _, nodes, _ in steps_of(tree) for n in nodes)):
                return [Problem(1, "syntax", "there is no call in it")]
            return told(self._check(tree), _odd_numbers(text), check_bytes(data, CONTROL))

        return problems

    def _check(self, tree: ast.Module) -> Iterator[Problem]:
        steps = steps_of(tree)
        own = {s.name: _signature(s) for s, *_ in steps if isinstance(s, _DEFINES)}
        known = _defined(steps) | {*dir(builtins), "__file__"} | {*own}
        starred = any(a.name == "*" for _, nodes, _ in steps for a in nodes if _is_alias(a))
        dotted = {*self.signatures, *self.attributes.split()}
        used = {n.id for _, nodes, _ in steps for n in nodes if isinstance(n, ast.Name)}
        standing = joints.Standing(("move that is waited for", "sleep"))
        for step, nodes, _ in steps:
            row = step.lineno
            for node in (step, *nodes):
                yield from self._check_node(node, row, dotted)
                if isinstance(node, ast.Name) and node.id not in known and not starred:
                    yield Problem(row, "name", f"{node.id[:40]} is not known")
                elif _is_alias(node) and node.name != "*":
                    name = node.asname or node.name.partition(".")[0]
                    if name not in used:
                        yield measuring(row, "name", f"{name[:40]} is imported and not used")
            yield from self._check_factor(step)
            idle_call = step.value if isinstance(step, ast.Expr) else None
            if isinstance(step, ast.AnnAssign) and step.value is None:
                yield measuring(row, "name", "an annotation alone does nothing")
            idle = isinstance(step, ast.Expr) and not isinstance(step.value, ast.Call)
            if idle and not isinstance(getattr(step.value, "value", None), str):  # type: ignore[attr-defined]
                yield measuring(row, "name", "a name or a value alone does nothing")
            for name, of, call in calls(nodes):
                signature = self.signatures.get(name) if of or name not in own else own[name]
                if idle_call is call and name in self.answers.split():
                    said = f"what {name} returns is not looked at, and it raises no error"
                    yield measuring(row, "answer", said)
                if signature is not None:
                    yield from _check_call(call, signature)
                for values, most in self.values(call, name):
                    yield from self._check_values(call.lineno, values, most)
                stops = self.stops(call, name)
                judges = any(isinstance(a, ast.Call) for a in call.args)  # what another returns
                measures = self.measures(call, name) or (name in own and not of and not judges)
                waits = name == "sleep"
                yield from standing.check(row, stops is not None, bool(stops), waits, measures)

    def _check_node(self, node: ast.AST, row: int, dotted: set[str]) -> Iterator[Problem]:
        if isinstance(node, ast.Attribute):
            inner = (n for n in dotted if len(n) > 7 and n in node.attr and node.attr not in dotted)
            nearly = near(node.attr, dotted, least=4) or next(inner, "")
            if nearly or re.match(r"_\d", node.attr):
                yield Problem(row, "name", f"{node.attr[:40]} is nearly {nearly or 'a name'}")
        elif isinstance(node, ast.alias | ast.ImportFrom):
            name = (node.name if isinstance(node, ast.alias) else node.module) or ""
            if getattr(node, "level", 0):
                yield measuring(row, "name", "is imported from a package that is not there")
            nearly = near(name, {*self.modules.split(), *dotted})
            if (nearly and name not in dotted) or re.search(r"\b_\d", name):
                yield Problem(row, "name", f"{name[:40]} is nearly {nearly}")

    def _check_factor(self, step: ast.stmt) -> Iterator[Problem]:
        match step:
            case ast.Assign(targets=[ast.Attribute(attr=name)], value=value):
                number = number_of(value)
                if name in self.factors.split() and not (math.isnan(number) or 0 < number <= 1):
                    yield Problem(step.lineno, "range", f"{name} is not above 0 to 1")
                elif name in self.factors.split() and isinstance(value, ast.BinOp | ast.UnaryOp):
                    yield measuring(step.lineno, "range", f"{name} is computed")

    def _check_values(self, row: int, node: ast.AST, most: float) -> Iterator[Problem]:
        listed = node.elts if isinstance(node, (ast.List, ast.Tuple)) else []
        if listed and len(listed) not in self.counts:
            yield Problem(row, "position", f"{len(listed)} joint values")
        far = [k for k, v in enumerate(listed, start=1) if abs(number_of(v)) > most]
        if far:
            yield Problem(row, "range", f"joint {far[0]} is beyond +-720 deg")
        if isinstance(node, ast.Constant | ast.Dict | ast.Set | ast.JoinedStr):
            yield Problem(row, "position", f"{ast.unparse(node)[:40]} is no list of joint values")


_DEFINES = (ast.FunctionDef, ast.ClassDef)


def _is_alias(node: ast.AST) -> TypeGuard[ast.alias]:
    return isinstance(node, ast.alias)


def _signature(step: ast.FunctionDef | ast.ClassDef) -> Signature | None:
    """Signature of a function of the program, where it is a plain one."""
    own = getattr(step, "args", None)
    if own is None or own.vararg or own.kwarg or own.posonlyargs or own.kwonlyargs:
        return None
    given = len(own.args) - len(own.defaults)
    named = [f"{a.arg}{'?' * (k >= given)}" for k, a in enumerate(own.args)]
    return Signature.parse(" ".join([step.name, *named]))


def _defined(steps: Iterable[Step]) -> set[str]:
    """Names that a program gives values, imports or defines."""
    found: set[str] = set()
    for step, nodes, _ in steps:
        for node in (step, *nodes):
            match node:
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    found.add(name)
                case ast.alias(name=name, asname=other):
                    found.add(other or name.partition(".")[0])
                case ast.Global(names=names) | ast.Nonlocal(names=names):
                    found |= {*names}
        found |= {h.name for h in getattr(step, "handlers", ()) if h.name}
    return found


def _check_call(call: ast.Call, signature: Signature) -> Iterator[Problem]:
    starred = any(isinstance(a, ast.Starred) for a in call.args)
    if starred or None in [k.arg for k in call.keywords]:
        return
    given = [("", a) for a in call.args] + [(k.arg or "", k.value) for k in call.keywords]
    listed = [Argument(_shown(v), word, *_kind(v)) for word, v in given]
    yield from (Problem(call.lineno, rule, said) for rule, said in signature.faults(listed))


def _shown(node: ast.expr) -> str:
    return "[...]" if isinstance(node, ast.List) else ast.unparse(node)[:60]


def _kind(node: ast.expr) -> tuple[str, float]:
    """Kind and number of an argument, as far as the text tells."""
    value = number_of(node)
    if math.isfinite(value):
        return "number", value
    constant = getattr(node, "value", None) if isinstance(node, ast.Constant) else None
    if isinstance(constant, str) or isinstance(node, ast.JoinedStr):
        return "text", math.nan
    if isinstance(constant, bool):
        return "flag", math.nan
    return ("list" if isinstance(node, (ast.List, ast.Tuple)) else ""), math.nan


def _odd_numbers(text: str) -> Iterator[Problem]:
    """Numbers with an underscore, which are seldom meant."""
    plain = _QUOTED.sub("", text.replace("\r", ""))
    for odd in _UNDERSCORED.finditer(plain):
        row = plain.count("\n", 0, odd.start()) + 1
        yield measuring(row, "syntax", f"{odd[0][:30]} is an odd number")


def imports(steps: Sequence[str]) -> list[str]:
    """Lines that import what the steps need of Python itself."""
    waits = any("time." in step for step in steps)
    return ["import sys", *(["import time"] if waits else [])]


def measured(program: PoseProgram, told: str) -> list[str]:
    """The function that is called at each pose, and prints what is told."""
    options = program.options
    if not options.measure_call:
        return []
    number, pose = ("number", " {number}") if options.measure_argument is not None else ("", "")
    return [
        f"def {options.measure_call}({number}):",
        f'    input(f"{options.question} Pose{pose}, Enter: ")',
        f'    print(f"POSE{pose} {told}")',
        "",
    ]
