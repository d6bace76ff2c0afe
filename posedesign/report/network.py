"""The answer of a network of cameras, targets and arms, in words and drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.robot_world import FramePrior, NetworkResult, Noise
from posedesign.files import Results
from posedesign.files.csv_tables import write_table
from posedesign.hand_eye.pairs.networks import (
    AROUND,
    ON_FLANGE,
    NetworkPairs,
    edge_rows,
    frame_rows,
    pair_rows_of_network,
)
from posedesign.report import figures
from posedesign.report.answer import Answer, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posedesign.hand_eye.pairs import Pairs
    from posedesign.hand_eye.pairs.certificate import Camera

FILES = (
    ("network.csv", "frames of a network"),
    ("network_pairs.csv", "residuals of its pairs"),
    *((f"network.{ending}", "figure of a network") for ending in ("png", "svg")),
)
"""Names of the files, and what they say that they are."""

_NOTHING_TOLD = 6
"""Directions from which on next to nothing is told."""

_MOST_SHOWN = 6
"""Frames that are printed at a glance; all of them stand in the file."""

_MOST_WRITTEN = 12
"""Rows and columns of the figure up to which numbers stand in it."""


def solve_and_draw_network(
    found: NetworkPairs,
    results: Results,
    noise: Noise | None,
    priors: Sequence[FramePrior] = (),
) -> NetworkResult:
    """Solve a network, in part where need be; write its frames, what is left over, and the figure.

    What is not told, and what is left over pair by pair, is in the result.
    """
    result = found.solved(noise, priors, in_part=True)
    write_network(found, results, result)
    return result


def write_network(found: NetworkPairs, results: Results, result: NetworkResult) -> None:
    """Write the frames of a network, what its pairs leave over, and the figure."""
    frames, pairs, *drawn = results.claim("computed", *FILES)
    rows, each = frame_rows(result), pair_rows_of_network(found, result)
    write_table(frames, list(rows[0]), rows)
    write_table(pairs, list(each[0]), each)
    figures.draw(results, drawn, lambda: figure_of_network(edge_rows(result)))


def told_in_part(
    pairs: Pairs, camera: Camera, results: Results, noise: Noise | None
) -> NetworkResult | None:
    """Solve pairs of one camera and one target as far as they tell, and write that.

    None, and nothing written, where they tell all, or next to nothing: the arm has not moved.
    """
    found = NetworkPairs.of_one(pairs, camera)
    result = found.solved(noise, in_part=True)
    if not 0 < len(result.untold) < _NOTHING_TOLD:
        return None
    write_network(found, results, result)
    return result


def answer_of_network(
    found: NetworkPairs, result: NetworkResult, files: Sequence[str] = ()
) -> Answer:
    """Return the answer: every frame with its standard deviations, and what looks wrong."""
    net, rows, edges = result.network, frame_rows(result), edge_rows(result)
    shown = {f"T_{_words(row['parent'])}_{row['frame']}": _pose(row) for row in rows[:_MOST_SHOWN]}
    left = result.residuals[result.used]
    rms = [float(np.sqrt((part**2).sum(axis=1).mean())) for part in (left[:, 3:], left[:, :3])]
    shown["left over"] = f"{1e3 * rms[0]:.3g} mm, {np.degrees(rms[1]):.3g} deg rms"
    trusted = all(one.grade != "not to be trusted" for one in result.findings)
    state = "not to be trusted" if not trusted else "solved" if result.is_ok else "solved in part"
    several = f", {len(net.arms)} arms" if len(net.arms) > 1 else ""
    parts = sorted({net.arms[j] for j in net.reference})
    apart = (
        [f"what {', '.join(parts)} see hangs together nowhere: each part is in a base of its own"]
        if len(parts) > 1
        else []
    )
    if len(result.untold):
        apart.append(
            "to have it told turn the flange about two axes, or say what is known of it from "
            "elsewhere with `prior`"
        )
    one_of_each = len(net.on_flange) == len(net.around) == 1
    what = (
        f"{net.on_flange[0]} and {net.around[0]}"
        if one_of_each
        else f"{len(net.on_flange)} on flanges, {len(net.around)} around{several},"
    )
    return Answer(
        f"{state}: {what} from {int(result.used.sum())} of {net.N} pairs",
        shown,
        warnings=[
            *(f"not told: {text}" for text in result.not_told),
            *found.pairs.notes,
            *(one.text for one in result.findings),
        ],
        notes=apart,
        tables=[Table("Frames", rows), Table("Pairs of frames", edges)],
        files=files,
    )


def _words(parent: object) -> str:
    return str(parent).replace(" ", "_")


def _pose(row: Mapping[str, object]) -> str:
    place, turn = (
        ", ".join(f"{float(str(row[axis])):.3f}" for axis in axes)
        for axes in (("x_mm", "y_mm", "z_mm"), ("w_deg", "p_deg", "r_deg"))
    )
    return (
        f"({place}) mm, W P R ({turn}) deg, sigma {float(str(row['sigma_mm'])):.2g} mm and "
        f"{float(str(row['sigma_deg'])):.2g} deg"
    )


def figure_of_network(edges: Sequence[Mapping[str, object]]) -> Figure:
    """Draw what each edge leaves over, by what is on the flange and what is around."""
    on_flange = list(dict.fromkeys(str(row[ON_FLANGE]) for row in edges))
    around = list(dict.fromkeys(str(row[AROUND]) for row in edges))
    height = 1.4 + 0.3 * min(len(on_flange), 30)
    figure = figures.new_figure(height)
    for panel, unit in zip(figures.panels_of(figure, 2), ("mm", "deg"), strict=True):
        squares, counts = np.zeros((2, len(on_flange), len(around)))
        for row in edges:
            at = on_flange.index(str(row[ON_FLANGE])), around.index(str(row[AROUND]))
            used = float(str(row["used"]))
            if used:
                squares[at] += used * float(str(row[f"residual_{unit}"])) ** 2
                counts[at] += used
        rms = np.full(counts.shape, np.nan)
        np.divide(squares, counts, out=rms, where=counts > 0)
        rms = np.sqrt(rms)
        image = panel.imshow(rms, cmap="viridis", aspect="auto", vmin=0.0)
        figure.colorbar(image, ax=panel, label=f"left over, rms [{unit}]")
        panel.set_yticks(range(len(on_flange)), [figures.shortened(name) for name in on_flange])
        panel.set_xticks(
            range(len(around)), [figures.shortened(name) for name in around], rotation=90
        )
        if max(rms.shape) <= _MOST_WRITTEN:
            bright = np.nanmax(rms) if np.isfinite(rms).any() else 1.0
            for (i, j), value in np.ndenumerate(rms):
                if np.isfinite(value):
                    colour = "black" if value > 0.6 * bright else "white"
                    panel.text(j, i, f"{value:.2g}", ha="center", va="center", color=colour)
    return figure
