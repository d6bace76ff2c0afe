"""Run the study: ``posedesign study run visual_touch_up``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from calib.se3 import FloatArray
from posedesign.report.drawing import BLACK, BLUE, GREEN, PURPLE, VERMILION, set_answer
from posedesign.study import Advance, Options
from studies import writing
from studies.writing import Cell, cell, span, table

from . import visual_pin as pin
from . import visual_tables as tables
from .visual_bench import Bench, cell_of, joint_scatter
from .visual_pin import VARIANTS

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
    found = next(row for row in said["rows"] if row["key"] == CLOUDS["touch_up"][0])
    ours, theirs = (
        ", ".join(f"{value:.3f}" for value in values)
        for values in ([found[f"{axis}_mm"] for axis in "VHD"], paper["touch_up_mm"])
    )
    set_answer(
        figure, f"Touch-ups repeat to {ours} mm (3 sigma of V, H, D); in the paper to {theirs} mm"
    )
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


SETTINGS = writing.settings_of(__file__)
LINE_ONLY = "afresh"
"""Condition that touch-ups know nothing of."""

DIGITS = 5
"""Significant digits of what is written: more than the sampling leaves."""

FIGURE = "visual_touch_up"
CLOUD_SHOWN = 300
"""Points of a cloud that are kept: enough for its shape, few enough to see a hundred among them."""


def study(options: Options) -> dict[str, Any]:
    """How well does a camera touch up?

    A trial is a repetition of a measurement: a touch-up, a stereo measurement, a touch-up less the
    real pin. A short form has as many of all.
    """
    trials = None if options.trials is None else writing.trials_of(options, options.trials)
    rows, clouds = run(trials, advance=writing.part_of(options.advance, 0, 2, "Tables 1 and 2"))
    options.advance("Table 3", 0.5)
    said: dict[str, Any] = {"rows": rows, "pin": against_pin(trials), "derived": derived()}
    tables = {"visual_touch_up.csv": rows}
    tables["visual_less_pin.csv"] = [_flat(row) for row in said["pin"]["rows"]]
    tables |= {f"cloud_{part}.csv": cloud_rows(clouds, part) for part in CLOUDS}
    return writing.write_rounded(options.out, said, DIGITS, tables)


def plot(folder: Path) -> list[Path]:
    """Clouds of repeated measurements, and what a pin is missed by."""
    clouds = {part: writing.read_rows(folder, f"cloud_{part}.csv") for part in CLOUDS}
    return writing.save(draw(clouds, writing.read_figures(folder), SETTINGS), folder, FIGURE)


def run(
    trials: int | None = None,
    keys: Sequence[str] | None = None,
    advance: Advance = lambda what, part: None,
) -> tuple[list[dict[str, Any]], dict[str, dict[str, FloatArray]]]:
    """Tables 1 and 2 under each condition, and the clouds behind them."""
    rows, clouds = [], {}
    wanted = [c for c in SETTINGS["condition"] if keys is None or c["key"] in keys]
    for done, condition in enumerate(wanted):
        advance(condition["says"], done / len(wanted))
        row, clouds[condition["key"]] = tables.row(condition, SETTINGS, trials)
        rows.append(row)
    return rows, clouds


def cloud_rows(clouds: dict[str, dict[str, FloatArray]], part: str) -> list[dict[str, Any]]:
    """Points of the clouds that are drawn: ``touch_up`` along V, H, D or ``stereo`` in the base."""
    names = [f"{axis}_mm" for axis in (tables.AXES if part == "touch_up" else tables.BASE_AXES)]
    return [
        {"condition": key} | dict(zip(names, point, strict=True))
        for key in CLOUDS[part]
        for point in _shown(clouds[key][part]).tolist()
    ]


def _shown(cloud: FloatArray) -> FloatArray:
    """Points ``(S, 3)`` of all set-ups alike: those of one follow each other."""
    return cloud[:: -(-len(cloud) // CLOUD_SHOWN)]


def against_pin(trials: int | None = None, seen: str = "image") -> dict[str, Any]:
    """Table 3, and the largest of its figures with a pin that is as good as it is."""
    count = trials or SETTINGS["pin"]["trials"]
    set_ups = min(SETTINGS["pin"]["set_ups"], max(2, count // tables.LEAST_TRIALS))
    benches = [Bench.of(SETTINGS, {"seen": seen}, k) for k in range(set_ups)]
    rows = pin.differences(benches, SETTINGS, count)
    rng = np.random.default_rng([SETTINGS["seed"], pin.PIN])
    return {"rows": rows, "largest": pin.largest(rows, SETTINGS, rng)}


def derived() -> dict[str, Any]:
    """What the settings come to: scatter of a joint, noise of the fast camera, gain of stereo."""
    cell = cell_of(SETTINGS, SETTINGS["base"])
    scatter = joint_scatter(cell, SETTINGS["base"]["repeatability_mm"] / 1e3)
    noise = Bench.of(SETTINGS, {}).observer.noise  # type: ignore[attr-defined]
    return {
        "joint_scatter_deg": float(np.rad2deg(scatter)),
        "noise_vhs_px": noise.sigma_vhs_px.tolist(),
        "stereo_gain": list(tables.depth_of_stereo(SETTINGS["stereo"]["turns_deg"])),
    }


def markdown(said: Mapping[str, Any]) -> str:
    """What people read: Tables 2, 1 and 3, and figures that the text has besides."""
    touched = [row for row in said["rows"] if row["key"] != LINE_ONLY]  # the same as in the base
    besides = json.dumps(said["pin"]["largest"] | said["derived"])
    pin = (_flat(row) for row in said["pin"]["rows"])
    tables_ = (table(touched, TOUCHED), table(said["rows"], MET), table(pin, AGAINST_PIN))
    return "\n\n".join((*tables_, besides))


def _axes(names: Sequence[str]) -> dict[str, Cell]:
    return {name: span("s.3f", f"{name}_mm") for name in names}


def _predicted(row: Mapping[str, Any]) -> str:
    """Three figures, or none where nothing is predicted; no sign of nothing."""
    names = [f"predicted_{axis}_mm" for axis in "xyz"]
    shown = ", ".join(f"{{{name}:s+z.3f}}" for name in names)
    return cell(row, shown) if any(row[name] for name in names) else "0"


def _three_sigma(row: Mapping[str, Any]) -> str:
    return ", ".join(cell({"v": 3 * row[f"sigma_{axis}_mm"]}, "{v:s.3f}") for axis in "xyz")


HEAD: Mapping[str, Cell] = {"condition": "{says}", "trials": "{trials}"}
TOUCHED = HEAD | _axes(tables.AXES)
TOUCHED |= {"D, least to most of a set-up": "{D_least_mm:s.3f} to {D_most_mm:s.3f}"}
TOUCHED |= {"moves": "{moves:.1f}", "failed": "{failed}"}
MET = HEAD | _axes(tables.BASE_AXES)
MET |= {"Z / D of a touch-up": span(".2f", "depth_ratio"), "failed": "{stereo_failed}"}
AGAINST_PIN: Mapping[str, Cell] = {
    "45 deg about": "{about}", "touch-up": "{touch_up}",
    **{axis: f"{{mean_{axis}_mm:s+z.3f}}" for axis in "xyz"},
    "predicted": _predicted, "3 sigma": _three_sigma,
}  # fmt: skip


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """A row of Table 3 without lists."""
    out = {"about": "xyz"[int(np.argmax(row["turn_deg"]))], "touch_up": row["variant"]}
    for name in ("mean_mm", "mean_error_mm", "sigma_mm", "predicted_mm"):
        stem = name.removesuffix("_mm")
        out |= {f"{stem}_{axis}_mm": v for axis, v in zip("xyz", row[name], strict=True)}
    return out | {"trials": row["trials"], "failed": row["failed"]}
