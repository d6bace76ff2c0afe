"""Where a file comes from: what it is, who wrote it from what and when, and whether it was changed.

One line in the file itself says it, so that it goes where the file goes: a comment before a table,
a key of JSON, a comment of TOML, XML or PDF, a text in a PNG. At its end stands a digest of the
whole file, with zeros in place of the digest; a file with another digest was changed by a person.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import struct
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, cast, get_args

Kind = Literal["measured", "simulated", "planned", "computed"]
"""Measured on a robot; made by a simulated one, or from something that was; planned; computed from
what was measured, or from what nothing is known of."""

MOST_BYTES = 200_000_000
"""Of a file that is looked into; a larger one was not written here."""

_HEAD_BYTES = 4000
"""The line stands within them, before any data."""

_DIGITS = 16
_SENTENCE = re.compile(
    r"(?P<kind>\w+) (?P<purpose>[^()\n]+?) by (?P<command>[\w -]+?)"
    r"(?: from (?P<inputs>[^\n]*?))? on (?P<day>\d{4}-\d\d-\d\d) digest (?P<digest>[0-9a-f]{16})"
)
_LINE = re.compile(rb"\b(?:origin|line)\W{1,4}[a-z]+ [^\n]{1,3000}? digest ([0-9a-f]{16})")
_INPUT = re.compile(r"(\S+) \(([0-9a-f]{8})\)")
_PNG, _PNG_HEAD = b"\x89PNG\r\n\x1a\n", 33
"""How a PNG begins, and the bytes up to the end of its first chunk (PNG, 2nd ed., 5.2, 11.2.2)."""


_PDF_ENTRY = re.compile(rb"(\d{10})(?= \d{5} n)")
"""Where an object begins, in the table of a PDF (PDF 1.7, 7.5.4)."""


@dataclass(frozen=True)
class Origin:
    """What a file says of itself.

    ``kind`` {"measured", "simulated", "planned", "computed"}. ``purpose``: what it is: "touch-ups",
    "measuring poses". ``command``: which wrote it. ``inputs``: names of the files that it was made
    from, and the first 8 hexadecimal digits of their SHA-256. ``day``: when, as in 2026-05-31
    (UTC): a day, so that the same work gives the same bytes.
    """

    kind: Kind
    purpose: str
    command: str
    inputs: tuple[tuple[str, str], ...] = ()
    day: str = ""

    @classmethod
    def of(cls, kind: Kind, purpose: str, command: str, inputs: Iterable[Path] = ()) -> Origin:
        """The origin of what is made from files now: simulated where one of them is.

        Measured data stays measured, whatever it was planned with. The day is that of
        ``SOURCE_DATE_EPOCH`` where that is set.
        """
        files = [path for path in inputs if path.is_file()]
        if kind != "measured" and any(is_simulated(path) for path in files):
            kind = "simulated"
        listed = tuple((_word(path.name), checksum(path)) for path in files)
        return cls(kind, purpose, command, listed, _today())

    def __str__(self) -> str:
        made_from = " ".join(f"{name} ({mark})" for name, mark in self.inputs)
        words = f"{self.kind} {self.purpose} by {self.command}"
        return words + (f" from {made_from}" if made_from else "") + f" on {self.day}"


def origin_of(path: Path | str) -> Origin | None:
    """What a file says of itself; None where it says nothing, or cannot be read."""
    return _read(head_of(path))[0]


def head_of(path: Path | str, most_bytes: int = _HEAD_BYTES) -> bytes:
    """The first bytes of a file; none where it cannot be read, or is a pipe."""
    if not os.path.isfile(path):
        return b""
    try:
        with open(path, "rb") as stream:
            return stream.read(most_bytes)
    except (OSError, ValueError):
        return b""


def is_simulated(path: Path | str) -> bool:
    """Whether a file says that it comes from a simulated robot."""
    found = origin_of(path)
    return found is not None and found.kind == "simulated"


def rehearsed(inputs: Iterable[Path | None]) -> str:
    """What to say before any result where one of the inputs is simulated; else empty."""
    said = [f"{path}: {origin_of(path)}" for path in inputs if path and is_simulated(path)]
    return f"SIMULATED, not for a robot: from {'; '.join(said)}" if said else ""


def described(path: Path) -> str:
    """A file in words that no format gives a meaning: name, checksum, and what it says it is."""
    found = origin_of(path)
    said = f", {found.kind} {found.purpose} by {found.command}" if found else ""
    return f"{_word(path.name)} ({checksum(path)}){said}"


def read_whole(path: Path) -> tuple[Origin | None, bool]:
    """What a file says of itself, and whether it is as it was written."""
    try:
        if path.stat().st_size > MOST_BYTES:
            return None, False
        data = path.read_bytes()
    except OSError:
        return None, False
    origin, written = _read(data[:_HEAD_BYTES])
    return origin, origin is not None and _digest(_with_digest(data, "")) == written


def checksum(path: Path) -> str:
    """The first 8 hexadecimal digits of the SHA-256 of a file; zeros where it cannot be read."""
    try:
        if not path.is_file():  # a pipe would be waited for
            return "0" * 8
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()[:8]
    except OSError:
        return "0" * 8


def stamped(data: bytes, name: str, origin: Origin) -> bytes:
    """The content of a file with its origin, as the ending of its name has comments.

    ``data``: text in UTF-8, a PNG, or a PDF with one table of its objects. ``name``: of the file:
    ``.csv``, ``.toml``, ``.yaml``, ``.json`` (an object), ``.urdf``, ``.xml``, ``.launch``,
    ``.html``, ``.svg``, ``.png`` or ``.pdf``.
    """
    line = f"{origin} digest {'0' * _DIGITS}"
    ending = Path(name).suffix.lower()
    if ending == ".json":
        said = {**asdict(origin), "inputs": dict(origin.inputs), "line": line}
        data = data.replace(b"{", b"{\n  " + f'"origin": {json.dumps(said)},'.encode(), 1)
    elif ending == ".png":
        text = b"tEXtComment\0" + f"origin: {line}".encode()
        chunk = struct.pack(">I", len(text) - 4) + text + bytes(4)
        data = data[:_PNG_HEAD] + chunk + data[_PNG_HEAD:]
    elif ending == ".pdf":
        data = _with_comment(data, f"% origin: {line}\n".encode())
    elif ending in (".urdf", ".xml", ".launch", ".html", ".svg"):
        declared = re.match(rb"(?i)<(?:\?xml|!doctype)[^>]*>\s*", data)
        at = declared.end() if declared else 0
        data = data[:at] + f"<!-- origin: {line} -->\n".encode() + data[at:]
    else:
        data = f"# origin: {line}\n".encode() + data
    return _with_digest(data, _digest(data))


def _with_comment(data: bytes, comment: bytes) -> bytes:
    """A PDF with a comment more at its beginning, and a table of where its objects are now.

    ``data``: with one table, as it is written the first time (PDF 1.7, 7.5).
    """
    begins = re.match(rb"(?:%[^\n]*\n)+", data)
    at = begins.end() if begins else 0
    before, mark, end = data.rpartition(b"startxref\n")
    start, _, rest = end.partition(b"\n")
    table = int(start)
    moved = _PDF_ENTRY.sub(lambda entry: b"%010d" % (int(entry[1]) + len(comment)), before[table:])
    start = b"%d" % (table + len(comment))
    return b"".join((data[:at], comment, before[at:table], moved, mark, start, b"\n", rest))


def _with_digest(data: bytes, digest: str) -> bytes:
    """The same with another digest; without one zeros, also in a PNG for what follows from it."""
    found = _LINE.search(data[:_HEAD_BYTES])
    if found is None:
        return data
    at, end = found.span(1)
    data = data[:at] + (digest or "0" * _DIGITS).encode() + data[end:]
    if not data.startswith(_PNG):
        return data
    check = zlib.crc32(data[_PNG_HEAD + 4 : end]) if digest else 0
    return data[:end] + struct.pack(">I", check) + data[end + 4 :]


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGITS]


def _read(head: bytes) -> tuple[Origin | None, str]:
    """What the first bytes of a file say, and the digest that they give."""
    line = _LINE.search(head)
    found = _SENTENCE.search(line[0].decode("utf-8", "replace")) if line else None
    if found is None or found["kind"] not in get_args(Kind):
        return None, ""
    inputs = tuple((name, mark) for name, mark in _INPUT.findall(found["inputs"] or ""))
    kind = cast(Kind, found["kind"])
    return Origin(kind, found["purpose"], found["command"], inputs, found["day"]), found["digest"]


def _word(name: str) -> str:
    """A file's name as one word that no format gives a meaning."""
    return re.sub(r"[^\w.]+|--+", "_", name)[:60] or "_"


def _today() -> str:
    seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(seconds), UTC) if seconds.isdecimal() else datetime.now(UTC)
    return f"{now:%Y-%m-%d}"
