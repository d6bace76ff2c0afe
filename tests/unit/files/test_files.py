"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path

import numpy as np
import pytest

from calib import limited
from calib.errors import FileFormatError, InputError, OutputError
from posedesign.files import (
    Results,
    csv_tables,
    encoded,
    folder_inside,
    held,
    locking,
    read_bytes_bounded,
    write_bytes_atomic,
    write_text_atomic,
)
from posedesign.files import safe as files
from posedesign.files.locking import LOCK
from posedesign.study import own_folder


def test_text_is_written_with_the_asked_line_ends(tmp_path):
    path = tmp_path / "a.txt"
    assert encoded(path, "one\ntwo\r\n", newline="\r\n") == b"one\r\ntwo\r\n"
    assert write_text_atomic(path, "one\ntwo\r\n") == path
    assert path.read_bytes() == b"one\ntwo\n"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_permissions_follow_the_umask(tmp_path):
    path, plain = tmp_path / "a.txt", tmp_path / "b.txt"
    write_text_atomic(path, "")
    plain.write_text("")
    assert path.stat().st_mode == plain.stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    real.write_text("old")
    link.symlink_to(real)
    write_text_atomic(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match="there is no folder") as caught:
        write_text_atomic(tmp_path / "none" / "a.txt", "x")
    assert caught.value.hint == "create it first"


@pytest.mark.parametrize("name", [".", "folder"])
def test_a_folder_is_no_file(tmp_path, name):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="not an ordinary file"):
        write_bytes_atomic(tmp_path / name, b"x")


def test_a_device_is_not_replaced():
    with pytest.raises(OutputError, match="not an ordinary file"):
        write_bytes_atomic(os.devnull, b"x")
    assert not Path(os.devnull).is_file()


def test_a_character_outside_the_encoding_is_refused_before_the_disk():
    with pytest.raises(OutputError, match=r"'\\xe9' cannot be written in ascii"):
        encoded("a.txt", "é", encoding="ascii")


class _FullDisk:
    """A stream that takes half of the data, then fails as a full disk does."""

    def __init__(self, descriptor: int, mode: str) -> None:
        self.stream = os.fdopen(descriptor, mode)

    def __enter__(self) -> _FullDisk:
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.close()

    def write(self, data: bytes) -> None:
        self.stream.write(data[: len(data) // 2])
        raise OSError(28, "No space left on device")


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")
    monkeypatch.setattr(files, "open", _FullDisk, raising=False)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        write_text_atomic(path, "new and long")
    assert "free space" in caught.value.hint
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, PermissionError(13, "Permission denied")])
def test_a_failed_rename_leaves_nothing(tmp_path, monkeypatch, error):
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(Path, "replace", fail)
    expected = KeyboardInterrupt if error is KeyboardInterrupt else OutputError
    with pytest.raises(expected):
        write_bytes_atomic(tmp_path / "a.bin", b"x")
    assert not os.listdir(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_closed_folder_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be written"):
        write_text_atomic(tmp_path / "a.txt", "x")


def test_a_closed_folder_is_found_before_the_work(tmp_path, monkeypatch):
    """Where it is asked for the right to write; root has it everywhere."""
    closed, (open_, name) = tmp_path / "closed", (tmp_path / "open", "poses.csv")
    closed.mkdir()
    (tmp_path / "file").write_text("")
    write_text_atomic(Results(open_).claim("planned", ("mine.csv", "measuring poses"))[0], "a\n1\n")
    (closed / "mine.csv").symlink_to(open_ / "mine.csv")
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != closed and access(path, mode))
    for folder in (closed, closed / "new" / "newer"):
        with pytest.raises(OutputError, match=r"the folder .*closed is closed to writing"):
            Results(folder).claim("planned", (name, "measuring poses"))
        with pytest.raises(OutputError, match="closed to writing"), own_folder(folder, "small"):
            pytest.fail("the study was run")
    for folder in (tmp_path / "file", tmp_path / "file" / "new"):
        with pytest.raises(OutputError, match="cannot be made"):
            Results(folder).claim("planned", (name, "measuring poses"))
    for folder, file in ((open_, name), (closed, "mine.csv")):
        assert Results(folder).claim("planned", (file, "measuring poses"))


def test_a_large_file_is_refused(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"12345")
    assert read_bytes_bounded(path, most_bytes=5) == b"12345"
    with pytest.raises(FileFormatError, match="is larger than"):
        read_bytes_bounded(path, most_bytes=4)


