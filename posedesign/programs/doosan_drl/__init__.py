"""Doosan DRL programs, which are Python, of joint positions.

A file ``NAME.drl``: a ``movej`` to each position, which stands in it. The measuring call is defined
in the program: as written it asks the operator whether the tool is at its target, and logs the
joint values then shown; put another body there to trigger an instrument. Touched-up positions are
typed, or taught, into the moves: the language keeps none. Speeds are percents of the slowest
joint's. Nothing was loaded on a controller.

Read are the joint values that ``movej`` and ``amovej`` go to: ``posj`` or a list of six, there or
in a variable. Computed and relative moves are unread. Poses (``posx``) say no posture: left out.

Rules: ``syntax``, ``indent``: Python, as Python's own parser has it. ``name``: functions and
variables are known; others are noted where they are not nearly known. ``arguments``: functions have
those that they take. ``position``, ``range``: ``posj`` has six numbers within +-720 deg, outputs
are from 1 to 16, times are not negative; moves to computed positions are noted. ``standstill``,
``wait-to-measure``: a move that is not blended, and a wait, before an output is set or a function
of the program called.

Sources: Doosan's doosan-robot2, DSR_ROBOT2.py (functions and parameters); programs of pendants and
people in public repositories; visose/Robots, DrlPostProcessor.cs.
"""

from __future__ import annotations

import ast
import builtins
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from posedesign.programs import joint_programs as joints
from posedesign.programs import language, signatures
from posedesign.programs.arm import Arm
from posedesign.programs.language import Line, Shape, Statement
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.rules import CONTROL, check_bytes, judged, measuring, told
from posedesign.programs.signatures import Argument
from posedesign.programs.straight_line import Event, Give, Go, Values
from posedesign.programs.writing import NameRule, Phrases

SIGNATURES = signatures.table("""
movej,amovej pos:joints vel/v? acc/a? time/t? radius/r? mod? ra?
movel,amovel pos vel/v? acc/a? time/t? radius/r? ref? mod? ra? app_type?
movejx,amovejx pos vel/v? acc/a? time/t? radius/r? ref? mod? ra? sol?:whole[0,7]
str object encoding? errors?
wait time:number[0,]
tp_log message
sub_program_run name:text
set_velj vel
set_accj acc
posj J1? J2? J3? J4? J5? J6?
posx X? Y? Z? A? B? C? sol? turn?
mwait time?:number[0,]
set_digital_output index:whole[1,16] val? time?:number[0,] val2?
tp_popup message pm_type? button_type?
get_current_posj
""")
"""Functions and their arguments; a position may also be one list of all its numbers."""

_MOVES = ("movej", "amovej")
_WORDS = """def if elif else while for try except return pass break continue from import in and or
not on"""
_RESERVED = frozenset(map(str.upper, [*SIGNATURES, *_WORDS.split()]))
_NAMES = """ON OFF set_velx set_accx get_current_posx set_digital_outputs get_digital_input movec
amovec moveb amoveb movesx movesj amovesx posb trans fkin ikin set_tool set_tcp get_digital_inputs
"""
_USUAL = "str print range len int float list abs round min max sum"
_PURE = {*SIGNATURES, *_NAMES.split(), *dir(builtins)}  # they change no list that they are given
_LITERAL = (ast.Constant, ast.List, ast.Tuple, ast.UnaryOp)
_MOST_CHARACTERS = 3_000_000  # of a program that is parsed: ten times those of 10,000 poses
_QUOTED = re.compile(r"""\"[^\"\n]*\"|'[^'\n]*'|#[^\n]*""")
_UNDERSCORED = re.compile(r"(?<![\w.])\d[\d.]*_[\w.]*")
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)

_NUMBERS = re.compile(
    r"""("[^"\n]*"|'[^'\n]*')
    |((?:(?:(?<=[\[(,=])|(?<=[\[(,=]\ ))-)?(?<![\w.])(?:\d+(?:\.\d*)?|\.\d+)(?![\w.]))""",
    re.ASCII | re.VERBOSE,
)


_DIGITS = re.compile(r"\d+")
_BY_NUMBER = re.compile(r"mod|\br\b|radius")  # arguments whose number changes what a step does
_PLAIN_MOVE = re.compile(
    r"\s*a?movej\((?:posj\([^()\[\]]*\)|\[[^()\[\]]*\])(?:, *\w+ *= *[-\w.]+)*\)\s*"
)


