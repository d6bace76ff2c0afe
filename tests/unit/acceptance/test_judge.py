"""Verdicts of acceptance tests, by arms whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import InputError
from calib.model import Setup
from calib.model.measurements import Measurements
from calib.se3 import rotation_exp, transform
from posedesign.acceptance.judge import best_frame, judge
from posedesign.acceptance.places import AcceptanceRequest, plan_acceptance
from posedesign.files.measurements import MeasurementTable
from tests.marks import by_stage


@pytest.fixture(scope="module")
def iso(found):
    """Postures of the five poses of ISO 9283, and their names."""
    plan = plan_acceptance(found.cell, AcceptanceRequest("iso"))
    return plan.poses.kept, plan.poses.kept_names


@pytest.fixture(scope="module")
def spread(found):
    """Postures of 29 places, and their names."""
    plan = plan_acceptance(found.cell, AcceptanceRequest("places", content=0.9))
    return plan.poses.kept, plan.poses.kept_names


def with_readings(table: MeasurementTable, off: np.ndarray) -> MeasurementTable:
    """The same with other readings: off by ``(N, 3)`` [m]."""
    observed = table.data.observed.copy()
    observed[:, :3] += off
    return replace(table, data=replace(table.data, observed=observed))


def test_the_true_arm_passes_and_the_one_as_described_does_not(found, iso):
    q, names = iso
    table = found.measured(np.tile(q, (30, 1)), names * 30)
    request = AcceptanceRequest("iso", limit_m=5e-5)
    verdict = judge(found.cell, table, request, planned=names, used=found.identified)
    before, after = verdict.judged
    assert verdict.passed()
    assert not verdict.passed(before)
    # the identified arm is the true one: AP is what the noise leaves, 0.02 / sqrt(30) an axis
    assert after.rms.value < 1e-5
    assert before.rms.value > 7 * after.rms.value
    assert set(after.poses) == set(names)
    assert {found.cycles for found in after.poses.values()} == {30}


@pytest.mark.parametrize("trials", by_stage(50, 250, 600))
def test_the_chance_to_pass_is_the_share_of_arms_that_pass(found, trials):
    """Arms drawn from the identification, each measured and judged: within 3.5 deviations."""
    known, cell = found.identified, found.cell
    request = AcceptanceRequest(limit_m=5.5e-5, content=0.8)
    plan = plan_acceptance(cell, request, used=known, known=known)
    assert 0.2 < plan.chance < 0.8
    q, names = plan.poses.kept, plan.poses.kept_names
    rng = np.random.default_rng(12)
    root = np.linalg.cholesky(known.covariance)
    table, passed = found.measured(q, names, seed=None), 0
    for _ in range(trials):
        x = known.x + root @ rng.standard_normal(known.model.p)
        read = known.model.predict(q, x) + 2e-5 * rng.standard_normal((len(q), 3))
        data = replace(table.data, observed=read)
        passed += judge(cell, replace(table, data=data), request, used=known).passed()
    slack = 3.5 * np.sqrt(plan.chance * (1 - plan.chance) / trials)
    assert passed / trials == pytest.approx(plan.chance, abs=slack + 0.01)


def test_repeatability_is_that_of_the_readings_whatever_the_arm(found, iso):
    """RP of scatter sigma along three axes: mean 1.596 and deviation .673 of chi_3, times sigma."""
    q, names = iso
    table = found.measured(np.tile(q, (200, 1)), names * 200)
    verdict = judge(found.cell, table, AcceptanceRequest("iso"), used=found.identified)
    for arm in verdict.judged:
        for pose in arm.poses.values():
            assert pose.repeatability.value == pytest.approx((1.596 + 3 * 0.673) * 2e-5, rel=0.12)


def test_distances_need_no_frame_and_are_those_between_places(found, iso):
    q, names = iso
    table = found.measured(q, names, seed=None)
    verdict = judge(found.cell, table, AcceptanceRequest("iso"), used=found.identified)
    before, after = verdict.judged
    p = found.cell.robot.state(q).point(found.cell.tool_m)
    assert before.distances["P02", "P04"].commanded_m == pytest.approx(np.linalg.norm(p[1] - p[3]))
    read = table.data.observed[:, :3]
    attained = np.linalg.norm(read[1] - read[3])
    AD = before.distances["P02", "P04"].accuracy.value
    assert pytest.approx(attained - np.linalg.norm(p[1] - p[3])) == AD
    assert len(before.distances) == 10
    assert max(abs(d.accuracy.value) for d in after.distances.values()) < 1e-9


def test_a_moved_instrument_changes_nothing_where_its_frame_is_fitted(found, spread):
    q, names = spread
    table = found.measured(q, names)
    moved = transform(rotation_exp(np.array([0.3, -0.2, 1.0])), np.array([1.0, 2.0, -0.5]))
    read = table.data.observed[:, :3]
    other = with_readings(table, read @ moved[:3, :3].T + moved[:3, 3] - read)
    request = AcceptanceRequest("places", content=0.9)
    one, two = (judge(found.cell, t, request, used=found.identified) for t in (table, other))
    assert one.final.places == pytest.approx(two.final.places, abs=1e-12)
    assert one.final.beyond == 0
    given = judge(found.cell, other, request, used=found.identified, given_frame=True)
    assert given.final.beyond == len(names)


def test_each_place_is_judged_in_the_frame_that_the_others_give(found, spread):
    """One reading off by a millimetre: all of it shows, and not what a fit to it would leave."""
    q, names = spread
    table = found.measured(q, names, seed=None)
    off = np.zeros((len(q), 3))
    off[7] = [0.0, 0.0, 1e-3]
    request = AcceptanceRequest("places", content=0.9)
    verdict = judge(found.cell, with_readings(table, off), request, used=found.identified)
    assert verdict.final.places[7] == pytest.approx(1e-3, rel=1e-9)
    assert np.linalg.norm(verdict.final.errors[7]) < 0.97e-3
    assert verdict.final.beyond == 1
    assert not verdict.passed()
    allowed = AcceptanceRequest("places", content=0.8, allowed=1)
    again = judge(found.cell, with_readings(table, off), allowed, used=found.identified)
    assert again.passed()
    assert again.proven() == pytest.approx(0.8466, abs=1e-3)


def test_poses_that_were_not_measured_count_as_beyond(found, spread):
    q, names = spread
    table = found.measured(q[:-2], names[:-2])
    verdict = judge(
        found.cell, table, AcceptanceRequest(content=0.9), planned=names, used=found.identified
    )
    assert verdict.missing == names[-2:]
    assert verdict.final.beyond == 2
    assert not verdict.passed()


def test_fewer_places_than_the_proof_takes_do_not_pass(found, spread):
    q, names = spread
    table = found.measured(q, names)
    assert not judge(found.cell, table, AcceptanceRequest(), used=found.identified).passed()  # 59


def test_touched_targets_of_a_plate_are_held_against_their_places(found):
    """Touch-ups of one target, scattered by a known amount: the distances from their mean."""
    cell, n = found.cell, 8
    rng = np.random.default_rng(1)
    q = cell.base_posture + rng.uniform(-0.1, 0.1, (n, 6))
    data = Measurements(q, Setup.of(n), ("pin",), names=tuple(f"P{i}" for i in range(n)))
    table = MeasurementTable(data, ("touch-up",), tuple(range(n)))
    verdict = judge(cell, table, AcceptanceRequest(content=0.5))
    p = cell.robot.state(q).point(cell.tool_m)
    mean_of_others = (p.sum(axis=0) - p) / (n - 1)
    assert verdict.final.places == pytest.approx(np.linalg.norm(p - mean_of_others, axis=1))
    assert not verdict.final.distances


def test_frames_are_refused_where_places_do_not_tell_them():
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    for places in (line, line[[0, 1]], np.array([[0, 0, 0], [1, 0, 0], [0, 1e-5, 0.0]])):
        with pytest.raises(InputError, match="do not tell how the instrument is turned"):
            best_frame(places, places)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: replace(t, kinds=("view-line",)), "a view-line does not tell where the tool is"),
        (lambda t: replace(t, data=replace(t.data, tools=("nose",))), "there is no tool 'nose'"),
        (
            lambda t: replace(t, data=replace(t.data, names=("Q1",) * t.data.count)),
            "Q1 is no pose of the test",
        ),
    ],
)
def test_measurements_that_are_no_test_are_refused(found, spread, change, said):
    q, names = spread
    with pytest.raises(InputError, match=said):
        judge(
            found.cell,
            change(found.measured(q, names)),
            AcceptanceRequest(),
            planned=names,
            used=found.identified,
        )
