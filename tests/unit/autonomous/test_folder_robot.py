"""A robot behind a folder: a thread plays the cell, reads the programs, and answers."""

import csv
import itertools
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import FileFormatError, InputError, JointLimitError
from calib.se3 import FloatArray
from posedesign.autonomous import FolderRobot
from posedesign.cell import Cell
from posedesign.programs import DIALECTS, Arm, read, validate
from tests.arms import PULSES, cell_for

POLL_S = 0.002
ROUNDING_DEG = 1.01e-3
"""FANUC's joint 3 is the sum of two values of three decimals."""


def picture_of(posture: FloatArray, count: int = 1) -> NDArray[np.uint8]:
    """A picture whose pixels are the bytes of a posture, and in the last row a count."""
    rows = np.frombuffer(np.append(posture, count).astype(float).tobytes(), np.uint8)
    return rows.reshape(-1, 8)


def seen_in(picture: NDArray[np.uint8]) -> FloatArray:
    """The posture and the count in a picture."""
    return np.frombuffer(picture.tobytes(), float)


def save_table(path: Path, values_deg: FloatArray, column: str = "j{}_deg", name: str = "") -> None:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        columns = [column.format(i + 1) for i in range(len(values_deg))]
        writer.writerow([*columns, *(["name"] if name else [])])
        writer.writerow([*(f"{v:.6f}" for v in values_deg), *([name] if name else [])])


class ServedCell(threading.Thread):
    """Serves a folder: runs what is new in ``out``, saves what ``answer`` says, then a picture."""

    def __init__(
        self, cell: Cell, folder: Path, answer: Callable[[Path, str, FloatArray], None] | None
    ) -> None:
        super().__init__(daemon=True)
        self.folder, self.answer = folder, answer
        self.arm = Arm.of(cell.robot)
        self.visited: list[FloatArray] = []
        self.stop = threading.Event()
        self.failed: BaseException | None = None

    def run(self) -> None:
        done: set[str] = set()
        try:
            while not self.stop.wait(POLL_S):
                orders = sorted(path.name for path in (self.folder / "out").iterdir())
                for name in orders:
                    if name not in done and re.fullmatch(r"\d{4}\.csv|\d{4}_\d+\.request", name):
                        self._serve(name)
                        done.add(name)
        except BaseException as error:
            self.failed = error

    def _serve(self, name: str) -> None:
        label, _, ending = name.partition(".")
        if ending == "csv":
            (path,) = (self.folder / "out").glob(f"MOVE{label}.*")
            posture = read(path).postures(self.arm)[0]
            self.visited.append(posture)
            if self.answer is not None:
                self.answer(self.folder, label, posture)
        count = int(label.partition("_")[2] or 1)
        done, data = cv2.imencode(".png", picture_of(self.visited[-1], count))
        assert done
        aside = self.folder / "in" / f".{label}"
        aside.write_bytes(bytes(data))
        aside.rename(self.folder / "in" / f"{label}.png")


@pytest.fixture
def serve() -> Iterator[Callable[..., ServedCell]]:
    """Starts a thread that serves a folder; it must not have failed in the end."""
    started: list[ServedCell] = []

    def start(
        cell: Cell, folder: Path, answer: Callable[[Path, str, FloatArray], None] | None = None
    ) -> ServedCell:
        started.append(ServedCell(cell, folder, answer))
        started[-1].start()
        return started[-1]

    yield start
    for server in started:
        server.stop.set()
        server.join()
        assert server.failed is None


def robot_in(cell: Cell, folder: Path, timeout_s: float = 5.0, **options: str) -> FolderRobot:
    return FolderRobot(cell, folder, timeout_s=timeout_s, poll_s=POLL_S, **options)


def answered(folder: Path, label: str, count: int = 1) -> None:
    """A picture that is there at once."""
    done, data = cv2.imencode(".png", picture_of(np.zeros(6), count))
    assert done
    (folder / "in" / f"{label}.png").write_bytes(bytes(data))


