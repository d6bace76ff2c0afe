"""Commands before measuring: robots, new, plan, next, check, score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from posedesign.cli.output import (
    DONE,
    NOT_REACHED,
    explain_frames,
    note,
    note_misfit,
    print_json,
    print_table,
    progress,
    results_in,
    say,
    say_rehearsed,
    say_what_to_know,
    show_file,
)

if TYPE_CHECKING:
    from posedesign.cell import Cell
    from posedesign.files import Results
    from posedesign.planning import PosePlan
    from posedesign.planning.checks import PoseVerdict
    from posedesign.planning.optimal.choose import Outlook

LARGEST_SEED = 2**63 - 1
"""As in a cell."""

LOOSE_HAND_EYE = 1e3
"""C_G that the first round of a hand-eye calibration hardly ever exceeds: the usual threshold of
touch-ups would end the loop at the narrowest angles."""

CellFile = Annotated[Path, typer.Argument(help="The cell, made with: posedesign new > cell.toml")]
OutFolder = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace files that this command did not write, too; they are kept beside it as "
        "NAME.1, NAME.2, ...",
    ),
]
TrustUnits = Annotated[
    bool, typer.Option("--trust-units", help="Accept joint values that look like radians.")
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(robots)
    app.command()(new)
    app.command()(plan)
    app.command("next")(next_poses)
    app.command()(check)
    app.command()(score)


def robots(as_json: AsJson = False) -> int:
    """List the robots that come with the tool."""
    from calib.robots import preset_info, preset_names

    rows: list[dict[str, object]] = []
    for name in preset_names():
        info = preset_info(name)
        keys = ("title", "controller", "payload_kg", "confidence", "source")
        rows.append({"preset": name, **{key: info[key] for key in keys}})
    if as_json:
        print_json(rows)
    else:
        print_table("Robots", rows)
    return DONE


def new(
    robot: Annotated[
        str | None, typer.Option(help="Preset or URDF file; default: the reference cell.")
    ] = None,
    xacro_arg: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME:=VALUE", help="Argument of a xacro file; may be repeated."),
    ] = None,
    packages: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder to search for packages that the URDF names, before those of "
            "ROS_PACKAGE_PATH and AMENT_PREFIX_PATH; may be repeated."
        ),
    ] = None,
) -> int:
    """Print a commented cell.toml to start from."""
    from calib.errors import RobotModelError
    from posedesign.cell import Cell, cell_template

    text = cell_template(robot, packages=packages or (), xacro_args=xacro_arg or ())
    made = Cell.from_text(text)
    for said in made.robot.notices:
        note(f"note: {said}")
    try:
        made.solid  # noqa: B018
    except RobotModelError as error:
        note(f"decide before planning: {error}")
    show_file(text)
    return DONE


def plan(
    cell: CellFile,
    out: OutFolder = Path(),
    as_json: AsJson = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="wpr: the grid of the paper, made wider until C_G is low enough (usual). "
            "exchange, detmax, greedy, rounding: the best poses out of a pool, with a proof."
        ),
    ] = None,
    poses: Annotated[
        str | None, typer.Option(help="How many poses, or auto: the fewest that will do. [27]")
    ] = None,
    criterion: Annotated[
        str | None,
        typer.Option(
            help="tcp, tcp-worst (over the task box), sigma:NAME, D, A, E, C_G, cond_2, O1 .. O5. "
            "[tcp]"
        ),
    ] = None,
    target_accuracy: Annotated[
        str | None,
        typer.Option(help="Largest rms error of the tool point over the task box, e.g. 0.2mm."),
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(help="Value of the criterion that must be reached.")
    ] = None,
    wanted_sigma_mm: Annotated[
        float | None,
        typer.Option(help="Largest standard deviation of every length that is identified."),
    ] = None,
    wanted_sigma_deg: Annotated[
        float | None, typer.Option(help="The same for every angle; may be given together.")
    ] = None,
    validation: Annotated[
        int, typer.Option(help="Poses to choose besides, to be kept out of the fit.")
    ] = 0,
    refine: Annotated[
        bool | None,
        typer.Option(help="Turn the tool at the chosen poses for as long as that helps."),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(help="Poses of your own that are to be among the chosen: a poses.csv."),
    ] = None,
    robust: Annotated[
        str,
        typer.Option(
            help="Choose for robots that are not as described, too: none, average, worst."
        ),
    ] = "none",
    overwrite: Overwrite = False,
) -> int:
    """Plan measuring poses.

    Angles are raised until the condition number falls below the threshold; or, with --method
    exchange, the best poses are chosen out of a pool, and it is proven how good they are.
    """
    from posedesign.cell import Cell
    from posedesign.planning.optimal.request import request_of_words

    loaded = Cell.load(cell)
    request = request_of_words(
        method,
        poses,
        criterion,
        target_accuracy,
        threshold,
        wanted_sigma_mm,
        wanted_sigma_deg,
        validation,
        refine,
        robust,
        keep=keep is not None,
    )
    results = results_in(out, "plan", cell, keep, overwrite=overwrite)
    say_what_to_know(loaded)  # before anything is planned for it
    if request is None:
        return _plan_by_grid(loaded, results, as_json=as_json)
    from posedesign.cli.optimal_output import print_optimal
    from posedesign.planning.poses_file import read_poses
    from posedesign.workflow import plan_optimal_poses

    own = None
    if keep is not None:
        own = read_poses(keep, loaded.robot.n, controller=loaded.robot.controller)
        note_misfit(keep, own)
    with progress("planning") as advance:
        result = plan_optimal_poses(loaded, results, request, advance, own)
    print_optimal(loaded, result, out, as_json=as_json)
    return DONE if result.reached else NOT_REACHED


def next_poses(
    cell: CellFile,
    measurements: Annotated[Path, typer.Argument(help="The touch-ups so far: touchups.csv")],
    out: OutFolder = Path(),
    poses: Annotated[int, typer.Option(min=1, max=100, help="How many poses.")] = 3,
    criterion: Annotated[str, typer.Option(help="As of plan --method exchange.")] = "tcp",
    least_gain: Annotated[
        float,
        typer.Option(help="Part of the error of the tool point that a pose must gain, or stop."),
    ] = 0.02,
    target_accuracy: Annotated[
        str | None, typer.Option(help="Error of the tool point at which to stop, e.g. 0.2mm.")
    ] = None,
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
    overwrite: Overwrite = False,
) -> int:
    """Say which poses to touch up next, given those that have been, and when to stop."""
    from posedesign.cell import Cell
    from posedesign.cli.optimal_output import print_next
    from posedesign.planning.optimal.request import parse_length
    from posedesign.workflow import plan_next_poses

    loaded = Cell.load(cell)
    result = plan_next_poses(
        loaded,
        measurements,
        results_in(out, "next", cell, overwrite=overwrite),
        poses,
        criterion=criterion,
        least_gain=least_gain,
        accuracy_m=None if target_accuracy is None else parse_length(target_accuracy),
        trust_units=trust_units,
    )
    say_rehearsed(cell, measurements, as_json=as_json)
    say_what_to_know(loaded)
    print_next(loaded, result, out, as_json=as_json)
    return NOT_REACHED if result.dropped else DONE


def _plan_by_grid(loaded: Cell, out: Results, *, as_json: bool) -> int:
    """The loop of the paper."""
    from posedesign.workflow import plan_poses

    largest = max(loaded.config.variations.largest_deg)
    with progress("planning") as advance:
        result = plan_poses(
            loaded,
            out,
            lambda turn: advance(
                f"round {turn.number}, C_G {turn.c_g:.3g}", max(turn.variation_deg) / largest
            ),
        )
    if loaded.is_hand_eye and result.threshold >= LOOSE_HAND_EYE:
        note(
            f"note: hardly any poses of a hand-eye calibration have a C_G above "
            f"{result.threshold:.4g}: set plan.condition_threshold to 100 or less, or say what is "
            "wanted with --wanted-sigma-mm and --wanted-sigma-deg"
        )
    print_plan(loaded, result, out.folder, as_json=as_json)
    return DONE if result.reached else NOT_REACHED


def print_plan(cell: Cell, result: PosePlan, out: Path, *, as_json: bool) -> None:
    """Print the rounds, the outcome and what accuracy to expect."""
    from posedesign.planning import scaling_of
    from posedesign.planning.optimal.choose import outlook_of
    from posedesign.workflow import round_rows

    outlook = outlook_of(cell, result.model, result.postures)
    sigma = [
        {"parameter": name, "predicted sigma": value, "unit": unit}
        for name, unit, value in result.sigma_displayed()
    ]
    if as_json:
        print_json(
            {
                "reached": result.reached,
                "stop": str(result.stop),
                "message": result.message,
                "threshold": result.threshold,
                "target": cell.whereabouts.as_dict(),
                "not_checked": result.not_checked,
                "fingerprint": result.fingerprint,
                "cycle_time_s": result.cycle_time_s,
                "rounds": round_rows(result),
                "indices": result.indices.as_dict(),
                "scaling": scaling_of(result.model),
                "predicted": sigma,
                "tcp_rms_mm": 1e3 * outlook.tcp_m,
                "tcp_worst_rms_mm": 1e3 * outlook.tcp_worst_m,
                "chosen_tcp_rms_mm": None
                if outlook.chosen_tcp_m is None
                else 1e3 * outlook.chosen_tcp_m,
                "task_box": outlook.box_words,
                "files": [str(out / "poses.csv"), str(out / "rounds.csv")],
            }
        )
        return
    rounds = [
        {key: value for key, value in row.items() if not key.startswith("sigma_target")}
        for row in round_rows(result)
    ]
    short = [{k.replace("zero_offset.", ""): v for k, v in row.items()} for row in rounds]
    print_table("Rounds of the loop", [_without_tool(row) for row in short])
    print_table("Predicted before measuring, from the noise alone", sigma)
    explain_frames(result.model)
    changed = zip(result.poses.names, result.poses.status, result.poses.reasons, strict=True)
    print_table(
        "Poses that are not those of the grid",
        [{"pose": name, "status": str(s), "reason": why} for name, s, why in changed if why],
    )
    say(result.message)
    print_outlook(outlook)
    say(result.route.timing)
    say(f"wrote {out / 'poses.csv'} and {out / 'rounds.csv'}")


def print_outlook(outlook: Outlook) -> None:
    """Print what the poses are worth at the tool point, and what chosen ones would be."""
    say(
        f"predicted error of the tool point over {outlook.box_words}: "
        f"{1e3 * outlook.tcp_m:.4g} mm rms, {1e3 * outlook.tcp_worst_m:.4g} mm where it is largest"
    )
    if outlook.chosen_is_better and outlook.chosen_tcp_m is not None:
        say(
            f"as many poses chosen by --method exchange: about {1e3 * outlook.chosen_tcp_m:.2g} mm "
            "(before the motions between them are looked at)"
        )


def _without_tool(row: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in row.items() if not key.startswith("sigma_tool")}


def check(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")],
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
) -> int:
    """Say whether the robot can really take the poses of a list, and go from one to the next.

    Limits, singularities, collisions, the view of the target, and the straight ways in between.
    """
    from posedesign.cell import Cell
    from posedesign.planning import off_target
    from posedesign.planning.checks import ON_TARGET_M, check_poses
    from posedesign.planning.poses_file import read_poses

    loaded = Cell.load(cell)
    listed = read_poses(
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
    )
    note_misfit(poses, listed)
    say_what_to_know(loaded)
    verdicts = check_poses(loaded, listed)
    measured = listed.measured
    off = off_target(loaded, measured.names, measured.postures, ON_TARGET_M)
    good = all(verdict.ok for verdict in verdicts) and not off
    if as_json:
        print_json(
            {
                "feasible": good,
                "poses": [verdict.__dict__ for verdict in verdicts],
                "off_target": off,
                "target": loaded.whereabouts.as_dict(),
                "notices": loaded.notices,
                "not_checked": loaded.not_checked,
            }
        )
        return DONE if good else NOT_REACHED
    print_table("Poses", [_verdict_row(verdict) for verdict in verdicts])
    for line in off:
        note(f"warning: {line}")
    say(_counted(verdicts))
    with_distance = [v for v in verdicts if v.distance_mm is not None]
    if with_distance:
        nearest = min(with_distance, key=lambda v: v.distance_mm or 0.0)
        say(f"smallest distance, at {nearest.name}: {nearest.nearest}")
    return DONE if good else NOT_REACHED


def _counted(verdicts: Sequence[PoseVerdict]) -> str:
    """How many poses cannot be taken, those to measure at and those passed through apart."""
    bad = {via: [v for v in verdicts if v.via is via and not v.feasible] for via in (False, True)}
    passed = sum(verdict.via for verdict in verdicts)
    said = f"{len(verdicts) - passed} poses: {len(bad[False])} cannot be taken"
    if bad[True]:
        said += f"; of {passed} passed through, {len(bad[True])} cannot"
    blocked = sum(verdict.way_clear is False for verdict in verdicts)
    return f"{said}; {blocked} motions between them not clear"


def _verdict_row(verdict: PoseVerdict) -> dict[str, object]:
    return {
        "pose": verdict.name + " (via)" * verdict.via,
        "verdict": "ok" if verdict.ok else ("NO" if not verdict.feasible else "NO WAY"),
        "tightest": verdict.tightest,
        "room": None if verdict.room is None else round(verdict.room, 3),
        "unit": verdict.unit,
        "in words": verdict.says + (f"; on the way to it: {verdict.way}" if verdict.way else ""),
        "distance [mm]": None if verdict.distance_mm is None else round(verdict.distance_mm, 1),
        "travel [deg]": round(verdict.travel_deg, 1),
    }


def score(
    cell: CellFile,
    poses: Annotated[Path, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")],
    as_json: AsJson = False,
    trust_units: TrustUnits = False,
) -> int:
    """Say how good any list of poses is.

    Condition numbers, indices, and the accuracy to expect.
    """
    from posedesign.cell import Cell
    from posedesign.planning import scaling_of
    from posedesign.planning.checks import score_poses
    from posedesign.planning.poses_file import read_poses

    loaded = Cell.load(cell)
    listed = read_poses(
        poses, loaded.robot.n, controller=loaded.robot.controller, trust_units=trust_units
    )
    note_misfit(poses, listed)
    scored = score_poses(loaded, listed.measured)
    say_what_to_know(loaded)
    scaling = scaling_of(loaded.model())
    threshold = loaded.config.plan.condition_threshold
    below = scored.indices.c_g < threshold
    good = below and not (scored.problem or scored.not_feasible or scored.off_target)
    sigma = [
        {"parameter": name, "predicted sigma": value, "unit": unit}
        for name, unit, value in scored.sigma
    ]
    if as_json:
        print_json(
            {
                "indices": scored.indices.as_dict(),
                "scaling": scaling,
                "predicted": sigma,
                "problem": scored.problem,
                "not_feasible": scored.not_feasible,
                "off_target": scored.off_target,
                "not_checked": loaded.not_checked,
                "threshold": threshold,
                "reached": good,
            }
        )
    else:
        print_table(
            "Indices",
            [
                {"index": key, "value": value, "scaling": scaling.get(key, "")}
                for key, value in scored.indices.as_dict().items()
            ],
        )
        print_table("Predicted before measuring, from the noise alone", sigma)
        for line in (*scored.not_feasible, *scored.off_target):
            note(f"warning: {line}")
        verdict = "below" if below else "not below"
        say(scored.problem or f"C_G {scored.indices.c_g:.4g} is {verdict} {threshold:.4g}")
        if scored.not_feasible:
            say(f"poses that cannot be taken: {len(scored.not_feasible)}")
        if scored.off_target:
            say(f"poses that do not touch the target: {len(scored.off_target)}")
    return DONE if good else NOT_REACHED
