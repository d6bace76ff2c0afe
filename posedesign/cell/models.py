"""Models of a cell: what may be off on its arm, the set-up, and the noise that it is measured with.

What is identified, what is planned for, and the simulated robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set

import numpy as np

from calib.errors import InputError
from calib.model import CalibrationModel, KnownDistance, Setup
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
    AXES,
    BearingCompliance,
    GravityLoad,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LensParameters,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Payload,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)
from calib.robots import Robot
from calib.se3 import FloatArray, rotation_from_wpr, transform
from posedesign.cell.board_set_up import BoardSetUp
from posedesign.cell.data import CellData
from posedesign.cell.observations import (
    POSES,
    Observation,
    instrument_frame,
    mark_named,
    normal_of,
    place_of,
    target_named,
)
from posedesign.cell.schema import CellConfig
from posedesign.cell.schema_sections import NoiseSection
from posedesign.files.measurements import TOOL

PRIORS = "priors"
"""Word that holds a model to what is known before measuring."""

WEIGH = ("compliance", "bearings", "lost_motion")
"""Words that need the torque of gravity, and so the masses of the links."""

WIND_UP = 3e-3
"""What a joint gives way by under the largest torque of gravity [rad], at most but for the spread
that sizes of priors have where they are found. With the stiffness of RV reducers of its class an
R-2000iC gives way by some 1.7 mrad at the shoulder, and the joints of light arms with torque
sensors by several."""

EVERYTHING = ("geometry", "compliance", "bearings", "lost_motion", "harmonics", PRIORS)
"""Words of what may be off on any arm."""

_WEIGHED = 300
"""Postures among which the largest torque is looked for."""


def payloads_of(cell: CellData) -> list[Payload]:
    """What the flange carries: the tool alone, and the tool with each of those listed besides."""
    own = cell.payload or Payload(0.0, np.zeros(3))
    loads = [own]
    for more in cell.config.payload:
        mass, com_m = own.mass_kg + more.mass_kg, np.array(more.com_mm) / 1e3
        both = own.mass_kg * own.com_m + more.mass_kg * com_m
        loads.append(Payload(mass, both / mass if mass else com_m))
    return loads


def robot_blocks(cell: CellData, words: Sequence[str]) -> list[ParameterBlock]:
    """Blocks of the arm that words free; all joints unless the cell lists offsets."""
    robot, section = cell.robot, cell.config.parameters
    joints, payloads = robot.turning_joints, payloads_of(cell)
    blocks: list[ParameterBlock] = []
    held, degree = PRIORS in words, np.pi / 180.0
    offset = section.prior_offset_deg * degree if held else None
    length = section.prior_length_mm * 1e-3 if held else None
    angle = section.prior_angle_deg * degree if held else None
    wave = section.prior_harmonic_deg * degree if held else None
    give = section.prior_compliance_urad_nm * 1e-6
    if "geometry" in words:
        # offsets first: a turn about a joint's axis is then called by the name of its offset
        blocks.append(ZeroOffsets(robot, robot.joint_names, offset, length))
        blocks.append(LinkGeometry(robot, _across_axes(robot) if held else None, length, angle))
    elif "zero_offsets" in words:
        blocks.append(ZeroOffsets(robot, cell.offset_joints, offset, length))
    if "scale" in words:
        blocks.append(JointScale(robot, robot.joint_names, wave))  # as much in a radian as a wave
    if "compliance" in words:
        gravity = GravityLoad(robot, payloads)
        wound = None
        if held:
            wound = _give(robot, payloads, gravity.joint_torque, give)[robot.arm_turns]
        blocks.append(JointCompliance(robot, joints, payloads, prior=wound))
    if "bearings" in words:
        bearings = BearingCompliance(robot, joints, payloads)
        if held:
            tilted = _give(robot, payloads, bearings.torques, give)
            bearings = BearingCompliance(robot, joints, payloads, prior=tilted)
        blocks.append(bearings)
    if "lost_motion" in words:
        blocks.append(LostMotion(robot, joints, section.lost_motion_nm, payloads, prior_rad=wave))
    if "harmonics" in words:
        blocks.append(JointHarmonics(robot, joints, section.harmonics, wave))
    return blocks


Torques = Callable[[FloatArray, Setup], FloatArray]
"""Torques of gravity ``(k, N)`` [Nm] at postures ``(n, N)`` and their set-up."""


def _give(robot: Robot, payloads: Sequence[Payload], torques: Torques, prior: float) -> FloatArray:
    """Standard deviations ``(k,)`` of compliances [rad/Nm]: less for those that carry much.

    The reducer of a shoulder that holds 5 kNm is stiffer than that of a light wrist, and so is the
    bearing of a first joint that holds the whole arm: none is built to give way by more than
    ``WIND_UP`` or so.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (_WEIGHED, robot.n)).T.copy()
    largest = np.max(
        [
            np.abs(torques(q, Setup.of(_WEIGHED, payload=[k] * _WEIGHED))).max(axis=1)
            for k in range(len(payloads))
        ],
        axis=0,
    )
    return np.asarray(np.minimum(prior, WIND_UP / np.maximum(largest, WIND_UP / prior)))


def _across_axes(robot: Robot) -> list[str]:
    """Parameters of all links but turns about the joints' own axes, which are zero offsets."""
    own = {
        f"link.{joint}.{AXES[3 + int(np.argmax(np.abs(axis)))]}"
        for joint, axis in zip(robot.joint_names, robot.chain.axes, strict=True)
        if np.abs(axis).max() > 1.0 - 1e-9
    }
    return [name for name in LinkGeometry(robot).names if name not in own]


