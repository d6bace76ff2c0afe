"""What all figures share: a colour for each name, axes that say what they are, labels at lines."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

COLOURS = BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9",
)  # fmt: skip
"""Okabe and Ito's palette: told apart by people who do not see red and green alike."""

BLACK, GREY = "#000000", "#555555"
MARKS = ("o", "s", "^", "D", "v", "P")

SMALL = 8
"""Size of labels in a panel [points]."""

CONDITION = "condition number C_G, log scale; better poses to the right"


class Style(NamedTuple):
    """How a series is drawn: by its colour, and without colours by line and mark."""

    colour: str
    line: str
    mark: str
    size: float = 4.0

    @property
    def drawn(self) -> dict[str, Any]:
        """What ``plot`` takes. Marks are hollow, so that others are seen behind them."""
        return {
            "color": self.colour, "ls": self.line, "lw": 1.3,
            "marker": self.mark, "ms": self.size, "mfc": "none", "mew": 1.2,
        }  # fmt: skip


STYLES = {
    # touch-ups, and what is made of them
    "touch-up weighted": Style(BLUE, "-", "o"),
    "touch-up unweighted": Style(VERMILION, "--", "s"),
    "view line": Style(GREEN, "-.", "^"),
    "uncalibrated": Style(GREY, "--", "x"),
    # methods of A X = Z B; those of rotations as quaternions give the same X, nearly
    "ml": Style(BLACK, "-", "o"),
    "zhuang": Style(PURPLE, "--", "s", 7.0),
    "dornaika-horaud": Style(PURPLE, "--", "o", 7.0),
    "hirsh": Style(PURPLE, ":", "x"),
    "li-dual-quaternion": Style(ORANGE, "-.", "D"),
    "li-kronecker": Style(SKY, "-", "^"),
    # how poses are chosen
    "by lot": Style(GREY, "-", "_", 9.0),
    "I": Style(VERMILION, "-", "o", 6.0),
    "D of the arm": Style(BLUE, "--", "D", 6.0),
    "C_G": Style(BLACK, ":", "X", 6.0),
    # arms
    "r2000ic165f": Style(BLUE, "-", "o"),
    "kr6r900sixx": Style(VERMILION, "--", "s"),
    "ur5e": Style(GREEN, "-.", "^"),
    "ur10e": Style(GREEN, "-.", "^"),
    "irb120": Style(PURPLE, ":", "D"),
}
"""The same in every figure of the project."""


def set_answer(figure: Figure, sentence: str, note: str = "") -> None:
    """Write what a figure tells above it, and how it is drawn below it."""
    # names from files may hold anything
    words: dict[str, Any] = {"x": 0.01, "ha": "left", "parse_math": False}
    width = figure.get_figwidth()
    figure.suptitle(fill(sentence, int(10.4 * width)), fontsize=11, fontweight="bold", **words)
    if note:
        figure.supxlabel(fill(note, int(16.0 * width)), fontsize=SMALL, **words)


def curve(
    panel: Axes,
    x: ArrayLike,
    y: ArrayLike,
    style: Style,
    label: str | None = None,
    *,
    ends: Sequence[ArrayLike] | None = None,
) -> None:
    """Draw a series, with bars from and to the ends of intervals."""
    panel.plot(x, y, label=label, **style.drawn)
    if ends is not None:
        low, high = (np.asarray(end, dtype=float) for end in ends)
        middle = np.asarray(y, dtype=float)
        panel.errorbar(
            x, middle, [middle - low, high - middle],
            fmt="none", ecolor=style.colour, elinewidth=0.9, capsize=2.0, alpha=0.7,
        )  # fmt: skip


_WIDE = 1e2
"""Ratio of the ends of an axis beyond which powers of ten suffice: there are too many ticks between
them to be told apart, and they take a third of the time that a figure takes."""


def condition_axis(panel: Axes, *, label: bool = True) -> None:
    """Lay C_G along x: better poses stand to the right in every figure."""
    from matplotlib.ticker import NullLocator

    panel.set_xscale("log")
    low, high = sorted(panel.get_xlim())
    panel.set_xlim(high, low)
    if high > _WIDE * low:
        panel.xaxis.set_minor_locator(NullLocator())
    if label:
        panel.set_xlabel(CONDITION)


def log_y(panel: Axes, what: str = "") -> None:
    """A logarithmic axis that says so; what it has is better below."""
    panel.set_yscale("log")
    plain_numbers(panel)
    panel.grid(True, which="major", alpha=0.25)
    panel.set_axisbelow(True)
    if what:
        panel.set_ylabel(f"{what}, log scale")


def plain_numbers(panel: Axes) -> None:
    """Numbers on a logarithmic axis as people write them; every tick has one.

    Ticks without a number would take most of the time that a figure takes.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator

    class Between(LogLocator):
        def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
            wide = vmax / vmin
            self.set_params(
                subs=(2, 5) if wide > 10.0 else (2, 3, 5) if wide > 3.0 else range(2, 10)
            )
            return super().tick_values(vmin, vmax)

    plain = FuncFormatter(lambda value, _: f"{value:g}")
    panel.yaxis.set_major_formatter(plain)
    panel.yaxis.set_minor_locator(Between())
    panel.yaxis.set_minor_formatter(plain)
    panel.tick_params(which="minor", labelsize=7)


def label_ends(panel: Axes) -> None:
    """Write the label of each line to the right of the panel, where it ends, in its colour.

    They stand in place of a legend. To be called when the axes are as they stay.
    """
    at: list[float] = []
    lines = [line for line in panel.lines if not str(line.get_label()).startswith("_")]
    for line in lines:
        points = np.column_stack([np.asarray(v, dtype=float) for v in line.get_data()])
        points = points[np.isfinite(points).all(axis=1)]
        points = panel.transAxes.inverted().transform(line.get_transform().transform(points))
        at.append(float(points[np.argmax(points[:, 0]), 1]))
    height = panel.get_window_extent().height * 72.0 / panel.figure.get_dpi()
    for line, y in zip(lines, apart(at, 1.25 * SMALL / height), strict=True):
        panel.annotate(
            str(line.get_label()), (1.0, y), (4, 0), xycoords="axes fraction",
            textcoords="offset points", va="center", fontsize=SMALL, color=line.get_color(),
            parse_math=False,
        )  # fmt: skip


def apart(places: Sequence[float], gap: float) -> list[float]:
    """Move places the least that leaves this gap between them, in the same order.

    Neighbours that are too near each other become a group about their mean, until none are.
    """
    order = np.argsort(places, kind="stable")
    groups: list[list[float]] = []  # the places that each was made of
    for k in order:
        groups.append([places[k]])
        while len(groups) > 1 and _first(groups[-1], gap) < _last(groups[-2], gap) + gap:
            groups[-2:] = [groups[-2] + groups[-1]]
    moved = [_first(group, gap) + gap * k for group in groups for k in range(len(group))]
    return [moved[k] for k in np.argsort(order)]


def _first(group: Sequence[float], gap: float) -> float:
    return float(np.mean(group)) - gap * (len(group) - 1) / 2.0


def _last(group: Sequence[float], gap: float) -> float:
    return float(np.mean(group)) + gap * (len(group) - 1) / 2.0
