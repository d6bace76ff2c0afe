"""A program that is there, with positions that bring the real arm to where they were meant.

Each position was meant for the arm as described: the controller computes joints from Cartesian
targets as its own geometry says, and an offline programming system does the same. The positions
that are written are other ones, with which the same controller brings the arm as identified to that
place, in the same arm position. All else of the file stays, byte for byte.

Positions that were taught on the arm are right as they are: correct what was programmed offline.
Joint targets are therefore corrected where they are asked for only.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.correction import compensate
from calib.errors import InputError, UnreachableError
from calib.model import CalibrationModel, Setup
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray, inverse
from posedesign.cell import Cell
from posedesign.files import Results, identity_of, rehearsed, write_bytes_atomic
from posedesign.files.origin import checksum
from posedesign.pose_programs.correction_routes import (
    corrected_tool,
    read_correcting,
    with_described_tool,
)
from posedesign.pose_programs.from_plan import arm_of, check_recorded_frames
from posedesign.programs import (
    DIALECTS,
    Arm,
    Dialect,
    RecordedPosition,
    RecordedProgram,
    postures_of,
)
from posedesign.programs.configurations import Configuration
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import CORRECTED
from posedesign.programs.registry import dialect_of
from posedesign.programs.rewriting import Change, rewritten

MOST_TURNED_RAD = np.deg2rad(10.0)
"""Of a joint by a correction. Errors of an arm are a degree at most: where a joint has to turn by
so much more, the position is next to a singularity."""

_NO_TURN_DEG = 1e-7
"""Of joints: less is what inverse kinematics leaves of a pose, and no correction."""

NO_POSTURE = "the arm as described has no such posture inside its limits"

OWN_CALIBRATION = {
    "ur": "controllers of Universal Robots compute with the calibration of the factory: the "
    "description of the cell has to be the one that ur_calibration makes of it"
}
"""By maker, where a controller computes joints in another way than a description as designed."""

IN_FOUND_BASE = "frames are taken to be in the base frame as the targets were found in it"

_SAME_TOOL_M = 1e-6
"""Distance of two tool points that are one: files have a thousandth of a millimetre."""


@dataclass(frozen=True, eq=False)
class CorrectedProgram:
    """A program with corrected positions."""

    data: bytes
    """Content of the file; empty where a position cannot be corrected: nothing is written then."""
    program: RecordedProgram  # as it was
    corrected: tuple[int, ...]
    """(M,): which of its positions were to be corrected; M may be less than all."""
    reasons: tuple[str, ...]  # why each of these cannot be corrected; empty where it is
    moved_m: FloatArray
    """(M,): how far off the tool point stands without the correction [m]; NaN where the arm as
    described does not reach it."""
    error_m: FloatArray  # (M,): how far off it stands with it [m]
    written_m: FloatArray
    """(M,): the same with the numbers as they stand in the file, rounded [m]; none where nothing is
    written."""
    notes: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    simulated: str = ""  # what is to be said first where the errors are those of a simulated robot

    @property
    def ok(self) -> bool:
        """Whether every position that was to be corrected is."""
        return not any(self.reasons)

    @property
    def positions(self) -> tuple[RecordedPosition, ...]:
        """Those that were to be corrected, as they were."""
        return tuple(self.program.positions[i] for i in self.corrected)

    def rows(self) -> list[dict[str, object]]:
        """One row a position that cannot be corrected."""
        return [
            {"position": p.label, "line": p.line, "reason": reason}
            for p, reason in zip(self.positions, self.reasons, strict=True)
            if reason
        ]


def is_program(path: Path, dialect: str | None = None) -> bool:
    """Whether a file is taken for a program, and not for a table of poses: by its ending."""
    endings = {ending for d in DIALECTS.values() for ending in d.suffixes} - {".csv", ".txt"}
    return dialect is not None or path.suffix.lower() in endings


def numbers_of(text: str | None) -> tuple[int, ...]:
    """Numbers of positions in a list, ``3,7``; InputError where it is none."""
    words = [] if text is None else [word.strip() for word in text.split(",")]
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) <= 6):
            raise InputError(
                f"{word[:30]!r} is no number of a position", hint='list them: "3,7"', name="leave"
            )
    return tuple(map(int, words))


def correct_program(
    cell: Cell,
    identification: Path,
    path: Path,
    out: Path | Results,
    *,
    dialect: str | None = None,
    joints: bool = False,
    leave: Collection[int] = (),
    name: str | None = None,
    tool: str | None = None,
    again: bool = False,
) -> CorrectedProgram:
    """Write a program with corrected positions into another folder, under its own name.

    A comment of it says by which identification they are corrected.

    ``identification``: an ``identification.json``. ``path``: the file with the positions. Others of
    the program go with the new one as they are. ``dialect``: of the program; by default its ending
    and its content tell. ``joints``: correct joint targets, too. ``leave``: numbers of positions
    that stay as they are. ``name``: of the model that is used; by default what the identification
    holds for the most likely. ``tool``: which tool point of the identification is that of the cell.
    ``again``: correct what is corrected already. Raises FileFormatError: a file that cannot be
    used. InputError: a frame that is not known, a program without anything to correct, a model that
    says nothing of the arm. OutputError: the program itself, or another file that is not to be
    replaced, is in the way.
    """
    if cell.robot.external.positioner:
        raise InputError(
            f"{cell.robot.joint_names[0]} turns what is measured: programs with such axes are "
            "not corrected",
            hint="correct the description, or hold it where it is: robot.held_deg",
            name=cell.robot.joint_names[0],
        )
    results = Results.of(out, "correct")
    if identity_of(results.folder) == identity_of(path.parent):
        raise InputError(
            f"{path} would be replaced by the corrected program",
            hint="name another folder: `out`",
            name="out",
        )
    claims = results.claim("computed", (path.name, "corrected program"), bare=True)
    identified = read_correcting(identification, cell, name)
    chosen = dialect_of(path, dialect).reading(*cell.config.program.pulses)
    data = read_program_bytes(path)
    by = chosen.corrected_by(path)
    if by and not again:
        raise InputError(
            f"{path}: its positions are {by} already",
            hint="correct the program as it was before; or say that it is to be corrected `again`",
            name="again",
        )
    program = chosen.parse(data, path)
    notes = check_recorded_frames(cell, chosen, program.positions, path)
    _check_frames_said(cell, program, path)
    point = corrected_tool(cell, identified, tool)
    arm = chosen.seen(arm_of(cell))
    done = correct_positions(
        chosen,
        data,
        path,
        arm,
        with_described_tool(cell, identified.model),
        identified.x,
        tool=point.index,
        tool_m=cell.tool_m,
        joints=joints,
        leave=leave,
    )
    said = chosen.with_remark(
        done.data.decode("latin-1"), CORRECTED.format(checksum(identification))
    ).encode("latin-1")
    files = [write_bytes_atomic(claims[0], chosen.packed(said))] if done.ok else []
    unsaid = "the file has no place to say that it is corrected: keep it apart"
    posed = any(p.T_user_tool is not None for p in done.positions)
    found_targets = any(block.targets and block.size for block in identified.model.parameters)
    return replace(
        done,
        notes=(
            f"by the model {identified.name!r:.60}",
            *filter(None, [point.said]),
            *filter(None, [OWN_CALIBRATION.get(arm.maker or "", "")] if posed else []),
            *([IN_FOUND_BASE] if found_targets else []),
            *notes,
            *done.notes,
            *([unsaid] if done.ok and said == done.data else []),
        ),
        data=said if done.ok else done.data,
        files=tuple(files),
        simulated=rehearsed([identification]),
    )


def _check_frames_said(cell: Cell, program: RecordedProgram, path: Path) -> None:
    """Refuse Cartesian targets in frames that neither the program nor the cell says."""
    section = cell.config.program
    for p in program.positions:
        for what, number, value, said in (
            ("tool", p.tool_frame, p.T_tip_tool, section.tool),
            ("user", p.user_frame, p.T_world_user, section.user),
        ):
            open_ = number is None and value is None and said is None
            if p.T_user_tool is not None and open_:
                raise InputError(
                    f"{path}: nothing says in which {what} frame {p.label} is",
                    hint=f"set program.{what} of the cell to where it is",
                    name=f"program.{what}",
                )


def correct_positions(
    dialect: Dialect,
    data: bytes,
    path: Path,
    arm: Arm,
    model: CalibrationModel,
    x: FloatArray,
    *,
    tool: int = 0,
    tool_m: FloatArray | None = None,
    joints: bool = False,
    leave: Collection[int] = (),
) -> CorrectedProgram:
    """The content of a program with corrected positions; nothing is written to disk.

    ``data``, ``path``: content of the file, and its name for messages. ``arm``: as the dialect
    shows it, with the frames of positions whose frames the file does not say. ``model``, ``x``: of
    the arm, and its identified parameters ``(p,)`` [SI]. ``tool``, ``tool_m``: which tool of the
    model is that of the program, and where it is on the tip as described ``(3,)`` [m]. Positions of
    another tool bring the tip to where it was meant. Other parameters and errors: see
    :func:`correct_program`.
    """
    program = dialect.parse(data, path)
    positions, notes = program.positions, []
    strange = sorted({*leave} - {p.number for p in positions})
    if strange:
        raise InputError(
            f"{path}: there is no position {strange[0]} to leave", hint="see the file", name="leave"
        )
    posed = [p.T_user_tool is not None for p in positions]
    taken = [i for i, p in enumerate(positions) if (posed[i] or joints) and p.number not in leave]
    if not taken:
        raise InputError(
            f"{path}: has joint targets only"
            if not any(posed)
            else f"{path}: all is left as it is",
            hint="to keep their places, too: `joints`; positions that were taught are right "
            "already",
            name="joints",
        )
    notes += [f"line {e.row} is as it was: {e.message.partition(': ')[2]}" for e in program.unread]
    stay = len(positions) - len(taken)
    if stay:
        notes.append(f"{stay} of {len(positions)} positions are as they were")
    own = tuple(_as_pose(positions[i]) for i in taken)
    nominal = _nominal(positions, taken, arm, notes)
    wanted_tip = np.stack([_tip_pose(p, arm, q) for p, q in zip(own, nominal, strict=True)])
    with_tool = np.array([_has_tool(p, arm, tool_m) for p in own])
    if not with_tool.all():
        notes.append(
            f"{(~with_tool).sum()} positions are of another tool than was identified: the flange "
            "is brought to its place there"
        )
    found = _Found.of(model, x, nominal, wanted_tip, with_tool, tool)
    words = _words(own, found.postures, arm)
    reasons = tuple(
        _reason(p, found, k, said, arm) for k, (p, said) in enumerate(zip(own, words, strict=True))
    )
    moved = found.off(nominal)
    done = CorrectedProgram(
        b"", program, tuple(taken), reasons, moved, found.error_m, np.empty(0), tuple(notes)
    )
    if not done.ok:
        return done
    changes = [Change()] * len(positions)
    turned = arm.shown(found.postures) - arm.shown(nominal)  # external axes stand last, and still
    turned[np.abs(turned).max(axis=1) < _NO_TURN_DEG] = 0.0
    for k, (i, q) in enumerate(zip(taken, found.postures, strict=True)):
        p = positions[i]
        own_turn = _as_listed(p, turned[k], arm)
        value = None if p.shown_deg is None else p.shown_deg + own_turn[: len(p.shown_deg)]
        T = _user_pose(p, arm, q) if posed[i] else None
        words_now = _recounted(p, words[k])
        changes[i] = Change(value, T, words_now if words_now != p.configuration else None)
    text, again = rewritten(dialect, data, path, program, changes)
    read = tuple(_as_pose(again.positions[i]) for i in taken)
    back = postures_of(read, arm, found.postures)
    return replace(done, data=text, written_m=found.off(back))


@dataclass(frozen=True, eq=False)
class _Found:
    """Commands of M positions, and what they are to reach, of tool or tip."""

    model: CalibrationModel
    x: FloatArray
    tool: int
    with_tool: BoolArray
    wanted: FloatArray
    nominal: FloatArray
    postures: FloatArray
    error_m: FloatArray
    reasons: tuple[str, ...]

    @classmethod
    def of(
        cls,
        model: CalibrationModel,
        x: FloatArray,
        nominal: FloatArray,
        wanted_tip: FloatArray,
        with_tool: BoolArray,
        tool: int,
    ) -> _Found:
        count = len(nominal)
        wanted, postures = wanted_tip.copy(), nominal.copy()
        error, reasons = np.full(count, np.nan), [NO_POSTURE] * count
        known = np.isfinite(nominal).all(axis=1)
        for point in ("tool", "tip"):
            rows = np.flatnonzero(known & (with_tool == (point == "tool")))
            if not len(rows):
                continue
            setup = Setup.of(len(rows), tool=tool)
            if point == "tool":
                one = Setup.of(1, tool=tool)
                zero = np.zeros((1, model.robot.n))
                first = compensate(model, model.nominal, postures=zero, setup=one)
                T_tip_tool = inverse(model.robot.fk(zero[0])) @ first.wanted[0]
                wanted[rows] = wanted_tip[rows] @ T_tip_tool
            found = compensate(
                model, x, poses=wanted[rows], postures=nominal[rows], point=point, setup=setup
            )
            postures[rows], error[rows] = found.postures, found.error_m
            for row, status, reason in zip(rows, found.status, found.reasons, strict=True):
                reasons[row] = f"{status}: {reason}" if reason else ""
        return cls(model, x, tool, with_tool, wanted, nominal, postures, error, tuple(reasons))

    def off(self, postures: FloatArray) -> FloatArray:
        """Distances ``(M,)`` [m] of the real arm's point from its place, at postures ``(M, n)``."""
        out = np.full(len(postures), np.nan)
        known = np.isfinite(postures).all(axis=1)
        setup = Setup.of(int(known.sum()), tool=self.tool)
        view = self.model.view(postures[known], self.x, setup)
        tip = view.T_base_tip[:, :3, 3]
        at = np.where(self.with_tool[known, None], view.tool_points, tip)
        out[known] = np.linalg.norm(at - self.wanted[known, :3, 3], axis=1)
        return out


