"""Everything that can look wrong, each in a small case of its own; and where nothing does."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib import se3
from calib.errors import CalibError, ConvergenceError, InputError
from calib.hand_eye import calibrate
from calib.hand_eye.checks import explain_misfit, find_half_turns
from calib.hand_eye.start import board_poses, start_lens
from calib.robots.flange_poses import posture_of_pose
from calib.se3 import rotation_exp, transform
from studies.board_scenes import EXACT, LENS, OTHER_LENS, SIZE, STOPS_OFF, draw_scene, inner_corners
from tests.picture_mistakes import FAR_OFF, case_of, distance_in_sigma

BOTH = pytest.mark.parametrize("carried", ["camera", "board"])
COUNT = 16
NAMES = tuple(f"P{i + 1:02d}" for i in range(COUNT))


@pytest.fixture(scope="module")
def seen():
    """Scene and pixels of each set-up, of an arm that stops off."""
    rng = np.random.default_rng(40)
    scenes = {carried: draw_scene(rng, COUNT, carried) for carried in ("camera", "board")}
    return {c: (scene, scene.seen(rng, arm=STOPS_OFF)) for c, scene in scenes.items()}


def moved(scene, pixels, place, turn, split, *, on_flange=False):
    """Pictures before which, from a number on, one thing was moved."""
    T = transform(rotation_exp(np.array(turn)), np.array(place))
    there = replace(scene, X=scene.X @ T) if on_flange else replace(scene, Z=scene.Z @ T)
    later = there.seen(np.random.default_rng(41), arm=STOPS_OFF)
    return np.concatenate([pixels[:split], later[split:]])


@BOTH
def test_nothing_looks_wrong_where_nothing_is(seen, carried):
    scene, pixels = seen[carried]
    for options in ({}, {"lens": LENS}, {"board_errors": ("scale", "bend_x", "bend_y")}):
        result = calibrate(scene.shown(pixels), **options)
        assert result.warnings == ()
        assert result.used.all()


@pytest.mark.parametrize(
    ("carried", "factor", "word"), [("camera", 1.03, "smaller"), ("board", 0.98, "larger")]
)
def test_a_board_of_another_size_is_named(seen, carried, factor, word):
    scene, pixels = seen[carried]
    result = calibrate(scene.shown(pixels, board=factor * scene.points))
    said = re.fullmatch(
        rf"the board seems to be ([\d.]+) \+- [\d.]+ % {word} than described, .*",
        result.warnings[0],
    )
    assert said
    assert float(said[1]) == pytest.approx(100 * abs(1 / factor - 1), abs=0.2)
    assert not result.is_ok
    scale, sigma = result.scale
    assert abs(scale - (1 / factor - 1)) < 5 * sigma


@BOTH
@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_size_by_which_prints_are_off_is_estimated(seen, carried, factor):
    """The answer is that of a fit that was asked for the size, and it is trusted."""
    scene, pixels = seen[carried]
    pictures = scene.shown(pixels, board=factor * scene.points)
    result, asked = calibrate(pictures), calibrate(pictures, board_errors=("scale",))
    assert result.is_ok
    assert "estimated with the rest: measure its squares" in result.warnings[0]
    assert result.scale == pytest.approx(asked.scale, rel=1e-3)
    np.testing.assert_allclose(result.X, asked.X, atol=1e-6)
    assert distance_in_sigma(scene, result) < FAR_OFF


def test_a_size_of_the_board_that_pictures_neither_confirm_nor_contradict_is_in_doubt():
    """1 % off, 12 pictures of an arm that stops off: Z is 4 mm off, with a sigma of .6 mm."""
    case = case_of("squares off by 1 %", 7210)
    result = calibrate(case.pictures)
    assert distance_in_sigma(case.scene, result) > FAR_OFF
    assert not result.is_ok
    assert "rests on the stated size of the board, which is in doubt" in result.warnings[0]
    scale, sigma = result.scale
    assert abs(scale - (1 / 1.01 - 1)) < 3 * sigma
    free = calibrate(case.pictures, board_errors=("scale",))
    assert distance_in_sigma(case.scene, free) < FAR_OFF
    assert free.is_ok


def test_a_move_is_judged_by_the_scatter_that_is_left_with_it(seen):
    """A board that was moved by 8 mm makes the answer uncertain, but not by as much."""
    scene, pixels = seen["camera"]
    result = calibrate(scene.shown(moved(scene, pixels, [0.008, 0.0, 0.0], [0, 0, 0.0], 9)))
    if result.used.all():
        (found,) = (one for one in result.findings if "moved before" in one.text)
        assert found.sigmas > 6.0
    assert not result.is_ok


def test_an_arm_that_scatters_as_cheap_ones_do_is_said_and_trusted():
    """The scatter is in the standard deviations of the answer."""
    rng = np.random.default_rng(47)
    scene = draw_scene(rng, COUNT, "camera")
    result = calibrate(scene.shown(scene.seen(rng, arm=(4e-3, 6e-3))))
    assert "the arm seems to be off by" in result.warnings[0]
    assert result.is_ok
    assert distance_in_sigma(scene, result) < FAR_OFF
    far = calibrate(scene.shown(scene.seen(rng, arm=(15e-3, 6e-3))))
    assert not far.is_ok


@pytest.mark.parametrize(
    ("carried", "axis", "edges"),
    [("camera", 0, "left and right"), ("board", 1, "upper and lower")],
)
def test_a_bent_board_is_named(seen, carried, axis, edges):
    scene, _ = seen[carried]
    points = scene.points.copy()
    half = np.ptp(points[:, axis]) / 2
    points[:, 2] -= 1e-3 * ((points[:, axis] - points[:, axis].mean()) / half) ** 2
    pixels = replace(scene, points=points).seen(np.random.default_rng(42), arm=STOPS_OFF)
    result = calibrate(scene.shown(pixels))
    said = re.search(rf"its {edges} edges lie (\S+) mm behind its middle", result.warnings[0])
    assert said
    assert float(said[1]) == pytest.approx(-1.0, abs=0.2)


@BOTH
def test_the_lens_of_another_camera_is_named(seen, carried):
    scene, pixels = seen[carried]
    result = calibrate(scene.shown(pixels), OTHER_LENS)
    text = next(text for text in result.warnings if "lens" in text)
    said = re.match(
        r"the lens given is not that of these pictures: with a focal length of (\d+) in place of "
        "1450 px",
        text,
    )
    assert said
    assert float(said[1]) == pytest.approx(LENS.values[0], rel=0.03)
    assert not result.is_ok


@BOTH
@pytest.mark.parametrize("on_flange", [False, True])
def test_what_was_moved_a_little_is_named(seen, carried, on_flange):
    """Its place, and the picture before which it was."""
    scene, pixels = seen[carried]
    mixed = moved(scene, pixels, [0.0015, 0.001, 0.0], [0, 0, 0.004], 9, on_flange=on_flange)
    result = calibrate(scene.shown(mixed))
    text = " | ".join(result.warnings)
    assert re.search(r"(seems to have been moved before P(09|10|11)|contradict)", text)
    carrying, around = ("camera", "board") if carried == "camera" else ("board", "camera")
    named = re.match(r"the (camera|board) seems to have been moved", result.warnings[0])
    if named:
        assert named[1] == (carrying if on_flange else around)


def test_what_was_moved_far_late_is_left_out(seen):
    scene, pixels = seen["camera"]
    result = calibrate(scene.shown(moved(scene, pixels, [0.02, 0.01, 0], [0, 0, 0.05], 12)))
    assert result.outliers == NAMES[12:]
    assert result.warnings[0].startswith("all pictures from P13 on contradict those before")
    assert not result.is_ok


def test_what_was_moved_far_early_is_left_out(seen):
    scene, pixels = seen["camera"]
    result = calibrate(scene.shown(moved(scene, pixels, [0.02, 0.01, 0], [0, 0, 0.05], 4)))
    assert result.outliers == NAMES[:4]
    assert result.warnings[0].startswith("all pictures before P05 contradict those from it on")
    assert not result.is_ok


@BOTH
def test_what_was_moved_far_half_way_is_refused(seen, carried):
    scene, pixels = seen[carried]
    mixed = moved(scene, pixels, [0.08, 0.05, 0.02], [0.1, 0, 0.4], COUNT // 2)
    with pytest.raises(InputError, match="the pictures before P09 fit each other") as refused:
        calibrate(scene.shown(mixed))
    assert "\n" not in str(refused.value)


@BOTH
def test_an_arm_that_is_far_off_is_named(seen, carried):
    scene, _ = seen[carried]
    pixels = scene.seen(np.random.default_rng(43), arm=(4e-3, 1e-3))
    result = calibrate(scene.shown(pixels))
    said = re.search(r"the arm seems to be off by ([\d.]+) mm and", " ".join(result.warnings))
    assert said
    assert float(said[1]) == pytest.approx(4.0, rel=0.5)


@pytest.mark.parametrize(("carried", "reordered"), [("camera", False), ("board", True)])
def test_mirrored_pictures_are_named(seen, carried, reordered):
    """Also where a detector has told the corners in the order of the mirror."""
    scene, pixels = seen[carried]
    order = np.arange(35)
    if reordered:
        order = order.reshape(5, 7)[:, ::-1].ravel()
    flipped = pixels[:, order] * [-1, 1] + [SIZE[0], 0]
    with pytest.raises(InputError, match="pictures are mirrored"):
        calibrate(scene.shown(flipped))


@pytest.mark.parametrize(
    ("carried", "factor"),
    [("camera", 1e-3), ("board", 0.1), ("camera", 2.54), ("board", 10.0), ("camera", 1e3)],
)
def test_squares_in_another_unit_are_named(seen, carried, factor):
    """The fit runs away from there: it is no result, whatever it ends at."""
    scene, pixels = seen[carried]
    with pytest.raises(InputError, match=r"with a board .* times as large") as refused:
        calibrate(scene.shown(pixels, board=factor * scene.points))
    said = float(re.search(r"with a board (\S+) times", str(refused.value))[1])
    assert said == pytest.approx(1 / factor, rel=0.02)


@BOTH
def test_places_of_the_flange_in_mm_are_named(seen, carried):
    scene, pixels = seen[carried]
    postures = posture_of_pose(scene.flange) * np.repeat([1e3, 1.0], 3)
    with pytest.raises(InputError, match="the unit of the flange's places") as refused:
        calibrate(scene.shown(pixels, postures=postures))
    assert re.search(r"with a board (1e\+03|9\d\d|1\.0\de\+03) times", str(refused.value))


@BOTH
def test_pictures_and_postures_in_another_order_are_refused(seen, carried):
    scene, pixels = seen[carried]
    order = {"camera": np.arange(COUNT)[::-1], "board": np.roll(np.arange(COUNT), 1)}[carried]
    with pytest.raises(CalibError) as refused:
        calibrate(scene.shown(pixels, postures=posture_of_pose(scene.flange[order])))
    assert "\n" not in str(refused.value)


@BOTH
def test_forty_percent_of_wrong_rows_are_left_out(seen, carried):
    scene, pixels = seen[carried]
    order = np.arange(COUNT)
    order[1:7] = np.roll(order[1:7], 1)
    result = calibrate(scene.shown(pixels, postures=posture_of_pose(scene.flange[order])))
    assert result.outliers == NAMES[1:7]
    error = scene.errors(result)
    sigma = np.sqrt(np.diag(result.estimate.covariance))
    assert (np.abs(error) < 5 * sigma).all()


def test_many_that_are_left_out_are_counted(seen):
    """Eight names are enough in a line."""
    rng = np.random.default_rng(44)
    scene = draw_scene(rng, 30)
    order = np.arange(30)
    wrong = np.arange(1, 28, 3)[:9]
    order[wrong] = np.roll(wrong, 1)
    pictures = scene.shown(
        scene.seen(rng, arm=STOPS_OFF), postures=posture_of_pose(scene.flange[order])
    )
    result = calibrate(pictures)
    assert len(result.outliers) == 9
    assert ", P23 and 1 more (wrong joints" in result.warnings[0]


@BOTH
def test_pictures_beyond_the_noise_that_is_given_are_refused_where_they_are_most(seen, carried):
    """An arm that is said to be exact and is not: all of them contradict each other."""
    scene, pixels = seen[carried]
    with pytest.raises(InputError, match=r"\d+ of 16 pictures contradict the others: which") as no:
        calibrate(scene.shown(pixels), sigma_px=0.2, arm_sigma=EXACT)
    assert no.value.hint
    assert calibrate(scene.shown(pixels), sigma_px=0.2, arm_sigma=STOPS_OFF).used.all()


def test_pictures_that_show_too_little_have_no_start():
    points, few = inner_corners(), np.full((3, 35, 2), np.nan)
    few[:, :5] = 500.0 + points[:5, :2] * 3e3
    with pytest.raises(ConvergenceError, match="no picture shows 6 points of the board") as refused:
        board_poses(LENS, points, few)
    assert refused.value.hint


@pytest.mark.parametrize("name", ["pinhole", "rational", "fisheye"])
def test_a_lens_of_usual_focal_length_where_pictures_say_nothing_of_it(name):
    """The same view again and again, square to the axis."""
    points = inner_corners()
    T = transform(np.eye(3), np.array([-0.12, -0.09, 0.5]))
    pixels = np.tile(LENS.project(se3.apply(T, points)), (5, 1, 1))
    lens = start_lens(name, SIZE, points, pixels)
    assert 0.1 < lens.values[0] / SIZE[0] < 50
    assert np.isfinite(lens.values).all()


def test_poses_of_the_board_are_those_of_both_that_fit_better(seen):
    """Also of a board that is no plane, and not where points are too few."""
    rng = np.random.default_rng(46)
    scene = draw_scene(rng, 8)
    bent = scene.points.copy()
    bent[::2, 2] += 0.02
    for points in (scene.points, bent):
        own = replace(scene, points=points)
        pixels = own.seen(rng, sigma_px=0.01)
        pixels[3, 4:] = np.nan
        poses, found = board_poses(LENS, points, pixels)
        assert found.tolist() == [i != 3 for i in range(8)]
        off = se3.inverse(poses) @ own.poses(own.flange)
        assert np.abs(off[found] - np.eye(4)).max() < 1e-3


@BOTH
@pytest.mark.parametrize("wrong", [0, 5])
def test_half_turns_are_told_by_the_arm(carried, wrong):
    rng = np.random.default_rng(47)
    scene = draw_scene(rng, COUNT, carried)
    poses = scene.poses(scene.flange)
    half = transform(np.diag([-1.0, -1.0, 1.0]), np.array([0.24, 0.18, 0.0]))
    flips = rng.random(COUNT) < 0.4
    either = np.where(flips[:, None, None], poses @ half, poses)
    A = scene.flange.copy()
    A[:wrong] = np.roll(A[:wrong], 1, axis=0)
    found = find_half_turns(A, either, half, carried)
    right = np.arange(COUNT) >= wrong
    agreed = found == flips
    assert agreed[right].all() or not agreed[right].any()
    assert found.sum() <= COUNT / 2


def test_nothing_is_said_of_poses_that_nothing_explains(seen):
    rng = np.random.default_rng(48)
    scene, _ = seen["camera"]
    poses = scene.poses(scene.flange)[rng.permutation(COUNT)]
    assert explain_misfit(scene.flange, poses, "camera", NAMES, iter(())) == ""
