"""The robots that come with the library, against what is published of them."""

import itertools
import re

import coal
import numpy as np
import pinocchio as pin
import pytest

from calib import Robot, preset_names, se3
from calib.errors import RobotModelError
from calib.geometry import Box, Capsule
from calib.robots import POSITIVE_AXES, preset_info

FIG7 = "r2000ia165f_fig7"

NAMES = (
    "gp7", "hp3", "irb120", "irb6700_200_260", "kr6r900sixx", "lrmate200id", "m20ia", "mh5",
    "panda", FIG7, "r2000ib210f", "r2000ic165f", "tx2_60", "tx2_90", "ur10e", "ur5e",
)  # fmt: skip

# d1, a1, a2, a3, d4, d6 [mm] and the sense of J3 and J5: height and offset of J2, upper arm,
# elbow offset, forearm, flange
ELBOW_ARMS = {
    "r2000ic165f": ((670, 312, 1075, 225, 1280, 215), -1),
    "r2000ib210f": ((670, 312, 1075, 225, 1280, 235), -1),
    FIG7: ((479, 0, 1075, 0, 1300, 260), -1),
    "m20ia": ((525, 150, 790, 250, 835, 100), -1),
    "lrmate200id": ((330, 50, 330, 35, 335, 80), -1),
    "mh5": ((330, 88, 310, 39.9, 305, 86.5), -1),
    "gp7": ((330, 40, 445, 40, 440, 80), -1),
    "hp3": ((300, 100, 290, 85, 300, 90), -1),
    "irb120": ((290, 0, 270, 70, 302, 72), 1),
    "irb6700_200_260": ((780, 320, 1125, 200, 1142.5, 200), 1),
    "kr6r900sixx": ((400, 25, 455, 35, 420, 80), 1),
}

# d1, a1, a2, y3, d5, d6 [mm]: straight up at zero
STAUBLI_ARMS = {"tx2_60": (375, 0, 290, 20, 310, 70), "tx2_90": (478, 50, 425, 50, 425, 100)}

# d1, a2, a3, d4, d5, d6 [m], as Universal Robots publishes them
UR_DH = {
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
}

AROUND = np.deg2rad(40.0)


def test_the_presets_are_those_of_the_manual():
    assert tuple(preset_names()) == NAMES


def test_pin_tip_of_the_reference_cell(reference_robot):
    """The check value that independent code gave for the reference cell."""
    T_base_tip = reference_robot.fk(np.deg2rad([0, 15, -25, 0, -50, 0]))
    tip_mm = 1e3 * se3.apply(T_base_tip, np.array([0.2, -0.05, 0.35]))
    np.testing.assert_allclose(tip_mm, [1915.4, 50.0, 493.0], atol=0.05)
    expected = se3.rotation_from_wpr(np.deg2rad([180, 0, 0]))
    np.testing.assert_allclose(T_base_tip[:3, :3], expected, atol=1e-14)


def test_pendant_position_of_the_real_controller():
    """Pendant J (0, 0, 0, 0, -90, 0): X 1592, Y 0, Z 1085 mm; all zero: X 1807, Z 1300."""
    robot = Robot.preset("r2000ic165f")
    shown = robot.controller.posture([[0, 0, 0, 0, -90, 0], [0, 0, 0, 0, 0, 0]])
    T = robot.controller.in_world(robot.fk(shown))
    np.testing.assert_allclose(T[:, :3, 3], [[1.592, 0, 1.085], [1.807, 0, 1.3]], atol=1e-12)
    np.testing.assert_allclose(T[0, :3, :3], np.diag([1, -1, -1]), atol=1e-14)


def test_lengths_of_figure_7():
    robot = Robot.preset(FIG7)
    origins = robot.state(np.zeros(6)).origins
    np.testing.assert_allclose(origins[1], [0, 0, 0.479], atol=1e-15)  # L1
    np.testing.assert_allclose(origins[2] - origins[1], [0, 0, 1.075], atol=1e-15)  # L2
    np.testing.assert_allclose(origins[4] - origins[2], [1.300, 0, 0], atol=1e-15)  # L3, L4
    tip = robot.fk(np.zeros(6))[:3, 3]
    np.testing.assert_allclose(tip - origins[4], [0.260, 0, 0], atol=1e-15)  # L5, L6


