"""Studies at scale: the same on any workers, and nothing lost or done twice after a kill."""

import contextlib
import errno
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from calib.errors import CalibError, ConvergenceError, FileFormatError, InputError, OutputError
from posedesign.study import Grid, Store, Workers, each, read_table, run_grid, runner
from posedesign.study import store as store_module
from tests.marks import rest_in_full

SCRIPT = Path(__file__).with_name("repeated.py")


@pytest.fixture(scope="module")
def repeated() -> Iterator[ModuleType]:
    """The study as a module that workers can import by its name."""
    spec = importlib.util.spec_from_file_location("repeated", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["repeated"] = module
    sys.path.insert(0, str(SCRIPT.parent))  # as loky's workers are told
    before = os.environ.get("PYTHONPATH", "")  # as those of a cluster are
    os.environ["PYTHONPATH"] = f"{SCRIPT.parent}{os.pathsep}{before}"
    spec.loader.exec_module(module)
    yield module
    os.environ["PYTHONPATH"] = before
    sys.path.remove(str(SCRIPT.parent))
    del sys.modules["repeated"]


@pytest.fixture(params=[".csv", ".parquet"])
def ending(request, monkeypatch) -> str:
    """Both forms of tables."""
    if request.param == ".parquet":
        pytest.importorskip("pyarrow", reason="Parquet needs pyarrow (posedesign[parquet])")
    monkeypatch.setattr(store_module, "has_parquet", lambda: request.param == ".parquet")
    return str(request.param)


def store_in(folder: Path, repeated: ModuleType) -> Store:
    return Store(folder, "trials", repeated.about())


def test_every_trial_is_there_once(repeated, tmp_path, ending):
    table = run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated))
    assert table.suffix == ending
    frame = read_table(table)
    assert len(frame) == 120
    for _, part in frame.groupby("scale"):
        assert part["trial"].tolist() == list(range(40))
    assert not (tmp_path / "parts").exists()


def test_seeds_belong_to_tasks():
    """Tasks draw what a sequence of their own number gives, however many others there are."""
    small, large = Grid([{}], 10, 5, 3).tasks(), Grid([{}, {}], 1000, 5, 3).tasks()
    for a, b in zip(small, large, strict=False):
        np.testing.assert_array_equal(a.rng().random(4), b.rng().random(4))
    draws = {float(task.rng().random()) for task in large}
    assert len(draws) == len(large)
    assert sum(task.trials for task in large) == 2000


@pytest.mark.parametrize("jobs", [2, pytest.param(8, marks=pytest.mark.slow)])
def test_the_same_on_any_number_of_workers(repeated, tmp_path, jobs):
    tables = [
        run_grid(
            repeated.simulate, repeated.grid(), store_in(tmp_path / str(n), repeated), Workers(n)
        )
        for n in (1, jobs)
    ]
    assert tables[0].read_bytes() == tables[1].read_bytes()


def test_what_comes_before_a_grid_is_in_the_order_of_its_conditions(repeated):
    conditions = repeated.grid().conditions
    alone, shared = (each(repeated.simulate, conditions, Workers(jobs)) for jobs in (1, 2))
    assert [columns["scale"][0] for columns in shared] == [c["scale"] for c in conditions]
    assert str(alone) == str(shared)


def test_going_on_does_only_what_is_left(repeated, tmp_path, ending):
    done: list[int] = []

    def noted(task: object) -> object:
        done.append(task.number)
        if len(done) == 10:
            raise KeyboardInterrupt
        return repeated.simulate(task)

    with pytest.raises(KeyboardInterrupt):
        run_grid(noted, repeated.grid(), store_in(tmp_path / "a", repeated))
    assert len(list((tmp_path / "a" / "parts").iterdir())) == 9
    seen: list[tuple[int, int]] = []
    table = run_grid(
        noted,
        repeated.grid(),
        store_in(tmp_path / "a", repeated),
        advance=lambda k, n: seen.append((k, n)),
    )
    assert sorted(done) == sorted([*range(24), 9])
    assert seen[0] == (9, 24)
    assert seen[-1] == (24, 24)
    whole = run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path / "b", repeated))
    assert table.read_bytes() == whole.read_bytes()
    run_grid(noted, repeated.grid(), store_in(tmp_path / "a", repeated))
    assert len(done) == 25


