"""The process that expands a xacro file: it may do nothing but read the files of its packages.

A xacro file is a program from somebody else, and people expand what they found on the net. It must
not read files beside its packages (their text would stand in the cell), write, start a process,
reach the net or the environment, or take the machine's memory and time. Four fences, one inside the
other; the second alone would do for deeds, and the third keeps it from being walked around, since
Python with its built-in functions taken away still leads back to all of them:

* the process is limited in memory and time, has no environment, and can neither write a file nor
  start a process (:mod:`calib.limited`);
* an audit hook, which nothing can take off again, ends it at any other deed: an import, a socket,
  code run by ``eval``, a file opened elsewhere (Python documentation, "Audit events table");
* the functions of the xacro package that open, evaluate and substitute are replaced by ones that
  keep to :mod:`calib.robots.description.packages` and to :func:`evaluate`;
* XML entities and document types are refused in every file.

Run by :func:`calib.robots.description.urdf.expand_xacro` only.

The expressions of a xacro file, worked out without Python's ``eval``.

The xacro package compiles what stands in ``${...}`` and evaluates it, with Python's built-in
functions taken away. That stops mistakes, not malice: the frame of a generator leads back to all
of them. Here the expression is parsed and its tree is walked; what is not listed does not exist.
"""

from __future__ import annotations

import ast
import json
import math
import operator
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from defusedxml import DefusedXmlException
from defusedxml.expatbuilder import parseString

from calib.robots.description.packages import Packages, is_inside

_HARMLESS = frozenset({"builtins.id", "compile", "glob.glob", "glob.glob/2"})
"""``compile``: Python's parser makes the tree of an expression; nothing can be run of it."""

_READING = frozenset({"open", "os.listdir", "os.scandir"})


class Refusal(Exception):
    """Something that a description may not do."""


def run(data: bytes) -> bytes:
    """Expand one file and give the outcome, as JSON; in a process of :mod:`calib.limited`.

    Of JSON with ``file``: the xacro file; ``search``: folders to search for packages;
    ``arguments``: of the file, by name; ``most_bytes``: of a file read and of the outcome.
    """
    job = json.loads(data)
    expansion: _Expansion | None = None
    try:
        expansion = _Expansion(job)
        outcome = {"urdf": expansion.text(), "folders": [str(f) for f in expansion.folders]}
    except MemoryError:
        outcome = {"error": "its expansion does not fit into memory"}
    except RecursionError:
        outcome = {"error": "its macros call each other without end, or its elements nest too deep"}
    except Exception as error:  # the xacro package raises whatever comes
        if expansion is None:
            raise
        outcome = {"error": expansion.told(error)}
    return json.dumps(outcome).encode()


