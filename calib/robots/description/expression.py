"""The expressions of a xacro file, worked out without Python's ``eval``.

The xacro package compiles what stands in ``${...}`` and evaluates it, with Python's built-in
functions taken away. That stops mistakes, not malice: the frame of a generator leads back to all
of them. Here the expression is parsed and its tree is walked; what is not listed does not exist.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

LONGEST_EXPRESSION = 2000
"""Characters; the parser of Python has a stack to run out of."""

_BUILTIN: tuple[Callable[..., Any], ...] = (
    *(abs, all, any, bool, dict, divmod, enumerate, float, int, len, list, max, min, range),
    *(reversed, round, set, sorted, str, sum, tuple, zip),
)
_MATH = {k: v for k, v in vars(math).items() if callable(v) and not k.startswith("_")}

FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{f.__name__: f for f in _BUILTIN},
    **{f"python.{f.__name__}": f for f in _BUILTIN},
    **_MATH,
    **{f"math.{name}": f for name, f in _MATH.items()},
}
"""What an expression may call, by the name it calls it by; abs and round are Python's."""

_METHODS: dict[type, frozenset[str]] = {
    str: frozenset(
        {
            *("capitalize", "count", "endswith", "find", "index", "isdigit", "join", "lower"),
            *("lstrip", "replace", "rstrip", "split", "startswith", "strip", "title", "upper"),
            "zfill",
        }
    ),
    dict: frozenset({"get", "items", "keys", "values"}),
    list: frozenset({"count", "index"}),
    tuple: frozenset({"count", "index"}),
}
_DATA = (bool, int, float, complex, str, list, tuple, dict, set, range, type(None))
_ITERATORS = (enumerate, reversed, zip)

_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}


class ExpressionError(Exception):
    """An expression that is not understood, or not accepted."""


def evaluate(
    text: str,
    symbols: Mapping[str, Any],
    functions: Mapping[str, Callable[..., Any]] = FUNCTIONS,
) -> Any:
    """Work out an expression of numbers, texts, lists and tables.

    Parameters
    ----------
    text : str
    symbols : mapping
        Values by name; a name space is a mapping in it.
    functions : mapping
        What may be called, by the dotted name it is called by.

    Raises
    ------
    ExpressionError
        The expression is no Python, or holds something that is not listed here.
    Exception
        What the operators and functions raise: division by zero, a wrong type.
    """
    if len(text) > LONGEST_EXPRESSION:
        raise ExpressionError(f"an expression of more than {LONGEST_EXPRESSION} characters")
    if "__" in text:
        raise ExpressionError("two underscores in a row are not accepted in an expression")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise ExpressionError(f"not an expression: {getattr(error, 'msg', error)}") from error
    return _Walk(symbols, functions).value(tree.body)


class _Walk:
    """One walk over the tree of an expression."""

    def __init__(
        self, symbols: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        self._symbols = symbols
        self._functions = functions
        self._local: dict[str, Any] = {}

    def value(self, node: ast.expr) -> Any:
        """What a node comes to, always plain data."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ExpressionError(f"{_shown(node)} is not understood here")
        return method(node)

    def _constant(self, node: ast.Constant) -> Any:
        if not isinstance(node.value, _DATA):
            raise ExpressionError(f"{_shown(node)} is not understood here")
        return node.value

    def _name(self, node: ast.Name) -> Any:
        return _plain(self._any(node), node)

    _attribute = _name

    def _any(self, node: ast.expr) -> Any:
        """A value, or a name space on the way to one."""
        if isinstance(node, ast.Name):
            if node.id in self._local:
                return self._local[node.id]
            try:
                return self._symbols[node.id]
            except KeyError:
                raise ExpressionError(f"name {node.id!r} is not defined") from None
        if isinstance(node, ast.Attribute):
            owner = self._any(node.value)
            try:
                if isinstance(owner, dict):  # a name space, or a table out of a YAML file
                    return owner[node.attr]
            except (KeyError, AttributeError):
                pass
            raise ExpressionError(f"{_shown(node)} is not defined")
        return self.value(node)

    def _binop(self, node: ast.BinOp) -> Any:
        return _operator(node.op)(self.value(node.left), self.value(node.right))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        return _operator(node.op)(self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Any:
        until = isinstance(node.op, ast.Or)
        result = None
        for part in node.values:
            result = self.value(part)
            if bool(result) is until:
                break
        return result

    def _compare(self, node: ast.Compare) -> bool:
        left = self.value(node.left)
        for kind, comparator in zip(node.ops, node.comparators, strict=True):
            right = self.value(comparator)
            if not _operator(kind)(left, right):
                return False
            left = right
        return True

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _list(self, node: ast.List) -> list[Any]:
        return [self.value(e) for e in node.elts]

    def _tuple(self, node: ast.Tuple) -> tuple[Any, ...]:
        return tuple(self.value(e) for e in node.elts)

    def _subscript(self, node: ast.Subscript) -> Any:
        return _plain(self.value(node.value)[self.value(node.slice)], node)

    def _slice(self, node: ast.Slice) -> slice:
        return slice(*(p and self.value(p) for p in (node.lower, node.upper, node.step)))

    def _listcomp(self, node: ast.ListComp | ast.GeneratorExp) -> list[Any]:
        outside = dict(self._local)
        try:
            return list(self._each(node.elt, node.generators))
        finally:
            self._local = outside

    _generatorexp = _listcomp

    def _each(self, element: ast.expr, loops: list[ast.comprehension]) -> Iterator[Any]:
        if not loops:
            yield self.value(element)
            return
        for item in self.value(loops[0].iter):
            self._bind(loops[0].target, item)
            if all(self.value(condition) for condition in loops[0].ifs):
                yield from self._each(element, loops[1:])

    def _bind(self, target: ast.expr, item: Any) -> None:
        if isinstance(target, ast.Name):
            self._local[target.id] = item
        elif isinstance(target, ast.Tuple):
            for part, value in zip(target.elts, item, strict=True):
                self._bind(part, value)
        else:
            raise ExpressionError(f"{_shown(target)} is not understood here")

    def _call(self, node: ast.Call) -> Any:
        function = self._functions.get(_dotted(node.func)) or self._method(node.func)
        values = [self.value(a) for a in node.args]
        named = {str(k.arg): self.value(k.value) for k in node.keywords}
        result = function(*values, **named)
        return _plain(list(result) if isinstance(result, _ITERATORS) else result, node)

    def _method(self, node: ast.expr) -> Callable[..., Any]:
        if isinstance(node, ast.Attribute) and _dotted(node.value) not in ("math", "python"):
            owner = self.value(node.value)
            for kind, names in _METHODS.items():
                if isinstance(owner, kind) and node.attr in names:
                    made = getattr(kind, node.attr)
                    if kind is dict and node.attr != "get":
                        return lambda: list(made(owner))
                    return lambda *values, **named: made(owner, *values, **named)
        raise ExpressionError(f"{_shown(node)} is not a function known here")


def _operator(kind: ast.AST) -> Callable[..., Any]:
    try:
        return _OPERATORS[type(kind)]
    except KeyError:
        raise ExpressionError(f"operator {type(kind).__name__} is not understood here") from None


def _plain(value: Any, node: ast.expr) -> Any:
    if not isinstance(value, _DATA):
        raise ExpressionError(f"{_shown(node)} is not a value")
    return value


def _dotted(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def _shown(node: ast.expr) -> str:
    text = " ".join(ast.unparse(node).split())
    return repr(text if len(text) <= 60 else text[:57] + "...")
