"""Plans out of a pool: what they promise, what is proven of them, and what is refused."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import InputError, UnreachableError
from calib.identification import covariance_of, identify_batch
from calib.identification.prediction import Expectation
from calib.identification.prior_arms import PriorArms
from calib.model import simulate, touch
from calib.se3 import rotation_angle
from posedesign.candidates import (
    candidates_of,
    cone_candidates,
    functions_over_work,
    workplace_of,
)
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import parse_config
from posedesign.cell.reference import reference_of
from posedesign.motion import Router
from posedesign.planning import off_target
from posedesign.planning.loop import check_base_pose
from posedesign.planning.optimal import Request, plan_fewest, plan_optimal
from posedesign.planning.optimal import choose as planning
from posedesign.planning.optimal.choose import refined_with_way, without_unreached
from posedesign.planning.optimal.outlook import advice_for, outlook_of
from posedesign.planning.optimal.refinement import blocks_of_robots, draw_parameters
from posedesign.planning.optimal.request import accuracy_of, objective_of
from posedesign.planning.poses_file import read_poses
from posedesign.selection import Candidates
from posedesign.selection.search import exchange
from posedesign.workflow import plan_optimal_poses
from tests.blocked import Blocked

POOL = {"candidates": 80}
FIVE_SIGMA = 5.0

TEN = {"planned": ["zero_offsets"]}
"""Plans for the ten parameters of the paper, of which bounds are tight and errors fall with every
measurement."""


@pytest.fixture(scope="module")
def cell(make_cell):
    return make_cell(pool=POOL)


@pytest.fixture(scope="module")
def of_ten(make_cell):
    return make_cell(pool=POOL, parameters=TEN)


@pytest.fixture(scope="module")
def planned(cell):
    return plan_optimal(cell, Request(count=9, refine=True, validation=4))


@pytest.fixture(scope="module")
def ten_planned(of_ten):
    return plan_optimal(of_ten, Request(count=9, refine=True, validation=4))


@pytest.fixture(scope="module")
def fewest(of_ten):
    return plan_optimal(of_ten, Request(count=None, accuracy_m=1e-4))


def error_left(cell, postures):
    """Error that an identification of a cell's arms leaves, by :class:`Expectation`."""
    arms, at = reference_of(cell), workplace_of(cell)
    C = arms.covariance(arms.blocks(arms.model.linearise(postures)))
    left = Expectation(arms.model, arms.model.nominal, C, at.postures, at.setup)
    return left.of(arms.model, arms.model.nominal)


@pytest.mark.parametrize("criterion", ["tcp", "tcp-worst", "D", "sigma:tool.z"])
def test_what_poses_promise_is_what_prediction_says_of_them(cell, criterion):
    model, pool = cell.model(), candidates_of(cell)
    box, _ = functions_over_work(cell, model)
    chosen = pool.take(np.arange(0, len(pool), 11))
    arms = PriorArms(model)
    objective = objective_of(Request(criterion=criterion), arms, box)
    found = accuracy_of(objective, arms, box, chosen.linearise(model))
    C = covariance_of(model, chosen.postures)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(C)), rtol=1e-6)
    at = workplace_of(cell)
    points = Expectation(model, model.nominal, C, at.postures, at.setup)
    spread = points.of(model, model.nominal).points_m ** 2
    assert found.tcp_m == pytest.approx(np.sqrt(spread.mean()), rel=1e-6)
    assert found.tcp_worst_m == pytest.approx(np.sqrt(spread.max()), rel=1e-6)
    sigma_z = 1e3 * np.sqrt(C[model.names.index("tool.z")] @ np.eye(model.p)[6])
    # D: of columns per mrad and mm, over the parameters of the robot alone
    robot = C[:4, :4]
    expected = {
        "tcp": 1e3 * found.tcp_m,
        "tcp-worst": 1e3 * found.tcp_worst_m,
        "D": np.linalg.det(1e6 * robot) ** -0.25,
        "sigma:tool.z": sigma_z,
    }
    assert found.value == pytest.approx(expected[criterion], rel=1e-6)