def _nominal(
    positions: Sequence[RecordedPosition], taken: Sequence[int], arm: Arm, notes: list[str]
) -> FloatArray:
    """Postures ``(M, n)`` [rad] that the controller takes positions with; NaN: it has none."""
    out = np.full((len(positions), arm.n), np.nan)

    def solve(rows: Sequence[int], near: FloatArray | None = None, *, posed: bool = True) -> None:
        own = tuple(_as_pose(positions[i]) if posed else positions[i] for i in rows)
        out[[*rows]] = postures_of(own, arm, near)

    listed = [i for i, p in enumerate(positions) if p.shown_deg is not None]
    solve(listed, posed=False)
    told = [i for i in taken if i not in {*listed} and positions[i].configuration is not None]
    with suppress(InputError, UnreachableError):  # all at once, where nothing is in the way
        solve(told)
    near = out.copy()
    # joints beside a pose say near which posture it is
    both = [i for i in listed if i in {*taken} and positions[i].T_user_tool is not None]
    out[both] = np.nan
    left = [i for i in taken if np.isnan(out[i]).any()]
    if {*left} - {*both}:
        notes.append("what a position leaves open of its posture is as near as can be to the last")
    for i in left:
        p, before = positions[i], near[: i + 1][~np.isnan(near[: i + 1]).any(axis=1)]
        if not len(before) and p.configuration is None:
            raise InputError(
                f"{p.label}: nothing says which of several postures is meant",
                hint="put a joint target before it",
                name=p.label,
            )
        with suppress(UnreachableError):  # is named with all others that cannot be corrected
            solve([i], before[-1:] if len(before) else np.zeros((1, arm.n)))
            near[i] = out[i]
    return out[[*taken]]


