"""Touch-ups from a running UR, told over a real socket to the real client."""

import json
import os
import shutil
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posedesign.cell import Cell, cell_template
from posedesign.cli.main import run
from posedesign.files.measurements import read_measurements
from posedesign.planning.poses_file import PoseList, write_pose_list
from posedesign.programs.ur_script import live, rtde_process
from tests.cli.conftest import below_comments
from tests.rtde_server import PAUSED, STOPPED, Raw, RtdeServer, Stage, package

pytest.importorskip("rtde_receive", reason="the extra ur is not installed")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="has one loopback address only")

PLANNED = np.array(
    [
        [-0.0612, -0.6407, 0.7939, -0.9512, -1.6002, 1.3478],
        [-0.5494, -1.0655, 1.6274, 0.6867, 0.8601, 0.0837],
        [0.1042, -1.2589, 2.2843, -3.2061, -2.0228, -0.8102],
    ]
)
NAMES = ("P02", "P03", "P01")
TOUCHED = PLANNED + np.array([[0.001], [0.002], [-0.001]])
END = Stage(state=STOPPED)


@pytest.fixture(scope="module")
def described(tmp_path_factory) -> Path:
    """A folder with the cell of a UR5e and its plan."""
    folder = tmp_path_factory.mktemp("ur")
    (folder / "cell.toml").write_text(cell_template("ur5e", surroundings=False))
    cell = Cell.load(folder / "cell.toml")
    listed = PoseList(NAMES, PLANNED, np.zeros(3, dtype=bool))
    write_pose_list(folder / "poses.csv", listed, cell.robot, cell.tool_m)
    return folder


@pytest.fixture
def ur(described, tmp_path) -> Path:
    """The same in a folder of its own."""
    return shutil.copytree(described, tmp_path / "ur")


@pytest.fixture
def record_in(cli, monkeypatch):
    monkeypatch.setattr(live, "AGAIN_S", 0.1)

    def recorded(folder: Path, server: RtdeServer, *words: object):
        files = (folder / "cell.toml", folder / "poses.csv")
        return cli("record", *files, server.host, "--out", folder, *words)

    return recorded


@pytest.fixture
def record(record_in, ur):
    return partial(record_in, ur)


@pytest.fixture
def at_once(described, tmp_path):
    """Check cases in a folder and a process each, all at once: they do little but wait."""

    def checked(check: Callable[[Any, Path], None], cases: Sequence[Any]) -> None:
        children = {}
        for i, case in enumerate(cases):
            folder = shutil.copytree(described, tmp_path / f"{i}")
            process = os.fork()
            if not process:
                try:
                    check(case, folder)
                except BaseException:
                    (folder / "failed").write_text(traceback.format_exc())
                finally:
                    os._exit(0)
            children[process] = folder
        for process, folder in children.items():
            os.waitpid(process, 0)
            assert not (folder / "failed").exists(), (folder / "failed").read_text()

    return checked


def told(number: int, q=None, **how) -> list[Stage]:
    """A pose that is told of as the scripts do, between half of the way there and the next one."""
    at = TOUCHED[number - 1] if q is None else q
    way = Stage(0, at, seconds=0.06)
    return [way, Stage(number, at, **{"seconds": 0.3, **how}), way]


def kept(folder: Path) -> dict[str, np.ndarray]:
    data = read_measurements(folder / "touchups.csv", 6).data
    return dict(zip(data.names, data.postures, strict=True))


def test_poses_arrive_one_after_the_other(record, ur):
    stages = [Stage(state=STOPPED), *told(2), *told(1), Stage(state=PAUSED), *told(3)]
    with RtdeServer(stages) as server:  # a paused program goes on
        said = record(server)
    assert said.code == 0, said
    assert list(kept(ur)) == ["P03", "P02", "P01"]
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(kept(ur)[name], TOUCHED[k], atol=1e-11)
    assert [line.split(",")[0] for line in said.out.splitlines()[:3]] == [
        f"{n}: touched up" for n in ("P03", "P02", "P01")
    ]
    assert "mm from the plan (3 of 3)" in said.out
    assert b"output_int_register_36" in server.asked[2]
    assert not [kind for kind in server.asked if kind[:1] in b"IU"]  # nothing is written


