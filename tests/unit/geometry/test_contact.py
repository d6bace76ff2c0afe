"""Contact is never room: of meshes with meshes, with other solids, and of one inside the other."""

import itertools

import numpy as np
import pytest

from calib.geometry import Body, Box, Mesh, Scene, Solid, Sphere
from calib.geometry import engine as engine_module
from calib.geometry.ways import TOUCH_M
from calib.robots import NO_EXTERNAL_AXES
from calib.se3 import rotation_exp, transform
from posedesign.constraints import Checker, Collision, MotionChecker, SelfCollision

ZERO = np.zeros((1, 4))
FACES = [(0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]


def box_mesh(*size_m: float, faces: slice = slice(None)) -> Mesh:
    """A box of triangles; faces 10 and 11 are those at its upper end."""
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size_m
    return Mesh(corners, np.array(FACES, dtype=np.intp)[faces])


CUBE, CUBE_MESH = Box((0.2, 0.2, 0.2)), box_mesh(0.2, 0.2, 0.2)
OPEN = slice(0, 10)


@pytest.mark.parametrize(("one", "other"), list(itertools.product([CUBE, CUBE_MESH], repeat=2)))
@pytest.mark.parametrize("apart_m", [0.15, 0.06, 0.0])
def test_contact_is_below_zero_and_as_deep_as_it_is(straight_arm, body, one, other, apart_m):
    """Cubes of 200 mm, two links apart, meet along x, or one lies in the other."""
    arm = [body("link2", 2, one, (1, 0, 0)), body("link4", 4, other, (apart_m - 1, 0, 0))]
    scene = Scene(straight_arm, arm, zero=[0, 0, 0, 2])
    found = scene.clearance(ZERO, depths=True)
    assert found.distance_m[0] == pytest.approx(apart_m - 0.2, rel=0.002)
    assert scene.clearance(ZERO).distance_m[0] < -1e-9
    assert not scene.ways(ZERO, ZERO, 0.0).clear[0]


def test_what_lies_inside_a_closed_mesh_touches_it(straight_arm, body):
    """Mesh or ball, the smaller one first or second; through an open end it is outside."""
    hollow = Body("hollow", 0, transform(np.eye(3), [4, 0, 0]), box_mesh(1.0, 1.0, 1.0))
    opened = Body("hollow", 0, hollow.T_link_body, box_mesh(1.0, 1.0, 1.0, faces=OPEN))
    for solid in (CUBE_MESH, Sphere(0.1)):
        tool = [body("tool", 4, solid, (1, 0, 0))]
        inside = Scene(straight_arm, tool=tool, obstacles=[hollow])
        assert inside.clearance(ZERO).distance_m[0] < -1e-9
        # out through a side: the half metre to it, and the small one's own half
        assert inside.clearance(ZERO, depths=True).distance_m[0] == pytest.approx(-0.6, rel=0.002)
        assert not inside.ways(ZERO, ZERO, 0.0).clear[0]
        free = Scene(straight_arm, tool=tool, obstacles=[opened])
        assert free.clearance(ZERO).distance_m[0] == pytest.approx(0.4, abs=1e-5)
        swallowed = Scene(
            straight_arm,
            tool=[body("tool", 4, box_mesh(1.0, 1.0, 1.0), (1, 0, 0))],
            obstacles=[Body("part", 0, hollow.T_link_body, solid)],
        )
        assert swallowed.clearance(ZERO).distance_m[0] < -1e-9


@pytest.mark.parametrize(("tool", "part"), list(itertools.product([CUBE, CUBE_MESH], repeat=2)))
def test_no_safety_distance_is_no_leave_to_touch(straight_arm, body, tool, part):
    """Postures and motions, of solids of every kind, and the words for them."""
    scene = Scene(
        straight_arm,
        tool=[body("tool", 4, tool, (1, 0, 0))],
        obstacles=[body("part", 0, part, (0, 4, 0))],
    )
    # at 90 deg the tool is in the part, at 10 deg less it is beside it
    q = np.deg2rad([[90.0, 0, 0, 0], [90.0, 1.0, 0, 0], [80.0, 0, 0, 0], [100.0, 0, 0, 0]])
    collision = Collision(scene, 0.0)

    class Free:
        """A robot without limits."""

        chain, n, coupled_limits = straight_arm, 4, ()
        external, sliding = NO_EXTERNAL_AXES, np.zeros(4, dtype=bool)
        lower, upper = np.full(4, -9.0), np.full(4, 9.0)
        joint_names = ("j1", "j2", "j3", "j4")

    verdicts = Checker(Free(), [collision]).check(q)
    np.testing.assert_array_equal(verdicts.feasible, [False, False, True, True])
    assert verdicts.reason(0) == "tool and part run 200 mm into each other"
    through = MotionChecker((collision,), np.inf).check(q[2:3], q[3:4])
    assert not through.clear[0]
    assert "tool" in through.reasons[0]


@pytest.mark.parametrize("solid", [CUBE, CUBE_MESH])
def test_a_motion_that_grazes_is_not_clear(straight_arm, body, solid):
    """By a twentieth of a millimetre, for a thousandth of the motion; ends far from it."""
    corner = 0.1 * np.sqrt(2.0)
    # the corner of the tool, turned by 45 deg, is 4 m + corner from the base
    tool = Body("tool", 4, transform(rotation_exp([0, 0, np.pi / 4]), [1, 0, 0]), solid)
    for gap_m, clear in ((-5e-5, False), (2e-4, True)):
        ball = body("part", 0, Sphere(1e-4), (0, 4.0 + corner + 1e-4 + gap_m, 0))
        collision = SelfCollision(Scene(straight_arm, tool=[tool], obstacles=[ball]))
        start, end = np.deg2rad([[80.0, 0, 0, 0]]), np.deg2rad([[97.0, 0, 0, 0]])
        assert MotionChecker((collision,), np.inf).check(start, end).clear[0] == clear


def test_a_tool_is_checked_against_the_wrist_unless_its_mount_always_touches(straight_arm, body):
    """Beside the last joint, clear at zero and in the wrist as the joint turns."""
    wrist = [body("wrist", 3, Box((0.2, 0.2, 0.2)), (0.5, 0, 0))]
    mount = body("mount", 4, Sphere(0.45), (0, 0, 0))
    camera = body("camera", 4, Sphere(0.1), (0.45, 0, 0))
    scene = Scene(straight_arm, wrist, tool=[mount, camera])
    assert scene.excluded == (("wrist", "mount"),)
    turned = np.array([[0, 0, 0, 0.0], [0, 0, 0, np.pi]])
    distance = scene.clearance(turned).distance_m
    assert distance[0] > 0.5 - 1e-6
    assert distance[1] == pytest.approx(0.95 - 0.9 - 0.1 - 0.1, abs=1e-6)
    # where the last joint cannot turn so far, a mount that touches wherever it can is left out
    near = body("near", 4, Sphere(0.2), (-0.3, 0, 0))
    assert Scene(straight_arm, wrist, tool=[near], last_range=(-0.5, 0.5)).excluded
    assert not Scene(straight_arm, wrist, tool=[near]).excluded


def test_bodies_nearer_than_descriptions_are_touch(straight_arm, body):
    """Half of TOUCH_M is refused, though it is no contact yet."""
    part = body("part", 0, Sphere(0.1), (4.2 + TOUCH_M / 2, 0, 0))
    collision = Collision(
        Scene(straight_arm, tool=[body("tool", 4, Sphere(0.1), (1, 0, 0))], obstacles=[part]), 0.0
    )
    assert collision.scene.clearance(ZERO).distance_m[0] == pytest.approx(TOUCH_M / 2)
    assert collision.explain(TOUCH_M / 2, 0) == "tool runs into part"


def test_a_mesh_has_one_tree_whoever_asks(straight_arm, body, monkeypatch):
    """Half a kilobyte a triangle: a scene, its parts and the lines of sight share it."""
    built = []
    whole = engine_module.coal.BVHModelOBBRSS
    monkeypatch.setattr(engine_module.coal, "BVHModelOBBRSS", lambda: built.append(1) or whole())
    mesh: Solid = box_mesh(0.2, 0.2, 0.2)
    arm = [body("link2", 2, mesh, (0.5, 0, 0)), body("link4", 4, CUBE, (0.5, 0, 0))]
    scene = Scene(straight_arm, arm, obstacles=[body("part", 0, mesh, (9, 0, 0))])
    for part in (scene, scene.own, scene.others):
        part.clearance(ZERO)
        part.sight(ZERO, [[0, 0, 0]], [[1, 1, 1]])
    assert len(built) == 1
