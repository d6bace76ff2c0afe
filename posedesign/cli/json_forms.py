"""What commands print as JSON, for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.identification import ExpectedError
    from posedesign.cell import Cell
    from posedesign.planning import PosePlan
    from posedesign.planning.optimal import NextPoses, OptimalPlan
    from posedesign.planning.optimal.outlook import Outlook
    from posedesign.pose_programs import CorrectedProgram
    from posedesign.pose_programs.correction import Correction


def expected_as_dict(expected: ExpectedError | None) -> dict[str, float] | None:
    """An error to expect, with its range over arms; None where nothing is told."""
    if expected is None:
        return None
    return {
        "rms_mm": 1e3 * expected.rms_m,
        "median_mm": 1e3 * expected.median_m,
        "low_mm": 1e3 * expected.low_m,
        "high_mm": 1e3 * expected.high_m,
        "share_of_arms": expected.share,
    }


def plan_as_dict(cell: Cell, result: PosePlan, outlook: Outlook) -> dict[str, object]:
    """What the loop found, for programs."""
    from posedesign.planning import scaling_of
    from posedesign.report.plans import sigma_table

    chosen = outlook.chosen_tcp_m
    return {
        "reached": result.reached,
        "stop": str(result.stop),
        "message": result.message,
        "threshold": result.threshold,
        "target": cell.whereabouts.as_dict(),
        "not_checked": result.not_checked,
        "fingerprint": result.fingerprint,
        "cycle_time_s": result.cycle_time_s,
        "rounds": result.round_rows(),
        "indices": result.indices.as_dict(),
        "scaling": scaling_of(result.model),
        "predicted": sigma_table(result.sigma_displayed()).rows,
        "expected_error": expected_as_dict(outlook.expected),
        "tcp_rms_mm": 1e3 * outlook.tcp_m,
        "tcp_worst_rms_mm": 1e3 * outlook.tcp_worst_m,
        "chosen_tcp_rms_mm": None if chosen is None else 1e3 * chosen,
        "task_box": outlook.box_words,
        "would_buy_more": outlook.advice,
    }


def choice_as_dict(cell: Cell, result: OptimalPlan) -> dict[str, object]:
    """What was chosen, what is proven of it, and what one pose more or fewer changes."""
    from posedesign.planning import scaling_of

    found, objective = result.selection, result.objective
    return {
        "reached": result.reached,
        "poses": len(result.poses.kept_names),
        "dropped": result.dropped,
        "pool": result.pool_size,
        "pool_in_words": result.pool_words,
        "message": result.message,
        "remarks": result.remarks,
        "not_checked": result.not_checked,
        "fingerprint": result.fingerprint,
        "method": result.request.method,
        "robust": result.request.robust,
        "refined": result.is_refined,
        "criterion": {
            "name": objective.criterion.name,
            "meaning": objective.criterion.title,
            "value": result.accuracy.value,
            "wanted": objective.limit,
            "of_the_pool": found.value,
            "bound": found.bound,
            "efficiency": None if result.dropped else found.efficiency,
            "unit": objective.unit,
        },
        "at_least": None if result.fewest is None else result.fewest.at_least,
        "decides": result.decides or None,
        "expected_error": expected_as_dict(result.accuracy.expected),
        "tcp_rms_mm": 1e3 * result.accuracy.tcp_m,
        "tcp_worst_rms_mm": 1e3 * result.accuracy.tcp_worst_m,
        "task_box": result.box_words,
        "cycle_time_s": result.cycle_time_s,
        "indices": result.indices.as_dict(),
        "predicted": result.sigma_rows(),
        "other_numbers_of_poses": [
            {
                "poses": other.poses,
                "value": other.value,
                "tcp_rms_mm": 1e3 * other.tcp_m,
                "tcp_worst_rms_mm": 1e3 * other.tcp_worst_m,
            }
            for other in result.others
        ],
        "validation": 0 if result.validation is None else len(result.validation.names),
        "scaling": scaling_of(result.model),
        "target": cell.whereabouts.as_dict(),
        "each_target_alone_tcp_rms_mm": {k: 1e3 * v for k, v in result.alone.items()},
        "unused_targets": result.unused,
    }


def next_as_dict(cell: Cell, result: NextPoses) -> dict[str, object]:
    """What each further pose would gain, and whether to go on."""
    return {
        "go_on": result.worth > 0,
        "worth": result.worth,
        "measured": result.measured,
        "message": result.message,
        "identified": not result.why_not,
        "why_not": result.why_not or None,
        "not_checked": cell.not_checked,
        "criterion": result.objective.criterion.name,
        "noise_scale": result.noise_scale,
        "tcp_rms_mm": [1e3 * float(value) for value in result.tcp_m],
        "task_box": result.box_words,
        "poses": list(result.poses.kept_names),
        "dropped": result.dropped,
    }


def correction_as_dict(done: Correction) -> dict[str, object]:
    """What each way to correct leaves, and what was made of the poses."""
    found = done.compensated
    return {
        "model": done.identified.name,
        "simulated": done.rehearsed or None,
        "box": done.routes.where,
        "routes": [
            {**row, "tool_mm": (1e3 * route.tool_m).tolist()}
            for row, route in zip(done.routes.rows(), done.routes.routes, strict=True)
        ],
        "verdict": done.verdict(),
        "mastering": done.mastering.rows(),
        "left_out": done.robot.left_out,
        "poses": []
        if found is None or done.poses is None
        else [
            {"name": n, "status": status, "reason": reason, "error_mm": far * 1e3}
            for n, status, reason, far in zip(
                done.poses.names, found.status, found.reasons, found.error_m, strict=True
            )
        ],
        "notes": [*filter(None, [done.routes.tool.said]), *done.notes],
        "files": [str(path) for path in done.files],
    }


def program_as_dict(done: CorrectedProgram) -> dict[str, object]:
    """Positions of a program, with what the correction of each is worth."""
    written = done.written_m.tolist() or [None] * len(done.corrected)
    rows = zip(done.positions, done.reasons, done.moved_m, done.error_m, written, strict=True)
    return {
        "simulated": done.simulated or None,
        "positions": [
            {
                "number": p.number,
                "name": p.name,
                "reason": reason,
                "without_mm": 1e3 * moved,
                "error_mm": 1e3 * error,
                "written_mm": None if rounded is None else 1e3 * rounded,
            }
            for p, reason, moved, error, rounded in rows
        ],
        "notes": list(done.notes),
        "files": [str(path) for path in done.files],
    }
