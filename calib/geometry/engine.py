"""Exact distances of many pairs of bodies, posture by posture: bounds first, then coal.

The only importer of coal. Arrays bound every distance from below; coal is asked for a pair only
where its bound is below all that is known exactly.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, assert_never

import coal
import numpy as np
from numpy.typing import NDArray

from calib.geometry.enclosure import (
    enclose,
    hull_vertices,
    is_closed,
    is_convex,
    once_a_mesh,
    polytope_vertices,
    reach,
)
from calib.geometry.rays import box_box_bound, contains, segment_segment
from calib.robots import ChainState
from calib.robots.shapes import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere
from calib.se3 import BoolArray, FloatArray, IntArray, frame_about

CONTACT_M = 1e-6
"""Bodies that are this near touch: coal's distances are not better. Contact is never room: it
counts as a distance below zero of at least this."""

LINE_RADIUS_M = 1e-6
"""coal knows no segments: a line of sight is a capsule as thin as coal's own tolerance."""

_DEPTH_PART, _DEPTH_M = 1e-3, 1e-5
"""Depths are found to within a thousandth, or a hundredth of a millimetre."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Where bodies are: ``rotations (S, B, 3, 3)``, ``origins (S, B, 3)`` [m], from the base."""

    rotations: FloatArray
    origins: FloatArray


@dataclass(eq=False)
class Bounds:
    """What is known of the distances of P pairs at S postures; :class:`Engine` improves it."""

    distance_m: FloatArray
    """(S, P): signed distance, or a lower bound of it. Of meshes that touch it is -CONTACT_M until
    :meth:`Engine.measure` has been asked how deep they do."""
    exact: BoolArray  # (S, P): which of them are distances
    refined: BoolArray  # (S, P): which of the others are the best bound that arrays give
    placed: Placed