def test_the_same_number_again_changes_nothing(record, ur):
    stages = [*told(1), *told(1, TOUCHED[0] + 0.003), *told(2), END]
    with RtdeServer(stages) as server:
        said = record(server, "--json")
    assert said.code == 1
    answer = json.loads(said.out)
    assert answer["missing"] == ["P01"]
    assert answer["refused"] == ["P02 is there already: its row stays as it is"]
    np.testing.assert_allclose(kept(ur)["P02"], TOUCHED[0], atol=1e-11)


NO_TOUCH_UPS = [
    (told(1, speed=0.02), "pose 1 was told while J1 moved, at 1.15 deg/s"),
    (told(1, speed=0.009), "pose 1 was told while J1 moved, at 0.516 deg/s"),
    (told(1, seconds=0.02), "pose 1 was told for less than 0.1 s"),
    (told(1, PLANNED[0]), "P02 stands as planned: it was not touched up"),
    (told(1, TOUCHED[1]), "P02: stands nearer to P03"),
    (told(1, PLANNED[0] + [0, 0.3, 0, 0, 0, 0]), "P02: the tool point is"),
    (told(1, [6.31, *TOUCHED[0][1:]]), "P02: shoulder_pan_joint"),
    (told(9, TOUCHED[0]), "there is no pose 9 in the plan of 3"),
    (told(-1, TOUCHED[0]), "there is no pose -1"),
    (told(1, np.full(6, np.nan)), "pose 1 has joint values that no arm has"),
    (told(1, np.full(6, 1e300)), "pose 1 has joint values that no arm has"),
]


def test_what_is_no_touch_up_is_named_and_left_out(record, ur):
    stages = [stage for some, _ in NO_TOUCH_UPS for stage in some]
    with RtdeServer([Stage(1, TOUCHED[0]), *stages, *told(2), END]) as server:
        said = record(server)
    assert said.code == 1
    warned = [line.removeprefix("warning: not recorded: ") for line in said.err.splitlines()]
    assert warned[0] == "pose 1 was told before the connection"
    for line, (_, why) in zip(warned[1:-1], NO_TOUCH_UPS, strict=True):
        assert line.startswith(why)
    assert warned[-1] == "warning: the program has ended without P02, P01"
    assert list(kept(ur)) == ["P03"]


def test_a_lost_connection_is_made_again(record, ur):
    """A number that stands there when it is back may be of before."""
    after = [Stage(2, TOUCHED[1]), *told(3), *told(2), *told(1)]
    with RtdeServer([*told(1), Raw(), Raw(), *after]) as server:
        said = record(server)
    assert said.code == 0, said
    assert server.clients == 3
    assert said.err.count("trying again") == 1
    assert f"{server.host}:30004: the connection was closed; trying again" in said.err
    assert "pose 2 was told before the connection" in said.err
    assert list(kept(ur)) == ["P02", "P01", "P03"]


def test_a_row_is_kept_by_the_next_start_as_it_is(record, ur):
    with RtdeServer([*told(1), END]) as server:
        assert record(server).code == 1
    before = (ur / "touchups.csv").read_text().splitlines()[1:]
    with RtdeServer([*told(2), *told(1, TOUCHED[0] + 1e-3), *told(3)]) as server:
        said = record(server)
    assert said.code == 0
    assert "goes on, 2 of 3 poses are missing" in said.err
    assert (ur / "touchups.csv").read_text().splitlines()[1 : 1 + len(before)] == before
    with RtdeServer([]) as server:
        assert record(server).code == 0
        assert server.clients == 0


