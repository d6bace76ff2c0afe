"""What the command for pose pairs prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from posedesign.cli.output import print_table, say

if TYPE_CHECKING:
    from posedesign.pairs import SolverOutcome
    from posedesign.pairs.certificate import Camera

_LEFT_OVER = {
    "method": "method",
    "status": "status",
    "iterations": "iterations",
    "residual_rotation_deg": "residual_deg",
    "residual_translation_mm": "residual_mm",
    "left_out_rotation_deg": "left_out_deg",
    "left_out_translation_mm": "left_out_mm",
    "used": "used",
    "pairs": "of pairs",
}
"""Columns of the table, and what they are called in print."""


def print_solvers(outcomes: Sequence[SolverOutcome], camera: Camera = "on-flange") -> None:
    """Print X and Z of every solver, with what is left over, and what the letters mean."""
    from posedesign.pairs import FRAMES
    from posedesign.pairs.results import noise_judged, remarks_of
    from posedesign.pairs.tables import solver_row

    rows = [solver_row(outcome) for outcome in outcomes]
    frames = FRAMES[camera]
    _print_transform("x", f"X = {frames.X}", rows, outcomes)
    _print_transform("z", f"Z = {frames.Z}", rows, outcomes)
    print_table(
        "Scale of B's translations"
        + (", corrected" if any(row["scale_estimated"] == "yes" for row in rows) else ""),
        [{key: row[key] for key in ("method", "scale_of_b", "sigma_scale_of_b")} for row in rows],
    )
    print_table("Left over (rms)", [_picked(row, _LEFT_OVER) for row in rows])
    for text in noise_judged(outcomes):
        say(text)
    say(f"A = {frames.A}; B = {frames.B}")
    sources = {row["noise"] for row in rows}
    noise = "the noise given" if "given" in sources else "the noise that the residuals show"
    if "given" not in sources and all(row["noise_on"] in ("B", None) for row in rows):
        noise += ", as of B"
    say(f"sigma: the largest of the three axes, by {noise}; left_out: of pairs not seen.")
    for text in remarks_of(outcomes):
        say(text)


def _print_transform(
    letter: str,
    title: str,
    rows: Sequence[Mapping[str, object]],
    outcomes: Sequence[SolverOutcome],
) -> None:
    """X or Z by every method, with the largest of its standard deviations."""
    from posedesign.pairs.tables import largest_sigma
    from posedesign.planning.poses_file import POSE_AXES

    shown = []
    for row, outcome in zip(rows, outcomes, strict=True):
        place, turn = largest_sigma(outcome, letter)
        line = {key: row[key] for key in ("method", "status")}
        line |= {axis: row[f"{letter}_{axis}"] for axis in POSE_AXES}
        shown.append(line | {"sigma_mm": place, "sigma_deg": turn})
    print_table(title, shown)


def _picked(row: Mapping[str, object], names: Mapping[str, str]) -> dict[str, object]:
    return {name: row[key] for key, name in names.items()}
