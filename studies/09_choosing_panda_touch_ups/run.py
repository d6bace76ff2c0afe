"""Run the study: ``posedesign study run choosing_panda_touch_ups``, or this file as a script.

It needs measurements that the project does not contain, see :mod:`studies.real_data`.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # the modules of this folder, however it is loaded

from panda_bench import SITES, bench_of, touched  # noqa: E402
from panda_choice import compare  # noqa: E402
from panda_figure import draw  # noqa: E402

from posedesign.study.library import Advance, Options  # noqa: E402
from studies import writing  # noqa: E402
from studies.choices import range_text, spread  # noqa: E402
from studies.real_data import data_with  # noqa: E402

SETTINGS: dict[str, Any] = tomllib.loads((HERE / "study.toml").read_text(encoding="utf-8"))
RECOMMENDED = "I at the sockets"
"""Criterion that is held to the bars: it asks for nothing of the site that is to come."""

EVERY = "all sites"
TOLERANCE = 5e-3
"""Of the figures on another machine, relative."""

DIGITS = 6
"""Significant digits of what is written."""

TABLE, FIGURE = "choosing_panda_touch_ups.csv", "choosing_panda_touch_ups"


def study(options: Options) -> dict[str, Any]:
    """Are ten touch-ups a socket as good as thirty?

    A trial is a choice by lot: so many each choice is held against.
    """
    draws = writing.trials_of(options, SETTINGS["draws"])
    folder = data_with(touched.RECORDINGS) / touched.RECORDINGS
    return write(run(folder, draws=draws, advance=options.advance), options.out)


def plot(folder: Path) -> list[Path]:
    """Error at the site held out over that of all touch-ups, by lot and by criterion."""
    rows = writing.read_figures(folder)["models"]
    return writing.save(draw(rows, [*SITES, EVERY]), folder, FIGURE)


def write(rows: list[dict[str, Any]], out: Path) -> dict[str, Any]:
    """Write table and key figures, and return these."""
    content = {"tolerance": TOLERANCE, "recommended": RECOMMENDED, "models": rows}
    figures: dict[str, Any] = writing.rounded(content, DIGITS)
    writing.write_rows(out, TABLE, flat(figures["models"]), DIGITS)
    writing.write_figures(out, figures)
    return figures


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
    wanted = [row for row in SETTINGS["model"] if names is None or row["name"] in names]
    for done, row in enumerate(wanted):
        advance(row["name"], done / len(wanted))
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
    return {
        "all_mm": whole,
        "by_lot_mm": spread(drawn),
        "drawn_mm": drawn,
        "chosen": chosen,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The table of the README: what is left at each site held out, and how it compares."""
    places = [*SITES, EVERY]
    lines = [
        "| model | touch-ups | efficiency | " + " | ".join(f"{p} [mm]" for p in places) + " |",
        "|---" * (3 + len(places)) + "|",
    ]
    for row in rows:
        of = [row["sites"][place] for place in places]
        head = f"| {row['model']} ({row['parameters']}) "
        lines.append(head + "| all 30 | | " + " | ".join(f"{s['all_mm']:.3f}" for s in of) + " |")
        ranges = (range_text(s["by_lot_mm"]["quantiles"]) for s in of)
        lines.append(head + "| *10 by lot: median (5 to 95 %)* | | " + " | ".join(ranges) + " |")
        for k, c in enumerate(of[-1]["chosen"]):
            proven = f"{c['efficiency']:.2f}" if c["efficiency"] is not None else ""
            cells = [
                f"{s['chosen'][k]['error_mm']:.3f} (x{s['chosen'][k]['over_all']:.2f}, "
                f"{100 * s['chosen'][k]['better_than']:.0f} %)"
                for s in of
            ]
            lines.append(
                head + f"| 10 by {c['criterion']} | {proven} | " + " | ".join(cells) + " |"
            )
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


def main() -> None:
    """Run, draw and print."""
    writing.script(study, plot, HERE, markdown)


if __name__ == "__main__":
    main()
