"""What planning and checking answer: plans, next poses, checks, scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from calib.model import CalibrationModel
from calib.model.measurements import BoardView
from posedesign.planning.pose_plan import displayed
from posedesign.planning.tellable import untold_of
from posedesign.report.answer import Answer, Table, expected_words

if TYPE_CHECKING:
    from posedesign.cell import Cell
    from posedesign.planning import PosePlan
    from posedesign.planning.checks import PoseVerdict, Score
    from posedesign.planning.optimal import NextPoses, OptimalPlan
    from posedesign.planning.optimal.outlook import Outlook
    from posedesign.planning.optimal.request import Accuracy

PREDICTED = "Expected before measuring"


def frame_notes(model: CalibrationModel) -> list[str]:
    """Which of the parameters are X and Z of A X = Z B, where these are what is planned for."""
    if isinstance(model.measurement, BoardView):
        in_hand = model.measurement.carried == "camera"
        X, Z = ("camera", "board") if in_hand else ("board", "camera")
        return [
            f"tool: X = T_flange_{X}, along and about the axes of the flange and of the {X}",
            f"target: Z = T_base_{Z}, along and about the axes of the base and of the {Z}",
        ]
    if model.measurement.name != "camera-pose":
        return []
    return [
        "tool: X = T_flange_camera, along and about the axes of the flange and of the camera",
        "target: Z = T_base_target, along and about the axes of the base and of the target",
    ]


def sigma_table(displayed: Sequence[tuple[str, str, float]]) -> Table:
    """Predicted standard deviations (name, unit, value) as people read them."""
    return Table(
        PREDICTED,
        [{"parameter": n, "predicted sigma": value, "unit": unit} for n, unit, value in displayed],
    )


def answer_of_plan(
    cell: Cell, result: PosePlan, outlook: Outlook, files: Sequence[str] = ()
) -> Answer:
    """The answer of the paper's loop: whether the threshold was reached, and what that is worth."""
    better = ""
    if outlook.chosen_is_better and outlook.chosen_tcp_m is not None:
        of_X = cell.is_hand_eye and not cell.sees_board
        better = (
            f"{'X' if of_X else 'about'} {1e3 * outlook.chosen_tcp_m:.2g} mm with as "
            "many poses chosen out of a pool, "
            f"{outlook.tcp_m / outlook.chosen_tcp_m:.2g} times less"
        )
    poses = result.poses
    changed = zip(poses.names, poses.status, poses.reasons, strict=True)
    return Answer(
        result.verdict,
        {
            **_promised(cell, outlook, outlook.box_words, result.sigma_displayed()),
            "better": better,
            "would buy more": "; ".join(filter(None, [outlook.advice, outlook.scale])),
            "time": result.route.timing.removeprefix("predicted cycle time "),
            "target": cell.whereabouts.words,
        },
        warnings=cell.doubts,
        not_checked=result.not_checked,
        notes=cell.remarks,
        details=frame_notes(result.model),
        tables=[
            Table("Rounds of the loop", [_short_names(row) for row in result.round_rows()]),
            sigma_table(result.sigma_displayed()),
            Table(
                "Poses that are not those of the grid",
                [{"pose": n, "status": str(s), "reason": why} for n, s, why in changed if why],
            ),
        ],
        files=files,
    )


def _camera_and_target(sigma: Sequence[tuple[str, str, float]]) -> dict[str, str]:
    """Predicted standard deviations of X and Z, the axes of each together."""
    said = {}
    for letter, thing in (("X", "tool."), ("Z", "target.")):
        place, turn = (
            math.hypot(*(v for name, own, v in sigma if name.startswith(thing) and own == unit))
            for unit in ("mm", "deg")
        )
        said[letter] = f"{place:.2g} mm and {turn:.2g} deg predicted, one standard deviation"
    lens = {name.rpartition(".")[2]: value for name, _, value in sigma if name.startswith("lens.")}
    if lens:
        focal, middle = (math.hypot(lens[f"{a}x"], lens[f"{a}y"]) for a in "fc")
        said["lens"] = (
            f"focal length {focal / math.sqrt(2.0):.2g} px, principal point {middle:.2g} px, "
            "likewise"
        )
    return said


