"""The tables of the study as its README has them, from the key figures alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies.writing import table_of

Said = Mapping[str, Any]
SCIPY = "scipy from OpenCV's SHAH"
COORDINATES, DISTANCES = "pybotics' arm, coordinates", "pybotics, its distances"
CONE = "figaroh: cone programme"


def markdown(said: Said) -> str:
    """Every table, and before them what was left out."""
    tables = (
        times_of_pairs(said),
        times_of_the_rest(said),
        accuracy_of_pairs(said),
        accuracy_of_touch_ups(said),
        choice(said),
        refusals(said),
    )
    return "\n\n".join((*said["left_out"].values(), *tables))


def times_of_pairs(said: Said) -> str:
    """A X = Z B: a line for each peer, a pair of columns for each number of pairs."""
    rows = [row for row in said["times"] if row["job"] == "A X = Z B"]
    sizes = list(dict.fromkeys(row["size"] for row in rows))
    head = ["by", "ours"] + [f"{size} pairs" for size in sizes]
    lines: dict[tuple[str, str], dict[int, str]] = {}
    for row in rows:
        lines.setdefault((row["peer"], row["ours"]), {})[row["size"]] = _ratio(row)
    return table_of(
        head,
        [[*names, *(cells.get(size, "") for size in sizes)] for names, cells in lines.items()],
    )


def times_of_the_rest(said: Said) -> str:
    """Ten parameters and the choice of poses."""
    rows = [row for row in said["times"] if row["job"] != "A X = Z B"]
    lines = [
        [row["job"], row["peer"], row["ours"], _ratio(row), _number(row["theirs_ms"])]
        for row in rows
    ]
    return table_of(["job", "by", "ours", "their time over ours", "theirs [ms]"], lines)


def accuracy_of_pairs(said: Said) -> str:
    """Errors of X: a line for each solver and number of pairs, a column for each setting."""
    rows = said["pairs"]
    settings = list(dict.fromkeys(row["setting"] for row in rows))
    lines: dict[tuple[int, str], dict[str, str]] = {}
    for row in rows:
        failed = f", {row['failed']} failed" if row["failed"] else ""
        cell = _interval(row, "X_mm") + failed
        lines.setdefault((row["pairs"], row["solver"]), {})[row["setting"]] = cell
    head = ["pairs", "by", *(f"{name}: X off [mm]" for name in settings)]
    return table_of(
        head, [[str(n), by, *(cells[s] for s in settings)] for (n, by), cells in lines.items()]
    )


def accuracy_of_touch_ups(said: Said) -> str:
    """Error of the tool point in postures that were not measured."""
    lines = []
    for row in said["touch_ups"]:
        off = f"{row['tool_error_mm']:.3f}"
        off += f" ({row['tool_error_low_mm']:.3f} to {row['tool_error_high_mm']:.3f})"
        nearer = f"{100 * row['ours_nearer']:.0f} % "
        nearer += f"({100 * row['ours_nearer_low']:.0f} to {100 * row['ours_nearer_high']:.0f})"
        cells = [row["noise"], row["by"], str(row["trials"]), off, f"{row['of_ours']:.2f}"]
        lines.append([*cells, "" if row["by"] == "ours" else nearer, f"{row['left_mm']:.3f}"])
    head = ["noise", "by", "trials", "tool point off [mm]", "over ours", "ours nearer"]
    return table_of([*head, "left at the touch-ups [mm]"], lines)


def choice(said: Said) -> str:
    """Share of the proven bound that every choice has."""
    lines = [
        [
            row["by"],
            str(row["poses"]),
            str(row["different"]),
            "" if row["of_the_bound"] is None else f"{row['of_the_bound']:.4f}",
            row["says_of_its_distance"],
        ]
        for row in said["selection"]
    ]
    head = ["by", "poses", "different", "of the bound", "says how far from the best"]
    return table_of(head, lines)


def refusals(said: Said) -> str:
    """What pairs that cannot be solved are answered with: a line for each solver."""
    cases = [row["pairs"] for row in said["refusals"]]
    solvers = [name for name in said["refusals"][0] if name != "pairs"]
    lines = [[name, *(row[name] for row in said["refusals"])] for name in solvers]
    return table_of(["by", *cases], lines)


def _ratio(row: Said) -> str:
    low, high = row["ratio_low"], row["ratio_high"]
    text = f"{_number(row['ratio'])}"
    return text if low == high else f"{text} ({_number(low)} to {_number(high)})"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    if value >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _interval(row: Said, name: str) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return f"{_number(row[name])} ({_number(low)} to {_number(high)})"


def sentences(said: Said) -> dict[str, str]:
    """What the README says of the key figures, each under a name."""
    return {"answer": _answer(said)} | _of_accuracy(said) | _of_facts(said)


def _answer(said: Said) -> str:
    pairs = [row for row in said["times"] if row["ours"] == "ml" and row["peer"] != SCIPY]
    few, many = (end(row["size"] for row in pairs) for end in (min, max))
    ratio = {size: [r["ratio"] for r in pairs if r["size"] == size] for size in (few, many)}
    rest = {row["peer"]: _number(row["ratio"]) for row in said["times"]}
    deep = _deep(said)
    return (
        f"**Answer.** At {few} pairs OpenCV's closed forms need {_ends(ratio[few])} of the time of "
        f"the likeliest X and Z, at {many} pairs {_ends(ratio[many])} times as long; for ten "
        f"parameters figaroh and pybotics need {rest['figaroh']} and {rest[COORDINATES]} times as "
        f"long, for a choice of poses figaroh's cone programme {rest[CONE]} times. With noise that "
        f"is alike on all axes their touch-ups are worth as much as ours, with depth six times as "
        f"uncertain they are {deep['figaroh']['of_ours']:.1f} times as far off; OpenCV's X is "
        f"{_ends(_over_ours(said))} times as far off, and most of its methods answer pairs that "
        f"have no answer."
    )


def _of_accuracy(said: Said) -> dict[str, str]:
    deep, nearer = _deep(said), _deep(said)["figaroh"]
    kink = next(row for row in said["touch_ups"] if row["by"] == DISTANCES)
    choice = {row["by"]: row for row in said["selection"]}
    every, heavy = (choice[f"{CONE}, {which}"] for which in ("all it keeps", "the heaviest"))
    top = choice["ours: exchange"]
    repeated = [row for row in said["selection"] if row["different"] < row["poses"]]
    counts = " and ".join(str(row["different"]) for row in repeated)
    shares = " and ".join(f"{row['of_the_bound']:.4f}" for row in repeated)
    return {
        "pairs": (
            f"scipy ends where `ml` does, in all of {said['optimum']['trials']} trials: X apart by "
            f"{said['optimum']['largest_difference_of_X']:.0e} at most."
        ),
        "touch-ups": (
            f"With equal noise all who take coordinates have the same answer. With depth six times "
            f"as uncertain the weights matter: {deep['ours']['tool_error_mm']:.2f} mm against "
            f"{nearer['tool_error_mm']:.2f}, ours nearer in {100 * nearer['ours_nearer']:.0f} % of "
            f"trials."
        ),
        "distances": (
            f"pybotics' own residuals, the distances, end {kink['of_ours']:.1f} times as far off "
            f"in the {kink['trials']} trials with equal noise"
        ),
        "choice": (
            f"Ours has {top['of_the_bound']:.4f} of the bound with 20 different poses, and says "
            f"so. figaroh's cone programme keeps {every['poses']} poses, of which the heaviest 20 "
            f"come to {heavy['of_the_bound']:.4f}; its DetMax takes some poses twice ({counts} "
            f"different ones) and so comes to {shares}, above ours. It starts at random and says "
            f"nothing of how far the best is."
        ),
    }


def _of_facts(said: Said) -> dict[str, str]:
    facts = said["facts"]
    told = facts["offset_that_cannot_be_told"]["figaroh"]
    first, last = told
    return {
        "apart": (
            f"Kinematics agree to {facts['figaroh_apart_m']:.0e} m (figaroh) and "
            f"{facts['pybotics_apart_m']:.0e} m (pybotics) in 200 postures."
        ),
        "own list": (
            f"frees {len(facts['figaroh_own_parameters'])} parameters, the axes of an unknown "
            f"frame of the target among them"
        ),
        "offsets": (
            f"Touch-ups of one point tell neither the offset of the first joint nor that of the "
            f"last. figaroh's selection {told[first].split()[0]} the first and "
            f"{told[last].split()[0]} the last; `identify` refuses both, and says which "
            f"parameters absorb them."
        ),
    }


def _deep(said: Said) -> dict[str, Said]:
    return {r["by"]: r for r in said["touch_ups"] if r["noise"].startswith("depth")}


def _over_ours(said: Said) -> list[float]:
    """Errors of OpenCV's X over those of the likeliest, where the noise is as told."""
    rows = [row for row in said["pairs"] if row["setting"].endswith("on B")]
    best = {(r["setting"], r["pairs"]): r["X_mm"] for r in rows if r["solver"] == "ours: ml"}
    theirs = [r for r in rows if not r["solver"].startswith(("ours", "scipy"))]
    return [r["X_mm"] / best[r["setting"], r["pairs"]] for r in theirs]


def _ends(values: Sequence[float]) -> str:
    return f"{min(values):.2g} to {max(values):,.2g}" if max(values) < 100 else _wide(values)


def _wide(values: Sequence[float]) -> str:
    return f"{min(values):.2g} to {max(values):,.0f}"