def test_the_figure_folds_the_elbow_offset_into_the_forearm(reference_robot):
    public = reference_robot.state(np.zeros(6)).origins
    assert np.linalg.norm(public[4] - public[2]) == pytest.approx(1.300, abs=5e-4)


def planar(q: np.ndarray) -> np.ndarray:
    """Postures with only the joints about parallel axes bent."""
    return q * [0, 1, 1, 0, 1, 0]


@pytest.mark.parametrize("name", ELBOW_ARMS)
def test_elbow_arms_reach_as_far_as_their_lengths_say(name):
    """In the plane of the arm, by plain trigonometry: angles down from the horizontal."""
    (d1, a1, a2, a3, d4, d6), sense = ELBOW_ARMS[name]
    robot = Robot.preset(name)
    q = planar(np.random.default_rng(0).uniform(robot.lower, robot.upper, (100, 6)))
    # KUKA's arms are stretched out at zero, the others have the upper arm upright
    stretched = np.pi / 2 if name.startswith("kr") else 0.0
    lean = q[:, 1] + stretched
    forearm = lean + sense * q[:, 2] - stretched
    wrist = forearm + sense * q[:, 4]
    x = a1 + a2 * np.sin(lean) + a3 * np.sin(forearm) + d4 * np.cos(forearm) + d6 * np.cos(wrist)
    z = d1 + a2 * np.cos(lean) + a3 * np.cos(forearm) - d4 * np.sin(forearm) - d6 * np.sin(wrist)
    T = robot.fk(q)
    np.testing.assert_allclose(1e3 * T[:, [0, 2], 3], np.column_stack([x, z]), atol=1e-9)
    np.testing.assert_allclose(T[:, 1, 3], 0.0, atol=1e-12)
    out = np.column_stack([np.cos(wrist), -np.sin(wrist)])  # z of the tool points out of the face
    np.testing.assert_allclose(T[:, [0, 2], 2], out, atol=1e-12)


@pytest.mark.parametrize("name", STAUBLI_ARMS)
def test_staubli_arms_reach_as_far_as_their_lengths_say(name):
    d1, a1, a2, y3, d5, d6 = STAUBLI_ARMS[name]
    robot = Robot.preset(name)
    q = planar(np.random.default_rng(0).uniform(robot.lower, robot.upper, (100, 6)))
    one, two, three = q[:, 1], q[:, 1] + q[:, 2], q[:, 1] + q[:, 2] + q[:, 4]
    x = a1 + a2 * np.sin(one) + d5 * np.sin(two) + d6 * np.sin(three)
    z = d1 + a2 * np.cos(one) + d5 * np.cos(two) + d6 * np.cos(three)
    T = robot.fk(q)
    expected = np.column_stack([x, np.full(100, y3), z])
    np.testing.assert_allclose(1e3 * T[:, :3, 3], expected, atol=1e-9)
    np.testing.assert_allclose(T[:, 2, 2], np.cos(three), atol=1e-12)


def turned(angle: np.ndarray, axis: str) -> np.ndarray:
    """Rotations ``(..., 4, 4)`` about x or z."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.zeros((*np.shape(angle), 4, 4)) + np.eye(4)
    i, j = (1, 2) if axis == "x" else (0, 1)
    T[..., i, i] = T[..., j, j] = c
    T[..., i, j], T[..., j, i] = -s, s
    return T


def moved(x: float, z: float) -> np.ndarray:
    return se3.transform(np.eye(3), [x, 0, z])


@pytest.mark.parametrize("name", UR_DH)
def test_universal_robots_as_their_published_dh_parameters(name):
    """Rz(q) Tz(d) Tx(a) Rx(alpha) six times over, from the controller's base to the flange."""
    d1, a2, a3, d4, d5, d6 = UR_DH[name]
    right = np.pi / 2
    rows = [(d1, 0, right), (0, a2, 0), (0, a3, 0), (d4, 0, right), (d5, 0, -right), (d6, 0, 0)]
    robot = Robot.preset(name)
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (100, 6))
    T = np.eye(4)
    for j, (d, a, alpha) in enumerate(rows):
        T = T @ turned(q[:, j], "z") @ moved(a, d) @ turned(np.array(alpha), "x")
    np.testing.assert_allclose(robot.controller.in_world(robot.fk(q)), T, atol=1e-12)
    np.testing.assert_allclose(Robot.preset(name, base="base").fk(q), T, atol=1e-12)


