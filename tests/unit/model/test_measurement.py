"""Measurements: what they see, that whitened noise is white, and what they refuse."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.errors import ConvergenceError, InputError
from calib.model import Setup, simulate, touch
from calib.model.measurements import (
    KINDS,
    Distance,
    Measurements,
    PlaneContact,
    Pose,
    TouchUp,
    ViewLine,
    touch_ups,
)
from calib.model.parameters import (
    Payload,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import rotation_exp, rotation_from_wpr, transform

SAMPLES = 3200
FIVE_SIGMA = 5 * np.sqrt(2 / SAMPLES)
"""Of the scatter of a variance estimated from that many samples."""

NOISE = {1: [4e-5], 2: [1e-5, 3e-5], 3: [1e-5, 2e-5, 8e-5], 6: [1e-5, 2e-5, 3e-5, 1e-4, 2e-4, 3e-4]}
TARGET = transform(rotation_exp([0.4, -0.3, 0.7]), [1.7, 0.1, 0.4])
TOOL = transform(rotation_exp([0.1, 0.6, -0.2]), [0.2, -0.05, 0.35])


def of_kind(robot, kind, joints=()) -> CalibrationModel:
    """A tool whose axes are not those of the tip, a target whose axes are not those of the base."""
    blocks = [ZeroOffsets(robot, joints), ToolFrame(TOOL, free=()), TargetFrame(TARGET, free=())]
    return CalibrationModel(robot, blocks, kind)


@pytest.mark.parametrize("name", KINDS)
def test_whitened_noise_has_unit_covariance(reference_robot, touching, name):
    """Of simulated measurements, in axes that turn with the tool and differ from the target's."""
    kind = KINDS[name](NOISE[KINDS[name].rows])
    model, q = of_kind(reference_robot, kind), touching(4)
    data = simulate(model, model.nominal, q, np.random.default_rng(1), trials=SAMPLES // 4)
    rows = model.linearise(data.postures, observed=data.observed).white_rows
    assert rows.shape == (SAMPLES // 4, 4, kind.rows)
    rows = rows.reshape(SAMPLES, kind.rows)
    covariance = rows.T @ rows / SAMPLES
    np.testing.assert_allclose(covariance, np.eye(kind.rows), atol=FIVE_SIGMA)
    np.testing.assert_allclose(rows.mean(axis=0), 0.0, atol=5 / np.sqrt(SAMPLES))


def test_noise_lies_along_the_axes_of_the_camera(reference_robot, touching):
    """Depth is along the tool's z, wherever that points."""
    q = np.repeat(touching(1), SAMPLES, axis=0)

    def stopped(kind) -> np.ndarray:
        model = of_kind(reference_robot, kind)
        data = simulate(model, model.nominal, q, np.random.default_rng(2))
        T = reference_robot.fk(data.postures) @ TOOL
        return ((T[:, :3, 3] - TARGET[:3, 3])[:, None] @ T[:, :3, :3])[:, 0]

    noise = stopped(TouchUp([1e-5, 2e-5, 8e-5]))
    np.testing.assert_allclose(noise.std(axis=0), [1e-5, 2e-5, 8e-5], rtol=FIVE_SIGMA)
    across = stopped(ViewLine([1e-5, 3e-5]))
    np.testing.assert_allclose(across[:, :2].std(axis=0), [1e-5, 3e-5], rtol=FIVE_SIGMA)
    np.testing.assert_allclose(across[:, 2], 0.0, atol=1e-11)
    on_plane = stopped(PlaneContact(4e-5))
    T = reference_robot.fk(q[:1]) @ TOOL
    normal = T[0, :3, :3].T @ TARGET[:3, 2]  # the posture hardly moves
    np.testing.assert_allclose((on_plane @ normal).std(), 4e-5, rtol=FIVE_SIGMA)


def test_noise_is_drawn_anew_for_each_trial_and_posture(make_model, touching):
    model, q = make_model(measurement=TouchUp(1e-5)), touching(4)
    data = simulate(model, model.nominal, q, np.random.default_rng(4), trials=5)
    noise = model.predict(data.postures)
    assert noise.shape == (5, 4, 3)
    assert len(np.unique(noise)) == 60
    again = simulate(model, model.nominal, q, np.random.default_rng(4), trials=3)
    np.testing.assert_array_equal(again.postures, data.postures[:3])


def test_a_view_line_does_not_see_along_itself(reference_robot, touching):
    q = touching(10)
    R = (reference_robot.fk(q) @ TOOL)[:, :3, :3]
    points = (reference_robot.fk(q) @ TOOL)[:, :3, 3]
    for i in range(10):
        target = TARGET.copy()
        line, point = (
            CalibrationModel(
                reference_robot,
                [ToolFrame(TOOL, free=()), TargetFrame(target, free=["x", "y", "z"])],
                kind,
            )
            for kind in (ViewLine(1e-5), TouchUp(1e-5))
        )
        behind = points[i] - 0.3 * R[i, :, 2]
        beside = behind - R[i, :, 1]
        np.testing.assert_allclose(line.predict(q[i : i + 1], behind)[0], 0.0, atol=1e-15)
        np.testing.assert_allclose(line.predict(q[i : i + 1], beside)[0], [0, 1], atol=1e-15)
        np.testing.assert_allclose(
            point.predict(q[i : i + 1], behind)[0],
            TARGET[:3, :3].T @ (0.3 * R[i, :, 2]),
            atol=1e-15,
        )


def test_a_plane_sees_the_height_over_itself(reference_robot, touching):
    model, q = of_kind(reference_robot, PlaneContact(1e-5)), touching(5)
    points = (reference_robot.fk(q) @ TOOL)[:, :3, 3]
    height = (points - TARGET[:3, 3]) @ TARGET[:3, 2]
    assert np.abs(height).min() > 0.01
    np.testing.assert_allclose(model.predict(q)[:, 0], height, atol=1e-15)
    touched = simulate(model, model.nominal, q)
    assert touched.observed is None
    np.testing.assert_allclose(model.predict(touched.postures), 0.0, atol=1e-12)


def test_one_number_means_the_same_noise_in_every_axis():
    np.testing.assert_array_equal(TouchUp(2e-5).sigma, [2e-5] * 3)
    np.testing.assert_array_equal(ViewLine(2e-5).sigma, [2e-5] * 2)
    np.testing.assert_array_equal(Pose(2e-5).sigma, [2e-5] * 6)
    assert TouchUp([1e-5, 2e-5, 2e-5]).mean_sigma_m == pytest.approx(np.sqrt(3) * 1e-5)
    # angles are no lengths
    assert Pose([1e-5, 2e-5, 2e-5, 1, 1, 1]).mean_sigma_m == pytest.approx(np.sqrt(3) * 1e-5)


def test_noise_that_is_not_given_is_to_be_estimated():
    assert TouchUp(None).estimated
    assert not TouchUp(1e-5).estimated
    louder = Pose([1.0] * 6).with_noise([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
    np.testing.assert_array_equal(louder.sigma, [2, 2, 2, 3, 3, 3])
    assert TouchUp(None).with_noise(2.0).estimated


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TouchUp(0.0), "a noise of 0 mm cannot be used: it must be above zero"),
        (lambda: TouchUp([1e-5, -1e-5, 1e-5]), "a noise of -0.01 mm cannot be used"),
        (lambda: TouchUp(np.nan), "a noise of nan mm cannot be used"),
        (lambda: ViewLine([1e-5, np.inf]), "a noise of inf mm cannot be used"),
        (lambda: TouchUp([1e-5, 1e-5]), "the noise needs 3 numbers, 2 were given"),
        (lambda: ViewLine([1e-5] * 3), "the noise needs 2 numbers, 3 were given"),
        (lambda: Pose([1e-5] * 3), "the noise needs 6 numbers, 3 were given"),
        (lambda: Distance(-1.0), "a noise of -1000 mm cannot be used"),
    ],
)
def test_noise_that_cannot_be_used(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert caught.value.name == "noise"


@pytest.mark.parametrize(
    ("postures", "target", "message"),
    [
        (np.zeros((3, 6)), [0, 0], r"2 targets for postures of shape \(3, 6\)"),
        (np.zeros(6), [0], r"1 targets for postures of shape \(6,\)"),
        (np.full((1, 6), np.nan), [0], "a joint value is not a finite number"),
        (np.zeros((2, 6)), [0, 2], "a target index has no name"),
        (np.zeros((2, 6)), [0, -1], "2 measurements need 2 indices of the target, from 0 up"),
    ],
)
def test_touch_ups_are_checked(postures, target, message):
    with pytest.raises(InputError, match=message):
        touch_ups(postures, np.array(target), ("left", "right"))


def test_simulated_touch_ups_have_the_noise_of_the_measurement(make_model, touching):
    """Where the true arm stops is scattered about the target, in camera axes."""
    model, q = make_model(), touching(10)
    x = model.nominal.copy()
    x[:5] += [1e-3, -1e-3, 2e-3, 1e-3, 1e-3]
    data = simulate(model, x, q, np.random.default_rng(5), trials=400)
    assert data.postures.shape == (400, 10, 6)
    white = model.linearise(data.postures, x).white_rows.reshape(-1, 3)
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(3), atol=5 * np.sqrt(2 / 4000))


def test_simulation_without_noise_stands_on_the_target(make_model, touching):
    model, q = make_model(targets=2), touching(4)
    x, setup = model.nominal + 1e-3, Setup.of(4, target=[0, 1, 1, 0])
    data = simulate(model, x, q, setup=setup)
    np.testing.assert_allclose(model.predict(data.postures, x, setup), 0.0, atol=1e-12)
    assert data.targets == ("T1", "T2")
    many = simulate(model, x, q, setup=setup, trials=3)
    np.testing.assert_allclose(many.postures, np.broadcast_to(data.postures, (3, 4, 6)), atol=1e-11)


def test_simulation_says_which_pose_cannot_be_touched(make_model, touching):
    model, q = make_model(targets=2), touching(3)
    x = model.nominal.copy()
    x[-3:] = [9.0, 0.0, 0.0]
    with pytest.raises(
        ConvergenceError, match=r"pose 2: the simulated arm stays .* mm off"
    ) as caught:
        simulate(model, x, q, setup=Setup.of(3, target=[0, 1, 0]))
    assert caught.value.name == "pose 2"


def test_touch_says_how_far_an_arm_out_of_reach_stays(make_model, touching, target_m):
    model = make_model()
    x = model.nominal.copy()
    x[-3:] = target_m + np.array([3.0, 0.0, 0.0])
    q, missing = touch(model, touching(2), x)
    point = model.view(q, x).tool_points
    np.testing.assert_allclose(missing, np.linalg.norm(point - x[-3:], axis=-1), atol=1e-9)
    assert (missing > 0.5).all()


@pytest.mark.parametrize(("mass", "com"), [(-1.0, [0, 0, 0]), (np.nan, [0, 0, 0]), (5.0, [0, 0])])
def test_a_payload_that_cannot_be(mass, com):
    with pytest.raises(InputError, match="a payload needs"):
        Payload(mass, com)


READ = np.zeros((3, 6))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"observed": np.zeros((2, 3))},
            r"readings of shape \(2, 3\) for postures of shape \(3, 6\)",
        ),
        ({"observed": np.zeros(3)}, r"readings of shape \(3,\) for postures"),
        ({"observed": np.full((3, 3), np.nan)}, "a reading is not a finite number"),
        ({"observed": np.full((3, 3), np.inf)}, "a reading is not a finite number"),
        ({"names": ("P1", "P2")}, "2 names for 3 measurements"),
        ({"setup": Setup.of(3, tool=[0, 1, 0])}, "a tool index has no name"),
        ({"setup": Setup.of(3, target=[0, 1, 0])}, "a target index has no name"),
        ({"setup": Setup.of(2)}, r"2 targets for postures of shape \(3, 6\)"),
    ],
)
def test_measurements_are_checked(change, message):
    with pytest.raises(InputError, match=message) as caught:
        Measurements(**{"postures": READ, "setup": Setup.of(3), **change})
    assert "\n" not in str(caught.value)