def kill_and_go_on(
    out: Path, moments: list[float], jobs: int, tasks: Sequence[int] = ()
) -> Counter[int]:
    """Run a study as a process that is killed again and again; how often each task was done.

    At moments [s], then when so many tasks have been done in all.
    """
    diary = out.with_name(f"{out.name}.diary")
    diary.mkdir()
    environment = os.environ | {"STUDY_DIARY": str(diary)}
    command = [sys.executable, str(SCRIPT), str(out), str(jobs)]
    for moment, count in [*((moment, 0) for moment in moments), *((0.0, n) for n in tasks)]:
        process = subprocess.Popen(command, env=environment, start_new_session=True)
        with suppress(subprocess.TimeoutExpired):
            process.wait(moment)
        while process.poll() is None and len(os.listdir(diary)) < count:
            time.sleep(0.002)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # its workers, too: the machine goes down
            process.wait()
    subprocess.run(command, env=environment, check=True)
    return Counter(int(path.name.partition(".")[0]) for path in diary.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("count", rest_in_full((6, 20), (6,)))
def test_killed_at_any_moment(repeated, tmp_path, count):
    """The same file; what was written was not done again, what was in hand once more at most."""
    whole = run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path / "whole", repeated))
    start = time.monotonic()
    times = kill_and_go_on(tmp_path / "once", [], 1)
    took = time.monotonic() - start
    assert set(times.values()) == {1}
    rng = np.random.default_rng(1)
    moments = rng.uniform(0.5 * took, took, count).tolist()
    for k, moment in enumerate(moments):
        out = tmp_path / f"killed{k}"
        times = kill_and_go_on(out, [moment], 1)
        assert (out / whole.name).read_bytes() == whole.read_bytes()
        assert sorted(times) == list(range(24))
        assert sum(times.values()) <= 25  # one task was in hand


@pytest.mark.slow
def test_killed_again_and_again_with_two_workers(repeated, tmp_path):
    whole = run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path / "whole", repeated))
    # by what was done, not by the clock: a run that has ended would begin anew
    times = kill_and_go_on(tmp_path / "out", [], 2, tasks=[3, 7, 11, 15])
    assert (tmp_path / "out" / whole.name).read_bytes() == whole.read_bytes()
    assert sorted(times) == list(range(24))
    # handed out ahead and lost with the workers: two a worker and those in hand, each time
    assert sum(times.values()) <= 24 + 4 * 6


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("name", ["parts", "trials.csv", "trials.parquet"])
def test_files_of_others_are_left_alone(repeated, tmp_path, name, restart):
    """A folder that somebody keeps something else in, under the same names."""
    mine = tmp_path / name
    if name == "parts":
        mine.mkdir()
        mine = mine / "bolts.txt"
    mine.write_text("mine")
    with pytest.raises(FileFormatError, match=r"no about\.json that says what of"):
        run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated), restart=restart)
    assert mine.read_text() == "mine"


def test_what_is_no_part_is_not_counted(repeated, tmp_path, ending):
    store = store_in(tmp_path, repeated)
    with store.open():
        store.write(3, {"a": [1]})
        for name in ("notes", "0000000004", "00000005x"):
            (tmp_path / "parts" / f"{name}{ending}").touch()
        (tmp_path / "parts" / "000000006.txt").touch()
        assert store.done() == {3}


@pytest.mark.parametrize("text", ["", "{", "[" * 200_000, "\x00", "[]"])
def test_a_damaged_note_of_what_it_is_about(repeated, tmp_path, text):
    (tmp_path / "about.json").write_text(text)
    with pytest.raises(FileFormatError, match="another study"):
        run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated))


def test_damaged_results_are_told(repeated, tmp_path, ending):
    store = store_in(tmp_path, repeated)
    with store.open():
        for number in range(24):
            store.write(number, {"a": [number]})
    if ending == ".parquet":
        (tmp_path / "parts" / f"000000001{ending}").write_bytes(b"PAR1")
        with pytest.raises(FileFormatError, match="cannot be read") as caught:
            run_grid(repeated.simulate, repeated.grid(), store)
        assert "`restart`" in caught.value.hint
    table = run_grid(repeated.simulate, repeated.grid(), store, restart=True)
    table.write_bytes(b"")
    with pytest.raises(FileFormatError, match="cannot be read"):
        store.read()
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_table(tmp_path / f"none{ending}")