@dataclass
class _Step:
    """A statement; ``inside``: of one that may not be run, or not then."""

    node: ast.stmt
    inside: bool
    form: Statement
    """The text of its lines: equal forms differ in numbers only."""

    @property
    def nodes(self) -> list[ast.AST]:
        """Expressions in it but for those of its blocks."""
        if self.form.said is None:
            parts = list(ast.iter_child_nodes(self.node))
            self.form.said = [x for p in parts if not isinstance(p, _BLOCKS) for x in _inside(p)]
        said: list[ast.AST] = self.form.said
        return said

    @property
    def row(self) -> int:
        """Its line."""
        return self.node.lineno


_BLOCKS = (ast.stmt, ast.excepthandler, ast.match_case)


def _tree(text: str) -> ast.Module | Problem:
    """The program as Python has it, or why it is none."""
    plain = text.replace("\r", "")
    return language.shared(("drl", plain), lambda: _parsed(plain))


def _parsed(text: str) -> ast.Module | Problem:
    if len(text) > _MOST_CHARACTERS:
        return Problem(1, "syntax", "the program is too long to be read")
    plain = _QUOTED.sub("", text)
    if odd := _UNDERSCORED.search(plain):
        row = plain.count("\n", 0, odd.start()) + 1  # Python 3.2, as controllers have it
        return Problem(row, "syntax", f"{odd[0][:30]} is no number")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of backslashes in texts
            return ast.parse(text)
    except SyntaxError as error:
        rule = "indent" if isinstance(error, IndentationError) else "syntax"
        return Problem(error.lineno or 1, rule, f"{error.msg}"[:200])
    except (ValueError, RecursionError, MemoryError, OverflowError):
        return Problem(1, "syntax", "no program that can be read")


_SILENT = (ast.Constant, ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop)
_PLACES = [parameter.name for parameter in SIGNATURES["movej"].parameters]


def _steps(tree: ast.Module, text: str) -> list[_Step]:
    """Statements in the order of the file."""
    return language.shared(("drl steps", id(tree)), lambda: list(_walked(tree, text)))


def _walked(tree: ast.Module, text: str) -> Iterator[_Step]:
    waiting: list[tuple[ast.AST, bool]] = [(s, False) for s in reversed(tree.body)]
    lines, shapes = text.replace("\r", "").split("\n"), dict[str, Shape]()
    last = 0
    while waiting:
        node, inside = waiting.pop()
        blocks = [p for p in ast.iter_child_nodes(node) if isinstance(p, _BLOCKS)]
        if isinstance(node, ast.stmt):
            alone = not blocks and node.lineno == node.end_lineno != last
            own = lines[node.lineno - 1] if alone else ""
            pieces = _NUMBERS.split(own)
            slots = [slot for slot in pieces[2::3] if slot]
            pieces[2::3] = [
                _DIGITS.sub("\0", slot.lstrip("-") if slot else "") for slot in pieces[2::3]
            ]
            key = "".join([piece or "" for piece in pieces])
            key = key if alone else f"{node.lineno} {node.col_offset}"
            key += " ".join(slots) if _BY_NUMBER.search(own) else ""
            shape = shapes.get(key)
            if shape is None:
                numbers = [*range(len(slots))]
                shape = shapes[key] = Shape(language.NOTHING, [], numbers=numbers)
            last = node.end_lineno or 0
            yield _Step(node, inside, Statement(node.lineno, own, shape, slots))
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


def _calls(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, ast.Call]]:
    """Calls of functions by their names."""
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id, node


def _number(node: ast.AST) -> str:
    """Text of a number that stands there; empty for anything else."""
    sign = ""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        sign, node = "-" * isinstance(node.op, ast.USub), node.operand
    if not isinstance(node, ast.Constant) or type(node.value) not in (int, float):
        return ""
    text = repr(node.value)
    return sign + (f"{float(text):.15f}" if "e-" in text else text)[:99]


def _joints_in(node: ast.AST | None, *, aliases: bool = True) -> Values | str:
    """Joint values that an expression is, or the name of the variable; empty for anything else."""
    if isinstance(node, ast.Name):
        return node.id if aliases else ""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "posj":
        if len(node.args) == 1 and not node.keywords:
            return _joints_in(node.args[0], aliases=aliases)
        listed = [] if node.keywords else node.args
    else:
        listed = node.elts if isinstance(node, ast.List) else []
    texts = tuple(map(_number, listed))
    return Values(listed[0].lineno, texts) if texts and all(texts) else ""


