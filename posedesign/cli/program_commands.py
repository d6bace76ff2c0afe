"""Commands for a controller's programs: program, validate, import, record, convert."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer

from posedesign.cli import output

if TYPE_CHECKING:
    from posedesign.cell import Cell
    from posedesign.pose_programs import WrittenProgram
    from posedesign.pose_programs.touch_ups import Imported
    from posedesign.report.answer import Answer


USUAL_NAME = "CALIB01"

MOST_SHOWN = 9
"""Problems of a file that are read at a glance."""

Files = Annotated[list[Path], typer.Argument(help="Program files, backups, or lists in CSV.")]


def program(
    poses: output.PlannedPoses,
    dialect: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="fanuc-ls, kuka-krl, abb-rapid, ur-script, ur-urp, yaskawa-jbi, staubli-val3, "
            "mitsubishi-melfa, kawasaki-as, doosan-drl, denso-pac, epson-spel, "
            "hyundai-job, comau-pdl, xarm-python, franky-python, ros-trajectory, "
            "moveit-joints, robot-calibration, robodk-csv. [that of the robot's controller]",
        ),
    ] = None,
    out: output.OutFolder = Path(),
    cell: Annotated[
        Path | None, typer.Option(help="Cell with a [program] section; default: usual values.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the program.")] = None,
    form: Annotated[
        str | None,
        typer.Option(help="joint, or cartesian: poses of the tool, with their configuration."),
    ] = None,
    approach_deg: Annotated[
        float | None,
        typer.Option(help="Let every joint come from one side to each pose, by this angle [deg]."),
    ] = None,
    payload: Annotated[
        str | None,
        typer.Option(help="Of a list for several loads, the one to write a program for, or none."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write poses that break constraints of the cell, too.")
    ] = False,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Write the robot program that visits the poses."""
    from posedesign.cell import Cell
    from posedesign.planning import check_fit
    from posedesign.planning.checks import check_clear
    from posedesign.pose_programs import chosen_dialect, program_options, write_program
    from posedesign.pose_programs.from_plan import with_approaches

    loaded = Cell.load(cell) if cell is not None else None
    listed = output.poses_of(loaded, poses, trust_units=trust_units, of_any_robot=True)
    listed = listed.of_payload("" if payload == "none" else payload)
    chosen = chosen_dialect(loaded, listed, dialect)
    listed = with_approaches(loaded, listed, approach_deg)
    forced: tuple[str, ...] = ()
    if loaded:
        with output.knowing(loaded), output.progress("checking poses and motions"):
            check_fit(loaded, listed)
            forced = check_clear(loaded, listed, force=force)
    usual = loaded.config.program.name if loaded else USUAL_NAME
    title = usual if name is None else name
    options = program_options(loaded, listed, form)
    results = output.results_in(out, "program", poses, cell, overwrite=overwrite)
    written = write_program(listed, results, chosen, options, title, loaded, forced)
    good, first = not written.problems, output.rehearsed_words(poses, cell)
    content = {**written.__dict__, "paths": [str(path) for path in written.paths]}
    told = _told(written, loaded)
    return output.tell(told, good, verbose=verbose, first=first, content=content, as_json=as_json)


def _told(written: WrittenProgram, cell: Cell | None) -> Answer:
    """What was written, and what nobody has checked of it."""
    from posedesign.report.answer import Answer

    count = f"{written.poses} poses"
    if written.corrected_by:
        count += f", CORRECTED BY {written.corrected_by}, not those of the plan"
    rounding = f"joints rounded by at most {written.largest_rounding_deg:.1g} deg"
    if cell is not None and cell.robot.sliding.any():
        rounding += f", slides by {written.largest_rounding_mm:.1g} mm"
    figures = {"rounding": rounding}
    if written.c_g is not None and written.c_g_rounded is not None:
        figures["C_G"] = f"as planned {written.c_g:.5g}, as written {written.c_g_rounded:.5g}"
    notes = [written.note] if written.note else []
    not_checked = list(written.not_checked)
    if cell is None:
        not_checked.append("limits, collisions and target: pass --cell")
    else:
        figures["target"] = cell.whereabouts.words
        notes += cell.remarks
        not_checked = list(dict.fromkeys([*cell.not_checked, *not_checked]))
    return Answer(
        f"{count}, {len(written.problems)} objections to the program"
        + ", NOT CHECKED against a cell" * (cell is None),
        figures,
        warnings=[
            *(cell.doubts if cell else ()),
            *(f"written in spite of {said}" for said in written.forced),
            *(str(problem) for problem in written.problems),
            *([written.warning] if written.warning else []),
        ],
        not_checked=not_checked,
        notes=notes,
        files=[str(path) for path in written.paths],
    )


