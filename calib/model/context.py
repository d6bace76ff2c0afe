"""Arm and set-up as a measurement finds them: what parameters displace and measurements look at.

Arrays here have the posture last (:mod:`calib.batch_last`): S postures are the N measurements
of T trials, trial after trial.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import along, columns_of, cross, product, turn, turn_back
from calib.errors import InputError
from calib.robots import Robot
from calib.robots.chain import Displacement, Walk
from calib.se3 import BoolArray, FloatArray, IntArray, right_jacobian, rotation_exp, transform


def reading_label(kind: str, name: str, usual: str) -> str:
    """Label of what an instrument reads by: ``lens``, or ``lens.left`` of one of several."""
    return kind if name == usual else f"{kind}.{name}"


NO_TURN = np.eye(3)[:, :, None]
"""Columns of the rotation of a point's frame, which is not turned: ``(3, 3, 1)``."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What N measurements are of, as indices into the lists of a model."""

    kind: IntArray  # (N,): into the model's measurements
    tool: IntArray  # (N,): into its tool labels: the point or frame on the tool that was measured
    target: IntArray  # (N,): into its target labels: what it was measured from
    payload: IntArray  # (N,): into the payloads of its compliance
    seen: BoolArray | None = None
    """(N, m): which rows of each were read, where a reading may be a part of what its kind gives:
    the points of a board in a picture. None: all."""
    stop: IntArray | None = None
    """(N,): which stop of the arm each was taken at, from 0 up, where several may be of one:
    pictures of two cameras. None: each is of its own."""
    motion: FloatArray | None = None
    """(N, 2, n): velocity [rad/s] and acceleration [rad/s²] of the joints at each. None: the arm
    stood still."""
    together: int = 1
    """How many that follow each other are of one posture, which is then given once, and make one
    block of it: the reflectors of a tool. Rows that are not seen are zero."""

    @classmethod
    def of(
        cls,
        count: int,
        *,
        kind: ArrayLike = 0,
        tool: ArrayLike = 0,
        target: ArrayLike = 0,
        payload: ArrayLike = 0,
    ) -> Setup:
        """Set-up of ``count`` measurements; one index is that of all, by default the first."""
        named = {"kind": kind, "tool": tool, "target": target, "payload": payload}
        arrays: dict[str, Any] = {}
        for name, given in named.items():
            index = np.asarray(given)
            whole = index.astype(np.intp)
            if not np.array_equal(index, whole):
                raise InputError(f"indices of the {name} are whole numbers", name=name)
            index = np.full(count, whole) if whole.ndim == 0 else whole
            if index.shape != (count,) or (index < 0).any():
                raise InputError(
                    f"{count} measurements need {count} indices of the {name}, from 0 up",
                    name=name,
                )
            arrays[name] = index
        return cls(**arrays)

    @property
    def count(self) -> int:
        """Number of measurements N."""
        return len(self.kind)

    @property
    def stops(self) -> IntArray:
        """Stop of the arm ``(N,)`` that each was taken at."""
        return np.arange(self.count) // self.together if self.stop is None else self.stop

    @property
    def shares_stops(self) -> bool:
        """Return True if several measurements may be of one stop."""
        return self.stop is not None or self.together > 1

    def __getitem__(self, rows: IntArray | BoolArray | slice) -> Setup:
        """Set-up of some of the measurements."""
        seen = None if self.seen is None else self.seen[rows]
        stop = None if self.stop is None else np.unique(self.stop[rows], return_inverse=True)[1]
        motion = None if self.motion is None else self.motion[rows]
        four = (self.kind[rows], self.tool[rows], self.target[rows], self.payload[rows])
        return Setup(*four, seen, stop, motion)


@dataclass(frozen=True, eq=False)
class Feature:
    """A frame, or only a point, that a measurement looks at: on the tool, or around the arm."""

    position: FloatArray  # (3, S) [m], in the tip or in the base frame
    columns: FloatArray | None = None
    """(3, 3, S): columns of its rotation; None for a point, which has the axes of the frame it sits
    in."""