class Engine:
    """Distances of pairs ``(P, 2)`` of bodies, by their rows.

    A half-space stands second, and there is at most one in a pair. ``hulls``: vertices ``(K, 3)``
    on the convex hulls of meshes [m].
    """

    def __init__(self, bodies: Sequence[Body], pairs: IntArray) -> None:
        self._bodies = tuple(bodies)
        self._pairs = pairs
        self._links = np.array([body.link for body in bodies], dtype=np.intp)
        placements = np.array([body.T_link_body for body in bodies]).reshape(-1, 4, 4)
        self._rotations, self._origins = placements[:, :3, :3], placements[:, :3, 3]
        self._half_space = np.array([isinstance(b.solid, HalfSpace) for b in bodies], dtype=bool)
        ball = enclose(Sphere(0.0))
        around = [ball if isinstance(b.solid, HalfSpace) else enclose(b.solid) for b in bodies]
        self._centres = np.array([e.centre for e in around]).reshape(-1, 3)
        self._halves = np.array([e.half for e in around]).reshape(-1, 3)
        self._roundings = np.array([e.radius_m for e in around])
        capsules = [e.capsule for e in around]
        self._ends = np.array([end for end, _ in capsules]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in capsules])
        self._balls = np.linalg.norm(self._ends, axis=1) + self._radii
        self.hulls = [hull_vertices(b.solid) if isinstance(b.solid, Mesh) else None for b in bodies]
        against_plane = self._half_space[pairs[:, 1]]
        self._plane_pairs = np.flatnonzero(against_plane)
        own = np.array([isinstance(b.solid, Capsule | Sphere) for b in bodies], dtype=bool)
        mesh = np.array([isinstance(b.solid, Mesh) for b in bodies], dtype=bool)
        self._no_depth = mesh[pairs].any(axis=-1) & ~against_plane
        self._exact = against_plane | own[pairs].all(axis=-1)
        self._oracle = _Oracle(bodies, pairs)
        self._asked = np.arange(len(pairs))  # what the oracle calls them

    def only(self, some: IntArray) -> Engine:
        """The same for some of the pairs, as if there were no others."""
        part = copy(self)
        part._pairs, part._asked = self._pairs[some], self._asked[some]
        part._no_depth, part._exact = self._no_depth[some], self._exact[some]
        part._plane_pairs = np.flatnonzero(self._half_space[part._pairs[:, 1]])
        return part

    def place(self, state: ChainState, done: BoolArray | None = None) -> Placed:
        """Where the bodies are at S states of the chain: all but those of ``done`` pairs (S, P)."""
        S, B = len(state.origins), len(self._links)
        rotations, origins = np.zeros((S, B, 3, 3)), np.zeros((S, B, 3))
        for b in range(B) if done is None else self._left(done):
            link = self._links[b]
            if link == 0:
                rotations[:, b], origins[:, b] = self._rotations[b], self._origins[b]
                continue
            # a product of all rows with one matrix
            R = state.rotations[:, link - 1].reshape(-1, 3)
            rotations[:, b] = (R @ self._rotations[b]).reshape(-1, 3, 3)
            origins[:, b] = (R @ self._origins[b]).reshape(-1, 3) + state.origins[:, link - 1]
        return Placed(rotations, origins)

    def _left(self, done: BoolArray) -> IntArray:
        """Rows of the bodies of pairs that are not done everywhere, of (S, P)."""
        return np.unique(self._pairs[~done.all(axis=0)])

    def bounds(
        self, placed: Placed, done: BoolArray | None = None, far_m: FloatArray | float = np.inf
    ) -> Bounds:
        """Distances at S postures where arrays give them exactly; bounds elsewhere.

        ``done (S, P)``: pairs that are looked at no more, which count as infinitely far.
        ``far_m (S, P)``: pairs that the balls about them keep so far apart get that bound [m].
        """
        (a, b), planes = self._pairs.T, self._half_space[self._pairs[:, 1]]
        distance = np.full((len(placed.origins), len(a)), np.inf)
        if done is None:
            ends, centres = self._within(placed, slice(None))
            exact = np.broadcast_to(planes, distance.shape).copy()
            between = np.sqrt(sum((along[b] - along[a]) ** 2 for along in centres))
            distance[:] = (between - (self._balls[a] + self._balls[b])[:, None]).T
            rows, pairs = np.nonzero((distance < far_m) & ~planes)
        else:
            left = self._left(done)
            ends, centres = self._within(placed, left)
            a, b = np.searchsorted(left, a), np.searchsorted(left, b)  # of others nobody asks
            exact = done | planes
            rows, pairs = np.nonzero(~exact)
            apart = centres[:, b[pairs], rows] - centres[:, a[pairs], rows]
            balls = self._balls[self._pairs].sum(axis=1)
            distance[rows, pairs] = np.sqrt((apart * apart).sum(axis=0)) - balls[pairs]
            near = (distance < far_m)[rows, pairs]
            rows, pairs = rows[near], pairs[near]
        apart = centres[:, b[pairs], rows] - centres[:, a[pairs], rows]
        first, second = (ends[:, of[pairs], rows].T for of in (a, b))
        between = segment_segment(apart.T, first, second)
        distance[rows, pairs] = between - self._radii[self._pairs].sum(axis=1)[pairs]
        exact[rows, pairs] = self._exact[pairs]
        for p in self._plane_pairs:
            some = np.arange(len(distance)) if done is None else np.flatnonzero(~done[:, p])
            if len(some):
                there = Placed(placed.rotations[some], placed.origins[some])
                distance[some, p] = self._above_plane(there, *self._pairs[p])
        return Bounds(distance, exact, exact.copy(), placed)

    def _within(self, placed: Placed, some: IntArray | slice) -> tuple[FloatArray, FloatArray]:
        """Ends and centres (3, K, S) of what encloses some bodies [m]: ends from the centres.

        Posture last, so that whole rows are worked on.
        """
        R = placed.rotations[:, some]
        ends, centres = (
            np.ascontiguousarray((R @ of[some, :, None])[..., 0].transpose(2, 1, 0))
            for of in (self._ends, self._centres)
        )
        centres += placed.origins[:, some].transpose(2, 1, 0)
        return ends, centres

    def settle(
        self,
        known: Bounds,
        beyond: FloatArray | float,
        enough: FloatArray | float,
        *,
        one_will_do: bool = False,
    ) -> None:
        """Improve the bounds, in place, until the smallest of each posture is exact, or enough.

        ``beyond (S, P)``: taken off the distances before they are compared [m]. ``enough (S,)``:
        rows whose smallest value is at least this are not looked at any further [m].
        ``one_will_do``: leave a row, too, when any exact value of it is below ``enough``.
        """
        key = known.distance_m - beyond
        if not key.shape[1]:
            return
        beyond = np.broadcast_to(beyond, key.shape)
        enough = np.broadcast_to(enough, len(key))
        exact = np.where(known.exact, key, np.inf).min(axis=1)
        rows = np.flatnonzero(exact >= enough) if one_will_do else np.arange(len(key))
        # boxes of all pairs that may be the nearest: in one go, where each round costs its calls
        at, pairs = np.nonzero(
            ~known.refined[rows] & (key < np.minimum(exact, enough)[:, None])[rows]
        )
        self._refine(known, rows[at], pairs)
        key[rows[at], pairs] = (known.distance_m - beyond)[rows[at], pairs]
        while len(rows):
            pairs = key[rows].argmin(axis=1)
            open_ = ~known.exact[rows, pairs] & (key[rows, pairs] < enough[rows])
            rows, pairs = rows[open_], pairs[open_]
            if not len(rows):
                return
            self._ask(known, rows, pairs)
            key[rows, pairs] = known.distance_m[rows, pairs] - beyond[rows, pairs]
            if one_will_do:
                rows = rows[key[rows, pairs] >= enough[rows]]

    def settle_all(self, known: Bounds, enough: float) -> None:
        """Improve all bounds until they are exact, or at least large enough [m]."""
        for improve in (self._refine, self._ask):
            improve(known, *np.nonzero(~known.exact & (known.distance_m < enough)))

    def measure(self, known: Bounds) -> None:
        """Replace the contacts of meshes that are known by how deep they are, see `_Oracle.depth`.

        Takes milliseconds a contact: for numbers that somebody reads.
        """
        touching = known.exact & (known.distance_m < 0.0) & self._no_depth
        rows, pairs = np.nonzero(touching)
        places = zip(self._asked[pairs].tolist(), *self._apart(known, rows, pairs), strict=True)
        depths = [self._oracle.depth(pair, R, p) for pair, R, p in places]
        known.distance_m[rows, pairs] = -np.array(depths)

    def _refine(self, known: Bounds, rows: IntArray, pairs: IntArray) -> None:
        """Replace bounds from capsules by bounds from boxes, where these are better."""
        a, b = self._pairs[pairs].T
        R_a, R_b = known.placed.rotations[rows, a], known.placed.rotations[rows, b]
        inverse = np.swapaxes(R_a, -1, -2)
        shift_a = (R_a @ self._centres[a][..., None])[..., 0] + known.placed.origins[rows, a]
        shift_b = (R_b @ self._centres[b][..., None])[..., 0] + known.placed.origins[rows, b]
        apart = (inverse @ (shift_b - shift_a)[..., None])[..., 0]
        bound = box_box_bound(inverse @ R_b, apart, self._halves[a], self._halves[b])
        bound -= self._roundings[a] + self._roundings[b]
        asked = self._asked[pairs]
        fine = np.flatnonzero(self._oracle.is_fine[asked])
        if len(fine):
            there = self._apart(known, rows[fine], pairs[fine])
            bound[fine] = np.maximum(bound[fine], self._oracle.bounds(asked[fine], *there))
        known.distance_m[rows, pairs] = np.maximum(known.distance_m[rows, pairs], bound)
        known.refined[rows, pairs] = True

    def _ask(self, known: Bounds, rows: IntArray, pairs: IntArray) -> None:
        found = self._oracle.distances(self._asked[pairs], *self._apart(known, rows, pairs))
        known.distance_m[rows, pairs] = found
        known.exact[rows, pairs] = True

    def _apart(
        self, known: Bounds, rows: IntArray, pairs: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """The second body of pairs in the axes of the first, (M, 3, 3) and (M, 3) [m]."""
        a, b = self._pairs[pairs].T
        inverse = np.swapaxes(known.placed.rotations[rows, a], -1, -2)
        shift = known.placed.origins[rows, b] - known.placed.origins[rows, a]
        return inverse @ known.placed.rotations[rows, b], (inverse @ shift[..., None])[..., 0]

    def _above_plane(self, placed: Placed, body: int, plane: int) -> FloatArray:
        """Height (S,) of the lowest point of a body above a half-space [m]."""
        normal = placed.rotations[:, plane, :, 2]
        apart = placed.origins[:, body] - placed.origins[:, plane]
        height = (apart * normal).sum(axis=-1)
        down = -(normal[:, None] @ placed.rotations[:, body])[:, 0]
        return np.asarray(height - reach(self._bodies[body].solid, self.hulls[body], down))


class _Oracle:
    """Distances of single pairs by coal, of solids, of which a closed mesh is one."""

    def __init__(self, bodies: Sequence[Body], pairs: IntArray) -> None:
        self._pairs = pairs
        # kept because coal's functors do not own the solids that they were made for
        self._solids = [coal_solid(body.solid) for body in bodies]
        # beside a mesh, round solids are lines or points: the box that coal puts about a thick one
        # has thousands of fine triangles looked at in vain
        beside = [any(isinstance(bodies[i].solid, Mesh) for i in pair) for pair in pairs]
        thin = [_thinned(body.solid) for body in bodies]
        self._thin = [coal_solid(solid) for solid, _ in thin]
        self._off_m = np.array([thin[a][1] + thin[b][1] for a, b in pairs]) * beside
        self._functors = [
            coal.ComputeDistance(*((self._thin if of_mesh else self._solids)[i] for i in pair))
            for of_mesh, pair in zip(beside, pairs, strict=True)
        ]
        # of meshes: that they touch is found hundreds of times as fast as that nothing is nearer
        self._contacts = [
            coal.ComputeCollision(self._solids[a], self._solids[b]) if of_mesh else None
            for of_mesh, (a, b) in zip(beside, pairs, strict=True)
        ]
        fine = [is_fine(body.solid) for body in bodies]
        self._around = [
            _polytope(body.solid) if isinstance(body.solid, Mesh) and of_many else solid
            for body, of_many, solid in zip(bodies, fine, self._solids, strict=True)
        ]
        self.is_fine = np.array([fine[a] or fine[b] for a, b in pairs], dtype=bool)
        self._bounds = [
            coal.ComputeDistance(self._around[a], self._around[b]) if of_many else None
            for of_many, (a, b) in zip(self.is_fine, pairs, strict=True)
        ]
        self._meshes = {
            b: MeshSurface(body.solid)
            for b, body in enumerate(bodies)
            if isinstance(body.solid, Mesh)
        }
        self._is_mesh = np.array([b in self._meshes for b in range(len(bodies))], dtype=bool)
        self._low, self._high = np.full((2, len(bodies), 3), np.nan)  # nothing is within
        for b, surface in self._meshes.items():
            if not isinstance(self._solids[b], coal.ConvexBase):  # of which coal knows the inside
                self._low[b], self._high[b] = surface.low, surface.high
        self._points = np.array([_a_point(body.solid) for body in bodies]).reshape(-1, 3)
        self._request = coal.DistanceRequest()
        self._result = coal.DistanceResult()
        self._touch, self._touches = coal.CollisionRequest(), coal.CollisionResult()

    def bounds(self, pairs: IntArray, R_a_b: FloatArray, p_a_b: FloatArray) -> FloatArray:
        """Lower bounds (M,) [m] of the distances of pairs in which a mesh is fine.

        By polytopes about such meshes, hundreds of times as fast as by their triangles.
        """
        found, here = np.empty(len(pairs)), coal.Transform3s.Identity()
        for m, (pair, there) in enumerate(_places(pairs, R_a_b, p_a_b)):
            self._result.clear()
            found[m] = self._bounds[pair](here, there, self._request, self._result)
        return found - CONTACT_M

    def distances(self, pairs: IntArray, R_a_b: FloatArray, p_a_b: FloatArray) -> FloatArray:
        """Signed distances (M,) [m] of pairs (M,) at (M, 3, 3) and (M, 3).

        Contact is below zero by :data:`CONTACT_M` at least; where one of the two is a mesh, whose
        distance coal gives as zero or as what it met first, by that much.
        """
        found, here = np.empty(len(pairs)), coal.Transform3s.Identity()
        request, result, touch, touches = self._request, self._result, self._touch, self._touches
        for m, (pair, there) in enumerate(_places(pairs, R_a_b, p_a_b)):
            contact = self._contacts[pair]
            if contact is not None:
                touches.clear()
                if contact(here, there, touch, touches):
                    found[m] = 0.0
                    continue
            result.clear()
            found[m] = self._functors[pair](here, there, request, result) - self._off_m[pair]
        found[found <= CONTACT_M] = np.minimum(found[found <= CONTACT_M], -CONTACT_M)
        a, b = self._pairs[pairs].T
        found[(found < 0.0) & (self._is_mesh[a] | self._is_mesh[b])] = -CONTACT_M
        of_b = (R_a_b @ self._points[b, :, None])[..., 0] + p_a_b
        of_a = ((self._points[a] - p_a_b)[:, None] @ R_a_b)[:, 0]
        for outer, points in ((a, of_b), (b, of_a)):
            within = (points > self._low[outer]) & (points < self._high[outer])
            for row in np.flatnonzero(within.all(axis=1) & (found > 0.0)):
                if self._meshes[outer[row]].encloses_far(points[row], found[row]):
                    found[row] = -CONTACT_M
        return found

    def depth(self, pair: int, R_a_b: FloatArray, p_a_b: FloatArray) -> float:
        """How far the second body of a pair that touch would have to be moved to come free [m].

        The shortest of the ways along the edges and diagonals of both bodies' own axes: no less
        than the shortest of all, and that itself where faces along these axes meet.
        """
        ways = np.concatenate([_DIRECTIONS, _DIRECTIONS @ R_a_b.T])
        index = np.array([pair])

        def touch(way: FloatArray, far_m: float) -> bool:
            there = (p_a_b + far_m * way)[None]
            return bool(self.distances(index, R_a_b[None], there)[0] < 0.0)

        depth = _DEPTH_M
        while touch(ways[0], depth):
            depth *= 2.0
        for way in ways:
            if touch(way, (1.0 - _DEPTH_PART) * depth):
                continue  # another is shorter
            low = 0.0
            while depth - low > max(_DEPTH_M, _DEPTH_PART * depth):
                middle = (low + depth) / 2.0
                low, depth = (middle, depth) if touch(way, middle) else (low, middle)
        return depth


class MeshSurface:
    """What lies on either side of a mesh, by coal's tree of its triangles."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.low, self.high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        self._size_m = float(np.linalg.norm(self.high - self.low))
        self._known: deque[tuple[FloatArray, float, bool]] = deque(maxlen=_REMEMBERED)

    def encloses(self, points: FloatArray) -> BoolArray:
        """Whether points (M, 3) [m], in the axes of the mesh, lie in its inside, (M,).

        A point from which a straight line leads out of the mesh does not, be it closed or not.
        """
        inside = np.asarray(((points > self.low) & (points < self.high)).all(axis=-1))
        for way in _DIRECTIONS[:6]:
            rows = np.flatnonzero(inside)
            if not len(rows):
                return inside
            inside[rows] = self.crosses(points[rows], points[rows] + self._size_m * way)
        inside[inside] = contains(self._mesh, points[inside])
        return inside

    @cached_property
    def _closed(self) -> bool:
        return is_closed(self._mesh)

    def encloses_far(self, point: FloatArray, clear_m: float) -> bool:
        """Whether a point (3,), at least that far from the surface [m], lies in its inside.

        All points of a ball that a closed surface does not meet lie on the same side of it.
        """
        for centre, radius, inside in self._known:
            apart = point - centre
            if apart @ apart < max(radius, clear_m) ** 2:
                return inside
        inside = bool(self.encloses(point[None])[0])
        if self._closed:
            self._known.appendleft((point, clear_m, inside))
        return inside

    def crosses(self, start: FloatArray, end: FloatArray) -> BoolArray:
        """Whether segments (M, 3) to (M, 3) [m], in the axes of the mesh, meet it, (M,)."""
        if not len(start):
            return np.zeros(0, dtype=bool)
        solid = _own_polytope(self._mesh)
        if solid is None:
            return _meets(_tree(self._mesh), start, end)
        met = _meets(solid, start, end)
        within = [_meets(solid, ends[met], ends[met]) for ends in (start, end)]
        met[met] = ~np.logical_and(*within)
        return met


def _meets(solid: coal.CollisionGeometry, start: FloatArray, end: FloatArray) -> BoolArray:
    """Whether segments (M, 3) to (M, 3) [m], in the axes of a solid, meet it, (M,)."""
    way = end - start
    length = np.linalg.norm(way, axis=-1)
    z = np.where(length[:, None] > 0.0, way, [0.0, 0.0, 1.0])
    rotations = frame_about(z / np.linalg.norm(z, axis=-1, keepdims=True))
    middles = (start + end) / 2.0
    here, request, result = (
        coal.Transform3s.Identity(),
        coal.CollisionRequest(),
        coal.CollisionResult(),
    )
    met = np.empty(len(start), dtype=bool)
    for m, (l_m, there) in enumerate(_places(length, rotations, middles)):
        result.clear()
        # its round ends must not reach beyond the segment, which may end on the surface
        line = coal.Capsule(LINE_RADIUS_M, max(0.0, l_m - 4.0 * LINE_RADIUS_M))
        met[m] = coal.collide(solid, here, line, there, request, result) > 0
    return met


def _places(
    of: NDArray[Any], rotations: FloatArray, origins: FloatArray
) -> Iterator[tuple[Any, coal.Transform3s]]:
    """Each of (M,) with its placement, in one object of coal's that changes."""
    there = coal.Transform3s.Identity()
    for one, R, p in zip(of.tolist(), rotations, origins, strict=True):
        there.setRotation(R)
        there.setTranslation(p)
        yield one, there


_REMEMBERED = 64
"""Points whose side of a surface is known."""

_STEPS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_STEPS = _STEPS[np.abs(_STEPS).sum(axis=1).argsort(kind="stable")]
_DIRECTIONS = _STEPS / np.linalg.norm(_STEPS, axis=1, keepdims=True)
"""Unit vectors (26, 3) along the edges of a cube, then along the diagonals."""


def coal_solid(solid: Solid) -> coal.CollisionGeometry:
    """A solid as coal has it; a mesh becomes a tree of oriented boxes about its triangles.

    Of a fine one that is convex its polytope is taken: distances to it take a hundredth of the
    time, because they need not look at many triangles that are about as near.
    """
    match solid:
        case Sphere(radius_m=radius):
            return coal.Sphere(radius)
        case Capsule(radius_m=radius, length_m=length):
            return coal.Capsule(radius, length)
        case Cylinder(radius_m=radius, length_m=length):
            return coal.Cylinder(radius, length)
        case Box(size_m=size):
            return coal.Box(*size)
        case HalfSpace():
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        case Mesh():
            return _own_polytope(solid) or _tree(solid)
    assert_never(solid)


_FINE = 2_000
"""Triangles of a mesh from which on a polytope about it saves time."""


def is_fine(solid: Solid) -> bool:
    """Whether a solid is a mesh of so many triangles that distances to it take long."""
    return isinstance(solid, Mesh) and _many(solid) and _own_polytope(solid) is None


def _many(mesh: Mesh) -> bool:
    return len(mesh.triangles) >= _FINE


_MOST_EDGES = 254
"""Edges that may meet in a vertex of a polytope of coal, which refuses 255 of them."""


@once_a_mesh
def _own_polytope(mesh: Mesh) -> coal.ConvexBase | None:
    """A fine convex mesh as the polytope that it is the surface of; None of others.

    None, too, where more edges meet in a vertex than coal can count: the hub of a lid.
    """
    if not (_many(mesh) and is_convex(mesh)):
        return None
    if np.bincount(mesh.triangles.ravel()).max() > _MOST_EDGES:  # as many as triangles, of closed
        return None
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(mesh.vertices))
    triangles.extend([coal.Triangle(*corners) for corners in mesh.triangles.tolist()])
    return coal.Convex(points, triangles)


