"""A whole calibration of a robot behind a folder, served by a simulated cell in another thread."""

from __future__ import annotations

import csv
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.robot_world import solve
from calib.se3 import inverse, rotation_angle
from calib.vision.touch_up import SimulatedArms
from posedesign.autonomous import FolderRobot, calibrate_robot
from posedesign.cell import Cell
from posedesign.cell.schema_sections import BoardSection
from posedesign.hand_eye.pairs import read_pairs
from posedesign.simulation import true_cell, true_observer

ONLY = np.zeros(1, dtype=np.intp)


class ServedCell:
    """The other end of the folder: runs each move in order, and answers with pictures."""

    def __init__(self, arms: SimulatedArms, folder: Path, *, done_only: bool = False) -> None:
        self._arms, self._folder, self._done_only = arms, folder, done_only
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self.moves = 0

    def __enter__(self) -> ServedCell:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self._thread.join()

    def _serve(self) -> None:
        while not self._done.wait(0.002):
            while (order := self._folder / "out" / f"{self.moves + 1:04d}.csv").exists():
                self.moves += 1
                self._arms.move(ONLY, self._joints(order))
                self._answer(f"{self.moves:04d}")
            for request in (self._folder / "out").glob("*.request"):
                if not (self._folder / "in" / f"{request.stem}.png").exists():
                    self._answer(request.stem)

    @staticmethod
    def _joints(order: Path) -> np.ndarray:
        with order.open() as stream:
            row = next(csv.DictReader(line for line in stream if not line.startswith("#")))
        return np.deg2rad([[float(row[f"j{k + 1}_deg"]) for k in range(6)]])

    def grab(self) -> np.ndarray:
        """What a camera sees that is connected to the other computer."""
        picture = self._arms.picture(0)
        assert picture is not None
        return picture

    def _answer(self, label: str) -> None:
        if self._done_only:
            (self._folder / "in" / f"{label}.done").touch()
            return
        picture = self._arms.picture(0)
        assert picture is not None
        aside = self._folder / "in" / f".{label}.png"
        assert cv2.imwrite(str(aside), picture)
        aside.rename(self._folder / "in" / f"{label}.png")


@pytest.fixture
def small_cell(make_demo_cell) -> Iterator[Cell]:
    return make_demo_cell(
        camera={"image_px": [640, 512], "focal_px": 900.0, "largest_tilt_deg": 50.0},
        parameters={"models": [["zero_offsets"], ["zero_offsets", "compliance"]]},
        touch_up={"repeats": 2},
        variations={"start_deg": [40.0, 40.0, 40.0]},
    )


BOARD = {
    "kind": "charuco",
    "columns": 8,
    "rows": 6,
    "square_mm": 11.0,
    "marker_mm": 8.0,
    "dictionary": "DICT_5X5_100",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "camera"),
    [
        # pictures of a circle, and pictures in the folder: the other two have both
        pytest.param(None, False, marks=pytest.mark.full),
        (BOARD, False),
        (None, True),
    ],
    ids=["circle", "board", "camera here"],
)
def test_programs_out_and_pictures_in(small_cell, tmp_path, board, camera):
    section = None if board is None else BoardSection.model_validate(board)
    changed = small_cell.config.model_copy(update={"board": section})
    cell = Cell.from_config(changed, Path("cell.toml"))
    folder, out = tmp_path / "share", tmp_path / "run"
    folder.mkdir()
    rng = np.random.default_rng(3)
    arms = SimulatedArms(true_cell(cell), true_observer(cell, "image"), 1, rng, cell.base_posture)
    served = ServedCell(arms, folder, done_only=camera)
    robot = FolderRobot(
        cell, folder, camera=served if camera else None, timeout_s=60.0, poll_s=0.005
    )
    with served:
        done = calibrate_robot(cell, robot, out)
    assert not done.missed
    assert len(done.touch_ups.names) == 27
    found = {r.model: r for r in done.identified.comparison.results}
    assert found["offsets + compliance"].leave_one_out_rms_m < 1e-4
    assert found["frames only"].leave_one_out_rms_m > 4e-4
    pairs = read_pairs(out / "pairs.csv")
    found_again = solve(pairs.A, pairs.B)
    off = inverse(true_cell(cell).T_tip_camera) @ found_again.X
    assert np.linalg.norm(off[:3, 3]) < 2e-3
    assert rotation_angle(off[:3, :3]) < np.deg2rad(0.2)
    with (out / "log.csv").open(newline="") as log:
        rows = list(csv.DictReader(line for line in log if not line.startswith("#")))
    kept = {row["picture"] for row in rows}
    assert {path.name for path in (out / "pictures").iterdir()} <= kept
    # every move was a program that the controller can run, and no other was made
    assert len(list((folder / "out").glob("MOVE*.LS"))) == served.moves
    again = calibrate_robot(cell, robot, out)
    np.testing.assert_array_equal(again.touch_ups.postures, done.touch_ups.postures)
    assert served.moves == len(list((folder / "out").glob("MOVE*.LS")))
