"""Tables 1 and 2: what repeated measurements of one target scatter by, under each condition."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2
from visual_bench import Bench
from visual_lines import first_guess, follow_line, identify_line, meet

from calib.se3 import FloatArray
from calib.visual.servo import touch_up

LEVEL = 0.95
AXES = ("V", "H", "D")
BASE_AXES = ("X", "Y", "Z")
_TOUCHING, _STEREO, _LINE = range(3)


def touched(bench: Bench, trials: int) -> tuple[FloatArray, dict[str, float]]:
    """Where touch-ups end along V, H, D ``(S, 3)`` [mm] from their mean, and how they went."""
    rng = bench.rng(_TOUCHING)
    drive = bench.drive(trials, rng)
    done = touch_up(drive, bench.starts(bench.home, trials, rng), bench.jacobian, bench.loop)
    ends = bench.ends(done)[done.touched]
    off = (ends - ends.mean(axis=0)) @ bench.R_base_camera
    went = {
        "moves": float(done.moves[done.touched].mean()),
        "failed": int((~done.touched).sum()),
    }
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
    return 1e3 * (met - met.mean(axis=0)), {"failed": int((~(ok & found)).sum())}


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


def three_sigma(off: FloatArray) -> list[float]:
    """Three standard deviations of each column ``(S, 3)``."""
    return [float(v) for v in 3.0 * off.std(axis=0, ddof=1)]


def interval(three: float, count: int) -> tuple[float, float]:
    """95 % interval of three standard deviations from so many normal draws, by chi-squared."""
    tail = (1.0 - LEVEL) / 2.0
    ends = chi2.ppf([1.0 - tail, tail], count - 1)
    low, high = three * np.sqrt((count - 1) / ends)
    return float(low), float(high)


def row(
    condition: dict[str, Any], settings: dict[str, Any], trials: int | None = None
) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """All figures of a condition, and the clouds behind them."""
    bench = Bench.of(settings, condition)
    seen = bench.condition["seen"]
    count = trials or settings["trials" if seen == "image" else "fast_trials"]
    touch, went = touched(bench, count)
    met, followed = stereo(bench, settings, count)
    found: dict[str, Any] = {
        "key": condition["key"],
        "says": condition["says"],
        "seen": seen,
        "trials": count,
    }
    for names, off in ((AXES, touch), (BASE_AXES, met)):
        for name, three in zip(names, three_sigma(off), strict=True):
            low, high = interval(three, len(off))
            found |= {f"{name}_mm": three, f"{name}_low_mm": low, f"{name}_high_mm": high}
    found |= {
        "moves": went["moves"],
        "failed": went["failed"],
        "stereo_failed": followed["failed"],
        "depth_ratio": found["Z_mm"] / found["D_mm"],
    }
    return found, {"touch_up": touch, "stereo": met}


def depth_of_stereo(turns_deg: list[float]) -> tuple[float, float, float]:
    """Deviations of the point where view lines meet, for one across each line.

    Along the axis of the turns, across it in the middle picture, and in depth: the information of
    a line turned by ``a`` is ``cos² a`` across and ``sin² a`` in depth.
    """
    turns = np.deg2rad(turns_deg)
    lines = np.stack([np.cos(turns), -np.sin(turns)], axis=-1)
    C = np.linalg.inv(lines.T @ lines)
    return 1.0 / np.sqrt(len(turns)), float(np.sqrt(C[0, 0])), float(np.sqrt(C[1, 1]))
