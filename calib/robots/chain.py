"""Forward kinematics and Jacobian of a serial chain over arrays of postures.

The kernel of everything that is done in batches: Monte Carlo trials times measuring poses. It
holds plain arrays, taken once from the Pinocchio model, and loops over the joints only.

Inside, the posture is the *last* index, and a joint turns two columns of its link's rotation about
the third: twelve products in long rows, where a 3x3 product for each posture takes 27 in rows of
three. All of it goes element by element, so that a posture gives the same bits in any batch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from calib.se3 import BoolArray, FloatArray, IntArray, frame_about, inverse, transform

_BLOCK = 1024
"""Postures walked at once: what a joint needs of them (100 kB) stays in the cache of a core."""

_EXACT = 1e-15
"""Distance from 0, 1 and -1 within which an element of a constant rotation is just that: a quarter
turn out of a URDF has elements of 6e-17, and multiplying by them costs time and means nothing."""

OUTLYING_M = 1.0
"""Distance beyond the reach of an arm from which the frame of a joint is no part of the arm:
identified and optimised descriptions place frames anywhere along nearly parallel axes."""


@dataclass(frozen=True)
class ExternalAxes:
    """Axes that move a whole arm against the base: the first joints of its chain.

    A rail, a gantry or a lift carries the arm. A positioner carries what is measured, and with it
    the base that everything is seen from: its joints come first, in the order from there to the
    floor, and each moves what is behind it the other way round. Joints of the arm itself that
    slide (the quill of a SCARA, the axes of a Cartesian robot) are told here, too.
    """

    positioner: int = 0  # how many turn: the first ones
    slides: int = 0  # how many slide, behind those
    arm_slides: tuple[int, ...] = ()  # joints of the arm that slide, counted from 0

    @property
    def count(self) -> int:
        """How many there are."""
        return self.positioner + self.slides

    @property
    def sliding(self) -> slice:
        """Which of the joints of a chain are slides that carry the arm."""
        return slice(self.positioner, self.count)

    @property
    def any_slides(self) -> bool:
        """Return True if a joint of the chain slides."""
        return bool(self.slides or self.arm_slides)

    def slides_of(self, n: int) -> BoolArray:
        """Whether each of n joints slides, ``(n,)``."""
        found = np.zeros(n, dtype=bool)
        found[self.sliding] = True
        found[[j for k in self.arm_slides if (j := self.count + k) < n]] = True
        return found

    @property
    def numbers(self) -> tuple[int, ...]:
        """Number of each, counted from 1: what carries the arm, then a positioner from its foot.

        As in descriptions, and as controllers count: the tilt before the turn that is on it.
        """
        slides, turns = self.slides, self.positioner
        return (*range(slides + turns, slides, -1), *range(1, slides + 1))

    def labels(self, n: int) -> tuple[str, ...]:
        """Short names of n joints as controllers give them: E1 .. of these, J1 .. of the arm's."""
        arm = range(1, n - self.count + 1)
        return (*(f"E{k}" for k in self.numbers), *(f"J{k}" for k in arm))

    def behind_arm(self, n: int) -> IntArray:
        """Indices ``(n,)`` of n joints in the order of programs: the arm's, then E1, E2, ..."""
        order = np.argsort(self.numbers, kind="stable")
        return np.concatenate([np.arange(self.count, n), order]).astype(np.intp)


NO_EXTERNAL_AXES = ExternalAxes()