def test_two_in_one_folder(repeated, tmp_path):
    pytest.importorskip("fcntl", reason="files are not locked on this system")
    with store_in(tmp_path, repeated).open():
        code = (
            "from pathlib import Path; import sys; from posedesign.study.store import Store;"
            "from calib.errors import InputError\n"
            "try:\n    Store(Path(sys.argv[1]), 'trials', {}).open().__enter__()\n"
            "except InputError as error:\n    print(error)"
        )
        said = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True
        )
    assert f"process {os.getpid()} is running a study here" in said.stdout


def test_other_numbers_in_one_folder(repeated, tmp_path):
    run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated))
    other = Store(tmp_path, "trials", {**repeated.about(), "trials": 41})
    with pytest.raises(FileFormatError, match="other numbers: trials was 40, and is 41 now"):
        run_grid(repeated.simulate, repeated.grid(), other)
    run_grid(repeated.simulate, repeated.grid(), other, restart=True)
    assert (tmp_path / "about.json").read_text().count("41") == 1


@pytest.mark.parametrize("when", ["part", "table"])
def test_a_full_disk(repeated, tmp_path, monkeypatch, when, ending):
    """One line, and what was written before is there for going on."""
    full = OSError(errno.ENOSPC, "No space left on device")

    def fails(*_: object) -> None:
        raise full

    if when == "part":
        write, count = os.fsync, [0]

        def late(descriptor: int) -> None:
            count[0] += 1
            if count[0] > 5:
                raise full
            write(descriptor)

        monkeypatch.setattr(os, "fsync", late)
    else:
        monkeypatch.setattr(store_module, "_join", fails)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated))
    assert "\n" not in str(caught.value)
    monkeypatch.undo()
    monkeypatch.setattr(store_module, "has_parquet", lambda: ending == ".parquet")
    kept = len(list((tmp_path / "parts").glob(f"0*{ending}")))
    assert kept == (4 if when == "part" else 24)
    assert not list(tmp_path.rglob("*.tmp"))
    frame = read_table(run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated)))
    assert len(frame) == 120


@pytest.mark.parametrize("bad", [{"trials": 0}, {"batch": 0}, {"conditions": []}])
def test_grids_of_nothing(bad):
    with pytest.raises(InputError):
        Grid(**{"conditions": [{}], "trials": 1, "batch": 1, "seed": 0, **bad})


@pytest.mark.parametrize("jobs", [0, -1, 1_000_000])
def test_numbers_of_workers_that_cannot_be(jobs):
    with pytest.raises(InputError, match="jobs"):
        Workers(jobs)


def test_errors_of_a_task_come_out(repeated, tmp_path):
    def refuses(task: object) -> object:
        raise InputError("no such arm", hint="choose another")

    with pytest.raises(InputError, match="no such arm"):
        run_grid(refuses, repeated.grid(), store_in(tmp_path, repeated))


def test_no_scheduler_there(repeated, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs Dask (posedesign[cluster])")
    monkeypatch.setattr(runner, "_CONNECT_S", 0.2)
    workers = Workers(1, "tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="no Dask scheduler at tcp:"):
        run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path, repeated), workers)


@pytest.mark.slow
def test_a_task_that_kills_its_worker_is_named(repeated, tmp_path):
    store = store_in(tmp_path, repeated)
    with pytest.raises(ConvergenceError, match=r"killed 3 times at task .*\b7\b.* is kept"):
        run_grid(repeated.simulate_deadly, repeated.grid(), store, Workers(2))
    with store.open():
        assert store.done() >= set(range(6))  # the neighbour of the seventh may be lost with it


@pytest.mark.slow
def test_results_that_a_killed_worker_takes_along_are_worked_out_again(
    repeated, tmp_path, monkeypatch
):
    """However slowly the results are written."""
    store = store_in(tmp_path, repeated)
    write = Store.write

    def slow(*given: object) -> None:
        time.sleep(0.3)
        write(*given)

    monkeypatch.setattr(Store, "write", slow)
    with pytest.raises(ConvergenceError, match=r"at task (6 or )?7(,| or 8)"):
        run_grid(repeated.simulate_deadly, repeated.grid(), store, Workers(2))
    with store.open():
        assert store.done() >= set(range(6))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes as Linux has")
