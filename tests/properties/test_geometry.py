"""Random arms among random solids, against Pinocchio alone and against plain sampling."""

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib import se3
from calib.geometry import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Scene, Solid, Sphere
from calib.geometry.enclosure import enclose, motion_radii, outer_points, reach
from calib.geometry.engine import CONTACT_M, MeshSurface, coal_solid
from calib.geometry.rays import box_box_bound, crosses, segment_segment
from calib.geometry.ways import WAY_TOLERANCE_M
from calib.robots import ExternalAxes, SerialChain

COAL_M = 2e-6
"""What the iterations of coal leave open: its tolerance is 1e-6, of a distance above a metre."""

seeds = st.integers(0, 2**32 - 1)


def pose(rng: np.random.Generator, spread_m: float = 1.0) -> np.ndarray:
    R = Rotation.random(rng=rng).as_matrix()
    return se3.transform(R, rng.uniform(-spread_m, spread_m, 3))


def random_chain(rng: np.random.Generator, n: int) -> SerialChain:
    """With or without joints that slide, before those that turn."""
    placements = np.array([pose(rng, 0.4) for _ in range(n)])
    axes = rng.normal(size=(n, 3))
    slides = int(rng.integers(min(n, 3))) if rng.random() < 0.5 else 0
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return SerialChain(placements, axes, pose(rng), ExternalAxes(slides=slides))


def random_mesh(rng: np.random.Generator, size_m: float) -> Mesh:
    """A box with its corners displaced, closed."""
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    triangles = [(0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5)]
    triangles += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    vertices = size_m * (corners + rng.uniform(-0.4, 0.4, (8, 3)) + rng.uniform(-1, 1, 3))
    return Mesh(vertices, np.array(triangles, dtype=np.intp))


def random_solid(rng: np.random.Generator, size_m: float, *, mesh: bool = True) -> Solid:
    a, b, c = (float(v) for v in size_m * rng.uniform(0.1, 1.0, 3))
    kinds: list[Solid] = [Sphere(a), Capsule(a / 2, 2 * b), Capsule(a, 0.0), Cylinder(a, b)]
    kinds += [Box((a, b, c)), Box((a, b, 1e-3))] + [random_mesh(rng, a)] * mesh
    return kinds[rng.integers(len(kinds))]


def random_bodies(rng: np.random.Generator, n: int, *, mesh: bool = True) -> dict[str, list[Body]]:
    """Arm, tool and obstacles, floor included."""

    def body(name: str, link: int, size_m: float, spread_m: float) -> Body:
        return Body(name, link, pose(rng, spread_m), random_solid(rng, size_m, mesh=mesh))

    R = pose(rng)[:3, :3]
    floor = Body("floor", 0, se3.transform(R, -2.0 * R[:, 2]), HalfSpace())
    return {
        "arm": [body(f"link{j}", j, 0.1, 0.1) for j in range(n + 1)],
        "tool": [body(f"tool{k}", n, 0.1, 0.3) for k in range(2)],
        "obstacles": [floor, *(body(f"part{k}", 0, 0.4, 2.0) for k in range(3))],
    }


def has_mesh(scene: Scene, pair: int) -> bool:
    return any(isinstance(scene.bodies[b].solid, Mesh) for b in scene.pairs[pair])


