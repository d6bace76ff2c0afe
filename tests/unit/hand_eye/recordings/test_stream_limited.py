"""A process that hands out parts: in order, without environment and files, and not without end."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from calib.limited import stream_limited


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Parts that the body of a function ``stream(data)`` yields."""

    def run(body: str, data: bytes = b"", **limits: float) -> Iterator[bytes]:
        text = f"import os, time\ndef stream(data):\n{textwrap.indent(body, '    ')}\n"
        (tmp_path / "streaming.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        given = {"memory_bytes": 2_000_000_000, "seconds": 10.0, "patience_s": 20.0} | limits
        return stream_limited("streaming", data, **given)

    return run


def test_parts_come_in_order_whatever_their_size(parts):
    body = "yield data\nyield b''\nyield bytes(3_000_000)\nyield data[::-1]"
    assert list(parts(body, b"abc")) == [b"abc", b"", bytes(3_000_000), b"cba"]


def test_nothing_of_the_environment_is_there(parts, monkeypatch):
    monkeypatch.setenv("SECRET", "x")
    (names,) = parts("yield ' '.join(sorted(os.environ)).encode()")
    assert "SECRET" not in names.decode().split()
    assert "HOME" not in names.decode().split()


def test_no_file_can_be_written(parts, tmp_path):
    with pytest.raises(OSError, match="broke off"):
        list(parts(f"with open({str(tmp_path / 'new')!r}, 'w') as f: f.write('x')\nyield b''"))
    assert not (tmp_path / "new").exists() or (tmp_path / "new").stat().st_size == 0


def test_memory_is_limited(parts):
    with pytest.raises(OSError, match="broke off"):
        list(parts("yield bytes(10 ** 9)", memory_bytes=500_000_000))


def test_what_comes_late_is_not_waited_for_and_what_came_is_there(parts):
    found = parts("yield b'first'\ntime.sleep(60)\nyield b'second'", patience_s=3.0)
    assert next(found) == b"first"
    with pytest.raises(TimeoutError, match="nothing came for 3 s"):
        next(found)


def test_a_process_ends_when_nobody_wants_more(parts):
    found = parts("yield str(os.getpid()).encode()\nwhile True: yield b'more'")
    number = int(next(found))
    assert Path(f"/proc/{number}").exists() or not Path("/proc").exists()
    found.close()
    assert not Path(f"/proc/{number}").exists()
