"""What a diagnosis finds: one cause of residuals, as numbers and names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Cause = Literal[
    "step",
    "drift",
    "warm-up",
    "scale",
    "reach",
    "harmonic",
    "sign",
    "zero",
    "sign and zero",
    "coupling",
    "swapped joints",
    "all signs",
    "joint unit",
    "reading unit",
    "mirrored axis",
    "swapped axes",
    "turned axes",
    "inverted rotation",
    "inverted pose",
    "shifted rows",
    "shifted labels",
    "swapped rows",
    "swapped labels",
    "wrong label",
]
"""Of residuals, as a measurement goes wrong."""

GROSS: frozenset[Cause] = frozenset(
    {
        "sign",
        "zero",
        "sign and zero",
        "coupling",
        "swapped joints",
        "all signs",
        "joint unit",
        "reading unit",
        "mirrored axis",
        "swapped axes",
        "turned axes",
        "inverted rotation",
        "inverted pose",
        "shifted rows",
        "shifted labels",
    }
)
"""Causes that all rows suffer from: with them nothing that was identified is of the robot."""

MODEL: frozenset[Cause] = frozenset({"reach", "harmonic"})
"""Causes that lie in the arm, not in how it was measured: the model is incomplete there."""


@dataclass(frozen=True)
class Finding:
    """One cause that explains residuals far better than chance.

    Attributes
    ----------
    cause : str
    things : tuple of str
        What it happened to: labels of tools or targets, names of joints, axes.
    part : str
        Of what kind these are: ``tool``, ``target``, ``targets``, ``instrument``, ``joint``,
        ``axis`` or nothing.
    rows : tuple of int
        Measurements concerned: the first one after a step, those swapped or mislabelled.
    size : float
        Of the effect: a length [m], an angle [rad], a factor; NaN where it has none.
    unit : str
        ``m``, ``rad`` or nothing.
    before_m, after_m : float
        Root mean square distance left over as measured and with the cause taken out [m].
    log_odds : float
        Natural logarithm of how much likelier the measurements are with the cause than without,
        what was tried besides considered.
    also : tuple of Finding
        Other causes that explain the measurements as well.
    """

    cause: Cause
    things: tuple[str, ...]
    part: str
    rows: tuple[int, ...]
    size: float
    unit: str
    before_m: float
    after_m: float
    log_odds: float
    also: tuple[Finding, ...] = ()