class PinocchioAlone:
    """Distances of pairs by Pinocchio's own model, kinematics and geometry."""

    def __init__(self, chain: SerialChain, scene: Scene) -> None:
        self.scene = scene
        self.model, self.geometry = pin.Model(), pin.GeometryModel()
        joint = 0
        for j in range(chain.n):
            slides = chain.external.slides_of(chain.n)[j]
            kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
            axis = chain.axes[j]
            joint = self.model.addJoint(joint, kind(axis), pin.SE3(chain.placements[j]), f"j{j}")
        for i, body in enumerate(scene.bodies):
            solid, placement = coal_solid(body.solid), pin.SE3(body.T_link_body)
            named = pin.GeometryObject(f"{i}", body.link, placement, solid)
            self.geometry.addGeometryObject(named)
        for a, b in scene.pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(int(a), int(b)))
        self.data, self.found = self.model.createData(), pin.GeometryData(self.geometry)

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Of all pairs at a posture (n,)."""
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.found, q)
        pin.computeDistances(self.geometry, self.found)
        found = np.array([r.min_distance for r in self.found.distanceResults])
        # how deep a mesh is in something depends on the triangle that is asked; that it is does not
        meshes = np.array([has_mesh(self.scene, p) for p in range(len(found))], dtype=bool)
        return np.where(meshes & (found <= 0.0), -CONTACT_M, found)


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7))
def test_the_smallest_distance_is_that_of_pinocchio(seed, n):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n)
    scene = Scene(chain, **random_bodies(rng, n))
    q = rng.uniform(-np.pi, np.pi, (6, n))
    found = scene.clearance(q, cap_m=0.3)
    reference = PinocchioAlone(chain, scene)
    for posture, distance, pair in zip(q, found.distance_m, found.pair, strict=True):
        all_of_them = reference.distances(posture)
        expected = all_of_them.min()
        # Pinocchio does not see what lies wholly inside a mesh, nor how deep a mesh is in a plane
        enclosed = has_mesh(scene, pair) and distance <= -CONTACT_M
        assert (distance <= 0.0) == (expected <= 0.0) or abs(expected) < COAL_M or enclosed
        if not enclosed:
            assert distance == pytest.approx(min(expected, 0.3), abs=COAL_M)
            if expected < 0.3 - COAL_M:
                assert all_of_them[pair] == pytest.approx(distance, abs=COAL_M)


@settings(max_examples=8)
@given(seed=seeds)
def test_segments_against_points_on_them(seed):
    """The nearest of 101 x 101 points is never nearer, and farther by no more than their step."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3)) * rng.choice([0.0, 1e-3, 1.0], (2, 1))
    if rng.random() < 0.3:  # parallel, or almost
        b = rng.normal() * a + rng.choice([0.0, 1e-9, 1e-5]) * rng.normal(size=3)
    apart = rng.normal(size=3) * rng.choice([0.0, 1.0, 3.0])
    part = np.linspace(-1, 1, 101)
    gaps = apart + part[:, None, None] * b - part[None, :, None] * a
    nearest = np.linalg.norm(gaps, axis=-1).min()
    distance = float(segment_segment(apart, a, b))
    step = (np.linalg.norm(a) + np.linalg.norm(b)) / 100
    assert nearest - step - 1e-9 <= distance <= nearest + 1e-9
    assert distance == pytest.approx(float(segment_segment(-apart, b, a)), abs=1e-9)


@settings(max_examples=8)
@given(seed=seeds)
def test_bounds_are_below_the_distance(seed):
    """Of boxes along each other's axes, apart and overlapping, against Pinocchio."""
    rng = np.random.default_rng(seed)
    halves, T = rng.uniform(0.01, 1.0, (2, 3)), pose(rng, 2.0)
    model, geometry = pin.Model(), pin.GeometryModel()
    for name, half, at in (("a", halves[0], np.eye(4)), ("b", halves[1], T)):
        solid = coal_solid(Box(tuple(2 * half)))
        geometry.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3(at), solid))
    geometry.addCollisionPair(pin.CollisionPair(0, 1))
    data, found = model.createData(), pin.GeometryData(geometry)
    pin.updateGeometryPlacements(model, data, geometry, found, np.empty(0))
    true = pin.computeDistance(geometry, found, 0).min_distance
    (bound,) = box_box_bound(T[None, :3, :3], T[None, :3, 3], halves[:1], halves[1:])
    assert bound <= true + COAL_M
    # boxes with the same axes: the bound is the distance
    (same,) = box_box_bound(np.eye(3)[None], T[None, :3, 3], halves[:1], halves[1:])
    gaps = np.abs(T[:3, 3]) - halves.sum(axis=0)
    assert same == pytest.approx(
        np.linalg.norm(np.maximum(gaps, 0)) if gaps.max() > 0 else gaps.max(), abs=1e-12
    )


