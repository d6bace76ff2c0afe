"""What encloses a solid: few numbers from which distances are bounded without an engine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar, assert_never
from weakref import WeakKeyDictionary

import numpy as np

from calib.errors import InputError, near_names
from calib.robots import SerialChain
from calib.robots.geared_chain import GearedChain
from calib.robots.shapes import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere
from calib.se3 import FloatArray, IntArray, check_transforms

_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A box with rounded edges about a solid, in the axes of the solid.

    A ball, a capsule and a box are their own enclosure.
    """

    centre: FloatArray  # (3,) [m]
    half: FloatArray  # (3,): half of the edges of the box, before it is rounded [m]
    radius_m: float  # how far the rounding reaches beyond the box

    @property
    def corners(self) -> FloatArray:
        """Corners ``(8, 3)`` of the box before it is rounded [m]; some fall together."""
        return np.asarray(self.centre + _SIGNS * self.half)

    @property
    def capsule(self) -> tuple[FloatArray, float]:
        """The capsule along the longest edge: from the centre to one end ``(3,)``; radius [m]."""
        longest = int(np.argmax(self.half))
        end = np.zeros(3)
        end[longest] = self.half[longest]
        return end, float(np.linalg.norm(np.delete(self.half, longest))) + self.radius_m


def enclose(solid: Solid) -> Enclosure:
    """Enclosure of a bounded solid."""
    centre = np.zeros(3)
    match solid:
        case Sphere(radius_m=radius):
            return Enclosure(centre, np.zeros(3), radius)
        case Capsule(radius_m=radius, length_m=length):
            return Enclosure(centre, np.array([0.0, 0.0, length / 2.0]), radius)
        case Cylinder(radius_m=radius, length_m=length):
            return Enclosure(centre, np.array([radius, radius, length / 2.0]), 0.0)
        case Box(size_m=size):
            return Enclosure(centre, np.array(size) / 2.0, 0.0)
        case Mesh():
            low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
            return Enclosure((low + high) / 2.0, (high - low) / 2.0, 0.0)
        case HalfSpace():
            raise InputError("a half-space is not bounded", hint="use it as an obstacle only")
    assert_never(solid)


def outer_points(solid: Solid) -> tuple[FloatArray, float]:
    """Points ``(K, 3)`` [m] and a radius [m]: their convex hull, grown by it, holds the solid."""
    if isinstance(solid, Mesh):
        return hull_vertices(solid), 0.0
    around = enclose(solid)
    return around.corners, around.radius_m


Made = TypeVar("Made")


def once_a_mesh(make: Callable[[Mesh], Made]) -> Callable[[Mesh], Made]:
    """Remember what is made of a mesh, whoever asks, for as long as there is the mesh."""
    known: WeakKeyDictionary[Mesh, Made] = WeakKeyDictionary()

    def made(mesh: Mesh) -> Made:
        if mesh not in known:
            known[mesh] = make(mesh)
        return known[mesh]

    return made


def hull_vertices(mesh: Mesh) -> FloatArray:
    """The vertices ``(K, 3)`` [m] of a mesh that lie on its convex hull."""
    return _hull(mesh)[0]


@once_a_mesh
def _hull(mesh: Mesh) -> tuple[FloatArray, float]:
    """Vertices ``(K, 3)`` [m] of the convex hull of a mesh, and its volume [m³]."""
    from scipy.spatial import ConvexHull, QhullError

    vertices, volume = mesh.vertices[np.unique(mesh.triangles)], 0.0
    with suppress(QhullError):  # all in a plane
        hull = ConvexHull(vertices)
        vertices, volume = vertices[hull.vertices], float(hull.volume)
    return vertices, volume