class _Expansion:
    """The xacro package with its doors closed, around one file."""

    def __init__(self, job: dict[str, Any]) -> None:
        import xacro
        import yaml

        self._xacro, self._yaml = xacro, yaml
        self._file, self._most_bytes = Path(job["file"]), job["most_bytes"]
        self._arguments: dict[str, str] = job["arguments"]
        self._used: set[str] = set()
        self._packages = Packages(self._file, [Path(folder) for folder in job["search"]])
        _ = self._packages.declared  # looks into folders, while the doors are open
        self.folders = {self._packages.tree}
        parseString("<a/>", forbid_dtd=True)  # imports what it needs before the doors are closed
        self._functions: dict[str, Callable[..., Any]] = {**FUNCTIONS, **self._of_xacro()}
        for name in ("safe_eval", "eval_extension", "parse"):
            if not callable(getattr(xacro, name, None)):
                raise Refusal(f"this version of xacro has no {name}()")
        xacro.safe_eval = lambda text, symbols, *_: evaluate(text, symbols, self._functions)
        xacro.eval_extension = self._substitute
        xacro.parse = self._parse
        # another version of xacro may go another way: these end it whichever way it goes
        xacro.eval = xacro.exec = xacro.open = _refuse
        sys.addaudithook(self._watch)

    def text(self) -> str:
        """The expanded file."""
        document = self._xacro.process_file(str(self._file), mappings=dict(self._arguments))
        unknown = sorted(self._arguments.keys() - self._used)
        if unknown:
            known = ", ".join(sorted(self._used)) or "none"
            raise Refusal(f"there is no argument {unknown[0]} (known: {known})")
        expanded = str(document.documentElement.toxml())
        if len(expanded) > self._most_bytes:
            raise Refusal(f"it expands to more than {self._most_bytes} characters")
        return expanded

    def told(self, error: Exception) -> str:
        """An error in one line, with the file it is in where that is another one."""
        words = " ".join((str(error) or type(error).__name__).split())
        if isinstance(getattr(error, "exc", None), MemoryError):  # which has no words of its own
            words = f"too large {words}"
        stack = [f for f in self._xacro.filestack or [] if f]
        if stack and Path(stack[-1]) != self._file:
            words = f"in {stack[-1]}: {words}"
        return words if len(words) <= 300 else words[:297] + "..."

    def _watch(self, event: str, args: tuple[Any, ...]) -> None:
        if event in _HARMLESS:
            return
        if event in _READING and isinstance(args[0], str | bytes):
            reading = event != "open" or args[1] in ("r", "rb")
            name = os.fsdecode(args[0])
            if reading and is_inside(Path(name), self.folders):
                return
            raise Refusal(f"{name} lies outside of the packages of {self._file.name}")
        raise Refusal(f"{event} is not accepted in a xacro file")

    def _read(self, name: str) -> bytes:
        path = Path(name)
        if not is_inside(path, self.folders):
            raise Refusal(f"{name} lies outside of the packages of {self._file.name}")
        with path.open("rb") as file:
            data = file.read(self._most_bytes + 1)
        if len(data) > self._most_bytes:
            raise Refusal(f"{name} has more than {self._most_bytes} bytes")
        return data

    def _parse(self, given: object, filename: str) -> Any:
        if given is not None:
            raise Refusal("only files are expanded")
        try:
            document = parseString(self._read(filename), forbid_dtd=True)
            declared = document.getElementsByTagName("xacro:arg")
            self._used.update(element.getAttribute("name") for element in declared)
            return document
        except OSError as error:
            self._xacro.filestack.pop()  # as xacro does: an optional file that is not there
            raise self._xacro.XacroException("cannot be read:", exc=error) from error
        except DefusedXmlException as error:
            raise Refusal(f"{filename}: document types and entities are not accepted") from error

    def _substitute(self, text: str) -> str:
        """Replace ``$(find package)``, ``$(arg name)``, ``$(optenv name default)``, ``$(dirname)``.

        Environment and working folder are not those of the description and are not looked at.
        """
        command, *words = text[2:-1].split() or [""]
        if command == "find" and len(words) == 1:
            return str(self._package(words[0]))
        if command == "arg" and len(words) == 1:
            return str(self._argument(words[0]))
        if command == "optenv" and words:
            return " ".join(words[1:])
        if command == "dirname" and not words:
            return str(Path(self._xacro.filestack[-1]).parent)
        raise Refusal(f"{text[:60]} is not accepted in a xacro file")

    def _package(self, name: str) -> Path:
        here = Path(self._xacro.filestack[-1])
        folder = self._packages.find(name) or self._packages.find_near(name, here)
        if folder is None:
            raise Refusal(
                f"package {name} is not among the folders above {self._file.name} or to search"
            )
        self.folders.add(folder)
        return folder

    def _argument(self, name: str) -> Any:
        self._used.add(name)
        given = self._xacro.substitution_args_context["arg"]
        if name not in given:
            raise Refusal(f"argument {name} has no default")
        return given[name]

    def _load_yaml(self, name: str) -> Any:
        for unit in self._xacro.ConstructUnits:
            self._yaml.SafeLoader.add_constructor(unit.value.tag, unit.constructor)
        place = self._xacro.abs_filename_spec(name)
        try:
            return self._xacro.YamlListWrapper.wrap(self._yaml.safe_load(self._read(place)))
        except self._yaml.YAMLError as error:
            raise Refusal(f"{place}: is not YAML: {error}") from error

    def _of_xacro(self) -> dict[str, Callable[..., Any]]:
        def fatal(*words: object) -> None:
            raise ExpressionError(" ".join(map(str, words)))

        def silent(*_: object, **__: object) -> str:
            return ""

        own: dict[str, Callable[..., Any]] = {
            "load_yaml": self._load_yaml,
            "abs_filename": self._xacro.abs_filename_spec,
            "dotify": self._xacro.YamlDictWrapper,
        }
        named = {
            **own,
            "arg": self._argument,
            "fatal": fatal,
            "tokenize": self._xacro.tokenize,
            **dict.fromkeys(("message", "warning", "error", "print_location"), silent),
        }
        return {**own, **{f"xacro.{name}": function for name, function in named.items()}}


def _refuse(*_: object, **__: object) -> None:
    raise Refusal("this version of xacro is not known")


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
    text: str, symbols: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] = FUNCTIONS
) -> Any:
    """Work out an expression of numbers, texts, lists and tables.

    ``symbols``: values by name; a name space is a mapping in it. ``functions``: what may be called,
    by the dotted name it is called by.

    Raises ExpressionError (it is no Python, or holds something that is not listed here), and what
    the operators and functions raise: division by zero, a wrong type.
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