def _promised(
    cell: Cell, promised: Accuracy | Outlook, where: str, sigma: Sequence[tuple[str, str, float]]
) -> dict[str, str]:
    """Error to expect of the tool point, or of what a camera sees, with X and Z."""
    if not cell.is_hand_eye:
        if promised.expected is None:
            return {"expected error": "unknown: these poses do not tell where tool and target are"}
        return {"expected error": expected_words(promised.expected, where)}
    said = _camera_and_target(sigma)  # nothing of the arm is identified
    if not cell.sees_board:
        return said
    on = "base" if cell.camera_stands else "flange"
    error = (
        f"{1e3 * promised.tcp_m:.3g} mm rms predicted over {where}, "
        f"{1e3 * promised.tcp_worst_m:.3g} mm where it is largest, seen from the {on}"
    )
    return {"what the camera sees": error} | said


def _short_names(row: Mapping[str, object]) -> dict[str, object]:
    """A round without the deviations of target and tool, which the next table has for the best."""
    return {
        key.replace("zero_offset.", ""): value
        for key, value in row.items()
        if not key.startswith(("sigma_target", "sigma_tool"))
    }


def _what_time_buys(result: OptimalPlan) -> str:
    """What the choice is worth as it is out of the pool, and two minutes less and more."""
    words = result.objective.words
    said = [f"{len(result.poses.kept)} poses out of the pool {words(result.of_pool.value)}"]
    said += [
        f"2 min {'more' if other.poses > len(result.poses.kept) else 'less'}, {other.poses} poses: "
        + (words(other.value) if math.isfinite(other.value) else "not all is told")
        for other in result.others
    ]
    return ", ".join(said)


def _alone_words(result: OptimalPlan) -> str:
    """What the tool point's error would be with one target only, for as many poses or minutes."""
    return ", ".join(
        f"{name} {1e3 * tcp_m:.3g} mm" if math.isfinite(tcp_m) else f"{name} tells not all"
        for name, tcp_m in result.alone.items()
    )


def _untold_words(cell: Cell) -> list[str]:
    """Zero offsets of the cell that no pose can tell, with the remedy."""
    found = untold_of(cell)
    return [] if found is None else [f"{found.words} ({found.remedy})"]


def answer_of_choice(cell: Cell, result: OptimalPlan, files: Sequence[str] = ()) -> Answer:
    """The answer of chosen poses: what accuracy to expect, and what is proven of the choice."""
    found = result.accuracy
    time = "" if result.cycle_time_s is None else f"about {result.cycle_time_s:.0f} s"
    if result.request.time_s is not None:
        time += "; " + _what_time_buys(result)
    return Answer(
        result.verdict,
        {
            **_promised(cell, found, result.box_words, displayed(result.model, found.sigma)),
            "would buy more": result.scale,
            "each target alone": _alone_words(result),
            "time": time,
            "pool": result.pool_words,
            "target": cell.whereabouts.words,
        },
        warnings=[*cell.doubts, *_untold_words(cell)],
        not_checked=result.not_checked,
        notes=[*result.remarks, *cell.remarks],
        details=frame_notes(result.model),
        tables=[
            Table(PREDICTED, result.sigma_rows()),
            Table(
                f"What a pose more or fewer changes, over {result.box_words}",
                result.accuracy_rows(),
            ),
        ],
        files=files or ["nothing"],
    )


def answer_of_next(cell: Cell, result: NextPoses, files: Sequence[str] = ()) -> Answer:
    """The answer of the poses to measure next: whether to go on, and what each would gain."""
    scaled = ""
    if result.noise_scale != 1.0:
        scaled = (
            f"the residuals are {result.noise_scale:.2g} times what the noise given explains: what "
            "is predicted is scaled by it. Where the model leaves something out, a larger one "
            "mends that and no further pose does: identify compares them"
        )
    seen = result.things[1]
    what = seen if seen.startswith("what ") else f"the {seen}"
    return Answer(
        result.message,
        {"poses": ", ".join(result.poses.names), "target": cell.whereabouts.words},
        warnings=[*cell.doubts, *([scaled] if scaled else [])],
        not_checked=cell.not_checked,
        notes=cell.remarks,
        tables=[Table(f"Error of {what}, as predicted", result.rows())],
        files=files,
    )