@dataclass(frozen=True, eq=False)
class ChainState:
    """Where every joint and the tip of a chain are, in the base frame."""

    rotations: FloatArray  # (..., n, 3, 3): ``R_base_link`` of the link that each joint moves
    origins: FloatArray  # (..., n, 3): a point on each joint axis [m]
    axes: FloatArray  # (..., n, 3): unit vector of each joint axis
    R_base_tip: FloatArray  # (..., 3, 3)
    p_base_tip: FloatArray  # (..., 3) [m]
    external: ExternalAxes = NO_EXTERNAL_AXES  # which of the joints slide along their axes
    twists: FloatArray | None = None
    """(..., n, 6): velocity at the origin of the base [m per unit] and turn that each joint gives
    the tip; only where joints follow others (:mod:`calib.robots.geared_chain`)."""

    @property
    def T_base_tip(self) -> FloatArray:
        """Pose of the tip, ``(..., 4, 4)``."""
        return transform(self.R_base_tip, self.p_base_tip)

    def point(self, p_tip: FloatArray) -> FloatArray:
        """Points fixed to the tip, ``(..., 3)`` [m] in tip axes, seen from the base."""
        return (self.R_base_tip @ p_tip[..., None])[..., 0] + self.p_base_tip

    def jacobian(self, point: FloatArray) -> FloatArray:
        """Geometric Jacobian ``(..., 6, n)`` of points ``(..., 3)`` [m] of the last link.

        Rows 0 to 2: velocity of the point [m/rad, m/m]; rows 3 to 5: angular velocity; all in base
        axes.
        """
        if self.twists is not None:
            v, w = self.twists[..., :3], self.twists[..., 3:]
            moved = np.concatenate([v + np.cross(w, point[..., None, :]), w], axis=-1)
            return np.swapaxes(moved, -1, -2)
        axes, levers = (
            np.swapaxes(a, -1, -2) for a in (self.axes, point[..., None, :] - self.origins)
        )
        J = np.empty((*axes.shape[:-2], 6, axes.shape[-1]))
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            J[..., k, :] = axes[..., i, :] * levers[..., j, :] - axes[..., j, :] * levers[..., i, :]
        J[..., 3:, :] = axes
        if self.external.any_slides:
            slides = self.external.slides_of(axes.shape[-1])
            J[..., :3, slides] = axes[..., slides]
            J[..., 3:, slides] = 0.0
        return J


class Walk(NamedTuple):
    """A chain at S postures, in base axes, the posture last."""

    columns: FloatArray
    """(n, 3, 3, S): the three columns, then their rows, of the rotation of a frame on each joint
    that turns with it: of ``R_base_link`` where the joint axis is an axis of the link's frame."""
    origins: FloatArray  # (n, 3, S): a point on each axis [m], where the frame of its link sits
    tip: FloatArray  # (3, 3, S): columns, then rows, of ``R_base_tip``
    p_base_tip: FloatArray  # (3, S) [m]
    placed: dict[int, FloatArray]
    """(3, 3, S), for each joint whose placement is displaced: columns, then rows, of the rotation
    of its frame before the joint turns it, in the axes of the description."""
    twists: FloatArray | None = None  # (n, 6, S): as :class:`ChainState` has them


class Displacement(NamedTuple):
    """How the frame of a joint sits off its place, in its own axes as described."""

    translation: FloatArray  # (3, S) or (3, 1) [m]
    rotation: FloatArray  # (3, 3, S) or (3, 3, 1): rows, then columns


_TWO = slice(1, 3), slice(2, None, -2), slice(0, 2)
"""The two columns that turn about each, in right-handed order."""

_Terms = list[list[tuple[int, float]]]


@dataclass(frozen=True, eq=False)
class Joint:
    """Constants of one joint, in frames of which it turns columns a and b about column k."""

    fixed: FloatArray  # (3, 3): from the frame of the joint before to this one at zero
    steps: list[tuple[int, float]]  # column of the frame before and distance along it [m]
    turning: tuple[int, int, int]  # a, b, k: right-handed
    way: float  # 1 or -1: turns as the column k, or against it
    to_link: FloatArray | None  # (3, 3) from that frame to the link's own, where it is another

    @cached_property
    def fixed_terms(self) -> _Terms:
        """See :func:`_terms`."""
        return _terms(self.fixed)