def validate(
    files: Files,
    dialect: output.FileFormat = None,
    measuring: Annotated[
        bool | None,
        typer.Option(
            "--measuring/--running",
            help="Ask for what a measuring program needs, or only for what a controller does; "
            "default: the first of programs that posedesign wrote.",
        ),
    ] = None,
    as_json: output.AsJson = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print all problems of each file.")
    ] = False,
) -> int:
    """Check program files strictly against the rules of their controllers."""
    from calib.errors import FileFormatError
    from posedesign.files import origin_of
    from posedesign.programs import Level
    from posedesign.programs.registry import dialect_of

    found = []
    for path in files:
        origin = origin_of(path) if path.suffix.lower() == ".csv" else None
        if origin is not None:
            raise FileFormatError(
                f"holds {origin.purpose}, not a program",
                path=path,
                hint="poses are checked by: posedesign check CELL POSES",
            )
        chosen = dialect_of(path, dialect)
        levels = chosen.levels_of(path)
        if measuring is not None:
            levels = ("error", "measuring") if measuring else ("error",)
        every = chosen.validate(path, get_args(Level))
        problems = [problem for problem in every if problem.level in levels]
        notes = [problem for problem in every if problem.level == "note"]
        found.append((path, chosen, levels, problems, notes))
    good = not any(problems for *_, problems, _ in found)
    if as_json:
        output.print_json(
            {
                "valid": good,
                "files": [
                    {
                        "path": str(path),
                        "format": chosen.name,
                        "levels": list(levels),
                        "problems": [problem.__dict__ for problem in problems],
                        "notes": [problem.__dict__ for problem in notes],
                    }
                    for path, chosen, levels, problems, notes in found
                ],
            }
        )
        return output.DONE if good else output.NOT_REACHED
    for path, chosen, levels, problems, notes in found:
        asked = "" if "measuring" in levels else " that a controller would refuse"
        verdict = f"{len(problems)} problem(s)" if problems else "no problem found"
        output.say(f"{path}: {chosen.title}: {verdict}{asked}")
        told = problems if verbose else problems[:MOST_SHOWN]
        for problem in told:
            output.say(f"- {problem}")
        if len(told) < len(problems):
            output.say(f"- and {len(problems) - len(told)} more: see --verbose")
        for remark in notes:
            output.note(f"{path}: note: {remark}")
    return output.DONE if good else output.NOT_REACHED


