"""Meshes of thousands of triangles: shortcuts that change no distance and no verdict."""

import numpy as np
import pytest
import trimesh

from calib.geometry import engine
from calib.geometry.enclosure import is_convex, polytope_vertices
from calib.geometry.engine import Engine, MeshSurface, Placed
from calib.robots.shapes import Body, Box, Capsule, Cylinder, Mesh, Solid, Sphere
from calib.se3 import rotation_exp


def as_mesh(made: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(made.vertices), np.array(made.faces, dtype=np.intp))


@pytest.fixture(scope="module")
def ring() -> Mesh:
    """No convex one: 5120 triangles."""
    return as_mesh(trimesh.creation.torus(0.3, 0.1, major_sections=80, minor_sections=32))


def to_surface(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Distances from the nearest triangle, all looked at."""
    corners = mesh.vertices[mesh.triangles]
    nearest = [
        trimesh.triangles.closest_point(corners, np.broadcast_to(p, (len(corners), 3)))
        for p in points
    ]
    apart = np.array(nearest) - points[:, None]
    return np.asarray(np.linalg.norm(apart, axis=-1).min(axis=1))


SOLIDS: list[Solid] = [
    Sphere(0.05),
    Capsule(0.04, 0.3),
    Box((0.1, 0.2, 0.05)),
    Cylinder(0.06, 0.2),
    as_mesh(trimesh.creation.icosphere(2, 0.07)),
]


def settled(bodies: list[Body], placed: Placed) -> np.ndarray:
    pairs = np.array([[0, k] for k in range(1, len(bodies))])
    found = Engine(bodies, pairs)
    known = found.bounds(placed)
    found.settle_all(known, np.inf)
    return known.distance_m


def test_distances_are_those_of_the_triangles(ring, monkeypatch):
    bodies = [Body(str(k), 1, np.eye(4), solid) for k, solid in enumerate([ring, *SOLIDS])]
    rng = np.random.default_rng(5)
    rotations = rotation_exp(rng.normal(size=(25, len(bodies), 3)))
    placed = Placed(rotations, rng.uniform(-0.5, 0.5, size=(25, len(bodies), 3)))
    here = settled(bodies, placed)
    monkeypatch.setattr(engine, "_FINE", 10**9)
    monkeypatch.setattr(engine, "_thinned", lambda solid: (solid, 0.0))
    there = settled(bodies, placed)
    assert ((here < 0.0) == (there < 0.0)).all()
    assert 0.1 < (here < 0.0).mean() < 0.6
    np.testing.assert_allclose(here, there, atol=2e-6)
    # the sphere, by another's code
    centre = np.einsum(
        "sji,sj->si", placed.rotations[:, 0], placed.origins[:, 1] - placed.origins[:, 0]
    )
    away = to_surface(ring, centre)
    free = here[:, 0] > 0.0
    np.testing.assert_allclose(here[free, 0], away[free] - 0.05, atol=2e-6)


@pytest.mark.parametrize("far_m", [0.0, 0.05, 0.2, 0.6])
def test_pairs_that_are_far_are_told_by_the_balls_about_them(ring, far_m):
    bodies = [Body(str(k), 1, np.eye(4), solid) for k, solid in enumerate([*SOLIDS, ring])]
    rng = np.random.default_rng(6)
    rotations = rotation_exp(rng.normal(size=(40, len(bodies), 3)))
    placed = Placed(rotations, rng.uniform(-0.5, 0.5, size=(40, len(bodies), 3)))
    found = Engine(bodies, np.array([[a, b] for b in range(len(bodies)) for a in range(b)]))
    known, whole = found.bounds(placed, far_m=far_m), found.bounds(placed)
    found.settle_all(known, far_m)
    found.settle_all(whole, np.inf)
    assert (known.distance_m <= whole.distance_m + 1e-9).all()
    np.testing.assert_array_equal(
        np.minimum(known.distance_m, far_m), np.minimum(whole.distance_m, far_m)
    )
    assert far_m > 0.5 or not known.exact.all()


def test_bounds_are_none_too_large(ring):
    solids = [ring, *SOLIDS]
    bodies = [Body(str(k), 1, np.eye(4), solid) for k, solid in enumerate(solids)]
    pairs = np.array([[0, k] for k in range(1, len(bodies))])
    found = Engine(bodies, pairs)
    rng = np.random.default_rng(6)
    M = 40
    R, p = rotation_exp(rng.normal(size=(M, 3))), rng.uniform(-0.8, 0.8, size=(M, 3))
    for pair in range(len(pairs)):
        which = np.full(M, pair)
        exact = found._oracle.distances(which, R, p)
        bound = found._oracle.bounds(which, R, p)
        clear = exact > 0.0
        assert (bound[clear] <= exact[clear]).all()
        assert (bound[~clear] < 0.0).all()
        assert np.median((exact - bound)[clear]) < 0.05


def test_the_polytope_holds_the_mesh_a_flat_one_too(ring):
    flat = Mesh(ring.vertices * [1.0, 1.0, 0.0], ring.triangles)
    for mesh in (ring, flat):
        corners = polytope_vertices(mesh)
        ways = np.random.default_rng(0).normal(size=(500, 3))
        assert ((ways @ corners.T).max(axis=1) >= (ways @ mesh.vertices.T).max(axis=1)).all()
        assert len(corners) < 500


@pytest.mark.parametrize("cut", [0, 40])
def test_sides_of_a_surface_are_remembered_where_it_is_closed(ring, cut):
    mesh = Mesh(ring.vertices, ring.triangles[cut:])
    points = np.random.default_rng(1).uniform(-0.42, 0.42, (50, 3)) * [1, 1, 0.25]
    clear = to_surface(mesh, points)
    wanted = MeshSurface(mesh).encloses(points)
    remembers = MeshSurface(mesh)
    found = [remembers.encloses_far(p, c) for p, c in zip(points, clear.tolist(), strict=True)]
    assert found == wanted.tolist()
    assert 0.2 < np.mean(found) < 0.8
    assert (len(remembers._known) > 0) == (cut == 0)
    assert len(remembers._known) <= engine._REMEMBERED


def egg(dent: float = 0.0) -> Mesh:
    """A convex surface of 5120 triangles, unless one vertex of it is pushed in by a share."""
    made = trimesh.creation.icosphere(4, 0.2)
    vertices = np.array(made.vertices) * [1.0, 0.7, 1.4] + [0.03, 0.0, 0.05]
    vertices[7] *= 1.0 - dent
    return Mesh(vertices, np.array(made.faces, dtype=np.intp))


def test_a_surface_is_convex_that_is_all_of_its_hull(ring):
    ball, other = egg(), egg()
    apart = Mesh(
        np.concatenate([ball.vertices, other.vertices + np.eye(3)[0]]),
        np.concatenate([ball.triangles, other.triangles + len(ball.vertices)]),
    )
    assert is_convex(ball)
    assert is_convex(Mesh(ball.vertices, ball.triangles[:, ::-1]))
    for mesh in (ring, apart, egg(0.05), Mesh(ball.vertices, ball.triangles[1:])):
        assert not is_convex(mesh)


def test_a_convex_mesh_is_as_its_triangles_are(monkeypatch):
    rng = np.random.default_rng(8)
    start, end = rng.uniform(-0.4, 0.4, size=(2, 200, 3))
    found = []
    for fine in (engine._FINE, 10**9):
        monkeypatch.setattr(engine, "_FINE", fine)
        mesh = egg()
        assert (engine._own_polytope(mesh) is not None) == (fine < 10**9)
        bodies = [Body(str(k), 1, np.eye(4), solid) for k, solid in enumerate([mesh, *SOLIDS])]
        turns = rotation_exp(np.random.default_rng(9).normal(size=(25, len(bodies), 3)))
        places = np.random.default_rng(10).uniform(-0.35, 0.35, size=(25, len(bodies), 3))
        found.append(
            (settled(bodies, Placed(turns, places)), MeshSurface(mesh).crosses(start, end))
        )
    (here, seen), (there, crossed) = found
    assert 0.1 < (here < 0.0).mean() < 0.9
    np.testing.assert_allclose(here, there, atol=5e-6)
    np.testing.assert_array_equal(seen, crossed)
    inside = MeshSurface(mesh).encloses(start) & MeshSurface(mesh).encloses(end)
    assert inside.any()
    assert not crossed[inside].any()


@pytest.mark.parametrize("sections", [254, 255, 600])
def test_the_hub_of_a_lid_may_have_more_edges_than_coal_counts(sections):
    """A turned part: convex, and all triangles of a lid meet in its middle."""
    profile = [[0, 0], [0.1, 0], [0.107, 0.05], [0.11, 0.1], [0.107, 0.15], [0.1, 0.2], [0, 0.2]]
    mesh = as_mesh(trimesh.creation.revolve(np.array(profile), sections=sections))
    assert len(mesh.triangles) >= engine._FINE
    assert is_convex(mesh)
    assert (engine._own_polytope(mesh) is not None) == (sections < 255)
    bodies = [Body("part", 1, np.eye(4), mesh), Body("ball", 0, np.eye(4), Sphere(0.05))]
    origins = np.zeros((3, 2, 3))
    origins[:, 1] = [[0.5, 0.0, 0.1], [0.0, 0.0, 0.4], [0.0, 0.0, 0.1]]
    found = settled(bodies, Placed(np.tile(np.eye(3), (3, 2, 1, 1)), origins))[:, 0]
    np.testing.assert_allclose(found[:2], [0.34, 0.15], rtol=0, atol=1e-6)
    assert found[2] < 0.0