def _argument(call: ast.Call, name: str) -> ast.expr | None:
    """The argument of a move of this name."""
    place = _PLACES.index(name)
    named = next((k.value for k in call.keywords if k.arg == name), None)
    return call.args[place] if len(call.args) > place else named


def _is_relative(call: ast.Call) -> bool:
    """Whether a move goes on from where the arm stands, or may."""
    mode = _argument(call, "mod")
    return mode is not None and ast.unparse(mode) not in ("0", "DR_MV_MOD_ABS")


def _remarks(text: str) -> Iterator[Line]:
    """Remarks that are lines of their own, and stand in no text of many lines."""
    tree = _tree(text)
    quoted: set[int] = set()
    quotes = '"""' in text or "'''" in text
    for node in ast.walk(tree) if isinstance(tree, ast.Module) and quotes else ():
        if isinstance(node, (ast.Constant, ast.JoinedStr)) and node.end_lineno:
            quoted |= {*range(node.lineno + 1, node.end_lineno + 1)}
    return (line for line in joints.remark_lines("#")(text) if line.row not in quoted)


def _events(text: str) -> Iterator[Event]:
    """What the steps give to variables, and where they move."""
    tree = _tree(text)
    if isinstance(tree, Problem):
        yield Go(tree.line, "", fault=f"a position cannot be read: {tree.message}")
        return
    found: dict[Shape, int | None] = {}  # where the joints stand; None: nothing is done
    for step in _steps(tree, text):
        shape, slots = step.form.shape, step.form.slots
        known = found.get(shape, -1)
        if known is not None and known >= 0:
            texts = tuple(slots[known : known + joints.JOINTS])
            yield Go(step.row, Values(step.row, texts), step.inside)
        elif known is not None:
            events = [*_events_of(step.node, step.nodes, step.inside)]
            yield from events
            if not events:
                found[shape] = None
            elif isinstance(events[0], Go) and _PLAIN_MOVE.fullmatch(step.form.text):
                target = events[0].target
                at = _place_in(target.texts, slots) if isinstance(target, Values) else -1
                found[shape] = at


def _place_in(texts: Sequence[str], slots: Sequence[str]) -> int:
    """Where joint values stand in the numbers of a line; -1 for elsewhere."""
    numbers, values = ([(float(t), t[0] == "-") for t in told] for told in (slots, texts))
    ends = range(len(numbers) - len(values) + 1) if len(values) == joints.JOINTS else ()
    found = [k for k in ends if numbers[k : k + joints.JOINTS] == values]
    return found[0] if len(found) == 1 else -1


def _events_of(step: ast.stmt, nodes: list[ast.AST], inside: bool) -> Iterator[Event]:
    for name, call in _calls(nodes):
        if name in _MOVES:
            yield from _move(call, inside)
    names = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    match step:
        case ast.Assign(targets=[ast.Name(id=name)], value=value):
            given = _joints_in(value, aliases=False)
            yield Give(step.lineno, name, given if isinstance(given, Values) else None, inside)
            names -= {name}
    # what it may change otherwise
    for node in nodes:
        func = node.func if isinstance(node, ast.Call) else None
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name):
            names |= {func.value.id} if func.attr != "format" else set()
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") not in _PURE:
            names |= {n.id for a in node.args for n in ast.walk(a) if isinstance(n, ast.Name)}
            kept = (n for k in node.keywords for n in ast.walk(k.value))
            names |= {n.id for n in kept if isinstance(n, ast.Name)}
        elif isinstance(node, (ast.Subscript, ast.Attribute, ast.Starred)):
            stored = isinstance(node.ctx, (ast.Store, ast.Del))
            names |= {node.value.id} if stored and isinstance(node.value, ast.Name) else set()
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name)
    names |= {*step.names} if isinstance(step, ast.Global) else set()
    yield from (Give(step.lineno, name, None, inside) for name in sorted(names))


def _move(call: ast.Call, inside: bool) -> Iterator[Event]:
    target = _argument(call, "pos")
    goes = _joints_in(target)
    if _is_relative(call):
        said = ast.unparse(call)[:60]
        yield Go(call.lineno, "", inside, f"{said!a}: is relative to where the arm stands")
    elif goes:
        yield Go(call.lineno, goes, inside)
    elif not (isinstance(target, ast.Call) and getattr(target.func, "id", "") == "posx"):
        yield Go(call.lineno, "", inside, f"{ast.unparse(call)[:60]!a}: no list of numbers")


