"""Extension of griffe: docstrings refer to names as reStructuredText does; pages are Markdown."""

from __future__ import annotations

import re
from typing import Any

import griffe

_ROLE = re.compile(r":\w+:`[~.]?(?:[\w.]+\.)?([^`.]+)`")
_PAPER = re.compile(r"(?:^\s*\.\. )?\[([A-Z]\w+\d{4})\](?:_| )", re.MULTILINE)
_INTERVAL = re.compile(r"([\])]) \[")


def plain_names(text: str) -> str:
    """The same text with plain names in place of references to code and papers.

    A unit after an interval, as in [0, pi] [rad], is no link.
    """
    text = _PAPER.sub(r"\1 ", _ROLE.sub(r"`\1`", text))
    return _INTERVAL.sub(r"\1 \\[", text)


class PlainDocstrings(griffe.Extension):
    """Leave no reStructuredText in docstrings that are shown as Markdown."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring as it is read."""
        if obj.docstring is not None:
            obj.docstring.value = plain_names(obj.docstring.value)
