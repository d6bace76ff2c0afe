"""The answer of two streams with clocks of their own: X, Z, the clocks, in words and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.robot_world import PoseStream, StreamResult, solve_streams
from calib.se3 import FloatArray, wpr_from_rotation
from posedesign.files import Results
from posedesign.files.csv_tables import write_table
from posedesign.hand_eye.pairs import FRAMES
from posedesign.report import figures
from posedesign.report.answer import Answer, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posedesign.hand_eye.pairs.certificate import Camera

FILES = (
    ("streams.csv", "answer of two streams"),
    ("streams_pairs.csv", "residuals of two streams"),
    *((f"streams.{ending}", "figure of two streams") for ending in ("png", "svg")),
)
"""Names of the files, and what they say that they are."""

_LONG_S = 10.0
"""Offset from which on it is printed in seconds."""

_AXES = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")


def solve_and_draw_streams(
    robot: PoseStream,
    camera: PoseStream,
    results: Results,
    *,
    largest_offset_s: float,
    estimate_scale: bool = False,
) -> StreamResult:
    """Solve two streams; write the answer, the residuals of the samples, and the figure."""
    answer, residuals, *drawn = results.claim("computed", *FILES)
    result = solve_streams(
        robot, camera, largest_offset_s=largest_offset_s, estimate_scale=estimate_scale
    )
    row = answer_row(result)
    write_table(answer, list(row), [row])
    rows = sample_rows(result)
    write_table(residuals, list(rows[0]), rows)
    figures.draw(results, drawn, lambda: figure_of_streams(result))
    return result


def answer_row(result: StreamResult) -> dict[str, object]:
    """Return clocks, X and Z with their standard deviations as one row."""
    row = result.rows()[0] | {"status": result.pairs.status, "used": int(result.pairs.used.sum())}
    for k, (letter, T) in enumerate((("x", result.X), ("z", result.Z))):
        sigma = np.sqrt(np.diag(result.covariance)[6 * k : 6 * k + 6])
        row |= {f"{letter}_{axis}": value for axis, value in zip(_AXES, _numbers(T), strict=True)}
        row[f"sigma_{letter}_mm"] = 1e3 * float(np.linalg.norm(sigma[3:]))
        row[f"sigma_{letter}_deg"] = float(np.degrees(np.linalg.norm(sigma[:3])))
    return row


def sample_rows(result: StreamResult) -> list[dict[str, object]]:
    """Return one row a sample of the camera: its time, and what it leaves over."""
    left = result.pairs.residuals
    return [
        {
            "time_s": repr(time),
            "used": "yes" if used else "no",
            "residual_mm": 1e3 * float(np.linalg.norm(row[3:])),
            "residual_deg": float(np.degrees(np.linalg.norm(row[:3]))),
        }
        for time, used, row in zip(
            result.times.tolist(), result.pairs.used.tolist(), left, strict=True
        )
    ]


def answer_of_streams(result: StreamResult, camera: Camera, files: Sequence[str] = ()) -> Answer:
    """Return the answer: the clocks, X and Z, and what looks wrong."""
    frames, row = FRAMES[camera], answer_row(result)
    x, z = (title.partition(": ")[0] for title in (frames.X, frames.Z))
    later = "later" if result.offset_s >= 0 else "earlier"
    far, known = abs(result.offset_s), f"{1e3 * result.sigma_offset_s:.2g} ms"
    by = f"{1e3 * far:.2f} ms" if far < _LONG_S else f"{far:.5f} s"
    clock = f"the camera's is {by} +- {known} {later} than the arm's"
    if result.rate:
        clock += f", and {1e6 * result.rate:+.0f} +- {1e6 * result.sigma_rate:.2g} ppm faster"
    if result.jitter_s:
        clock += f"; its stamps jitter by {1e3 * result.jitter_s:.2g} ms"
    used = result.pairs.used
    left = result.pairs.residuals[used]
    rms = [float(np.sqrt((part**2).sum(axis=1).mean())) for part in (left[:, 3:], left[:, :3])]
    state = "solved" if result.is_ok else "not to be trusted"
    said = [] if result.pairs.status == "ok" else [result.pairs.message]
    return Answer(
        f"{state}: A X = Z B from {int(used.sum())} of {len(used)} samples",
        {
            "frames": f"X is {frames.X.partition(': ')[2]}, Z is {frames.Z.partition(': ')[2]}",
            f"X = {x}": _transform(row, "x"),
            f"Z = {z}": _transform(row, "z"),
            "clocks": clock,
            "left over": f"{1e3 * rms[0]:.3g} mm, {np.degrees(rms[1]):.3g} deg rms",
        },
        warnings=[
            *(one.text for one in result.findings),
            *said,
            *(text for text in result.pairs.warnings if text not in said),
        ],
        tables=[Table("Clocks", result.rows())],
        files=files,
    )


def figure_of_streams(result: StreamResult) -> Figure:
    """Draw what samples leave over, by their time."""
    figure = figures.new_figure(4.6)
    left, used = result.pairs.residuals, result.pairs.used
    seconds = result.times - result.times[0]
    sizes = (
        ("mm", 1e3 * np.linalg.norm(left[:, 3:], axis=1)),
        ("deg", np.degrees(np.linalg.norm(left[:, :3], axis=1))),
    )
    for part, (unit, size) in zip(figures.rows_of(figure, (2.3, 2.3)), sizes, strict=True):
        (panel,) = figures.panels_of(part)
        panel.plot(seconds[used], size[used], ".", ms=3, label="used")
        if not used.all():
            panel.plot(seconds[~used], size[~used], "x", ms=4, color="red", label="left out")
        panel.set_xlabel("time since the first sample [s]")
        panel.set_ylabel(f"left over [{unit}]")
        panel.set_ylim(bottom=0.0)
        panel.legend(fontsize=8, loc="upper right")
    return figure


def _numbers(T: FloatArray) -> list[float]:
    """Place [mm] and W, P, R [deg]."""
    return [*(1e3 * T[:3, 3]).tolist(), *np.degrees(wpr_from_rotation(T[:3, :3])).tolist()]


def _transform(row: dict[str, object], letter: str) -> str:
    numbers = [f"{float(str(row[f'{letter}_{axis}'])):.3f}" for axis in _AXES]
    return (
        f"({', '.join(numbers[:3])}) mm, W P R ({', '.join(numbers[3:])}) deg, sigma "
        f"{float(str(row[f'sigma_{letter}_mm'])):.2g} mm and "
        f"{float(str(row[f'sigma_{letter}_deg'])):.2g} deg"
    )
