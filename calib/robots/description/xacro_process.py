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
  keep to :mod:`calib.robots.description.packages` and :mod:`calib.robots.description.expression`;
* XML entities and document types are refused in every file.

Run by :func:`calib.robots.description.xacro_file.expand_xacro` only.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from defusedxml import DefusedXmlException
from defusedxml.minidom import parseString

from calib.robots.description.expression import FUNCTIONS, ExpressionError, evaluate
from calib.robots.description.packages import Packages, is_inside

_HARMLESS = frozenset({"builtins.id", "compile", "glob.glob", "glob.glob/2"})
"""``compile``: Python's parser makes the tree of an expression; nothing can be run of it."""

_READING = frozenset({"open", "os.listdir", "os.scandir"})


class Refusal(Exception):
    """Something that a description may not do."""


def run(data: bytes) -> bytes:
    """Expand one file and give the outcome, as JSON; in a process of :mod:`calib.limited`.

    Parameters
    ----------
    data : bytes
        As JSON ``file``: the xacro file; ``search``: folders to search for packages;
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
