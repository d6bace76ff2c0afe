"""Points of a board in pictures as a kind of measurement: derivatives, noise, what is unseen."""

from dataclasses import replace

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.errors import InputError
from calib.identification import identify
from calib.lens import DISTORTION, Lens
from calib.model import Setup
from calib.model.measurements import KINDS, BoardShape, BoardView, board_views
from calib.model.parameters import (
    BoardErrors,
    LensParameters,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoints,
    ZeroOffsets,
)
from calib.robots.flange_poses import flange_robot, posture_of_pose
from calib.se3 import rotation_exp, transform
from studies.board_scenes import LENS, SIGMA_PX, SIZE, draw_scene, inner_corners, reached

ARM = (3e-4, 5e-4)
ERRORS = ("scale", "bend_x", "bend_y")
LENSES = {
    "pinhole": LENS,
    "rational": Lens("rational", *SIZE, (*LENS.values, 0.02, -0.01, 0.005)),
    "fisheye": Lens("fisheye", *SIZE, (*LENS.values[:4], 0.02, -0.01, 0.004, -0.002)),
}
BOTH = pytest.mark.parametrize("carried", ["camera", "board"])

RELATIVE = 1e-7
"""Of the largest element of a column: truncation and rounding leave about 1e-9."""


@pytest.fixture(scope="module")
def robot():
    return Robot.preset("ur10e")


@pytest.fixture(scope="module")
def scenes(robot):
    """A scene and joint values ``(5, 6)`` for each set-up."""
    rng = np.random.default_rng(3)
    small = inner_corners(5, 4, 0.05)
    return {c: reached(robot, draw_scene(rng, 20, c, points=small), 5) for c in ("camera", "board")}


def model_of(robot, scene, arm=ARM, lens=LENS, free=None, errors=ERRORS) -> CalibrationModel:
    blocks = [
        ToolFrame(scene.X),
        TargetFrame(scene.Z),
        LensParameters(lens, free=free),
        BoardErrors(free=errors),
        ZeroOffsets(robot, robot.joint_names),
    ]
    kind = BoardView(SIGMA_PX, BoardShape(scene.points), lens, scene.carried, arm)
    return CalibrationModel(robot, blocks, kind)


def steps_of(model: CalibrationModel) -> np.ndarray:
    """Of central differences: each moves pixels by some tenths."""
    unit = {"px": 1e-2, "m": 1e-6, "rad": 1e-6, "1": 1e-4}
    return np.array([unit[u] for u in model.units])