def test_panda_as_its_published_dh_parameters():
    """Rx(alpha) Tx(a) Tz(d) Rz(q) in Craig's convention, seven joints and the flange."""
    right = np.pi / 2
    rows = [
        (0, 0, 0.333), (-right, 0, 0), (right, 0, 0.316), (right, 0.0825, 0),
        (-right, -0.0825, 0.384), (right, 0, 0), (right, 0.088, 0),
    ]  # fmt: skip
    robot = Robot.preset("panda")
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (100, 7))
    T = np.eye(4)
    for j, (alpha, a, d) in enumerate(rows):
        T = T @ turned(np.array(alpha), "x") @ moved(a, d) @ turned(q[:, j], "z")
    np.testing.assert_allclose(robot.fk(q), T @ moved(0, 0.107), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_every_preset_says_where_it_is_from(name):
    info = preset_info(name)
    for key in ("title", "source", "confidence", "shape_fit"):
        assert info[key].strip() == info[key]
        assert len(info[key]) > 8
    assert all(info["missing"])
    assert info["payload_kg"] > 0
    assert 0.005 <= info.get("repeatability_mm", 0.5) <= 0.5
    assert info.get("arm_mass_kg", np.inf) > info["payload_kg"]
    # catalogue figures are from memory, which the file must say
    assert "unverified" in info["confidence"].lower()
    assert info["controller"] in POSITIVE_AXES


def test_what_is_from_memory_says_so():
    assert preset_info("hp3")["confidence"].startswith("UNVERIFIED")
    assert "not fitted to a mesh" in preset_info("r2000ic165f")["shape_fit"]


@pytest.mark.parametrize("name", NAMES)
def test_base_posture_points_the_tool_down_inside_all_limits(name):
    robot = Robot.preset(name)
    q = np.deg2rad(preset_info(name)["base_posture_deg"])
    room = np.minimum(q - robot.lower, robot.upper - q)
    assert (room > np.deg2rad(20.0)).all()
    assert all(limit.margin(q) > np.deg2rad(20.0) for limit in robot.coupled_limits)
    T = robot.fk(q)
    assert T[2, 2] < -np.cos(np.deg2rad(1.0))
    reach = np.linalg.norm(np.diff(robot.state(q).origins, axis=0), axis=1).sum()
    assert T[0, 3] > 0.25 * reach
    # away from singularities, lengths in parts of the reach
    J = robot.jacobian(q)
    J[:3] /= reach
    assert np.linalg.svd(J, compute_uv=False)[-1] > 0.05


@pytest.mark.parametrize("name", NAMES)
def test_limits_speeds_and_what_the_arm_weighs(name):
    robot, info = Robot.preset(name), preset_info(name)
    assert robot.name == name
    assert robot.notices == ()
    assert (robot.lower < robot.upper).all()
    assert (robot.speed > 0).all()
    stiffness = [float(j.get("stiffness_nm_per_rad", np.inf)) for j in info["joint"]]
    np.testing.assert_array_equal(robot.stiffness, stiffness)
    np.testing.assert_array_equal(robot.link_mass, [j.get("mass_kg", 0) for j in info["joint"]])
    com = [np.array(j.get("com_mm", [0, 0, 0])) / 1e3 for j in info["joint"]]
    np.testing.assert_allclose(robot.link_com, com, atol=1e-15)
    said = " ".join(info["missing"])
    if not robot.link_mass.any():
        assert "masses" in said
    else:
        assert robot.link_mass.sum() < 1.05 * info["arm_mass_kg"]
    if np.isinf(robot.stiffness).any():
        assert "stiffness" in said


@pytest.mark.parametrize("name", NAMES)
def test_j3_of_fanuc_is_limited_against_the_horizontal_too(name):
    robot = Robot.preset(name)
    if preset_info(name)["controller"] != "fanuc":
        assert robot.coupled_limits == ()
        return
    (limit,) = robot.coupled_limits
    assert limit.name == "J3 to the horizontal"
    assert (limit.lower, limit.upper) == (robot.lower[2], robot.upper[2])
    # the sum that is limited is what the pendant shows as J3
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (20, 6))
    shown = robot.controller.pendant(q)[:, 2]
    np.testing.assert_allclose(np.rad2deg(q @ limit.coefficients), shown, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_the_pendant_is_read_back(name):
    robot = Robot.preset(name)
    assert robot.controller.maker == preset_info(name)["controller"]
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (50, robot.n))
    np.testing.assert_allclose(robot.controller.posture(robot.controller.pendant(q)), q, atol=1e-13)


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith(("panda", "irb", "kr6"))])
def test_the_world_of_the_controller_is_the_link_called_base(name):
    robot = Robot.preset(name)
    world = robot.controller.T_base_world
    at_j2 = np.diag([0, 0, 1]) @ robot.state(np.zeros(6)).origins[1]
    if name.startswith("ur"):
        np.testing.assert_allclose(world, np.diag([-1.0, -1, 1, 1]), atol=1e-15)
    else:
        np.testing.assert_allclose(world, se3.transform(np.eye(3), at_j2), atol=1e-15)


