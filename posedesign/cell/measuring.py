"""What a cell measures, and the models of it: what is identified, and the simulated robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError
from calib.model import CalibrationModel
from calib.model.measurements import (
    KINDS,
    BoardShape,
    BoardView,
    CameraPose,
    Measurement,
    Point,
    TouchUp,
    ViewLine,
)
from calib.model.parameters import (
    JointCompliance,
    LensParameters,
    LinkGeometry,
    ParameterBlock,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray
from posedesign.cell.arm_errors import payloads_of
from posedesign.cell.board_set_up import BoardSetUp
from posedesign.cell.data import CellData
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import NoiseSection


def free_tool_axes(cell: CellData, measurement: Measurement) -> str:
    """Axes of the tool point that another measurement identifies in this cell.

    Those that the cell asks for; z only by touch-up, which does show it.
    """
    given = cell.config.parameters.tool_axes
    asked = "xyz" if given is None else given
    across = asked.replace("z", "")
    if isinstance(measurement, ViewLine):
        return across
    own = cell.config.measurement.kind
    return across + "z" if "z" in asked or (own == "view-line" and across) else across


def hand_eye_model(
    cell: CellData,
    measurement: CameraPose | BoardView,
    set_up: BoardSetUp | None,
    offsets: tuple[str, ...],
) -> CalibrationModel:
    """Model of camera on the tip (X of A X = Z B) and target in the base (Z), six numbers each.

    Parameters
    ----------
    set_up : BoardSetUp, optional
        Camera and board where pictures of a board are measured; their lens is free where the cell
        estimates it.
    offsets : tuple of str
        Joints with an unknown zero offset.
    """
    X, Z = cell.T_tip_camera, cell.T_base_target
    lens = []
    if set_up is not None:
        X, Z = set_up.X, set_up.Z
        lens = [LensParameters.usual(set_up.lens)] if cell.estimates_lens else []
    frames = [ToolFrame(X), TargetFrame(Z, cell.config.target.name)]
    freed = [ZeroOffsets(cell.robot, offsets)] if offsets else []
    return CalibrationModel(cell.robot, [*freed, *frames, *lens], measurement)


def touching_model(
    cell: CellData,
    measurement: Measurement,
    axes: str,
    offsets: tuple[str, ...],
    targets: TargetPoints | None,
) -> CalibrationModel:
    """Model of zero offsets, tool point along some of its axes, and targets."""
    return CalibrationModel(
        cell.robot,
        [
            ZeroOffsets(cell.robot, offsets),
            ToolPoint(cell.tool_m, axes),
            targets or TargetPoints([cell.target_m], [cell.config.target.name]),
        ],
        measurement,
    )


def truth_of(
    cell: CellData,
    set_up: Sequence[ParameterBlock],
    placed: Sequence[FloatArray],
    measurements: Sequence[Measurement],
) -> tuple[CalibrationModel, FloatArray]:
    """Model of the simulated robot, all joints with offsets and deflection, and its values.

    ``set_up``, ``placed``: its tools and targets, and where they really are.
    """
    truth = cell.config.truth
    given = truth.zero_offsets_deg
    turning = cell.robot.arm_joints  # slides are where they show; their frames may be off
    offsets = usual_offsets(len(turning)) if given is None else np.deg2rad(given)
    carrying = cell.robot.joint_names[: cell.robot.floor]
    theirs = np.append(0.0, np.full(len(carrying), OF_POSITIONER_RAD))[: len(carrying)]
    if truth.positioner_offsets_deg is not None:
        theirs = np.deg2rad(truth.positioner_offsets_deg)[::-1]
    blocks: list[ParameterBlock] = [ZeroOffsets(cell.robot, [*carrying, *turning])]
    values = [theirs, offsets]
    if cell.deflects:
        loads = payloads_of(cell)
        blocks.append(JointCompliance(cell.robot, turning, loads))
        values.append(1.0 / cell.stiffness)
    if truth.link_error_mm > 0.0 or truth.link_error_deg > 0.0:
        links = LinkGeometry(cell.robot)
        blocks.append(links)
        values.append(_link_errors(links, truth.link_error_mm, truth.link_error_deg, truth.seed))
    model = CalibrationModel(cell.robot, [*blocks, *set_up], measurements)
    return model, np.concatenate([*values, *placed])


OF_POSITIONER_RAD = np.deg2rad(0.07)
"""Zero offset of the joints of a positioner, but for that which moves the base: nothing measured
tells it from targets that sit elsewhere."""


def _link_errors(links: LinkGeometry, mm: float, deg: float, seed: int) -> FloatArray:
    """Errors of links by chance ``(p,)`` [m, rad], the same for the same seed."""
    sigma = np.where([unit == "m" for unit in links.units], mm / 1e3, np.deg2rad(deg))
    return np.asarray(sigma * np.random.default_rng([seed, 1]).standard_normal(links.size))


def usual_offsets(n: int) -> FloatArray:
    """Zero offsets ``(n,)`` [rad] as on arms mastered by eye: up to a tenth of a degree."""
    if n < 1:
        raise InputError("a robot needs joints")
    pattern = np.deg2rad([0.03, 0.08, -0.06, 0.05, 0.10, -0.04])
    return np.resize(pattern, n)


def camera_pose(config: CellConfig) -> CameraPose:
    """Poses of the target as a camera sees them, with the noise that the file gives them.

    That of ``[[noise]]`` where one is given: it may differ from axis to axis.
    """
    section = config.measurement
    given = next((noise for noise in config.noise if noise.kind == "camera-pose"), None)
    noise = given or NoiseSection(
        kind="camera-pose",
        three_sigma_mm=section.camera_three_sigma_mm,
        three_sigma_deg=section.camera_three_sigma_deg,
    )
    return CameraPose(noise_sigma(noise))


def make_touch_up(config: CellConfig, R_tip_camera: FloatArray) -> TouchUp:
    """Touch-ups with the noise that the file gives them, along the axes that it gives."""
    section = config.measurement
    axes = R_tip_camera if section.noise_axes == "camera" else None
    return TouchUp(np.array(section.three_sigma_mm) / 3e3, axes)


def noise_of_kind(cell: CellData, kind: str) -> Measurement:
    """A kind of measurement with its noise, for planning.

    Raises
    ------
    InputError
        Nothing is said of the noise of an instrument.
    """
    given = next((noise for noise in cell.config.noise if noise.kind == kind), None)
    if given is not None:
        return measured_with(given)
    if kind == "touch-up":
        return make_touch_up(cell.config, cell.T_tip_camera[:3, :3])
    if kind == "view-line":
        return ViewLine(np.array(cell.config.measurement.three_sigma_mm[:2]) / 3e3)
    raise InputError(
        f"how well a {kind} is measured is not known, and plans go by that",
        hint=f'add [[noise]] with kind = "{kind}" and three_sigma_mm of the instrument',
        name="noise",
    )


def measured_with(noise: NoiseSection) -> Measurement:
    """A kind of measurement with the noise that a cell gives it."""
    sigma = noise_sigma(noise)
    if noise.grows:
        per_m = noise.along_three_sigma_mm_per_m, noise.across_three_sigma_mm_per_m
        return Point(sigma, *(growth / 3e3 for growth in per_m))
    return KINDS[noise.kind](sigma)


def noise_sigma(noise: NoiseSection) -> FloatArray:
    """Standard deviations ``(m,)`` [m, rad] of a kind."""
    kind = KINDS[noise.kind]
    lengths = np.array(noise.three_sigma_mm) / 3e3
    count = kind.rows - kind.turns
    parts = [np.broadcast_to(lengths, (3,))[:count] if lengths.ndim else np.full(count, lengths)]
    if noise.three_sigma_deg is not None:
        parts.append(np.broadcast_to(np.deg2rad(noise.three_sigma_deg) / 3.0, (3,)))
    return np.concatenate(parts)


def board_view(cell: CellData, found: BoardSetUp) -> BoardView:
    """The measurement: pixels of the board's points, those out of the image left out."""
    section = cell.config.measurement
    arm = section.arm_three_sigma_mm / 3e3, float(np.deg2rad(section.arm_three_sigma_deg)) / 3.0
    return BoardView(
        section.board_three_sigma_px / 3.0,
        BoardShape(found.board.points),
        found.lens,
        found.carried,
        arm if any(arm) else None,
        border_px=found.border_px,
    )
