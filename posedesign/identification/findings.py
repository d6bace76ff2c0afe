"""What :mod:`calib.identification.diagnosis` finds, in words and for ``identification.json``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from calib.identification.held import Cause, Finding
from posedesign.files.measurements import MeasurementTable

_CLEARLY_LESS = 0.8
"""Residual over that as measured, from which its size says what was found."""

_MOST_SHOWN = 99.0


def in_words(finding: Finding, table: MeasurementTable) -> str:
    """A finding in one line: what happened, where, how much is explained, what to do."""
    what, remedy = _said(finding, table)
    after, before = 1e3 * finding.after_m, 1e3 * finding.before_m
    if not math.isfinite(before):
        shown = f"residual {after:.2g} mm, in place of no answer"
    elif finding.after_m < _CLEARLY_LESS * finding.before_m:
        shown = f"residual {after:.2g} in place of {before:.2g} mm"
    else:  # an arm can be bent to explain it, too
        odds = min(finding.log_odds / math.log(10.0), _MOST_SHOWN)
        shown = f"errors of the arm that explain it as well are 1e{odds:.0f} times less likely"
    others = [_said(other, table)[0] for other in finding.also[:2]]
    also = f" (or {', or '.join(others)})" if others else ""
    effect = ""
    if math.isfinite(finding.change_m):
        effect = (
            "; taken into account, it changes the errors of the arm by "
            f"{1e3 * finding.change_m:.2g} mm ({finding.sigmas:.1f} sigma)"
        )
    return f"{what}{also}: {shown}{effect}; {remedy}"


def as_dict(finding: Finding, table: MeasurementTable) -> dict[str, Any]:
    """A finding for ``identification.json``: degrees and millimetres."""
    factor, unit = _display(finding)
    return {
        "cause": finding.cause,
        "grade": finding.grade,
        "part": finding.part,
        "things": list(finding.things),
        "poses": [table.data.names[i] for i in finding.rows],
        "lines": [table.lines[i] for i in finding.rows],
        "size": finding.size * factor,
        "unit": unit,
        "rms_before_mm": 1e3 * finding.before_m,
        "rms_after_mm": 1e3 * finding.after_m,
        "log_odds": finding.log_odds,
        "change_mm": 1e3 * finding.change_m,
        "change_sigmas": finding.sigmas,
        "text": in_words(finding, table),
        "also": [_said(other, table)[0] for other in finding.also],
    }


def _display(finding: Finding) -> tuple[float, str]:
    return {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}.get(finding.unit, (1.0, ""))


def _said(finding: Finding, table: MeasurementTable) -> tuple[str, str]:
    """What seems to have happened, and what to do."""
    if finding.cause in ("step", "drift", "warm-up"):
        return _changed(finding, table)
    if finding.cause in ("swapped rows", "swapped labels", "wrong label", "mistyped joint"):
        return _mixed_up(finding, table)
    if finding.cause in ("coupled joints", "joint scale"):
        return _geared(finding)
    if finding.cause in ("scale", "harmonic", "reach"):
        return _followed(finding)
    what, remedy = _OF_ALL_ROWS[finding.cause]
    row = {"later": "low", "earlier": "high"}  # of what stands one row off
    things = [*(row.get(thing, thing) for thing in finding.things), "", "", ""]
    off = things[1].lstrip("+")
    return what.format(*things, off=off, listed=", ".join(finding.things)), remedy


_SIGNS = "bring the joints into the signs and zeros of the URDF, or give them as pendant_j.."
_AXES = "give the readings in a right-handed frame, axes in order"
_SHIFTED = "is a row missing, or one there twice?"
_OF_ALL_ROWS: dict[Cause, tuple[str, str]] = {
    "sign": ("as if {0} were counted the other way", _SIGNS),
    "zero": ("as if the zero of {0} were {off} deg off", _SIGNS),
    "sign and zero": ("as if {0} were counted the other way from a zero {off} deg off", _SIGNS),
    "coupling": (
        "as if {0} were shown {2} {1}, as on FANUC pendants",
        "give the joints as pendant_j1_deg .. with robot.controller in the cell (and "
        "robot.coupling, if it is no FANUC), or in URDF joints",
    ),
    "swapped joints": ("as if {0} and {1} were exchanged", "put the columns in order"),
    "joint unit": ("as if joints were in {0}", "give them in degrees"),
    "all signs": ("as if all joints were counted the other way", _SIGNS),
    "reading unit": ("as if readings were in {listed}", "give them in mm"),
    "mirrored axis": ("as if an axis of the readings were mirrored, or two exchanged", _AXES),
    "swapped axes": ("as if the axes {0} and {1} of readings were exchanged", _AXES),
    "turned axes": ("as if the axes of places were in the order {listed}", _AXES),
    "inverted rotation": (
        "as if the rotations of readings were inverted",
        "give w_deg, p_deg, r_deg of the frame that places are of",
    ),
    "inverted pose": (
        "as if poses were read from the other side",
        "a camera-pose is the target in the camera, a pose the tool in the instrument",
    ),
    "shifted labels": ("as if targets stood one row too {0}", _SHIFTED),
    "shifted rows": ("as if readings stood one row too {0}", _SHIFTED),
}
"""What all rows suffer from, by its things, and what to do."""


def _changed(finding: Finding, table: MeasurementTable) -> tuple[str, str]:
    factor, unit = _display(finding)
    size = f"{finding.size * factor:.2g} {unit}"
    thing = _thing(finding, table)
    if finding.cause == "drift":
        return (
            f"{thing} seems to drift, by {size} from the first measurement to the last",
            "let arm and instrument warm up, fix what moves, and measure again",
        )
    if finding.cause == "warm-up":
        return (
            f"{thing} seems to go off by {size} and settle, as when something warms up",
            "leave out what was measured first, or measure again when all is warm",
        )
    at = _place(finding.rows[0], table)
    if finding.part == "payload":
        return (
            f"from {at} on the flange seems to carry a load that is not described, which bends the "
            f"arm by up to {size}",
            "describe the load as a [[payload]] of the cell and name it in the column payload",
        )
    verb = "lost its zero by" if finding.part == "joint" else "moved by"
    if finding.part == "target":
        remedy = "give its measurements from there on a target name of their own, or measure again"
    else:
        remedy = "identify the measurements before and after it apart, or measure again"
    return f"{thing} seems to have {verb} {size} before {at}", remedy


def _thing(finding: Finding, table: MeasurementTable) -> str:
    name = ", ".join(finding.things)
    if finding.part == "tool":
        return "the tool" if name == "tool" else f"the tool {name}"
    if finding.part == "instrument":
        return f"the {'target' if 'camera-pose' in table.kinds else 'instrument'} {name}"
    if finding.part == "targets":
        return "what all targets, or the arm, stand on"
    return name if finding.part == "joint" else f"the target {name}"


def _place(row: int, table: MeasurementTable) -> str:
    return f"{table.data.names[row]} (line {table.lines[row]})"


def _mixed_up(finding: Finding, table: MeasurementTable) -> tuple[str, str]:
    places = [_place(row, table) for row in finding.rows]
    if finding.cause == "wrong label":
        was = table.data.targets[table.data.target[finding.rows[0]]]
        what = f"as if {places[0]} were of the target {finding.things[0]}, not {was}"
    elif finding.cause == "mistyped joint":
        what = f"as if {finding.things[0]} of {places[0]} were wrong"
        return what, "put the joint right, or leave the pose out"
    elif finding.cause == "swapped labels":
        what = f"as if the targets of {places[0]} and {places[1]} were exchanged"
    else:
        what = f"as if the readings of {places[0]} and {places[1]} were exchanged"
    return what, "put the table right, or leave these rows out"


def _geared(finding: Finding) -> tuple[str, str]:
    part = f"{abs(finding.size) * 100:.2g} %"
    if finding.cause == "joint scale":
        way = "more" if finding.size > 0 else "less"
        return (
            f"{finding.things[0]} seems to turn by {part} {way} than it shows",
            "check its gear ratio in the controller, and the unit of its column",
        )
    joint, of = finding.things
    way = "" if finding.size > 0 else "minus "
    return (
        f"{joint} seems to turn by {way}{part} of {of} besides what it shows",
        "give the joints as the URDF counts them: see robot.coupling and robot.controller",
    )


def _followed(finding: Finding) -> tuple[str, str]:
    if finding.cause == "scale":
        way = "long" if finding.size > 0 else "short"
        return (
            f"readings of {finding.things[0]} seem to be {abs(finding.size) * 100:.2g} % too {way}",
            "check the scale of the instrument or the size of its target, and the unit",
        )
    if finding.cause == "reach":
        return (
            f"the model is incomplete: the arm bends by some {1e3 * abs(finding.size):.2g} mm more "
            "at full reach",
            "free compliance, with the masses of links and tool in the cell",
        )
    joint, wave = finding.things
    turn = "once" if wave == "1" else f"{wave} times"
    return (
        f"the model is incomplete: {joint} is off by a wave of "
        f"{np.degrees(finding.size):.2g} deg that comes {turn} a turn",
        'free "harmonics" in parameters.models',
    )
