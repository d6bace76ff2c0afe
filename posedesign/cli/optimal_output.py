"""What `plan` prints of poses that were chosen out of a pool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posedesign.cli.output import explain_frames, note, print_json, print_table, say

if TYPE_CHECKING:
    from posedesign.cell import Cell
    from posedesign.planning.optimal import NextPoses, OptimalPlan


def print_optimal(cell: Cell, result: OptimalPlan, out: Path, *, as_json: bool) -> None:
    """Print what accuracy to expect, what is proven, and what one pose more or fewer changes."""
    from posedesign.planning import scaling_of

    files = [str(out / "poses.csv")] if result.route is not None else []
    if result.validation is not None:
        files.append(str(out / "validation.csv"))
    if as_json:
        told = {"scaling": scaling_of(result.model), "target": cell.whereabouts.as_dict()}
        print_json(_as_dict(result) | told | {"files": files})
        return
    print_table("Predicted before measuring, from the noise alone", result.rows())
    print_table(
        f"What a pose more or fewer changes, over {result.box_words}", result.accuracy_rows()
    )
    explain_frames(result.model)
    for said in result.remarks:
        note(f"note: {said}")
    say(result.pool_words)
    say(result.message)
    if result.cycle_time_s is not None:
        say(f"cycle time about {result.cycle_time_s:.0f} s")
    say("wrote " + ", ".join(files) if files else "wrote nothing")


def _as_dict(result: OptimalPlan) -> dict[str, object]:
    found, objective, tried = result.selection, result.objective, result.robustness
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
        "tcp_rms_mm": 1e3 * result.accuracy.tcp_m,
        "tcp_worst_rms_mm": 1e3 * result.accuracy.tcp_worst_m,
        "task_box": result.box_words,
        "cycle_time_s": result.cycle_time_s,
        "indices": result.indices.as_dict(),
        "predicted": result.rows(),
        "other_numbers_of_poses": [
            {
                "poses": other.poses,
                "value": other.value,
                "tcp_rms_mm": 1e3 * other.tcp_m,
                "tcp_worst_rms_mm": 1e3 * other.tcp_worst_m,
            }
            for other in result.others
        ],
        "other_robots": None
        if tried is None
        else {
            "trials": tried.trials,
            "nominal": tried.nominal,
            "median": tried.median,
            "worst": tried.worst,
        },
        "validation": 0 if result.validation is None else len(result.validation.names),
    }


def print_next(cell: Cell, result: NextPoses, out: Path, *, as_json: bool) -> None:
    """Print what each further pose would gain, and whether to go on."""
    files = [str(out / "poses.csv")]
    if as_json:
        print_json(
            {
                "go_on": result.worth > 0,
                "worth": result.worth,
                "measured": result.measured,
                "message": result.message,
                "identified": result.identified is not None,
                "why_not": result.why_not or None,
                "not_checked": cell.not_checked,
                "criterion": result.objective.criterion.name,
                "noise_scale": result.noise_scale,
                "tcp_rms_mm": [1e3 * float(value) for value in result.tcp_m],
                "task_box": result.box_words,
                "poses": list(result.poses.kept_names),
                "dropped": result.dropped,
                "files": files,
            }
        )
        return
    print_table("Error of the tool point, as predicted", result.rows())
    if result.noise_scale != 1.0:
        note(
            f"note: the residuals are {result.noise_scale:.2g} times what the noise given "
            "explains: what is predicted is scaled by it. Where the model leaves something out, a "
            "larger one mends that and no further pose does: identify compares them"
        )
    say(result.message)
    say("wrote " + files[0])
