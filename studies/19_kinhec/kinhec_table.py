"""What the rows of all sequences come to: errors, pairs of ours and theirs, intervals, clocks.

A sequence without an answer counts with an infinite error: whoever refuses what is difficult is
not to look better by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from calib.se3 import FloatArray
from studies.intervals import median_interval, wilson

from .kinhec_rows import ESTIMATED, ORACLE, OURS, OURS_SCALE, STREAMS, STREAMS_SCALE, WITHIN

EVERY_OURS = (OURS, OURS_SCALE, STREAMS, STREAMS_SCALE)
FIGURES = ("X_deg", "X_mm", "Y_deg", "Y_mm")
TRACKS = (
    "noise", "motion", "temporal", "outliers", "monocular", "robot_error", "pnp", "mixed",
)  # fmt: skip
"""In the order of the benchmark."""

_FAR = 4.0
"""Error over its sigma that chance does not bring."""

Rows = list[dict[str, Any]]


def setting_of(track: str, clock: str) -> str:
    """The name of a part of the tables."""
    return track if clock == ORACLE else f"{track}, clock estimated"


def settings(rows: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Tracks by the true clock, then sequences with clocks of their own by the estimated one.

    ``mixed`` has both kinds of sequences: by the true clock all of them stand together.
    """
    for clock in (ORACLE, ESTIMATED):
        for track in TRACKS:
            own = rows[(rows["track"] == track) & (rows["clock"] == clock)]
            if len(own):
                yield setting_of(track, clock), track, own


def shown_ours(setting: str, track: str) -> str:
    """The one of ours that a user would take: of both streams, and with the scale of monocular."""
    names = (STREAMS, STREAMS_SCALE) if setting != track else (OURS, OURS_SCALE)
    return names[track == "monocular"]


def median_of(values: FloatArray) -> dict[str, float]:
    """Median of errors with its 95 % interval, and their 90 % quantile; infinite ones count."""
    low, high = median_interval(values)
    return {
        "": _quantile(values, 0.5),
        "_low": low,
        "_high": high,
        "_90": _quantile(values, 0.9),
    }


def _quantile(values: FloatArray, part: float) -> float:
    """Linear between neighbours, as of numpy, where both are finite."""
    ordered = np.sort(values)
    at = part * (len(ordered) - 1)
    pair = ordered[[int(np.floor(at)), int(np.ceil(at))]]
    return float(pair[0] + (at % 1.0) * (pair[1] - pair[0])) if np.isfinite(pair).all() else np.inf


def errors(rows: pd.DataFrame) -> Rows:
    """A row for each setting and solver."""
    found = []
    for setting, _, of in settings(rows):
        for solver, own in of.groupby("solver", sort=False):
            row: dict[str, Any] = {"setting": setting, "solver": solver, "sequences": len(own)}
            row["without_answer"] = int((~own["answered"]).sum())
            for name in FIGURES:
                values = own[name].to_numpy(float)
                if not np.isnan(values).any():
                    row |= {name + key: value for key, value in median_of(values).items()}
            row["cpu_ms"] = float(own["cpu_ms"].median())
            if "cpu_all_ms" in own and own["cpu_all_ms"].notna().any():
                row["cpu_all_ms"] = float(own["cpu_all_ms"].median())
            found.append(row)
    return found


