"""Camera and board from pictures: what is found, what is held, and what changes nothing."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.chance import chi2_quantile
from calib.errors import CalibError, InputError
from calib.hand_eye import Pictures, calibrate
from calib.lens import Lens
from calib.model.parameters import ZeroOffsets
from calib.robots import Robot
from calib.robots.flange_poses import posture_of_pose
from calib.se3 import rotation_exp, transform
from studies.board_scenes import (
    EXACT,
    FLANGE,
    LENS,
    SIGMA_PX,
    SIZE,
    STOPS_OFF,
    draw_scene,
    inner_corners,
    reached,
)

BOTH = pytest.mark.parametrize("carried", ["camera", "board"])
NOISE = {"sigma_px": SIGMA_PX, "arm_sigma": STOPS_OFF}
"""Where the noise is given an estimate is exact to its convergence."""

CONVERGED = 1e-3
"""Of a standard deviation: where two runs of the same estimate may end."""

CHANCE = 1e-6


@pytest.fixture(scope="module")
def seen():
    """A scene of each set-up, and pixels of an arm that stops off."""
    rng = np.random.default_rng(10)
    scenes = {carried: draw_scene(rng, 12, carried) for carried in ("camera", "board")}
    return {c: (scene, scene.seen(rng, arm=STOPS_OFF)) for c, scene in scenes.items()}


@pytest.fixture(scope="module")
def usual(seen):
    return {c: calibrate(scene.shown(pixels), **NOISE) for c, (scene, pixels) in seen.items()}


def sigma_of(result) -> np.ndarray:
    return np.concatenate([*result.sigma_of("X"), *result.sigma_of("Z")])


def apart(one, other) -> float:
    """Largest difference of two results over the standard deviation."""
    off = np.concatenate([(one.X - other.X)[:3].ravel(), (one.Z - other.Z)[:3].ravel()])
    return float(np.abs(off).max() / sigma_of(one).min())


def is_likely(error, covariance) -> bool:
    square = float(error @ np.linalg.solve(covariance, error))
    return square < chi2_quantile(1 - CHANCE, len(error))


@BOTH
def test_what_is_left_within_pictures_is_that_of_their_best_poses(carried, seen, usual):
    """OpenCV places the board in each picture alone, with the lens that was found."""
    (scene, pixels), result = seen[carried], usual[carried]
    K, distortion = result.lens.to_opencv()
    for own, within in zip(pixels, result.within_px, strict=True):
        _, turn, shift = cv2.solvePnP(scene.points, own - 0.5, K, distortion)
        turn, shift = cv2.solvePnPRefineLM(scene.points, own - 0.5, K, distortion, turn, shift)
        shown, _ = cv2.projectPoints(scene.points, turn, shift, K, distortion)
        np.testing.assert_allclose(within, shown[:, 0] - (own - 0.5), atol=0.02)
    largest = np.abs(result.within_px).max()
    assert largest < 6.0 * NOISE["sigma_px"]
    assert np.abs(result.residuals_px).max() > largest  # the arm's part is not in it


@BOTH
@pytest.mark.parametrize("arm", [EXACT, STOPS_OFF])
def test_camera_board_and_lens_are_found_within_what_is_said(carried, arm):
    rng = np.random.default_rng(20)
    scene = draw_scene(rng, 15, carried)
    result = calibrate(scene.shown(scene.seen(rng, arm=arm)))
    assert is_likely(scene.errors(result), result.estimate.covariance)
    assert result.warnings == ()
    assert result.is_ok
    assert result.used.all()
    assert result.sigma_px == pytest.approx(SIGMA_PX, rel=0.1)  # of 940 rows: 2.4 %
    assert 0.3 < result.distance_m < 0.7
    wanted = "T_flange_camera" if carried == "camera" else "T_base_camera"
    assert result.frames[0].name == wanted
    np.testing.assert_array_equal(result.frames[0].T, result.X if carried == "camera" else result.Z)
    assert result.headline.startswith(f"{wanted} from 15 of 15 pictures")
    rows = result.rows()
    assert [row["picture"] for row in rows] == list(result.names)
    assert {row["status"] for row in rows} == {"used"}


@pytest.mark.parametrize(
    "lens",
    [
        Lens("rational", *SIZE, (*LENS.values, 0.02, -0.01, 0.005)),
        Lens("fisheye", *SIZE, (900.0, 905.0, 965.0, 545.0, 0.02, -0.01, 0.004, -0.002)),
    ],
    ids=["rational", "fisheye"],
)
def test_other_lenses_are_found_by_what_they_show(lens):
    """Their terms hide behind each other, so rays are compared, not terms."""
    rng = np.random.default_rng(21)
    scene = draw_scene(rng, 20, lens=lens, points=inner_corners(12, 9, 0.03), far_m=(0.35, 0.5))
    result = calibrate(scene.shown(scene.seen(rng)), lens.name)
    pose = np.r_[0:12]
    assert is_likely(scene.errors(result)[pose], result.estimate.covariance[np.ix_(pose, pose)])
    x, y = np.meshgrid(np.linspace(300, 1620, 7), np.linspace(200, 880, 5))
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)
    off = result.lens.project(np.append(lens.rays(pixels), np.ones((35, 1)), axis=1)) - pixels
    # a shift of all pixels is a turn of the camera, too
    assert np.sqrt(np.mean((off - off.mean(axis=0)) ** 2)) < 1.5
    assert result.sigma_px == pytest.approx(SIGMA_PX, rel=0.1)


@pytest.mark.parametrize("name", ["pinhole", "rational", "fisheye"])
def test_lenses_of_long_focal_length_are_found_without_their_higher_terms(name):
    """30 deg wide: k3 does less than the noise, its standard deviation is in the hundreds."""
    rng = np.random.default_rng([22, len(name)])
    K = np.array([[4000.0, 0, 960], [0, 4000, 540], [0, 0, 1]])
    lens = Lens.from_opencv(name, SIZE, K, np.array([-0.2, 0.1]))
    scene = draw_scene(rng, 15, lens=lens, far_m=(1.0, 1.8))
    result = calibrate(scene.shown(scene.seen(rng, arm=STOPS_OFF)), name)
    assert result.warnings == ()
    pose = np.r_[0:12]
    assert is_likely(scene.errors(result)[pose], result.estimate.covariance[np.ix_(pose, pose)])


@BOTH
def test_the_order_of_the_pictures_changes_nothing(seen, usual, carried):
    scene, pixels = seen[carried]
    order = np.random.default_rng(0).permutation(len(pixels))
    names = tuple(f"file {i}" for i in order)
    postures = posture_of_pose(scene.flange[order])
    other = calibrate(scene.shown(pixels[order], postures=postures, names=names), **NOISE)
    assert apart(usual[carried], other) < CONVERGED
    assert other.names == names
    np.testing.assert_allclose(other.rms_px, usual[carried].rms_px[order], rtol=1e-4)


@BOTH
def test_the_order_of_the_points_changes_nothing(seen, usual, carried):
    scene, pixels = seen[carried]
    order = np.random.default_rng(1).permutation(len(scene.points))
    pictures = scene.shown(pixels[:, order], board=scene.points[order])
    assert apart(usual[carried], calibrate(pictures, **NOISE)) < CONVERGED


@BOTH
def test_another_world_frame_moves_what_stands_in_it_and_nothing_else(seen, usual, carried):
    scene, pixels = seen[carried]
    T = transform(rotation_exp(np.array([0.7, -1.9, 0.4])), np.array([3.0, -2.0, 1.0]))
    other = calibrate(scene.shown(pixels, postures=posture_of_pose(T @ scene.flange)), **NOISE)
    back = replace(other, Z=np.linalg.inv(T) @ other.Z)
    assert apart(usual[carried], back) < CONVERGED
    np.testing.assert_allclose(
        other.covariance_of("X"), usual[carried].covariance_of("X"), rtol=1e-3, atol=1e-16
    )


@BOTH
def test_another_flange_frame_moves_what_is_on_it_and_nothing_else(seen, carried):
    """The deviation of the arm is about its tip: without it there is no difference."""
    scene, _ = seen[carried]
    pixels = scene.seen(np.random.default_rng(2))
    noise = {"sigma_px": SIGMA_PX, "arm_sigma": EXACT}
    T = transform(rotation_exp(np.array([0.2, 0.5, -0.9])), np.array([0.1, -0.05, 0.2]))
    one = calibrate(scene.shown(pixels), **noise)
    other = calibrate(scene.shown(pixels, postures=posture_of_pose(scene.flange @ T)), **noise)
    back = replace(other, X=T @ other.X)
    assert apart(one, back) < CONVERGED


@BOTH
@pytest.mark.parametrize("factor", [0.2, 7.0])
def test_lengths_have_no_unit(seen, usual, carried, factor):
    """All of them larger by a factor: the same rotations, lens and pixels."""
    scene, pixels = seen[carried]
    flange = scene.flange.copy()
    flange[:, :3, 3] *= factor
    noise = NOISE | {"arm_sigma": (factor * STOPS_OFF[0], STOPS_OFF[1])}
    pictures = scene.shown(pixels, postures=posture_of_pose(flange), board=factor * scene.points)
    other = calibrate(pictures, **noise)
    X, Z = other.X.copy(), other.Z.copy()
    X[:3, 3] /= factor
    Z[:3, 3] /= factor
    assert apart(usual[carried], replace(other, X=X, Z=Z)) < CONVERGED
    np.testing.assert_allclose(other.lens.values, usual[carried].lens.values, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(other.rms_px, usual[carried].rms_px, rtol=1e-4)


@BOTH
def test_points_that_were_not_seen_count_as_if_there_were_none(seen, carried):
    scene, pixels = seen[carried]
    keep = np.arange(len(scene.points)) % 4 != 2
    hidden = calibrate(scene.shown(np.where(keep[:, None], pixels, np.nan)), **NOISE)
    without = calibrate(scene.shown(pixels[:, keep], board=scene.points[keep]), **NOISE)
    # the board's middle is where the deviation is told from the lens: it is of all points
    assert apart(hidden, without) < CONVERGED
    np.testing.assert_allclose(hidden.rms_px, without.rms_px, rtol=1e-4)
    np.testing.assert_allclose(hidden.estimate.sigma, without.estimate.sigma, rtol=1e-4)


@BOTH
def test_views_of_a_part_of_the_board_do(carried):
    """Of each picture another half of the points."""
    rng = np.random.default_rng(23)
    scene = draw_scene(rng, 15, carried)
    pixels = scene.seen(rng, arm=STOPS_OFF)
    middle = scene.points.mean(axis=0)
    for i, way in enumerate(rng.standard_normal((15, 2))):
        pixels[i, (scene.points - middle)[:, :2] @ way > 0] = np.nan
    result = calibrate(scene.shown(pixels))
    assert result.used.all()
    assert is_likely(scene.errors(result), result.estimate.covariance)


@BOTH
def test_a_lens_that_is_given_is_held(seen, carried):
    scene, pixels = seen[carried]
    result = calibrate(scene.shown(pixels), LENS)
    assert result.lens == LENS
    assert not result.lens_estimated
    assert result.estimate.values.size == 12
    assert result.warnings == ()
    assert is_likely(scene.errors(result), result.estimate.covariance)


@BOTH
def test_a_lens_that_is_given_may_be_estimated_again(seen, usual, carried):
    scene, pixels = seen[carried]
    near = LENS.with_values(np.array(LENS.values) * 1.01)
    result = calibrate(scene.shown(pixels), near, free_lens=True, **NOISE)
    assert result.lens_estimated
    assert apart(usual[carried], result) < 10 * CONVERGED  # the start is another


@BOTH
def test_pictures_without_posture_or_board_take_no_part(seen, usual, carried):
    scene, pixels = seen[carried]
    postures = posture_of_pose(scene.flange)
    blind = np.full((1, *pixels.shape[1:]), np.nan)
    few = np.where(np.arange(len(scene.points))[:, None] < 5, pixels[:1], np.nan)
    pictures = scene.shown(
        np.concatenate([blind, pixels, few, pixels[:1]]),
        postures=np.concatenate([postures[:1], postures, postures[:1], postures[:1] * np.nan]),
    )
    result = calibrate(pictures, **NOISE)
    wanted = ["no board", *["used"] * 12, "no board", "no posture"]
    assert list(result.status) == wanted
    assert (np.isfinite(result.rms_px) == result.used).all()
    assert (np.isfinite(result.left_out_px) == result.used).all()
    assert apart(usual[carried], result) < 10 * CONVERGED  # the lens starts elsewhere
    assert result.headline.split(" from ")[1].startswith("12 of 15 pictures")


@BOTH
def test_a_picture_that_contradicts_the_others_takes_no_part(seen, carried):
    scene, pixels = seen[carried]
    wrong = scene.flange.copy()
    wrong[4, :3, 3] += [0.01, 0.0, 0.0]
    result = calibrate(scene.shown(pixels, postures=posture_of_pose(wrong)))
    assert result.outliers == ("P05",)
    assert result.status[4] == "contradicts the others"
    assert result.warnings[0].startswith("left out, as they contradict the others: P05 ")
    assert result.is_ok
    assert np.isnan(result.left_out_px[4])
    assert result.rms_px[4] > 3 * np.delete(result.rms_px, 4).max()
    assert is_likely(scene.errors(result), result.estimate.covariance)


@BOTH
def test_a_picture_whose_points_lie_in_wrong_places_takes_no_part(seen, carried):
    scene, pixels = seen[carried]
    blurred = pixels.copy()
    blurred[7] += np.random.default_rng(3).normal(0, 2.0, pixels[7].shape)
    result = calibrate(scene.shown(blurred))
    assert result.outliers == ("P08",)
    assert result.scatter_px[7] > 3 * result.sigma_px
    assert is_likely(scene.errors(result), result.estimate.covariance)


@BOTH
def test_zero_offsets_of_the_robot_are_found_with_camera_and_board(carried):
    rng, robot = np.random.default_rng(24), Robot.preset("ur10e")
    scene, q = reached(robot, draw_scene(rng, 40, carried), 25)
    true = np.deg2rad([0.2, -0.3, 0.15, 0.25])
    shown = q - np.concatenate([[0.0], true, [0.0]])
    joints = robot.joint_names[1:5]
    pictures = scene.shown(scene.seen(rng), robot=robot, postures=shown)
    blocks = [ZeroOffsets(robot, joints)]
    result = calibrate(pictures, LENS, free=blocks, sigma_px=SIGMA_PX, arm_sigma=EXACT)
    names = list(result.estimate.names)
    own = [names.index(name) for name in blocks[0].names]
    off = result.estimate.values[own] - true
    assert is_likely(off, result.estimate.covariance[np.ix_(own, own)])
    assert (result.estimate.sigma[own] < np.deg2rad(0.02)).all()
    held = calibrate(pictures, LENS)
    assert held.arm_sigma[1] > 5e-4  # the same offsets look like an arm that stops off


@BOTH
def test_errors_of_the_board_are_estimated_where_asked(seen, carried):
    rng = np.random.default_rng(25)
    scene = draw_scene(rng, 15, carried)
    bent = scene.points.copy()
    half = np.ptp(bent[:, 1]) / 2
    bent[:, 2] += 8e-4 * ((bent[:, 1] - bent[:, 1].mean()) / half) ** 2
    pixels = replace(scene, points=1.02 * bent).seen(rng, arm=STOPS_OFF)
    result = calibrate(scene.shown(pixels), board_errors=("scale", "bend_x", "bend_y"))
    assert result.warnings == ()
    own = [k for k, n in enumerate(result.estimate.names) if n.startswith("board.")]
    off = result.estimate.values[own] - [0.02, 0.0, 1.02 * 8e-4]
    assert is_likely(off, result.estimate.covariance[np.ix_(own, own)])
    scale, sigma = result.scale
    assert scale == result.estimate.values[own[0]]
    assert sigma == pytest.approx(result.estimate.sigma[own[0]])
    assert sigma < 0.002


def test_the_middle_of_the_picture_is_as_uncertain_as_draws_from_the_covariance(usual):
    result = usual["camera"]
    rng = np.random.default_rng(26)
    draws = rng.multivariate_normal(
        result.estimate.values, result.estimate.covariance, 1000, method="cholesky"
    )
    values = result.estimate.values
    middle = np.array(SIZE) / 2.0
    points = []
    for draw in draws:
        turned = result.X[:3, :3] @ rotation_exp(draw[3:6] - values[3:6])
        place = result.X[:3, 3] + draw[:3] - values[:3]
        ray = np.append(result.lens.with_values(draw[12:]).rays(middle), 1.0)
        points.append(turned @ (result.distance_m * ray) + place)
    found = np.sqrt(np.trace(np.cov(np.array(points).T)))
    assert result.seen_sigma_m == pytest.approx(found, rel=0.08)  # 1000 draws: 2.2 %


def test_half_turned_views_of_a_board_that_looks_alike_are_turned_back(seen):
    """With some wrong rows of joints, too."""
    scene, pixels = seen["camera"]
    rng = np.random.default_rng(27)
    flips = rng.random(len(pixels)) < 0.4
    either = np.where(flips[:, None, None], pixels[:, ::-1], pixels)
    result = calibrate(scene.shown(either, half_turn=True), **NOISE)
    assert result.used.all()
    one = calibrate(scene.shown(pixels), **NOISE)
    other = calibrate(scene.shown(pixels[:, ::-1]), **NOISE)
    assert min(apart(one, result), apart(other, result)) < 10 * CONVERGED
    wrong = scene.flange.copy()
    wrong[[1, 5, 9]] = wrong[[5, 9, 1]]
    found = calibrate(scene.shown(either, postures=posture_of_pose(wrong), half_turn=True), **NOISE)
    assert found.outliers == ("P02", "P06", "P10")


def refusal(pictures: Pictures, *given, **options) -> CalibError:
    with pytest.raises(CalibError) as refused:
        calibrate(pictures, *given, **options)
    assert "\n" not in str(refused.value)
    return refused.value


@BOTH
def test_too_few_pictures_are_refused(seen, carried):
    scene, pixels = seen[carried]
    few = replace(scene, flange=scene.flange[:3])
    error = refusal(few.shown(pixels[:3]))
    assert "3 of 3 pictures show the board and have a posture" in str(error)
    assert "4 are needed" in error.hint
    four = replace(scene, flange=scene.flange[:4])
    assert calibrate(four.shown(pixels[:4]), LENS).used.sum() == 4


def test_a_lens_of_pictures_of_another_size_is_refused(seen):
    scene, pixels = seen["camera"]
    error = refusal(scene.shown(pixels), replace(LENS, width_px=1280, height_px=720))
    assert "pictures of 1280 x 720 pixels, these have 1920 x 1080" in str(error)
    assert error.hint


@pytest.mark.parametrize(
    "changes",
    [
        {"postures": np.zeros((11, 6))},
        {"postures": np.zeros((12, 5))},
        {"board": inner_corners(5, 5)},
        {"pixels": np.zeros((12, 70))},
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(seen, changes):
    scene, pixels = seen["camera"]
    with pytest.raises(InputError, match="do not belong together") as refused:
        scene.shown(**{"pixels": pixels} | changes)
    assert refused.value.hint


def test_motion_without_turns_does_not_tell_where_the_camera_is(seen):
    """Nor turns about parallel axes where along them it is."""
    scene, _ = seen["camera"]
    rng = np.random.default_rng(28)
    flange = np.repeat(scene.flange[:1], 10, axis=0)
    flange[:, :3, 3] += rng.uniform(-0.03, 0.03, (10, 3))
    still = replace(scene, flange=flange)
    assert refusal(still.shown(still.seen(rng)), LENS).hint
    spun = flange.copy()
    for i, angle in enumerate(np.linspace(-0.3, 0.3, 10)):
        spun[i, :3, :3] = flange[i, :3, :3] @ rotation_exp(np.array([0.0, 0.0, angle]))
    about_one = replace(scene, flange=spun)
    assert refusal(about_one.shown(about_one.seen(rng)), LENS).hint


def test_a_robot_of_poses_and_a_robot_of_joints_say_the_same():
    rng, robot = np.random.default_rng(29), Robot.preset("ur10e")
    scene, q = reached(robot, draw_scene(rng, 25), 12)
    pixels = scene.seen(rng, arm=STOPS_OFF)
    poses = calibrate(scene.shown(pixels, robot=FLANGE), **NOISE)
    joints = calibrate(scene.shown(pixels, robot=robot, postures=q), **NOISE)
    assert apart(poses, joints) < CONVERGED
