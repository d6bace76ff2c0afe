"""The simulation of Fig. 1 of Li, Wang and Wu 2010, and what its errors say of the claims."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

from calib import se3
from calib.robot_world import METHODS, PairNoise, PairSets, Problems, random_problems
from calib.robot_world.algebra import kronecker, least_squares
from calib.robot_world.closed_form import assemble
from calib.se3 import FloatArray
from studies.intervals import LEVEL, median_interval, share

MM = 1e3
"""Millimetres in a metre: the paper's noise and its errors are in mm."""

MEASURES = ("rotation_deg", "translation_mm")
"""σ1 + σ2 of the paper, split: sums over X and Z of the angles and of the distances by which they
are off. The norm of the difference of two rotations is 2 sqrt(2) sin(angle/2), .0247 a degree, so
the norm of the difference of whole matrices with lengths in mm is that of the translations."""


@dataclass(frozen=True, eq=False)
class Measured:
    """T noisy problems with their answer: ``metres`` and ``millimetres`` are the same pairs."""

    metres: PairSets
    millimetres: PairSets
    X: FloatArray
    Z: FloatArray
    noise: PairNoise


Answer = tuple[FloatArray, FloatArray]
"""X and Z ``(T, 4, 4)`` [m]."""


def draw(
    rng: np.random.Generator, trials: int, poses: int, noisy: str, cone_deg: float, settings: dict
) -> Measured:
    """Problems of a small arm with noise on A, on B or on both, as the paper draws it."""
    true = _small_arm(random_problems(rng, trials, poses, cone_deg or None), **settings["arm"])
    noise = settings["noise"]
    A = _with_noise(rng, true.A, **noise) if noisy in ("A", "both") else true.A
    B = _with_noise(rng, true.B, **noise) if noisy in ("B", "both") else true.B
    spread = 1.0 / np.sqrt(3.0)  # standard deviation of a uniform number in plus and minus 1
    sigma = PairNoise(
        np.radians(noise["angle_deg"]) * spread, noise["position_mm"] / MM * spread, on=noisy
    )
    return Measured(PairSets(A, B), PairSets(in_mm(A), in_mm(B)), true.X, true.Z, sigma)


def in_mm(T: FloatArray) -> FloatArray:
    """Transforms ``(..., 4, 4)`` [m] with their translations in mm."""
    scaled = T.copy()
    scaled[..., :3, 3] *= MM
    return scaled


def _small_arm(problems: Problems, scale: float, centre_m: list[float]) -> Problems:
    """Shorter lengths, and the work in front of the base instead of around its origin."""
    A, B, X, Z = (T.copy() for T in (problems.A, problems.B, problems.X, problems.Z))
    for T in (A, B, X, Z):
        T[..., :3, 3] *= scale
    for T in (A, Z):  # a shift of the base: A X = Z B as before
        T[..., :3, 3] += centre_m
    return Problems(A, B, X, Z)


def _with_noise(
    rng: np.random.Generator, T: FloatArray, angle_deg: float, position_mm: float
) -> FloatArray:
    """Uniform noise on the three Z-Y-Z Euler angles and the three coordinates."""
    R = Rotation.from_matrix(T[..., :3, :3].reshape(-1, 3, 3))
    angles = R.as_euler("ZYZ", degrees=True)
    angles += rng.uniform(-angle_deg, angle_deg, angles.shape)
    turned = Rotation.from_euler("ZYZ", angles, degrees=True).as_matrix()
    limit = position_mm / MM
    moved = T[..., :3, 3] + rng.uniform(-limit, limit, (*T.shape[:-2], 3))
    return se3.transform(turned.reshape(*T.shape[:-2], 3, 3), moved)


def _by(method: str, data: Measured) -> Answer:
    found = METHODS[method].run(data.metres, data.noise)
    return found.X, found.Z


def _by_mm(method: str, data: Measured) -> Answer:
    found = METHODS[method].run(data.millimetres, None)
    return in_metres(found.X), in_metres(found.Z)


def in_metres(T: FloatArray) -> FloatArray:
    """Inverse of :func:`in_mm`."""
    scaled = T.copy()
    scaled[..., :3, 3] /= MM
    return scaled


def _kronecker_second_stage(data: Measured) -> Answer:
    """Translations solved again for the rotations of the Kronecker form in mm, made orthonormal."""
    X, Z = _by_mm("li-kronecker-literal", data)
    return assemble(data.metres, X[:, :3, :3], Z[:, :3, :3])


def _true_rotations(data: Measured) -> Answer:
    """What rotations without any error leave of the error of the translations."""
    return assemble(data.metres, data.X[:, :3, :3], data.Z[:, :3, :3])


