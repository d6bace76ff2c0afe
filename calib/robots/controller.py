"""What a robot's own controller shows for what its description says, and back.

A pendant shows joint values with the maker's signs, and FANUC's shows the angle of the forearm to
the horizontal, not to the upper arm:

    J3 = q3 - q2        q3 = J3 + J2

with joint_2 about +y and joint_3 about -y (ros-industrial/fanuc, fanuc_driver/src/fanuc_utils.cpp,
where ``J23_factor`` is 1 for all arms but the M-430iA). A zero offset of J2 therefore moves q2
*and* q3 when the pendant's J3 is kept. Positions are given in the controller's own frame: FANUC's
lies on the axis of J1 at the height of J2, that of Universal Robots is turned by half a turn.

Signs are not taken on trust: the directions of the joint axes at zero are compared with those that
the maker counts positive about, so that a description with other signs is read rightly, and one
with another zero posture is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, RobotModelError, near_names
from calib.robots.chain import SerialChain
from calib.se3 import FloatArray, inverse, transform

_X, _Y, _Z = np.eye(3)

_ELBOW_UP = (_Z, _Y, -_Y, -_X, -_Y, -_X)
"""Upper arm up, forearm to the front."""

POSITIVE_AXES: dict[str, tuple[FloatArray, ...]] = {
    "fanuc": _ELBOW_UP,
    "yaskawa": _ELBOW_UP,
    "abb": (_Z, _Y, _Y, _X, _Y, _X),
    "kuka": (-_Z, _Y, _Y, -_X, _Y, -_X),
    "staubli": (_Z, _Y, _Y, _Z, _Y, _Z),
    "kawasaki": (-_Z, -_X, _X, _Z, _X, _Z),
    "doosan": (_Z, _Y, _Y, _Z, _Y, _Z),
    "denso": (_Z, _Y, _Y, _Z, _Y, _Z),
    "ur": (_Z, -_Y, -_Y, -_Y, -_Z, -_Y),
    "franka": (_Z, _Y, _Z, -_Y, _Z, -_Y, -_Z),
}
"""Directions that joints are counted positive about, at zero and in the controller's world. From
ROS-Industrial's and the makers' own URDFs, whose joint values are those of the controllers (FANUC:
but for J3)."""

_SAME_DIRECTION = 1.0 - 1e-3
"""Cosine from which two axes are one, 2.6 deg: URDFs round their angles to three decimals or more,
and those of calibrated arms have zero offsets of half a degree in them, one joint upon another."""


@dataclass(frozen=True, eq=False)
class Controller:
    """How a controller shows joints and positions.

    Attributes
    ----------
    pendant_from_joints : array (n, n)
        Joint values on the pendant of those in the description.
    T_base_world : array (4, 4)
        The controller's world in the base frame of the robot [m].
    """

    maker: str
    pendant_from_joints: FloatArray
    T_base_world: FloatArray

    @property
    def differs(self) -> bool:
        """Whether the pendant shows other joint values than the description has."""
        return not np.array_equal(self.pendant_from_joints, np.eye(len(self.pendant_from_joints)))

    def pendant(self, q: ArrayLike) -> FloatArray:
        """Joint values on the pendant ``(..., n)`` [deg] of postures ``(..., n)`` [rad]."""
        return np.asarray(np.rad2deg(self._check(q) @ self.pendant_from_joints.T) + 0.0)

    def posture(self, pendant_deg: ArrayLike) -> FloatArray:
        """Postures ``(..., n)`` [rad] of joint values on the pendant ``(..., n)`` [deg]."""
        back = np.linalg.inv(self.pendant_from_joints)
        return np.asarray(np.deg2rad(self._check(pendant_deg) @ back.T))

    def in_world(self, T_base: FloatArray) -> FloatArray:
        """Poses ``(..., 4, 4)`` in the controller's world of poses in the base frame."""
        return np.asarray(inverse(self.T_base_world) @ T_base)

    def in_base(self, T_world: FloatArray) -> FloatArray:
        """Poses ``(..., 4, 4)`` in the base frame of poses in the controller's world."""
        return np.asarray(self.T_base_world @ T_world)

    def _check(self, values: ArrayLike) -> FloatArray:
        array = np.asarray(values, dtype=float)
        n = len(self.pendant_from_joints)
        if array.ndim == 0 or array.shape[-1] != n:
            found = array.shape[-1] if array.ndim else 0
            raise InputError(f"the posture has {found} joint values, the arm {n}", name="posture")
        return array


def controller_of(maker: str, chain: SerialChain, T_base_world: FloatArray | None) -> Controller:
    """The view of a maker's controller on a chain.

    Parameters
    ----------
    T_base_world : array (4, 4) or None
        Where the description places the controller's world; None where it does not say.

    Raises
    ------
    RobotModelError
        The maker is unknown, or the axes of the chain at zero are not those of its arms.
    """
    if maker not in POSITIVE_AXES:
        raise RobotModelError(
            f"there is no controller {maker!r}", hint=near_names(maker, POSITIVE_AXES), name=maker
        )
    wanted = np.array(POSITIVE_AXES[maker])
    if len(wanted) != chain.n:
        raise RobotModelError(
            f"an arm of {maker} has {len(wanted)} joints, this one {chain.n}",
            hint="leave the controller out, or name another one",
            name=maker,
        )
    state = chain.forward(np.zeros(chain.n))
    world = _usual_world(maker, state.origins) if T_base_world is None else T_base_world
    cosine = np.sum((state.axes @ world[:3, :3]) * wanted, axis=-1)
    if (np.abs(cosine) < _SAME_DIRECTION).any():
        joint = int(np.argmin(np.abs(cosine)))
        raise RobotModelError(
            f"joint {joint + 1} at zero does not turn about the axis that a controller of {maker} "
            "counts it about",
            hint="is the zero posture of the description that of the controller?",
            name=maker,
        )
    matrix = np.diag(np.sign(cosine))
    if maker == "fanuc":
        matrix[2] -= matrix[1]
    return Controller(maker, matrix, world)


def _usual_world(maker: str, origins: FloatArray) -> FloatArray:
    """The controller's world where the description has no frame for it."""
    if maker == "fanuc":
        return transform(np.eye(3), [*origins[0, :2], origins[1, 2]])
    if maker == "ur":
        return transform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    return np.eye(4)
