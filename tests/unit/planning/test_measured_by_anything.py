"""Plans for trackers, distances, planes, several targets, pins and payloads: what they promise."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib.errors import CalibError, InputError, NotIdentifiableError, UnreachableError
from calib.identification import covariance_of
from calib.identification.prediction import Expectation
from calib.model.measurements import Point
from calib.se3 import apply
from posedesign.autonomous.by_sight import run_by_sight
from posedesign.candidates import (
    away_from_singularities,
    box_of_cell,
    candidates_of,
    functions_over_work,
)
from posedesign.cell import Cell
from posedesign.files import Results
from posedesign.files.measurements import read_measurements
from posedesign.identification.instruments import read_measured
from posedesign.planning import plan
from posedesign.planning.checks import check_poses, score_poses
from posedesign.planning.optimal import OptimalPlan, Request, plan_next, plan_optimal
from posedesign.planning.optimal.sequential import BEFORE_MEASURING
from posedesign.planning.poses_file import PoseList, read_poses, write_poses
from posedesign.pose_programs import import_touch_ups, program_options, write_program
from posedesign.pose_programs.correction import predict
from posedesign.pose_programs.recording import Recording
from posedesign.report.plots import figure_of_plan, plot
from posedesign.report.tour import Tour
from posedesign.simulation import SimulatedRobot, accuracy_study
from tests.measured_cells import (
    ARMS,
    KINDS,
    MARKS,
    POSES,
    TRACKER,
    cell_text,
    check_scatter,
    measured_cell,
    planned,
    scatter_over_predicted,
)

ARM = "kr6r900sixx"


def listed_of(chosen: OptimalPlan) -> PoseList:
    return PoseList.of_route(chosen.poses, chosen.route)


QUICK = ("two pins", "planes", "reflectors", "mixed")
"""What every run simulates; the others are of the same parts, or of those that other tests have."""


@pytest.mark.parametrize(
    "kind", [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in KINDS]
)
def test_parameters_scatter_as_predicted(kind):
    check_scatter(scatter_over_predicted(measured_cell(kind, ARM)))


OTHERS = [
    pytest.param(arm, kind, marks=() if (i + k) % 3 == 0 else pytest.mark.full)
    for i, arm in enumerate(arm for arm in ARMS if arm != ARM)
    for k, kind in enumerate(KINDS)
]
"""Each kind by one of the other arms, by all of them where everything is run."""


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "kind"), OTHERS)
def test_parameters_of_other_arms_scatter_as_predicted(arm, kind):
    check_scatter(scatter_over_predicted(measured_cell(kind, arm)))


@pytest.mark.parametrize("kind", ["reflectors", "distances", "planes", "two pins", "mixed"])
def test_poses_of_a_list_say_what_they_are_of(kind, tmp_path):
    """What is planned is judged alike when its file is read again, and drawn."""
    cell = measured_cell(kind, ARM)
    chosen = planned(cell)
    path = tmp_path / "poses.csv"
    write_poses(path, cell.robot, chosen.poses, chosen.route, cell.tool_m)
    listed = read_poses(path, 6)
    assert all(verdict.ok for verdict in check_poses(cell, listed))
    scored = score_poses(cell, listed.measured)
    assert not scored.off_target
    assert not scored.problem
    assert not scored.not_feasible
    promised = {name: value for name, _, value in scored.sigma}
    np.testing.assert_allclose(
        sorted(promised.values()),
        sorted(
            value * (1e3 if unit == "m" else np.rad2deg(1.0))
            for value, unit in zip(chosen.accuracy.sigma, chosen.model.units, strict=True)
        ),
        rtol=1e-5,
    )
    if len(cell.observations) > 1:
        assert len({tuple(label.items()) for label in listed.measured.labels}) > 1
        unsaid = replace(listed.measured, extra={})
        with pytest.raises(InputError, match="does not say which"):
            score_poses(cell, unsaid)
    figure_of_plan(cell, chosen.arms, chosen.postures, chosen.setup)
    plot(chosen)


def test_a_pose_of_a_target_that_the_cell_has_not_is_refused():
    cell = measured_cell("two targets", ARM)
    with pytest.raises(InputError, match="middle, which the cell does not measure") as refused:
        cell.which([{"target": "middle"}])
    assert "low" in refused.value.hint


def test_marks_are_seen_as_a_second_calculation_finds():
    """Angle, distance, and lines of sight through boxes, point by point along each line."""
    text = cell_text("reflectors", f'preset = "{ARM}"', ARMS[ARM]) + (
        '[[obstacle]]\nname = "pillar"\nsize_mm = [400.0, 400.0, 3000.0]\n'
        "at_mm = [1500.0, 500.0, 700.0]\n"
        '[[obstacle]]\nname = "beam"\nsize_mm = [300.0, 3000.0, 200.0]\n'
        "at_mm = [1800.0, 500.0, 400.0]\n"
    )
    text = text.replace('name = "tracker"\n', 'name = "tracker"\nfarthest_mm = 2500.0\n')
    cell = Cell.from_text(text)
    rng = np.random.default_rng(5)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (400, 6))
    setup = cell.setup(cell.model(), q)
    seen = setup.seen[:, 0].reshape(400, 3)
    T, head = cell.robot.fk(q), cell.whereabouts.target_m
    boxes = [np.array(o.size_mm) / 2e3 for o in cell.config.obstacle]
    middles = [np.array(o.at_mm) / 1e3 for o in cell.config.obstacle]
    expected = np.zeros_like(seen)
    arm_in_way = np.zeros_like(seen)
    for k, mark in enumerate(cell.config.tool.mark):
        at = apply(T, np.broadcast_to(np.array(mark.point_mm) / 1e3, (400, 3)))
        sight = head - at
        away = np.linalg.norm(sight, axis=1)
        good = away < 2.5
        if mark.axis is not None:
            faced = T[:, :3, :3] @ (np.array(mark.axis) / np.linalg.norm(mark.axis))
            angle = np.arccos(np.clip((faced * sight).sum(axis=1) / away, -1, 1))
            good &= angle < np.deg2rad(mark.largest_angle_deg)
        along = at[:, None] + np.linspace(0.03, 0.99, 800)[:, None] * sight[:, None]
        for half, middle in zip(boxes, middles, strict=True):
            good &= ~(np.abs(along - middle) < half).all(axis=2).any(axis=1)
        expected[:, k] = good
        # the arm's own shapes are another matter: it only takes away
        arm_in_way[:, k] = good & ~seen[:, k]
    assert not (seen & ~expected).any()
    assert expected.any()
    assert seen.sum() > 0
    assert arm_in_way.sum() < expected.sum()


@pytest.mark.parametrize("kind", ["reflectors", "distances", "point"])
def test_candidates_are_seen_and_in_range(kind):
    cell = measured_cell(kind, ARM)
    pool = candidates_of(cell)
    for k, part in enumerate(cell.parts):
        own = pool.postures[pool.of == k]
        assert len(own) > 30
        target = part.config.target
        point = cell.robot.state(own).point(part.tool_m)
        away_mm = 1e3 * np.linalg.norm(point - part.whereabouts.target_m, axis=1)
        if kind == "distances":
            assert target.nearest_mm - 1e-6 < away_mm.min()
            assert away_mm.max() < target.farthest_mm + 1e-6
            assert np.ptp(away_mm) > 0.8 * (target.farthest_mm - target.nearest_mm)
        assert part.checker.check(own).feasible.all()


def test_noise_that_grows_is_that_of_its_covariance():
    """Along the line of sight and across it, by many draws, against a matrix written out."""
    kind = Point(2e-5, 1e-5, 4e-5)
    cell = measured_cell("point", ARM)
    model = cell.model().with_measurements([kind])
    q = candidates_of(cell).postures[:3]
    view = model.view(q)
    rng = np.random.default_rng(1)
    many = 40_000
    drawn = rng.standard_normal((3, 3 * many))
    draws = kind.colour(drawn, model.view(np.repeat(q, many, axis=0))).reshape(3, 3, many)
    for i in range(3):
        p = view.in_target(view.error)[:, i]
        away = np.linalg.norm(p)
        u = p / away
        covariance = (
            4e-10 * np.eye(3)
            + (1e-5 * away) ** 2 * np.outer(u, u)
            + (4e-5 * away) ** 2 * (np.eye(3) - np.outer(u, u))
        )
        found = np.cov(draws[:, i])
        assert np.abs(found - covariance).max() < 0.03 * covariance.max()
    rows = rng.standard_normal((3, 3))
    np.testing.assert_allclose(kind.whiten(kind.colour(rows, view), view), rows, atol=1e-12)
    doubled = kind.with_noise(2.0)
    np.testing.assert_allclose(doubled.colour(rows, view), 2.0 * kind.colour(rows, view))
    with pytest.raises(InputError, match="one constant part"):
        Point([1e-5, 1e-5, 2e-5], 1e-6)
    with pytest.raises(InputError, match="less than nothing"):
        Point(1e-5, -1e-6)


def test_what_is_measured_together_is_what_is_measured_one_by_one():
    cell = measured_cell("reflectors", ARM)
    model = cell.model()
    q = candidates_of(cell).postures[:12]
    together = cell.setup(model, q)
    rows, apart = cell.one_by_one(model, q, np.zeros(12, dtype=int))
    assert together.together == 3
    assert 12 < len(rows) < 36
    for weighted in (True, False):
        one = covariance_of(model, q, setup=together, weighted=weighted)
        other = covariance_of(model, q[rows], setup=apart, weighted=weighted)
        if weighted:
            np.testing.assert_allclose(one, other, rtol=1e-6)
        assert np.isfinite(one).all()


def test_the_next_pose_is_of_the_target_that_tells_most():
    """Of all candidates of both targets, each tried by itself."""
    cell = measured_cell("two targets", ARM)
    chosen = planned(cell, 16)
    which = cell.which(chosen.labels)
    robot, own = SimulatedRobot.of(cell), which == 0
    rng = np.random.default_rng(2)
    names = [f"P{i + 1:02d}" for i in range(own.sum())]
    data = robot.measure(chosen.postures[own], which[own], names, rng)
    found = plan_next(cell, data, 1)
    assert "target.high" in found.why_not
    assert found.poses.names[0] == f"P{own.sum() + 1:02d}"
    model, pool = cell.model(), candidates_of(away_from_singularities(cell))
    data = data.with_labels(model.targets, model.tools)
    told = model.linearise(data.postures, setup=data.setup).white_jacobian.reshape(-1, model.p)
    wide = np.diag([1.0 / BEFORE_MEASURING[unit] for unit in model.units])
    known = told.T @ told + wide @ wide
    box = functions_over_work(cell, model)[0]
    each = [
        np.sqrt(np.einsum("kip,pq,kiq->", box, np.linalg.inv(known + g.T @ g), box) / len(box))
        for g in pool.white(model)
    ]
    assert found.tcp_m[-1] == pytest.approx(min(each), rel=1e-6)
    assert found.poses.labels[0]["target"] == pool.target_names[pool.of[int(np.argmin(each))]]


def test_the_next_poses_after_a_tracker_lower_the_error():
    cell = measured_cell("reflectors", ARM)
    chosen = planned(cell, 8)
    names = [f"P{i + 1:02d}" for i in range(8)]
    rng = np.random.default_rng(2)
    data = SimulatedRobot.of(cell).measure(chosen.postures, np.zeros(8, dtype=int), names, rng)
    found = plan_next(cell, data, 3)
    assert found.identified is not None
    assert (np.diff(found.tcp_m) < 0).all()
    with pytest.raises(InputError, match="measures no pose"):
        plan_next(cell, data, 3, kinds=["pose"])
    with pytest.raises(InputError, match="no target 'tracker'"):
        plan_next(measured_cell("distances", ARM), data, 3)


def test_poses_with_a_payload_are_a_tour_of_their_own():
    cell = measured_cell("payloads", "r2000ic165f")
    chosen = planned(cell)
    assert "compliance.joint_2" in chosen.model.names
    listed = listed_of(chosen)
    loads = listed.extra["payload"]
    changes = [i for i in range(1, len(loads)) if loads[i] != loads[i - 1]]
    assert len(changes) == 1
    before = changes[0] - 1
    np.testing.assert_allclose(listed.postures[before], cell.base_posture)
    assert listed.via[before]
    with pytest.raises(InputError, match="poses with the tool alone, weight"):
        listed.of_payload(None)
    heavy = listed.of_payload("weight")
    assert set(heavy.extra["payload"]) == {"weight"}
    assert len(heavy.names) + len(listed.of_payload("").names) == len(listed.names)
    with pytest.raises(InputError, match="not with 'wieght'"):
        listed.of_payload("wieght")


def test_a_target_that_tells_least_is_left_out_and_said():
    """A bar whose foot takes three poses to place, of a few."""
    arm = "r2000ic165f"  # with a pool of usual size: of few poses another choice is the best
    cell = Cell.from_text(cell_text("distances", f'preset = "{arm}"', ARMS[arm]))
    chosen = plan_optimal(cell, Request(count=17, beside=0))
    assert len(chosen.unused) == 1
    assert any(f"no pose is of {chosen.unused[0]}" in said for said in chosen.remarks)
    assert f"target.{chosen.unused[0]}.x" not in chosen.model.names
    assert np.isfinite(chosen.accuracy.tcp_m)


def test_the_loop_varies_about_the_first_target():
    cell = measured_cell("two targets", ARM)
    found = plan(cell)
    assert {label["target"] for label in found.labels} == {"low"}
    touched = cell.robot.state(found.postures).point(cell.tool_m)
    np.testing.assert_allclose(touched, np.broadcast_to(cell.target_m, touched.shape), atol=1e-9)


def test_joints_that_only_a_load_tells_are_left_out_of_the_plan():
    """Nothing shows how the first joint gives way, whose axis is upright."""
    chosen = planned(measured_cell("payloads", "r2000ic165f"))
    assert "compliance.joint_1" not in chosen.model.names


BAD = {
    "an instrument nowhere": (
        '[measurement]\nkind = "point"\n' + TRACKER,
        "key target.position_mm: where T1 stands is not said",
    ),
    "a bar of any length": (
        '[measurement]\nkind = "distance"\n[target]\nposition_mm = [800.0, 0.0, 0.0]\n',
        "key target.farthest_mm: how long T1 can be is not said",
    ),
    "shortest above longest": (
        "[target]\nnearest_mm = 500.0\nfarthest_mm = 400.0\n",
        "nearest_mm 500 is not below farthest_mm 400",
    ),
    "two of a name": (
        '[[target]]\nname = "A"\n[[target]]\nname = "A"\n',
        "two targets have the name 'A'",
    ),
    "an unknown payload": (
        '[measurement]\npayloads = ["wight"]\n[[payload]]\nname = "weight"\nmass_kg = 3.0\n'
        "com_mm = [0.0, 0.0, 0.0]\n",
        "the cell has no payload 'wight'",
    ),
    "a board besides": (
        '[[target]]\nname = "A"\n[[target]]\nname = "B"\nkind = "camera-pose"\n',
        "is planned by itself",
    ),
    "growth of a pose": (
        '[[noise]]\nkind = "pose"\nthree_sigma_mm = 0.1\nthree_sigma_deg = 0.1\n'
        "across_three_sigma_mm_per_m = 0.1\n",
        "noise that grows with the distance is of a point",
    ),
    "growth on three numbers": (
        '[[noise]]\nkind = "point"\nthree_sigma_mm = [0.1, 0.1, 0.2]\n'
        "across_three_sigma_mm_per_m = 0.1\n",
        "with one number as three_sigma_mm",
    ),
    "a mistyped key of the second": (
        '[[target]]\nname = "A"\n[[target]]\nname = "B"\npositon_mm = [1.0, 2.0, 3.0]\n',
        "there is no such key",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_cell_that_cannot_be_measured_says_why(case):
    text, message = BAD[case]
    head = (
        f'[robot]\npreset = "{ARM}"\n[tool]\npoint_mm = [40.0, 10.0, 120.0]\n'
        f"[base_pose]\nposture_deg = {list(ARMS[ARM])}\n"
    )
    with pytest.raises(CalibError) as refused:
        Cell.from_text(head + text)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_marks_do_not_go_with_a_camera_or_a_pose():
    head = f'[robot]\npreset = "{ARM}"\n[tool]\npoint_mm = [40.0, 10.0, 120.0]\n{MARKS}'
    head += f"[base_pose]\nposture_deg = {list(ARMS[ARM])}\n"
    for more, message in (
        ("[camera]\n", "marks are seen by an instrument or touch"),
        ('[measurement]\nkind = "pose"\n[target]\nposition_mm = [3000, 0, 0]\n', "as a whole"),
    ):
        with pytest.raises(CalibError, match=message):
            Cell.from_text(head + more)


def test_the_noise_of_an_instrument_has_to_be_said():
    text = cell_text("point", f'preset = "{ARM}"', ARMS[ARM]).replace(TRACKER, "")
    with pytest.raises(InputError, match="how well a point is measured is not known"):
        plan_optimal(Cell.from_text(text), Request(count=POSES))


def test_a_target_out_of_reach_is_named():
    text = cell_text("two targets", f'preset = "{ARM}"', ARMS[ARM])
    text += '[[target]]\nname = "far"\nposition_mm = [3000.0, 0.0, 500.0]\n'
    with pytest.raises(UnreachableError, match="far: none of"):
        plan_optimal(Cell.from_text(text), Request(count=POSES))


def test_named_offsets_that_cannot_be_told_are_refused():
    """The first joint turns with the tracker's frame."""
    text = cell_text("point", f'preset = "{ARM}"', ARMS[ARM])
    text += 'zero_offsets = ["joint_a1", "joint_a2"]\n'
    with pytest.raises(NotIdentifiableError, match="joint_a1"):
        plan_optimal(Cell.from_text(text), Request(count=POSES))


