"""Which pairs are checked, distances by hand, and every error of a scene."""

import itertools
import pickle

import numpy as np
import pytest

from calib import Robot
from calib.errors import InputError
from calib.geometry import Body, Box, Capsule, Cylinder, HalfSpace, Mesh, Scene, Sphere
from calib.geometry import scene as scene_module
from calib.geometry.enclosure import motion_radii
from calib.robots import SerialChain
from calib.se3 import rotation_exp, transform

BALL = Sphere(0.1)
ZERO = np.zeros((1, 4))
LYING = rotation_exp([0.0, np.pi / 2, 0.0])
"""Turns the z axis of a solid into the x axis of its link."""


@pytest.fixture
def make(straight_arm, body):
    """A ball in the middle of every link, one on the tip and one obstacle."""

    def scene(**changes) -> Scene:
        groups = {
            "arm": [body(f"link{j}", j, BALL, (0.5, 0, 0)) for j in range(1, 5)]
            + [body("base", 0, BALL, (-0.5, 0, 0))],
            "tool": [body("tool", 4, BALL, (1, 0, 0))],
            "obstacles": [body("part", 0, BALL, (1.5, 1, 0))],
        }
        return Scene(straight_arm, **{**groups, **changes})

    return scene


def test_which_pairs_are_checked(make, body):
    scene = make(obstacles=[body(f"part{i}", 0, BALL, (0, 9 + i, 0)) for i in range(2)])
    names = {frozenset(scene.names(p)) for p in range(len(scene.pairs))}
    arm = ("link1 link3", "link1 link4", "link2 link4", "link2 base", "link3 base", "link4 base")
    tool = ("tool link1", "tool link2", "tool link3", "tool base")
    parts = [
        f"{name} part{i}" for i in range(2) for name in ("link1", "link2", "link3", "link4", "tool")
    ]
    assert names == {frozenset(pair.split()) for pair in (*arm, *tool, *parts)}
    assert len(scene.pairs) == len(names)
    assert [body.name for body in scene.bodies][-3:] == ["tool", "part0", "part1"]
    assert scene.excluded == ()


def test_own_pairs_and_those_with_others(make):
    scene = make()
    rng = np.random.default_rng(4)
    q, to = rng.uniform(-3, 3, (2, 40, 4))
    whole = scene.clearance(q)
    own, others = scene.own, scene.others
    named = [{frozenset(s.names(p)) for p in range(len(s.pairs))} for s in (scene, own, others)]
    assert named[0] == named[1] | named[2]
    assert not named[1] & named[2]
    mounted = {"tool", "link3"}  # their distance is that of the mount
    assert mounted in named[1]
    assert all(
        pair == mounted or all(name.startswith(("link", "base")) for name in pair)
        for pair in named[1]
    )
    assert all(pair & {"tool", "part"} for pair in named[2])
    apart = np.minimum(own.clearance(q).distance_m, others.clearance(q).distance_m)
    np.testing.assert_array_equal(apart, whole.distance_m)
    clear = own.ways(q, to, 0.01).clear & others.ways(q, to, 0.01).clear
    np.testing.assert_array_equal(clear, scene.ways(q, to, 0.01).clear)
    # distances of their own to keep, by pair: as each kind alone
    together = scene.with_pairs(np.concatenate([own.pairs, others.pairs]))
    keep_m = np.repeat([0.0, 0.08], [len(own.pairs), len(others.pairs)])
    alone = own.ways(q, to, 0.0).clear & others.ways(q, to, 0.08).clear
    assert 0 < alone.sum() < own.ways(q, to, 0.0).clear.sum()
    found = together.ways(q, to, keep_m)
    np.testing.assert_array_equal(found.clear, alone)


