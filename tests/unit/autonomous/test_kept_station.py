"""Measurements of a station that are kept: what comes back, and what is refused."""

import json
from typing import Any

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray, IntArray
from calib.vision.camera import Views
from calib.vision.touch_up import Drive, ImageJacobian, Loop, Relation
from posedesign.autonomous.journal import Journal, KeptStation

ABOUT = {"robot": "of a test"}


class Unmoved:
    """Arms of a robot that takes no picture before it was moved."""

    count = 1

    @property
    def image_px(self) -> tuple[int, int]:
        raise InputError("there was no move yet")

    def joints(self, which: IntArray) -> FloatArray:
        return np.zeros((1, 6))

    def move(self, which: IntArray, q: FloatArray) -> None:
        raise AssertionError("was moved")


class Failing(Unmoved):
    """Arms whose adapter has a flaw of its own."""

    def move(self, which: IntArray, q: FloatArray) -> None:
        raise ValueError("a flaw of the adapter")


class Moved:
    """Arms that see a circle from everywhere, and note where they were sent."""

    count, image_px = 1, (640, 480)

    def __init__(self) -> None:
        self.visited: list[FloatArray] = []

    def move(self, which: IntArray, q: FloatArray) -> None:
        self.visited.extend(q)

    def joints(self, which: IntArray) -> FloatArray:
        return np.array(self.visited[-1:] or np.zeros((1, 6)))

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        return Views(np.ones((1, 5)), ("",))


def refuses(start: FloatArray, end: FloatArray) -> list[str]:
    return ["the arm would hit the floor"] * len(end)


def test_a_refused_move_is_told_and_no_picture_asked_for(reference_cell, tmp_path):
    drive = Drive(reference_cell.robot, Unmoved(), 0.0, refuses)
    for _ in range(2):
        with Journal(tmp_path / "journal.jsonl", ABOUT) as journal:
            view = KeptStation(drive, journal).look("taught", reference_cell.base_posture)
            assert isinstance(view, Views)
            assert view.reasons == ("the arm would hit the floor",)


def test_what_is_passed_through_before_a_kept_measurement(reference_cell, tmp_path):
    """Not gone through again; what lies before the next one is, in the same order."""
    asked = [np.full(6, 0.1 * k) for k in range(1, 7)]
    visited = []
    for whole in (False, True):
        arms = Moved()
        drive = Drive(reference_cell.robot, arms, 0.0)
        with Journal(tmp_path / "journal.jsonl", ABOUT) as journal:
            station = KeptStation(drive, journal)
            station.pass_through("V01", asked[0])
            station.look("P01", asked[1])
            if whole:
                station.pass_through("V02", asked[2])
                station.pass_through("V03", asked[3])
                station.look("P02", asked[4])
                station.pass_through("V04", asked[5])
                station.rest()
                station.rest()
        visited.append(arms.visited)
    assert np.array(visited[0]).tolist() == np.array(asked[:2]).tolist()
    assert np.array(visited[1]).tolist() == np.array(asked[2:]).tolist()


def test_a_flaw_of_an_adapter_is_not_called_one_of_the_file(reference_cell, tmp_path):
    drive = Drive(reference_cell.robot, Failing(), 0.0)
    with (
        Journal(tmp_path / "journal.jsonl", ABOUT) as journal,
        pytest.raises(ValueError, match="a flaw of the adapter"),
    ):
        KeptStation(drive, journal).look("taught", reference_cell.base_posture)


ANSWER: dict[str, Any] = {
    "q": [[0.1] * 6],
    "error_px": [[0.0] * 3],
    "ellipses": [[1.0] * 5],
    "moves": [3],
    "status": ["touched"],
    "reasons": [""],
}


@pytest.mark.parametrize(
    "broken",
    [
        {},
        {"q": [[0.1] * 5 + [None]]},
        {"q": [[0.1] * 5]},
        {"q": [[0.1] * 5 + [1e300]]},
        {"q": [[0.1] * 5 + [100.0]]},
        {"q": "none"},
        {"status": ["done"]},
        {"status": []},
        {"moves": "many"},
    ],
)
def test_a_damaged_touch_up(reference_cell, tmp_path, broken):
    path = tmp_path / "journal.jsonl"
    head = {"posedesign": "calibration", "version": 2, "about": ABOUT}
    line = {"name": "P01", "asked": [0.0] * 6, "answer": ANSWER | broken}
    path.write_text(f"{json.dumps(head)}\n{json.dumps(line)}\n")
    jacobian = ImageJacobian(np.eye(3), Relation(np.zeros(2), 100.0))
    with Journal(path, ABOUT) as journal:
        station = KeptStation(Drive(reference_cell.robot, Unmoved(), 0.0), journal)
        if not broken:
            done = station.touch_up("P01", np.zeros(6), jacobian, Loop())
            assert done.touched.all()
            assert done.q.tolist() == ANSWER["q"]
            return
        with pytest.raises(FileFormatError, match="the measurement P01 cannot be read"):
            station.touch_up("P01", np.zeros(6), jacobian, Loop())
