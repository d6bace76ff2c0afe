"""The frames that poses of a program are in: what the cell says of them, what a file says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.cell import Cell
from posedesign.cell.schema import FrameSection
from posedesign.programs import Arm, Dialect, Load, RecordedPosition


def arm_of(cell: Cell) -> Arm:
    """The arm of a cell as its controller knows it, with tool and user frame of ``[program]``.

    Raises InputError: user frame 0, which is the world's on a FANUC, is given another place.
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
    return Arm.of(cell.robot, T_world_user, _frame(tool), load)


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

    Returns list of str: A warning where the file does not say which frames they are in. Raises
    InputError: A pose is in a frame of another number, or of a number that the cell knows nothing
    of.
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
    open_ = [p for p in posed if _is_open(p)]
    if not open_:
        return []
    return [
        f"{path}: does not say in which frames {open_[0].label} is"
        + " and others" * (len(open_) > 1)
        + "; taken to be the tool and user frame of the cell"
    ]


def _is_open(p: RecordedPosition) -> bool:
    """Whether a frame of a pose is known neither by number nor by value."""
    return (p.user_frame is None and p.T_world_user is None) or (
        p.tool_frame is None and p.T_tip_tool is None
    )
