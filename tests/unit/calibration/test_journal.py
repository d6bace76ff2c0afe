"""Measurements that are kept: recalled, cut off, damaged, of another calibration."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.calibration.journal import Journal

Q = np.array([0.1, -0.2])


def journal(path: Path, about: str = "cell a") -> Journal:
    return Journal(path / "journal.jsonl", about)


def never() -> dict[str, Any]:
    raise AssertionError("measured again")


def test_a_measurement_is_made_once(tmp_path: Path) -> None:
    with journal(tmp_path) as kept:
        first = kept.recall("P01", Q, lambda: {"q": np.array([1.0 / 3.0, np.nan])})
        assert first["q"] == [1.0 / 3.0, None]
        assert kept.recall("P01", Q, never)["q"] == [1.0 / 3.0, None]
    with journal(tmp_path) as again:
        assert len(again) == 1
        assert again.recall("P01", Q, never)["q"] == [1.0 / 3.0, None]  # to the last bit


def test_every_measurement_is_on_the_disk_at_once(tmp_path: Path) -> None:
    """What a machine that goes down now would leave."""
    with journal(tmp_path) as kept:
        for k in range(3):
            kept.recall(f"P{k}", Q, lambda k=k: {"k": k})
            lines = (tmp_path / "journal.jsonl").read_text().splitlines()
            assert json.loads(lines[-1])["answer"] == {"k": k}


@pytest.mark.parametrize("left", range(1, 60, 7))
def test_a_line_that_was_cut_off_is_dropped(tmp_path: Path, left: int) -> None:
    path = tmp_path / "journal.jsonl"
    with journal(tmp_path) as kept:
        kept.recall("P01", Q, lambda: {"k": 1})
        whole = path.read_bytes()
        kept.recall("P02", Q, lambda: {"k": 2})
    path.write_bytes(path.read_bytes()[: len(whole) + left])
    with journal(tmp_path) as again:
        assert len(again) == 1
        assert path.read_bytes() == whole
        assert again.recall("P02", Q, lambda: {"k": 3}) == {"k": 3}
    with journal(tmp_path) as last:
        assert last.recall("P02", Q, never) == {"k": 3}


def test_another_posture_is_refused(tmp_path: Path) -> None:
    with journal(tmp_path) as kept:
        kept.recall("P01", Q, lambda: {"k": 1})
        assert kept.recall("P01", Q + 1e-12, never) == {"k": 1}
        for asked in (Q + 1e-6, Q[:1], np.zeros(0)):
            with pytest.raises(InputError, match="P01 was measured at another posture"):
                kept.recall("P01", asked, never)


def test_another_calibration_is_refused(tmp_path: Path) -> None:
    journal(tmp_path).__exit__()
    with pytest.raises(FileFormatError, match="begun with another cell"):
        journal(tmp_path, "cell b")


@pytest.mark.parametrize(
    "text",
    ["[1]\n", "no json\n", '{"posedesign": "plan"}\n', "{\n", "[" * 100_000 + "\n", "\x00\n"],
)
def test_what_is_no_journal_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "journal.jsonl").write_text(text)
    with pytest.raises(FileFormatError, match="is no journal"):
        journal(tmp_path)
    assert (tmp_path / "journal.jsonl").read_text() == text


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="files are not locked on this system")
    with journal(tmp_path), pytest.raises(InputError, match="another calibration is writing it"):
        journal(tmp_path)
    journal(tmp_path).__exit__()


def test_a_damaged_answer_is_an_error_of_the_file(tmp_path: Path) -> None:
    with (
        journal(tmp_path) as kept,
        pytest.raises(FileFormatError, match="cannot be read"),
        kept.reading(),
    ):
        raise KeyError("q")


def test_what_failed_at_the_end_is_tried_again(tmp_path: Path) -> None:
    """Not what failed before something that succeeded: that was built upon it."""
    lost = {"reasons": ["no target: dark"]}
    with journal(tmp_path) as kept:
        kept.recall("S02a", Q, lambda: lost)
        kept.recall("S02b", Q, lambda: {"reasons": [""]})
        kept.recall("S03a", Q, lambda: lost)
        kept.recall("moves", Q, lambda: {"matrix": None, "reason": "out of reach"})
    with journal(tmp_path) as again:
        assert len(again) == 2
        assert again.recall("S02a", Q, never) == lost
        assert again.recall("S03a", Q, lambda: {"reasons": [""]}) == {"reasons": [""]}
    with journal(tmp_path) as last:
        assert last.recall("S03a", Q, never) == {"reasons": [""]}
