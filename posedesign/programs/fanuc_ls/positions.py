"""FANUC ``.LS``: the positions of a /POS section as they stand, whatever their layout."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from posedesign.programs.fanuc_ls.stored import StoredGroup
from posedesign.programs.reading import refuse

# Repeats inside the brackets are bounded: a damaged line of megabytes must not be retried for
# each way in which it could be divided.
_TOKEN = re.compile(
    r"""\s*(?:
      P\s*\[\s*(?P<number>\d{1,6})\s*
        (?::(?:\s*"(?P<quoted>[^"]{0,99})"\s*|(?P<bare>[^]"]{0,99})))?\]\s*\{
    | (?P<close>\}\s*;?)
    | GP(?P<group>\d{1,2})\s*:
    | (?P<frame>UF|UT)\s*:\s*(?P<frame_number>\d{1,3}|F)
    | [CK]ONFIG\s*:\s*'(?P<config>[^']{0,60})'
    | (?P<name>[A-Z]{1,2}\d?)\s*=\s*(?P<value>[^\s,;{}=]+?)\s*(?P<unit>deg|mm)?(?=[\s,;}]|$)
    | [,;]
    | $
    )""",
    re.VERBOSE,
)


@dataclass
class StoredPosition:
    """One position, as it stands in the file."""

    number: int
    name: str
    line: int
    groups: dict[int, StoredGroup] = field(default_factory=dict)
    group: StoredGroup | None = None


class PositionParser:
    """Collects the positions of the /POS section, one line at a time."""

    def __init__(self, path: Path | str) -> None:
        self.path = path
        self.positions: list[StoredPosition] = []
        self._numbers: set[int] = set()
        self._open: StoredPosition | None = None

    def feed(self, line: str, row: int) -> None:
        """Take one more line."""
        at = 0
        while at < len(line):
            token = _TOKEN.match(line, at)
            if token is None:
                rest = line[at:].strip()[:30]
                refuse(f"cannot make sense of {rest!r} in a position", self.path, row)
            at = max(token.end(), at + 1)
            if token["number"] is not None:
                self._begin(token, row)
            elif token.lastgroup is not None:
                self._take(token, row)

    def finish(self, row: int) -> None:
        """End of the section: no position may be open."""
        if self._open is not None:
            refuse(f"P[{self._open.number}] is not closed by }};", self.path, row)

    def _begin(self, token: re.Match[str], row: int) -> None:
        self.finish(row)
        number = int(token["number"])
        if number in self._numbers:
            refuse(f"P[{number}] is there twice", self.path, row, "remove one of them")
        self._numbers.add(number)
        self._open = StoredPosition(number, (token["quoted"] or token["bare"] or "").strip(), row)

    def _take(self, token: re.Match[str], row: int) -> None:
        position = self._open
        if position is None:
            refuse(f"{token[0].strip()[:30]!r} is outside a position", self.path, row)
        group = position.group
        if token["close"]:
            self.positions.append(position)
            self._open = None
        elif token["group"]:
            number = int(token["group"])
            if number in position.groups:
                refuse(f"P[{position.number}] has GP{number} twice", self.path, row)
            position.group = position.groups[number] = StoredGroup(row)
        elif group is None:
            refuse(f"P[{position.number}] has a value outside a group", self.path, row)
        elif token["frame"]:
            value = token["frame_number"]
            group.frames[token["frame"]] = None if value == "F" else int(value)
        elif token["config"] is not None:
            group.config = token["config"]
        elif token["name"] in group.fields:
            refuse(f"P[{position.number}] has {token['name']} twice", self.path, row)
        else:
            group.fields[token["name"]] = (token["value"], token["unit"] or "", row)
