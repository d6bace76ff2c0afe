"""From a pose list to a controller's program, checked, and how good its rounded poses still are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from calib.errors import InputError
from calib.robots.arm_shapes import makers_like
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.cell import Cell
from posedesign.cell.schema import FrameSection
from posedesign.cell.surroundings import touches
from posedesign.files import Results
from posedesign.files.origin import described, is_simulated
from posedesign.motion import KnownMotions, find_approaches
from posedesign.motion.route import Passing
from posedesign.planning import fingerprint
from posedesign.planning.loop import identification_jacobian, told_by
from posedesign.planning.poses_file import STOPS_SHORT, PoseList
from posedesign.programs import (
    DIALECTS,
    Arm,
    Dialect,
    Load,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    RecordedPosition,
    find_dialect,
    postures_of,
)
from posedesign.programs.program import form_of, in_range
from posedesign.selection import evaluate

MOST_CHANGE = 0.01
"""Part by which rounding may change C_G before it is worth a warning."""


WORLD_STANDS = ("kuka", "abb")
"""Makers whose world stays where it is while slides carry the arm: KUKA's chain from ``$WORLD`` to
the arm's root has the ROBROOT kinematic system in it, whose offset is ``$ERSYSROOT`` (machine data
of the KR C2, 12.04, 2.1.9); ABB's base frame is moved by the track in a fixed world (RAPID, Basic
characteristics, 1.2.6). What is public of others does not say, or disagrees."""


def arm_of(cell: Cell) -> Arm:
    """The arm of a cell as its controller knows it, with the frames of ``[program]``.

    Raises InputError: user frame 0, which is the world's on a FANUC, is given another place; a
    world where the arm stands, or of another maker.
    """
    section = cell.config.program
    tool = section.tool or FrameSection(at_mm=cell.config.tool.point_mm)
    user = section.user or FrameSection()
    T_world_user = _frame(user)
    controller = cell.robot.controller
    in_world = controller and controller.maker == "fanuc" and section.user_frame == 0
    if in_world and not np.array_equal(T_world_user, np.eye(4)):
        raise InputError(
            "user frame 0 of a FANUC is the world: it cannot be elsewhere",
            hint="set program.user_frame to the number that it has on the controller",
            name="program.user",
        )
    mass, com = cell.config.tool.mass_kg, np.array(cell.config.tool.com_mm) / 1e3
    load = Load(mass, com) if mass > 0 else None
    arm = Arm.of(cell.robot, T_world_user, _frame(tool), load)
    if section.world is None:
        return arm
    external = cell.robot.external
    if external.positioner or not external.slides or arm.maker not in WORLD_STANDS:
        raise InputError(
            "program.world is of an arm that slides carry, and of a controller of "
            f"{' or '.join(WORLD_STANDS)}",
            hint="leave it out",
            name="program.world",
        )
    seen = replace(arm.controller, T_base_world=_frame(section.world))
    return replace(arm, controller=seen, world_stands=True)


def check_frames(cell: Cell, dialect: Dialect) -> None:
    """Refuse poses in a user frame that has a number on the controller and no place in the cell."""
    section = cell.config.program
    if dialect.numbered_frames and section.user_frame != 0 and section.user is None:
        raise InputError(
            f"poses in user frame {section.user_frame} need to know where it is",
            hint="say so in program.user, as it is set on the controller, or use joint positions",
            name="program.user",
            value=section.user_frame,
        )


def tool_note(cell: Cell, dialect: Dialect) -> str:
    """What the controller's tool frame is taken for, where that has only a number."""
    section = cell.config.program
    if not dialect.numbered_frames or section.tool is not None:
        return ""
    place = ", ".join(f"{value:g}" for value in cell.config.tool.point_mm)
    return (
        f"tool frame {section.tool_frame} is taken to be the cell's tool point ({place}) mm in the "
        "axes of the faceplate: the controller's must be the same, or program.tool say what it is"
    )


def _frame(section: FrameSection) -> FloatArray:
    rotation = rotation_from_wpr(np.deg2rad(section.wpr_deg))
    return transform(rotation, np.array(section.at_mm) / 1e3)


