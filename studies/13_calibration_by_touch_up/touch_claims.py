"""What the figures say of each claim of the paper, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import f as f_distribution

from calib.se3 import FloatArray
from studies.intervals import rank_correlation, share

from .touch_bench import PoseSet
from .touch_plate import ACROSS, LINE, OF_MANY_ARMS, PAPER, WEIGHTED, Identified

Found = Sequence[tuple[PoseSet, list[Identified]]]

PAPERS_SETS = 4
"""Pose sets in the figures of the paper."""

_CHOICES = 4000
"""Random choices of four pose sets: shares to 0.8 %."""

HALF = 0.5


def deviations(found: Found, name: str, size: int) -> FloatArray:
    """Standard deviations ``(K, S)`` [deg] of groups of ``size`` data sets, for each pose set."""
    offsets = [e.offset_deg for _, them in found for e in them if e.estimator.name == name]
    count = min(len(o) for o in offsets) // size
    groups = np.array([o[: count * size].reshape(count, size) for o in offsets])
    return np.asarray(groups.std(axis=-1, ddof=1).T)


def falls(found: Found, name: str, size: int, rng: np.random.Generator) -> dict[str, float]:
    """Whether the variation falls with C_G: by rank over all pose sets, and over four of them.

    An experimenter has one group of data sets: the interval is that over the groups.
    """
    c_g = np.array([poses.c_g for poses, _ in found])
    std = deviations(found, name, size)
    rho = rank_correlation(c_g, std)
    order = np.argsort(-c_g)
    four = np.sort(rng.permuted(np.tile(order.argsort(), (_CHOICES, 1)), axis=1)[:, :PAPERS_SETS])
    group = rng.integers(len(std), size=(_CHOICES, 1))
    in_order = std[:, order][group, four]
    return {
        "rho": float(rho[0]),
        **_spread_of(rho),
        "four_in_order": float((np.diff(in_order) < 0.0).all(axis=1).mean()),
        "four_ends_in_order": float((in_order[:, -1] < in_order[:, 0]).mean()),
    }


def against(found: Found, first: str, second: str, size: int) -> list[dict[str, float]]:
    """Variation of one estimator over that of another, for each pose set, with 95 % intervals.

    By Fisher's distribution, which makes them too wide where both are from the same touch-ups; and
    in which part of groups of ``size`` the second varies less.
    """
    ones, others = (deviations(found, name, size) for name in (first, second))
    count = min(len(ones), len(others))
    less = (others[:count] < ones[:count]).mean(axis=0)
    table = []
    for k, (poses, them) in enumerate(found):
        offsets = {each.estimator.name: each.offset_deg for each in them}
        a, b = offsets[first], offsets[second]
        ratio = float(a.std(ddof=1) / b.std(ddof=1))
        ends = np.sqrt(f_distribution.ppf([0.975, 0.025], len(a) - 1, len(b) - 1))
        low, high = (float(ratio / end) for end in ends)
        row = {"d_deg": poses.d_deg, "c_g": poses.c_g, "ratio": ratio, "low": low, "high": high}
        table.append(row | {"second_less_in_groups": float(less[k])})
    return table


def variation(found: Found, size: int, seed: int) -> dict[str, Any]:
    """Claims of Figures 9 and 10."""
    rng = np.random.default_rng([seed, 21])
    names = [each.estimator.name for each in found[0][1]]
    return {
        "falls": {name: falls(found, name, size, rng) for name in names},
        "view line over touch-up": against(found, LINE.name, PAPER.name, size),
        "view line over touch-up, weighted": against(found, LINE.name, WEIGHTED.name, size),
        "size left out over touch-up, weighted": against(found, ACROSS.name, WEIGHTED.name, size),
    }


def plate(table: Mapping[str, Any]) -> dict[str, Any]:
    """Claims of Figure 11, of one arm; a part for each estimator."""
    said = {}
    for name in dict.fromkeys(row["estimator"] for row in table["rows"]):
        rows = [row for row in table["rows"] if row["estimator"] == name]
        c_g, error = (np.array([row[key] for row in rows]) for key in ("c_g", "worst_mm"))
        best, last = int(error.argmin()), int(c_g.argmin())
        said[name] = {
            "rho": float(rank_correlation(c_g, error[None])[0]),
            "ratio_at_smallest_c_g": float(rows[last]["ratio"]),
            "ratio_at_largest_c_g": float(rows[int(c_g.argmax())]["ratio"]),
            "best_ratio": float(rows[best]["ratio"]),
            "best_d_deg": float(rows[best]["d_deg"]),
            "sets_below_half": int(sum(row["ratio"] < HALF for row in rows)),
            "sets": len(rows),
        }
    return said


def many_arms(ratios: FloatArray, sets: Sequence[PoseSet]) -> dict[str, Any]:
    """Claims of Figure 11 over arms drawn at random, of ratios ``(A, S, E)`` after over before."""
    c_g = np.array([poses.c_g for poses in sets])
    last = int(c_g.argmin())
    said: dict[str, Any] = {"count": len(ratios)}
    for e, estimator in enumerate(OF_MANY_ARMS):
        own = ratios[..., e]
        rho = rank_correlation(c_g, own)
        rows = []
        for k, poses in enumerate(sets):
            low, middle, high = np.quantile(own[:, k], [0.1, 0.5, 0.9])
            row = {"d_deg": poses.d_deg, "c_g": poses.c_g}
            row |= {"ratio_low": low, "ratio": middle, "ratio_high": high}
            row["below_half"] = share(own[:, k] < HALF)
            rows.append(row | {"worse_than_before": share(own[:, k] > 1.0)})
        said[estimator.name] = {
            "rows": rows,
            "smallest_c_g_is_best": share(own.argmin(axis=1) == last),
            "smallest_beats_largest_c_g": share(own[:, last] < own[:, int(c_g.argmax())]),
            **_spread_of(rho),
        }
    return said


def _spread_of(rho: FloatArray) -> dict[str, float]:
    low, middle, high = np.quantile(rho, [0.025, 0.5, 0.975])
    return {"rho_median": float(middle), "rho_low": float(low), "rho_high": float(high)}
