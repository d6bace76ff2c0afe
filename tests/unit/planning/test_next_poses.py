"""What to touch up next: what is known counts, what each pose gains, and when to stop."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib.errors import InputError
from calib.identification import covariance_of, identify
from calib.model import simulate
from calib.model.measurements import touch_ups
from posedesign.candidates import candidates_of, functions_over_work
from posedesign.cell.reference import reference_of
from posedesign.motion import Router
from posedesign.planning.loop import identification_jacobian
from posedesign.planning.optimal import plan_next
from posedesign.selection import evaluate

POOL = {"candidates": 80}


@pytest.fixture(scope="module")
def cell(make_cell):
    """Poses are for the ten parameters of the paper, which six touch-ups identify by themselves."""
    return make_cell(pool=POOL, parameters={"planned": ["zero_offsets"]})


@pytest.fixture(scope="module")
def whole(make_cell):
    """Poses are for all that may be off."""
    return make_cell(pool=POOL)


def touched(cell, count, seed=2, noise=1.0):
    """Simulated touch-ups at poses drawn from the pool."""
    pool, rng = candidates_of(cell), np.random.default_rng(seed)
    rows = rng.choice(len(pool), count, replace=False)
    model = cell.model()
    if noise != 1.0:
        kind = type(model.measurement)(noise * model.measurement.sigma)
        model = cell.model(measurement=kind)
    x = model.nominal.copy()
    x[:4] += np.deg2rad([0.1, -0.08, 0.05, 0.12])
    return simulate(model, x, pool.postures[rows], rng)


def expected_rms(cell, postures, x):
    """Error to expect of one design of all poses, by all that may be off [m]."""
    arms = reference_of(cell)
    functions, _ = functions_over_work(cell, arms.model)
    J = arms.model.linearise(postures, x).white_jacobian
    D = arms.deviation_rad * J[..., [n.startswith("zero_offset.") for n in arms.model.names]]
    weight = np.linalg.inv(np.eye(3) + D @ np.swapaxes(D, 1, 2))
    told = np.einsum("nap,nab,nbq->pq", J, weight, J)
    prior = np.where(np.isfinite(arms.model.prior), arms.model.prior, np.inf) ** -2.0
    C = np.linalg.inv(np.diag(prior) + told)
    return float(np.sqrt(np.einsum("kri,ij,krj->", functions, C, functions) / len(functions)))


def tcp_rms(cell, postures, x):
    """Error of the tool point over the box of one design of all poses [m]."""
    model = cell.model()
    box, _ = functions_over_work(cell, model)
    C = covariance_of(model, postures, x)
    return float(np.sqrt(np.einsum("kri,ij,krj->", box, C, box) / len(box)))


@pytest.fixture(scope="module")
def six(cell):
    data = touched(cell, 6)
    return data, plan_next(cell, data, 4)


def test_errors_are_those_of_one_design_of_what_was_and_will_be_measured(cell, six):
    data, found = six
    x = identify(cell.model(), data).values
    for k, error in enumerate(found.tcp_m):
        together = np.concatenate([data.postures, found.poses.kept[:k]])
        expected = tcp_rms(cell, together, x)
        assert error / found.noise_scale == pytest.approx(expected, rel=1e-6)


def test_next_poses_that_no_way_leads_to_are_dropped(cell, six, monkeypatch):
    data, _ = six
    route = Router.route

    def losing(self, postures, loads=None):
        lost = {1: "a wall"} if len(postures) > 2 else {}
        return replace(route(self, np.delete(postures, list(lost), axis=0)), lost=lost)

    monkeypatch.setattr(Router, "route", losing)
    found = plan_next(cell, data, 3)
    assert found.dropped == ("a wall",)
    assert found.poses.kept_names == ("P07", "P08")
    assert len(found.tcp_m) == 3
    assert [row["pose"] for row in found.rows()] == ["", "P07", "P08"]
    assert "1 pose(s) dropped: a wall" in found.message


def test_each_pose_gains_and_none_of_the_rest_would_have_gained_more(cell, six):
    data, found = six
    assert (np.diff(found.tcp_m) < 0.0).all()
    assert found.worth == 4
    assert found.message.startswith("go on: tool point known to")
    x = identify(cell.model(), data).values
    kept = found.poses.kept
    for k in range(len(kept)):
        so_far = np.concatenate([data.postures, kept[:k]])
        errors = [tcp_rms(cell, np.vstack([so_far, q]), x) for q in kept[k:]]
        assert np.argmin(errors) == 0


@pytest.mark.slow
def test_a_first_pose_is_the_best_of_the_pool(cell, six):
    data, _ = six
    found = plan_next(cell, data, 1)
    x = identify(cell.model(), data).values
    errors = [tcp_rms(cell, np.vstack([data.postures, q]), x) for q in candidates_of(cell).postures]
    assert found.tcp_m[1] / found.noise_scale == pytest.approx(min(errors), rel=1e-6)
    assert "one more is predicted" in found.message


def test_poses_can_be_taken_and_are_named_on_from_those_measured(cell, six):
    data, found = six
    assert cell.checker.check(found.poses.kept).feasible.all()
    off = cell.robot.state(found.poses.kept).point(cell.tool_m) - cell.target_m
    assert np.abs(off).max() < 1e-9
    assert found.poses.names == ("P07", "P08", "P09", "P10")
    assert sorted(found.route.order) == [0, 1, 2, 3]
    numbered = touch_ups(data.postures)
    odd = type(numbered)(
        numbered.postures,
        numbered.setup,
        numbered.targets,
        numbered.tools,
        None,
        ("P01", "P12", "left", "P03", "P04", "x7"),
    )
    assert plan_next(cell, odd, 1).poses.names == ("P13",)


def test_it_is_time_to_stop_where_a_pose_gains_little(cell):
    data = touched(cell, 30)
    found = plan_next(cell, data, 3, least_gain=0.2)
    gain = 1.0 - found.tcp_m[1] / found.tcp_m[0]
    assert gain < 0.2
    assert found.worth == 0
    assert found.message.startswith("stop: ")
    assert "would gain less than 20 %" in found.message
    assert plan_next(cell, data, 3, least_gain=0.9 * gain).worth > 0


def test_it_is_time_to_stop_where_the_accuracy_is_reached(cell, six):
    data, found = six
    between = float(found.tcp_m[1:3].mean())
    aimed = plan_next(cell, data, 4, accuracy_m=between)
    assert aimed.worth == 2  # the second brings it below
    there = plan_next(cell, data, 4, accuracy_m=float(found.tcp_m[0]) * 1.01)
    assert there.worth == 0
    assert there.message.startswith("stop: ")
    assert "mm is reached" in there.message


@pytest.mark.parametrize("count", [1, 2, 3])
def test_before_everything_is_identified_poses_are_chosen_for_that(cell, count):
    data = touched(cell, count)
    found = plan_next(cell, data, 4)
    assert found.identified is None
    assert f"{3 * count} equations for 10 parameters" in found.why_not
    assert found.message.startswith(f"go on: {count} touch-up")
    assert found.worth == 4
    assert found.noise_scale == 1.0
    together = np.concatenate([data.postures, found.poses.kept])
    assert np.isfinite(covariance_of(cell.model(), together)).all()


def test_errors_to_expect_are_of_all_that_may_be_off(whole):
    data = touched(whole, 6)
    found = plan_next(whole, data, 3)
    x = identify(reference_of(whole).model, data).values
    for k, error in enumerate(found.tcp_m):
        together = np.concatenate([data.postures, found.poses.kept[:k]])
        expected = expected_rms(whole, together, x)
        assert error / found.noise_scale == pytest.approx(expected, rel=1e-6)


def test_with_priors_two_touch_ups_have_to_tell_tool_and_target(whole):
    """Six parameters that nothing is known of: one touch-up is too few, three are enough."""
    one = plan_next(whole, touched(whole, 1), 4)
    assert one.identified is None
    assert "3 equations for" in one.why_not
    assert one.message.startswith("go on: 1 touch-up does not yet identify everything")
    three = plan_next(whole, touched(whole, 3), 4)
    assert three.identified is not None
    assert not three.why_not
    assert (np.diff(three.tcp_m) < 0.0).all()


@pytest.mark.parametrize("criterion", ["C_G", "cond_2"])
@pytest.mark.parametrize("count", [2, 6])
def test_condition_numbers_are_of_the_ten_parameters(whole, criterion, count):
    """Better than pairs drawn from the pool, by the numbers of the paper's regressor."""
    data = touched(whole, count)
    found = plan_next(whole, data, 2, criterion=criterion)
    model, pool, rng = whole.model(), candidates_of(whole), np.random.default_rng(1)
    if count == 2:  # the four together identify the ten
        together = np.concatenate([data.postures, found.poses.kept])
        assert np.isfinite(covariance_of(model, together)).all()
        return

    def value(more):
        linear = model.linearise(np.concatenate([data.postures, more]))
        indices = evaluate(identification_jacobian(linear), linear.white_jacobian)
        return indices.c_g if criterion == "C_G" else indices.cond_2_g

    drawn = [value(pool.postures[rng.choice(len(pool), 2, replace=False)]) for _ in range(20)]
    assert value(found.poses.kept) <= min(drawn)