def outside(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance (M,) of points (M, 3) from a convex solid; inside only its sign is right."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    if isinstance(solid, Sphere):
        return np.linalg.norm(points, axis=1) - solid.radius_m
    if isinstance(solid, Capsule):
        ends = np.clip(z, -solid.length_m / 2, solid.length_m / 2)
        return np.hypot(flat, z - ends) - solid.radius_m
    if isinstance(solid, HalfSpace):
        return z
    if isinstance(solid, Cylinder):
        gaps = np.stack([flat - solid.radius_m, np.abs(z) - solid.length_m / 2])
    elif isinstance(solid, Box):
        gaps = np.abs(points.T) - np.array(solid.size_m)[:, None] / 2
    else:
        raise TypeError
    deepest = gaps.max(axis=0)
    return np.where(deepest > 0, np.linalg.norm(np.maximum(gaps, 0), axis=0), deepest)


@settings(max_examples=8)
@given(seed=seeds)
def test_enclosures_and_reach_against_points_of_the_solid(seed):
    rng = np.random.default_rng(seed)
    solid = random_solid(rng, 1.0, mesh=False)
    points = rng.uniform(-1.5, 1.5, (5_000, 3)) * rng.choice([0.05, 0.3, 1.0], (5_000, 1))
    within = points[outside(solid, points) <= 0]
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    far = float(reach(solid, None, direction))
    assert (within @ direction).max(initial=-9.0) <= far + 1e-12
    # the plane at that distance touches the solid
    plane = Body(
        "plane",
        0,
        se3.transform(
            Rotation.align_vectors(-direction[None], [[0, 0, 1]])[0].as_matrix(), far * direction
        ),
        HalfSpace(),
    )
    tall = Body("solid", 2, np.eye(4), solid)
    chain = SerialChain(np.array([np.eye(4)] * 2), np.eye(3)[:2], np.eye(4))
    scene = Scene(chain, [tall], obstacles=[plane])
    assert PinocchioAlone(chain, scene).distances(np.zeros(2))[0] == pytest.approx(0, abs=COAL_M)
    around = enclose(solid)
    gaps = np.abs(within - around.centre) - around.half
    assert (np.linalg.norm(np.maximum(gaps, 0), axis=1) <= around.radius_m + 1e-12).all()
    end, radius = around.capsule
    part = within - around.centre
    at = np.clip(part @ end / max(end @ end, 1e-300), -1, 1)[:, None] * end
    assert (np.linalg.norm(part - at, axis=1) <= radius + 1e-12).all()
    corners, grown = outer_points(solid)
    assert (corners @ direction).max() + grown >= far - 1e-12


@settings(max_examples=8)
@given(seed=seeds, n=st.integers(2, 7))
def test_no_distance_changes_faster_than_its_bound(seed, n):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n)
    scene = Scene(chain, **random_bodies(rng, n))
    reference = PinocchioAlone(chain, scene)
    radii = motion_radii(chain, scene.bodies, scene.pairs)
    for _ in range(4):
        start = rng.uniform(-np.pi, np.pi, n)
        # one joint, or all of them, a little or a lot
        step = rng.normal(size=n) * rng.choice([0.01, 0.3]) * (rng.random(n) < rng.random())
        one, other = reference.distances(start), reference.distances(start + step)
        apart = (one > 0) & (other > 0)
        limit = radii @ np.abs(step) + COAL_M * (1.0 + one)
        assert (np.abs(one - other)[apart] <= limit[apart]).all()


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7))
def test_clear_ways_keep_their_distance_everywhere(seed, n):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n)
    scene = Scene(chain, **random_bodies(rng, n))
    start, end = rng.uniform(-1.5, 1.5, (2, 6, n))
    end[-1] = start[-1]
    keep_m = float(rng.choice([0.0, 0.01, 0.1]))
    found = scene.ways(start, end, keep_m)
    part = np.linspace(0, 1, 101)[:, None]
    reference = PinocchioAlone(chain, scene)
    for w in range(len(start)):
        samples = scene.clearance(start[w] + part * (end - start)[w]).distance_m
        if found.clear[w]:
            assert samples.min() >= keep_m - WAY_TOLERANCE_M - COAL_M
        else:
            assert found.distance_m[w] < keep_m
        # the place that is reported is where that pair is that near
        there = start[w] + found.part[w] * (end - start)[w]
        expected = reference.distances(there)
        if not has_mesh(scene, found.pair[w]):
            assert min(expected[found.pair[w]], 0.5) == pytest.approx(
                found.distance_m[w], abs=COAL_M
            )


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7), one=st.booleans())
def test_sight_against_points_along_the_line(seed, n, one):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n)
    scene = Scene(chain, **random_bodies(rng, n, mesh=False))
    S = 20
    q = rng.uniform(-np.pi, np.pi, (1 if one else S, n))
    start, end = rng.uniform(-2, 2, (2, S, 3))
    start[:5] = end[:5]  # a point
    end[5:10, :2] = start[5:10, :2]  # along an axis
    found = scene.sight(q, start, end)
    assert (found.clear == (found.blocker == -1)).all()
    state = chain.forward(np.broadcast_to(q, (S, n)))
    part = np.linspace(0, 1, 1001)[:, None]
    for s in range(S):
        points = start[s] + part * (end - start)[s]
        step = np.linalg.norm(end[s] - start[s]) / 1000
        for b, body in enumerate(scene.bodies):
            T = body.T_link_body
            if body.link:
                j = body.link - 1
                T = se3.transform(state.rotations[s, j], state.origins[s, j]) @ T
            away = outside(body.solid, se3.apply(se3.inverse(T), points)).min()
            if away < -1e-9:
                assert 0 <= found.blocker[s] <= b
            if found.blocker[s] == b:
                assert away <= step


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7), one=st.booleans(), flat=st.booleans())
def test_sight_of_a_beam_is_that_of_all_its_lines(seed, n, one, flat):
    """Each line against each body, without bounds: a disc of 24, or any ends about the middle."""
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, n)
    scene = Scene(chain, **random_bodies(rng, n))
    S = 50
    q = rng.uniform(-np.pi, np.pi, (1 if one else S, n))
    start, end = rng.uniform(-2, 2, (2, S, 3))
    size, angle = rng.choice([0.01, 0.1, 0.5]), np.arange(24) * np.pi / 12
    disc = np.stack([np.cos(angle), np.sin(angle), np.zeros(24)], axis=1) @ pose(rng)[:3, :3]
    around = size * (disc if flat else rng.normal(size=(rng.integers(6), 3)))
    found = scene.sight(q, start, end, around=around)
    ends = end[:, None] + np.vstack([np.zeros(3), around])
    starts = np.broadcast_to(start[:, None], ends.shape)
    state = chain.forward(np.broadcast_to(q, (S, n)))
    expected = np.full(S, -1)
    for b, body in reversed(list(enumerate(scene.bodies))):
        T = np.broadcast_to(body.T_link_body, (S, 4, 4))
        if body.link:
            T = (
                se3.transform(state.rotations[:, body.link - 1], state.origins[:, body.link - 1])
                @ T
            )
        R, p = T[:, :3, :3], T[:, None, :3, 3]
        lines = [((points - p) @ R).reshape(-1, 3) for points in (starts, ends)]
        mesh = isinstance(body.solid, Mesh)
        met = MeshSurface(body.solid).crosses(*lines) if mesh else crosses(body.solid, *lines)
        expected[met.reshape(S, -1).any(axis=1)] = b
    np.testing.assert_array_equal(found.blocker, expected)
    np.testing.assert_array_equal(found.clear, expected < 0)


