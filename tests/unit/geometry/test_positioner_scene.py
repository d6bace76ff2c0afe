"""Scenes of arms beside a positioner: what stands on the floor turns against what is measured."""

from dataclasses import replace

import numpy as np
import pytest

from calib import Robot
from calib.errors import InputError
from calib.geometry import Body, Box, Capsule, Cylinder, HalfSpace, Scene, Sphere
from calib.robots.arm_shapes import with_capsules
from calib.se3 import apply, inverse, transform
from tests.positioners import TWO_AXES, beside_positioner

FIXTURE = Body("fixture", 0, transform(np.eye(3), [0.05, -0.1, 0.1]), Sphere(0.06))
POST_AT = transform(np.eye(3), [0.5, 0.3, 0.5])
GROUND = transform(np.eye(3), [0.0, 0.0, -0.05])


@pytest.fixture(scope="module", params=[False, True], ids=["alone", "on a rail"])
def robot(request, tmp_path_factory) -> Robot:
    path = tmp_path_factory.mktemp("scene") / "robot.urdf"
    path.write_text(beside_positioner("ur10e", TWO_AXES, place=0.8, rail=request.param))
    return with_capsules(Robot.from_urdf(path, tip="tool0", base="plate"), [0.04])


def standing(robot: Robot) -> list[Body]:
    """A post and the ground, where they are in the root of the description."""
    solids = (("post", POST_AT, Box((0.1, 0.12, 1.0))), ("ground", GROUND, HalfSpace()))
    return [Body(n, robot.floor, robot.T_floor_world @ T, s) for n, T, s in solids]


def scene_of(robot: Robot) -> Scene:
    at = robot.chain.T_link_tip @ transform(np.eye(3), [0.0, 0.0, 0.15])
    tool = Body("pin", robot.n, at, Capsule(0.01, 0.1))
    return Scene(robot.chain, robot.bodies, tool=[tool], obstacles=[FIXTURE, *standing(robot)])


