"""Run the study: ``posedesign study run choosing_panda_touch_ups``.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.report.drawing import GREY, label_ends, set_answer
from posedesign.selection import (
    Candidates,
    Criterion,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    select,
)
from posedesign.study import Advance, Options
from studies import writing
from studies.choices import by_lot, draw_choices, range_text, spread, write
from studies.real_data import data_with
from studies.writing import cell

from .panda_bench import SITES, Bench, bench_of, touched

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


def draw(rows: Sequence[dict[str, Any]], places: Sequence[str]) -> Figure:
    """A panel for each model of the arm: the error at each site over that of all touch-ups."""
    shown = [row for row in rows if len(row["sites"][places[0]]["chosen"]) > 1]
    figure = Figure(figsize=(12.5, 4.4), layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for panel, row in zip(panels, shown, strict=True):
        sites = [row["sites"][place] for place in places]
        lots = [np.array(of["by_lot_mm"]["quantiles"]) / of["all_mm"] for of in sites]
        chosen = [{c["criterion"]: c["over_all"] for c in of["chosen"]} for of in sites]
        draw_choices(panel, places, lots, chosen, joined=False)
        panel.axhline(1.0, color=GREY, lw=1.2, ls="--", label="all 30")
        panel.axhline(BAR, color=GREY, lw=1.0, ls=":")
        panel.set_title(f"{row['model']} ({row['parameters']} parameters)", fontsize=10)
        panel.set_xlabel("site held out")
    panels[0].set_ylabel("error at the site, 10 touch-ups\na socket over all 30 [-]")
    for panel in panels:
        label_ends(panel)
    of = rows[0]["sites"][EVERY]
    (own,) = (c for c in of["chosen"] if c["criterion"] == RECOMMENDED)
    lot = of["by_lot_mm"]["quantiles"][2] / of["all_mm"]
    set_answer(
        figure,
        f"Ten touch-ups a socket, chosen by {RECOMMENDED}, leave {own['over_all']:.2f} times the "
        f"error of all thirty over all sites; ten by lot {lot:.2f} times ({rows[0]['model']})",
        f"Bars: 5 to 95 % of the choices by lot. Dotted: {100 * (BAR - 1):.0f} % more than all 30.",
    )
    return figure


SETTINGS = writing.settings_of(__file__)
RECOMMENDED = "I at the sockets"
"""Criterion that is held to the bars: it asks for nothing of the site that is to come."""

BAR = 1.1
"""So much more error than all touch-ups leave is taken for as good."""

EVERY = "all sites"
TABLE, FIGURE = "choosing_panda_touch_ups.csv", "choosing_panda_touch_ups"


def study(options: Options) -> dict[str, Any]:
    """Are ten touch-ups a socket as good as thirty?

    A trial is a choice by lot: so many each choice is held against.
    """
    draws = writing.trials_of(options, SETTINGS["draws"])
    folder = data_with(touched.RECORDINGS) / touched.RECORDINGS
    rows = run(folder, draws=draws, advance=options.advance)
    return write(rows, RECOMMENDED, options.out / TABLE, flat)


def plot(folder: Path) -> list[Path]:
    """Error at the site held out over that of all touch-ups, by lot and by criterion."""
    rows = writing.read_figures(folder)["models"]
    return writing.save(draw(rows, [*SITES, EVERY]), folder, FIGURE)


def run(
    folder: Path,
    names: Sequence[str] | None = None,
    criteria: Sequence[str] | None = None,
    draws: int = SETTINGS["draws"],
    advance: Advance = lambda what, part: None,
) -> list[dict[str, Any]]:
    """Figures of each model, or of those that are named; by all of its criteria, or by some."""
    recorded = touched.load(folder)
    settings = SETTINGS | {"draws": draws}
    rows = []
    for row in writing.named(SETTINGS["model"], names, advance):
        tried = [c for c in row["criteria"] if criteria is None or c in criteria]
        found = {}
        for site, name in enumerate(SITES):
            bench = bench_of(recorded, row, site, settings)
            rng = np.random.default_rng([SETTINGS["seed"], site])
            found[name] = compare(bench, tried, settings, rng)
        found[EVERY] = together(list(found.values()))
        for of in found.values():
            del of["drawn_mm"]
        rows.append({"model": row["name"], "parameters": bench.model.p, "sites": found})
    return rows


def together(sites: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The same over all sites: root of the mean square of what is left at each."""

    def rms(values: Any) -> Any:
        return np.sqrt(np.mean(np.square(values), axis=0))

    whole = float(rms([of["all_mm"] for of in sites]))
    drawn = rms([of["drawn_mm"] for of in sites])
    chosen = []
    for k, first in enumerate(sites[0]["chosen"]):
        error = float(rms([of["chosen"][k]["error_mm"] for of in sites]))
        chosen.append(
            {
                "criterion": first["criterion"],
                "error_mm": error,
                "over_all": error / whole,
                "better_than": float(np.mean(drawn > error)),
                "efficiency": min(of["chosen"][k]["efficiency"] for of in sites),
            }
        )
    return {"all_mm": whole, "by_lot_mm": spread(drawn), "drawn_mm": drawn, "chosen": chosen}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The table of the README: what is left at each site held out, and how it compares."""
    places = [*SITES, EVERY]
    heads = ["model", "touch-ups", "efficiency", *(f"{place} [mm]" for place in places)]
    how = "{error_mm:.3f} (x{over_all:.2f}, {better_than:p} %)"
    lines: list[str] = []
    for row in rows:
        of = [row["sites"][place] for place in places]
        name = f"{row['model']} ({row['parameters']})"
        every = [[name, "all 30", "", *(cell(s, "{all_mm:.3f}") for s in of)]]
        by_lot = "*10 by lot: median (5 to 95 %)*"
        every.append([name, by_lot, "", *(cell(s, range_text("by_lot_mm[quantiles]")) for s in of)])
        for k, c in enumerate(of[-1]["chosen"]):
            left = [cell(s["chosen"][k], how) for s in of]
            every.append([name, f"10 by {c['criterion']}", cell(c, "{efficiency:.2f}", ""), *left])
        lines.append(writing.lines_of(() if lines else heads, every))
    return "\n".join(lines)


def flat(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A line of the CSV for each choice at each site."""
    lines = []
    for row in rows:
        for place, of in row["sites"].items():
            head = {"model": row["model"], "parameters": row["parameters"], "held_out": place}
            lines.append(head | {"touch_ups": "all", "error_mm": of["all_mm"]})
            middle = of["by_lot_mm"]["quantiles"][2]
            lines.append(head | {"touch_ups": "lot, median", "error_mm": middle})
            lines += [head | {"touch_ups": c["criterion"]} | c for c in of["chosen"]]
    return [{k: v for k, v in line.items() if k != "criterion"} for line in lines]


def markdown(found: Mapping[str, Any]) -> str:
    """What the README has of the key figures."""
    return table(found["models"])
