"""Figures of a calibration: what a plan promises, what is left over before and after.

Each takes arrays and words and draws into a figure, or a part of one.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import CalibError
from calib.robots import NO_EXTERNAL_AXES, ExternalAxes
from calib.se3 import BoolArray, FloatArray
from posedesign.files import Claim, Results, write_bytes_atomic
from posedesign.report.drawing import COLOURS, GREY, MARKS, log_y

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_MODELS = (GREY, *COLOURS)
MOST_NUMBERS = 60
"""Fields of a map that have their number written in."""

MOST_NAMED = 10
"""Outliers that are named."""

LONGEST_NAME = 20
"""Letters of a name that is written beside an axis."""

WIDTH_IN, DPI = 8.0, 130


def new_figure(height_in: float = 3.0) -> Figure:
    """An empty figure as wide as a page."""
    from matplotlib.figure import Figure

    # built without pyplot: no global state, no window system
    return Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")


def panels_of(figure: Figure | SubFigure, columns: int = 1) -> list[Axes]:
    """Panels side by side."""
    panels = figure.subplots(1, columns, squeeze=False)[0]
    for panel in panels:
        panel.grid(True, alpha=0.25)
        panel.set_axisbelow(True)
    return list(panels)


def draw(out: Results, files: Sequence[Claim], figure: Callable[[], Figure | None]) -> None:
    """Write a figure as picture and as drawing, the two files that were claimed for it.

    Where there is nothing to be drawn, the figure of an earlier time goes.
    """
    try:
        drawn = figure()
    except CalibError:  # no place of the box can be reached, say: results stand without it
        drawn = None
    if drawn is None:
        out.remove(*((file.path.name, file.origin.purpose) for file in files))
        return
    picture, drawing = files
    write_bytes_atomic(picture, as_png(drawn))
    write_bytes_atomic(drawing, as_svg(drawn).encode())


def rows_of(figure: Figure, heights: Sequence[float]) -> list[SubFigure]:
    """Parts one below the other, as high as these against each other."""
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    return [part for (part,) in parts]


def _take_as_written(figure: Figure) -> None:
    """Draw texts with a $ as they are: names from files are no formulas."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        written = text.get_text() if isinstance(text, Text) else ""
        if isinstance(text, Text) and "$" in written and _OF_TICKS not in written:
            text.set_parse_math(False)


@contextmanager
def _any_letters() -> Iterator[None]:
    """Draw letters that the font does not have, of names from files, as boxes and say nothing."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing", UserWarning)
        yield


_OF_TICKS = r"\mathdefault"
"""Stands in the powers of ten that axes write."""


def as_png(figure: Figure) -> bytes:
    """The figure as a picture, and all of it in its place from then on."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    _take_as_written(figure)
    data = io.BytesIO()
    engine = figure.get_layout_engine()
    with _any_letters():
        if engine is not None:
            engine.execute(figure)
            # another time takes as long as drawing, and moves nothing by a tenth of a pixel
            figure.set_layout_engine("none")
        # `savefig` would draw all of it once more before
        FigureCanvasAgg(figure).print_png(data)  # type: ignore[no-untyped-call]
    return data.getvalue()


