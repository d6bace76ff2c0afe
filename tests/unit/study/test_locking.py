"""One process at a time in a folder."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from calib.errors import InputError, OutputError
from posedesign.files import locking
from posedesign.files.locking import LOCK, held

pytest.importorskip("fcntl", reason="files are not locked on this system")


def test_the_second_is_told_which_is_first(tmp_path: Path) -> None:
    with (
        held(tmp_path, "digging"),
        pytest.raises(InputError, match=f"process {os.getpid()} is digging here") as caught,
        held(tmp_path, "digging", "dig elsewhere"),
    ):
        pass
    assert caught.value.hint == "wait for it, stop it, or dig elsewhere"
    with held(tmp_path, "digging"):
        assert (tmp_path / LOCK).read_text() == f"{os.getpid()}\n"
    assert not (tmp_path / LOCK).read_text()


def test_what_stands_in_the_lock_may_be_anything(tmp_path: Path) -> None:
    with held(tmp_path, "digging"):
        (tmp_path / LOCK).write_bytes(b"\xff\x00\x1b[31m")
        with (
            pytest.raises(InputError, match="process another is digging"),
            held(tmp_path, "digging"),
        ):
            pass


def test_what_a_link_leads_to_is_not_emptied(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("kept")
    (tmp_path / LOCK).symlink_to(tmp_path / "kept")
    with pytest.raises(OutputError, match="cannot be written"), held(tmp_path, "digging"):
        pass
    assert (tmp_path / "kept").read_text() == "kept"


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="No such file"), held(tmp_path / "none", "digging"):
        pass


def test_a_file_system_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some network shares: nobody is said to be there who is not."""

    def unknown(*_: object) -> None:
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(locking.fcntl, "flock", unknown)
    with held(tmp_path, "digging"), held(tmp_path, "digging"):
        assert (tmp_path / LOCK).read_text() == f"{os.getpid()}\n"


def test_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OutputError, match="No space left"), held(tmp_path, "digging"):
        pass
    monkeypatch.undo()
    with held(tmp_path, "digging"):
        pass