def test_the_same_pose_again_and_again_identifies_nothing(cell):
    data = touched(cell, 1)
    same = touch_ups(np.repeat(data.postures, 6, axis=0))
    found = plan_next(cell, same, 3)
    assert found.identified is None
    assert "cannot identify" in found.why_not


def test_noise_is_scaled_by_what_the_residuals_say(cell):
    scales = []
    for noise in (1.0, 3.0):
        data = touched(cell, 12, seed=6, noise=noise)
        found = plan_next(cell, data, 1)
        x = identify(cell.model(), data).values
        assert found.tcp_m[0] == pytest.approx(found.noise_scale * tcp_rms(cell, data.postures, x))
        scales.append(found.noise_scale)
    freedom = 3 * 12 - 10
    low, high = 3.0 * np.sqrt(chi2.ppf([1e-4, 1 - 1e-4], freedom) / freedom)
    assert scales[0] == 1.0
    assert low < scales[1] < high


@pytest.mark.parametrize("criterion", ["tcp-worst", "D", "A", "C_G", "cond_2", "sigma:tool.x"])
@pytest.mark.parametrize("count", [2, 6])
def test_other_criteria_count_what_is_known_in_their_own_rows(cell, criterion, count):
    data = touched(cell, count)
    found = plan_next(cell, data, 2, criterion=criterion)
    if count == 2:
        return
    # better by that criterion than poses drawn from the pool
    model, pool = cell.model(), candidates_of(cell)
    x = identify(model, data).values
    rng = np.random.default_rng(1)

    def value(more):
        postures = np.concatenate([data.postures, more])
        return found.objective.cost_of_blocks(found.objective.blocks(model.linearise(postures, x)))

    drawn = [value(pool.postures[rng.choice(len(pool), 2, replace=False)]) for _ in range(20)]
    assert value(found.poses.kept) <= min(drawn) * (1 + 1e-9)


@pytest.mark.parametrize("gain", [0.0, 1.0, 2.0, -1.0, np.nan])
def test_a_least_gain_is_a_part(cell, six, gain):
    with pytest.raises(InputError, match="between 0 and 1"):
        plan_next(cell, six[0], 1, least_gain=gain)


def test_other_cells_and_data_are_refused(cell, six, make_cell):
    camera = make_cell(measurement={"kind": "camera-pose"})
    with pytest.raises(InputError, match="camera calibrated"):
        plan_next(camera, six[0], 1)