@once_a_mesh
def _polytope(mesh: Mesh) -> coal.ConvexBase:
    """A polytope of few faces about a mesh."""
    points = coal.StdVec_Vec3s()
    points.extend(list(polytope_vertices(mesh)))
    return coal.ConvexBase.convexHull(points, True, "Qt")


def _thinned(solid: Solid) -> tuple[Solid, float]:
    """A line or point of which a round solid is all that is within a distance, and that [m]."""
    match solid:
        case Sphere(radius_m=radius) if radius > LINE_RADIUS_M:
            return Sphere(LINE_RADIUS_M), radius - LINE_RADIUS_M
        case Capsule(radius_m=radius, length_m=length) if radius > LINE_RADIUS_M:
            return Capsule(LINE_RADIUS_M, length), radius - LINE_RADIUS_M
    return solid, 0.0


def _a_point(solid: Solid) -> FloatArray:
    """A point (3,) of a solid [m]."""
    if isinstance(solid, Mesh):
        return np.asarray(solid.vertices[solid.triangles[0, 0]])
    return np.zeros(3)


@once_a_mesh
def _tree(mesh: Mesh) -> coal.BVHModelOBBRSS:
    """Takes half a kilobyte a triangle."""
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(mesh.triangles), len(mesh.vertices))
    tree.addVertices(np.ascontiguousarray(mesh.vertices, dtype=float))
    tree.addTriangles(np.ascontiguousarray(mesh.triangles, dtype=np.dtype("l")))
    tree.endModel()
    return tree