@dataclass(frozen=True, eq=False)
class SerialChain:
    """n joints in a row: external axes, then those of the arm.

    External axes move all of the arm against the base, so that what is known of the arm (its
    branches, its controller's view) holds wherever they are.
    """

    placements: FloatArray
    """(n, 4, 4): frame of each joint at zero, in that of the link before it (first: the base)."""
    axes: FloatArray  # (n, 3): unit vector of each joint axis in its own frame
    T_link_tip: FloatArray  # (4, 4): the tip in the frame of the last link
    external: ExternalAxes = NO_EXTERNAL_AXES
    """What moves the arm, and which joints of the arm slide: values of slides are in metres where
    those of others are in radians."""
    strokes_m: tuple[float, ...] = ()
    """Largest distance [m] of each of ``external.arm_slides`` from its zero, by its limits."""

    @cached_property
    def arm(self) -> SerialChain:
        """The arm, on external axes that rest at zero; the chain itself where there are none."""
        count = self.external.count
        if not count:
            return self
        first = np.eye(4)
        for placement in self.placements[: count + 1]:
            first = first @ placement
        placements = np.concatenate([first[None], self.placements[count + 1 :]])
        own = ExternalAxes(arm_slides=self.external.arm_slides)
        return SerialChain(placements, self.axes[count:], self.T_link_tip, own, self.strokes_m)

    def at_rest(self, T_base: FloatArray, external: FloatArray) -> FloatArray:
        """Poses ``(..., 4, 4)`` as :attr:`arm` sees them, of external axes at ``(..., count)``.

        An arm that has gone along sees a pose come back by as much.
        """
        count = self.external.count
        carrier = SerialChain(self.placements[:count], self.axes[:count], np.eye(4), self.external)
        at_zero = carrier.forward(np.zeros(count)).T_base_tip
        return np.asarray(at_zero @ inverse(carrier.forward(external).T_base_tip) @ T_base)

    @cached_property
    def _near_points(self) -> tuple[FloatArray, FloatArray]:
        """A point on each axis from the second turning one (or the only one) on.

        ``(K + 1, 3)`` [m], the tip last, with all joints at zero; and how far each is along its
        axis from the origin of the joint's frame, ``(K,)`` [m]. Each point is the nearest of its
        axis to the point before it; the first is found by the same steps from the tip. Descriptions
        may have the frame of a joint anywhere along its axis, far outside the arm even. These
        points do not depend on it.
        """
        first = min(self.external.count + 1, self.n - 1)
        origins, axes, T = [], [], np.eye(4)
        for j in range(first, self.n):
            T = T @ self.placements[j] if j > first else T
            origins.append(T[:3, 3])
            axes.append(T[:3, :3] @ self.axes[j])
        at = tip = (T @ self.T_link_tip)[:3, 3]
        lines = list(zip(origins, axes, strict=True))
        for origin, axis in reversed(lines):
            at = origin + axis * (axis @ (at - origin))
        points, along = [], []
        for origin, axis in lines:
            along.append(float(axis @ (at - origin)))
            at = origin + axis * along[-1]
            points.append(at)
        return np.array([*points, tip]), np.array(along)

    @cached_property
    def reach_m(self) -> float:
        """Length of the stretched arm from its second turning axis to the tip, an upper bound.

        The sum of the shortest steps from axis to axis, and of how far its own slides go: where
        along its axis the frame of a joint is described changes nothing.
        """
        points, _ = self._near_points
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return float(steps.sum()) + sum(self.strokes_m)

    @cached_property
    def outlying(self) -> FloatArray:
        """Shift ``(n,)`` [m] of each joint's frame along its axis that brings it to the arm.

        Zero where it is nearer than the reach and :data:`OUTLYING_M`. Zero for the first turning
        joint.
        """
        _, along = self._near_points
        out = np.zeros(self.n)
        out[self.n - len(along) :] = np.where(np.abs(along) > self.reach_m + OUTLYING_M, along, 0.0)
        return out

    def smallest_singular_values(self, state: ChainState) -> FloatArray:
        """How far states ``(S, ...)`` are from a singularity, ``(S,)``: zero is in one.

        The smallest singular value of the tip's Jacobian by the joints of the arm, its linear rows
        divided by the reach. What slides moves in parts of the reach, too.
        """
        J = state.jacobian(state.p_base_tip)[..., self.external.count :]
        size = self.reach_m if self.reach_m > 0 else 1.0
        J[..., :3, :] /= size
        if self.external.arm_slides:
            J[..., :3, list(self.external.arm_slides)] *= size
        return np.asarray(np.linalg.svd(J, compute_uv=False)[..., -1])

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axes)

    @cached_property
    def _joints(self) -> list[Joint]:
        joints, before = [], np.eye(3)
        for placement, axis in zip(self.placements, self.axes, strict=True):
            k = int(np.argmax(np.abs(axis)))
            along = float(np.abs(np.delete(axis, k)).max()) < _EXACT
            turned = np.eye(3) if along else frame_about(axis)
            joints.append(
                Joint(
                    fixed=_exact(before.T @ placement[:3, :3] @ turned),
                    steps=_steps(before.T @ placement[:3, 3]),
                    turning=((k + 1) % 3, (k + 2) % 3, k) if along else (0, 1, 2),
                    way=float(np.sign(axis[k])) if along else 1.0,
                    to_link=None if along else turned.T,
                )
            )
            before = turned
        return joints

    @cached_property
    def _slides(self) -> list[bool]:
        slides: list[bool] = self.external.slides_of(self.n).tolist()
        return slides

    @cached_property
    def _mount(self) -> tuple[_Terms, list[tuple[int, float]]]:
        """The tip in the frame that the last joint turns: rotation, and steps along its columns."""
        to_link, T = self._joints[-1].to_link, self.T_link_tip
        R = np.eye(3) if to_link is None else to_link
        return _terms(_exact(R @ T[:3, :3])), _steps(R @ T[:3, 3])

    def walk(
        self, q: FloatArray, displaced: Mapping[int, Displacement] = MappingProxyType({})
    ) -> Walk:
        """Go from the base to the tip at postures ``(n, S)`` [rad, m], C-contiguous is fastest.

        ``displaced``: joints whose frames are not where the description has them.
        """
        count = q.shape[1]
        sines, cosines = np.sin(q), np.cos(q)
        if count == 1 and not displaced and not self.external.any_slides:
            return self._walk_one(sines[:, 0].tolist(), cosines[:, 0].tolist())
        columns, origins = np.empty((self.n, 3, 3, count)), np.empty((self.n, 3, count))
        before = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, count))
        origin, spare = np.zeros((3, count)), np.empty((2, 3, count))
        placed = {}
        slides = self._slides
        for j, joint in enumerate(self._joints):
            origin = _moved(origin, before, joint.steps, origins[j])
            a, b, k = joint.turning
            at_zero = _turned_by(before, joint.fixed_terms)
            if j in displaced:
                own = at_zero if joint.to_link is None else _turned(at_zero, joint.to_link)
                origin = _moved_along(origin, own, displaced[j].translation, origins[j])
                placed[j] = own = _product(own, displaced[j].rotation)
                at_zero = own if joint.to_link is None else _turned(own, joint.to_link.T)
            here = columns[j]
            if slides[j]:
                here[:] = at_zero
                origin = np.add(origin, joint.way * q[j] * at_zero[k], out=origins[j])
                before = here
                continue
            s = sines[j] if joint.way > 0 else -sines[j]
            both = _TWO[k]
            np.multiply(cosines[j], at_zero[both], out=here[both])
            np.multiply(s, at_zero[both], out=spare)
            here[a] += spare[1]
            here[b] -= spare[0]
            here[k] = at_zero[k]
            before = here
        terms, steps = self._mount
        p_base_tip = _moved(origin, before, steps, np.empty((3, count)))
        return Walk(columns, origins, _turned_by(before, terms), p_base_tip, placed)

    def _walk_one(self, sines: list[float], cosines: list[float]) -> Walk:
        """The same of one posture, number by number: the same products in the same order.

        An array of one number takes as long as one of a hundred.
        """
        before: list[_Vector] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        origin: _Vector = (0.0, 0.0, 0.0)
        columns, origins = [], []
        for joint, sine, cosine in zip(self._joints, sines, cosines, strict=True):
            origin = _moved_one(origin, before, joint.steps)
            a, b, _ = joint.turning
            at_zero = _turned_one(before, joint.fixed_terms)
            s = sine if joint.way > 0 else -sine
            (ax, ay, az), (bx, by, bz) = at_zero[a], at_zero[b]
            before = at_zero.copy()
            before[a] = cosine * ax + s * bx, cosine * ay + s * by, cosine * az + s * bz
            before[b] = cosine * bx - s * ax, cosine * by - s * ay, cosine * bz - s * az
            columns.append(before)
            origins.append(origin)
        terms, steps = self._mount
        tip, p_base_tip = _turned_one(before, terms), _moved_one(origin, before, steps)
        columns_, origins_, tip_, p_ = (
            np.array(part)[..., None] for part in (columns, origins, tip, p_base_tip)
        )
        return Walk(columns_, origins_, tip_, p_, {})

    def axes_of(self, walk: Walk, joint: int) -> FloatArray:
        """Unit vectors ``(3, S)`` of one joint axis."""
        turning, ways = self._ways
        return np.asarray(walk.columns[joint, turning[joint]] * ways[joint])

    @cached_property
    def _ways(self) -> tuple[IntArray, FloatArray]:
        """Of each joint the column that it turns about, and whether as that or against it."""
        ways = np.array([joint.way for joint in self._joints])
        return np.array([joint.turning[2] for joint in self._joints]), ways[:, None, None]

    def all_axes(self, walk: Walk) -> FloatArray:
        """Unit vectors ``(n, 3, S)`` of the joint axes."""
        turning, ways = self._ways
        return np.asarray(walk.columns[np.arange(self.n), turning] * ways)

    def tip_jacobian(self, walk: Walk) -> FloatArray:
        """Geometric Jacobian ``(6, n, S)`` of the tip: as :meth:`ChainState.jacobian` of it."""
        if walk.twists is not None:
            return twists_at(walk.twists, walk.p_base_tip).transpose(1, 0, 2)
        axes, levers = self.all_axes(walk), walk.p_base_tip - walk.origins
        J = np.empty((6, *axes.shape[::2]))
        for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            np.multiply(axes[:, i], levers[:, j], out=J[k])
            J[k] -= axes[:, j] * levers[:, i]
        J[3:] = axes.transpose(1, 0, 2)
        if self.external.any_slides:
            slides = self.external.slides_of(self.n)
            J[:3, slides], J[3:, slides] = J[3:, slides], 0.0
        return J

    def in_base(self, walk: Walk, points: FloatArray) -> FloatArray:
        """Points ``(n, 3)`` [m], one of each link and in its frame: ``(n, 3, S)`` in the base."""
        own = [
            p if joint.to_link is None else joint.to_link @ p
            for joint, p in zip(self._joints, points, strict=True)
        ]
        levers = np.array(own)[:, None] @ walk.columns.reshape(self.n, 3, -1)
        return np.asarray(walk.origins + levers.reshape(walk.origins.shape))

    def link_columns(self, walk: Walk, joint: int) -> FloatArray:
        """Columns, then rows, ``(3, 3, S)`` of ``R_base_link`` of the link that a joint moves."""
        to_link, columns = self._joints[joint].to_link, walk.columns[joint]
        return columns if to_link is None else _turned(columns, to_link)

    def forward(self, q: FloatArray) -> ChainState:
        """State of the chain at postures ``(..., n)`` [rad, m]."""
        batch, n = q.shape[:-1], self.n
        q = q.reshape(-1, n)
        count = len(q)
        rotations, origins, axes = (np.empty((count, n, *s)) for s in ((3, 3), (3,), (3,)))
        twists: list[FloatArray] = []
        R_base_tip, p_base_tip = np.empty((count, 3, 3)), np.empty((count, 3))
        for start in range(0, count, _BLOCK):
            part = slice(start, start + _BLOCK)
            walk = self.walk(np.ascontiguousarray(q[part].T))
            axes[part] = self.all_axes(walk).transpose(2, 0, 1)
            # first: the tip may share its numbers with the frame of the last joint
            R_base_tip[part], p_base_tip[part] = walk.tip.transpose(2, 1, 0), walk.p_base_tip.T
            for j, joint in enumerate(self._joints):
                if joint.to_link is not None:
                    walk.columns[j] = self.link_columns(walk, j)
            if walk.twists is not None:
                twists.append(walk.twists.transpose(2, 0, 1))
            rotations[part] = walk.columns.transpose(3, 0, 2, 1)
            origins[part] = walk.origins.transpose(2, 0, 1)
        return ChainState(
            rotations=rotations.reshape(*batch, n, 3, 3),
            origins=origins.reshape(*batch, n, 3),
            axes=axes.reshape(*batch, n, 3),
            R_base_tip=R_base_tip.reshape(*batch, 3, 3),
            p_base_tip=p_base_tip.reshape(*batch, 3),
            external=self.external,
            twists=np.concatenate(twists).reshape(*batch, n, 6) if twists else None,
        )


