"""Replacements: as far as possible from all other poses, from wherever there is something left."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.se3 import rotation_angle
from posedesign.cell import Cell
from posedesign.planning import plan
from posedesign.planning.loop import (
    ENOUGH,
    POOL_ORIENTATIONS,
    Replacements,
    farthest_postures,
    grid_poses,
    repair,
)
from posedesign.planning.pose_plan import PosePlan, PoseStatus, StopReason
from posedesign.planning.poses_file import read_poses, write_poses
from tests.blocked import Blocked


@given(seed=st.integers(0, 10_000), count=st.integers(1, 6))
def test_each_replacement_is_the_farthest_there_is(seed, count):
    rng = np.random.default_rng(seed)
    pool, chosen = rng.uniform(size=(30, 3)), rng.uniform(size=(4, 3))
    scale = np.array([1.0, 2.0, 0.5])
    picked = farthest_postures(pool, chosen, count, scale)
    there = chosen
    for posture in picked:
        distance = np.linalg.norm((pool[:, None] - there[None]) / scale, axis=-1).min(axis=1)
        best = np.linalg.norm((posture - there) / scale, axis=-1).min()
        assert best == pytest.approx(distance.max())
        there = np.vstack([there, posture])


def test_repetitions_are_not_picked():
    pool = np.zeros((5, 2))
    assert len(farthest_postures(pool, np.ones((1, 2)), 3, np.ones(2))) == 1
    assert len(farthest_postures(np.empty((0, 2)), pool, 3, np.ones(2))) == 0


def test_every_posture_of_the_pool_keeps_every_constraint(demo_cell):
    q = Replacements(demo_cell).postures(5)
    assert len(q) >= ENOUGH * 5
    assert demo_cell.checker.check(q).feasible.all()
    point = demo_cell.robot.state(q).point(demo_cell.tool_m)
    assert np.abs(point - demo_cell.target_m).max() < 1e-9


def test_the_first_pool_stays_near_the_base_pose(make_cell):
    cell = make_cell(plan={"repair_tilt_deg": 25.0, "repair_base_joint_deg": 20.0})
    q = Replacements(cell).postures(1)
    z = cell.robot.fk(q)[:, :3, 2]
    tilt = np.rad2deg(np.arccos(z @ cell.robot.fk(cell.base_posture)[:3, 2]))
    assert tilt.max() <= 25.0 + 1e-6
    assert np.rad2deg(np.abs(q[:, 0] - cell.base_posture[0])).max() <= 20.0
    assert len(q) > POOL_ORIENTATIONS / 4


def test_a_narrow_view_is_searched_until_there_is_enough(make_demo_cell):
    """A tilt of 1 deg leaves hardly any of a thousand orientations; many are found all the same."""
    cell = make_demo_cell(camera={"largest_tilt_deg": 1.0})
    pool = Replacements(cell)
    q = pool.postures(24)
    assert len(q) >= ENOUGH * 24
    assert cell.checker.check(q).feasible.all()


def test_the_same_cell_gives_the_same_pool(demo_cell):
    one, other = Replacements(demo_cell), Replacements(demo_cell)
    np.testing.assert_array_equal(one.postures(400), other.postures(400))


def test_what_is_excluded_is_offered_no_more(demo_cell):
    pool = Replacements(demo_cell)
    before = pool.postures(1)
    pool.exclude(before[:3])
    after = pool.postures(1)
    for posture in before[:3]:
        assert np.abs(after - posture).max(axis=1).min() > np.deg2rad(1.0)
    assert len(before) > len(after) > 0
    later = pool.postures(10 * len(after))  # from other stages
    for posture in before[:3]:
        assert np.abs(later - posture).max(axis=1).min() > np.deg2rad(1.0)


def test_reasons_say_what_and_how_far(demo_cell):
    """The turn in words is the angle between the pose of the grid and its replacement."""
    poses = grid_poses(demo_cell, np.full(3, 50.0))
    gaps = [i for i, status in enumerate(poses.status) if status is PoseStatus.DROPPED]
    assert gaps
    after = repair(demo_cell, poses, Replacements(demo_cell))
    for i in gaps:
        why = poses.reasons[i]
        R = demo_cell.robot.fk(after.postures[i])[:3, :3]
        angle = np.rad2deg(rotation_angle(poses.orientations[i].T @ R))
        assert after.reasons[i] == f"{why}; replaced by a pose turned by {angle:.0f} deg"


def test_replacements_are_shared_out_by_nearness(demo_cell):
    """No two gaps could swap their replacements and both be turned less in sum."""
    poses = grid_poses(demo_cell, np.full(3, 60.0))
    gaps = [i for i, status in enumerate(poses.status) if status is PoseStatus.DROPPED]
    assert len(gaps) > 3
    R = demo_cell.robot.fk(repair(demo_cell, poses, Replacements(demo_cell)).postures)[:, :3, :3]

    def turn(i: int, j: int) -> float:
        return float(rotation_angle(poses.orientations[i].T @ R[j]))

    for i in gaps:
        for j in gaps:
            assert turn(i, i) + turn(j, j) <= turn(i, j) + turn(j, i) + 1e-9


def test_every_round_says_why_poses_are_not_those_of_the_grid(make_demo_cell):
    """In its row, for each of them; not in the last round alone."""
    result = plan(make_demo_cell(variations={"start_deg": [40.0, 40.0, 40.0]}))
    rows = result.round_rows()
    assert len(rows) == len(result.history)
    for row, poses in zip(rows, result.history, strict=True):
        said = str(row["reasons"]).split(" | ")
        others = [i for i, status in enumerate(poses.status) if status is not PoseStatus.GRID]
        assert others
        assert said == [f"{poses.names[i]}: {poses.reasons[i]}" for i in others]


def test_without_repair_poses_are_dropped(make_demo_cell):
    cell = make_demo_cell(plan={"repair": False}, variations={"start_deg": [50.0, 50.0, 50.0]})
    result = plan(cell)
    assert result.rounds[0].dropped > 0
    assert result.rounds[0].repaired == 0
    assert result.poses.count(PoseStatus.DROPPED) == result.rounds[result.best].dropped


def test_a_plan_is_the_same_every_time(demo_cell, make_demo_cell):
    one, other = plan(demo_cell), plan(make_demo_cell())
    np.testing.assert_array_equal(one.postures, other.postures)
    assert one.names == other.names
    assert one.fingerprint == other.fingerprint


# plans whose ways are blocked


def test_blocked_ways_are_not_blamed_on_angles(make_demo_cell):
    cell = make_demo_cell(plan={"repair": False}, variations={"largest_deg": [10.0, 10.0, 10.0]})
    cell.__dict__["ways"] = Blocked(lambda start, end: np.abs(end - start).max(axis=1) > 1e-9)
    result = plan(cell)
    assert not result.reached
    assert len(result.postures) == 1
    assert "no clear way leads to them" in result.message
    assert "free fewer" not in result.message


def beyond(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Motions that lead to postures with joint 4 beyond 50 deg."""
    return (np.abs(np.rad2deg([start[:, 3], end[:, 3]])) > 50.0).any(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("replace", [True, False])
def test_poses_that_no_way_leads_to(make_demo_cell, replace):
    wide = {"start_deg": [25.0, 25.0, 25.0]}
    keys = {"repair": replace, "condition_threshold": 2e5}
    cell = make_demo_cell(plan=keys, variations=wide)
    free = plan(cell)
    assert (np.abs(free.postures[:, 3]) > np.deg2rad(50.0)).any()
    cell = make_demo_cell(plan=keys, variations=wide)
    cell.__dict__["ways"] = Blocked(beyond)
    result = plan(cell)
    assert (np.abs(result.postures[:, 3]) <= np.deg2rad(50.0)).all()
    best = result.rounds[result.best]
    assert best.grid + best.repaired == len(result.postures)
    assert (best.repaired > 0) == replace
    assert result.indices.c_g == pytest.approx(best.c_g)
    lost = [why for why in result.poses.reasons if "no clear way to it: a wall" in why]
    assert lost
    assert len(lost) + best.grid == 27


@pytest.mark.parametrize(("joint", "largest_deg"), [(3, 20.0), (5, 15.0)])
def test_replacements_are_those_that_a_way_leads_to(make_demo_cell, joint, largest_deg):
    """Most postures are shut off: what is drawn blindly is lost again, yet none is dropped."""
    cell = make_demo_cell(plan={"condition_threshold": 2e5})
    base = cell.base_posture[joint]

    def far(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        moved = np.abs(np.array([start[:, joint], end[:, joint]]) - base)
        return (moved > np.deg2rad(largest_deg)).any(axis=0)

    cell.__dict__["ways"] = Blocked(far)
    result = plan(cell)
    assert result.poses.count(PoseStatus.DROPPED) == 0
    assert len(result.postures) == 27
    assert result.poses.count(PoseStatus.REPAIRED) > 5
    assert np.abs(result.postures[:, joint] - base).max() <= np.deg2rad(largest_deg)
    assert cell.checker.check(result.postures).feasible.all()


@pytest.fixture(scope="module")
def hemmed_in(make_demo_cell) -> Cell:
    """No joint may travel far: some poses are reached only through others, or not at all."""
    return make_demo_cell(constraints={"largest_travel_deg": 40.0})


@pytest.fixture(scope="module")
def hemmed_plan(hemmed_in) -> PosePlan:
    return plan(hemmed_in)


def test_ways_of_a_plan_are_clear(hemmed_in, hemmed_plan):
    result = hemmed_plan
    stops = np.array([hemmed_in.base_posture, *(stop.posture for stop in result.route.stops)])
    assert hemmed_in.ways.check(stops[:-1], stops[1:]).clear.all()
    assert np.rad2deg(np.abs(np.diff(stops, axis=0))).max() <= 40.0 + 1e-6


def test_rounds_count_the_poses_that_are_left(hemmed_plan):
    result = hemmed_plan
    best = result.rounds[result.best]
    assert best.grid + best.repaired == len(result.postures) == len(result.names)
    assert best.dropped == 27 - len(result.postures)
    assert result.stop is not StopReason.THRESHOLD or best.c_g < result.threshold
    assert result.indices.c_g == pytest.approx(best.c_g)
    for status, reason in zip(result.poses.status, result.poses.reasons, strict=True):
        assert (status is PoseStatus.GRID) == (reason == "")


def test_what_is_written_is_what_was_planned(hemmed_in, hemmed_plan, tmp_path):
    result = hemmed_plan
    path = tmp_path / "poses.csv"
    write_poses(path, hemmed_in.robot, result.poses, result.route, hemmed_in.tool_m)
    read = read_poses(path, 6)
    assert read.via.sum() == len(result.route.stops) - len(result.postures)
    np.testing.assert_allclose(read.postures[-1], hemmed_in.base_posture, atol=1e-9)
    assert read.measured.names == result.names
    np.testing.assert_allclose(read.measured.postures, result.postures, atol=1e-9)
