"""Noise of pixels and of the arm, from what pictures are off: against what was simulated."""

from dataclasses import replace

import numpy as np
import pytest

from calib.chance import normal_quantile
from calib.errors import ConvergenceError
from calib.hand_eye.noise import squares_of_pictures
from calib.identification.deviations import (
    LEAST_ARM,
    arm_deviation,
    deviations,
    noise_within,
    restricted,
)
from calib.lens import Lens
from calib.model import CalibrationModel
from calib.model.measurements import (
    BoardShape,
    BoardView,
    Measurements,
    Setup,
    ViewLine,
    board_views,
)
from calib.model.parameters import LensParameters, TargetFrame, TargetPoints, ToolFrame, ToolPoint
from calib.robots.flange_poses import flange_robot, posture_of_pose
from calib.se3 import rotation_exp, transform
from studies.board_scenes import EXACT, LENS, SIGMA_PX, STOPS_OFF, Scene, draw_scene

TRIALS = 20
SURE = normal_quantile(1 - 1e-5)
"""Standard errors of a mean within which it is right."""


def model_of(scene: Scene, sigma_px: float = SIGMA_PX, lens: Lens = LENS) -> CalibrationModel:
    kind = BoardView(sigma_px, BoardShape(scene.points), lens, scene.carried)
    blocks = [ToolFrame(scene.X), TargetFrame(scene.Z), LensParameters(lens)]
    return CalibrationModel(flange_robot(), blocks, kind)


def parts_of(scene: Scene, pixels, sigma_px: float = SIGMA_PX):
    """About the truth: the Gauss-Newton step to the estimate is a part of the restriction."""
    model = model_of(scene, sigma_px)
    data = board_views(posture_of_pose(scene.flange), pixels)
    return deviations(model.linearise_at(data, model.nominal))


@pytest.fixture(scope="module", params=["camera", "board"])
def scene(request):
    return draw_scene(np.random.default_rng(30), 15, request.param)


def is_mean(values, wanted: float) -> bool:
    """Whether the mean is as wanted, to the scatter of the values."""
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    return abs(float(np.mean(values)) - wanted) < SURE * error


def test_a_known_deviation_of_the_tip_is_found(scene):
    """To first order: of .1 mm and .1 mrad a thousandth is left."""
    rng = np.random.default_rng(31)
    true = 1e-4 * rng.standard_normal((15, 6))
    moved = transform(
        rotation_exp(true[:, 3:]) @ scene.flange[:, :3, :3], scene.flange[:, :3, 3] + true[:, :3]
    )
    pixels = Scene(moved, scene.carried, Z=scene.Z).seen(rng, sigma_px=0.0)
    parts = parts_of(scene, pixels)
    np.testing.assert_allclose(parts.off, true, rtol=0, atol=2e-3 * np.abs(true).max())
    assert (parts.within < 1e-3 * parts.within_rows).all()


def test_deviations_by_parameters_are_central_differences(scene):
    """What a picture is off by less the six of its own pose: of the lens, mostly a part."""
    pixels = scene.seen(np.random.default_rng(32), sigma_px=0.0)
    model, data = model_of(scene), board_views(posture_of_pose(scene.flange), pixels)
    found = deviations(model.linearise_at(data, model.nominal)).by_parameters
    steps = np.array([{"px": 1e-2, "m": 1e-6, "rad": 1e-6, "1": 1e-5}[u] for u in model.units])
    for k, step in enumerate(steps):
        e = step * (np.arange(model.p) == k)
        ahead, behind = (
            deviations(model.linearise_at(data, model.nominal + s * e)).off for s in (1, -1)
        )
        wanted = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(found[..., k], wanted, rtol=0, atol=1e-4 * np.abs(wanted).max())


def test_the_scatter_within_pictures_is_that_of_the_pixels_whatever_the_arm_does(scene):
    """Its mean, and without those terms of the lens that pictures tell the rest by."""
    rng = np.random.default_rng(33)
    for arm in (EXACT, STOPS_OFF):
        found = [
            noise_within(parts_of(scene, scene.seen(rng, 0.3, arm), sigma_px=SIGMA_PX))[0] ** 2
            for _ in range(TRIALS)
        ]
        assert is_mean(found, (0.3 / SIGMA_PX) ** 2)


def test_covariances_of_deviations_are_their_scatter(scene):
    rng = np.random.default_rng(34)
    parts = [parts_of(scene, scene.seen(rng, arm=STOPS_OFF)) for _ in range(TRIALS)]
    squares = [squares_of_pictures(one, STOPS_OFF).mean() / 6 for one in parts]
    assert is_mean(squares, 1.0)
    exact = [parts_of(scene, scene.seen(rng)) for _ in range(TRIALS)]
    assert is_mean([squares_of_pictures(one, EXACT).mean() / 6 for one in exact], 1.0)
    assert np.mean([squares_of_pictures(one, EXACT).mean() / 6 for one in parts]) > 1.5