def _as_pose(p: RecordedPosition) -> RecordedPosition:
    """A position without the joints that stand beside a pose: the pose is what is moved to."""
    return p if p.T_user_tool is None else replace(p, shown_deg=None)


def _frames(p: RecordedPosition, arm: Arm) -> tuple[FloatArray, FloatArray]:
    """User frame in the world and tool frame in the tip ``(4, 4)`` [m] of a position."""
    return (
        arm.T_world_user if p.T_world_user is None else p.T_world_user,
        arm.T_tip_tool if p.T_tip_tool is None else p.T_tip_tool,
    )


def _tip_pose(p: RecordedPosition, arm: Arm, q: FloatArray) -> FloatArray:
    """Where the tip ``(4, 4)`` [m] was meant to be, in the base frame."""
    if p.T_user_tool is None:
        return np.asarray(_robot(arm).fk(q))
    T_world_user, T_tip_tool = _frames(p, arm)
    return arm.controller.in_base(T_world_user @ p.T_user_tool @ inverse(T_tip_tool))


def _user_pose(p: RecordedPosition, arm: Arm, q: FloatArray) -> FloatArray:
    """The pose ``(4, 4)`` [m] of a position that the controller takes with a posture."""
    T_world_user, T_tip_tool = _frames(p, arm)
    return replace(arm, T_world_user=T_world_user, T_tip_tool=T_tip_tool).tool_poses(q)


