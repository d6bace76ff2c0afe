"""A controller's end of RTDE, after Universal Robots' guide to the protocol, for tests.

A package is its size (2 bytes, this header with them), its type (1 byte), and its content, all
numbers with the highest byte first. The client asks for protocol version 2 (V), the controller's
version (v) and a recipe of variables (O), and starts (S); from then on packages of data come (U).
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

PORT = 30004
PERIOD_S = 0.004
STOPPED, PLAYING, PAUSED = 1, 2, 4

_TYPES = {
    "timestamp": "DOUBLE",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "runtime_state": "UINT32",
}


def package(kind: str, content: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(content), ord(kind)) + content


@dataclass(frozen=True)
class Stage:
    """What the arm does for some time: a number in the register, joints [rad], speed of J1."""

    number: int = 0
    q: Sequence[float] = (0.0,) * 6
    seconds: float = 0.12
    speed: float = 0.0
    state: int = PLAYING


@dataclass(frozen=True)
class Raw:
    """Bytes in place of data; none: the connection is closed; None: silence."""

    data: bytes | None = b""


@dataclass
class RtdeServer:
    """Plays stages to whoever connects; a second client hears what the first one has not."""

    stages: Sequence[Stage | Raw]
    answers: dict[str, bytes | None] = field(default_factory=dict)
    """By the letter of a request, other content than the usual."""
    clients: int = 0
    asked: list[bytes] = field(default_factory=list)

    def __enter__(self) -> RtdeServer:
        self._left = iter(self.stages)
        self._clock = 100.0
        self._over = threading.Event()
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for last in range(2, 250):  # tests run side by side, and ur_rtde knows one port only
            self.host = f"127.0.53.{last}"
            with suppress(OSError):
                self._listener.bind((self.host, PORT))
                break
        self._listener.listen()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(10)
        assert not self._thread.is_alive()

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self.clients += 1
            client.settimeout(0.2)
            with client, suppress(OSError):
                self._talk(client)

    def _talk(self, client: socket.socket) -> None:
        names: list[str] = []
        for kind, content in self._requests(client):
            usual = {"V": b"\1", "v": struct.pack(">4I", 5, 12, 4, 0), "S": b"\1"}
            if kind == "O":
                names = content[8:].decode().strip(",").split(",")
                usual["O"] = b"\1" + ",".join(_TYPES.get(n, "INT32") for n in names).encode()
            answer = self.answers.get(kind, usual.get(kind, b"\1"))
            if answer is None:
                self._over.wait(60)
                return
            client.sendall(package(kind, answer))
            if kind == "S":
                self._play(client, names)
                return

    def _requests(self, client: socket.socket) -> Iterator[tuple[str, bytes]]:
        while True:
            head = self._read(client, 3)
            size, kind = struct.unpack(">HB", head)
            content = self._read(client, size - 3)
            self.asked.append(bytes([kind]) + content)
            yield chr(kind), content

    def _read(self, client: socket.socket, count: int) -> bytes:
        data = b""
        while len(data) < count and not self._over.is_set():
            with suppress(TimeoutError):
                part = client.recv(count - len(data))
                if not part:
                    raise ConnectionError
                data += part
        if len(data) < count:
            raise ConnectionError
        return data

    def _play(self, client: socket.socket, names: Sequence[str]) -> None:
        for stage in self._left:
            if isinstance(stage, Raw):
                if stage.data:
                    client.sendall(stage.data)
                    continue
                if stage.data is None:
                    self._over.wait(60)
                return
            for step in range(round(stage.seconds / PERIOD_S)):
                if self._over.is_set():
                    return
                self._clock += PERIOD_S
                q = [stage.q[0] + stage.speed * step * PERIOD_S, *stage.q[1:]]
                values = {
                    "timestamp": struct.pack(">d", self._clock),
                    "actual_q": struct.pack(">6d", *q),
                    "actual_qd": struct.pack(">6d", stage.speed, 0, 0, 0, 0, 0),
                    "runtime_state": struct.pack(">I", stage.state),
                }
                number = struct.pack(">i", stage.number)
                content = b"".join(values.get(name, number) for name in names)
                client.sendall(package("U", b"\1" + content))
                time.sleep(PERIOD_S)
        self._over.wait(60)
