"""What a block of parameters must tell the calibration model: what it moves, and how.

Every error of the arm is seen at the tool point: a small change of a parameter moves the tool
point against the target and turns the tool. A block gives that motion as a twist; how a
measurement sees it is the measurement's business.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from calib.errors import InputError, near_names
from calib.robots.chain import ChainState
from calib.robots.robot import Robot
from calib.se3 import FloatArray, IntArray

Unit = Literal["rad", "m", "rad/Nm"]


@dataclass(frozen=True, eq=False)
class Payload:
    """What the flange carries besides itself.

    Attributes
    ----------
    mass_kg : float
    com_m : array (3,)
        Centre of mass in the tip frame [m].
    """

    mass_kg: float
    com_m: FloatArray

    def __post_init__(self) -> None:
        com = np.asarray(self.com_m, dtype=float)
        if not (np.isfinite(self.mass_kg) and self.mass_kg >= 0 and com.shape == (3,)):
            raise InputError(
                "a payload needs a mass of zero or more and a centre of mass of three numbers",
                name="payload",
                value=self.mass_kg,
            )
        object.__setattr__(self, "com_m", com)


@dataclass
class ArmErrors:
    """How the arm differs from its nominal description at given parameters.

    Attributes
    ----------
    joints : array (..., n)
        Added to the joint values [rad].
    tool : array (..., 3)
        Tool point in the tip frame [m].
    targets : array (..., 1, K, 3)
        Target points in the base frame [m].
    """

    joints: FloatArray
    tool: FloatArray
    targets: FloatArray


@dataclass(frozen=True, eq=False)
class ArmView:
    """Everything about an arm in given postures that a parameter block may need.

    Attributes
    ----------
    q : array (..., n)
        Joint values as the controller shows them [rad].
    state : ChainState
        The arm with its errors applied.
    point : array (..., 3)
        Tool point in the base frame [m].
    target : array (N,)
        Index of the target that each posture touches.
    errors : ArmErrors
        The errors applied.
    """

    q: FloatArray
    state: ChainState
    point: FloatArray
    target: IntArray
    errors: ArmErrors

    @cached_property
    def joint_motion(self) -> FloatArray:
        """Twist ``(..., 6, n)`` of the tool point for each joint [m/rad, 1]."""
        return self.state.jacobian(self.point)


class ParameterBlock(ABC):
    """A group of parameters that enter the model in the same way.

    Attributes
    ----------
    names : tuple of str
        One a parameter, unique over the model, e.g. ``zero_offset.joint_2``.
    unit : str
        SI unit of all of them.
    nuisance : bool
        Whether they place the measuring set-up (tool point, target) rather than the robot.
    """

    names: tuple[str, ...]
    unit: Unit
    nuisance: bool = False

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @property
    @abstractmethod
    def nominal(self) -> FloatArray:
        """Values ``(size,)`` of the robot and set-up as described."""

    @abstractmethod
    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray) -> None:
        """Apply values ``(..., size)`` to the arm; ``q`` ``(..., n)`` are the joints as shown."""

    @abstractmethod
    def motion(self, view: ArmView) -> FloatArray:
        """Twist ``(..., 6, size)`` of the tool against the target for each parameter.

        Rows 0 to 2: velocity of the tool point minus that of the target [m per unit]; rows 3 to
        5: angular velocity of the tool; in base axes.
        """


def joint_indices(robot: Robot, joints: Sequence[str]) -> list[int]:
    """Indices of joints by name.

    Raises
    ------
    InputError
        A name that the robot does not have; the hint lists near ones.
    """
    for joint in joints:
        if joint not in robot.joint_names:
            raise InputError(
                f"{robot.name} has no joint {joint!r}",
                hint=near_names(joint, robot.joint_names),
                name=joint,
            )
    doubles = [j for j in joints if list(joints).count(j) > 1]
    if doubles:
        raise InputError(f"joint {doubles[0]!r} is listed twice", hint="list it once")
    return [robot.joint_names.index(joint) for joint in joints]
