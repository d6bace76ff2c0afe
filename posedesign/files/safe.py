"""Files written whole or not at all, never over what somebody else wrote, and read up to a size.

A robot program or a table that was cut off half-way can still be loaded, and then moves an arm.
So every file is written aside, in the same folder, and then renamed: readers see the old content
or the new one, never a part.

What a command is going to write it claims first, before any work: :class:`Results`. A file that is
there already is replaced only where the same command wrote it for the same purpose and nobody
changed it since; measured data only from the same files. :mod:`posedesign.files.origin` tells.
"""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import FileFormatError, OutputError
from calib.limited import read_bounded
from posedesign.files.origin import Kind, Origin, origin_of, read_whole, stamped

StrPath = str | os.PathLike[str]

MEASURED = ("touchups.csv", "measurements.csv", "pairs.csv")
"""Usual names of tables that people measure; without an origin they are taken for measured."""


@dataclass(frozen=True)
class Claim(os.PathLike[str]):
    """A file that a command is going to write, and was found free to; a path to write it under.

    Whatever writes files here takes it for a path, and the file then says its origin.
    """

    path: Path
    origin: Origin
    overwrite: bool = False
    """Whether what is there may be replaced; it is kept beside it, under a name with a number."""
    say: Callable[[str], None] = lambda text: None  # told where what was there is kept
    needed_by: str = ""  # what else belongs to what is there, in words; empty for nothing
    bare: bool = False
    """Whether the file cannot say its origin: other programs could not read it then. It is checked
    when it is written, and may be replaced by the same bytes only."""
    place: tuple[int, int] | None = None
    """The folder as it was claimed in, by device and number: see :func:`identity_of`."""

    def __fspath__(self) -> str:
        return str(self.path)

    __str__ = __fspath__

    @property
    def foreign(self) -> str:
        """Why what is there is not to be replaced, in words; empty where nothing forbids it."""
        if not self.path.exists():
            return ""
        if not self.path.is_file():
            raise OutputError(
                f"{self.path} is not an ordinary file", hint="name a file", name=str(self.path)
            )
        there, intact = read_whole(self.path)
        own = self.origin
        if there is None:
            return "does not say where it is from"
        if (there.kind, there.purpose, there.command) != (own.kind, own.purpose, own.command):
            return f"holds {there}"
        if not intact:
            return "was changed since it was written"
        if own.kind == "measured" and there.inputs != own.inputs:
            return f"holds {there}: other measurements"
        return f"belongs to {self.needed_by}" if self.needed_by else ""

    def check(self) -> str:
        """Why what is there has to be kept aside, empty for nothing.

        Raises OutputError: what is there must not be replaced.
        """
        self._check_place()
        why = self.foreign
        there = origin_of(self.path)
        is_measured = there.kind == "measured" if there else self.path.name in MEASURED
        measured = self.origin.kind == "simulated" and is_measured
        if why and (measured or not self.overwrite):
            raise OutputError(
                f"{self.path} {why}: it is not replaced by {self.origin.kind} "
                f"{self.origin.purpose}",
                hint="name another output folder"
                + ("" if measured else ", or overwrite: it is then kept under another name"),
                name=str(self.path),
            )
        return why

    def _check_place(self) -> None:
        """Refuse a folder that is another one than when it was claimed in, and a link to nothing.

        A folder that was not there yet is made by this command, and so is no link.
        """
        folder = self.path.parent
        if folder.is_symlink() if self.place is None else identity_of(folder) != self.place:
            raise OutputError(
                f"{folder} was removed or replaced since this began",
                hint="put the folder back, and start the same command again",
                name=str(self.path),
            )
        refuse_dangling(self.path)

    def write(self, data: bytes) -> Path:
        """Write the file with its origin, and keep aside what is there and is not ours."""
        self._check_place()
        if not self.bare:
            data = stamped(data, self.path.name, self.origin)
        if self.path.is_file() and self.path.read_bytes() == data:
            return self.path
        aside = kept_aside(self.path) if self.check() else None
        make_folder(self.path.parent)
        written = write_bytes_atomic(self.path, data)
        if aside is not None:
            self.say(f"{self.path}: what was there is kept as {aside.name}")
        return written