def import_positions(
    cell: output.CellFile,
    files: Files,
    out: output.OutFolder = Path(),
    poses: Annotated[
        Path | None, typer.Option(help="The plan that the program was written from: its poses.csv.")
    ] = None,
    dialect: output.FileFormat = None,
    keep_untouched: Annotated[
        bool, typer.Option("--keep-untouched", help="Take positions that stand as planned, too.")
    ] = False,
    as_json: output.AsJson = False,
    verbose: output.Verbose = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Read touched-up positions back from the controller; write touchups.csv."""
    from posedesign.cell import Cell
    from posedesign.files.measurements import write_measurements
    from posedesign.pose_programs import import_touch_ups
    from posedesign.workflow import TOUCH_UPS

    loaded = Cell.load(cell)
    plan = None if poses is None else output.poses_of(loaded, poses)
    results = output.results_in(out, "import", cell, poses, *files, overwrite=overwrite)
    (claimed,) = results.claim("measured", TOUCH_UPS)
    with output.progress("reading programs"):
        imported = import_touch_ups(loaded, files, plan, dialect, keep_untouched=keep_untouched)
    loads = [load.name for load in loaded.config.payload]
    kinds = [] if loaded.is_hand_eye else list(dict.fromkeys(o.kind for o in loaded.observations))
    several = kinds if len(kinds) > 1 else []
    path = write_measurements(
        claimed, imported.touch_ups, several, payloads=loads, external=loaded.robot.external
    )
    content = {
        "path": str(path),
        "touch_ups": imported.touch_ups.count,
        "moved_mm": imported.moved_mm,
        "untouched": imported.untouched,
        "missing": imported.missing,
        "warnings": imported.warnings,
    }
    return output.tell(
        _told_imported(imported, path, planned=plan is not None),
        not imported.doubtful,
        verbose=verbose,
        then=output.command_line(
            *output.after_measuring(cell, poses, path), *output.to_folder(out)
        ),
        content=content,
        as_json=as_json,
    )


def _told_imported(imported: Imported, path: Path, *, planned: bool) -> Answer:
    """What came back: how far touch-up moved the tool point, and what is missing."""
    from posedesign.report.answer import Answer, Table

    names, moved = imported.touch_ups.names, [float(far) for far in imported.moved_mm]
    figures = {}
    if planned and moved:
        figures["moved"] = f"the tool point by {min(moved):.3f} to {max(moved):.3f} mm"
    warnings = list(imported.warnings)
    if imported.untouched:
        warnings.append(f"as planned, so not touched up: {', '.join(imported.untouched)}")
    if imported.missing:
        warnings.append(f"of the plan, not in the files: {', '.join(imported.missing)}")
    rows = [{"pose": n, "moved [mm]": round(far, 3)} for n, far in zip(names, moved, strict=False)]
    not_given = "pass --poses to check that the file belongs to the plan, and was touched up"
    return Answer(
        f"{len(names)} touch-ups",
        figures,
        warnings=warnings,
        notes=[] if planned else [not_given],
        tables=[Table("How far touch-up moved the tool point", rows if planned else [])],
        files=[str(path)],
    )


MOST_REFUSED = 1000
"""Poses told in vain: what tells of more is no measuring program."""


def record(
    cell: output.CellFile,
    poses: Annotated[Path, typer.Argument(help="The plan that the program was written from.")],
    host: Annotated[str, typer.Argument(help="Name or address of the UR controller.")],
    out: output.OutFolder = Path(),
    register: Annotated[
        int,
        typer.Option(
            help="Output integer register that the program writes the number of each pose into, "
            "and 0 before it moves on: 36 to 43, or 12 to 19."
        ),
    ] = 36,
    timeout_s: Annotated[float, typer.Option(help="Longest time without a pose [s].")] = 3600.0,
    as_json: output.AsJson = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Take touch-ups from a UR while its program runs; add each to touchups.csv.

    Stopped and begun again, it goes on with the poses that are missing.
    """
    from calib.errors import InputError
    from posedesign.cell import Cell
    from posedesign.files import held, make_folder
    from posedesign.pose_programs.recording import Recording, check_recorded
    from posedesign.programs.ur_script.live import told_poses
    from posedesign.workflow import TOUCH_UPS

    loaded = Cell.load(cell)
    plan = output.poses_of(loaded, poses, trust_units=trust_units)
    check_recorded(loaded, plan)
    arriving = told_poses(host, register, timeout_s, output.note)
    results = output.results_in(make_folder(out), "record", poses, overwrite=overwrite)
    refused: list[str] = []
    with held(out, "recording"):
        (claimed,) = results.claim("measured", TOUCH_UPS)
        recording = Recording.resume(loaded, plan, claimed)
        total = len(recording.plan.names)
        if recording.by_hand:
            output.note(f"warning: {claimed}: {recording.by_hand}")
        if recording.rows:
            output.note(
                f"{claimed}: goes on, {len(recording.missing)} of {total} poses are missing"
            )
        for told in arriving if recording.missing else ():
            try:
                if told.q is None:
                    raise InputError(f"pose {told.number} {told.problem}")
                name, moved_m = recording.take(told.number, told.q)
            except InputError as error:
                refused.append(error.message)
                output.note(f"warning: not recorded: {error}")
                if len(refused) > MOST_REFUSED:
                    raise
                continue
            line = f"{name}: touched up, {1e3 * moved_m:.3f} mm from the plan"
            (output.note if as_json else output.say)(
                f"{line} ({total - len(recording.missing)} of {total})"
            )
            if not recording.missing:
                break
    if as_json:
        said = {"touch_ups": len(recording.rows), "missing": recording.missing, "refused": refused}
        output.print_json({"path": str(claimed), **said})
    else:
        output.say(f"{claimed}: {len(recording.rows)} touch-ups")
    if recording.missing:
        output.note(f"warning: the program has ended without {', '.join(recording.missing)}")
    return output.NOT_REACHED if recording.missing else output.DONE


def convert(
    poses: Annotated[
        Path,
        typer.Argument(help="A table of poses: joints as j1_deg .., <joint name>_rad .. or J1 .."),
    ],
    cell: Annotated[Path, typer.Option(help="The cell: its robot has the names of the joints.")],
    out: Annotated[Path, typer.Option("--out", help="The table to write.")],
    to: Annotated[
        Literal["usual", "ros", "robodk"],
        typer.Option(
            help="usual: j1_deg ..; ros: <joint name>_rad ..; robodk: J1 .. as the pendant shows "
            "them, first in each row."
        ),
    ] = "usual",
    as_json: output.AsJson = False,
    trust_units: output.TrustUnits = False,
    overwrite: output.Overwrite = False,
) -> int:
    """Write a table of poses with its joints named in another way.

    Configuration and margins are written anew; columns that are not known are kept.
    """
    from posedesign.cell import Cell
    from posedesign.files.postures import JointForm
    from posedesign.planning import Margins, outside_limits
    from posedesign.planning.poses_file import read_robot_poses, write_pose_list

    loaded = Cell.load(cell)
    (file,) = output.results_in(out.parent, "convert", poses, overwrite=overwrite).claim(
        "planned", (out.name, "converted poses"), bare=to == "robodk"
    )
    listed = read_robot_poses(poses, loaded.robot, trust_units=trust_units)
    for said in outside_limits(loaded, listed.names, listed.postures):
        output.note(f"warning: {poses}: {said}")
    output.note_misfit(poses, listed, loaded)
    write_pose_list(
        file,
        listed,
        loaded.robot,
        loaded.tool_m,
        margins=Margins.of(loaded, listed),
        form=JointForm(to),
    )
    if as_json:
        output.print_json(
            {
                "path": str(out),
                "poses": len(listed.measured.names),
                "fingerprint": listed.fingerprint,
                "fingerprint_written": listed.fingerprint_written,
                "kept_columns": list(listed.extra),
            }
        )
    else:
        output.say(f"wrote {out}: {len(listed.measured.names)} poses")
    return output.DONE
