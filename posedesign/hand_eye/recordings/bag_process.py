"""Reading of rosbag2 storage, for a process of its own: see :func:`calib.limited.stream_limited`.

Only the storage is read here: SQLite, MCAP, and what is compressed in them. Content of messages is
decoded elsewhere, by definitions that do not come from the bag.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

MESSAGE = struct.Struct("<Hq")
"""Before the bytes of a message: number of its topic, and when it was recorded [ns]."""

_LONGEST_NAME = 255
"""Of a topic, as DDS has them."""


def stream(data: bytes) -> Iterator[bytes]:
    """Yield the topics of a bag, then the messages of some of them; or why it cannot be read.

    ``data``: JSON of ``files``, ``topics`` (names), ``compressed`` (whether each message is) and
    ``most_bytes`` of a message. The first byte of each part: ``t`` topics in JSON, ``m`` a message,
    ``e`` an error in words.
    """
    try:
        yield from _parts(json.loads(data))
    except MemoryError:
        yield b"ea part of it claims more memory than there is for it"
    except Exception as error:  # its readers let anything through that their arithmetic raises
        yield b"e" + (str(error) or type(error).__name__).encode("utf-8", "replace")


def _parts(job: dict[str, Any]) -> Iterator[bytes]:
    from rosbags.rosbag2 import Reader

    with ExitStack() as stack:
        readers = [stack.enter_context(Reader(file)) for file in job["files"]]
        topics: dict[str, list[Any]] = {}
        for reader in readers:
            for one in reader.connections:
                if len(one.topic) > _LONGEST_NAME:
                    continue
                known = topics.setdefault(one.topic, [one.msgtype, 0])
                known[1] += one.msgcount
        yield b"t" + json.dumps(topics).encode()
        for reader in readers:
            yield from _messages(reader, job)


def _messages(reader: Reader, job: dict[str, Any]) -> Iterator[bytes]:
    wanted = job["topics"]
    connections = [one for one in reader.connections if one.topic in wanted]
    if not connections:
        return
    for one, time_ns, content in reader.messages(connections):
        raw = _decompressed(content, job["most_bytes"]) if job["compressed"] else content
        if len(raw) > job["most_bytes"]:
            raise ValueError(f"a message of {one.topic} has {len(raw) / 1e6:.0f} MB")
        yield b"m" + MESSAGE.pack(wanted.index(one.topic), time_ns) + raw


def _decompressed(content: bytes, most_bytes: int) -> bytes:
    import sys

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    raw: bytes = zstd.ZstdDecompressor().decompress(content, most_bytes + 1)
    return raw
