"""Plans for pictures of a board: cell, constraints, candidates, blocks, choice and next poses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError, UnreachableError
from calib.hand_eye.points import seen_point_motion
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel
from calib.model.measurements import BoardShape, BoardView
from calib.model.parameters import TargetFrame, ToolFrame
from calib.se3 import inverse, rotation_exp, transform
from posedesign.candidates import candidates_of, functions_over_work
from posedesign.candidates.building import view_candidates
from posedesign.cell.schema import SolidSection
from posedesign.constraints import nearest_postures
from posedesign.constraints.visibility import BoardSight
from posedesign.hand_eye import as_calibrated
from posedesign.planning.checks import score_poses
from posedesign.planning.loop import check_base_pose, grid_poses
from posedesign.planning.optimal import Request, plan_next_views, plan_optimal, refinement
from posedesign.planning.optimal.request import objective_of
from posedesign.planning.pose_plan import PoseStatus
from posedesign.planning.poses_file import PoseList
from posedesign.selection import mean_deviation, select, select_fewest, shortened
from posedesign.selection.criteria import criterion_by_name, wanted_deviations
from posedesign.workflow import plan_next_poses
from tests.board_cells import board_cell, check_constraints, inside, pixels_of, seen, true_frames
from tests.marks import rest_in_slow

FIXED = pytest.mark.parametrize("fixed", [False, True], ids=["in hand", "to hand"])
COUNT, FEW = 8, 16


@pytest.fixture(scope="module")
def cell():
    return board_cell(pool={"candidates": 150})


@pytest.fixture(scope="module")
def pool(cell):
    return candidates_of(cell)


@FIXED
def test_camera_and_board_are_where_the_sections_say(fixed):
    found = board_cell(fixed=fixed).board_set_up
    X, Z = true_frames(board_cell(fixed=fixed))
    np.testing.assert_allclose(found.X, X, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.Z, Z, rtol=0, atol=1e-12)
    assert found.carried == ("board" if fixed else "camera")


@FIXED
def test_a_board_may_be_rolled_and_faces_where_it_is_said_to(fixed):
    target = {"normal": [0.0, 0.6, 0.8], "roll_deg": 30.0}
    found = board_cell(fixed=fixed, target=target).board_set_up
    board = found.X if fixed else found.Z
    np.testing.assert_allclose(board[:3, 2], [0.0, -0.6, -0.8], atol=1e-12)
    plain = board_cell(fixed=fixed, target=target | {"roll_deg": 0.0}).board_set_up
    turn = (plain.X if fixed else plain.Z)[:3, :3].T @ board[:3, :3]
    np.testing.assert_allclose(turn, rotation_exp(np.deg2rad([0.0, 0.0, 30.0])), atol=1e-12)
    assert plain.room_px(np.array(0.35)).shape == (2,)


def test_a_fixed_camera_looks_at_the_board_from_where_it_is():
    place = [1500.0, 300.0, 200.0]
    cell = board_cell(fixed=True, camera={"position_mm": place})
    Z = cell.board_set_up.Z
    np.testing.assert_allclose(1e3 * Z[:3, 3], place)
    np.testing.assert_allclose((inverse(Z) @ [*cell.target_m, 1.0])[:2], 0.0, atol=1e-12)
    turned = board_cell(fixed=True, camera={"position_mm": place, "wpr_deg": [90.0, 0.0, 0.0]})
    np.testing.assert_allclose(turned.board_set_up.Z[:3, 2], [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"camera": {"distortion": [0.1] * 6}}, "a pinhole lens has 5 terms of distortion, 6 were"),
        ({"measurement": {"kind": "camera-pose"}, "camera": {"mount": "fixed"}}, "on the flange"),
        ({"measurement": {"weighted": False}}, "a board is weighted by its noise"),
        ({"camera": {"share_in_view": 0.0}}, "share_in_view"),
        ({"camera": {"mount": "wall"}}, "should be 'flange' or 'fixed'"),
    ],
)
def test_what_does_not_go_together_is_refused(sections, words):
    with pytest.raises(CalibError) as refused:
        board_cell(**sections)
    assert words in str(refused.value)


@FIXED
def test_the_constraints_are_those_that_a_few_lines_find(fixed):
    """Of postures all about: the share in view, distance and tilt decide as counted by hand."""
    cell = board_cell(fixed=fixed, camera={"largest_tilt_deg": 40.0, "nearest_mm": 250.0})
    rng = np.random.default_rng(3)
    q = cell.base_posture + rng.uniform(-0.25, 0.25, (400, 6))
    verdicts = cell.checker.check(q)
    names = [constraint.name for constraint in verdicts.constraints]
    margin = {name: verdicts.margin[:, names.index(name)] for name in names}
    T = cell.robot.fk(q)
    share = inside(cell, seen(cell, T, cell.board.points)).mean(axis=1)
    assert 20 < (share >= 0.6).sum() < 380
    np.testing.assert_array_equal(margin["image border"] >= 0.0, share >= 0.6)
    corners = cell.board.outline
    sides = (corners + corners[[1, 2, 3, 0]]) / 2.0
    there = seen(cell, T, np.vstack([corners, corners.mean(axis=0), sides]))
    far = np.linalg.norm(there, axis=2)
    np.testing.assert_array_equal(
        margin["camera distance"] >= 0.0, (far.min(axis=1) >= 0.25) & (far.max(axis=1) <= 0.7)
    )
    into = np.cross(there[:, 1] - there[:, 0], there[:, 3] - there[:, 0])
    cosine = (into * there[:, 4]).sum(axis=1) / np.linalg.norm(into, axis=1) / far[:, 4]
    np.testing.assert_allclose(
        np.rad2deg(margin["tilt of the board"]), 40.0 - np.rad2deg(np.arccos(cosine)), atol=1e-6
    )


@FIXED
def test_the_circle_of_a_round_target_has_to_be_whole(fixed):
    """It is found by its rim, which lies outside all of its points."""
    cell = board_cell(kind="round-target", fixed=fixed)
    rng = np.random.default_rng(3)
    q = cell.base_posture + rng.uniform(-0.15, 0.15, (400, 6))
    verdicts = cell.checker.check(q)
    names = [constraint.name for constraint in verdicts.constraints]
    T = cell.robot.fk(q)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    rim = 0.045 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    whole = inside(cell, seen(cell, T, rim)).all(axis=1)
    points = inside(cell, seen(cell, T, cell.board.points)).all(axis=1)
    kept = verdicts.margin[:, names.index("image border")] >= 0.0
    assert 20 < whole.sum() < points.sum() - 5
    assert (kept != whole).sum() <= 1  # between the points of the rim that are looked at


def test_a_picture_that_lacks_points_says_how_many():
    cell = board_cell(square_mm=40.0, kind="chessboard")
    with pytest.raises(UnreachableError, match=r"25 of 35 points of the board in the image .* 35"):
        check_base_pose(cell)
    check_base_pose(board_cell(square_mm=40.0))  # a ChArUco needs but some of its points


@FIXED
def test_what_stands_before_an_edge_of_the_board_is_in_the_way(fixed):
    cell = board_cell(fixed=fixed)
    lens = cell.lens_m
    edge = cell.target_m + cell.robot.fk(cell.base_posture)[:3, :3] @ [0.058, 0.0, 0.0]
    post = {"name": "post", "size_mm": [8.0, 8.0, 8.0]}
    bodies = [
        ({**post, "at_mm": (1e3 * (0.5 * lens + 0.5 * place)).tolist()}, clear)
        for place, clear in ((edge, False), (3.0 * edge - 2.0 * cell.target_m, True))
    ]
    for body, clear in bodies:
        solid = SolidSection.model_validate(body)
        config = cell.config.model_copy(update={"obstacle": (solid,)})
        again = type(cell).from_config(config, Path("cell.toml"))
        verdicts = again.checker.check(again.base_posture[None])
        names = [constraint.name for constraint in verdicts.constraints]
        k = names.index("line of sight")
        assert (verdicts.margin[0, k] > 0.0) == clear
        if not clear:
            assert verdicts.reason(0, k) == "post stands between camera and board"


def test_folded_points_of_a_distorted_lens_are_not_in_view():
    """A strong distortion brings what is far outside back into the picture."""
    cell = board_cell(camera={"distortion": [-0.3], "focal_px": 1000.0})
    there = cell.board_set_up
    sight = BoardSight(there.lens, np.eye(3), np.eye(4)[:, :3], there.X, there.Z, "camera")
    far = np.array([[[1.7, 0.0, 1.0], [0.2, 0.0, 1.0]]])
    assert (np.abs(there.lens.project(far) - [640.0, 512.0]) < 300.0).all()
    margins = sight.margins_px(far)[0]
    assert margins[0] < 0.0 < margins[1]
    # nor do they count where poses are judged: the same two points, of a board at the base pose
    T = there.cameras(cell.robot.fk(cell.base_posture))
    board = BoardShape(0.3 * far[0] @ T[:3, :3].T + T[:3, 3] + there.T_board_middle[:3, 3])
    kind = BoardView(0.2, board, there.lens, border_px=30.0)
    model = CalibrationModel(cell.robot, [ToolFrame(there.X), TargetFrame(there.Z)], kind)
    J = model.linearise(cell.base_posture[None]).jacobian[0]
    assert not J[:2].any()
    assert J[2:].any(axis=1).all()


@FIXED
def test_views_are_spread_over_the_image_and_all_distances(fixed):
    cell = board_cell(fixed=fixed, pool={"candidates": 250})
    pool = candidates_of(cell)
    assert len(pool) == 250
    check_constraints(cell, pool.postures)
    middle = seen(cell, cell.robot.fk(pool.postures), cell.board.outline.mean(axis=0)[None])[:, 0]
    places = pixels_of(cell, middle)
    counts = np.histogram2d(*places.T, bins=(3, 3), range=[[0, 1280], [0, 1024]])[0]
    assert counts.min() > 5
    away = np.linalg.norm(middle, axis=1)
    assert away.max() > 2.0 * away.min()


def test_views_of_a_cell_without_pictures_are_refused():
    plain = board_cell(measurement={"kind": "camera-pose"}, pool={"kind": "views"})
    with pytest.raises(InputError, match="views are of a board"):
        candidates_of(plain)


def test_no_view_at_all_has_its_reason():
    cell = board_cell(camera={"nearest_mm": 20.0, "farthest_mm": 60.0})
    with pytest.raises(UnreachableError, match=r"none of \d+ poses can be taken"):
        view_candidates(cell, 50, np.random.default_rng(0))


def test_the_grid_moves_the_board_over_the_image_and_leaves_the_base_pose(cell):
    poses = grid_poses(cell, np.array([10.0, 10.0, 10.0]))
    assert len(poses.postures) == 27
    good = [i for i, status in enumerate(poses.status) if status is PoseStatus.GRID]
    assert len(good) >= 24
    np.testing.assert_allclose(poses.postures[13], cell.base_posture, atol=1e-9)
    T = cell.robot.fk(poses.postures[good])
    middle = seen(cell, T, cell.board.outline.mean(axis=0)[None])[:, 0]
    places = pixels_of(cell, middle)
    assert (np.ptp(places, axis=0) > [500.0, 350.0]).all()
    assert np.ptp(np.linalg.norm(middle, axis=1)) > 0.1
    calibrated = board_cell(measurement={"estimate_lens": False})
    kept = grid_poses(calibrated, np.array([10.0, 10.0, 10.0])).postures
    there = seen(calibrated, calibrated.robot.fk(kept), calibrated.board.outline.mean(axis=0)[None])
    np.testing.assert_allclose(pixels_of(calibrated, there[:, 0]), [[640.0, 512.0]] * 27, atol=1e-6)


def _criteria(p: int, functions: np.ndarray) -> dict:
    found = {
        name: criterion_by_name(name, p, COUNT)
        for name in ("D", "A", "E", "cond_2", "O1", "O2", "O3", "O4", "O5")
    }
    found["tcp"] = mean_deviation(1e3 * functions)
    found["sigma"] = wanted_deviations([1.0] * p, p)
    return found


@pytest.fixture(scope="module")
def both(cell, pool):
    """Blocks as they are (N, 2K, p), and shortened, of a few candidates."""
    model = cell.model()
    some = pool.take(np.arange(FEW))
    return some.linearise(model).white_jacobian, some.white(model)


def test_shortened_blocks_have_the_same_information(both):
    whole, short = both
    assert whole.shape == (FEW, 70, 21)
    assert short.shape == (FEW, 13, 21)  # eight of a plane's homography, five of the distortion
    size = np.sqrt(np.einsum("nmp,nmp->p", whole, whole))
    informations = [np.einsum("nmp,nmq->npq", b / size, b / size) for b in both]
    np.testing.assert_allclose(*informations, rtol=0, atol=1e-15)
    assert shortened(short) is short


ALL = ("D", "A", "E", "cond_2", "O1", "O2", "O3", "O4", "O5", "tcp", "sigma")


@pytest.mark.parametrize("name", rest_in_slow(ALL, {"D", "cond_2", "O2", "tcp"}))
def test_every_criterion_chooses_the_same_of_shortened_blocks(cell, both, name):
    functions, _ = functions_over_work(cell, cell.model())
    criterion = _criteria(21, functions)[name]
    one, other = (select(blocks, COUNT, criterion, starts=1, bound=False) for blocks in both)
    np.testing.assert_array_equal(one.indices, other.indices)
    assert one.value == pytest.approx(other.value, rel=1e-6)


@pytest.mark.parametrize("method", rest_in_slow(["greedy", "exchange"], {"exchange"}))
def test_every_method_chooses_the_same_of_shortened_blocks(cell, both, method):
    functions, _ = functions_over_work(cell, cell.model())
    criterion = mean_deviation(1e3 * functions)
    few = [blocks[:14] for blocks in both]
    one, other = (select(blocks, COUNT, criterion, method) for blocks in few)
    np.testing.assert_array_equal(one.indices, other.indices)
    assert one.bound == pytest.approx(other.bound, rel=1e-4)
    fewest = [select_fewest(blocks, criterion, 1.2 * one.value).selection for blocks in few]
    np.testing.assert_array_equal(fewest[0].indices, fewest[1].indices)


def test_pools_are_linearised_a_few_at_a_time_to_the_same_blocks(cell, pool, monkeypatch):
    model = cell.model()
    whole = pool.white(model)
    monkeypatch.setattr("posedesign.candidates.candidate_poses._NUMBERS", 70 * 21 * 16)
    parts = pool.white(model)
    size = np.sqrt(np.einsum("nmp,nmp->p", whole, whole))
    informations = [np.einsum("nmp,nmq->npq", b / size, b / size) for b in (whole, parts)]
    np.testing.assert_allclose(*informations, rtol=0, atol=1e-15)


@FIXED
def test_what_the_camera_sees_moves_as_it_does(fixed):
    """The derivative that poses are chosen by, against differences of X, or Z, and of the lens."""
    cell = board_cell(fixed=fixed)
    model, there = cell.model(), cell.board_set_up
    points = np.array([[0.05, -0.08, 0.4], [0.0, 0.0, 0.5]])
    pixels = there.lens.project(points)
    motion = seen_point_motion(
        model, model.nominal, (model.targets if fixed else model.tools)[0], there.lens, points
    )

    def place(x: np.ndarray) -> np.ndarray:
        lens = there.lens.with_values(x[12:])
        rays = lens.rays(pixels)
        in_camera = points[:, 2:] * np.column_stack([rays, np.ones(2)])
        frame = model.parameters[1 if fixed else 0]
        T = frame.poses(x[model.slices[1 if fixed else 0]])[0]
        return in_camera @ T[:3, :3].T + T[:3, 3]

    for k, unit in enumerate(model.units):
        step = {"px": 1e-2, "1": 1e-4}.get(unit, 1e-5) * (np.arange(model.p) == k)
        slope = (place(model.nominal + step) - place(model.nominal - step)) / (2.0 * step.max())
        np.testing.assert_allclose(motion[:, :, k], slope, rtol=1e-4, atol=1e-8)


@FIXED
def test_chosen_poses_keep_all_constraints_and_promise_what_they_are_worth(fixed, monkeypatch):
    monkeypatch.setattr(refinement, "MOST_SWEEPS", 3)
    cell = board_cell(fixed=fixed, pool={"candidates": 40})
    found = plan_optimal(cell, Request(count=COUNT, refine=fixed, beside=0))
    q = found.postures
    assert len(q) == COUNT
    assert found.reached
    check_constraints(cell, q)
    white = found.model.linearise(q).white_jacobian.reshape(-1, found.model.p)
    # with what is known of a lens before
    information = white.T @ white + np.diag(found.model.prior**-2.0)
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    np.testing.assert_allclose(found.accuracy.sigma, np.sqrt(np.diag(covariance)), rtol=1e-4)
    scored = score_poses(
        cell, PoseList(tuple(f"P{k}" for k in range(COUNT)), q, np.zeros(COUNT, dtype=bool))
    )
    assert not scored.not_feasible
    assert not scored.off_target
    assert not scored.problem
    given = {name: value for name, _, value in scored.sigma}
    assert given["lens.fx"] == pytest.approx(found.accuracy.sigma[12], rel=1e-4)


def test_the_next_pictures_gain_what_is_predicted(cell, pool):
    taken = pool.postures[:4]
    found = plan_next_views(cell, taken, 2)
    assert not found.why_not
    assert found.poses.kept_names == ("P05", "P06")
    assert (np.diff(found.tcp_m) < 0.0).all()
    functions, _ = functions_over_work(cell, cell.model())
    q = np.vstack([taken, found.poses.kept])
    model = cell.model()
    criterion = objective_of(Request(count=6), PriorArms(model), functions)
    assert 1e3 * found.tcp_m[-1] == pytest.approx(criterion.value_of(model.linearise(q)), rel=1e-5)
    check_constraints(cell, found.poses.kept)
    assert "what the camera sees known to" in found.message
    first = plan_next_views(cell, taken[:1], 1)
    assert first.message.startswith("go on: 1 picture does not yet identify everything")
    with pytest.raises(InputError, match="a least gain of 2"):
        plan_next_views(cell, taken, 1, least_gain=2.0)


def calibrated_file(cell, taken, folder, **changes):
    """What camera writes of a camera that is 20 mm and 2 deg off its description."""
    there = cell.board_set_up
    off = transform(rotation_exp(np.array([0.0, 0.035, 0.0])), np.array([0.02, 0.0, 0.0]))
    names = ("T_flange_camera", "T_base_board")
    if there.carried == "board":
        names = ("T_flange_board", "T_base_camera")
    lens = there.lens.with_values(np.array(there.lens.values) * [1.02, 1.02, *[1.0] * 7])
    K, terms = lens.to_opencv()
    content = {
        "camera": "fixed" if there.carried == "board" else "on-flange",
        names[0]: {"matrix_m": (there.X @ off).tolist()},
        names[1]: {"matrix_m": there.Z.tolist()},
        "lens": {
            "model": lens.name, "width_px": lens.width_px, "height_px": lens.height_px,
            "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2],
            "distortion": dict(zip(lens.names[4:], terms.tolist(), strict=True)),
        },
        "noise": {"pixel_sigma": 0.05, "arm_sigma_mm": 0.1, "arm_sigma_deg": 0.02},
        "joints_deg": {f"{k}.png": row for k, row in enumerate(np.degrees(taken).tolist())},
    }  # fmt: skip
    path = folder / "camera.json"
    path.write_text(json.dumps(content | changes))
    return path, lens, there.X @ off


def test_the_next_pictures_are_planned_with_the_camera_that_was_found(cell, pool, tmp_path):
    taken = pool.postures[:6]
    path, lens, X = calibrated_file(cell, taken, tmp_path)
    known, postures = as_calibrated(cell, path)
    np.testing.assert_allclose(postures, taken, atol=1e-12)
    np.testing.assert_allclose(known.board_set_up.X, X, atol=1e-12)
    np.testing.assert_allclose(known.board_set_up.lens.values, lens.values)
    kind = known.measurement
    assert kind.sigma[0] == pytest.approx(0.05)
    np.testing.assert_allclose(kind.arm_sigma, [1e-4, np.deg2rad(0.02)])
    found = plan_next_poses(
        cell, path, tmp_path / "next", 1, criterion="tcp", least_gain=0.02, accuracy_m=None
    )
    model = known.model()
    q = np.vstack([taken, found.poses.kept])
    functions, _ = functions_over_work(known, model)
    criterion = objective_of(Request(count=6), PriorArms(model), functions)
    assert 1e3 * found.tcp_m[-1] == pytest.approx(criterion.value_of(model.linearise(q)), rel=1e-5)
    # pixels and arm that scatter less than the cell says
    plain = plan_next_views(cell, taken, 1)
    assert found.tcp_m[0] < 0.5 * plain.tcp_m[0]


def test_a_camera_file_that_tells_nothing_of_it_is_refused(cell, pool, tmp_path):
    path, *_ = calibrated_file(cell, pool.postures[:4], tmp_path, joints_deg={})
    with pytest.raises(FileFormatError, match="does not have one camera, its noise and the joints"):
        as_calibrated(cell, path)
    path, *_ = calibrated_file(cell, pool.postures[:4], tmp_path, camera="fixed")
    with pytest.raises(FileFormatError, match="does not have one camera"):
        as_calibrated(cell, path)


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (Request(count=8, criterion="C_G"), "C_G is of the entries of every row"),
        (Request(count=8, robust="worst"), "tried by touching"),
    ],
)
def test_what_pictures_cannot_be_chosen_by_is_refused(cell, request_, words):
    with pytest.raises(InputError, match=words):
        plan_optimal(cell, request_)


def test_a_board_in_the_middle_at_the_base_pose_is_found_by_the_arm(cell):
    """Poses of the tip and of the camera against the board are each other's inverse."""
    there = cell.board_set_up
    T = cell.robot.fk(cell.base_posture)[None]
    np.testing.assert_allclose(there.tip_poses(there.cameras(T)), T, atol=1e-12)
    found = nearest_postures(cell.checker, there.tip_poses(there.cameras(T)), cell.base_posture)
    np.testing.assert_allclose(found.q[0], cell.base_posture, atol=1e-8)
    moved = replace(cell, target_m=cell.target_m + np.array([0.0, 0.0, 0.01]))
    np.testing.assert_allclose(moved.board_set_up.Z[2, 3] - there.Z[2, 3], 0.01, atol=1e-12)
