"""Meshes of thousands of triangles: shortcuts that change no distance and no verdict."""

import numpy as np
import pytest
import trimesh

from calib.geometry import engine
from calib.geometry.enclosure import polytope_vertices
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
    rotations = rotation_exp(rng.normal(size=(60, len(bodies), 3)))
    placed = Placed(rotations, rng.uniform(-0.5, 0.5, size=(60, len(bodies), 3)))
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


def test_bounds_are_none_too_large(ring):
    solids = [ring, *SOLIDS]
    bodies = [Body(str(k), 1, np.eye(4), solid) for k, solid in enumerate(solids)]
    pairs = np.array([[0, k] for k in range(1, len(bodies))])
    found = Engine(bodies, pairs)
    rng = np.random.default_rng(6)
    M = 100
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
    points = np.random.default_rng(1).uniform(-0.42, 0.42, (300, 3)) * [1, 1, 0.25]
    clear = to_surface(mesh, points)
    wanted = MeshSurface(mesh).encloses(points)
    remembers = MeshSurface(mesh)
    found = [remembers.encloses_far(p, c) for p, c in zip(points, clear.tolist(), strict=True)]
    assert found == wanted.tolist()
    assert 0.2 < np.mean(found) < 0.8
    assert (len(remembers._known) > 0) == (cut == 0)
    assert len(remembers._known) <= engine._REMEMBERED
