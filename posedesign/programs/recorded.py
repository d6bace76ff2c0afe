"""What comes back from a controller's file: its positions, or the faults found in it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray, inverse
from posedesign.programs.arm import Arm
from posedesign.programs.configurations import Configuration

Level = Literal["error", "measuring", "note"]  # how much a problem weighs; see `Problem`
_MARK = re.compile(r"PLAN ([0-9a-f]{4,16}) (\d{1,7})(?: \d{1,3} [0-9a-f]{8})?")
"""What stands behind it is of the files of the program: :mod:`.sets`."""


CORRECTED = "CORRECTED BY {}"
"""What a program with corrected positions says: the checksum of the identification."""

_CORRECTED = re.compile(rb"\bCORRECTED BY ([0-9a-f]{8})\b")


def corrected_by(*files: bytes) -> str:
    """By which identification the positions in files are corrected, in words; empty: none."""
    found = dict.fromkeys(mark.decode() for data in files for mark in _CORRECTED.findall(data))
    return f"corrected by the identification {' and '.join(found)}" if found else ""


@dataclass(frozen=True)
class PlanMark:
    """What a program says of the plan that it was written from, in a comment."""

    fingerprint: str = ""  # of the plan; empty for none
    measured: int | None = None
    """Number of poses that are measured, in the whole plan. Positions with higher numbers are
    passed through."""

    @property
    def words(self) -> str:
        """As it stands in a comment: ``PLAN 1a2b3c4d 27``."""
        return f"PLAN {self.fingerprint} {self.measured}"

    @classmethod
    def found_in(cls, text: str) -> PlanMark | None:
        """The mark that a comment is, or None: a person's remark may hold the word, too."""
        found = _MARK.fullmatch(text.strip())
        return None if found is None else cls(found[1], int(found[2]))


@dataclass(frozen=True, eq=False)
class RecordedPosition:
    """One position as a controller stores it: joint values, or a pose of the tool."""

    number: int  # that it has in the program, e.g. 3 for FANUC's ``P[3]``; counted from 1
    name: str  # on the controller; empty where it has none
    line: int  # of the file where it starts, counted from 1
    shown_deg: FloatArray | None = None  # (n,): joint values as the controller shows them [deg]
    T_user_tool: FloatArray | None = None  # (4, 4): the tool frame in the user frame [m]
    configuration: Configuration | None = None
    """Which arm position takes the pose; None where the file does not say."""
    user_frame: int | None = None
    tool_frame: int | None = None
    """user_frame, tool_frame: numbers of the frames it was recorded in; None where the file leaves
    them open."""
    T_world_user: FloatArray | None = None
    T_tip_tool: FloatArray | None = None
    """T_world_user, T_tip_tool: (4, 4): these frames, where the file gives them by value [m]."""
    joint_names: tuple[str, ...] = ()
    """Joints of ``shown_deg`` in their order, where the file names them."""
    external_shown: tuple[float, ...] = ()
    """Values of external axes beside the joints, E1 first [mm]; of those that turn [deg]."""
    external_units: tuple[str, ...] = ()  # of these, where the file gives them
    carried: Mapping[int, FileFormatError] = field(default_factory=dict)
    """What says that an external axis stands elsewhere than in the first position, by its index
    from 0 on. Raised for an arm that has no such axis in its description."""
    fault: FileFormatError | None = None
    """What says that the arm is not sure to go there, such as two frames. Raised where its posture
    is asked for."""

    @property
    def label(self) -> str:
        """Number and name, for messages."""
        return f"position {self.number}" + f" ({self.name})" * bool(self.name)


@dataclass(frozen=True, eq=False)
class RecordedProgram:
    """A program read back from a controller's file."""

    name: str
    comment: str  # its title
    mark: PlanMark  # the plan it was written from, where it says so
    positions: tuple[RecordedPosition, ...]  # at least one, in the order of the file
    maker: str | None
    """Whose controller shows the joint values; None: they are those of the description."""
    in_registers: bool = False  # positions are numbered as the registers that they were kept in
    empty_registers: bool = False
    """The program keeps touched-up positions in registers of its own, and none holds a value yet:
    the positions are the planned ones."""
    unread: tuple[FileFormatError, ...] = ()
    """Moves of which the file does not say where they go, and positions without a value: of these
    nothing is in ``positions``."""

    def whole(self) -> RecordedProgram:
        """The program; FileFormatError where a move or position of it could not be read."""
        for error in (*self.unread, *(p.fault for p in self.positions if p.fault)):
            raise error
        return self

    @property
    def fingerprint(self) -> str:
        """Of the plan it was written from; empty where it carries none."""
        return self.mark.fingerprint

    @property
    def measured(self) -> tuple[RecordedPosition, ...]:
        """Positions that are measured: all, unless the program says how many there are."""
        most = self.mark.measured
        return tuple(p for p in self.positions if most is None or p.number <= most)

    def postures(self, arm: Arm | None = None) -> FloatArray:
        """Postures of all positions ``(N, n)`` [rad]; see :func:`postures_of`."""
        return postures_of(self.positions, arm or self.arm)

    @property
    def arm(self) -> Arm:
        """The maker's usual arm, with as many joints as the positions have."""
        joints = next((p.shown_deg for p in self.positions if p.shown_deg is not None), None)
        return Arm.usual(self.maker, None if joints is None else len(joints))


