"""Several cameras and boards in one estimate: one kind of measurement, stops that they share."""

from __future__ import annotations

import numpy as np
import pytest

from calib.errors import InputError
from calib.hand_eye import Pictures, calibrate
from calib.lens import Lens
from calib.model import CalibrationModel, Setup
from calib.model.measurements import BoardShape, BoardView, BoardViews
from calib.model.parameters import AXES, BoardErrors, LensParameters, ZeroOffsets
from calib.model.parameters.frames import AroundArm, OnTool
from calib.robots import Robot
from calib.robots.flange_poses import flange_robot, posture_of_pose
from calib.se3 import inverse, rotation_exp, transform
from studies.board_scenes import LENS, SIGMA_PX, SIZE, STOPS_OFF, X, draw_scene, inner_corners

FISHEYE = Lens("fisheye", 1600, 1200, (800.0, 805.0, 800.0, 600.0, 0.01, -0.005, 0.001, 0.0))
BESIDE = transform(rotation_exp(np.array([0.0, -0.1, 0.0])), np.array([0.1, 0.0, 0.0]))


def model_of_four_looks() -> tuple[CalibrationModel, np.ndarray, Setup]:
    """Two cameras on a UR10e, two boards before it, nine pictures at five stops."""
    rng = np.random.default_rng(1)
    robot = Robot.preset("ur10e")
    home = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
    before = transform(rotation_exp(np.array([0.1, -0.1, 0.2])), np.array([-0.08, -0.08, 0.5]))
    Z = robot.fk(home) @ X @ before
    boards = {"A": inner_corners(6, 5), "B": inner_corners(5, 4, 0.036)}
    lenses = {"left": LENS, "right": FISHEYE}
    looks = {
        (camera, board): BoardView(
            SIGMA_PX * (1 if camera == "left" else 3),
            BoardShape(points),
            lens,
            camera_label=camera,
            board_label=board,
        )
        for camera, lens in lenses.items()
        for board, points in boards.items()
    }
    aside = transform(np.eye(3), np.array([0.15, 0.0, 0.02]))
    model = CalibrationModel(
        robot,
        [
            OnTool(list(lenses), np.stack([X, X @ BESIDE]), AXES),
            AroundArm(list(boards), np.stack([Z, Z @ aside]), AXES),
            *(LensParameters(lens, camera) for camera, lens in lenses.items()),
            BoardErrors("A", ("scale",)),
            BoardErrors("B", ("bend_x",)),
            ZeroOffsets(robot, robot.joint_names[1:5]),
        ],
        BoardViews(looks, STOPS_OFF),
    )
    stop = np.array([0, 0, 1, 2, 2, 2, 3, 3, 4])
    target = np.array([0, 0, 1, 0, 0, 1, 1, 0, 0])
    seen = rng.random((9, 40)) > 0.1
    seen[target == 1, 2 * len(boards["B"]) :] = False
    tool = np.array([0, 1, 0, 0, 1, 0, 1, 1, 0])
    nothing = np.zeros(9, dtype=int)
    q = (home + rng.uniform(-0.2, 0.2, (5, 6)))[stop]
    return model, q, Setup(nothing, tool, target, nothing, seen, stop)


def test_derivatives_of_all_looks():
    model, q, setup = model_of_four_looks()
    pixels = np.array([unit == "px" for unit in model.units])
    step = np.where(pixels, 1e-4, 1e-6)
    x = model.nominal + step * np.random.default_rng(2).standard_normal(model.p)
    J = model.jacobian(q, x, setup)
    for k in range(model.p):
        e = step * (np.arange(model.p) == k)
        ahead, behind = model.predict(q, x + e, setup), model.predict(q, x - e, setup)
        expected = (ahead - behind) / (2.0 * step[k]) * setup.seen
        scale = np.abs(expected).max()
        assert scale > 0, model.names[k]
        np.testing.assert_allclose(J[..., k], expected, atol=1e-6 * scale, err_msg=model.names[k])


