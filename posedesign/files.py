"""Files written whole or not at all, and read only up to a size.

A robot program or a table that was cut off half-way can still be loaded, and then moves an arm.
So every file is written aside, in the same folder, and then renamed: readers see the old content
or the new one, never a part.
"""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.errors import FileFormatError, OutputError


def write_text_atomic(
    path: Path | str, text: str, *, newline: str = "\n", encoding: str = "utf-8"
) -> Path:
    r"""Write a text file whole or not at all.

    Parameters
    ----------
    path : Path or str
        The file; one that exists is replaced. Its folder must exist.
    text : str
        The content; its lines end in ``\n`` or ``\r\n``.
    newline : str
        What ends the lines of the file: ``"\n"``, or ``"\r\n"`` for robot controllers.
    encoding : str
        Name of the encoding.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The text does not fit the encoding, or the file cannot be written.
    """
    try:
        data = text.replace("\r\n", "\n").replace("\n", newline).encode(encoding)
    except UnicodeEncodeError as error:
        raise OutputError(
            f"{path}: {text[error.start]!a} cannot be written in {encoding}",
            hint="replace this character",
            name=str(path),
            value=text[error.start],
        ) from error
    return write_bytes_atomic(path, data)


def write_json_atomic(path: Path | str, content: object) -> Path:
    """Write a value as JSON, whole or not at all; see :func:`json_text`."""
    return write_text_atomic(path, json_text(content) + "\n")


def json_text(content: object) -> str:
    """A value as JSON: arrays as lists, and null for numbers that JSON does not have."""
    return json.dumps(_plain(content), indent=2)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_bytes_atomic(path: Path | str, data: bytes) -> Path:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : Path or str
        The file; one that exists is replaced. Its folder must exist.
    data : bytes
        The content.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The folder is missing or closed to writing, the disk is full, or the path is a folder or a
        device.
    """
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
            _write_new(aside, data)
            aside.replace(target)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror or error}",
            hint=f"check that the folder {target.parent} can be written and has free space",
            name=str(path),
        ) from error
    return Path(path)


def _write_new(path: Path, data: bytes) -> None:
    """Create a file with the permissions the user's umask gives, and push it to the disk."""
    # tempfile would create it readable by its owner only, and the rename would keep that.
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def read_bytes_bounded(path: Path | str, *, most_bytes: int) -> bytes:
    """Read a file of at most ``most_bytes`` bytes.

    Parameters
    ----------
    path : Path or str
        The file.
    most_bytes : int
        Largest size accepted: a wrong file of gigabytes is refused before it fills the memory.

    Returns
    -------
    bytes
        The content.

    Raises
    ------
    FileFormatError
        The file is missing, cannot be opened, or is larger.
    """
    try:
        with open(path, "rb") as stream:
            data = stream.read(most_bytes + 1)
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

    Raises
    ------
    OutputError
        It cannot be created, or is a file.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path}: the output folder cannot be made: {error.strerror}",
            hint="name another one with --out",
            name=str(path),
        ) from error
    return path
