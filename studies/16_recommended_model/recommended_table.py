"""What became of all arms: how good the recommended model is, and how often it harms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from posedesign.identification.models import OFFSETS
from studies.intervals import wilson
from studies.writing import Cell, table

from .recommended_trials import KNOWN, NOMINAL, PULLED, REDUCED

if TYPE_CHECKING:
    import pandas as pd


PEERS = {"reduced": REDUCED, "pulled": PULLED, "known": KNOWN}
EVERY = "all"
WORSE = 1e-6
"""Part of an error by which another is larger, and not the same one rounded."""

OFFSETS_WORSE = 0.1
"""Part of the error of offsets alone by which the recommended model does harm."""

GIVES = 0.1
"""Part of the error of the nominal arm from which a compliance does something."""


def outcomes(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each trial: errors in mm, NaN where there is no such model.

    ``model`` is the recommended one, the nominal one where none is; ``refused``, nothing could be
    identified. ``recommended`` to ``known`` are errors of models, ``box`` those over the usual task
    box, of the recommended, the best and the nominal one. ``expected`` is what the result says of
    its recommended model's error, with its interval. ``incomplete``: the result says that the model
    leaves something of the arm out; ``blames``: it names a mistake in measuring, of which there is
    none. ``give`` is what compliance as recommended moves the tool point by.
    """
    import pandas as pd

    trials = table.groupby(["preset", "way", "trial"], sort=False)
    return pd.DataFrame([_outcome(rows) for _, rows in trials])


def _outcome(rows: pd.DataFrame) -> dict[str, Any]:
    head = rows.iloc[0]
    models = rows[rows["role"] == "model"].set_index("model")
    peers = rows[rows["role"].isin(["peer", "bound"])].set_index("model")["error_mm"]
    chosen, own = (models[models[which].astype(bool)] for which in ("recommended", "reference"))
    taken = chosen.iloc[0] if len(chosen) else None

    def of(name: str, column: str = "error_mm") -> float:
        return float(models[column].get(name, np.nan))

    def said(column: str) -> float:
        return np.nan if taken is None else float(taken[column])

    name = NOMINAL if taken is None else str(taken.name)
    return {
        "preset": str(head["preset"]),
        "way": str(head["way"]),
        "trial": int(head["trial"]),
        "compliant": bool(head["compliant"]),
        "wavy": bool(head["wavy"]),
        "refused": head["role"] == "refused",
        "model": name,
        "recommended": of(name) if taken is None else float(taken["error_mm"]),
        "best": float(models["error_mm"].min()),
        "nominal": of(NOMINAL),
        "offsets": of(OFFSETS),
        "reference": float(own["error_mm"].iloc[0]) if len(own) else np.nan,
        **{key: float(peers.get(peer, np.nan)) for key, peer in PEERS.items()},
        "box": of(name, "box_mm"),
        "box_best": float(models["box_mm"].min()),
        "box_nominal": of(NOMINAL, "box_mm"),
        **{key: said(f"{key}_mm") for key in ("expected", "expected_low", "expected_high")},
        "incomplete": taken is not None and bool(taken["incomplete"]),
        "blames": bool(head["blames"]),
        "covered": 0 if taken is None else int(taken["covered"]),
        "parameters": 0 if taken is None else int(taken["parameters"]),
        "give": 0.0 if taken is None else float(np.nan_to_num(taken["give_mm"])),
        "seconds": float(head["seconds"]),
    }


def judged(found: pd.DataFrame) -> pd.DataFrame:
    """Trials in which something was identified, with what is made of them.

    ``harms`` is worse than the nominal arm, ``harms_beyond`` by more than its interval says that it
    may be off; ``is_expected`` is an error within that interval; ``gives``, compliance moves the
    tool by more than a little.
    """
    told = found[np.isfinite(found["best"])]
    harms = told["recommended"] > (1.0 + WORSE) * told["nominal"]
    within = told["recommended"] <= told["nominal"] + (told["expected_high"] - told["expected"])
    return told.assign(
        over_best=told["recommended"] / told["best"],
        harms=harms,
        harms_beyond=harms & ~within,
        is_expected=told["recommended"].between(told["expected_low"], told["expected_high"]),
        gives=told["give"] > GIVES * told["nominal"],
        worse_than_offsets=told["recommended"] > (1.0 + OFFSETS_WORSE) * told["offsets"],
    )


def summary(found: pd.DataFrame, near: float) -> list[dict[str, Any]]:
    """A row for each way to measure, then one for each preset with it."""
    ways, presets = found["way"].unique(), found["preset"].unique()
    rows = [_row(way, EVERY, found[found["way"] == way], near) for way in ways]
    for way in ways:
        for preset in presets:
            own = found[(found["way"] == way) & (found["preset"] == preset)]
            rows.append(_row(way, preset, own, near))
    return rows