def test_the_file_of_a_tracker_is_read_by_the_names_of_the_plan(tmp_path):
    """Reflectors and frame of the cell: points by name, as a tracker's software writes them."""
    cell = measured_cell("reflectors", ARM)
    chosen = planned(cell, 12)
    names = [f"P{i + 1:02d}" for i in range(12)]
    rng = np.random.default_rng(4)
    data = SimulatedRobot.of(cell).measure(chosen.postures, np.zeros(12, dtype=int), names, rng)
    lines = ["pose,name,x_mm,y_mm,z_mm," + ",".join(f"j{k}_deg" for k in range(1, 7))]
    for i, name in enumerate(data.names):
        row = [*1e3 * data.observed[i], *np.rad2deg(data.postures[i])]
        mark = data.tools[data.setup.tool[i]]
        lines.append(f"{name},{mark}," + ",".join(f"{value:.9f}" for value in row))
    path = tmp_path / "tracker.csv"
    path.write_text("\n".join(lines) + "\n")
    text = cell_text("reflectors", f'preset = "{ARM}"', ARMS[ARM]) + (
        '[instrument.columns]\nreflector = "name"\npose = "pose"\n'
        'place = ["x_mm", "y_mm", "z_mm"]\n'
        "joints = [" + ", ".join(f'"j{k}_deg"' for k in range(1, 7)) + "]\n"
        '[instrument]\nunit = "mm"\njoint_unit = "deg"\n'
    )
    read = read_measured(Cell.from_text(text), path).table.data
    assert read.targets == ("tracker",)
    assert set(read.tools) <= {"R1", "R2", "R3"}
    assert read.count == data.count


