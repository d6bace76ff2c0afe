"""Runs the tasks of a grid: on this machine's cores, or on a cluster, and goes on after a stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import CalibError, ConvergenceError, InputError
from posedesign.study.grid import Grid, Task
from posedesign.study.store import Columns, Store

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


@dataclass(frozen=True)
class Workers:
    """Who does the work.

    Attributes
    ----------
    jobs : int
        Processes on this machine.
    scheduler : str, optional
        Address of a Dask scheduler, such as ``tcp://host:8786``; then its workers do it.
    """

    jobs: int = 1
    scheduler: str | None = None

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

    Parameters
    ----------
    simulate : callable
    grid : Grid
    store : Store
    workers : Workers, optional
        One process by default: this one.
    restart : bool
        Begin anew.
    advance : callable
        Called as tasks are done.

    Raises
    ------
    InputError
        The folder is in use, or the scheduler cannot be reached.
    ConvergenceError
        A worker died; what was done is kept.
    CalibError
        What ``simulate`` raises.
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


def _results(
    simulate: Simulate, tasks: Sequence[Task], workers: Workers
) -> Iterator[tuple[int, Columns]]:
    """Numbers and results of tasks as they come."""
    if not tasks:
        return
    if min(workers.jobs, len(tasks)) == 1 and workers.scheduler is None:
        for task in tasks:
            yield _numbered(simulate, task)
        return
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    with _backend(workers, len(tasks)) as count:
        parallel = joblib.Parallel(
            n_jobs=count, return_as="generator_unordered", pre_dispatch=_AHEAD * count, batch_size=1
        )
        try:
            yield from parallel(joblib.delayed(_numbered)(simulate, task) for task in tasks)
        except TerminatedWorkerError as error:
            raise ConvergenceError(
                "a worker process was killed, for want of memory perhaps; what was done is kept",
                hint="start the same command again, with fewer --jobs",
            ) from error


def _numbered(simulate: Simulate, task: Task) -> tuple[int, Columns]:
    return task.number, simulate(task)


@contextmanager
def _backend(workers: Workers, tasks: int) -> Iterator[int]:
    """Joblib set to the workers; how many there are, no more on this machine than tasks."""
    import joblib

    if workers.scheduler is None:
        # matrices are small: one thread a worker
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            yield min(workers.jobs, tasks)
        return
    with _client(workers.scheduler) as client, joblib.parallel_config(backend="dask"):
        yield max(1, sum(client.nthreads().values()))


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
