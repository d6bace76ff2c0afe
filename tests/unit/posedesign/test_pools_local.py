"""The tool turned a little about what it touches: the same branch, next to where it was."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import InputError
from calib.robots import CoupledLimit
from calib.se3 import FloatArray, rotation_angle, rotation_exp
from posedesign.candidates import CandidatePoses, cone_candidates, feasible, local_poses
from posedesign.cell import Cell, cell_template, touching_poses


def pool_of(cell: Cell, count: int = 300) -> CandidatePoses:
    return cone_candidates(cell, 0.9, count, np.random.default_rng(4), "all")


def turns_of(pool: CandidatePoses, sigma: float) -> FloatArray:
    return np.random.default_rng(5).normal(0.0, sigma, (len(pool), 3))


def test_the_tool_turns_in_its_own_axes_about_what_it_touches(reference_cell):
    pool = pool_of(reference_cell)
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
    pool = pool_of(reference_cell)
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
    pool = pool_of(demo_cell)
    turns = turns_of(pool, 0.25)
    q = local_poses(demo_cell, pool.postures, turns, pool.touched_m)
    there = np.isfinite(q).all(axis=1)
    assert there.mean() > 0.7
    back = local_poses(demo_cell, q[there], -turns[there], pool.touched_m[there])
    np.testing.assert_allclose(back, pool.postures[there], atol=1e-6)


def test_a_small_turn_moves_the_joints_as_the_jacobian_has_it(reference_cell):
    pool = pool_of(reference_cell, 50)
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
    pool = pool_of(demo_cell, 50)
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
    pool = pool_of(reference_cell, 100)
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
    pool = pool_of(demo_cell, 100)
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
