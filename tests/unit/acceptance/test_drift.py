"""The test of whether an arm is still the same: choice by brute force, chances by simulation."""

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from calib.errors import InputError
from posedesign.acceptance.drift import (
    FALSE_ALARM,
    POWER,
    UNEXPLAINED,
    Cause,
    Pool,
    alarm_from,
    choose,
    judge_change,
    non_centrality,
    whiten,
)
from posedesign.acceptance.recheck import Watch, plan_recheck
from posedesign.cell import Cell, cell_template
from posedesign.files.measurements import MeasurementTable
from tests.marks import by_stage
from tests.unit.acceptance.conftest import TRACKER_CELL, identified_in


def a_pool(rng: np.random.Generator, anew: int = 0, N: int = 12) -> Pool:
    p = 7
    root = rng.standard_normal((p, p)) * 0.1
    return Pool(
        rng.standard_normal((N, 3, p)) * 3.0,
        root @ root.T,
        np.eye(p)[:, :4],
        np.eye(p)[:, p - anew :],
    )


@pytest.mark.parametrize("anew", [0, 3])
@pytest.mark.parametrize("seed", range(6))
def test_the_choice_is_that_of_all_sets_tried(anew, seed):
    """220 sets of three out of twelve."""
    rng = np.random.default_rng(seed)
    pool = a_pool(rng, anew)
    every = np.array(list(combinations(range(12), 3)))
    best = pool.information(every).min(axis=1).max()
    chosen, value = choose(pool, 3, rng)
    assert value == pytest.approx(best)
    assert pool.information(chosen[None]).min() == pytest.approx(best)


@pytest.mark.parametrize("anew", [0, 3])
def test_information_is_that_of_the_test_itself(anew):
    rng = np.random.default_rng(8)
    pool = a_pool(rng, anew)
    causes = [Cause(f"c{k}", np.eye(7)[:, [k]], "rad") for k in range(4)]
    rows = np.array([2, 5, 9, 11])
    told = whiten(pool.blocks[rows].reshape(-1, 7), pool.covariance, causes, pool.anew)
    assert told.freedom == 12 - anew
    squares = [float(np.sum(told.effects[c.name] ** 2)) for c in causes]
    assert pool.information(rows[None])[0] == pytest.approx(squares)
    # generalised least squares with the set-up free, written out
    J = pool.blocks[rows].reshape(-1, 7)
    S = np.eye(12) + J @ pool.covariance @ J.T
    for k, square in enumerate(squares):
        design = np.column_stack([J[:, k], J @ pool.anew])
        by_hand = 1.0 / np.linalg.inv(design.T @ np.linalg.solve(S, design))[0, 0]
        assert square == pytest.approx(by_hand)


def test_the_smallest_change_is_found_with_the_chance_that_it_is_said_to_be():
    rng = np.random.default_rng(3)
    pool = a_pool(rng)
    cause = Cause("a shift", np.eye(7)[:, :3], "m")
    told = whiten(pool.blocks[:4].reshape(-1, 7), pool.covariance, [cause], pool.anew)
    weakest = np.linalg.svd(told.effects["a shift"])[2][-1]
    assert told.power("a shift", told.smallest("a shift") * weakest) == pytest.approx(POWER)
    assert told.power("a shift", np.zeros(3) + 1e-9) == pytest.approx(FALSE_ALARM, rel=1e-3)
    assert stats.ncx2.sf(alarm_from(12), 12, non_centrality(12, 0.5)) == pytest.approx(0.5)


def test_what_does_not_show_is_found_by_nothing():
    J = np.zeros((6, 3))
    J[:, 0] = 1.0
    causes = [Cause("seen", np.eye(3)[:, [0]], "rad"), Cause("not", np.eye(3)[:, [1]], "rad")]
    told = whiten(J, np.zeros((3, 3)), causes, np.zeros((3, 0)))
    assert np.isfinite(told.smallest("seen"))
    assert told.smallest("not") == np.inf
    with pytest.raises(InputError, match="nothing besides where the set-up stands"):
        whiten(J[:1], np.zeros((3, 3)), causes, np.eye(3)[:, [0]])


def test_too_many_poses_of_a_pool_are_refused():
    with pytest.raises(InputError, match="13 poses out of 12"):
        choose(a_pool(np.random.default_rng(0)), 13, np.random.default_rng(0))


@pytest.fixture(scope="module")
def watch(found):
    return Watch.of(found.cell, found.identified, {}, ["point"])


@pytest.fixture(scope="module")
def plan(found, watch):
    return plan_recheck(found.cell, watch, 4)


def rechecks(found, watch, plan, change: dict[str, float], trials: int, seed: int):
    """Outcomes of rechecks of arms drawn from the identification, with a change and noise."""
    rng = np.random.default_rng(seed)
    model, q = watch.model, plan.poses.kept
    values, vectors = np.linalg.eigh(watch.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    x = watch.x + rng.standard_normal((trials, model.p)) @ root.T
    for name, more in change.items():
        x[:, model.names.index(name)] += more
    true = model.predict(np.broadcast_to(q, (trials, *q.shape)), x)
    read = true + model.measurement.sigma * rng.standard_normal(true.shape)
    table = found.measured(q, plan.poses.kept_names, seed=None)
    data = table.data
    for each in read:
        measured = type(data)(q, data.setup, data.targets, data.tools, each, data.names)
        yield watch.test(MeasurementTable(measured, ("point",), table.lines))


@pytest.mark.parametrize("trials", by_stage(80, 700, 2000))
def test_false_alarms_are_as_many_as_they_are_said_to_be(found, watch, plan, trials):
    alarms = sum(not each.same for each in rechecks(found, watch, plan, {}, trials, 5))
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, FALSE_ALARM)
    assert low <= alarms <= high