def test_measurements_can_be_taken_apart():
    observed = np.arange(12.0).reshape(4, 3)
    q = np.arange(24.0).reshape(4, 6)
    setup = Setup.of(4, target=[0, 1, 0, 1])
    data = Measurements(q, setup, ("a", "b"), observed=observed, names=("P", "P", "Q", "Q"))
    np.testing.assert_array_equal(data.pose, [0, 0, 1, 1])
    some = data[np.array([3, 0])]
    np.testing.assert_array_equal(some.postures, q[[3, 0]])
    np.testing.assert_array_equal(some.observed, observed[[3, 0]])
    np.testing.assert_array_equal(some.target, [1, 0])
    assert some.names == ("Q", "P")
    assert some.targets == ("a", "b")
    many = data.repeated(5)
    assert many.postures.shape == (5, 4, 6)
    assert many.observed.shape == (5, 4, 3)
    np.testing.assert_array_equal(many.trials(3).observed, observed)
    assert data.trials(None).postures.shape == (1, 4, 6)
    assert data.trials(None).observed.shape == (1, 4, 3)
    assert touch_ups(q).names == ("P01", "P02", "P03", "P04")


def test_kinds_are_simulated_together(reference_robot, touching):
    """Those that touch move the arm; those that are read stay where they are."""
    blocks = [
        ZeroOffsets(reference_robot, ["joint_2"]),
        ToolPoint([0.2, -0.05, 0.35]),
        TargetFrame(TARGET),
    ]
    model = CalibrationModel(reference_robot, blocks, [TouchUp(1e-5), Distance(1e-5)])
    q, setup = touching(6), Setup.of(6, kind=[0, 1, 1, 0, 1, 0])
    x = model.nominal + 1e-3
    data = simulate(model, x, q, setup=setup)
    read = setup.kind == 1
    np.testing.assert_array_equal(data.postures[read], q[read])
    assert (np.abs(data.postures[~read] - q[~read]).max(axis=1) > 1e-4).all()
    points = model.view(data.postures, x, setup).tool_points
    place = x[-6:-3]
    np.testing.assert_allclose(points[~read], np.broadcast_to(place, (3, 3)), atol=1e-12)
    np.testing.assert_allclose(
        data.observed[read, 0], np.linalg.norm(points[read] - place, axis=1), atol=1e-15
    )
    assert (data.observed[~read] == 0).all()
    residuals = model.linearise(data.postures, x, setup, data.observed).rows
    np.testing.assert_allclose(residuals, 0.0, atol=1e-12)


