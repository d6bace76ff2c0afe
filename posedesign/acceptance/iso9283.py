"""Pose and distance characteristics of ISO 9283, each with an interval: arrays only.

With attained positions (x_j, y_j, z_j), j = 1 .. n, at a pose commanded as (x_c, y_c, z_c), their
mean (the barycentre) and S the standard deviation with n - 1, ISO 9283:1998 defines

    AP_p = |mean - commanded|                                                      (7.2.1)
    RP_l = mean(l) + 3 S_l,  l_j = |attained_j - mean|                             (7.2.2)
    RP_a = 3 S_a of an angle a                                                     (7.2.2)
    AD_p = mean(D) - D_c,    D_j = |P1_j - P2_j|, D_c = |P1_c - P2_c|              (7.3.2)
    RD   = 3 S_D                                                                   (7.3.3)

The standard has no intervals. Those here hold what would be found with very many cycles with a
chance of 95 %, for attained positions that scatter as a normal distribution: of AD Student's, of
RD and RP_a by chi-square, both exact. Of AP Student's by the scatter along the deviation, its lower
end at zero unless Hotelling's test tells the deviation from none: a length is never below zero, and
found too large where there is hardly any. Of RP_l the quantiles of samples drawn from the normal
distribution found (parametric bootstrap), as factors of what is found: they are pivotal but for the
shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from calib.errors import InputError
from calib.se3 import FloatArray

CHANCE = 0.95
"""Of an interval."""

_FAR = 4.0
"""Deviation over the half width of its interval from which on the scatter along it counts, and not
the largest: nearer to none, its own direction is a matter of chance (coverage was 85 % there)."""

_DRAWS = 2000
"""Samples of the bootstrap: ends to some two per cent of the width."""


@dataclass(frozen=True)
class Figure:
    """A characteristic and the ends of its interval; NaN where it cannot be told."""

    value: float
    low: float = np.nan
    high: float = np.nan


@dataclass(frozen=True, eq=False)
class PoseCharacteristics:
    """Accuracy and repeatability at a pose."""

    cycles: int  # n
    accuracy: Figure  # AP_p [m]
    deviation: FloatArray  # (3,): AP_x, AP_y, AP_z [m]
    repeatability: Figure  # RP_l [m]; NaN from a single cycle
    angles: FloatArray | None = None
    """(3,): AP_a, AP_b, AP_c [rad]; None where no orientation was measured."""
    angle_repeatability: tuple[Figure, ...] = ()
    """RP_a, RP_b, RP_c [rad]; empty where no orientation was measured."""


def pose_characteristics(
    deviations: FloatArray, angles: FloatArray | None = None
) -> PoseCharacteristics:
    """AP and RP of a pose.

    ``deviations`` (n, 3): attained less commanded position of each cycle [m]. ``angles`` (n, 3):
    the same of the orientation [rad], by angles about three axes.
    """
    deviations = _checked(deviations)
    count = len(deviations)
    about: tuple[Figure, ...] = ()
    if angles is not None:
        angles = _checked(angles)
        about = tuple(_three_sigma(column) for column in angles.T)
    return PoseCharacteristics(
        count,
        _accuracy(deviations),
        np.asarray(deviations.mean(axis=0)),
        _repeatability(deviations),
        None if angles is None else np.asarray(angles.mean(axis=0)),
        about,
    )


@dataclass(frozen=True)
class DistanceCharacteristics:
    """Accuracy AD_p (with its sign) and repeatability RD of a distance [m]."""

    cycles: int
    commanded_m: float
    accuracy: Figure
    repeatability: Figure


def distance_characteristics(attained: FloatArray, commanded: float) -> DistanceCharacteristics:
    """AD and RD of the distances attained in each cycle ``(n,)`` [m]."""
    D = np.asarray(attained, dtype=float)
    found = float(D.mean()) - commanded
    half = np.nan
    if len(D) > 1:
        half = float(stats.t.ppf((1 + CHANCE) / 2, len(D) - 1) * D.std(ddof=1) / np.sqrt(len(D)))
    accuracy = Figure(found, found - half, found + half)
    return DistanceCharacteristics(len(D), commanded, accuracy, _three_sigma(D))


def _checked(rows: FloatArray) -> FloatArray:
    rows = np.asarray(rows, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or not np.isfinite(rows).all():
        raise InputError(
            f"deviations of shape {rows.shape}: one row of three numbers a cycle", name="deviations"
        )
    return rows


def _accuracy(deviations: FloatArray) -> Figure:
    n, mean = len(deviations), deviations.mean(axis=0)
    found = float(np.linalg.norm(mean))
    if n < 2 or found == 0.0:
        return Figure(found)
    C = np.cov(deviations.T) / n
    largest, t = float(np.linalg.eigvalsh(C)[-1]), float(stats.t.ppf((1 + CHANCE) / 2, n - 1))
    half = t * np.sqrt(max(largest, 0.0))
    if found > _FAR * half:  # else the direction is not known well enough to go by
        half = t * float(np.sqrt((mean / found) @ C @ (mean / found)))
    seen = n > 3 and half < found
    if seen and np.linalg.cond(C) < 1e12:
        # Hotelling's T² (n - 3) / (3 (n - 1)) is of F(3, n - 3): Anderson, Multivariate Statistical
        # Analysis, 3rd ed., 5.2
        T2 = float(mean @ np.linalg.solve(C, mean))
        seen = bool(T2 * (n - 3) / (3 * (n - 1)) > stats.f.ppf(CHANCE, 3, n - 3))
    return Figure(found, found - half if seen else 0.0, found + half)


def _repeatability(deviations: FloatArray) -> Figure:
    n = len(deviations)
    if n < 2:
        return Figure(np.nan)
    found = float(_rp(deviations))
    C = np.cov(deviations.T)
    values, vectors = np.linalg.eigh(C)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng = np.random.default_rng(0)
    many = max(100 * n, 10_000)
    true = float(_rp(rng.standard_normal((many, 3)) @ root.T))
    drawn = _rp(rng.standard_normal((_DRAWS, n, 3)) @ root.T)
    low, high = np.quantile(drawn, [(1 - CHANCE) / 2, (1 + CHANCE) / 2])
    if found == 0.0:
        return Figure(found, 0.0, 0.0)
    return Figure(found, found * true / float(high), found * true / float(low))


def _rp(attained: FloatArray) -> FloatArray:
    """RP_l ``(...)`` of samples ``(..., n, 3)``."""
    far = np.linalg.norm(attained - attained.mean(axis=-2, keepdims=True), axis=-1)
    return np.asarray(far.mean(axis=-1) + 3.0 * far.std(axis=-1, ddof=1))


def _three_sigma(values: FloatArray) -> Figure:
    n = len(values)
    if n < 2:
        return Figure(np.nan)
    found = 3.0 * float(values.std(ddof=1))
    ends = stats.chi2.ppf([(1 + CHANCE) / 2, (1 - CHANCE) / 2], n - 1)
    low, high = found * np.sqrt((n - 1) / ends)
    return Figure(found, float(low), float(high))