def check_recorded_frames(
    cell: Cell, dialect: Dialect, positions: Sequence[RecordedPosition], path: Path
) -> list[str]:
    """Compare the frames of recorded poses with those of the cell; joint positions need none.

    Gives a warning where the file does not say which frames they are in, and refuses poses in a
    frame of another number, or of a number that the cell knows nothing of.
    """
    section = cell.config.program
    posed = [p for p in positions if p.T_user_tool is not None and p.shown_deg is None]
    for p in posed:
        for what, number, own, by_value in (
            ("user", p.user_frame, section.user_frame, p.T_world_user),
            ("tool", p.tool_frame, section.tool_frame, p.T_tip_tool),
        ):
            if by_value is None and number is not None and number != own:
                raise InputError(
                    f"{path}: {p.label} is in {what} frame {number}, the cell has {own}",
                    hint=f"set program.{what}_frame, and program.{what} to where it is",
                    name=f"program.{what}_frame",
                    value=number,
                    bound=own,
                )
    if any(p.user_frame is not None and p.T_world_user is None for p in posed):
        check_frames(cell, dialect)
    open_ = [  # a frame is known neither by number nor by value
        p
        for p in posed
        if (p.user_frame is None and p.T_world_user is None)
        or (p.tool_frame is None and p.T_tip_tool is None)
    ]
    if not open_:
        return []
    return [
        f"{path}: does not say in which frames {open_[0].label} is"
        + " and others" * (len(open_) > 1)
        + "; taken to be the tool and user frame of the cell"
    ]


@dataclass(frozen=True)
class WrittenProgram:
    """A robot program on disk, checked."""

    paths: tuple[Path, ...]  # those with the positions first
    poses: int  # that are measured
    problems: tuple[str, ...]  # what the strict validator objects to; empty is good
    largest_rounding_deg: float
    largest_rounding_mm: float
    """largest_rounding_deg, largest_rounding_mm: largest difference of a joint between the plan and
    what is read back from the program, of those that turn and those that slide."""
    c_g: float | None = None
    c_g_rounded: float | None = None
    """c_g, c_g_rounded: of the poses as planned, and as they stand in the program; None without a
    cell."""
    note: str = ""  # what the program takes for granted; empty for nothing
    not_checked: tuple[str, ...] = ()
    forced: tuple[str, ...] = ()
    """not_checked, forced: what nobody looked at, and poses written although they break a
    constraint; both stand in the head of the program."""
    simulated: tuple[str, ...] = ()
    made_from: tuple[str, ...] = ()
    corrected_by: str = ""
    """simulated, made_from, corrected_by: the files that it was made from, those of a simulated
    robot apart, and the identification that its poses are corrected by; the same."""

    @property
    def warning(self) -> str:
        """What rounding did to the condition number, where it did something."""
        if self.c_g is None or self.c_g_rounded is None:
            return ""
        if not np.isfinite([self.c_g, self.c_g_rounded]).all():
            return ""
        change = self.c_g_rounded / self.c_g - 1.0
        if abs(change) <= MOST_CHANGE:
            return ""
        return (
            f"rounding moved C_G by {change:+.1%}, from {self.c_g:.4g} to {self.c_g_rounded:.4g}: "
            "the poses hardly tell some parameters apart"
        )


def program_options(cell: Cell | None, poses: PoseList, form: str | None = None) -> ProgramOptions:
    """Options of a program as the cell wants them, with the fingerprint of the plan."""
    mark = fingerprint(poses.measured.postures)
    if cell is None:
        return ProgramOptions(form=form_of(form or "joint"), fingerprint=mark)
    section = cell.config.program
    return ProgramOptions(
        form=form_of(form or section.form),
        user_frame=section.user_frame,
        tool_frame=section.tool_frame,
        speed_percent=section.speed_percent,
        settle_s=section.settle_s,
        measure_call=section.measure_call or None,
        measure_argument=_argument_of(section.measure_argument),
        measure_output=section.measure_output,
        measure_pulse_s=section.measure_pulse_s,
        keep=section.keep,
        first_register=section.first_register,
        guided=touches(cell),
        pulses_per_deg=section.pulses_per_deg,
        pulses_per_mm=section.pulses_per_mm,
        fingerprint=mark,
    )


def _argument_of(word: int | str) -> Literal["number"] | int | None:
    """The argument of the measuring call as the options have it."""
    if isinstance(word, int):
        return word
    return "number" if word == "number" else None


