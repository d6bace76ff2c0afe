"""Choices of poses by each criterion and by lot, and what a calibration from them is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from irb_bench import Bench

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection import Selection, largest_deviation, mean_deviation, select
from studies.choices import by_lot, spread

D_OF_ARM = "D of the arm"


@dataclass(frozen=True, eq=False)
class Everything:
    """What all configurations together are worth, ``(36,)`` [m²] each.

    Attributes
    ----------
    left_out, check_left_out : array
        Of each configuration, from a fit to the other 35: the points, the check points.
    in_sample : array
        From the fit to all 36.
    """

    left_out: FloatArray
    check_left_out: FloatArray
    in_sample: FloatArray


def everything(bench: Bench) -> Everything:
    """All 36, and each left out."""
    others = ~np.eye(bench.count, dtype=bool)
    x = bench.fit(others)
    whole = bench.fit(np.ones((1, bench.count), dtype=bool))
    return Everything(
        np.diag(bench.squares(x)),
        np.diag(bench.check_squares(x, others)),
        bench.squares(whole)[0],
    )


def chosen_by(bench: Bench, n: int, criterion: str) -> Selection:
    """n configurations by a criterion, from nominal blocks alone."""
    given: Any = criterion
    interest: Sequence[int] | None = None
    if criterion == "I":
        given = mean_deviation(bench.functions)
    elif criterion == "G":
        given = largest_deviation(bench.functions)
    elif criterion == D_OF_ARM:
        given, interest = "D", bench.arm
    elif criterion in ("A", "E"):
        interest = bench.arm
    known = bench.known if len(bench.known) else None
    return select(bench.blocks, n, given, known=known, interest=interest, names=bench.model.names)


def figures(bench: Bench, all36: Everything, chosen: BoolArray) -> dict[str, FloatArray]:
    """What fits to the chosen ``(T, 36)`` leave at the poses not chosen, ``(T,)`` each [mm].

    Beside it stands what all 36 leave at the same poses: each predicted from the other 35, and in
    the fit that has seen it.
    """
    x = bench.fit(chosen)
    rest = ~chosen

    def rms_mm(squares: FloatArray) -> FloatArray:
        mean = (squares * rest).sum(axis=1) / rest.sum(axis=1)
        return np.asarray(1e3 * np.sqrt(mean))

    return {
        "error_mm": rms_mm(bench.squares(x)),
        "all_left_out_mm": rms_mm(all36.left_out),
        "all_in_sample_mm": rms_mm(all36.in_sample),
        "check_mm": rms_mm(bench.check_squares(x, chosen)),
        "check_all_left_out_mm": rms_mm(all36.check_left_out),
    }


def expected_mm(bench: Bench, chosen: IntArray) -> float:
    """Rms distance of new readings in all 36, of a fit to the chosen, by the noise model."""
    rows = np.concatenate([bench.blocks[chosen].reshape(-1, bench.model.p), bench.known])
    C = np.linalg.inv(rows.T @ rows)
    L = bench.functions
    spread = np.einsum("krp,pq,krq->k", L, C, L, optimize=True).mean()
    return float(1e3 * np.sqrt(bench.noise_m**2 + spread))


def row_of(
    bench: Bench, all36: Everything, n: int, criterion: str, lot: dict[str, FloatArray]
) -> dict[str, Any]:
    """Figures of the choice by one criterion, held against those by lot."""
    selection = chosen_by(bench, n, criterion)
    chosen = np.zeros((1, bench.count), dtype=bool)
    chosen[0, selection.indices] = True
    found = {name: float(value[0]) for name, value in figures(bench, all36, chosen).items()}
    row: dict[str, Any] = {
        "criterion": criterion,
        "poses": [int(i) + 1 for i in selection.indices],
        "efficiency": selection.efficiency,
        **found,
        "over_all_left_out": found["error_mm"] / found["all_left_out_mm"],
        "over_all_in_sample": found["error_mm"] / found["all_in_sample_mm"],
        "check_over_all": found["check_mm"] / found["check_all_left_out_mm"],
        "better_than": float(np.mean(lot["error_mm"] > found["error_mm"])),
        "better_than_over_all": float(
            np.mean(
                lot["error_mm"] / lot["all_left_out_mm"]
                > found["error_mm"] / found["all_left_out_mm"]
            )
        ),
        "expected_over_all": expected_mm(bench, selection.indices)
        / expected_mm(bench, np.arange(bench.count)),
    }
    if criterion == "I":
        best = np.hypot(1e3 * bench.noise_m, 1e3 * selection.bound)
        row["expected_bound"] = float(best / expected_mm(bench, np.arange(bench.count)))
    return row


def compare(
    bench: Bench,
    all36: Everything,
    n: int,
    criteria: Sequence[str],
    draws: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Choices of n by lot and by each criterion."""
    lot = figures(bench, all36, by_lot(bench.count, n, draws, rng))
    return {
        "n": n,
        "left_out_of_all_mm": float(1e3 * np.sqrt(all36.left_out.mean())),
        "by_lot": {
            "error_mm": spread(lot["error_mm"]),
            "over_all_left_out": spread(lot["error_mm"] / lot["all_left_out_mm"]),
            "check_mm": spread(lot["check_mm"]),
        },
        "chosen": [row_of(bench, all36, n, name, lot) for name in criteria],
    }