def test_the_outlook_of_any_poses_is_their_expected_error_beside_that_of_chosen_ones(cell):
    postures = candidates_of(cell).postures[::11]
    found = outlook_of(cell, postures)
    assert found.tcp_m == pytest.approx(error_left(cell, postures).rms_m, rel=1e-6)
    chosen = plan_optimal(cell, Request(count=len(postures), refine=False))
    # out of more candidates than this cell's pool has, and without regard to the way
    assert 0.7 * chosen.accuracy.tcp_m < found.chosen_tcp_m < 1.05 * chosen.accuracy.tcp_m


def test_a_proof_of_the_pool_is_not_said_of_poses_turned_off_it(ten_planned):
    value, of_pool = ten_planned.accuracy.value, ten_planned.of_pool.value
    assert value < ten_planned.selection.bound < of_pool
    before, _, proven = ten_planned.message.partition(
        "turned off the pool, which the proof does not"
    )
    assert f"tcp {value:.4g} mm" in before
    assert f"tcp {of_pool:.4g} mm, proven: no 9 poses of the pool are below tcp" in proven


def test_a_base_pose_that_cannot_be_taken_is_no_fault_of_the_task_box(make_demo_cell):
    slab = {"name": "slab", "size_mm": [600.0, 600.0, 100.0], "at_mm": [0.0, 0.0, 900.0]}
    with pytest.raises(UnreachableError, match=r"the base pose cannot be taken: .* slab"):
        plan_optimal(make_demo_cell(obstacle=[slab]), Request(count=9))


def test_where_the_base_pose_is_blocked_a_free_one_is_named(make_demo_cell):
    """A ball in the elbow: the arm turned a little about the target passes it, not flipped over."""
    demo = make_demo_cell()
    around = [body.model_dump(exclude_none=True) for body in demo.config.obstacle]
    elbow = (1e3 * demo.robot.state(demo.base_posture).origins[2]).tolist()
    around.append({"name": "ball", "kind": "sphere", "radius_mm": 30.0, "at_mm": elbow})
    with pytest.raises(UnreachableError, match="link_3 and ball run") as caught:
        check_base_pose(make_demo_cell(obstacle=around))
    named = re.search(r"free is posture_deg = \[(.*)\]", str(caught.value))
    posture_deg = [float(value) for value in named[1].split(", ")]
    assert np.abs(posture_deg - np.rad2deg(demo.base_posture)).max() < 45.0
    other = make_demo_cell(obstacle=around, base_pose={"posture_deg": posture_deg})
    check_base_pose(other)
    assert np.linalg.norm(other.target_m - demo.target_m) < 1e-3


def test_too_few_poses_promise_nothing(cell):
    model, pool = cell.model(), candidates_of(cell)
    box, _ = functions_over_work(cell, model)
    arms = PriorArms(model)
    few = pool.take([0, 1, 2]).linearise(model)
    found = accuracy_of(objective_of(Request(), arms, box), arms, box, few)
    assert np.isinf([*found.sigma, found.tcp_m, found.tcp_worst_m, found.value]).all()


def test_the_error_predicted_is_that_of_simulated_calibrations(of_ten, ten_planned):
    model, trials = ten_planned.model, 1000
    rng = np.random.default_rng(4)
    data = simulate(model, model.nominal, ten_planned.postures, rng, trials=trials)
    error = identify_batch(model, data) - model.nominal
    q = workplace_of(of_ten).postures
    true = of_ten.robot.state(q).point(of_ten.tool_m)
    squares = []
    for x in error:  # where the arm goes that is corrected by what each trial found
        offsets = np.zeros(6)
        offsets[1:5] = x[:4]
        moved = of_ten.robot.state(q + offsets).point(of_ten.tool_m + x[4:7])
        # its user frame is taught anew: the base goes where both agree best
        turn, _ = Rotation.align_vectors(true - true.mean(axis=0), moved - moved.mean(axis=0))
        off = turn.apply(moved - moved.mean(axis=0)) - (true - true.mean(axis=0))
        squares.append((off**2).sum(axis=1).mean())
    ratio = np.sqrt(np.mean(squares)) / ten_planned.accuracy.tcp_m
    # one parameter may carry all of it: then the squares are of as many normal variates as trials
    assert ratio == pytest.approx(1.0, abs=FIVE_SIGMA / np.sqrt(2 * trials))


