"""Pools of postures: they touch, they keep every constraint, and nothing is left out or twice."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import kstest

from calib.errors import CalibError, InputError, UnreachableError
from calib.model import Setup
from calib.se3 import FloatArray
from posedesign.candidates import (
    CONFIGURATIONS,
    CandidatePoses,
    cone_candidates,
    feasible,
    grid_candidates,
    offset_targets,
)
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
    poses = tried_poses(cell, 150)
    pool = cone_candidates(cell, TILT, 150, rng(), "nearest")
    solutions = cell.robot.inverse(poses, near=cell.base_posture, margin=cell.margin)
    expected, second = [], 0
    for k in range(150):
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
    poses = tried_poses(demo_cell, 300)
    pool = cone_candidates(demo_cell, TILT, 300, rng(), configurations)
    solutions = demo_cell.robot.inverse(poses, near=demo_cell.base_posture, margin=demo_cell.margin)
    expected = np.concatenate([solutions.of(k) for k in range(300)])
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