def has_weight(cell: CellData) -> bool:
    """Whether the masses of the links are known."""
    return bool(cell.robot.link_mass.any())


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
    turning = cell.robot.turning_joints  # slides are where they show; their frames may be off
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


_FRAMES = ("point", "pose", "camera-pose")


def set_up_blocks(
    cell: CellData,
    tools: Sequence[tuple[str, set[str]]],
    targets: Sequence[tuple[str, set[str], FloatArray]],
) -> list[ParameterBlock]:
    """Blocks that place tools and targets, in the order given.

    ``tools``: label, and the kinds that it is measured by. ``targets``: the same, and where the
    nominal tool points were ``(N, 3)`` [m] when it was measured: the first guess of what the cell
    does not place.
    """
    blocks: list[ParameterBlock] = []
    for label, met in tools:
        point = mark_named(cell, label).point_m
        if met & set(POSES):
            blocks.append(ToolFrame(transform(np.eye(3), point), label))
        else:
            blocks.append(ToolPoints([point], [label], _tool_axes(cell, label, met)))
    return blocks + [_target(cell, *target) for target in targets]


def _tool_axes(cell: CellData, label: str, met: set[str]) -> str:
    """Axes along which a tool point can be seen: not along a view line."""
    asked = cell.config.parameters.tool_axes
    if label == TOOL and asked is not None:
        return asked
    return "xy" if met == {"view-line"} else "xyz"


def _target(cell: CellData, label: str, met: set[str], points: FloatArray) -> ParameterBlock:
    known = target_named(cell.config, label)
    if met & set(_FRAMES):
        return TargetFrame(np.eye(4) if known is None else instrument_frame(cell, known), label)
    if met == {"plane"}:
        if known is not None:
            return TargetPlane(place_of(cell, known), normal_of(known), label)
        middle = points.mean(axis=0)
        normal = np.linalg.svd(points - middle)[2][-1]
        return TargetPlane(middle, normal if normal[2] >= 0 else -normal, label)
    return TargetPoints([points.mean(axis=0) if known is None else place_of(cell, known)], [label])


def everything(cell: CellData) -> tuple[str, ...]:
    """Words of all that may be off on the arm of a cell, and that the cell asks for."""
    asked = {word for words in cell.config.parameters.models for word in words}
    every = dict.fromkeys([*EVERYTHING, *sorted(asked - {"zero_offsets"})])
    return tuple(word for word in every if has_weight(cell) or word not in WEIGH)


def measuring_model(
    cell: CellData, observations: Sequence[Observation], words: Sequence[str] | None = None
) -> CalibrationModel:
    """Model of the arm's errors, and of tools and targets of observations.

    ``words``: of the errors; by default those of ``parameters.planned``, else the zero offsets of
    Watanabe et al. 2006.
    """
    if words is None:
        words = cell.config.parameters.planned or PAPER
    arm = robot_blocks(cell, words)
    return CalibrationModel(
        cell.robot,
        [*arm, *_set_up(cell, observations)],
        _kinds(cell, observations),
        known_distances(cell, {seen.target for seen in observations}) if PRIORS in words else (),
    )


PAPER = ("zero_offsets",)
"""Words of what Watanabe et al. 2006 identify: ten numbers with tool point and target."""


def known_distances(cell: CellData, targets: Set[str]) -> list[KnownDistance]:
    """Distances that the cell knows between some targets, by their names."""
    return [
        KnownDistance(*known.targets, known.length_mm / 1e3, known.three_sigma_mm / 3e3)
        for known in cell.config.known_distance
        if targets >= {*known.targets}
    ]


def _kinds(cell: CellData, observations: Sequence[Observation]) -> list[Measurement]:
    return [noise_of_kind(cell, kind) for kind in dict.fromkeys(o.kind for o in observations)]


def _set_up(cell: CellData, observations: Sequence[Observation]) -> list[ParameterBlock]:
    """Tools and targets; a tool point that is not measured itself is first, and not free."""
    tools: dict[str, set[str]] = {}
    targets: dict[str, set[str]] = {}
    for seen in observations:
        targets.setdefault(seen.target, set()).add(seen.kind)
        for label in seen.tools:
            tools.setdefault(label, set()).add(seen.kind)
    nowhere = np.zeros((1, 3))  # all are of the cell: none is guessed from points
    blocks = set_up_blocks(
        cell, list(tools.items()), [(label, met, nowhere) for label, met in targets.items()]
    )
    return blocks if TOOL in tools else [ToolPoint(cell.tool_m, free=""), *blocks]


def true_set_up(
    cell: CellData, observations: Sequence[Observation]
) -> tuple[list[ParameterBlock], list[FloatArray], list[Measurement]]:
    """Tools and targets as they are in the simulated cell: blocks, their values, and the kinds.

    All are off by the errors of ``[truth]``.
    """
    truth = cell.config.truth
    blocks = _set_up(cell, observations)
    values = []
    for block in blocks:
        value = block.nominal.copy()
        if isinstance(block, (ToolFrame, TargetFrame, TargetPlane)):
            error = truth.tool_error_mm if block.tools else truth.target_error_mm
            turned = (0.0, 0.0, 0.0) if block.tools else truth.target_turn_deg
            off = transform(rotation_from_wpr(np.deg2rad(turned)), np.zeros(3))
            T = block.T_nominal[0] @ off
            T[:3, 3] += np.array(error) / 1e3
            if isinstance(block, TargetPlane):
                value[0] = float(np.array(error) / 1e3 @ block.T_nominal[0, :3, 2])
            else:
                value = block.values_at(T, 0, value)
        elif value.size == 3:
            value += np.array(truth.tool_error_mm if block.tools else truth.target_error_mm) / 1e3
        values.append(value)
    return blocks, values, _kinds(cell, observations)
