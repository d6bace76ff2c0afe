"""Plans for the arm that is fitted: what they promise, for whom, and what is proven of a choice."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from calib.identification import tool_motion
from calib.identification.prediction import rigid_motions
from posedesign.candidates import functions_over_work, workplace_of
from posedesign.cell.models import EVERYTHING, PRIORS, WIND_UP, payloads_of, robot_blocks
from posedesign.cell.reference import DEVIATION_RAD, USUAL_SIZES, reference_of
from posedesign.planning.optimal import Request, plan_optimal
from posedesign.planning.optimal.outlook import outlook_of
from posedesign.report.plans import answer_of_choice
from posedesign.selection import mean_deviation, search, select, select_fewest

POOL = {"candidates": 60}


@pytest.fixture(scope="module")
def cell(make_cell):
    return make_cell(pool=POOL)


@pytest.fixture(scope="module")
def planned(cell):
    return plan_optimal(cell, Request(count=12))


def expected_by_hand(cell, postures, setup=None):
    """Error [m] after measuring: priors, blocks and rigid motions put together by plain numpy."""
    model = reference_of(cell).model
    J = model.linearise(postures, setup=setup).white_jacobian
    D = DEVIATION_RAD * J[..., [name.startswith("zero_offset.") for name in model.names]]
    weight = np.linalg.inv(np.eye(J.shape[1]) + D @ np.swapaxes(D, 1, 2))
    at = workplace_of(cell)
    moved = tool_motion(model, at.postures, at.setup).reshape(-1, model.p)
    B = rigid_motions(model.view(at.postures, None, at.setup).tool_points)
    L = moved - B @ (B.T @ moved)
    unit = np.linalg.norm(J.reshape(-1, model.p), axis=0)
    unit[unit == 0.0] = 1.0
    told = np.einsum("nap,nab,nbq->pq", J / unit, weight, J / unit)
    known = model.known_rows / unit
    C = np.linalg.inv(told + known.T @ known) / np.outer(unit, unit)
    return float(np.sqrt(np.trace(L @ C @ L.T) / len(at.postures)))


def test_a_plan_is_by_default_for_all_that_may_be_off(cell, planned):
    model = planned.model
    assert model.names == reference_of(cell).model.names
    stems = {name.partition(".")[0] for name in model.names}
    assert {"zero_offset", "link", "compliance", "bearing", "lost_motion", "harmonic"} <= stems
    assert PRIORS in EVERYTHING
    free = [name for name, sigma in zip(model.names, model.prior, strict=True) if sigma == np.inf]
    assert all(name.partition(".")[0] in ("tool", "target") for name in free)
    assert len(free) == 6


def test_a_plan_promises_the_error_of_a_second_calculation(cell, planned):
    expected = expected_by_hand(cell, planned.postures)
    assert planned.accuracy.tcp_m == pytest.approx(expected, rel=1e-5)
    assert planned.accuracy.expected.rms_m == pytest.approx(expected, rel=1e-5)
    assert planned.selection.value == pytest.approx(1e3 * planned.of_pool.tcp_m, rel=1e-6)
    assert planned.selection.value >= planned.selection.bound
    assert outlook_of(cell, planned.postures).tcp_m == pytest.approx(expected, rel=1e-5)


def test_the_range_over_arms_is_said_beside_it(cell, planned):
    found = planned.accuracy.expected
    assert found.low_m < found.median_m < found.high_m
    assert found.low_m < found.rms_m
    said = answer_of_choice(cell, planned).figures["expected error"]
    assert said.startswith(f"{1e3 * found.rms_m:.3g} mm rms over ")
    low, high = f"{1e3 * found.low_m:.2g}", f"{1e3 * found.high_m:.2g}"
    assert said.endswith(f"80 % of such arms {low} to {high} mm")


def test_what_is_named_is_planned_for_with_nothing_known_beforehand(make_cell):
    cell = make_cell(pool=POOL, parameters={"planned": ["zero_offsets"]})
    found, model = plan_optimal(cell, Request(count=12, beside=0)), cell.model()
    assert found.model.names == model.names
    assert len(found.model.names) == 10
    assert not len(found.arms.known_rows)
    J = model.linearise(found.postures).white_jacobian.reshape(-1, 10)
    sigma = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    np.testing.assert_allclose(found.accuracy.sigma, sigma, rtol=1e-6)
    at = workplace_of(cell)
    moved = tool_motion(model, at.postures, at.setup).reshape(-1, 10)
    B = rigid_motions(model.view(at.postures, None, at.setup).tool_points)
    L = moved - B @ (B.T @ moved)
    error = np.sqrt(np.trace(L @ np.linalg.inv(J.T @ J) @ L.T) / len(at.postures))
    assert found.accuracy.tcp_m == pytest.approx(error, rel=1e-6)


@pytest.mark.parametrize("criterion", ["C_G", "cond_2"])
def test_condition_numbers_stay_those_of_the_ten(make_cell, cell, criterion):
    asked = Request(count=12, criterion=criterion, beside=0)
    ten = plan_optimal(make_cell(pool=POOL, parameters={"planned": ["zero_offsets"]}), asked)
    found = plan_optimal(cell, asked)
    np.testing.assert_array_equal(found.postures, ten.postures)
    assert found.selection.value == pytest.approx(ten.selection.value)
    assert found.indices.as_dict() == pytest.approx(ten.indices.as_dict())
    # what such poses leave of the arm is said all the same
    assert found.accuracy.tcp_m == pytest.approx(expected_by_hand(cell, found.postures), rel=1e-5)


def test_a_known_distance_lowers_the_error(make_cell):
    """Touch-ups of two targets show the scale of the arm only where their distance is known."""
    target = {"position_mm": [1915.4, 50.0, 493.0], "name": "low"}
    targets = [target, {"name": "high", "position_mm": [1915.4, 50.0, 1293.0]}]
    known = {"targets": ["low", "high"], "length_mm": 800.0, "three_sigma_mm": 0.03}
    free = make_cell(pool=POOL, target=targets)
    told = make_cell(pool=POOL, target=targets, known_distance=[known])
    plan = plan_optimal(free, Request(count=16, beside=0))
    which = free.which([dict(label) for label in plan.labels])
    errors = []
    for cell in (free, told):
        arms = reference_of(cell)
        functions, _ = functions_over_work(cell, arms.model)
        setup = cell.setup(arms.model, plan.postures, which)
        blocks = arms.blocks(arms.model.linearise(plan.postures, setup=setup))
        errors.append(arms.expected_error(blocks, functions).rms_m)
        by_hand = expected_by_hand(cell, plan.postures, setup)
        assert errors[-1] == pytest.approx(by_hand, rel=1e-5)
    assert errors[1] < 0.9 * errors[0]
    assert plan_optimal(told, Request(count=16, beside=0)).accuracy.tcp_m < 0.9 * errors[0]


def test_the_bearing_of_a_joint_that_carries_the_arm_gives_way_less(reference_cell):
    """By no more than some milliradians under the moment that overturns it, as reducers do."""
    robot = reference_cell.robot
    (bearings,) = robot_blocks(reference_cell, ["bearings", PRIORS])
    usual = 1e-6 * reference_cell.config.parameters.prior_compliance_urad_nm
    assert (bearings.prior <= usual * (1.0 + 1e-12)).all()
    # the moment about the first joint, across its axis, of all that it carries
    q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (3000, robot.n))
    state, (load, *_) = robot.state(q), payloads_of(reference_cell)
    masses = np.einsum("nlij,lj->nli", state.rotations, robot.link_com) + state.origins
    moment = np.einsum("l,nli->ni", robot.link_mass, masses - state.origins[:, :1])
    moment += load.mass_kg * (state.point(load.com_m) - state.origins[:, 0])
    overturning = 9.81 * np.hypot(moment[:, 0], moment[:, 1]).max()
    least = WIND_UP / overturning
    assert least < 0.1 * usual
    first = [k for k, name in enumerate(bearings.names) if name.startswith("bearing.joint_1.")]
    assert len(first) == 2
    for k in first:  # of either direction, by fewer postures
        assert 0.99 * least < bearings.prior[k] < 1.3 * least
    last = [k for k, name in enumerate(bearings.names) if name.startswith("bearing.joint_6.")]
    assert bearings.prior[last].min() > 10.0 * bearings.prior[first].max()


def pool_of(rng, count: int, p: int = 8):
    """Blocks of three rows by which priors hold all but three parameters, widely apart.

    Of some hardly anything is known, of some the priors know more than all poses would tell.
    """
    unit = 10.0 ** rng.uniform(-3.0, 3.0, p)
    J = rng.normal(size=(count, 3, p)) * rng.uniform(0.3, 3.0, (count, 1, 1)) * unit
    known = np.zeros((p - 3, p))
    known[:, 3:] = np.diag(unit[3:] * 10.0 ** rng.uniform(-1.0, 2.5, p - 3))
    return J, known, rng.normal(size=(5, 3, p)) * unit


def error_of(pool, rows):
    """Error of a choice, or of choices ``(K, n)``: normal equations of scaled columns."""
    J, known, functions = pool
    unit = np.sqrt((J**2).sum(axis=(0, 1)) + (known**2).sum(axis=0))
    A, B, L = J / unit, known / unit, (functions / unit).reshape(-1, J.shape[2])
    each = np.einsum("nap,naq->npq", A, A)
    C = np.linalg.inv(each[np.array(rows)].sum(axis=-3) + B.T @ B)
    return np.sqrt(np.einsum("...pq,rp,rq->...", C, L, L, optimize=True) / len(functions))


def test_no_choice_out_of_a_small_pool_beats_the_one_found(monkeypatch):
    """Nor the bound, by the relaxation and not by trying: in all of 200 pools."""
    monkeypatch.setattr(search, "ENUMERATED", 0)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        count, n = int(rng.integers(10, 15)), int(rng.integers(4, 7))
        J, known, functions = pool = pool_of(rng, count)
        found = select(J, n, mean_deviation(functions), known=known)
        best = error_of(pool, list(combinations(range(count), n))).min()
        assert found.value == pytest.approx(error_of(pool, found.indices), rel=1e-7)
        assert found.value <= best * (1.0 + 1e-7)
        assert found.bound <= best * (1.0 + 1e-7)
        assert found.efficiency == pytest.approx((found.bound / found.value) ** 2)


def exchanged(pool, rows, rng) -> float:
    """Error after each pose of a choice was offered ten others, once."""
    rows, best = list(rows), error_of(pool, rows)
    for k in range(len(rows)):
        for other in rng.choice(np.setdiff1d(np.arange(len(pool[0])), rows), 10, replace=False):
            offered = [*rows[:k], int(other), *rows[k + 1 :]]
            if (error := error_of(pool, offered)) < best:
                rows, best = offered, error
    return best


def test_the_proof_of_a_choice_is_tight_where_poses_tell_twice_what_there_is():
    """Of 60 to 100 candidates; 8 to 20 poses of three rows for eight parameters."""
    efficiency = []
    for seed in range(30):
        rng = np.random.default_rng(1000 + seed)
        count, n = int(rng.integers(60, 101)), int(rng.integers(8, 21))
        J, known, functions = pool = pool_of(rng, count)
        found = select(J, n, mean_deviation(functions), known=known)
        efficiency.append(found.efficiency)
        drawn = [rng.choice(count, n, replace=False) for _ in range(2000)]
        errors = error_of(pool, drawn)
        assert found.bound < errors.min()
        assert found.value <= errors.min()
        best = np.argsort(errors)[:3]
        better = min(exchanged(pool, drawn[k], rng) for k in best)
        assert found.bound < better
        assert found.value <= better * (1.0 + 1e-9)
    assert min(efficiency) > 0.95


def test_the_proof_is_loose_where_poses_tell_less_than_there_is():
    """Parts of poses then tell nearly as much as whole ones, which no choice of poses has.

    Twenty-four rows for forty parameters that priors hold: the bound is right, and far below.
    """
    efficiency = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        J, known, functions = pool = pool_of(rng, 80, p=40)
        found = select(J, 8, mean_deviation(functions), known=known, starts=2)
        efficiency.append(found.efficiency)
        start = rng.choice(80, 8, replace=False)
        assert found.bound < found.value < exchanged(pool, start, rng)
    assert 0.1 < np.median(efficiency) < 0.8


def test_more_measurements_are_counted_beside_what_is_known_beforehand():
    """What the priors hold stays as it is, however often poses are measured."""
    J, known, functions = pool_of(np.random.default_rng(5), 8)
    criterion = mean_deviation(functions)
    for times in (2, 7, 30):
        again = np.sqrt(times) * J, known, functions
        found = select_fewest(J, criterion, error_of(again, range(8)) * (1.0 + 1e-6), known=known)
        assert not found.reached
        assert found.times == times
    # without priors the square of the error falls with the number
    told = select_fewest(J, criterion, error_of((J, 0.0 * known, functions), range(8)) / 2.999)
    assert told.times == 9
    dark = J * (np.arange(8) < 7)  # the last parameter is told by its prior alone
    left = error_of((1e6 * dark, known, functions), range(8))
    assert select_fewest(dark, criterion, 0.99 * left, known=known).times == 0


def test_the_page_on_the_expected_error_has_the_sizes_that_plans_take():
    page = (Path(__file__).parents[3] / "docs/explanation/expected_error.md").read_text("utf-8")
    rows = re.findall(r"^\| ([^|]+) \| \.(\d+)[^|]* \| ([\d.]+) \|$", page, flags=re.MULTILINE)
    said = {name: (float(f".{share}"), float(factor)) for name, share, factor in rows}
    called = {
        "offsets": "zero offsets",
        "lengths": "lengths of links",
        "angles": "angles of links",
        "compliance": "joint compliance",
        "bearing": "bearings",
        "lost motion": "lost motion, harmonics",
        "harmonic": "lost motion, harmonics",
    }
    assert {name: said[called[name]] for name in USUAL_SIZES} == {
        name: (size.share, size.factor) for name, size in USUAL_SIZES.items()
    }
    assert f"by {1e6 * DEVIATION_RAD:g} µrad" in page
