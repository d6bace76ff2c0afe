"""Log and pictures of a calibration: what is in them, how they grow, and what they never do."""

import csv
import itertools
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.errors import FileFormatError, OutputError, UnreachableError
from calib.se3 import FloatArray
from calib.vision.camera import CircleTarget, Views
from calib.vision.touch_up import ImageJacobian, Loop, RobotAdapter, SimulatedArms
from calib.vision.touch_up.arms import OneArm
from calib.vision.touch_up.jacobian import Relation
from posedesign.autonomous import calibrate_robot, run_by_sight
from posedesign.autonomous import record as record_module
from posedesign.autonomous.folder_robot import drive_of
from posedesign.autonomous.journal import Journal, KeptStation
from posedesign.autonomous.record import LOG, Record, RecordedArms
from posedesign.cell import Cell
from posedesign.files import Results
from posedesign.simulation import true_cell, true_observer

ONE = np.zeros(1, dtype=np.intp)
SMALL = {"camera": {"image_px": [320, 256], "focal_px": 450.0}}


class Robot(RobotAdapter):
    """A simulated arm behind its adapter; its power fails before so many moves."""

    def __init__(self, cell: Cell, moves: int = 10_000) -> None:
        rng = np.random.default_rng(2)
        observer = true_observer(cell, "image")
        self._arms = SimulatedArms(true_cell(cell), observer, 1, rng, cell.base_posture)
        self.left, self.taken = moves, []

    def move(self, q: FloatArray) -> None:
        self.left -= 1
        if self.left < 0:
            raise UnreachableError("the power failed")
        self._arms.move(ONE, q[None])

    def joints(self) -> FloatArray:
        return self._arms.joints(ONE)[0]

    def grab(self) -> np.ndarray:
        self.taken.append(self._arms.picture(0))
        return self.taken[-1]