SIGMA = np.array([1e-5, 2e-5, 9e-5])
R_TIP_CAMERA = rotation_from_wpr(np.deg2rad([20.0, -35.0, 80.0]))
TRIALS = 4000


def model(measurement: TouchUp) -> CalibrationModel:
    robot = Robot.preset("r2000ic165f")
    q = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
    target = robot.state(q).point(np.array([0.2, -0.05, 0.35]))
    tool = ToolPoint([0.2, -0.05, 0.35])
    return CalibrationModel(
        robot, [ZeroOffsets(robot, ["joint_2"]), tool, TargetPoints([target])], measurement
    )


def test_simulated_noise_has_the_axes_of_the_camera():
    truth = model(TouchUp(SIGMA, R_TIP_CAMERA))
    q = np.deg2rad([[0.0, 15.0, -25.0, 0.0, -50.0, 0.0]])
    done = simulate(truth, truth.nominal, q, np.random.default_rng(1), trials=TRIALS).postures[:, 0]
    robot = truth.robot
    state = robot.state(done)
    off = state.point(np.array([0.2, -0.05, 0.35])) - robot.state(q[0]).point(
        np.array([0.2, -0.05, 0.35])
    )
    in_camera = off @ state.R_base_tip[0] @ R_TIP_CAMERA
    # the standard deviation of a standard deviation is 1 / sqrt(2 trials); four of them
    np.testing.assert_allclose(in_camera.std(axis=0), SIGMA, rtol=4 / np.sqrt(2 * TRIALS))
    assert np.abs(np.corrcoef(in_camera.T) - np.eye(3)).max() < 4 / np.sqrt(TRIALS)


def test_whitening_is_that_of_the_covariance():
    """White Jacobians give JᵀC⁻¹J with the covariance turned into base axes, where it touches."""
    given = model(TouchUp(SIGMA, R_TIP_CAMERA))
    q = np.deg2rad([[10.0, 15.0, -25.0, 20.0, -50.0, 30.0], [-5.0, 20.0, -30.0, -20.0, -40.0, 0.0]])
    q = simulate(given, given.nominal, q).postures
    linear = given.linearise(q)
    R = given.robot.fk(q)[:, :3, :3] @ R_TIP_CAMERA
    C = R @ np.diag(SIGMA**2) @ np.swapaxes(R, 1, 2)
    J, white = linear.jacobian, linear.white_jacobian
    expected = np.einsum("kip,kij,kjr->kpr", J, np.linalg.inv(C), J)
    got = np.einsum("kip,kir->kpr", white, white)
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def test_axes_that_are_no_rotation():
    with pytest.raises(InputError, match="axes"):
        TouchUp(SIGMA, np.diag([1.0, 1.0, -1.0]))