def test_what_is_of_one_touched_target_is_refused_for_others(tmp_path):
    cell = measured_cell("two targets", ARM)
    with pytest.raises(InputError, match="the study is of one target that the tool point touches"):
        accuracy_study(cell)
    path = tmp_path / "cell.toml"
    path.write_text(cell_text("two targets", f'preset = "{ARM}"', ARMS[ARM]))
    with pytest.raises(InputError, match="a calibration by sight is of one target"):
        run_by_sight(path, tmp_path / "out")
    with pytest.raises(InputError, match="shows no more of a distance than its place does"):
        plan(measured_cell("distances", ARM))


def test_the_accuracy_over_a_box_is_predicted_for_whatever_is_measured(tmp_path):
    cell = measured_cell("mixed", ARM)
    chosen = planned(cell)
    box, _ = box_of_cell(cell)
    found = predict(cell, listed_of(chosen), box, tmp_path)
    model = chosen.model
    C = covariance_of(model, chosen.postures, setup=chosen.setup)
    left = Expectation(model, model.nominal, C, found.postures[found.reached])
    expected = left.of(model, model.nominal)
    assert expected.rms_m > 0.0
    np.testing.assert_allclose(found.rms_m[found.reached], expected.points_m, rtol=1e-6)


def test_a_scene_has_every_pose_of_several_targets():
    cell = measured_cell("two targets", ARM)
    chosen = planned(cell, 16)
    listed = listed_of(chosen)
    tour = Tour.of(cell, listed)
    assert len(tour.verdicts) == len(listed.names) + 1
    assert all(verdict.feasible for verdict in tour.verdicts[1:])
    assert Tour.of(cell).verdicts[0].feasible