def as_svg(figure: Figure) -> str:
    """The figure as an element of a page, its texts as texts; the same bytes each time."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _take_as_written(figure)
    text = io.StringIO()
    own = matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "posedesign"})
    with own, _any_letters():
        # the same, of which `savefig` would draw all before
        FigureCanvasSVG(figure).print_svg(  # type: ignore[no-untyped-call]
            text, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
        )
    drawn = re.sub(r"^.*?(?=<svg)", "", text.getvalue(), flags=re.DOTALL)
    return _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", drawn)


_NOT_IN_XML = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f]")
"""Characters that XML does not have (XML 1.0, 2.2): names of pictures may have them."""


def error_by_poses(
    figure: Figure | SubFigure, error: Mapping[str, FloatArray], what: str, *, first: int = 1
) -> None:
    """Draw predicted errors against the number of poses.

    ``error`` (N,): by what the order of the poses is: of 1, 2, .. N of them; NaN where they do not
    suffice. ``what``: what stands beside the axis, with its unit. ``first``: how many poses the
    first error is that of.
    """
    (panel,) = panels_of(figure)
    most = 0
    for (label, values), colour, mark, size in zip(
        error.items(), COLOURS, MARKS, (6, 3, 3, 3, 3, 3), strict=False
    ):
        at = first + np.arange(len(values))
        most = max(most, int(at[-1]))
        # the first is seen below another
        panel.plot(at, values, "-", marker=mark, ms=size, color=colour, label=label)
        if np.isfinite(values[-1]):
            text, end = f"{values[-1]:.2g}", (float(at[-1]), float(values[-1]))
            panel.annotate(text, end, (5, 0), textcoords="offset points", va="center", fontsize=8)
    log_y(panel, what)
    panel.set_xlim(right=1.07 * most)
    panel.set_xlabel("number of poses")
    panel.legend(fontsize=8)


def error_over_box(figure: Figure | SubFigure, points_m: FloatArray, error_m: FloatArray) -> None:
    """Draw the error of the tool point over a box, from above and from the side.

    ``points_m`` (N, 3): on a grid, base frame. ``error_m`` (N,): [m]; NaN where the point cannot be
    reached. Of points behind each other the largest counts.
    """
    panels = panels_of(figure, 2)
    finite = 1e3 * error_m[np.isfinite(error_m)]
    least, most = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    for panel, (a, b, title) in zip(
        panels, ((0, 1, "from above"), (0, 2, "from the side")), strict=True
    ):
        xs, ys = (np.unique(points_m[:, axis].round(6)) for axis in (a, b))
        values = np.full((len(ys), len(xs)), np.nan)
        column, row = (np.searchsorted(v, points_m[:, k].round(6)) for v, k in ((xs, a), (ys, b)))
        np.fmax.at(values, (row, column), 1e3 * error_m)
        image = panel.pcolormesh(
            1e3 * xs, 1e3 * ys, values, cmap="viridis_r", vmin=least, vmax=most, shading="nearest"
        )
        few = values.size <= MOST_NUMBERS
        for (i, k), value in np.ndenumerate(values if few else np.empty((0, 0))):
            panel.text(
                float(1e3 * xs[k]),
                float(1e3 * ys[i]),
                f"{value:.3g}" if np.isfinite(value) else "out of\nreach",
                ha="center",
                va="center",
                fontsize=8,
                color="white" if value > (least + most) / 2 else "black",
            )
        panel.grid(False)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(f"{'xyz'[a]} [mm]")
        panel.set_ylabel(f"{'xyz'[b]} [mm]")
    figure.colorbar(image, ax=panels, label="error of the tool point\nrms, expected [mm]")


def residuals_by_pose(
    figure: Figure | SubFigure,
    names: Sequence[str],
    residuals: Mapping[str, FloatArray],
    outliers: BoolArray,
    unit: str = "mm",
) -> None:
    """Draw the residual at each pose by each model, outliers marked and named.

    ``names``: of the poses, N of them. ``residuals`` (N,): by the name of the model, in the unit.
    ``outliers`` (N,): of the last model.
    """
    (panel,) = panels_of(figure)
    at = np.arange(len(names))
    for (label, values), colour, mark in zip(residuals.items(), _MODELS, MARKS, strict=False):
        median = float(np.median(values))
        panel.plot(at, values, mark, ms=4, color=colour, label=f"{label}: median {median:.2g}")
        panel.axhline(median, color=colour, lw=1, ls="--")
    last = list(residuals.values())[-1]
    if outliers.any():
        panel.plot(at[outliers], last[outliers], "o", ms=11, mfc="none", mec="red", label="outlier")
    for k in np.flatnonzero(outliers)[:MOST_NAMED]:
        panel.annotate(
            shortened(names[k]),
            (float(at[k]), float(last[k])),
            (8, -2),  # the legend is above
            textcoords="offset points",
            va="top",
            fontsize=8,
            color="red",
            parse_math=False,
        )
    panel.set_ylabel(f"residual [{unit}]")
    if all((values > 0).all() for values in residuals.values()):
        log_y(panel, panel.get_ylabel())
    name_ticks(panel, names)
    panel.legend(fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)


def name_ticks(panel: Axes, names: Sequence[str]) -> None:
    """Name poses along x, each as long as there is space, every so many of hundreds."""
    step = max(1, -(-len(names) // (40 if len(names) <= 80 else 20)))
    at = range(0, len(names), step)
    panel.set_xticks(
        at, [shortened(names[k]) for k in at], rotation=90, fontsize=7, parse_math=False
    )


def shortened(name: str, letters: int = LONGEST_NAME) -> str:
    """Return a name without its middle where it is too long: both ends tell it apart."""
    half = letters // 2
    return name if len(name) <= letters else f"{name[:half]}…{name[-half:]}"


def residuals_by_joint(
    figure: Figure | SubFigure,
    joints: Sequence[str],
    q_deg: FloatArray,
    residuals_mm: Mapping[str, FloatArray],
    external: ExternalAxes = NO_EXTERNAL_AXES,
) -> None:
    """Draw residuals against each joint's angle: a slope or a bow is what a model leaves out.

    ``q_deg`` (N, n): of joints that slide [mm]. ``residuals_mm`` (N,).
    """
    panels, sliding = panels_of(figure, len(joints)), external.slides_of(len(joints))
    for k, (panel, joint) in enumerate(zip(panels, joints, strict=True)):
        for values, colour, mark in zip(residuals_mm.values(), _MODELS, MARKS, strict=False):
            panel.plot(q_deg[:, k], values, mark, ms=3, color=colour)
        log_y(panel)
        unit = "mm" if sliding[k] else "deg"
        panel.set_xlabel(f"{joint} [{unit}]", fontsize=8, parse_math=False)
        panel.tick_params(labelsize=7)
        if k:
            panel.sharey(panels[0])
            panel.tick_params(labelleft=False, which="both")
    panels[0].set_ylabel("residual [mm], log scale", fontsize=8)


def answers_beside_the_first(
    figure: Figure | SubFigure,
    first: str,
    off: Mapping[str, FloatArray],
    sigma: FloatArray | None,
    refused: Sequence[str],
) -> None:
    """Draw how far the answers of methods are from that of the first, a row for each.

    ``first``: the method that the others are compared with. ``off`` (2,): by method: distance [mm]
    and angle [deg]. ``sigma`` (2,): largest standard deviations of the first along an axis [mm],
    and about one [deg]. ``refused``: methods without an answer to be trusted; they have rows, too.
    """
    panels = panels_of(figure, 2)
    names = [*off, *refused]
    rows = np.arange(len(names))
    for k, (panel, title, unit) in enumerate(
        zip(panels, ("position of X", "rotation of X"), ("mm", "deg"), strict=True)
    ):
        values = np.array([each[k] for each in off.values()])
        panel.barh(rows[: len(values)], values, 0.6, color=COLOURS[0], zorder=2)
        for row in rows[len(values) :]:
            panel.text(0.0, row, " no answer to be trusted", va="center", fontsize=8, color="red")
        if sigma is not None:
            panel.axvspan(0.0, 2.0 * sigma[k], color=COLOURS[4], alpha=0.35, lw=0, zorder=1)
            title += f"; shaded: two standard deviations of {first}"
        panel.set_yticks(rows, names if k == 0 else [""] * len(names), fontsize=8)
        panel.set_ylim(len(names) - 0.4, -0.6)
        panel.set_xlim(left=0.0)
        panel.set_xlabel(f"off {first} [{unit}]")
        panel.set_title(title, fontsize=8)
