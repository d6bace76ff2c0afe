"""Table 1 of the paper: E = Σ |A_i X - Z B_i|² of seven poses, simulated and measured."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from li_cases import (
    DUAL,
    FLOOR,
    KRONECKER,
    MM,
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
from calib.se3 import FloatArray, transform
from posedesign.pairs_file import Pairs
from posedesign.pairs_source import PairSource

UNPROJECTED = "Kronecker, mm, not orthonormal"
METHODS_OF_TABLE = (QUATERNION, SAFE, DUAL, KRONECKER, UNPROJECTED, SCALED, FLOOR)
HERE = Path(__file__).parent
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz", "x_m", "y_m", "z_m")


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


def data_folder() -> Path:
    """Where real measurements are looked for."""
    named = os.environ.get("POSEDESIGN_DATA")
    return Path(named) if named else HERE.parents[1].parent / "shared" / "data"


def real_pairs(folder: Path) -> dict[str, Pairs]:
    """The pairs of real robots [m], by name; those whose files are there."""
    root = folder / "robot_world"
    found: dict[str, Pairs] = {}
    mat = root / "ur3e_hand_camera" / "T_handcam_UR3e210506.mat"
    if mat.is_file():
        names = ("T_cam", "T_hand")
        found["UR3e"] = PairSource(mat, variables=names, unit="mm", invert="b").read()
    for name, stem in (("tag 22, camera 2", "tag_22_cam_2"), ("tag 15, camera 1", "tag_15_cam_1")):
        sides = [root / "multi_tag" / f"{stem}_{side}.csv" for side in "AB"]
        if all(path.is_file() for path in sides):
            found[name] = PairSource(a=sides[0], b=sides[1], columns=QUATERNION_COLUMNS).read()
    if (root / "tabb_ds1").is_dir():
        found["Tabb"] = _tabb(root / "tabb_ds1")
    return found


def _tabb(folder: Path) -> Pairs:
    """Rows of an index, a matrix and a translation [mm]; blocks of 4x4 numbers by that index."""
    rows = np.loadtxt(folder / "cali_subset24.txt")
    A = transform(rows[:, 1:10].reshape(-1, 3, 3), rows[:, 10:] / MM)
    numbers = (folder / "robot_cali.txt").read_text(encoding="utf-8").split()
    B = np.array(numbers[1:], dtype=float).reshape(-1, 4, 4)[rows[:, 0].astype(int)]
    return Pairs((), A, transform(B[:, :3, :3], B[:, :3, 3] / MM))


def measured(
    rng: np.random.Generator, every: dict[str, Pairs], settings: dict[str, Any]
) -> dict[str, Any]:
    """Table 1 on random subsets of real pairs, with E of the pairs left out beside it."""
    found: dict[str, Any] = {}
    count, size = settings["table_1"]["subsets"], settings["table_1"]["poses"]
    for name, pairs in every.items():
        order = rng.permuted(np.tile(np.arange(len(pairs.A)), (count, 1)), axis=1)
        A, B = pairs.A[order], pairs.B[order]
        # what tells X at all: a subset whose poses turn about one axis has no E worth comparing
        good = ~solve_batch(A[:, :size], B[:, :size], "shah").degenerate
        found[name] = _of_subsets(A[good], B[good], size) | {"pairs": len(pairs.A)}
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
