"""``acceptance_test.json``, ``acceptance.json``, ``recheck.json``: a test, its verdict, a recheck.

The rule is written before anything is measured: what is judged by it cannot choose it. All are
hostile until read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from calib.errors import InputError
from posedesign.acceptance.drift import Explanation, Recheck
from posedesign.acceptance.iso9283 import Figure
from posedesign.acceptance.judge import Judged, Verdict
from posedesign.acceptance.places import AcceptancePlan, AcceptanceRequest
from posedesign.acceptance.sampling import MOST_PLACES
from posedesign.files import origin_of, plain
from posedesign.files.json_files import Number, ReadFromFile, Text, read_json
from posedesign.files.measurements import MeasurementTable
from posedesign.files.origin import checksum

RULE, RESULT, RECHECK = "acceptance_test.json", "acceptance.json", "recheck.json"

_WRITTEN = "give the file that posedesign prove has written"


class Rule(ReadFromFile):
    """An acceptance test as it was planned."""

    test: Text
    limit_mm: Annotated[Number, Field(gt=0.0)]
    content: Number
    confidence: Number
    allowed: Annotated[int, Field(strict=True)]
    cycles: Annotated[int, Field(strict=True)]
    poses: Annotated[list[Text], Field(min_length=1, max_length=4 * MOST_PLACES)]
    statement: Text
    where: Text
    chance: Number | None = None
    touched: Annotated[tuple[Text, ...], Field(max_length=MOST_PLACES)] = ()
    """Targets that all poses touch."""
    elsewhere: Annotated[str, Field(max_length=1000)] = ""  # what nothing is proven of
    expected_elsewhere_mm: Number | None = None  # by the identification

    @property
    def request(self) -> AcceptanceRequest:
        return AcceptanceRequest(
            self.test,
            self.limit_mm / 1e3,
            self.content,
            self.confidence,
            self.allowed,
            cycles=self.cycles,
        )


Interval = tuple[float | None, float | None, float | None]
"""A figure and the ends of its interval."""


class PoseRow(ReadFromFile):
    """AP and RP of a pose [mm, deg]."""

    pose: str
    cycles: int
    ap_mm: Interval
    deviation_mm: tuple[float, float, float]
    rp_mm: Interval
    ap_deg: tuple[float, float, float] | None = None
    rp_deg: tuple[Interval, ...] = ()


class DistanceRow(ReadFromFile):
    """AD and RD of a distance [mm]."""

    first: str
    second: str
    cycles: int
    commanded_mm: float
    ad_mm: Interval
    rd_mm: Interval


class Arm(ReadFromFile):
    """Errors of an arm in a test [mm]."""

    arm: str
    passed: bool
    beyond: int
    proven: float
    rms_mm: Interval
    worst_mm: float
    errors_mm: list[float]
    poses: tuple[PoseRow, ...] = ()
    distances: tuple[DistanceRow, ...] = ()


class AcceptanceFile(ReadFromFile):
    """What is read of an ``acceptance.json``; ``places_mm``: x, y, z in the base frame."""

    rule: Rule
    passed: bool
    frame: str
    poses: list[str]
    places_mm: list[tuple[float, float, float]]
    missing: tuple[str, ...] = ()
    arms: Annotated[list[Arm], Field(min_length=1, max_length=2)]
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _as_many(self) -> AcceptanceFile:
        counts = {len(self.poses), len(self.places_mm), *(len(a.errors_mm) for a in self.arms)}
        if len(counts) > 1:
            raise ValueError("poses, places and errors are not as many")
        return self

    @property
    def final(self) -> Arm:
        """The arm that was judged."""
        return self.arms[-1]


def read_rule(path: Path) -> Rule:
    """Read an ``acceptance_test.json``."""
    return read_json(path, Rule, "plan the test first, with posedesign prove")


def read_result(path: Path) -> AcceptanceFile:
    """Read an ``acceptance.json``."""
    return read_json(path, AcceptanceFile, _WRITTEN)


class SingleCause(ReadFromFile):
    """What a single cause would explain [SI]."""

    cause: Text
    unit: Text
    change_si: list[Number]
    sigma_si: list[Number]
    sum_of_squares_left: Number
    p_left: Number


class RecheckFile(ReadFromFile):
    """What is read of a ``recheck.json``."""

    p_value: Number
    sum_of_squares: Number
    degrees_of_freedom: Annotated[int, Field(strict=True)]
    causes: list[SingleCause]


def read_recheck(path: Path) -> Recheck:
    """Read a ``recheck.json``."""
    found = read_json(path, RecheckFile, "give the file that posedesign recheck has written")
    causes = tuple(
        Explanation(
            each.cause,
            each.unit,
            np.array(each.change_si),
            np.array(each.sigma_si),
            each.sum_of_squares_left,
            each.p_left,
        )
        for each in found.causes
    )
    return Recheck(found.degrees_of_freedom, found.sum_of_squares, found.p_value, causes)


def recheck_as_dict(found: Recheck) -> dict[str, Any]:
    """The content of ``recheck.json``: the test, and what each single cause would explain."""
    content: dict[str, Any] = plain(
        {
            "same": found.same,
            "p_value": found.p_value,
            "sum_of_squares": found.square,
            "degrees_of_freedom": found.freedom,
            "possible": [each.cause for each in found.possible],
            "causes": [
                {
                    "cause": each.cause,
                    "unit": each.unit,
                    "change_si": each.change,
                    "sigma_si": each.sigma,
                    "sum_of_squares_left": each.left,
                    "p_left": each.p_left,
                }
                for each in found.explanations
            ],
        }
    )
    return content


def rule_as_dict(plan: AcceptancePlan) -> dict[str, Any]:
    """The content of ``acceptance_test.json``."""
    asked = plan.request
    content: dict[str, Any] = plain(
        {
            "test": asked.test,
            "limit_mm": 1e3 * asked.limit_m,
            "content": asked.content,
            "confidence": asked.confidence,
            "allowed": asked.allowed,
            "cycles": asked.times,
            "poses": list(plan.poses.kept_names),
            "statement": plan.statement,
            "where": plan.where,
            "chance": plan.chance if np.isfinite(plan.chance) else None,
            "touched": list(plan.touched),
            "elsewhere": plan.elsewhere,
            "expected_elsewhere_mm": 1e3 * plan.expected_elsewhere_m
            if np.isfinite(plan.expected_elsewhere_m)
            else None,
        }
    )
    return content


def verdict_as_dict(rule: Rule, verdict: Verdict) -> dict[str, Any]:
    """The content of ``acceptance.json``: millimetres and degrees."""
    content: dict[str, Any] = plain(
        {
            "rule": rule.model_dump(),
            "passed": verdict.passed(),
            "frame": verdict.frame,
            "poses": list(verdict.names),
            "places_mm": 1e3 * verdict.points_m,
            "missing": list(verdict.missing),
            "arms": [_arm(verdict, judged) for judged in verdict.judged],
            "notes": list(verdict.notes),
        }
    )
    return content


def _arm(verdict: Verdict, judged: Judged) -> dict[str, Any]:
    return {
        "arm": judged.arm,
        "passed": verdict.passed(judged),
        "beyond": judged.beyond,
        "proven": verdict.proven(judged),
        "rms_mm": _ends(judged.rms),
        "worst_mm": 1e3 * judged.worst_m,
        "errors_mm": 1e3 * judged.places,
        "poses": [
            {
                "pose": name,
                "cycles": found.cycles,
                "ap_mm": _ends(found.accuracy),
                "deviation_mm": 1e3 * found.deviation,
                "rp_mm": _ends(found.repeatability),
                "ap_deg": None if found.angles is None else np.rad2deg(found.angles),
                "rp_deg": [_ends(each, np.rad2deg(1.0)) for each in found.angle_repeatability],
            }
            for name, found in judged.poses.items()
        ],
        "distances": [
            {
                "first": first,
                "second": second,
                "cycles": found.cycles,
                "commanded_mm": 1e3 * found.commanded_m,
                "ad_mm": _ends(found.accuracy),
                "rd_mm": _ends(found.repeatability),
            }
            for (first, second), found in judged.distances.items()
        ],
    }


def _ends(figure: Figure, factor: float = 1e3) -> list[float | None]:
    values = (figure.value, figure.low, figure.high)
    return [float(factor * v) if np.isfinite(v) else None for v in values]


def check_not_fitted(
    measurements: Path,
    table: MeasurementTable,
    identification: Path,
    fitted: MeasurementTable | None,
) -> list[str]:
    """Refuse a test by what was identified from; what cannot be told is said.

    ``fitted``: what the identification was made from, where that is there. Raises InputError: the
    file, or a row of it, was identified from.
    """
    own, there = checksum(measurements), origin_of(identification)
    used = dict(there.inputs) if there is not None else {}
    if own in used.values():
        raise InputError(
            f"{measurements} is what {identification.name} was identified from: it proves nothing",
            hint="measure the poses of the test, and give these",
            name="measurements",
        )
    notes = []
    if fitted is None:
        notes.append(
            "not checked: rows that were identified from, because their file is not beside the "
            "identification"
        )
    else:
        rows = set(map(bytes, _as_rows(fitted)))
        again = sum(bytes(row) in rows for row in _as_rows(table))
        if again:
            raise InputError(
                f"{again} of {table.data.count} rows of {measurements} were identified from: they "
                "prove nothing",
                hint="leave them out, or measure others",
                name="measurements",
            )
        n = fitted.data.postures.shape[1]
        stood = {bytes(row[:n]) for row in _as_rows(fitted)}
        at = sum(bytes(row[:n]) in stood for row in _as_rows(table))
        if at:
            notes.append(f"{at} measurements are at postures that were identified from")
    return notes


def _as_rows(table: MeasurementTable) -> Sequence[np.ndarray[Any, Any]]:
    """Joints, and what was read, of each row: rounded to what a file has."""
    data = table.data
    read = np.zeros((data.count, 6))
    if data.observed is not None:
        read[:, : min(6, data.observed.shape[1])] = data.observed[:, :6]
    return list(np.round(np.hstack([data.postures, read]), 9) + 0.0)
