"""Commands before measuring: robots, new, plan, next, check, score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from posedesign.cli import output
from posedesign.report.answer import WIDTH

if TYPE_CHECKING:
    from posedesign.cell import Cell
    from posedesign.files import Results
    from posedesign.planning import PosePlan
    from posedesign.planning.optimal.outlook import Outlook
    from posedesign.report.answer import Answer

LOOSE_HAND_EYE = 1e3
"""C_G that the first round of a hand-eye calibration hardly ever exceeds: the usual threshold of
touch-ups would end the loop at the narrowest angles."""


def robots(as_json: output.AsJson = False, verbose: output.Verbose = False) -> int:
    """List the robots that come with the tool."""
    from calib.robots import preset_info, preset_names

    rows: list[dict[str, object]] = []
    for name in preset_names():
        info = preset_info(name)
        keys = ("title", "controller", "payload_kg", "confidence", "source")
        rows.append({"preset": name, **{key: info[key] for key in keys}})
    if as_json:
        output.print_json(rows)
    elif verbose:
        output.print_table("Robots", rows)
    else:
        for row in rows:
            said = str(row.pop("confidence"))
            doubtful = "UNVERIFIED" if "UNVERIFIED" in said else "partly unverified"
            row["numbers"] = doubtful if "unverified" in said.lower() else "public"
            del row["source"]
        output.print_table("Robots", rows, WIDTH)
    return output.DONE


def new(
    robot: Annotated[
        str | None, typer.Option(help="Preset or URDF file; default: the reference cell.")
    ] = None,
    camera: Annotated[
        Literal["flange", "fixed"] | None,
        typer.Option(
            help="A cell for pictures of a board: the camera on the flange, or fixed around the "
            "arm, with the board on the flange."
        ),
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
    tip: Annotated[str | None, typer.Option(help="Link of the URDF that carries the tool.")] = None,
    base: Annotated[
        str | None, typer.Option(help="Link of the URDF that positions are given in.")
    ] = None,
    lock: Annotated[
        list[str] | None,
        typer.Option(help="Joint of the URDF between them that is held; may be repeated."),
    ] = None,
) -> int:
    """Print a commented cell.toml to start from."""
    from calib.errors import RobotModelError
    from calib.robots import preset_info
    from calib.robots.arm_shapes import makers_like
    from posedesign.cell import Cell, cell_template
    from posedesign.cell.template import srdf_beside

    text = cell_template(
        robot,
        camera=camera,
        packages=packages or (),
        xacro_args=xacro_arg or (),
        tip=tip,
        base=base,
        lock=lock or (),
    )
    made = Cell.from_text(text)
    if robot is None:
        output.note(
            f"note: this is the reference cell, of a {preset_info(made.robot.name)['title']}; for "
            "your own robot: posedesign new --robot PRESET or FILE.urdf (posedesign robots lists "
            "the presets)"
        )
    for said in made.doubts:
        output.note(f"warning: {said}")
    for said in made.robot.notices:
        output.note(f"note: {said}")
    beside = made.config.robot.urdf and srdf_beside(Path(made.config.robot.urdf))
    if beside:
        output.note(
            f"note: {beside.name} lies beside the URDF: robot.srdf takes it, if you want it"
        )
    try:
        made.solid  # noqa: B018
    except RobotModelError as error:
        output.note(f"decide before planning: {error}")
    makers = makers_like(made.robot) if made.robot.controller is None else ()
    if makers:
        output.note(
            "say before planning whose it is, for programs need it: robot.controller = "
            f'"{makers[0]}" perhaps'
        )
    output.show_file(text)
    return output.DONE


def plan(
    cell: output.CellFile,
    out: output.OutFolder = Path(),
    as_json: output.AsJson = False,
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
        typer.Option(
            help="Largest rms error of the tool point over the task box: 0.2mm or 200um; in mm "
            "where no unit is given."
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            help="Value of the criterion that must be reached: in mm for tcp and tcp-worst, in mm "
            "or deg for sigma:NAME; the others have no unit."
        ),
    ] = None,
    wanted_sigma_mm: Annotated[
        float | None,
        typer.Option(help="Largest standard deviation of every length that is identified [mm]."),
    ] = None,
    wanted_sigma_deg: Annotated[
        float | None, typer.Option(help="The same for every angle [deg]; may be given together.")
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            help="How long a round may take, in place of a number of poses: as many of the best as "
            "there is time for."
        ),
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
    verbose: output.Verbose = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Plan measuring poses.

    Angles are raised until the condition number falls below the threshold; or, with --method
    exchange, the best poses are chosen out of a pool, and it is proven how good they are.
    """
    from posedesign.cell import Cell
    from posedesign.cli.plan_request import request_of_words

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
        minutes=minutes,
    )
    results = output.results_in(out, "plan", cell, keep, overwrite=overwrite)
    if request is None:
        return _plan_by_grid(loaded, results, cell, as_json=as_json, verbose=verbose)
    from posedesign.cli.json_forms import choice_as_dict
    from posedesign.report.plans import answer_of_choice
    from posedesign.workflow import plan_optimal_poses

    own = None if keep is None else output.poses_of(loaded, keep, of_any_robot=True)
    with output.knowing(loaded), output.progress("planning") as advance:
        result = plan_optimal_poses(loaded, results, request, advance, own)
    names = ("poses.csv", *["validation.csv"] * (result.validation is not None), "plan.png")
    files = [str(out / name) for name in names if result.route is not None]
    return output.tell(
        answer_of_choice(loaded, result, files),
        result.reached,
        verbose=verbose,
        then=_program_command(loaded, files, cell, out),
        content=choice_as_dict(loaded, result) | {"files": files},
        as_json=as_json,
    )


