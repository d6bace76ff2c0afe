"""Commands after identifying: prove, recheck."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from posedesign.cli import output

_IDENTIFICATION = Path("identification.json")

_OF_MEASUREMENTS = "is of measurements, and none are given"

Measured = Annotated[
    Path | None, typer.Argument(help="What was measured at these poses; none: plan them.")
]


def prove(
    cell: output.CellFile,
    measurements: Measured = None,
    identification: Annotated[
        Path | None,
        typer.Option(help="What the arm is corrected by; default: the arm as described is judged."),
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="A model of it; default: the recommended one.")
    ] = None,
    test: Annotated[
        str | None,
        typer.Option(
            help="places: as many as prove the limit over the task box (default); iso: the five "
            "poses of ISO 9283."
        ),
    ] = None,
    limit: Annotated[
        str | None, typer.Option(help="Of the error of position, such as 0.2mm (default).")
    ] = None,
    content: Annotated[
        float | None, typer.Option(help="Part of all places to be within it; default: 0.95.")
    ] = None,
    confidence: Annotated[float | None, typer.Option(help="Of saying so; default: 0.95.")] = None,
    allowed: Annotated[
        int | None, typer.Option(help="Places of the test that may be beyond; default: none.")
    ] = None,
    plane: Annotated[
        str | None, typer.Option(help="Of the cube of ISO 9283: x=z, x=-z, y=z or y=-z.")
    ] = None,
    cycles: Annotated[
        int | None, typer.Option(help="Times that each pose is measured; default: 30 of iso, or 1.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=output.LARGEST_SEED, help="Of the places; default: 1.")
    ] = None,
    rule: Annotated[
        Path | None,
        typer.Option(help="The planned test; default: acceptance_test.json at the measurements."),
    ] = None,
    frame: Annotated[
        Literal["fit", "given"],
        typer.Option(help="Of the instrument: fit, or given as the cell has it."),
    ] = "fit",
    joints: output.JointsFile = None,
    out: output.OutFolder = Path("proof"),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Prove the accuracy: plan an acceptance test, then judge what was measured at its poses.

    The rule is fixed when the test is planned; whatever the identification was made from is refused
    as a proof of it.
    """
    from posedesign import workflow
    from posedesign.acceptance import AcceptanceRequest
    from posedesign.acceptance.file import rule_as_dict
    from posedesign.cell import Cell
    from posedesign.cli.plan_request import parse_length
    from posedesign.report.acceptance import answer_of_acceptance_plan, answer_of_verdict

    asked = {
        "test": test,
        "limit": limit,
        "content": content,
        "confidence": confidence,
        "allowed": allowed,
        "plane": plane,
        "cycles": cycles,
        "seed": seed,
    }
    given: dict[str, object] = {name: value for name, value in asked.items() if value is not None}
    given_frame = frame == "given"
    loaded = Cell.load(cell)
    results = output.results_in(
        out, "prove", cell, measurements, identification, rule, joints, overwrite=overwrite
    )
    if measurements is None:
        only = {"frame": given_frame or None, "rule": rule, "joints": joints}
        output.refuse_given(only, _OF_MEASUREMENTS)
        if limit is not None:
            given["limit_m"] = parse_length(str(given.pop("limit")))
        request = AcceptanceRequest(**given)  # type: ignore[arg-type]
        with output.progress("planning"), output.knowing(loaded):
            plan = workflow.plan_acceptance_test(loaded, request, results, identification, model)
        files = [str(out / name) for name in (workflow.POSES[0], workflow.ACCEPTANCE_RULE[0])]
        return output.tell(
            answer_of_acceptance_plan(loaded, plan, files),
            verbose=verbose,
            then=output.command_line("program", files[0], "--cell", cell, "--out", out),
            first=output.rehearsed_words(identification),
            content={**rule_as_dict(plan), "notes": plan.notes, "files": files},
            as_json=as_json,
        )
    output.refuse_given(given, "was fixed when the test was planned")
    with output.progress("judging"):
        found = workflow.judge_acceptance_test(
            loaded,
            measurements,
            results,
            identification,
            model,
            rule,
            joints=joints,
            given_frame=given_frame,
            trust_units=trust_units,
        )
    names = (workflow.ACCEPTANCE[0], workflow.ACCEPTANCE_DRAWN[0][0])
    return output.tell(
        answer_of_verdict(found, [str(out / name) for name in names]),
        found.passed,
        verbose=verbose,
        then=output.command_line("report", out),
        first=output.rehearsed_words(measurements, identification),
        content=found.model_dump(),
        as_json=as_json,
    )


def recheck(
    cell: output.CellFile,
    measurements: Measured = None,
    identification: Annotated[
        Path, typer.Option(help="The identification that the arm is held against.")
    ] = _IDENTIFICATION,
    poses: Annotated[int, typer.Option(help="How many to measure at.")] = 4,
    set_up_anew: Annotated[
        bool,
        typer.Option(
            "--set-up-anew", help="Target or instrument stand elsewhere than in the identification."
        ),
    ] = False,
    joints: output.JointsFile = None,
    out: output.OutFolder = Path("recheck"),
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Is it still the robot that was identified? Plan a few poses, then test what was measured."""
    from calib.errors import InputError
    from posedesign import workflow
    from posedesign.acceptance.file import recheck_as_dict
    from posedesign.cell import Cell
    from posedesign.report.acceptance import answer_of_recheck, answer_of_recheck_plan

    if identification == _IDENTIFICATION and not identification.exists():
        raise InputError(
            f"{identification}: there is no such file here, and the arm is held against it",
            hint="name the one that posedesign identify has written with `identification`",
            name="identification",
        )
    loaded = Cell.load(cell)
    results = output.results_in(
        out, "recheck", cell, measurements, identification, joints, overwrite=overwrite
    )
    if measurements is None:
        output.refuse_given({"joints": joints}, _OF_MEASUREMENTS)
        with output.progress("choosing poses"), output.knowing(loaded):
            plan = workflow.plan_recheck_poses(
                loaded, identification, results, poses, set_up_anew=set_up_anew
            )
        files = [str(out / workflow.POSES[0])]
        return output.tell(
            answer_of_recheck_plan(loaded, plan, files),
            verbose=verbose,
            then=output.command_line("program", files[0], "--cell", cell, "--out", out),
            first=output.rehearsed_words(identification),
            content={"smallest_si": plan.smallest(), "blind": plan.blind, "files": files},
            as_json=as_json,
        )
    found = workflow.recheck_file(
        loaded,
        measurements,
        identification,
        results,
        joints=joints,
        set_up_anew=set_up_anew,
        trust_units=trust_units,
        warn=lambda text: output.note(f"warning: {measurements}: {text}"),
    )
    return output.tell(
        answer_of_recheck(found, [str(out / workflow.RECHECK[0])]),
        found.same,
        verbose=verbose,
        then=output.command_line("report", out),
        first=output.rehearsed_words(measurements, identification),
        content=recheck_as_dict(found),
        as_json=as_json,
    )
