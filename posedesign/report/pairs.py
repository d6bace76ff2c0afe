"""What the solvers of A X = Z B answer: X and Z, their uncertainty, how far methods differ.

In words, and drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.robot_world import Noise, NoiseShown, difference
from calib.se3 import FloatArray, rotation_angle, rotation_from_wpr
from posedesign.files import Results
from posedesign.files.csv_tables import write_table
from posedesign.hand_eye.pairs import FRAMES, solve_pairs
from posedesign.hand_eye.pairs.results import (
    DEFAULT_METHODS,
    POSE_AXES,
    Advance,
    largest_sigma,
    noise_judged,
    opencv_rows,
    pair_rows,
    reached,
    remarks_of,
    solver_row,
    warnings_of,
)
from posedesign.hand_eye.pairs.transforms import FrameNames, forms_of
from posedesign.report import figures
from posedesign.report.answer import Answer, Table

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from posedesign.hand_eye.pairs import Pairs, SolverOutcome
    from posedesign.hand_eye.pairs.certificate import Camera

ROBOT_WORLD = (("robot_world.csv", "answers"), ("robot_world_pairs.csv", "residuals of pairs"))
DRAWN = tuple((f"robot_world.{ending}", "figure of A X = Z B") for ending in ("png", "svg"))
"""Names of the files, and what they say that they are."""

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

_PROOF = {
    "proven": "proven to be the likeliest by this noise",
    "away": "not the optimum that is proven",
}
"""What a proof makes of an answer; its other statuses say it themselves."""


_BOTH = (
    "of A and B both inverted the equations hold as well, with X and Z in each other's place: only "
    "who made the files knows it"
)


def answer_of_pairs(
    outcomes: Sequence[SolverOutcome],
    camera: Camera = "on-flange",
    pairs: Pairs | None = None,
    files: Sequence[str] = (),
    *,
    opencv: bool = False,
    inverted: bool = False,
    names: FrameNames | None = None,
) -> Answer:
    """The answer of the solvers: X and Z of the first, and what the others say of it.

    ``names``: of the frames, for the forms of other programs.
    """
    called = (names or FrameNames()).of
    frames = FRAMES[camera]
    rows = [solver_row(outcome) for outcome in outcomes]
    first, row = outcomes[0], rows[0]
    figures: dict[str, str] = {}
    if first.result is not None:
        x, z = (title.partition(": ")[2] for title in (frames.X, frames.Z))
        figures["frames"] = f"X is {x}, Z is {z}"
        # who asks for OpenCV's names reads these first
        for named in opencv_rows([first]) if opencv else ():
            figures[f"OpenCV's {named['transform']}"] = _six([named[axis] for axis in POSE_AXES])
        for letter, title in (("x", frames.X), ("z", frames.Z)):
            name = title.partition(": ")[0]
            figures[f"{letter.upper()} = {name}"] = _transform(letter, row, first)
        figures["left over"] = (
            f"{_shown(row['residual_translation_mm'])} mm, {_shown(row['residual_rotation_deg'])} "
            f"deg rms; of pairs not seen {_shown(row['left_out_translation_mm'])} mm, "
            f"{_shown(row['left_out_rotation_deg'])} deg"
        )
        figures["noise"] = first.result.noise_words
        figures["not seen"] = first.result.unseen
        figures["proof"] = next((o.proof.message for o in outcomes if o.proof is not None), "")
        figures["methods"] = _spread(outcomes)
    warnings: list[str] = []
    if pairs is not None:
        misread = [pairs.misread] if pairs.misread else []
        warnings = [*pairs.notes, *misread, *warnings_of(outcomes, misread=bool(misread))]
    details = [*noise_judged(outcomes), f"A = {frames.A}; B = {frames.B}", _BOTH]
    details.append(_sigma_words(rows))
    details += remarks_of(outcomes)
    if first.result is not None:
        for letter, T, title in (("X", first.result.X, frames.X), ("Z", first.result.Z, frames.Z)):
            parent, child = map(called, title.partition(":")[0].split("_")[1:])
            forms = forms_of(T, parent, child)
            details += [f"{letter}, {form}: {text}" for form, text in forms.items()]
    if pairs is not None and not (opencv or inverted):
        details.append(frames.other_way)
    state = "solved" if reached(outcomes) else "not to be trusted"
    used = "" if first.result is None else f" from {row['used']} of {row['pairs']} pairs"
    return Answer(
        f"{state}: A X = Z B by {first.method}{used}"
        + ("" if first.proof is None else f", {_PROOF.get(first.proof.status, first.proof.status)}")
        + ("" if first.result is not None else f": {first.said}"),
        figures,
        warnings=warnings,
        details=details,
        tables=_tables(outcomes, rows, camera, opencv=opencv),
        files=files,
    )


def _transform(letter: str, row: Mapping[str, object], outcome: SolverOutcome) -> str:
    """Place and turn of X or Z with the largest of their standard deviations."""
    place, turn = largest_sigma(outcome, letter)
    said = _six([row[f"{letter}_{axis}"] for axis in POSE_AXES])
    if place is None or turn is None:
        return said
    return f"{said}, sigma {place:.2g} mm and {turn:.2g} deg"


def _six(values: Sequence[object]) -> str:
    """Place [mm] and turn [deg] of a transform."""
    shown = [f"{value:.3f}" if isinstance(value, float) else "" for value in values]
    return f"({', '.join(shown[:3])}) mm, W P R ({', '.join(shown[3:])}) deg"


def _shown(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) and np.isfinite(value) else "-"


def _spread(outcomes: Sequence[SolverOutcome]) -> str:
    """How far the answers of the other methods are from the first one's."""
    first, others = outcomes[0].result, [o.result for o in outcomes[1:] if o.ok and o.result]
    refused = [o.method for o in outcomes if not o.ok]
    said = []
    if first is not None and others:
        off = np.array([difference(other.X, first.X) for other in others])
        place, turn = (np.linalg.norm(off[:, part], axis=1) for part in (np.s_[3:], np.s_[:3]))
        said.append(
            f"{len(others)} others have X within {1e3 * place.max():.2g} mm and "
            f"{np.degrees(turn.max()):.2g} deg of {outcomes[0].method}"
        )
    if refused:
        said.append(f"no answer to be trusted by {', '.join(refused)}")
    return "; ".join(said)