def twists_at(twists: FloatArray, points: FloatArray) -> FloatArray:
    """Return velocities and turns ``(n, 6, S)`` of points ``(3, S)`` [m] by twists at the base."""
    v, w = twists[:, :3], twists[:, 3:]
    x, y, z = points
    a, b, c = w.transpose(1, 0, 2)
    swept = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)
    return np.concatenate([v + swept, w], axis=1)


def _exact(R: FloatArray) -> FloatArray:
    whole = np.round(R)
    return np.where(np.abs(R - whole) < _EXACT, whole, R)


def _steps(p: FloatArray) -> list[tuple[int, float]]:
    return [(k, value) for k, value in enumerate(p.tolist()) if value]


def _moved(
    origin: FloatArray, columns: FloatArray, steps: list[tuple[int, float]], out: FloatArray
) -> FloatArray:
    """A point moved along columns ``(3, 3, S)``, written to ``out`` (3, S)."""
    if not steps:
        out[...] = origin
    for k, distance in steps:
        np.add(origin, distance * columns[k], out=out)
        origin = out
    return out


def _turned(columns: FloatArray, R: FloatArray) -> FloatArray:
    """Columns ``(3, 3, S)`` of the product with a constant rotation, sparing noughts and ones."""
    return _turned_by(columns, _terms(R))