@pytest.mark.parametrize("name", ["none.bin", ".", "a\0b"])
def test_a_file_that_cannot_be_opened_is_named(tmp_path, name):
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_bytes_bounded(tmp_path / name, most_bytes=4)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_a_pipe_that_nobody_writes_into_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(limited, "PATIENCE_S", 0.1)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileFormatError, match=r"nothing came out of this pipe for 0.1 s"):
        files.read_bytes_bounded(tmp_path / "pipe", most_bytes=10)


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="descriptors as files")
def test_a_pipe_that_somebody_writes_into_is_read():
    out, into = os.pipe()
    os.write(into, b"12345")
    os.close(into)
    try:
        assert files.read_bytes_bounded(f"/dev/fd/{out}", most_bytes=10) == b"12345"
    finally:
        os.close(out)


@pytest.mark.parametrize("text", ["9" * 400, "9" * 5000, "1e999", "-1e301", "NaN", "[" * 200_000])
def test_numbers_of_json_that_no_result_has(text):
    with pytest.raises(ValueError, match=r"finite number within|nested too deep"):
        csv_tables.load_json(f'{{"a": {text}')


@pytest.mark.parametrize("text", ['{"a": 1, "a": 2}', '[{"b": {"x": 1, "y": 2, "x": 1}}]'])
def test_a_key_of_json_that_stands_twice(text):
    """Two readers would take two values, and people see the first."""
    with pytest.raises(ValueError, match=r"the key '?[ax]'? stands twice"):
        csv_tables.load_json(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1.5", 1.5), ("-2,5", -2.5), ("1E999", math.nan), ("1e13", math.nan), ("nan", math.nan)],
)
def test_numbers_of_texts_have_the_same_bound(text, value):
    np.testing.assert_equal(csv_tables.number_of(text), value)


def test_no_file_is_written_by_a_link_to_nothing(tmp_path):
    elsewhere, out = tmp_path / "elsewhere.json", tmp_path / "out"
    out.mkdir()
    (out / "a.json").symlink_to(elsewhere)
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for folder in (out, tmp_path / "link"):
        with pytest.raises(OutputError, match="is a link to what is not there"):
            Results(folder, "test").claim("computed", ("a.json", "results"))
    assert not elsewhere.exists()


def test_a_folder_that_became_a_link_is_not_written_into(tmp_path):
    """It was not there when its files were claimed, so the command would have made it."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (claim,) = Results(out, "test").claim("computed", ("a.json", "results"))
    out.symlink_to(elsewhere)
    with pytest.raises(OutputError, match="removed or replaced since this began"):
        write_text_atomic(claim, "{}")
    assert not list(elsewhere.iterdir())


def test_a_folder_of_a_command_is_no_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "pictures").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="is a link, and not a folder of its own"):
        folder_inside(tmp_path / "pictures")


def test_one_bound_for_all_numbers():
    assert csv_tables.usable(3) == 3.0
    assert csv_tables.usable(-csv_tables.LARGEST_NUMBER) == -csv_tables.LARGEST_NUMBER
    for value in (10**400, 1e308, -(10**13), float("nan"), float("-inf"), True, "1", None):
        assert math.isnan(csv_tables.usable(value))


pytest.importorskip("fcntl", reason="files are not locked on this system")


def test_the_second_is_told_which_is_first(tmp_path):
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


def not_held(folder: Path, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says), held(folder, "digging"):
        pytest.fail("is held")


def test_what_stands_in_the_lock_may_be_anything(tmp_path):
    with held(tmp_path, "digging"):
        (tmp_path / LOCK).write_bytes(b"\xff\x00\x1b[31m")
        not_held(tmp_path, InputError, "process another is digging")


def test_what_a_link_leads_to_is_not_emptied_and_a_folder_has_to_be_there(tmp_path):
    (tmp_path / "kept").write_text("kept")
    (tmp_path / LOCK).symlink_to(tmp_path / "kept")
    not_held(tmp_path, OutputError, "cannot be written")
    assert (tmp_path / "kept").read_text() == "kept"
    not_held(tmp_path / "none", OutputError, "No such file")


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    """Some network shares: nobody is said to be there who is not."""

    def unknown(*_: object) -> None:
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(locking.fcntl, "flock", unknown)
    with held(tmp_path, "digging"), held(tmp_path, "digging"):
        assert (tmp_path / LOCK).read_text() == f"{os.getpid()}\n"


def test_a_full_disk(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    not_held(tmp_path, OutputError, "No space left")
    monkeypatch.undo()
    with held(tmp_path, "digging"):
        pass