def postures_of(
    positions: tuple[RecordedPosition, ...], arm: Arm, near: FloatArray | None = None
) -> FloatArray:
    """Postures ``(N, n)`` [rad] of stored positions.

    Parameters
    ----------
    positions : tuple of RecordedPosition
    arm : Arm
        Turns shown joint values into postures, and poses by inverse kinematics.
    near : array (N, n), optional
        Where the arm was to be [rad]: settles which posture is meant where the file does not.

    Raises
    ------
    InputError
        A position has joint values of another arm, or a pose and nothing says which posture.
    FileFormatError
        An external axis carries the arm, whose description has none; a position has a fault.
    UnreachableError
        No posture takes a stored pose.
    """
    for p in positions:
        for error in (p.fault, *(e for k, e in p.carried.items() if k >= arm.n_external)):
            if error is not None:
                raise error
    if arm.n_external:
        positions = tuple(_with_external(position, arm) for position in positions)
    out = np.empty((len(positions), arm.n))
    at_joints = [i for i, p in enumerate(positions) if p.shown_deg is not None]
    for i in at_joints:
        values = positions[i].shown_deg
        if values is None or len(values) != arm.n:
            raise InputError(
                f"{positions[i].label} has {0 if values is None else len(values)} joint values, "
                f"the arm {arm.n}",
                hint="is this the program of another robot?",
                name=positions[i].label,
            )
        out[i] = values if arm.robot is None else _in_order(positions[i], values, arm)
    if at_joints:
        out[at_joints] = arm.postures(out[at_joints])
    posed = [i for i, p in enumerate(positions) if p.shown_deg is None]
    if posed:
        out[posed] = arm.postures_at(
            np.stack([_in_frames_of(arm, positions[i]) for i in posed]),
            [positions[i].configuration for i in posed],
            None if near is None else near[posed],
            [positions[i].label for i in posed],
            np.array([positions[i].external_shown[: arm.n_external] for i in posed]) / 1e3
            if arm.n_external
            else None,
        )
    return out


def _with_external(position: RecordedPosition, arm: Arm) -> RecordedPosition:
    """A position with the values of external axes behind those of the arm's joints."""
    shown, units = position.shown_deg, arm.external_units
    if shown is None and not arm.world_stands:
        raise InputError(
            f"{position.label} is a pose, and where an external axis has the arm is not in it",
            hint="record joint positions; of a KUKA or an ABB set program.world",
            name=position.label,
        )
    if shown is not None and position.joint_names:
        # a file that names its joints has them all, in SI
        own = zip(arm.joint_names[-len(units) :], units, strict=True)
        slide = np.isin(position.joint_names, [name for name, unit in own if unit == "mm"])
        return replace(position, shown_deg=np.where(slide, 1e3 * np.deg2rad(shown), shown))
    missing = len(position.external_shown)
    if missing < len(units):
        raise InputError(
            f"{position.label} has no value [{units[missing]}] of E{missing + 1}, which "
            + ("carries the arm" if units[missing] == "mm" else "turns what is measured"),
            hint="record it with its external axes; of encoder pulses, give pulses_per_mm",
            name=position.label,
        )
    for k, (unit, wanted) in enumerate(zip(position.external_units, units, strict=False)):
        if unit != wanted:
            raise InputError(
                f"{position.label}: E{k + 1} is in {unit or 'no unit'}, and the description's "
                f"{arm.joint_names[k - len(units)]} in {wanted}",
                hint="are the external axes of the controller those of the description?",
                name=position.label,
            )
    if shown is None:
        return position
    joints = shown[: arm.n - len(units)]  # formats for any arm cannot say where its joints end
    return replace(position, shown_deg=np.append(joints, position.external_shown[: len(units)]))


def _in_order(position: RecordedPosition, values: FloatArray, arm: Arm) -> FloatArray:
    """Joint values in the order of the arm's joints: ROS often lists joints by the alphabet."""
    names = position.joint_names
    if not names or names == arm.joint_names:
        return values
    other = sorted(set(names) ^ set(arm.joint_names))
    if other:
        raise InputError(
            f"{position.label} has the joints {', '.join(names)}, "
            f"the arm {', '.join(arm.joint_names)}",
            hint="is this the program of another robot?",
            name=position.label,
            value=other,
        )
    return np.asarray(values[[names.index(name) for name in arm.joint_names]])


def _in_frames_of(arm: Arm, position: RecordedPosition) -> FloatArray:
    """The pose ``(4, 4)`` of a position in the arm's own user and tool frame."""
    T = np.eye(4) if position.T_user_tool is None else position.T_user_tool
    if position.T_world_user is not None:
        T = inverse(arm.T_world_user) @ position.T_world_user @ T
    if position.T_tip_tool is not None:
        T = T @ inverse(position.T_tip_tool) @ arm.T_tip_tool
    return np.asarray(T)


@dataclass(frozen=True)
class Problem:
    """Something in a program that a controller would refuse, or run in another way than meant."""

    line: int  # of the file, counted from 1 as an editor shows it
    rule: str  # name of the rule it breaks
    message: str  # what is wrong
    level: Level = "error"
    """``error``: a controller would refuse it, or move in another way than meant. ``measuring``: it
    runs, but may not measure what was planned. ``note``: cannot be known from the file."""

    def __str__(self) -> str:
        return f"line {self.line}: {self.message} [{self.rule}]"