@settings(max_examples=5)
@given(seed=seeds)
def test_sight_and_inside_of_a_closed_mesh(seed):
    """A convex one, so that planes tell the truth."""
    rng = np.random.default_rng(seed)
    box = Box((0.7, 0.9, 1.1))
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * box.size_m
    mesh = Mesh(corners, random_mesh(rng, 1.0).triangles)
    T = pose(rng)
    chain = random_chain(rng, 2)
    as_box, as_mesh = (
        Scene(
            chain,
            obstacles=[
                Body("far", 0, se3.transform(np.eye(3), [9, 0, 0]), Sphere(0.1)),
                Body("part", 0, T, solid),
            ],
        )
        for solid in (box, mesh)
    )
    start, end = rng.uniform(-2, 2, (2, 100, 3))
    seen = as_mesh.sight(np.zeros(2), start, end)
    # a line that ends inside is blocked by both, one wholly inside meets no surface
    inside = (as_box.inside(start) >= 0) & (as_box.inside(end) >= 0)
    assert seen.clear[inside].all()
    expected = as_box.sight(np.zeros(2), start, end)
    np.testing.assert_array_equal(seen.blocker[~inside], expected.blocker[~inside])
    points = rng.uniform(-1.5, 1.5, (500, 3))
    np.testing.assert_array_equal(as_mesh.inside(points), as_box.inside(points))
    away = outside(box, se3.apply(se3.inverse(T), points))
    np.testing.assert_array_equal(as_box.inside(points), np.where(away < 0, 1, -1))


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7))
def test_moving_the_whole_cell_changes_nothing(seed, n):
    rng = np.random.default_rng(seed)
    chain, bodies = random_chain(rng, n), random_bodies(rng, n)
    T = pose(rng, 3.0)
    placements = np.concatenate([T @ chain.placements[:1], chain.placements[1:]])
    there = replace(chain, placements=placements)
    moved = {
        group: [
            Body(b.name, b.link, b.T_link_body if b.link else T @ b.T_link_body, b.solid)
            for b in members
        ]
        for group, members in bodies.items()
    }
    scene, other = Scene(chain, **bodies), Scene(there, **moved)
    assert scene.excluded == other.excluded
    q, to = rng.uniform(-np.pi, np.pi, (2, 5, n))
    np.testing.assert_allclose(
        scene.clearance(q).distance_m, other.clearance(q).distance_m, atol=COAL_M
    )
    start, end = rng.uniform(-2, 2, (2, 5, 3))
    np.testing.assert_array_equal(
        scene.sight(q, start, end).blocker,
        other.sight(q, se3.apply(T, start), se3.apply(T, end)).blocker,
    )
    np.testing.assert_array_equal(scene.inside(start), other.inside(se3.apply(T, start)))
    ways, others = scene.ways(q, to, 0.01), other.ways(q, to, 0.01)
    np.testing.assert_array_equal(ways.clear, others.clear)