def compared(rows: pd.DataFrame) -> Rows:
    """Ours against the best baseline, on the sequences that both have an answer to.

    Best is the baseline whose median error of a figure is smallest, looked up afterwards: of
    eleven one is the luckiest. Once over all of our answers, once over those that are ok.
    """
    found = []
    for setting, track, of in settings(rows):
        ours = of[of["solver"] == shown_ours(setting, track)].set_index("sequence")
        others = of[~of["solver"].isin(EVERY_OURS)]
        for name in FIGURES:
            medians = others.groupby("solver", sort=False)[name].median().dropna()
            best = str(medians.idxmin())
            theirs = others[others["solver"] == best].set_index("sequence")
            for which in ("all answers", "ok"):
                own = ours[ours["answered"] & ((ours["status"] == "ok") | (which != "ok"))]
                a = own[name].to_numpy(float)
                b = theirs.loc[own.index, name].to_numpy(float)
                kept = np.isfinite(a) & np.isfinite(b)
                if kept.sum() < 2:
                    continue
                ratio = b[kept] / np.maximum(a[kept], np.finfo(float).tiny)
                low, high = median_interval(ratio)
                nearer = wilson(ratio > 1.0)
                found.append(
                    {
                        "setting": setting, "of": which, "figure": name, "best": best,
                        "sequences": int(kept.sum()), "ratio": float(np.median(ratio)),
                        "ratio_low": low, "ratio_high": high, "nearer": nearer["share"],
                        "nearer_low": nearer["low"], "nearer_high": nearer["high"],
                        "ours": float(np.median(a[kept])), "theirs": float(np.median(b[kept])),
                        "ours_90": _quantile(a[kept], 0.9), "theirs_90": _quantile(b[kept], 0.9),
                    }
                )  # fmt: skip
    return found


def stated(rows: pd.DataFrame) -> Rows:
    """What ours says of its own answers: status, intervals, and where both are wrong."""
    found = []
    for setting, _, of in settings(rows):
        for solver, own in of[of["solver"].isin(EVERY_OURS)].groupby("solver", sort=False):
            ok = own[own["status"] == "ok"]
            far = ok[ok["farthest"] > _FAR]
            row: dict[str, Any] = {
                "setting": setting, "solver": solver, "sequences": len(own), "ok": len(ok),
                "other_status": int(own["answered"].sum()) - len(ok),
                "refused": int((~own["answered"]).sum()),
            }  # fmt: skip
            for frame in "XY":
                row |= _covered(ok[f"within_{frame}"].dropna(), f"covered_{frame}")
            row["ok_beyond_4_sigma"] = len(far)
            row["which"] = " ".join(far["sequence"])
            row["refusals"] = " ".join(own[~own["answered"]]["sequence"])
            found.append(row)
    return found


def _covered(within: pd.Series, name: str) -> dict[str, Any]:
    """Share of components in their intervals; its own interval from the sequences, not these.

    Components of a sequence are alike: the interval is that of the mean of independent sequences.
    """
    if len(within) < 2:
        return dict.fromkeys((name, f"{name}_low", f"{name}_high"))
    share = within.to_numpy(float) / 6.0
    reach = WITHIN * float(share.std(ddof=1)) / np.sqrt(len(share))
    mean = float(share.mean())
    return {
        name: mean,
        f"{name}_low": max(mean - reach, 0.0),
        f"{name}_high": min(mean + reach, 1.0),
    }


def clocks(rows: pd.DataFrame) -> Rows:
    """Errors of the offset of the clocks, in ms, and how often our interval holds it."""
    found = []
    for setting, _, of in settings(rows[rows["clock"] == ESTIMATED]):
        first = of[of["solver"] == OURS]
        kinds = {"KinHEC, correlation of angular speeds": first}
        kinds |= {name: of[of["solver"] == name] for name in (STREAMS, STREAMS_SCALE)}
        for name, own in kinds.items():
            if not len(own):
                continue
            values = own["offset_ms"].fillna(np.inf).to_numpy(float)
            row: dict[str, Any] = {"setting": setting, "by": name, "sequences": len(own)}
            row["without_answer"] = int(np.isinf(values).sum())
            row |= {f"ms{key}": value for key, value in median_of(values).items()}
            ok = own[own["status"] == "ok"]["offset_in_sigma"].dropna()
            if name != next(iter(kinds)) and len(ok):
                held = wilson((ok < WITHIN).to_numpy())
                row |= {"ok": len(ok), "covered": held["share"]}
                row |= {"covered_low": held["low"], "covered_high": held["high"]}
                row["farthest"] = float(ok.max())
            found.append(row)
    return found
