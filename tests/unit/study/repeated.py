"""A study that is quick and needs no robot: what the tests of the runner repeat."""

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from posedesign.study import Grid, Store, Task, Workers, run_grid

CONDITIONS = [{"scale": 1.0}, {"scale": 10.0}, {"scale": 100.0}]
TRIALS, BATCH, SEED = 40, 5, 3


def grid() -> Grid:
    return Grid(CONDITIONS, TRIALS, BATCH, SEED)


def about() -> dict[str, Any]:
    return {"study": "repeated", "tasks": len(grid()), "trials": TRIALS}


def simulate(task: Task) -> dict[str, Any]:
    """Some numbers, a mean that takes a moment, and a line in a diary of who did what."""
    values = task.condition["scale"] * task.rng().standard_normal(task.trials)
    time.sleep(task.condition.get("seconds", 0.0))
    return {
        "scale": np.full(task.trials, task.condition["scale"]),
        "trial": np.arange(task.first, task.first + task.trials),
        "value": values,
    }


def simulate_deadly(task: Task) -> dict[str, Any]:
    """The same, but that the seventh task ends the process that does it, as a full memory does."""
    if task.number == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(task)


def simulate_noted(task: Task) -> dict[str, Any]:
    """The same, and a diary of the tasks that were done, a file each time."""
    done = simulate(task)
    time.sleep(0.01)
    diary = Path(os.environ["STUDY_DIARY"])
    (diary / f"{task.number}.{time.monotonic_ns()}").touch()
    return done


if __name__ == "__main__":
    out, jobs = Path(sys.argv[1]), int(sys.argv[2])
    slow = Grid([{**c, "seconds": 600.0} for c in CONDITIONS], TRIALS, BATCH, SEED)
    chosen = slow if sys.argv[3:] == ["slow"] else grid()
    run_grid(simulate_noted, chosen, Store(out, "trials", about()), Workers(jobs))