QUATERNION, SAFE = "quaternion", "quaternion, safe frames"
DUAL, DUAL_M = "dual quaternion, mm", "dual quaternion, m"
KRONECKER, KRONECKER_M = "Kronecker, mm", "Kronecker, m"
SCALED, FLOOR = "Kronecker, scaled", "maximum likelihood"
TWO_STAGE, SECOND, TRUE = "rotations first", "Kronecker, mm, 2nd stage", "true rotations"

SOLVERS: Mapping[str, Callable[[Measured], Answer]] = {
    QUATERNION: partial(_by, "zhuang-literal"),
    SAFE: partial(_by, "zhuang"),
    DUAL: partial(_by_mm, "li-dual-quaternion"),
    DUAL_M: partial(_by, "li-dual-quaternion"),
    KRONECKER: partial(_by_mm, "li-kronecker-literal"),
    KRONECKER_M: partial(_by, "li-kronecker-literal"),
    SCALED: partial(_by, "li-kronecker"),
    FLOOR: partial(_by, "ml"),
    TWO_STAGE: partial(_by, "shah"),
    SECOND: _kronecker_second_stage,
    TRUE: _true_rotations,
}
"""What is compared. The first eight stand for themselves; the last three are there to tell how
errors of the rotations reach the translations."""

SHOWN = tuple(SOLVERS)[:8]


def errors(data: Measured, answer: Answer) -> FloatArray:
    """The :data:`MEASURES` of X and Z together ``(T, 2)``."""
    out = np.zeros((data.metres.T, 2))
    for found, true in zip(answer, (data.X, data.Z), strict=True):
        turn = found[:, :3, :3] @ np.swapaxes(true[:, :3, :3], -1, -2)
        out[:, 0] += np.degrees(se3.rotation_angle(turn))
        out[:, 1] += MM * np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=-1)
    return out


def sum_of_squares(pairs: PairSets, X: FloatArray, Z: FloatArray) -> FloatArray:
    """E of Table 1 ``(T,)``: Σ |A_i X - Z B_i|², in the unit of length of the pairs."""
    left = pairs.A @ X[:, None] - Z[:, None] @ pairs.B
    return np.asarray((left**2).sum(axis=(1, 2, 3)))


def linear_minimum(pairs: PairSets) -> Answer:
    """Matrices X and Z ``(T, 4, 4)`` that Eq. 19 asks for, before they are made rotations.

    All 24 unknowns at once, row-major: ``R_A R_X - R_Z R_B`` and ``R_A p_X - R_Z p_B - p_Z + p_A``.
    The sum of squares that this minimises is E itself.
    """
    A, B, T, N = pairs.A, pairs.B, pairs.T, pairs.N
    one = np.broadcast_to(np.eye(3), (T, N, 3, 3))
    R_A, p_B = A[..., :3, :3], B[..., :3, 3]
    rows = np.zeros((T, N, 12, 24))
    rows[..., :9, 0:9] = kronecker(A, se3.transform(one, p_B))
    rows[..., :9, 9:18] = -kronecker(se3.transform(one, p_B), np.swapaxes(B, -1, -2))
    rows[..., 9:, 18:21] = R_A
    rows[..., 9:, 21:] = -np.eye(3)
    for axis in range(3):
        rows[..., 9 + axis, 9 + 3 * axis : 12 + 3 * axis] = -p_B
    right = np.zeros((T, N, 12))
    right[..., 9:] = -A[..., :3, 3]
    u = least_squares(rows.reshape(T, 12 * N, 24), right.reshape(T, 12 * N))
    X = se3.transform(u[:, :9].reshape(T, 3, 3), u[:, 18:21])
    Z = se3.transform(u[:, 9:18].reshape(T, 3, 3), u[:, 21:])
    return X, Z


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
    of = {"poses": f"{min(poses)} to {max(poses)}", "cells": len(cells)}
    names = {"holds": 1, "reversed": -1, "undecided": 0}
    return {
        "better": better,
        "worse": worse,
        "error": MEASURES[measure],
        **of,
        **{name: verdicts.count(verdict) for name, verdict in names.items()},
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
    more = [(KRONECKER_M, DUAL_M), (KRONECKER_M, QUATERNION), (DUAL_M, QUATERNION)]
    more += [(KRONECKER, SAFE), (DUAL, SAFE), (DUAL_M, SAFE), (SCALED, DUAL), (SCALED, DUAL_M)]
    more += [(SCALED, SAFE), (SECOND, KRONECKER)]
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
