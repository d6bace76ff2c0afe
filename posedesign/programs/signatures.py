"""One table of signatures a language: arguments of functions, their kinds and ranges.

A line of a table is a function and its parameters, e.g. ``sleep t:number[0,]``. Behind the name of
a parameter stand ``?`` where it may be left out, its kind, and its range, round brackets where an
end is none of it. Parameters behind ``|`` are given by name only. Kinds: number, whole, text, flag,
list, pose, joints (a list or a pose is none of a number); none where any value is right.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

_PARAMETER = re.compile(r"(\w+(?:/\w+)*)(\?)?(?::(\w+))?(?:([\[(])(-?[\d.]*),(-?[\d.]*)([\])]))?")
_EXCLUDED = {
    "number": {"text", "flag", "list", "pose"},
    "whole": {"text", "flag", "list", "pose", "fraction"},
    "text": {"number", "flag", "list", "pose"},
    "flag": {"text", "list", "pose"},
    "list": {"number", "text", "flag", "pose"},
    "pose": {"number", "text", "flag", "list"},
    "joints": {"number", "text", "flag"},
}
"""Kinds of values that are wrong for a kind of parameter."""


class Argument(NamedTuple):
    """What a call is given; ``kind`` is empty and ``number`` NaN where the text does not tell."""

    shown: str
    keyword: str = ""
    kind: str = ""
    number: float = math.nan


@dataclass(frozen=True)
class Parameter:
    """A parameter, its kind, and the range of its numbers; ``open_``: without its least."""

    names: tuple[str, ...]
    kind: str = ""
    least: float = -math.inf
    most: float = math.inf
    open_: bool = False

    @property
    def name(self) -> str:
        """What the parameter is called first."""
        return self.names[0]

    def fault(self, given: Argument) -> tuple[str, str]:
        """A rule that an argument breaks, and how; both empty for none."""
        value, wrong = given.number, _EXCLUDED.get(self.kind, ())
        if given.kind in wrong or ("fraction" in wrong and math.isfinite(value) and value % 1):
            return "arguments", f"{self.name} is {given.shown[:60]}, no {self.kind}"
        if value < self.least or value > self.most or (self.open_ and value == self.least):
            ends = f"{'above ' if self.open_ else ''}{self.least:g} to {self.most:g}"
            return "range", f"{self.name} is {given.shown[:60]}, not {ends}"
        return "", ""


@dataclass(frozen=True)
class Signature:
    """Parameters of a function: the first ``least`` are needed, ``most`` can be given by place."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    least: int = 0
    most: int = 0

    @cached_property
    def by_name(self) -> Mapping[str, Parameter]:
        """Parameters by all of their names."""
        return {name: p for p in self.parameters for name in p.names}

    def named(self, given: Sequence[Argument]) -> Iterator[tuple[Parameter, Argument]]:
        """Parameters of the arguments of a call; those that it does not have are left out."""
        known = self.by_name
        for k, argument in enumerate(given):
            parameter = self.parameters[k] if k < len(self.parameters) else None
            parameter = known.get(argument.keyword) if argument.keyword else parameter
            if parameter:
                yield parameter, argument

    @classmethod
    def parse(cls, line: str) -> Signature:
        """The signature of a line of a table."""
        name, *words = line.split()
        by_place = words.index("|") if "|" in words else len(words)
        parameters, needed = [], 0
        for word in words:
            found = _PARAMETER.fullmatch(word)
            if found:
                least, most = (found[5] or "-inf", found[6] or "inf")
                ends = float(least), float(most)
                parameters.append(
                    Parameter(tuple(found[1].split("/")), found[3] or "", *ends, found[4] == "(")
                )
                needed += not found[2]
            elif word != "|":
                raise ValueError(f"{line}: {word} is no parameter")
        return cls(name, tuple(parameters), needed, by_place)

    def faults(self, given: Sequence[Argument]) -> Iterator[tuple[str, str]]:
        """Rules that a call breaks, and how."""
        known = self.by_name
        keywords = [argument.keyword for argument in given if argument.keyword]
        odd = next((word for word in keywords if word not in known), "")
        named = list(self.named(given) if keywords else zip(self.parameters, given, strict=False))
        reason = ""
        if odd:
            reason = f"{self.name} has no {odd[:30]}"
        elif keywords and len({id(parameter) for parameter, _ in named}) < len(named):
            reason = f"{self.name}: an argument is given twice"
        elif keywords and any(a.keyword and not b.keyword for a, b in pairwise(given)):
            reason = f"{self.name}: an argument without a name behind one with"
        elif not self.least <= len(given) or len(given) - len(keywords) > self.most:
            most = len(self.parameters)
            ends = f"{self.least} to {most}" if self.least < most else f"{most}"
            reason = f"{self.name} has {len(given)} arguments, not {ends}"
        if reason:
            yield "arguments", reason
            return
        for parameter, argument in named:
            rule, fault = parameter.fault(argument)
            if rule:
                yield rule, f"{self.name}: {fault}"


def table(text: str) -> dict[str, Signature]:
    """The signatures of the lines of a text, by name; a line may have several: ``a,b x``."""
    found: dict[str, Signature] = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        names, _, rest = line.partition(" ")
        found |= {name: Signature.parse(f"{name} {rest}") for name in names.split(",")}
    return found