def test_pairs_that_touch_at_zero_are_left_out_and_told(make, body):
    long = Body("link1", 1, transform(LYING, [1.0, 0, 0]), Capsule(0.1, 2.8))
    arm = [long, *(body(f"link{j}", j, BALL, (0.5, 0, 0)) for j in (2, 3, 4))]
    scene = make(arm=arm)
    assert scene.excluded == (("link1", "link3"),)
    assert ("link1", "link3") not in [scene.names(p) for p in range(len(scene.pairs))]
    # with the elbow bent, they are apart in the zero posture
    assert make(arm=arm, zero=[0, 0, 1.5, 0]).excluded == ()
    # obstacles and tools that touch are not left out
    inside = make(arm=arm, obstacles=[body("part", 0, BALL, (1.5, 0, 0))])
    assert inside.excluded == (("link1", "link3"),)
    assert inside.clearance(ZERO).distance_m[0] == pytest.approx(-0.2)


@pytest.mark.parametrize(("gap_m", "touch"), [(1.1e-4, False), (0.9e-4, True), (-1e-4, True)])
def test_touching_is_nearer_than_a_tenth_of_a_millimetre(make, body, gap_m, touch):
    """For boxes, too, whose distance needs iterations."""
    cube = Box((0.2, 0.2, 0.2))
    arm = [body("link1", 1, cube, (1.5, 0, 0)), body("link3", 3, cube, (-0.3 + gap_m, 0, 0))]
    assert bool(make(arm=arm, tool=[], obstacles=[]).excluded) is touch


@pytest.mark.parametrize("pair", [("tool", "part"), ("part", "tool")])
def test_ignored_pairs(make, body, pair):
    near = body("part", 0, BALL, (4, 0.5, 0)), body("part", 0, BALL, (4, -0.6, 0))
    assert make(obstacles=near).clearance(ZERO).distance_m[0] == pytest.approx(0.3)
    scene = make(obstacles=near, ignore=[pair])
    # all bodies of that name are meant; link4 remains, whose centre is half a metre nearer the base
    assert scene.clearance(ZERO, cap_m=2).distance_m[0] == pytest.approx(np.hypot(0.5, 0.5) - 0.2)


def test_distances_by_hand(make):
    scene = make()
    q = np.array([[0.0, 0, 0, 0], [np.pi / 2, 0, 0, 0], [0, np.pi / 2, 0, 0]])
    found = scene.clearance(q, cap_m=2.0)
    # link2 is at (1.5, 0), at (0, 1.5), and at (1, 0.5); link1 at (0.5, 0), then (0, 0.5);
    # the tool 1.5 m from link3
    expected = np.array([1.0, 1.5, np.hypot(0.5, 0.5)]) - 0.2
    np.testing.assert_allclose(found.distance_m, expected, atol=1e-12)
    assert [set(scene.names(p)) for p in found.pair[[0]]] == [{"link2", "part"}]


def test_beyond_the_cap(make):
    scene = make()
    found = scene.clearance(ZERO, cap_m=0.3)
    assert found.distance_m[0] == 0.3
    assert 0 <= found.pair[0] < len(scene.pairs)
    ways = scene.ways(ZERO, ZERO, 0.7, cap_m=0.3)
    assert ways.clear[0]
    assert ways.distance_m[0] == pytest.approx(0.7, abs=1e-5)


def test_nothing_to_meet(straight_arm):
    scene = Scene(straight_arm)
    found = scene.clearance(np.zeros((3, 4)))
    np.testing.assert_array_equal(found.distance_m, np.inf)
    np.testing.assert_array_equal(found.pair, -1)
    ways = scene.ways(np.zeros((2, 4)), np.ones((2, 4)), 0.1)
    assert ways.clear.all()
    assert scene.sight(ZERO, [[0, 0, 0]], [[1, 1, 1]]).clear.all()
    lowest, highest = scene.extent(ZERO)
    assert (lowest == np.inf).all()
    assert (highest == -np.inf).all()
    np.testing.assert_array_equal(scene.inside([[0, 0, 0]]), -1)