def _turned_by(columns: FloatArray, terms: _Terms) -> FloatArray:
    """As :func:`_turned`, by the terms of the rotation."""
    if terms == _NO_TURN:
        return columns
    out = np.empty(columns.shape)
    for k, ((i, weight), *more) in enumerate(terms):
        np.multiply(weight, columns[i], out=out[k])
        for i, weight in more:
            out[k] += weight * columns[i]
    return out


_Vector = tuple[float, float, float]


def _terms(R: FloatArray) -> _Terms:
    """Of each column of a constant rotation, its rows and numbers that are not nought."""
    return [[(i, w) for i, w in enumerate(column) if w] for column in R.T.tolist()]


def _turned_one(columns: list[_Vector], terms: _Terms) -> list[_Vector]:
    """As :func:`_turned`, of one posture."""
    out = []
    for (i, w), *more in terms:
        x, y, z = columns[i]
        x, y, z = w * x, w * y, w * z
        for i, w in more:
            c = columns[i]
            x, y, z = x + w * c[0], y + w * c[1], z + w * c[2]
        out.append((x, y, z))
    return out


def _moved_one(origin: _Vector, columns: list[_Vector], steps: list[tuple[int, float]]) -> _Vector:
    """As :func:`_moved`, of one posture."""
    for k, distance in steps:
        (x, y, z), c = origin, columns[k]
        origin = x + distance * c[0], y + distance * c[1], z + distance * c[2]
    return origin


def _moved_along(
    origin: FloatArray, columns: FloatArray, translation: FloatArray, out: FloatArray
) -> FloatArray:
    """A point ``(3, S)`` moved by ``(3, S)`` in the axes that are columns; written to ``out``."""
    for k in range(3):
        origin = np.add(origin, columns[k] * translation[k], out=out)
    return out


def _product(columns: FloatArray, R: FloatArray) -> FloatArray:
    """Columns ``(3, 3, S)`` of the product with rotations ``(3, 3, S)``, rows then columns."""
    out = columns[0] * R[0, :, None]
    out += columns[1] * R[1, :, None]
    out += columns[2] * R[2, :, None]
    return np.asarray(out)


_NO_TURN = _terms(np.eye(3))


SLIGHT_M = 5e-3
"""Length that a description is taken to mean as none [m]: arms are built off by some tenths of a
millimetre, rarely by a few."""
