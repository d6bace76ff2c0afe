"""The image Jacobian against differences of the projection, and what it tells of the camera."""

import numpy as np
import pytest

from calib.se3 import inverse, rotation_exp
from calib.vision.camera import circle_image
from calib.vision.touch_up import ImageJacobian
from calib.vision.touch_up.drive import shifted
from calib.vision.touch_up.jacobian import measure_jacobian


def by_differences(bench) -> np.ndarray:
    """Central differences of the relation's error by the tip's place ``(3, 3)``, without arms."""
    T = bench.robot.fk(bench.q)
    h, columns = 1e-5, []
    for axis in np.eye(3):
        seen = []
        for sign in (1.0, -1.0):
            T_camera = shifted(T, sign * h * axis) @ bench.true.T_tip_camera
            T_camera_target = inverse(T_camera) @ bench.true.T_base_target
            seen.append(circle_image(bench.camera, bench.target.diameter_m, T_camera_target))
        columns.append((bench.relation.error(seen[0]) - bench.relation.error(seen[1])) / (2 * h))
    return np.column_stack(columns)


@pytest.mark.parametrize("both_ways", [True, False])
@pytest.mark.parametrize("step_m", [2e-3, 20e-3])
def test_jacobian_is_that_of_the_projection(bench, step_m, both_ways):
    """At any length of the moves: the data are linear, so there is nothing to linearise."""
    found = measure_jacobian(bench.drive(), bench.q, bench.relation, step_m, both_ways=both_ways)
    expected = by_differences(bench)
    assert np.abs(found.jacobian.matrix - expected).max() < 1e-3 * np.abs(expected).max()


def test_arm_ends_where_it_began(bench):
    drive = bench.drive()
    measure_jacobian(drive, bench.q, bench.relation, 0.01)
    assert np.abs(drive.arms.joints(np.array([0])) - bench.q).max() < 1e-12


def test_camera_is_told(bench):
    """How it is turned, its focal length, distance and size of the target."""
    found = measure_jacobian(bench.drive(), bench.q, bench.relation, 0.01, both_ways=True).jacobian
    assert np.abs(found.R_tip_camera - bench.true.T_tip_camera[:3, :3]).max() < 1e-4
    assert found.distance_m == pytest.approx(0.35, rel=1e-3)
    assert found.focal_px == pytest.approx(bench.camera.focal_px, rel=1e-3)
    assert found.diameter_m == pytest.approx(bench.target.diameter_m, rel=1e-3)


def test_shift_takes_errors_away(bench):
    """Eq. 3; for a view line V and H only, by the smallest shift that does."""
    jacobian = ImageJacobian(by_differences(bench), bench.relation)
    error = np.array([[12.0, -7.0, 3.0], [1.0, 2.0, -0.5]])
    assert error + jacobian.shift(error) @ jacobian.matrix.T == pytest.approx(0.0, abs=1e-9)
    line = jacobian.shift(error, view_line=True)
    assert (error + line @ jacobian.matrix.T)[:, :2] == pytest.approx(0.0, abs=1e-9)
    assert line @ np.cross(*jacobian.matrix[:2]) == pytest.approx(0.0, abs=1e-6)


def test_update_keeps_what_was_not_moved(bench):
    """The secant of the move is met, and across it nothing changes."""
    jacobian = ImageJacobian(by_differences(bench), bench.relation)
    move, change = np.array([0.01, -0.02, 0.03]), np.array([5.0, 1.0, -9.0])
    updated = jacobian.updated(move, change)
    assert updated.matrix @ move == pytest.approx(change)
    across = np.linalg.svd(move[None])[2][1:].T
    assert updated.matrix @ across == pytest.approx(jacobian.matrix @ across)


def test_sound_jacobian_has_no_flaw(bench):
    assert ImageJacobian(by_differences(bench), bench.relation).flaw() == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda M, R: np.diag([1.0, -1.0, 1.0]) @ M, "mirrored"),
        (lambda M, R: M @ np.diag([1.0, 1.0, -1.0]), "wrong sign"),
        (lambda M, R: np.diag([1.0, 1.1, 1.0]) @ M, "squares"),
        (lambda M, R: M + 0.05 * np.outer([1.0, 0.0, 0.0], M[1]), "3 deg off right angles"),
        (lambda M, R: np.vstack([M[:2], M[2] @ rotation_exp(0.12 * R[:, 0]).T]), "right angles"),
        (lambda M, R: 0.0 * M, "does not follow"),
        (lambda M, R: M * [1.0, np.nan, 1.0], "does not follow"),
    ],
)
def test_what_no_camera_sees_is_a_flaw(bench, change, said):
    M = by_differences(bench)
    R = ImageJacobian(M, bench.relation).R_tip_camera
    assert said in ImageJacobian(change(M, R), bench.relation).flaw()


def test_picture_that_stands_still_is_told(make_bench):
    """From a hundred metres nothing moves in the picture, and nothing is made of that."""
    bench = make_bench()
    drive = bench.drive()
    still = drive.arms.look(np.array([0]))
    drive.arms.look = lambda which, near_px=None: still
    found = measure_jacobian(drive, bench.q, bench.relation, 0.01)
    assert found.jacobian is None
    assert found.status == "unmoved"
    assert "does not follow" in found.reason


def test_move_out_of_the_picture_is_told(bench):
    found = measure_jacobian(bench.drive(), bench.q, bench.relation, 0.2)
    assert found.jacobian is None
    assert found.status in ("lost", "no posture")
    assert found.reason
