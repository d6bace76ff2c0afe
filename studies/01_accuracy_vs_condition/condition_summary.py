"""What the trials come to: a row for each pose set, and how errors follow the condition number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from condition_trials import OFFSET, TOOL
from scipy.stats import linregress, spearmanr
from scipy.stats import norm as normal
from scipy.stats import t as student

from calib.se3 import FloatArray
from posedesign.simulation.accuracy_study import spread_interval

QUANTITIES = ("x_deg", "x_mm", "z_deg", "z_mm")
"""Rotation and translation of X, the camera on the flange, and of Z, the target in the base."""

_MOST_REFUSED = 0.5
"""Part of the answers that may be missing for a median to be one of the rest."""


def summary(trials: pd.DataFrame, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each pose set: spread of the offset, medians and 5 to 95 % of errors."""
    rows = []
    for (preset, threshold), part in trials.groupby(["preset", "threshold"], sort=False):
        first = part.iloc[0]
        row: dict[str, Any] = {"preset": preset, "threshold": threshold}
        row |= {key: first[key].item() for key in ("c_g", "d_deg", "poses")}
        row |= {"trials": len(part), "predicted_deg": first[f"predicted_{OFFSET}"].item()}
        offset = part[OFFSET].to_numpy()
        spread = float(np.nanstd(offset, ddof=1))
        low, high = spread_interval(spread, int(np.isfinite(offset).sum()))
        row |= {"spread_deg": spread, "spread_low_deg": low, "spread_high_deg": high}
        row |= _quantiles(TOOL, part[TOOL].to_numpy())
        for solver in solvers:
            refused = float(np.isnan(part[f"x_deg {solver}"]).mean())
            row[f"refused {solver}"] = refused
            for quantity in QUANTITIES:
                name = f"{quantity} {solver}"
                row |= _quantiles(name, part[name].to_numpy(), refused)
        rows.append(row)
    return rows


def _quantiles(name: str, values: FloatArray, refused: float = 0.0) -> dict[str, float | None]:
    good = values[np.isfinite(values)]
    if refused > _MOST_REFUSED or not len(good):
        return {name: None, f"{name} p5": None, f"{name} p95": None}
    low, middle, high = np.quantile(good, [0.05, 0.5, 0.95])
    return {name: float(middle), f"{name} p5": float(low), f"{name} p95": float(high)}


def relations(rows: pd.DataFrame, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """How each error follows C_G on each arm: slope of the logarithms and rank correlation.

    Both with 95 % intervals over the pose sets: by Student's t for the slope, by Fisher's z with
    the variance of [BonettWright2000]_ for the rank correlation.

    References
    ----------
    .. [BonettWright2000] D. G. Bonett, T. A. Wright, Sample size requirements for estimating
       Pearson, Kendall and Spearman correlations, Psychometrika 65.
    """
    found = []
    for preset, part in rows.groupby("preset", sort=False):
        for estimator, quantity, column in _columns(solvers):
            c_g, error = part["c_g"].to_numpy(), part[column].to_numpy(dtype=float)
            good = np.isfinite(error)
            if good.sum() < 4:
                continue
            line = linregress(np.log10(c_g[good]), np.log10(error[good]))
            half = float(student.ppf(0.975, good.sum() - 2) * line.stderr)
            rank = float(spearmanr(c_g[good], error[good]).statistic)
            low, high = _rank_interval(rank, int(good.sum()))
            found.append(
                {
                    "preset": preset,
                    "estimator": estimator,
                    "quantity": quantity,
                    "sets": int(good.sum()),
                    "slope": float(line.slope),
                    "slope_low": float(line.slope) - half,
                    "slope_high": float(line.slope) + half,
                    "rank": rank,
                    "rank_low": low,
                    "rank_high": high,
                    "first": float(error[good][0]),
                    "last": float(error[good][-1]),
                }
            )
    return found


def _columns(solvers: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    yield "identification", "spread of the offset [deg]", "spread_deg"
    yield "identification", "tool point elsewhere [mm]", TOOL
    for solver in solvers:
        yield solver, "X rotation [deg]", f"x_deg {solver}"
        yield solver, "X translation [mm]", f"x_mm {solver}"


def _rank_interval(rank: float, count: int) -> tuple[float, float]:
    if abs(rank) >= 1.0 or count < 4:
        return rank, rank  # Fisher's z has no interval there
    half = normal.ppf(0.975) * np.sqrt((1.0 + rank**2 / 2.0) / (count - 3))
    low, high = np.tanh(np.arctanh(rank) + np.array([-half, half]))
    return float(low), float(high)