def identity_of(path: Path) -> tuple[int, int] | None:
    """What a file or folder is, under whatever name: device and number; None where it is not."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def refuse_dangling(path: Path) -> None:
    """Refuse to write by a link to what is not there: it may stand anywhere."""
    if path.is_symlink() and not path.exists():
        raise OutputError(
            f"{path} is a link to what is not there",
            hint="remove the link, or name another output folder",
            name=str(path),
        )


def folder_inside(path: Path) -> Path:
    """Create a folder inside the output folder.

    Raises OutputError: it is a link, which may lead out of the output folder, or a file; or it
    cannot be created.
    """
    if path.is_symlink():
        raise OutputError(
            f"{path} is a link, and not a folder of its own",
            hint="remove the link, or name another output folder",
            name=str(path),
        )
    return make_folder(path)


def kept_aside(path: Path) -> Path:
    """Give what is at a path a second name, the first that is free of ``path.1``, ``path.2``, ...

    The first name stays until it is written anew, so that a stop in between loses neither.
    """
    target = Path(os.path.realpath(path))
    number = 1
    while os.path.lexists(aside := target.with_name(f"{target.name}.{number}")):
        number += 1
    try:
        try:
            os.link(target, aside)
        except OSError:  # no second names on this disk
            write_bytes_atomic(aside, target.read_bytes())
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be kept aside: {error.strerror or error}",
            hint="name another folder: `out`",
            name=str(path),
        ) from error
    return aside


@dataclass(frozen=True)
class Results:
    """The folder that one command writes its results into."""

    folder: Path
    command: str = "Python"  # name of the command, or of who else writes
    inputs: Sequence[Path] = ()  # files that the results are made from
    overwrite: bool = False  # whether files that are not its own may be replaced, and kept aside
    say: Callable[[str], None] = lambda text: None  # told of what is kept aside
    remakes: bool = False  # whether all that follows from its plan is made anew, too
    place: tuple[int, int] | None = None  # the folder as it was at first; see :func:`identity_of`

    @classmethod
    def of(cls, out: Path | Results, command: str) -> Results:
        """Results of the caller's, or of this command into a folder."""
        return out if isinstance(out, Results) else cls(out, command)

    def claim(
        self,
        kind: Kind,
        *files: tuple[str, str],
        inputs: Sequence[Path] = (),
        needed_by: Mapping[str, str] | None = None,
        bare: bool = False,
        check: bool = True,
    ) -> list[Claim]:
        """Claim files before the work: all may be written, or none is.

        ``kind`` {"measured", "simulated", "planned", "computed"}. ``*files``: name and purpose of
        each. ``inputs``: that they are made from, besides those of the command. ``needed_by``: by
        name, what else belongs to the file that is there. ``bare``: whether they cannot say their
        origin; see :class:`Claim`. ``check``: whether what is there is looked at now, and not only
        when they are written. Raises OutputError: one is there, and is not this command's own or
        was changed; or it is in the way; or its folder is closed to writing.
        """
        refuse_dangling(self.folder)
        used = dict.fromkeys((*self.inputs, *inputs))
        claims = [
            Claim(
                self.folder / name,
                Origin.of(kind, purpose, self.command, used),
                self.overwrite,
                self.say,
                (needed_by or {}).get(name, ""),
                bare,
                self.place or identity_of(self.folder),
            )
            for name, purpose in files
        ]
        for claim in claims if check else ():
            check_writable(claim.path)
            if not bare:
                claim.check()
        return claims

    def remove(self, *files: tuple[str, str]) -> None:
        """Remove what the command wrote before this time, and has not written anew.

        It would stand beside results that it does not belong to. What is not the command's own, or
        was changed, stays, and is named.
        """
        for name, purpose in files:
            path = self.folder / name
            there, intact = read_whole(path)
            if there is None or (there.purpose, there.command) != (purpose, self.command):
                continue
            if intact:
                path.unlink(missing_ok=True)
            self.say(
                f"{path} {'was' if intact else 'is'} of an earlier time" + ": removed" * intact
            )