def test_the_deviation_of_the_arm_is_unbiased_by_what_is_estimated_with_it(scene):
    """Without the restriction 12 parameters of 90 rows would take a seventh of the variance."""
    rng = np.random.default_rng(35)
    parts = [parts_of(scene, scene.seen(rng, arm=STOPS_OFF)) for _ in range(TRIALS)]
    found = np.array([arm_deviation(one) for one in parts]) ** 2
    for k in range(2):
        assert is_mean(found[:, k], STOPS_OFF[k] ** 2)


def test_the_slope_of_the_restricted_likelihood_is_central_differences(scene):
    parts = parts_of(scene, scene.seen(np.random.default_rng(37), arm=STOPS_OFF))
    unlikely = restricted(parts)
    at, steps = np.log([STOPS_OFF, (1e-6, 1e-3), (1e-3, 1e-6)]), 1e-5 * np.eye(2)
    wanted = [(unlikely(at + s)[0] - unlikely(at - s)[0]) / 2e-5 for s in steps]
    np.testing.assert_allclose(unlikely(at)[1], np.transpose(wanted), rtol=1e-4, atol=1e-4)


def test_no_other_deviation_is_likelier(scene):
    """On a grid: a search by differences stops where the likelihood is flat, at no deviation.

    To a tenth of what a standard error of a deviation costs.
    """
    rng = np.random.default_rng(38)
    grid = np.log(np.stack(np.meshgrid(*[np.geomspace(1e-7, 1e-2, 13)] * 2), axis=-1))
    for arm in [EXACT] * 4 + [STOPS_OFF] * 2:
        parts = parts_of(scene, scene.seen(rng, arm=arm))
        unlikely = restricted(parts)
        found = unlikely(np.log(np.maximum([arm_deviation(parts)], LEAST_ARM)))[0]
        assert found <= unlikely(grid.reshape(-1, 2))[0].min() + 0.1


def test_an_exact_arm_is_found_to_be_one(scene):
    """Half of the time noise alone looks like some: far below what pixels tell of one picture."""
    rng = np.random.default_rng(36)
    parts = [parts_of(scene, scene.seen(rng)) for _ in range(TRIALS)]
    found = np.array([arm_deviation(one) for one in parts])
    own = np.sqrt(np.median(np.einsum("nii->ni", parts[0].covariance), axis=0)).reshape(2, 3)
    assert (found.max(axis=0) < own.max(axis=1)).all()
    assert ((found == 0).mean(axis=0) > 0.15).all()


def test_a_single_view_line_does_not_tell_where_the_arm_stood():
    blocks = [ToolPoint([0.1, 0.2, 0.3]), TargetPoints([[0.4, 0.1, 0.2]])]
    model = CalibrationModel(flange_robot(), blocks, ViewLine(1e-5))
    data = Measurements(np.zeros((2, 6)), Setup.of(2))
    with pytest.raises(ConvergenceError, match="where the arm stood"):
        deviations(model.linearise_at(data, model.nominal))


def test_pictures_are_judged_by_what_the_parameters_leave_of_them(scene):
    """At an estimate from nine of fifteen: used ones are off less, the others more, all as said."""
    rng = np.random.default_rng(37)
    used = np.arange(15) < 9
    found = []
    for _ in range(TRIALS):
        pixels = scene.seen(rng, arm=STOPS_OFF)
        parts = parts_of(scene, pixels)
        V = parts.covariance + np.diag(np.repeat(np.square(STOPS_OFF), 3))
        H, W = parts.by_parameters[used], np.linalg.inv(V[used])
        A = np.einsum("nip,nij,njq->pq", H, W, H) + parts.within_blocks[used].sum(axis=0)
        b = np.einsum("nip,nij,nj->p", H, W, parts.off[used])
        step = np.linalg.solve(A, b + parts.within_right[used].sum(axis=0))
        fitted = replace(parts, off=parts.off - np.einsum("nip,p->ni", parts.by_parameters, step))
        squares = squares_of_pictures(fitted, STOPS_OFF, used) / 6
        plain = squares_of_pictures(fitted, STOPS_OFF) / 6
        found.append([one[own].mean() for one in (squares, plain) for own in (used, ~used)])
    those, others, plain_those, plain_others = np.array(found).T
    assert is_mean(those, 1.0)
    assert is_mean(others, 1.0)
    assert plain_those.mean() < 0.9
    assert plain_others.mean() > 1.15