def test_imported_touch_ups_are_of_the_targets_of_the_plan(tmp_path):
    text = cell_text("two targets", 'preset = "lrmate200id"', (0.0, 10.0, -10.0, 0.0, -60.0, 0.0))
    cell = Cell.from_text(text)
    chosen = planned(cell, 16)
    listed = listed_of(chosen)
    options = program_options(cell, listed, None)
    written = write_program(listed, tmp_path, "fanuc-ls", options, "CALIB01", cell)
    touched = re.sub(
        r"J2=( *)(-?\d+\.\d+)",
        lambda found: f"J2={found[1]}{float(found[2]) + 0.05:.3f}",
        written.paths[0].read_text(),
    )
    path = tmp_path / "BACK.LS"
    path.write_text(touched)
    found = import_touch_ups(cell, [path], listed, None)
    of = dict(zip(listed.names, listed.labels, strict=True))
    assert [found.touch_ups.targets[k] for k in found.touch_ups.setup.target] == [
        of[name]["target"] for name in found.touch_ups.names
    ]
    with pytest.raises(InputError, match="was written from the plan"):
        import_touch_ups(cell, [path], None, None)


def test_recorded_touch_ups_are_of_what_the_plan_says(tmp_path):
    """Two pins, then a tracker besides: which pin touched, and nothing of what is only read."""
    cell = measured_cell("two pins", "ur10e")
    listed = listed_of(planned(cell, 8)).measured
    (file,) = Results.of(tmp_path, "record").claim("measured", ("touchups.csv", "touch-ups"))
    recording = Recording.resume(cell, listed, file)
    for k in (1, 2, 3):
        recording.take(k, listed.postures[k - 1] + 1e-3)
    table = read_measurements(tmp_path / "touchups.csv", 6)
    assert [table.data.tools[k] for k in table.data.setup.tool] == list(listed.extra["tool"][:3])
    mixed = measured_cell("mixed", "ur10e")
    listed = listed_of(plan_optimal(mixed, Request(count=8))).measured
    (file,) = Results.of(tmp_path / "b", "record").claim("measured", ("touchups.csv", "touch-ups"))
    k = listed.extra["target"].index("tracker")
    with pytest.raises(InputError, match="is read by tracker, and not touched up"):
        Recording.resume(mixed, listed, file).take(k + 1, listed.postures[k] + 1e-3)
