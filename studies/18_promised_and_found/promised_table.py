"""What was found of all arms, beside what the plans promised."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.se3 import FloatArray
from studies.intervals import wilson
from studies.tool_errors import RESAMPLES, RESAMPLING_SEED, interval
from studies.writing import Cell, span, table

from .promised_arms import EXCHANGE, GRID

if TYPE_CHECKING:
    import pandas as pd

EVERY = "all"

ARM = "preset", "population", "trial"
"""Columns that name an arm."""

Statistic = Callable[[FloatArray], FloatArray]
"""A figure of each sample ``(B, T) -> (B,)``."""


def rms(values: FloatArray) -> FloatArray:
    """Return root mean squares along the last axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=-1)))


def median(values: FloatArray) -> FloatArray:
    """Return medians along the last axis."""
    return np.asarray(np.median(values, axis=-1))


def summary(trials: pd.DataFrame, limits: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a row for each population and plan: of all presets together, then of each.

    Errors of all presets together are taken as ratios: over the promise of the preset's own plan,
    and over the root mean square of the preset's own grid.
    """
    both = trials.merge(limits, on=["preset", "population", "plan"], sort=False)
    grid = both[both["plan"] == GRID]
    own = grid.set_index([*ARM])[["work_mm", "box_mm"]]
    both = both.join(own.add_prefix("grid_"), on=[*ARM])
    squares = grid.assign(work_mm=grid["work_mm"] ** 2, box_mm=grid["box_mm"] ** 2)
    of_grid = squares.groupby([*ARM[:2]])[["work_mm", "box_mm"]].mean() ** 0.5
    both = both.join(of_grid.add_prefix("grid_rms_"), on=[*ARM[:2]])
    groups = both.groupby(["population", "plan"], sort=False)
    rows = [_row({"preset": EVERY}, part) for _, part in groups]
    groups = both.groupby(["preset", "population", "plan"], sort=False)
    return rows + [_row({"preset": preset}, part) for (preset, *_), part in groups]


def _row(head: dict[str, Any], of: pd.DataFrame) -> dict[str, Any]:
    first, told = of.iloc[0], of[~of["refused"].astype(bool)]
    row: dict[str, Any] = {**head, "population": first["population"], "plan": first["plan"]}
    row |= {"arms": len(of), "refused": len(of) - len(told)}
    found = told["work_mm"].to_numpy()
    if head["preset"] != EVERY:
        for name in ("", "_low", "_high", "_median"):
            row[f"promised{name}_mm"] = float(first[f"promised{name}_mm"])
        row |= {"own_mm": float(first["own_mm"]), "known_mm": float(first["known_mm"])}
        row |= _with_interval("found_mm", found, rms) | _with_interval("median_mm", found, median)
        row |= _with_interval("box_mm", told["box_mm"].to_numpy(), rms)
        row["nominal_mm"] = float(rms(told["nominal_mm"].to_numpy()))
    row |= _with_interval("over_promised", found / told["promised_mm"].to_numpy(), rms)
    row |= _with_interval("over_known", found / told["known_mm"].to_numpy(), rms)
    of_median = found / told["promised_median_mm"].to_numpy()
    row |= _with_interval("over_median", of_median, median)
    row |= _with_interval("over_expected", found / told["expected_mm"].to_numpy(), median)
    low, high = (told[f"promised_{end}_mm"].to_numpy() for end in ("low", "high"))
    row |= _share("inside", (low <= found) & (found <= high)) | _share("above", found > high)
    both = told[np.isfinite(told["grid_work_mm"])]
    for name, where in (("over_grid", "work_mm"), ("box_over_grid", "box_mm")):
        size = both[f"grid_rms_{where}"].to_numpy()
        own, others = (both[column].to_numpy() / size for column in (where, f"grid_{where}"))
        row |= _paired(name, own, others)
    row |= _share("better", (both["work_mm"] < both["grid_work_mm"]).to_numpy())
    return row


def _with_interval(name: str, values: FloatArray, of: Statistic) -> dict[str, float | None]:
    """A figure of values ``(T,)`` with its bootstrap interval, of those that are there."""
    known = values[np.isfinite(values)]
    if not len(known):
        return dict.fromkeys((name, *_ends(name)))
    drawn = known[_resampled(len(known))]
    return {name: float(of(known)), **dict(zip(_ends(name), interval(of(drawn)), strict=True))}


def _paired(name: str, values: FloatArray, others: FloatArray) -> dict[str, float | None]:
    """Root mean square over that of others ``(T,)``, arms being drawn again with both."""
    rows = _resampled(len(values))
    ends = interval(rms(values[rows]) / rms(others[rows]))
    return {name: float(rms(values) / rms(others)), **dict(zip(_ends(name), ends, strict=True))}


def _resampled(count: int) -> np.ndarray:
    rng = np.random.default_rng(RESAMPLING_SEED)
    return rng.integers(count, size=(RESAMPLES, count))


def _ends(name: str) -> tuple[str, str]:
    """Names of the ends of an interval: the unit comes last."""
    stem, unit = name.removesuffix("_mm"), "_mm" if name.endswith("_mm") else ""
    return f"{stem}_low{unit}", f"{stem}_high{unit}"


def _share(name: str, of: np.ndarray) -> dict[str, Any]:
    said = wilson(np.asarray(of, dtype=bool))
    return {name: said["share"], f"{name}_low": said["low"], f"{name}_high": said["high"]}


def floors(limits: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return what can be reached at all, one row a preset and population.

    By whoever knows the sizes of errors: after the grid, after the exchange, with the best choice
    of as many poses (its bound), and with the whole pool measured.
    """
    rows = []
    for one in limits:
        if one["plan"] != GRID:
            continue
        key = one["preset"], one["population"]
        by = {r["plan"]: r["known_mm"] for r in limits if (r["preset"], r["population"]) == key}
        row = {name: one[name] for name in ("preset", "population", "pool", "floor_mm", "bound_mm")}
        row |= {"grid_mm": by[GRID], "exchange_mm": by[EXCHANGE]}
        row["floor_over_grid"] = one["floor_mm"] / by[GRID]
        row["bound_over_grid"] = one["bound_mm"] / by[GRID]
        row["exchange_over_grid"] = by[EXCHANGE] / by[GRID]
        rows.append(row)
    return rows


def markdown(said: Mapping[str, Any]) -> str:
    """Return the tables that people read."""
    every = [row for row in said["rows"] if row["preset"] == EVERY]
    each = [row for row in said["rows"] if row["preset"] != EVERY]
    return "\n\n".join(
        table(rows, cells)
        for rows, cells in ((every, OF_ALL), (each, OF_EACH), (said["floors"], OF_FLOORS))
    )


_SHARES: Mapping[str, Cell] = {
    "inside the range": "{inside:p} % ({inside_low:p} to {inside_high:p})",
    "over grid": span(".2f", "over_grid"),
    "over grid, in the box": "{box_over_grid:.2f}",
    "better than grid": "{better:p} % ({better_low:p} to {better_high:p})",
}
_RATIOS: Mapping[str, Cell] = {
    "found over promised": span(".2f", "over_promised"),
    "medians": span(".2f", "over_median"),
}
OF_ALL: Mapping[str, Cell] = {
    "arms": "{population}",
    "plan": "{plan}",
    "number": "{arms}",
    "refused": "{refused}",
    **_RATIOS,
    "over known sizes": span(".2f", "over_known"),
    "above the range": "{above:p} %",
    **_SHARES,
    "found over expected": "{over_expected:.2f}",
}
OF_EACH: Mapping[str, Cell] = {
    "preset": "{preset}",
    "arms": "{population}",
    "plan": "{plan}",
    "promised": "{promised_mm:s.3f}",
    "80 % range": "{promised_low_mm:s.3f} to {promised_high_mm:s.3f}",
    "found": span("s.3f", "found_mm"),
    "median": span("s.3f", "median_mm"),
    "over the box": "{box_mm:s.3f}",
    **_RATIOS,
    "over known sizes": "{over_known:.2f}",
    **_SHARES,
}
OF_FLOORS: Mapping[str, Cell] = {
    "preset": "{preset}",
    "arms": "{population}",
    "grid": "{grid_mm:s.4f}",
    "exchange": "{exchange_mm:s.4f}",
    "bound of as many": "{bound_mm:s.4f}",
    "all of the pool": "{floor_mm:s.4f}",
    "exchange over grid": "{exchange_over_grid:.2f}",
    "bound over grid": "{bound_over_grid:.2f}",
    "pool over grid": "{floor_over_grid:.2f}",
}
"""Columns of the tables and their cells."""
