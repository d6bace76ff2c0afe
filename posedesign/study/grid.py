"""What a study repeats: conditions times trials, cut into tasks with a seed each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.errors import InputError

MOST_TASKS = 100_000
"""Of a study: the results of each are a file until all are done."""


@dataclass(frozen=True)
class Task:
    """Some trials of one condition: what a worker does at once.

    Attributes
    ----------
    number : int
        Counted from 0 over the whole grid.
    condition : mapping
        Plain values that can be sent to another machine.
    first, trials : int
        The trials of the condition that it does.
    seed : int
        Of the study.
    """

    number: int
    condition: Mapping[str, Any]
    first: int
    trials: int
    seed: int

    def rng(self) -> np.random.Generator:
        """Random numbers of the task's own: the same on any worker, in any order."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(self.number,))
        return np.random.default_rng(sequence)


@dataclass(frozen=True)
class Grid:
    """All conditions, each with as many trials.

    Attributes
    ----------
    conditions : sequence of mapping
    trials : int
    batch : int
        Trials of a task: enough for arrays to pay, and small enough for a task to be lost. It
        decides which random numbers a trial gets, so it is a number of the study and does not
        depend on how many workers there are.
    seed : int

    Raises
    ------
    InputError
        Nothing to do.
    """

    conditions: Sequence[Mapping[str, Any]]
    trials: int
    batch: int
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
