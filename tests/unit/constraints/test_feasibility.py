"""Every constraint against what it means geometrically, verdicts, and the choice of postures."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import FileFormatError
from calib.robots import CoupledLimit, Robot
from calib.se3 import rotation_exp
from posedesign.candidates.postures import no_pose
from posedesign.cell import Cell, touching_poses
from posedesign.constraints import (
    Checker,
    Collision,
    Constraint,
    Distance,
    InImage,
    Situation,
    Tilt,
    nearest_postures,
)
from posedesign.constraints.checker import CoupledLimits, JointLimits, Singularity
from posedesign.constraints.visibility import LineOfSight


def situation(cell: Cell, *postures_deg: list[float]) -> Situation:
    return Situation(cell.robot.chain, np.deg2rad(np.array(postures_deg)))


def turned(cell: Cell, axis: str, degrees: float) -> Situation:
    """The base pose turned about an axis of the tool, the tool point still on the target."""
    R = cell.robot.fk(cell.base_posture)[:3, :3]
    turn = rotation_exp(np.deg2rad(degrees) * np.eye(3)["xyz".index(axis)])
    pose = touching_poses((R @ turn)[None], cell.tool_m, cell.target_m)
    found = nearest_postures(Checker(cell.robot), pose, cell.base_posture)
    assert found.feasible.all(), found.reasons
    return Situation(cell.robot.chain, found.q)


def only(cell: Cell, kind: type[Constraint]) -> Constraint:
    return next(c for c in cell.checker.constraints if type(c) is kind)


# joints


@pytest.mark.parametrize(
    ("q", "margin", "reason"),
    [
        ([0, 15, -25, 0, -50, 0], 61.0, "J2 15.0 deg, upper bound 76.0 deg"),
        ([0, 75, -25, 0, -50, 0], 1.0, "J2 75.0 deg, upper bound 76.0 deg"),
        ([0, -59, -25, 0, -50, 0], 1.0, "J2 -59.0 deg, lower bound -60.0 deg"),
        ([0, 15, -25, 0, -131.2, 0], -6.2, "J5 -131.2 deg is below -125.0 deg"),
    ],
)
def test_joint_limits(reference_cell, q, margin, reason):
    verdicts = Checker(reference_cell.robot).check(np.deg2rad([q]))
    assert np.rad2deg(verdicts.margin[0, 0]) == pytest.approx(margin)
    limits = verdicts.constraints[0]
    assert limits.reason(verdicts.arm, 0, verdicts.margin[0, 0], verdicts.which[0, 0]) == reason
    assert verdicts.feasible[0] == (margin >= 0)


def test_a_margin_moves_every_bound(reference_cell):
    robot = reference_cell.robot
    q = np.deg2rad([[0.0, 75.5, -25.0, 0.0, -50.0, 0.0]])
    verdicts = Checker(robot, margin=np.deg2rad(1.0)).check(q)
    assert not verdicts.feasible[0]
    assert verdicts.reason(0) == "J2 75.5 deg is above 75.0 deg (1 deg inside the limit)"


def test_coupled_limits():
    """q3 - q2 within -60 .. 40 deg, whatever the joints by themselves may do."""
    bare = Robot.preset("r2000ic165f")
    limit = CoupledLimit(
        "J3 to the horizontal", np.array([0.0, -1, 1, 0, 0, 0]), np.deg2rad(-60), np.deg2rad(40)
    )
    robot = replace(bare, coupled_limits=(limit,))
    checker = Checker(robot, margin=np.deg2rad(2.0))
    q = np.deg2rad([[0, 10, -30, 0, -50, 0], [0, 35, -30, 0, -50, 0], [0, 10, 49, 0, -50, 0.0]])
    verdicts = checker.check(q)
    k = [isinstance(c, CoupledLimits) for c in verdicts.constraints].index(True)
    # -40: 20 from the lower bound; -65: 5 beyond it; 39: 1 from the upper; less the margin
    np.testing.assert_allclose(np.rad2deg(verdicts.margin[:, k]), [18.0, -7.0, -1.0])
    assert verdicts.feasible.tolist() == [True, False, False]
    assert verdicts.reason(1) == "J3 to the horizontal -65.0 deg is below -60.0 deg"
    assert verdicts.reason(2) == (
        "J3 to the horizontal 39.0 deg is above 38.0 deg (2 deg inside the limit)"
    )
    assert verdicts.hint(1) == ""  # no margin would help
    assert verdicts.hint(2) == "lower plan.limit_margin_deg"


def test_coupled_limits_of_the_cell(make_cell):
    """Beside those of the preset, or in their place."""
    given = {
        "name": "J2 with J3",
        "coefficients": [0.0, 1.0, 1.0, 0.0, 0.0, 0.0],
        "lower_deg": -20.0,
        "upper_deg": 90.0,
    }
    cell = make_cell(robot={"coupled_limit": [given]})
    names = [limit.name for limit in cell.robot.coupled_limits]
    assert names == ["J3 to the horizontal", "J2 with J3"]
    verdicts = cell.checker.check(np.deg2rad([[0.0, 5.0, -26.0, 0.0, -50.0, 0.0]]))
    assert verdicts.reason(0) == "J2 with J3 -21.0 deg is below -20.0 deg"
    with pytest.raises(FileFormatError, match="the base pose is outside the limits: J2 with J3"):
        make_cell(robot={"coupled_limit": [{**given, "lower_deg": -9.0}]})
    alone = make_cell(robot={"coupled_limit": [given], "keep_coupled_limits": False})
    assert [limit.name for limit in alone.robot.coupled_limits] == ["J2 with J3"]
    assert make_cell(robot={"keep_coupled_limits": False}).robot.coupled_limits == ()


def test_singular_value_against_an_svd_of_pinocchio(reference_cell):
    pin = pytest.importorskip("pinocchio")
    robot = reference_cell.robot
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (20, 6))
    margin, _ = Singularity(0.0).margin(Situation(robot.chain, q))
    data = robot.model.createData()
    frame = robot.model.getFrameId(robot.tip_frame)
    for posture, value in zip(q, margin, strict=True):
        J = pin.computeFrameJacobian(
            robot.model, data, posture, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        J[:3] /= 1.075 + 0.225 + 1.280 + 0.215  # from joint 2 to the faceplate
        assert value == pytest.approx(np.linalg.svd(J, compute_uv=False)[-1], abs=1e-9)


def test_a_straight_wrist_is_singular(make_cell):
    cell = make_cell(constraints={"collisions": False, "smallest_singular_value": 0.02})
    q = np.deg2rad([[0.0, 15.0, -25.0, 0.0, 0.0, 0.0], [0.0, 15.0, -25.0, 0.0, -50.0, 0.0]])
    verdicts = cell.checker.check(q)
    assert verdicts.feasible.tolist() == [False, True]
    assert verdicts.reason(0) == "smallest singular value 0.000, bound 0.02"


# what the camera sees


@pytest.fixture
def seeing(make_demo_cell) -> Cell:
    return make_demo_cell(constraints={"collisions": False}, obstacle=None)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 60.0, 69.9])
def test_tilt_is_the_angle_that_the_tool_is_turned_by(seeing, degrees):
    """The target faces the camera of the base pose, which looks along the tool."""
    arm = turned(seeing, "y", degrees)
    margin, _ = only(seeing, Tilt).margin(arm)
    assert np.rad2deg(margin[0]) == pytest.approx(70.0 - degrees, abs=1e-6)


def test_tilt_beyond_its_bound(seeing):
    verdicts = seeing.checker.check(turned(seeing, "y", 75.0).q)
    assert not verdicts.feasible[0]
    assert verdicts.reason(0) == "target seen at a tilt of 75.0 deg, largest allowed 70 deg"


def test_the_normal_of_the_target_may_be_given(make_demo_cell):
    slanted = [np.sin(np.deg2rad(30.0)), 0.0, np.cos(np.deg2rad(30.0))]
    cell = make_demo_cell(target={"normal": slanted})
    margin, _ = only(cell, Tilt).margin(situation(cell, [0, 15, -25, 0, -50, 0]))
    assert np.rad2deg(margin[0]) == pytest.approx(40.0, abs=1e-6)


def test_the_default_normal_faces_the_camera_of_the_base_pose(make_demo_cell):
    """Also where the target is moved: the base pose is then moved onto it, its orientation kept."""
    cell = make_demo_cell(target={"position_mm": [1800.0, 200.0, 600.0]}, obstacle=None)
    np.testing.assert_allclose(cell.target_normal, [0.0, 0.0, 1.0], atol=1e-12)


def test_the_rolled_target_stays_in_the_middle(seeing):
    """The tool point is the middle of the image: 512 px to the edge, less the radius and border.

    10 mm at 250 mm with 1800 px: 72 px, and the corners of the octagon about it a little farther.
    """
    margin, _ = only(seeing, InImage).margin(turned(seeing, "z", 37.0))
    reach_px = 1800.0 * 10.0 / 250.0
    assert 482.0 - reach_px / np.cos(np.pi / 8) - 1e-9 <= margin[0] <= 482.0 - reach_px + 1e-9


def test_target_outside_the_image(make_demo_cell):
    """A lens turned by 15 deg sees the target 1800 tan(15) = 482 px off the middle."""
    cell = make_demo_cell(camera={"wpr_deg": [15.0, 0.0, 0.0]}, target={"radius_mm": 0.0})
    margin, _ = only(cell, InImage).margin(situation(cell, [0, 15, -25, 0, -50, 0]))
    assert margin[0] == pytest.approx(512.0 - 1800.0 * np.tan(np.deg2rad(15.0)) - 30.0)
    away = make_demo_cell(camera={"wpr_deg": [170.0, 0.0, 0.0]})
    verdicts = away.checker.check(away.base_posture[None])
    assert verdicts.reason(0) == "the camera looks away from the target, by 170 deg"


@pytest.mark.parametrize(
    ("nearest", "farthest", "margin", "reason"),
    [
        (100.0, 700.0, 150.0, "target 250 mm from the camera, nearest allowed 100 mm"),
        (260.0, 700.0, -10.0, "target 250 mm from the camera, nearest allowed 260 mm"),
        (100.0, 240.0, -10.0, "target 250 mm from the camera, farthest allowed 240 mm"),
    ],
)
def test_distance(make_demo_cell, nearest, farthest, margin, reason):
    cell = make_demo_cell(camera={"nearest_mm": nearest, "farthest_mm": farthest})
    arm = situation(cell, [0, 15, -25, 0, -50, 0])
    distance = only(cell, Distance)
    found, which = distance.margin(arm)
    assert 1e3 * found[0] == pytest.approx(margin, abs=1e-6)
    assert distance.reason(arm, 0, found[0], which[0]) == reason


def test_something_in_the_line_of_sight(make_demo_cell):
    x, y, z = 1e3 * make_demo_cell().target_m
    post = {"name": "post", "size_mm": [10.0, 10.0, 50.0], "at_mm": [x, y, z + 60.0]}
    cell = make_demo_cell(obstacle=[post], constraints={"collisions": False})
    verdicts = cell.checker.check(cell.base_posture[None])
    assert not verdicts.feasible[0]
    assert verdicts.reason(0) == "post stands between camera and target"
    beside = make_demo_cell(
        obstacle=[{**post, "at_mm": [x + 20.0, y, z + 60.0]}], constraints={"collisions": False}
    )
    assert beside.checker.check(cell.base_posture[None]).feasible[0]


@pytest.mark.parametrize(("beside_mm", "seen"), [(0.2, False), (1.0, True)])
def test_a_clamp_over_the_rim_blocks_the_view(make_demo_cell, beside_mm, seen):
    """The middle of the target is free, and its rim where the clamp ends just outside."""
    plain = make_demo_cell()
    x, y, z = 1e3 * plain.target_m
    radius = plain.config.target.radius_mm
    edge = radius * (beside_mm if not seen else 1.0) + (0.5 if seen else 0.0)
    clamp = {"name": "clamp", "size_mm": [40.0, 40.0, 1.0], "at_mm": [x, y + edge + 20.0, z + 3.0]}
    cell = make_demo_cell(obstacle=[clamp], constraints={"collisions": False})
    straight = cell.checker.check(cell.base_posture[None])
    assert straight.feasible[0] == seen
    if not seen:
        assert straight.reason(0) == "clamp stands between camera and target"


def test_the_tool_itself_may_block_the_view(make_demo_cell):
    tool = {"name": "clamp", "size_mm": [300.0, 300.0, 50.0], "at_mm": [100.0, 0.0, 200.0]}
    cell = make_demo_cell(tool={"body": [tool]}, obstacle=None, constraints={"collisions": False})
    verdicts = cell.checker.check(cell.base_posture[None])
    assert verdicts.reason(0) == "clamp stands between camera and target"
    sight = only(cell, LineOfSight)
    margin, which = sight.margin(verdicts.arm)
    assert margin[0] < 0
    assert cell.scene.bodies[which[0]].name == "clamp"


# space


def test_two_bodies_too_near(make_demo_cell):
    """A wall beside the gun, 15 mm from its side."""
    cell = make_demo_cell()
    T = cell.robot.fk(cell.base_posture)
    side = 1e3 * (T[:3, 3] + T[:3, :3] @ [-0.010, 0.110, 0.145])  # middle of the gun's side
    wall = {
        "name": "wall",
        "size_mm": [300.0, 10.0, 300.0],
        "at_mm": (side - [0.0, 20.0, 0.0]).tolist(),  # tool y points to -y of the base
    }
    near = make_demo_cell(obstacle=[wall])
    verdicts = near.checker.check(near.base_posture[None])
    assert not verdicts.feasible[0]
    assert verdicts.reason(0) == "gun 15.0 mm from wall, 20 mm asked for"
    closer = make_demo_cell(obstacle=[wall], constraints={"safety_distance_mm": 10.0})
    assert closer.checker.check(near.base_posture[None]).feasible[0]
    ignored = make_demo_cell(
        obstacle=[wall], constraints={"ignore": [["wall", "gun"]]}, plan={"retreat_mm": 400.0}
    )
    assert ignored.checker.check(near.base_posture[None]).feasible[0]


def test_workspace_box(make_demo_cell):
    """Farthest to the front is the side of the camera, 240 mm along x of the tip."""
    cell = make_demo_cell()
    front = 1e3 * cell.robot.fk(cell.base_posture)[0, 3] + 240.0
    box = {
        "workspace_lowest_mm": [-2000.0, -2000.0, 0.0],
        "workspace_highest_mm": [front - 10.0, 2000.0, 4000.0],
    }
    narrow = make_demo_cell(constraints=box)
    verdicts = narrow.checker.check(cell.base_posture[None])
    assert not verdicts.feasible[0]
    expected = f"camera 10 mm outside the workspace, beyond x = {front - 10.0:.0f} mm"
    assert verdicts.reason(0) == expected
    box["workspace_highest_mm"] = [front + 10.0, 2000.0, 4000.0]
    wide = make_demo_cell(constraints=box)
    assert wide.checker.check(cell.base_posture[None]).feasible[0]


def test_the_workspace_is_kept_on_the_ways_too(make_demo_cell):
    """From 30 deg to the left to 30 deg to the right the camera swings out to the front."""
    cell = make_demo_cell(camera=None, obstacle=None)
    q = np.tile(cell.base_posture, (2, 1))
    q[:, 0] = np.deg2rad([-30.0, 30.0])
    # farthest to the front at the two ends, and on the way
    _, ends = cell.scene.extent(q)
    _, middle = cell.scene.extent(cell.base_posture[None])
    front = 1e3 * float(max(ends[:, 0].max(), middle[0, 0]) - 0.02)
    box = {
        "workspace_lowest_mm": [-3000.0, -3000.0, -100.0],
        "workspace_highest_mm": [front, 3000.0, 4000.0],
    }
    narrow = make_demo_cell(camera=None, obstacle=None, constraints=box)
    assert narrow.checker.check(q).feasible.all()
    verdicts = narrow.ways.check(q[:1], q[1:])
    assert not verdicts.clear[0]
    assert f"beyond x = {front:.0f} mm" in verdicts.reasons[0]
    assert not narrow.passing.check(cell.base_posture[None]).feasible[0]


def test_an_arm_without_bodies_keeps_the_workspace_all_the_same(make_cell):
    """Its joints and its tool point do: that of the reference cell is at x = 1915 mm."""
    box = {
        "collisions": False,
        "workspace_lowest_mm": [-3000.0, -3000.0, -100.0],
        "workspace_highest_mm": [1900.0, 3000.0, 4000.0],
    }
    cell = make_cell(constraints=box)
    cell = replace(cell, robot=replace(cell.robot, bodies=()))
    verdicts = cell.checker.check(cell.base_posture[None])
    assert not verdicts.feasible[0]
    assert verdicts.reason(0) == "tool point 15 mm outside the workspace, beyond x = 1900 mm"


@pytest.mark.parametrize("distance", [600.0, 2500.0])
def test_safety_distances_of_more_than_half_a_metre(make_demo_cell, distance):
    """A ball 1.5 m from everything that moves."""
    ball = {"name": "ball", "kind": "sphere", "radius_mm": 50.0, "at_mm": [1900.0, 2500.0, 1000.0]}
    cell = make_demo_cell(
        obstacle=[ball], tool={"body": []}, constraints={"safety_distance_mm": distance}
    )
    collision = only(cell, Collision)
    margin, which = collision.margin(situation(cell, [0, 15, -25, 0, -50, 0]))
    assert (margin[0] >= 0) == (distance == 600.0)
    if distance == 2500.0:
        said = collision.reason(
            situation(cell, [0, 15, -25, 0, -50, 0]), 0, float(margin[0]), int(which[0])
        )
        assert "from ball, 2500 mm asked for" in said
        assert not cell.ways.check(cell.base_posture[None], cell.base_posture[None]).clear[0]


# verdicts


class NoNumber(JointLimits):
    """A constraint whose room cannot be computed."""

    def margin(self, arm: Situation) -> tuple[np.ndarray, np.ndarray]:
        return np.full(len(arm.q), np.nan), np.zeros(len(arm.q), dtype=np.intp)


@pytest.mark.parametrize("every", [True, False])
def test_a_room_that_is_no_number_is_none(reference_cell, every):
    robot = reference_cell.robot
    checker = Checker(robot, [NoNumber(robot, 0.0)])
    verdicts = checker.check(reference_cell.base_posture[None], every=every)
    assert not verdicts.feasible[0]


def test_later_constraints_are_spared_what_is_lost(demo_cell):
    q = np.vstack([demo_cell.base_posture, np.deg2rad([0.0, 90.0, -25.0, 0.0, -50.0, 0.0])])
    lazy = demo_cell.checker.check(q, every=False)
    full = demo_cell.checker.check(q)
    assert np.isnan(lazy.margin[1, 1:]).all()
    assert not np.isnan(full.margin).any()
    np.testing.assert_array_equal(lazy.feasible, full.feasible)
    assert (lazy.margin[0] <= full.margin[0] + 1e-9).all()
    assert lazy.reason(1) == "J2 90.0 deg is above 76.0 deg"


def test_what_is_broken_is_measured_all_the_same(demo_cell):
    """Of postures that people need not read about only distances that are kept are left open."""
    rng = np.random.default_rng(6)
    robot = demo_cell.robot
    q = demo_cell.base_posture + rng.uniform(-0.5, 0.5, (400, robot.n))
    checker = Checker(robot, demo_cell.solid)
    lazy, full = (checker.check(q, every=every) for every in (False, True))
    np.testing.assert_array_equal(lazy.feasible, full.feasible)
    broken = lazy.margin < 0.0
    assert (broken.sum(axis=1) == ~full.feasible).all()
    collision = [c.name for c in full.constraints].index("collision")
    assert broken[:, collision].any()
    assert (lazy.margin < full.margin - 1e-9).any()
    np.testing.assert_allclose(lazy.margin[broken], full.margin[broken], atol=1e-9)
    np.testing.assert_array_equal(lazy.which[broken], full.which[broken])


def test_order_of_postures_does_not_matter(demo_cell):
    rng = np.random.default_rng(5)
    robot = demo_cell.robot
    size = np.repeat([0.02, 0.6], 30)[:, None]
    q = demo_cell.base_posture + size * rng.uniform(-1.0, 1.0, (60, robot.n))
    order = rng.permutation(60)
    one, other = demo_cell.checker.check(q), demo_cell.checker.check(q[order])
    np.testing.assert_allclose(one.margin[order], other.margin, atol=1e-12)
    assert one.feasible.any()
    assert not one.feasible.all()


def test_no_postures(demo_cell):
    verdicts = demo_cell.checker.check(np.empty((0, 6)))
    assert verdicts.feasible.shape == (0,)


# the choice of postures


def test_a_branch_that_collides_gives_way_to_another(make_demo_cell):
    """A post where the forearm's elbow-up branch is: the pose is still taken, otherwise."""
    cell = make_demo_cell(constraints={"collisions": False}, obstacle=None)
    pose = cell.robot.fk(cell.base_posture)[None]
    plain = nearest_postures(cell.checker, pose, cell.base_posture)
    np.testing.assert_allclose(plain.q[0], cell.base_posture, atol=1e-9)

    class NotThisBranch(JointLimits):
        name = "test"

        def margin(self, arm: Situation) -> tuple[np.ndarray, np.ndarray]:
            apart = np.abs(arm.q - cell.base_posture).max(axis=1)
            return np.where(apart < 0.1, -1.0, 1.0), np.zeros(len(apart), dtype=np.intp)

    checker = Checker(cell.robot, [NotThisBranch(cell.robot, 0.0)])
    other = nearest_postures(checker, pose, cell.base_posture)
    assert other.feasible[0]
    assert np.abs(other.q[0] - cell.base_posture).max() > 0.1
    np.testing.assert_allclose(cell.robot.fk(other.q[0]), pose[0], atol=1e-9)
    # of all other branches the nearest
    branches = cell.robot.inverse(pose, near=cell.base_posture).of(0)
    apart = np.sort(np.linalg.norm(branches - cell.base_posture, axis=1))
    assert np.linalg.norm(other.q[0] - cell.base_posture) == pytest.approx(apart[1])