def _sigma_words(rows: Sequence[Mapping[str, object]]) -> str:
    sources = {row["noise"] for row in rows}
    noise = "the noise given" if "given" in sources else "the noise that the residuals show"
    if "given" not in sources and all(row["noise_on"] in ("B", None) for row in rows):
        noise += ", as of B"
    return f"sigma: the largest of the three axes, by {noise}; left_out: of pairs not seen."


def _tables(
    outcomes: Sequence[SolverOutcome],
    rows: Sequence[Mapping[str, object]],
    camera: Camera,
    *,
    opencv: bool,
) -> list[Table]:
    """X, Z, the scale and what is left over, by every method."""
    frames = FRAMES[camera]
    corrected = any(row["scale_estimated"] == "yes" for row in rows)
    scale = ("method", "scale_of_b", "sigma_scale_of_b")
    return [
        Table(f"X = {frames.X}", _transform_rows("x", rows, outcomes)),
        Table(f"Z = {frames.Z}", _transform_rows("z", rows, outcomes)),
        Table(
            "Scale of B's translations" + ", corrected" * corrected,
            [{key: row[key] for key in scale} for row in rows],
        ),
        Table(
            "Left over (rms)",
            [{name: row[key] for key, name in _LEFT_OVER.items()} for row in rows],
        ),
        *([Table("In OpenCV's names", opencv_rows(outcomes))] if opencv else []),
    ]


def _transform_rows(
    letter: str, rows: Sequence[Mapping[str, object]], outcomes: Sequence[SolverOutcome]
) -> list[dict[str, object]]:
    """X or Z by every method, with the largest of its standard deviations."""
    shown = []
    for row, outcome in zip(rows, outcomes, strict=True):
        place, turn = largest_sigma(outcome, letter)
        line = {key: row[key] for key in ("method", "status")}
        line |= {axis: row[f"{letter}_{axis}"] for axis in POSE_AXES}
        shown.append(line | {"sigma_mm": place, "sigma_deg": turn})
    return shown


