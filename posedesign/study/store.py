"""Results of a study on disk: each task's as it is done, and one table when all are."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.errors import FileFormatError, OutputError
from posedesign.files import (
    folder_inside,
    held,
    identity_of,
    json_text,
    load_json,
    make_folder,
    not_written,
    read_bytes_bounded,
    write_bytes_atomic,
    write_text_atomic,
)

if TYPE_CHECKING:
    import pandas as pd

Columns = Mapping[str, Any]
"""A table by columns: arrays or lists of one length."""

_ABOUT, _PARTS = "about.json", "parts"
_ENDINGS = (".csv", ".parquet")
_PART = re.compile(r"(\d{9})(\.csv|\.parquet)", re.ASCII)
_MOST_BYTES = 1_000_000


class Store:
    """A folder of results, of one study with one set of numbers.

    Every task's rows are written whole or not at all, under the number of the task. When all are
    there they are put behind each other, in the order of the tasks and one at a time, into one
    table; so it is the same whatever the workers were, and however often it was stopped.

    ``name``: of the tables: ``name.parquet`` where pyarrow is installed, else ``name.csv``.
    ``about``: what makes results comparable: the study and all its numbers.
    """

    def __init__(self, folder: Path, name: str, about: Mapping[str, Any]) -> None:
        self.folder = folder
        self._name = name
        self._about = json.loads(json_text(about))
        self._ending = ".parquet" if has_parquet() else ".csv"
        self._place: tuple[int, int] | None = None  # the folder of parts as it was opened

    @property
    def table(self) -> Path:
        """The table of all results."""
        return self.folder / f"{self._name}{self._ending}"

    @contextmanager
    def open(self, *, restart: bool = False) -> Iterator[None]:
        """Hold the folder, and check that what is in it is of this study.

        Raises InputError: another process is running a study in it. FileFormatError: the folder has
        results of other numbers, or files of other origin under their names. OutputError: the
        folder cannot be written.
        """
        make_folder(self.folder)
        with held(self.folder, "running a study"):
            about = self.folder / _ABOUT
            if not about.exists():
                self._check_free()
            elif restart:
                self._clear()
            else:
                self._check(about)
            if not about.exists():
                write_text_atomic(about, json_text(self._about) + "\n")
            self._place = identity_of(folder_inside(self.folder / _PARTS))
            yield

    def done(self) -> set[int]:
        """Numbers of tasks whose results are there."""
        if self.table.exists():
            return set(range(int(self._about.get("tasks", 0))))
        names = (path.name for path in (self.folder / _PARTS).iterdir())
        return {
            int(found[1])
            for found in map(_PART.fullmatch, names)
            if found and found[2] == self._ending
        }

    def write(self, number: int, columns: Columns) -> None:
        """Write the results of a task."""
        data = _encoded(columns, self._ending)
        if identity_of(self.folder / _PARTS) != self._place:
            raise OutputError(
                f"{self.folder} was removed or replaced since this began",
                hint="put the folder back, and start the same command again",
                name=str(self.folder),
            )
        write_bytes_atomic(self.folder / _PARTS / f"{number:09d}{self._ending}", data)

    def assemble(self, count: int) -> Path:
        """One table of the results of all ``count`` tasks, in order; the parts are removed.

        Raises FileFormatError: a part is damaged. OutputError: the table cannot be written.
        """
        if not self.table.exists():
            parts = [self.folder / _PARTS / f"{k:09d}{self._ending}" for k in range(count)]
            aside = self.table.with_name(f".{self.table.name}")
            try:
                _join(parts, aside)
                aside.replace(self.table)
            except OSError as error:
                aside.unlink(missing_ok=True)
                hint = "make room, then start the same command again"
                raise not_written(self.table, error, hint) from error
            except ValueError as error:
                aside.unlink(missing_ok=True)
                raise _damaged(self.folder / _PARTS, error) from error
        shutil.rmtree(self.folder / _PARTS, ignore_errors=True)
        return self.table

    def read(self) -> pd.DataFrame:
        """The table of all results."""
        return read_table(self.table)

    def _tables(self) -> list[Path]:
        return [self.folder / f"{self._name}{ending}" for ending in _ENDINGS]

    def _check_free(self) -> None:
        """Without a note of what is in the folder, nothing in it was made here."""
        for path in (self.folder / _PARTS, *self._tables()):
            if path.exists():
                raise FileFormatError(
                    f"is there already, and no {_ABOUT} that says what of",
                    path=path,
                    hint="name another folder with `out`",
                )

    def _clear(self) -> None:
        """Remove results; the note of what they are of goes last."""
        try:
            shutil.rmtree(self.folder / _PARTS, ignore_errors=True)
            for path in (*self._tables(), self.folder / _ABOUT):
                path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"{error.filename}: cannot be removed: {error.strerror}",
                hint="name another folder with `out`",
                name=str(self.folder),
            ) from error

    def _check(self, about: Path) -> None:
        try:
            found = load_json(read_bytes_bounded(about, most_bytes=_MOST_BYTES))
        except ValueError:
            found = None
        if found != self._about:
            raise FileFormatError(
                f"the folder has results of {self._difference(found)}",
                path=about,
                hint="name another folder with `out`, or begin anew with `restart`",
            )

    def _difference(self, found: object) -> str:
        """What other results there are, in words."""
        if not isinstance(found, dict) or found.get("study") != self._about.get("study"):
            return "another study"
        for key, value in self._about.items():
            there = found.get(key)
            if there != value and isinstance(value, float | int | str) and key != "tasks":
                return f"other numbers: {key} was {there}, and is {value} now"
        return "other numbers"


def has_parquet() -> bool:
    """Whether tables are written as Parquet."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return False
    return True


def read_table(path: Path) -> pd.DataFrame:
    """A table of results, whatever its form.

    Raises FileFormatError: it is not there, or damaged.
    """
    import pandas as pd

    try:
        return pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> FileFormatError:
    first = str(error).partition("\n")[0]
    return FileFormatError(f"cannot be read: {first}", path=path, hint="begin anew with `restart`")


def _encoded(columns: Columns, ending: str) -> bytes:
    import pandas as pd

    frame = pd.DataFrame(dict(columns))
    if ending == ".parquet":
        stream = io.BytesIO()
        frame.to_parquet(stream, index=False)
        return stream.getvalue()
    return frame.to_csv(index=False, lineterminator="\n").encode()


def _join(parts: Sequence[Path], target: Path) -> None:
    """Put parts behind each other, one in memory at a time."""
    if target.name.endswith(".parquet"):
        import pyarrow.parquet as pq

        schema = pq.read_schema(parts[0])
        with pq.ParquetWriter(target, schema) as writer:
            for part in parts:
                writer.write_table(pq.read_table(part, schema=schema))
        return
    with open(target, "wb") as out:
        for k, part in enumerate(parts):
            with open(part, "rb") as stream:
                head = stream.readline()
                if k == 0:
                    out.write(head)
                shutil.copyfileobj(stream, out)
