"""The arm as its controller knows it: joints as shown, poses in its frames, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, UnreachableError, near_names
from calib.robots import POSITIVE_AXES, Controller, Robot
from calib.se3 import FloatArray, IntArray, inverse
from posedesign.programs.configurations import Configuration, configuration_of

USUAL_JOINTS = 6  # of the arms of every maker whose joint count is not given with its axes
_SAME_RAD = 4e-5  # answers all within this are one, found twice near a singularity: 0.002 deg
_AT_ONCE = 500
"""Poses solved at once: each has up to eight arm positions in up to 27 combinations of turns."""


@dataclass(frozen=True, eq=False)
class Load:
    """What the flange carries."""

    mass_kg: float
    com_m: FloatArray  # (3,): its centre in the tip frame [m]


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm as its controller shows it."""

    controller: Controller  # turns postures into joint values as they are shown, and back
    robot: Robot | None = None
    """None where only joint values are known: then nothing is said of poses."""
    T_world_user: FloatArray = field(default_factory=lambda: np.eye(4))
    """(4, 4): the user frame in the controller's world [m]."""
    T_tip_tool: FloatArray = field(default_factory=lambda: np.eye(4))
    """(4, 4): the controller's tool frame in the tip frame of the robot, its faceplate [m]."""
    load: Load | None = None  # None where it is not known
    world_stands: bool = False
    """Slides carry the arm, and the controller's world stands still meanwhile, at ``T_base_world``
    of the controller: poses then have the places of the slides beside them."""

    @classmethod
    def usual(cls, maker: str | None, n: int | None = None) -> Arm:
        """The arm of a maker in the signs of its own and ROS-Industrial's URDFs.

        ``maker``: None: joints are shown as the description has them. ``n``: number of joints.
        Raises InputError: the maker is unknown, or its arms have another number of joints.
        """
        if maker is None:
            return cls(Controller("", np.eye(n or USUAL_JOINTS), np.eye(4)))
        if maker not in POSITIVE_AXES:
            raise InputError(
                f"there is no controller {maker!r}", hint=near_names(maker, POSITIVE_AXES)
            )
        joints = len(POSITIVE_AXES[maker])
        if n is not None and n != joints:
            raise InputError(
                f"the posture has {n} joint values, an arm of {maker} has {joints}",
                hint=f"only arms of {joints} joints can be written for this controller",
                name="posture",
                value=n,
                bound=joints,
            )
        matrix = np.eye(joints)
        if maker == "fanuc":
            matrix[2, 1] = -1.0  # J3 is the angle to the horizontal: q3 - q2
        return cls(Controller(maker, matrix, np.eye(4)))

    @classmethod
    def of(
        cls,
        robot: Robot,
        T_world_user: FloatArray | None = None,
        T_tip_tool: FloatArray | None = None,
        load: Load | None = None,
    ) -> Arm:
        """The arm of a robot's description, with its controller where that is known."""
        return cls(
            robot.controller or Controller("", np.eye(robot.n), np.eye(4), robot.external),
            robot,
            np.eye(4) if T_world_user is None else T_world_user,
            np.eye(4) if T_tip_tool is None else T_tip_tool,
            load,
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.controller.pendant_from_joints)

    @property
    def maker(self) -> str | None:
        """Whose controller it has; None where that is not known."""
        return self.controller.maker or None

    @property
    def n_external(self) -> int:
        """How many joints are external axes, which stand behind the others."""
        return self.controller.external.count

    def slowest_rad_s(self, usual: float) -> float:
        """Speed of its slowest joint [rad/s]; the usual one where none is known."""
        known = self.robot.speed[np.isfinite(self.robot.speed)] if self.robot is not None else ()
        return float(min(known, default=usual))

    @property
    def order(self) -> IntArray:
        """Indices ``(n,)`` of the description's joints in the order of programs."""
        return self.controller.external.behind_arm(self.n)

    @property
    def external_units(self) -> tuple[str, ...]:
        """Units of the external axes, E1 first: mm or deg."""
        slides = self.controller.external.slides_of(self.n)[self.order]
        return tuple(np.where(slides, "mm", "deg").tolist()[self.n - self.n_external :])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Of the description; joint_1, joint_2, ... without one. External axes come last."""
        if self.robot is not None:
            return tuple(self.robot.joint_names[j] for j in self.order)
        return tuple(f"joint_{j + 1}" for j in range(self.n))

    def shown(self, postures: ArrayLike) -> FloatArray:
        """Values ``(..., n)`` [deg] as the controller shows postures ``(..., n)`` [rad, m].

        Behind those of the arm's joints stand those of external axes [mm, deg].
        """
        return self.controller.pendant(postures)[..., self.order]

    def postures(self, shown_deg: ArrayLike) -> FloatArray:
        """Postures ``(..., n)`` [rad, m] of values ``(..., n)`` [deg, mm] as shown."""
        shown = np.asarray(shown_deg, dtype=float)
        if shown.shape[-1:] == (self.n,):  # any other number is refused by the controller
            shown = shown[..., np.argsort(self.order)]
        return self.controller.posture(shown)

    def tool_poses(self, postures: ArrayLike) -> FloatArray:
        """The tool frame in the user frame ``(..., 4, 4)`` at postures ``(..., n)`` [rad]."""
        world = self.controller.in_world(self._described().fk(postures))
        return np.asarray(inverse(self.T_world_user) @ world @ self.T_tip_tool)

    def configurations(self, postures: ArrayLike) -> list[Configuration]:
        """Arm positions and turns of postures ``(N, n)`` [rad] in the maker's words."""
        kind = configuration_of(self.controller.maker)
        if kind is None:
            raise InputError(
                f"the arm positions of a controller of {self.maker or 'an unknown maker'} have no "
                "words",
                hint="write joint positions",
                name="form",
            )
        turning = np.atleast_2d(np.asarray(postures, dtype=float))[:, self.n_external :]
        return list(kind.of(self._standing, turning))

    def postures_at(
        self,
        T_user_tool: FloatArray,
        meant: Sequence[Configuration | None],
        near: FloatArray | None = None,
        labels: Sequence[str] = (),
        places: FloatArray | None = None,
    ) -> FloatArray:
        """Postures ``(N, n)`` [rad] that bring the tool to poses, in the arm positions meant.

        Parameters
        ----------
        T_user_tool : array (N, 4, 4)
            [m]
        meant : sequence of Configuration or None
            None: the file does not say; the answer nearest to ``near`` is taken.
        near : array (N, n), optional
            Where the arm was to be [rad]; of answers that the words leave open the nearest is
            taken.
        labels : sequence of str
            What to call the poses in errors.
        places : array (N, slides), optional
            Where slides have the arm at each [m].

        Raises
        ------
        UnreachableError
            No posture inside the limits takes a pose, or none in the arm position meant.
        InputError
            Nothing says which of several postures is meant, or the robot is not known.
        """
        names = labels or [f"position {i + 1}" for i in range(len(T_user_tool))]
        T_base_tip = self.controller.in_base(
            self.T_world_user @ T_user_tool @ inverse(self.T_tip_tool)
        )
        if places is not None:
            zero = np.zeros(self.n)
            directions = self._described().state(zero).axes[: self.n_external]
            # an arm that has gone along sees a pose come back by as much
            T_base_tip[:, :3, 3] -= places @ directions
            near = None if near is None else near[:, self.n_external :]
        starts = [*range(0, len(T_base_tip), _AT_ONCE), len(T_base_tip)]
        found = [
            self._solve(
                T_base_tip[a:b], meant[a:b], None if near is None else near[a:b], names[a:b]
            )
            for a, b in pairwise(starts)
        ]
        turning = np.concatenate(found) if found else np.empty((0, self._standing.n))
        return turning if places is None else np.hstack([places, turning])

    def _solve(
        self,
        T_base_tip: FloatArray,
        meant: Sequence[Configuration | None],
        near: FloatArray | None,
        names: Sequence[str],
    ) -> FloatArray:
        robot = self._standing
        solutions = robot.inverse(T_base_tip, every_turn=True)
        inside = solutions.inside
        postures, pose = solutions.postures[inside], solutions.pose[inside]
        said = any(m is not None for m in meant)
        words = self.configurations(self._at_zero(postures)) if said else []
        out = np.empty((len(T_base_tip), robot.n))
        for i, name in enumerate(names):
            first, last = np.searchsorted(pose, [i, i + 1])
            answers = postures[first:last]
            if not len(answers):
                raise UnreachableError(
                    f"{name}: no posture inside the joint limits takes it",
                    hint="are tool frame, user frame and robot those it was recorded with?",
                    name=name,
                )
            wanted = meant[i]
            if wanted is not None:
                fits = [k for k in range(len(answers)) if wanted.allows(words[first + k])]
                if not fits:
                    raise UnreachableError(
                        f"{name}: no posture that takes it has the configuration {wanted.words}",
                        hint="are tool frame, user frame and robot those it was recorded with?",
                        name=name,
                        value=wanted.words,
                    )
                answers = answers[fits]
            out[i] = _nearest(answers, None if near is None else near[i], name)
        return out

    def _at_zero(self, turning: FloatArray) -> FloatArray:
        """Postures ``(N, n)`` [rad, m] of values of the joints that turn, slides at zero."""
        return np.hstack([np.zeros((len(turning), self.n_external)), turning])

    @cached_property
    def _standing(self) -> Robot:
        """The arm without the slides that carry it, where they have it at zero."""
        robot, first = self._described(), self.n_external
        if not first:
            return robot
        shares = self.controller.pendant_from_joints[first:, first:]
        rows = ("joint_names", "lower", "upper", "speed", "link_mass", "link_com", "stiffness")
        return replace(
            robot,
            **{name: getattr(robot, name)[first:] for name in rows},
            chain=robot.chain.arm,
            coupled_limits=tuple(
                replace(c, coefficients=c.coefficients[first:]) for c in robot.coupled_limits
            ),
            bodies=(),
            lost_shapes=(),
            controller=Controller(self.controller.maker, shares, self.controller.T_base_world),
        )

    def _described(self) -> Robot:
        if self.robot is None:
            raise InputError(
                "poses of the tool need the robot",
                hint="pass `cell`, or write joint positions",
                name="robot",
            )
        return self.robot


def _nearest(answers: FloatArray, near: FloatArray | None, name: str) -> FloatArray:
    """The one answer; of several the nearest to where the arm was to be."""
    if near is not None:
        distance = np.linalg.norm(answers - near, axis=1)
        return np.asarray(answers[int(np.argmin(distance))])
    spread = np.ptp(answers, axis=0).max()
    if spread > _SAME_RAD:
        raise InputError(
            f"{name}: {len(answers)} postures take it, and nothing says which is meant",
            hint="pass the plan it belongs to, or store joint positions",
            name=name,
        )
    return np.asarray(answers[0])