def _row(way: str, preset: str, found: pd.DataFrame, near: float) -> dict[str, Any]:
    told = judged(found)
    wavy, ratio = told[told["wavy"]], told["over_best"]
    row: dict[str, Any] = {"way": way, "preset": preset, "arms": len(found)}
    row["refused"] = int(found["refused"].sum())
    row |= _share("best", ratio <= 1.0 + WORSE)
    row |= _share("near", ratio <= 1.0 + near)
    row |= _share("known_near", told["known"] <= (1.0 + near) * told["best"])
    row["over_best_median"] = _median(ratio)
    row["over_best_worst"] = float(ratio.max()) if len(ratio) else None
    for name in ("harms", "harms_beyond", "worse_than_offsets"):
        row |= _share(name, told[name])
    row |= _share("compliance_of_rigid", told["gives"][~told["compliant"]])
    row["box_near"] = int((told["box"] <= (1.0 + near) * told["box_best"]).sum())
    row["box_harms"] = int((told["box"] > (1.0 + WORSE) * told["box_nominal"]).sum())
    names = ("nominal", "offsets", "recommended", "best", "reference", "reduced", "pulled", "known")
    for name in (*names, "box", "box_best", "box_nominal"):
        row[f"{name}_mm"] = _median(told[name])
    row |= _coverage("covered", told)
    row |= _coverage("covered_smooth", told[~told["wavy"]])
    row |= _coverage("covered_wavy", wavy)
    row |= _coverage("covered_wavy_silent", wavy[~wavy["incomplete"]])
    expects = told[np.isfinite(told["expected"])]
    row |= _share("expected", expects["is_expected"])
    row["found_over_expected"] = _median(expects["recommended"] / expects["expected"])
    row |= _share("incomplete_wavy", wavy["incomplete"])
    row |= _share("blames", told["blames"])
    row["seconds"] = _median(told["seconds"])
    return row


def _share(name: str, of: pd.Series[bool] | np.ndarray) -> dict[str, Any]:
    found = wilson(np.asarray(of, dtype=bool))
    ends = {f"{name}_{end}": found[end] for end in ("low", "high")}
    return {name: int(of.sum()), f"{name}_of": len(of)} | ends


def _coverage(name: str, found: pd.DataFrame) -> dict[str, Any]:
    """Pooled over arms; their interval takes the parameters of an arm for independent."""
    return _share(name, np.arange(found["parameters"].sum()) < found["covered"].sum())


def _median(values: pd.Series[float]) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.median()) if len(known) else None


def models_taken(found: pd.DataFrame) -> dict[str, dict[str, int]]:
    """How often each model is recommended, by way to measure."""
    ways = found.groupby("way", sort=False)["model"]
    return {way: dict(Counter(models).most_common()) for way, models in ways}


def worst(found: pd.DataFrame, count: int = 10) -> list[dict[str, Any]]:
    """Trials in which the recommended model is farthest from the best."""
    told = judged(found).sort_values("over_best", ascending=False, kind="stable").head(count)
    errors = ["recommended", "best", "nominal", "offsets"]
    shown = told[["way", "preset", "trial", "model", *errors]]
    return shown.rename(columns={name: f"{name}_mm" for name in errors}).to_dict("records")


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read."""
    rows = [row | {"where": _where(row)} for row in said["rows"]]
    for row in rows:
        for name in [key for key in row if f"{key}_of" in row]:
            row[f"share {name}"] = row[name] / row[f"{name}_of"] if row[f"{name}_of"] else None
            if not row[f"{name}_of"]:
                row |= {f"{name}_low": None, f"{name}_high": None}
    return "\n\n".join(table(rows, cells, heads.split(" | ")) for heads, cells in TABLES.items())


def _where(row: Mapping[str, Any]) -> str:
    return f"**{row['way']}**" if row["preset"] == EVERY else f"{row['way']}, {row['preset']}"


def _ends(name: str) -> str:
    return f"{{{name}_low:p}} to {{{name}_high:p}} %"


TABLES: Mapping[str, Sequence[Cell]] = {
    "measured by | arms | within 10 % | 95 % | sizes known | median | worst | worse than nominal | "
    "beyond its interval | 95 % | than offsets | 95 % | compliance on rigid arms | 95 %": (
        "{where}", "{arms}", "{share near:p} %", _ends("near"), "{share known_near:p} %",
        "{over_best_median:.2f}", "{over_best_worst:.2f}", "{harms}", "{harms_beyond}",
        _ends("harms_beyond"), "{worse_than_offsets}", _ends("worse_than_offsets"),
        "{compliance_of_rigid} of {compliance_of_rigid_of}", _ends("compliance_of_rigid"),
    ),
    "measured by | nominal | offsets | recommended | reference | best model | QR, no priors | "
    "pulled to nominal | sizes known": (
        "{where}", "{nominal_mm:s.3f}", "{offsets_mm:s.3f}", "{recommended_mm:s.3f}",
        "{reference_mm:s.3f}", "{best_mm:s.3f}", "{reduced_mm:s.3f}", "{pulled_mm:s.3f}",
        "{known_mm:s.3f}",
    ),
    "measured by | covered | 95 % | smooth | wavy | wavy, nothing said | said of wavy | mistakes "
    "named | error in its interval | found over expected": (
        "{where}", "{share covered:p} %", _ends("covered"), "{share covered_smooth:p} %",
        "{share covered_wavy:p} %", "{share covered_wavy_silent:p} %",
        "{incomplete_wavy} of {incomplete_wavy_of}", "{blames} of {blames_of}",
        "{share expected:p} %", "{found_over_expected:.2f}",
    ),
}  # fmt: skip
"""Heads and cells of each table."""
