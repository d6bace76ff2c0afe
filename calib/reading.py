"""Reading files that may be anything: of bounded size, and in bounded time."""

from __future__ import annotations

import os
import select
import stat
from pathlib import Path

PATIENCE_S = 10.0
"""For the next bytes of a pipe: a pipe that nobody writes into would be waited for without end."""

_CHUNK = 1 << 20


def read_bounded(path: Path | str, most_bytes: int) -> bytes:
    """At most ``most_bytes + 1`` bytes of a file, or of a pipe that something comes out of.

    Raises
    ------
    OSError
        It cannot be opened or read, is a folder, or nothing comes out of it.
    ValueError
        The path holds a zero byte.
    """
    with open(path, "rb", opener=_open_at_once) as stream:
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return stream.read(most_bytes + 1)
        data = b""
        while len(data) <= most_bytes:
            if not select.select([stream], [], [], PATIENCE_S)[0]:
                raise TimeoutError(0, f"nothing came out of this pipe for {PATIENCE_S:g} s")
            part = os.read(stream.fileno(), min(_CHUNK, most_bytes + 1 - len(data)))
            if not part:
                break
            data += part
        return data


def _open_at_once(path: str, flags: int) -> int:
    """Open without waiting for somebody at the other end of a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