def solid_geometry(robot: Robot) -> pin.GeometryModel:
    """The shapes as Pinocchio has them, with all pairs that are two or more links apart."""
    geometry = pin.GeometryModel()
    for i, body in enumerate(robot.bodies):
        solid = body.solid
        if isinstance(solid, Capsule):
            shape = coal.Capsule(solid.radius_m, solid.length_m)
        else:
            assert isinstance(solid, Box)
            shape = coal.Box(*solid.size_m)
        joint = robot.model.getJointId(robot.joint_names[body.link - 1]) if body.link else 0
        place = pin.SE3(body.T_link_body)
        geometry.addGeometryObject(pin.GeometryObject(f"{i}", joint, place, shape))
    for i, one in enumerate(robot.bodies):
        for j, other in enumerate(robot.bodies[:i]):
            if abs(one.link - other.link) >= 2:
                geometry.addCollisionPair(pin.CollisionPair(j, i))
    return geometry


@pytest.mark.parametrize("name", NAMES)
def test_every_link_has_a_shape(name):
    robot, info = Robot.preset(name), preset_info(name)
    assert {body.link for body in robot.bodies} == set(range(robot.n + 1))
    each = [shape["link"] for shape in info["shape"]]
    assert info["base"] in each
    # parts of one link go by different names
    names = [shape.get("name", shape["link"]) for shape in info["shape"]]
    assert len(set(names)) == len(names)
    for body in robot.bodies:
        sizes = np.atleast_1d(
            body.solid.radius_m if isinstance(body.solid, Capsule) else body.solid.size_m
        )
        assert (sizes > 0.005).all()
        assert (sizes < 1.2).all()


@pytest.mark.parametrize("name", NAMES)
def test_shapes_do_not_touch_where_the_arm_works(name):
    """At zero and at the base posture nothing touches, and 40 deg about it hardly anything."""
    robot, q0 = Robot.preset(name), np.deg2rad(preset_info(name)["base_posture_deg"])
    geometry = solid_geometry(robot)
    found, data = pin.GeometryData(geometry), robot.model.createData()

    def touches(q: np.ndarray) -> bool:
        pin.updateGeometryPlacements(robot.model, data, geometry, found, q)
        return bool(pin.computeCollisions(geometry, found, True))

    assert not touches(np.clip(np.zeros(robot.n), robot.lower, robot.upper))
    assert not touches(q0)
    lower, upper = np.maximum(q0 - AROUND, robot.lower), np.minimum(q0 + AROUND, robot.upper)
    near = np.random.default_rng(2).uniform(lower, upper, (200, robot.n))
    assert np.mean([touches(q) for q in near]) <= 0.05


@pytest.mark.parametrize("name", ELBOW_ARMS)
def test_the_wrist_bends_almost_to_its_limits(name):
    """Makers let joint 5 turn as far as the wrist allows: shapes must not take much of it away."""
    robot = Robot.preset(name)
    geometry = solid_geometry(robot)
    found, data = pin.GeometryData(geometry), robot.model.createData()
    for share in (-0.75, -0.5, 0.5, 0.75):
        for roll in np.deg2rad([0.0, 45.0, 90.0]):
            q = np.zeros(6)
            q[4:] = share * min(-robot.lower[4], robot.upper[4]), roll
            pin.updateGeometryPlacements(robot.model, data, geometry, found, q)
            assert not pin.computeCollisions(geometry, found, True)