def test_workers_end_soon_after_the_run_they_work_for_was_killed(tmp_path):
    """Even in the middle of a task of ten minutes."""
    environment = os.environ | {"STUDY_DIARY": str(tmp_path)}
    command = [sys.executable, str(SCRIPT), str(tmp_path / "out"), "2", "slow"]
    process = subprocess.Popen(command, env=environment)
    workers: list[int] = []
    deadline = time.monotonic() + 60.0
    while len(workers) < 2 and time.monotonic() < deadline:
        time.sleep(0.2)
        workers = [w for w in children_of(process.pid) if b"LokyProcess" in words_of(w)]
    time.sleep(1.0)
    process.kill()
    process.wait()
    assert len(workers) == 2
    deadline = time.monotonic() + 20.0
    while any(map(words_of, workers)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not any(map(words_of, workers))


def children_of(pid: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(stat.read_text().rpartition(")")[2].split()[1]) == pid:
                found.append(int(stat.parent.name))
    return found


def words_of(pid: int) -> bytes:
    """The command line of a process; empty once it has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


@dataclass
class Cluster:
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@contextmanager
def cluster(folder: Path, count: int, *options: str) -> Iterator[Cluster]:
    """A scheduler and workers as their documentation starts them."""
    pytest.importorskip("distributed", reason="needs Dask (posedesign[cluster])")
    bin_ = Path(sys.executable).with_name("dask")
    address = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen(
        [bin_, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", address], **quiet
    )
    start = [bin_, "worker", "--scheduler-file", address, "--nthreads", "1", "--no-dashboard"]
    workers = [subprocess.Popen([*start, *options], **quiet) for _ in range(count)]
    try:
        deadline = time.monotonic() + 60.0
        while not address.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        where = json.loads(address.read_text())["address"]
        from distributed import Client

        with Client(where) as client:
            client.wait_for_workers(count, timeout=60)
        yield Cluster(where, scheduler, workers)
    finally:
        for process in workers:  # a nanny ends its worker when it is asked to end
            process.terminate()
        for process in workers:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_whose_worker_is_killed(repeated, tmp_path):
    whole = run_grid(repeated.simulate, repeated.grid(), store_in(tmp_path / "whole", repeated))
    slow = Grid([{**c, "seconds": 0.15} for c in repeated.CONDITIONS], 40, 5, 3)
    killed = []
    with cluster(tmp_path, 2, "--no-nanny") as there:

        def advance(done: int, total: int) -> None:
            if done == 5 and not killed:
                there.workers[0].kill()
                killed.append(done)

        table = run_grid(
            repeated.simulate,
            slow,
            store_in(tmp_path / "cluster", repeated),
            Workers(1, there.address),
            advance=advance,
        )
    assert killed
    assert table.read_bytes() == whole.read_bytes()


@pytest.mark.slow
def test_a_task_that_kills_the_workers_of_a_cluster(repeated, tmp_path):
    store = store_in(tmp_path / "out", repeated)
    with (
        cluster(tmp_path, 1) as there,
        pytest.raises(ConvergenceError, match=r"killed again and again at task 7, .* is kept"),
    ):
        run_grid(repeated.simulate_deadly, repeated.grid(), store, Workers(1, there.address))


@pytest.mark.slow
def test_a_cluster_that_loses_all_workers(repeated, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "_PATIENCE_S", 3.0)
    monkeypatch.setattr(runner, "_LOOK_S", 1.0)
    store = store_in(tmp_path / "out", repeated)
    with (
        cluster(tmp_path, 1, "--no-nanny") as there,
        pytest.raises(CalibError, match="has had no workers for 3 s; what was done is kept"),
    ):
        run_grid(repeated.simulate_deadly, repeated.grid(), store, Workers(1, there.address))


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_goes(repeated, tmp_path, monkeypatch, how):
    monkeypatch.setattr(runner, "_PATIENCE_S", 3.0)
    monkeypatch.setattr(runner, "_LOOK_S", 1.0)
    slow = Grid([{**c, "seconds": 0.3} for c in repeated.CONDITIONS], 40, 5, 3)
    store = store_in(tmp_path / "out", repeated)
    with cluster(tmp_path, 1) as there:

        def advance(done: int, total: int) -> None:
            if done == 5:
                there.scheduler.send_signal(how)

        with pytest.raises(CalibError, match="does not answer any more; what was done is kept"):
            run_grid(repeated.simulate, slow, store, Workers(1, there.address), advance=advance)
    with store.open():
        assert store.done() >= set(range(5))
