"""The robot as identified: a kinematic chain that holds what a chain can hold.

Zero offsets and link geometry move the frames of joints, in every posture alike: a chain with
these frames is the robot as it was found. What changes from posture to posture is no part of any
chain (compliance, harmonics, scale, lost motion): it is named, so that nobody takes the chain for
all that was identified. :mod:`calib.correction.compensation` corrects postures for everything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model import CalibrationModel, Setup
from calib.model.context import ArmErrors
from calib.model.parameters import ParameterBlock
from calib.robots import Robot
from calib.robots.robot import with_placements
from calib.se3 import FloatArray, inverse, rotation_exp, transform


@dataclass(frozen=True, eq=False)
class CorrectedRobot:
    """A robot with its identified kinematics.

    Attributes
    ----------
    robot : Robot
        Same joints, limits, masses, tip and controller; other joint frames.
    nominal : Robot
        As described.
    left_out : tuple of str
        What was identified and no chain can hold, in words: kind of error and parameters.
    """

    robot: Robot
    nominal: Robot
    left_out: tuple[str, ...]

    @property
    def corrections(self) -> FloatArray:
        """How each joint's frame sits off its place as described, ``(n, 4, 4)`` [m].

        In its own axes at zero: ``T_described_corrected``.
        """
        described = inverse(self.nominal.chain.placements)
        return np.asarray(described @ self.robot.chain.placements)

    @property
    def moved(self) -> tuple[str, ...]:
        """Joints whose frames are not where the description has them."""
        same = (self.robot.chain.placements == self.nominal.chain.placements).all(axis=(1, 2))
        pairs = zip(self.nominal.joint_names, same, strict=True)
        return tuple(name for name, is_same in pairs if not is_same)


def corrected_robot(model: CalibrationModel, x: ArrayLike) -> CorrectedRobot:
    """The robot of a calibration model at identified parameters, as far as a chain can hold it.

    The tip is that of the description: where the tool sits on it, and where the targets are, are
    no matter of the robot. What the set-up absorbs (the zero offset of joint 1, by targets that
    are not surveyed) stays as described.

    Parameters
    ----------
    model : CalibrationModel
    x : array_like (p,)
        Identified parameters [SI].

    Raises
    ------
    InputError
        Not one finite value for each parameter.
    """
    values = check_values(model, x)
    robot = model.robot
    errors = ArmErrors(np.zeros((robot.n, 1)))
    anywhere = np.zeros((robot.n, 1))  # what a chain holds is the same in every posture
    left_out = []
    for block, part in zip(model.parameters, model.slices, strict=True):
        if not block.beyond_chain:
            block.displace(values[part, None], errors, anywhere, Setup.of(1))
        elif _does_something(block, values[part], robot):
            listed = ", ".join(block.names) or "as described"
            left_out.append(f"{block.beyond_chain} ({listed})")
    placements = robot.chain.placements.copy()
    for joint, off in errors.displacements().items():
        placements[joint] @= transform(off.rotation[..., 0], off.translation[..., 0])
    for j in np.flatnonzero(errors.joints[:, 0]):
        turn = rotation_exp(robot.chain.axes[j] * errors.joints[j, 0])
        placements[j] @= transform(turn, np.zeros(3))
    corrected = with_placements(robot, placements)
    said = "joint frames as identified, not as described"
    corrected = replace(corrected, notices=(*robot.notices, said))
    return CorrectedRobot(corrected, robot, tuple(left_out))


def check_values(model: CalibrationModel, x: ArrayLike) -> FloatArray:
    """One set of parameters as an array ``(p,)``.

    Raises
    ------
    InputError
        Not one finite value for each parameter.
    """
    values = np.asarray(x, dtype=float)
    if values.shape != (model.p,):
        raise InputError(
            f"the model has {model.p} parameters, the values have shape {values.shape}",
            hint="give one set of values",
            name="x",
        )
    if not np.isfinite(values).all():
        name = model.names[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise InputError(f"the value of {name} is not a finite number", name=name)
    return values


def _does_something(block: ParameterBlock, values: FloatArray, robot: Robot) -> bool:
    """Whether a block displaces the arm at its values: one that is identified as zero does not."""
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (8, robot.n)).T
    errors = ArmErrors(np.zeros((robot.n, 1)))
    block.displace(values[:, None], errors, np.ascontiguousarray(q), Setup.of(8))
    return bool(errors.joints.any() or errors.displaced)