def check_writable(path: Path) -> None:
    """Refuse a file, before the work for it, whose folder is closed to writing.

    Of a folder that is not there yet the first one above it counts that is.
    """
    target = Path(os.path.realpath(path))
    there = next((folder for folder in target.parents if folder.exists()), target)
    if not there.is_dir():
        make_folder(target.parent)  # says that it cannot be made
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(
            f"{path}: cannot be written: the folder {there} is closed to writing",
            hint="name another one: `out`",
            name=str(path),
        )


def write_text_atomic(path: StrPath, text: str) -> Path:
    """Write a text file in UTF-8 whole or not at all, as :func:`write_bytes_atomic` does."""
    return write_bytes_atomic(path, encoded(path, text))


def encoded(path: StrPath, text: str, *, newline: str = "\n", encoding: str = "utf-8") -> bytes:
    r"""The bytes of a text file; OutputError where the text does not fit the encoding.

    ``newline``: what its lines end in, whether in the text it is ``\n`` or ``\r\n``.
    """
    try:
        return text.replace("\r\n", "\n").replace("\n", newline).encode(encoding)
    except UnicodeEncodeError as error:
        raise OutputError(
            f"{path}: {text[error.start]!a} cannot be written in {encoding}",
            hint="replace this character",
            name=str(path),
            value=text[error.start],
        ) from error


def write_json_atomic(path: StrPath, content: object) -> Path:
    """Write a value as JSON, whole or not at all; see :func:`json_text`."""
    return write_text_atomic(path, json_text(content) + "\n")


def json_text(content: object) -> str:
    """A value as JSON: arrays as lists, and null for numbers that JSON does not have."""
    return json.dumps(plain(content), indent=2)


def plain(value: Any) -> Any:
    """A value of what JSON has: arrays as lists, None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_bytes_atomic(path: StrPath, data: bytes) -> Path:
    """Write a file whole or not at all, in place of one that exists; return its path.

    Its folder must exist. What is claimed is checked again, and says its origin. Raises
    OutputError: the folder is missing or closed to writing, the disk is full, or the path is a
    folder or a device.
    """
    if isinstance(path, Claim):
        return path.write(data)
    # The link stays a link, and the rename stays inside one file system.
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise OutputError(
            f"{path}: there is no folder {target.parent}", hint="create it first", name=str(path)
        )
    if target.exists() and not target.is_file():
        # A rename would replace a device such as /dev/null by an ordinary file.
        raise OutputError(f"{path} is not an ordinary file", hint="name a file", name=str(path))
    aside = target.parent / f".{secrets.token_hex(8)}.tmp"
    try:
        try:
            # tempfile would make it readable by its owner only, and the rename would keep that
            with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            aside.replace(target)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        hint = f"check that the folder {target.parent} can be written and has free space"
        raise not_written(path, error, hint) from error
    return Path(path)


def not_written(path: StrPath, error: OSError, hint: str) -> OutputError:
    """The error of a file that cannot be written."""
    said = error.strerror or error
    return OutputError(f"{path}: cannot be written: {said}", hint=hint, name=str(path))


def read_bytes_bounded(path: Path | str, *, most_bytes: int) -> bytes:
    """Read a file of at most ``most_bytes`` bytes: a wrong one of gigabytes fills no memory.

    Raises FileFormatError: the file is missing, cannot be opened, or is larger.
    """
    try:
        data = read_bounded(path, most_bytes)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise FileFormatError(
            f"cannot be read: {reason}", path=path, hint="check the path"
        ) from error
    if len(data) > most_bytes:
        raise FileFormatError(
            f"is larger than {most_bytes / 1e6:g} MB", path=path, hint="is this the right file?"
        )
    return data


def make_folder(path: Path) -> Path:
    """Create the folder that results go to.

    Raises OutputError: it cannot be created, or is a file.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path}: the output folder cannot be made: {error.strerror}",
            hint="name another one: `out`",
            name=str(path),
        ) from error
    return path