def test_no_postures(make):
    scene, none = make(), np.empty((0, 4))
    assert scene.clearance(none).distance_m.shape == (0,)
    assert scene.ways(none, none, 0.1).clear.shape == (0,)
    assert scene.sight(none, np.empty((0, 3)), np.empty((0, 3))).clear.shape == (0,)
    assert scene.extent(none).lowest.shape == (0, 3)
    assert scene.inside(np.empty((0, 3))).shape == (0,)


def test_a_way_through_an_obstacle_between_free_ends(make, body):
    """The whole arm sweeps past a thin pole, which is only met near the middle."""
    pole = body("pole", 0, Capsule(0.005, 2.0), (0, 3.5, 0))
    scene = make(obstacles=[pole])
    start, end = np.array([[0.0, 0, 0, 0]]), np.array([[np.pi, 0, 0, 0]])
    ends = scene.clearance(np.concatenate([start, end]), cap_m=9.0)
    assert (ends.distance_m > 0.5).all()
    found = scene.ways(start, end, 0.0)
    assert not found.clear[0]
    assert set(scene.names(found.pair[0])) == {"link4", "pole"}
    assert found.part[0] == pytest.approx(0.5, abs=0.05)
    away = scene.ways(start, -end, 0.0)
    assert away.clear[0]


def test_a_way_that_passes_at_a_known_distance(make, body):
    """The tip passes a ball at 0.25 m less 0.2 m of radii."""
    scene = make(obstacles=[body("part", 0, BALL, (0, 4.25, 0))])
    start, end = np.array([[0.3, 0, 0, 0]]), np.array([[2.9, 0, 0, 0]])
    assert scene.ways(start, end, 0.049).clear[0]
    blocked = scene.ways(start, end, 0.0515)
    assert not blocked.clear[0]
    assert blocked.distance_m[0] < 0.0515
    assert blocked.part[0] == pytest.approx((np.pi / 2 - 0.3) / 2.6, abs=0.02)


def test_a_way_that_starts_blocked(make, body):
    scene = make(obstacles=[body("part", 0, BALL, (4, 0, 0))])
    found = scene.ways(np.zeros((1, 4)), np.ones((1, 4)), 0.0)
    assert not found.clear[0]
    assert found.part[0] == 0.0
    assert found.distance_m[0] == pytest.approx(-0.2)


def test_how_fast_joints_move_bodies_by_hand(straight_arm, body):
    """Seen from a small body at the base, and from one far out on the last link."""
    bodies = [body("base", 0, BALL, (0, 0, 7)), body("far", 4, BALL, (5, 0, 0)),
              body("near", 4, BALL, (1, 0, 0)), body("link1", 1, BALL, (0, 9, 0)),
              body("floor", 0, HalfSpace(), (0, 0, 0))]  # fmt: skip
    pairs = np.array([[0, 1], [2, 3], [3, 2], [1, 4]])
    radii = motion_radii(straight_arm, bodies, pairs)
    # joint axes are at x = 0, 1, 2 and 3; height along an axis counts for the other joints only
    np.testing.assert_allclose(radii[0], [0.1, 7.1, 6.1, 5.1])
    # joint 1 moves both bodies
    np.testing.assert_allclose(radii[1], [0.0, 3.1, 2.1, 1.1])
    np.testing.assert_array_equal(radii[1], radii[2])
    np.testing.assert_allclose(radii[3], [8.1, 7.1, 6.1, 5.1])
    inner = body("inner", 0, BALL, (0, 0, 0))
    radii = motion_radii(straight_arm, [inner, bodies[1]], np.array([[0, 1]]))
    np.testing.assert_allclose(radii[0], [0.1, 1.1, 2.1, 3.1])


