"""Which method predicts pairs best that took no part: halves of a sequence, run by run.

Poses that follow each other are all but the same, so that a pair left out alone is predicted by
its neighbours. Here whole runs of consecutive pairs are left out: four of eight, in each of the
70 ways.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from real_rows import ON_B, PARTS, RATIO, TO_SHOW, Settings, given_noise

from calib.robot_world import solve_batch
from calib.robot_world.results import residuals
from calib.se3 import BoolArray, FloatArray
from studies.real_pairs import Sides

BEST = "ml"
"""The method that the others are compared with."""

FIGURES = ("rms_deg", "median_deg", "rms_mm", "median_mm")


def halves(count: int, runs: int) -> BoolArray:
    """Pairs ``(S, N)`` that learn, in every way to take half of the runs."""
    run = np.arange(count) * runs // count
    return np.array([np.isin(run, chosen) for chosen in combinations(range(runs), runs // 2)])


def predictions(sides: Sides, learn: BoolArray, name: str, settings: Settings) -> FloatArray:
    """What is left ``(S, 4)`` of the pairs that did not learn, in the order of FIGURES."""
    A, B = sides
    noise = {RATIO: given_noise(settings), ON_B: "B"}.get(name)
    method = "ml" if name in (RATIO, ON_B) else name
    out = np.full((len(learn), len(FIGURES)), np.nan)
    sizes = learn.sum(axis=1)
    for size in np.unique(sizes):  # runs differ by a pair where their number is no divisor
        rows = np.flatnonzero(sizes == size)
        inside = np.array([np.flatnonzero(learn[row]) for row in rows])
        outside = np.array([np.flatnonzero(~learn[row]) for row in rows])
        found = solve_batch(A[inside], B[inside], method, noise)
        error = residuals(A[outside], B[outside], found.X, found.Z)
        for k, (part, scale) in enumerate(zip(PARTS, TO_SHOW, strict=True)):
            size_of = scale * np.linalg.norm(error[..., part], axis=-1)
            out[rows, 2 * k] = np.sqrt((size_of**2).mean(axis=1))
            out[rows, 2 * k + 1] = np.median(size_of, axis=1)
    return out


def compared(sides: Sides, names: list[str], settings: Settings) -> dict[str, Any]:
    """Each method against :data:`BEST`, split by split, on the splits that identify X."""
    learn = halves(len(sides[0]), settings["splits"]["runs"])
    identify = np.array(
        [~solve_batch(*(T[None, w] for T in sides), "shah").degenerate[0] for w in learn]
    )
    learn = learn[identify]
    every = {name: predictions(sides, learn, name, settings) for name in names}
    rows = {}
    for name, values in every.items():
        row: dict[str, Any] = {}
        for figure, own, best in zip(FIGURES, values.T, every[BEST].T, strict=True):
            row[figure] = float(np.median(own))
            row[f"{figure}_ratio"] = float(np.exp(np.mean(np.log(own / best))))
            row[f"{figure}_worse"] = float(np.mean(own > best)) if name != BEST else None
        rows[name] = row
    return {"splits": len(learn), "unidentified": int((~identify).sum()), "methods": rows}