@settings(max_examples=5)
@given(seed=seeds, n=st.integers(2, 7))
def test_the_order_of_bodies_changes_nothing(seed, n):
    rng = np.random.default_rng(seed)
    chain, bodies = random_chain(rng, n), random_bodies(rng, n)
    shuffled = {group: [members[i] for i in rng.permutation(len(members))]
                for group, members in bodies.items()}  # fmt: skip
    scene, other = Scene(chain, **bodies), Scene(chain, **shuffled)
    assert {frozenset(pair) for pair in scene.excluded} == {
        frozenset(pair) for pair in other.excluded
    }
    q = rng.uniform(-np.pi, np.pi, (10, n))
    one, two = scene.clearance(q), other.clearance(q)
    told = (one.distance_m > 0) | ~np.array([has_mesh(scene, pair) for pair in one.pair])
    np.testing.assert_allclose(one.distance_m[told], two.distance_m[told], atol=COAL_M)
    np.testing.assert_array_equal(one.distance_m > 0, two.distance_m > 0)
    for i in np.flatnonzero(told & (one.distance_m < 0.5)):
        assert set(scene.names(one.pair[i])) == set(other.names(two.pair[i]))
    for a, b in zip(scene.extent(q), other.extent(q), strict=True):
        np.testing.assert_array_equal(a, b)
    start, end = rng.uniform(-2, 2, (2, 10, 3))
    np.testing.assert_array_equal(
        scene.sight(q, start, end).clear, other.sight(q, start, end).clear
    )
