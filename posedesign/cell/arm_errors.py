"""What may be off on an arm, in the words of a cell, as parameters of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.model import Setup
from calib.model.parameters import (
    AXES,
    BearingCompliance,
    GravityLoad,
    JointCompliance,
    JointHarmonics,
    JointScale,
    LinkGeometry,
    LostMotion,
    ParameterBlock,
    Payload,
    ZeroOffsets,
)
from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.cell.data import CellData

PRIORS = "priors"
"""Word that holds a model to what is known before measuring."""

WEIGH = ("compliance", "bearings", "lost_motion")
"""Words that need the torque of gravity, and so the masses of the links."""

WIND_UP = 3e-3
"""What a joint gives way by under the largest torque of gravity [rad], at most but for the spread
of :data:`SIZES`. With the stiffness of RV reducers of its class an R-2000iC gives way by some 1.7
mrad at the shoulder, and the joints of light arms with torque sensors by several."""

_WEIGHED = 300
"""Postures among which the largest torque is looked for."""


def payloads_of(cell: CellData) -> list[Payload]:
    """The tool's own payload, and those listed besides."""
    own = cell.payload or Payload(0.0, np.zeros(3))
    others = [Payload(p.mass_kg, np.array(p.com_mm) / 1e3) for p in cell.config.payload]
    return [own, *others]


def robot_blocks(cell: CellData, words: Sequence[str]) -> list[ParameterBlock]:
    """Blocks of the arm that words free; all joints unless the cell lists offsets."""
    robot, section = cell.robot, cell.config.parameters
    joints, payloads = robot.arm_joints, payloads_of(cell)
    blocks: list[ParameterBlock] = []
    held, degree = PRIORS in words, np.pi / 180.0
    offset = section.prior_offset_deg * degree if held else None
    length = section.prior_length_mm * 1e-3 if held else None
    angle = section.prior_angle_deg * degree if held else None
    wave = section.prior_harmonic_deg * degree if held else None
    give = section.prior_compliance_urad_nm * 1e-6 if held else None
    if "geometry" in words:
        # offsets first: a turn about a joint's axis is then called by the name of its offset
        blocks.append(ZeroOffsets(robot, robot.joint_names, offset, length))
        blocks.append(LinkGeometry(robot, _across_axes(robot) if held else None, length, angle))
    elif "zero_offsets" in words:
        blocks.append(ZeroOffsets(robot, cell.offset_joints, offset, length))
    if "scale" in words:
        blocks.append(JointScale(robot, robot.joint_names, wave))  # as much in a radian as a wave
    if "compliance" in words:
        wound = None if give is None else _give(robot, payloads, give)
        blocks.append(JointCompliance(robot, joints, payloads, prior=wound))
    if "bearings" in words:
        blocks.append(BearingCompliance(robot, joints, payloads, prior=give))
    if "lost_motion" in words:
        blocks.append(LostMotion(robot, joints, section.lost_motion_nm, payloads, prior_rad=wave))
    if "harmonics" in words:
        blocks.append(JointHarmonics(robot, joints, section.harmonics, wave))
    return blocks


def _give(robot: Robot, payloads: Sequence[Payload], prior: float) -> FloatArray:
    """Standard deviations ``(n,)`` of compliances [rad/Nm]: less for joints that carry much.

    The reducer of a shoulder that holds 5 kNm is stiffer than that of a light wrist: none is built
    to give way by more than ``WIND_UP`` or so.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (_WEIGHED, robot.n)).T.copy()
    load = GravityLoad(robot, payloads)
    largest = np.max(
        [
            np.abs(load.joint_torque(q, Setup.of(_WEIGHED, payload=[k] * _WEIGHED))).max(axis=1)
            for k in range(len(payloads))
        ],
        axis=0,
    )
    sigma = np.minimum(prior, WIND_UP / np.maximum(largest, WIND_UP / prior))
    return np.asarray(sigma[robot.n_external :])


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