@pytest.mark.parametrize("cause", ["joint_a2", "joint_a4", "joint_a6"])
@pytest.mark.parametrize("trials", by_stage(80, 500, 1500))
def test_power_is_as_predicted(found, watch, plan, cause, trials):
    """Within .05; within three standard deviations of few trials."""
    smallest = plan.told.smallest(f"zero of {cause}")
    change = {f"zero_offset.{cause}": smallest}
    hits = sum(not each.same for each in rechecks(found, watch, plan, change, trials, 6))
    assert hits / trials == pytest.approx(POWER, abs=max(0.03, 3 * 0.3 / np.sqrt(trials)))


@pytest.mark.parametrize("joint", [1, 2, 3, 4, 5])
def test_what_moved_is_named_with_its_size(found, watch, plan, joint):
    """Ten times the smallest change that is found: nothing else explains it."""
    name = f"zero of joint_a{joint}"
    moved = 10.0 * plan.told.smallest(name)
    changes = {f"zero_offset.joint_a{joint}": moved}
    for outcome in rechecks(found, watch, plan, changes, 5, 7):
        assert not outcome.same
        best = outcome.explanations[0]
        assert best.cause == name
        assert outcome.possible[:1] == ((best,) if best.p_left >= UNEXPLAINED else ())
        assert best.change[0] == pytest.approx(moved, abs=5 * best.sigma[0])


def test_a_tool_that_was_hit_is_named(found, watch, plan):
    moved = 10.0 * plan.told.smallest("the tool")
    for outcome in rechecks(found, watch, plan, {"tool.x": moved, "tool.z": -moved}, 3, 8):
        best = outcome.possible[0]
        assert best.cause == "the tool"
        assert best.change == pytest.approx([moved, 0.0, -moved], abs=5 * best.sigma.max())


def test_two_changes_are_explained_by_no_single_cause(found, watch, plan):
    far = {
        f"zero_offset.joint_a{j}": 60 * plan.told.smallest(f"zero of joint_a{j}") for j in (2, 5)
    }
    for outcome in rechecks(found, watch, plan, far | {"tool.y": 0.01}, 3, 9):
        assert not outcome.same
        assert outcome.possible == ()


def test_an_instrument_set_up_anew_is_no_alarm_and_hides_the_first_joint(found, plan):
    anew = Watch.of(found.cell, found.identified, {}, ["point"], set_up_anew=True)
    own = plan_recheck(found.cell, anew, 4)
    assert own.blind == ("zero of joint_a1",)
    assert own.smallest()["zero of joint_a1"] > 1e3
    change = {"target.tracker.x": 0.02, "target.tracker.rz": 1e-4}
    outcomes = list(rechecks(found, anew, own, change, 20, 10))
    assert sum(each.same for each in outcomes) >= 16
    stays = Watch.of(found.cell, found.identified, {}, ["point"])
    assert not any(each.same for each in rechecks(found, stays, own, change, 20, 10))


def test_poses_keep_the_constraints_of_the_cell_and_more_find_less(found, plan):
    assert found.cell.checker.check(plan.poses.kept, every=False).feasible.all()
    assert len(plan.route.order) == 4
    assert plan.by_count[3] > plan.by_count[4]
    with pytest.raises(InputError, match="21 poses"):
        plan_recheck(found.cell, plan.watch, 21)


def test_touched_targets_are_watched_as_well():
    text = cell_template(surroundings=False).replace("candidates = 1500", "candidates = 60")
    cell = Cell.from_text(text.replace("deflection = true", "deflection = false"))
    found = identified_in(cell)
    watch = Watch.of(cell, found.identified, {}, ["touch-up"])
    plan = plan_recheck(cell, watch, 3)
    assert plan.blind == ()
    tool = cell.robot.state(plan.poses.kept).point(cell.tool_m)
    assert tool == pytest.approx(np.tile(cell.target_m, (3, 1)), abs=1e-6)
    for add, same in ((0.0, True), (20 * plan.told.smallest("zero of joint_3"), False)):
        robot = found.robot
        k = robot.model.names.index("zero_offset.joint_3")
        robot.values[k] += add
        data = robot.touch_up(plan.poses.kept, np.random.default_rng(2))
        outcome = watch.test(MeasurementTable(data, ("touch-up",), (2, 3, 4)))
        robot.values[k] -= add
        assert outcome.same == same
    assert outcome.possible[0].cause == "zero of joint_3"


def test_targets_that_were_not_identified_are_left_out(found, watch):
    """Of two trackers the one is rechecked that the arm was identified by; of none, nothing."""
    text = TRACKER_CELL.replace("three_sigma_deg_if_pose", "")
    head, _, rest = text.partition("[target]")
    own, _, tail = rest.partition("[task_box]")
    other = own.replace('"tracker"', '"other"').replace("3000.0", "3500.0")
    both = f"{head}[[target]]{own}[[target]]{other}[task_box]{tail}"
    plan = plan_recheck(Cell.from_text(both), watch, 4)
    assert {each["target"] for each in plan.poses.kept_labels} == {"tracker"}
    neither = both.replace('"tracker"', '"another"')
    with pytest.raises(InputError, match="nothing that the cell measures was identified"):
        plan_recheck(Cell.from_text(neither), watch, 4)


def test_an_outcome_needs_measurements(watch, plan):
    with pytest.raises(InputError, match="nothing was measured"):
        judge_change(plan.told, watch.causes)