def next_poses(
    cell: output.CellFile,
    measurements: Annotated[
        Path,
        typer.Argument(
            help="What was measured so far, as identify takes it; of pictures of a board "
            "camera.json, or the poses: poses.csv"
        ),
    ],
    joints: output.JointsFile = None,
    out: output.OutFolder = Path(),
    poses: Annotated[int, typer.Option(min=1, max=100, help="How many poses.")] = 3,
    criterion: Annotated[str, typer.Option(help="As of plan --method exchange.")] = "tcp",
    least_gain: Annotated[
        float,
        typer.Option(help="Part of the error of the tool point that a pose must gain, or stop."),
    ] = 0.02,
    target_accuracy: Annotated[
        str | None,
        typer.Option(
            help="Error of the tool point at which to stop: 0.2mm or 200um; in mm where no unit is "
            "given."
        ),
    ] = None,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Say which poses to measure next, given those that have been, and when to stop."""
    from posedesign.cell import Cell
    from posedesign.cli.json_forms import next_as_dict
    from posedesign.cli.plan_request import parse_length
    from posedesign.report.plans import answer_of_next
    from posedesign.workflow import plan_next_poses

    loaded = Cell.load(cell)
    with output.knowing(loaded), output.progress("choosing the next poses"):
        result = plan_next_poses(
            loaded,
            measurements,
            output.results_in(out, "next", cell, overwrite=overwrite),
            poses,
            criterion=criterion,
            least_gain=least_gain,
            accuracy_m=None if target_accuracy is None else parse_length(target_accuracy),
            joints=joints,
            trust_units=trust_units,
            warn=lambda text: output.note(f"warning: {measurements}: {text}"),
        )
    files = [str(out / "poses.csv")]
    then = output.command_line("program", files[0], "--cell", cell, *output.to_folder(out))
    if not result.worth:
        of = ("--joints", joints) if joints else ()
        then = output.command_line("identify", cell, measurements, *of, *output.to_folder(out))
    return output.tell(
        answer_of_next(loaded, result, files),
        not result.dropped,
        verbose=verbose,
        then=then,
        first=output.rehearsed_words(cell, measurements),
        content=next_as_dict(loaded, result) | {"files": files},
        as_json=as_json,
    )


def _plan_by_grid(loaded: Cell, out: Results, cell: Path, *, as_json: bool, verbose: bool) -> int:
    """The loop of the paper."""
    from posedesign.cli.json_forms import plan_as_dict
    from posedesign.planning.optimal.outlook import outlook_of
    from posedesign.workflow import plan_poses

    largest = max(loaded.config.variations.largest_deg)
    with output.knowing(loaded), output.progress("planning") as advance:
        result = plan_poses(
            loaded,
            out,
            lambda turn: advance(
                f"round {turn.number}, C_G {turn.c_g:.3g}", max(turn.variation_deg) / largest
            ),
        )
        outlook = outlook_of(loaded, result.postures)
    files = [str(out.folder / name) for name in ("poses.csv", "rounds.csv", "plan.png")]
    return output.tell(
        told_plan(loaded, result, outlook, files),
        result.reached,
        verbose=verbose,
        then=_program_command(loaded, files, cell, out.folder),
        content=plan_as_dict(loaded, result, outlook) | {"files": files},
        as_json=as_json,
    )


def _program_command(cell: Cell, files: Sequence[str], path: Path, out: Path) -> str:
    """The command that writes the program, after what the cell has to say for it."""
    from calib.robots.arm_shapes import makers_like

    if not files:
        return ""
    controller, words = cell.robot.controller, ["program", files[0], "--cell", path]
    named = controller is not None and bool(controller.maker)
    makers = (controller.maker,) if controller is not None and named else makers_like(cell.robot)
    if not makers:  # each maker whose controllers are known has programs
        words += ["--format", "ros-trajectory"]
        return output.command_line(*words, *output.to_folder(out))
    first = f'say whose it is in {path}, robot.controller = "{makers[0]}" perhaps; then '
    return first * (not named) + output.command_line(*words, *output.to_folder(out))


def told_plan(cell: Cell, result: PosePlan, outlook: Outlook, files: Sequence[str] = ()) -> Answer:
    """The answer of the loop, with what to ask for where that would be better."""
    from posedesign.report.plans import answer_of_plan

    answer = answer_of_plan(cell, result, outlook, files)
    figures = dict(answer.figures)
    if figures["better"]:
        figures["better"] += " (--method exchange)"
    warnings = list(answer.warnings)
    if cell.is_hand_eye and result.threshold >= LOOSE_HAND_EYE:
        warnings.append(
            f"hardly any poses of a hand-eye calibration have a C_G above {result.threshold:.4g}: "
            "set plan.condition_threshold to 100 or less, or say what is wanted with "
            "--wanted-sigma-mm and --wanted-sigma-deg"
        )
    return replace(answer, figures=figures, warnings=warnings)


def check(
    cell: output.CellFile,
    poses: output.ListedPoses,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
) -> int:
    """Say whether the robot can really take the poses of a list, and go from one to the next.

    Limits, singularities, collisions, the view of the target, and the straight ways in between.
    """
    from posedesign.cell import Cell
    from posedesign.planning import off_target
    from posedesign.planning.checks import ON_TARGET_M, check_poses
    from posedesign.report.plans import answer_of_check

    loaded = Cell.load(cell)
    listed = output.poses_of(loaded, poses, trust_units=trust_units)
    with output.knowing(loaded), output.progress("checking poses and motions"):
        verdicts = check_poses(loaded, listed)
        measured = listed.measured
        which = loaded.which(measured.labels)
        off = off_target(loaded, measured.names, measured.postures, ON_TARGET_M, which)
    good = all(verdict.ok for verdict in verdicts) and not off
    content = {
        "feasible": good,
        "poses": [verdict.__dict__ for verdict in verdicts],
        "off_target": off,
        "target": loaded.whereabouts.as_dict(),
        "notices": loaded.notices,
        "not_checked": loaded.not_checked,
    }
    answer = answer_of_check(loaded, verdicts, off)
    return output.tell(answer, good, verbose=verbose, content=content, as_json=as_json)


def score(
    cell: output.CellFile,
    poses: output.ListedPoses,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
) -> int:
    """Say how good any list of poses is.

    Condition numbers, indices, and the accuracy to expect.
    """
    from posedesign.cell import Cell
    from posedesign.cli.json_forms import expected_as_dict
    from posedesign.planning import scaling_of
    from posedesign.planning.checks import score_poses
    from posedesign.report.plans import answer_of_score, sigma_table

    loaded = Cell.load(cell)
    listed = output.poses_of(loaded, poses, trust_units=trust_units)
    with output.knowing(loaded):
        scored = score_poses(loaded, listed.measured)
    scaling = scaling_of(loaded.model())
    threshold = loaded.config.plan.condition_threshold
    below = scored.indices.c_g < threshold
    good = below and not (scored.problem or scored.not_feasible or scored.off_target)
    content = {
        "indices": scored.indices.as_dict(),
        "scaling": scaling,
        "expected_error": expected_as_dict(scored.expected),
        "predicted": sigma_table(scored.sigma).rows,
        "problem": scored.problem,
        "not_feasible": scored.not_feasible,
        "off_target": scored.off_target,
        "not_checked": loaded.not_checked,
        "threshold": threshold,
        "reached": good,
    }
    answer = answer_of_score(loaded, scored, scaling)
    return output.tell(answer, good, verbose=verbose, content=content, as_json=as_json)
