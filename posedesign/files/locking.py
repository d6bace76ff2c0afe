"""One process at a time in a folder: the second is told which one is first."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calib.errors import InputError
from posedesign.files.safe import not_written

try:
    import fcntl
except ImportError:  # not on Windows, where nothing keeps two processes apart
    fcntl = None  # type: ignore[assignment]

LOCK = "running.lock"
"""The file in the folder that is locked; it has the number of the process that holds it."""

_LONGEST_NUMBER = 20

_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
"""What stands behind a link is somebody else's, and would be emptied."""


@contextmanager
def held(folder: Path, what: str, hint: str = "name another folder: `out`") -> Iterator[None]:
    """Hold a folder while something is written; a process that is killed lets go of it.

    Where the file system has no locks, as on some network shares, nothing keeps two apart.

    ``folder``: must exist. ``what``: what is being done, for the one who is refused. ``hint``: what
    else the one who is refused may do than to wait for it or to stop it. Raises InputError: another
    process holds it. OutputError: the lock file cannot be written.
    """
    path = folder / LOCK
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _NO_LINK, 0o666)
    except OSError as error:
        raise not_written(path, error, hint) from error
    try:
        if not _locked(descriptor):
            owner = os.read(descriptor, _LONGEST_NUMBER).strip()  # anything may stand there, too
            said = owner.decode() if owner.isdigit() else "another"
            raise InputError(
                f"{folder}: process {said} is {what} here",
                hint=f"wait for it, stop it, or {hint}",
                name=str(folder),
                value=said,
            )
        try:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
        except OSError as error:
            raise not_written(path, error, hint) from error
        try:
            yield
        finally:
            with suppress(OSError):
                os.ftruncate(descriptor, 0)  # nobody holds it any more
    finally:
        os.close(descriptor)


def _locked(descriptor: int) -> bool:
    """Whether nobody else has locked a file, as far as the file system can tell."""
    if fcntl is not None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True  # a file system without locks
    return True
