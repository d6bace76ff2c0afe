"""What an identification and its corrections answer: the model to take, what to know of it.

And the best way to correct, with the error that each leaves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from posedesign.pose_programs.correction_routes import DESCRIPTION, MASTERING
from posedesign.report.answer import EXPECTED_ERROR, Answer, Table, expected_words

if TYPE_CHECKING:
    from calib.identification import IdentificationResult, KindNoise, Trial
    from posedesign.cell.task_box import BoxAccuracy
    from posedesign.identification import Identified
    from posedesign.pose_programs import CorrectedProgram
    from posedesign.pose_programs.correction import Correction


_MOST_LISTED = 5
_DECIMALS = 4
"""Of mm and mrad in the table of models: a tenth of a micrometre."""

_COLUMNS = (
    "model",
    "parameters",
    "equations left",
    "rms",
    "max",
    "expected error",
    "leave-one-out",
    "leave-one-target-out",
    "rms mrad",
    "leave-one-out mrad",
    "residual / noise",
)
"""Of the table of models; those that are empty throughout are not shown."""


def answer_of_identification(identified: Identified, files: Sequence[str] = ()) -> Answer:
    """The answer of all models side by side: which to take, and what error it leaves."""
    from posedesign.identification.findings import in_words

    warnings: list[str] = []
    notes: list[str] = []
    details: list[str] = []
    for finding in identified.findings:
        said = in_words(finding, identified.table)
        (notes if finding.grade == "note" else warnings).append(said)
    models = models_table(identified)
    if not identified.is_trusted:
        why = "what was found changes the answer, put it right first"
        if not identified.is_of_this_robot:
            why = "these measurements do not fit the robot of the cell"
        return Answer(
            f"no model: {why}",
            {},
            warnings=warnings or [identified.reason],
            notes=notes,
            tables=[models],
            files=files,
        )
    trial, result = identified.shown
    comparison = identified.comparison
    warnings += [contradiction.said for contradiction in identified.contradictions]
    left_out = [(t.name, t.error) for t in comparison.trials if t.error is not None]
    notes += [f"{name} left out: {error.message}" for name, error in left_out]
    if identified.held_only:
        names = " and ".join(identified.held_only)
        details.append(
            f"{names} not tried: nothing measured sees the scale of links without priors"
        )
    over = ""
    if identified.workplace:
        over = f"{identified.workplace}, the base placed anew for each model"
    return Answer(
        f"recommended: {comparison.recommended or 'none'}",
        {
            "expected error": comparison.reason,
            "expected over": over,
            "as measured again": _as_measured(trial),
            "noise": result.message,
            **identified.table.facts,
            "largest residuals": _residuals(result),
            **_of_the_fit(result),
        },
        warnings=warnings,
        notes=[*notes, *result.notes],
        details=[*details, *_merged(trial)],
        tables=[models, Table(f"Identified: {result.model}", parameter_rows(result))],
        files=files,
    )


def _as_measured(trial: Trial) -> str:
    """Return what further poses will show: the expected error with the noise of the readings."""
    from calib.identification.candidate import FURTHER_POSES

    if trial.as_measured is None:
        return ""
    error = trial.as_measured
    return (
        f"{1e3 * error.rms_m:.3f} mm rms ({1e3 * error.low_m:.3f} to {1e3 * error.high_m:.3f}) at "
        f"{FURTHER_POSES} poses that took no part, the noise of the readings included"
    )


def models_table(identified: Identified) -> Table:
    """The table of models; columns that are empty throughout are left out."""
    rows = [_row(trial) for trial in identified.comparison.trials]
    if math.isfinite(identified.nominal_rms_m):
        far = _rounded(identified.nominal_rms_m * 1e3)
        rows.insert(0, {"model": "nominal", "parameters": 0, "rms": far})
    kept = [key for key in _COLUMNS if any(row.get(key) is not None for row in rows)]
    return Table(
        "Before and after: distance left over at a measurement [mm]",
        [{key: row.get(key) for key in kept} for row in rows],
    )


def _row(trial: Trial) -> dict[str, object]:
    result = trial.result
    row: dict[str, object] = {"model": trial.name, "parameters": trial.candidate.model.p}
    if result is not None:
        row |= {
            "equations left": result.degrees_of_freedom,
            "rms": _rounded(result.rms_m * 1e3),
            "max": _rounded(result.max_m * 1e3),
            "expected error": None
            if trial.expected is None
            else _rounded(trial.expected.rms_m * 1e3),
            "leave-one-out": _rounded(result.leave_one_out_rms_m * 1e3),
            "leave-one-target-out": _rounded(trial.target_out_rms_m * 1e3),
            "rms mrad": _rounded(result.rms_rad * 1e3),
            "leave-one-out mrad": _rounded(result.leave_one_out_rms_rad * 1e3),
            "residual / noise": _rounded(result.noise_scale, 2),
        }
    return row


def _rounded(value: float, decimals: int = _DECIMALS) -> str | None:
    return f"{value:.{decimals}f}" if math.isfinite(value) else None


def _of_the_fit(result: IdentificationResult) -> dict[str, str]:
    """What has to be known of a fit, by what it is about; empty texts for nothing."""
    estimated = {
        f"noise of {noise.kind}, from the residuals": _noise_in_words(noise)
        for noise in result.noise
        if noise.estimated
    }
    weighed = ""
    if result.is_weighed:
        weighed = (
            f"rms {1e3 * result.weighed_rms_m:.3f} mm, leave-one-out "
            f"{1e3 * result.weighed_leave_one_out_rms_m:.3f} mm"
        )
    pairs, held = result.strong_correlations, result.held_by_prior
    shown = "; ".join(f"{a} with {b} {value:+.3f}" for a, b, value in pairs[:_MOST_LISTED])
    return {
        **estimated,
        "with the weights of the loss": weighed,
        "correlated beyond 0.9": shown and shown + _more(len(pairs)),
        "held by their priors alone": ", ".join(held[:_MOST_LISTED]) + _more(len(held)),
    }


def parameter_rows(result: IdentificationResult) -> list[dict[str, object]]:
    """Parameters with as many decimals as their standard deviations have two digits."""
    rows: list[dict[str, object]] = []
    for shown in result.displayed():
        decimals = _decimals(shown.sigma)
        numbers = {"value": shown.value, "change": shown.change, "sigma": shown.sigma}
        numbers |= {"95 % from": shown.low, "to": shown.high}
        row: dict[str, object] = {"parameter": shown.name}
        # adding zero makes minus zero plus zero
        row |= {key: f"{round(n, decimals) + 0.0:.{decimals}f}" for key, n in numbers.items()}
        rows.append(row | {"unit": shown.unit})
    return rows


def _decimals(sigma: float) -> int:
    if not 0 < sigma < math.inf:
        return 6
    return min(max(1 - math.floor(math.log10(sigma)), 0), 9)


def _residuals(result: IdentificationResult) -> str:
    """The largest residuals of what took part, as they are and as predicted from the others."""
    distances, out = result.distances_m, result.leave_one_out_m
    used = [i for i in range(len(distances)) if result.used[i]]
    order = sorted(used, key=lambda i: -distances[i])
    worst = list({result.poses[i]: i for i in reversed(order)}.values())[::-1][:3]  # one a pose
    return ", ".join(
        f"{result.poses[i]} {distances[i] * 1e3:.3f} mm"
        + (f" ({out[i] * 1e3:.3f} when left out)" if math.isfinite(out[i]) else "")
        for i in worst
    )


def _noise_in_words(noise: KindNoise) -> str:
    from calib.model.measurements import KINDS

    lengths = len(noise.sigma) - KINDS[noise.kind].turns
    said = [", ".join(f"{s * 1e3:.3g}" for s in noise.sigma[:lengths]) + " mm"]
    if lengths < len(noise.sigma):
        said.append(", ".join(f"{s * 1e3:.3g}" for s in noise.sigma[lengths:]) + " mrad")
    if noise.arm_sigma is not None:
        shift, turn = (1e3 * sigma for sigma in noise.arm_sigma)
        said.append(f"from pose to pose {shift:.3g} mm and {turn:.3g} mrad more, an axis")
    return "; ".join(said)


def _more(count: int) -> str:
    return f" and {count - _MOST_LISTED} more" if count > _MOST_LISTED else ""


def _merged(trial: Trial) -> list[str]:
    """What of the arm was left out of the model, and what it shows up in."""
    notes = trial.candidate.notes
    if not notes:
        return []
    verb = "parameter of the arm is" if len(notes) == 1 else "parameters of the arm are"
    said = f"{len(notes)} {verb} not in this model, because these measurements do not tell: "
    more = f"; and {len(notes) - _MOST_LISTED} more, see identification.json"
    return [said + "; ".join(notes[:_MOST_LISTED]) + more * (len(notes) > _MOST_LISTED)]


_WITH_TOOL = (DESCRIPTION, MASTERING)
"""Ways that go with a tool point of their own."""

TAUGHT = (
    "positions that were taught on the arm are right already: correct what was made offline, and "
    "use it alone: with mastering or a corrected description it corrects twice"
)


def answer_of_correction(done: Correction) -> Answer:
    """The answer of a correction: which way is best, and what error each leaves."""
    routes = done.routes
    remarks = routes.remarks()
    tools = [f"with {way} {routes.tool_words(way)}" for way in _WITH_TOOL if routes.tool.parameters]
    errors = "; ".join(
        f"{route.name} {1e3 * route.expected.rms_m:.3g} mm" for route in routes.routes
    )
    posed, failed = _poses(done)
    return Answer(
        done.verdict(),
        {
            EXPECTED_ERROR: errors,
            "tool point": "; ".join(tools),
            "over": remarks[0].removeprefix("over "),
            "poses": posed,
        },
        warnings=[f"{row['pose']}: {row['reason']}" for row in failed],
        notes=[*filter(None, (done.routes.tool.said, *done.notes))],
        details=remarks[1:2],
        tables=[
            Table("Expected error of the tool point over the box [mm]", routes.rows()),
            Table(
                f"Mastering, by the model {done.identified.name!r}",
                [{k: v for k, v in row.items() if k != "joint"} for row in done.mastering.rows()],
            ),
            Table("Poses that cannot be corrected", failed),
        ],
        files=[str(path) for path in done.files],
    )


def _poses(done: Correction) -> tuple[str, list[dict[str, object]]]:
    """How many poses are corrected, in words, and those that are not."""
    found, poses = done.compensated, done.poses
    if found is None or poses is None:
        return "", []
    failed: list[dict[str, object]] = [
        {"pose": name, "status": status, "reason": reason}
        for name, status, reason in zip(poses.names, found.status, found.reasons, strict=True)
        if reason
    ]
    return f"{len(poses.names) - len(failed)} of {len(poses.names)} postures corrected", failed


def answer_of_program(done: CorrectedProgram) -> Answer:
    """The answer of a corrected program: how far off it was, or what stands in the way."""
    count, failed = len(done.corrected), done.rows()
    verdict = f"{count} positions keep their place on the real arm"
    figures = {}
    if done.ok:
        figures = {
            "without correction": f"up to {1e3 * done.moved_m.max():.3g} mm off",
            "as written": f"up to {1e6 * done.written_m.max():.2g} um off, by rounding",
        }
    else:
        verdict = f"nothing is written: {len(failed)} of {count} positions cannot be corrected"
    return Answer(
        verdict,
        figures,
        warnings=[f"{row['position']}: {row['reason']}" for row in failed],
        notes=[*done.notes, TAUGHT],
        tables=[Table("Positions that cannot be corrected", failed)],
        files=[str(path) for path in done.files],
    )


def answer_of_prediction(found: BoxAccuracy, files: Sequence[str] = ()) -> Answer:
    """The answer of a prediction: the error to expect of the tool point over the box."""
    error = "" if found.expected is None else expected_words(found.expected, "the points reached")
    return Answer(
        found.summary(),
        {"expected error": error},
        details=[found.reference],
        tables=[Table("Expected error of the tool point [mm], one sigma", found.rows())],
        files=files,
    )
