"""Figures of a calibration: what a plan promises, what is left over before and after.

Each takes arrays and words and gives a figure; :func:`as_svg` makes it part of a page.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.se3 import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette: told apart by people who do not see red and green alike."""

GREY = "#555555"
WIDTH_IN = 8.0


def new_figure(height_in: float = 3.0, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """An empty figure as wide as a page, with panels side by side."""
    from matplotlib.figure import Figure

    # built without pyplot: no global state, no window system
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    panels = figure.subplots(1, columns, squeeze=False)[0]
    for panel in panels:
        panel.grid(True, alpha=0.25)
        panel.set_axisbelow(True)
    return figure, list(panels)


def as_svg(figure: Figure) -> str:
    """The figure as an element of a page, its texts as texts; the same bytes each time."""
    import matplotlib

    text = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "posedesign"}):
        figure.savefig(
            text, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
        )
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), flags=re.DOTALL)


def error_by_poses(error_m: Sequence[FloatArray], labels: Sequence[str]) -> Figure:
    """Predicted error of the tool point against the number of poses.

    Parameters
    ----------
    error_m : sequence of array (N,)
        Root mean square error [m] of 1, 2, .. N poses; NaN where they do not suffice.
    labels : sequence of str
        What the orders are.
    """
    figure, (panel,) = new_figure()
    for values, label, colour in zip(error_m, labels, COLOURS, strict=False):
        panel.plot(
            range(1, len(values) + 1),
            1e3 * np.asarray(values),
            "o-",
            ms=3,
            color=colour,
            label=label,
        )
    panel.set_yscale("log")
    _plain_numbers(panel)
    panel.set_xlabel("number of poses")
    panel.set_ylabel("error of the tool point\nover the box, rms [mm]")
    panel.legend(fontsize=8)
    return figure


def error_over_box(points_m: FloatArray, error_m: FloatArray) -> Figure:
    """Error of the tool point over a box, from above and from the side.

    Parameters
    ----------
    points_m : array (N, 3)
        On a grid, base frame.
    error_m : array (N,)
        [m]; NaN where the point cannot be reached. Of points behind each other the largest counts.
    """
    figure, panels = new_figure(3.4, 2)
    least, most = 1e3 * np.nanmin(error_m), 1e3 * np.nanmax(error_m)
    for panel, (a, b, title) in zip(
        panels, ((0, 1, "from above"), (0, 2, "from the side")), strict=True
    ):
        xs, ys = (np.unique(points_m[:, axis].round(6)) for axis in (a, b))
        values = np.full((len(ys), len(xs)), np.nan)
        for k, x in enumerate(xs):
            for i, y in enumerate(ys):
                here = np.isclose(points_m[:, a], x) & np.isclose(points_m[:, b], y)
                found = 1e3 * error_m[here & np.isfinite(error_m)]
                values[i, k] = found.max() if found.size else np.nan
        image = panel.pcolormesh(
            1e3 * xs, 1e3 * ys, values, cmap="viridis_r", vmin=least, vmax=most, shading="nearest"
        )
        for k, x in enumerate(xs):
            for i, y in enumerate(ys):
                value = values[i, k]
                panel.text(
                    1e3 * x,
                    1e3 * y,
                    f"{value:.3g}" if np.isfinite(value) else "out of\nreach",
                    ha="center",
                    va="center",
                    fontsize=8,
                    color="black" if value < (least + most) / 2 or np.isnan(value) else "white",
                )
        panel.grid(False)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(f"{'xyz'[a]} [mm]")
        panel.set_ylabel(f"{'xyz'[b]} [mm]")
    figure.colorbar(image, ax=panels, label="error, rms [mm]")
    return figure


def residuals_by_pose(
    names: Sequence[str], residuals_mm: Mapping[str, FloatArray], outliers: BoolArray
) -> Figure:
    """What is left over at each pose by each model, outliers marked.

    Parameters
    ----------
    names : sequence of str
        Of the poses, N of them.
    residuals_mm : mapping of str to array (N,)
        By the name of the model.
    outliers : array (N,) of bool
    """
    figure, (panel,) = new_figure(3.2)
    at = np.arange(len(names))
    for (label, values), colour in zip(residuals_mm.items(), (GREY, *COLOURS), strict=False):
        panel.plot(at, values, "o", ms=4, color=colour, label=label)
        median = float(np.median(values))
        panel.axhline(median, color=colour, lw=1, ls="--")
    if outliers.any():
        last = list(residuals_mm.values())[-1]
        panel.plot(at[outliers], last[outliers], "o", ms=11, mfc="none", mec="red", label="outlier")
    panel.set_yscale("log")
    _plain_numbers(panel)
    step = max(1, -(-len(names) // 40))
    panel.set_xticks(at[::step], list(names)[::step], rotation=90, fontsize=7, parse_math=False)
    panel.set_ylabel("left over [mm]; dashed: median")
    panel.legend(fontsize=8)
    return figure


def residuals_by_joint(
    joints: Sequence[str], q_deg: FloatArray, residuals_mm: Mapping[str, FloatArray]
) -> Figure:
    """What is left over against each joint's angle: a slope or a bow is what a model leaves out.

    Parameters
    ----------
    q_deg : array (N, n)
    residuals_mm : mapping of str to array (N,)
    """
    figure, panels = new_figure(2.4, len(joints))
    for k, (panel, joint) in enumerate(zip(panels, joints, strict=True)):
        for (label, values), colour in zip(residuals_mm.items(), (GREY, *COLOURS), strict=False):
            panel.plot(q_deg[:, k], values, "o", ms=3, color=colour, label=label)
        panel.set_yscale("log")
        _plain_numbers(panel)
        panel.set_xlabel(f"{joint} [deg]", fontsize=8, parse_math=False)
        panel.tick_params(labelsize=7)
        if k:
            panel.sharey(panels[0])
            panel.tick_params(labelleft=False, which="both")
    panels[0].set_ylabel("left over [mm]", fontsize=8)
    return figure


def _plain_numbers(panel: Axes) -> None:
    """Numbers on a logarithmic axis as people write them."""
    from matplotlib.ticker import FuncFormatter

    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    few = FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    panel.yaxis.set_minor_formatter(few)
    panel.tick_params(which="minor", labelsize=7)