@pytest.mark.parametrize("name", NAMES)
def test_shapes_touch_when_the_arm_is_folded_up(name):
    """Among postures of all kinds there are some where the arm hits itself, and it is noticed."""
    robot = Robot.preset(name)
    geometry = solid_geometry(robot)
    found, data = pin.GeometryData(geometry), robot.model.createData()
    hits = 0
    for q in np.random.default_rng(3).uniform(robot.lower, robot.upper, (100, robot.n)):
        pin.updateGeometryPlacements(robot.model, data, geometry, found, q)
        hits += bool(pin.computeCollisions(geometry, found, True))
    assert 0 < hits < 60


@pytest.mark.parametrize("name", ELBOW_ARMS)
def test_shapes_reach_from_joint_to_joint(name):
    """No stretch of the arm is bare: points on the lines between its joints lie in some shape.

    The links of other arms run beside the lines between their joints.
    """
    robot = Robot.preset(name)
    state = robot.state(np.deg2rad(preset_info(name)["base_posture_deg"]))
    corners = [*state.origins, state.p_base_tip]
    gaps = []
    for a, b in itertools.pairwise(corners):
        for part in np.linspace(0.05, 0.95, 10):
            gaps.append(
                min(outside(robot, state, body, a + part * (b - a)) for body in robot.bodies)
            )
    size = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    assert max(gaps) < 0.02 * size


def outside(robot: Robot, state, body, p_base: np.ndarray) -> float:
    """Distance of a point from a solid, zero or less inside it [m]."""
    T = np.eye(4)
    if body.link:
        T = se3.transform(state.rotations[body.link - 1], state.origins[body.link - 1])
    p = se3.apply(se3.inverse(T @ body.T_link_body), p_base)
    if isinstance(body.solid, Capsule):
        half = body.solid.length_m / 2
        return float(np.linalg.norm(p - [0, 0, np.clip(p[2], -half, half)]) - body.solid.radius_m)
    assert isinstance(body.solid, Box)
    return float(np.linalg.norm(np.maximum(np.abs(p) - np.array(body.solid.size_m) / 2, 0)))


@pytest.mark.parametrize("name", NAMES)
def test_files_are_plain_numbers(name):
    """Only keys that the loader knows, so that nothing written there is silently unused."""
    known = {
        "": {
            "title", "source", "confidence", "missing", "controller", "payload_kg",
            "repeatability_mm", "aliases",
    "arm_mass_kg", "base", "tip", "base_posture_deg", "shape_fit",
            "joint", "frame", "shape", "coupled_limit",
        },
        "joint": {
            "name", "link", "xyz_mm", "rpy_deg", "axis", "lower_deg", "upper_deg", "speed_deg_s",
            "mass_kg", "com_mm", "stiffness_nm_per_rad",
        },
        "frame": {"name", "parent", "xyz_mm", "rpy_deg"},
        "shape": {
            "name", "link", "from_mm", "to_mm", "radius_mm", "size_mm", "xyz_mm", "rpy_deg",
        },
        "coupled_limit": {"name", "coefficients", "lower_deg", "upper_deg"},
    }  # fmt: skip
    info = preset_info(name)
    assert set(info) <= known[""]
    for table in ("joint", "frame", "shape", "coupled_limit"):
        for entry in info.get(table, []):
            assert set(entry) <= known[table]


def test_unknown_preset_lists_the_near_ones():
    with pytest.raises(RobotModelError, match="there is no preset 'r2000ic165'") as caught:
        Robot.preset("r2000ic165")
    assert "r2000ic165f" in caught.value.hint
    known = re.escape("known: gp7, hp3, irb120")
    with pytest.raises(RobotModelError, match=known):
        preset_info("../../secret")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("R-2000iC/165F", "r2000ic165f"),
        ("R-2000iB/210F", "r2000ib210f"),
        ("R-2000iA/165F", "r2000ia165f_fig7"),
        ("M-20iA", "m20ia"),
        ("LR Mate 200iD", "lrmate200id"),
        ("IRB 6700", "irb6700_200_260"),
        ("KR 6 R900", "kr6r900sixx"),
        ("TX2-60", "tx2_60"),
    ],
)
def test_names_as_people_type_them(typed, meant):
    assert Robot.preset(typed).name == meant


@pytest.mark.parametrize("name", ["", "-", "kuka", "r2000", "r2000ic165"])
def test_half_a_name_is_not_guessed_at(name):
    """An R-2000iC/165 is not an R-2000iC/165F."""
    with pytest.raises(RobotModelError, match="there is no preset"):
        Robot.preset(name)
