"""Table 1 of the paper: E = Σ |A_i X - Z B_i|² of seven poses, simulated and measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from li_cases import (
    DUAL,
    FLOOR,
    KRONECKER,
    QUATERNION,
    SAFE,
    SCALED,
    SOLVERS,
    Measured,
    draw,
    in_mm,
    linear_minimum,
    sum_of_squares,
)

from calib.robot_world import METHODS, PairSets, solve_batch
from calib.robot_world.results import residuals
from calib.se3 import FloatArray
from studies.real_pairs import Sides

UNPROJECTED = "Kronecker, mm, not orthonormal"
METHODS_OF_TABLE = (QUATERNION, SAFE, DUAL, KRONECKER, UNPROJECTED, SCALED, FLOOR)


def table_row(data: Measured) -> dict[str, FloatArray]:
    """E ``(T,)`` [mm²] of every method, rotations and translations in one norm."""
    answers = {name: SOLVERS[name](data) for name in METHODS_OF_TABLE if name != UNPROJECTED}
    found = {name: (in_mm(X), in_mm(Z)) for name, (X, Z) in answers.items()}
    found[UNPROJECTED] = linear_minimum(data.millimetres)
    return {name: sum_of_squares(data.millimetres, *found[name]) for name in METHODS_OF_TABLE}


def summary(E: dict[str, FloatArray]) -> dict[str, Any]:
    """Medians, and how often the three methods stand as in the paper."""
    q, d, k = (E[name] for name in (QUATERNION, DUAL, KRONECKER))
    u = E[UNPROJECTED]
    return {
        "sets": len(q),
        "median": {name: float(np.median(values)) for name, values in E.items()},
        "kronecker_least": float(((k < q) & (k < d)).mean()),
        "not_orthonormal_least": float(((u < q) & (u < d)).mean()),
        "paper_order": float(((k < q) & (q < d)).mean()),
        "paper_order_not_orthonormal": float(((u < q) & (q < d)).mean()),
    }


def simulated(rng: np.random.Generator, trials: int, settings: dict[str, Any]) -> dict[str, Any]:
    """Table 1 by simulation, for every workspace and noisy side."""
    found: dict[str, Any] = {}
    poses = settings["table_1"]["poses"]
    for workspace, cone_deg in settings["workspaces"].items():
        for noisy in settings["noisy"]:
            data = draw(rng, trials, poses, noisy, cone_deg, settings)
            row = summary(table_row(data))
            X, Z = (in_mm(T) for T in SOLVERS[SAFE](data))
            e = residuals(data.millimetres.A, data.millimetres.B, X, Z)
            # |R - 1|² is twice the square of a small angle
            row["rotation_part"] = float(np.median(2.0 * (e[..., :3] ** 2).sum(axis=(1, 2))))
            found[f"{workspace}, noise on {noisy}"] = row
    return found


def measured(
    rng: np.random.Generator, every: Mapping[str, Sides], count: int, size: int
) -> dict[str, Any]:
    """Table 1 on random subsets of real pairs, with E of the pairs left out beside it."""
    found: dict[str, Any] = {}
    for name, pairs in every.items():
        order = rng.permuted(np.tile(np.arange(len(pairs[0])), (count, 1)), axis=1)
        A, B = (side[order] for side in pairs)
        # what tells X at all: a subset whose poses turn about one axis has no E worth comparing
        good = ~solve_batch(A[:, :size], B[:, :size], "shah").degenerate
        found[name] = _of_subsets(A[good], B[good], size) | {"pairs": len(pairs[0])}
    return found


def _of_subsets(A: FloatArray, B: FloatArray, size: int) -> dict[str, Any]:
    inside = PairSets(A[:, :size], B[:, :size])
    mm = PairSets(in_mm(inside.A), in_mm(inside.B))
    left_out = PairSets(in_mm(A[:, size:]), in_mm(B[:, size:]))
    answers = {
        QUATERNION: METHODS["zhuang-literal"].run(mm, None),
        SAFE: METHODS["zhuang"].run(mm, None),
        DUAL: METHODS["li-dual-quaternion"].run(mm, None),
        KRONECKER: METHODS["li-kronecker-literal"].run(mm, None),
        SCALED: METHODS["li-kronecker"].run(mm, None),
    }
    found = {name: (answer.X, answer.Z) for name, answer in answers.items()}
    likeliest = METHODS["ml"].run(inside, None)
    found[FLOOR] = (in_mm(likeliest.X), in_mm(likeliest.Z))
    found[UNPROJECTED] = linear_minimum(mm)
    row = summary({name: sum_of_squares(mm, *found[name]) for name in METHODS_OF_TABLE})
    row["left_out_a_pose"] = {
        name: float(np.median(sum_of_squares(left_out, *found[name])) / left_out.N)
        for name in METHODS_OF_TABLE
    }
    return row