def answer_of_check(cell: Cell, verdicts: Sequence[PoseVerdict], off: Sequence[str]) -> Answer:
    """The answer of a check: how many poses cannot be taken or reached, and the narrowest place."""
    bad = [verdict for verdict in verdicts if not verdict.ok]
    with_distance = [v for v in verdicts if v.distance_mm is not None]
    nearest: dict[str, str] = {}
    if with_distance:
        closest = min(with_distance, key=lambda v: v.distance_mm or 0.0)
        nearest = {f"smallest distance, at {closest.name}": closest.nearest}
    return Answer(
        _counted(verdicts) + f"; {len(off)} off the target" * bool(off),
        nearest | {"target": cell.whereabouts.words},
        warnings=[*cell.doubts, *(f"{v.name}: {_says(v)}" for v in bad), *off],
        not_checked=cell.not_checked,
        notes=cell.remarks,
        tables=[Table("Poses", [_verdict_row(verdict) for verdict in verdicts])],
    )


def _counted(verdicts: Sequence[PoseVerdict]) -> str:
    """How many poses cannot be taken, those to measure at and those passed through apart."""
    bad = {via: [v for v in verdicts if v.via is via and not v.feasible] for via in (False, True)}
    passed = sum(verdict.via for verdict in verdicts)
    said = f"{len(verdicts) - passed} poses: {len(bad[False])} cannot be taken"
    if bad[True]:
        said += f"; of {passed} passed through, {len(bad[True])} cannot"
    blocked = sum(verdict.way_clear is False for verdict in verdicts)
    return f"{said}; {blocked} motions between them not clear"


def _says(verdict: PoseVerdict) -> str:
    """What is wrong with a pose or the way to it."""
    said = [] if verdict.feasible else [verdict.says]
    return "; ".join([*said, *([f"on the way to it: {verdict.way}"] if verdict.way else [])])


def _verdict_row(verdict: PoseVerdict) -> dict[str, object]:
    return {
        "pose": verdict.name + " (via)" * verdict.via,
        "verdict": "ok" if verdict.ok else ("NO" if not verdict.feasible else "NO WAY"),
        "tightest": verdict.tightest,
        "margin": None if verdict.room is None else round(verdict.room, 3),
        "unit": verdict.unit,
        "reason": verdict.says + (f"; on the way to it: {verdict.way}" if verdict.way else ""),
        "distance [mm]": None if verdict.distance_mm is None else round(verdict.distance_mm, 1),
        "travel [deg]": round(verdict.travel_deg, 1),
    }


def answer_of_score(cell: Cell, score: Score, scaling: Mapping[str, str]) -> Answer:
    """The answer of a score: whether C_G is below the cell's threshold, and what it is worth."""
    c_g, threshold = score.indices.c_g, cell.config.plan.condition_threshold
    verdict = score.problem or (
        f"C_G {c_g:.4g} is {'below' if c_g < threshold else 'not below'} {threshold:.4g}"
    )
    counted = {
        "poses that cannot be taken": score.not_feasible,
        "poses that do not touch the target": score.off_target,
    }
    # the worst first: no number of such poses is worth anything
    worst = [f"{what}: {len(poses)}" for what, poses in counted.items() if poses]
    verdict = "; ".join([*worst, verdict])
    return Answer(
        verdict,
        {
            "expected error": ""
            if score.expected is None
            else expected_words(score.expected, score.where),
            "largest predicted sigma": _largest(score.sigma),
            "target": cell.whereabouts.words,
        },
        warnings=[*cell.doubts, *score.not_feasible, *score.off_target],
        not_checked=cell.not_checked,
        notes=cell.remarks,
        tables=[
            Table(
                "Indices",
                [
                    {"index": key, "value": value, "scaling": scaling.get(key, "")}
                    for key, value in score.indices.as_dict().items()
                ],
            ),
            sigma_table(score.sigma),
        ],
    )


def _largest(displayed: Sequence[tuple[str, str, float]]) -> str:
    """The largest deviation of a length and of an angle, with their names."""
    found: dict[str, tuple[str, float]] = {}
    for name, unit, value in displayed:
        if unit not in found or value > found[unit][1]:
            found[unit] = name, value
    return ", ".join(f"{name} {value:.3g} {unit}" for unit, (name, value) in found.items())
