"""What corrections and predictions answer: the best way to correct, the error that is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from posedesign.identification.correction_routes import DESCRIPTION, MASTERING
from posedesign.report.answer import Answer, Table

if TYPE_CHECKING:
    from posedesign.cell.task_box import BoxAccuracy
    from posedesign.identification.correction import Correction
    from posedesign.pose_programs import CorrectedProgram

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
            "error left": errors,
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
    """The answer of a prediction: the error of the tool point over the box."""
    return Answer(
        found.summary(),
        {"": "from the noise alone: what the model leaves out comes on top"},
        details=[found.reference],
        tables=[Table("Predicted accuracy of the tool point [mm], one sigma", found.rows())],
        files=files,
    )