def check_doosan_drl(data: bytes, path: Path) -> list[Problem]:
    """Problems in the content of a file; never fails."""
    text = data.decode("latin-1")
    tree = _tree(text)
    if isinstance(tree, Problem):
        return told([tree], check_bytes(data, CONTROL))
    does = (ast.Assign, ast.AnnAssign, ast.FunctionDef)
    if not any(
        isinstance(s, does) or isinstance(getattr(s, "value", 0), ast.Call) for s in tree.body
    ):
        return [Problem(1, "syntax", "there is no call and no function in it")]
    return told(_Checker(_steps(tree, text)).check(), check_bytes(data, CONTROL))


class _Checker:
    """The statements of a program, and what is known of its names."""

    def __init__(self, steps: list[_Step]) -> None:
        self.steps = steps
        of_forms = {step.form.shape: step for step in steps}.values()
        nodes = [node for step in of_forms for node in (step.node, *step.nodes)]
        self.own = {node.name for node in nodes if isinstance(node, _FUNCTIONS)}
        self.known = {*_PURE, *self.own}
        self.texts_of: dict[str, set[str]] = {}  # kinds of the values of names
        for node in nodes:
            match node:
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    self.known.add(name)
                case ast.alias(name=name, asname=other):
                    self.known.add(other or name.partition(".")[0])
                case ast.Global(names=names) | ast.Nonlocal(names=names):
                    self.known |= {*names}
                case ast.ExceptHandler(name=str(name)):
                    self.known.add(name)
        self.known |= {h.name for s in steps for h in getattr(s.node, "handlers", ()) if h.name}
        named = (n for s in SIGNATURES.values() for p in s.parameters for n in p.names)
        self.meant = " ".join([*self.known - {*dir(builtins)}, _WORDS, _USUAL, *named])
        self.numbers = {
            a.arg
            for step in (s.node for s in steps)
            if isinstance(step, ast.FunctionDef)
            for a, value in zip(step.args.args[::-1], step.args.defaults[::-1], strict=False)
            if _number(value)
        }

    def check(self) -> Iterator[Problem]:
        yield from judged(self.steps, self._check_step, lambda step: step.form)
        standing = joints.Standing(("mwait", "wait"))
        for step in self.steps:
            notes = step.form.shape.notes
            if "does" not in notes:
                notes["does"] = [*self._does(step)]
            for does in notes["does"]:
                yield from standing.check(step.row, *does)

    def _does(self, step: _Step) -> Iterator[tuple[bool, bool, bool, bool]]:
        """Whether each call in a step moves the arm, stops it, waits, or measures."""
        for name, call in _calls(step.nodes):
            moves = name.startswith(("move", "amove"))
            radius = next((k.value for k in call.keywords if k.arg in ("r", "radius")), None)
            blended = radius is not None and float(_number(radius) or 1) != 0
            stops = name == "mwait" or (name[0] == "m" and moves and not blended)
            measures = name in self.own or name == "sub_program_run"
            measures |= name == "set_digital_output" and "OFF" not in ast.unparse(call)
            yield moves, stops, name == "wait", measures

    def _check_step(self, step: _Step) -> Iterator[Problem]:
        node, nodes, row = step.node, step.nodes, step.row
        loads = (n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load))
        for name in sorted({*loads} - self.known):
            if not re.fullmatch(r"DR_[A-Z_\d]+", name):
                level = joints.level_of(name, self.meant, name * name[-1].isdigit())
                yield Problem(row, "name", f"{name[:40]} is not known", level)  # P_2 is not P_1
        idle = isinstance(node, ast.Expr) and not isinstance(node.value, ast.Call)
        if idle and not isinstance(getattr(node.value, "value", None), str):  # type: ignore[attr-defined]
            yield measuring(row, "name", "a name or a value alone does nothing")
        yield from self._check_texts(row, nodes)
        for name, call in _calls(nodes):
            yield from _check_call(row, name, call)

    def _check_texts(self, row: int, nodes: Iterable[ast.AST]) -> Iterator[Problem]:
        for node in nodes:
            if isinstance(node, ast.UnaryOp) and _is_text(node.operand):
                yield Problem(row, "arguments", "a text has no sign and is no condition")
            if not isinstance(node, ast.BinOp):
                continue
            left, right = node.left, node.right
            text = next((t for t in (left, right) if _is_text(t)), None)
            other = right if text is left else left
            number = bool(_number(other)) or getattr(other, "id", "") in self.numbers
            called = getattr(getattr(other, "func", None), "id", "str")
            number |= called in SIGNATURES and called != "str"
            if isinstance(node.op, ast.Add) and text is not None and number:
                yield measuring(row, "arguments", "a number cannot be added to a text")
            made = isinstance(text, (ast.JoinedStr, ast.BinOp))
            formats = text is left and (made or "%" in str(getattr(text, "value", "")))
            if isinstance(node.op, ast.Mod) and text is not None and not formats:
                yield Problem(row, "arguments", "% formats nothing")


