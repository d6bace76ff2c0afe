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

Arms with a parallel linkage have such a coupling with other makers, too: the motor of joint 3 turns
the forearm against the base, and an IRB 4400 shows ``J3 = q3 + q2`` in ABB's signs (ros-industrial/
abb, abb_driver/src/abb_utils.cpp, ``J23_coupled``). No description says so: it is to be given.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, RobotModelError, near_names
from calib.robots.chain import NO_EXTERNAL_AXES, ExternalAxes, SerialChain
from calib.se3 import FloatArray, apply, inverse, transform

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

_MAKER_WORDS = {
    "fanuc": r"fanuc|lrmate\w*|m\d{1,3}i[abcd]\w*|r\d{4}i[abcd]\w*|crx\w*|cr\d+i[abcd]\w*",
    "yaskawa": r"yaskawa|motoman|(gp|mh|hc|hp|sia|ar)\d+\w*",
    "abb": r"abb|irb\w*|crb\w*|gofa|yumi",
    "kuka": r"kuka|kr\d+\w*|lbr|iiwa\w*",
    "staubli": r"staubli|stäubli|[rt]x2?\d*x?l?",
    "kawasaki": r"kawasaki|khi|rs\d{3}\w*",
    "doosan": r"doosan|dsr|[aehm]\d{4}",
    "denso": r"denso|cobotta|v[mps]\d+\w*",
    "ur": r"ur(\d+\w*)?|universal",
    "franka": r"franka|emika|panda|fr3|fer",
}
"""Words in names of a robot, its package or its links that only a maker's own arms have: the maker,
or a series of models."""


def makers_named(names: Iterable[str]) -> frozenset[str]:
    """Return the makers that names out of a description speak of."""
    words = {word for name in names for word in re.split(r"[^0-9a-zä]|_", name.lower())}
    return frozenset(
        maker
        for maker, pattern in _MAKER_WORDS.items()
        if any(re.fullmatch(pattern, word) for word in words)
    )


_SAME_DIRECTION = 1.0 - 1e-3
"""Cosine from which two axes are one, 2.6 deg: URDFs round their angles to three decimals or more,
and those of calibrated arms have zero offsets of half a degree in them, one joint upon another."""


_LEAST_DETERMINANT = 1e-6
"""Of the shares of joints in what is shown: without couplings in a ring it is one."""


@dataclass(frozen=True, eq=False)
class Controller:
    """How a controller shows joints and positions."""

    maker: str
    pendant_from_joints: FloatArray  # (n, n): values on the pendant of those in the description
    T_base_world: FloatArray  # (4, 4): the controller's world in the base frame of the robot [m]
    external: ExternalAxes = NO_EXTERNAL_AXES
    """The first joints: shown as the description has them, in millimetres and degrees."""

    @property
    def differs(self) -> bool:
        """Whether the pendant shows other joint values than the description has."""
        return not np.array_equal(self.pendant_from_joints, np.eye(len(self.pendant_from_joints)))

    def pendant(self, q: ArrayLike) -> FloatArray:
        """Joint values on the pendant ``(..., n)`` [deg, mm] of postures ``(..., n)`` [rad, m]."""
        shown = self._check(q) @ self.pendant_from_joints.T * shown_of(self._n, self.external)
        return np.asarray(shown + 0.0)

    def posture(self, pendant_deg: ArrayLike) -> FloatArray:
        """Postures ``(..., n)`` [rad, m] of joint values on the pendant ``(..., n)`` [deg, mm]."""
        back = np.linalg.inv(self.pendant_from_joints)
        values = self._check(pendant_deg) / shown_of(self._n, self.external)
        return np.asarray(values @ back.T)

    def in_world(self, T_base: FloatArray) -> FloatArray:
        """Poses ``(..., 4, 4)`` in the controller's world of poses in the base frame."""
        return np.asarray(inverse(self.T_base_world) @ T_base)

    def in_base(self, T_world: FloatArray) -> FloatArray:
        """Poses ``(..., 4, 4)`` in the base frame of poses in the controller's world."""
        return np.asarray(self.T_base_world @ T_world)

    @property
    def _n(self) -> int:
        return len(self.pendant_from_joints)

    def _check(self, values: ArrayLike) -> FloatArray:
        array = np.asarray(values, dtype=float)
        found = array.shape[-1] if array.ndim else 0
        if found != self._n:
            raise InputError(
                f"the posture has {found} joint values, the arm {self._n}", name="posture"
            )
        return array


