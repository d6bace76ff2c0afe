"""What no pose of a cell can tell, found before anything is planned.

A parameter that has no effect on what is measured, or the same effect as others, at every pose:
wider angles and more poses change nothing about it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError, NotIdentifiableError
from calib.identification import is_identifiable
from calib.identification.identifiability import sort_out
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.candidates.postures import even_points
from posedesign.cell import Cell, cone_rotations_at, poses_about_tool
from posedesign.cell.models import PAPER
from posedesign.cell.observations import touched_by_tool
from posedesign.constraints import Checker, nearest_postures

_POSES = 48
"""Poses tried: with three rows each three times the parameters of a cell, and more."""

_TILT_RAD = np.deg2rad(60.0)
"""Tilt of the tool up to which poses are tried; grids and pools of cells tilt less."""

_LARGEST_RAD = np.deg2rad(60.0)
"""How far joints are turned where nothing is touched."""

_ON_AXIS_M = 1e-5
"""Distance of the tool point from a joint axis below which it lies on it: turning the joint by a
tenth of a degree then moves the point by less than .02 um."""

_ASIDE_OF_REACH = 0.05
"""Offset of a tool point from an axis that is tried as a remedy, of the reach."""

_SEED = 2006


@dataclass(frozen=True)
class Untold:
    """Parameters that no pose of a cell can tell."""

    names: tuple[str, ...]
    why: tuple[str, ...]  # for each, in words
    remedy: str

    @property
    def words(self) -> str:
        """All in one sentence."""
        return f"no pose can tell {', '.join(self.names)}: {'; '.join(self.why)}"


def check_tellable(cell: Cell, stations: FloatArray | None = None) -> None:
    """Refuse to plan for parameters that no pose of the cell can tell.

    Raises
    ------
    NotIdentifiableError
        Naming the parameters, the reason and the remedy.
    """
    found = untold_of(cell, stations)
    if found is not None:
        raise _Refused(found)


class _Refused(NotIdentifiableError):
    """Parameters that no pose can tell, in the words of a plan."""

    def __init__(self, found: Untold) -> None:
        super().__init__(found.names, found.why, hint=found.remedy)
        self.message = found.words


def untold_of(cell: Cell, stations: FloatArray | None = None) -> Untold | None:
    """Find parameters that no pose of the cell can tell; None where there are none.

    Of the ten parameters of Watanabe et al. 2006 (zero offsets that the cell lists, tool point and
    target). What other words of ``parameters.planned`` free is reduced to what can be told.

    Parameters
    ----------
    stations : array (K, n), optional
        Postures [rad, m] that poses are near to: where external axes stand. The base posture by
        default; nothing is found then of cells with external axes or several targets.
    """
    if cell.is_hand_eye or cell.config.parameters.planned not in (None, PAPER):
        return None
    if cell.observations[0].kind in ("plane", "distance"):
        return None  # turning about one point is no pool of these
    alone = len(cell.observations) == 1 and not cell.robot.n_external
    if stations is None and not alone:
        return None  # several targets, or places of external axes, tell more than one of them
    cell = cell.parts[0]
    near = cell.base_posture[None] if stations is None else stations
    hidden = _hidden_of(cell, near)
    if not hidden:
        return None
    model, q, columns = hidden
    on_axis = [k for k in columns if _is_on_axis(cell, model.names[k], q)]
    why = [
        f"the tool point lies on the axis of {_joint_of(model.names[k])} at every pose"
        if k in on_axis
        else columns[k]
        for k in columns
    ]
    names = tuple(model.names[k] for k in columns)
    return Untold(names, tuple(why), _remedy(cell, near, names, bool(on_axis)))


def _remedy(cell: Cell, near: FloatArray, names: tuple[str, ...], on_axis: bool) -> str:
    """Say what to change in the cell. An offset of the tool is named only where it helps."""
    joints = [_joint_of(name) for name in names if _joint_of(name)]
    if not joints:
        return "leave them out: parameters.tool_axes lists the axes of the tool point that are free"
    held = f"leave {', '.join(joints)} out of parameters.zero_offsets"
    if on_axis:
        aside = _ASIDE_OF_REACH * cell.robot.chain.reach_m
        other = replace(cell, tool_m=cell.tool_m + np.array([aside, 0.0, 0.0]))
        try:
            helps = not _hidden_of(other, near)
        except CalibError:
            helps = False
        if helps:
            held += (
                f", or give the tool point an offset from that axis, such as {1e3 * aside:.0f} mm"
            )
    return held


Hidden = tuple[CalibrationModel, FloatArray, dict[int, str]]
"""Model, postures ``(N, n)``, and reasons by column."""


def _hidden_of(cell: Cell, near: FloatArray) -> Hidden | None:
    """Columns of the cell's model that random poses cannot tell; None where there are none.

    None also where so few poses can be taken that the number of equations would hide something.
    """
    model = cell.model()
    q = _random_postures(cell, near)
    linear = cell.linearise(model, q) if len(q) else None
    if linear is None or linear.white_jacobian[..., 0].size < 2 * model.p:
        return None
    told = np.vstack([linear.white_jacobian.reshape(-1, model.p), model.known_rows])
    if is_identifiable(told):
        return None
    found = sort_out(told, model.names, first=model.nuisance)
    return model, q, dict(zip(found.left_out, found.why, strict=True))


def _random_postures(cell: Cell, near: FloatArray) -> FloatArray:
    """Postures ``(N, n)`` [rad] inside the limits, on the target where the tool touches it."""
    robot, rng = cell.robot, np.random.default_rng(_SEED)
    if not touched_by_tool(cell.config):
        low = np.maximum(robot.lower, near.min(axis=0) - _LARGEST_RAD)
        high = np.minimum(robot.upper, near.max(axis=0) + _LARGEST_RAD)
        return np.asarray(low + (high - low) * even_points(_POSES, robot.n, rng))
    base = robot.fk(cell.base_posture)[:3, :3]
    R = cone_rotations_at(base, _TILT_RAD, even_points(_POSES, 3, rng))
    poses = poses_about_tool(robot, R, cell.tool_m, cell.target_m, cell.base_posture)
    checker, found = Checker(robot), []
    for k, at in enumerate(near):
        postures = nearest_postures(checker, poses[k :: len(near)], at)
        found.append(postures.q[postures.feasible])
    return np.concatenate(found)


def _joint_of(name: str) -> str:
    """Name of the joint of a zero offset; empty for other parameters."""
    prefix = "zero_offset."
    return name.removeprefix(prefix) if name.startswith(prefix) else ""


def _is_on_axis(cell: Cell, name: str, q: FloatArray) -> bool:
    """Return True if the tool point lies on the axis of a zero offset's joint at all postures."""
    joint = _joint_of(name)
    if not joint:
        return False
    state, j = cell.robot.state(q), cell.robot.joint_names.index(joint)
    lever = np.cross(state.axes[:, j], state.point(cell.tool_m) - state.origins[:, j])
    return bool(np.linalg.norm(lever, axis=1).max() < _ON_AXIS_M)
