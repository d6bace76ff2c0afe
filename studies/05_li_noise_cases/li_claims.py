"""What the errors say of each claim of the paper, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from li_cases import (
    DUAL,
    DUAL_M,
    FLOOR,
    KRONECKER,
    KRONECKER_M,
    MEASURES,
    QUATERNION,
    SAFE,
    SCALED,
    SECOND,
    SHOWN,
    TRUE,
    TWO_STAGE,
)
from scipy.stats import spearmanr

from calib.se3 import FloatArray
from studies.intervals import LEVEL, median_interval, share

Cell = tuple[str, str, int]
"""Workspace, noisy side, number of poses."""

Found = Mapping[Cell, Mapping[str, FloatArray]]
"""Errors ``(T, 2)`` of every method in every cell."""

FEW = 7
"""Poses up to which a cell counts as one of few poses."""

STAGES = (TWO_STAGE, KRONECKER, SECOND, SCALED, FLOOR)
"""Whose translations are set against those with the true rotations."""


def compare(
    found: Found, better: str, worse: str, measure: int, poses: Sequence[int]
) -> dict[str, Any]:
    """In how many cells one method is nearer to the truth than another, problem by problem.

    A sign test in each cell, at a level that holds for all cells together (Bonferroni).
    """
    cells = [cell for cell in found if cell[2] in poses]
    level = 1.0 - (1.0 - LEVEL) / len(cells)
    shares, verdicts = [], []
    for cell in cells:
        wins = share(found[cell][better][:, measure] < found[cell][worse][:, measure], level)
        shares.append(wins["share"])
        verdicts.append((wins["low"] > 0.5) - (wins["high"] < 0.5))
    return {
        "better": better,
        "worse": worse,
        "error": MEASURES[measure],
        "poses": f"{min(poses)} to {max(poses)}",
        "cells": len(cells),
        "holds": verdicts.count(1),
        "reversed": verdicts.count(-1),
        "undecided": verdicts.count(0),
        "share_least": min(shares),
        "share_most": max(shares),
    }


def steps(found: Found, name: str, measure: int) -> dict[str, Any]:
    """Whether the median falls from each number of poses to the next, beyond chance or not."""
    rows = {cell: median_interval(every[name][:, measure]) for cell, every in found.items()}
    falls, rises, where = 0, 0, set()
    for (workspace, noisy, poses), (low, high) in rows.items():
        later = [n for w, s, n in rows if (w, s) == (workspace, noisy) and n > poses]
        if not later:
            continue
        next_low, next_high = rows[workspace, noisy, min(later)]
        falls += next_high < low
        rises += next_low > high
        if next_low > high:
            where.add(min(later))
    return {
        "method": name,
        "error": MEASURES[measure],
        "falls": int(falls),
        "rises": int(rises),
        "rises_at": sorted(where),
    }


def propagation(found: Found, name: str, poses: int) -> dict[str, Any]:
    """How errors of rotation reach the translations, at one number of poses.

    ``times``: median error of translation over that of least squares with the true rotations, which
    is 1 where nothing is propagated; least and most over the cells. ``rank_correlation``: of the
    error of rotation with that of translation (Spearman).
    """
    cells = [cell for cell in found if cell[2] == poses]
    error = [found[cell][name] for cell in cells]
    free = [np.median(found[cell][TRUE][:, 1]) for cell in cells]
    times = [np.median(e[:, 1]) / f for e, f in zip(error, free, strict=True)]
    linked = [spearmanr(e[:, 0], e[:, 1]).statistic for e in error]
    return {
        "method": name,
        "poses": poses,
        "times_least": float(min(times)),
        "times_most": float(max(times)),
        "rank_correlation_least": float(min(linked)),
    }


def order_of_averages(found: Found, poses: int, size: int, measure: int) -> dict[str, Any]:
    """How often averages of a few problems have the paper's order of the three methods."""
    shares = []
    for cell, every in found.items():
        if cell[2] != poses:
            continue
        groups = len(every[KRONECKER]) // size
        means = [
            every[name][: groups * size, measure].reshape(groups, size).mean(axis=1)
            for name in (KRONECKER, DUAL, QUATERNION)
        ]
        shares.append(float(((means[0] < means[1]) & (means[1] < means[2])).mean()))
    return {"poses": poses, "error": MEASURES[measure], "least": min(shares), "most": max(shares)}


def claims(found: Found, size: int) -> dict[str, Any]:
    """Everything that the verdicts rest on; ``size`` problems make an average of the paper."""
    every = sorted({poses for _, _, poses in found})
    parts = [[n for n in every if n <= FEW], [n for n in every if n > FEW]]
    pairs = [(KRONECKER, DUAL), (KRONECKER, QUATERNION), (DUAL, QUATERNION)]
    more = [
        (KRONECKER_M, DUAL_M),
        (KRONECKER_M, QUATERNION),
        (DUAL_M, QUATERNION),
        (KRONECKER, SAFE),
        (DUAL, SAFE),
        (DUAL_M, SAFE),
        (SCALED, DUAL),
        (SCALED, DUAL_M),
        (SCALED, SAFE),
        (SECOND, KRONECKER),
    ]
    return {
        "order": [
            compare(found, a, b, measure, part)
            for a, b in pairs + more
            for measure in range(2)
            for part in parts
            if part and not (a == SECOND and measure == 0)  # their rotations are the same
        ],
        "steps": [steps(found, name, measure) for name in SHOWN for measure in range(2)],
        "propagation": [propagation(found, name, n) for n in every for name in STAGES],
        "averages": [
            order_of_averages(found, n, size, measure) for n in every for measure in range(2)
        ],
    }
