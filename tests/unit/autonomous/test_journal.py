"""Measurements that are kept: recalled, cut off, damaged, of another calibration."""

import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError, OutputError
from posedesign.autonomous.journal import Journal

Q = np.array([0.1, -0.2])
LOST = {"reasons": ["no target: dark"]}
SEEN = {"reasons": [""]}


ABOUT = {"robot": "MyRobot serial 7", "cell": "a"}


def journal(path: Path, **about: str) -> Journal:
    return Journal(path / "journal.jsonl", ABOUT | about)


def never() -> dict[str, Any]:
    raise AssertionError("measured again")


def recalled(kept: Journal, name: str, answer: dict[str, Any] | None = None, q: Any = Q) -> Any:
    """The answer under a name; measured now, if one is given."""
    return kept.recall(name, q, never if answer is None else lambda: answer, dict)


def test_a_measurement_is_made_once(tmp_path):
    with journal(tmp_path) as kept:
        first = recalled(kept, "P01", {"q": np.array([1.0 / 3.0, np.nan])})
        assert first["q"] == [1.0 / 3.0, None]
        assert recalled(kept, "P01")["q"] == [1.0 / 3.0, None]
    with journal(tmp_path) as again:
        assert len(again) == 1
        assert recalled(again, "P01")["q"] == [1.0 / 3.0, None]  # to the last bit


def test_every_measurement_is_on_the_disk_at_once(tmp_path):
    """What a machine that goes down now would leave."""
    with journal(tmp_path) as kept:
        for k in range(3):
            recalled(kept, f"P{k}", {"k": k})
            lines = (tmp_path / "journal.jsonl").read_text().splitlines()
            assert json.loads(lines[-1])["answer"] == {"k": k}


@pytest.mark.parametrize("left", range(1, 60, 7))
def test_a_line_that_was_cut_off_is_dropped(tmp_path, left):
    path = tmp_path / "journal.jsonl"
    with journal(tmp_path) as kept:
        recalled(kept, "P01", {"k": 1})
        whole = path.read_bytes()
        recalled(kept, "P02", {"k": 2})
    path.write_bytes(path.read_bytes()[: len(whole) + left])
    with journal(tmp_path) as again:
        assert len(again) == 1
        assert path.read_bytes() == whole
        assert recalled(again, "P02", {"k": 3}) == {"k": 3}
    with journal(tmp_path) as last:
        assert recalled(last, "P02") == {"k": 3}


def test_cut_off_in_its_first_line_it_begins_anew(tmp_path):
    journal(tmp_path).__exit__()
    path = tmp_path / "journal.jsonl"
    whole = path.read_bytes()
    for left in (0, 1, 20, len(whole) - 1):
        path.write_bytes(whole[:left])
        journal(tmp_path).__exit__()
        assert path.read_bytes() == whole


def test_another_posture_is_refused(tmp_path):
    with journal(tmp_path) as kept:
        recalled(kept, "P01", {"k": 1})
        assert recalled(kept, "P01", q=Q + 1e-12) == {"k": 1}
        for asked in (Q + 1e-6, Q[:1], np.zeros(0)):
            with pytest.raises(InputError, match="P01 was measured at another posture"):
                recalled(kept, "P01", q=asked)


def test_another_calibration_is_refused_and_what_is_other_is_named(tmp_path):
    journal(tmp_path).__exit__()
    before = (tmp_path / "journal.jsonl").read_bytes()
    with pytest.raises(FileFormatError, match="begun with another cell, not with the cell that"):
        journal(tmp_path, cell="b")
    said = r"another robot \(MyRobot serial 7\), not with MyRobot serial 8"
    with pytest.raises(FileFormatError, match=said):
        journal(tmp_path, robot="MyRobot serial 8")
    with pytest.raises(FileFormatError, match="another tool"):
        journal(tmp_path, tool="none before")
    assert (tmp_path / "journal.jsonl").read_bytes() == before


@pytest.mark.parametrize("number", ["Infinity", "-Infinity", "NaN", "1e999", "1" + 400 * "0"])
@pytest.mark.parametrize("where", ["asked", "answer"])
def test_numbers_that_are_none_are_found_when_it_is_opened(tmp_path, number, where):
    path = tmp_path / "journal.jsonl"
    with journal(tmp_path) as kept:
        for k in range(3):
            recalled(kept, f"P{k}", {"q": 0.5}, np.array([0.25]))
    lines = path.read_text().splitlines(keepends=True)
    lines[2] = lines[2].replace("0.25" if where == "asked" else "0.5", number)
    path.write_text("".join(lines))
    with pytest.raises(FileFormatError, match="line 3: is damaged"):
        journal(tmp_path)
    assert path.read_text() == "".join(lines)


def _gone(folder: Path) -> None:
    shutil.rmtree(folder)