def _has_tool(p: RecordedPosition, arm: Arm, tool_m: FloatArray | None) -> bool:
    if p.T_user_tool is None or tool_m is None:
        return True
    return bool(np.abs(_frames(p, arm)[1][:3, 3] - tool_m).max() <= _SAME_TOOL_M)


def _as_listed(p: RecordedPosition, shown: FloatArray, arm: Arm) -> FloatArray:
    """Joint values in the order of the file."""
    if not p.joint_names:
        return shown
    return np.asarray(shown[[arm.joint_names.index(name) for name in p.joint_names]])


def _words(
    own: Sequence[RecordedPosition], q: FloatArray, arm: Arm
) -> Sequence[Configuration | None]:
    """Arm positions at the commands, of positions that say theirs."""
    found: list[Configuration | None] = [None] * len(own)
    if any(p.configuration is not None for p in own):
        known = np.flatnonzero(np.isfinite(q).all(axis=1)).tolist()
        for k, words in zip(known, arm.configurations(q[known]), strict=True):
            found[k] = words
    return found


def _reason(
    p: RecordedPosition, found: _Found, k: int, words: Configuration | None, arm: Arm
) -> str:
    """Why a position cannot be corrected; empty where it can."""
    if found.reasons[k]:
        return found.reasons[k]
    turned = np.abs(found.postures[k] - found.nominal[k])
    if turned[: arm.n_external].any():
        return f"{arm.joint_names[-1]} would have to move, and in a program it keeps its place"
    j = int(np.argmax(turned))
    if turned[j] > MOST_TURNED_RAD:
        return (
            f"next to a singularity: {_robot(arm).joint_names[j]} would turn by "
            f"{np.rad2deg(turned[j]):.1f} deg"
        )
    if words is not None and p.configuration is not None and _recounted(p, words) is None:
        return f"leaves its arm position {p.configuration.words} for {words.words}"
    return ""


def _recounted(p: RecordedPosition, now: Configuration | None) -> Configuration | None:
    """The configuration of a position at its command; None where it is another arm position.

    Counts of turns, quadrants and signs change where a joint crosses a boundary of theirs: it
    often stands right at one, at 0 deg.
    """
    own = p.configuration
    if own is None or now is None or own.allows(now):
        return own
    counts = {name: getattr(now, name) for name in own.counts if type(now) is type(own)}
    found: Configuration = replace(own, **counts)  # type: ignore[type-var]
    return found if found.allows(now) else None


def _robot(arm: Arm) -> Robot:
    if arm.robot is None:
        raise InputError("targets need the robot", hint="pass `cell`", name="robot")
    return arm.robot