def shown_of(n: int, external: ExternalAxes = NO_EXTERNAL_AXES) -> FloatArray:
    """Degrees in a radian ``(n,)``; millimetres in a metre of joints that slide."""
    return np.where(external.slides_of(n), 1e3, np.rad2deg(1.0))


@dataclass(frozen=True)
class Coupling:
    """A joint that the controller shows with a part of another one in it, by their names."""

    joint: str
    of: str
    ratio: float
    """Part of ``of`` that is added to what is shown of ``joint``, both in the signs of the
    controller: FANUC's J3 has -1 of J2. Zero for none."""


def controller_of(
    maker: str,
    chain: SerialChain,
    T_base_world: FloatArray | None,
    couplings: Sequence[Coupling] = (),
    joint_names: Sequence[str] = (),
    T_base_foot: FloatArray | None = None,
) -> Controller:
    """The view of a maker's controller on a chain.

    Parameters
    ----------
    couplings : sequence of Coupling
        In place of what the maker's controllers usually have between these joints.
    joint_names : sequence of str
        Of the chain, which couplings name.
    T_base_world : array (4, 4) or None
        Where the description places the controller's world; None where it does not say.
    T_base_foot : array (4, 4), optional
        The link that the arm stands on, external axes at zero, which makers count from; the base
        where it is not given.

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
    arm, first = chain.arm, chain.external.count
    if len(wanted) != arm.n:
        raise RobotModelError(
            f"an arm of {maker} has {len(wanted)} joints, this one {arm.n}",
            hint="leave the controller out, or name another one",
            name=maker,
        )
    state = arm.forward(np.zeros(arm.n))
    foot = np.eye(4) if T_base_foot is None else T_base_foot
    world = T_base_world
    if world is None:
        world = foot @ _usual_world(maker, apply(inverse(foot), state.origins))
    cosine = np.sum((state.axes @ world[:3, :3]) * wanted, axis=-1)
    if (np.abs(cosine) < _SAME_DIRECTION).any():
        joint = int(np.argmin(np.abs(cosine)))
        raise RobotModelError(
            f"joint {joint + 1} at zero does not turn about the axis that a controller of {maker} "
            "counts it about",
            hint="is the zero posture of the description that of the controller?",
            name=maker,
        )
    signs = np.diag(np.concatenate([np.ones(first), np.sign(cosine)]))
    shares = np.eye(chain.n)  # what is shown, of joint values in the maker's signs
    if maker == "fanuc":
        shares[first + 2, first + 1] = -1.0
    for coupling in couplings:
        shares[_places(coupling, joint_names)] = coupling.ratio
    if abs(np.linalg.det(shares)) < _LEAST_DETERMINANT:
        raise RobotModelError(
            "with these couplings what the controller shows does not tell where the joints are",
            hint="a joint is shown with a part of one that comes before it",
            name="coupling",
        )
    return Controller(maker, shares @ signs, world, chain.external)


def _places(coupling: Coupling, joint_names: Sequence[str]) -> tuple[int, int]:
    """Row and column of a coupling."""
    for name in (coupling.joint, coupling.of):
        if name not in joint_names:
            raise RobotModelError(
                f"there is no joint {name!r} to couple",
                hint=near_names(name, joint_names),
                name=name,
            )
    if coupling.joint == coupling.of or not np.isfinite(coupling.ratio):
        raise RobotModelError(
            f"{coupling.joint} cannot be coupled with {coupling.ratio:g} of {coupling.of}",
            hint="name two joints, and a number",
            name=coupling.joint,
        )
    return list(joint_names).index(coupling.joint), list(joint_names).index(coupling.of)


def _usual_world(maker: str, origins: FloatArray) -> FloatArray:
    """The controller's world where the description has no frame for it."""
    if maker == "fanuc":
        return transform(np.eye(3), [*origins[0, :2], origins[1, 2]])
    if maker == "ur":
        return transform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    return np.eye(4)
