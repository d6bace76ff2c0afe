"""The figure of the study: clouds of repeated measurements, and what a pin is missed by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from visual_pin import VARIANTS

from calib.se3 import FloatArray
from studies.drawing import BLACK, BLUE, GREEN, PURPLE, VERMILION

TOUCH, STEREO, LOST, PAPER = BLUE, VERMILION, PURPLE, BLACK

CLOUDS = {"touch_up": ("images", "fast"), "stereo": ("images", "any side, tenth")}
"""What is drawn, and under which conditions."""

_UM = 1e3

Cloud = Sequence[Mapping[str, Any]]


def draw(clouds: Mapping[str, Cloud], said: Mapping[str, Any], settings: dict[str, Any]) -> Figure:
    """Touch-ups across and in depth, stereo, and the differences to a pin.

    Parameters
    ----------
    clouds : mapping
        Rows of the two tables of clouds.
    said : mapping
        Key figures.
    settings : dict
        Of the study: what the paper has.
    """
    figure = Figure(figsize=(12.0, 9.0), layout="constrained")
    (across, depth), (stereo, against) = figure.subplots(2, 2)
    paper = settings["paper"]
    H, V, D = 1, 0, 2
    images, fast = (_points(clouds["touch_up"], key) for key in CLOUDS["touch_up"])
    trials = {row["key"]: row["trials"] for row in said["rows"]}
    for panel, x, y in ((across, H, V), (depth, H, D)):
        panel.plot(
            _UM * fast[:, x],
            _UM * fast[:, y],
            ".",
            color="#bbbbbb",
            ms=3,
            zorder=1,
            rasterized=True,
        )
        panel.plot(_UM * images[:, x], _UM * images[:, y], "o", color=TOUCH, ms=4, alpha=0.8)
        _ring(panel, paper["touch_up_mm"][x], paper["touch_up_mm"][y])
        panel.set_xlabel("H [µm]")
    across.set_ylabel("V [µm]")
    across.set_aspect("equal", adjustable="datalim")
    depth.set_ylabel("D [µm]")
    across.set_title("touch-ups, across the line of sight (Table 2)", fontsize=11)
    depth.set_title("the same in depth", fontsize=11)
    _stereo(stereo, clouds["stereo"], paper)
    _against(against, said["pin"]["rows"], paper, settings)
    across.plot([], [], "o", color=TOUCH, ms=4, label=f"through pictures, {trials['images']}")
    shown = f"projected circle, {len(fast)} of {trials['fast']}"
    across.plot([], [], ".", color="#bbbbbb", ms=6, label=shown)
    across.plot([], [], "--", color=PAPER, label="3 sigma of the paper")
    for panel in (across, stereo, against):
        panel.legend(fontsize=9, loc="upper right", framealpha=0.9)
    for panel in (across, depth, stereo):
        panel.grid(True, alpha=0.3)
    return figure


def _points(cloud: Cloud, condition: str) -> FloatArray:
    """Points ``(S, 3)`` [mm] of a condition."""
    rows = [list(row.values())[1:] for row in cloud if row["condition"] == condition]
    return np.array(rows, dtype=float)


def _ring(panel: Axes, across_mm: float, up_mm: float) -> None:
    """Ellipse with the paper's 3 sigma as half axes."""
    size = (2 * _UM * across_mm, 2 * _UM * up_mm)
    panel.add_patch(Ellipse((0.0, 0.0), *size, fill=False, ls="--", lw=1.5, color=PAPER, zorder=3))


def _stereo(panel: Axes, cloud: Cloud, paper: dict[str, list[float]]) -> None:
    met, rest = (_points(cloud, key) for key in CLOUDS["stereo"])
    y, z = _UM * rest[:, 1], _UM * rest[:, 2]
    panel.plot(y, z, "s", color=LOST, ms=2.5, label="a tenth of it left", rasterized=True)
    panel.plot(
        _UM * met[:, 1], _UM * met[:, 2], "D", color=STEREO, ms=4, label="lost motion taken up"
    )
    _ring(panel, paper["stereo_mm"][1], paper["stereo_mm"][2])
    panel.plot([], [], "--", color=PAPER, label="3 sigma of the paper")
    panel.set_xlabel("Y of the base [µm]")
    panel.set_ylabel("Z of the base, along the line of sight [µm]")
    panel.set_title("stereo from three view lines, -15, 0, 15 deg (Table 1)", fontsize=11)


def _against(
    panel: Axes, pin: list[dict[str, Any]], paper: dict[str, Any], settings: dict[str, Any]
) -> None:
    """Differences of Table 3, a group of three axes for each turn."""
    turns = settings["pin"]["turns_deg"]
    place = np.arange(3 * len(turns)) + np.repeat(np.arange(len(turns)), 3)  # a gap between turns
    bar = _UM * settings["paper"]["pin_bar_mm"]
    panel.axhspan(-bar, bar, color="#eeeeee", lw=0, label="within .2 mm")
    marks = zip(VARIANTS, ("o", "^", "s"), (TOUCH, STEREO, GREEN), (-0.2, 0.0, 0.2), strict=True)
    for variant, mark, colour, aside in marks:
        rows = [row for row in pin if row["variant"] == variant]
        mean = _UM * np.concatenate([row["mean_mm"] for row in rows])
        sigma = _UM * np.concatenate([row["sigma_mm"] for row in rows])
        panel.errorbar(
            place + aside, mean, 3 * sigma, fmt=mark, color=colour, ms=5, lw=1, label=variant
        )
    expected = np.concatenate([r["predicted_mm"] for r in pin if r["variant"] == VARIANTS[0]])
    panel.plot(place - 0.2, _UM * expected, "_", color=PAPER, ms=14, mew=1.5, label="predicted")
    printed = _UM * np.concatenate(paper["pin_mm"])
    panel.plot(place + 0.4, printed, "x", color=PAPER, ms=6, label="paper's Table 3")
    names = [
        f"{axis}\n{'turned about ' + 'xyz'[k] if axis == 'y' else ''}"
        for k in range(3)
        for axis in "xyz"
    ]
    panel.set_xticks(place, names)
    panel.set_ylabel("visual less pin, tip axes [µm]; bars 3 sigma")
    panel.set_ylim(-300, 420)
    panel.set_title("45 deg: touch-up less real pin (Table 3)", fontsize=11)
