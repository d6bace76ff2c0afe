"""Poses turned off the pool: better, inside all constraints, on target, and at an optimum."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.identification.prior_arms import PriorArms
from calib.se3 import rotation_exp
from posedesign.candidates import cone_candidates, functions_over_work, joint_candidates
from posedesign.cell import touching_poses
from posedesign.planning.optimal import Request, refinement
from posedesign.planning.optimal.refinement import _Refinement, refine
from posedesign.planning.optimal.request import objective_of
from posedesign.selection import select
from tests.marks import rest_in_slow

TILT = np.deg2rad(40.0)
CRITERIA = ("tcp", "tcp-worst", "sigma:zero_offset.joint_2", "D", "A", "C_G", "cond_2")
SMOOTH = ("tcp", "sigma:zero_offset.joint_2", "D", "A")


def objective_in(cell, criterion):
    model = cell.model()
    box, _ = functions_over_work(cell, model)
    return model, objective_of(Request(count=8, criterion=criterion), PriorArms(model), box)


def cost_of(model, objective, pool):
    return objective.cost_of_blocks(objective.blocks(pool.linearise(model)))


def best_of(model, objective, pool, count=8):
    found = select(
        objective.blocks(pool.linearise(model)), count, objective.criterion, starts=1, bound=False
    )
    return pool.take(found.indices)


def tilts(cell, postures):
    z = cell.robot.fk(postures)[:, :3, 2]
    return np.arccos(np.clip(z @ cell.robot.fk(cell.base_posture)[:3, 2], -1.0, 1.0))


def turned(cell, pool, k, turn):
    """Pose k turned, on the branch it was on: by the closed form, not as refinement turns it."""
    R = pool.orientations[k] @ rotation_exp(np.asarray(turn))
    T = touching_poses(R[None], cell.tool_m, pool.touched_m[[k]])
    found = cell.robot.inverse(T, near=pool.postures[k], margin=cell.margin)
    distance = np.abs(found.postures - pool.postures[k]).max(axis=1)
    q = pool.postures.copy()
    if not len(distance) or distance.min() > 20 * np.linalg.norm(turn):
        return None
    q[k] = found.postures[np.argmin(distance)]
    orientations = pool.orientations.copy()
    orientations[k] = R
    return replace(pool, postures=q, orientations=orientations)


@pytest.fixture(scope="module")
def reference(make_cell):
    cell = make_cell()
    return cell, cone_candidates(cell, TILT, 80, np.random.default_rng(3))


@pytest.fixture(scope="module")
def refined(reference):
    """Model, objective, poses chosen and poses refined, by the criterion."""
    cell, pool = reference

    @cache
    def made(criterion):
        model, objective = objective_in(cell, criterion)
        chosen = best_of(model, objective, pool)
        return model, objective, chosen, refine(cell, model, objective, chosen)

    return made


@pytest.mark.slow
@pytest.mark.parametrize("criterion", CRITERIA)
def test_refined_poses_are_better_and_keep_every_constraint(reference, refined, criterion):
    cell, _ = reference
    model, objective, chosen, found = refined(criterion)
    assert cost_of(model, objective, found) < 0.98 * cost_of(model, objective, chosen)
    assert cell.checker.check(found.postures).feasible.all()
    off = cell.robot.state(found.postures).point(cell.tool_m) - cell.target_m
    assert np.abs(off).max() < 1e-9
    np.testing.assert_allclose(cell.robot.fk(found.postures)[:, :3, :3], found.orientations)
    assert tilts(cell, found.postures).max() <= tilts(cell, chosen.postures).max() + 1e-8


@pytest.mark.parametrize(
    ("keys", "tilt_deg"),
    [
        pytest.param({"safety_distance_mm": 60.0}, 40.0, id="collisions"),
        pytest.param(
            {"smallest_singular_value": 0.08}, 60.0, id="singularities", marks=pytest.mark.slow
        ),
    ],
)
def test_what_lies_in_the_way_of_better_poses_is_kept_clear_of(
    make_demo_cell, monkeypatch, keys, tilt_deg
):
    cell = make_demo_cell(constraints=keys)
    pool = cone_candidates(cell, np.deg2rad(tilt_deg), 80, np.random.default_rng(3))
    model, objective = objective_in(cell, "tcp")
    chosen = best_of(model, objective, pool)
    found = refine(cell, model, objective, chosen)
    assert cost_of(model, objective, found) < 0.98 * cost_of(model, objective, chosen)
    assert cell.checker.check(found.postures).feasible.all()
    monkeypatch.setattr(refinement, "feasible", lambda cell, q, *at: np.isfinite(q).all(axis=1))
    free = refine(cell, model, objective, chosen)
    assert not cell.checker.check(free.postures).feasible.all()


@pytest.mark.parametrize("criterion", [*SMOOTH[:3], pytest.param("A", marks=pytest.mark.slow)])
def test_slopes_are_those_of_the_whole_cost(reference, refined, criterion):
    cell, _ = reference
    model, objective, chosen, _ = refined(criterion)
    inside = chosen.take(np.flatnonzero(tilts(cell, chosen.postures) < TILT))
    slopes = _Refinement(cell, model, objective, inside, 0)._slopes()
    step, compared = 1e-3, 0
    for k in range(len(inside)):
        for axis in range(3):
            ends = [turned(cell, inside, k, s * step * np.eye(3)[axis]) for s in (1, -1)]
            if None in ends:
                continue
            ahead, behind = (np.log(cost_of(model, objective, end)) for end in ends)
            expected = (ahead - behind) / (2 * step)
            assert slopes[k, axis] == pytest.approx(expected, rel=2e-3, abs=2e-5)
            compared += 1
    assert compared > 2 * len(inside)


@pytest.mark.parametrize("criterion", rest_in_slow(["tcp", "D", "C_G"], ["tcp"]))
def test_no_small_turn_helps_any_more(reference, refined, criterion):
    cell, _ = reference
    model, objective, chosen, found = refined(criterion)
    before, after = cost_of(model, objective, chosen), cost_of(model, objective, found)
    widest = tilts(cell, chosen.postures).max() + 1e-9
    rng = np.random.default_rng(8)
    gains = []
    for turn in rng.normal(size=(90, 3)):
        k = int(rng.integers(len(found)))
        other = turned(cell, found, k, turn * rng.choice([0.003, 0.01, 0.03]))
        if other is None or not cell.checker.check(other.postures).feasible.all():
            continue
        if tilts(cell, other.postures).max() <= widest:
            gains.append(1.0 - cost_of(model, objective, other) / after)
    assert len(gains) > 30
    # what a turn of one pose still gains is little beside what refinement gained
    assert max(gains) < 0.05 * (1.0 - after / before)


def test_poses_that_are_fixed_stay(reference, refined):
    cell, _ = reference
    model, objective, chosen, _ = refined("tcp")
    found = refine(cell, model, objective, chosen, fixed=3)
    np.testing.assert_array_equal(found.postures[:3], chosen.postures[:3])
    assert (np.abs(found.postures[3:] - chosen.postures[3:]).max(axis=1) > 1e-3).any()


def test_without_a_touch_the_tool_point_stays_where_each_pose_has_it(make_cell):
    cell = make_cell(measurement={"kind": "camera-pose"})
    pool = joint_candidates(cell, 60, np.random.default_rng(4), np.deg2rad(40.0))
    model, objective = objective_in(cell, "tcp")
    chosen = best_of(model, objective, pool)
    found = refine(cell, model, objective, chosen)
    assert cost_of(model, objective, found) < cost_of(model, objective, chosen)
    before, after = (cell.robot.state(p.postures).point(cell.tool_m) for p in (chosen, found))
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert cell.checker.check(found.postures).feasible.all()
