"""Transforms that come in from outside: mirrored, scaled or transposed ones are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.errors import InputError
from calib.model.parameters import TargetFrame, ToolFrame
from calib.robot_world import solve, solve_batch
from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.planning.tables import Pairs, write_pairs

Take = Callable[[FloatArray, Path], object]


def _pairs(T: FloatArray) -> FloatArray:
    return np.stack([np.eye(4), np.eye(4), T])


ENTRANCES: dict[str, Take] = {
    "ToolFrame": lambda T, _: ToolFrame(T),
    "TargetFrame": lambda T, _: TargetFrame(T),
    "solve, A": lambda T, _: solve(_pairs(T), _pairs(np.eye(4))),
    "solve, B": lambda T, _: solve(_pairs(np.eye(4)), _pairs(T)),
    "solve_batch": lambda T, _: solve_batch(_pairs(T)[None], _pairs(np.eye(4))[None]),
    "inverse kinematics": lambda T, _: Robot.preset("r2000ic165f").inverse(T[None]),
    "pairs.csv": lambda T, folder: write_pairs(
        folder / "pairs.csv", Pairs(("a", "b", "c"), _pairs(np.eye(4)), _pairs(T))
    ),
}


def moved(row: int, column: int, by: float) -> FloatArray:
    """The unit transform with one number changed."""
    T = np.eye(4)
    T[row, column] += by
    return T


WRONG = {
    "left-handed": (np.diag([1.0, 1.0, -1.0, 1.0]), "left-handed"),
    "scaled": (np.diag([1.01, 1.01, 1.01, 1.0]), "not orthonormal"),
    "transposed": (moved(3, 0, 0.2), "last row"),
    "not a number": (moved(0, 3, np.nan), "not a finite number"),
}


@pytest.mark.parametrize("entrance", ENTRANCES)
@pytest.mark.parametrize("kind", WRONG)
def test_what_is_no_rigid_transform_is_refused(tmp_path: Path, entrance: str, kind: str) -> None:
    T, message = WRONG[kind]
    with pytest.raises(InputError, match=message):
        ENTRANCES[entrance](T, tmp_path)
    assert list(tmp_path.iterdir()) == []
