"""Tables and verdicts as people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from studies.writing import table_line


def tables(said: Mapping[str, Any]) -> list[list[str]]:
    """The tables that people read, line by line: variation, causes, plate, arms drawn, verdicts."""
    shown = said["arms"]["deflecting"]
    return [
        variation_table(shown["variation"], shown["claims"]),
        causes_table(said["causes"]),
        plate_table({arm: part["plate"] for arm, part in said["arms"].items()}),
        arms_table(said["robots"]),
        verdicts(said),
    ]


def variation_table(rows: list[Mapping[str, Any]], found: Mapping[str, Any]) -> list[str]:
    """Ten data sets and all of them, a line for each pose set."""
    lines = []
    ratios = found["view line over touch-up"]
    for ratio in ratios:
        own = {row["estimator"]: row for row in rows if row["d_deg"] == ratio["d_deg"]}
        cells = [f"{ratio['d_deg']:g}", power(ratio["c_g"])]
        for name in ("touch-up", "touch-up, weighted", "view line", "touch-up, size left out"):
            row = own[name]
            if name != "touch-up, size left out":
                ends = f"{digits(row['ten_low_deg'])} to {digits(row['ten_high_deg'])}"
                cells.append(f"{digits(row['ten_std_deg'])} ({ends})")
            cells.append(digits(row["many_std_deg"]))
        cells.append(f"{ratio['ratio']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})")
        cells += [digits(own[name]["error_deg"]) for name in ("touch-up", "touch-up, weighted")]
        lines.append(table_line(cells))
    return lines


def causes_table(rows: list[Mapping[str, Any]]) -> list[str]:
    """Errors with one cause away, a line for each pose set and cause."""
    lines = []
    for row in rows:
        errors = [digits(value) for key, value in row.items() if key.endswith("error_deg")]
        cells = [f"{row['d_deg']:g}", power(row["c_g"]), row["away"], *errors]
        lines.append(table_line(cells))
    return lines


def plate_table(plates: Mapping[str, Any]) -> list[str]:
    """Distances before and after, the paper's way and weighted, a line for each pose set."""
    first = next(iter(plates.values()))
    before = [f"{plate['before']['worst_mm']:.3f}" for plate in plates.values() for _ in range(2)]
    distances = (100, 200, 300, 400)
    cells = ["", "before", *(f"{first['before'][f'd{d}_mm']:.3f}" for d in distances), *before]
    lines = [table_line(cells)]
    for row in (r for r in first["rows"] if r["estimator"] == "touch-up"):
        cells = [f"{row['d_deg']:g}", power(row["c_g"])]
        cells += [f"{row[f'd{d}_mm']:.3f}" for d in distances]
        for plate in plates.values():
            for name in ("touch-up", "touch-up, weighted"):
                (own,) = (
                    r for r in plate["rows"] if (r["estimator"], r["d_deg"]) == (name, row["d_deg"])
                )
                cells.append(f"{own['worst_mm']:.3f} ({own['ratio']:.2f})")
        lines.append(table_line(cells))
    return lines


def arms_table(robots: Mapping[str, Any]) -> list[str]:
    """Arms drawn at random: ratio and shares, a line for each pose set."""
    names = [name for name in robots if name != "count"]
    lines = []
    for k, first in enumerate(robots[names[0]]["rows"]):
        cells = [f"{first['d_deg']:g}", power(first["c_g"])]
        for name in names:
            row = robots[name]["rows"][k]
            cells.append(f"{row['ratio']:.2f} ({row['ratio_low']:.2f} to {row['ratio_high']:.2f})")
            cells += [percent(row["below_half"]), percent(row["worse_than_before"])]
        lines.append(table_line(cells))
    return lines