@dataclass
class ArmErrors:
    """How arm and set-up differ from the description at given parameters."""

    joints: FloatArray  # (n, S): added to the joint values [rad]
    displaced: dict[int, FloatArray] = field(default_factory=dict)
    """(6, S) or (6, 1): frames of joints that are not in their places, by joint: shift [m] and
    rotation vector [rad] in the axes of the description, summed over all that displaces them."""
    tools: list[Feature] = field(default_factory=list)
    """What sits on the tip, in the order of the model's tool labels; in the tip frame."""
    targets: list[Feature] = field(default_factory=list)
    """What is measured from, in the order of the model's target labels; in the base frame."""
    lengths: dict[str, FloatArray] = field(default_factory=dict)
    """(S,): what is shown more than the distance from a target, by its label [m]."""
    readings: dict[str, FloatArray] = field(default_factory=dict)
    """(k, S): what an instrument reads by: the values of a lens, say, by its label."""

    def displace(self, joint: int, six: FloatArray) -> None:
        """Displace the frame of a joint by ``(6, S)``, besides what others displace it by."""
        before = self.displaced.get(joint)
        self.displaced[joint] = six if before is None else before + six

    def displacements(self) -> dict[int, Displacement]:
        """The same as the chain takes it."""
        return {
            joint: Displacement(six[:3], rotation_exp(six[3:].T).transpose(1, 2, 0))
            for joint, six in self.displaced.items()
        }