def test_a_row_that_a_person_took_out_is_measured_again(record, ur):
    with RtdeServer([*told(1), *told(2), *told(3)]) as server:
        assert record(server).code == 0
    path = ur / "touchups.csv"
    lines = [line for line in path.read_text().splitlines() if not line.endswith("P03")]
    path.write_text("\n".join([lines[0], f"{lines[1]},remark", *[f"{x},+1" for x in lines[2:]]]))
    with RtdeServer(told(2)) as server:
        said = record(server)
        assert said.code == 2
        assert "was changed since it was written" in said.err
        said = record(server, "--overwrite")
    assert said.code == 0
    assert list(kept(ur)) == ["P02", "P01", "P03"]
    rows = below_comments(path.read_text()).splitlines()
    assert [line.split(",")[-1] for line in rows[1:]] == ["+1", "+1", ""]
    assert (ur / "touchups.csv.1").exists()
    # nobody takes them for recorded ones: the command says it, the file says it, now and later
    by_hand = "changed by hand: the file of these rows was, and they are as they stood: P02, P01"
    assert f"warning: {path}: {by_hand}" in said.err
    assert f"# {by_hand}\n" in path.read_text()
    with RtdeServer([]) as server:
        assert by_hand in record(server).err


def test_measurements_of_others_are_left_alone(record, ur):
    (ur / "touchups.csv").write_text("target,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n")
    with RtdeServer([]) as server:
        said = record(server)
        assert (said.code, server.clients) == (2, 0)
    assert "does not say where it is from" in said.err


def test_a_kill_loses_nothing(record, ur):
    """In the middle of a program, without warning."""
    words = ["record", ur / "cell.toml", ur / "poses.csv"]
    with RtdeServer([*told(1), *told(2), Raw(None)]) as server:
        process = os.fork()
        if not process:
            run([*map(str, words), server.host, "--out", str(ur)])
            os._exit(0)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if (ur / "touchups.csv").exists() and "P03" in kept(ur):
                break
            time.sleep(0.05)
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
    assert list(kept(ur)) == ["P02", "P03"]
    with RtdeServer(told(3)) as server:
        assert record(server).code == 0
    assert sorted(kept(ur)) == ["P01", "P02", "P03"]


@pytest.fixture
def process_of(monkeypatch, tmp_path_factory):
    """Have the process that talks to the controller be another in one place of its text."""

    def changed(old: str, new: str) -> None:
        source = Path(rtde_process.__file__).read_text()
        path = tmp_path_factory.mktemp("process") / "changed.py"
        path.write_text(source.replace(old, new))
        assert path.read_text() != source
        monkeypatch.setattr(rtde_process, "__file__", str(path))

    return changed


@pytest.fixture
def impatient(process_of) -> None:
    """The process waits for some seconds only: on a busy machine it is there in one or two."""
    process_of("CONNECT_S, SILENT_S = 15.0, 5.0", "CONNECT_S, SILENT_S = 4, 1")


def test_a_slow_start_is_no_time_without_a_pose(record, ur, process_of):
    process_of("CONNECT_S, SILENT_S =", "time.sleep(1.5)\nCONNECT_S, SILENT_S =")
    with RtdeServer([*told(1), *told(2), *told(3)]) as server:
        said = record(server, "--timeout-s", "1")
    assert said.code == 0, said
    assert list(kept(ur)) == ["P02", "P03", "P01"]


@pytest.mark.usefixtures("impatient")
def test_silence_of_the_controller_is_one_line(record_in, at_once):
    def is_one_line(request: str, folder: Path) -> None:
        with RtdeServer([], {request: None}) as server:
            said = record_in(folder, server)
        assert said.code == 2
        (line,) = [line for line in said.err.splitlines() if line.startswith("error")]
        assert line.startswith(f"error: {server.host}:30004: nothing comes (is it the controller's")
        assert not (folder / "touchups.csv").exists()

    at_once(is_one_line, "VS")


@pytest.mark.usefixtures("impatient")
def test_silence_in_the_middle_keeps_what_was_told(record, ur):
    with RtdeServer([*told(1), Raw(None)]) as server:
        said = record(server, "--timeout-s", "2")
    assert said.code == 2
    assert f"{server.host}:30004: nothing comes" in said.err
    assert list(kept(ur)) == ["P02"]


