"""Staubli VAL 3 data files (``.dtx``) as they stand: arrays of elements with their lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from defusedxml import DefusedXmlException, ElementTree

from posedesign.programs.reading import refuse

MOST_ELEMENTS = 100_000
"""Largest size of an array that is believed."""

_WHOLE = re.compile(r"\d{1,6}", re.ASCII)


@dataclass(frozen=True)
class Element:
    """A ``Value`` and its attributes."""

    line: int
    attributes: dict[str, str]


@dataclass(frozen=True)
class DataArray:
    """A ``Data`` and its elements by key."""

    line: int
    name: str
    type: str
    size: int
    elements: dict[int, Element] = field(default_factory=dict)


def read_database(data: bytes, path: Path) -> dict[str, DataArray]:
    """Arrays of a data file by name, in their order.

    Raises
    ------
    FileFormatError
        The file is no XML, has a DTD or entities, is no database of VAL 3, or holds an array or an
        element twice.
    """
    reader = _Reader(path)
    try:
        reader.parser.feed(data)
        reader.parser.close()
    except DefusedXmlException:
        refuse("has a DTD or entities", path, reader.line, "save the application again")
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        reason = f"is no whole XML file: {error}"
        refuse(
            reason, path, reader.line, "name the project's data file, NAME.dtx, or copy it again"
        )
    return reader.arrays


class _Reader:
    """Collects the arrays while the XML is parsed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.arrays: dict[str, DataArray] = {}
        self.parser = ElementTree.DefusedXMLParser(target=self, forbid_dtd=True)
        self._open: list[str] = []
        self._array: DataArray | None = None

    @property
    def line(self) -> int:
        """Where the parser is."""
        return int(self.parser.parser.CurrentLineNumber)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Take the start of an element."""
        name = tag.rpartition("}")[2]
        if not self._open and name != "Database":
            hint = "name the project's data file, NAME.dtx"
            refuse("is no data file of a VAL 3 project", self.path, self.line, hint)
        if name == "Data":
            self._data(attributes)
        elif name == "Value" and self._open[-1] == "Data" and self._array is not None:
            self._value(self._array, attributes)
        self._open.append(name)

    def end(self, tag: str) -> None:
        """Take the end of an element."""
        self._open.pop()

    def data(self, text: str) -> None:
        """Take text between elements: there is none that counts."""

    def close(self) -> None:
        """Take the end of the file."""

    def _data(self, attributes: dict[str, str]) -> None:
        name, size = attributes.get("name", ""), attributes.get("size", "1")
        if not name or name in self.arrays:
            reason = f"{name[:30]!a} is there twice" if name else "an array has no name"
            refuse(reason, self.path, self.line)
        if not _WHOLE.fullmatch(size) or int(size) > MOST_ELEMENTS:
            refuse(f"{name[:30]} has the size {size[:20]!a}", self.path, self.line)
        kind = attributes.get("type", "")
        self._array = self.arrays[name] = DataArray(self.line, name, kind, int(size))

    def _value(self, array: DataArray, attributes: dict[str, str]) -> None:
        key = attributes.get("key", "0")
        if not _WHOLE.fullmatch(key):
            return  # a collection has words for keys, and is no array of positions
        if int(key) >= array.size or int(key) in array.elements:
            reason = "is there twice" if int(key) in array.elements else "is beyond its size"
            refuse(f"{array.name}[{int(key)}] {reason}", self.path, self.line)
        array.elements[int(key)] = Element(self.line, attributes)
