"""What must hold for a cell as a whole, beyond what its file's keys are checked for one by one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.errors import CalibError, FileFormatError, InputError
from calib.geometry import Scene
from posedesign.cell.data import CellData
from posedesign.cell.surroundings import meeting_pairs, nearest_body

TOUCHING_M = 0.02
"""A tool that is to touch its target ends within this of the tool point, what it touches within
this of the target: bodies are described a few millimetres short, and measured by hand."""

NEAREST_LENS_M = 1e-3
"""A lens nearer to its target than this is a mistake: nothing could be told of what it sees."""


class naming:
    """Name file and key in an error that was raised without knowing them."""

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, CalibError):
            raise FileFormatError(
                error.message, path=self._path, key=self._key, hint=error.hint
            ) from error


def check_cell(cell: CellData, scene: Callable[[], Scene], path: Path) -> None:
    """Refuse what does not go together in a cell, among it bodies that its scene cannot be of.

    Raises
    ------
    FileFormatError
        Naming file and key.
    """
    _check_truth(cell, path)
    _check_margins(cell, path)
    _check_surroundings(cell, scene, path)


def _check_truth(cell: CellData, path: Path) -> None:
    truth, n = cell.config.truth, cell.robot.n
    for key, values in (
        ("zero_offsets_deg", truth.zero_offsets_deg),
        ("stiffness_nm_per_rad", truth.stiffness_nm_per_rad),
    ):
        if values is not None and len(values) != n:
            raise FileFormatError(
                f"{len(values)} values for {n} joints",
                path=path,
                key=f"truth.{key}",
                hint="give one value for each joint",
            )
    if truth.deflection and not cell.deflects:
        raise FileFormatError(
            f"nothing is known that would make {cell.robot.name} deflect",
            path=path,
            key="truth.deflection",
            hint="give truth.stiffness_nm_per_rad and tool.mass_kg, or set it to false",
        )


def _check_surroundings(cell: CellData, scene: Callable[[], Scene], path: Path) -> None:
    try:
        inside = int(scene().inside(cell.target_m[None])[0])
    except InputError as error:
        ignored = [name for pair in cell.config.constraints.ignore for name in pair]
        key = "constraints.ignore" if error.name in ignored else "tool.body, obstacle"
        with naming(path, key):
            raise
    met = meeting_pairs(cell)
    if met and not cell.config.plan.retreat_mm:
        raise FileFormatError(
            f"{met[0][0]} and {met[0][1]} may touch: without a retreat they would run into each "
            "other on the motions between the poses",
            path=path,
            key="constraints.ignore",
            hint="set plan.retreat_mm: how far the tool backs off along its axis before it turns, "
            "such as 50",
        )
    if inside >= 0:
        obstacle = cell.obstacles[inside].name
        raise FileFormatError(
            f"the target lies inside the obstacle {obstacle!r}",
            path=path,
            key="target.position_mm",
            hint="correct the place of one of them; a target sits on its fixture, not in it",
        )
    _check_contact(cell, path)
    if cell.config.camera and np.linalg.norm(cell.lens_m - cell.target_m) < NEAREST_LENS_M:
        raise FileFormatError(
            "the lens of the camera lies on the target",
            path=path,
            key="camera.position_mm",
            hint="give the place of the lens in the axes of the tip, or tool.camera_stand_off_mm",
        )


def _check_contact(cell: CellData, path: Path) -> None:
    """Refuse a tool that would not touch what it is described to touch.

    Bodies of tool and surroundings that ``constraints.ignore`` lets come together meet at the
    target, and the tool point is where the tool ends, unless a camera looks from afar.
    """
    pairs = {name for pair in meeting_pairs(cell) for name in pair}
    if cell.config.camera is not None or not pairs:
        return
    tool = [body for body in cell.tool_bodies if body.name in pairs]
    around = [body for body in cell.obstacles if body.name in pairs]
    point = cell.robot.chain.T_link_tip @ [*cell.tool_m, 1.0]
    checks = (
        (nearest_body(cell.robot, around, cell.target_m), "the target", "obstacle"),
        (nearest_body(cell.robot, tool, point[:3]), "the tool point", "tool.body"),
        ((cell.target_offset_m, "the tool point of the base posture"), "the target", "base_pose"),
    )
    for found, place, key in checks:
        if found is not None and found[0] > TOUCHING_M:
            raise FileFormatError(
                f"{found[1]} is {1e3 * found[0]:.0f} mm from {place}, and is to touch there "
                "(constraints.ignore)",
                path=path,
                key=key,
                hint="correct the place of one of them: tool.point_mm, target.position_mm, or "
                "at_mm of the body",
                value=found[0],
                bound=TOUCHING_M,
            )


def _check_margins(cell: CellData, path: Path) -> None:
    plan = cell.config.plan
    narrowest = int(np.argmin(cell.robot.joint_range))
    room = float(np.rad2deg(cell.robot.joint_range[narrowest])) / 2.0
    for key in ("limit_margin_deg", "repair_margin_deg"):
        if getattr(plan, key) >= room:
            raise FileFormatError(
                f"{getattr(plan, key):g} deg leaves nothing of the range of "
                f"{cell.robot.joint_names[narrowest]}",
                path=path,
                key=f"plan.{key}",
                hint=f"stay well below {room:.0f} deg",
            )