def test_nothing_told_in_time_is_one_line(record, ur):
    with RtdeServer([Stage(seconds=20)]) as server:
        said = record(server, "--timeout-s", "1", "--register", "12")
    assert said.code == 2
    assert "no pose was told in output integer register 12 for 1 s (does the program" in said.err


def test_nobody_there(cli, ur):
    said = cli("record", ur / "cell.toml", ur / "poses.csv", "127.0.54.1", "--out", ur)
    assert said.code == 2
    assert "error: 127.0.54.1:30004: Error: Could not connect" in said.err


BAD_ANSWERS = [{"O": b"\1" + b"NOT_FOUND," * 5}, {"O": b""}, {"v": b""}, {"S": b""}]


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("answers", BAD_ANSWERS)
def test_a_bad_greeting_is_one_line_or_does_no_harm(answers, record, ur):
    with RtdeServer([*told(1), END], answers) as server:
        said = record(server, "--timeout-s", "2")
    assert "Traceback" not in said.err
    assert said.code in (1, 2)
    if said.code == 2:
        assert said.err.splitlines()[-1].startswith(f"error: {server.host}:30004: ")
        assert not (ur / "touchups.csv").exists()


HOSTILE = [
    struct.pack(">HB", 0, ord("U")) + b"x" * 70_000,
    package("U", b"\1"),
    package("M", b"\xff"),
    package("U", b"\1" + b"\xff" * 60_000),
    b"HTTP/1.1 400 Bad Request\r\n\r\n",
]


@pytest.mark.usefixtures("impatient")
def test_hostile_packages_write_no_row(record_in, at_once):
    """Whatever ur_rtde makes of them: it may lose the line, or read a state in which nothing
    runs, depending on how the bytes fall into its reads; no row is written for it either way."""

    def writes_no_row(data: bytes, folder: Path) -> None:
        with RtdeServer([*told(1), *[Raw(data)] * 5, Stage(state=PAUSED), Raw(None)]) as server:
            said = record_in(folder, server, "--timeout-s", "2")
        assert "Traceback" not in said.err
        if said.code == 1:
            assert "the program has ended without P03, P01" in said.err, said
        else:
            assert said.code == 2, said
            (line,) = [line for line in said.err.splitlines() if line.startswith("error")]
            assert f"{server.host}:30004: " in line
        np.testing.assert_allclose(kept(folder).pop("P02"), TOUCHED[0], atol=1e-11)
        assert list(kept(folder)) == ["P02"]

    at_once(writes_no_row, HOSTILE)


def test_a_program_that_counts_without_end_is_left(record, ur, monkeypatch):
    monkeypatch.setattr("posedesign.cli.program_commands.MOST_REFUSED", 20)
    with RtdeServer([Stage(k, TOUCHED[0], seconds=0.012) for k in range(400)]) as server:
        said = record(server)
    assert said.code == 2
    assert said.err.count("warning: not recorded") == 21


def test_without_the_extra_it_says_what_to_install(refuse, ur, monkeypatch):
    monkeypatch.setattr(live.importlib.util, "find_spec", lambda name: None)
    said = refuse("record", ur / "cell.toml", ur / "poses.csv", "127.0.0.1", "--out", ur)
    assert "pip install posedesign[ur]" in said


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--register", "24"), "ur_rtde does not read output integer register 24"),
        (("--timeout-s", "nan"), "timeout_s"),
    ],
)
def test_options_out_of_range(words, why, refuse, ur):
    files = (ur / "cell.toml", ur / "poses.csv")
    assert why in refuse("record", *files, "127.0.0.1", "--out", ur, *words)


def test_robots_of_others_are_refused(refuse, work):
    said = refuse("record", work / "cell.toml", work / "poses.csv", "127.0.0.1", "--out", work)
    assert "the robot's controller is one of fanuc, not of ur" in said
