"""The loop of visual touch-up: one move does where nothing is off; every end has its reason."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import InputError
from calib.se3 import inverse
from calib.vision.camera import MeasurementNoise
from calib.vision.touch_up import Drive, ImageJacobian, Loop, follow, touch_up
from calib.vision.touch_up.drive import shifted
from calib.vision.touch_up.jacobian import measure_jacobian

ONE = np.zeros(1, dtype=np.intp)


def beside(bench, shift_m) -> np.ndarray:
    """The posture ``(n,)`` a shift ``(..., 3)`` of the tip from the base posture."""
    T = shifted(bench.robot.fk(bench.q), np.atleast_2d(shift_m))
    q, found = follow(bench.robot, np.tile(bench.q, (len(T), 1)), T)
    assert found.all()
    return q


def true_place(bench, q) -> np.ndarray:
    """Target before the lens at a posture, without errors ``(3,)``."""
    T = inverse(bench.robot.fk(q) @ bench.true.T_tip_camera) @ bench.true.T_base_target
    return T[:3, 3]


@pytest.mark.parametrize("way", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.5, -0.6)])
def test_one_move_from_30_mm_off(bench, jacobian, way):
    """Eq. 3 with data that are linear in the place of the target."""
    loop = Loop(center_px=0.5, size_px=0.2)
    done = touch_up(bench.drive(), beside(bench, 0.03 * np.array(way)), jacobian, loop)
    assert done.touched.all()
    assert done.moves[0] == 1
    assert np.abs(true_place(bench, done.q[0]) - [0, 0, 0.35]).max() < 1e-3


def test_view_line_leaves_the_distance(bench, jacobian):
    R = bench.true.T_tip_camera[:3, :3]
    q = beside(bench, R @ [0.01, -0.015, 0.03])
    before = true_place(bench, q[0])[2]
    done = touch_up(bench.drive(), q, jacobian, Loop(view_line=True))
    after = true_place(bench, done.q[0])
    assert done.touched.all()
    assert np.abs(after[:2]).max() < 1e-4
    assert after[2] == pytest.approx(before, abs=1e-4)
    assert abs(before - 0.35) > 0.02


def test_batch_is_the_same_as_one_at_a_time(make_bench):
    """With offsets and without noise: arms do not know of each other."""
    bench = make_bench(offsets_deg=0.2)
    jacobian = measure_jacobian(bench.drive(), bench.q, bench.relation, 0.01).jacobian
    rng = np.random.default_rng(2)
    q = beside(bench, rng.uniform(-0.02, 0.02, (7, 3)))
    together = touch_up(bench.drive(bench.arms(7), 0.003), q, jacobian, Loop())
    for k in range(7):
        alone = touch_up(bench.drive(bench.arms(1), 0.003), q[k : k + 1], jacobian, Loop())
        assert np.abs(together.q[k] - alone.q[0]).max() < 1e-12
        assert together.moves[k] == alone.moves[0]


def test_target_outside_the_picture_is_lost(bench, jacobian):
    done = touch_up(bench.drive(), beside(bench, [0.15, 0.0, 0.0]), jacobian, Loop())
    assert done.status == ("lost",)
    assert "outside the image" in done.reasons[0] or "cut by the edge" in done.reasons[0]


def test_farthest_ends_the_loop(bench, jacobian):
    q = beside(bench, bench.true.T_tip_camera[:3, :3] @ [0.0, 0.0, -0.06])
    done = touch_up(bench.drive(), q, jacobian, Loop(farthest_m=0.05))
    assert done.status == ("too far",)
    assert "60 mm" in done.reasons[0]


def test_refused_posture_is_no_posture(bench, jacobian):
    fence = ["behind the fence"]
    drive = Drive(bench.robot, bench.arms(), 0.0, lambda start, end: fence * len(end))
    done = touch_up(drive, beside(bench, [0.01, 0.0, 0.0]), jacobian, Loop())
    assert done.status == ("no posture",)
    assert done.reasons == ("behind the fence",)
    assert np.array_equal(done.q[0], bench.q), "it stands where it stood"


def test_unreachable_shift_is_no_posture(make_bench, jacobian):
    """The target is 20 cm further, where the arm comes to a limit."""
    bench = make_bench()
    q = bench.q.copy()
    robot = replace(bench.robot, upper=q + 1e-3, lower=q - 1e-3)
    drive = Drive(robot, bench.arms(), 0.0)
    wrong = ImageJacobian(jacobian.matrix, replace(jacobian.relation, center_px=(100.0, 100.0)))
    done = touch_up(drive, q[None], wrong, Loop())
    assert done.status == ("no posture",)
    assert "limits or a singularity" in done.reasons[0]


def test_noise_above_the_threshold_does_not_converge(bench, jacobian):
    noisy = bench.arms(1, MeasurementNoise.from_sigma([5.0, 5.0, 5.0]))
    done = touch_up(bench.drive(noisy), bench.q[None], jacobian, Loop(1e-3, 1e-3, 3, 1.0))
    assert done.status == ("not converged",)
    assert done.moves[0] == 3
    assert "after 3 moves" in done.reasons[0]
    assert "px off" in done.reasons[0]


def test_picture_that_does_not_follow_is_lost(bench, jacobian):
    """One that is always one move old: told after the first move."""
    drive = bench.drive()
    q = beside(bench, [0.02, 0.01, 0.0])
    drive.to_posture(ONE, q)
    old = drive.arms.look(ONE)
    drive.arms.look = lambda which, near_px=None: old
    done = touch_up(drive, q, jacobian, Loop())
    assert done.status == ("lost",)
    assert done.moves[0] == 1
    assert "followed a move by 0.0 of" in done.reasons[0]


def test_first_picture_is_not_believed_alone(bench, jacobian):
    """The first may be one of the last touch-up, at which the target was as designated."""
    drive = bench.drive()
    touched = drive.arms.look(ONE)
    looks = [touched]
    look = drive.arms.look
    drive.arms.look = lambda which, near_px=None: looks.pop() if looks else look(which, near_px)
    done = touch_up(drive, beside(bench, [0.02, 0.01, 0.0]), jacobian, Loop())
    assert done.touched.all()
    assert done.moves[0] >= 1
    assert np.abs(true_place(bench, done.q[0])[:2]).max() < 1e-4


def test_mean_of_looks_is_taken(bench, jacobian):
    """Of 400 pictures the scatter of what is measured is a twentieth of that of one."""
    noise = MeasurementNoise.from_sigma([1.0, 1.0, 1.0])
    errors = {}
    for looks in (1, 400):
        loop = Loop(center_px=50.0, size_px=50.0, looks=looks)
        done = touch_up(
            bench.drive(bench.arms(60, noise)), np.tile(bench.q, (60, 1)), jacobian, loop
        )
        errors[looks] = done.error_px[:, :2].std()
    # standard deviation of 120 numbers: good to 7 %
    assert errors[1] / errors[400] == pytest.approx(20.0, rel=0.4)


@pytest.mark.parametrize(
    "wrong", [{"center_px": 0.0}, {"size_px": -1.0}, {"iterations": 0}, {"farthest_m": np.inf}]
)
def test_loop_that_cannot_end_is_refused(wrong):
    with pytest.raises(InputError, match="of the touch-up is"):
        Loop(**wrong)