def test_refinement_is_better_than_the_pool_and_the_proof_is_of_the_pool(cell, planned):
    assert planned.is_refined
    assert planned.accuracy.tcp_m < planned.of_pool.tcp_m
    assert planned.selection.bound <= planned.selection.value
    at = planned.postures
    assert cell.checker.check(at).feasible.all()
    assert off_target(cell, planned.poses.names, at, 1e-9) == []
    found = error_left(cell, at)
    assert planned.accuracy.tcp_m == pytest.approx(found.rms_m, rel=1e-6)
    assert planned.accuracy.tcp_worst_m == pytest.approx(found.worst_m, rel=1e-6)
    assert [other.poses for other in planned.others] == [8, 10]
    for other in planned.others:
        assert (other.tcp_m > planned.of_pool.tcp_m) == (other.poses < 9)


def test_validation_poses_are_others_that_can_be_taken(cell, planned):
    q = planned.validation.kept
    assert len(q) == 4
    assert planned.validation.names == ("V01", "V02", "V03", "V04")
    apart = np.abs(q[:, None] - planned.postures).max(axis=2)
    assert apart.min() > 1e-3
    assert cell.checker.check(q).feasible.all()
    assert off_target(cell, planned.validation.names, q, 1e-9) == []
    assert sorted(planned.validation_route.order) == [0, 1, 2, 3]


@pytest.mark.parametrize("ten", [False, True])
def test_validation_poses_would_tell_more_than_any(cell, planned, of_ten, ten_planned, ten):
    """Than poses drawn from the pool, of how good the plan is where the arm will work.

    Of ten parameters all by themselves; of all that may be off, after a hundredth of the plan.
    """
    measured, plan = (of_ten, ten_planned) if ten else (cell, planned)
    pool, arms = candidates_of(measured), reference_of(measured)
    functions, _ = functions_over_work(measured, arms.model)
    L, known = functions.reshape(-1, arms.model.p), arms.known_rows
    G = arms.blocks(arms.model.linearise(plan.poses.kept)).reshape(-1, arms.model.p)
    before = known.T @ known + (0.0 if ten else 0.01) * G.T @ G

    def told(q):
        J = arms.blocks(arms.model.linearise(q)).reshape(-1, arms.model.p)
        return np.trace(L @ np.linalg.solve(before + J.T @ J, L.T))

    rng = np.random.default_rng(1)
    drawn = [told(pool.postures[rng.choice(len(pool), 4, replace=False)]) for _ in range(20)]
    assert told(plan.validation.kept) < np.median(drawn)


def test_auto_takes_the_fewest_and_proves_it(of_ten, fewest):
    assert fewest.reached
    count = fewest.selection.count
    assert error_left(of_ten, fewest.postures).worst_m <= 1e-4 * (1 + 1e-6)
    # no exchange from anywhere finds one fewer
    pool, objective = candidates_of(of_ten), fewest.objective
    blocks = Candidates(objective.blocks(pool.linearise(fewest.model)))
    cost = objective.criterion.on(blocks)
    rng = np.random.default_rng(5)
    for _ in range(3):
        start = np.sort(rng.choice(blocks.N, count - 1, replace=False))
        rows = exchange(cost, start, np.empty(0, dtype=np.intp))
        assert objective.criterion.shown(cost.cost(rows)) > 0.1
    assert f"{count} poses reach tcp-worst" in fewest.message
    assert "0.1 mm is wanted" in fewest.message
    assert "proven: fewer" in fewest.message
    assert fewest.fewest.at_least <= count


def test_what_is_out_of_reach_says_how_often_all_would_have_to_be_measured(of_ten):
    found = plan_optimal(of_ten, Request(count=None, accuracy_m=1e-6))
    assert not found.reached
    assert found.route is None
    every = candidates_of(of_ten)
    best = error_left(of_ten, every.postures).worst_m
    times = int(np.ceil((best / 1e-6) ** 2))
    assert f"all {len(every)} poses of the pool give tcp-worst {1e3 * best:.4g} mm" in found.message
    assert f"each would have to be measured {times} times" in found.message


