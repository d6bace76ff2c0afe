"""What joints lose: against a play operator written out, and what the approach does about it."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.model.parameters import Payload
from calib.vision.touch_up import Loop, SimulatedArms, touch_up
from calib.vision.touch_up.arms import LostMotion
from calib.vision.touch_up.jacobian import measure_jacobian

ONE = np.zeros(1, dtype=np.intp)


def played(motors: np.ndarray, least: float, most: float) -> np.ndarray:
    """Joint of a play operator: dragged along where the motor leaves the band of lags."""
    joint, out = motors[0], []
    for motor in motors:
        if joint - motor > most:
            joint = motor + most
        if joint - motor < least:
            joint = motor + least
        out.append(joint)
    return np.array(out)


def joints_of(bench, lost: LostMotion, ways: np.ndarray, payload=None) -> np.ndarray:
    """True joints ``(K, n)`` of an arm on its way."""
    true = bench.true.__class__(
        bench.true.model,
        bench.true.values,
        bench.true.T_tip_camera,
        bench.true.T_base_target,
        lost,
        payload,
    )
    observer = bench.arms()._observer
    arms = SimulatedArms(true, observer, 1, np.random.default_rng(0), ways[0])
    out = []
    for q in ways:
        arms.move(ONE, q[None])
        out.append((arms._motors + arms._lag)[0])
    return np.array(out)


def test_joints_follow_a_play_operator(bench):
    """Back and forth, friction winding the reducer up on both sides of the play."""
    n = bench.robot.n
    lost = LostMotion.of(n, backlash_rad=2e-3, friction_nm=5.0, stiffness_nm_per_rad=1e4)
    rng = np.random.default_rng(4)
    ways = bench.q + np.cumsum(rng.uniform(-2e-3, 2e-3, (60, n)), axis=0)
    found = joints_of(bench, lost, ways)
    band = 2e-3 / 2 + 5.0 / 1e4
    for j in range(n):
        assert found[:, j] == pytest.approx(played(ways[:, j], -band, band), abs=1e-15)


def test_gravity_lays_joints_on_a_side(bench):
    """Whatever the way, a joint that carries more than its friction lies on the lower side."""
    n = bench.robot.n
    lost = LostMotion.of(n, backlash_rad=2e-3)
    payload = Payload(20.0, np.array([0.2, 0.0, 0.05]))
    rng = np.random.default_rng(4)
    ways = bench.q + rng.uniform(-2e-3, 2e-3, (20, n))
    lag = joints_of(bench, lost, ways, payload) - ways
    loaded = lag[:, [1, 2, 4]]  # shoulder, elbow and wrist carry the load
    assert np.abs(loaded) == pytest.approx(1e-3)
    assert (np.ptp(loaded, axis=0) < 1e-12).all()


def test_upright_axis_leans_to_no_side(bench):
    """Its torque is rounding, whose sign is by chance: it must not throw the joint about."""
    n = bench.robot.n
    lost = LostMotion.of(n, backlash_rad=2e-3)
    payload = Payload(20.0, np.array([0.2, 0.0, 0.05]))
    ways = np.tile(bench.q, (30, 1))
    ways[:, 0] += np.linspace(0.0, 1.0, 30)
    lag = joints_of(bench, lost, ways, payload)[:, 0] - ways[:, 0]
    assert lag[1:] == pytest.approx(-1e-3, abs=1e-12), "dragged behind the motor, all the way"


def test_no_loss_without_any(bench):
    ways = bench.q + np.random.default_rng(0).uniform(-0.1, 0.1, (5, bench.robot.n))
    assert np.array_equal(joints_of(bench, LostMotion.of(bench.robot.n), ways), ways)


@pytest.mark.parametrize("wrong", [[1.0, 2.0], -1.0, np.nan])
def test_lost_motion_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(InputError, match="lost motion"):
        LostMotion.of(6, backlash_rad=wrong)


def test_approach_takes_up_what_joints_lose(make_bench):
    """Touch-ups come to from different sides: the backlash scatters them, the approach does not."""
    lost = LostMotion.of(6, backlash_rad=3e-4)
    bench = make_bench(lost_motion=lost)
    jacobian = measure_jacobian(
        make_bench().drive(), bench.q, bench.relation, 0.01, both_ways=True
    ).jacobian
    rng = np.random.default_rng(6)
    scatter = {}
    for approach in (0.0, 3e-3):
        arms = bench.arms(40)
        # each arm comes from elsewhere
        arms.move(np.arange(40), bench.q + rng.uniform(-0.05, 0.05, (40, 6)))
        start = bench.q + rng.uniform(-2e-3, 2e-3, (40, 6))
        done = touch_up(bench.drive(arms, approach), start, jacobian, Loop(1.0, 0.5, 20))
        assert done.touched.sum() > 30
        T = bench.robot.fk(done.q[done.touched])
        pin = bench.true.T_tip_camera @ [0.0, 0.0, 0.35, 1.0]
        scatter[approach] = (T @ pin)[:, :3].std(axis=0).max()
    assert scatter[0.0] > 1.5e-4
    assert scatter[3e-3] < 0.5 * scatter[0.0]
