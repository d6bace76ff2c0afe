"""Runs the tasks of a grid: on this machine's cores, or on a cluster, and goes on after a stop."""

from __future__ import annotations

import itertools
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import CalibError, ConvergenceError, InputError
from posedesign.study.store import Columns, Store

MOST_TASKS = 100_000
"""Of a study: the results of each are a file until all are done."""


@dataclass(frozen=True)
class Task:
    """Some trials of one condition: what a worker does at once."""

    number: int  # counted from 0 over the whole grid
    condition: Mapping[str, Any]  # plain values that can be sent to another machine
    first: int
    trials: int  # first, trials: the trials of the condition that it does
    seed: int  # of the study

    def rng(self) -> np.random.Generator:
        """Random numbers of the task's own: the same on any worker, in any order."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(self.number,))
        return np.random.default_rng(sequence)


@dataclass(frozen=True)
class Grid:
    """All conditions, each with as many trials.

    Raises InputError: nothing to do.
    """

    conditions: Sequence[Mapping[str, Any]]
    trials: int
    batch: int
    """Trials of a task: enough for arrays to pay, and small enough for a task to be lost. It
    decides which random numbers a trial gets, so it is a number of the study and does not depend on
    how many workers there are."""
    seed: int

    def __post_init__(self) -> None:
        for name in ("trials", "batch"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"{getattr(self, name)} {name}", hint="give one or more", name=name
                )
        if self.conditions and len(self) > MOST_TASKS:
            raise InputError(
                f"{self.trials} trials are {len(self)} tasks, each with a file of its own",
                hint=f"give fewer: at most {MOST_TASKS} tasks",
                name="trials",
                value=self.trials,
                bound=MOST_TASKS,
            )
        if not self.conditions:
            raise InputError("the study has no conditions", name="conditions")

    def __len__(self) -> int:
        """Number of tasks."""
        return len(self.conditions) * -(-self.trials // self.batch)

    def tasks(self) -> list[Task]:
        """The tasks, condition by condition."""
        starts = range(0, self.trials, self.batch)
        return [
            Task(
                c * len(starts) + k,
                condition,
                first,
                min(self.batch, self.trials - first),
                self.seed,
            )
            for c, condition in enumerate(self.conditions)
            for k, first in enumerate(starts)
        ]


Simulate = Callable[[Task], Columns]
"""What is repeated: the results of a task, by columns. It is sent to workers, so it is a function
of a module that they can import, or a partial of one."""

Advance = Callable[[int, int], None]
"""Called with how many tasks are done, and how many there are."""

_AHEAD = 2
"""Tasks a worker that are handed out before their results are taken: no worker waits, and what
is in memory does not grow with the study."""

MOST_JOBS = 1024
"""Processes on one machine; each takes a hundred megabytes, and all are started at once."""

_CONNECT_S = 5
"""A scheduler that is there answers in a fraction of it."""

_PATIENCE_S = 60.0
"""A nanny starts a worker again in some seconds; a busy scheduler answers in a few."""

_LOOK_S = 5.0
"""Between two looks at whether there are workers."""

_WATCH_S = 1.0
"""Between two looks of a worker at whether the process is there that it works for."""

_TRIES = 3
"""Times that worker processes may be killed: a task that kills them does it again."""


@dataclass(frozen=True)
class Workers:
    """Who does the work."""

    jobs: int = 1  # processes on this machine
    scheduler: str | None = None
    """Address of a Dask scheduler, such as ``tcp://host:8786``; then its workers do it."""

    def __post_init__(self) -> None:
        if not 1 <= self.jobs <= MOST_JOBS:
            raise InputError(
                f"{self.jobs} jobs",
                hint=f"give from 1 to {MOST_JOBS}, as many as there are cores",
                name="jobs",
                value=self.jobs,
                bound=(1, MOST_JOBS),
            )


def run_grid(
    simulate: Simulate,
    grid: Grid,
    store: Store,
    workers: Workers | None = None,
    *,
    restart: bool = False,
    advance: Advance = lambda done, total: None,
) -> Path:
    """Run what is not done yet, and return the table of all.

    The same table on any workers, to the last bit: random numbers belong to tasks.

    ``workers``: one process by default: this one. ``restart``: begin anew. ``advance``: called as
    tasks are done. Raises InputError: the folder is in use, or the scheduler cannot be reached.
    ConvergenceError: workers died again and again, with the task that did it; what was done is
    kept. CalibError: the scheduler went or lost its workers; or what ``simulate`` raises.
    """
    workers = workers or Workers()
    with store.open(restart=restart):
        before = store.done()
        tasks = [task for task in grid.tasks() if task.number not in before]
        total = len(grid)
        advance(total - len(tasks), total)
        for done, (number, columns) in enumerate(_results(simulate, tasks, workers), start=1):
            store.write(number, columns)
            advance(total - len(tasks) + done, total)
        return store.assemble(total)


def each(
    simulate: Callable[[Task], Any], conditions: Sequence[Mapping[str, Any]], workers: Workers
) -> list[Any]:
    """What one task a condition gives, in their order: for what comes before a grid.

    It stores nothing, and the grid finds the workers started. Raises what :func:`run_grid` does.
    """
    found = dict(_results(simulate, Grid(conditions, 1, 1, 0).tasks(), workers))
    return [found[number] for number in sorted(found)]


