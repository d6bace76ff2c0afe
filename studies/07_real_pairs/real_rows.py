"""Every method on a data set, and which predicts pairs best that took no part.

Poses that follow each other are all but the same, so that a pair left out alone is predicted by
its neighbours. Here whole runs of consecutive pairs are left out: four of eight, in each of the
70 ways.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from calib.robot_world import (
    METHODS,
    PairNoise,
    RobotWorldResult,
    certify,
    difference,
    residuals,
    solve,
    solve_batch,
)
from calib.se3 import BoolArray, FloatArray
from studies.real_data import MM, Sides

RATIO, ON_B = "ml, ratio", "ml, on B"
"""``ml`` with the ratio of the noises given, and with noise of B alone, the same in all directions;
every other row leaves the noise to the residuals."""

PARTS = (slice(0, 3), slice(3, 6))
TO_SHOW = (float(np.degrees(1.0)), 1.0 / MM)
"""Degrees in a radian, millimetres in a metre."""

Settings = Mapping[str, Any]


def row_names(methods: Iterable[str] | None = None) -> list[str]:
    """Names of the rows of a data set: every method, ``ml`` three times."""
    names = list(METHODS if methods is None else methods)
    return [RATIO, ON_B, *names] if "ml" in names else names


def given_noise(settings: Settings) -> PairNoise:
    """Noise on B in the ratio of the settings."""
    return PairNoise(float(np.radians(settings["ratio"]["deg"])), settings["ratio"]["mm"] * MM)


def solved(sides: Sides, name: str, settings: Settings) -> RobotWorldResult:
    """One solution. Of the noise given only the ratio counts: its size is as the residuals say."""
    if name == ON_B:
        return solve(*sides, "ml", "B")
    if name != RATIO:
        return solve(*sides, name)
    noise = given_noise(settings)
    first = solve(*sides, "ml", noise)
    if first.chi2 is None:
        raise RuntimeError(f"ml was not solved: {first.message}")
    larger = float(np.sqrt(first.chi2 / first.freedom))
    return solve(*sides, "ml", PairNoise(larger * noise.rotation_rad, larger * noise.translation_m))


def row_of(name: str, result: RobotWorldResult, sigma: bool = True) -> dict[str, Any]:
    """Figures of one solution: rms and medians over all pairs, those left out included."""
    noise = result.noise
    row: dict[str, Any] = {
        "method": name,
        "status": result.status,
        "pairs": len(result.used),
        "left_out": int((~result.used).sum()),
    }
    of = {"": result.residuals, "out_": result.left_out_residuals}
    for which, error in of.items():
        for unit, part, scale in zip(("deg", "mm"), PARTS, TO_SHOW, strict=True):
            size = scale * np.linalg.norm(error[:, part], axis=1)
            row[f"{which}rms_{unit}"] = float(np.sqrt(np.mean(size**2)))
            row[f"{which}median_{unit}"] = float(np.median(size))
    known = isinstance(noise, PairNoise)
    row["noise_deg"] = float(np.degrees(noise.rotation_rad)) if known else None
    row["noise_mm"] = noise.translation_m / MM if known else None
    row["noise_made"] = result.noise_made
    if sigma:
        for letter, at in (("X", 0), ("Z", 6)):
            for unit, first, scale in zip(("deg", "mm"), (0, 3), TO_SHOW, strict=True):
                own = slice(at + first, at + first + 3)
                row[f"sigma_{letter}_{unit}"] = _largest(result.covariance, own, scale)
    return row


def _largest(covariance: FloatArray | None, own: slice, scale: float) -> float | None:
    """Standard deviation in the direction that is known least."""
    if covariance is None:
        return None
    return float(scale * np.sqrt(np.linalg.eigvalsh(covariance[own, own])[-1]))


def proof(sides: Sides, result: RobotWorldResult) -> dict[str, Any]:
    """What the certificate says of a solution of ``ml``, with the noise of B that it estimated."""
    noise = result.noise
    if not isinstance(noise, PairNoise):
        raise RuntimeError(f"no noise to weigh by: {result.message}")
    found = certify(*sides, result.X, result.Z, noise)
    return {
        "status": found.status,
        "unique": found.unique,
        "chi2": found.cost,
        "bound": found.bound,
        "relative_gap": found.relative_gap,
        "smallest_eigenvalue": found.smallest_eigenvalue,
        "moved_deg": float(np.degrees(found.rotation_moved_rad.max())),
        "moved_mm": float(found.translation_moved_m.max() / MM),
    }


def against_images(
    result: RobotWorldResult, reference: tuple[FloatArray, FloatArray]
) -> dict[str, Any]:
    """Differences [deg, mm] of X and Z to those from the images, with their deviations beside.

    In the axes of the frame that the transform maps to: target for X, camera for Z.
    """
    if result.covariance is None:
        raise RuntimeError(f"no covariance: {result.message}")
    error = np.concatenate(
        [
            difference(found, given)
            for found, given in zip((result.X, result.Z), reference, strict=True)
        ]
    )
    sigma = np.sqrt(np.diag(result.covariance))
    scale = np.tile(np.repeat(TO_SHOW, 3), 2)
    names = [
        f"{letter} {what} {axis}" for letter in "XZ" for what in ("turn", "shift") for axis in "xyz"
    ]
    rows = {
        name: {"difference": float(d), "sigma": float(s)}
        for name, d, s in zip(names, scale * error, scale * sigma, strict=True)
    }
    chi2 = float(error @ np.linalg.solve(result.covariance, error))
    return {"components": rows, "chi2": chi2}


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