def solve_and_draw(
    pairs: Pairs,
    out: Path | Results,
    methods: Sequence[str] = DEFAULT_METHODS,
    noise: Noise | NoiseShown | None = None,
    advance: Advance = lambda what, part: None,
    inputs: Sequence[Path] = (),
    *,
    estimate_scale: bool = False,
) -> tuple[SolverOutcome, ...]:
    """Solve AX=ZB by several methods; write ``robot_world.csv`` and ``robot_world_pairs.csv``.

    One row a method, and one a pair; drawn are residuals, and how methods differ. ``advance`` is
    called with what is being done and the part of all work that is done. Raises InputError: an
    unknown method. NotIdentifiableError: no method has an answer because the motions do not allow
    one.
    """
    results = Results.of(out, "robot-world")
    answers, residuals, *drawn = results.claim("computed", *ROBOT_WORLD, *DRAWN, inputs=inputs)
    outcomes = solve_pairs(pairs, methods, noise, advance, estimate_scale=estimate_scale)
    rows = [solver_row(outcome) for outcome in outcomes]
    write_table(answers, list(rows[0]), rows)
    each = [pair_rows(pairs, outcome) for outcome in outcomes]
    write_table(residuals, list(each[0][0]), [row for rows_of_one in each for row in rows_of_one])
    figures.draw(results, drawn, lambda: figure_of_pairs(rows, each[0]))
    return outcomes


SIGMA_AXES = (("mm", ("x", "y", "z")), ("deg", ("rx", "ry", "rz")))
"""Of the standard deviations of X, as columns have them."""


def figure_of_pairs(
    answers: Sequence[Mapping[str, object]], each: Sequence[Mapping[str, object]]
) -> Figure | None:
    """Residuals of the pairs by the first method, and how far X of the others is from its X.

    None where the first has no answer.

    ``answers``, ``each``: rows of robot_world.csv and robot_world_pairs.csv.
    """
    first = answers[0]
    own = [row for row in each if row["method"] == first["method"]]
    if first["status"] != "ok" or not own:
        return None
    if len(answers) == 1:
        heights: tuple[float, ...] = (2.6, 2.6)
    else:
        heights = (2.6, 2.6, 1.0 + 0.18 * len(answers))
    figure = figures.new_figure(sum(heights))
    parts = figures.rows_of(figure, heights)
    used = np.array([row["used"] == "yes" for row in own])
    names = [str(row["pose"]) for row in own]
    for part, unit in zip(parts, ("mm", "deg"), strict=False):
        left = {str(first["method"]): np.array([_number(row[f"residual_{unit}"]) for row in own])}
        figures.residuals_by_pose(part, names, left, ~used, unit)
    if len(answers) == 1:
        return figure
    X = _transform_of(first)
    off = {}
    for row in answers[1:]:
        if row["status"] == "ok":
            place, R = _transform_of(row)
            angle = float(np.rad2deg(rotation_angle(X[1].T @ R)))
            off[str(row["method"])] = np.array([np.linalg.norm(place - X[0]), angle])
    sigma = [
        max(_number(first[f"sigma_x_{axis}_{unit}"]) for axis in axes) for unit, axes in SIGMA_AXES
    ]
    refused = [str(row["method"]) for row in answers[1:] if row["status"] != "ok"]
    known = np.array(sigma) if np.isfinite(sigma).all() else None
    figures.answers_beside_the_first(parts[-1], str(first["method"]), off, known, refused)
    return figure


def _number(value: object) -> float:
    """A number of a table, which may be empty."""
    return float(str(value)) if value not in (None, "") else float("nan")


def _transform_of(row: Mapping[str, object]) -> tuple[FloatArray, FloatArray]:
    """Position [mm] and rotation of X."""
    place, wpr = (
        np.array([_number(row[f"x_{axis}"]) for axis in axes])
        for axes in (("x_mm", "y_mm", "z_mm"), ("w_deg", "p_deg", "r_deg"))
    )
    return place, rotation_from_wpr(np.deg2rad(wpr))