def _results(
    simulate: Simulate, tasks: Sequence[Task], workers: Workers
) -> Iterator[tuple[int, Columns]]:
    """Numbers and results of tasks as they come."""
    if not tasks:
        return
    if workers.scheduler is not None:
        yield from _of_cluster(simulate, tasks, workers.scheduler)
    elif min(workers.jobs, len(tasks)) == 1:
        for task in tasks:
            yield _numbered(simulate, task)
    else:
        yield from _of_processes(simulate, tasks, min(workers.jobs, len(tasks)))


def _numbered(simulate: Simulate, task: Task) -> tuple[int, Columns]:
    return task.number, simulate(task)


def _of_processes(
    simulate: Simulate, tasks: Sequence[Task], count: int
) -> Iterator[tuple[int, Columns]]:
    """Results of ``count`` processes of this machine; new ones where some were killed.

    A killed process takes the results along that were not read yet. After the first one the tasks
    are therefore handed out in rounds of ``count``, each read before the next begins.
    """
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    left = {task.number: task for task in tasks}
    suspects = set(left)
    size = len(tasks)
    for _ in range(_TRIES):
        handed_out: list[int] = []

        def calls(some: Sequence[Task], handed_out: list[int] = handed_out) -> Iterator[Any]:
            handed_out.clear()
            for task in some:
                handed_out.append(task.number)
                yield joblib.delayed(_numbered)(simulate, task)

        # matrices are small: one thread a worker
        with joblib.parallel_config(
            backend="loky",
            inner_max_num_threads=1,
            initializer=_end_with_parent,
            initargs=(os.getpid(),),
        ):
            parallel = joblib.Parallel(
                n_jobs=count,
                return_as="generator_unordered",
                pre_dispatch=_AHEAD * count,
                batch_size=1,
            )
            waiting = list(left.values())
            try:
                for first in range(0, len(waiting), size):
                    for number, columns in parallel(calls(waiting[first : first + size])):
                        del left[number]
                        yield number, columns
                return
            except TerminatedWorkerError:
                suspects &= left.keys() & handed_out
                size = count
    raise _killed(f"worker processes were killed {_TRIES} times", sorted(suspects))


def _killed(what: str, numbers: Sequence[int]) -> ConvergenceError:
    at = f" at task {' or '.join(map(str, numbers))}" if numbers else ""
    return ConvergenceError(
        f"{what}{at}, for want of memory perhaps; what was done is kept",
        hint="start the same command again with fewer workers, or give them more memory",
    )


def _end_with_parent(parent: int) -> None:
    """Have this worker end when the process has that it works for, were it killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _of_cluster(
    simulate: Simulate, tasks: Sequence[Task], address: str
) -> Iterator[tuple[int, Columns]]:
    """Results of the workers of a Dask scheduler, which gives a task to another one if one dies."""
    with _client(address) as client:
        from distributed import KilledWorker

        ahead = _AHEAD * sum(client.nthreads().values())
        waiting = iter(tasks)
        in_hand: dict[Any, Task] = {}
        while True:
            for task in itertools.islice(waiting, ahead - len(in_hand)):
                in_hand[client.submit(_numbered, simulate, task, pure=False)] = task
            if not in_hand:
                return
            with _reached(address):
                _wait(client, address, list(in_hand))
                done = [future for future in in_hand if future.done()]
                errors = [(future.exception(_PATIENCE_S), in_hand[future]) for future in done]
            for error, task in errors:
                if isinstance(error, KilledWorker):
                    raise _killed("workers were killed again and again", [task.number]) from error
                if error is not None:
                    raise error
            for future in done:
                with _reached(address):
                    try:
                        found = future.result(_PATIENCE_S)
                    except TimeoutError:
                        # the worker that held it is gone, and it is computed again; or the
                        # scheduler is, which this call says
                        _workers(client)
                        continue
                del in_hand[future]
                yield found


def _wait(client: Any, address: str, futures: list[Any]) -> None:
    """Wait until one of the futures is done, for as long as there are workers."""
    from distributed import wait

    seen = time.monotonic()
    while True:
        with suppress(TimeoutError):
            wait(futures, timeout=_LOOK_S, return_when="FIRST_COMPLETED")
            return
        if _workers(client):
            seen = time.monotonic()
        elif time.monotonic() - seen > _PATIENCE_S:
            raise CalibError(
                f"the scheduler at {address} has had no workers for {_PATIENCE_S:g} s; what was "
                "done is kept",
                hint="start some with: dask worker ADDRESS, then the same command again",
            )


def _workers(client: Any) -> dict[str, int]:
    """Ask the scheduler for its workers and their threads."""
    found: dict[str, int] = client.sync(client.scheduler.ncores, callback_timeout=_PATIENCE_S)
    return found


@contextmanager
def _reached(address: str) -> Iterator[None]:
    """Say in one line that a scheduler is gone."""
    from distributed import CancelledError

    try:
        yield
    except (CancelledError, OSError) as error:  # TimeoutError, too
        raise CalibError(
            f"the scheduler at {address} does not answer any more; what was done is kept",
            hint="start it again, then the same command",
        ) from error


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "a scheduler needs Dask, which is not installed",
            hint='pip install -e ".[cluster]"',
            name="scheduler",
        ) from error
    # a scheduler that goes is told by an error, and not by a traceback in a log besides
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"there is no Dask scheduler at {address}",
            hint="start one with: dask scheduler, and workers with: dask worker ADDRESS",
            name="scheduler",
            value=address,
        ) from error
    with client:
        if not client.nthreads():
            raise CalibError(
                f"the scheduler at {address} has no workers",
                hint="start some with: dask worker ADDRESS",
            )
        yield client
