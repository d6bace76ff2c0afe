"""Stereo by following a view line: the line in the tip frame, and where several of them meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from visual_bench import Bench

from calib.se3 import FloatArray
from calib.vision.touch_up.servo import touch_up

_STEPS = 6
"""Gauss-Newton steps: the unknowns are nearly linear, the third changes nothing."""


def follow_line(
    bench: Bench, postures: FloatArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Bring the target onto the view line at postures ``(K, n)`` one after the other.

    Returns
    -------
    T : array (count, K, 4, 4)
        Poses of the nominal tip, as recorded.
    ok : array (count,) of bool
        Whether all were reached.
    """
    drive = bench.drive(count, rng)
    loop = replace(bench.loop, view_line=True)
    done = [touch_up(drive, bench.starts(q, count, rng), bench.jacobian, loop) for q in postures]
    T = np.stack([bench.cell.robot.fk(one.q) for one in done], axis=1)
    return T, np.all([one.touched for one in done], axis=0)


def identify_line(T: FloatArray, line: FloatArray) -> FloatArray:
    """View lines ``(S, 4)`` of poses ``(S, K, 4, 4)`` of one target, from a first guess ``(4,)``.

    ``(cx, cy, ax, ay)``: the line meets the tip's x-y plane at ``(cx, cy)`` [m] and runs along
    ``(ax, ay, 1)``. With the target in tip axes, ``u = Rᵀ (m - t)``, each pose asks for
    ``u_xy = c + a u_z``, two rows for seven unknowns.
    """
    R, t = T[..., :3, :3], T[..., :3, 3]
    back = np.swapaxes(R, -1, -2)
    x = np.tile(line, (len(T), 1))
    m = meet(T, x)
    for _ in range(_STEPS):
        u = (back @ (m[:, None] - t)[..., None])[..., 0]
        off = u[..., :2] - x[:, None, :2] - x[:, None, 2:] * u[..., 2:]
        J = np.zeros((*u.shape[:2], 2, 7))
        J[..., :, :2] = -np.eye(2)
        J[..., 0, 2] = J[..., 1, 3] = -u[..., 2]
        J[..., :, 4:] = back[..., :2, :] - x[:, None, 2:, None] * back[..., 2:, :]
        rows = J.reshape(len(T), -1, 7)
        step = -np.linalg.pinv(rows) @ off.reshape(len(T), -1, 1)
        x, m = x + step[:, :4, 0], m + step[:, 4:, 0]
    return x


def meet(T: FloatArray, line: FloatArray) -> FloatArray:
    """Point ``(S, 3)`` [m] nearest to the view lines ``(S, 4)`` at poses ``(S, K, 4, 4)``.

    Nearest across each line, as it is seen: two rows a pose, linear in the point.
    """
    R, t = T[..., :3, :3], T[..., :3, 3]
    across = np.zeros((len(T), 1, 2, 3))
    across[..., :2] = np.eye(2)
    across[..., 2] = -line[:, None, 2:]
    rows = across @ np.swapaxes(R, -1, -2)
    right = (rows @ t[..., None])[..., 0] + line[:, None, :2]
    A = rows.reshape(len(T), -1, 3)
    return np.asarray((np.linalg.pinv(A) @ right.reshape(len(T), -1, 1))[..., 0])


def first_guess(bench: Bench) -> FloatArray:
    """The line ``(4,)`` as the camera was meant to be mounted: through the tool point, along z."""
    x, y, _ = bench.cell.tool_m
    return np.array([x, y, 0.0, 0.0])