def test_pictures_of_one_stop_share_the_deviation_of_the_arm():
    model, q, setup = model_of_four_looks()
    view = model.view(q, None, setup)
    assert isinstance(model.measurement, BoardViews)
    sigma = np.where(setup.tool == 0, SIGMA_PX, 3 * SIGMA_PX)
    D = sigma[:, None, None] * model.by_deviation(view).transpose(2, 0, 1)  # (N, m, 6)
    variance = np.repeat(np.array(STOPS_OFF) ** 2, 3)
    N, m, _ = D.shape
    together = setup.stops[:, None] == setup.stops
    covariance = np.einsum("imt,t,jnt,ij->imjn", D, variance, D, together).reshape(N * m, N * m)
    covariance += np.diag(np.repeat(sigma**2, m))
    rows = np.random.default_rng(3).standard_normal((m, N)) * setup.seen.T
    white = model.whiten_last(rows, view)
    flat = rows.T.ravel()
    assert np.sum(white**2) == pytest.approx(flat @ np.linalg.solve(covariance, flat), rel=1e-9)
    np.testing.assert_allclose(model.colour_last(white, view), rows, atol=1e-9)


def test_what_two_cameras_are_apart_is_known_better_than_where_they_are():
    rng = np.random.default_rng(3)
    scene = draw_scene(rng, 8)
    second = X @ BESIDE
    apart, sigmas = [], []
    names = tuple(f"P{i}" for i in range(8))
    for _ in range(5):
        place = scene.flange[:, :3, 3] + STOPS_OFF[0] * rng.standard_normal((8, 3))
        turn = rotation_exp(STOPS_OFF[1] * rng.standard_normal((8, 3)))
        flange = transform(turn @ scene.flange[:, :3, :3], place)
        sets = []
        for name, T_flange_camera in (("left", X), ("right", second)):
            T = inverse(flange @ T_flange_camera) @ scene.Z
            points = np.einsum("nij,kj->nki", T[:, :3, :3], scene.points) + T[:, None, :3, 3]
            pixels = LENS.project(points) + SIGMA_PX * rng.standard_normal((*points.shape[:2], 2))
            q = posture_of_pose(scene.flange)
            sets.append(
                Pictures(
                    flange_robot(), q, pixels, scene.points, SIZE, "camera", names, camera=name
                )
            )
        result = calibrate(sets)
        names_ = result.estimate.names
        left, right = ([names_.index(f"tool.{c}.{a}") for a in "xyz"] for c in ("left", "right"))
        gain = np.zeros((3, len(names_)))
        gain[range(3), right], gain[range(3), left] = 1.0, -1.0
        sigma = np.sqrt(np.diag(gain @ result.estimate.covariance @ gain.T))
        found = result.poses["right"][:3, 3] - result.poses["left"][:3, 3]
        apart.append((found - (second - X)[:3, 3]) / sigma)
        sigmas.append(np.linalg.norm(sigma) / np.linalg.norm(result.frames[0].sigma_m))
    # rms of 15 numbers, three of a trial not independent: 1 +- 0.3
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.6
    assert np.median(sigmas) < 0.7
    assert result.warnings == ()
    assert {frame.name for frame in result.frames} == {
        "T_flange_left",
        "T_flange_right",
        "T_base_board",
    }


def test_a_name_on_both_sides_is_refused():
    rng = np.random.default_rng(5)
    scene, other = draw_scene(rng, 8), draw_scene(rng, 8, "board")
    sets = [scene.shown(scene.seen(rng)), other.shown(other.seen(rng))]
    with pytest.raises(InputError, match="is on the flange in some pictures"):
        calibrate(sets)


def test_names_with_points_are_refused():
    rng = np.random.default_rng(5)
    scene = draw_scene(rng, 5)
    with pytest.raises(InputError, match="is no name of a camera"):
        scene.shown(scene.seen(rng), camera="left.1")
