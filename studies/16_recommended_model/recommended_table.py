"""What became of all arms: how good the recommended model is, and how often it harms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posedesign.identification.models import OFFSETS
from studies.intervals import wilson
from studies.writing import table_of

from .recommended_trials import KNOWN, NOMINAL, PULLED, REDUCED

if TYPE_CHECKING:
    import pandas as pd


EVERY = "all"
WORSE = 1e-6
"""Part of an error by which another is larger, and not the same one rounded."""

OFFSETS_WORSE = 0.1
"""Part of the error of offsets alone by which the recommended model does harm."""

GIVES = 0.1
"""Part of the error of the nominal arm from which a compliance does something."""


@dataclass(frozen=True)
class Outcome:
    """One trial: errors in mm, NaN where there is no such model.

    Attributes
    ----------
    preset, way : str
    trial : int
    compliant, wavy : bool
    refused : bool
        Nothing could be identified.
    model : str
        The recommended one; the nominal one where none is.
    recommended, best, nominal, offsets, reference, reduced, pulled, known : float
    box, box_best, box_nominal : float
        Of the recommended, the best and the nominal one over the usual task box.
    expected, expected_low, expected_high : float
        What the result says of its recommended model's error, with its interval; NaN without.
    incomplete : bool
        Whether the result says that the model leaves something of the arm out.
    blames : bool
        Whether it names a mistake in measuring, of which there is none.
    covered, parameters : int
    give : float
        What compliance as recommended moves the tool point by.
    seconds : float
    """

    preset: str
    way: str
    trial: int
    compliant: bool
    wavy: bool
    refused: bool
    model: str
    recommended: float
    best: float
    nominal: float
    offsets: float
    reference: float
    reduced: float
    pulled: float
    known: float
    box: float
    box_best: float
    box_nominal: float
    expected: float
    expected_low: float
    expected_high: float
    incomplete: bool
    blames: bool
    covered: int
    parameters: int
    give: float
    seconds: float

    @property
    def over_best(self) -> float:
        """Error of the recommended model over the least of all models."""
        return self.recommended / self.best

    @property
    def harms(self) -> bool:
        """Whether it is worse than the nominal arm."""
        return self.recommended > (1.0 + WORSE) * self.nominal

    @property
    def harms_beyond(self) -> bool:
        """Whether it is, by more than its interval says that it may be off."""
        reach = self.expected_high - self.expected
        return self.harms and not self.recommended <= self.nominal + reach

    @property
    def is_expected(self) -> bool:
        """Whether its error is in the interval that the result gives."""
        return self.expected_low <= self.recommended <= self.expected_high

    @property
    def gives(self) -> bool:
        """Whether compliance as recommended moves the tool by more than a little."""
        return self.give > GIVES * self.nominal

    @property
    def worse_than_offsets(self) -> bool:
        """By a tenth."""
        return self.recommended > (1.0 + OFFSETS_WORSE) * self.offsets


def outcomes(table: pd.DataFrame) -> list[Outcome]:
    """One of each trial."""
    found = []
    for _, rows in table.groupby(["preset", "way", "trial"], sort=False):
        models = rows[rows["role"] == "model"].set_index("model")
        peers = rows[rows["role"].isin(["peer", "bound"])].set_index("model")["error_mm"]
        head = rows.iloc[0]
        chosen = models[models["recommended"].astype(bool)] if len(models) else models
        nominal = _of(models, NOMINAL)
        taken = chosen.iloc[0] if len(chosen) else None
        own = models[models["reference"].astype(bool)] if len(models) else models
        found.append(
            Outcome(
                preset=str(head["preset"]),
                way=str(head["way"]),
                trial=int(head["trial"]),
                compliant=bool(head["compliant"]),
                wavy=bool(head["wavy"]),
                refused=head["role"] == "refused",
                model=NOMINAL if taken is None else str(taken.name),
                recommended=nominal if taken is None else float(taken["error_mm"]),
                best=float(models["error_mm"].min()) if len(models) else np.nan,
                nominal=nominal,
                offsets=_of(models, OFFSETS),
                reference=float(own["error_mm"].iloc[0]) if len(own) else np.nan,
                reduced=float(peers.get(REDUCED, np.nan)),
                pulled=float(peers.get(PULLED, np.nan)),
                known=float(peers.get(KNOWN, np.nan)),
                box=_of(models, NOMINAL if taken is None else str(taken.name), "box_mm"),
                box_best=float(models["box_mm"].min()) if len(models) else np.nan,
                box_nominal=_of(models, NOMINAL, "box_mm"),
                expected=_said(taken, "expected_mm"),
                expected_low=_said(taken, "expected_low_mm"),
                expected_high=_said(taken, "expected_high_mm"),
                incomplete=taken is not None and bool(taken["incomplete"]),
                blames=bool(head["blames"]),
                covered=0 if taken is None else int(taken["covered"]),
                parameters=0 if taken is None else int(taken["parameters"]),
                give=0.0 if taken is None else float(np.nan_to_num(taken["give_mm"])),
                seconds=float(head["seconds"]),
            )
        )
    return found


def _said(taken: pd.Series[Any] | None, column: str) -> float:
    return float("nan") if taken is None else float(taken[column])


def _of(models: pd.DataFrame, name: str, column: str = "error_mm") -> float:
    return float(models[column].get(name, np.nan)) if len(models) else float("nan")


def summary(found: Sequence[Outcome], near: float) -> list[dict[str, Any]]:
    """A row for each way to measure, then one for each preset with it."""
    ways = dict.fromkeys(one.way for one in found)
    presets = dict.fromkeys(one.preset for one in found)
    rows = [_row(way, EVERY, [o for o in found if o.way == way], near) for way in ways]
    for way in ways:
        for preset in presets:
            own = [o for o in found if (o.way, o.preset) == (way, preset)]
            rows.append(_row(way, preset, own, near))
    return rows


def _row(way: str, preset: str, found: Sequence[Outcome], near: float) -> dict[str, Any]:
    told = [one for one in found if np.isfinite(one.best)]
    rigid = [one for one in told if not one.compliant]
    wavy = [one for one in told if one.wavy]
    ratio = np.array([one.over_best for one in told])
    row: dict[str, Any] = {"way": way, "preset": preset, "arms": len(found)}
    row["refused"] = sum(one.refused for one in found)
    row |= _share("best", ratio <= 1.0 + WORSE)
    row |= _share("near", ratio <= 1.0 + near)
    row |= _share("known_near", _flags(one.known <= (1.0 + near) * one.best for one in told))
    row["over_best_median"] = _median(ratio)
    row["over_best_worst"] = float(ratio.max()) if len(ratio) else None
    row |= _share("harms", _flags(one.harms for one in told))
    row |= _share("harms_beyond", _flags(one.harms_beyond for one in told))
    row |= _share("worse_than_offsets", _flags(one.worse_than_offsets for one in told))
    row |= _share("compliance_of_rigid", _flags(one.gives for one in rigid))
    row["box_near"] = sum(one.box <= (1.0 + near) * one.box_best for one in told)
    row["box_harms"] = sum(one.box > (1.0 + WORSE) * one.box_nominal for one in told)
    names = ("nominal", "offsets", "recommended", "best", "reference", "reduced", "pulled", "known")
    for name in (*names, "box", "box_best", "box_nominal"):
        row[f"{name}_mm"] = _median([getattr(one, name) for one in told])
    row |= _coverage("covered", told)
    row |= _coverage("covered_smooth", [one for one in told if not one.wavy])
    row |= _coverage("covered_wavy", wavy)
    row |= _coverage("covered_wavy_silent", [one for one in wavy if not one.incomplete])
    expects = [one for one in told if np.isfinite(one.expected)]
    row |= _share("expected", _flags(one.is_expected for one in expects))
    row["found_over_expected"] = _median([one.recommended / one.expected for one in expects])
    row |= _share("incomplete_wavy", _flags(one.incomplete for one in wavy))
    row |= _share("blames", _flags(one.blames for one in told))
    row["seconds"] = _median([one.seconds for one in told])
    return row


def _flags(of: Iterable[bool]) -> np.ndarray:
    return np.array(list(of), dtype=bool)


def _share(name: str, of: np.ndarray) -> dict[str, Any]:
    found = wilson(of)
    return {
        name: int(of.sum()),
        f"{name}_of": len(of),
        f"{name}_low": found["low"],
        f"{name}_high": found["high"],
    }


def _coverage(name: str, found: Sequence[Outcome]) -> dict[str, Any]:
    """Pooled over arms; their interval takes the parameters of an arm for independent."""
    covered, parameters = (sum(getattr(one, k) for one in found) for k in ("covered", "parameters"))
    of = np.arange(parameters) < covered
    return _share(name, of)


def _median(values: Iterable[float]) -> float | None:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else None


def models_taken(found: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """How often each model is recommended, by way to measure."""
    taken: dict[str, dict[str, int]] = {}
    for one in found:
        own = taken.setdefault(one.way, {})
        own[one.model] = own.get(one.model, 0) + 1
    return {way: dict(sorted(own.items(), key=lambda pair: -pair[1])) for way, own in taken.items()}


def worst(found: Sequence[Outcome], count: int = 10) -> list[dict[str, Any]]:
    """Trials in which the recommended model is farthest from the best."""
    told = sorted((o for o in found if np.isfinite(o.best)), key=lambda one: -one.over_best)
    return [
        {"way": one.way, "preset": one.preset, "trial": one.trial, "model": one.model}
        | {f"{k}_mm": getattr(one, k) for k in ("recommended", "best", "nominal", "offsets")}
        for one in told[:count]
    ]


def markdown(said: Mapping[str, Any]) -> str:
    """The tables that people read."""
    return "\n\n".join([_choice(said["rows"]), _errors(said["rows"]), _belief(said["rows"])])


def _choice(rows: Sequence[Mapping[str, Any]]) -> str:
    head = ["measured by", "arms", "within 10 %", "95 %", "sizes known", "median", "worst"]
    head += ["worse than nominal", "beyond its interval", "95 %", "than offsets", "95 %"]
    head += ["compliance on rigid arms", "95 %"]
    return table_of(
        head,
        [
            [
                *(_where(row), f"{row['arms']}", _percent(row, "near"), _ends(row, "near")),
                _percent(row, "known_near"),
                *(_digits(row["over_best_median"]), _digits(row["over_best_worst"])),
                *(f"{row['harms']}", f"{row['harms_beyond']}", _ends(row, "harms_beyond")),
                *(f"{row['worse_than_offsets']}", _ends(row, "worse_than_offsets")),
                *(f"{row['compliance_of_rigid']} of {row['compliance_of_rigid_of']}",),
                _ends(row, "compliance_of_rigid"),
            ]
            for row in rows
        ],
    )


def _errors(rows: Sequence[Mapping[str, Any]]) -> str:
    names = ("nominal", "offsets", "recommended", "reference", "best", "reduced", "pulled", "known")
    head = ["measured by", "nominal", "offsets", "recommended", "reference", "best model"]
    head += ["QR, no priors", "pulled to nominal", "sizes known"]
    return table_of(
        head, [[_where(row), *(_mm(row[f"{name}_mm"]) for name in names)] for row in rows]
    )


def _belief(rows: Sequence[Mapping[str, Any]]) -> str:
    head = ["measured by", "covered", "95 %", "smooth", "wavy", "wavy, nothing said"]
    head += ["said of wavy", "mistakes named", "error in its interval", "found over expected"]
    return table_of(
        head,
        [
            [
                *(_where(row), _percent(row, "covered"), _ends(row, "covered")),
                *(_percent(row, "covered_smooth"), _percent(row, "covered_wavy")),
                *(_percent(row, "covered_wavy_silent"),),
                f"{row['incomplete_wavy']} of {row['incomplete_wavy_of']}",
                f"{row['blames']} of {row['blames_of']}",
                *(_percent(row, "expected"), _digits(row["found_over_expected"])),
            ]
            for row in rows
        ],
    )


def _where(row: Mapping[str, Any]) -> str:
    return f"**{row['way']}**" if row["preset"] == EVERY else f"{row['way']}, {row['preset']}"


def _percent(row: Mapping[str, Any], name: str) -> str:
    return f"{100 * row[name] / row[f'{name}_of']:.0f} %" if row[f"{name}_of"] else "-"


def _ends(row: Mapping[str, Any], name: str) -> str:
    if not row[f"{name}_of"]:
        return "-"
    return f"{100 * row[f'{name}_low']:.0f} to {100 * row[f'{name}_high']:.0f} %"


def _digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}".lstrip("0")