def test_many_chunks_give_the_same(make, monkeypatch):
    rng = np.random.default_rng(3)
    q, to = rng.uniform(-3, 3, (2, 50, 4))
    start, end = rng.uniform(-3, 3, (2, 50, 3))
    end[:, 2] = start[:, 2] = 0.0
    scene = make()
    at_once = scene.clearance(q), scene.ways(q, to, 0.01), scene.sight(q, start, end)
    extent = scene.extent(q)
    monkeypatch.setattr(scene_module, "_CHUNK_ENTRIES", 40)
    in_parts = scene.clearance(q), scene.ways(q, to, 0.01), scene.sight(q, start, end)
    for one, other in zip(at_once, in_parts, strict=True):
        for name, values in vars(one).items():
            np.testing.assert_array_equal(values, vars(other)[name])
    np.testing.assert_array_equal(extent, scene.extent(q))
    assert 5 < at_once[2].clear.sum() < 45
    assert 5 < at_once[1].clear.sum() < 45


def test_a_state_that_is_known_is_not_reckoned_again(make, straight_arm):
    scene, q = make(), np.array([[0.3, 0.2, -0.4, 0.1]])
    state = straight_arm.forward(q)
    elsewhere = q + 1.0
    assert scene.clearance(elsewhere, state=state).distance_m == scene.clearance(q).distance_m
    np.testing.assert_array_equal(scene.extent(elsewhere, state=state), scene.extent(q))
    start, end = np.array([[0.5, -2, 0]]), np.array([[0.5, 2, 0]])
    expected = scene.sight(q, start, end).blocker
    one = straight_arm.forward(q[0])
    np.testing.assert_array_equal(scene.sight(q[0], start, end, state=one).blocker, expected)
    assert expected != scene.sight(elsewhere, start, end).blocker


def test_extent_by_hand(make, body):
    """Link 1, the base and obstacles do not count; a tool of a one-joint arm does."""
    scene = make(tool=[body("tool", 4, Box((0.2, 0.4, 0.6)), (1, 0, 0))])
    lowest, highest = scene.extent([[0.0, 0, 0, 0], [np.pi / 2, 0, 0, 0]])
    np.testing.assert_allclose(lowest, [[1.4, -0.2, -0.3], [-0.2, 1.4, -0.3]], atol=1e-12)
    np.testing.assert_allclose(highest, [[4.1, 0.2, 0.3], [0.2, 4.1, 0.3]], atol=1e-12)
    one = SerialChain(np.eye(4)[None], np.array([[0.0, 0, 1]]), np.eye(4))
    arm, tool = [body("link1", 1, BALL, (5, 0, 0))], [body("tool", 1, BALL, (1, 0, 0))]
    np.testing.assert_allclose(
        Scene(one, arm, tool=tool).extent([[0.0]]).highest[0], [1.1, 0.1, 0.1]
    )


