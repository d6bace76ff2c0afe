"""The two steps by sight: what is found, what is kept, and what stops it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posedesign
from calib.errors import ConvergenceError, FileFormatError, InputError, UnreachableError
from calib.se3 import FloatArray, IntArray, inverse
from calib.vision.camera import MeasurementNoise
from calib.vision.camera.rendering import GreyImage
from calib.vision.touch_up import RobotAdapter, SimulatedArms
from posedesign.autonomous import Calibration, SightResult, calibrate_robot, process
from posedesign.autonomous.folder_robot import drive_of, refusals_of
from posedesign.autonomous.journal import Journal, KeptStation
from posedesign.autonomous.process import LEAST_SIGMA_M, calibrate
from posedesign.cell import Cell, cell_template
from posedesign.files.measurements import read_measurements
from posedesign.simulation import true_cell, true_observer
from tests.cli.conftest import empty_pictures
from tests.marks import rest_in_full

Whole = tuple[Calibration, Path, int]
"""What was found, where, and how many moves it took."""

SEED = 7
ONE = np.zeros(1, dtype=np.intp)
NOISE = MeasurementNoise.from_sigma([0.005, 0.005, 0.012])
QUICK = {"parameters": {"models": [["zero_offsets"], ["zero_offsets", "compliance"]]}}


class StoppedError(Exception):
    """The operator's hand on the button."""


class StoppingArms:
    """Simulated arms that are stopped after so many moves."""

    def __init__(self, arms: SimulatedArms, moves: int | None) -> None:
        self._arms = arms
        self._moves = moves
        self.made = 0
        self.visited: list[FloatArray] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arms, name)

    def move(self, which: IntArray, q: FloatArray) -> None:
        self.made += 1
        if self._moves is not None and self.made > self._moves:
            raise StoppedError
        self._arms.move(which, q)
        self.visited.extend(q)


def arms_of(cell: Cell) -> SimulatedArms:
    rng = np.random.default_rng(SEED)
    observer = true_observer(cell, "fast", NOISE)
    return SimulatedArms(true_cell(cell), observer, 1, rng, cell.base_posture)


@contextmanager
def station_of(
    cell: Cell, out: Path, moves: int | None = None, arms: StoppingArms | None = None
) -> Iterator[KeptStation]:
    driven = arms or StoppingArms(arms_of(cell), moves)
    out.mkdir(exist_ok=True)
    with Journal(out / "journal.jsonl", {"robot": "of a test"}) as journal:
        yield KeptStation(drive_of(cell, driven), journal, SEED)


@pytest.fixture(scope="module")
def cell(make_cell) -> Cell:
    """With nothing around the arm: its poses are planned in a moment."""
    return make_cell(**QUICK)


@pytest.fixture(scope="module", autouse=True)
def _without_figures():
    with empty_pictures():
        yield


@pytest.fixture(scope="module")
def whole(cell, tmp_path_factory) -> Whole:
    out = tmp_path_factory.mktemp("whole")
    with station_of(cell, out) as station:
        done = calibrate(cell, station, out)
    return done, out, station.drive.arms.made


@pytest.fixture
def planned_once(whole, monkeypatch) -> None:
    """The same set-up has the same plan, and is identified elsewhere."""
    monkeypatch.setattr(process, "plan_poses", lambda cell, results: whole[0].plan)
    monkeypatch.setattr(process, "identify_file", lambda *_, **__: whole[0].identified)


def test_camera_and_target_are_found(cell, whole):
    """From a cell that is told nothing of them: within what the arm itself is off."""
    done, _, _ = whole
    truth = true_cell(cell)
    off = inverse(truth.T_tip_camera) @ done.cell.T_tip_camera
    assert np.linalg.norm(off[:3, 3]) < 2e-3
    assert np.arccos((np.trace(off[:3, :3]) - 1.0) / 2.0) < np.deg2rad(0.3)
    q = done.set_up.postures[:1]
    shown = cell.robot.fk(q[0]) @ inverse(truth.model.view(q, truth.values).T_base_tip[0])
    seen = shown @ truth.T_base_target
    assert np.linalg.norm(done.cell.target_m - seen[:3, 3]) < 2e-3
    assert np.arccos(min(1.0, done.cell.target_normal @ seen[:3, 2])) < np.deg2rad(0.5)


def test_touch_ups_leave_what_noise_and_lost_motion_leave(whole):
    done, _, _ = whole
    assert not done.missed
    assert len(done.touch_ups.names) == len(done.plan.postures) == 27
    found = {r.model: r for r in done.identified.comparison.results}
    frames, elastic = found["frames only"], found["offsets + compliance"]
    assert frames.leave_one_out_rms_m > 5e-4
    assert elastic.leave_one_out_rms_m < 0.1 * frames.leave_one_out_rms_m
    expected = {t.name: t.expected.rms_m for t in done.identified.comparison.trials if t.expected}
    taken = expected[done.identified.comparison.recommended]
    assert taken < 1.1 * expected["offsets + compliance"]
    assert taken < 0.2 * expected["frames only"]


