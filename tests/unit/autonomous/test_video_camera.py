"""A camera here: a recording that OpenCV wrote, and a driver that keeps old pictures."""

from collections import deque
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from calib.vision.camera.rendering import GreyImage
from posedesign.autonomous import FolderRobot, VideoCamera
from posedesign.autonomous.by_sight import run_by_sight
from posedesign.cell import cell_template

RATE_HZ, COUNT, SIZE = 20.0, 200, (64, 48)


def picture_of(number: int) -> GreyImage:
    """A picture that shows its number by eight squares, with noise."""
    rng = np.random.default_rng(number)
    bits = np.array([number >> k & 1 for k in range(8)])
    grey = np.repeat(np.repeat(bits.reshape(2, 4), 24, axis=0), 16, axis=1) * 160.0 + 40.0
    return np.clip(grey + rng.normal(0.0, 3.0, grey.shape), 0, 255).astype(np.uint8)


def number_in(picture: GreyImage) -> int:
    squares = picture.reshape(2, 24, 4, 16).mean(axis=(1, 3)).ravel() > 120.0
    return int((squares * 2 ** np.arange(8)).sum())


def written(path: Path, pictures: list[GreyImage]) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), RATE_HZ, SIZE)
    assert writer.isOpened()
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.avi"
    return written(path, [picture_of(k) for k in range(COUNT)])


class Device:
    """A driver that keeps the first pictures nobody asked for, and whose pictures are of a file.

    Picture k is exposed k / RATE_HZ seconds after it was opened.
    """

    def __init__(self, film: Path, keeps: int = 4) -> None:
        capture = cv2.VideoCapture(str(film))
        self.pictures = [capture.read()[1] for _ in range(COUNT)]
        self.now, self._next, self._keeps = 0.0, 0, keeps
        self._kept: deque[int] = deque()
        self._held, self.set_to = 0, {}

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        """Time in which nobody asks."""
        self.now += seconds
        while self._next / RATE_HZ <= self.now:
            if len(self._kept) < self._keeps:
                self._kept.append(self._next)
            self._next += 1

    def isOpened(self) -> bool:
        return True

    def get(self, key: int) -> float:
        return RATE_HZ if key == cv2.CAP_PROP_FPS else 0.0

    def set(self, key: int, value: float) -> bool:
        self.set_to[key] = value
        return True

    def grab(self) -> bool:
        if self._kept:
            self._held = self._kept.popleft()
            return True
        self._held, self.now = self._next, max(self.now, self._next / RATE_HZ)
        self._next += 1
        return self._held < COUNT

    def retrieve(self) -> tuple[bool, GreyImage]:
        return True, self.pictures[self._held]


def test_a_recording_gives_one_picture_after_another(film):
    camera = VideoCamera(str(film))
    assert [number_in(camera.grab()) for _ in range(COUNT)] == list(range(COUNT))
    with pytest.raises(InputError, match=r"camera .*film.avi gives no picture"):
        camera.grab()


@pytest.mark.parametrize("keeps", [1, 4, 60])
def test_what_a_driver_kept_is_never_given(film, keeps):
    """Whatever it keeps, and whenever it is asked: the picture was exposed after the call."""
    device = Device(film, keeps)
    camera = VideoCamera("0", open_=lambda source: device, clock=device.clock)
    for pause in (0.31, 0.02, 2.0):
        device.wait(pause)
        asked = device.now
        shown = number_in(camera.grab())
        assert asked < shown / RATE_HZ < asked + 6 / RATE_HZ


def test_a_device_is_set_to_the_size_and_told_where_it_does_not_take_it(film):
    device = Device(film)
    camera = VideoCamera("0", (1280, 1024), open_=lambda source: device, clock=device.clock)
    assert device.set_to == {cv2.CAP_PROP_FRAME_WIDTH: 1280, cv2.CAP_PROP_FRAME_HEIGHT: 1024}
    with pytest.raises(InputError, match="camera 0 gives pictures of 64 x 48, not 1280 x 1024"):
        camera.grab()


def test_a_stream_that_is_never_caught_up_with_is_told(film):
    device = Device(film)
    device.grab = lambda: True
    camera = VideoCamera("rtsp://me:secret@10.0.0.7/eye", open_=lambda source: device)
    with pytest.raises(InputError, match="gives old pictures without an end") as refused:
        camera.grab()
    assert "secret" not in str(refused.value)
    assert "rtsp://10.0.0.7/eye" in str(refused.value)


@pytest.mark.parametrize(
    ("pictures", "said"),
    [
        (np.full((24, 32, 3), 99, np.uint8), "gives pictures of 32 x 24, not 64 x 48"),
        (np.full((48, 64, 3), 9, np.uint8), "gives black pictures"),
        (np.full((48, 64, 3), 99, np.uint8), "camera 0 is frozen: 50 pictures are the same"),
        (np.full((48, 64), 900, np.uint16), "gives pictures of uint16"),
        (None, "gave a picture that cannot be read"),
        ("unplugged", "gives no picture"),
    ],
)
def test_a_camera_that_becomes_useless_is_told(film, pictures, said):
    device = Device(film)
    camera = VideoCamera("0", open_=lambda source: device, clock=device.clock)
    camera.grab()
    device.pictures = [pictures] * COUNT
    if isinstance(pictures, str):
        device.grab = lambda: False
    with pytest.raises(InputError, match=said):
        camera.grab()


def test_what_cannot_be_opened_is_told(tmp_path):
    (tmp_path / "no.avi").write_bytes(b"no film")
    with pytest.raises(InputError, match=r"no.avi cannot be opened"):
        VideoCamera(str(tmp_path / "no.avi"))


@pytest.fixture
def share(tmp_path) -> Path:
    (tmp_path / "share").mkdir()
    return tmp_path / "share"


def test_with_a_folder_an_empty_file_says_that_the_arm_stands(film, share, demo_cell):
    robot = FolderRobot(demo_cell, share, camera=VideoCamera(str(film)), timeout_s=0.3, poll_s=0.01)
    robot.move(demo_cell.base_posture)
    with pytest.raises(FileFormatError, match=r"0001.done: has not come"):
        robot.grab()
    (share / "in" / "0001.done").touch()
    np.testing.assert_allclose(robot.joints(), demo_cell.base_posture, atol=2e-5)
    assert [number_in(robot.grab()) for _ in range(3)] == [0, 1, 2]
    assert not list((share / "out").glob("*.request"))
    (share / "in" / "0002.done").touch()
    with pytest.raises(InputError, match="was there before move 2 was written"):
        robot.move(demo_cell.base_posture)


def test_a_black_camera_is_told_before_the_arm_moves(tmp_path, share, demo_cell):
    cell = tmp_path / "cell.toml"
    cell.write_text(cell_template())
    black = written(tmp_path / "black.avi", [np.zeros((48, 64), np.uint8)] * 3)
    with pytest.raises(InputError, match="gives pictures of 64 x 48, not 1280 x 1024"):
        run_by_sight(cell, tmp_path / "run", folder=share, camera=str(black))
    assert not (share / "out").exists()
    small = cell_template().replace("image_px = [1280, 1024]", "image_px = [64, 48]")
    cell.write_text(small.replace("border_px = 30.0", "border_px = 1.0"))
    with pytest.raises(InputError, match="gives black pictures"):
        run_by_sight(cell, tmp_path / "run", folder=share, camera=str(black))
    with pytest.raises(InputError, match="a simulated robot has its own camera"):
        run_by_sight(cell, tmp_path / "run", camera="0")