def postures(robot: Robot, count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(robot.lower, robot.upper, (count, robot.n))


def placed_by_hand(robot: Robot, scene: Scene, q: np.ndarray) -> Scene:
    """All bodies where Pinocchio's tree has them at a posture, as obstacles of a still scene."""
    state = robot.state(q)
    bodies = []
    for body in scene.bodies:
        T = np.eye(4)
        if body.name in ("post", "ground"):
            T = robot.T_base_floor(q) @ robot.T_floor_world
            T = T @ (POST_AT if body.name == "post" else GROUND) @ inverse(body.T_link_body)
        elif body.link:
            T = transform(state.rotations[body.link - 1], state.origins[body.link - 1])
        bodies.append(replace(body, link=0, T_link_body=T @ body.T_link_body))
    return bodies


def distance_of(one: Body, other: Body, chain) -> float:
    """Of two bodies that stand still, by a scene of these: one is a tool that does not move."""
    state = chain.forward(np.zeros(chain.n))
    T = transform(state.rotations[-1], state.origins[-1])
    held = replace(one, link=chain.n, T_link_body=inverse(T) @ one.T_link_body)
    alone = Scene(chain, tool=[held], obstacles=[other])
    return float(alone.distances(np.zeros((1, chain.n)), 10.0)[0, 0])


def test_distances_are_those_of_obstacles_moved_by_hand(robot):
    scene, q = scene_of(robot), postures(robot, 1)
    still = Robot.preset("ur10e").chain
    found = scene.distances(q, 10.0)
    assert {"post", "ground", "fixture"} <= {
        n for p in range(len(scene.pairs)) for n in scene.names(p)
    }
    for i, posture in enumerate(q):
        bodies = placed_by_hand(robot, scene, posture)
        for p, (a, b) in enumerate(scene.pairs):
            expected = distance_of(bodies[a], bodies[b], still)
            assert found[i, p] == pytest.approx(expected, abs=2e-6), scene.names(p)


def test_what_turns_is_checked_against_what_stands_and_the_stand_is_not(robot):
    scene = scene_of(robot)
    pairs = {frozenset(scene.names(p)) for p in range(len(scene.pairs))}
    (plate,) = [b.name for b in robot.bodies if b.link == 0]
    for pair in ((plate, "post"), (plate, "ground"), ("fixture", "post"), ("fixture", "pin")):
        assert frozenset(pair) in pairs
    assert frozenset((plate, "fixture")) not in pairs
    assert frozenset(("post", "ground")) not in pairs
    others = {frozenset(scene.others.names(p)) for p in range(len(scene.others.pairs))}
    (far,) = [b.name for b in robot.bodies if b.link == robot.n - 2]
    assert frozenset((plate, far)) in others  # at the safety distance: no maker built both
    centre = apply(FIXTURE.T_link_body, np.zeros(3))
    np.testing.assert_array_equal(scene.inside(np.array([centre, centre + 1.0])), [0, -1])


def test_only_its_own_stand_is_a_neighbour_of_a_positioner(tmp_path):
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    text = beside_positioner("ur10e").replace(
        '<link name="stand"/>', f'<link name="stand">{ball}</link>'
    )
    text = text.replace('<link name="world"/>', f'<link name="world">{ball}</link>')
    text = text.replace('<link name="tilt_link"/>', f'<link name="tilt_link">{ball}</link>')
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    robot = Robot.from_urdf(path, tip="tool0", base="plate")
    links = {body.name.split("/")[0]: body.link for body in robot.bodies}
    assert [links[name] for name in ("plate", "tilt_link", "world", "stand")] == [0, 1, 2, 2]
    scene = Scene(robot.chain, robot.bodies)
    pairs = {frozenset(n.split("/")[0] for n in scene.names(p)) for p in range(len(scene.pairs))}
    assert frozenset(("tilt_link", "world")) in pairs
    assert frozenset(("plate", "stand")) in pairs
    assert frozenset(("tilt_link", "stand")) not in pairs
    assert frozenset(("plate", "tilt_link")) not in pairs


def test_an_arm_whose_zero_is_in_the_table_is_checked_against_it(tmp_path):
    """Descriptions overlap at joints; an arm that lies stretched out in a table does not."""
    path = tmp_path / "robot.urdf"
    path.write_text(beside_positioner("ur10e"))
    robot = Robot.from_urdf(path, tip="tool0", base="plate")
    zero = np.zeros(robot.n)
    world = inverse(robot.T_base_floor(zero) @ robot.T_floor_world)
    there = apply(world, robot.state(zero).origins[5]) - [0.1, 0.05, 0.05]
    table = (("turn", "0 0 1", "-3", "3", " ".join(map(str, there)), "0 0 -0.1"),)
    path.write_text(beside_positioner("ur10e", table))
    robot = with_capsules(Robot.from_urdf(path, tip="tool0", base="plate"), [0.04])
    scene = Scene(robot.chain, robot.bodies)
    zero = scene.clearance(np.zeros((1, robot.n)))
    (plate,) = [b.name for b in robot.bodies if b.link == 0]
    touching = [n for p in range(len(scene.pairs)) if plate in (n := scene.names(p))]
    assert zero.distance_m[0] < 0.0
    assert touching
    assert not any(plate in pair for pair in scene.excluded)


def test_motions_that_are_clear_touch_nothing_on_the_way(robot):
    """Against samples: axes that are passed the other way round, a rail in between, the ground."""
    scene = scene_of(robot).others
    start = postures(robot, 500)
    end = start + np.random.default_rng(4).normal(0.0, 0.4, start.shape)
    end = np.clip(end, robot.lower, robot.upper)
    free = (scene.clearance(start).distance_m > 0.0) & (scene.clearance(end).distance_m > 0.0)
    start, end = start[free], end[free]
    assert len(start) > 15
    found = scene.ways(start, end, 0.0)
    parts = np.linspace(0.0, 1.0, 40)
    q = start[:, None] + (end - start)[:, None] * parts[:, None]
    sampled = scene.clearance(q.reshape(-1, robot.n)).distance_m.reshape(len(start), -1).min(axis=1)
    assert (sampled[found.clear] > -1e-6).all()
    assert (~found.clear[sampled < -1e-3]).all()
    assert found.clear[sampled > 2e-3].mean() > 0.98
    assert found.clear.sum() > 5
    assert (sampled < 0.0).sum() > 2


def test_obstacles_stand_on_the_base_or_the_floor(robot):
    astray = Body("astray", 1, np.eye(4), Cylinder(0.1, 0.1))
    with pytest.raises(InputError, match="obstacle astray is on link 1"):
        Scene(robot.chain, obstacles=[astray])
