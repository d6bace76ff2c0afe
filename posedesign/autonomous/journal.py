"""Measurements kept as they are made: a calibration that is stopped goes on where it was.

One line of JSON a measurement, pushed to the disk before the next one begins. A process that asks
for the same measurements in the same order is run again from the start and finds its answers here,
up to the one it was stopped at. A line that was cut off when the machine went down is dropped, and
what failed at the end is tried again: somebody may have brought the target into view since.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from calib.errors import FileFormatError, InputError, OutputError
from calib.se3 import FloatArray
from posedesign.files import identity_of, json_text, load_json, read_bytes_bounded

MOST_BYTES = 50_000_000
"""A touch-up takes half a kilobyte: a hundred thousand of them are no calibration of a robot."""

_VERSION = 2
_HEAD = b'{"posedesign": "calibration"'
"""How the first line begins."""

_SAME_RAD = 1e-9
"""Joint values asked for that differ by less are the same: they come out of the same arithmetic."""

T = TypeVar("T")


class Journal:
    """A file of named measurements, each with what was asked.

    One process may have it open at a time; see :func:`~posedesign.files.locking.held`.

    Parameters
    ----------
    path : Path
        Made where it does not exist.
    about : mapping of str to str
        What the measurements are of, each under a word for it: robot, description, cell. Where the
        journal has another one under a word, it is named.

    Raises
    ------
    FileFormatError
        The file is of another calibration, of another version, damaged, or no journal; it is left
        as it is.
    OutputError
        It cannot be written, or is a link.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self._kept: dict[str, dict[str, Any]] = {}
        lines, length = self._read()
        if lines:
            self._check_head(lines[0], about)
        while len(lines) > 1 and _failed(lines[-1]):
            lines.pop()  # what it was stopped by, and may be mended now
        for entry in lines[1:]:
            self._kept[str(entry.get("name"))] = entry
        try:
            # no buffer: what could not be written must not be tried again when it is closed
            self._stream = open(path, "ab", buffering=0, opener=_opened)  # noqa: SIM115 -- closed by __exit__
            self._stream.truncate(length)  # a line was cut off when the machine went down
        except OSError as error:
            raise _not_written(path, error, "choose another --out") from error
        self._length = length
        self._folder = identity_of(path.parent)
        if not lines:
            head = {"posedesign": "calibration", "version": _VERSION, "about": dict(about)}
            try:
                self._append(head)
            except BaseException:
                self._stream.close()
                raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()

    def __len__(self) -> int:
        return len(self._kept)

    def recall(
        self,
        name: str,
        asked: FloatArray,
        measure: Callable[[], Mapping[str, Any]],
        read: Callable[[dict[str, Any]], T],
    ) -> T:
        """The answer kept under a name, or that of measuring now, which is kept.

        Parameters
        ----------
        name : str
        asked : array (k,)
            What is asked for, joint values first [rad].
        measure : callable
            Makes the measurement; what it raises comes out as it is.
        read : callable
            What an answer says; a KeyError, TypeError, ValueError or IndexError of it means that
            the answer is damaged.

        Raises
        ------
        InputError
            Something else was asked for under this name.
        FileFormatError
            The answer cannot be read.
        OutputError
            The answer cannot be written.
        """
        if name not in self._kept:
            self.check_place()  # before an arm moves for what could not be kept
            # as it will be read, so that it is the same whether it was measured now or before
            self._kept[name] = self._append({"name": name, "asked": asked, "answer": measure()})
        entry = self._kept[name]
        try:
            before = np.asarray(entry["asked"], dtype=float)
            same = before.shape == asked.shape and np.allclose(
                before, asked, rtol=0, atol=_SAME_RAD
            )
            if same:
                return read(dict(entry["answer"]))
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise FileFormatError(
                f"the measurement {name} cannot be read",
                path=self.path,
                hint="remove its line and all after it to measure from there on, or --restart",
            ) from error
        raise InputError(
            f"{self.path}: {name} was measured at another posture than it is asked for now",
            hint="go on with the cell and the options that it was begun with, or --restart",
            name=name,
        )

    def check_place(self) -> None:
        """Refuse to go on where the file, or the folder that it is in, is no longer the same.

        Raises
        ------
        OutputError
            It was removed, or replaced by another one or by a link: what is measured would be lost.
        """
        own = os.fstat(self._stream.fileno())
        same = (
            not self.path.is_symlink()
            and identity_of(self.path) == (own.st_dev, own.st_ino)
            and identity_of(self.path.parent) == self._folder
        )
        if not same:
            raise OutputError(
                f"{self.path} was removed or replaced while it was written",
                hint="put its folder back, and start the same command again",
                name=str(self.path),
            )

    def _append(self, entry: dict[str, Any]) -> dict[str, Any]:
        written: dict[str, Any] = json.loads(json_text(entry))
        line = json.dumps(written).encode() + b"\n"
        self.check_place()
        left = line
        try:
            while left:
                left = left[self._stream.write(left) :]
            os.fsync(self._stream.fileno())
        except OSError as error:
            with suppress(OSError):  # the part of a line: whoever reads it drops it as well
                self._stream.truncate(self._length)
            raise _not_written(
                self.path, error, "make room, then start the same command again"
            ) from error
        self._length += len(line)
        return written

    def _read(self) -> tuple[list[dict[str, Any]], int]:
        """Whole lines, and how many bytes they take."""
        if not self.path.exists():
            return [], 0
        data = read_bytes_bounded(self.path, most_bytes=MOST_BYTES)
        *whole, cut = data.split(b"\n")
        if not whole and not cut.startswith(_HEAD[: len(cut)]):
            raise self._no_journal()
        lines = [self._entry(number, line) for number, line in enumerate(whole, start=1) if line]
        return lines, len(data) - len(cut)

    def _entry(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            entry = load_json(line)
        except ValueError:
            entry = None
        if isinstance(entry, dict):
            return entry
        if number == 1:
            raise self._no_journal()
        raise FileFormatError(
            "is damaged",
            path=self.path,
            row=number,
            hint="remove this line and all after it to measure from there on, or --restart",
        )

    def _check_head(self, head: dict[str, Any], about: Mapping[str, str]) -> None:
        if head.get("posedesign") != "calibration":
            raise self._no_journal()
        if head.get("version") != _VERSION:
            raise FileFormatError(
                f"is a journal of version {head.get('version')!r:.20}, this program has {_VERSION}",
                path=self.path,
                hint="go on with the program that it was begun with, or choose another --out",
            )
        begun = head.get("about")
        for what, own in about.items():
            other = begun.get(what) if isinstance(begun, dict) else None
            if other != own:
                shown = f" ({other!s:.200})" if what == "robot" else ""
                raise FileFormatError(
                    f"was begun with another {what}{shown}, not with {_told(what, own)}",
                    path=self.path,
                    hint="choose another --out, or --restart",
                    value=other,
                    bound=own,
                )

    def _no_journal(self) -> FileFormatError:
        return FileFormatError(
            "is no journal of a calibration", path=self.path, hint="choose another --out"
        )


def _told(what: str, own: str) -> str:
    """What a journal is to be of, for the one who is refused."""
    return own if what == "robot" else f"the {what} that there is now"


def _opened(path: str, flags: int) -> int:
    """Open a file for writing, and no link: what stands behind it is somebody else's."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _not_written(path: Path, error: OSError, hint: str) -> OutputError:
    return OutputError(f"{path}: cannot be written: {error.strerror}", hint=hint, name=str(path))


def _failed(entry: dict[str, Any]) -> bool:
    """Whether an entry is of a measurement that saw nothing, or did not arrive."""
    answer = entry.get("answer")
    if not isinstance(answer, dict):
        return False
    reasons = answer.get("reasons")
    return bool(answer.get("reason")) or (isinstance(reasons, list) and any(reasons))