def log_of(out: Path) -> list[dict[str, str]]:
    with (out / "log.csv").open(newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


@contextmanager
def recorded(out: Path, n: int = 6, keep_mb: float = 1.0, say=None) -> Iterator[Record]:
    (log,) = Results(out, "calibrate").claim("measured", LOG, check=False)
    with Record(log, n, keep_mb, say or (lambda text: None)) as record:
        yield record


def test_a_touch_up_in_log_and_pictures(make_demo_cell, tmp_path):
    """Each command with what was shown, each look with its picture, and what was decided."""
    cell = make_demo_cell(**SMALL)
    robot = Robot(cell)
    matrix = np.array([[0.0, -1900.0, 0.0], [-1900.0, 0.0, 0.0], [0.0, 0.0, -150.0]])
    jacobian = ImageJacobian(matrix, Relation((160.0, 128.0), 36.0))
    with recorded(tmp_path) as record, Journal(tmp_path / "journal.jsonl", {}) as journal:
        arms = RecordedArms(OneArm(robot, CircleTarget()), record)
        station = KeptStation(drive_of(cell, arms), journal)
        done = station.touch_up("P 7/é", cell.base_posture, jacobian, Loop(iterations=2))
    rows = log_of(tmp_path)
    looks = [row for row in rows if row["event"] == "look"]
    assert [row["event"] for row in rows[:4]] == ["command", "shown", "command", "shown"]
    assert rows[-1]["event"] == "decided"
    assert rows[-1]["said"].startswith(f"{done.status[0]} after {done.moves[0]} correction")
    assert {row["pose"] for row in rows} == {"P 7/é"}
    assert [int(row["round"]) for row in looks] == list(range(1, len(looks) + 1))
    for command, shown in itertools.pairwise(rows):
        if command["event"] == "command":
            joints = [f"j{k + 1}_deg" for k in range(6)]
            assert [command[j] for j in joints] == [shown[j] for j in joints]
    assert len(looks) == len(robot.taken) == done.moves[0] + 1
    for row, taken in zip(looks, robot.taken, strict=True):
        assert row["picture"] == f"P_7_é_{int(row['round']):02d}.png"
        kept = cv2.imread(str(tmp_path / "pictures" / row["picture"]), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(kept, taken)
    seen = [float(looks[-1][key]) for key in ("right_px", "down_px")]
    np.testing.assert_allclose(seen, done.ellipses[0, :2], atol=1e-3)


def test_both_go_on_after_a_stop_and_nothing_is_replaced(make_demo_cell, tmp_path):
    cell = make_demo_cell(**SMALL)
    with pytest.raises(UnreachableError, match="the power failed"):
        calibrate_robot(cell, Robot(cell, moves=31), tmp_path)
    before = (tmp_path / "log.csv").read_bytes()
    kept = {path.name: path.read_bytes() for path in (tmp_path / "pictures").iterdir()}
    assert log_of(tmp_path)[-1]["said"] == "the power failed"
    with (tmp_path / "log.csv").open("ab") as log:
        log.write(b"2026-01-01T00:00:00.000,middle,7,lo")  # the machine went down in a line
    with pytest.raises(UnreachableError, match="the power failed"):
        calibrate_robot(cell, Robot(cell, moves=31), tmp_path)
    assert (tmp_path / "log.csv").read_bytes().startswith(before)
    for name, data in kept.items():
        assert (tmp_path / "pictures" / name).read_bytes() == data
    rows = log_of(tmp_path)
    looks = Counter((row["pose"], row["round"]) for row in rows if row["event"] == "look")
    assert max(looks.values()) == 1
    pictures = {row["picture"] for row in rows if row["picture"]}
    assert pictures == {path.name for path in (tmp_path / "pictures").iterdir()}
    assert len(pictures) > len(kept)
    with pytest.raises(UnreachableError):
        calibrate_robot(cell, Robot(cell, moves=3), tmp_path, restart=True)
    aside = tmp_path / "session.1"
    assert (aside / "log.csv").read_bytes().startswith(before)
    assert {path.name for path in (aside / "pictures").iterdir()} == pictures


def test_pictures_take_no_more_than_they_may(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (200, 300), dtype=np.uint8)
    seen, said = Views(np.full((1, 5), np.nan), ("no target: dark",)), []
    for expected in (3, 3):  # those of before count
        with recorded(tmp_path, keep_mb=0.2, say=said.append) as record:
            record.begin("P01")
            for _ in range(5):
                record.looked(np.zeros(6), seen, image)
        kept = list((tmp_path / "pictures").iterdir())
        assert len(kept) == expected
        assert sum(path.stat().st_size for path in kept) <= 200_000
    assert len(log_of(tmp_path)) == 10
    assert said == ["pictures are kept no longer, from P01 on: they take 0.2 MB, as allowed"] * 2


def test_a_disk_that_fills_ends_the_pictures_and_not_the_calibration(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(record_module.shutil, "disk_usage", lambda path: usage)
    said: list[str] = []
    with recorded(tmp_path, say=said.append) as record:
        record.begin("P01")
        record.looked(np.zeros(6), Views(np.zeros((1, 5)), ("",)), np.zeros((9, 9), dtype=np.uint8))
    assert said == ["pictures are kept no longer, from P01 on: the disk is nearly full"]
    assert not os.listdir(tmp_path / "pictures")


def test_no_pictures_are_kept_where_none_are_wanted(tmp_path):
    with recorded(tmp_path, keep_mb=0.0) as record:
        record.begin("P01")
        record.looked(np.zeros(6), Views(np.zeros((1, 5)), ("",)), np.zeros((9, 9), dtype=np.uint8))
    assert not (tmp_path / "pictures").exists()


def test_what_somebody_else_wrote_stays(tmp_path):
    (tmp_path / "log.csv").write_text("day,oil\n1,2\n")
    with pytest.raises(FileFormatError, match=r"log.csv: is no log of a calibration"):
        recorded(tmp_path).__enter__()
    assert (tmp_path / "log.csv").read_text() == "day,oil\n1,2\n"
    (tmp_path / "log.csv").unlink()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "pictures").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="pictures is a link"):
        recorded(tmp_path).__enter__()


def test_a_rehearsal_keeps_pictures_where_it_is_asked_to(make_demo_cell, tmp_path):
    """And comes to the same, whether it does or not."""
    cell = make_demo_cell(**SMALL, truth={"target_error_mm": [300.0, 0.0, 0.0]})
    path = tmp_path / "cell.toml"
    from posedesign.cell.file import cell_text

    path.write_text(cell_text(cell.config, tmp_path, ""))
    for name, keep_mb in (("without", None), ("with", 50.0)):
        with pytest.raises(UnreachableError, match="not seen from the taught posture"):
            run_by_sight(path, tmp_path / name, pictures_mb=keep_mb)
    assert not (tmp_path / "without" / "pictures").exists()
    assert os.listdir(tmp_path / "with" / "pictures") == ["taught_01.png"]
    rows = [log_of(tmp_path / name)[-1]["said"] for name in ("without", "with")]
    assert rows[0] == rows[1]
    assert rows[0].startswith("not seen: no target")