def tree(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_moves_and_pictures_go_with_each_other(reference_cell, tmp_path, serve):
    robot = robot_in(reference_cell, tmp_path)
    served = serve(reference_cell, tmp_path)
    rng = np.random.default_rng(3)
    for k in range(4):
        posture = reference_cell.base_posture + np.deg2rad(rng.uniform(-8, 8, 6))
        robot.move(posture - np.deg2rad(0.2))  # from one side: nobody looks on the way
        robot.move(posture)
        for count in (1, 2, 3)[: k + 1]:
            found = seen_in(robot.grab())
            assert np.abs(np.rad2deg(found[:6] - posture)).max() < ROUNDING_DEG
            assert found[6] == count
            # without an answer: as the values stand in the program that the cell has read
            assert np.array_equal(robot.joints(), found[:6])
    assert len(served.visited) == 8
    assert "0008_3.request" in tree(tmp_path / "out")
    assert "0008_4.request" not in tree(tmp_path / "out")
    assert "0007_2.request" not in tree(tmp_path / "out")


def test_joints_can_be_asked_for_before_the_picture(reference_cell, tmp_path, serve):
    def answer(folder: Path, label: str, posture: FloatArray) -> None:
        time.sleep(0.03)
        save_table(folder / "in" / f"{label}.csv", np.rad2deg(posture) + 0.02)

    robot = robot_in(reference_cell, tmp_path)
    serve(reference_cell, tmp_path, answer)
    robot.move(reference_cell.base_posture)
    off = np.rad2deg(robot.joints() - reference_cell.base_posture)
    assert off == pytest.approx(np.full(6, 0.02), abs=ROUNDING_DEG)


@pytest.mark.parametrize("kind", ["pendant table", "program", "program in small letters"])
def test_a_pendant_shows_joint_3_to_the_horizontal(kind, reference_cell, tmp_path, serve):
    shift = np.array([0.03, -0.05, 0.04, 0.01, -0.02, 0.05])

    def answer(folder: Path, label: str, posture: FloatArray) -> None:
        shown = np.rad2deg(posture) + shift
        shown[2] -= shown[1]  # J3 = q3 - q2, by hand
        if kind == "pendant table":
            save_table(folder / "in" / f"{label}.csv", shown, "pendant_j{}_deg")
            return
        text = (folder / "out" / f"MOVE{label}.LS").read_text()
        values = iter(shown)
        text = re.sub(r"(J\d=) *[-.\d]+", lambda m: f"{m[1]}{next(values):10.3f}", text)
        name = f"MOVE{label}.LS"
        (folder / "in" / (name.lower() if "small" in kind else name)).write_text(text)

    robot = robot_in(reference_cell, tmp_path)
    serve(reference_cell, tmp_path, answer)
    posture = reference_cell.base_posture + 0.1
    robot.move(posture)
    robot.grab()
    text = (tmp_path / "out" / "MOVE0001.LS").read_text()
    written = [float(value) for value in re.findall(r"J\d= *([-.\d]+)", text)]
    q2, q3 = np.rad2deg(posture[1:3])
    assert written[2] == pytest.approx(q3 - q2, abs=6e-4)
    assert np.rad2deg(robot.joints() - posture) == pytest.approx(shift, abs=2.5e-3)


def test_a_pendants_joint_3_in_the_column_of_the_urdf_is_refused(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    robot.move(reference_cell.base_posture)
    shown = np.rad2deg(reference_cell.base_posture)
    shown[2] -= shown[1]
    assert abs(shown[1]) > 1.0
    save_table(tmp_path / "in" / "0001.csv", shown)
    with pytest.raises(InputError, match=r"where move 1 commands .*those of the pendant") as caught:
        robot.joints()
    assert "pendant_j1_deg" in caught.value.hint
    assert caught.value.name == reference_cell.robot.joint_names[2]


@pytest.mark.parametrize("name", DIALECTS)
def test_every_controller(name, tmp_path):
    dialect = DIALECTS[name]
    cell = cell_for(dialect)
    robot = robot_in(cell, tmp_path, dialect=name)
    posture = cell.base_posture + np.deg2rad(0.123456)
    robot.move(posture)
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert not any(b"MEASURE" in path.read_bytes() for path in files)
    (program,) = (p for p in files if p.suffix.lower() == dialect.suffixes[0] and "MOVE" in p.name)
    assert validate(program, name) == []
    recorded = dialect.reading(PULSES).read(program)
    stands = recorded.postures(dialect.seen(Arm.of(cell.robot)))
    assert len(stands) == 1
    assert np.abs(np.rad2deg(stands[0] - posture)).max() < ROUNDING_DEG
    with (tmp_path / "out" / "0001.csv").open() as stream:
        (row,) = csv.DictReader(line for line in stream if not line.startswith("#"))
    degrees = [float(row[f"j{i + 1}_deg"]) for i in range(cell.robot.n)]
    assert degrees == pytest.approx(np.rad2deg(posture), abs=1e-8)
    answered(tmp_path, "0001")
    robot.grab()
    assert np.array_equal(robot.joints(), stands[0])
    beside = (tmp_path / "in" / program.relative_to(tmp_path / "out")).parent
    beside.mkdir(exist_ok=True)
    (beside / program.name).write_bytes(program.read_bytes())
    assert np.array_equal(robot.joints(), stands[0])


@pytest.mark.parametrize("name", ["kuka-krl", "fanuc-ls", "staubli-val3"])
def test_the_table_comes_last(name, tmp_path, monkeypatch):
    cell = cell_for(DIALECTS[name])
    there: list[list[str]] = []
    rename = os.replace

    def seen(path: Path, target: Path, **options: int) -> None:
        rename(path, target, **options)
        there.append(sorted(p.name for p in (tmp_path / "out").iterdir()))

    robot = robot_in(cell, tmp_path)
    monkeypatch.setattr(os, "replace", seen)
    robot.move(cell.base_posture)
    assert len(there[-1]) >= 2
    assert [names for names in there if "0001.csv" in names] == there[-1:]


def test_what_the_arm_cannot_do_is_not_written(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    beyond, nan = reference_cell.base_posture.copy(), reference_cell.base_posture.copy()
    beyond[4] = reference_cell.robot.upper[4] + 0.01
    nan[0] = np.nan
    coupled = reference_cell.base_posture.copy()
    limit = reference_cell.robot.coupled_limits[0]
    coupled += (
        limit.coefficients
        * (limit.upper + 0.01 - coupled @ limit.coefficients)
        / (limit.coefficients @ limit.coefficients)
    )
    for posture, kind in ((beyond, JointLimitError), (coupled, JointLimitError), (nan, InputError)):
        with pytest.raises(kind):
            robot.move(posture)
    with pytest.raises(InputError):
        robot.move(reference_cell.base_posture[:5])
    assert tree(tmp_path) == ["in", "out"]


def test_what_the_controller_would_refuse_is_not_given_out(make_cell, tmp_path, monkeypatch):
    cell = make_cell(program={"tool_frame": 99})  # FANUC has ten
    with pytest.raises(InputError, match="tool_frame"):
        robot_in(cell, tmp_path).move(cell.base_posture)
    writes = DIALECTS["fanuc-ls"].render
    monkeypatch.setattr(
        type(DIALECTS["fanuc-ls"]),
        "render",
        lambda _, program, arm: {
            name: text.replace("% FINE", "% FIN") for name, text in writes(program, arm).items()
        },
    )
    sane = make_cell()
    with pytest.raises(InputError, match=r"MOVE0001\.LS would be refused: line \d"):
        robot_in(sane, tmp_path).move(sane.base_posture)
    assert tree(tmp_path) == ["in", "out"]


@pytest.mark.parametrize("stale", ["0007.png", "0007.CSV", "0007_2.png", "move0007.ls"])
def test_results_of_an_earlier_run_are_not_taken(stale, reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    (tmp_path / "out" / "MOVE0006.LS").touch()
    (tmp_path / "in" / stale).touch()
    with pytest.raises(InputError, match="was there before move 7 was written") as caught:
        robot.move(reference_cell.base_posture)
    assert "elsewhere" in caught.value.hint
    assert tree(tmp_path / "out") == ["MOVE0006.LS"]
    (tmp_path / "in" / stale).unlink()
    robot.move(reference_cell.base_posture)
    assert tree(tmp_path / "out") == ["0007.csv", "MOVE0006.LS", "MOVE0007.LS"]


def test_a_second_picture_that_is_there_too_early(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    robot.move(reference_cell.base_posture)
    answered(tmp_path, "0001")
    answered(tmp_path, "0001_2")
    robot.grab()
    with pytest.raises(InputError, match="was there before picture 0001_2 was asked for"):
        robot.grab()
    assert "0001_2.request" not in tree(tmp_path / "out")


def test_numbers_go_on(reference_cell, tmp_path):
    posture = reference_cell.base_posture
    robot_in(reference_cell, tmp_path).move(posture)
    robot = robot_in(reference_cell, tmp_path)
    robot.move(posture)
    for path in (tmp_path / "out").iterdir():
        path.unlink()  # a controller may take programs away
    robot.move(posture)
    assert tree(tmp_path / "out") == ["0003.csv", "MOVE0003.LS"]
    (tmp_path / "out" / "notes 9999.txt").touch()
    (tmp_path / "out" / "00041.csv").touch()
    robot.move(posture)
    assert "0004.csv" in tree(tmp_path / "out")
    (tmp_path / "out" / "9999.csv").touch()
    with pytest.raises(InputError, match="9999 moves"):
        robot.move(posture)


def test_two_that_order_moves_of_one_arm(reference_cell, tmp_path):
    """Pictures of either would be taken from where the other has sent the arm."""
    first, second = (robot_in(reference_cell, tmp_path) for _ in range(2))
    first.move(reference_cell.base_posture)
    second.move(reference_cell.base_posture)
    with pytest.raises(InputError, match="has move 2 of somebody else"):
        first.move(reference_cell.base_posture)
    second.move(reference_cell.base_posture)
    assert tree(tmp_path / "out")[:3] == ["0001.csv", "0002.csv", "0003.csv"]


def test_waiting_ends_and_can_be_taken_up_again(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path, timeout_s=0.05)
    robot.move(reference_cell.base_posture)
    begun = time.monotonic()
    with pytest.raises(FileFormatError, match=r"0001\.png: has not come in 0\.05 s") as caught:
        robot.grab()
    assert time.monotonic() - begun >= 0.05
    assert "MOVE0001.LS" in caught.value.hint
    with pytest.raises(FileFormatError):
        robot.joints()
    answered(tmp_path, "0001")
    assert seen_in(robot.grab())[6] == 1
    for _ in range(2):
        with pytest.raises(FileFormatError, match=r"0001_2\.png: has not come"):
            robot.grab()
    answered(tmp_path, "0001_2", 2)
    assert seen_in(robot.grab())[6] == 2


def test_a_picture_that_is_still_being_written_is_waited_for(reference_cell, tmp_path):
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 256, (40, 50), dtype=np.uint8)
    done, data = cv2.imencode(".png", picture)
    assert done
    path = tmp_path / "in" / "0001.PNG"
    robot = robot_in(reference_cell, tmp_path)
    robot.move(reference_cell.base_posture)

    def write_slowly() -> None:
        with path.open("wb", buffering=0) as stream:
            for part in np.array_split(np.frombuffer(bytes(data), np.uint8), 4):
                stream.write(part.tobytes())
                time.sleep(0.02)

    writer = threading.Thread(target=write_slowly)
    writer.start()
    found = robot.grab()
    writer.join()
    assert np.array_equal(found, picture)


def test_a_picture_that_never_becomes_one(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path, timeout_s=0.03)
    robot.move(reference_cell.base_posture)
    answered(tmp_path, "0001")
    path = tmp_path / "in" / "0001.png"
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    with pytest.raises(FileFormatError) as caught:
        robot.grab()
    assert (
        caught.value.message
        == f"{path}: could not be used in 0.03 s: cannot be decoded: broken PNG file (chunk b'IEN')"
    )
    path.write_bytes(whole)
    robot.grab()


def test_what_changes_without_end_is_not_read(reference_cell, tmp_path, monkeypatch):
    robot = robot_in(reference_cell, tmp_path, timeout_s=0.03)
    robot.move(reference_cell.base_posture)
    answered(tmp_path, "0001")
    path, sleep, looks = tmp_path / "in" / "0001.png", time.sleep, itertools.count(1)

    def written_anew(seconds: float) -> None:
        k = next(looks)
        os.utime(path, ns=(k, k))  # a whole picture every time
        sleep(seconds)

    monkeypatch.setattr(time, "sleep", written_anew)
    with pytest.raises(FileFormatError, match="it changes"):
        robot.grab()
    assert next(looks) > 2


def test_what_is_no_file_is_not_opened(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path, timeout_s=0.03)
    robot.move(reference_cell.base_posture)
    os.mkfifo(tmp_path / "in" / "0001.png")  # to open it would wait for ever
    with pytest.raises(FileFormatError, match="no ordinary file"):
        robot.grab()


@pytest.mark.parametrize(("off_deg", "taken"), [(0.06, True), (0.15, False)])
def test_an_arm_that_was_moved(off_deg, taken, reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    robot.move(reference_cell.base_posture)
    answered(tmp_path, "0001")
    shown = np.rad2deg(reference_cell.base_posture)
    shown[3] += off_deg
    save_table(tmp_path / "in" / "0001.csv", shown, name="0001")
    if taken:
        robot.grab()
        assert np.rad2deg(robot.joints()) == pytest.approx(shown, abs=1e-6)
        return
    for ask in (robot.grab, robot.joints):
        with pytest.raises(InputError, match=r"move 1 commands 0.00 deg: 0\.15 deg off") as caught:
            ask()
        assert "\n" not in str(caught.value)
    save_table(tmp_path / "in" / "0001.csv", np.rad2deg(reference_cell.base_posture))
    robot.grab()


def test_results_of_another_move(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path)
    near = reference_cell.base_posture + np.deg2rad(0.01)
    robot.move(near)
    robot.move(reference_cell.base_posture)
    answered(tmp_path, "0002")
    (tmp_path / "in" / "MOVE0002.LS").write_bytes((tmp_path / "out" / "MOVE0001.LS").read_bytes())
    with pytest.raises(InputError, match="the result of another move than 2"):
        robot.grab()
    (tmp_path / "in" / "0002.csv").write_bytes((tmp_path / "out" / "0001.csv").read_bytes())
    with pytest.raises(InputError, match="the result of another move than 2"):
        robot.grab()
    (tmp_path / "in" / "0002.csv").write_bytes((tmp_path / "out" / "0002.csv").read_bytes())
    robot.grab()


def test_tables_that_cannot_be_used(reference_cell, tmp_path):
    robot = robot_in(reference_cell, tmp_path, timeout_s=0.03)
    robot.move(reference_cell.base_posture)
    path = tmp_path / "in" / "0001.csv"
    row = "1,2,3,4,5,6\n"
    header = "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n"
    for text, why in (
        (header, "has no rows"),
        (header + row + row, "2 poses, not one"),
        (header + row.replace("3", "abc"), "column j3_deg: 'abc' is not a finite number"),
    ):
        path.write_text(text)
        with pytest.raises(FileFormatError, match=why) as caught:
            robot.joints()
        assert str(caught.value).count(str(path)) == 1


def test_nothing_is_written_elsewhere(reference_cell, tmp_path):
    folder, other = tmp_path / "share", tmp_path / "other"
    folder.mkdir()
    other.mkdir()
    (folder / "out").symlink_to(other)
    with pytest.raises(InputError, match="is a link"):
        robot_in(reference_cell, folder)
    (folder / "out").unlink()
    robot = robot_in(reference_cell, folder)
    (other / "kept").write_text("kept")
    (folder / "out" / "0001.csv").symlink_to(other / "kept")
    robot.move(reference_cell.base_posture)
    (folder / "out" / "0002_2.request").symlink_to(other / "kept")
    (folder / "in" / "0002.png").symlink_to(folder / "in" / "picture")
    done, data = cv2.imencode(".png", picture_of(np.zeros(6)))
    assert done
    (folder / "in" / "picture").write_bytes(bytes(data))
    robot.grab()
    (folder / "in" / "0002_2.png").unlink(missing_ok=True)
    threading.Timer(0.03, answered, (folder, "0002_2", 2)).start()
    assert seen_in(robot.grab())[6] == 2
    assert tree(tmp_path / "other") == ["kept"]
    assert (other / "kept").read_text() == "kept"
    assert sorted(path.name for path in folder.iterdir()) == ["in", "out"]


def test_wrong_uses(reference_cell, tmp_path):
    with pytest.raises(InputError, match="there is no folder"):
        robot_in(reference_cell, tmp_path / "none")
    with pytest.raises(InputError, match="unknown dialect"):
        robot_in(reference_cell, tmp_path, dialect="fanuc")
    with pytest.raises(InputError, match="wrong convention"):
        robot_in(reference_cell, tmp_path, dialect="kuka-krl")
    with pytest.raises(InputError, match="timeout_s"):
        robot_in(reference_cell, tmp_path, timeout_s=0.0)
    robot = robot_in(reference_cell, tmp_path)
    for ask in (robot.grab, robot.joints):
        with pytest.raises(InputError, match="there was no move"):
            ask()


@pytest.mark.parametrize("place", ["in", "out"])
def test_a_folder_that_becomes_a_link_leads_nowhere(place, reference_cell, tmp_path):
    """Between two moves: what is elsewhere is neither written nor read."""
    share, elsewhere = tmp_path / "share", tmp_path / "elsewhere"
    share.mkdir()
    robot = robot_in(reference_cell, share, timeout_s=0.05)
    robot.move(reference_cell.base_posture)
    answered(share, "0001")
    (share / place).rename(elsewhere)
    (share / place).symlink_to(elsewhere)
    before = tree(elsewhere)
    ask = {"in": robot.grab, "out": lambda: robot.move(reference_cell.base_posture + 0.01)}
    with pytest.raises(InputError, match="is a link"):
        ask[place]()
    assert tree(elsewhere) == before