@dataclass(frozen=True, eq=False)
class MeasurementContext:
    """Arm and set-up in given postures, with their errors: all that a block or a kind may need."""

    robot: Robot
    q: FloatArray  # (n, S): joint values as the controller shows them [rad]
    batch: tuple[int, ...]  # leading dimensions of the trials; empty for one set
    setup: Setup  # how each of the N measurements was set up
    tools: tuple[str, ...]
    targets: tuple[str, ...]  # tools, targets: labels that it has indices into
    is_distance: BoolArray
    """(N,): which of them are distances, to which alone an error of a reading's zero matters."""
    errors: ArmErrors  # as applied
    displacements: dict[int, Displacement]  # of the frames of joints
    walk: Walk  # the arm with its errors
    point: FloatArray  # (3, S): tool point in the base frame [m]
    tool: FloatArray  # (3, 3, S): columns of ``R_base_tool``
    origin: FloatArray  # (3, S): origin of the target in the base frame [m]
    target: FloatArray  # (3, 3, S) or (3, 3, 1): columns of ``R_base_target``
    found: dict[Any, Any] = field(default_factory=dict)
    """What kinds of measurement have computed here, for themselves."""

    @property
    def error(self) -> FloatArray:
        """Tool point minus target, ``(3, S)`` [m] in base axes: Eq. 4 of [Watanabe2006]_."""
        return np.asarray(self.point - self.origin)

    def in_target(self, vector: FloatArray) -> FloatArray:
        """Vectors ``(..., 3, S)`` of the base in the axes of the target."""
        return vector if self.target is NO_TURN else turn_back(self.target, vector)

    def out_of_target(self, vector: FloatArray) -> FloatArray:
        """Vectors ``(..., 3, S)`` in the axes of the target in those of the base."""
        return vector if self.target is NO_TURN else turn(self.target, vector)

    def part(self, columns: IntArray, own: IntArray) -> MeasurementContext:
        """The view of some of the S postures: those of the measurements ``own``."""

        def cut(value: Any) -> Any:
            if value is None:
                return None
            if isinstance(value, dict):
                return {key: cut(array) for key, array in value.items()}
            return value if value.shape[-1] == 1 else value[..., columns]

        def cut_of(whole: Any, *names: str) -> dict[str, Any]:
            return {name: cut(getattr(whole, name)) for name in names}

        return replace(
            self,
            setup=self.setup[own],
            is_distance=self.is_distance[own],
            q=self.q[:, columns],
            walk=Walk(*map(cut, self.walk)),
            errors=replace(
                self.errors, **cut_of(self.errors, "joints", "displaced", "lengths", "readings")
            ),
            found={},
            **cut_of(self, "point", "tool", "origin", "target"),
        )

    @property
    def seen_last(self) -> BoolArray | None:
        """Which rows were read, ``(m, S)``; None for all."""
        seen = self.setup.seen
        if seen is None:
            return None
        return np.tile(seen.T, self.q.shape[1] // max(self.setup.count, 1))

    def posture_first(self, array: FloatArray) -> FloatArray:
        """``(..., m, S)`` as ``(*batch, N, m, ...)``: posture first, and parameters last."""
        moved = np.ascontiguousarray(array.T)
        return moved.reshape(*self.batch, self.setup.count, *moved.shape[1:])

    @property
    def tool_points(self) -> FloatArray:
        """Tool points in the base frame, ``(..., N, 3)`` [m]."""
        return self.posture_first(self.point)

    @property
    def T_base_tip(self) -> FloatArray:
        """Poses of the tip with all errors, ``(..., N, 4, 4)``."""
        R = self.posture_first(self.walk.tip)  # (..., N, row, column)
        return transform(R, self.posture_first(self.walk.p_base_tip))

    @property
    def joint_errors(self) -> FloatArray:
        """What the joints turn more than they show, ``(..., N, n)`` [rad]."""
        return self.posture_first(np.broadcast_to(self.errors.joints, self.q.shape))

    def axis(self, joint: int) -> FloatArray:
        """Unit vector ``(3, S)`` along a joint."""
        return self.robot.chain.axes_of(self.walk, joint)

    def frame_axes(self, joint: int) -> FloatArray:
        """Axes ``(3, 3, S)`` about which a joint's frame turns as its rotation vector changes.

        For joints whose frames are displaced.
        """
        turning = right_jacobian(self.errors.displaced[joint][3:].T)
        return product(self.walk.placed[joint], columns_of(turning))

    def frame_origin(self, joint: int) -> FloatArray:
        """Origin ``(3, S)`` [m] of a joint's frame before the joint moves its link."""
        origin: FloatArray = self.walk.origins[joint]
        if not self.robot.sliding[joint]:
            return origin
        return np.asarray(origin - (self.q[joint] + self.errors.joints[joint]) * self.axis(joint))

    def move_joint(self, joint: int, out: FloatArray) -> None:
        """Write the tool's twist, ``(..., 3, S)`` or ``(..., 6, S)``, of a joint's own motion."""
        twists = self.walk.twists
        if twists is not None:
            v, w = twists[joint, :3], twists[joint, 3:]
            out[..., :3, :] = v + cross(w, self.point)
            out[..., 3:, :] = w[..., : out.shape[-2] - 3, :]
        elif not self.robot.sliding[joint]:
            self.turn_about(self.axis(joint), self.walk.origins[joint], out)
        else:
            out[..., :3, :], out[..., 3:, :] = self.axis(joint), 0.0

    def turn_about(self, axis: FloatArray, origin: FloatArray, out: FloatArray) -> None:
        """Write the tool's twist, ``(..., 3, S)`` or ``(..., 6, S)``, of a turn about an axis."""
        out[..., :3, :] = cross(axis, self.point - origin)
        out[..., 3:, :] = axis[..., : out.shape[-2] - 3, :]

    def tiled(self, index: IntArray, label: int) -> FloatArray | None:
        """1 where a measurement has the label in ``index`` (N,), else 0: ``(S,)``; None: all."""
        has = index == label
        if has.all():
            return None
        return np.tile(has.astype(float), self.q.shape[1] // len(index))

    def distance(self) -> tuple[FloatArray, FloatArray]:
        """Distance from target to tool point ``(S,)`` [m] and the direction ``(3, S)``."""
        error = self.error
        length = np.sqrt(along(error, error))
        return length, error / np.maximum(length, np.finfo(float).tiny)