def test_noise_that_repeats_cannot_show_is_a_bound(whole):
    """Repeats that agree by chance are weighted by the least noise, and no figure was measured."""
    found = replace(whole[0], sigma_m=np.array([LEAST_SIGMA_M, 2e-5, 4e-5]))
    said = SightResult(found, None)
    assert "from repeats: at most 0.009, 0.060, 0.120 mm" in said.noise_in_words()
    assert said.as_dict()["three_sigma_is_a_bound"] == [True, False, False]


def test_files_say_the_same(whole):
    done, out, _ = whole
    table = read_measurements(out / "touchups.csv", done.cell.robot.n, kind="touch-up")
    np.testing.assert_allclose(table.data.postures, done.touch_ups.postures, atol=1e-8)
    back = Cell.load(out / "found_cell.toml")
    np.testing.assert_allclose(back.T_tip_camera, done.cell.T_tip_camera, atol=1e-7)
    np.testing.assert_allclose(back.target_m, done.cell.target_m, atol=1e-9)
    np.testing.assert_allclose(back.measurement.sigma, done.sigma_m, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("moves", rest_in_full((1, 20, 60, 130, 170), (60, 170)))
def test_stopped_and_gone_on_it_is_the_same(cell, whole, tmp_path, moves):
    """Whatever it was stopped in: nothing is lost, nothing is measured twice."""
    done, out, made = whole
    with station_of(cell, tmp_path, moves) as first, pytest.raises(StoppedError):
        calibrate(cell, first, tmp_path)
    before = (tmp_path / "journal.jsonl").read_bytes()
    with station_of(cell, tmp_path) as second:
        again = calibrate(cell, second, tmp_path)
    assert (tmp_path / "journal.jsonl").read_bytes().startswith(before)
    np.testing.assert_array_equal(again.touch_ups.postures, done.touch_ups.postures)
    assert (tmp_path / "touchups.csv").read_bytes() == (out / "touchups.csv").read_bytes()
    # made twice is what the measurement had done that it was stopped in: a Jacobian has 14 moves
    assert second.drive.arms.made <= made - moves + 14


@pytest.mark.slow
def test_stopped_among_obstacles(make_demo_cell, tmp_path):
    """With postures that are passed through on the way to others."""
    cell = make_demo_cell(**QUICK)
    with station_of(cell, tmp_path) as station:
        whole = calibrate(cell, station, tmp_path)
        made = station.drive.arms.made
    assert "passed through on the way" in whole.plan.message
    found = {r.model: r.leave_one_out_rms_m for r in whole.identified.comparison.results}
    assert found["frames only"] > 5e-4
    assert found["offsets + compliance"] < 5e-5
    lines = (tmp_path / "journal.jsonl").read_bytes()
    for moves in (130, 170):
        (tmp_path / "journal.jsonl").unlink()
        with station_of(cell, tmp_path, moves) as first, pytest.raises(StoppedError):
            calibrate(cell, first, tmp_path)
        with station_of(cell, tmp_path) as second:
            calibrate(cell, second, tmp_path)
        assert (tmp_path / "journal.jsonl").read_bytes() == lines
        assert second.drive.arms.made <= made - moves + 14


@pytest.mark.slow
def test_a_whole_calibration_is_replayed_without_a_move(cell, whole, tmp_path):
    done, out, _ = whole
    (tmp_path / "journal.jsonl").write_bytes((out / "journal.jsonl").read_bytes())
    with station_of(cell, tmp_path, moves=0) as station:
        again = calibrate(cell, station, tmp_path)
    np.testing.assert_array_equal(again.touch_ups.postures, done.touch_ups.postures)


@pytest.mark.slow
def test_what_the_file_says_of_camera_and_target_is_not_looked_at(cell, whole, tmp_path, make_cell):
    """The same arm, camera and target; a cell that has them somewhere else comes to the same."""
    told = make_cell(
        tool={"point_mm": [0.0, 0.0, 100.0]},
        target={"position_mm": [1700.0, 300.0, 300.0], "normal": [0.0, 1.0, 1.0]},
        camera={"focal_px": 900.0, "position_mm": [0.0, 0.0, 10.0]},
        **QUICK,
    )
    with station_of(told, tmp_path, arms=StoppingArms(arms_of(cell), None)) as station:
        done = calibrate(told, station, tmp_path)
    np.testing.assert_array_equal(done.set_up.tool_m, whole[0].set_up.tool_m)
    np.testing.assert_array_equal(done.cell.target_m, whole[0].cell.target_m)


class Blind(StoppingArms):
    """Sees nothing any more after so many looks."""

    def __init__(self, arms: SimulatedArms, looks: int) -> None:
        super().__init__(arms, None)
        self._looks = looks

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> object:
        self._looks -= 1
        seen = self._arms.look(which, near_px)
        if self._looks >= 0:
            return seen
        return type(seen)(np.full_like(seen.ellipses, np.nan), ("no target: dark",) * len(which))


@pytest.mark.usefixtures("planned_once")
def test_poses_that_were_missed_are_said(cell, tmp_path):
    """Blind for the last quarter of the poses."""
    said: list[str] = []
    with station_of(cell, tmp_path, arms=Blind(arms_of(cell), 110)) as station:
        done = calibrate(cell, station, tmp_path, warn=said.append)
    missed = [pose.name for pose in done.missed]
    assert 0 < len(missed) < 15
    assert all(pose.reason.startswith("lost, no target: dark") for pose in done.missed)
    assert sum("was not touched up" in line for line in said) == len(missed)
    assert set(done.touch_ups.names) | set(missed) == set(done.plan.names)


@pytest.mark.usefixtures("planned_once")
def test_blind_in_step_two(cell, tmp_path):
    with (
        station_of(cell, tmp_path, arms=Blind(arms_of(cell), 66)) as station,
        pytest.raises(ConvergenceError, match="poses could be touched up: lost, no target: dark"),
    ):
        calibrate(cell, station, tmp_path)


def test_moves_into_what_stands_around_are_refused(demo_cell):
    cell = demo_cell
    refuses = refusals_of(cell)
    q = np.tile(cell.base_posture, (2, 1))
    q[1, 1] += np.deg2rad(25.0)  # the upper arm down: the gun into the fixture or the floor
    for start in (np.tile(cell.base_posture, (2, 1)), np.full((2, 6), np.nan)):
        free, into = refuses(start, q)
        assert free == ""
        assert "mm" in into


def test_a_motion_that_is_not_clear_from_where_the_arm_stands(demo_cell):
    """Either end is: between them the fixture stands. Another way is taken, past the base pose."""
    cell = demo_cell
    plan = posedesign.plan(cell)
    arms = arms_of(cell)
    made = StoppingArms(arms, None)
    drive = drive_of(cell, made)
    refuses = drive.refuses  # as near as the arm may come on its way, which is nearer than planned
    assert refuses is not None
    start, end = next(
        (a, b)
        for a in plan.postures
        for b in plan.postures
        if refuses(a[None], b[None])[0].startswith("on the way, ")
    )
    arms.stand(ONE, start[None])
    assert drive.to_posture(ONE, end[None]) == [""]
    assert made.made > 2
    path = np.array([start, *made.visited])
    assert not any(refuses(path[:-1], path[1:]))


class TurnedOn(StoppingArms):
    """Arms whose controller shows J2 one turn on after so many moves."""

    def __init__(self, arms: SimulatedArms, lies_from: int) -> None:
        super().__init__(arms, None)
        self._lies_from = lies_from

    def joints(self, which: IntArray) -> FloatArray:
        lies = self.made >= self._lies_from
        return np.asarray(self._arms.joints(which) + lies * 2.0 * np.pi * np.eye(6)[1])


@pytest.mark.parametrize("lies_from", [0, 22, 140])
def test_a_turn_too_many_ends_it_before_the_next_move(tmp_path, lies_from):
    """At whatever move of a calibration, of an arm that may turn by a whole turn."""
    cell = Cell.from_text(cell_template("ur10e", surroundings=False))
    arms = TurnedOn(arms_of(cell), lies_from)
    with (
        station_of(cell, tmp_path, arms=arms) as station,
        pytest.raises(InputError, match="one turn of 360 deg on"),
    ):
        calibrate(cell, station, tmp_path)
    assert arms.made == lies_from


class Named(RobotAdapter):
    """Says who it is, and that its gate is open."""

    def __init__(self, identity: object) -> None:
        self.identity = identity

    def move(self, q: FloatArray) -> None:
        raise AssertionError("was moved")

    def joints(self) -> FloatArray:
        raise UnreachableError("the gate is open")

    def grab(self) -> GreyImage:
        raise AssertionError("a picture was taken")


@pytest.mark.parametrize(
    ("identity", "kind", "said"),
    [
        ("serial 7", UnreachableError, "the gate is open"),
        (lambda: "serial 7", UnreachableError, "the gate is open"),
        ("serial 8", FileFormatError, r"another robot \(Named serial 7\), not with Named serial 8"),
        (7, InputError, r"identity\(\) of the robot's adapter gave a int"),
    ],
)
def test_touch_ups_belong_to_the_robot_that_its_adapter_names(cell, tmp_path, identity, kind, said):
    with pytest.raises(UnreachableError, match="the gate is open"):
        calibrate_robot(cell, Named("serial 7"), tmp_path)
    with pytest.raises(kind, match=said):
        calibrate_robot(cell, Named(identity), tmp_path)
