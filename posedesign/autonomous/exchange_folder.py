"""A folder that files are exchanged through: orders out, results in, both under numbers.

Files go out whole and all of an order before its last one; results are taken when they do not
change any more and can be read. Names that files come with are compared with those that are looked
for, and never used to make others.
"""

from __future__ import annotations

import os
import re
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from calib.errors import FileFormatError, InputError
from posedesign.files import not_written
from posedesign.programs.program import in_range

LONGEST_S = 7 * 24 * 3600.0
"""Longest wait: over a week-end that nobody is at the cell, and some days more."""

_NUMBERED = re.compile(r"(?:move)?(\d{4})(?!\d).*", re.ASCII | re.DOTALL)

_CHECK = "check that it is there, can be written and has free space"

T = TypeVar("T")


@dataclass(frozen=True)
class ExchangeFolder:
    """A folder with ``out`` for orders and ``in`` for results; both are made if need be.

    ``folder``: must exist: a share that is not connected is not replaced by a folder on this disk.
    ``timeout_s``: longest wait for a result [s]. ``poll_s``: time from look to look [s]. A file is
    read when it has not changed between two. Raises InputError: there is no such folder, a link
    leads out of it, or a time is out of its range. OutputError: the folder cannot be written.
    """

    folder: Path
    timeout_s: float
    poll_s: float

    def __post_init__(self) -> None:
        in_range("poll_s", self.poll_s, 1e-3, 60.0)
        in_range("timeout_s", self.timeout_s, self.poll_s, LONGEST_S)
        if not self.folder.is_dir():
            raise InputError(
                f"there is no folder {self.folder}",
                hint="create it, or connect the share that it is on",
                name=str(self.folder),
            )
        for place in (self.orders, self.results):
            _refuse_link(place)
            try:
                place.mkdir(exist_ok=True)
            except OSError as error:
                raise not_written(place, error, _CHECK) from error

    @property
    def orders(self) -> Path:
        """Where orders are written."""
        return self.folder / "out"

    @property
    def results(self) -> Path:
        """Where results are looked for."""
        return self.folder / "in"

    def last_number(self) -> int:
        """Highest number of an order that is there; 0 for none."""
        return max((number_of(name) for name in _entries(self.orders)), default=0)

    @contextmanager
    def publishing(self, last: str) -> Iterator[Path]:
        """A folder that an order is written in unseen; left without an error, it goes out.

        ``last``: name of the file that goes last, when all others are there. Raises OutputError:
        the folder cannot be written. InputError: a link leads out of it by now.
        """
        try:
            with tempfile.TemporaryDirectory(
                prefix=".making-", dir=self.folder, ignore_cleanup_errors=True
            ) as name:
                aside = Path(name)
                yield aside
                entries = sorted(aside.iterdir(), key=lambda e: (e.name == last, e.name))
                _refuse_link(self.orders)
                with _unmoved(self.orders) as folder:
                    for entry in entries:
                        # a link that stands there is replaced, not followed
                        os.replace(entry, folder.path / entry.name, dst_dir_fd=folder.descriptor)
        except OSError as error:
            raise not_written(self.orders, error, _CHECK) from error

    def refuse_early(self, is_its: Callable[[str], bool], event: str) -> None:
        """Refuse a result that is there before it was ordered.

        ``is_its``: whether the file of this name would be taken for the result. ``event``: what it
        was there before, in words. Raises InputError: there is such a file. FileFormatError: the
        folder cannot be listed.
        """
        early = next((name for name in sorted(_entries(self.results)) if is_its(name)), None)
        if early is not None:
            raise InputError(
                f"{self.results / early} was there before {event}: it is the result of something "
                "else",
                hint=f"move what is in {self.results} elsewhere, then go on",
                name=early,
            )

    def find(self, label: str, endings: Sequence[str]) -> Path | None:
        """The result of this name and the first of these endings that is there.

        Letters of either case are the same: controllers write names in capitals.
        """
        _refuse_link(self.results)
        folder = (self.results / label).parent
        stem = Path(label).name
        try:
            names = {name.casefold(): name for name in _entries(folder)}
        except FileFormatError:  # a share that is gone for a moment: nothing has come
            return None
        wanted = (names.get((stem + ending).casefold()) for ending in endings)
        found = next((name for name in wanted if name is not None), None)
        return None if found is None else folder / found

    def wait(
        self, label: str, endings: Sequence[str], read: Callable[[Path], T], hint: str
    ) -> tuple[T, Path]:
        """Wait for a result that does not change any more and can be read.

        ``label``: name of the file without ending, in the folder of results. ``endings``: that it
        may have. ``read``: reads it; a FileFormatError means that it is not whole yet. ``hint``:
        what to do where nothing comes. Returns what was read, and the file. Raises FileFormatError:
        it has not come in time, or could not be read until then.
        """
        until = time.monotonic() + self.timeout_s
        before: tuple[object, ...] | None = None
        while True:
            late = time.monotonic() >= until
            path = self.find(label, endings)
            stamp = None if path is None else _stamp(path)
            problem = None
            if path is not None and stamp is not None and stamp == before:
                try:
                    return read(path), path
                except FileFormatError as error:
                    problem = error
            if late and path is None:
                wanted = self.results / f"{label}{endings[0]}"
                raise FileFormatError(
                    f"has not come in {self.timeout_s:g} s", path=wanted, hint=hint
                )
            if late and path is not None:
                raise self._unusable(path, problem) from problem
            before = stamp
            time.sleep(self.poll_s)

    def _unusable(self, path: Path, problem: FileFormatError | None) -> FileFormatError:
        why = (
            ": it changes, or is no ordinary file"
            if problem is None
            else problem.message.removeprefix(str(path))
        )
        return FileFormatError(
            f"could not be used in {self.timeout_s:g} s{why}",
            path=path,
            hint="save it again, whole; asked again, it is waited for again",
        )


@dataclass(frozen=True)
class _Opened:
    """A folder that names are relative to: the open one where the system can do that."""

    path: Path
    descriptor: int | None


@contextmanager
def _unmoved(folder: Path) -> Iterator[_Opened]:
    """A folder that stays the same while it is written, whatever is put in its place."""
    if os.rename not in os.supports_dir_fd:
        yield _Opened(folder, None)
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        yield _Opened(Path(), descriptor)
    finally:
        os.close(descriptor)


def _refuse_link(place: Path) -> None:
    if place.is_symlink():
        raise InputError(
            f"{place} is a link",
            hint="nothing is written or read outside the folder: make it a folder",
            name=str(place),
        )


def number_of(name: str) -> int:
    """Number of the order that a file or a pose is named after; 0 for none."""
    found = _NUMBERED.fullmatch(name.casefold())
    return 0 if found is None else int(found[1])


def _entries(folder: Path) -> list[str]:
    """Names of what is in a folder."""
    try:
        return os.listdir(folder)
    except OSError as error:
        raise FileFormatError(
            f"cannot be listed: {error.strerror or error}",
            path=folder,
            hint="is the share that it is on connected?",
        ) from error


def _stamp(path: Path) -> tuple[object, ...] | None:
    """What changes while a file is written; None for what is no ordinary file, or gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return (path, status.st_size, status.st_mtime_ns) if stat.S_ISREG(status.st_mode) else None