def _is_text(node: ast.AST) -> bool:
    while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        if _is_text(node.right):
            return True
        node = node.left
    made = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "str"
    return (
        made
        or isinstance(node, ast.JoinedStr)
        or (isinstance(node, ast.Constant) and isinstance(node.value, str))
    )


def _kind(node: ast.expr) -> tuple[str, float]:
    """Kind and number of an argument, as far as the text tells."""
    if text := _number(node):
        return "number", float(text)
    if _is_text(node) or (isinstance(node, ast.BinOp) and _kind(node.left)[0] == "text"):
        return "text", math.nan
    switched = isinstance(node, ast.BinOp) and {"ON", "OFF"} & {
        getattr(side, "id", "") for side in (node.left, node.right)
    }
    if switched or isinstance(node, (ast.Tuple, ast.Compare, ast.BoolOp, ast.Dict, ast.Set)):
        return "odd", math.nan
    return ("list" if isinstance(node, ast.List) else ""), math.nan


def _shown(node: ast.expr) -> str:
    if isinstance(node, ast.Call):
        return f"{getattr(node.func, 'id', '')}(...)"  # positions are many, and long
    return getattr(node, "id", "") or _number(node) or ast.unparse(node)[:80]


def _check_call(row: int, name: str, call: ast.Call) -> Iterator[Problem]:
    signature = SIGNATURES.get(name)
    goes = name in _MOVES or (name == "posj" and len(call.args) == 1)
    target = call.args[0] if name == "posj" and call.args else _argument(call, "pos")
    computed = isinstance(target, ast.Starred) or not isinstance(
        target, (ast.Call, ast.List, ast.Name)
    )
    if goes and (computed or _is_relative(call)):
        yield Problem(row, "position", f"{name}: a computed position is not read back", "note")
    starred = any(isinstance(a, ast.Starred) for a in call.args) or None in [
        k.arg for k in call.keywords
    ]
    if signature is None or starred:
        return
    given = [("", a) for a in call.args] + [(k.arg or "", k.value) for k in call.keywords]
    arguments = [Argument("", word, *_kind(v)) for word, v in given]
    odd = next((v for a, (_, v) in zip(arguments, given, strict=True) if a.kind == "odd"), None)
    if odd is not None:
        yield Problem(row, "arguments", f"{name[:40]}: {_shown(odd)[:40]}")
        return
    if any(signature.faults(arguments)):
        told = [a._replace(shown=_shown(v)) for a, (_, v) in zip(arguments, given, strict=True)]
        yield from (Problem(row, rule, said) for rule, said in signature.faults(told))
    if name == "posj" and len(call.args) > 1:
        yield from joints.check_joints(row, [_number(a) or "?" for a in call.args])


class DoosanDrl(joints.JointDialect):
    """Programs of Doosan arms."""

    name = "doosan-drl"
    title = "Doosan DRL program"
    maker = "doosan"
    suffixes = (".drl",)
    remark = (r"", "# {words}")
    names = NameRule("a DRL name", 32, small=True, reserved=_RESERVED)
    phrases = Phrases(
        note="# {}",
        move=("movej(posj({target}), vel={speed}, acc={speed})", "mwait()"),
        wait="wait({time:.3f})",
        pulse=(
            "set_digital_output({output}, ON)",
            "wait({time:.3f})",
            "set_digital_output({output}, OFF)",
        ),
        call=("{call}({argument})",),
    )
    limits = replace(joints.LIMITS, outputs=(1, 16))
    reader = joints.in_moves(_events, _remarks, "doosan")
    rules = check_doosan_drl

    def lines(self, program: PoseProgram, arm: Arm, steps: list[str]) -> list[str]:
        """The measuring call, and the steps."""
        call = (
            f"def {program.options.measure_call}(number=0):",
            f'    tp_popup("{program.options.question} Pose " + str(number))',
            '    tp_log("POSE " + str(number) + " q=" + str(get_current_posj()))',
        )
        return [*(call if program.options.measure_call else ()), *steps]
