"""Pools that touch nothing: even in the joints, or in what a camera sees of its target."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from calib.errors import InputError, UnreachableError
from calib.se3 import FloatArray
from posedesign.candidates import joint_candidates
from posedesign.candidates.building import viewing_poses
from posedesign.candidates.postures import even_points
from posedesign.cell import Cell, cell_template


def rng(seed: int = 7) -> np.random.Generator:
    return np.random.default_rng(seed)


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