def _made_anew(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _linked(folder: Path) -> None:
    elsewhere = folder.with_name("elsewhere")
    shutil.copytree(folder, elsewhere)
    shutil.rmtree(folder)
    folder.symlink_to(elsewhere)


def _moved_and_linked(folder: Path) -> None:
    """The same folder by another name is not led outside of."""
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


@pytest.mark.parametrize("done", [_gone, _made_anew, _linked])
def test_a_folder_that_is_taken_away_ends_it(tmp_path, done):
    """Before anything is measured that could not be kept."""
    folder = tmp_path / "run"
    folder.mkdir()
    with journal(folder) as kept:
        recalled(kept, "P01", {"k": 1})
        done(folder)
        assert recalled(kept, "P01") == {"k": 1}
        with pytest.raises(OutputError, match="was removed or replaced while it was written"):
            kept.recall("P02", Q, never, dict)
        if (tmp_path / "elsewhere").is_dir():
            assert len((tmp_path / "elsewhere" / "journal.jsonl").read_text().splitlines()) == 2


def test_a_folder_that_was_renamed_is_the_same(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    with journal(folder) as kept:
        _moved_and_linked(folder)
        recalled(kept, "P01", {"k": 1})
    with journal(tmp_path / "elsewhere") as again:
        assert recalled(again, "P01") == {"k": 1}


def test_a_journal_that_is_a_link_is_refused(tmp_path):
    (tmp_path / "journal.jsonl").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match=r"journal\.jsonl"):
        journal(tmp_path)
    assert not (tmp_path / "elsewhere").exists()


OF_ANOTHER_VERSION = '{"posedesign": "calibration", "version": 3, "about": {"robot": "a"}}\n{"cut'
NO_JOURNALS = [
    "[1]\n", "no json\n", '{"posedesign": "plan"}\n', "{\n", "[" * 100_000 + "\n", "\x00\n",
    # without a line end, as a line that was cut off
    '{"mine": 1}', '{"mine": 1}\n{"mine": 2}', '{"posedesign": "plan"}',
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *((text, "is no journal") for text in NO_JOURNALS),
        (OF_ANOTHER_VERSION, "version 3, this program has 2"),
    ],
)
def test_what_is_no_journal_is_refused_and_left_as_it_is(tmp_path, text, said):
    (tmp_path / "journal.jsonl").write_text(text)
    with pytest.raises(FileFormatError, match=said):
        journal(tmp_path)
    assert (tmp_path / "journal.jsonl").read_text() == text


def test_a_damaged_line_can_be_taken_out(tmp_path):
    path = tmp_path / "journal.jsonl"
    with journal(tmp_path) as kept:
        for k in range(3):
            recalled(kept, f"P{k}", {"k": k})
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:2], lines[2].replace('"name"', "name"), lines[3]]))
    with pytest.raises(FileFormatError, match="line 3: is damaged") as caught:
        journal(tmp_path)
    assert "remove this line and all after it" in caught.value.hint
    path.write_text("".join(lines[:2]))
    with journal(tmp_path) as again:
        assert recalled(again, "P0") == {"k": 0}


@pytest.mark.parametrize("broken", [{"asked": "abc"}, {"asked": {}}, {"answer": None}])
def test_a_damaged_answer_is_told_by_its_name(tmp_path, broken):
    with journal(tmp_path) as kept:
        recalled(kept, "P01", {"k": 1})
    path = tmp_path / "journal.jsonl"
    head, line = path.read_text().splitlines()
    path.write_text(f"{head}\n{json.dumps(json.loads(line) | broken)}\n")
    with (
        journal(tmp_path) as again,
        pytest.raises(FileFormatError, match="the measurement P01 cannot be read"),
    ):
        recalled(again, "P01")


def test_errors_of_whoever_measures_come_out_as_they_are(tmp_path):
    """An adapter that fails is no damaged file: --restart would throw hours away."""

    def fails() -> dict[str, Any]:
        raise KeyError("socket")

    with journal(tmp_path) as kept:
        with pytest.raises(KeyError, match="socket"):
            kept.recall("P01", Q, fails, dict)
        assert len(kept) == 0


def test_a_full_disk_leaves_whole_lines(tmp_path, monkeypatch):
    """One line says it, and the same journal can be gone on with when there is room."""
    path = tmp_path / "journal.jsonl"

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with journal(tmp_path) as kept:
        recalled(kept, "P01", {"k": 1})
        whole = path.read_bytes()
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", full)
            with pytest.raises(OutputError, match="No space left on device"):
                recalled(kept, "P02", {"k": 2})
        assert path.read_bytes() == whole
        recalled(kept, "P02", {"k": 3})
    with journal(tmp_path) as again:
        assert recalled(again, "P02") == {"k": 3}


def test_a_disk_that_takes_no_byte(tmp_path, monkeypatch):
    if not os.path.exists("/dev/full"):
        pytest.skip("no device that is full on this system")
    (tmp_path / "sub").mkdir()
    kept = journal(tmp_path / "sub")
    monkeypatch.setattr(kept, "check_place", lambda: None)
    kept._stream.close()
    kept._stream = open("/dev/full", "ab", buffering=0)  # noqa: SIM115 -- closed by the journal
    with kept, pytest.raises(OutputError, match="No space left on device"):
        recalled(kept, "P01", {"k": 1})


def test_what_failed_at_the_end_is_tried_again(tmp_path):
    """Not what failed before something that succeeded: that was built upon it."""
    with journal(tmp_path) as kept:
        recalled(kept, "S02a", LOST)
        recalled(kept, "S02b", SEEN)
        recalled(kept, "S03a", LOST)
        recalled(kept, "moves", {"matrix": None, "reason": "out of reach"})
    with journal(tmp_path) as again:
        assert len(again) == 2
        assert recalled(again, "S02a") == LOST
        assert recalled(again, "S03a", SEEN) == SEEN
    with journal(tmp_path) as last:
        assert recalled(last, "S03a") == SEEN