def chosen_dialect(cell: Cell | None, poses: PoseList, name: str | None) -> str:
    """The dialect of this name, or else of the robot's controller.

    Without a cell the controller is the one that the pose list names.

    Raises InputError: the controller is not known, has no dialect here, or does not read the one
    that is named.
    """
    if cell is not None:
        robot = cell.robot.name
        maker = cell.robot.controller.maker if cell.robot.controller else None
    else:
        robot, maker = "the robot of this list", poses.header.get("controller")
    if name is not None:
        wanted = find_dialect(name).maker
        if cell is None and maker and wanted not in (None, maker):
            raise InputError(
                f"{robot} has a controller of {maker}, {name} is for one of {wanted}",
                hint="leave `format` out, or name a format for any robot",
                name="format",
                value=name,
            )
        return name
    own = next((d.name for d in DIALECTS.values() if maker and d.maker == maker), None)
    if own is None:
        # programs of a maker need a controller of theirs, which a cell says and a list may not
        open_to = [d.name for d in DIALECTS.values() if d.maker is None or not (cell or maker)]
        way = "pass `cell`, or " if cell is None else ""
        if cell is not None and not maker:
            fitting = " or ".join(f'"{name}"' for name in makers_like(cell.robot))
            way = f"set robot.controller = {fitting} in the cell, or " if fitting else ""
        raise InputError(
            f"{robot} has a controller of {maker or 'an unknown maker'}",
            hint=f"{way}choose with `format`: {', '.join(open_to)}",
            name="robot.controller",
        )
    return own


def with_approaches(cell: Cell | None, poses: PoseList, approach_deg: float | None) -> PoseList:
    """The list with a posture short of each measured pose, so that joints arrive from one side.

    ``cell``: whose limits and obstacles tell which side. ``approach_deg``: last movement of every
    joint; None: the list as it is. Refused are poses that cannot be approached so, a list that is
    approached already, and a list without a cell.
    """
    if approach_deg is None:
        return poses
    in_range("approach_deg", approach_deg, 0.01, 30.0)
    if cell is None:
        raise InputError(
            "which side is free is a matter of the cell", hint="pass `cell`", name="approach"
        )
    if cell.retreat is not None:
        raise InputError(
            "the tool comes to the poses along its own axis: not all joints from one side",
            hint="leave `approach_deg` out, or set plan.retreat_mm = 0",
            name="approach",
        )
    if Passing.APPROACH in poses.reasons:
        raise InputError(
            "the poses are approached from one side already",
            hint="leave `approach_deg` out, or plan without plan.approach",
            name="approach",
        )
    # only whether the short motions are clear is asked, so speeds do not matter
    known = KnownMotions(
        cell.robot, cell.ways, cell.passing, cell.base_posture, np.ones(cell.robot.n)
    )
    angle = float(np.deg2rad(approach_deg))
    found = find_approaches(poses.measured.postures, angle, cell.passing, known)
    if found.lost:
        i, why = next(iter(found.lost.items()))
        raise InputError(f"pose {poses.measured.names[i]} {why}", name="approach")
    at = np.flatnonzero(~poses.via)
    short = [f"{poses.names[i]}-approach" for i in at]
    names = np.insert(np.array(poses.names, dtype=object), at, short)
    postures = np.insert(poses.postures, at, found.postures, axis=0)
    return PoseList(tuple(names.tolist()), postures, np.insert(poses.via, at, True))


def stopping_short(cell: Cell, poses: PoseList) -> PoseList:
    """The list with its measured postures as far before the target as programs of the cell stop."""
    if cell.retreat is None or not cell.retreat.short_m:
        return poses
    postures = poses.postures.copy()
    postures[~poses.via] = cell.retreat.stop_short(postures[~poses.via])
    return replace(poses, postures=postures)


def check_names_differ(poses: PoseList) -> None:
    """Refuse a list in which two poses have one name: what comes back could not be told apart."""
    twice = next((name for name, times in Counter(poses.names).items() if times > 1), None)
    if twice is not None:
        raise InputError(f"there are two poses {twice}", hint="rename one of them", name=twice)