def test_extent_of_a_mesh_and_a_cylinder(straight_arm, body):
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))[[0, 1, 2, 4]]
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
    scene = Scene(straight_arm, tool=[body("mesh", 4, mesh, (0, 0, 0))])
    lowest, highest = scene.extent([[np.pi, 0, 0, 0]])
    np.testing.assert_allclose(lowest[0], [-4.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(highest[0], [-3.0, 0.0, 1.0], atol=1e-12)
    tilted = Body("can", 4, transform(rotation_exp([0, np.pi / 4, 0]), [0, 0, 0]), Cylinder(1, 4))
    lowest, highest = Scene(straight_arm, tool=[tilted]).extent(ZERO)
    s = np.sqrt(0.5)
    np.testing.assert_allclose(highest[0], [3 + 3 * s, 1, 3 * s], atol=1e-12)
    np.testing.assert_allclose(lowest[0], [3 - 3 * s, -1, -3 * s], atol=1e-12)


def test_sight_by_hand(make, body):
    wall = body("wall", 0, Box((0.1, 10, 10)), (5, 0, 0))
    floor = body("floor", 0, HalfSpace(), (0, 0, -1))
    scene = make(obstacles=[wall, floor])
    names = [b.name for b in scene.bodies]
    # the last one runs along the wall, half a metre before it
    start = np.array([[1.5, -1, 0], [4.9, 3, 0], [2.0, 0, 0], [2, 0, 0], [2, 1, 0], [4.5, -1, 2]])
    end = np.array([[1.5, 1, 0], [5.1, 3, 0], [2.0, 0, -2], [2, 1, 0], [4.95, 1, 0], [4.5, 1, 2]])
    found = scene.sight([0, 0, 0, 0], start, end)
    assert [names[b] if b >= 0 else "" for b in found.blocker] == [
        "link2", "wall", "floor", "", "", "",
    ]  # fmt: skip
    through = scene.sight([0, 0, 0, 0], start, end, ignore=["link2", "floor"])
    np.testing.assert_array_equal(through.clear, [True, False, True, True, True, True])


def test_sight_past_a_mesh(straight_arm, body):
    """A single triangle: lines through it and just beside it."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    scene = Scene(
        straight_arm, obstacles=[body("sheet", 0, Mesh(corners, np.array([[0, 1, 2]])), (0, 0, 1))]
    )
    through = np.array([[0.2, 0.2], [0.49, 0.49], [0.51, 0.51], [-0.01, 0.5], [0.01, 0.5]])
    start = np.column_stack([through, np.zeros(5)])
    end = np.column_stack([through, np.full(5, 2.0)])
    expected = [False, False, True, True, False]
    np.testing.assert_array_equal(scene.sight(np.zeros(4), start, end).clear, expected)
    end[:, 2] = 0.999  # ends before it
    assert scene.sight(np.zeros(4), start, end).clear.all()


def test_short_lines_of_sight_past_a_mesh(straight_arm):
    """Across an upright sheet, along it, and lines of no length."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sheet = Body("sheet", 0, transform(LYING, [0, 0, 0]), Mesh(corners, np.array([[0, 1, 2]])))
    start = np.array([[-0.01, 0.2, -0.2], [0.01, 0.2, -0.2], [0.01, 0.2, -0.2]])
    end = np.array([[0.01, 0.2, -0.2], [0.01, 0.2, -0.3], [0.01, 0.2, -0.2]])
    found = Scene(straight_arm, obstacles=[sheet]).sight(np.zeros(4), start, end)
    np.testing.assert_array_equal(found.clear, [False, True, True])


def test_a_line_of_sight_may_end_on_a_mesh(straight_arm):
    """As on any other solid; a hundredth of a millimetre beyond, it is blocked."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sheet = Body("sheet", 0, np.eye(4), Mesh(corners, np.array([[0, 1, 2]])))
    start = np.tile([0.2, 0.3, 1.0], (3, 1))
    end = np.array([[0.2, 0.3, 1e-5], [0.2, 0.3, 0.0], [0.2, 0.3, -1e-5]])
    found = Scene(straight_arm, obstacles=[sheet]).sight(np.zeros(4), start, end)
    np.testing.assert_array_equal(found.clear, [True, True, False])


def test_inside_names_the_obstacle_by_its_place_in_the_list(make, body):
    solids = (BALL, Box((0.2, 0.2, 0.2)), Cylinder(0.1, 0.2), Capsule(0.1, 0.2))
    obstacles = [body(f"part{i}", 0, solid, (i, 0, 0)) for i, solid in enumerate(solids)]
    scene = make(obstacles=[*obstacles, body("floor", 0, HalfSpace(), (0, 0, -1))])
    points = np.array([[0.0, 0, 0], [1, 0.09, 0.09], [2, 0, 0.11], [3, 0, 0.11], [0, 0, -1.1]])
    np.testing.assert_array_equal(scene.inside(points), [0, 1, -1, 3, 4])


def test_a_scene_can_be_sent_to_a_worker(make):
    scene, q = make(), np.random.default_rng(5).uniform(-3, 3, (20, 4))
    before = scene.clearance(q)
    there = pickle.loads(pickle.dumps(scene))  # noqa: S301
    np.testing.assert_array_equal(there.clearance(q).distance_m, before.distance_m)
    assert there.excluded == scene.excluded


def test_an_arm_of_the_presets():
    """The flange of a 165 kg robot at zero, 2.2 m above the floor, by a plate on it."""
    robot = Robot.preset("r2000ic165f")
    plate = Body("plate", robot.n, robot.chain.T_link_tip, Cylinder(0.1, 1e-3))
    floor = Body("floor", 0, np.eye(4), HalfSpace())
    found = Scene(robot.chain, tool=[plate], obstacles=[floor]).clearance(np.zeros((1, 6)), cap_m=9)
    T = robot.fk(np.zeros(6))
    lowest = T[2, 3] - 0.1 * np.hypot(*T[2, :2]) - 0.5e-3 * abs(T[2, 2])
    assert found.distance_m[0] == pytest.approx(lowest, abs=1e-12)


@pytest.mark.parametrize(
    ("group", "link", "solid", "says", "hint"),
    [
        ("arm", 5, BALL, "thing is on link 5 of an arm of 4 joints", "0 (the base) to 4"),
        ("arm", -1, BALL, "thing is on link -1 of an arm of 4 joints", "0 (the base) to 4"),
        ("tool", 3, BALL, "tool thing is on link 3", "is on link 4"),
        ("obstacles", 1, BALL, "obstacle thing is on link 1", "is on link 0"),
        ("tool", 4, HalfSpace(), "thing is a half-space and belongs to the robot", "obstacles"),
        ("arm", 0, HalfSpace(), "thing is a half-space and belongs to the robot", "obstacles"),
        ("arm", 1, Sphere(-1.0), "thing: radius_m of the sphere is -1.0", "above zero"),
        ("arm", 1, Sphere(np.nan), "thing: radius_m of the sphere is nan", "above zero"),
        ("arm", 1, Cylinder(0.1, 0.0), "thing: length_m of the cylinder is 0.0", "above zero"),
        ("arm", 1, Capsule(0.1, -0.1), "thing: length_m of the capsule is -0.1", "above zero"),
        ("arm", 1, Capsule(0.0, 0.1), "thing: radius_m of the capsule is 0.0", "above zero"),
        ("arm", 1, Box((1, 0, 1)), "thing: size_m of the box is (1, 0, 1)", "above zero"),
        ("arm", 1, Box((1, np.inf, 1)), "size_m of the box is (1, inf, 1)", "above zero"),
    ],
)  # fmt: skip
def test_bodies_that_cannot_be(make, body, group, link, solid, says, hint):
    with pytest.raises(InputError) as caught:
        make(**{group: [body("thing", link, solid, (0, 0, 0))]})
    assert says in caught.value.message
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("vertices", "triangles", "says"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], "vertices of shape (3, 2)"),
        (np.eye(3), [[0, 1]], "triangles of shape (1, 2)"),
        (np.eye(3), np.empty((0, 3), dtype=int), "thing: the mesh has no triangles"),
        (np.eye(3), [[0, 1, 3]], "thing: a triangle of the mesh names vertex 3 of 3"),
        (np.eye(3), [[0, 1, -1]], "thing: a triangle of the mesh names vertex -1 of 3"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "thing: a vertex of the mesh is not finite"),
    ],
)
def test_meshes_that_cannot_be(make, body, vertices, triangles, says):
    with pytest.raises(InputError) as caught:
        make(arm=[body("thing", 1, Mesh(vertices, np.asarray(triangles)), (0, 0, 0))])
    assert says in caught.value.message


def test_a_placement_that_is_not_rigid(make):
    with pytest.raises(InputError, match="T_link_body of thing"):
        make(arm=[Body("thing", 1, 2 * np.eye(4), BALL)])


def test_ignored_names_that_do_not_exist(make):
    with pytest.raises(InputError, match="there is no body 'tol' to ignore") as caught:
        make(ignore=[("part", "tol")])
    assert caught.value.hint == "did you mean tool?"
    with pytest.raises(InputError, match="there is no body 'prt' to ignore") as caught:
        make().sight(ZERO, [[0, 0, 0]], [[1, 0, 0]], ignore=["prt"])
    assert caught.value.hint == "did you mean part?"


@pytest.mark.parametrize("zero", [[0, 0, 0], np.zeros((2, 4)), [0, 0, 0, np.nan]])
def test_zero_postures_that_are_none(make, zero):
    with pytest.raises(InputError, match="zero"):
        make(zero=zero)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda s: s.clearance(np.zeros((2, 5))), "q has shape (2, 5), the arm has 4 joints"),
        (lambda s: s.clearance(np.zeros((1, 2, 4))), "q has shape (1, 2, 4), the arm has 4 joints"),
        (lambda s: s.clearance([[0, 0, 0, 0], [0, 0, np.inf, 0]]), "posture 1 of q is not finite"),
        (lambda s: s.clearance(ZERO, cap_m=0.0), "cap_m is 0.0"),
        (lambda s: s.ways(ZERO, ZERO, -0.1), "keep_m is -0.1"),
        (lambda s: s.ways(ZERO, ZERO, np.nan), "keep_m is nan"),
        (lambda s: s.ways(ZERO, ZERO, 0.1, cap_m=-1.0), "cap_m is -1.0"),
        (lambda s: s.ways(ZERO, np.zeros((2, 4)), 0.1), "there are 1 starts and 2 ends of ways"),
        (lambda s: s.ways(ZERO, np.zeros((1, 3)), 0.1), "end has shape (1, 3)"),
        (lambda s: s.extent(np.zeros(3)), "q has shape (3,), the arm has 4 joints"),
        (lambda s: s.inside([0, 0, 0]), "points has shape (3,)"),
        (lambda s: s.inside([[0, 0, np.nan]]), "points has shape (1, 3), or a value that is not"),
        (lambda s: s.sight(ZERO, [[0, 0, 0]], [[0, 0]]), "end has shape (1, 2)"),
        (
            lambda s: s.sight(np.zeros((2, 4)), np.zeros((3, 3)), np.zeros((3, 3))),
            "there are 2 postures, 3 starts and 3 ends",
        ),
        (
            lambda s: s.sight(ZERO, np.zeros((3, 3)), np.zeros((2, 3))),
            "there are 1 postures, 3 starts and 2 ends",
        ),
    ],
)
def test_wrong_arguments(make, call, says):
    with pytest.raises(InputError) as caught:
        call(make())
    assert says in caught.value.message
    assert "\n" not in caught.value.message
    assert caught.value.hint


def test_distances_of_all_pairs(make):
    scene = make()
    q = np.random.default_rng(7).uniform(-3, 3, (40, 4))
    cap_m = 0.6
    found = scene.distances(q, cap_m)
    assert found.shape == (40, len(scene.pairs))
    assert (found < 0.0).any()
    assert (found == cap_m).any()
    nearest = scene.clearance(q, cap_m=cap_m)
    assert np.allclose(found.min(axis=1), nearest.distance_m, rtol=0, atol=1e-9)
    for pair in range(len(scene.pairs)):
        alone = scene.with_pairs(scene.pairs[[pair]])
        apart = alone.clearance(q, cap_m=cap_m).distance_m
        assert np.allclose(found[:, pair], apart, rtol=0, atol=1e-9)
    assert np.array_equal(scene.distances(q[:0], cap_m), np.empty((0, len(scene.pairs))))
    with pytest.raises(InputError, match="cap_m is -1"):
        scene.distances(q, -1.0)
