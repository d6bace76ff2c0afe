"""A cell of solids: an arm, what it carries, what stands around it, and what is in the way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.geometry.enclosure import (
    candidate_pairs,
    check_groups,
    check_names,
    motion_radii,
    reach,
    without_ignored,
)
from calib.geometry.engine import Engine, Placed
from calib.geometry.rays import contains
from calib.geometry.ways import (
    TOUCH_M,
    Clearance,
    Extent,
    LinesOfSight,
    Sight,
    Ways,
    check_ways,
    nearest,
)
from calib.robots import ChainState, SerialChain
from calib.robots.shapes import Body
from calib.se3 import BoolArray, FloatArray, IntArray

CAP_M = 0.5
"""Distances beyond this are not told apart: nobody asks for more room than half a metre."""

_TURNS = 73
"""Angles of the last joint at which a tool is looked at: every 5 deg of a turn."""

_CHUNK_ENTRIES = 50_000
"""Postures times pairs that are held at once: what a cache holds, and 10 MB at most."""

_WAYS = 2
"""Times as many on ways, where most pairs are done with soon."""


class Scene:
    """The bodies of a cell and the pairs of them that must not meet.

    Checked are links of the arm at least two apart (another branch of the tree is apart from the
    first link, too), the tool against all links but the last, and
    obstacles against the tool and the moving links. Pairs of the arm's own bodies that touch in
    the zero posture are left out, since descriptions overlap at the joints, but not those of the
    arm and a positioner beside it; so are a body of the tool and one of the last link but one that
    touch at every angle of the last joint.

    Bodies are solid, closed meshes too. Methods take as ``state`` what ``chain.forward(q)`` gives,
    where it is known already.

    Parameters
    ----------
    arm : sequence of Body
        Solids of the arm, links 0 (the base) to n; as ``robot.bodies``.
    tool : sequence of Body
        What the arm carries: link n, in the frame of the last joint (with the tool given in the
        tip frame, ``chain.T_link_tip @ T_tip_body``).
    obstacles : sequence of Body
        Link 0, in the base frame; of a chain with a positioner, which carries that, on the link
        that stands on the floor, too.
    ignore : sequence of (str, str)
        Names of bodies that may come together, in either order. Several bodies can have the same
        name; all of them are meant.
    zero : array_like (n,), optional
        The zero posture [rad]; zeros by default.
    last_range : (float, float)
        Smallest and largest angle of the last joint [rad]; of more than a turn, the first counts.

    Attributes
    ----------
    bodies : tuple of Body
        Arm, tool and obstacles, in this order.
    pairs : array (P, 2) of int
        The pairs that are checked, as rows of ``bodies``.
    excluded : tuple of (str, str)
        Names of the bodies that are left out because they touch, see above.
    """

    def __init__(
        self,
        chain: SerialChain,
        arm: Sequence[Body] = (),
        *,
        tool: Sequence[Body] = (),
        obstacles: Sequence[Body] = (),
        ignore: Sequence[tuple[str, str]] = (),
        zero: ArrayLike | None = None,
        last_range: tuple[float, float] = (-np.pi, np.pi),
    ) -> None:
        check_groups(chain.n, arm, tool, obstacles, chain.external.positioner)
        self._chain = chain
        self._tool_from = len(arm)
        self._fixed_from = len(arm) + len(tool)
        self.bodies: tuple[Body, ...] = (*arm, *tool, *obstacles)
        names = [body.name for body in self.bodies]
        pairs = without_ignored(candidate_pairs(chain.n, arm, tool, obstacles), names, ignore)
        rest = self._postures(np.zeros(chain.n) if zero is None else zero, "zero")
        if len(rest) != 1:
            raise InputError(
                f"zero has {len(rest)} postures", hint="give one value a joint", name="zero"
            )
        low, high = last_range
        turned = np.repeat(rest, _TURNS, axis=0)
        turned[:, -1] = np.linspace(low, min(high, low + 2.0 * np.pi), _TURNS)
        engine, touching = Engine(self.bodies, pairs), np.zeros(len(pairs), dtype=bool)
        own = (pairs[:, 1] < len(arm)) & ~self._across(pairs)
        for rows, postures in ((own, rest), (self._mounted(pairs), turned)):
            if rows.any():
                some = engine.only(np.flatnonzero(rows))
                touching[rows] = self._touching(some, postures)
        self.pairs: IntArray = pairs[~touching]
        self._engine = engine.only(np.flatnonzero(~touching))
        self.excluded: tuple[tuple[str, str], ...] = tuple(
            dict.fromkeys((names[a], names[b]) for a, b in pairs[touching])
        )

    def __getstate__(self) -> dict[str, object]:
        # coal's objects cannot be sent to a worker, and pairs may change: made anew when needed
        lazy = ("_engine", "_lines", "_radii")
        return {key: value for key, value in self.__dict__.items() if key not in lazy}

    @property
    def own(self) -> Scene:
        """The same bodies, with only the pairs whose distances are the maker's affair.

        Links of the arm, those of a positioner, and the tool with the last link but one: how far
        these two are apart is how the tool is mounted, whatever the posture.
        """
        return self.with_pairs(self.pairs[self._own])

    @property
    def others(self) -> Scene:
        """The same bodies, with only the other pairs, of which one is the tool or an obstacle."""
        return self.with_pairs(self.pairs[~self._own])

    @property
    def _own(self) -> BoolArray:
        arm = (self.pairs[:, 1] < self._tool_from) & ~self._across(self.pairs)
        return arm | self._mounted(self.pairs)

    def _across(self, pairs: IntArray) -> BoolArray:
        """Which pairs (P,) are of a positioner and of the arm beside it: no maker built both."""
        links = np.array([body.link for body in self.bodies], dtype=np.intp)[pairs]
        floor = self._chain.external.positioner
        return np.asarray((links.min(axis=1) < floor) & (links.max(axis=1) > floor))

    def _mounted(self, pairs: IntArray) -> BoolArray:
        """Which pairs (P,) are of the tool and the last link but one."""
        links = np.array([body.link for body in self.bodies], dtype=np.intp)[pairs]
        tool = (pairs[:, 1] >= self._tool_from) & (pairs[:, 1] < self._fixed_from)
        return np.asarray(tool & (links[:, 0] == self._chain.n - 1))

    def with_pairs(self, pairs: IntArray) -> Scene:
        """The same bodies, with these pairs (P, 2)."""
        scene = copy(self)  # without what is made of the pairs, see __getstate__
        scene.pairs = pairs
        return scene

    def names(self, pair: int) -> tuple[str, str]:
        """Names of the two bodies of a pair, a row of ``pairs``."""
        a, b = self.pairs[pair]
        return self.bodies[a].name, self.bodies[b].name

    def clearance(
        self,
        q: ArrayLike,
        *,
        cap_m: float = CAP_M,
        depths: bool = False,
        state: ChainState | None = None,
    ) -> Clearance:
        """How near bodies come to each other at postures ``(S, n)`` [rad].

        Parameters
        ----------
        q : array_like (S, n)
        cap_m : float
            Distances beyond this are not told apart.
        depths : bool
            Say how deep meshes are in what they touch, which takes milliseconds a contact.
        """
        postures = self._postures(q, "q")
        _check_length(cap_m, "cap_m", 1e-9)
        distance = np.empty(len(postures))
        pair = np.empty(len(postures), dtype=np.intp)
        for rows in self._chunks(len(postures)):
            known = self._engine.bounds(self._place(postures, state, rows), far_m=cap_m)
            self._engine.settle(known, 0.0, cap_m)
            if depths:
                self._engine.measure(known)
            distance[rows], pair[rows] = nearest(known.distance_m, cap_m)
        return Clearance(distance, pair)

    def distances(self, q: ArrayLike, cap_m: float) -> FloatArray:
        """Distances ``(S, P)`` of all pairs at postures ``(S, n)`` [m], as far as they are small.

        Those of pairs that touch are negative; those beyond ``cap_m`` are said to be ``cap_m``.
        """
        postures = self._postures(q, "q")
        _check_length(cap_m, "cap_m", 0.0)
        distance = np.empty((len(postures), len(self.pairs)))
        for rows in self._chunks(len(postures)):
            known = self._engine.bounds(self._place(postures, None, rows), far_m=cap_m)
            self._engine.settle_all(known, cap_m)
            distance[rows] = np.minimum(known.distance_m, cap_m)
        return distance

    def ways(
        self, start: ArrayLike, end: ArrayLike, keep_m: ArrayLike, *, cap_m: float = CAP_M
    ) -> Ways:
        """Check straight joint-space ways as a whole, not at samples alone.

        A clear way keeps the distance everywhere, to within
        :data:`~calib.geometry.ways.WAY_TOLERANCE_M`, and touches nothing if the distance is
        :data:`~calib.geometry.ways.TOUCH_M` at least.

        Parameters
        ----------
        start, end : array_like (W, n)
            [rad]
        keep_m : float or array_like (P,)
            Distance that all pairs have to keep, or each of them.
        cap_m : float
            Distances beyond this are not told apart, if it is more than ``keep_m``; of several,
            what each pair has more to spare than the one that keeps most has then.
        """
        starts, ends = self._postures(start, "start"), self._postures(end, "end")
        keep = np.broadcast_to(np.asarray(keep_m, dtype=float), len(self.pairs))
        for value in np.unique(keep_m).tolist():
            _check_length(value, "keep_m", 0.0)
        _check_length(cap_m, "cap_m", 1e-9)
        if len(starts) != len(ends):
            raise InputError(
                f"there are {len(starts)} starts and {len(ends)} ends of ways",
                hint="give one end for each start",
                name="end",
            )
        return check_ways(
            self._chain,
            self._engine,
            self._radii,
            starts,
            ends,
            keep_m=keep,
            cap_m=max(cap_m - keep.max(initial=0.0), 1e-6),
            chunk=_WAYS * self._chunk,
        )

    def sight(
        self,
        q: ArrayLike,
        start: ArrayLike,
        end: ArrayLike,
        *,
        around: ArrayLike = (),
        ignore: Sequence[str] = (),
        state: ChainState | None = None,
    ) -> Sight:
        """Check whether lines of sight are free of all bodies.

        Parameters
        ----------
        q : array_like (S, n) or (n,)
            Postures [rad]; one for all lines, or one a line.
        start, end : array_like (S, 3)
            Ends of each line in the base frame [m]. A line that begins or ends inside a body is
            blocked by it, one that ends on its surface is not. A mesh blocks the lines that
            cross its surface, not those that lie wholly inside.
        around : array_like (K, 3), optional
            From the end of each line to further ends [m]: lines to all of them must be free.
        ignore : sequence of str
            Names of bodies that may be looked through.
        """
        postures = self._postures(q, "q")
        starts, ends = _points(start, "start"), _points(end, "end")
        aside = np.reshape(np.asarray(around, dtype=float), (-1, 3))
        if len(ends) != len(starts) or len(postures) not in (1, len(starts)):
            raise InputError(
                f"there are {len(postures)} postures, {len(starts)} starts and {len(ends)} ends",
                hint="give a posture, a start and an end for each line of sight",
                name="start",
            )
        check_names(ignore, [body.name for body in self.bodies])
        blocker = np.full(len(starts), -1, dtype=np.intp)
        for rows in self._chunks(len(starts), len(self.bodies)):
            of = rows if len(postures) == len(starts) else slice(0, 1)
            placed = self._place(postures, state, of)
            blocker[rows] = self._lines.blockers(placed, starts[rows], ends[rows], aside, ignore)
        return Sight(blocker < 0, blocker)

    def extent(self, q: ArrayLike, *, state: ChainState | None = None) -> Extent:
        """Box around tool and links from the second on, in base axes, at postures ``(S, n)``."""
        postures = self._postures(q, "q")
        lowest = np.full((len(postures), 3), np.inf)
        highest = np.full((len(postures), 3), -np.inf)
        robot = range(self._fixed_from)
        moving = [b for b in robot if b >= self._tool_from or self.bodies[b].link >= 2]
        for rows in self._chunks(len(postures), len(self.bodies)):
            placed = self._place(postures, state, rows)
            for b in moving:
                axes, origin = placed.rotations[:, b], placed.origins[:, b]
                solid, hull = self.bodies[b].solid, self._engine.hulls[b]
                highest[rows] = np.maximum(highest[rows], origin + reach(solid, hull, axes))
                lowest[rows] = np.minimum(lowest[rows], origin - reach(solid, hull, -axes))
        return Extent(lowest, highest)

    def inside(self, points: ArrayLike) -> IntArray:
        """Which obstacle on the base contains each of the points ``(S, 3)`` in its frame [m].

        Returns
        -------
        array (S,) of int
            The first obstacle, a row of ``obstacles`` as they were given; -1: none. Meshes are
            taken to be closed.
        """
        wanted = _points(points, "points")
        found = np.full(len(wanted), -1, dtype=np.intp)
        for row, body in enumerate(self.bodies[self._fixed_from :]):
            if body.link:
                continue
            R, p = body.T_link_body[:3, :3], body.T_link_body[:3, 3]
            free = np.flatnonzero(found < 0)
            found[free[contains(body.solid, (wanted[free] - p) @ R)]] = row
        return found

    def _place(self, q: FloatArray, state: ChainState | None, rows: slice) -> Placed:
        if state is None:
            return self._engine.place(self._chain.forward(q[rows]))
        # a state of one posture may come without the batch
        R = state.rotations.reshape(-1, *state.rotations.shape[-3:])[rows]
        origins = state.origins.reshape(-1, *state.origins.shape[-2:])[rows]
        return self._engine.place(replace(state, rotations=R, origins=origins))

    @cached_property
    def _engine(self) -> Engine:
        return Engine(self.bodies, self.pairs)

    @cached_property
    def _radii(self) -> FloatArray:
        return motion_radii(self._chain, self.bodies, self.pairs)

    @cached_property
    def _lines(self) -> LinesOfSight:
        return LinesOfSight(self.bodies)

    @property
    def _chunk(self) -> int:
        return max(1, _CHUNK_ENTRIES // max(1, len(self.pairs)))

    def _chunks(self, count: int, width: int | None = None) -> Iterator[slice]:
        step = self._chunk if width is None else max(1, _CHUNK_ENTRIES // max(1, width))
        return (slice(first, first + step) for first in range(0, count, step))

    def _touching(self, engine: Engine, postures: FloatArray) -> BoolArray:
        """Which pairs of an engine touch at all of some postures."""
        known = engine.bounds(engine.place(self._chain.forward(postures)))
        engine.settle_all(known, TOUCH_M)
        return np.asarray((known.distance_m < TOUCH_M).all(axis=0))

    def _postures(self, q: ArrayLike, name: str) -> FloatArray:
        postures = np.atleast_2d(np.asarray(q, dtype=float))
        if postures.ndim != 2 or postures.shape[1] != self._chain.n:
            raise InputError(
                f"{name} has shape {np.shape(q)}, the arm has {self._chain.n} joints",
                hint=f"give an array (S, {self._chain.n})",
                name=name,
            )
        if not np.isfinite(postures).all():
            row = int(np.argwhere(~np.isfinite(postures))[0][0])
            raise InputError(
                f"posture {row} of {name} is not finite", hint="give radians", name=name
            )
        return postures


def _points(points: ArrayLike, name: str) -> FloatArray:
    array = np.asarray(points, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
        raise InputError(
            f"{name} has shape {array.shape}, or a value that is not finite",
            hint="give an array (S, 3) of finite values, in metres",
            name=name,
        )
    return array


def _check_length(value_m: float, name: str, smallest_m: float) -> None:
    if not (np.isfinite(value_m) and value_m >= smallest_m):
        raise InputError(
            f"{name} is {value_m}",
            hint="give a finite length in metres that is not negative",
            name=name,
            value=value_m,
        )
