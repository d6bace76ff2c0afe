"""One process at a time in a folder: the second is told which one is first."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.errors import InputError, OutputError

try:
    import fcntl
except ImportError:  # not on Windows, where nothing keeps two processes apart
    fcntl = None  # type: ignore[assignment]


@contextmanager
def held(path: Path, what: str) -> Iterator[None]:
    """Hold a lock file while something is written; a process that is killed lets go of it.

    Parameters
    ----------
    path : Path
        The lock file, made where it does not exist; its folder must. It has the number of the
        process that holds it, or held it last.
    what : str
        What is being done, for the one who is refused.

    Raises
    ------
    InputError
        Another process holds it.
    OutputError
        The file cannot be written.
    """
    try:
        stream = open(path, "a+", encoding="ascii")  # noqa: SIM115 -- held open while it is locked
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}",
            hint="name another folder with --out",
            name=str(path),
        ) from error
    with stream:
        if fcntl is not None:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                stream.seek(0)
                owner = stream.read(20).strip() or "another"
                raise InputError(
                    f"{path.parent}: process {owner} is {what} here",
                    hint="wait for it, stop it, or name another folder with --out",
                    name=str(path.parent),
                    value=owner,
                ) from error
        stream.truncate(0)
        stream.write(f"{os.getpid()}\n")
        stream.flush()
        yield
