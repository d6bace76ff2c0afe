"""Files that may be anything, read with limits: of size, of time, and of what reading may break.

What may crash or never end runs in a process of its own. It begins with the paths of its parent and
without environment, and can take no more memory and time than it is given, write no file and start
no process. On Windows, which has no limits of this kind, only its time is limited.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import stat
import struct
import subprocess
import sys
import time
from collections.abc import Generator
from importlib import import_module
from pathlib import Path
from threading import Event, Thread

_START = (
    "import sys; sys.path[:] = {path!r}; sys.pycache_prefix = {compiled!r};"
    "from calib.limited import {serve};"
    "{serve}({module!r}, {memory_bytes!r}, {seconds!r}, {threads!r})"
)

_LENGTH = struct.Struct("<Q")
_END = 2**64 - 1
"""In place of a length: all parts were sent."""


def run_limited(module: str, data: bytes, *, memory_bytes: int, seconds: float) -> bytes:
    """Call ``run(data)`` of a module in a process of its own, and give what it returns.

    Raises
    ------
    OSError
        The process cannot be started, or broke off.
    TimeoutError
        It was not done in time.
    """
    try:
        done = subprocess.run(  # noqa: S603 - no shell, and no word of it is from the data
            _command("serve", module, memory_bytes, seconds),
            input=data,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
            check=True,
        )
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"not done in {seconds:g} s") from error
    except subprocess.CalledProcessError as error:
        raise OSError("the process broke off") from error
    return done.stdout


def stream_limited(
    module: str,
    data: bytes,
    *,
    memory_bytes: int,
    seconds: float,
    patience_s: float,
    threads: bool = False,
) -> Generator[bytes, None, None]:
    """Call ``stream(data)`` of a module in a process of its own, and give the parts it yields.

    The process is ended when the iterator is closed. ``seconds``: processor time of all.
    ``patience_s``: longest time until the next part. ``threads``: whether it may start threads, and
    so processes: systems limit both as one.

    Raises
    ------
    OSError
        The process cannot be started, or broke off.
    TimeoutError
        A part did not come in time.
    """
    process = subprocess.Popen(  # noqa: S603 - as above
        _command("serve_stream", module, memory_bytes, seconds, threads),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    reader = _Reader(process, patience_s)
    with process:
        try:
            process.stdin.write(data)  # type: ignore[union-attr] # both are pipes
            process.stdin.close()  # type: ignore[union-attr]
            while (length := _LENGTH.unpack(reader.read(_LENGTH.size))[0]) != _END:
                yield reader.read(length)
        finally:
            reader.done.set()
            process.kill()


class _Reader:
    """Reads what a process writes, and ends it where it is late."""

    def __init__(self, process: subprocess.Popen[bytes], patience_s: float) -> None:
        self.done = Event()
        self._process, self._patience_s = process, patience_s
        self._until, self._late = math.inf, False  # when to end it: while it is waited for
        Thread(target=self._watch, daemon=True).start()

    def read(self, count: int) -> bytes:
        """Read so many bytes; OSError, or TimeoutError, where they do not come."""
        self._until = time.monotonic() + self._patience_s
        data = self._process.stdout.read(count)  # type: ignore[union-attr] # a pipe
        self._until = math.inf
        if len(data) == count:
            return data
        if self._late:
            raise TimeoutError(f"nothing came for {self._patience_s:g} s")
        raise OSError("the process broke off")

    def _watch(self) -> None:
        while not self.done.wait(min(1.0, self._patience_s)):
            if time.monotonic() > self._until:
                self._late = True
                self._process.kill()
                return


def _command(
    serve: str, module: str, memory_bytes: int, seconds: float, threads: bool = False
) -> list[str]:
    """Command line of a process that serves a module."""
    start = _START.format(
        path=[entry for entry in sys.path if entry],  # "" is the folder one happens to be in
        compiled=sys.pycache_prefix,
        serve=serve,
        module=module,
        memory_bytes=memory_bytes,
        seconds=seconds,
        threads=threads,
    )
    return [sys.executable, "-I", "-B", "-X", "utf8", "-c", start]


def serve(module: str, memory_bytes: int, seconds: float, threads: bool) -> None:
    """Answer for :func:`run_limited`, inside of the process."""
    _limit(memory_bytes, seconds, threads)
    out, sys.stdout = sys.stdout.buffer, sys.stderr
    out.write(import_module(module).run(sys.stdin.buffer.read()))
    out.flush()


def serve_stream(module: str, memory_bytes: int, seconds: float, threads: bool) -> None:
    """Answer for :func:`stream_limited`, inside of the process."""
    _limit(memory_bytes, seconds, threads)
    out, sys.stdout = sys.stdout.buffer, sys.stderr
    for part in import_module(module).stream(sys.stdin.buffer.read()):
        out.write(_LENGTH.pack(len(part)))
        out.write(part)
        out.flush()
    out.write(_LENGTH.pack(_END))
    out.flush()


def _limit(memory_bytes: int, seconds: float, threads: bool) -> None:
    """Limit what this process may take and do."""
    os.environ.clear()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # its threads take memory, and may not be started
    with contextlib.suppress(ImportError):  # on Windows
        import resource

        for limit, most in (
            (resource.RLIMIT_AS, memory_bytes),
            (resource.RLIMIT_CPU, max(1, int(seconds))),
            (resource.RLIMIT_FSIZE, 0),
            (resource.RLIMIT_CORE, 0),
            *([] if threads else [(resource.RLIMIT_NPROC, 0)]),
        ):
            with contextlib.suppress(ValueError, OSError):  # one that the system does not know
                resource.setrlimit(limit, (most, most))


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