_SAME_VOLUME = 1e-6
"""Share by which the volume inside a surface may differ from its hull's. Where the hull is taken
for it, nothing comes nearer than is told, since the hull holds all of it."""


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge of a triangle is one of another, the other way round."""
    start, end = mesh.triangles.T, np.roll(mesh.triangles, -1, axis=1).T
    count = len(mesh.vertices)
    there, back = np.sort((start * count + end).ravel()), np.sort((end * count + start).ravel())
    return bool((there == back).all() and (np.diff(there) > 0).all())


def is_convex(mesh: Mesh) -> bool:
    """Whether a mesh is the closed surface of its convex hull."""
    if not is_closed(mesh):
        return False
    hull = _hull(mesh)[1]
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles] - mesh.vertices.mean(axis=0), 1, 0)
    inside = float(np.einsum("fk,fk->", a, np.cross(b, c))) / 6.0
    return hull > 0.0 and abs(abs(inside) - hull) <= _SAME_VOLUME * hull


_FACES = 2
"""Of the polytope about a mesh: 162 directions, 20 degrees apart."""

_SLACK_M = 1e-6
"""By which the polytope is larger: a flat mesh has one, too, and rounding takes nothing off."""


def polytope_vertices(mesh: Mesh) -> FloatArray:
    """Vertices ``(K, 3)`` [m], some hundreds, of a convex polytope that holds a mesh."""
    from scipy.spatial import HalfspaceIntersection
    from trimesh.creation import icosphere

    normals = np.asarray(icosphere(_FACES).vertices)
    hull = hull_vertices(mesh)
    heights = np.array([(hull @ normal).max() for normal in normals]) + _SLACK_M
    planes = np.column_stack([normals, -heights])
    return np.asarray(HalfspaceIntersection(planes, hull.mean(axis=0)).intersections)


def reach(solid: Solid, hull: FloatArray | None, direction: FloatArray) -> FloatArray:
    """How far a solid reaches in unit directions ``(..., 3)``, its support function: ``(...)`` [m].

    Exactly; of all but half-spaces, a mesh by its :func:`hull_vertices` where these are known.
    """
    if isinstance(solid, Cylinder):
        along = direction[..., 2]
        across = np.hypot(direction[..., 0], direction[..., 1])
        return np.asarray(np.abs(along) * (solid.length_m / 2.0) + across * solid.radius_m)
    if isinstance(solid, Mesh):
        points = hull_vertices(solid) if hull is None else hull
        return np.asarray((direction @ points.T).max(axis=-1))
    around = enclose(solid)
    return np.asarray(direction @ around.centre + np.abs(direction) @ around.half + around.radius_m)


def check_body(body: Body) -> None:
    """Raise :class:`InputError` for a placement that is not rigid or a size that is not one."""
    check_transforms(body.T_link_body, f"T_link_body of {body.name}")
    solid = body.solid
    if isinstance(solid, Mesh):
        _check_mesh(body.name, solid)
        return
    for name, value in vars(solid).items():
        sizes = np.atleast_1d(np.asarray(value, dtype=float))
        # a capsule without a length is a ball
        smallest = 0.0 if isinstance(solid, Capsule) and name == "length_m" else 1e-9
        if not (np.isfinite(sizes).all() and (sizes >= smallest).all()):
            raise InputError(
                f"{body.name}: {name} of the {type(solid).__name__.lower()} is {value}",
                hint="sizes are finite and above zero, in metres",
                name=name,
                value=value,
            )


def _check_mesh(name: str, mesh: Mesh) -> None:
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if vertices.ndim != 2 or vertices.shape[-1] != 3 or triangles.shape[1:] != (3,):
        what = f"vertices of shape {vertices.shape} and triangles of shape {triangles.shape}"
        raise InputError(f"{name}: the mesh has {what}", hint="give (V, 3) and (F, 3)", name=name)
    if not len(triangles):
        raise InputError(f"{name}: the mesh has no triangles", name=name)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        worst = int(triangles.min() if triangles.min() < 0 else triangles.max())
        raise InputError(
            f"{name}: a triangle of the mesh names vertex {worst} of {len(vertices)}",
            hint="vertices are counted from zero",
            name=name,
            value=worst,
        )
    if not np.isfinite(vertices).all():
        raise InputError(f"{name}: a vertex of the mesh is not finite", name=name)


def check_groups(
    n: int, arm: Sequence[Body], tool: Sequence[Body], obstacles: Sequence[Body], floor: int = 0
) -> None:
    """Raise :class:`InputError` for a body that is not where its group is, or not usable.

    ``floor``: number of the link that obstacles stand on that are not on the base.
    """
    for body in (*arm, *tool, *obstacles):
        check_body(body)
    for body in (*arm, *tool):
        if isinstance(body.solid, HalfSpace):
            raise InputError(
                f"{body.name} is a half-space and belongs to the robot",
                hint="only obstacles can be half-spaces",
                name=body.name,
            )
    for body in arm:
        if not 0 <= body.link <= n:
            raise InputError(
                f"{body.name} is on link {body.link} of an arm of {n} joints",
                hint=f"links are counted from 0 (the base) to {n}",
                name=body.name,
                value=body.link,
                bound=n,
            )
    for group, links, bodies in (("tool", (n,), tool), ("obstacle", (0, floor), obstacles)):
        for body in bodies:
            if body.link not in links:
                allowed = " or ".join(dict.fromkeys(map(str, links)))
                raise InputError(
                    f"{group} {body.name} is on link {body.link}",
                    hint=f"a body of this group is on link {allowed}",
                    name=body.name,
                    value=body.link,
                    bound=links[-1],
                )


def candidate_pairs(
    n: int, arm: Sequence[Body], tool: Sequence[Body], obstacles: Sequence[Body]
) -> IntArray:
    """Pairs ``(P, 2)`` of rows of arm, tool and obstacles in a row that can come together.

    Neighbouring links touch at their joint and are left out, so is the tool against the last link,
    which carries it, and what stands still against each other: obstacles against the link that
    they are on. Another branch of the tree is no neighbour of the first link, and of what stands on
    the floor only its own foot is a neighbour of a positioner. What stands second in a pair with a
    half-space is that.
    """

    def can_meet(a: Body, b: Body) -> bool:
        near, far = sorted((a, b), key=lambda body: body.link)
        apart = far.link - near.link
        return apart >= 2 or (apart == 1 and (near.of_other_branch or far.beside_positioner))

    arms = list(enumerate(arm))
    tools = [len(arm) + i for i in range(len(tool))]
    fixed = [len(arm) + len(tool) + i for i in range(len(obstacles))]
    pairs = [(i, k) for i, a in arms for k, b in arms[i + 1 :] if can_meet(a, b)]
    pairs += [(i, t) for t in tools for i, a in arms if a.link < n]
    around = list(zip(fixed, obstacles, strict=True))
    pairs += [(i, o) for o, body in around for i, a in arms if a.link != body.link]
    pairs += [(t, o) for o in fixed for t in tools]
    carried = [(o, body) for o, body in around if not isinstance(body.solid, HalfSpace)]
    pairs += [(c, o) for c, a in carried for o, b in around if a.link == 0 != b.link]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def check_names(ignored: Iterable[str], names: Sequence[str]) -> None:
    """Refuse to ignore what is not there."""
    for name in ignored:
        if name not in names:
            hint = near_names(name, dict.fromkeys(names))
            raise InputError(f"there is no body {name!r} to ignore", hint=hint, name=name)


def without_ignored(
    pairs: IntArray, names: Sequence[str], ignore: Sequence[tuple[str, str]]
) -> IntArray:
    """Leave out the pairs whose names are ignored, in either order."""
    check_names(itertools.chain.from_iterable(ignore), names)
    gone = {frozenset(pair) for pair in ignore}
    kept = [frozenset((names[a], names[b])) not in gone for a, b in pairs]
    return np.asarray(pairs[np.array(kept, dtype=bool)])


def motion_radii(chain: SerialChain, bodies: Sequence[Body], pairs: IntArray) -> FloatArray:
    """How fast joints can change distances of pairs ``(P, 2)`` at most, ``(P, n)`` [m/rad].

    A joint between the two links changes the distance no faster than it moves the one body seen
    from the other: by the largest distance of that body from the joint's axis. Either of the two
    may be taken to be the moving one, because the closest points of both lie on the line along
    which the distance changes. Largest distances are added up link by link.
    """
    if isinstance(chain, GearedChain):
        return np.tile(_radii_of_all(chain, bodies), (len(pairs), 1))
    outward, inward = _radii(chain, bodies)
    links = np.array([body.link for body in bodies], dtype=np.intp)
    order = np.argsort(links[pairs], axis=1, kind="stable")
    lower, upper = np.take_along_axis(pairs, order, axis=1).T
    joint = np.arange(1, chain.n + 1)
    between = (joint > links[lower, None]) & (joint <= links[upper, None])
    return np.where(between, np.minimum(outward[upper], inward[lower]), 0.0)


def _radii_of_all(chain: GearedChain, bodies: Sequence[Body]) -> FloatArray:
    """Return how fast any body moves by each joint at most, ``(n,)`` [m/rad, m/m].

    Of arms with joints that follow others: as if each moved a body at the far end of the arm.
    """
    whole, gears = chain.whole, chain.gears
    size = 0.0
    for body in bodies:
        if not isinstance(body.solid, HalfSpace):
            points, radius = outer_points(body.solid)
            points = points @ body.T_link_body[:3, :3].T + body.T_link_body[:3, 3]
            size = max(size, float(np.linalg.norm(points, axis=-1).max()) + radius)
    length = np.linalg.norm(whole.placements[:, :3, 3], axis=-1).sum() + sum(whole.strokes_m)
    slides = whole.external.slides_of(whole.n)
    return np.asarray(np.where(slides, 1.0, length + 2.0 * size) @ np.abs(gears))


def _radii(chain: SerialChain, bodies: Sequence[Body]) -> tuple[FloatArray, FloatArray]:
    """Largest distance of bodies (B, n) from every axis inside, and outside, of their link [m].

    A slide moves all alike, by as much as itself; how far bodies on one side of it are from axes
    on the other is not bounded by the links. Slides that carry the arm are next to each other, so
    that of the two ways to bound the motion across a joint one passes none. Slides of the arm
    itself lengthen their links by their strokes.
    """
    n, slides = chain.n, chain.external.sliding
    stroke = np.zeros(n)
    stroke[[chain.external.count + k for k in chain.external.arm_slides]] = chain.strokes_m
    step = chain.placements[:, :3, 3]  # from each joint to the next, in axes of the link between
    length = np.linalg.norm(step, axis=-1)
    axis_inside = (chain.placements[:, :3, :3] @ chain.axes[:, :, None])[..., 0]
    outward = np.zeros((len(bodies), n))
    inward = np.zeros((len(bodies), n))
    for b, body in enumerate(bodies):
        if isinstance(body.solid, HalfSpace):
            outward[b] = inward[b] = np.inf
            continue
        points, radius = outer_points(body.solid)
        points = points @ body.T_link_body[:3, :3].T + body.T_link_body[:3, 3]
        own = body.link - 1  # row of the joint that moves the body
        for k in range(n):
            if k <= own:
                found, axis, seen = outward, chain.axes[k], points
                first, between, slid = k + 1, length[k + 2 : own + 1], stroke[k + 1 : own + 1]
            else:  # seen from the next joint outside
                found, axis, seen = inward, axis_inside[k], points - step[own + 1]
                first, between, slid = k, length[own + 2 : k], stroke[own + 1 : k]
            if k in (own, own + 1):
                found[b, k] = _off_axis(seen, axis) + radius
            else:
                far = np.linalg.norm(seen, axis=-1).max() + radius + slid.sum()
                found[b, k] = _off_axis(step[first][None], axis) + between.sum() + far
        if chain.external.slides:
            if own < slides.stop - 1:
                inward[b, slides.stop :] = np.inf
            if own >= slides.start:
                outward[b, : slides.start] = np.inf
    every = chain.external.slides_of(n)
    outward[:, every] = inward[:, every] = 1.0
    return outward, inward


def _off_axis(points: FloatArray, axis: FloatArray) -> float:
    """Largest distance of points (K, 3) from a line through the origin along a unit vector."""
    return float(np.linalg.norm(np.cross(points, axis), axis=-1).max())