def test_the_parameter_that_decides_is_named(cell):
    found = plan_optimal(cell, Request(count=12, sigma_m=1.5e-4))
    sigma = np.sqrt(np.diag(covariance_of(found.model, found.postures)))
    lengths = [k for k, unit in enumerate(found.model.units) if unit == "m"]
    worst = max(lengths, key=lambda k: sigma[k])
    assert found.decides == found.model.names[worst]
    assert f"{sigma[worst] / 1.5e-4:.4g} times the deviation wanted" in found.message
    assert f"({found.decides} decides)" in found.message


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (Request(count=27, criterion="C_G", threshold=850.0), "no set of 27 poses .* below 850"),
        (Request(count=27, threshold=0.01), "no set of 27 poses .* below 0.01: tcp"),
        (Request(count=9, criterion="D", threshold=1e9), r"no set of 9 poses .* above 1e\+09"),
        (Request(count=12, sigma_m=1e-5), "no 12 poses .* deviations wanted: .* times them"),
        (Request(count=1), "1 poses give 3 equations for 6 parameters .*2 poses or more"),
        (Request(count=1, criterion="C_G"), "1 poses give 3 equations"),
        (Request(count=9, validation=900), "9 poses and 900 for validation"),
        (Request(count=900), "900 poses of"),
        (Request(method="guess"), "no method 'guess'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_this_pool_cannot_give_is_refused(cell, monkeypatch, asked, words):
    monkeypatch.setattr(Router, "route", None)  # before any way is looked for
    with pytest.raises(InputError) as refused:
        plan_optimal(cell, asked)
    assert "\n" not in str(refused.value)
    refused.match(words)


@pytest.fixture
def lose(monkeypatch):
    """Have no way lead to rows of postures that a rule names; returns all that it was asked for."""

    def by(rule, why="a wall"):
        route, asked = Router.route, []

        def losing(self, postures, loads=None):
            asked.append(postures)
            lost = list(rule(postures, len(asked)))
            found = route(self, np.delete(postures, lost, axis=0))
            return replace(found, lost=dict.fromkeys(lost, why))

        monkeypatch.setattr(Router, "route", losing)
        return asked

    return by


def test_too_few_equations_for_ten_parameters_are_refused(of_ten, monkeypatch):
    monkeypatch.setattr(Router, "route", None)
    words = "3 poses give 9 equations for 10 parameters .*4 poses or more"
    with pytest.raises(InputError, match=words):
        plan_optimal(of_ten, Request(count=3))


def test_what_no_way_leads_to_is_left_out(cell, lose):
    asked = lose(lambda q, _: np.flatnonzero(q[:, 3] > 2.5))
    found = plan_optimal(cell, Request(count=9))
    assert len(found.postures) == 9
    assert (found.postures[:, 3] <= 2.5).all()
    cut = [int((q[:, 3] > 2.5).sum()) for q in asked]
    assert cut[0] > 0
    assert cut[-1] == 0
    assert found.pool_size == len(candidates_of(cell)) - sum(cut)


@pytest.mark.slow
def test_an_arm_half_of_whose_postures_are_out_of_the_way(make_cell):
    """A UR10e folds its wrist into branches that no clear motion leads to: others take their place.

    Choice after choice was of such postures, until none was left of the attempts, nor of the poses.
    """
    raw = tomllib.loads(cell_template("ur10e"))
    raw["pool"]["candidates"] = 200
    raw["parameters"].update(TEN)
    cell = Cell.from_config(parse_config(raw, Path("cell.toml")), Path("cell.toml"))
    found = plan_optimal(cell, Request(count=12, refine=False))
    assert found.reached
    assert len(found.postures) == 12
    assert found.left_out > 50
    assert any("(no clear way to it: " in said for said in found.remarks)
    assert found.accuracy.value >= found.selection.bound
    stops = np.array([cell.base_posture, *(stop.posture for stop in found.route.stops)])
    assert cell.ways.check(stops[:-1], stops[1:]).clear.all()


def test_as_many_poses_are_chosen_as_can_be_reached(make_cell, tmp_path):
    """Eight of the pool, of twelve that are asked for: four are dropped, in the file, too."""
    cell = make_cell(pool=POOL)
    fourth = np.sort(np.abs(candidates_of(cell).postures[:, 3]))
    highest = 0.5 * (fourth[7] + fourth[8])
    cell.__dict__["ways"] = Blocked(
        lambda start, end: (np.abs(np.stack([start, end])[:, :, 3]) > highest).any(axis=0)
    )
    found = plan_optimal_poses(cell, tmp_path, Request(count=12, refine=False))
    assert not found.reached
    assert len(found.postures) == 8
    assert (np.abs(found.postures[:, 3]) <= highest).all()
    assert found.left_out == len(fourth) - 8
    assert found.dropped == ("no clear way to it: a wall",) * 4
    assert "8 poses, tcp" in found.message
    listed = read_poses(tmp_path / "poses.csv", 6)
    assert len(listed.measured.names) == 8
    assert [pose.reason for pose in listed.dropped] == list(found.dropped)


def test_what_was_to_be_kept_and_is_not_reached_is_dropped(cell, planned, lose):
    """Others make up for it, also among the poses for validation; nothing else is lost."""
    own = planned.poses.kept[:2]
    lose(lambda q, _: np.flatnonzero((q == own[1]).all(axis=1)))
    found = plan_optimal(cell, Request(count=9, refine=False), keep=own)
    assert not found.reached
    assert found.dropped == ("was to be kept: a wall",)
    assert len(found.postures) == 9
    assert (found.poses.kept == own[0]).all(axis=1).any()
    assert not (found.poses.kept == own[1]).all(axis=1).any()
    assert "1 pose(s) dropped: was to be kept: a wall" in found.message


def test_poses_for_validation_that_are_not_reached_cost_nothing_else(cell, lose):
    lose(lambda q, turn: [0] if turn > 1 and len(q) > 2 else [])
    found = plan_optimal(cell, Request(count=9, refine=False, validation=3))
    assert not found.reached
    assert len(found.postures) == 9
    assert len(found.validation.kept) == 2
    assert found.validation.names == ("V01", "V02", "V03")
    assert found.dropped == ("a wall",)


def test_poses_that_no_way_leads_to_are_not_refined_first(cell, lose, monkeypatch):
    chosen = candidates_of(cell).take([0, 1, 2])
    lose(lambda q, _: [2])
    monkeypatch.setattr(Router, "reached", lambda self, q: np.arange(len(q)) < 2)
    found, route = refined_with_way(Router.of_cell(cell), chosen, lambda _: pytest.fail("refined"))
    assert found is chosen
    assert list(route.lost) == [2]


def test_what_no_way_leads_to_goes_after_those_that_were_lost(make_cell):
    cell = make_cell(pool={"candidates": 40})
    pool, lost = candidates_of(cell), np.array([5, 7])
    router = Router.of_cell(cell)
    assert len(without_unreached(router, pool, lost, 0)) == len(pool) - 2
    reached = router.reached(pool.postures)
    reached[lost] = False
    left = without_unreached(router, pool, lost, 1, kept=7)
    reached[:7] = [True] * 5 + [False, True]
    np.testing.assert_array_equal(left.postures, pool.postures[reached])


TILT = np.deg2rad(40.0)


@pytest.fixture(scope="module")
def reference(make_cell):
    cell = make_cell()
    model = cell.model()
    pool = cone_candidates(cell, TILT, 40, np.random.default_rng(3))
    box, _ = functions_over_work(cell, model)
    return cell, model, pool, objective_of(Request(), PriorArms(model), box)


def test_parameters_without_priors_are_drawn_by_usual_sizes(reference):
    _, model, _, _ = reference
    drawn = draw_parameters(model, 4001, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn[0], model.nominal)
    spread = (drawn[1:] - model.nominal).std(axis=0)
    expected = [np.deg2rad(1.0) if unit == "rad" else 5e-3 for unit in model.units]
    # standard error of a standard deviation: 1 / sqrt(2 n); five of them
    np.testing.assert_allclose(spread, expected, rtol=5 / np.sqrt(8000))


def test_parameters_of_the_arm_that_is_fitted_are_drawn_by_their_priors(reference):
    model = reference_of(reference[0]).model
    drawn = draw_parameters(model, 4001, np.random.default_rng(0))
    held = np.isfinite(model.prior)
    spread = (drawn[1:] - model.nominal).std(axis=0)[held]
    assert held.sum() == model.p - 6  # all but tool and target
    np.testing.assert_allclose(spread, model.prior[held], rtol=5 / np.sqrt(8000))


def test_blocks_are_those_at_the_postures_that_touch(reference):
    _, model, pool, objective = reference
    drawn = draw_parameters(model, 3, np.random.default_rng(1))
    blocks = blocks_of_robots(model, objective, pool, drawn)
    assert blocks.shape == (3, len(pool), 3, model.p)
    np.testing.assert_allclose(blocks[0], pool.white(model), rtol=1e-9, atol=1e-6)
    q, miss = touch(model, pool.postures, drawn[2])
    assert miss.max() < 1e-9
    step = 1e-6
    for k in range(model.p):  # central differences of what such a robot would show
        shift = step * np.eye(model.p)[k]
        ahead = model.linearise(q, drawn[2] + shift).white_rows
        behind = model.linearise(q, drawn[2] - shift).white_rows
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(blocks[2][..., k], slope, rtol=1e-4, atol=1.0)


def test_what_is_said_of_other_robots_is_what_identification_finds_there(reference):
    """The predicted error over the box, against Monte Carlo on one such robot."""
    cell, model, pool, objective = reference
    chosen = pool.take(np.arange(0, len(pool), 3))
    x = draw_parameters(model, 2, np.random.default_rng(5))[1]
    predicted = objective.criterion.shown(
        objective.cost_of_blocks(blocks_of_robots(model, objective, chosen, x[None])[0])
    )
    trials, rng = 600, np.random.default_rng(6)

    data = simulate(model, x, chosen.postures, rng, trials=trials)
    found = identify_batch(model, data)
    box, _ = functions_over_work(cell, model)
    error = np.einsum("krp,tp->tkr", box, found - x)
    rms = np.sqrt((error**2).sum(axis=(1, 2)).mean() / len(box))
    # a few parameters carry most of the error: some 600 independent squares, five standard errors
    assert 1e3 * rms == pytest.approx(predicted, rel=5 / np.sqrt(2 * trials))  # in mm


@pytest.mark.parametrize("robust", ["average", pytest.param("worst", marks=pytest.mark.slow)])
def test_a_robust_plan_says_for_how_many_robots(make_cell, robust):
    cell = make_cell(pool={"candidates": 40}, parameters=TEN)
    plan = plan_optimal(cell, Request(count=6, robust=robust))
    assert plan.reached
    assert f"{robust} of 6 robots" in plan.message
    assert plan.selection.value >= plan.accuracy.value * 0.9
    assert plan.selection.efficiency > 0.9


def test_a_robust_plan_is_for_arms_drawn_from_the_priors(make_cell):
    """Its value is the mean square over six of them, each fitted with all that may be off."""
    cell = make_cell(pool={"candidates": 40})
    plan = plan_optimal(cell, Request(count=6, robust="average", beside=0))
    arms, q = reference_of(cell), plan.poses.kept
    model, known = arms.model, arms.known_rows
    functions, _ = functions_over_work(cell, model)
    L = functions.reshape(-1, model.p)
    squares = []
    for x in draw_parameters(model, 6, np.random.default_rng(6)):
        J = arms.blocks(model.linearise(touch(model, q, x[None])[0][0], x)).reshape(-1, model.p)
        C = np.linalg.inv(known.T @ known + J.T @ J)
        squares.append(np.trace(L @ C @ L.T) / len(functions))
    assert plan.selection.value == pytest.approx(1e3 * np.sqrt(np.mean(squares)), rel=1e-5)
    assert plan.selection.value > plan.selection.bound


WANTED_M = 2e-4


@pytest.fixture(scope="module")
def camera_cell(make_cell):
    return make_cell(
        measurement={"kind": "camera-pose"}, variations={"largest_deg": (45.0, 45.0, 45.0)}
    )


@pytest.fixture(scope="module")
def fewest_seen(camera_cell):
    return plan_fewest(camera_cell, WANTED_M)


def test_the_pool_is_all_grids_that_can_be_taken(camera_cell, fewest_seen):
    found = fewest_seen
    assert found.tried == 16 * 26 + 1  # the base pose is in every grid
    assert found.pool_size == found.tried
    base = camera_cell.robot.fk(camera_cell.base_posture)[:3, :3]
    turned = np.rad2deg(rotation_angle(base.T @ found.poses.orientations))
    assert turned.max() > 45.0
    kept = found.poses.kept
    assert off_target(camera_cell, found.poses.names, kept, 1e-9) == []
    assert camera_cell.checker.check(kept).feasible.all()
    assert sorted(found.route.order) == list(range(len(kept)))


def test_others_take_the_place_of_poses_that_no_way_leads_to(camera_cell, fewest_seen, lose):
    first = fewest_seen
    cut_off = first.poses.kept[0]
    lose(lambda q, _: np.flatnonzero((q == cut_off).all(axis=1)))
    second = plan_fewest(camera_cell, WANTED_M)
    assert second.reached
    assert second.pool_size == first.pool_size - 1
    assert not (second.poses.kept == cut_off).all(axis=1).any()


def test_the_rest_is_kept_where_no_way_leads_to_a_pose(camera_cell, lose, monkeypatch):
    """Whatever is chosen, its first is cut off: it is dropped, and what is left is planned."""
    tries = lose(lambda q, turn: [0] if turn <= 2 else [], "no clear way to it: a wall")
    monkeypatch.setattr(planning, "ATTEMPTS", 2)
    found = plan_fewest(camera_cell, WANTED_M)
    assert len(tries) == 3
    assert not found.reached
    assert found.dropped == ("no clear way to it: a wall",)
    count = found.selection.count - 1
    assert len(found.postures) == len(found.poses.kept_names) == found.accuracy.poses == count
    assert len(found.poses.names) == count + 1
    assert "1 pose(s) dropped: no clear way to it: a wall" in found.message


def test_without_any_way_it_says_what_is_in_it(camera_cell, lose, monkeypatch):
    lose(lambda q, _: range(len(q)))
    monkeypatch.setattr(planning, "ATTEMPTS", 2)
    with pytest.raises(InputError, match="a wall"):
        plan_fewest(camera_cell, 1e-3)


def test_something_has_to_be_wanted(camera_cell):
    with pytest.raises(InputError, match="no accuracy is wanted"):
        plan_fewest(camera_cell)


def test_what_would_buy_more_than_any_choice_is_said_with_what_it_buys(make_cell):
    """A second target high above the first: as a cell that has it promises, where both will work.

    Of the ten parameters, and of a tool that tilts little: of an arm whose lengths rest on their
    drawing neither that nor other postures would buy a fifth.
    """
    count, pool = 12, {"tilt_deg": 15.0}
    cell = make_cell(pool=pool, parameters=TEN)
    said = advice_for(cell, count).split("; ")
    assert any("over" in words or "configurations" in words for words in said)
    words = next(words for words in said if words.startswith("a second [[target]]"))
    height, side = re.match(r"a second \S+ (\d+) mm (above|below) this one: about", words).groups()
    target = cell.config.target
    x, y, z = (1e3 * cell.target_m).tolist()
    place = (x, y, z + float(height) * (1 if side == "above" else -1))
    other = target.model_copy(update={"name": "T2", "position_mm": place})
    config = cell.config.model_copy(update={"other_targets": (other,)})
    at = workplace_of(cell)

    def error(measured):
        found = plan_optimal(measured, Request(count=count, beside=0))
        model = found.model
        C = covariance_of(model, found.postures, setup=found.setup)
        left = Expectation(model, model.nominal, C, at.postures, at.setup)
        return left.of(model, model.nominal).rms_m

    told = float(re.search(r"([\d.]+) times less", words)[1])
    both, alone = error(replace(cell, config=config)), error(cell)
    assert told == pytest.approx(alone / both, rel=0.3)
    assert told > 1.25
    assert not advice_for(make_cell(pool=pool), count)
