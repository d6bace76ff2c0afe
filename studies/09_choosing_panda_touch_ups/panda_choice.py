"""Choices of so many touch-ups at each socket, by each criterion and by lot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from panda_bench import Bench

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.selection import (
    Criterion,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    select,
)
from posedesign.selection.candidates import Candidates
from studies.choices import by_lot, spread

WITHOUT_BOUND = ("C_G", "cond_2")
"""Criteria whose relaxation takes minutes with so many parameters: no efficiency is proven."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Touch-ups chosen ``(K,)``, and the part of information that they are proven to have."""

    rows: IntArray
    efficiency: float


def criterion_of(bench: Bench, name: str, count: int) -> Criterion:
    """A criterion by the name that the study has for it."""
    if name == "I at the site":
        return mean_deviation(bench.at_the_site)
    if name == "G at the site":
        return largest_deviation(bench.at_the_site)
    if name == "I at the sockets":
        return mean_deviation(bench.at_the_sockets)
    own = name.removesuffix(" of the arm")
    interest = bench.arm if own != name or name in ("A", "E") else None
    return criterion_by_name(own, bench.model.p, count, interest)


def choose(bench: Bench, name: str, each: int, starts: int, rounds: int) -> Choice:
    """So many touch-ups at each socket, from nominal blocks alone.

    One socket after the other is chosen for anew, with what is chosen at the others known, until
    nothing changes. The relaxation that knows no socket is a bound for all such choices.
    """
    count = each * len(bench.groups)
    criterion = criterion_of(bench, name, count)
    p = bench.model.p
    # spread over the recording, whatever it is sorted by
    chosen = [group[np.linspace(0, len(group) - 1, each).astype(int)] for group in bench.groups]
    before: FloatArray | None = None
    for _ in range(rounds):
        for k, group in enumerate(bench.groups):
            others = np.concatenate([own for i, own in enumerate(chosen) if i != k])
            known = np.vstack([bench.known, bench.blocks[others].reshape(-1, p)])
            found = select(
                bench.blocks[group], each, criterion, known=known, starts=starts, bound=False
            )
            chosen[k] = group[found.indices]
        now = np.concatenate(chosen)
        if before is not None and np.array_equal(now, before):
            break
        before = now
    rows = np.sort(np.concatenate(chosen))
    efficiency = np.nan
    if name not in WITHOUT_BOUND:
        known_rows = bench.known if len(bench.known) else None
        relaxed = select(bench.blocks, count, criterion, "rounding", known=known_rows).relaxation
        cost = criterion.on(Candidates(bench.blocks, known_rows)).cost(rows)
        efficiency = min(1.0, relaxed.bound / cost) if relaxed is not None else np.nan
    return Choice(rows, float(efficiency))


def by_lot_at_each(bench: Bench, each: int, draws: int, rng: np.random.Generator) -> BoolArray:
    """Choices ``(draws, N)`` of so many touch-ups at each socket."""
    out = np.zeros((draws, bench.data.count), dtype=bool)
    for group in bench.groups:
        out[:, group] = by_lot(len(group), each, draws, rng)
    return out


def compare(
    bench: Bench, criteria: Sequence[str], settings: dict[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    """All touch-ups, choices by lot and by each criterion, with one site held out."""
    choices = [
        choose(bench, name, settings["each"], settings["starts"], settings["rounds"])
        for name in criteria
    ]
    chosen = np.zeros((len(criteria), bench.data.count), dtype=bool)
    for mask, choice in zip(chosen, choices, strict=True):
        mask[choice.rows] = True
    lot = by_lot_at_each(bench, settings["each"], settings["draws"], rng)
    every = np.ones((1, bench.data.count), dtype=bool)
    far = bench.held_out_mm(np.concatenate([every, lot, chosen]))
    whole, drawn = float(far[0]), far[1 : 1 + len(lot)]
    return {
        "all_mm": whole,
        "by_lot_mm": spread(drawn),
        "drawn_mm": [float(value) for value in drawn],
        "chosen": [
            {
                "criterion": name,
                "error_mm": float(error),
                "over_all": float(error) / whole,
                "better_than": float(np.mean(drawn > error)),
                "efficiency": choice.efficiency,
            }
            for name, error, choice in zip(criteria, far[1 + len(lot) :], choices, strict=True)
        ],
    }
