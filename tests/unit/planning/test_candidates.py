"""Candidate poses: what they touch and keep, evenly drawn, none left out or twice; local turns."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import kstest

from calib.errors import CalibError, InputError, UnreachableError
from calib.model import Setup
from calib.robots import CoupledLimit
from calib.se3 import FloatArray, rotation_angle, rotation_exp
from posedesign.candidates import (
    CONFIGURATIONS,
    CandidatePoses,
    away_from_singularities,
    cone_candidates,
    feasible,
    grid_candidates,
    joint_candidates,
    local_poses,
    offset_targets,
    postures,
)
from posedesign.candidates.building import viewing_poses
from posedesign.candidates.postures import even_points, evenly, once
from posedesign.cell import Cell, cell_template, cone_rotations_at, touching_poses
from posedesign.cell.orientations import cone_rotations
from posedesign.constraints import nearest_postures

TILT = np.deg2rad(45.0)


def rng(seed: int = 7) -> np.random.Generator:
    return np.random.default_rng(seed)


def tried_poses(cell: Cell, count: int, seed: int = 7) -> FloatArray:
    base = cell.robot.fk(cell.base_posture)[:3, :3]
    rotations = cone_rotations_at(base, TILT, even_points(count, 3, rng(seed)))
    return touching_poses(rotations, cell.tool_m, cell.target_m)


def as_set(postures: FloatArray) -> set[bytes]:
    return {q.tobytes() for q in postures}


@pytest.mark.parametrize("configurations", CONFIGURATIONS)
def test_every_posture_touches_its_target_and_keeps_every_constraint(demo_cell, configurations):
    targets = offset_targets(demo_cell, [[0, 0, 0], [40, -30, 200]])
    pool = cone_candidates(demo_cell, TILT, 60, rng(), configurations, targets_m=targets)
    robot = demo_cell.robot
    touched = robot.state(pool.postures).point(demo_cell.tool_m)
    assert np.abs(touched - targets[pool.target]).max() < 1e-9
    assert np.abs(robot.fk(pool.postures)[:, :3, :3] - pool.orientations).max() < 1e-9
    for k, target_m in enumerate(targets):
        assert pool.of_each[k] > 30
        own = replace(demo_cell, target_m=target_m)
        assert own.checker.check(pool.postures[pool.target == k]).feasible.all()


def test_what_a_camera_is_to_see_goes_with_the_target(make_demo_cell):
    """The verdicts are those of a cell whose file says that the target is there."""
    cell = make_demo_cell(camera={"largest_tilt_deg": 20.0})
    targets = offset_targets(cell, [[0, 0, 0], [0, 400, 0]])
    pool = cone_candidates(cell, TILT, 200, rng(), "all", targets_m=targets)
    beside = make_demo_cell(
        camera={"largest_tilt_deg": 20.0}, target={"position_mm": (1e3 * targets[1]).tolist()}
    )
    there = pool.postures[pool.target == 1]
    assert len(there) > 10
    assert beside.checker.check(there).feasible.all()
    assert not cell.checker.check(there).feasible.any(), "the fixture's target would not be in view"
    alone = cone_candidates(beside, TILT, 200, rng(), "all")
    both = feasible(cell, alone.postures, np.ones(len(alone), dtype=int), targets)
    assert both.all()


def test_the_grids_are_those_of_the_fewest_poses(demo_cell, reference_cell):
    for cell, expected in ((reference_cell, 411), (demo_cell, 369)):
        pool = grid_candidates(cell)
        assert (pool.tried, len(pool)) == (417, expected)
        poses = touching_poses(pool.orientations, cell.tool_m, cell.target_m)
        found = nearest_postures(cell.checker, poses, cell.base_posture)
        np.testing.assert_array_equal(pool.postures, found.q)


def test_angles_that_are_held_do_not_repeat_poses(make_cell):
    cell = make_cell(variations={"start_deg": [5.0, 0.0, 5.0], "largest_deg": [60.0, 0.0, 5.0]})
    # W takes 2 * 4 + 1 values, R three
    assert grid_candidates(cell, 4).tried == 27


def test_the_nearest_posture_is_the_nearest_of_all_that_can_be_taken():
    """On an arm whose branches collide in different places."""
    cell = Cell.from_text(cell_template("ur5e"))
    poses = tried_poses(cell, 60)
    pool = cone_candidates(cell, TILT, 60, rng(), "nearest")
    solutions = cell.robot.inverse(poses, near=cell.base_posture, margin=cell.margin)
    expected, second = [], 0
    for k in range(60):
        all_of = solutions.of(k)
        kept = all_of[cell.checker.check(all_of).feasible] if len(all_of) else all_of
        if len(kept):
            expected.append(min(kept, key=lambda q: np.linalg.norm(q - cell.base_posture)))
            away = np.linalg.norm(all_of - cell.base_posture, axis=1)
            second += np.linalg.norm(expected[-1] - cell.base_posture) > away.min()
    np.testing.assert_array_equal(pool.postures, expected)
    assert second > 0, "some pose must be taken with another than its nearest posture"


@pytest.mark.parametrize("configurations", ["front", "all"])
def test_no_branch_is_left_out(demo_cell, configurations):
    poses = tried_poses(demo_cell, 100)
    pool = cone_candidates(demo_cell, TILT, 100, rng(), configurations)
    solutions = demo_cell.robot.inverse(poses, near=demo_cell.base_posture, margin=demo_cell.margin)
    expected = np.concatenate([solutions.of(k) for k in range(100)])
    if configurations == "front":
        expected = expected[np.cos(expected[:, 0] - demo_cell.base_posture[0]) >= 0.0]
    expected = expected[demo_cell.checker.check(expected).feasible]
    assert as_set(pool.postures) == as_set(expected)
    assert len(pool) == len(expected)


def test_the_arm_reaches_over_its_back_only_where_it_is_asked_to(reference_cell):
    base = reference_cell.base_posture[0]
    front = cone_candidates(reference_cell, TILT, 300, rng(), "front")
    everything = cone_candidates(reference_cell, TILT, 300, rng(), "all")
    assert (np.abs(front.postures[:, 0] - base) <= np.pi / 2).all()
    back = np.abs(everything.postures[:, 0] - base) > np.pi / 2
    assert back.any()
    assert as_set(everything.postures[~back]) == as_set(front.postures)


def test_each_joint_takes_the_turn_nearest_to_the_base_posture(reference_cell):
    pool = cone_candidates(reference_cell, TILT, 100, rng(), "all")
    poses = touching_poses(pool.orientations, reference_cell.tool_m, pool.touched_m)
    turned = reference_cell.robot.inverse(poses, every_turn=True)
    others = 0
    for k, q in enumerate(pool.postures):
        apart = turned.of(k) - q
        same_arm = (np.abs(np.sin(apart / 2.0)) < 1e-6).all(axis=1)
        away = np.linalg.norm(turned.of(k)[same_arm] - reference_cell.base_posture, axis=1)
        assert np.linalg.norm(q - reference_cell.base_posture) <= away.min() + 1e-9
        others += same_arm.sum() - 1
    assert others > 100


def test_the_cone_is_filled_evenly():
    count, tilt = 3000, np.deg2rad(50.0)
    points = even_points(count, 3, rng())
    R = cone_rotations_at(np.eye(3), tilt, points)
    cosine = R[:, 2, 2]
    heading = np.arctan2(R[:, 1, 2], R[:, 0, 2])
    assert cosine.min() >= np.cos(tilt) - 1e-12
    # what is left of a turn when the tilt is undone is the roll
    axis = np.stack([-R[:, 1, 2], R[:, 0, 2], np.zeros(count)], axis=1)
    x = (
        R[:, :, 0]
        - (axis * R[:, :, 0]).sum(axis=1)[:, None] * axis / (axis**2).sum(axis=1)[:, None]
    )
    assert np.linalg.norm(x, axis=1).max() <= 1.0 + 1e-12
    for value in ((1.0 - cosine) / (1.0 - np.cos(tilt)), heading / (2 * np.pi) + 0.5):
        # far closer to uniform than independent draws are: those reach 1.36 / sqrt(N) at 5 %
        assert kstest(value, "uniform").statistic < 0.2 * 1.36 / np.sqrt(count)
    probes = rng(1).random((5000, 3))
    even = cKDTree(points, boxsize=1.0).query(probes)[0].max()
    drawn = [
        cKDTree(rng(s).random((count, 3)), boxsize=1.0).query(probes)[0].max() for s in range(5)
    ]
    assert even < 0.8 * min(drawn)


def test_rolls_fill_the_full_turn():
    """At the middle of the cone the tilt vanishes, and the turn is the roll alone."""
    points = even_points(500, 3, rng())
    R = cone_rotations_at(np.eye(3), 1e-6, points)
    roll = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    assert kstest(roll / (2 * np.pi) + 0.5, "uniform").statistic < 0.02


def test_independent_cones_are_drawn_as_ever():
    """Replacements of a plan are seeded: the same cell must give the same plan."""
    given = np.random.default_rng(3)
    R = cone_rotations(np.eye(3), 0.7, 5, given)
    again = np.random.default_rng(3)
    cosine = again.uniform(np.cos(0.7), 1.0, 5)
    np.testing.assert_allclose(R[:, 2, 2], cosine, atol=1e-12)
    again.uniform(-np.pi, np.pi, (2, 5))
    assert given.random() == again.random()


def test_no_two_postures_are_the_same(reference_cell):
    for pool in (
        grid_candidates(reference_cell),
        cone_candidates(reference_cell, TILT, 200, rng(), "all"),
    ):
        apart = np.abs(pool.postures[:, None] - pool.postures).max(axis=-1)
        assert (apart + np.eye(len(pool))).min() > 1e-6


def test_the_same_generator_gives_the_same_pool(reference_cell):
    one, same, other = (
        cone_candidates(reference_cell, TILT, 50, rng(s)).postures for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert not as_set(one) & as_set(other)


def test_targets_are_tried_with_other_orientations(reference_cell):
    targets = offset_targets(reference_cell, [[0, 0, 0], [0, 0, 300]])
    pool = cone_candidates(reference_cell, TILT, 50, rng(), "nearest", targets_m=targets)
    first, second = (pool.orientations[pool.target == k].reshape(-1, 9) for k in (0, 1))
    assert np.linalg.norm(first[:, None] - second, axis=-1).min() > 1e-6


def test_blocks_are_those_of_the_target_that_each_posture_touches(reference_cell):
    targets = offset_targets(reference_cell, [[0, 0, 0], [100, 0, 300], [-50, 80, 200]])
    pool = cone_candidates(
        reference_cell, TILT, 30, rng(), targets_m=targets, target_names=["low", "mid", "high"]
    )
    model = reference_cell.model(targets=pool.target_points())
    assert np.abs(pool.linearise(model).rows).max() < 1e-9, "tool point less target"
    columns = [model.names.index(f"target.{name}.z") for name in ("low", "mid", "high")]
    moved = np.abs(pool.white(model)[:, :, columns]).max(axis=1) > 0
    np.testing.assert_array_equal(moved, np.eye(3, dtype=bool)[pool.target])
    setup = Setup.of(len(pool), target=pool.target)
    by_hand = model.linearise(pool.postures, setup=setup).white_jacobian
    np.testing.assert_array_equal(pool.white(model), by_hand)
    # by their names, in whatever order the model has them
    turned = CandidatePoses(
        **{
            **pool.__dict__,
            "target": 2 - pool.target,
            "targets_m": targets[::-1],
            "target_names": pool.target_names[::-1],
        }
    )
    np.testing.assert_array_equal(turned.white(model), pool.white(model))


def test_one_target_goes_with_the_one_of_a_model(reference_cell):
    pool = cone_candidates(reference_cell, TILT, 20, rng(), target_names=["ball"])
    assert pool.white(reference_cell.model()).shape == (len(pool), 3, 10)
    several = cone_candidates(
        reference_cell, TILT, 20, rng(), targets_m=offset_targets(reference_cell, np.eye(3) * 90)
    )
    with pytest.raises(InputError, match=r"no target 'T2'"):
        several.white(reference_cell.model())


def test_some_of_a_pool(reference_cell):
    targets = offset_targets(reference_cell, [[0, 0, 0], [0, 0, 200]])
    pool = cone_candidates(reference_cell, TILT, 20, rng(), targets_m=targets)
    some = pool.take([5, 0, -1])
    np.testing.assert_array_equal(some.postures, pool.postures[[5, 0, -1]])
    np.testing.assert_array_equal(some.orientations, pool.orientations[[5, 0, -1]])
    np.testing.assert_array_equal(some.target, [0, 0, 1])
    model = reference_cell.model(targets=pool.target_points())
    np.testing.assert_allclose(some.white(model), pool.white(model)[[5, 0, -1]], atol=1e-9)
    np.testing.assert_array_equal(
        pool.take(pool.target == 1).touched_m, np.tile(targets[1], (pool.of_each[1], 1))
    )
    assert len(pool.take([])) == 0


def test_a_summary_in_words(reference_cell):
    targets = offset_targets(reference_cell, [[0, 0, 0], [0, 0, 3000]])
    pool = cone_candidates(reference_cell, TILT, 20, rng(), "nearest", targets_m=targets)
    assert pool.summary() == (
        "cone of 45 deg, rolled freely, the nearest posture of each: 20 postures from 40 tried; "
        "T1 20, T2 0"
    )
    assert grid_candidates(reference_cell, 2).summary() == (
        "W P R varied by 5, 5, 5 to 60, 60, 60 deg in 2 levels, the nearest posture of each: "
        "51 postures from 53 tried"
    )


def test_a_redundant_arm_gives_some_of_its_postures():
    cell = Cell.from_text(cell_template("panda", surroundings=False))
    for configurations, most in (("nearest", 1), ("front", 8)):
        pool = cone_candidates(cell, 0.4, 12, rng(), configurations)
        touched = cell.robot.state(pool.postures).point(cell.tool_m)
        assert np.abs(touched - cell.target_m).max() < 1e-9
        assert cell.checker.check(pool.postures).feasible.all()
        counts = np.unique(pool.orientations.round(9), axis=0, return_counts=True)[1]
        assert counts.max() == most
        # eight of a hundred are spread over the elbow's turns, not those next to each other
        if most > 1:
            first = pool.postures[:most]
            assert np.ptp(first, axis=0).max() > np.deg2rad(60.0)


def test_as_many_of_a_redundant_arm_as_if_all_its_postures_were_looked_at(monkeypatch):
    cell = Cell.from_text(cell_template("panda"))
    few, looked_at = [], []
    check = type(cell.checker).check

    def counted(checker, q, **how):
        looked_at[-1] += len(q)
        return check(checker, q, **how)

    monkeypatch.setattr(type(cell.checker), "check", counted)
    for most in (postures.LOOKED_AT_PER_POSE, 10**6):
        monkeypatch.setattr(postures, "LOOKED_AT_PER_POSE", most)
        looked_at.append(0)
        pool = cone_candidates(cell, 0.6, 30, rng(), "front")
        few.append(np.unique(pool.orientations.round(9), axis=0, return_counts=True))
    np.testing.assert_allclose(few[0][0], few[1][0], atol=1e-8)
    np.testing.assert_array_equal(few[0][1], few[1][1])
    assert few[0][1].max() == 8
    assert looked_at[0] < 0.8 * looked_at[1]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"tilt": 0.0}, "above 0"),
        ({"tilt": -0.1}, "above 0"),
        ({"tilt": 45.0}, "radians"),
        ({"tilt": np.nan}, "above 0"),
        ({"count": 0}, "1 to"),
        ({"count": 2.5}, "1 to"),
        ({"count": np.inf}, "1 to"),
        ({"configurations": "fornt"}, "did you mean front"),
        ({"targets_m": [[1.0, 2.0]]}, r"\(K, 3\)"),
        ({"targets_m": np.empty((0, 3))}, r"\(K, 3\)"),
        ({"targets_m": [[1900.0, 50.0, 490.0]]}, "in metres"),
        ({"targets_m": [[np.nan, 0.0, 0.0]]}, "no number"),
        ({"targets_m": [[1.9, 0.0, 0.5], [1.9, 0.0, 0.5]]}, "same point"),
        ({"targets_m": [[1.9, 0.0, 0.5]], "target_names": ["a", "b"]}, "as many names"),
    ],
)
def test_wrong_input_is_refused(reference_cell, wrong, said):
    given = {"tilt": TILT, "count": 5, "rng": rng(), **wrong}
    with pytest.raises(InputError, match=said) as caught:
        cone_candidates(reference_cell, **given)
    assert caught.value.hint or caught.value.name


def test_wrong_levels_and_offsets_are_refused(reference_cell):
    with pytest.raises(InputError, match="1 to"):
        grid_candidates(reference_cell, 0)
    with pytest.raises(InputError, match="in mm"):
        offset_targets(reference_cell, [1.0, 2.0])
    np.testing.assert_allclose(
        offset_targets(reference_cell, [0, 0, 500]) - reference_cell.target_m, [[0, 0, 0.5]]
    )


def test_a_target_in_an_obstacle_is_refused(demo_cell):
    with pytest.raises(InputError, match="inside the obstacle 'fixture'"):
        cone_candidates(
            demo_cell, TILT, 5, rng(), targets_m=offset_targets(demo_cell, [0, 0, -100])
        )


@pytest.mark.parametrize(
    ("offset_mm", "said"),
    [([3000, 0, 0], "out of reach"), ([-1700, 0, 300], "joint limits, e.g. J")],
)
def test_an_empty_pool_says_why(reference_cell, offset_mm, said):
    targets = offset_targets(reference_cell, offset_mm)
    with pytest.raises(UnreachableError, match="none of 40 poses can be taken") as caught:
        cone_candidates(reference_cell, 0.2, 40, rng(), targets_m=targets)
    assert said in caught.value.message
    assert caught.value.hint


def test_the_reason_is_the_one_met_most_often(make_demo_cell):
    """Nothing comes nearer to anything than half a metre: gun and fixture stand in the way."""
    cell = make_demo_cell(constraints={"safety_distance_mm": 500.0})
    with pytest.raises(
        UnreachableError, match=r"; 100% of them: collision, e.g. .* mm from .*500 mm asked for"
    ):
        cone_candidates(cell, 0.2, 30, rng())
    blind = make_demo_cell(camera={"largest_tilt_deg": 2.0}, target={"normal": [1.0, 0.0, 0.0]})
    with pytest.raises(UnreachableError, match=r"tilt of the target, e\.g\. target seen") as caught:
        grid_candidates(blind, 2)
    assert "camera.largest_tilt_deg" in caught.value.hint


def test_an_arm_that_could_only_reach_over_its_back_says_so(make_cell):
    """The base posture looks away from the target: all postures turn the first joint."""
    cell = make_cell()
    away = replace(cell, base_posture=cell.base_posture + np.pi * np.eye(6)[0])
    with pytest.raises(CalibError, match="other side of the base posture") as caught:
        cone_candidates(away, 0.1, 10, rng(), "front", targets_m=cell.target_m)
    assert 'configurations = "all"' in caught.value.hint
    assert len(cone_candidates(away, 0.1, 10, rng(), "all", targets_m=cell.target_m))


@given(st.integers(0, 10_000), st.integers(0, 60), st.integers(1, 7))
def test_each_row_is_kept_once(seed, count, width):
    rng = np.random.default_rng(seed)
    rows = rng.integers(-2, 3, (count, width)) * 0.3 + rng.uniform(-2e-7, 2e-7, (count, width))
    kept = once(rows, 1e-6)
    apart = np.abs(rows[:, None] - rows).max(axis=-1, initial=0.0) < 1e-6
    # the noise is so small that being the same goes over from one to the next
    expected = [not apart[i, :i].any() for i in range(count)]
    assert kept.tolist() == expected


@given(st.lists(st.integers(0, 30), max_size=12), st.integers(1, 9))
def test_rows_of_a_group_are_thinned_evenly(sizes, most):
    group = np.repeat(np.arange(len(sizes)), sizes)
    kept = evenly(group, most)
    for k, size in enumerate(sizes):
        rows = np.flatnonzero(kept[group == k])
        assert len(rows) == min(size, most)
        if 1 <= most <= size:
            gaps = np.diff(np.append(rows, size + rows[0]))
            assert gaps.max() - gaps.min() <= 1
            assert rows[0] == 0


@given(st.integers(1, 500), st.integers(1, 8), st.integers(0, 10_000))
def test_even_points_are_in_the_cube_and_apart(count, dimensions, seed):
    points = even_points(count, dimensions, np.random.default_rng(seed))
    assert points.shape == (count, dimensions)
    assert points.min() >= 0.0
    assert points.max() < 1.0
    if count > 1 and dimensions == 1:
        # the golden section leaves gaps of at most three lengths (Steinhaus)
        gaps = np.diff(np.sort(points[:, 0]), append=points.min() + 1.0)
        assert len(np.unique(gaps.round(9))) <= 3


def brute_force(cell: Cell, half: float, wanted: int) -> FloatArray:
    """Feasible postures of independent draws around the base posture."""
    draws, found = rng(1), np.empty((0, cell.robot.n))
    lower = np.maximum(cell.robot.lower + cell.margin, cell.base_posture - half)
    upper = np.minimum(cell.robot.upper - cell.margin, cell.base_posture + half)
    while len(found) < wanted:
        q = draws.uniform(lower, upper, (50_000, cell.robot.n))
        found = np.concatenate([found, q[cell.checker.check(q, every=False).feasible]])
    return found


def test_joints_fill_their_ranges(make_cell):
    cell = make_cell(plan={"limit_margin_deg": 2.0})
    free = [0, 3, 4, 5]  # joints 2 and 3 have a limit together that cuts a corner off
    pool = joint_candidates(cell, 800, rng(), largest_turn=1.0)
    assert len(pool) == 800
    assert cell.checker.check(pool.postures).feasible.all()
    lower = np.maximum(cell.robot.lower + cell.margin, cell.base_posture - 1.0)
    upper = np.minimum(cell.robot.upper - cell.margin, cell.base_posture + 1.0)
    part = (pool.postures - lower) / (upper - lower)
    assert part.min() >= 0.0
    assert part.max() <= 1.0
    for j in free:
        assert kstest(part[:, j], "uniform").pvalue > 0.01
    np.testing.assert_allclose(cell.robot.fk(pool.postures)[:, :3, :3], pool.orientations)
    assert (pool.target == 0).all()


def test_postures_follow_brute_force(make_cell):
    cell = make_cell(constraints={"smallest_singular_value": 0.12})
    expected = brute_force(cell, 1.2, 3000)
    pool = joint_candidates(cell, 3000, rng(), largest_turn=1.2)
    assert pool.tried > 3500, "the constraint must refuse some"
    apart = pool.postures.mean(axis=0) - expected.mean(axis=0)
    sigma = expected.std(axis=0) * np.sqrt(2.0 / 3000)
    assert (np.abs(apart) < 4.0 * sigma).all()


def test_a_view_is_all_that_the_camera_is_allowed(make_demo_cell):
    cell = make_demo_cell(
        camera={"wpr_deg": [8.0, -5.0, 30.0], "largest_tilt_deg": 40.0},
        target={"normal": [0.3, -0.2, 1.0]},
    )
    camera = cell.config.camera
    assert camera is not None
    T = viewing_poses(cell, even_points(4000, 6, rng())) @ cell.T_tip_camera
    in_camera = np.einsum("nji,nj->ni", T[:, :3, :3], cell.target_m - T[:, :3, 3])
    pixels = np.array(camera.image_px) / 2 + camera.focal_px * in_camera[:, :2] / in_camera[:, 2:]
    away_mm = 1e3 * np.linalg.norm(in_camera, axis=1)
    sight = (T[:, :3, 3] - cell.target_m) / (away_mm[:, None] / 1e3)
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    cosine = sight @ normal
    np.testing.assert_allclose(np.linalg.det(T[:, :3, :3]), 1.0)
    room = camera.border_px
    for values, low, high in (
        (pixels[:, 0], room, camera.image_px[0] - room),
        (pixels[:, 1], room, camera.image_px[1] - room),
        (away_mm, camera.nearest_mm, camera.farthest_mm),
        (cosine, np.cos(np.deg2rad(40.0)), 1.0),
    ):
        part = (values - low) / (high - low)
        assert -1e-9 < part.min() < 0.01
        assert 0.99 < part.max() < 1.0 + 1e-9
        assert kstest(part, "uniform").pvalue > 0.01
    across = np.cross(normal, [1.0, 0.0, 0.0])
    heading = np.arctan2(sight @ across, sight @ np.cross(across, normal))
    assert kstest(heading / (2 * np.pi) + 0.5, "uniform").statistic < 0.03


def test_the_target_is_in_view_and_nothing_that_is_possible_is_missed(demo_cell):
    """Every feasible posture of brute force has one of the pool near by."""
    pool = joint_candidates(demo_cell, 1500, rng(), largest_turn=1.0)
    assert len(pool) == 1500
    assert demo_cell.checker.check(pool.postures).feasible.all()
    assert np.abs(pool.postures - demo_cell.base_posture).max() <= 1.0
    expected = brute_force(demo_cell, 1.0, 150)
    apart = np.abs(expected[:, None] - pool.postures).max(axis=-1).min(axis=1)
    own = np.abs(expected[:, None] - expected).max(axis=-1) + np.eye(len(expected))
    # no farther off than such postures lie from each other, ten times fewer as they are
    assert np.quantile(apart, 0.99) < np.quantile(own.min(axis=1), 0.99)


def test_the_arm_is_turned_over_its_back_where_the_camera_sees_from_there(make_demo_cell):
    cell = make_demo_cell(constraints={"collisions": False})
    pool = joint_candidates(cell, 500, rng())
    assert (np.abs(pool.postures[:, 0] - cell.base_posture[0]) > np.pi / 2).any()
    assert np.abs(pool.postures - cell.base_posture).max() <= np.pi


def test_close_to_the_base_posture_joints_are_drawn_evenly(demo_cell):
    """There most of what is drawn in the joints sees the target, and hardly any view is so near."""
    pool = joint_candidates(demo_cell, 500, rng(), largest_turn=0.01)
    assert (len(pool), pool.tried) == (500, 1000)
    part = (pool.postures - demo_cell.base_posture) / 0.02 + 0.5
    assert min(kstest(column, "uniform").pvalue for column in part.T) > 0.01


def test_a_redundant_arm_sees_its_target():
    cell = Cell.from_text(cell_template("panda"))
    pool = joint_candidates(cell, 40, rng())
    assert len(pool) == 40
    assert cell.checker.check(pool.postures).feasible.all()


def test_the_same_generator_gives_the_same_postures(demo_cell, reference_cell):
    for cell in (demo_cell, reference_cell):
        one, same, other = (joint_candidates(cell, 30, rng(s)).postures for s in (1, 1, 2))
        np.testing.assert_array_equal(one, same)
        assert len(one) == 30
        assert not np.isin(one, other).any()


def test_no_two_postures_are_the_same_without_touch(demo_cell):
    q = joint_candidates(demo_cell, 300, rng()).postures
    apart = np.abs(q[:, None] - q).max(axis=-1)
    assert (apart + np.eye(len(q))).min() > 1e-6


def test_wrong_input_is_refused_without_touch(reference_cell):
    for count in (0, -1, 1.5, np.nan):
        with pytest.raises(InputError, match="1 to"):
            joint_candidates(reference_cell, count, rng())  # type: ignore[arg-type]
    for turn in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="one posture") as caught:
            joint_candidates(reference_cell, 5, rng(), turn)
        assert "radians" in caught.value.hint


def test_an_empty_pool_without_touch_says_why(make_cell, make_demo_cell):
    cell = make_cell(constraints={"smallest_singular_value": 0.9})
    with pytest.raises(UnreachableError, match=r"of them: singularity, e\.g\. smallest") as one:
        joint_candidates(cell, 5, rng())
    assert "constraints.smallest_singular_value" in one.value.hint
    walled = make_demo_cell(constraints={"safety_distance_mm": 700.0})
    with pytest.raises(UnreachableError, match=r"collision, e\.g\. "):
        joint_candidates(walled, 5, rng())
    cell = make_demo_cell(constraints={"collisions": False})
    aside = replace(cell, base_posture=cell.base_posture + np.eye(6)[0], target_m=cell.target_m)
    with pytest.raises(UnreachableError, match="turned farther") as other:
        joint_candidates(aside, 5, rng(), largest_turn=0.1)
    assert "largest_turn" in other.value.hint


def around(cell: Cell, count: int = 300) -> CandidatePoses:
    return cone_candidates(cell, 0.9, count, np.random.default_rng(4), "all")


def turns_of(pool: CandidatePoses, sigma: float) -> FloatArray:
    return np.random.default_rng(5).normal(0.0, sigma, (len(pool), 3))


def test_the_tool_turns_in_its_own_axes_about_what_it_touches(reference_cell):
    pool = around(reference_cell)
    turns = turns_of(pool, 0.03)
    q = local_poses(reference_cell, pool.postures, turns)
    there = np.isfinite(q).all(axis=1)
    assert there.mean() > 0.9
    state = reference_cell.robot.state(q[there])
    np.testing.assert_allclose(
        state.R_base_tip, (pool.orientations @ rotation_exp(turns))[there], atol=1e-9
    )
    touched = state.point(reference_cell.tool_m)
    assert np.abs(touched - reference_cell.target_m).max() < 1e-9


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.03])
def test_it_is_the_nearest_of_all_branches_in_closed_form(reference_cell, sigma):
    """Where the nearest is another branch, a singularity of the wrist is less than a turn away."""
    pool = around(reference_cell)
    turns = turns_of(pool, sigma)
    q = local_poses(reference_cell, pool.postures, turns, pool.touched_m)
    poses = touching_poses(
        pool.orientations @ rotation_exp(turns), reference_cell.tool_m, reference_cell.target_m
    )
    solutions = reference_cell.robot.inverse(poses, every_turn=True)
    nan = same = 0
    for k, start in enumerate(pool.postures):
        away = np.linalg.norm(solutions.of(k) - start, axis=1)
        wrist = np.abs(start[4])
        if np.isnan(q[k]).any():
            nan += 1
            # the limits are in the way: what is left is a turn of a joint away
            assert away.min(initial=np.inf) > 2.0
        elif wrist > 10.0 * sigma:
            same += 1
            np.testing.assert_allclose(solutions.of(k)[np.argmin(away)], q[k], atol=1e-7)
    assert same > 0.8 * len(pool)
    assert nan < 0.1 * len(pool)


def test_there_and_back_again(demo_cell):
    """Followed along the turn no branch is left, however large the turn is."""
    pool = around(demo_cell)
    turns = turns_of(pool, 0.25)
    q = local_poses(demo_cell, pool.postures, turns, pool.touched_m)
    there = np.isfinite(q).all(axis=1)
    assert there.mean() > 0.7
    back = local_poses(demo_cell, q[there], -turns[there], pool.touched_m[there])
    np.testing.assert_allclose(back, pool.postures[there], atol=1e-6)


def test_a_small_turn_moves_the_joints_as_the_jacobian_has_it(reference_cell):
    pool = around(reference_cell, 50)
    turns = turns_of(pool, 1e-5)
    q = local_poses(reference_cell, pool.postures, turns)
    state = reference_cell.robot.state(pool.postures)
    J = state.jacobian(state.point(reference_cell.tool_m))
    twist = np.concatenate(
        [np.zeros((len(pool), 3)), np.einsum("nij,nj->ni", pool.orientations, turns)], axis=1
    )
    expected = np.linalg.solve(J, twist[..., None])[..., 0]
    gain = np.linalg.norm(np.linalg.inv(J), axis=(1, 2))
    assert (np.abs(q - pool.postures - expected).max(axis=1) < 1e-8 * gain**3).all()


def test_no_turn_is_the_same_posture(demo_cell):
    pool = around(demo_cell, 50)
    q = local_poses(demo_cell, pool.postures, np.zeros((len(pool), 3)))
    np.testing.assert_allclose(q, pool.postures, atol=1e-9)


def test_there_is_no_posture_beyond_a_limit(reference_cell):
    """Joint 6 five degrees below its limit: turned about its own axis by four, and by six."""
    robot = reference_cell.robot
    start = reference_cell.base_posture.copy()
    start[5] = robot.upper[5] - np.deg2rad(5.0)
    # the tool point stays: only where it is on the axis of joint 6 does no other joint move
    on_axis = replace(reference_cell, tool_m=np.array([0.0, 0.0, 0.3]))
    z = robot.fk(start)[:3, 2] @ robot.state(start).axes[5]
    turns = np.deg2rad([[0.0, 0.0, 4.0 * z], [0.0, 0.0, 6.0 * z]])
    q = local_poses(on_axis, np.tile(start, (2, 1)), turns)
    np.testing.assert_allclose(q[0] - start, np.deg2rad([0, 0, 0, 0, 0, 4.0]), atol=1e-9)
    assert np.isnan(q[1]).all()


def test_there_is_no_posture_beyond_a_coupled_limit(reference_cell):
    pool = around(reference_cell, 100)
    turns = turns_of(pool, 0.02)
    free = local_poses(reference_cell, pool.postures, turns)
    limit = CoupledLimit("J4 plus J6", np.array([0.0, 0, 0, 1, 0, 1]), -1.0, 1.0)
    robot = replace(reference_cell.robot, coupled_limits=(limit,))
    q = local_poses(replace(reference_cell, robot=robot), pool.postures, turns)
    kept = np.abs(free[:, 3] + free[:, 5]) <= 1.0
    assert 0 < kept.sum() < len(pool)
    np.testing.assert_array_equal(np.isfinite(q).all(axis=1), kept)
    np.testing.assert_array_equal(q[kept], free[kept])


def test_a_redundant_arm_moves_little():
    cell = Cell.from_text(cell_template("panda", surroundings=False))
    pool = cone_candidates(cell, 0.3, 10, np.random.default_rng(4), "front")
    turns = turns_of(pool, 0.02)
    q = local_poses(cell, pool.postures, turns, pool.touched_m)
    there = np.isfinite(q).all(axis=1)
    assert there.mean() > 0.9
    state = cell.robot.state(q[there])
    assert np.abs(state.point(cell.tool_m) - cell.target_m).max() < 1e-9
    turned = rotation_angle(np.swapaxes(pool.orientations[there], 1, 2) @ state.R_base_tip)
    np.testing.assert_allclose(turned, np.linalg.norm(turns[there], axis=1), atol=1e-8)
    assert (q[there] >= cell.robot.lower).all()
    assert (q[there] <= cell.robot.upper).all()
    # the pseudo-inverse is the least motion there is
    start = cell.robot.state(pool.postures[there])
    J = start.jacobian(start.point(cell.tool_m))
    twist = np.zeros((there.sum(), 6))
    twist[:, 3:] = np.einsum("nij,nj->ni", pool.orientations[there], turns[there])
    least = np.linalg.norm((np.linalg.pinv(J) @ twist[..., None])[..., 0], axis=1)
    moved = np.linalg.norm(q[there] - pool.postures[there], axis=1)
    assert np.median(moved / least) < 1.1


def test_verdicts_of_many_targets_and_of_none(demo_cell):
    pool = around(demo_cell, 100)
    q = local_poses(demo_cell, pool.postures, turns_of(pool, 0.2), pool.touched_m)
    kept = feasible(demo_cell, q, pool.target, pool.targets_m)
    there = np.isfinite(q).all(axis=1)
    assert not kept[~there].any()
    np.testing.assert_array_equal(kept[there], demo_cell.checker.check(q[there]).feasible)
    assert 0 < kept.sum() < len(pool)


def test_wrong_turns_are_refused(reference_cell):
    q = np.tile(reference_cell.base_posture, (2, 1))
    for turns in (np.zeros((1, 3)), np.zeros(3), np.full((2, 3), np.nan)):
        with pytest.raises(InputError, match="rotation vector"):
            local_poses(reference_cell, q, turns)
    with pytest.raises(InputError, match="touch places"):
        local_poses(reference_cell, q, np.zeros((2, 3)), np.zeros(3))
    with pytest.raises(InputError, match="6 joints"):
        local_poses(reference_cell, q[:, 1:], np.zeros((2, 3)))


@pytest.mark.parametrize("section", ["pool", "constraints"])
def test_poses_near_singularities_name_the_setting_that_is_at_work(section):
    text = cell_template("ur5e", surroundings=False)
    given = re.search(r"^#? ?smallest_singular_value.*$", text.partition(f"[{section}]")[2], re.M)
    head, tail = text.split(f"[{section}]", 1)
    cell = Cell.from_text(
        f"{head}[{section}]{tail.replace(given[0], 'smallest_singular_value = 0.9', 1)}"
    )
    with pytest.raises(UnreachableError) as error:
        cone_candidates(away_from_singularities(cell), TILT, 60, rng())
    assert error.value.hint == f"lower {section}.smallest_singular_value"