def verdicts(said: Mapping[str, Any]) -> list[str]:
    """A line for each claim of the paper."""
    arm, robots = said["arms"]["deflecting"], said["robots"]
    found, plate = arm["claims"], arm["claims"]["plate"]
    rigid = said["arms"]["rigid"]["claims"]["plate"]["touch-up"]
    paper, line = (found["falls"][name] for name in ("touch-up", "view line"))
    lines = []
    for figure, one in (("9: touch-up", paper), ("10: view line", line)):
        verdict = "reproduced" if one["rho_low"] > 0.8 else "not reproduced"
        lines.append(
            f"| Figure {figure}: small C_G, stable identification | {verdict} | rank correlation "
            f"{one['rho_median']:.2f} ({one['rho_low']:.2f} to {one['rho_high']:.2f}); of four "
            f"sets at random the outer two are in order in {100 * one['four_ends_in_order']:.1f} "
            f"%, all four in {100 * one['four_in_order']:.0f} % |"
        )
    for key, what in (
        ("view line over touch-up", "unweighted, as in the paper"),
        ("view line over touch-up, weighted", "touch-up weighted"),
    ):
        lines.append(_better(found[key], what))
    own = robots["touch-up"]
    beats = percent(own["smallest_beats_largest_c_g"])
    lines.append(
        "| Figure 11: C_G is an adequate index of accuracy | "
        f"{_index_verdict(own, rigid)} | rank correlation {plate['touch-up']['rho']:.2f} on the "
        f"arm shown, {own['rho_median']:.2f} ({own['rho_low']:.2f} to {own['rho_high']:.2f}) over "
        f"{robots['count']} arms; smallest C_G better than largest on {beats} %, best of all on "
        f"{percent(own['smallest_c_g_is_best'])} %; rigid arm: after over before falls from "
        f"{rigid['ratio_at_largest_c_g']:.2f} to {rigid['ratio_at_smallest_c_g']:.2f} |"
    )
    half = own["rows"][-1]["below_half"]
    mine = plate["touch-up"]
    verdict = "reproduced" if half["low"] > 0.5 else "under conditions"
    lines.append(
        f"| Figure 11: below 1/2 with the smallest C_G | {verdict} | arm shown: "
        f"{mine['ratio_at_smallest_c_g']:.2f} there, {mine['best_ratio']:.2f} at best (D = "
        f"{mine['best_d_deg']:g} deg), below 1/2 with {mine['sets_below_half']} of {mine['sets']} "
        f"sets; {percent(half)} % of arms at the smallest C_G; rigid arm: "
        f"{rigid['ratio_at_smallest_c_g']:.2f} |"
    )
    return lines


def _better(rows: list[Mapping[str, Any]], what: str) -> str:
    """Where touch-up varies less than the view line, and where more."""
    less = [row for row in rows if row["low"] > 1.0]
    more = [row for row in rows if row["high"] < 1.0]
    verdict = "reproduced" if not more else "under conditions" if less else "not reproduced"
    said = [f"view line over touch-up {rows[0]['ratio']:.2f} at C_G = {power(rows[0]['c_g'])}"]
    if less:
        said.append(f"touch-up varies less from {power(less[-1]['c_g'])} up")
    if more:
        said.append(f"more from {power(more[0]['c_g'])} down ({rows[-1]['ratio']:.2f} at the end)")
    return f"| Figure 10: improved by touch-up, {what} | {verdict} | {'; '.join(said)} |"


def _index_verdict(own: Mapping[str, Any], rigid: Mapping[str, Any]) -> str:
    """Of arms that deflect, and of one that is as the model has it."""
    if own["rho_low"] > 0.0:
        return "reproduced"
    falls = rigid["ratio_at_smallest_c_g"] < 0.5 * rigid["ratio_at_largest_c_g"]
    return "only where the model is right" if falls else "not reproduced"


def power(value: float) -> str:
    """Three digits and a power of ten."""
    return f"{value:.2e}".replace("e+0", "e")


def digits(value: float) -> str:
    """Two digits, or three where it begins with a one."""
    shown = f"{value:.3g}" if f"{abs(value):.1e}"[0] == "1" else f"{value:.2g}"
    return shown.replace("0.", ".", 1) if abs(value) < 1.0 else shown


def percent(share: Mapping[str, float]) -> str:
    """A share with its 95 % interval."""
    low, middle, high = (100.0 * share[key] for key in ("low", "share", "high"))
    return f"{middle:.0f} ({low:.0f} to {high:.0f})"