def differences(model, q, x, setup=None) -> np.ndarray:
    columns = []
    for k, step in enumerate(steps_of(model)):
        e = step * (np.arange(model.p) == k)
        ahead, behind = (model.predict(q, x + s * e, setup) for s in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def off_nominal(model, rng) -> np.ndarray:
    return model.nominal + 100 * steps_of(model) * rng.standard_normal(model.p)


@BOTH
@pytest.mark.parametrize("lens", LENSES)
def test_the_jacobian_is_central_differences(robot, scenes, carried, lens):
    """About parameters that are not nominal, of trials at once."""
    scene, q = scenes[carried]
    model = model_of(robot, scene, lens=LENSES[lens])
    assert model.p == 6 + 6 + len(LENSES[lens].values) + 3 + 6
    rng = np.random.default_rng(1)
    x = np.stack([off_nominal(model, rng) for _ in range(2)])
    found = model.jacobian(q, x)
    wanted = np.stack([differences(model, q, one) for one in x])
    scale = np.abs(wanted).max(axis=(0, 1, 2))
    assert (scale > 0).all()
    assert (np.abs(found - wanted).max(axis=(0, 1, 2)) / scale < RELATIVE).all()


@BOTH
def test_rows_that_were_not_seen_have_no_derivative(robot, scenes, carried):
    scene, q = scenes[carried]
    model = model_of(robot, scene)
    rng = np.random.default_rng(2)
    seen = np.repeat(rng.random((len(q), len(scene.points))) < 0.6, 2, axis=1)
    setup = replace(Setup.of(len(q)), seen=seen)
    x = off_nominal(model, rng)
    found = model.jacobian(q, x, setup)
    wanted = np.where(seen[..., None], differences(model, q, x), 0.0)
    scale = np.abs(wanted).max(axis=(0, 1))
    assert (np.abs(found - wanted).max(axis=(0, 1)) / scale < RELATIVE).all()
    whitened = model.linearise(q, x, setup).white_jacobian
    assert not whitened[~seen].any()


@BOTH
def test_some_values_of_a_lens_are_identified_and_the_others_kept(robot, scenes, carried):
    scene, q = scenes[carried]
    every, some = model_of(robot, scene), model_of(robot, scene, free=("cy", "k1"))
    own = [k for k, name in enumerate(every.names) if name in some.names]
    assert len(own) == some.p == every.p - len(LENS.values) + 2
    x = off_nominal(every, np.random.default_rng(4))
    kept = [k for k in range(every.p) if k not in own]
    x[kept] = every.nominal[kept]
    np.testing.assert_allclose(some.predict(q, x[own]), every.predict(q, x), rtol=1e-12)
    np.testing.assert_allclose(some.jacobian(q, x[own]), every.jacobian(q, x)[..., own])


@BOTH
def test_whitening_is_that_of_the_explicit_covariance(robot, scenes, carried):
    """sigma² I + D S Dᵀ, with D by central differences of where the tip is."""
    scene, _ = scenes[carried]
    flange = flange_robot()
    kind = BoardView(SIGMA_PX, BoardShape(scene.points), LENS, carried, ARM)
    model = CalibrationModel(flange, [ToolFrame(scene.X), TargetFrame(scene.Z)], kind)
    q = posture_of_pose(scene.flange)
    step = 1e-6
    D = np.empty((len(q), model.rows, 6))
    for k in range(6):
        six = step * np.eye(6)[k]
        moved = [
            transform(rotation_exp(s * six[3:]) @ T[:3, :3], T[:3, 3] + s * six[:3])
            for s in (1, -1)
            for T in scene.flange
        ]
        ahead, behind = np.split(model.predict(posture_of_pose(np.array(moved))), 2)
        D[..., k] = (ahead - behind) / (2 * step)
    analytic = SIGMA_PX * model.by_deviation(model.view(q)).transpose(2, 0, 1)
    np.testing.assert_allclose(analytic, D, atol=1e-6 * np.abs(D).max())
    S = np.diag(np.repeat(np.square(ARM), 3))
    covariance = SIGMA_PX**2 * np.eye(model.rows) + D @ S @ D.transpose(0, 2, 1)
    unit = np.broadcast_to(np.eye(model.rows), covariance.shape)
    W = model.whiten(q, unit)
    identity = W @ covariance @ W.transpose(0, 2, 1)
    np.testing.assert_allclose(identity, unit, atol=1e-6)
    root = model.linearise(q).noise_root
    np.testing.assert_allclose(
        root @ root.transpose(0, 2, 1), covariance, atol=1e-6 * covariance.max()
    )


def one_of_each_kind(robot, scene) -> CalibrationModel:
    blocks = [
        ToolFrame(scene.X),
        ToolPoints([[0.1, 0.2, 0.3]], ["point"]),
        TargetFrame(scene.Z),
        TargetPoints([[0.4, 0.1, 0.2]], ["pin"]),
    ]
    kinds = [kind(np.linspace(1e-5, 3e-5, kind.rows)) for kind in KINDS.values()]
    kinds += [
        BoardView(SIGMA_PX, BoardShape(scene.points), LENS, scene.carried, arm)
        for arm in (None, ARM)
    ]
    return CalibrationModel(robot, blocks, kinds)


@BOTH
def test_colouring_is_the_inverse_of_whitening(robot, scenes, carried):
    """Of every kind, mixed, about frames on the tool and around the arm."""
    scene, q = scenes[carried]
    model = one_of_each_kind(robot, scene)
    count = len(model.measurements)
    setup = Setup.of(count, kind=np.arange(count))
    postures = q[np.arange(count) % len(q)]
    rng = np.random.default_rng(5)
    white = np.zeros((count, model.rows))
    for i, kind in enumerate(model.measurements):
        white[i, : kind.rows] = rng.standard_normal(kind.rows)
    coloured = model.linearise(postures, setup=setup).coloured(white)
    assert not np.allclose(coloured, white)
    again = model.whiten(postures, coloured[..., None], setup=setup)[..., 0]
    np.testing.assert_allclose(again, white, atol=1e-9)


def fit_of(scene, points, pixels):
    kind = BoardView(SIGMA_PX, BoardShape(points), LENS, scene.carried, ARM)
    blocks = [ToolFrame(scene.X), TargetFrame(scene.Z)]
    model = CalibrationModel(flange_robot(), blocks, kind)
    return identify(model, board_views(posture_of_pose(scene.flange), pixels))


@BOTH
def test_points_that_were_not_seen_count_as_if_there_were_none(scenes, carried):
    scene, _ = scenes[carried]
    pixels = scene.seen(np.random.default_rng(6), arm=ARM)
    keep = np.arange(len(scene.points)) % 3 != 1
    without = fit_of(scene, scene.points[keep], pixels[:, keep])
    hidden = fit_of(scene, scene.points, np.where(keep[:, None], pixels, np.nan))
    np.testing.assert_allclose(hidden.values, without.values, rtol=0, atol=1e-10)
    np.testing.assert_allclose(hidden.covariance, without.covariance, rtol=1e-6, atol=1e-18)
    assert hidden.degrees_of_freedom == without.degrees_of_freedom


@BOTH
def test_one_coordinate_of_a_point_is_a_measurement(robot, scenes, carried):
    """An edge of the picture hides whole points, but rows are masked one by one."""
    scene, q = scenes[carried]
    pixels = scene.seen(np.random.default_rng(7))
    pixels[0, 0, 1] = np.nan
    data = board_views(q, pixels)
    assert data.setup.seen is not None
    assert data.setup.seen.sum() == pixels.size - 1


@BOTH
def test_points_outside_the_picture_count_as_unseen_where_nothing_says_which(
    robot, scenes, carried
):
    """Also those behind the camera, whose pixels may lie in the picture."""
    scene, q = scenes[carried]
    kind = BoardView(SIGMA_PX, BoardShape(scene.points), LENS, carried, border_px=400.0)
    model = CalibrationModel(robot, [ToolFrame(scene.X), TargetFrame(scene.Z)], kind)
    pixels = model.predict(q).reshape(len(q), -1, 2)
    inside = ((pixels >= 400) & (pixels <= np.array(SIZE) - 400)).all(axis=-1)
    assert inside.any()
    assert not inside.all()
    J = model.jacobian(q).reshape(*pixels.shape, model.p)
    assert ((J != 0).any(axis=(2, 3)) == inside).all()
    back = transform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    if carried == "camera":
        behind = [ToolFrame(scene.X @ back), TargetFrame(scene.Z)]
    else:
        behind = [ToolFrame(scene.X), TargetFrame(scene.Z @ back)]
    assert not CalibrationModel(robot, behind, kind).jacobian(q).any()


def test_errors_of_a_print_move_its_points():
    points = inner_corners()
    moved = BoardShape(points).by_errors
    np.testing.assert_allclose(moved[0], points)
    for k, bent in enumerate(moved[1:]):
        along = points[:, k]
        assert not bent[:, :2].any()
        ends = np.isclose(along, along.min()) | np.isclose(along, along.max())
        np.testing.assert_allclose(bent[ends, 2], 1.0)
        middle = np.isclose(along, (along.min() + along.max()) / 2)
        assert bent[middle, 2] == pytest.approx(0.0, abs=1e-12)


def test_pixels_of_a_stretched_board_are_those_of_a_board_of_that_size(robot, scenes):
    scene, q = scenes["camera"]
    model = model_of(robot, scene, errors=("scale",))
    x = model.nominal.copy()
    x[[i for i, name in enumerate(model.names) if name.endswith("scale")]] = 0.02
    larger = model_of(robot, replace(scene, points=1.02 * scene.points), errors=("scale",))
    np.testing.assert_allclose(model.predict(q, x), larger.predict(q), rtol=1e-12)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (lambda: LensParameters(LENS, free=["fz"]), "has no 'fz'"),
        (lambda: BoardErrors(free=["scle"]), "has no 'scle'"),
    ],
)
def test_what_lens_and_board_do_not_have_cannot_be_identified(block, said):
    with pytest.raises(InputError, match=said) as refused:
        block()
    assert refused.value.hint


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.zeros(3), np.full((4, 3), np.nan)])
def test_a_board_without_points_in_space_is_refused(points):
    with pytest.raises(InputError, match=r"a board needs points \(K, 3\)"):
        BoardShape(points)


def test_names_of_lens_parameters_are_those_of_the_lens():
    for name, terms in DISTORTION.items():
        block = LensParameters(LENSES[name])
        assert tuple(n.split(".")[-1] for n in block.names) == ("fx", "fy", "cx", "cy", *terms)
        assert block.units == ("px",) * 4 + ("1",) * len(terms)
