"""What makes one doubt that positions from a controller are the touch-ups they are taken for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from calib.errors import InputError
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.planning import NEAR_TARGET_M
from posedesign.planning.poses_file import PoseList

WORTH_A_WORD = 0.3
"""Part of the noise of touching up from which that of rounding is worth a word: it adds 4 %."""

MUCH_NEARER = 0.5
"""Part of the distance to its own pose of the plan, in the joint that is farthest off, at which
another one is: touching up moves joints by far less than poses are apart."""


def tool_moved_m(cell: Cell, q: FloatArray, planned: FloatArray) -> FloatArray:
    """How far the tool point of the nominal arm is apart at postures ``(N, n)``, ``(N,)`` [m]."""
    here, there = (cell.robot.state(at).point(cell.tool_m) for at in (q, planned))
    return np.asarray(np.linalg.norm(here - there, axis=1))


def exchanged(names: Sequence[str], q: FloatArray, plan: PoseList) -> list[str]:
    """Positions ``(N, n)`` [rad] that are nearer to another pose of the plan than to their own.

    All touch the same target, so that only the joints tell poses apart.

    Raises InputError: most are: the numbers are those of another program.
    """
    planned, known = plan.measured.postures, plan.measured.names
    row_of = {name: k for k, name in enumerate(known)}
    own = planned[[row_of[name] for name in names]]
    found = cKDTree(planned).query(q, p=np.inf)
    apart, nearest = (np.atleast_1d(of_all) for of_all in found)
    rows = np.flatnonzero(apart < MUCH_NEARER * np.abs(q - own).max(axis=1))
    if 2 * len(rows) > len(q):
        i = int(rows[0])
        raise InputError(
            f"{len(rows)} of {len(q)} positions stand at other poses of the plan than their "
            f"numbers say: {names[i]} at {known[int(nearest[i])]}",
            hint="is it another program, or is program.first_register wrong?",
            name="poses",
        )
    return [f"{names[i]}: stands nearer to {known[int(nearest[i])]}" for i in rows.tolist()]


def refuse_far(
    cell: Cell, names: Sequence[str], q: FloatArray, near: FloatArray, path: Path
) -> None:
    """Refuse what does not say which plan it is of, and is far from this one."""
    moved = tool_moved_m(cell, q, near)
    worst = int(np.argmax(moved))
    if moved[worst] > NEAR_TARGET_M:
        raise InputError(
            f"{path}: position {worst + 1} is {1e3 * moved[worst]:.0f} mm from where the plan has "
            f"{names[worst]}, and the file does not say which plan it is of",
            hint="is it the program of another plan? Without --poses it is read as it is",
            name=str(path),
        )


def rounding_words(cell: Cell, q: FloatArray, step_rad: float) -> list[str]:
    """What the controller's rounding of joints adds to the noise, where that is worth a word."""
    robot, controller = cell.robot, cell.robot.controller
    if not step_rad or controller is None:
        return []
    state = robot.state(q)
    tip = robot.jacobian(q)  # shape (N, 6, n)
    lever = state.R_base_tip @ cell.tool_m  # shape (N, 3)
    place = tip[:, :3] + np.cross(tip[:, 3:], lever[:, :, None], axis=1)
    shown = place @ np.linalg.inv(controller.pendant_from_joints)
    added_m = float(np.sqrt((shown**2).sum(axis=(1, 2)).mean() * step_rad**2 / 12.0))
    noise_m = _touch_up_noise_m(cell)
    if noise_m is None or added_m < WORTH_A_WORD * noise_m:
        return []
    return [
        f"joints are stored to {np.rad2deg(step_rad):g} deg: that moves the tool point by "
        f"{1e3 * added_m:.2g} mm rms, beside the {1e3 * noise_m:.2g} mm of touching up; raise "
        "measurement.three_sigma_mm, or let measurement.estimate_noise find both"
    ]


def _touch_up_noise_m(cell: Cell) -> float | None:
    """Length of the standard deviation of a touch-up [m]; None where it is not given."""
    kind = cell.measurement
    if kind.estimated:
        return None
    return float(np.linalg.norm(kind.sigma[: kind.rows - kind.turns]))