def write_program(
    poses: PoseList,
    out: Path | Results,
    dialect: str,
    options: ProgramOptions,
    name: str,
    cell: Cell | None = None,
    forced: Sequence[str] = (),
) -> WrittenProgram:
    """Write a robot program, validate it, read it back, and judge what it has become.

    The measured postures are those where the tool stops short of its target, if the cell says so.
    The head says what was not checked: by the cell, or without one when the list was planned; and
    which files ``out`` says that it is made from, those of a simulated robot first. ``forced`` are
    poses that are written although they break a constraint, each with the reason.

    Raises InputError: the program cannot be said in this dialect. OutputError: A file cannot be
    written.
    """
    chosen, poses = find_dialect(dialect), poses.of_payload(None)
    check_names_differ(poses)
    backs_off = Passing.RETREAT in poses.reasons or (cell is not None and cell.retreat is not None)
    if backs_off and not chosen.passes:
        raise InputError(
            f"{chosen.name} lists measured poses only: the tool would not back off between them",
            hint="write another format: the others have postures that are passed through",
            name="format",
            value=chosen.name,
        )
    if cell is not None:
        poses = stopping_short(cell, poses)
    elif poses.header.get(STOPS_SHORT):
        raise InputError(
            f"programs are to stop {poses.header[STOPS_SHORT]} mm short of these poses: where that "
            "is follows from the cell",
            hint="pass `cell`",
            name="cell",
        )
    note = ""
    if cell is not None and options.form == "cartesian":
        check_frames(cell, chosen)
        note = tool_note(cell, chosen)
    results = Results.of(out, "program")
    files = [path for path in results.inputs if path.is_file()]
    stops = zip(poses.names, poses.postures, poses.via, strict=True)
    listed = tuple(ProgramPose(label, q, via=bool(via)) for label, q, via in stops)
    program = PoseProgram(
        name,
        listed,
        options,
        None if cell is None else arm_of(cell),
        not_checked=poses.not_checked if cell is None else cell.not_checked,
        forced=tuple(forced),
        simulated=tuple(described(path) for path in files if is_simulated(path)),
        made_from=tuple(described(path) for path in files if not is_simulated(path)),
        short_m=cell.config.plan.stop_short_mm / 1e3 if cell is not None else 0.0,
        corrected_by=poses.corrected_by,
    )
    paths = chosen.write(program, results)
    problems = [
        f"{path.name}: {problem}"
        for path in paths
        if path.suffix.lower() in chosen.suffixes
        for problem in chosen.validate(path)
    ]
    rounded = _read_back(chosen, program, paths)
    planned, labels = poses.measured.postures, poses.measured.labels
    sliding = np.zeros(planned.shape[1], dtype=bool) if cell is None else cell.robot.sliding
    off = np.abs(rounded - planned)
    return WrittenProgram(
        paths,
        len(planned),
        tuple(problems),
        float(np.rad2deg(off[:, ~sliding].max())),
        1e3 * float(off[:, sliding].max(initial=0.0)),
        None if cell is None else _c_g(cell, planned, labels),
        None if cell is None else _c_g(cell, rounded, labels),
        note,
        (*program.not_checked, *(() if program.arm is None else chosen.unchecked(program.arm))),
        program.forced,
        program.simulated,
        program.made_from,
        program.corrected_by,
    )


def _read_back(dialect: Dialect, program: PoseProgram, paths: Sequence[Path]) -> FloatArray:
    """Measured postures ``(N, n)`` [rad] as they stand in the files."""
    found: dict[int, FloatArray] = {}
    planned = [pose.posture_rad for pose in program.poses if not pose.via]
    for _, path in zip(dialect.parts(program), paths, strict=False):
        read = dialect.read(path)
        numbers = [p.number for p in read.positions if p.number <= program.measured_count]
        positions = tuple(p for p in read.positions if p.number <= program.measured_count)
        near = np.stack([planned[number - 1] for number in numbers])
        arm = program.arm if program.arm is not None else read.arm
        found |= dict(zip(numbers, postures_of(positions, dialect.seen(arm), near), strict=True))
    missing = next((k for k in range(1, len(planned) + 1) if k not in found), None)
    if missing is not None:
        raise InputError(f"pose {missing} is not in the program that was written", name="program")
    return np.stack([found[k] for k in range(1, len(planned) + 1)])


def _c_g(cell: Cell, postures: FloatArray, labels: Sequence[Mapping[str, str]]) -> float:
    which = cell.which(labels)
    model = told_by(cell, cell.model_for(which), postures, which)
    linear = cell.linearise(model, postures, which)
    return evaluate(identification_jacobian(linear), linear.white_jacobian).c_g