class Shallow(Constraint):
    """A bound that is broken a little by every posture."""

    name, unit, display, comfort, off = "shallow", "mm", 1e3, 0.05, -0.01

    def margin(self, arm: Situation) -> tuple[np.ndarray, np.ndarray]:
        return np.full(len(arm.q), self.off), np.zeros(len(arm.q), dtype=np.intp)

    def reason(self, arm: Situation, i: int, margin: float, which: int) -> str:
        return f"{self.name} {-1e3 * margin:.0f} mm"

    def hint(self, margin: float) -> str:
        return f"mend {self.name}"


class Deep(Shallow):
    """One that is broken far more, and looked at later."""

    name, off = "deep", -0.091


def test_the_reason_is_what_is_broken_worst_not_first(demo_cell):
    checker = Checker(demo_cell.robot, [Shallow(), Deep()])
    base = demo_cell.base_posture
    poses = demo_cell.robot.fk(np.tile(base, (3, 1)))
    found = nearest_postures(checker, poses, base)
    assert found.reasons == ("deep 91 mm",) * 3
    assert found.hints == ("mend deep",) * 3
    nothing = no_pose(checker, poses, base, lambda s: np.ones(len(s.pose), dtype=bool), ("", ""))
    assert str(nothing).startswith("none of 3 poses can be taken; 100% of them: deep, e.g. deep 91")


def test_reasons_of_poses_that_cannot_be_taken(make_demo_cell):
    cell = make_demo_cell(camera=None)
    poses = np.tile(cell.robot.fk(cell.base_posture), (3, 1, 1))
    poses[0, 0, 3] += 3.0  # out of reach
    poses[1, 2, 3] -= 0.7  # the gun would go through the floor
    found = nearest_postures(cell.checker, poses, cell.base_posture)
    assert found.feasible.tolist() == [False, False, True]
    assert found.reasons[0].startswith("out of reach by ")
    assert "floor" in found.reasons[1] or "fixture" in found.reasons[1]
    assert "constraints.safety_distance_mm" in found.hints[1]
    assert found.hints[2] == ""
    assert found.reasons[2] == ""
    assert np.isnan(found.q[:2]).all()
