"""Tables 1 and 2: what repeated measurements of one target scatter by, under each condition."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import t as t_distribution

from calib.se3 import FloatArray
from calib.vision.touch_up import touch_up

from .visual_bench import Bench

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


LEVEL = 0.95
AXES = ("V", "H", "D")
BASE_AXES = ("X", "Y", "Z")
LEAST_TRIALS = 5
"""Of a set-up: fewer say little of its scatter, and a short form has fewer set-ups instead."""

_TOUCHING, _STEREO, _LINE = range(3)


def touched(bench: Bench, trials: int) -> tuple[FloatArray, dict[str, float]]:
    """Where touch-ups end along V, H, D ``(S, 3)`` [mm] from their mean, and how they went."""
    rng = bench.rng(_TOUCHING)
    drive = bench.drive(trials, rng)
    done = touch_up(drive, bench.starts(bench.home, trials, rng), bench.jacobian, bench.loop)
    ends = bench.ends(done)[done.touched]
    off = (ends - ends.mean(axis=0)) @ bench.R_base_camera
    went = {"moves": float(done.moves[done.touched].mean()), "failed": int((~done.touched).sum())}
    return 1e3 * off[:, [1, 0, 2]], went


def stereo(
    bench: Bench, settings: dict[str, Any], trials: int
) -> tuple[FloatArray, dict[str, float]]:
    """Where three view lines meet ``(S, 3)`` [mm] from the mean, in the base frame."""
    part = settings["stereo"]
    R = bench.cell.robot.fk(bench.home)[:3, :3]
    about = R.T[:, 0]  # the base's x axis, in tip axes
    turns = np.deg2rad(part["turns_deg"])[:, None] * about
    postures = np.array([bench.turned(turn) for turn in turns])
    T, ok = follow_line(bench, postures, trials, bench.rng(_STEREO))
    line, found = _lines(bench, settings, trials)
    met = meet(T, line)[ok & found]
    off = met - met.mean(axis=0) if len(met) else met
    return 1e3 * off, {"failed": int((~(ok & found)).sum())}


def _lines(bench: Bench, settings: dict[str, Any], trials: int) -> tuple[FloatArray, FloatArray]:
    """View lines ``(S, 4)``, identified beforehand: one for all, or one each."""
    given = np.array(settings["stereo"]["identified_from"])
    turns = np.deg2rad(given[:, :3]) @ bench.jacobian.R_tip_camera.T
    postures = [
        bench.away(bench.turned(turn), along / 1e3)
        for turn, along in zip(turns, given[:, 3], strict=True)
    ]
    count = trials if bench.condition["afresh"] else 1
    T, ok = follow_line(bench, np.array(postures), count, bench.rng(_LINE))
    line = identify_line(T, first_guess(bench))
    return np.broadcast_to(line, (trials, 4)), np.broadcast_to(ok, trials)


def over_set_ups(variances: FloatArray, less: FloatArray | None = None) -> tuple[float, float]:
    """Logarithm of a deviation from many set-ups, and how far it is known at the 95 % level.

    Parameters
    ----------
    variances : array (K,)
        Of the trials of each set-up, from their own mean; NaN for a set-up that failed.
    less : array (K,), optional
        The same of what the deviation is divided by, in the same set-ups.

    Returns
    -------
    log, half : float
        Half of the logarithm of the mean variance, and half the width of its interval: Student's,
        of the set-ups to first order, so that trials of one set-up do not count as if they were
        apart.
    """
    there = np.isfinite(variances if less is None else variances + less)
    variances = variances[there]
    if len(variances) < 2:  # a short form of which set-ups failed: no interval
        return (float(0.5 * np.log(variances[0])) if len(variances) else np.nan), np.inf
    parts = variances / variances.mean()
    log = 0.5 * np.log(variances.mean())
    if less is not None:
        parts = parts - less[there] / less[there].mean()
        log -= 0.5 * np.log(less[there].mean())
    count = len(variances)
    half = 0.5 * parts.std(ddof=1) / np.sqrt(count) * t_distribution.ppf(0.5 + LEVEL / 2, count - 1)
    return float(log), float(half)


def _variance(cloud: FloatArray) -> FloatArray:
    """Variance of the trials ``(S, 3)`` of a set-up; NaN where too few of them ended."""
    return cloud.var(axis=0, ddof=1) if len(cloud) >= LEAST_TRIALS else np.full(3, np.nan)


def row(
    condition: dict[str, Any], settings: dict[str, Any], trials: int | None = None
) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """All figures of a condition, and the clouds behind them."""
    seen = (settings["base"] | condition)["seen"]
    wanted = trials or settings["trials" if seen == "image" else "fast_trials"]
    set_ups = min(settings["set_ups"], max(2, wanted // LEAST_TRIALS))
    count = wanted // set_ups
    touch, met, moves, failed, stereo_failed = [], [], [], 0, 0
    for number in range(set_ups):
        bench = Bench.of(settings, condition, number)
        off, went = touched(bench, count)
        lines, followed = stereo(bench, settings, count)
        touch.append(off)
        met.append(lines)
        moves.append(went["moves"])
        failed += int(went["failed"])
        stereo_failed += int(followed["failed"])
    found: dict[str, Any] = {
        "key": condition["key"],
        "says": condition["says"],
        "seen": seen,
        "set_ups": set_ups,
        "trials": count * set_ups,
    }
    variances = {}
    for names, clouds in ((AXES, touch), (BASE_AXES, met)):
        of_each = np.array([_variance(cloud) for cloud in clouds])
        variances |= dict(zip(names, of_each.T, strict=True))
    for name, each in variances.items():
        log, half = over_set_ups(each)
        single = 3.0 * np.sqrt(each)
        found |= {
            f"{name}_mm": 3.0 * np.exp(log),
            f"{name}_low_mm": 3.0 * np.exp(log - half),
            f"{name}_high_mm": 3.0 * np.exp(log + half),
            f"{name}_least_mm": float(np.nanmin(single)),
            f"{name}_most_mm": float(np.nanmax(single)),
        }
    log, half = over_set_ups(variances["Z"], variances["D"])
    found |= {
        "moves": float(np.mean(moves)),
        "failed": failed,
        "stereo_failed": stereo_failed,
        "depth_ratio": np.exp(log),
        "depth_ratio_low": np.exp(log - half),
        "depth_ratio_high": np.exp(log + half),
    }
    return found, {"touch_up": np.concatenate(touch), "stereo": np.concatenate(met)}


def depth_of_stereo(turns_deg: list[float]) -> tuple[float, float, float]:
    """Deviations of the point where view lines meet, for one across each line.

    Along the axis of the turns, across it in the middle picture, and in depth: the information of
    a line turned by ``a`` is ``cos² a`` across and ``sin² a`` in depth.
    """
    turns = np.deg2rad(turns_deg)
    lines = np.stack([np.cos(turns), -np.sin(turns)], axis=-1)
    C = np.linalg.inv(lines.T @ lines)
    return 1.0 / np.sqrt(len(turns)), float(np.sqrt(C[0, 0])), float(np.sqrt(C[1, 1]))
